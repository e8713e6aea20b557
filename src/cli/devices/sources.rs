//! Sockets and files that devices are read from: each on a task or a thread of its own.

use std::fs::File;
use std::io::{self, Read};
use std::net::SocketAddr;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use anyhow::Context;
use polyptych_devices::joystick::{self, JoystickEvent};
use polyptych_devices::osc::PACKET_BYTES_MAX;
use polyptych_devices::sensor_pose::SensorPose;
use polyptych_devices::spacenav;
use polyptych_devices::vrpn::{COOKIE, VrpnStream};
use polyptych_protocol::stream;
use polyptych_wall::Wall;
use polyptych_wall::device::{DeviceSource, HeadInput};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket};
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};

/// Maximum number of readings that wait for the bridge; the newest wait in the system's buffers.
const READINGS_MAX: usize = 256;

/// Pause before a device that cannot be opened, or has gone, is opened again.
const REOPEN_PAUSE: Duration = Duration::from_secs(1);

/// Time within which a VRPN server accepts the connection, and then sends its cookie. Afterwards
/// one with nobody in view may be silent.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(10);

/// Size of what is read of a stream at once, in bytes.
const READ_BYTES: usize = 16_384;

/// A reading or an event of the device with this index.
pub struct Reading {
    pub device: usize,
    pub what: ReadingKind,
}

/// The kind of a reading or an event.
pub enum ReadingKind {
    /// A UDP packet and its sender.
    Packet(SocketAddr, Vec<u8>),
    /// Values of a pad or a 3D mouse that have changed at once; at least one.
    Joystick(Vec<JoystickEvent>),
    /// A pose of the head's sensor.
    Pose(SensorPose),
    /// A reading that is damaged.
    Damaged(String),
    /// The device was opened.
    Opened,
    /// The device answers, but has sent no reading of its sensor yet.
    Silent(String),
    /// The device cannot be read.
    Failed(String),
}

/// Opens all devices of a wall. The receiver returns their readings.
///
/// # Errors
/// An address that cannot be listened to. A pad may be plugged in later.
pub async fn open(wall: &Wall) -> anyhow::Result<mpsc::Receiver<Reading>> {
    let (to_bridge, readings) = mpsc::channel(READINGS_MAX);
    for (index, device) in wall.devices.iter().enumerate() {
        let to_bridge = to_bridge.clone();
        match &device.source {
            DeviceSource::Osc { listen } => {
                let about = || {
                    let name = &device.name;
                    format!("device {name}: cannot listen to {listen}; end what does, or change it")
                };
                let socket = UdpSocket::bind(listen).await.with_context(about)?;
                tokio::spawn(read_packets(socket, index, to_bridge));
            }
            DeviceSource::Joystick { path } => {
                let path = path.clone();
                let thread = std::thread::Builder::new().name("joystick".into());
                let events = |bytes| joystick::event(bytes).into_iter().collect::<Vec<_>>();
                let open = |path: &str| File::open(path);
                let hint = "plug it in, or change path";
                thread.spawn(move || read_events(&path, hint, open, events, index, &to_bridge))?;
            }
            DeviceSource::Spacenav { path } => {
                let path = path.clone();
                let thread = std::thread::Builder::new().name("spacenav".into());
                let open = |path: &str| UnixStream::connect(path);
                let hint = "start spacenavd, or change path";
                let events = spacenav::events;
                thread.spawn(move || read_events(&path, hint, open, events, index, &to_bridge))?;
            }
            DeviceSource::Vrpn { server } => {
                let input = device.head.as_ref().map(|head| head.input.clone());
                if let Some(HeadInput::Vrpn { tracker, sensor }) = input {
                    let stream = VrpnStream::new(&tracker, sensor);
                    let hint = format!(
                        "the VRPN server {server} answers; no pose of sensor {sensor} of {tracker} \
                         has come yet, check both if none does"
                    );
                    tokio::spawn(read_vrpn(server.clone(), stream, hint, index, to_bridge));
                }
            }
        }
    }
    Ok(readings)
}

async fn read_packets(socket: UdpSocket, device: usize, to_bridge: mpsc::Sender<Reading>) {
    let mut buffer = vec![0; PACKET_BYTES_MAX];
    loop {
        let what = match socket.recv_from(&mut buffer).await {
            Ok((length, from)) => ReadingKind::Packet(from, buffer[..length].to_vec()),
            Err(error) => {
                sleep(REOPEN_PAUSE).await;
                ReadingKind::Failed(format!("its socket fails: {error}"))
            }
        };
        if to_bridge.send(Reading { device, what }).await.is_err() {
            return;
        }
    }
}

