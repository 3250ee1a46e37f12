//! The state of the engine in words and figures: phase, what it waits for, what came in, what is wrong.

use super::Engine;
use super::estimate::{BEYOND_PRIOR, Constants};
use super::situation::{self, FIX_PATIENCE_S, Inputs, Situation};
use super::snapshot::{Consistency, GnssStatus, Guidance, ImuStatus, Phase, StateStatus, Status};
use crate::timeline::Gaps;
use gaware_nav::effects::{BiasWalk, unit};
use gaware_nav::estimator::{EstimatorEvent, Stage};
use gaware_nav::filter::{Filter, FixEvent, PassedOver};

/// So long after the motion had to start anew from the fixes the estimate is not to be believed, s.
const CONTRADICTED_S: f64 = 30.0;

impl Engine {
    pub(super) fn phase(&self) -> Phase {
        match self.estimator.stage() {
            Stage::WaitingForImu => Phase::WaitingForImu,
            Stage::WaitingForGnss if self.fix_age_s().is_some_and(|age| age < FIX_PATIENCE_S) => {
                Phase::Aligning
            }
            Stage::WaitingForGnss => Phase::WaitingForGnss,
            Stage::SearchingHeading => Phase::SearchingHeading,
            Stage::Running => Phase::Running,
        }
    }

    pub(super) fn fix_age_s(&self) -> Option<f64> {
        Some(self.time.now_s()? - self.last_fix_s?)
    }

    pub(super) fn waiting_for(&self, filter: Option<&Filter>) -> String {
        let stands = filter.is_some_and(|f| self.stillness.stands(f.nav().v_n().norm()));
        match self.phase() {
            Phase::WaitingForImu => "no inertial samples yet: is the autopilot connected?".to_owned(),
            Phase::WaitingForGnss if self.estimator.before_restart().is_some() => {
                "no GNSS fix since the restart: the constants are kept, motion starts with the next fix"
                    .to_owned()
            }
            Phase::WaitingForGnss => "no GNSS fix yet: G cannot be estimated".to_owned(),
            Phase::Aligning => "levelling: a second of inertial samples is needed".to_owned(),
            Phase::SearchingHeading | Phase::Running => match self.fix_age_s() {
                _ if self.estimator.on_ground_without_fixes().is_some() => {
                    "on the ground without fixes: turn the vehicle to its six sides and hold it still on each".to_owned()
                }
                Some(age) if age >= FIX_PATIENCE_S => {
                    format!("no GNSS fix for {age:.0} s: G cannot be estimated further")
                }
                _ if self.estimator.is_stationary() => {
                    "stationary: position, velocity and heading are held, nothing excites G: turn the vehicle to another side, or fly".to_owned()
                }
                _ if stands => "stationary or hovering: nothing excites G".to_owned(),
                _ if self.phase() == Phase::SearchingHeading => {
                    "the heading is unknown: accelerate or turn to make it observable".to_owned()
                }
                _ => String::new(),
            },
        }
    }

    /// Whether the estimate is inconsistent with its measurements.
    fn is_inconsistent(&self) -> bool {
        let since_s = self.time.now_s().zip(self.contradicted_s).map(|(now, then)| now - then);
        since_s.is_some_and(|s| s < CONTRADICTED_S)
    }

