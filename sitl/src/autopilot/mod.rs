//! The simulated autopilot: a sans-I/O core that behaves on the wire as ArduPilot or as PX4 does (FIELD_NOTES).
//!
//! Feed it received bytes, [step](Autopilot::step) its virtual time, and take the frames it sends. It knows no clock and no
//! socket, so the same seed and the same input give the same bytes. The shell that puts it on a wire is
//! [`crate::shell`].

// The dialect calls much of what flies today superseded; vehicles speak it all the same.
#![allow(deprecated)]

mod commands;
mod feasibility;
mod flight;
mod messages;
pub mod mission;
mod navigation;
pub mod params;
pub mod streams;
mod upset;

use crate::faults::Fault;
use crate::noise::{Noise, Purpose};
use crate::powertrain::Carrier;
use crate::scenario::{Airframe, Scenario};
use crate::sensors::{SensorConfig, Sensors};
use crate::trajectory::dragged::Dragged;
use crate::truth::{Trajectory, Truth};
use crate::vehicle::{Vehicle, VehicleConfig};
use flight::Body;
use gaware_nav::math::{exp, sin};
use gaware_nav::model::Model;
use gaware_nav::sample::{GnssFix, ImuSample};
use gaware_wire::frame::encode;
use gaware_wire::framer::Framer;
use mavlink::dialects::ardupilotmega::*;
use mavlink::{MavHeader, MessageData};
use mission::MissionServer;
use nalgebra::Vector3;
use navigation::{Calibration, Navigation, Receiver};
use params::ParameterTable;
use std::collections::BTreeSet;
use streams::{SLOW_DOWN, Streams};

/// Which autopilot it behaves as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flavour {
    /// ArduPilot 4.6.
    ArduPilot,
    /// PX4 1.15.
    Px4,
}

/// Hardware id where none is set: as on PX4's own simulation, all of them have the same.
const DEFAULT_UID: u64 = 0x4155_5052_0100_0001;

/// What kind of autopilot.
#[derive(Debug, Clone, PartialEq)]
pub struct AutopilotConfig {
    /// Which autopilot it behaves as.
    pub flavour: Flavour,
    /// What it flies.
    pub airframe: Airframe,
    /// MAVLink system id; the component is 1.
    pub system_id: u8,
    /// Hardware id, `uid` of `AUTOPILOT_VERSION`; 0 is none.
    pub uid: u64,
    /// Main loop, Hz.
    pub loop_rate_hz: f64,
    /// Corner of the two-pole filter on the inertial samples, Hz; `None` = unfiltered.
    pub filter_hz: Option<f64>,
    /// Whether ArduPilot's bigger boards' `HIGHRES_IMU` is there.
    pub has_highres_imu: bool,
    /// Whether ArduPilot's `SIM_STATE`, the truth, can be had.
    pub has_sim_state: bool,
    /// Whether ArduPilot's inertial stamps are those of sending, up to one loop late.
    pub late_stamps: bool,
    /// Height of the geoid above the ellipsoid, m.
    pub geoid_height_m: f64,
    /// Whether an analytic flight waits, stationary, until a station has asked for messages.
    pub wait_for_station: bool,
    /// Whether an analytic motion is that of people's hands: the vehicle is never armed.
    pub by_hand: bool,
    /// Parameters that differ from the usual ones, by name; NaN is one that it does not have.
    pub parameters: Vec<(&'static str, f64)>,
    /// Whether it navigates by its own filter, with its own parameters: `ATTITUDE` and the status of the filter come from that.
    pub navigates: bool,
    /// What goes wrong.
    pub faults: Vec<Fault>,
    /// Seed of all noise.
    pub seed: u64,
}

impl Default for AutopilotConfig {
    fn default() -> Self {
        Self {
            flavour: Flavour::ArduPilot,
            airframe: Airframe::FixedWing,
            system_id: 1,
            uid: DEFAULT_UID,
            loop_rate_hz: 400.0,
            filter_hz: None,
            has_highres_imu: true,
            has_sim_state: true,
            late_stamps: true,
            geoid_height_m: 47.0,
            wait_for_station: true,
            by_hand: false,
            parameters: Vec::new(),
            navigates: false,
            faults: Vec::new(),
            seed: 1,
        }
    }
}

/// A frame on its way to the station.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outgoing {
    /// When it was sent, µs since the start of the simulation.
    pub t_us: u64,
    /// The MAVLink 2 frame.
    pub bytes: Vec<u8>,
}

/// Whether sensors beside the inertial unit have errors: then all of them are sent, with what drives these.
fn has_air_or_field(model: &Model) -> bool {
    model.effects.iter().any(|s| s.effect.on_air().is_some() || s.effect.on_field().is_some())
}

