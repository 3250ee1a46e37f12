//! The engine: samples in, snapshots out. Synchronous and deterministic: no clock, no I/O, no randomness.
//!
//! It wraps the estimator of `gaware-nav` and adds what people want to know beyond the estimate: how much came in,
//! what the estimation waits for, what the flight has made observable. Live, replay and simulation run the very same code.

pub(crate) mod counters;
pub(crate) mod estimate;
pub mod events;
mod ground;
pub mod guidance;
pub mod meaning;
pub mod observability;
pub mod situation;
pub mod snapshot;
mod stationary;
mod status;

use counters::{ElapsedTime, RateMeter, Warnings};
use estimate::Constants;
use gaware_mission::airframe::Airframe;
use gaware_mission::maneuver::Maneuver;
use gaware_nav::earth::Geodetic;
use gaware_nav::estimator::{Estimator, EstimatorEvent, Stage};
use gaware_nav::filter::{Filter, FixEvent, FixOutcome, PassedOver};
use gaware_nav::ground::session::Side;
use gaware_nav::model::Model;
use gaware_nav::observability::covariance::Targets;
use gaware_nav::observability::segments::PathSegment;
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::{GnssFix, ImuSample, Sample};
use ground::GroundWatch;
pub(crate) use ground::WARMED;
use guidance::motion::Instant;
use guidance::{Flying, GuidanceOptions, Guide};
use observability::ConditionWatch;
use situation::FlightReport;
use snapshot::{Estimate, Guidance, ImuStatus, Snapshot, Summary};
use stationary::StationaryTest;
use status::{reported, reported_fix};

/// Fixes are predicted at the present rate within these intervals, s.
const FIX_INTERVAL_S: (f64, f64) = (0.1, 1.0);

/// Said of the motion that a restart ends.
const FIXES_INCONSISTENT: &str = "position and velocity fixes failed the innovation test for more than 3 s; motion started anew from them: check GNSS and vibration";

/// What the user may set.
#[derive(Debug, Clone, PartialEq)]
pub struct EngineOptions {
    /// Sigmas below which states count as observable.
    pub targets: Targets,
    /// What flies, for guidance and the words of remedies; without it there is no guidance.
    pub guidance: Option<GuidanceOptions>,
    /// Where the vehicle is, for as long as no fix says so.
    pub place: Option<Geodetic>,
    /// A ground session that was asked for, with the sides that the vehicle cannot stand on.
    pub ground: Option<Vec<Side>>,
    /// Error of attitude that matters to the vehicle, deg.
    pub limit_deg: f64,
}

impl Default for EngineOptions {
    fn default() -> Self {
        Self {
            targets: Targets::default(),
            guidance: None,
            place: None,
            ground: None,
            limit_deg: meaning::LIMIT_DEG,
        }
    }
}

impl EngineOptions {
    /// With guidance for this airframe, by hand or by the autopilot alone.
    pub fn for_airframe(airframe: Airframe, manual: bool) -> Self {
        Self { guidance: Some(GuidanceOptions::new(airframe, manual)), ..Self::default() }
    }

    /// What flies by the airframe, where one is given.
    pub fn vehicle(&self) -> Option<VehicleKind> {
        let wing = self.guidance.as_ref()?.airframe.is_fixed_wing();
        Some(if wing { VehicleKind::FixedWing } else { VehicleKind::Multirotor })
    }
}

/// The whole estimation with its books.
#[derive(Debug, Clone)]
pub struct Engine {
    estimator: Estimator,
    options: EngineOptions,
    autopilot: String,
    /// As the vehicle or the log reports it.
    reported: VehicleKind,
    message: String,
    time: ElapsedTime,
    imu_rate: RateMeter,
    samples: u64,
    refused: u64,
    fix_rate: RateMeter,
    last_fix_s: Option<f64>,
    fixes: u64,
    used: u64,
    rejected: u64,
    rejected_before: PassedOver,
    nis: (f64, usize),
    last_outcome: FixOutcome,
    warnings: Warnings,
    stillness: StationaryTest,
    watch: ConditionWatch,
    guide: Option<Guide>,
    /// What the vehicle reports of its flight, where there is one.
    flight: Option<FlightReport>,
    /// When a position was rejected as a jump, s, and how far it was off, m.
    jump: Option<(f64, f64)>,
    /// When the motion started anew because the fixes contradicted it, s.
    contradicted_s: Option<f64>,
    /// The ground session.
    ground: GroundWatch,
}

