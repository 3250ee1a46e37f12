//! Blind flights: an effect is hidden in a simulated vehicle, the vehicle flies, the explanation names what it finds, and only
//! then the truth is looked at.
//!
//! Two families of flights exist: one on which thresholds were tuned, and one kept aside (other maneuvers, speeds, air,
//! vibration and seeds) for the figures that count.

use super::parallel::{Progress, map_runs};
use gaware_nav::effects::{self, Effect, REGISTRY};
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::noise::fit;
use gaware_nav::identify::select::{self, Settings};
use gaware_nav::identify::{Serial, pass};
use gaware_nav::model::{EffectSetting, Model};
use gaware_nav::sample::{Quantisation, Sample, Steps};
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::sensors::{Flight as Simulated, SensorConfig, Temperature, VibrationLine};
use gaware_sitl::trajectory::Flown;
use gaware_sitl::trajectory::fixed_wing::FixedWing;
use gaware_sitl::trajectory::signal::Signal;
use serde::Serialize;
use std::collections::BTreeMap;

/// How the aircraft is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Turns, pull-ups, changes of speed and sideslips.
    Rich,
    /// The same without sideslip.
    Coordinated,
}

/// Which flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Those on which the method was tuned.
    Tuning,
    /// Those kept aside.
    Aside,
}

/// One blind flight.
#[derive(Debug, Clone)]
pub struct Blind {
    /// What was hidden; the sealed truth.
    pub hidden: Vec<EffectSetting>,
    /// Everything that was simulated.
    pub truth: Model,
    /// What the sensors told.
    pub samples: Vec<Sample>,
}

/// Length of a blind flight, s.
pub const DURATION_S: f64 = 240.0;
const FAMILY_SEED: u64 = 0x00a5_1de0;

/// Draws a size of an effect, from just detectable to typical.
pub fn draw(effect: &'static dyn Effect, noise: &mut Noise) -> EffectSetting {
    let mut setting = EffectSetting::unknown(effect);
    let share = 0.35 * (1.0f64 / 0.35).powf(noise.uniform());
    let between = |noise: &mut Noise, low: f64, high: f64| low * (high / low).powf(noise.uniform());
    let sizes = effect.sizes_to_try();
    for (k, sigma) in setting.sigmas.clone().into_iter().enumerate() {
        setting.values[k] = sigma * share * noise.normal();
    }
    match effect.name() {
        "gps_latency" => setting.values[0] = between(noise, 0.04, 0.3),
        "gps_bias_step" | "gyro_bias_step" => setting.values[0] = 50.0 + 140.0 * noise.uniform(),
        _ if !sizes.is_empty() => setting.values[0] = between(noise, sizes[1], sizes[sizes.len() - 1]),
        _ => {}
    }
    // A draw near zero on every axis is no effect.
    let drawn: f64 = setting
        .sigmas
        .iter()
        .zip(&setting.values)
        .filter(|(s, _)| **s > 0.0)
        .map(|(s, v)| (v / s).powi(2))
        .sum();
    let wanted = share * share * setting.estimated() as f64;
    if drawn > 0.0 && effect.name() != "gps_latency" {
        let scale = (wanted / drawn).sqrt().max(1.0);
        let sigmas = setting.sigmas.clone();
        setting.values.iter_mut().zip(sigmas).filter(|(_, s)| *s > 0.0).for_each(|(v, _)| *v *= scale);
    }
    setting.sigmas.fill(0.0);
    setting
}