/// Reads the stream of a VRPN server, and connects again when it ends.
async fn read_vrpn(
    server: String,
    fresh: VrpnStream,
    hint: String,
    device: usize,
    to_bridge: mpsc::Sender<Reading>,
) {
    loop {
        let ended = read_vrpn_once(&server, fresh.clone(), &hint, device, &to_bridge).await;
        let failure = match ended {
            Ok(()) => return,
            Err(reason) => format!("the VRPN server {server}: {reason}"),
        };
        let what = ReadingKind::Failed(failure);
        if to_bridge.send(Reading { device, what }).await.is_err() {
            return;
        }
        sleep(REOPEN_PAUSE).await;
    }
}

/// Reads until the bridge has ended. The hint is given with the first bytes of each connection: a
/// tracker that the server does not have sends nothing, and the server does not say so.
///
/// # Errors
/// The reason for which the connection ended.
async fn read_vrpn_once(
    server: &str,
    mut vrpn: VrpnStream,
    hint: &str,
    device: usize,
    to_bridge: &mpsc::Sender<Reading>,
) -> Result<(), String> {
    let silent = || format!("it says nothing for {} s", ANSWER_TIME_MAX.as_secs());
    let connecting = timeout(ANSWER_TIME_MAX, TcpStream::connect(server)).await;
    let connected = connecting.map_err(|_| silent())?;
    let mut socket = connected.map_err(|error| format!("cannot connect: {error}; start it"))?;
    // A machine that is gone without a word is noticed by the system.
    stream::tune(&socket).map_err(|error| error.to_string())?;
    socket.write_all(COOKIE).await.map_err(|error| error.to_string())?;
    let mut buffer = vec![0; READ_BYTES];
    let mut is_first = true;
    loop {
        let reading = socket.read(&mut buffer);
        let read = if vrpn.has_cookie() {
            Ok(reading.await)
        } else {
            timeout(ANSWER_TIME_MAX, reading).await
        };
        let length = read.map_err(|_| silent())?.map_err(|error| error.to_string())?;
        if length == 0 {
            return Err("it has closed the connection".to_owned());
        }
        let readings = vrpn.read(&buffer[..length]).map_err(|error| error.to_string())?;
        if std::mem::take(&mut is_first) {
            let what = ReadingKind::Silent(hint.to_owned());
            if to_bridge.send(Reading { device, what }).await.is_err() {
                return Ok(());
            }
        }
        for reading in readings {
            let what = reading.map_or_else(ReadingKind::Damaged, ReadingKind::Pose);
            if to_bridge.send(Reading { device, what }).await.is_err() {
                return Ok(());
            }
        }
    }
}

/// Reads records of a size until the bridge ends; opens the path again if it has gone.
fn read_events<const BYTES: usize, Source: Read>(
    path: &str,
    hint: &str,
    open: impl Fn(&str) -> io::Result<Source>,
    events: impl Fn([u8; BYTES]) -> Vec<JoystickEvent>,
    device: usize,
    to_bridge: &mpsc::Sender<Reading>,
) {
    let send = |what| to_bridge.blocking_send(Reading { device, what }).is_ok();
    loop {
        let failure = match open(path) {
            Err(error) => format!("{path} cannot be opened: {error}; {hint}"),
            Ok(mut source) => {
                if !send(ReadingKind::Opened) {
                    return;
                }
                loop {
                    let mut bytes = [0; BYTES];
                    if let Err(error) = source.read_exact(&mut bytes) {
                        break format!("{path} has ended: {error}");
                    }
                    let events = events(bytes);
                    if !events.is_empty() && !send(ReadingKind::Joystick(events)) {
                        return;
                    }
                }
            }
        };
        if !send(ReadingKind::Failed(failure)) {
            return;
        }
        std::thread::sleep(REOPEN_PAUSE);
    }
}

#[cfg(test)]
mod tests {
    use tokio::net::TcpListener;

    use super::*;

    #[tokio::test]
    async fn each_connection_with_a_vrpn_server_says_that_no_pose_has_come_yet() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let server = listener.local_addr().expect("an address").to_string();
        let (to_bridge, mut readings) = mpsc::channel(READINGS_MAX);
        for _ in 0..2 {
            let serving = async {
                let (mut stream, _) = listener.accept().await.expect("a client");
                let mut hello = [0; COOKIE.len()];
                stream.read_exact(&mut hello).await.expect("a cookie");
                stream.write_all(COOKIE).await.expect("sent");
            };
            let vrpn = VrpnStream::new("Tracker0", 3);
            let reading = read_vrpn_once(&server, vrpn, "no pose yet", 0, &to_bridge);
            let (ended, ()) = tokio::join!(reading, serving);
            assert!(ended.is_err_and(|why| why.contains("closed")));
            let Reading { device, what } = readings.try_recv().expect("a reading");
            assert_eq!(device, 0);
            assert!(matches!(what, ReadingKind::Silent(hint) if hint == "no pose yet"));
        }
    }
}
