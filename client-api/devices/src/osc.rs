//! OSC 1.0 packets: messages, and bundles of them.
//!
//! The format is that of M. Wright, *The Open Sound Control 1.0 Specification*, 2002: all is big
//! endian, and strings and blobs fill multiples of four bytes.

use std::str;

/// Maximum size of a packet in bytes: what a UDP datagram can hold.
pub const PACKET_BYTES_MAX: usize = 65_535;

/// Maximum depth of bundles in bundles; trackers send one.
pub const DEPTH_MAX: usize = 8;

/// Maximum number of messages in a packet: a tracker of a hundred bodies sends three for each.
pub const MESSAGES_MAX: usize = 512;

/// Maximum number of a message's arguments; a pose as a matrix has 16.
pub const ARGUMENTS_MAX: usize = 64;

/// The time tag that means "immediately".
const IMMEDIATELY: u64 = 1;

/// A message.
#[derive(Clone, Debug, PartialEq)]
pub struct OscMessage<'a> {
    /// The address, beginning with "/".
    pub address: &'a str,
    /// The arguments; brackets of arrays are left out.
    pub arguments: Vec<OscArgument<'a>>,
    /// The time tag of the innermost bundle, in units of 2⁻³² seconds since 1900; `None` outside
    /// of bundles and for "immediately".
    pub time_tag: Option<u64>,
}

/// An argument of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OscArgument<'a> {
    /// An integer of 32 or 64 bits.
    Integer(i64),
    /// A float of 32 or 64 bits; may be NaN or infinite.
    Float(f64),
    /// A string or a symbol.
    Text(&'a str),
    /// Bytes.
    Blob(&'a [u8]),
    /// True or false.
    Bool(bool),
    /// A time tag, a character, a colour, a MIDI message, nil or infinitum.
    Other,
}

impl OscArgument<'_> {
    /// Returns the number, with 1 for true and 0 for false; `None` if it is not a finite number.
    pub fn number(&self) -> Option<f64> {
        match *self {
            Self::Integer(number) => Some(number as f64),
            Self::Float(number) => Some(number).filter(|number| number.is_finite()),
            Self::Bool(is_true) => Some(f64::from(u8::from(is_true))),
            Self::Text(_) | Self::Blob(_) | Self::Other => None,
        }
    }
}

/// The fault of a packet; none of its messages count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OscError {
    /// The packet is larger than any datagram.
    #[error("the packet has more than {PACKET_BYTES_MAX} bytes")]
    TooLarge,
    /// The packet ends within an element.
    #[error("the packet is cut off")]
    CutOff,
    /// The packet begins with neither "/" nor "#bundle".
    #[error("neither a message nor a bundle")]
    Neither,
    /// A string is not UTF-8.
    #[error("a string is not UTF-8 text")]
    NotText,
    /// A message has no type tags.
    #[error("a message has no type tags")]
    NoTypeTags,
    /// A type tag that OSC 1.0 does not have.
    #[error("the type tag {:?} is unknown", char::from(*.0))]
    UnknownType(u8),
    /// Too many arguments.
    #[error("a message has more than {ARGUMENTS_MAX} arguments")]
    TooManyArguments,
    /// Too many messages.
    #[error("the packet has more than {MESSAGES_MAX} messages")]
    TooManyMessages,
    /// Bundles within bundles.
    #[error("bundles are nested deeper than {DEPTH_MAX}")]
    TooDeep,
    /// Bytes that belong to nothing.
    #[error("bytes follow the end of a message")]
    Trailing,
}

/// Reads the messages of a packet, in order.
///
/// # Errors
/// [`OscError`] for the first fault.
pub fn parse(packet: &[u8]) -> Result<Vec<OscMessage<'_>>, OscError> {
    if packet.len() > PACKET_BYTES_MAX {
        return Err(OscError::TooLarge);
    }
    let mut messages = Vec::new();
    element(packet, None, 0, &mut messages)?;
    Ok(messages)
}

