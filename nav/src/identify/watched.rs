//! What a run over a linearised flight watches: parameters of effects that the model lacks (or holds at a wrong value), each a column of the
//! linear model.

use crate::effects::{ActsOn, Instant, MAX_PARAMETERS};
use crate::model::EffectSetting;
use nalgebra::Vector3;

/// What is watched.
#[derive(Debug, Clone, Default)]
pub struct Watched {
    /// Effects with the values about which they are linearised; every parameter that can be a state is watched.
    pub effects: Vec<EffectSetting>,
}

impl Watched {
    /// Effect and parameter of each column.
    pub fn slots(&self) -> Vec<(usize, usize)> {
        let mut slots = Vec::new();
        for (e, setting) in self.effects.iter().enumerate() {
            slots.extend(setting.states().map(|p| (e, p)));
        }
        slots
    }

    /// What each watched parameter does to the rate and the force that are read off the samples, appended to `columns`.
    pub(crate) fn columns(&self, x: &Instant, columns: &mut Vec<[Vector3<f64>; 2]>) {
        for setting in &self.effects {
            let effect = setting.effect;
            if !effect.acts_on(ActsOn::Samples) {
                columns.extend(setting.states().map(|_| [Vector3::zeros(); 2]));
                continue;
            }
            let n = effect.len();
            let (mut gyro, mut accel) =
                ([Vector3::zeros(); MAX_PARAMETERS], [Vector3::zeros(); MAX_PARAMETERS]);
            effect.imu_jacobian(&setting.values, x, &mut gyro[..n], &mut accel[..n]);
            columns.extend(setting.states().map(|k| [-gyro[k], -accel[k]]));
        }
    }
}
