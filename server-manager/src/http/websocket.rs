//! The frames of a WebSocket, as bytes in and out: RFC 6455 without sockets and without a clock.
//!
//! ```text
//! FIN 1 | RSV 3 | opcode 4 | MASK 1 | length 7 | length 16 or 64, big-endian | mask 32 | payload
//! ```
//!
//! Text comes in, of one frame or several. Frames of a client are masked, those of a server are
//! not (§ 5.1); control frames come between the parts of a text (§ 5.4).

use bytes::{Buf, Bytes, BytesMut};

/// Maximum size of a text, in bytes: a camera takes 300.
pub(super) const TEXT_BYTES_MAX: usize = 16 << 10;

/// Maximum size of the payload of a control frame, in bytes (§ 5.5).
const CONTROL_BYTES_MAX: usize = 125;

/// The reason that a frame cannot be, as the code of a close frame (§ 7.4.1) and in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub code: u16,
    pub reason: &'static str,
}

const fn fault(code: u16, reason: &'static str) -> Fault {
    Fault { code, reason }
}

/// The code of a close frame where the server goes away, or the peer was silent (§ 7.4.1).
pub(super) const GOING_AWAY: u16 = 1001;

/// A message of the peer.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Message {
    Text(String),
    Ping(Bytes),
    Pong,
    /// The peer ends the connection, with its code if it gave one.
    Close(Option<u16>),
}

/// Decodes the bytes of a peer into its messages.
#[derive(Debug, Default)]
pub(super) struct Decoder {
    bytes: BytesMut,
    /// The parts of a text that has not ended.
    text: Option<Vec<u8>>,
}

struct Head {
    is_last: bool,
    opcode: u8,
    mask: [u8; 4],
    /// The bytes of the head itself, and of the payload behind it.
    lengths: [usize; 2],
}

impl Decoder {
    /// Takes bytes as they came.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// Returns the next message; `None` until more bytes come.
    ///
    /// # Errors
    /// The fault of a frame. Nothing that follows has a meaning.
    pub fn next(&mut self) -> Result<Option<Message>, Fault> {
        loop {
            let Some(head) = self.head()? else { return Ok(None) };
            let [before, length] = head.lengths;
            if self.bytes.len() < before + length {
                return Ok(None);
            }
            self.bytes.advance(before);
            let mut payload = self.bytes.split_to(length);
            for (at, byte) in payload.iter_mut().enumerate() {
                *byte ^= head.mask[at % 4];
            }
            if let Some(message) = self.take(head.is_last, head.opcode, payload.freeze())? {
                return Ok(Some(message));
            }
        }
    }

    /// Returns the head of the next frame; `None` until all of it is there.
    fn head(&self) -> Result<Option<Head>, Fault> {
        let [first, second, rest @ ..] = &self.bytes[..] else { return Ok(None) };
        let (is_last, opcode) = (first & 0x80 != 0, first & 0x0f);
        if first & 0x70 != 0 {
            return Err(fault(1002, "no extension was agreed on"));
        }
        if second & 0x80 == 0 {
            return Err(fault(1002, "frames of a client are masked"));
        }
        let is_control = opcode & 0x08 != 0;
        let (length, more) = match second & 0x7f {
            126 if !is_control => match rest.first_chunk::<2>() {
                Some(bytes) => (u64::from(u16::from_be_bytes(*bytes)), 2),
                None => return Ok(None),
            },
            127 if !is_control => match rest.first_chunk::<8>() {
                Some(bytes) => (u64::from_be_bytes(*bytes), 8),
                None => return Ok(None),
            },
            length => (u64::from(length), 0),
        };
        if is_control && (!is_last || length > CONTROL_BYTES_MAX as u64) {
            return Err(fault(1002, "a control frame is whole, and of 125 bytes at most"));
        }
        let before = self.text.as_ref().map_or(0, Vec::len) as u64;
        if !is_control && length.saturating_add(before) > TEXT_BYTES_MAX as u64 {
            return Err(fault(1009, "a text has 16 KiB at most"));
        }
        let Some(mask) = rest.get(more..).and_then(|rest| rest.first_chunk::<4>()) else {
            return Ok(None);
        };
        Ok(Some(Head { is_last, opcode, mask: *mask, lengths: [2 + more + 4, length as usize] }))
    }

