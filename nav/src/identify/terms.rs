//! What no named effect explains: the sparse combination of products of motion that comes closest.
//!
//! Orthogonal matching pursuit (Tropp & Gilbert 2007) on score and information: every term is a disturbance of one sensor
//! axis, propagated through the filter like an effect, so that what the filter's own states can absorb counts for
//! nothing.
//!
//! A term is reported when two things speak for it. On the data that choose, its evidence must exceed the logarithm of the number of
//! terms tried by a wide margin. On data that took no part, the flights must be more likely with it, at the value of the
//! first, than without it: by the factor whose mean under chance is one, so that it exceeds e³ in one case of twenty at most
//! (Vovk & Wang 2021, "E-values", proposition 2.1, Markov's inequality). What the catalogue covers is left to the catalogue, and
//! effects found there are fitted anew beside every term.

use super::Workers;
use super::evidence::{self, Fit};
use super::flight::Flight;
use super::judge;
use super::linear;
use super::pass::{Information, Options};
use super::select::{Added, Point, Search, Selection, Settings, is_drift, priors};
use crate::effects::{BiasWalk, Instant};
use crate::identify::watched::{Term, Watched};
use crate::math::ln;
use crate::model::Model;

/// One regressor with its name and unit.
#[derive(Debug, Clone, Copy)]
pub struct Regressor {
    /// As in the report: `f_x*f_z`.
    pub name: &'static str,
    /// Divides the unit of the channel.
    pub per: &'static str,
    value: fn(&Instant) -> f64,
    /// A size of the regressor in flight, to judge coefficients by.
    typical: f64,
}

macro_rules! regressor {
    ($name:literal, $per:literal, $typical:literal, $value:expr) => {
        Regressor { name: $name, per: $per, value: $value, typical: $typical }
    };
}

/// Every regressor.
pub const REGRESSORS: [Regressor; 32] = [
    regressor!("f_x", "/(m/s2)", 3.0, |r| r.force.x),
    regressor!("f_y", "/(m/s2)", 3.0, |r| r.force.y),
    regressor!("f_z", "/(m/s2)", 10.0, |r| r.force.z),
    regressor!("f_x*f_x", "/(m/s2)^2", 10.0, |r| r.force.x * r.force.x),
    regressor!("f_y*f_y", "/(m/s2)^2", 10.0, |r| r.force.y * r.force.y),
    regressor!("f_z*f_z", "/(m/s2)^2", 100.0, |r| r.force.z * r.force.z),
    regressor!("f_x*f_y", "/(m/s2)^2", 10.0, |r| r.force.x * r.force.y),
    regressor!("f_x*f_z", "/(m/s2)^2", 30.0, |r| r.force.x * r.force.z),
    regressor!("f_y*f_z", "/(m/s2)^2", 30.0, |r| r.force.y * r.force.z),
    regressor!("w_x", "/(rad/s)", 0.5, |r| r.rate.x),
    regressor!("w_y", "/(rad/s)", 0.3, |r| r.rate.y),
    regressor!("w_z", "/(rad/s)", 0.3, |r| r.rate.z),
    regressor!("w_x*w_x", "/(rad/s)^2", 0.2, |r| r.rate.x * r.rate.x),
    regressor!("w_y*w_y", "/(rad/s)^2", 0.1, |r| r.rate.y * r.rate.y),
    regressor!("w_z*w_z", "/(rad/s)^2", 0.1, |r| r.rate.z * r.rate.z),
    regressor!("w_x*w_y", "/(rad/s)^2", 0.1, |r| r.rate.x * r.rate.y),
    regressor!("w_x*w_z", "/(rad/s)^2", 0.1, |r| r.rate.x * r.rate.z),
    regressor!("w_y*w_z", "/(rad/s)^2", 0.1, |r| r.rate.y * r.rate.z),
    regressor!("w_x*f_x", "/(rad/s*m/s2)", 1.5, |r| r.rate.x * r.force.x),
    regressor!("w_x*f_y", "/(rad/s*m/s2)", 1.5, |r| r.rate.x * r.force.y),
    regressor!("w_x*f_z", "/(rad/s*m/s2)", 5.0, |r| r.rate.x * r.force.z),
    regressor!("w_y*f_x", "/(rad/s*m/s2)", 1.0, |r| r.rate.y * r.force.x),
    regressor!("w_y*f_y", "/(rad/s*m/s2)", 1.0, |r| r.rate.y * r.force.y),
    regressor!("w_y*f_z", "/(rad/s*m/s2)", 3.0, |r| r.rate.y * r.force.z),
    regressor!("w_z*f_x", "/(rad/s*m/s2)", 1.0, |r| r.rate.z * r.force.x),
    regressor!("w_z*f_y", "/(rad/s*m/s2)", 1.0, |r| r.rate.z * r.force.y),
    regressor!("w_z*f_z", "/(rad/s*m/s2)", 3.0, |r| r.rate.z * r.force.z),
    regressor!("T", "/degC", 10.0, |r| r.temperature_above_25_degc),
    regressor!("speed", "/(m/s)", 20.0, |r| r.conditions.speed),
    regressor!("speed*speed", "/(m/s)^2", 400.0, |r| r.conditions.speed * r.conditions.speed),
    regressor!("t", "/s", 100.0, |r| r.conditions.elapsed_s),
    regressor!("t*t", "/s^2", 1e4, |r| r.conditions.elapsed_s * r.conditions.elapsed_s),
];

