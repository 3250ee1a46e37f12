//! Whether what is measured agrees with the unit's own file ([`crate::model::JointPrior`]), and a filter that does without it.

use super::Filter;
use super::calibration::Calibration;
use super::layout::index;
use crate::consistency::departure;

/// A constant that lies farther from the unit's file than so many sigmas contradicts it: thirty constants are looked at every second of a flight, of
/// which a normal one is beyond five sigmas once in 1.7 million.
const UNIT_CONTRADICTED: f64 = 5.0;

impl Filter {
    /// What contradicts the unit's own file most: the name of a constant, how many of its sigmas it lies from what the file says, and how many
    /// such constants there are. Biases are no evidence: each turn-on has its own.
    pub fn contradicts_unit(&self) -> Option<(&'static str, f64, usize)> {
        let joint = self.model.joint.as_deref()?;
        let said = Calibration::new(&self.model);
        let names = self.layout.names().iter().enumerate();
        let off = names.filter(|(_, n)| joint.names.iter().any(|j| j == n.name)).map(|(k, n)| {
            let state = index::GYRO_BIAS + k;
            let before = self.initial_sigmas[state].powi(2);
            let moved = self.estimate.calibration.get(&self.layout, state) - said.get(&self.layout, state);
            (n, departure(moved, before, self.p.at(state, state)))
        });
        let beyond: Vec<_> =
            off.filter(|(n, z)| !n.effect.ends_with("_bias") && *z > UNIT_CONTRADICTED).collect();
        let (worst, sigmas) = beyond.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((worst.name, *sigmas, beyond.len()))
    }

    /// The same filter that believes nothing of what the unit's own file says of its constants: they keep their values and are as uncertain as
    /// before anything was measured.
    #[must_use]
    pub fn forgetting_unit(&self) -> Self {
        let mut free = self.clone();
        let Some(joint) = &self.model.joint else { return free };
        for (name, unmeasured) in joint.names.iter().zip(&joint.unmeasured_si) {
            let Some(state) = self.layout.find(name) else { continue };
            free.p.add_variance(state, (unmeasured.powi(2) - self.p.at(state, state)).max(0.0));
            free.initial_sigmas[state] = free.initial_sigmas[state].max(*unmeasured);
        }
        free.model = self.model.clone().forgetting_unit();
        free
    }
}
