//! The ground session inside the engine: looks at the motion of a vehicle that stands or is turned by hand, a few times a second.

use super::Engine;
use super::estimate::Constants;
use super::snapshot::{GroundSide, GroundStatus};
use gaware_nav::ground::session::{Instruction, Look, Session, Side};
use gaware_nav::sample::ImuSample;

/// A look every so often, s.
const EVERY_S: f64 = 0.1;
/// What turns show of the gyros, and the sigma wanted, ppm and mrad: what a turn at 2 g leaves of scale and axes is then as little as what six sides leave of
/// G (0.4 rad/s times 300 ppm is 25 deg/h, times 0.5 mrad 41 deg/h).
const BY_TURNS: [(&str, f64); 2] = [("gyro_scale_factor", 300.0), ("gyro_misalignment", 0.5)];

/// A session during which the temperature changes by more may take a drift for G, °C: elements were within 2 sigma of the truth where it changed by 4 °C, and up
/// to 5.5 and 13 sigma off where it changed by 8 and by 12 to 20 °C, at 15 deg/h/°C (18 independent sessions, 2026-11-30).
const WARMS_DEGC: f64 = 7.0;
/// What is said then.
pub(crate) const WARMED: &str = "the temperature of the unit changed by more than 7 °C while it was turned by hand: G may be off by many sigmas; let it run warm and turn it again, or see what gaware explain makes of the recording";

/// The session and when the next look is due.
#[derive(Debug, Clone, Default)]
pub(super) struct GroundWatch {
    session: Session,
    next_s: f64,
    /// Whether it was asked for, or people have begun it by turning the vehicle.
    begun: bool,
    armed: bool,
    flying: bool,
    /// Least and largest temperature while it was held, °C.
    held_degc: Option<(f64, f64)>,
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

/// Of what turns about each axis show: the root mean square of the sigmas as shares of those wanted.
fn by_turns(constants: &Constants) -> [f64; 3] {
    let mut sums = [(0.0, 0.0); 3];
    for (name, sigma) in constants.layout.names().iter().zip(&constants.sigma) {
        let wanted = BY_TURNS.iter().find(|(effect, _)| *effect == name.effect);
        // The last letter is the axis that is turned about.
        let axis = ["x", "y", "z"].iter().position(|axis| name.name.ends_with(axis));
        if let (Some((_, wanted)), Some(axis)) = (wanted, axis) {
            let (sum, n) = sums[axis];
            sums[axis] = (sum + (sigma / name.unit.si / wanted).powi(2), n + 1.0);
        }
    }
    sums.map(|(sum, n)| if n > 0.0 { f64::sqrt(sum / n) } else { 0.0 })
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
        let constants = self.estimator.filter().map(Constants::of_filter);
        let sigma = constants.as_ref().map(|c| {
            let cells = c.estimate(self.estimator.model()).g_sensitivity_deg_per_h_per_g.sigma;
            cells.as_flattened().iter().copied().fold(0.0, f64::max)
        });
        let look = Look {
            t_s: imu.t_s,
            force,
            rate,
            stationary: self.estimator.is_stationary(),
            noise: self.estimator.gyro_noise(),
            g_sigma_deg_per_h_per_g: sigma.unwrap_or(f64::NAN),
            turn_sigma: constants.as_ref().map(by_turns).unwrap_or_default(),
        };
        self.ground.session.look(&look);
        if let (true, Some(now)) = (look.stationary, imu.temperature_degc) {
            let (least, most) = self.ground.held_degc.unwrap_or((now, now));
            self.ground.held_degc = Some((least.min(now), most.max(now)));
        }
        // Whoever puts the vehicle on a second side means it.
        let held = self.ground.session.sides().iter().filter(|s| s.held_s > 0.0).count();
        self.ground.begun |= held > 1;
        if self.has_warmed() {
            self.warnings.push(WARMED);
        }
    }

    /// Whether the temperature changed too much during a session for what it says of G.
    pub(crate) fn has_warmed(&self) -> bool {
        self.ground.begun && self.ground.held_degc.is_some_and(|(least, most)| most - least > WARMS_DEGC)
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
            turn_sigma: session.turn_sigma(),
            turned_on_support_mrad: self.turned_on_support_mrad(),
            without_fixes: self.estimator.on_ground_without_fixes().is_some(),
            reference_known: self.estimator.on_ground_without_fixes() != Some(false),
        }
    }

    fn turned_on_support_mrad(&self) -> f64 {
        self.estimator.filter().map_or(0.0, |f| 1e3 * f.turned_on_support())
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
        let support = match self.turned_on_support_mrad() {
            0.0 => String::new(),
            mrad => format!(
                " The support gives way ({mrad:.1} mrad in one hold): put the vehicle on something firm."
            ),
        };
        Some([
            watch.session.instruction().words(),
            format!("G by hand: {done} of {all} sides done.{support}{reference}"),
        ])
    }
}
