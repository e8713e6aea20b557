//! The bridge between the devices of a wall and its manager: the requests that it sends and their
//! times.
//!
//! The caller hands it what sockets and files deliver. [`Bridge::poll_request`] returns the next
//! request to send, and [`Bridge::poll_timeout`] the time of the next call.

use std::net::SocketAddr;

use polyptych_protocol::device_status::DeviceStatus;
use polyptych_protocol::feedback::Quantiles;
use polyptych_protocol::head_update::HeadUpdate;
use polyptych_protocol::request::Request;
use polyptych_wall::Wall;
use polyptych_wall::head::HeadPose;

use crate::Micros;
use crate::device_reader::{DeviceReader, sent_rotation};
use crate::head_pacer::HeadPacer;
use crate::joystick::JoystickEvent;
use crate::latency_meter::LatencyMeter;
use crate::sensor_pose::{HeadSample, SensorPose};

/// Period of reports; the manager takes a device for lost once their client has gone.
pub const REPORT_PERIOD: Micros = 1_000_000;

/// Minimum time between two reports: a device that comes and goes floods nobody.
const REPORT_PERIOD_MIN: Micros = 100_000;

/// A time of the caller's clock that never comes: a century.
const IDLE_TIMEOUT: Micros = 3_155_760_000_000_000;

/// The purpose of a request of the bridge; the caller hands it back with the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A head whose newest reading came at this time, if any.
    Head(Option<Micros>),
    /// A flight.
    Flight,
    /// A report.
    Report,
}

/// The devices of a wall, and what the manager knows of them.
#[derive(Debug)]
pub struct Bridge {
    wall: Wall,
    readers: Vec<DeviceReader>,
    pacer: HeadPacer,
    meter: LatencyMeter,
    /// The last head that was sent, and the newest reading in it.
    sent: Option<(HeadSample, Option<Micros>)>,
    /// The newest reading in a head that was sent, to this manager or to one before.
    measured: Option<Micros>,
    /// `true` if the last head was part of a movement without readings: the head at its end is
    /// still to be sent.
    is_settling: bool,
    flight_waits: bool,
    report_waits: bool,
    reported: Option<Micros>,
    is_news: bool,
    /// `true` if the manager accepts this bridge's reports; `false` while another bridge reads the
    /// devices.
    is_accepted: bool,
    /// The last logged reason why the manager rejects reports.
    rejection: Option<String>,
    /// The last logged reason why the manager rejects flights, until it accepts one.
    flight_rejection: Option<String>,
    events: Vec<String>,
}

impl Bridge {
    /// Creates the bridge of the devices of a wall file.
    pub fn new(wall: &Wall) -> Self {
        let head = wall.head();
        Self {
            readers: wall.devices.iter().map(|device| DeviceReader::new(device, &head)).collect(),
            wall: wall.clone(),
            pacer: HeadPacer::default(),
            meter: LatencyMeter::default(),
            sent: None,
            measured: None,
            is_settling: false,
            flight_waits: false,
            report_waits: false,
            reported: None,
            is_news: true,
            is_accepted: false,
            rejection: None,
            flight_rejection: None,
            events: Vec::new(),
        }
    }

    /// Handles a UDP packet for the device with this index.
    pub fn handle_packet(&mut self, now: Micros, device: usize, from: SocketAddr, packet: &[u8]) {
        self.readers[device].handle_packet(now, from, packet);
    }

    /// Handles a reading of the pad or the 3D mouse with this index: values that have changed at
    /// once.
    pub fn handle_joystick(&mut self, now: Micros, device: usize, events: &[JoystickEvent]) {
        self.readers[device].handle_joystick(now, events);
    }

    /// Handles a pose of the head's sensor, from the device with this index.
    pub fn handle_pose(&mut self, now: Micros, device: usize, pose: &SensorPose) {
        self.readers[device].handle_pose(now, pose);
    }

    /// Counts and logs a damaged reading of the device with this index.
    pub fn handle_damage(&mut self, now: Micros, device: usize, reason: &str) {
        self.readers[device].refuse(now, "damaged", reason);
    }

