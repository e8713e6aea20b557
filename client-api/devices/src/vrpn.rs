//! The byte stream of a VRPN server, version 7, over TCP alone.
//!
//! The format is that of the VRPN library's own description, `Format_Of_Protocol.txt`, and of
//! `vrpn_Connection.C` and `vrpn_Tracker.C`, 07.35. Each side begins with a cookie of 24 bytes. A
//! message is a head of six big-endian `i32` (length of head and body, seconds, microseconds,
//! sender, type, sequence number) and a body that is padded to a multiple of 8 bytes. Negative
//! types are the connection's own: −1 and −2 name a sender and a type, whose number stands in the
//! place of the sender. A client that describes no UDP port is sent all over TCP.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};

use crate::sensor_pose::SensorPose;

/// The cookie of a client that wants no log.
pub const COOKIE: &[u8; COOKIE_BYTES] = b"vrpn: ver. 07.35  0\0\0\0\0\0";

/// Size of a cookie in bytes.
pub const COOKIE_BYTES: usize = 24;

/// The beginning of the cookie of a compatible server: minor versions work together.
const COOKIE_PREFIX: &[u8] = b"vrpn: ver. 07.";

/// Size of the head of a message in bytes.
const HEAD_BYTES: usize = 24;

/// Maximum size of a message's body in bytes: that of VRPN's own TCP buffer.
const BODY_BYTES_MAX: usize = 64_000;

/// Maximum number of senders and of types: those of the library's tables.
const NAMES_MAX: usize = 2000;

/// Maximum length of a name in bytes.
const NAME_BYTES_MAX: usize = 255;

/// Size of the body of a report in bytes: sensor, padding, position and quaternion.
const REPORT_BYTES: usize = 64;

const TYPE_SENDER_NAME: i32 = -1;
const TYPE_TYPE_NAME: i32 = -2;

/// Name of the type of messages with a pose.
const POSE_TYPE: &str = "vrpn_Tracker Pos_Quat";

/// Range of the length of a quaternion: numbers of trackers are rounded.
const LENGTH_RANGE: std::ops::RangeInclusive<f64> = 0.9..=1.1;

/// The fault of a stream, which ends the connection.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VrpnError {
    /// The stream does not begin with the cookie of a VRPN server of version 7.
    #[error("it is no VRPN server of version 7")]
    Cookie,
    /// A message is shorter than its head or larger than any.
    #[error("a message of {0} bytes, where {HEAD_BYTES} to {BODY_BYTES_MAX} can be")]
    Length(i64),
    /// Too many names.
    #[error("the server has more than {NAMES_MAX} senders or types")]
    TooManyNames,
    /// A name that is longer than any, or not as long as it says.
    #[error("a damaged name")]
    Name,
}

/// A pose of the sensor, or the reason to ignore one.
pub type VrpnReading = Result<SensorPose, String>;

/// The stream of a server, as far as it was read.
#[derive(Clone, Debug)]
pub struct VrpnStream {
    tracker: String,
    sensor: i32,
    has_cookie: bool,
    bytes: Vec<u8>,
    /// The senders and the types that matter, and how many there are.
    senders: BTreeMap<i32, bool>,
    types: BTreeMap<i32, bool>,
}

impl VrpnStream {
    /// Creates the stream of a server, of which one sensor of a tracker is read.
    pub fn new(tracker: &str, sensor: i32) -> Self {
        Self {
            tracker: tracker.to_owned(),
            sensor,
            has_cookie: false,
            bytes: Vec::new(),
            senders: BTreeMap::new(),
            types: BTreeMap::new(),
        }
    }

    /// Returns whether the server's cookie has come. Afterwards a server without poses may say
    /// nothing for any time.
    pub fn has_cookie(&self) -> bool {
        self.has_cookie
    }

