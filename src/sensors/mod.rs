//! Frames into samples: which vehicle, which inertial message, which units, which time.
//!
//! The [`Converter`] is deterministic: the same frames give the same samples, live or replayed. It knows the habits of
//! autopilots (a file each) and nothing of links or filters; about time decides its [`TimeLine`]. Measurements of logs that
//! hold no frames go through the same time line. Whatever is refused is counted, and what matters to the user becomes a
//! [`Notice`].

pub mod air;
mod ardupilot;
pub mod clipped;
mod compass;
pub mod flight;
pub mod gnss;
mod health;
pub mod imu;
pub mod modes;
pub mod notice;
pub mod operating;
mod px4;
pub mod source;
pub mod stuck;
pub mod truth;

use crate::link::frame::Frame;
use crate::link::systems::Systems;
use crate::timeline::{Measurement, Stamp, TimeCounts, TimeLine};
use gaware_mission::identity::Carrier;
use gaware_nav::earth::Geodetic;
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::{GnssFix, ImuSample, RestartReason, Sample};
use gaware_wire::heartbeat::Heartbeat;
use health::{Health, Verdict};
use imu::Unusable;
use mavlink::dialects::ardupilotmega::{GPS_RAW_INT_DATA, MavMessage};
pub use notice::{Notice, Severity};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use source::{Autopilot, ImuSource};
use source::{SourceChoice, Window};

/// Component of an autopilot.
pub const AUTOPILOT_COMPONENT: u8 = 1;
/// After so much message time without a heartbeat a vehicle is taken as it is, µs.
const HEARTBEAT_PATIENCE_US: u64 = 3_000_000;
/// For so long after a reboot messages come back one after the other, s of message time.
const REBOOT_SETTLES_S: f64 = 15.0;
/// Below this rate a maneuver cannot be followed, Hz.
const LOW_RATE_HZ: f64 = 20.0;
/// Seconds in a row of a low rate before the user is informed.
const LOW_RATE_PATIENCE: u32 = 5;
/// Notices that wait to be fetched; more are dropped, oldest first.
const MAX_NOTICES: usize = 256;

/// What the user may set.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConverterOptions {
    /// Listen to this system only; otherwise the autopilot that sends inertial data.
    pub vehicle: Option<u8>,
    /// Take this message whatever else arrives.
    pub source: Option<ImuSource>,
}

/// What came of the frames so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ConverterStats {
    /// Frames fed.
    pub frames: u64,
    /// Of other systems, gimbals, ground stations, companions.
    pub foreign: u64,
    /// Payloads that could not be read.
    pub undecodable: u64,
    /// Missing by the running numbers of the autopilot's frames: lost on the link, or left out by who recorded.
    pub frames_missing: u64,
    /// Inertial messages before a source was chosen.
    pub imu_before_choice: u64,
    /// Inertial messages of sources not in use.
    pub imu_other_source: u64,
    /// Without new gyro and accelerometer values.
    pub imu_not_updated: u64,
    /// With values that are no numbers.
    pub imu_not_finite: u64,
    /// Of a sensor whose values do not change while the vehicle moves.
    pub imu_stuck: u64,
    /// With a value at the end of the range of its sensor.
    pub imu_at_limit: u64,
    /// Given out with a value at the end of the integer range.
    pub imu_clipped: u64,
    /// GNSS messages without a 3-D fix.
    pub no_fix: u64,
    /// What the time line gave out and refused.
    #[serde(flatten)]
    pub time: TimeCounts,
}

impl ConverterStats {
    /// Inertial messages of the source in use that were refused.
    pub fn imu_dropped(&self) -> u64 {
        self.time.imu_duplicates
            + self.time.imu_backward
            + self.time.imu_unconfirmed
            + self.time.imu_invalid
            + self.time.imu_implausible
            + self.imu_not_updated
            + self.imu_not_finite
            + self.imu_stuck
            + self.imu_at_limit
    }
}