/// Flies a vehicle with these effects hidden in it.
pub fn fly(hidden: &[EffectSetting], kind: Kind, family: Family, seed: u64) -> Blind {
    let seed = if family == Family::Aside { seed ^ FAMILY_SEED } else { seed };
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 7);
    let mut truth = Model::default();
    for k in 0..3 {
        truth.imu.gyro_bias[k] = 0.3f64.to_radians() * noise.normal();
        truth.imu.accel_bias[k] = 0.1 * noise.normal();
    }
    truth.imu.gyro_noise *= 0.7 + 0.8 * noise.uniform();
    truth.imu.accel_noise *= 0.7 + 0.8 * noise.uniform();
    let white = 0.3 + 0.5 * noise.uniform();
    truth.gnss.position_sigma_m = [white, white, 1.6 * white];
    truth.gnss.velocity_sigma_m_per_s = [0.06 + 0.08 * noise.uniform(); 3];
    truth.gnss.position_correlation_s = 30.0 + 60.0 * noise.uniform();
    let wander = 0.6 + 1.2 * noise.uniform();
    truth.gnss.position_wander_sigma_m = [wander, wander, 1.6 * wander];
    for setting in hidden {
        truth.set(setting.clone());
    }
    let truncation_hidden = hidden.iter().any(|s| s.effect.truncates_samples());
    let truncated = Quantisation::Truncate(Steps::RAW_IMU);
    let strength = 0.3 + noise.uniform();
    let lines: [f64; 2] = match family {
        Family::Tuning => [87.0, 61.3],
        Family::Aside => [112.9, 73.7],
    };
    let vibration = lines
        .into_iter()
        .map(|f| VibrationLine {
            frequency_hz: f + 3.0 * noise.uniform(),
            accel_rms: [0.15 * strength, 0.12 * strength, 0.25 * strength],
            gyro_rms: [1.5e-3 * strength, 1.5e-3 * strength, 1e-3 * strength],
        })
        .collect();
    let sensors = SensorConfig {
        imu_rate_hz: 50.0,
        fix_rate_hz: 5.0,
        message: "RAW_IMU".into(),
        // Hidden truncation: the source says that its values are whole.
        quantisation: if truncation_hidden { Quantisation::None } else { truncated },
        attitude_rate_hz: 5.0,
        vibration,
        time_jitter_s: 2e-3,
        temperature: Some(Temperature { start_degc: 22.0, end_degc: 47.0, time_constant_s: 110.0 }),
        ..SensorConfig::default()
    };
    let profile = profile(kind, family, seed);
    let flight = Simulated::new(Box::new(Flown::new(profile)), &truth, sensors, seed);
    let samples = flight.take_while(|(_, t)| t.t_s < DURATION_S).map(|(s, _)| s).collect();
    Blind { hidden: hidden.to_vec(), truth, samples }
}

fn profile(kind: Kind, family: Family, seed: u64) -> FixedWing {
    let mut wind = Noise::new(seed, Purpose::Wind);
    let (gusts, phase) = (0.2 + 0.6 * wind.uniform(), 6.0 * wind.uniform());
    match family {
        Family::Tuning => FixedWing::new(kind == Kind::Rich).with_gusts(25.0, gusts, phase),
        Family::Aside => random_flight(kind, &mut wind).with_gusts(22.0, gusts, phase),
    }
}

/// Another aircraft: slower, with maneuvers drawn one after the other.
fn random_flight(kind: Kind, draw: &mut Noise) -> FixedWing {
    let deg = |d: f64| d.to_radians();
    let mut speed = Signal::constant(0.0).step(10.0, 7.0, 16.0 + 4.0 * draw.uniform());
    let mut climb = Signal::constant(0.0).pulse(18.0, 34.0, 3.0, deg(5.0 + 4.0 * draw.uniform()));
    let (mut bank, mut slip) = (Signal::constant(0.0), Signal::constant(0.0));
    let mut t = 38.0;
    let mut side = 1.0;
    while t < DURATION_S + 10.0 {
        side = -side;
        let length = 8.0 + 6.0 * draw.uniform();
        match (draw.uniform() * 5.0) as u32 {
            0 | 1 => bank = bank.pulse(t, t + length, 2.0, side * deg(25.0 + 30.0 * draw.uniform())),
            2 => speed = speed.pulse(t, t + length, 4.0, 3.0 + 4.0 * draw.uniform()),
            3 => {
                let size = deg(12.0 + 12.0 * draw.uniform());
                climb =
                    climb.step(t, 1.8, size).step(t + 3.0, 3.0, -1.8 * size).step(t + 7.0, 2.0, 0.8 * size);
            }
            _ if kind == Kind::Rich => {
                let size = deg(8.0 + 8.0 * draw.uniform());
                slip = slip.wave(t, t + length, size, 0.25 + 0.2 * draw.uniform(), 1.5);
            }
            _ => bank = bank.pulse(t, t + length, 2.0, side * deg(40.0)),
        }
        t += length + 3.0;
    }
    FixedWing::from_signals(DURATION_S + 20.0, speed, climb, bank, slip)
}

/// What one blind flight gave.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Hidden effect, `none` for a clean flight.
    pub hidden: String,
    /// How it was flown.
    pub kind: Kind,
    /// Seed.
    pub seed: u64,
    /// The groups that were named, in order.
    pub groups: Vec<Vec<&'static str>>,
    /// Evidence of each.
    pub evidence: Vec<f64>,
    /// Whether the truth had enough evidence where truth and size are known (the oracle), and no other effect comes close.
    pub oracle: bool,
    /// Parameters within three sigma: how many of how many, where the effect was named.
    pub within_3_sigma: (usize, usize),
    /// Best candidates of the last look: for tuning.
    pub last: Vec<(&'static str, f64)>,
}