/// Reads a message, or a bundle with all that is in it.
fn element<'a>(
    bytes: &'a [u8],
    time_tag: Option<u64>,
    depth: usize,
    messages: &mut Vec<OscMessage<'a>>,
) -> Result<(), OscError> {
    match bytes.first() {
        Some(b'/') if messages.len() >= MESSAGES_MAX => Err(OscError::TooManyMessages),
        Some(b'/') => {
            messages.push(message(bytes, time_tag)?);
            Ok(())
        }
        Some(b'#') => {
            let mut rest = Reader(bytes);
            if rest.text()? != "#bundle" {
                return Err(OscError::Neither);
            }
            if depth >= DEPTH_MAX {
                return Err(OscError::TooDeep);
            }
            let tag = u64::from_be_bytes(rest.take()?);
            let time_tag = Some(tag).filter(|tag| *tag != IMMEDIATELY);
            while !rest.0.is_empty() {
                let length = u32::from_be_bytes(rest.take()?);
                let inner = rest.bytes(usize::try_from(length).map_err(|_| OscError::CutOff)?)?;
                element(inner, time_tag, depth + 1, messages)?;
            }
            Ok(())
        }
        Some(_) => Err(OscError::Neither),
        None => Err(OscError::CutOff),
    }
}

fn message(bytes: &[u8], time_tag: Option<u64>) -> Result<OscMessage<'_>, OscError> {
    let mut rest = Reader(bytes);
    let address = rest.text()?;
    if rest.0.first() != Some(&b',') {
        return Err(OscError::NoTypeTags);
    }
    let types = rest.text()?;
    let mut arguments = Vec::with_capacity(types.len().min(ARGUMENTS_MAX));
    for tag in types.bytes().skip(1).filter(|tag| !b"[]".contains(tag)) {
        if arguments.len() >= ARGUMENTS_MAX {
            return Err(OscError::TooManyArguments);
        }
        arguments.push(match tag {
            b'i' => OscArgument::Integer(i32::from_be_bytes(rest.take()?).into()),
            b'h' => OscArgument::Integer(i64::from_be_bytes(rest.take()?)),
            b'f' => OscArgument::Float(f32::from_be_bytes(rest.take()?).into()),
            b'd' => OscArgument::Float(f64::from_be_bytes(rest.take()?)),
            b's' | b'S' => OscArgument::Text(rest.text()?),
            b'b' => {
                let length = u32::from_be_bytes(rest.take()?);
                let length = usize::try_from(length).map_err(|_| OscError::CutOff)?;
                let blob = rest.bytes(length)?;
                rest.bytes(length.next_multiple_of(4) - length)?;
                OscArgument::Blob(blob)
            }
            b'T' | b'F' => OscArgument::Bool(tag == b'T'),
            b'N' | b'I' => OscArgument::Other,
            b'c' | b'r' | b'm' => {
                rest.take::<4>()?;
                OscArgument::Other
            }
            b't' => {
                rest.take::<8>()?;
                OscArgument::Other
            }
            other => return Err(OscError::UnknownType(other)),
        });
    }
    if !rest.0.is_empty() {
        return Err(OscError::Trailing);
    }
    Ok(OscMessage { address, arguments, time_tag })
}

