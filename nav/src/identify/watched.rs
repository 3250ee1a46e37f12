//! What a run over a linearised flight watches: parameters of effects that the model lacks (or holds at a wrong value), and terms outside
//! the catalogue, each a column of the linear model.

use crate::effects::{Instant, MAX_PARAMETERS};
use crate::model::EffectSetting;
use nalgebra::Vector3;

/// A term of the sparse regression: a disturbance of one sensor axis in proportion to a product of motion.
#[derive(Debug, Clone, Copy)]
pub struct Term {
    /// 0 … 2: gyro x, y, z; 3 … 5: accelerometer x, y, z.
    pub channel: usize,
    /// What it is proportional to.
    pub regressor: fn(&Instant) -> f64,
}

/// What is watched.
#[derive(Debug, Clone, Default)]
pub struct Watched {
    /// Effects with the values about which they are linearised; every parameter that can be a state is watched.
    pub effects: Vec<EffectSetting>,
    /// Terms outside the catalogue.
    pub terms: Vec<Term>,
}

impl Watched {
    /// Effect and parameter of each of the first columns.
    pub fn slots(&self) -> Vec<(usize, usize)> {
        let mut slots = Vec::new();
        for (e, setting) in self.effects.iter().enumerate() {
            slots.extend(setting.states().map(|p| (e, p)));
        }
        slots
    }

    /// What each watched parameter of the effects does to the rate and the force that are read off the samples, appended to
    /// `columns`.
    pub(crate) fn imu_columns(&self, x: &Instant, columns: &mut Vec<[Vector3<f64>; 2]>) {
        for setting in &self.effects {
            let Some(effect) = setting.effect.on_samples() else {
                columns.extend(setting.states().map(|_| [Vector3::zeros(); 2]));
                continue;
            };
            let n = setting.effect.len();
            let (mut gyro, mut accel) =
                ([Vector3::zeros(); MAX_PARAMETERS], [Vector3::zeros(); MAX_PARAMETERS]);
            effect.imu_jacobian(&setting.values, x, &mut gyro[..n], &mut accel[..n]);
            columns.extend(setting.states().map(|k| [-gyro[k], -accel[k]]));
        }
    }

    /// The same of effects and terms.
    pub(crate) fn columns(&self, x: &Instant, columns: &mut Vec<[Vector3<f64>; 2]>) {
        self.imu_columns(x, columns);
        columns.extend(self.terms.iter().map(|term| {
            let mut column = [Vector3::zeros(); 2];
            column[term.channel / 3 % 2][term.channel % 3] = -(term.regressor)(x);
            column
        }));
    }
}