    fn take(
        &mut self,
        is_last: bool,
        opcode: u8,
        payload: Bytes,
    ) -> Result<Option<Message>, Fault> {
        match (opcode, self.text.take()) {
            (0, Some(mut text)) => {
                text.extend_from_slice(&payload);
                self.whole(is_last, text)
            }
            (0, None) => Err(fault(1002, "nothing was begun that could go on")),
            (1, None) => self.whole(is_last, payload.to_vec()),
            (1 | 2, Some(_)) => Err(fault(1002, "a text has not ended")),
            (2, None) => Err(fault(1003, "texts are taken, and no binary data")),
            (8..=10, text) => {
                self.text = text;
                control(opcode, payload).map(Some)
            }
            _ => Err(fault(1002, "there is no such opcode")),
        }
    }

    fn whole(&mut self, is_last: bool, text: Vec<u8>) -> Result<Option<Message>, Fault> {
        if !is_last {
            self.text = Some(text);
            return Ok(None);
        }
        let text = String::from_utf8(text).map_err(|_| fault(1007, "a text is UTF-8"))?;
        Ok(Some(Message::Text(text)))
    }
}

fn control(opcode: u8, payload: Bytes) -> Result<Message, Fault> {
    match (opcode, &payload[..]) {
        (9, _) => Ok(Message::Ping(payload)),
        (10, _) => Ok(Message::Pong),
        (_, []) => Ok(Message::Close(None)),
        (_, [high, low, reason @ ..]) => {
            let code = u16::from_be_bytes([*high, *low]);
            // § 7.4: those that may stand in a frame.
            let is_code = matches!(code, 1000..=1003 | 1007..=1014 | 3000..=4999);
            if !is_code || std::str::from_utf8(reason).is_err() {
                return Err(fault(
                    1002,
                    "there is no such code of an end, or its reason is no text",
                ));
            }
            Ok(Message::Close(Some(code)))
        }
        _ => Err(fault(1002, "the code of an end has two bytes")),
    }
}

/// Returns a text as a frame.
pub(super) fn text(text: &str) -> Bytes {
    frame(1, text.as_bytes())
}

/// Returns the frame that asks whether the peer is there.
pub(super) fn ping() -> Bytes {
    frame(9, b"")
}

/// Returns the answer to a ping, with its payload.
pub(super) fn pong(payload: &[u8]) -> Bytes {
    frame(10, payload)
}

/// Returns the close frame, with its code and a reason that is cut to 123 bytes.
pub(super) fn close(code: u16, reason: &str) -> Bytes {
    let end = reason.floor_char_boundary(CONTROL_BYTES_MAX - 2);
    frame(8, &[&code.to_be_bytes(), &reason.as_bytes()[..end]].concat())
}