/// Turns the frames of one vehicle into samples.
#[derive(Debug, Clone)]
pub struct Converter {
    options: ConverterOptions,
    vehicle: Option<u8>,
    autopilot: Autopilot,
    heartbeat_seen: bool,
    /// A system that sends inertial messages, and when it began, while no heartbeat came.
    silent: Option<(u8, u64)>,
    kind: Option<VehicleKind>,
    time: TimeLine,
    sequence: Option<u8>,
    /// Frames missing since the last inertial message of the source in use.
    missing: u64,
    choice: SourceChoice,
    absent_windows: u32,
    slow_windows: u32,
    receiver: gnss::Receiver,
    calibration: px4::Calibration,
    compasses: compass::Compasses,
    air: air::AirMessages,
    has_fix: Option<bool>,
    systems: Systems,
    /// Until then, s, a change of the inertial source belongs to the reboot before it.
    rebooted_until_s: Option<f64>,
    /// Restarts that belong to the reboot before them.
    settling_restarts: u64,
    health: Health,
    stats: ConverterStats,
    notices: Vec<Notice>,
}

impl Converter {
    /// A converter that has seen nothing.
    pub fn new(options: ConverterOptions) -> Self {
        Self {
            options,
            vehicle: options.vehicle,
            autopilot: Autopilot::Unknown,
            heartbeat_seen: false,
            silent: None,
            kind: None,
            time: TimeLine::default(),
            sequence: None,
            missing: 0,
            choice: SourceChoice::new(options.source),
            absent_windows: 0,
            slow_windows: 0,
            receiver: gnss::Receiver::default(),
            calibration: px4::Calibration::default(),
            compasses: compass::Compasses::default(),
            air: air::AirMessages::default(),
            has_fix: None,
            systems: Systems::default(),
            rebooted_until_s: None,
            settling_restarts: 0,
            health: Health::default(),
            stats: ConverterStats::default(),
            notices: Vec::new(),
        }
    }

    /// Takes the next frame and appends the samples that come of it. The time of reception is part of the record of
    /// a flight, but the samples follow the autopilot's time alone: a replay at any speed gives the same.
    pub fn feed(&mut self, _received_us: u64, frame: &Frame, out: &mut Vec<Sample>) {
        self.stats.frames += 1;
        self.systems.record(frame);
        self.follow(out);
        let ours = frame.component_id == AUTOPILOT_COMPONENT
            && self.vehicle.is_none_or(|system| system == frame.system_id);
        if !ours {
            self.stats.foreign += 1;
            return;
        }
        self.count_missing(frame.sequence);
        // Ids of HEARTBEAT, SYS_STATUS, SYSTEM_TIME, GPS_RAW_INT, SCALED_IMU, RAW_IMU, ATTITUDE, SERVO_OUTPUT_RAW, VFR_HUD, HIGHRES_IMU,
        // SCALED_IMU2 and 3, BATTERY_STATUS, SCALED_PRESSURE, 2 and 3, AIRSPEED.
        if !matches!(frame.message_id, 0..=2 | 24 | 26 | 27 | 30 | 36 | 74 | 105 | 116 | 129 | 147)
            && !matches!(frame.message_id, 29 | 137 | 143 | 295)
        {
            return;
        }
        if let Some(heartbeat) = Heartbeat::of(frame) {
            self.heartbeat(frame.system_id, &heartbeat, out);
            return;
        }
        let Ok(message) = frame.decode() else {
            self.stats.undecodable += 1;
            return;
        };
        if self.vehicle.is_none() {
            self.without_heartbeat(frame.system_id, &message);
        } else {
            self.measurement(&message, out);
        }
    }

    /// Turns to the vehicle that sends inertial data, when the one followed so far sends none: a stray heartbeat was taken for it.
    fn follow(&mut self, out: &mut Vec<Sample>) {
        let next = self.systems.followed(self.vehicle);
        if self.options.vehicle.is_some() || self.vehicle.is_none() || next == self.vehicle {
            return;
        }
        let Some(system_id) = next else { return };
        let heard = self.systems.of(system_id);
        let autopilot = heard.map_or(Autopilot::Unknown, |h| Autopilot::of(h.autopilot));
        if self.time.counts().imu_samples > 0 {
            out.push(Sample::Restart(RestartReason::SourceChange));
        }
        self.vehicle = Some(system_id);
        self.autopilot = autopilot;
        self.kind = heard.and_then(|h| vehicle_kind(h.mav_type));
        self.time = TimeLine::default();
        (self.sequence, self.missing) = (None, 0);
        self.choice = SourceChoice::new(self.options.source);
        self.receiver = gnss::Receiver::default();
        self.has_fix = None;
        (self.rebooted_until_s, self.settling_restarts) = (None, 0);
        self.calibration = px4::Calibration::default();
        self.compasses = compass::Compasses::default();
        self.air = air::AirMessages::default();
        self.health = Health::default();
        self.tell(Notice::Vehicle { system_id, autopilot });
    }

