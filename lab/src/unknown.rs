//! Effects that no catalogue holds: one of 32 is injected, alone or beside one of the catalogue, and the explanation must name a formula that
//! does the same on this flight. On clean flights it must name none.

use crate::blind::{self, Family, Kind, Seen};
use gaware::explain::contract::Verdict;
use gaware::parallel::{Progress, map_runs_on};
use gaware_nav::effects::{Conditions, Effect, Instant, REGISTRY, data};
use gaware_nav::identify::Serial;
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::select::{self, Settings};
use gaware_nav::math::{atan2, hypot, powf};
use gaware_nav::model::EffectSetting;
use gaware_sitl::blind::{draw, fly_with_reports};
use gaware_sitl::noise::{Noise, Purpose};
use nalgebra::Vector3;
use serde::Serialize;
use std::time::Instant as Clock;

/// What is injected: target, axis, driver, and its usual size in SI by which a disturbance of a consumer unit is divided. A third of them are not
/// in the grammar of the search either.
const OUTSIDE: [(&str, &str, &str, f64); 32] = [
    ("gyro", "z", "current", 10.0),
    ("gyro", "y", "current*current", 200.0),
    ("accel", "x", "throttle", 0.3),
    ("accel", "z", "throttle*throttle", 0.3),
    ("gyro", "x", "lag(temperature,100)", 10.0),
    ("accel", "y", "lag(temperature,30)", 10.0),
    ("gyro", "z", "w_z*|w_z|", 0.1),
    ("gyro", "x", "w_x*w_x", 0.2),
    ("gyro", "y", "f_x*f_z", 30.0),
    ("accel", "y", "f_x*f_y", 10.0),
    ("accel", "x", "w_y", 0.3),
    ("accel", "z", "w_x", 0.5),
    ("gyro", "z", "voltage", 1.0),
    ("accel", "x", "dynamic_pressure", 200.0),
    ("gyro", "y", "airspeed", 10.0),
    ("gyro", "x", "motor_1", 0.15),
    ("accel", "z", "motor_2", 0.1),
    ("gyro", "z", "temperature*temperature", 200.0),
    ("gyro", "x", "sign(w_x)", 1.0),
    ("accel", "y", "|w_z|", 0.2),
    ("gyro", "y", "w_x*f_z", 5.0),
    ("accel", "z", "w_y*f_z", 3.0),
    ("gyro", "z", "current*throttle", 5.0),
    ("accel", "x", "f_x^3", 100.0),
    ("position", "y", "sin(2*heading)", 0.7),
    ("velocity", "x", "height", 30.0),
    ("position", "x", "cos(heading)", 0.7),
    ("velocity", "y", "speed*speed", 200.0),
    ("gyro", "x", "dead(w_x,0.3)", 0.3),
    ("accel", "y", "above(throttle,0.05)", 0.5),
    ("gyro", "z", "above(height,60)", 0.5),
    ("gyro", "y", "sign(temperature-lag(temperature,30))", 1.0),
];

/// Of a series: three axes of gyros, accelerometers, position and velocity.
const CHANNELS: usize = 3 * data::Target::ALL.len();
/// Formulas whose corrected series correlate by this much with the injected one are equal on this flight.
const EQUAL: f64 = 0.95;

/// What to fly.
#[derive(Debug, Clone, Copy)]
pub struct Campaign {
    /// Flights with an injected effect.
    pub flights: usize,
    /// Clean flights.
    pub clean: usize,
    /// Whether an effect of the catalogue is injected beside it.
    pub beside: bool,
    /// First seed.
    pub seed: u64,
    /// Which flights.
    pub family: Family,
    /// So many flights at a time.
    pub threads: usize,
}

/// What one flight gave.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// The injected expression; nothing on a clean flight.
    pub injected: Option<String>,
    /// The effect of the catalogue beside it.
    pub beside: Option<&'static str>,
    /// How it was flown.
    pub kind: Kind,
    /// What someone saw who knew the truth.
    pub oracle: Option<Seen>,
    /// The groups that were named.
    pub groups: Vec<Vec<&'static str>>,
    /// Of the names: those that do the same on this flight.
    pub equal: Vec<&'static str>,
    /// The verdict.
    pub verdict: Verdict,
    /// Time of the explanation, s.
    pub seconds: f64,
}

impl Outcome {
    /// Whether something equal to what was injected is named.
    fn is_right(&self) -> bool {
        !self.equal.is_empty()
    }

    /// Whether a name of the catalogue stands alone that was not injected.
    fn wrong_name_alone(&self) -> bool {
        let wrong =
            |n: &str| !n.starts_with(data::FORMULA) && self.beside != Some(n) && !self.equal.contains(&n);
        self.groups.iter().any(|g| g.len() == 1 && wrong(g[0]))
    }