fn frame(opcode: u8, payload: &[u8]) -> Bytes {
    let mut bytes = Vec::with_capacity(payload.len() + 10);
    bytes.push(0x80 | opcode);
    match payload.len() {
        length @ 0..=125 => bytes.push(length as u8),
        length @ 126..=0xffff => {
            bytes.push(126);
            bytes.extend_from_slice(&(length as u16).to_be_bytes());
        }
        length => {
            bytes.push(127);
            bytes.extend_from_slice(&(length as u64).to_be_bytes());
        }
    }
    bytes.extend_from_slice(payload);
    bytes.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame as a client sends it.
    fn masked(first: u8, payload: &[u8]) -> Vec<u8> {
        let mask = [0x37, 0xfa, 0x21, 0x3d];
        let mut bytes = vec![first];
        match payload.len() {
            length @ 0..=125 => bytes.push(0x80 | length as u8),
            length => {
                bytes.push(0x80 | 0x7e);
                bytes.extend((length as u16).to_be_bytes());
            }
        }
        bytes.extend(mask);
        bytes.extend(payload.iter().enumerate().map(|(at, byte)| byte ^ mask[at % 4]));
        bytes
    }

    fn all(bytes: &[u8]) -> Result<Vec<Message>, Fault> {
        let mut decoder = Decoder::default();
        decoder.feed(bytes);
        let mut messages = Vec::new();
        while let Some(message) = decoder.next()? {
            messages.push(message);
        }
        Ok(messages)
    }

    #[test]
    fn texts_come_whole_in_any_pieces() {
        // § 5.7: a masked text of one frame.
        let hello = [0x81, 0x85, 0x37, 0xfa, 0x21, 0x3d, 0x7f, 0x9f, 0x4d, 0x51, 0x58];
        assert_eq!(all(&hello), Ok(vec![Message::Text("Hello".into())]));
        let long = "ü".repeat(200);
        let parts = [
            masked(0x01, &long.as_bytes()[..101]),
            masked(0x89, b"there?"),
            masked(0x00, &long.as_bytes()[101..300]),
            masked(0x80, &long.as_bytes()[300..]),
            masked(0x81, b""),
            masked(0x8a, b""),
            masked(0x88, &[0x03, 0xe8]),
        ]
        .concat();
        let wanted = [
            Message::Ping(Bytes::from_static(b"there?")),
            Message::Text(long),
            Message::Text(String::new()),
            Message::Pong,
            Message::Close(Some(1000)),
        ];
        assert_eq!(all(&parts).expect("messages"), wanted);
        let (mut decoder, mut messages) = (Decoder::default(), Vec::new());
        for byte in parts {
            decoder.feed(&[byte]);
            while let Some(message) = decoder.next().expect("no fault") {
                messages.push(message);
            }
        }
        assert_eq!(messages, wanted);
    }

    #[test]
    fn frames_that_cannot_be_end_it_with_their_code() {
        let code = |bytes: &[u8]| all(bytes).map_err(|fault| fault.code);
        assert_eq!(code(b"\x81\x05Hello"), Err(1002), "unmasked");
        assert_eq!(code(&masked(0xc1, b"x")), Err(1002), "compressed");
        assert_eq!(code(&masked(0x82, b"x")), Err(1003), "binary");
        assert_eq!(code(&masked(0x83, b"x")), Err(1002), "an opcode that is not used");
        assert_eq!(code(&masked(0x80, b"x")), Err(1002), "a part of nothing");
        assert_eq!(code(&masked(0x09, b"x")), Err(1002), "a ping in parts");
        assert_eq!(code(&masked(0x89, &[b'x'; 126])), Err(1002), "a long ping");
        assert_eq!(code(&[masked(0x01, b"x"), masked(0x81, b"y")].concat()), Err(1002));
        assert_eq!(code(&masked(0x81, b"\xff")), Err(1007), "no UTF-8");
        assert_eq!(code(&masked(0x88, b"\x03")), Err(1002), "half a code");
        assert_eq!(code(&masked(0x88, &1005_u16.to_be_bytes())), Err(1002));
        assert_eq!(code(&masked(0x88, b"")), Ok(vec![Message::Close(None)]));
        // Refused by its head, before a byte of it is kept.
        let endless = [0x81, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        assert_eq!(code(&endless), Err(1009));
        let half = vec![b'x'; TEXT_BYTES_MAX / 2 + 1];
        assert_eq!(code(&[masked(0x01, &half), masked(0x80, &half)].concat()), Err(1009));
    }

    #[test]
    fn frames_of_the_server_have_the_shortest_head() {
        assert_eq!(text("Hello"), &b"\x81\x05Hello"[..]);
        assert_eq!(text(&"x".repeat(126))[..4], [0x81, 126, 0, 126]);
        let head = [0x81, 127, 0, 0, 0, 0, 0, 1, 0, 0];
        assert_eq!(text(&"x".repeat(0x10000))[..10], head);
        assert_eq!(close(1001, &"ü".repeat(100)).len(), 2 + 2 + 122);
        assert_eq!(
            (ping(), pong(b"a")),
            (Bytes::from_static(b"\x89\0"), Bytes::from_static(b"\x8a\x01a"))
        );
    }
}