    /// Reads the bytes that came next. Returns the readings of the sensor in them.
    ///
    /// # Errors
    /// A fault after which nothing more can be read.
    pub fn read(&mut self, bytes: &[u8]) -> Result<Vec<VrpnReading>, VrpnError> {
        self.bytes.extend_from_slice(bytes);
        let mut readings = Vec::new();
        let mut at = 0;
        if !self.has_cookie {
            let known = self.bytes.len().min(COOKIE_PREFIX.len());
            if self.bytes[..known] != COOKIE_PREFIX[..known] {
                return Err(VrpnError::Cookie);
            }
            if self.bytes.len() < COOKIE_BYTES {
                return Ok(readings);
            }
            (self.has_cookie, at) = (true, COOKIE_BYTES);
        }
        let bytes = std::mem::take(&mut self.bytes);
        while let Some(head) = bytes.get(at..at + HEAD_BYTES) {
            let length = i64::from(integer(head, 0));
            let body = usize::try_from(length - HEAD_BYTES as i64).ok();
            let Some(body) = body.filter(|body| *body <= BODY_BYTES_MAX) else {
                return Err(VrpnError::Length(length));
            };
            let begin = at + HEAD_BYTES;
            let padded = body.next_multiple_of(8);
            let Some(whole) = bytes.get(begin..begin + padded) else { break };
            let (sender, kind) = (integer(head, 3), integer(head, 4));
            readings.extend(self.message(sender, kind, &whole[..body])?);
            at = begin + padded;
        }
        self.bytes = bytes[at..].to_vec();
        Ok(readings)
    }

    fn message(
        &mut self,
        sender: i32,
        kind: i32,
        body: &[u8],
    ) -> Result<Option<VrpnReading>, VrpnError> {
        let named = match kind {
            TYPE_SENDER_NAME => Some((&mut self.senders, self.tracker.as_str())),
            TYPE_TYPE_NAME => Some((&mut self.types, POSE_TYPE)),
            _ => None,
        };
        if let Some((names, wanted)) = named {
            let is_wanted = name(body)? == wanted.as_bytes();
            names.insert(sender, is_wanted);
            return if names.len() > NAMES_MAX { Err(VrpnError::TooManyNames) } else { Ok(None) };
        }
        let is_ours = |names: &BTreeMap<i32, bool>, number| names.get(&number) == Some(&true);
        if kind < 0 || !is_ours(&self.senders, sender) || !is_ours(&self.types, kind) {
            return Ok(None);
        }
        if body.len() < REPORT_BYTES {
            return Ok(Some(Err(format!("a report of {} bytes", body.len()))));
        }
        Ok((integer(body, 0) == self.sensor).then(|| reading(body)))
    }
}

/// Returns the reading in the body of a report of at least [`REPORT_BYTES`].
fn reading(body: &[u8]) -> VrpnReading {
    let number = |index: usize| {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(&body[8 * (index + 1)..8 * (index + 2)]);
        f64::from_be_bytes(bytes)
    };
    let position = DVec3::new(number(0), number(1), number(2));
    let quaternion = DQuat::from_xyzw(number(3), number(4), number(5), number(6));
    if !position.is_finite() || !LENGTH_RANGE.contains(&quaternion.length()) {
        return Err("a report whose numbers are no pose".to_owned());
    }
    Ok(SensorPose { position, rotation: Some(quaternion.normalize()) })
}

/// Returns the name in a description: its length with the zero at its end, then its bytes.
fn name(body: &[u8]) -> Result<&[u8], VrpnError> {
    let (length, rest) = body.split_first_chunk().ok_or(VrpnError::Name)?;
    let length = usize::try_from(i32::from_be_bytes(*length)).map_err(|_| VrpnError::Name)?;
    let text = rest.get(..length).filter(|_| length <= NAME_BYTES_MAX + 1);
    let text = text.ok_or(VrpnError::Name)?;
    Ok(text.split(|byte| *byte == 0).next().unwrap_or(text))
}