    fn names_formula(&self) -> bool {
        self.groups.iter().flatten().any(|n| n.starts_with(data::FORMULA))
    }
}

/// So many of so many.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Count {
    /// How many.
    pub count: usize,
    /// Of how many.
    pub of: usize,
}

/// What a campaign shows; all but the last where an oracle could have named the effect alone.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Flights on which an oracle could.
    pub oracle: Count,
    /// A formula that does the same is named, alone or in a group.
    pub right: Count,
    /// A name of the catalogue stands alone that was not injected.
    pub wrong_name_alone: Count,
    /// The verdict is that nothing is missing.
    pub nothing_missing: Count,
    /// Clean flights with a formula.
    pub false_formula: Count,
    /// Mean time of an explanation, s.
    pub seconds: f64,
}

/// Sums up.
pub fn summarise(outcomes: &[Outcome]) -> Summary {
    let flown = outcomes.iter().filter(|o| o.injected.is_some());
    let seen: Vec<&Outcome> = flown.clone().filter(|o| o.oracle.is_some_and(|s| s.alone)).collect();
    let of_seen = |what: &dyn Fn(&Outcome) -> bool| Count {
        count: seen.iter().filter(|o| what(o)).count(),
        of: seen.len(),
    };
    let clean: Vec<&Outcome> = outcomes.iter().filter(|o| o.injected.is_none()).collect();
    Summary {
        oracle: Count { count: seen.len(), of: flown.count() },
        right: of_seen(&Outcome::is_right),
        wrong_name_alone: of_seen(&Outcome::wrong_name_alone),
        nothing_missing: of_seen(&|o| o.verdict == Verdict::NothingMissing),
        false_formula: Count { count: clean.iter().filter(|o| o.names_formula()).count(), of: clean.len() },
        seconds: outcomes.iter().map(|o| o.seconds).sum::<f64>() / outcomes.len().max(1) as f64,
    }
}

/// Row `k` as an effect with a size drawn by a seed.
fn injected(k: usize, noise: &mut Noise) -> Option<EffectSetting> {
    let (target, axis, driver, typical) = OUTSIDE[k];
    let text = format!(
        "schema = \"gaware.effects/1\"\n[[effect]]\nname = \"outside_{k}\"\ntarget = \"{target}\"\n{axis} = \"{driver}\"\n"
    );
    let effect = *data::load(&text).ok()?.first()?;
    let size = data::Target::of_name(target)?.disturbance() / typical;
    let sign = if noise.uniform() < 0.5 { -1.0 } else { 1.0 };
    EffectSetting::known(effect, &[sign * size * (0.35 * powf(2.0f64 / 0.35, noise.uniform()))]).ok()
}

fn one(campaign: &Campaign, k: usize, settings: &Settings) -> Option<Outcome> {
    let kind = if k.is_multiple_of(2) { Kind::Rich } else { Kind::Coordinated };
    let seed = (campaign.seed + k as u64).wrapping_mul(7_919) + 31 * u64::from(campaign.beside);
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 11);
    let own = if k < campaign.flights { Some(injected(k % OUTSIDE.len(), &mut noise)?) } else { None };
    let linear: Vec<&'static dyn Effect> =
        REGISTRY.iter().copied().filter(|e| e.tolerance().is_some() || e.delays_fixes()).collect();
    let beside = own.as_ref().filter(|_| campaign.beside).map(|_| draw(linear[k % linear.len()], &mut noise));
    let all: Vec<EffectSetting> = own.iter().chain(&beside).cloned().collect();
    let blind = fly_with_reports(&all, kind, campaign.family, seed);
    let base = blind::belief(&all);
    let flight = Flight::prepare(&blind.samples, &base).ok()?;
    let oracle = own.as_ref().and_then(|_| {
        let known = select::select(&[&flight], &base, settings, &Serial);
        blind::could_name(&flight, &base, &all, &known, settings).into_iter().next()
    });
    let begun = Clock::now();
    let explained = gaware::explain::samples(&[blind.samples], &[], &base, settings, &|_| {});
    let seconds = begun.elapsed().as_secs_f64();
    let groups: Vec<Vec<&'static str>> =
        explained.explanation.effects.iter().map(|e| e.names.clone()).collect();
    let equal = own
        .as_ref()
        .map(|own| equal_names(own, &groups, &explained.model.effects, &flight))
        .unwrap_or_default();
    Some(Outcome {
        injected: own.is_some().then(|| {
            let (target, axis, driver, _) = OUTSIDE[k % OUTSIDE.len()];
            format!("{target} {axis} ~ {driver}")
        }),
        beside: beside.map(|b| b.effect.name()),
        kind,
        oracle,
        groups,
        equal,
        verdict: explained.explanation.verdict,
        seconds,
    })
}

