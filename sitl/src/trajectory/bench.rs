//! A vehicle that stands on the bench.

use super::{Chain, Profile};
use crate::truth::Motion;
use gaware_nav::earth::Geodetic;
use nalgebra::Vector3;

/// Stands still, not quite level.
#[derive(Debug, Clone)]
pub struct Bench {
    /// How long, s.
    pub duration_s: f64,
    /// Roll, pitch, yaw, rad.
    pub roll_pitch_yaw: [f64; 3],
}

impl Bench {
    /// For this long, 1° right wing down and 2° nose up, heading 70°.
    pub fn new(duration_s: f64) -> Self {
        Self { duration_s, roll_pitch_yaw: [1.0, 2.0, 70.0].map(f64::to_radians) }
    }
}

impl Profile for Bench {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn start(&self) -> Geodetic {
        Geodetic::from_degrees(47.397_7, 8.545_6, 488.0)
    }

    fn motion_at(&self, _t_s: f64, _course_rad: f64) -> (Motion, f64) {
        let [roll, pitch, yaw] = self.roll_pitch_yaw;
        let body = Chain::new().about(2, yaw, 0.0).about(1, pitch, 0.0).about(0, roll, 0.0);
        let still = Motion {
            v_n: Vector3::zeros(),
            a_n: Vector3::zeros(),
            c_nb: body.matrix(),
            rate_nb: Vector3::zeros(),
        };
        (still, 0.0)
    }
}
