//! How large the error of a sensor is by all its effects, named or within their tolerances, and which of these it is of.

use super::{AirSensor, Ideal};
use crate::effects::Effect;
use crate::identify::aids::choose::Chosen;
use crate::model::EffectSetting;
use crate::sample::AirKind;
use nalgebra::DVector;

/// An effect that adds less of an error than this is not worth a word.
const SHARE: f64 = 0.2;

impl AirSensor<'_> {
    /// The error by all effects with these values at each instant, and the speed through the air.
    pub(super) fn errors(&self, values: &[f64], ideal: &[Ideal]) -> Vec<(f64, f64)> {
        let now = self.ideal(&vec![0.0; values.len()], &self.wind);
        let error = |(s, now): (&Ideal, &Ideal)| {
            (s.value - now.value + self.added(values, &s.x), now.x.velocity.norm())
        };
        ideal.iter().zip(&now).map(error).collect()
    }

    /// Values of all effects within the tolerances of those that are not named. A height's scale within its tolerance is the air of a warm or cold day, and no error of a sensor.
    pub(super) fn of_the_sensor(&self, chosen: &Chosen) -> Vec<f64> {
        let mut values = chosen.within[0].clone();
        if self.kind == AirKind::Barometer {
            let of_day =
                self.catalogue.iter().flat_map(|e| std::iter::repeat_n(e.name() == "baro_scale", e.len()));
            values
                .iter_mut()
                .zip(&chosen.named)
                .zip(of_day)
                .filter(|(_, d)| *d)
                .for_each(|((v, n), _)| *v = *n);
        }
        values
    }

    /// By how much the error at an instant grows with each parameter.
    pub(super) fn slope(&self, s: &Ideal) -> DVector<f64> {
        let drivers = self.catalogue.iter().filter_map(|e| e.on_air()).flat_map(|a| a.drivers);
        let mut slope = DVector::zeros(self.widths.len());
        slope.iter_mut().zip(drivers).for_each(|(o, d)| *o = d.value(&s.x));
        slope
    }

    /// Effects that are not named, with the value of each within its tolerance, where that adds more than [`SHARE`] of the error at an instant.
    pub(super) fn shared(&self, slope: &DVector<f64>, values: &[f64], chosen: &Chosen) -> Vec<EffectSetting> {
        let sigma = |k: usize| chosen.covariance[(k, k)].max(0.0).sqrt();
        let total: f64 = slope.iter().zip(values).map(|(s, v)| s * v).sum();
        let mut at = 0;
        let one = |effect: &&'static dyn Effect| {
            let own = at..at + effect.len();
            at += effect.len();
            let part: f64 = own.clone().map(|k| slope[k] * values[k]).sum();
            let is_named = chosen.findings.iter().any(|f| f.setting.effect.name() == effect.name());
            let mut setting = EffectSetting::unknown(*effect);
            setting.values = own.clone().map(|k| values[k]).collect();
            setting.sigmas = own.map(sigma).collect();
            (!is_named && part / total > SHARE).then_some(setting)
        };
        self.catalogue.iter().filter_map(one).collect()
    }
}