/// What an autopilot sends of barometers and airspeed; PX4 has the latter in `HIGHRES_IMU`.
fn air_messages(flavour: Flavour, airframe: Airframe) -> &'static [u32] {
    const ALL: [u32; 3] = [SCALED_PRESSURE_DATA::ID, SCALED_PRESSURE2_DATA::ID, AIRSPEED_DATA::ID];
    let has_airspeed = flavour == Flavour::ArduPilot && airframe == Airframe::FixedWing;
    if has_airspeed { &ALL } else { &ALL[..2] }
}

/// The flight begins this long after the station's first request, so that it can make all of them, s.
const RELEASE_AFTER_S: f64 = 1.0;

/// The simulated autopilot.
pub struct Autopilot {
    config: AutopilotConfig,
    body: Body,
    mission: MissionServer,
    parameters: ParameterTable,
    /// What the parameters make of the accelerometers' samples.
    calibration: Calibration,
    receiver: Receiver,
    navigation: Option<Navigation>,
    sensors: Sensors,
    streams: Streams,
    framer: Framer,
    out: Vec<Outgoing>,
    loops: u64,
    now_s: f64,
    /// Simulation time at which the boot clock was 0.
    booted_s: f64,
    silent_until_s: f64,
    /// Until then PX4 denies the rates of messages that it does not send.
    denies_until_s: f64,
    /// Faults by time that are still to come.
    pending: Vec<Fault>,
    sequence: [u8; 2],
    fixes: u64,
    fix: Option<GnssFix>,
    last_filler_s: f64,
    imu: Option<ImuSample>,
    imu_s: f64,
    /// When the compass was last read, s, and what it said, T.
    field: (f64, Vector3<f64>),
    filter: Option<[messages::LowPass; 2]>,
    stamp_noise: Noise,
    /// When the analytic flight begins; infinite while it waits.
    release_s: f64,
    last_timesync_s: f64,
    /// Height above the ellipsoid that relative altitudes count from, m.
    home_height: f64,
    /// When PX4 judges the mission that was uploaded; infinite: nothing to judge.
    judge_s: f64,
    /// Whether PX4 has rejected the mission on board.
    mission_rejected: bool,
    events_sent: u16,
    /// Messages that were asked for once.
    requested: BTreeSet<u32>,
}

impl std::fmt::Debug for Autopilot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Autopilot")
            .field("config", &self.config)
            .field("now_s", &self.now_s)
            .finish_non_exhaustive()
    }
}

impl Autopilot {
    /// An autopilot that plays an analytic flight with these sensors.
    pub fn new(
        config: AutopilotConfig,
        body: Box<dyn Trajectory>,
        model: &Model,
        sensors: SensorConfig,
    ) -> Self {
        Self::with_body(config, Body::Analytic(body, Vec::new()), model, sensors)
    }

    /// An autopilot whose vehicle flies what is uploaded.
    pub fn flying(
        config: AutopilotConfig,
        vehicle: VehicleConfig,
        model: &Model,
        sensors: SensorConfig,
    ) -> Self {
        let config = AutopilotConfig { airframe: vehicle.airframe, wait_for_station: false, ..config };
        let vehicle = VehicleConfig {
            first_item: usize::from(config.flavour == Flavour::ArduPilot),
            geoid_height_m: config.geoid_height_m,
            climbs_in_circles: !config.faults.contains(&Fault::NoClimbInCircles),
            returns_at: config.faults.iter().find_map(|fault| match fault {
                Fault::Return { item } => Some(*item),
                _ => None,
            }),
            ..vehicle
        };
        Self::with_body(config, Body::Vehicle(Box::new(Vehicle::new(vehicle))), model, sensors)
    }

