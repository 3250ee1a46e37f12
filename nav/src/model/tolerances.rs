//! Tolerances: what calibration leaves in the sensors of any vehicle.
//!
//! Scale factors, axes and the place of the antenna are never exact. A model without them takes them for exact, and whatever it
//! estimates beside them absorbs their errors with sigmas that are too small: 0.15 % of gyro scale factor looks like 400 deg/h/g. So the
//! standard model estimates them from zero with the tolerance of a consumer unit ([`Effect::tolerance`](crate::effects::Effect::tolerance))
//! as prior sigma. They are nuisance parameters: they widen the sigmas of all others, but no flight is flown for their sake. An effect that
//! a user names is no tolerance any more.
//!
//! Nor does a consumer unit keep its constants for a day: they walk by a share of their prior sigma, which for the gyro biases is 7 deg/h in
//! an hour and for the scale factors 30 ppm. Without it a filter that is never switched off counts on constants that no unit has, and
//! the smallest systematic error leaves its sigmas in the end (fictitious process noise: Maybeck 1979, section 6.8).

use super::{EffectSetting, Model};
use crate::effects::{Effect, RECEIVER, REGISTRY};

/// Random walks of the biases and of all other constants of a model with tolerances, in an hour, as shares of their prior sigmas. That of a
/// bias is what changes from one start to the next, of which less changes in between.
const WALK_PER_RTH: [f64; 2] = [0.004, 0.01];

impl EffectSetting {
    /// Zero with the tolerance of a consumer unit as sigma, if the effect has one; what is beyond its first group is as unknown as it is without.
    pub fn tolerance(effect: &'static dyn Effect) -> Option<Self> {
        let (sigma, mut setting) = (effect.tolerance()?, Self::unknown(effect));
        setting.sigmas.iter_mut().take(effect.groups().first()?.shape.len()).for_each(|s| *s = sigma);
        Some(setting)
    }
}

impl Model {
    /// The same with the tolerances of a consumer unit for every effect that has one and that the model does not name.
    #[must_use]
    pub fn with_tolerances(mut self) -> Self {
        for effect in REGISTRY.iter().chain([&RECEIVER]) {
            if let (None, Some(setting)) = (self.get(effect.name()), EffectSetting::tolerance(*effect)) {
                self.effects.push(setting);
                self.tolerances.push(effect.name());
            }
        }
        self
    }

    /// The same with what every receiver does to its velocities, to be estimated, unless the model says how much that is: a model describes an
    /// inertial unit, whatever receiver it flies with. Without it an accelerometer scale of a recorded flight was 9 sigma off.
    #[must_use]
    pub fn with_receiver(mut self) -> Self {
        if self.get(RECEIVER.name()).is_none() {
            self.set(EffectSetting::unknown(RECEIVER));
        }
        self
    }

    /// The same without tolerances: sensors that are calibrated perfectly.
    #[must_use]
    pub fn without_tolerances(mut self) -> Self {
        let tolerances = std::mem::take(&mut self.tolerances);
        self.effects.retain(|s| !tolerances.contains(&s.effect.name()));
        self
    }

    /// Random walks of the biases and of all other constants, as shares of their prior sigmas, 1/√s.
    pub fn constants_walk(&self) -> Option<[f64; 2]> {
        (!self.tolerances.is_empty()).then(|| WALK_PER_RTH.map(|share| share / 60.0))
    }

    /// Whether this effect is in the model as a tolerance only.
    pub fn is_tolerance(&self, name: &str) -> bool {
        self.tolerances.contains(&name)
    }

    /// Whether a file can ask for the tolerances by one word instead of naming each effect: they are as they were added.
    pub(super) fn is_unchanged_tolerance(&self, setting: &EffectSetting) -> bool {
        self.is_tolerance(setting.effect.name())
            && EffectSetting::tolerance(setting.effect)
                .is_some_and(|t| t.values == setting.values && t.sigmas == setting.sigmas)
    }

    /// Effects that would come back if a file asked for tolerances, though the model has none of theirs.
    pub(super) fn tolerances_left_out(&self) -> impl Iterator<Item = EffectSetting> {
        let without = REGISTRY.iter().filter(|e| e.tolerance().is_some() && self.get(e.name()).is_none());
        without.filter_map(|e| EffectSetting::known(*e, &vec![0.0; e.len()]).ok())
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
        assert_eq!(sigma("gps_smoothing"), vec![0.005, 1.3e-4]);
        assert_eq!(model.effects.len(), 6);
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
        assert_eq!(model.effects.len(), 6);
        let states = Layout::new(&model).len();
        assert_eq!(model.with_tolerances().effects.len(), 6);
        assert_eq!(states, 15 + 3 + 3 + 6 + 3 + 2);
    }

    #[test]
    fn taking_tolerances_out_leaves_what_is_named() {
        let names = |m: Model| m.effects.iter().map(|s| s.effect.name()).collect::<Vec<_>>();
        assert_eq!(names(Model::standard().without_tolerances()), names(Model::calibrated()));
        let mut model = Model::standard();
        assert!(model.is_tolerance("gps_lever_arm") && !model.is_tolerance("gps_latency"));
        model.set(EffectSetting::unknown(&crate::effects::GpsLeverArm));
        assert!(!model.is_tolerance("gps_lever_arm"));
        let left = names(model.without_tolerances());
        assert_eq!(left, ["gyro_g_sensitivity", "gps_latency", "gps_lever_arm"]);
    }

    #[test]
    fn layouts_say_which_states_are_tolerances() {
        let mut model = Model::standard();
        model.set(EffectSetting::unknown(&crate::effects::GYRO_SCALE_FACTOR));
        let layout = Layout::new(&model);
        let tolerances: Vec<_> = layout.names().iter().filter(|n| n.is_tolerance).map(|n| n.effect).collect();
        assert_eq!(tolerances.len(), 3 + 6 + 3 + 3 + 2);
        assert!(!tolerances.contains(&"gyro_scale_factor") && !tolerances.contains(&"gyro_g_sensitivity"));
    }
}