/// Names of the channels of a term.
pub const CHANNELS: [&str; 6] = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"];
/// A disturbance of this size is the prior, rad/s and m/s².
const DISTURBANCE: [f64; 2] = [3e-3, 0.1];
/// A term must gain this much evidence beyond the logarithm of the number of terms, nats.
const WORTH: f64 = 5.0;
/// Data that took no part must be more likely with a term by this much, nats.
const CONFIRMED: f64 = 3.0;
/// A coefficient is reported with a prior so many times as wide as that which found it.
const WIDE: f64 = 30.0;
/// An effect held at its prior mean is known to this share of its prior's width.
const HELD: f64 = 1e-3;
/// More terms than this describe nothing any more.
const MOST_TERMS: usize = 4;

/// One term found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// `gyro_y`.
    pub channel: &'static str,
    /// `f_x*f_z`.
    pub term: &'static str,
    /// Coefficient, SI.
    pub coefficient: f64,
    /// 1-sigma.
    pub sigma: f64,
    /// Unit of both.
    pub unit: String,
    /// By how much more likely it makes the data that took no part, nats.
    pub held_out: f64,
}

/// The value of a regressor by its name.
pub fn value(term: &str, at: &Instant) -> Option<f64> {
    REGRESSORS.iter().find(|r| r.name == term).map(|r| (r.value)(at))
}

/// Whether an effect of the catalogue is this very term.
fn in_catalogue(channel: usize, regressor: &Regressor) -> bool {
    let own = ["f_x*f_x", "f_y*f_y", "f_z*f_z"][channel % 3];
    let linear: &[&str] =
        if channel < 3 { &["f_x", "f_y", "f_z", "w_x", "w_y", "w_z"] } else { &["f_x", "f_y", "f_z"] };
    regressor.name == own || regressor.name == "T" || linear.contains(&regressor.name)
}

/// Every term outside the catalogue: channel and regressor, in the order of the columns of the watch.
fn all() -> Vec<(usize, &'static Regressor)> {
    (0..6)
        .flat_map(|channel| REGRESSORS.iter().map(move |r| (channel, r)))
        .filter(|(channel, r)| !in_catalogue(*channel, r))
        .collect()
}

/// What is left over when the catalogue has said its part.
#[derive(Debug, Clone, Default)]
pub struct LeftOver {
    /// Terms, in the order in which they gain the most.
    pub terms: Vec<Found>,
    /// Effects that nothing speaks for once the terms are there: they had only imitated them.
    pub replaced: Vec<&'static str>,
}

/// What the flights say of effects and terms: on the part that chooses, and on the part held out.
struct Data {
    parts: [Information; 2],
    /// Of the part that chooses, without terms.
    log_likelihood: f64,
    effects: Vec<Added>,
    /// Effect and parameter of the first columns.
    slots: Vec<(usize, usize)>,
    /// Prior sigma and offset of those found.
    sigma: Vec<f64>,
    offset: Vec<f64>,
    terms: Vec<(usize, &'static Regressor)>,
}

/// Flights at a selection, with every term watched.
struct Watching<'a> {
    search: Search<'a>,
    point: Point,
    watched: Watched,
    /// The random walk of the biases.
    walk: BiasWalk,
}

