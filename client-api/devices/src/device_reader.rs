//! A device: turns its readings into poses of the head and flights.

use std::net::SocketAddr;

use glam::DQuat;
use polyptych_protocol::device_status::{DeviceState, DeviceStatus};
use polyptych_protocol::feedback::Quantiles;
use polyptych_wall::device::{ControlInput, Device};
use polyptych_wall::head::{HEAD_REACH_MAX_M, HeadPose};

use crate::flight_controls::FlightControls;
use crate::joystick::JoystickEvent;
use crate::osc_input::OscInput;
use crate::packet_order::{OrderFault, PacketOrder};
use crate::pose_filter::{FilterEvent, PoseFilter};
use crate::sensor_pose::{HeadSample, SensorPose};
use crate::{Micros, micros_from_ms};

/// Time over which readings are counted for a rate.
const RATE_PERIOD: Micros = 1_000_000;

/// Minimum time between two events of one kind of a device: damaged packets may come by thousands.
const REPEAT_PERIOD: Micros = 10_000_000;

/// Maximum number of changes of a device's state that are logged one by one, until it has had none
/// for [`REPEAT_PERIOD`].
const CHANGES_MAX: u32 = 6;

/// Maximum length of a reason, in bytes.
const REASON_BYTES_MAX: usize = 256;

/// The reason of a device before its first reading.
const SILENT: &str = "no reading has come yet";

/// A device of the wall as its bridge reads it.
#[derive(Clone, Debug)]
pub(crate) struct DeviceReader {
    device: Device,
    osc: OscInput,
    order: PacketOrder,
    pub filter: Option<PoseFilter>,
    pub flight: Option<FlightControls>,
    state: DeviceState,
    since: Micros,
    reason: Option<String>,
    /// The time of the last valid reading.
    last: Option<Micros>,
    /// The time of the last pose that the head follows.
    pub pose_at: Option<Micros>,
    /// The time of the last packet with values of OSC controls; `None` once they are released.
    values_at: Option<Micros>,
    refused: u64,
    /// The start of the counting period and the number of readings since then.
    counted: (Micros, u64),
    rate_hz: f64,
    /// The time at which each kind of refusal was logged last.
    told: Vec<(&'static str, Micros)>,
    /// The start of the period in which changes of the state are counted, and their number.
    told_changes: Option<(Micros, u32)>,
    /// The last change of the state if it was not logged, and the changes since one was.
    untold: Option<String>,
    changes: u64,
    /// `true` if the state has changed since the last call of [`Self::take_news`].
    has_news: bool,
    events: Vec<String>,
}

impl DeviceReader {
    /// Creates a device without readings. `rest` is the head of the wall file.
    pub fn new(device: &Device, rest: &HeadPose) -> Self {
        let rest = HeadSample { position: rest.position, rotation: rest.rotation };
        let head = device.head.clone();
        Self {
            osc: OscInput::new(device),
            order: PacketOrder::new(micros_from_ms(device.lost_ms)),
            filter: head.map(|head| PoseFilter::new(head, device.lost_ms, rest)),
            flight: device.fly.clone().map(FlightControls::new),
            device: device.clone(),
            state: DeviceState::Waiting,
            since: 0,
            reason: Some(SILENT.into()),
            last: None,
            pose_at: None,
            values_at: None,
            refused: 0,
            counted: (0, 0),
            rate_hz: 0.0,
            told: Vec::new(),
            told_changes: None,
            untold: None,
            changes: 0,
            has_news: false,
            events: Vec::new(),
        }
    }

    /// Handles a UDP packet.
    pub fn handle_packet(&mut self, now: Micros, from: SocketAddr, packet: &[u8]) {
        let mut osc = self.osc.clone();
        let readings = match osc.read(now, packet) {
            Ok(readings) => readings,
            Err(fault) => {
                return self.refuse(now, "damaged", &format!("a packet of {from}: {fault}"));
            }
        };
        if readings.pose.is_none() && readings.values.is_empty() {
            // Something else of the sender, or half of a first pose.
            self.osc = osc;
            return;
        }
        if let Err(fault) = self.order.accept(now, from, readings.time_tag) {
            let kind = match fault {
                OrderFault::Overtaken => "overtaken",
                OrderFault::OtherSender(..) => "sender",
            };
            self.refused += 1;
            return self.tell(now, kind, &fault.to_string());
        }
        self.osc = osc;
        if let Some(flight) = &mut self.flight {
            for (place, value) in &readings.values {
                flight.set(now, *place, *value);
                self.values_at = Some(now);
            }
        }
        match readings.pose {
            Some(pose) => self.handle_pose(now, &pose),
            // A wand whose stick alone is heard does not track the head: it has to be named.
            None if self.filter.is_some() => {}
            None => self.handle_life(now),
        }
    }