    /// What the situation follows from, without words.
    fn inputs(&self) -> Inputs<'_> {
        let filter = self.estimator.filter();
        let guide = self.guide.as_ref();
        let now_s = self.time.now_s();
        Inputs {
            phase: self.phase(),
            fix_age_s: self.fix_age_s(),
            jump: self.jump.zip(now_s).map(|((then_s, offset_m), now)| (now - then_s, offset_m)),
            rates_hz: [&self.imu_rate, &self.fix_rate].map(|rate| now_s.map_or(0.0, |now| rate.at(now))),
            inconsistent: self.is_inconsistent(),
            stationary: self.estimator.is_stationary()
                || filter.is_some_and(|f| self.stillness.stands(f.nav().v_n().norm())),
            height_m: guide.zip(filter).and_then(|(g, f)| g.height_m(f)),
            floor_m: guide.map_or(0.0, |g| g.floor_m()),
            airframe: self.options.vehicle(),
            vehicle: self.vehicle(),
            done: guide.is_some_and(|g| g.is_done()),
            without_fixes: self.estimator.on_ground_without_fixes().is_some(),
            flight: self.flight.as_ref(),
            ..Inputs::default()
        }
    }

    /// Whether a maneuver may be proposed now.
    pub(super) fn allows_maneuver(&self) -> bool {
        situation::decide(&self.inputs()).allows_maneuver()
    }

    /// What may be said now.
    pub(super) fn situation(
        &self,
        waiting_for: &str,
        guidance: &Guidance,
        states: &[StateStatus],
    ) -> Situation {
        let open: Vec<&str> =
            states.iter().filter(|s| s.status != Status::Observable).map(|s| s.name.as_str()).collect();
        let names = open.join(", ");
        let by_hand = self.ground_words();
        situation::describe(&Inputs {
            by_hand: by_hand.as_ref().map(|[text, detail]| [text.as_str(), detail.as_str()]),
            waiting_for,
            instruction: [&guidance.instruction, &guidance.reason],
            open: (&names, open.len(), states.len()),
            ..self.inputs()
        })
    }

    pub(super) fn imu_status(&self) -> ImuStatus {
        ImuStatus {
            message: self.message.clone(),
            samples: self.samples,
            rate_hz: self.time.now_s().map_or(0.0, |now| self.imu_rate.at(now)),
            dropped: self.refused,
            ..ImuStatus::default()
        }
    }

    pub(super) fn gnss_status(&self) -> GnssStatus {
        let rejected = self.fixes_rejected();
        GnssStatus {
            fixes: self.fixes,
            used: self.used,
            rejected: self.rejected + rejected.late + rejected.overtaken,
            rate_hz: self.time.now_s().map_or(0.0, |now| self.fix_rate.at(now)),
            gaps: Gaps::default(),
        }
    }

    pub(super) fn fixes_rejected(&self) -> PassedOver {
        let mut all = self.rejected_before;
        all += self.estimator.passed_over();
        all
    }

    pub(super) fn consistency(&self) -> Consistency {
        let (p, v) = (self.last_outcome.position.normalised, self.last_outcome.velocity.normalised);
        Consistency {
            nis_mean_per_dof: if self.nis.1 > 0 { self.nis.0 / self.nis.1 as f64 } else { 0.0 },
            last_normalised_innovation: [p[0], p[1], p[2], v[0], v[1], v[2]],
        }
    }

    pub(super) fn warnings(&self, constants: &Constants) -> Vec<String> {
        let mut list = self.warnings.to_vec();
        let far = constants.beyond_prior(self.estimator.model());
        if !far.is_empty() {
            list.push(format!(
                "{} left what the model expects by more than {BEYOND_PRIOR} of its sigmas: these states absorb an unmodelled sensor error",
                far.join(", ")
            ));
        }
        if self.estimator.on_ground_without_fixes().is_some() {
            list.push("no GNSS fix: the place on the ground takes its part, and nothing is estimated of what a fix would show".to_owned());
        }
        if self.fixes_rejected().late > 0 {
            list.push("some fixes came more than 1.5 s after their time and were not used".to_owned());
        }
        list
    }
}

