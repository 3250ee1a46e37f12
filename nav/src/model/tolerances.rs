//! Tolerances: what calibration leaves in the sensors of any vehicle.
//!
//! Scale factors, axes and the place of the antenna are never exact. A model without them takes them for exact, and whatever it
//! estimates beside them absorbs their errors with sigmas that are too small: 0.15 % of gyro scale factor looks like 400 deg/h/g. So the
//! standard model estimates them from zero with the tolerance of a consumer unit ([`Effect::tolerance`](crate::effects::Effect::tolerance))
//! as prior sigma. States with a prior no wider than that are nuisance parameters: they widen the sigmas of all others, and no
//! maneuver is planned for their sake.

use super::{EffectSetting, Model};
use crate::effects::{Effect, REGISTRY};

/// Prior sigmas up to this share above the tolerance count as the tolerance: files have twelve digits.
const ROUNDING: f64 = 1.0 + 1e-9;

impl EffectSetting {
    /// Zero with the tolerance of a consumer unit as sigma, if the effect has one.
    pub fn tolerance(effect: &'static dyn Effect) -> Option<Self> {
        let sigma = effect.tolerance()?;
        Some(Self { effect, values: vec![0.0; effect.len()], sigmas: vec![sigma; effect.len()] })
    }

    /// Whether this parameter is estimated for the sake of the others: its prior sigma is within the tolerance.
    pub fn is_tolerance(&self, parameter: usize) -> bool {
        let sigma = self.sigmas.get(parameter).copied().unwrap_or(0.0);
        sigma > 0.0 && self.effect.tolerance().is_some_and(|t| sigma <= t * ROUNDING)
    }
}

impl Model {
    /// The same with the tolerances of a consumer unit for every effect that has one and that the model does not name.
    #[must_use]
    pub fn with_tolerances(mut self) -> Self {
        for effect in REGISTRY {
            if self.get(effect.name()).is_none() {
                self.effects.extend(EffectSetting::tolerance(*effect));
            }
        }
        self
    }

    /// The same without any parameter that is estimated as a tolerance: the model of a unit that is calibrated perfectly.
    #[must_use]
    pub fn without_tolerances(mut self) -> Self {
        self.effects.retain(|setting| {
            let mut estimated = (0..setting.sigmas.len()).filter(|k| setting.sigmas[*k] > 0.0).peekable();
            estimated.peek().is_none() || estimated.any(|k| !setting.is_tolerance(k))
        });
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::layout::Layout;

    #[test]
    fn a_consumer_unit_has_the_tolerances_of_its_data_sheet() {
        let model = Model::default().with_tolerances();
        let sigma = |name: &str| {
            let setting = model.get(name).unwrap_or_else(|| panic!("{name} is missing"));
            assert!(setting.values.iter().all(|v| *v == 0.0), "{name}");
            setting.sigmas.clone()
        };
        for name in ["gyro_scale_factor", "accel_scale_factor"] {
            assert!(sigma(name).iter().all(|s| (s - 0.003).abs() < 1e-12), "{name}");
        }
        for name in ["gyro_misalignment", "accel_misalignment"] {
            assert!(sigma(name).iter().all(|s| (s - 0.003).abs() < 1e-12), "{name}");
        }
        assert_eq!(sigma("gps_lever_arm"), vec![0.3; 3]);
        assert_eq!(model.effects.len(), 5);
    }

    #[test]
    fn what_the_model_names_stays_as_it_is() {
        let mut model = Model::default();
        let Ok(known) = EffectSetting::known(&crate::effects::GpsLeverArm, &[0.5, 0.0, -0.1]) else {
            panic!("three values")
        };
        model.set(known);
        let model = model.with_tolerances();
        let arm = model.get("gps_lever_arm").map(|s| (s.values.clone(), s.sigmas.clone()));
        assert_eq!(arm, Some((vec![0.5, 0.0, -0.1], vec![0.0; 3])));
        assert_eq!(model.effects.len(), 5);
        let states = Layout::new(&model).len();
        assert_eq!(model.with_tolerances().effects.len(), 5);
        assert_eq!(states, 15 + 3 + 3 + 6 + 3);
    }

    #[test]
    fn taking_tolerances_out_leaves_what_is_sought_or_known() {
        let names = |m: Model| m.effects.iter().map(|s| s.effect.name()).collect::<Vec<_>>();
        assert_eq!(names(Model::standard().without_tolerances()), names(Model::calibrated()));
        let mut model = Model::standard();
        model.set(EffectSetting::unknown(&crate::effects::GpsLeverArm));
        if let Ok(known) = EffectSetting::known(&crate::effects::GyroScaleFactor, &[1e-3; 3]) {
            model.set(known);
        }
        let left = names(model.without_tolerances());
        assert!(left.contains(&"gps_lever_arm") && left.contains(&"gyro_scale_factor"), "{left:?}");
        assert_eq!(left.len(), 4);
    }

    #[test]
    fn a_wider_prior_is_sought_and_a_tighter_one_is_a_nuisance() {
        let tolerance = |factor: f64| {
            let mut setting = EffectSetting::unknown(&crate::effects::GyroScaleFactor);
            setting.sigmas.iter_mut().for_each(|s| *s *= factor);
            (0..3).map(|k| setting.is_tolerance(k)).collect::<Vec<_>>()
        };
        assert_eq!(tolerance(1.0), [true; 3]);
        assert_eq!(tolerance(0.1), [true; 3]);
        assert_eq!(tolerance(0.0), [false; 3]);
        assert_eq!(tolerance(2.0), [false; 3]);
    }
}