    /// Handles a pose of the head's sensor, in the tracker's own axes.
    pub fn handle_pose(&mut self, now: Micros, pose: &SensorPose) {
        let (Some(filter), Some(head)) = (&mut self.filter, &self.device.head) else { return };
        let sample = HeadSample::from_sensor(&self.device.frame, head, pose);
        let position = sample.position;
        if !sample.is_finite() || position.abs().max_element() > HEAD_REACH_MAX_M {
            return self.refuse(now, "range", &format!("a head at {position} m is out of reach"));
        }
        let counts = filter.add(now, sample);
        self.take_filter_events(now);
        if counts {
            self.pose_at = Some(now);
            self.handle_life(now);
        } else {
            // A head that jumps is told of with its first jump.
            self.refused += 1;
        }
    }

    /// Handles a reading of a pad or a 3D mouse: values that have changed at once.
    pub fn handle_joystick(&mut self, now: Micros, events: &[JoystickEvent]) {
        self.handle_life(now);
        let Some(flight) = &mut self.flight else { return };
        for place in 0..5 {
            let input = flight.controls().controls()[place].map(|control| control.input.clone());
            for event in events {
                match (&input, event) {
                    (Some(ControlInput::Axis(of)), JoystickEvent::Axis(number, value))
                    | (Some(ControlInput::Button(of)), JoystickEvent::Button(number, value))
                        if of == number =>
                    {
                        flight.set(now, place, *value);
                    }
                    _ => {}
                }
            }
        }
    }

    /// Marks the device as live. A pad sends readings only when a value changes.
    pub fn handle_life(&mut self, now: Micros) {
        self.last = Some(now);
        self.counted.1 += 1;
        self.set_state(now, DeviceState::Live, None);
    }

    /// Marks the device as lost, or leaves it waiting if it never was live.
    pub fn handle_failure(&mut self, now: Micros, reason: &str) {
        let state = match self.state {
            DeviceState::Waiting => DeviceState::Waiting,
            DeviceState::Live | DeviceState::Lost => DeviceState::Lost,
        };
        self.lose(now, state, reason);
    }

    fn lose(&mut self, now: Micros, state: DeviceState, reason: &str) {
        if let Some(flight) = &mut self.flight {
            flight.release();
        }
        let reason = &reason[..reason.floor_char_boundary(REASON_BYTES_MAX)];
        self.set_state(now, state, Some(reason.to_owned()));
    }

    fn set_state(&mut self, now: Micros, state: DeviceState, reason: Option<String>) {
        if self.state != state {
            (self.state, self.since) = (state, now);
            self.has_news = true;
            let name = &self.device.name;
            let text = match &reason {
                Some(reason) => format!("device {name} is {}: {reason}", state.name()),
                None => format!("device {name} is {}", state.name()),
            };
            self.changes += 1;
            self.tell_change(now, text);
        } else if reason != self.reason
            && let Some(reason) = &reason
        {
            self.has_news = true;
            let text = format!("device {}: {reason}", self.device.name);
            self.tell_change(now, text);
        }
        self.reason = reason;
    }

    /// Logs a change of the state: the first [`CHANGES_MAX`], and of a device that goes on to come
    /// and go its state once a period, with the number of changes.
    fn tell_change(&mut self, now: Micros, text: String) {
        let is_over = |(since, _)| now.saturating_sub(since) >= REPEAT_PERIOD;
        if self.untold.is_none() && self.told_changes.is_none_or(is_over) {
            self.told_changes = Some((now, 0));
        }
        let Some((_, count)) = &mut self.told_changes else { return };
        *count += 1;
        if *count <= CHANGES_MAX {
            self.untold = None;
            self.changes = 0;
            self.events.push(text);
        } else {
            self.untold = Some(text);
        }
    }

    /// Returns the time at which the last change that was not logged is due.
    fn untold_due(&self) -> Option<Micros> {
        let (since, _) = self.told_changes.filter(|_| self.untold.is_some())?;
        Some(since + REPEAT_PERIOD)
    }

    /// Counts a reading that is ignored, and logs its kind.
    pub fn refuse(&mut self, now: Micros, kind: &'static str, reason: &str) {
        self.refused += 1;
        self.tell(now, kind, &format!("{reason}; it is ignored"));
    }

    /// Logs a kind of refusal, at most once in [`REPEAT_PERIOD`].
    fn tell(&mut self, now: Micros, kind: &'static str, reason: &str) {
        let at = self.told.iter_mut().find(|(of, _)| *of == kind);
        match at {
            Some((_, at)) if now.saturating_sub(*at) < REPEAT_PERIOD => return,
            Some((_, at)) => *at = now,
            None => self.told.push((kind, now)),
        }
        let mut text = format!("device {}: {reason}", self.device.name);
        text.truncate(text.floor_char_boundary(REASON_BYTES_MAX));
        self.events.push(text);
    }