    fn with_body(config: AutopilotConfig, mut body: Body, model: &Model, sensors: SensorConfig) -> Self {
        let start = body.truth_at(0.0).place;
        let home = messages::home_item(&start, config.geoid_height_m);
        // Rounding is done where the message is made.
        let carrier = match config.airframe {
            Airframe::FixedWing => Carrier::Wings,
            Airframe::Multirotor => Carrier::Rotors,
        };
        let sensors = SensorConfig { time_jitter_s: 0.0, carrier: Some(carrier), ..sensors };
        let (flavour, airframe) = (config.flavour, config.airframe);
        let senses = has_air_or_field(model);
        let streams = Streams::new(config.flavour, config.loop_rate_hz, config.has_highres_imu, 0.0)
            .with_sim_state(config.has_sim_state)
            .with_filter_status(config.navigates, 0.0)
            .with_reports(model.effects.iter().any(|s| s.effect.needs_conditions()) || senses, 0.0)
            .with_air(if senses { air_messages(flavour, airframe) } else { &[] }, 0.0);
        let filter = config.filter_hz.map(|hz| {
            let one = messages::LowPass::new(hz, config.loop_rate_hz);
            [one.clone(), one]
        });
        let parameters =
            ParameterTable::new(flavour, config.airframe, config.loop_rate_hz, &config.parameters);
        let navigation = config.navigates.then(|| Navigation::new(flavour));
        let mut pending = config.faults.clone();
        pending.retain(|f| {
            matches!(
                f,
                Fault::Reboot { .. }
                    | Fault::InstanceRestart { .. }
                    | Fault::ClockJump { .. }
                    | Fault::RateTheft { .. }
            )
        });
        Self {
            sensors: Sensors::unrounded(model, sensors, config.seed),
            stamp_noise: Noise::new(config.seed, Purpose::Jitter),
            release_s: if config.wait_for_station { f64::INFINITY } else { 0.0 },
            config,
            body,
            streams,
            framer: Framer::new(),
            out: Vec::new(),
            loops: 0,
            now_s: 0.0,
            booted_s: 0.0,
            silent_until_s: 0.0,
            denies_until_s: 0.0,
            pending,
            sequence: [0; 2],
            fixes: 0,
            fix: None,
            last_filler_s: 0.0,
            imu: None,
            imu_s: 0.0,
            field: (f64::NEG_INFINITY, Vector3::zeros()),
            filter,
            last_timesync_s: 0.0,
            home_height: start.height_m,
            judge_s: f64::INFINITY,
            mission_rejected: false,
            events_sent: 0,
            requested: BTreeSet::new(),
            mission: MissionServer::new(flavour, airframe, home),
            calibration: Calibration::new(flavour, &parameters),
            receiver: Receiver::new(flavour, &parameters),
            navigation,
            parameters,
        }
    }

    /// An autopilot that plays a scenario's analytic flight, or waits for a mission where the scenario has a vehicle.
    pub fn playing(config: AutopilotConfig, scenario: &Scenario) -> Self {
        if let Some(vehicle) = &scenario.vehicle {
            return Self::flying(config, vehicle.clone(), &scenario.model, scenario.sensors.clone());
        }
        let by_hand = scenario.by_hand;
        let config = AutopilotConfig { airframe: scenario.airframe, by_hand, ..config };
        let (model, sensors) = (&scenario.model, scenario.sensors.clone());
        let trajectory = Dragged::by_model(scenario.trajectory(), model, sensors.wind, config.seed);
        Self::new(config, trajectory, model, sensors)
    }

    /// Whether it has a pitot tube that is sent.
    fn has_airspeed(&self) -> bool {
        self.config.airframe == Airframe::FixedWing && has_air_or_field(self.sensors.model())
    }

    /// Virtual time since the start, s.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Whether an analytic flight still waits for a station.
    pub fn is_waiting(&self) -> bool {
        self.release_s > self.now_s
    }

    /// Whether the next move is a station's: an analytic flight that waits, or a vehicle that is not armed.
    pub fn is_idle(&self) -> bool {
        self.is_waiting() || self.vehicle().is_some_and(|v| !v.is_armed())
    }

    /// Whether an analytic flight is over.
    pub fn is_over(&self) -> bool {
        self.now_s - self.release_s >= self.body.duration_s()
    }

    /// Lets an analytic flight begin now.
    pub fn release(&mut self) {
        self.release_s = self.release_s.min(self.now_s);
    }

    /// The ground truth about the sensors.
    pub fn model(&self) -> &Model {
        self.sensors.model()
    }

    /// Where the vehicle really is now.
    pub fn truth(&mut self) -> Truth {
        let now = self.now_s;
        self.truth_at(now)
    }

    /// Where it really was at this time of the boot clock, s, which message stamps count; good for the last second or two.
    pub fn truth_at_boot(&mut self, boot_s: f64) -> Truth {
        let then = (boot_s + self.booted_s).min(self.now_s);
        self.truth_at(then)
    }

    /// Frames sent since the last call.
    pub fn take_output(&mut self) -> Vec<Outgoing> {
        std::mem::take(&mut self.out)
    }

    /// Received bytes, in any portions.
    pub fn receive(&mut self, bytes: &[u8]) {
        if self.now_s < self.silent_until_s {
            return;
        }
        self.framer.push(bytes);
        while let Some((header, message)) = self.framer.next_message() {
            self.handle(&header, &message);
        }
    }

    /// Runs the main loop up to this virtual time.
    pub fn step(&mut self, until_s: f64) {
        loop {
            let next = self.loops as f64 / self.config.loop_rate_hz;
            if next > until_s {
                return;
            }
            self.loops += 1;
            self.now_s = next;
            self.run_loop();
        }
    }