impl<'a> Watching<'a> {
    fn new(
        flights: &'a [&'a Flight],
        selection: &Selection,
        settings: &Settings,
        workers: &'a dyn Workers,
    ) -> Self {
        let search = judge::about(flights, selection, settings, workers);
        let point = search.best(&selection.added, &selection.noise);
        let watched = Watched {
            effects: point.added.iter().map(|a| a.setting.clone()).collect(),
            terms: all().iter().map(|(channel, r)| Term { channel: *channel, regressor: r.value }).collect(),
        };
        let walk = search.walk(&point.added);
        Self { search, point, watched, walk }
    }

    /// The same with other data counting.
    fn hearing(self, options: Options) -> Self {
        Self { search: self.search.hearing(options), ..self }
    }

    fn data(&self) -> Data {
        let runs = self.search.run_through(&self.point, &self.watched, &[self.walk], None);
        let columns = self.watched.slots().len() + self.watched.terms.len();
        let mut parts = [0, 1].map(|_| Information::zeros(columns));
        let mut log_likelihood = 0.0;
        for run in runs.iter().flatten() {
            parts.iter_mut().zip(&run.information).for_each(|(sum, own)| sum.add(own));
            log_likelihood += run.log_likelihood[0];
        }
        self.search.correlate(&self.point.added, &self.watched, &mut parts[0]);
        let effects = self.point.added.clone();
        let (sigma, offset) = priors(&effects, &self.watched);
        Data { parts, log_likelihood, effects, slots: self.watched.slots(), sigma, offset, terms: all() }
    }

    /// The same without the random walks that were added to the biases; `None` where there are none.
    fn without_drifts(&mut self, base: &Model) -> Option<Vec<&'static str>> {
        let effects = &self.point.added;
        let drifts: Vec<&'static str> =
            effects.iter().map(|a| a.setting.effect).filter(|e| is_drift(*e)).map(|e| e.name()).collect();
        self.walk = linear::walk(base);
        (!drifts.is_empty()).then_some(drifts)
    }
}

