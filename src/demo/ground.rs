//! The ground session before the flight: the same unit, turned to six sides by simulated hands indoors, in virtual time through an engine of its
//! own. What it finds is the file of the unit, and the belief that the flight begins with.

use super::{HOME, Prepared, Settings};
use crate::engine::snapshot::{Snapshot, Status};
use crate::engine::{Engine, EngineOptions};
use crate::unit::{Origin, Unit};
use gaware_nav::earth::Geodetic;
use gaware_sitl::sensors::{Flight as Simulated, SensorConfig, draw_vehicle};
use gaware_sitl::trajectory::Flown;
use gaware_sitl::trajectory::hand::Hand;
use serde_json::{Value, json};

/// A side is held for so long, s, and six more: what the session asks for, each of them at least twice. With the turns that makes six minutes.
const HOLD_S: f64 = 15.0;
/// Step of the integrated path, s: a session bends slowly.
const STEP_S: f64 = 0.02;
/// The day of the simulated session; the flight is on the same.
const DAY: &str = "2026-01-01";

/// The session.
#[derive(Debug)]
pub struct GroundSession {
    samples: Simulated,
    engine: Engine,
    now_s: f64,
    over: bool,
}

impl GroundSession {
    /// Of the unit of this seed.
    pub fn new(settings: &Settings, seed: u64) -> Self {
        let (lat, lon, height, _) = HOME;
        let path = Flown::with_step(Hand::six_sides(HOLD_S), STEP_S);
        let sensors = SensorConfig {
            imu_rate_hz: 50.0,
            attitude_rate_hz: 5.0,
            attitude_sigma_rad: [0.02, 0.02, 0.1],
            // Indoors.
            fix_rate_hz: 0.0,
            vibration: Vec::new(),
            ..Prepared::sensors()
        };
        let options = EngineOptions {
            place: Some(Geodetic::from_degrees(lat, lon, height)),
            ground: Some(Vec::new()),
            ..EngineOptions::default()
        };
        Self {
            samples: Simulated::new(Box::new(path), &draw_vehicle(&settings.drawn, seed), sensors, seed),
            engine: Engine::new(settings.belief.clone(), options),
            now_s: 0.0,
            over: false,
        }
    }

    /// On until this time, s.
    pub fn go_on(&mut self, until_s: f64) {
        while self.now_s < until_s && !self.over {
            match self.samples.next() {
                Some((sample, truth)) => {
                    self.now_s = truth.t_s;
                    self.engine.feed(&sample);
                }
                None => self.over = true,
            }
        }
    }

    /// Virtual time, s.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Whether hands have put it down for good.
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// The state now.
    pub fn snapshot(&self) -> Snapshot {
        self.engine.snapshot()
    }

    /// The unit's file; nothing where the estimation never began.
    pub fn unit(&self) -> Option<Unit> {
        let origin =
            Origin { date: DAY.to_owned(), from: vec!["ground session".to_owned()], ..Origin::default() };
        self.engine.filter().map(|filter| Unit::of_filter(filter, origin))
    }

    /// Elements of G that are observable, of how many, and the largest sigma, deg/h/g.
    fn shows(&self) -> (usize, usize, f64) {
        let snapshot = self.snapshot();
        let states = &snapshot.observability.states;
        let of_g = || states.iter().filter(|s| s.name.starts_with('g') && s.name.len() == 3);
        let sigmas = snapshot.estimate.g_sensitivity_deg_per_h_per_g.sigma;
        let observable = of_g().filter(|s| s.status == Status::Observable).count();
        (observable, of_g().count(), sigmas.as_flattened().iter().copied().fold(0.0, f64::max))
    }

    /// What it has shown, in words.
    pub fn words(&self) -> String {
        let (observable, all, sigma) = self.shows();
        format!(
            "by hand on the ground, {:.0} s: {observable} of {all} elements of G observable, sigma at most {sigma:.0} deg/h/g",
            self.now_s
        )
    }

    /// The same for the document.
    pub fn document(&self) -> Value {
        let snapshot = self.snapshot();
        let (observable, all, _) = self.shows();
        json!({"duration_s": self.now_s, "observable": observable, "of": all, "session": snapshot.ground,
            "g_sensitivity_deg_per_h_per_g": snapshot.estimate.g_sensitivity_deg_per_h_per_g})
    }
}

impl Settings {
    /// The same for a companion that begins with what this unit's file says.
    #[must_use]
    pub fn knowing(mut self, unit: &Unit) -> Self {
        unit.apply(&mut self.belief, DAY);
        self
    }
}