/// Returns the `i32` at an index of a head or body that is long enough.
fn integer(bytes: &[u8], index: usize) -> i32 {
    let mut number = [0; 4];
    number.copy_from_slice(&bytes[4 * index..4 * (index + 1)]);
    i32::from_be_bytes(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(sender: i32, kind: i32, body: &[u8]) -> Vec<u8> {
        let length = (HEAD_BYTES + body.len()) as i32;
        let head = [length, 1_700_000_000, 250_000, sender, kind, 77];
        let mut bytes: Vec<u8> = head.iter().flat_map(|number| number.to_be_bytes()).collect();
        bytes.extend_from_slice(body);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    fn description(name: &str) -> Vec<u8> {
        let length = name.len() as i32 + 1;
        [&length.to_be_bytes(), name.as_bytes(), b"\0"].concat()
    }

    fn report(sensor: i32, numbers: [f64; 7]) -> Vec<u8> {
        let mut body = [sensor.to_be_bytes(), [0; 4]].concat();
        body.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
        message(3, 9, &body)
    }

    fn server() -> Vec<u8> {
        let mut bytes = b"vrpn: ver. 07.34  0\0\0\0\0\0".to_vec();
        bytes.extend(message(0, TYPE_SENDER_NAME, &description("VRPN Control")));
        bytes.extend(message(3, TYPE_SENDER_NAME, &description("Tracker0")));
        bytes.extend(message(9, TYPE_TYPE_NAME, &description(POSE_TYPE)));
        bytes.extend(message(4, TYPE_TYPE_NAME, &description("vrpn_Base ping_message")));
        bytes.extend(message(3, 4, b""));
        bytes.extend(report(2, [1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]));
        bytes.extend(report(1, [9.0; 7]));
        bytes
    }

    #[test]
    fn reports_of_the_sensor_are_read_however_the_stream_is_cut() {
        let pose = SensorPose {
            position: DVec3::new(1.0, 2.0, 3.0),
            rotation: Some(DQuat::from_xyzw(0.0, 0.6, 0.0, 0.8)),
        };
        for step in [1, 7, 24, 1000] {
            let mut stream = VrpnStream::new("Tracker0", 2);
            let bytes = server();
            let parts = bytes.chunks(step).map(|part| stream.read(part).expect("a server"));
            let readings: Vec<VrpnReading> = parts.flatten().collect();
            assert_eq!(readings, [Ok(pose)], "{step}");
        }
        let mut other = VrpnStream::new("Tracker1", 2);
        assert_eq!(other.read(&server()), Ok(Vec::new()));
    }

    #[test]
    fn damaged_streams_end_and_damaged_reports_do_not() {
        let read = |bytes: &[u8]| VrpnStream::new("Tracker0", 2).read(bytes);
        assert_eq!(read(b"HTTP/1.1 400 Bad Request"), Err(VrpnError::Cookie));
        assert_eq!(read(b"vrpn: ver. 06.00"), Err(VrpnError::Cookie));
        let mut long = server();
        long.extend([0x7f; HEAD_BYTES]);
        assert!(matches!(read(&long), Err(VrpnError::Length(_))));
        let mut short = server();
        short.extend([0; HEAD_BYTES]);
        assert_eq!(read(&short), Err(VrpnError::Length(0)));
        let mut name = server();
        name.extend(message(7, TYPE_SENDER_NAME, &i32::MAX.to_be_bytes()));
        assert_eq!(read(&name), Err(VrpnError::Name));
        let mut names = server();
        for number in 0..=NAMES_MAX as i32 {
            names.extend(message(number, TYPE_TYPE_NAME, &description("t")));
        }
        assert_eq!(read(&names), Err(VrpnError::TooManyNames));
        let mut poses = server();
        poses.extend(report(2, [f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]));
        poses.extend(report(2, [0.0; 7]));
        poses.extend(message(3, 9, &[0; 12]));
        let readings = read(&poses).expect("it goes on");
        assert_eq!(readings.iter().filter(|reading| reading.is_err()).count(), 3);
        for end in 0..server().len() {
            let mut stream = VrpnStream::new("Tracker0", 2);
            let first = stream.read(&server()[..end]).expect("a beginning");
            assert!(first.len() <= 1);
            assert_eq!(stream.has_cookie(), end >= COOKIE_BYTES);
        }
    }
}
