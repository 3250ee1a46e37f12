//! The model for the next flight of one unit, from what its earlier flights have in common.

use super::Family;
use gaware_nav::effects::unit;
use gaware_nav::model::Model;

/// The given model with the constants of the unit as priors: value and sigma of what is expected in its next flight. Where flights say nothing of
/// a parameter, or less than the model, the model's prior stays. `None`: no such unit.
pub fn prior_model(family: &Family, name: &str, base: &Model) -> Option<Model> {
    family.units.iter().find(|u| *u == name)?;
    let mut model = base.clone();
    let expected = |effect: &str, parameter: &str, si: f64, prior_sigma: f64| {
        let own = family.parameters.iter().find(|p| p.effect == effect && p.name == parameter)?;
        let next = own.units.iter().find(|u| u.unit == name)?.next_flight;
        (next.sigma * si < prior_sigma).then_some((next.value * si, next.sigma * si))
    };
    let axes = ["x", "y", "z"];
    let imu = &mut model.imu;
    let biases = [
        ("gyro_bias", "bg", unit::DEG_PER_H.si, &mut imu.gyro_bias, &mut imu.gyro_bias_sigma),
        ("accel_bias", "ba", unit::MG.si, &mut imu.accel_bias, &mut imu.accel_bias_sigma),
    ];
    for (effect, short, si, values, sigma) in biases {
        let found: Vec<_> =
            axes.iter().filter_map(|a| expected(effect, &format!("{short}_{a}"), si, *sigma)).collect();
        // One sigma holds for the three axes: the largest, and only where all are known.
        if let [x, y, z] = found[..] {
            *values = [x.0, y.0, z.0];
            *sigma = x.1.max(y.1).max(z.1);
        }
    }
    for setting in base.effects.iter().cloned() {
        let mut changed = setting.clone();
        let name = setting.effect.name();
        for (k, (parameter, unit)) in setting.parameters().enumerate() {
            let (Some(value), Some(sigma)) = (changed.values.get_mut(k), changed.sigmas.get_mut(k)) else {
                continue;
            };
            if let Some(next) = expected(name, parameter, unit.si, *sigma) {
                (*value, *sigma) = next;
            }
        }
        if changed.values != setting.values || changed.sigmas != setting.sigmas {
            // As what a user names: it is a tolerance no longer.
            model.set(changed);
        }
    }
    Some(model)
}