impl Engine {
    /// An engine that has seen nothing.
    pub fn new(model: Model, options: EngineOptions) -> Self {
        let guide = options.guidance.clone().map(|g| Guide::new(g, &options.targets));
        let watch = ConditionWatch::new(options.targets);
        let mut estimator = Estimator::new(model);
        options.place.into_iter().for_each(|place| estimator.set_place(place));
        Self {
            estimator,
            ground: GroundWatch::new(options.ground.is_some(), options.ground.as_deref().unwrap_or_default()),
            options,
            autopilot: "unknown".to_owned(),
            reported: VehicleKind::Unknown,
            message: String::new(),
            time: ElapsedTime::default(),
            imu_rate: RateMeter::default(),
            samples: 0,
            refused: 0,
            fix_rate: RateMeter::default(),
            last_fix_s: None,
            fixes: 0,
            used: 0,
            rejected: 0,
            rejected_before: PassedOver::default(),
            nis: (0.0, 0),
            last_outcome: FixOutcome::default(),
            warnings: Warnings::default(),
            stillness: StationaryTest::default(),
            watch,
            guide,
            flight: None,
            jump: None,
            contradicted_s: None,
        }
    }

    /// Names the firmware: `ardupilot`, `px4` or `unknown`.
    pub fn set_autopilot(&mut self, name: &str) {
        name.clone_into(&mut self.autopilot);
    }

    /// Takes the type of vehicle as itself or its log reports it, for the words of remedies; an airframe that the user named
    /// counts more.
    pub fn set_vehicle(&mut self, kind: VehicleKind) {
        self.reported = kind;
    }

    /// Takes what the vehicle reports of its flight.
    pub fn set_flight(&mut self, report: &FlightReport) {
        self.flight.get_or_insert_default().clone_from(report);
        self.estimator.set_flight(report.in_air, report.armed || !report.has_heartbeat);
        self.ground.set_flight(report.in_air, report.armed);
    }

    /// Takes where the vehicle is for as long as no fix says so; the options count more.
    pub fn set_place(&mut self, place: Geodetic) {
        self.estimator.set_place(self.options.place.unwrap_or(place));
    }

    /// What the user has set.
    pub fn options(&self) -> &EngineOptions {
        &self.options
    }

    /// What flies.
    pub fn vehicle(&self) -> VehicleKind {
        self.options.vehicle().unwrap_or(self.reported)
    }

    /// Takes something that the user should know.
    pub fn notice(&mut self, text: &str) {
        self.warnings.push(text);
    }

    /// Takes the next item.
    pub fn feed(&mut self, sample: &Sample) {
        match sample {
            Sample::Stream(stream) => self.message.clone_from(&stream.message),
            Sample::Imu(imu) => return self.feed_imu(imu, sample),
            Sample::Fix(fix) => return self.feed_fix(fix, sample),
            Sample::Attitude(hint) => {
                if !hint.t_s.is_finite() || hint.roll_pitch_yaw.iter().any(|a| !a.is_finite()) {
                    return;
                }
            }
            Sample::Restart(_) => self.restart(),
            // The live estimate depends on none of it.
            Sample::Field(_) | Sample::Air(_) => return,
            Sample::Recalibrated | Sample::Place(_) => {}
            // Only effects that depend on it take notice.
            Sample::Operating(_) => {
                self.estimator.feed(sample);
                return;
            }
        }
        self.take(sample);
    }

    fn feed_imu(&mut self, imu: &ImuSample, sample: &Sample) {
        let plausible = imu.is_plausible();
        let newer = self.time.now_s().is_none_or(|now| imu.t_s > now);
        if !plausible || !newer {
            self.refused += 1;
            if !plausible {
                self.warnings.push("inertial samples with impossible values were refused");
            }
            return;
        }
        self.samples += 1;
        self.time.push(imu.t_s);
        self.imu_rate.push(imu.t_s);
        self.stillness.push(imu);
        self.take(sample);
        self.watch.push(&self.estimator);
        self.guide(imu.t_s);
        self.look_at_ground(imu);
    }

