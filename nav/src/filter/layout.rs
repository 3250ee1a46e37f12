//! Which state stands where: [δr δv ε b_g b_a effects… Gauss-Markov error], the paper's order (eqs. (20) and (24)).

use crate::effects::Unit;
use crate::effects::unit;
use crate::model::Model;

/// First index of each block of fixed size.
pub mod index {
    /// Position error, body axes.
    pub const POSITION: usize = 0;
    /// Velocity error, body axes.
    pub const VELOCITY: usize = 3;
    /// Attitude error, body axes.
    pub const ATTITUDE: usize = 6;
    /// Gyro bias.
    pub const GYRO_BIAS: usize = 9;
    /// Accelerometer bias.
    pub const ACCEL_BIAS: usize = 12;
    /// First parameter of an effect.
    pub const EFFECTS: usize = 15;
}

/// One constant state behind the navigation states, as people see it.
#[derive(Debug, Clone, PartialEq)]
pub struct StateName {
    /// Effect it belongs to; `gyro_bias` and `accel_bias` for the biases.
    pub effect: &'static str,
    /// Short name, for example `g11`.
    pub name: &'static str,
    /// Unit of screens.
    pub unit: Unit,
    /// Whether it is estimated only for the sake of the others: a tolerance of the sensors.
    pub is_tolerance: bool,
}

/// An estimated parameter: which effect, which parameter of it, which state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    /// Index into the model's effects.
    pub effect: usize,
    /// Index of the parameter within the effect.
    pub parameter: usize,
    /// Index of the state.
    pub state: usize,
}

/// The order of all states of one filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    slots: Vec<Slot>,
    names: Vec<StateName>,
    wander: Option<usize>,
    len: usize,
}

impl Layout {
    /// The states that this model asks for.
    pub fn new(model: &Model) -> Self {
        let mut names = Vec::new();
        for (effect, unit, axes) in [
            ("gyro_bias", unit::DEG_PER_H, ["bg_x", "bg_y", "bg_z"]),
            ("accel_bias", unit::MG, ["ba_x", "ba_y", "ba_z"]),
        ] {
            names.extend(axes.map(|name| StateName { effect, name, unit, is_tolerance: false }));
        }
        let mut slots = Vec::new();
        for (e, setting) in model.effects.iter().enumerate() {
            for (p, (name, unit)) in setting.parameters().enumerate() {
                if setting.sigmas[p] > 0.0 {
                    slots.push(Slot { effect: e, parameter: p, state: index::GYRO_BIAS + names.len() });
                    let effect = setting.effect.name();
                    names.push(StateName { effect, name, unit, is_tolerance: model.is_tolerance(effect) });
                }
            }
        }
        let mut len = index::GYRO_BIAS + names.len();
        let wanders = model.gnss.position_correlation_s > 0.0
            && model.gnss.position_wander_sigma_m.iter().any(|s| *s > 0.0);
        let wander = wanders.then_some(len);
        len += if wanders { 3 } else { 0 };
        Self { slots, names, wander, len }
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Never: the navigation states and biases are always there.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The estimated parameters of effects.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// Biases and parameters from index [`index::GYRO_BIAS`] on, without the Gauss-Markov states.
    pub fn names(&self) -> &[StateName] {
        &self.names
    }

    /// First of the three states of correlated position error (north, east, down), if there are any.
    pub fn gauss_markov(&self) -> Option<usize> {
        self.wander
    }

    /// Index of the state of this name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|s| s.name == name).map(|i| i + index::GYRO_BIAS)
    }
}