    /// Takes a measurement of a log that holds no frames, and appends what follows from it.
    pub fn take(&mut self, measurement: &Measurement, out: &mut Vec<Sample>) {
        match measurement {
            Measurement::Imu(stamp, sample) => self.sample(*stamp, sample, out),
            Measurement::Fix(stamp, fix) => self.placed_fix(*stamp, fix, out),
            Measurement::Stream(_)
            | Measurement::Attitude(..)
            | Measurement::Field(..)
            | Measurement::Air(..)
            | Measurement::Operating(..) => {
                self.in_time(measurement, out);
            }
        }
    }

    /// Every sender numbers its frames from 0 to 255 and over again (MAVLink guide, "Packet Serialization"). What looks like
    /// more than half a turn is a frame out of order, or another link of the same sender.
    fn count_missing(&mut self, sequence: u8) {
        if let Some(last) = self.sequence.replace(sequence) {
            let missing = u64::from(sequence.wrapping_sub(last).wrapping_sub(1));
            if missing < 128 {
                self.stats.frames_missing += missing;
                self.missing += missing;
            }
        }
    }

    fn heartbeat(&mut self, system_id: u8, heartbeat: &Heartbeat, out: &mut Vec<Sample>) {
        if !heartbeat.is_of_vehicle() {
            return;
        }
        let autopilot = Autopilot::of(heartbeat.autopilot);
        self.kind = vehicle_kind(heartbeat.mav_type).or(self.kind);
        if !self.heartbeat_seen || self.autopilot != autopilot {
            self.heartbeat_seen = true;
            self.vehicle = Some(system_id);
            self.autopilot = autopilot;
            self.tell(Notice::Vehicle { system_id, autopilot });
        }
        self.in_time(&Measurement::Operating(None, operating::of_heartbeat(heartbeat)), out);
        if autopilot == Autopilot::Px4 && self.calibration.may_change(heartbeat.is_armed()) {
            out.push(Sample::Recalibrated);
        }
    }

    /// A vehicle whose heartbeat never comes (an extract of a log, a one-way bridge) is taken after a while.
    fn without_heartbeat(&mut self, system_id: u8, message: &MavMessage) {
        let Some(Ok(reading)) = imu::reading(message) else { return };
        self.stats.imu_before_choice += 1;
        let t_us = reading.stamp.raw_us();
        match self.silent {
            Some((system, since)) if system == system_id && t_us >= since => {
                if t_us - since >= HEARTBEAT_PATIENCE_US {
                    self.vehicle = Some(system_id);
                    self.tell(Notice::Vehicle { system_id, autopilot: Autopilot::Unknown });
                }
            }
            _ => self.silent = Some((system_id, t_us)),
        }
    }

    fn measurement(&mut self, message: &MavMessage, out: &mut Vec<Sample>) {
        match message {
            MavMessage::SYSTEM_TIME(m) => self.time.learn(m.time_unix_usec, m.time_boot_ms),
            MavMessage::GPS_RAW_INT(m) => self.fix(m, out),
            MavMessage::HOME_POSITION(m) if (m.latitude, m.longitude) != (0, 0) => {
                let degrees = |e7: i32| f64::from(e7) * 1e-7;
                let height_m = f64::from(m.altitude) * 1e-3;
                let home = Geodetic::from_degrees(degrees(m.latitude), degrees(m.longitude), height_m);
                out.push(Sample::Place(home));
            }
            MavMessage::ATTITUDE(m) => {
                let roll_pitch_yaw = [m.roll, m.pitch, m.yaw].map(f64::from);
                self.health.attitude(roll_pitch_yaw);
                self.in_time(&Measurement::Attitude(Stamp::BootMs(m.time_boot_ms), roll_pitch_yaw), out);
            }
            other => {
                if let Some(values) = operating::of_message(other) {
                    return self.in_time(&Measurement::Operating(None, values), out);
                }
                self.inertial(other, out);
                if let Some((stamp, sample)) = self.compasses.reading(other, self.autopilot) {
                    self.in_time(&Measurement::Field(stamp, sample), out);
                }
                for (stamp, sample) in self.air.readings(other) {
                    self.in_time(&Measurement::Air(stamp, sample), out);
                }
            }
        }
    }