/// The best few terms that a selection lacks. `validate` are flights that took no part; without any, the held-out blocks of
/// `flights` judge.
pub fn find(
    flights: &[&Flight],
    validate: &[&Flight],
    selection: &Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> LeftOver {
    let settings = Settings { options: selection.options, ..*settings };
    let mut own = Watching::new(flights, selection, &settings, workers);
    let all = settings.options.all();
    let mut others =
        (!validate.is_empty()).then(|| Watching::new(validate, selection, &settings, workers).hearing(all));
    let look = |own: &Watching, others: &Option<Watching>| {
        let mut data = own.data();
        if let Some(others) = others {
            let [all, _] = others.data().parts;
            data.parts[1] = all;
        }
        let chosen = data.confirmed(data.pursued());
        (data.evidence(&chosen), data, chosen)
    };
    let (mut evidence, mut data, mut chosen) = look(&own, &others);
    let mut replaced = Vec::new();
    // A random walk follows whatever there is, so that it masks terms: they are tested without it, too.
    if let Some(drifts) = own.without_drifts(&selection.base) {
        if let Some(others) = &mut others {
            others.without_drifts(&selection.base);
        }
        let without = look(&own, &others);
        if !without.2.is_empty() && without.0 > evidence {
            (evidence, data, chosen) = without;
            replaced = drifts;
        }
    }
    if !chosen.is_empty() {
        replaced.extend(data.imitations(&chosen, evidence, settings.threshold));
    }
    LeftOver { terms: data.found(&chosen), replaced }
}

impl Data {
    /// Effects and these terms fitted to one part.
    fn fit(&self, information: &Information, chosen: &[usize]) -> Option<(Vec<usize>, Fit)> {
        self.fit_with(information, chosen, None, 1.0)
    }

    /// The same with one effect held at its prior mean, and the terms' prior so many times as wide.
    fn fit_with(
        &self,
        information: &Information,
        chosen: &[usize],
        gone: Option<usize>,
        width: f64,
    ) -> Option<(Vec<usize>, Fit)> {
        let open: Vec<usize> = (0..self.sigma.len()).filter(|k| self.sigma[*k] > 0.0).collect();
        let columns: Vec<usize> =
            open.iter().copied().chain(chosen.iter().map(|k| self.slots.len() + k)).collect();
        let prior = |k: &usize| {
            let (channel, regressor) = self.terms[*k];
            width * DISTURBANCE[channel / 3] / regressor.typical
        };
        let own = |k: &usize| self.sigma[*k] * if Some(self.slots[*k].0) == gone { HELD } else { 1.0 };
        let sigmas: Vec<f64> = open.iter().map(own).chain(chosen.iter().map(prior)).collect();
        let offsets: Vec<f64> =
            open.iter().map(|k| self.offset[*k]).chain(chosen.iter().map(|_| 0.0)).collect();
        evidence::fit(information, &columns, &sigmas, &offsets).map(|fit| (columns, fit))
    }

    /// Of the part that chooses, with these terms.
    fn evidence(&self, chosen: &[(usize, f64)]) -> f64 {
        let columns: Vec<usize> = chosen.iter().map(|c| c.0).collect();
        self.fit(&self.parts[0], &columns).map_or(f64::NEG_INFINITY, |f| self.log_likelihood + f.1.evidence)
    }

    /// Effects that nothing speaks for beside these terms.
    fn imitations(&self, chosen: &[(usize, f64)], evidence: f64, threshold: f64) -> Vec<&'static str> {
        let columns: Vec<usize> = chosen.iter().map(|c| c.0).collect();
        let without = |e: usize| self.fit_with(&self.parts[0], &columns, Some(e), 1.0).map(|f| f.1.evidence);
        // The first ones belong to the model that was given.
        let candidates = (0..self.effects.len()).filter(|e| self.slots.iter().any(|s| s.0 == *e));
        candidates
            .filter(|e| without(*e).is_some_and(|w| evidence - self.log_likelihood - w < threshold))
            .map(|e| self.effects[e].setting.effect.name())
            .collect()
    }

    /// Terms in the order in which they gain the most.
    fn pursued(&self) -> Vec<usize> {
        let mut chosen: Vec<usize> = Vec::new();
        let evidence = |chosen: &[usize]| self.fit(&self.parts[0], chosen).map(|f| f.1.evidence);
        let Some(mut have) = evidence(&chosen) else { return chosen };
        while chosen.len() < MOST_TERMS {
            let tried = (0..self.terms.len()).filter(|k| !chosen.contains(k)).filter_map(|k| {
                let with: Vec<usize> = chosen.iter().copied().chain([k]).collect();
                evidence(&with).map(|e| (k, e))
            });
            let Some((k, best)) = tried.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            if best - have < WORTH + ln(self.terms.len() as f64) {
                break;
            }
            chosen.push(k);
            have = best;
        }
        chosen
    }

    /// How much more likely the held-out part is with what the other part says of these terms.
    fn held_out(&self, chosen: &[usize]) -> f64 {
        let Some((columns, fit)) = self.fit(&self.parts[0], chosen) else { return f64::NEG_INFINITY };
        let held = &self.parts[1];
        let (mut along, mut square) = (0.0, 0.0);
        for (i, row) in columns.iter().enumerate() {
            along += held.score[*row] * fit.step[i];
            square += columns
                .iter()
                .enumerate()
                .map(|(j, c)| fit.step[i] * held.matrix[(*row, *c)] * fit.step[j])
                .sum::<f64>();
        }
        along - 0.5 * square
    }

    /// Those that the held-out part confirms, each with what it gains there.
    fn confirmed(&self, chosen: Vec<usize>) -> Vec<(usize, f64)> {
        let mut left = chosen;
        loop {
            let whole = self.held_out(&left);
            let gains: Vec<(usize, f64)> = left
                .iter()
                .map(|k| {
                    let others: Vec<usize> = left.iter().copied().filter(|o| o != k).collect();
                    (*k, whole - self.held_out(&others))
                })
                .collect();
            match gains.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((worst, gain)) if *gain < CONFIRMED => left.retain(|k| k != worst),
                _ => return gains,
            }
        }
    }

    /// Coefficients from all the data, hardly drawn toward zero by the prior.
    fn found(&self, chosen: &[(usize, f64)]) -> Vec<Found> {
        let mut sum = self.parts[0].clone();
        sum.add(&self.parts[1]);
        let columns: Vec<usize> = chosen.iter().map(|c| c.0).collect();
        let Some((all, fit)) = self.fit_with(&sum, &columns, None, WIDE).filter(|_| !chosen.is_empty())
        else {
            return Vec::new();
        };
        let first = all.len() - chosen.len();
        chosen
            .iter()
            .enumerate()
            .map(|(i, (k, held_out))| {
                let (channel, regressor) = self.terms[*k];
                let base = if channel < 3 { "rad/s" } else { "m/s2" };
                Found {
                    channel: CHANNELS[channel],
                    term: regressor.name,
                    coefficient: fit.step[first + i],
                    sigma: fit.covariance[(first + i, first + i)].max(0.0).sqrt(),
                    unit: format!("{base}{}", regressor.per),
                    held_out: *held_out,
                }
            })
            .collect()
    }
}
