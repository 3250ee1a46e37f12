//! Prediction of what a flight makes observable of compass, barometer and airspeed: the information that a report would have of them, along kinematics.
//!
//! A sensor's parameters count as known where an error of their usual size would be named.

use super::{BoundPredictor, NamedSigma, Predictor};
use crate::airframe::Airframe;
use crate::kinematics::Kinematics;
use crate::maneuver::Maneuver;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::identify::aids::foreseen::{Foresight, Planned, Setting};
use gaware_nav::identify::air::Carriage;
use nalgebra::{Vector2, Vector3};
use std::borrow::Cow;

/// Thrust over weight of a multirotor at full throttle: it hovers at half (ArduPilot learns `MOT_THST_HOVER` from .125 to .6875).
const ROTOR_FULL_G: f64 = 2.0;
/// Current at full throttle, A: small electric vehicles. The sigmas of effects per ampere go with its inverse.
pub const FULL_CURRENT_A: f64 = 40.0;

/// Along the kinematics of an airframe.
#[derive(Debug, Clone)]
pub struct SensorPredictor {
    /// Heading; it is followed only for a compass.
    bound: BoundPredictor,
    has_compass: bool,
    airframe: Airframe,
    foresight: Foresight,
    wind: Vector2<f64>,
    elapsed_s: f64,
    since_fix_s: f64,
}

impl SensorPredictor {
    /// `bound`: where the flight begins. `field_n`: the Earth's field there, north, east, down, T.
    pub fn new(
        bound: BoundPredictor,
        airframe: &Airframe,
        planned: &[Planned],
        wind_n_e: [f64; 2],
        field_n: Vector3<f64>,
    ) -> Self {
        let setting = Setting {
            is_wing: airframe.is_fixed_wing(),
            wind: wind_n_e.into(),
            home_height_m: bound.home_height_m,
            field_n,
            full_current_a: FULL_CURRENT_A,
        };
        Self {
            bound,
            has_compass: planned.contains(&Planned::Compass),
            airframe: airframe.clone(),
            foresight: Foresight::new(planned, setting),
            wind: setting.wind,
            elapsed_s: 0.0,
            since_fix_s: 0.0,
        }
    }

    /// Share of full throttle: of a multirotor by its thrust, of a wing between idle and full by what they accelerate.
    fn throttle(&self, k: &Kinematics) -> f64 {
        let a = &self.airframe;
        let share = if a.is_fixed_wing() {
            let through_air = k.velocity_ned_m_per_s - Vector3::new(self.wind.x, self.wind.y, 0.0);
            let along = (k.attitude * k.force).dot(&through_air) / through_air.norm().max(1.0);
            (along + a.braking_m_per_s2) / (a.acceleration_m_per_s2 + a.braking_m_per_s2)
        } else {
            -k.force.z / (ROTOR_FULL_G * STANDARD_GRAVITY)
        };
        share.clamp(0.0, 1.0)
    }

    fn at_fix(&mut self, k: &Kinematics) {
        let now = Carriage {
            elapsed_s: self.elapsed_s,
            c_nb: k.attitude.to_rotation_matrix(),
            v_n: k.velocity_ned_m_per_s,
            height_m: self.bound.home_height_m + k.height_m(),
            throttle: self.throttle(k),
            force: Some(k.force),
        };
        self.foresight.take(&now, &k.rate);
    }
}

impl Predictor for SensorPredictor {
    fn fly(&mut self, kinematics: &[Kinematics], fix_interval_s: f64) {
        if self.has_compass {
            self.bound.fly(kinematics, fix_interval_s);
        }
        let mut last_t_s = None;
        for k in kinematics {
            let dt_s = last_t_s.replace(k.t_s).map_or(0.0, |t| k.t_s - t).max(0.0);
            self.elapsed_s += dt_s;
            self.since_fix_s += dt_s;
            if self.since_fix_s >= fix_interval_s {
                self.since_fix_s = 0.0;
                self.at_fix(k);
            }
        }
    }

    fn sigmas(&self) -> Vec<NamedSigma> {
        let [_, _, yaw_sigma] = self.bound.attitude_sigma_rad();
        let one = |f: &gaware_nav::identify::aids::foreseen::Foreseen| NamedSigma {
            name: Cow::Borrowed(f.name),
            sigma: f.sigma,
            target: f.target,
            unit: Cow::Borrowed(f.unit.symbol),
        };
        self.foresight.parameters(yaw_sigma).iter().map(one).collect()
    }

    /// An error of a sensor is named or it is not.
    fn is_short_of_use(&self) -> bool {
        false
    }

    fn maneuvers(&self, airframe: &Airframe) -> Vec<Maneuver> {
        Maneuver::for_sensors(airframe)
    }
}