    fn run_loop(&mut self) {
        self.meet_faults();
        let arrived = self.take_fix();
        if self.filter.is_some() || self.navigation.is_some() {
            self.sample_imu();
        }
        if arrived {
            self.navigate_by_fix();
        }
        if self.now_s < self.silent_until_s {
            return;
        }
        let slower = self.slow_down();
        for id in self.streams.due(self.now_s, slower) {
            self.send_stream(id);
            if id == HEARTBEAT_DATA::ID && self.config.faults.contains(&Fault::Gimbal) {
                self.send_gimbal();
            }
        }
        self.report_mission();
        self.ask_for_time();
    }

    fn slow_down(&self) -> f64 {
        let slow = self.config.flavour == Flavour::ArduPilot && self.mission.is_uploading();
        if slow { SLOW_DOWN } else { 1.0 }
    }

    /// Boot time, s.
    fn boot_s(&self) -> f64 {
        self.now_s - self.booted_s
    }

    fn truth_at(&mut self, t_s: f64) -> Truth {
        let flight_s = (t_s - self.release_s).max(0.0);
        Truth { t_s, ..self.body.truth_at(flight_s) }
    }

    /// The inertial sample of this loop.
    fn sample_imu(&mut self) -> ImuSample {
        if let Some(sample) = self.imu.filter(|_| self.imu_s == self.now_s) {
            return sample;
        }
        let interval =
            if self.imu.is_some() { self.now_s - self.imu_s } else { 1.0 / self.config.loop_rate_hz };
        let truth = self.truth_at(self.now_s);
        let mut sample = self.sensors.imu_after(&truth, interval);
        sample.accel = self.calibration.apply(&sample.accel);
        self.navigate(&sample, &truth);
        if let Some([gyro, accel]) = &mut self.filter {
            sample.gyro = gyro.next(sample.gyro);
            sample.accel = accel.next(sample.accel);
        }
        self.imu = Some(sample);
        self.imu_s = self.now_s;
        sample
    }

    /// The receiver delivers at its own rate, whatever the link asks for. Whether a fix has arrived.
    fn take_fix(&mut self) -> bool {
        let config = self.sensors.config();
        if config.fix_rate_hz <= 0.0 {
            return false;
        }
        let due = config.fix_phase_s + self.fixes as f64 / config.fix_rate_hz;
        if due > self.now_s + 1e-9 {
            return false;
        }
        self.fixes += 1;
        let (body, release_s, now_s) = (&mut self.body, self.release_s, self.now_s);
        let (fix, valid) = self
            .sensors
            .fix(due, |t_s| Truth { t_s, ..body.truth_at((t_s.min(now_s) - release_s).max(0.0)) });
        let lost = self
            .config
            .faults
            .iter()
            .any(|f| matches!(f, Fault::GnssLoss { from_s, to_s } if (*from_s..*to_s).contains(&due)));
        let known = valid >= 0.0 && due > self.booted_s && !lost && !self.sensors.in_outage(due);
        self.fix = known.then_some(fix);
        known
    }

    fn send(&mut self, message: &MavMessage) {
        self.send_as(1, message);
    }

    fn send_as(&mut self, component_id: u8, message: &MavMessage) {
        let sequence = &mut self.sequence[usize::from(component_id != 1)];
        let header = MavHeader { system_id: self.config.system_id.into(), component_id, sequence: *sequence };
        *sequence = sequence.wrapping_add(1);
        let t_us = (self.now_s * 1e6).round() as u64;
        self.out.push(Outgoing { t_us, bytes: encode(header, message) });
    }

    /// The autopilot synchronises its own clock: PX4 at 10 Hz, ArduPilot every 10 s.
    fn ask_for_time(&mut self) {
        let every_s = match self.config.flavour {
            Flavour::ArduPilot => 10.0,
            Flavour::Px4 => 0.1,
        };
        if self.now_s - self.last_timesync_s >= every_s {
            self.last_timesync_s = self.now_s;
            let ts1 = (self.boot_s() * 1e9) as i64;
            self.send(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1, ..Default::default() }));
        }
    }

    /// Bias that PX4's filter assumes and has taken off its `HIGHRES_IMU`: near the truth, and moving.
    fn px4_bias_estimate(&self) -> [Vector3<f64>; 2] {
        let settled = 1.0 - exp(-self.boot_s() / 30.0);
        let sway = 0.05 * sin(self.boot_s() / 23.0);
        let imu = &self.sensors.model().imu;
        [Vector3::from(imu.gyro_bias), Vector3::from(imu.accel_bias)].map(|b| b * (settled + sway))
    }
}

#[cfg(test)]
mod tests;
