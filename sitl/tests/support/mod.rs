//! What the tests of plans share.

use gaware_mission::kinematics::Kinematics;
use gaware_mission::predictor::{NamedSigma, Predictor};
use nalgebra::Vector3;

/// Rewards spread of specific force: no filter is needed to see whether a plan is safe and what a firmware takes of it.
#[derive(Clone)]
pub struct Spread(pub [f64; 3]);

impl Predictor for Spread {
    fn fly(&mut self, kinematics: &[Kinematics], _: f64) {
        for k in kinematics {
            let d = k.force - Vector3::new(0.0, 0.0, -9.80665);
            (0..3).for_each(|i| self.0[i] += d[i] * d[i] * 0.05);
        }
    }

    fn sigmas(&self) -> Vec<NamedSigma> {
        let one = |i: usize| NamedSigma {
            name: format!("g{i}").into(),
            sigma: 360.0 / (1.0 + self.0[i]).sqrt(),
            target: 5.0,
            unit: "".into(),
        };
        (0..3).map(one).collect()
    }
}