/// Whether somebody who knows the candidates and the true size would have named the truth alone: its likelihood, paid for only with
/// the choice among the candidates, is above the threshold, and no other candidate comes within the margin.
fn oracle(
    flight: &Flight,
    base: &Model,
    hidden: &EffectSetting,
    selection: &select::Selection,
    settings: &Settings,
) -> bool {
    let mut truth = base.clone();
    truth.set(hidden.clone());
    let options = settings.options.all();
    let (noise, with) = fit(&[flight], &truth, selection.noise, &options, 3, &Serial);
    let without = pass::run(flight, base, &noise, &options, None).log_likelihood[0];
    let gain = with - without - (REGISTRY.len() as f64).ln();
    let whole = Settings { options, ..*settings };
    let other = select::odds(&[flight], base, &noise, &whole, &Serial)
        .into_iter()
        .find(|c| c.setting.effect.name() != hidden.effect.name())
        .map_or(0.0, |c| c.evidence);
    gain > settings.threshold && gain - other > settings.margin
}

/// What a campaign shows, over its flights.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Flights with a hidden effect.
    pub hidden: usize,
    /// Of these, that the oracle would have named alone.
    pub oracle: usize,
    /// Of the oracle's, named alone and right.
    pub oracle_alone_right: usize,
    /// Named alone and right.
    pub alone_right: usize,
    /// Something named, and the truth among the first group.
    pub in_group: usize,
    /// Something named.
    pub named: usize,
    /// Named alone and wrong.
    pub alone_wrong: usize,
    /// A second effect named where there was one.
    pub too_many: usize,
    /// Clean flights.
    pub clean: usize,
    /// Clean flights with something named.
    pub false_alarms: usize,
    /// Parameters within three sigma, of how many.
    pub within_3_sigma: (usize, usize),
}

/// Sums up a campaign.
pub fn summarise(outcomes: &[Outcome]) -> Summary {
    let mut s = Summary::default();
    for o in outcomes {
        if o.hidden == "none" {
            s.clean += 1;
            s.false_alarms += usize::from(!o.groups.is_empty());
            continue;
        }
        s.hidden += 1;
        s.oracle += usize::from(o.oracle);
        s.too_many += usize::from(o.groups.len() > 1);
        s.within_3_sigma.0 += o.within_3_sigma.0;
        s.within_3_sigma.1 += o.within_3_sigma.1;
        let Some(first) = o.groups.first() else { continue };
        let (inside, alone) = (first.contains(&o.hidden.as_str()), first.len() == 1);
        s.named += 1;
        s.in_group += usize::from(inside);
        s.alone_right += usize::from(inside && alone);
        s.oracle_alone_right += usize::from(inside && alone && o.oracle);
        s.alone_wrong += usize::from(!inside && alone);
    }
    s
}

/// What `sim --hide-random` hides for a seed: an effect of the table with its size, or (once in as many draws as there are
/// effects and one more) nothing.
pub fn hide_random(seed: u64) -> Option<EffectSetting> {
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 3);
    let pick = (noise.uniform() * (REGISTRY.len() + 1) as f64) as usize;
    REGISTRY.get(pick).map(|e| draw(*e, &mut noise))
}

/// The sealed truth as text: a `model.toml` that holds nothing but what was hidden.
pub fn seal(hidden: Option<&EffectSetting>) -> String {
    let mut model = Model::default();
    if let Some(setting) = hidden {
        model.set(setting.clone());
    }
    model.to_toml()
}

/// Hides, flies, explains, unseals.
pub fn one(
    effect: Option<&'static dyn Effect>,
    kind: Kind,
    family: Family,
    seed: u64,
    settings: &Settings,
) -> Option<Outcome> {
    let seed = seed
        .wrapping_mul(1_000_003)
        .wrapping_add(effect.map_or(0, |e| e.name().len() as u64 * 31 + e.len() as u64));
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 3);
    let hidden: Vec<EffectSetting> = effect.map(|e| draw(e, &mut noise)).into_iter().collect();
    let blind = fly(&hidden, kind, family, seed);
    let mut base = Model::default();
    if hidden.iter().any(|s| s.effect.truncates_samples()) {
        base.imu.quantisation = gaware_nav::model::QuantisationBelief::None;
    }
    let flight = Flight::prepare(&blind.samples, &base).ok()?;
    let selection = select::select(&[&flight], &base, settings, &Serial);
    let oracle = hidden.first().is_some_and(|h| oracle(&flight, &base, h, &selection, settings));
    let mut within = (0, 0);
    for h in &hidden {
        if let Some(a) = selection.added.iter().find(|a| a.setting.effect.name() == h.effect.name()) {
            for (k, s) in a.setting.sigmas.iter().enumerate().filter(|(_, s)| **s > 0.0) {
                within.1 += 1;
                within.0 += usize::from((a.setting.values[k] - h.values[k]).abs() < 3.0 * s);
            }
        }
    }
    let mut last = selection.remaining.clone();
    last.truncate(4);
    Some(Outcome {
        hidden: effect.map_or_else(|| "none".to_owned(), |e| e.name().to_owned()),
        kind,
        seed,
        groups: selection.steps.iter().map(|s| s.group.clone()).collect(),
        evidence: selection.steps.iter().map(|s| s.evidence).collect(),
        oracle,
        within_3_sigma: within,
        last,
    })
}