/// What an effect adds along a flight, every tenth of a second to the sensors and at each fix to that: twelve channels.
fn series(setting: &EffectSetting, flight: &Flight) -> Vec<f64> {
    let (from, to) = flight.span_s();
    let height_m = flight.initial().nav.geodetic().height_m;
    let mut out = Vec::new();
    let mut fixes = flight.fixes().iter().peekable();
    let mut conditions = flight.conditions(from);
    for sample in flight.reported().iter().step_by(5).filter(|s| (from..to).contains(&s.t_s)) {
        conditions = Conditions {
            speed: conditions.speed,
            height_m: conditions.height_m,
            heading_rad: conditions.heading_rad,
            ..flight.conditions(sample.t_s)
        };
        if let Some(fix) = fixes.next_if(|f| f.t_s <= sample.t_s) {
            conditions.height_m = fix.position.height_m - height_m;
            let [north, east, _] = fix.velocity.components();
            (conditions.speed, conditions.heading_rad) = (hypot(north, east), atan2(east, north));
        }
        let x = Instant {
            t_s: sample.t_s,
            rate: sample.gyro,
            force: sample.accel,
            temperature_above_25_degc: sample.temperature_degc.map_or(0.0, |t| t - 25.0),
            around: flight.around(sample.t_s),
            conditions,
        };
        let mut added = [Vector3::zeros(); 4];
        match data::added(setting.effect.name(), &setting.values, &x) {
            Some((target, by)) => added[target as usize] = by,
            None => {
                added[0] = setting.effect.gyro(&setting.values, &x);
                added[1] = setting.effect.accel(&setting.values, &x);
            }
        }
        out.extend(added.iter().flat_map(|v| v.iter().copied()));
    }
    out
}

/// Correlation of two series of twelve channels, each about its mean.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = (a.len() / CHANNELS).max(1) as f64;
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for c in 0..CHANNELS {
        let of = |v: &[f64]| v.iter().skip(c).step_by(CHANNELS).copied().collect::<Vec<f64>>();
        let (a, b) = (of(a), of(b));
        let (ma, mb) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
        for (a, b) in a.iter().zip(&b) {
            (ab, aa, bb) = (ab + (a - ma) * (b - mb), aa + (a - ma).powi(2), bb + (b - mb).powi(2));
        }
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// Names in the groups whose effect does what the injected one does. The first of a group has the values that were found; another one is equal
/// where its driver alone correlates on the injected axis.
fn equal_names(
    own: &EffectSetting,
    groups: &[Vec<&'static str>],
    found: &[EffectSetting],
    flight: &Flight,
) -> Vec<&'static str> {
    let truth = series(own, flight);
    let same = |name: &&'static str| {
        let setting = found.iter().find(|s| s.effect.name() == *name).cloned();
        let other = || {
            let effect = gaware_nav::effects::find(name)?;
            let one = |k: usize| {
                let mut values = vec![0.0; effect.len()];
                values[k] = 1.0;
                correlation(
                    &truth,
                    &series(&EffectSetting { sigmas: values.clone(), values, effect }, flight),
                )
                .abs()
            };
            Some((0..effect.len()).map(one).fold(0.0, f64::max))
        };
        let value = setting.map(|s| correlation(&truth, &series(&s, flight))).or_else(other);
        value.is_some_and(|c| c >= EQUAL)
    };
    groups.iter().flatten().filter(|n| same(n)).copied().collect()
}

/// Flies a campaign.
pub fn run(campaign: &Campaign, settings: &Settings, progress: &dyn Progress) -> Vec<Outcome> {
    let jobs = campaign.flights + campaign.clean;
    let all = map_runs_on(campaign.threads, jobs, progress, |k| one(campaign, k, settings));
    all.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_an_effect_and_equals_itself() {
        let mut noise = Noise::new(1, Purpose::HiddenTruth);
        for (k, row) in OUTSIDE.iter().enumerate() {
            let setting = injected(k, &mut noise).unwrap_or_else(|| panic!("{row:?}"));
            assert_eq!(setting.effect.len(), 1);
        }
        let a: Vec<f64> = (0..600).map(|k| f64::from(k % 7)).collect();
        let b: Vec<f64> = (0..600).map(|k| f64::from((k * k) % 11)).collect();
        assert!((correlation(&a, &a) - 1.0).abs() < 1e-12 && correlation(&a, &b).abs() < 0.5);
    }
}
