//! Someone who knows what was injected, with its size, and which candidates there are: could the effect be named at all?
//!
//! The oracle compares likelihoods over all fixes, each model with the noise that suits it best: the truth against the
//! truth without the effect. By Bayes' theorem a ratio of exp(t) comes about by chance with a probability of at most
//! exp(−t), so with as many candidates as effects it names where t exceeds ln(candidates / 2 %); and it names *alone*
//! where besides no other candidate comes within ln(1 / 1 %) of the truth. The others' sizes it does not know: they are
//! fitted, and charged for it. It holds nothing out. Where several effects were injected, each is looked for with the others in
//! at their true sizes, and one of these being larger or smaller is a candidate as well.

use gaware_nav::effects::REGISTRY;
use gaware_nav::identify::Serial;
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::noise::Noise;
use gaware_nav::identify::select::{self, Selection, Settings};
use gaware_nav::math::ln;
use gaware_nav::model::{EffectSetting, Model};
use serde::Serialize;

/// Share of clean flights on which something may be named.
const ALARMS: f64 = 0.02;
/// Share of flights on which the wrong name may be reported.
const WRONG: f64 = 0.01;

/// What the oracle saw of one injected effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Seen {
    /// Whether it could be named alone.
    pub alone: bool,
    /// What the log-likelihood loses without it, nats.
    pub gain: f64,
    /// The best of the other candidates, with its evidence against the model without the effect, nats.
    pub other: Option<(&'static str, f64)>,
}

/// Which of the injected effects could be named alone.
pub(crate) fn could_name(
    flight: &Flight,
    base: &Model,
    hidden: &[EffectSetting],
    selection: &Selection,
    settings: &Settings,
) -> Vec<Seen> {
    if hidden.is_empty() {
        return Vec::new();
    }
    let settings = Settings { options: settings.options.all(), ..*settings };
    let fitted = |without: Option<usize>, start: &Noise| {
        let mut model = base.clone();
        for (_, h) in hidden.iter().enumerate().filter(|(k, _)| Some(*k) != without) {
            model.set(h.clone());
        }
        select::best_noise(&[flight], &model, start, &settings, &Serial)
    };
    let all = fitted(None, &selection.noise);
    // The likelihood has more than one maximum over the noise: each model is also fitted from where the other one ended.
    let gain = |k: usize| {
        let without = fitted(Some(k), &selection.noise);
        let better = fitted(None, &without.0).1.max(all.1);
        better - fitted(Some(k), &all.0).1.max(without.1)
    };
    let seen = |k: usize| {
        let gain = gain(k);
        let mut others = base.clone();
        hidden.iter().enumerate().filter(|h| h.0 != k).for_each(|h| others.set(h.1.clone()));
        let own = [hidden[k].effect.name()];
        let noise = if hidden.len() == 1 { &selection.base_noise } else { &selection.noise };
        let other = select::best_other(&[flight], &others, noise, &own, &settings, &Serial);
        let best_other = other.as_ref().map_or(0.0, |o| o.evidence.max(0.0));
        let chance = ln(REGISTRY.len() as f64 / ALARMS);
        Seen {
            alone: gain > chance && gain - best_other > ln(1.0 / WRONG),
            gain,
            other: other.map(|o| (o.setting.effect.name(), o.evidence)),
        }
    };
    (0..hidden.len()).map(seen).collect()
}