    /// Marks the device with this index as live: it was opened.
    pub fn handle_life(&mut self, now: Micros, device: usize) {
        self.readers[device].handle_life(now);
    }

    /// Marks the device with this index as lost: it cannot be read.
    pub fn handle_failure(&mut self, now: Micros, device: usize, reason: &str) {
        self.readers[device].handle_failure(now, reason);
    }

    /// Handles the swap of a frame that began `frame_us` microseconds before.
    pub fn handle_swap(&mut self, now: Micros, frame_us: Micros) {
        self.meter.handle_swap(now, frame_us);
        self.pacer.handle_swap(now);
    }

    /// Handles the answer to a request; the error is the manager's reason to refuse it.
    pub fn handle_answer(&mut self, now: Micros, purpose: Purpose, answer: Result<(), String>) {
        match (purpose, answer) {
            (Purpose::Head(Some(reading)), Ok(())) => self.meter.handle_answer(now, reading),
            (Purpose::Head(_), Err(reason)) => {
                if let Some(at) = self.head_place() {
                    self.readers[at].refuse_head(now, &reason);
                }
            }
            (Purpose::Report, Ok(())) => (self.is_accepted, self.rejection) = (true, None),
            (Purpose::Report, Err(reason)) => {
                self.is_accepted = false;
                if self.rejection.as_ref() != Some(&reason) {
                    self.events.push(format!("nothing is sent: {reason}"));
                    self.rejection = Some(reason);
                }
            }
            (Purpose::Flight, Ok(())) => self.flight_rejection = None,
            // Flights come at the rate of displays while a stick is held.
            (Purpose::Flight, Err(reason)) => {
                if self.flight_rejection.as_ref() != Some(&reason) {
                    self.events.push(format!("the camera cannot fly: {reason}"));
                    self.flight_rejection = Some(reason);
                }
            }
            (Purpose::Head(None), Ok(())) => {}
        }
        self.finish(purpose);
    }

    /// Handles a request that stays unanswered because the connection was lost.
    pub fn handle_no_answer(&mut self, purpose: Purpose) {
        self.is_accepted = false;
        (self.reported, self.is_news) = (None, true);
        if matches!(purpose, Purpose::Head(_)) {
            self.sent = None;
        }
        self.finish(purpose);
    }

    fn finish(&mut self, purpose: Purpose) {
        match purpose {
            Purpose::Head(_) => self.pacer.handle_answer(),
            Purpose::Flight => self.flight_waits = false,
            Purpose::Report => self.report_waits = false,
        }
    }

    /// Resets what the manager knows of the devices, after a reconnection.
    pub fn handle_reconnect(&mut self) {
        self.meter.forget_waiting();
        (self.sent, self.reported, self.is_news) = (None, None, true);
        self.is_accepted = false;
    }

    /// Applies the changes that the passing of time causes; [`Self::poll_request`] does so too.
    pub fn advance(&mut self, now: Micros) {
        for reader in &mut self.readers {
            reader.advance(now);
            let events = reader.take_events();
            let is_news = reader.take_news() || !events.is_empty();
            self.is_news |= is_news;
            // An ease may begin and end between two heads; where it led must be sent all the same.
            self.is_settling |= is_news;
            self.events.extend(events);
        }
    }

    /// Returns the next request that is due, with its purpose. Until the manager has accepted a
    /// report, this bridge sends reports only.
    pub fn poll_request(&mut self, now: Micros) -> Option<(Purpose, Request)> {
        self.advance(now);
        if let Some(report) = self.take_report(now) {
            return Some((Purpose::Report, Request::ReportDevices(report)));
        }
        if !self.is_accepted {
            return None;
        }
        if let Some((reading, head)) = self.take_head(now) {
            return Some((Purpose::Head(reading), Request::SetHead(head)));
        }
        // Of several devices the one that has waited longest: one after the other flies, however
        // long an answer takes.
        let flights = self.readers.iter_mut().filter_map(|reader| reader.flight.as_mut());
        let due = flights.filter_map(|flight| Some((flight.due()?, flight)));
        let due = due.filter(|(due, _)| *due <= now && !self.flight_waits);
        let (_, controls) = due.min_by_key(|(due, _)| *due)?;
        let flight = controls.take(now)?;
        self.flight_waits = true;
        Some((Purpose::Flight, Request::Fly(flight)))
    }