    fn feed_fix(&mut self, fix: &GnssFix, sample: &Sample) {
        self.fixes += 1;
        if !fix.is_plausible() {
            self.rejected += 1;
            self.warnings.push("fixes with impossible values were refused");
            return;
        }
        self.fix_rate.push(fix.t_s);
        self.last_fix_s = self.time.now_s();
        self.take(sample);
    }

    fn take(&mut self, sample: &Sample) {
        let running = self.estimator.stage() == Stage::Running;
        for outcome in self.estimator.feed(sample) {
            self.account(&outcome, running);
        }
        for event in self.estimator.take_events() {
            self.warnings.push(&reported(&event));
            if matches!(event, EstimatorEvent::BiasesDrift { walk } if walk.shakes()) {
                self.contradicted_s = self.time.now_s();
            }
            if let Some(guide) = &mut self.guide {
                guide.restart();
            }
            self.watch.restart();
        }
    }

    fn account(&mut self, outcome: &FixOutcome, running: bool) {
        if outcome.used() {
            self.used += 1;
        } else {
            self.rejected += 1;
        }
        for group in [&outcome.position, &outcome.velocity] {
            // While headings compete, most of them are wrong.
            if running && group.used {
                self.nis.0 += group.nis;
                self.nis.1 += group.dof;
            }
        }
        match &outcome.event {
            _ if !running => {}
            Some(event) => {
                self.warnings.push(&reported_fix(event));
                self.jump = match event {
                    FixEvent::PositionJump { offset_m } => self.time.now_s().zip(Some(*offset_m)),
                    FixEvent::PositionAccepted { .. } | FixEvent::Reacquired { .. } => None,
                };
            }
            None if outcome.position.recovered || outcome.velocity.recovered => {
                self.warnings.push(FIXES_INCONSISTENT);
                self.contradicted_s = self.time.now_s();
            }
            None => {}
        }
        self.last_outcome = *outcome;
    }

    /// The constants go on, motion starts anew.
    fn restart(&mut self) {
        self.rejected_before += self.estimator.passed_over();
        self.time.restart();
        self.imu_rate = RateMeter::default();
        self.fix_rate = RateMeter::default();
        self.last_fix_s = None;
        (self.jump, self.contradicted_s) = (None, None);
        self.stillness = StationaryTest::default();
        self.warnings.forget(FIXES_INCONSISTENT);
        self.watch.restart();
        if let Some(guide) = &mut self.guide {
            guide.restart();
        }
    }

    fn guide(&mut self, t_s: f64) {
        let rate = self.fix_rate.at(t_s);
        let due = self.guide.as_ref().is_some_and(|g| g.is_due(t_s));
        if !due || rate <= 0.0 || self.estimator.stage() != Stage::Running {
            return;
        }
        let Some(flying) = self.flying(t_s, rate) else { return };
        if let (Some(guide), Some(filter)) = (&mut self.guide, self.estimator.filter()) {
            guide.push(filter, &flying);
        }
    }

    /// The vehicle as the guide sees it.
    fn flying(&self, t_s: f64, fix_rate_hz: f64) -> Option<Flying> {
        let (filter, sample) = (self.estimator.filter()?, self.estimator.last_sample()?);
        let nav = filter.nav();
        let here = Instant {
            t_s,
            heading: nav.euler().z,
            height_m: nav.geodetic().height_m,
            speed: nav.v_n().xy().norm(),
            force: filter.calibration().motion(filter.model(), sample).force,
        };
        Some(Flying {
            here,
            fix_interval_s: (1.0 / fix_rate_hz).clamp(FIX_INTERVAL_S.0, FIX_INTERVAL_S.1),
            stationary: self.stillness.stands(nav.v_e.norm()),
            allowed: self.allows_maneuver(),
        })
    }

    /// What is asked for, and only where the situation allows it.
    fn guidance(&self) -> Guidance {
        let running = self.estimator.stage() == Stage::Running;
        let filter = self.estimator.filter().filter(|_| running);
        let guidance = self.guide.as_ref().map(|g| g.guidance(filter)).unwrap_or_default();
        if self.allows_maneuver() {
            return guidance;
        }
        Guidance { instruction: String::new(), progress: 0.0, ..guidance }
    }