/// What to fly.
#[derive(Debug, Clone)]
pub struct Campaign {
    /// Effects to hide; all when empty.
    pub effects: Vec<String>,
    /// Seeds per effect and kind of flight.
    pub seeds: usize,
    /// Clean flights per kind.
    pub clean: usize,
    /// First seed.
    pub first_seed: u64,
    /// Which flights.
    pub family: Family,
}

/// Flies a campaign on all cores.
pub fn run(campaign: &Campaign, settings: &Settings, progress: &dyn Progress) -> Vec<Outcome> {
    let chosen = |e: &&&'static dyn Effect| {
        campaign.effects.is_empty() || campaign.effects.iter().any(|n| n == e.name())
    };
    let mut jobs: Vec<(Option<&'static dyn Effect>, Kind, u64)> = Vec::new();
    for kind in [Kind::Rich, Kind::Coordinated] {
        for effect in REGISTRY.iter().filter(chosen) {
            jobs.extend((0..campaign.seeds).map(|k| (Some(*effect), kind, campaign.first_seed + k as u64)));
        }
        jobs.extend((0..campaign.clean).map(|k| (None, kind, campaign.first_seed + 5000 + k as u64)));
    }
    map_runs(jobs.len(), progress, |k| {
        let (effect, kind, seed) = jobs[k];
        one(effect, kind, campaign.family, seed, settings)
    })
    .into_iter()
    .flatten()
    .collect()
}

/// The confusion matrix: hidden effect → what was named first → how often. A group is joined by `|`.
pub fn confusion(outcomes: &[Outcome]) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut matrix: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for o in outcomes {
        let named = o.groups.first().map_or_else(|| "nothing".to_owned(), |g| g.join("|"));
        *matrix.entry(o.hidden.clone()).or_default().entry(named).or_default() += 1;
    }
    matrix
}

/// The effect of this name, for callers that hold names.
pub fn effect(name: &str) -> Option<&'static dyn Effect> {
    effects::find(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_stay_within_what_an_effect_can_be() {
        for (k, effect) in REGISTRY.iter().enumerate() {
            let setting = draw(*effect, &mut Noise::numbered(k as u64, Purpose::HiddenTruth, 3));
            assert_eq!(setting.values.len(), effect.len());
            assert!(setting.values.iter().all(|v| v.is_finite()), "{}", effect.name());
            assert!(effect.is_empty() || setting.values.iter().any(|v| *v != 0.0), "{}", effect.name());
        }
    }

    #[test]
    fn what_is_sealed_can_be_unsealed() {
        let hidden: Vec<_> = (0..200).map(hide_random).collect();
        let named: std::collections::BTreeSet<_> =
            hidden.iter().map(|h| h.as_ref().map_or("none", |s| s.effect.name())).collect();
        assert_eq!(named.len(), REGISTRY.len() + 1);
        for h in hidden.iter().flatten() {
            let back = Model::from_toml(&seal(Some(h))).unwrap();
            let found = back.get(h.effect.name()).unwrap();
            assert!(found.values.iter().zip(&h.values).all(|(a, b)| (a - b).abs() <= 1e-9 * b.abs()));
        }
    }

    #[test]
    fn the_summary_counts_what_was_promised() {
        let outcome = |hidden: &str, groups: Vec<Vec<&'static str>>, oracle| Outcome {
            hidden: hidden.into(),
            kind: Kind::Rich,
            seed: 1,
            evidence: vec![9.0; groups.len()],
            groups,
            oracle,
            within_3_sigma: (1, 1),
            last: Vec::new(),
        };
        let s = summarise(&[
            outcome("gps_latency", vec![vec!["gps_latency"]], true),
            outcome("gps_latency", vec![vec!["gps_lever_arm", "gps_latency"]], false),
            outcome("gps_latency", vec![vec!["gps_lever_arm"]], true),
            outcome("none", vec![vec!["gps_latency"]], false),
            outcome("none", vec![], false),
        ]);
        assert_eq!((s.hidden, s.oracle, s.oracle_alone_right, s.alone_right), (3, 2, 1, 1));
        assert_eq!((s.in_group, s.alone_wrong, s.clean, s.false_alarms), (2, 1, 2, 1));
    }
}