    fn take_report(&mut self, now: Micros) -> Option<Vec<DeviceStatus>> {
        if self.report_waits || self.report_due() > now {
            return None;
        }
        (self.reported, self.is_news, self.report_waits) = (Some(now), false, true);
        Some(self.statuses(now))
    }

    fn report_due(&self) -> Micros {
        let Some(reported) = self.reported else { return 0 };
        reported + if self.is_news { REPORT_PERIOD_MIN } else { REPORT_PERIOD }
    }

    /// Returns the state of every device, in the order of the wall file.
    pub fn statuses(&self, now: Micros) -> Vec<DeviceStatus> {
        let status = |reader: &DeviceReader| {
            let is_head = reader.filter.is_some();
            let latency = if is_head { self.meter.quantiles() } else { Quantiles::default() };
            reader.status(now, latency)
        };
        self.readers.iter().map(status).collect()
    }

    fn head_place(&self) -> Option<usize> {
        self.readers.iter().position(|reader| reader.filter.is_some())
    }

    /// Returns the head if one is due, with the time of its newest reading.
    fn take_head(&mut self, now: Micros) -> Option<(Option<Micros>, HeadUpdate)> {
        if self.head_due().is_none_or(|due| due > now) {
            return None;
        }
        let at = self.head_place()?;
        let reader = &mut self.readers[at];
        let reading = reader.pose_at?;
        let filter = reader.filter.as_mut()?;
        let sample = filter.pose(now);
        self.is_settling = filter.is_moving();
        // Heads that are sent again, and those that are held, show no new reading.
        let is_measured = filter.is_tracked() && self.measured != Some(reading);
        let is_new = self.sent.is_none_or(|(_, of)| of != Some(reading));
        let is_same = self.sent.is_some_and(|(sent, _)| sent == sample);
        self.sent = Some((sample, Some(reading)));
        let pose =
            HeadPose { position: sample.position, rotation: sample.rotation, ..self.wall.head() };
        let refusal = self.wall.check_head(&pose).err();
        if let Some(error) = &refusal {
            self.readers[at].refuse_head(now, &error.to_string());
        }
        if refusal.is_some() || (is_same && !is_new) {
            self.pacer.record_skipped(now);
            return None;
        }
        let rotation = sent_rotation(&self.readers[at], &sample);
        self.pacer.record_sent(now);
        self.measured = Some(reading);
        let update = HeadUpdate { position: sample.position, rotation, eye_separation_m: None };
        Some((Some(reading).filter(|_| is_new && is_measured), update))
    }

    /// Returns the time of the next call of [`Self::poll_request`], or of [`Self::advance`] without
    /// a connection, if no reading comes before.
    pub fn poll_timeout(&self, is_connected: bool) -> Micros {
        let may_report = is_connected && !self.report_waits;
        let report = if may_report { self.report_due() } else { IDLE_TIMEOUT };
        let devices = self.readers.iter().filter_map(DeviceReader::poll_timeout);
        let flights = self.readers.iter().filter_map(|reader| reader.flight.as_ref()?.due());
        let may_fly = is_connected && self.is_accepted && !self.flight_waits;
        let flights = flights.filter(|_| may_fly);
        let head = self.head_due().filter(|_| is_connected && self.is_accepted);
        devices.chain(flights).chain(head).chain([report]).min().unwrap_or(report)
    }

    fn head_due(&self) -> Option<Micros> {
        let reader = &self.readers[self.head_place()?];
        let reading = reader.pose_at?;
        let is_new = self.sent.is_none_or(|(_, of)| of != Some(reading));
        let is_moving = self.is_settling || reader.filter.as_ref()?.is_moving();
        if !is_new && !is_moving {
            return None;
        }
        self.pacer.due(Some(reading).filter(|_| is_new))
    }

    /// Returns the events since the last call, as sentences.
    pub fn take_events(&mut self) -> Vec<String> {
        std::mem::take(&mut self.events)
    }
}

#[cfg(test)]
mod tests;