    /// Roll, pitch, yaw, rad, and the time they are for, s; cheap enough to ask for at every sample.
    pub fn attitude(&mut self) -> Option<(f64, [f64; 3])> {
        self.estimator.predicted_nav().map(|(t_s, nav)| (t_s, nav.euler().into()))
    }

    /// 1-sigma of roll, pitch, yaw at the last fix, rad.
    pub fn attitude_sigmas(&self) -> Option<[f64; 3]> {
        self.estimator.euler_sigma().map(Into::into)
    }

    /// The maneuvers that the guidance asks for, to be flown one after the other.
    pub fn proposed(&self) -> &[Maneuver] {
        self.guide.as_ref().filter(|_| self.allows_maneuver()).map_or(&[], Guide::proposed)
    }

    /// The filter at the time of its last fix, once there is one.
    pub fn filter(&self) -> Option<&Filter> {
        self.estimator.filter()
    }

    /// The segment of constant attitude under way.
    pub fn segment(&self) -> Option<&PathSegment> {
        self.watch.segment()
    }

    /// The state now.
    pub fn snapshot(&self) -> Snapshot {
        let predicted = self.estimator.predicted();
        let constants = self.constants(predicted.as_ref());
        let (waiting_for, guidance) = (self.waiting_for(predicted.as_ref()), self.guidance());
        let observability = observability::of(
            &self.watch,
            &constants,
            predicted.as_ref().or(self.estimator.before_restart()),
            &self.options.targets,
            self.vehicle(),
        );
        let estimate = self.estimate(predicted.as_ref(), &constants);
        Snapshot {
            schema: "gaware.snapshot/1".to_owned(),
            sequence: self.samples,
            t_s: self.time.now_s().unwrap_or(0.0),
            elapsed_s: self.time.elapsed_s(),
            autopilot: self.autopilot.clone(),
            vehicle_type: self.vehicle().word().to_owned(),
            phase: self.phase(),
            stationary: self.estimator.is_stationary(),
            imu: self.imu_status(),
            gnss: self.gnss_status(),
            turn: meaning::after_a_turn(&estimate.g_sensitivity_deg_per_h_per_g, self.options.limit_deg),
            estimate,
            motion: predicted.as_ref().map(estimate::motion).unwrap_or_default(),
            situation: self.situation(&waiting_for, &guidance, &observability.states),
            waiting_for,
            observability,
            guidance,
            ground: self.ground_status(),
            mission: snapshot::MissionProgress::default(),
            consistency: self.consistency(),
            warnings: self.warnings(&constants),
            news: Vec::new(),
        }
    }

    /// The result so far.
    pub fn summary(&self) -> Summary {
        let now = self.snapshot();
        let duration_s = self.time.elapsed_s();
        let rate_hz = if duration_s > 0.0 { self.samples.saturating_sub(1) as f64 / duration_s } else { 0.0 };
        Summary {
            schema: "gaware.summary/1".to_owned(),
            duration_s,
            autopilot: now.autopilot,
            vehicle_type: now.vehicle_type,
            imu: ImuStatus { rate_hz, ..now.imu },
            gnss: now.gnss,
            estimate: now.estimate,
            turn: now.turn,
            observability: now.observability,
            consistency: now.consistency,
            warnings: now.warnings,
            phase: now.phase,
            waiting_for: now.waiting_for,
            implausible: self.implausible().into_iter().map(str::to_owned).collect(),
        }
    }

    fn implausible(&self) -> Vec<&'static str> {
        self.constants(self.estimator.predicted().as_ref()).beyond_prior(self.estimator.model())
    }

    fn constants(&self, filter: Option<&Filter>) -> Constants {
        // What is known before a restart or a gap is shown until the next filter runs.
        match filter.or(self.estimator.before_restart()) {
            Some(filter) => Constants::of_filter(filter),
            None => Constants::of_model(self.estimator.model()),
        }
    }

    fn estimate(&self, filter: Option<&Filter>, constants: &Constants) -> Estimate {
        let mut estimate = constants.estimate(self.estimator.model());
        estimate.attitude_deg = match filter.zip(self.estimator.euler_sigma()) {
            Some((filter, sigma)) => estimate::attitude(filter, &sigma),
            None => estimate::levelled(self.estimator.gathered_mean().as_ref()),
        };
        estimate
    }
}

#[cfg(test)]
mod tests;