    fn inertial(&mut self, message: &MavMessage, out: &mut Vec<Sample>) {
        let reading = match imu::reading(message) {
            None => return,
            Some(Ok(reading)) => reading,
            Some(Err(why)) => {
                match why {
                    Unusable::OtherInstance => self.stats.imu_other_source += 1,
                    Unusable::NotUpdated => self.stats.imu_not_updated += 1,
                    Unusable::NotFinite => self.stats.imu_not_finite += 1,
                }
                return;
            }
        };
        let counted = self
            .time
            .place_imu(reading.stamp)
            .and_then(|t_us| self.choice.count(reading.source, t_us, self.autopilot));
        if let Some(window) = counted {
            self.window(window, out);
        }
        match self.choice.current() {
            None => self.stats.imu_before_choice += 1,
            Some(current) if current != reading.source => self.stats.imu_other_source += 1,
            Some(_) => {
                self.stats.imu_clipped += u64::from(reading.clipped);
                self.sample(reading.stamp, &reading.sample, out);
                self.missing = 0;
            }
        }
    }

    /// A sample of the source in use: of a sensor that works it goes to the time line.
    fn sample(&mut self, stamp: Stamp, sample: &ImuSample, out: &mut Vec<Sample>) {
        if self.measures(stamp, sample, out) {
            self.in_time(&Measurement::Imu(stamp, *sample), out);
            let counts = self.time.counts();
            let misplaced = counts.imu_unconfirmed + counts.fix_misplaced;
            self.health.stamps(misplaced, &mut self.notices);
        }
    }

    /// Whether the sensor works. Motion ends with one that does not: its last samples were wrong, and what follows is unknown.
    fn measures(&mut self, stamp: Stamp, sample: &ImuSample, out: &mut Vec<Sample>) -> bool {
        let Some(t_us) = self.time.place_imu(stamp) else { return true };
        let new = match self.health.judge(t_us, sample, &mut self.notices) {
            Verdict::Good => return true,
            Verdict::AtLimit(new) => {
                self.stats.imu_at_limit += 1;
                new
            }
            Verdict::Stuck(new) => {
                self.stats.imu_stuck += 1;
                new
            }
        };
        if new {
            self.time.interrupt(RestartReason::SensorFault, out);
        }
        false
    }

    /// Hands a measurement to the time line, and reports fresh starts.
    fn in_time(&mut self, measurement: &Measurement, out: &mut Vec<Sample>) {
        let before = out.len();
        self.time.push(measurement, self.missing, out);
        for sample in out.get(before..).unwrap_or_default() {
            match sample {
                Sample::Restart(RestartReason::Reboot) => {
                    self.receiver = gnss::Receiver::default();
                    self.rebooted_until_s = self.time.now_s().map(|now| now + REBOOT_SETTLES_S);
                    push_notice(&mut self.notices, Notice::Reboot);
                }
                Sample::Restart(RestartReason::ClockJump) => {
                    push_notice(&mut self.notices, Notice::ClockJump)
                }
                Sample::Restart(RestartReason::ClockSetBack) => {
                    push_notice(&mut self.notices, Notice::ClockSetBack)
                }
                _ => {}
            }
        }
    }