/// What the estimator did on its own, in words.
pub(super) fn reported(event: &EstimatorEvent) -> String {
    match event {
        EstimatorEvent::AlignedAfterGap { gap_s } => {
            format!(
                "no inertial samples for {gap_s:.1} s: the attitude is aligned anew, biases and G are kept"
            )
        }
        EstimatorEvent::AlignedAfterOutage => {
            "the attitude was lost during the GNSS outage and is aligned anew, biases and G are kept"
                .to_owned()
        }
        EstimatorEvent::AlignedAsVague { sigma_rad } => format!(
            "the attitude became uncertain to {:.0}° and is aligned anew, biases and G are kept",
            sigma_rad.to_degrees()
        ),
        EstimatorEvent::UnitContradicted { worst, sigmas, constants } => {
            let others = match constants {
                1 => String::new(),
                n => format!(" and {} more", n - 1),
            };
            format!(
                "the unit's file is inconsistent with the measurements in {worst}{others} ({sigmas:.1} sigma): it is left out, and the estimate starts anew without it. Measure the unit again (gaware ground), or check what has changed (mounting, another sensor, warm-up)"
            )
        }
        EstimatorEvent::BiasesDrift { walk } => drift_words(*walk),
        EstimatorEvent::PlaceKnown { constants_kept: true } => {
            "first GNSS fix after a start on the ground without one: position and heading start from it, biases and G are kept"
                .to_owned()
        }
        EstimatorEvent::PlaceKnown { constants_kept: false } => {
            "the first GNSS fix shows a flying vehicle where none seemed to move: everything starts from it"
                .to_owned()
        }
        EstimatorEvent::PlaceLeft => {
            "the vehicle left its place before the first GNSS fix: its motion waits for one, biases and G are kept".to_owned()
        }
        EstimatorEvent::Rounding { rounds: true } => {
            "the integers of the inertial samples are rounded, where this message's are truncated elsewhere: everything starts anew with that".to_owned()
        }
        EstimatorEvent::Rounding { rounds: false } => {
            "the integers of the inertial samples are truncated after all: everything starts anew with that".to_owned()
        }
        EstimatorEvent::Failed { constants_kept: true } => {
            "the filter failed its health check and was restarted; biases and G are kept".to_owned()
        }
        EstimatorEvent::Failed { constants_kept: false } => {
            "the filter failed its health check and was restarted from the model".to_owned()
        }
    }
}

/// What a fix did to the filter, in words.
pub(super) fn reported_fix(event: &FixEvent) -> String {
    match event {
        FixEvent::PositionJump { offset_m } => format!(
            "GNSS position jump of {offset_m:.0} m: inconsistent with velocity and inertial data, rejected"
        ),
        FixEvent::PositionAccepted { offset_m } => format!(
            "the GNSS position stayed {offset_m:.0} m away for 30 s and is accepted as a correction; only the position changed"
        ),
        FixEvent::Reacquired { after_s } => {
            format!("GNSS is back after {after_s:.0} s: position and velocity start from its first fix")
        }
    }
}
/// What another walk of the biases means. Accelerometers that seem to shake are also what a receiver looks like that is led astray.
fn drift_words(walk: BiasWalk) -> String {
    let gyro = format!("{:.0} deg/h/√h for those of the gyros", walk.gyro / unit::DEG_PER_H_PER_RTH.si);
    if walk.shakes() {
        return format!(
            "fixes and inertial data fail the innovation test of sensors in order: the accelerometers shake or clip, or the fixes are wrong (check \
             vibration and GNSS); the filter now assumes random walks of the biases, of {gyro} and of {} m/s²/√s for those of the accelerometers",
            walk.accel
        );
    }
    if walk.accel > 0.0 {
        let accel = walk.accel / unit::MG_PER_RTH.si;
        return format!(
            "the fixes fit better if the biases drift, as those of a unit that warms up: the filter now assumes random walks of {gyro} and {accel:.0} mg/√h \
             for those of the accelerometers"
        );
    }
    if walk.gyro > 0.0 {
        return format!(
            "the fixes fit better if the gyro biases drift: the filter now assumes a random walk of {gyro}"
        );
    }
    "the fixes fit better without a drift of the biases beyond the model's".to_owned()
}