    /// Counts and logs a tracked head that is refused.
    pub fn refuse_head(&mut self, now: Micros, reason: &str) {
        self.refuse(now, "head", &format!("the head cannot be there: {reason}"));
    }

    /// Applies the changes that the passing of time causes.
    pub fn advance(&mut self, now: Micros) {
        if let Some(filter) = &mut self.filter {
            filter.advance(now);
            self.take_filter_events(now);
        }
        if self.values_end().is_some_and(|ends| ends <= now) {
            self.values_at = None;
            if let Some(flight) = &mut self.flight {
                flight.release();
            }
        }
        if self.silence_ends().is_some_and(|ends| ends <= now) {
            let reason = format!("no usable reading for {} ms", self.device.lost_ms);
            self.lose(now, DeviceState::Lost, &reason);
        }
        if self.untold_due().is_some_and(|due| due <= now)
            && let Some(text) = self.untold.take()
        {
            let changes = std::mem::take(&mut self.changes);
            self.events.push(format!("{text}; its state has changed {changes} times"));
            self.told_changes = Some((now, CHANGES_MAX));
        }
        let (began, count) = self.counted;
        let elapsed = now.saturating_sub(began);
        if elapsed >= RATE_PERIOD {
            self.rate_hz = count as f64 / crate::seconds(elapsed);
            self.counted = (now, 0);
        }
    }

    /// Returns the time at which silence makes the device lost; `None` if it is not live, or a pad.
    fn silence_ends(&self) -> Option<Micros> {
        let is_read = self.state == DeviceState::Live && !self.device.source.is_read_by_change();
        let last = self.last.filter(|_| is_read)?;
        Some(last + micros_from_ms(self.device.lost_ms))
    }

    /// Returns the time at which silence releases OSC controls; poses do not hold them.
    fn values_end(&self) -> Option<Micros> {
        self.values_at.map(|at| at + micros_from_ms(self.device.lost_ms))
    }

    /// Returns the time at which [`Self::advance`] is due next.
    pub fn poll_timeout(&self) -> Option<Micros> {
        let filter = self.filter.as_ref().and_then(PoseFilter::poll_timeout);
        let dues = [self.silence_ends(), self.values_end(), self.untold_due(), filter];
        dues.into_iter().flatten().min()
    }

    fn take_filter_events(&mut self, now: Micros) {
        let events = self.filter.as_mut().map(PoseFilter::take_events).unwrap_or_default();
        let name = self.device.name.clone();
        for event in events {
            match event {
                // The device's own state says it.
                FilterEvent::Tracked | FilterEvent::Lost => {}
                FilterEvent::Jumped { distance_m } => {
                    let reason = format!("its head jumped by {distance_m:.2} m");
                    self.tell(now, "jump", &format!("{reason}; such readings wait to be steady"));
                }
                FilterEvent::Steady => {
                    self.events.push(format!("device {name}: the head is steady elsewhere"));
                }
                FilterEvent::Released => {
                    self.events.push(format!("device {name}: the head moves back to wall.eye"));
                }
            }
        }
    }

    /// Returns the state of the device, with the latency of its head.
    pub fn status(&self, now: Micros, latency_ms: Quantiles) -> DeviceStatus {
        DeviceStatus {
            name: self.device.name.clone(),
            state: self.state,
            since_ms: now.saturating_sub(self.since) / 1000,
            reason: self.reason.clone(),
            rate_hz: self.rate_hz,
            refused: self.refused,
            latency_ms,
        }
    }

    /// Returns whether the rotation of the head is tracked.
    pub fn has_rotation(&self) -> bool {
        use polyptych_wall::device::HeadInput;
        self.device.head.as_ref().is_some_and(|head| match &head.input {
            HeadInput::Osc { form, .. } => form.is_some(),
            HeadInput::Vrpn { .. } => true,
        })
    }

    /// Returns whether the state has changed since the last call.
    pub fn take_news(&mut self) -> bool {
        std::mem::take(&mut self.has_news)
    }

    /// Returns the events since the last call, as sentences.
    pub fn take_events(&mut self) -> Vec<String> {
        std::mem::take(&mut self.events)
    }
}

/// Returns the rotation to send; `None` if the rotation of the head is not tracked.
pub(crate) fn sent_rotation(reader: &DeviceReader, sample: &HeadSample) -> Option<DQuat> {
    reader.has_rotation().then_some(sample.rotation)
}