    fn window(&mut self, window: Window, out: &mut Vec<Sample>) {
        if let Some(source) = window.change {
            // After a reboot the messages come back one after the other: that is one restart, not several.
            let settling =
                self.time.now_s().zip(self.rebooted_until_s).is_some_and(|(now, until)| now < until);
            let before = self.time.counts().restarts;
            self.in_time(&Measurement::Stream(source.stream()), out);
            if settling {
                self.settling_restarts += self.time.counts().restarts - before;
            }
            self.tell(Notice::SourceChosen { source, autopilot: self.autopilot });
        }
        if let (Some(source), None) = (self.options.source, self.choice.current()) {
            self.absent_windows += 1;
            if self.absent_windows == LOW_RATE_PATIENCE {
                self.tell(Notice::SourceAbsent { source });
            }
        }
        match window.rate_hz {
            Some(rate_hz) if rate_hz < LOW_RATE_HZ => {
                self.slow_windows += 1;
                if self.slow_windows == LOW_RATE_PATIENCE {
                    self.tell(Notice::RateTooLow { rate_hz });
                }
            }
            Some(rate_hz) if self.slow_windows >= LOW_RATE_PATIENCE => {
                self.slow_windows = 0;
                self.tell(Notice::RateGood { rate_hz });
            }
            _ => self.slow_windows = 0,
        }
    }

    fn fix(&mut self, m: &GPS_RAW_INT_DATA, out: &mut Vec<Sample>) {
        let has_fix = gnss::has_fix(m);
        if self.has_fix != Some(has_fix) {
            self.has_fix = Some(has_fix);
            self.tell(if has_fix { Notice::FixGained } else { Notice::NoFix });
        }
        if !has_fix {
            self.stats.no_fix += 1;
            return;
        }
        let stamp = (m.time_usec != 0).then_some(Stamp::Usec(m.time_usec));
        let fix = self.receiver.fix(m, 0.0);
        self.placed_fix(stamp, &fix, out);
    }

    fn placed_fix(&mut self, stamp: Option<Stamp>, fix: &GnssFix, out: &mut Vec<Sample>) {
        self.health.fix(fix);
        self.in_time(&Measurement::Fix(stamp, *fix), out);
    }

    fn tell(&mut self, notice: Notice) {
        push_notice(&mut self.notices, notice);
    }

    /// Takes the notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    /// What came of the frames so far.
    pub fn stats(&self) -> ConverterStats {
        let counts = *self.time.counts();
        let restarts = counts.restarts.saturating_sub(self.settling_restarts);
        ConverterStats { time: TimeCounts { restarts, ..counts }, ..self.stats }
    }

    /// The time line.
    pub fn time(&self) -> &TimeLine {
        &self.time
    }

    /// What flies, where its heartbeat says so.
    pub fn vehicle_kind(&self) -> Option<VehicleKind> {
        self.kind
    }

    /// Whether the receiver has a fix, as far as it has said.
    pub fn has_fix(&self) -> Option<bool> {
        self.has_fix
    }

    /// All vehicles in words where there are several and none was chosen; empty otherwise.
    pub fn several_vehicles(&self) -> String {
        let several = self.options.vehicle.is_none() && self.systems.vehicles() > 1;
        if several { self.systems.words() } else { String::new() }
    }

    /// All autopilots received.
    pub fn systems(&self) -> &Systems {
        &self.systems
    }

    /// The vehicle listened to.
    pub fn vehicle(&self) -> Option<u8> {
        self.vehicle
    }

    /// Its firmware.
    pub fn autopilot(&self) -> Autopilot {
        self.autopilot
    }

    /// The inertial message in use.
    pub fn source(&self) -> Option<ImuSource> {
        self.choice.current()
    }
}

fn push_notice(notices: &mut Vec<Notice>, notice: Notice) {
    if notices.len() >= MAX_NOTICES {
        notices.remove(0);
    }
    notices.push(notice);
}

/// What a type of MAVLink vehicle flies like (`MAV_TYPE` of `minimal.xml`); nothing for what does not fly.
fn vehicle_kind(mav_type: u8) -> Option<VehicleKind> {
    Some(match Carrier::of(mav_type)? {
        // The kinds of VTOL have wings to fly turns with.
        Carrier::Wings | Carrier::WingsAndRotors => VehicleKind::FixedWing,
        Carrier::Rotors => VehicleKind::Multirotor,
    })
}

#[cfg(test)]
mod tests;
