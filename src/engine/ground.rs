//! The ground session inside the engine: looks at the motion of a vehicle that stands or is turned by hand, a few times a second.

use super::Engine;
use super::snapshot::{GroundSide, GroundStatus};
use gaware_nav::ground::session::{Instruction, Look, Session, Side};
use gaware_nav::sample::ImuSample;

/// A look every so often, s.
const EVERY_S: f64 = 0.1;

/// The session and when the next look is due.
#[derive(Debug, Clone, Default)]
pub(super) struct GroundWatch {
    session: Session,
    next_s: f64,
    /// Whether it was asked for, or people have begun it by turning the vehicle.
    begun: bool,
    armed: bool,
    flying: bool,
}

impl GroundWatch {
    /// A session that leaves these sides out; one that was asked for gives instructions from the start.
    pub(super) fn new(asked: bool, skip: &[Side]) -> Self {
        let mut session = Session::default();
        skip.iter().for_each(|side| session.skip(*side));
        Self { session, begun: asked, ..Self::default() }
    }

    pub(super) fn set_flight(&mut self, flying: bool, armed: bool) {
        (self.flying, self.armed) = (flying, armed);
    }

    /// Why there is no session now; empty where there may be one.
    fn refusal(&self) -> &'static str {
        match (self.flying, self.armed) {
            (true, _) => "the vehicle reports that it flies: land and disarm it first",
            (false, true) => "the vehicle is armed: disarm it before anybody turns it by hand",
            (false, false) => "",
        }
    }

    /// Whether its instructions are what the pilot should see.
    pub(super) fn instructs(&self) -> bool {
        self.begun && self.refusal().is_empty()
    }
}

impl Engine {
    /// Looks at a vehicle that people may be turning.
    pub(super) fn look_at_ground(&mut self, imu: &ImuSample) {
        if imu.t_s < self.ground.next_s {
            return;
        }
        self.ground.next_s = imu.t_s + EVERY_S;
        if self.ground.flying || !self.estimator.is_handled() {
            return;
        }
        let (rate, force) = self.stillness.smoothed();
        let sigma = self.estimator.filter().map(|f| {
            let sigmas = super::estimate::Constants::of_filter(f).estimate(self.estimator.model());
            let cells = sigmas.g_sensitivity_deg_per_h_per_g.sigma;
            cells.as_flattened().iter().copied().fold(0.0, f64::max)
        });
        let look = Look {
            t_s: imu.t_s,
            force,
            rate,
            stationary: self.estimator.is_stationary(),
            noise: self.estimator.gyro_noise(),
            g_sigma_deg_per_h_per_g: sigma.unwrap_or(f64::NAN),
        };
        self.ground.session.look(&look);
        // Whoever puts the vehicle on a second side means it.
        let held = self.ground.session.sides().iter().filter(|s| s.held_s > 0.0).count();
        self.ground.begun |= held > 1;
    }

    /// The session in words and figures.
    pub(super) fn ground_status(&self) -> GroundStatus {
        let watch = &self.ground;
        let session = &watch.session;
        let instruction = session.instruction();
        let refused = watch.refusal();
        let wanted_s = Session::wanted_s(self.estimator.gyro_noise());
        let side = |s: &gaware_nav::ground::session::SideState| GroundSide {
            side: s.side.words().to_owned(),
            held_s: s.held_s,
            wanted_s,
            done: s.done,
            skipped: s.skipped,
            g_sigma_deg_per_h_per_g: s.g_sigma_deg_per_h_per_g.filter(|s| s.iter().all(|x| x.is_finite())),
        };
        GroundStatus {
            active: watch.instructs(),
            done: session.is_done(),
            refused: refused.to_owned(),
            instruction: instruction.words(),
            seconds_left: match instruction {
                Instruction::Hold { seconds_left, .. } => Some(seconds_left),
                _ => None,
            },
            duration_s: session.duration_s(),
            interruptions: session.interruptions(),
            sides: session.sides().iter().map(side).collect(),
            turned_deg: session.turned().map(f64::to_degrees),
            without_fixes: self.estimator.on_ground_without_fixes().is_some(),
            reference_known: self.estimator.on_ground_without_fixes() != Some(false),
        }
    }

    /// What the session asks for and how far it is, in words; nothing where it asks for nothing.
    pub(super) fn ground_words(&self) -> Option<[String; 2]> {
        let watch = &self.ground;
        if !watch.instructs() || !self.estimator.is_handled() {
            return None;
        }
        let sides = watch.session.sides();
        let done = sides.iter().filter(|s| s.done).count();
        let all = sides.iter().filter(|s| !s.skipped).count();
        let reference = match self.estimator.on_ground_without_fixes() {
            Some(false) => {
                " Place or heading is unknown: the Earth's rate counts as an unknown of 15 deg/h (--home LAT,LON gives the place)."
            }
            _ => "",
        };
        Some([
            watch.session.instruction().words(),
            format!("G by hand: {done} of {all} sides done.{reference}"),
        ])
    }
}