/// The bytes that are left of an element.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes(&mut self, count: usize) -> Result<&'a [u8], OscError> {
        let (found, rest) = self.0.split_at_checked(count).ok_or(OscError::CutOff)?;
        self.0 = rest;
        Ok(found)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], OscError> {
        self.bytes(N)?.try_into().map_err(|_| OscError::CutOff)
    }

    /// Reads a string that ends with a zero and fills a multiple of four bytes.
    fn text(&mut self) -> Result<&'a str, OscError> {
        let length = self.0.iter().position(|byte| *byte == 0).ok_or(OscError::CutOff)?;
        let bytes = self.bytes((length + 1).next_multiple_of(4))?;
        str::from_utf8(&bytes[..length]).map_err(|_| OscError::NotText)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The message of the specification's second example.
    const FOO: &[u8] = b"/foo\0\0\0\0,iisff\0\0\0\0\x03\xe8\xff\xff\xff\xffhello\0\0\0\
        \x3f\x9d\xf3\xb6\x40\xb5\xb2\x2d";

    fn bundle(tag: u64, elements: &[&[u8]]) -> Vec<u8> {
        let mut bytes = b"#bundle\0".to_vec();
        bytes.extend(tag.to_be_bytes());
        for element in elements {
            bytes.extend((element.len() as u32).to_be_bytes());
            bytes.extend_from_slice(element);
        }
        bytes
    }

    #[test]
    fn the_examples_of_the_specification_are_read() {
        let oscillator = b"/oscillator/4/frequency\0,f\0\0\x43\xdc\0\0";
        let message = &parse(oscillator).expect("a message")[0];
        assert_eq!(message.address, "/oscillator/4/frequency");
        assert_eq!(message.arguments, [OscArgument::Float(440.0)]);
        let foo = &parse(FOO).expect("a message")[0];
        let numbers: Vec<_> = foo.arguments.iter().map(OscArgument::number).collect();
        let (a, b) = (f64::from(1.234_f32), f64::from(5.678_f32));
        assert_eq!(numbers, [Some(1000.0), Some(-1.0), None, Some(a), Some(b)]);
        assert_eq!(foo.arguments[2], OscArgument::Text("hello"));
    }

    #[test]
    fn bundles_give_their_time_tags_and_every_type_its_length() {
        let all = b"/a\0\0,[hdb]TFNIctrmS\0\0\0\0\0\0\0\0\x07\
            \x3f\xe0\0\0\0\0\0\0\0\0\0\x05abcde\0\0\0cccctttttttt\x01\x02\x03\x04mmmmsym\0";
        let packet = bundle(9 << 32, &[all, &bundle(IMMEDIATELY, &[FOO])]);
        let messages = parse(&packet).expect("messages");
        assert_eq!([messages[0].time_tag, messages[1].time_tag], [Some(9 << 32), None]);
        let arguments = &messages[0].arguments;
        assert_eq!(arguments.len(), 12);
        assert_eq!(arguments[..2], [OscArgument::Integer(7), OscArgument::Float(0.5)]);
        assert_eq!(arguments[2], OscArgument::Blob(b"abcde"));
        assert_eq!(arguments[3].number(), Some(1.0));
        assert_eq!(arguments[11], OscArgument::Text("sym"));
    }

    #[test]
    fn damaged_packets_are_refused_and_never_panic() {
        let mut nested = FOO.to_vec();
        for _ in 0..=DEPTH_MAX {
            nested = bundle(IMMEDIATELY, &[&nested]);
        }
        let many: Vec<&[u8]> = vec![b"/a\0\0,\0\0\0"; MESSAGES_MAX + 1];
        let long = format!("/a\0\0,{}", "T".repeat(ARGUMENTS_MAX + 2));
        for (packet, error) in [
            (b"".as_slice(), OscError::CutOff),
            (b"\0\0\0\0", OscError::Neither),
            (b"#bundel\0", OscError::Neither),
            (b"/a\0\0", OscError::NoTypeTags),
            (b"/a\xff\0,\0\0\0", OscError::NotText),
            (b"/a\0\0,x\0\0", OscError::UnknownType(b'x')),
            (b"/a\0\0,\0\0\0\0\0\0\0", OscError::Trailing),
            (b"/a\0\0,b\0\0\xff\xff\xff\xff", OscError::CutOff),
            (&nested, OscError::TooDeep),
            (&bundle(5, &many), OscError::TooManyMessages),
            ([long.as_bytes(), b"\0\0\0"].concat().as_slice(), OscError::TooManyArguments),
            (&vec![b'/'; PACKET_BYTES_MAX + 1], OscError::TooLarge),
        ] {
            assert_eq!(parse(packet), Err(error));
        }
        for end in 0..FOO.len() {
            assert!(parse(&FOO[..end]).is_err(), "{end} bytes");
            assert!(parse(&bundle(7, &[FOO])[..end + 20]).is_err(), "{end} bytes of a bundle");
        }
        let nan = [b"/a\0\0,f\0\0".as_slice(), &f32::NAN.to_be_bytes()].concat();
        assert_eq!(parse(&nan).expect("a message")[0].arguments[0].number(), None);
    }
}
