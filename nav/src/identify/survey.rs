//! The whole catalogue at the final point: values of what was found with sigmas that hold under misfit, what the model leaves
//! open, and for everything else its odds and its limit.
//!
//! Two things make the curvature of the likelihood too sharp. Errors that are correlated in time: the scatter of the values when
//! blocks of the flight are left out in turn says how much (the cluster jackknife; MacKinnon, Nielsen & Webb 2023, "Fast and
//! reliable jackknife and bootstrap methods for cluster-robust inference"; it is a sandwich estimate whose meat are the scores of
//! blocks, White 1982). And effects that were not found: that none of them has the evidence for a name does not make them zero,
//! so values are averaged over the models with each of them, weighed by their evidence (Hoeting, Madigan, Raftery & Volinsky
//! 1999, "Bayesian model averaging").

use super::evidence::{self, Column, Fit, SCALES};
use super::linear::Problem;
use super::map;
use super::pass::Information;
use super::select::{self, Added, Point, Search};
use crate::effects::{Effect, GYRO_G_SENSITIVITY, REGISTRY};
use crate::identify::watched::Watched;
use crate::math::exp;
use crate::model::EffectSetting;
use nalgebra::Vector3;

/// Length of the blocks that are left out in turn, s: long against the correlation of GNSS errors that the model knows not of.
const BLOCK_S: f64 = 20.0;
/// Fewer blocks than this say nothing about a scatter.
const ENOUGH_BLOCKS: usize = 6;
/// A parameter whose sigma is more than this share of its prior's is not informed by the flights.
const INFORMED: f64 = 0.8;
/// An effect that was not named speaks at most this loud for values beside it, nats: held-out data were against it.
const LOUDEST: f64 = 3.3;
/// An axis of a formula that is held at nothing has this share of its prior's sigma: far below what any flight resolves, and far enough from zero for the
/// arithmetic.
const HELD: f64 = 1e-3;
/// A drift of a size is excluded where it makes the flights less likely by this, nats: two sigmas.
const EXCLUDED: f64 = 2.0;
/// The prior of an effect that was not found is made so many times wider for its limit.
const WIDE: f64 = 30.0;

/// What was looked for and not found, with the sigma that these flights leave it: an effect smaller than a few of those sigmas may be
/// there all the same. The sigma is that of the information bound along the flown trajectory (van Trees 1968, section 2.4), given
/// what else was found and with hardly any prior: what the flights themselves know.
#[derive(Debug, Clone)]
pub struct NotFound {
    /// The effect with the values that suit the flights best, and their sigmas.
    pub setting: EffectSetting,
    /// Logarithm of the odds that it is there.
    pub evidence: f64,
    /// Why there is no better limit, where there is a reason.
    pub reason: Option<&'static str>,
}

/// The catalogue when everything is over.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// What the model itself left to be estimated, with the values that the flights give.
    pub assumed: Vec<Added>,
    /// What was looked for and not found, the likeliest first.
    pub not_found: Vec<NotFound>,
}

/// Which parameters of an effect the flights inform: their sigma is smaller than that of their prior.
pub fn informed(added: &Added) -> Vec<bool> {
    let own = |(sigma, (_, prior)): (&f64, &(f64, f64))| *prior == 0.0 || *sigma < INFORMED * prior;
    added.setting.sigmas.iter().zip(&added.prior).map(own).collect()
}

/// Whether the flights inform any parameter of an effect that has a prior. Of one that has none (a switch, a drift) its presence is all
/// there is to know.
pub fn is_informed(added: &Added) -> bool {
    let mut open =
        informed(added).into_iter().zip(&added.prior).filter(|(_, (_, prior))| *prior > 0.0).peekable();
    open.peek().is_none() || open.any(|(informed, _)| informed)
}

/// The flights linearised at the final point.
struct Linear<'a> {
    search: &'a Search<'a>,
    point: &'a Point,
    lacking: Vec<EffectSetting>,
    watched: Watched,
    problems: Vec<Problem>,
    blocks: Vec<Information>,
    all: Information,
    log_likelihood: f64,
    /// Columns of what was found that may move.
    open: Vec<Column>,
    /// Columns that are held at nothing, and the sigma that each has where it is not.
    held: Vec<(usize, f64)>,
}

impl<'a> Linear<'a> {
    fn new(search: &'a Search<'a>, point: &'a Point) -> Self {
        let lacking = search.lacking(&point.added);
        let linear = lacking.iter().filter(|s| select::is_linear(s.effect)).cloned();
        let effects = point.added.iter().map(|a| a.setting.clone()).chain(linear).collect();
        let watched = Watched { effects };
        let runs = search.run_through(point, &watched, &[search.walk(&point.added)], Some(BLOCK_S));
        let problems = search.problems(point, &Watched::default());
        let mut all = Information::zeros(watched.slots().len());
        let mut log_likelihood = 0.0;
        let mut blocks = Vec::new();
        for run in runs.into_iter().flatten() {
            log_likelihood += run.log_likelihood[0];
            run.blocks.iter().for_each(|b| all.add(b));
            all.imitated += &run.information[0].imitated;
            blocks.extend(run.blocks);
        }
        search.correlate(&point.added, &watched, &mut all);
        let open = select::open(&point.added, &watched);
        let held = Vec::new();
        let mut linear =
            Self { search, point, lacking, watched, problems, blocks, all, log_likelihood, open, held };
        linear.hold_idle_axes();
        linear
    }

    /// Holds the axes of formulas at nothing that are likelier so, one after the other. A formula is sought on all axes of a sensor at once, and what it has
    /// no part in would take what noise and effects that are badly seen leave there: beside an antenna's place `f_x^3` of accelerometer x did on y what it
    /// did on x.
    fn hold_idle_axes(&mut self) {
        let slots = self.watched.slots();
        let effect_of = |c: &Column| slots[c.at].0;
        let formula = |i: &usize| self.watched.effects[effect_of(&self.open[*i])].effect.prior_cost() > 0.0;
        let mut axes: Vec<usize> = (0..self.open.len()).filter(formula).collect();
        while let Some(full) = self.fit(&self.all, &[]).filter(|_| !axes.is_empty()) {
            let open = &self.open;
            let without = |i: usize| {
                let mut open = open.clone();
                open[i].sigma *= HELD;
                evidence::fit(&self.all, &open).map(|f| (i, f.evidence))
            };
            // It is named: one axis at least has a part in it.
            let others =
                |i: &&usize| axes.iter().any(|a| a != *i && effect_of(&open[*a]) == effect_of(&open[**i]));
            let best =
                axes.iter().filter(others).filter_map(|i| without(*i)).max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((i, _)) = best.filter(|b| b.1 > full.evidence) else { break };
            self.held.push((open[i].at, full.covariance[(i, i)].sqrt()));
            self.open[i].sigma *= HELD;
            axes.retain(|a| *a != i);
        }
    }

    /// What was found, and further columns.
    fn fit(&self, information: &Information, more: &[Column]) -> Option<Fit> {
        evidence::fit(information, &[&self.open, more].concat())
    }

    /// Columns of a lacking effect with the prior sigmas of its definition.
    fn columns(&self, effect: &dyn Effect) -> Vec<Column> {
        let own = select::prior_sigmas(effect);
        let slots = self.watched.slots().into_iter().enumerate();
        let of = slots.filter(|(_, slot)| self.watched.effects[slot.0].effect.name() == effect.name());
        of.map(|(at, slot)| Column { at, sigma: own[slot.1], offset: 0.0 }).collect()
    }

    /// Columns of what is in any unit and the search has not named: what calibration leaves, with tolerances for sigmas, and G, which no one calibrates,
    /// with that of the standard model. Evidence that is not enough for a name is none that a unit has no G: on two flights made by other means its
    /// elements of 110 and 220 deg/h/g had put scale factors 3.0 and 6.2 sigma off.
    fn tolerances(&self) -> Vec<Column> {
        if !self.search.settings.tolerances {
            return Vec::new();
        }
        let linear = self.lacking.iter().filter(|s| select::is_linear(s.effect));
        let sigma_of = |s: &&EffectSetting| {
            let name = s.effect.name();
            let g = name == GYRO_G_SENSITIVITY.name() && self.search.base.get(name).is_none();
            s.effect.tolerance().or_else(|| select::prior_sigmas(s.effect).first().copied().filter(|_| g))
        };
        linear
            .filter_map(|s| Some((s, sigma_of(&s)?)))
            .flat_map(|(s, sigma)| self.columns(s.effect).into_iter().map(move |c| Column { sigma, ..c }))
            .collect()
    }

    /// By how much the scatter over blocks exceeds what the curvature says, as a factor on each open column's sigma; at least 1.
    fn widening(&self, full: &Fit, beside: &[Column]) -> Vec<f64> {
        let n = self.blocks.len();
        let open = self.open.len();
        if n < ENOUGH_BLOCKS {
            return vec![1.0; open];
        }
        let without = map(self.search.workers, n, |b| {
            let mut rest = self.all.clone();
            rest.score -= &self.blocks[b].score;
            rest.matrix -= &self.blocks[b].matrix;
            self.fit(&rest, beside).map(|f| f.step)
        });
        let share = (n - 1) as f64 / n as f64;
        (0..open)
            .map(|k| {
                let squares = without.iter().flatten().map(|s| (s[k] - full.step[k]).powi(2));
                (share * squares.sum::<f64>() / full.covariance[(k, k)]).max(1.0).sqrt()
            })
            .collect()
    }

    /// Values and sigmas of what was found, averaged over what else may be there.
    fn values(&self) -> Option<Vec<Added>> {
        let tolerances = self.tolerances();
        let full = self.fit(&self.all, &tolerances)?;
        let widening = self.widening(&full, &tolerances);
        let mut models: Vec<(f64, Fit)> = vec![(1.0, full.clone())];
        for setting in self.lacking.iter().filter(|s| select::is_linear(s.effect)) {
            let own = self.columns(setting.effect);
            for scale in SCALES {
                let others = tolerances.iter().filter(|t| own.iter().all(|c| c.at != t.at)).copied();
                let more: Vec<Column> = others.chain(own.iter().map(|c| c.wider(scale))).collect();
                if let Some(fit) = self.fit(&self.all, &more) {
                    let weight = exp((fit.evidence - full.evidence).min(LOUDEST)) / SCALES.len() as f64;
                    models.push((weight, fit));
                }
            }
        }
        let total: f64 = models.iter().map(|m| m.0).sum();
        let mean = |of: &dyn Fn(&Fit) -> f64| models.iter().map(|(w, f)| w * of(f)).sum::<f64>() / total;
        let slots = self.watched.slots();
        let mut added = self.point.added.clone();
        for (i, column) in self.open.iter().enumerate() {
            let step = mean(&|f| f.step[i]);
            let within = mean(&|f| f.covariance[(i, i)]) * widening[i].powi(2);
            let between = mean(&|f| (f.step[i] - step).powi(2));
            let (effect, parameter) = slots[column.at];
            added[effect].setting.values[parameter] += step;
            added[effect].setting.sigmas[parameter] = (within + between).max(0.0).sqrt();
        }
        for (k, sigma) in &self.held {
            let (effect, parameter) = slots[*k];
            added[effect].setting.values[parameter] = 0.0;
            added[effect].setting.sigmas[parameter] = *sigma;
        }
        Some(added)
    }

    /// A linear effect that was not found.
    fn linear(&self, setting: &EffectSetting, full: &Fit) -> Option<NotFound> {
        let own = self.columns(setting.effect);
        let fit = |scale: f64| {
            let own: Vec<Column> = own.iter().map(|c| c.wider(scale)).collect();
            self.fit(&self.all, &own)
        };
        let evidences = SCALES.iter().filter_map(|scale| fit(*scale).map(|f| f.evidence - full.evidence));
        let evidence = evidence::log_mean_exp(evidences);
        let (wide, slots) = (fit(WIDE)?, self.watched.slots());
        let mut setting = setting.clone();
        for (column, at) in own.iter().zip(self.open.len()..) {
            let parameter = slots[column.at].1;
            setting.values[parameter] += wide.step[at];
            setting.sigmas[parameter] = wide.covariance[(at, at)].max(0.0).sqrt();
        }
        let prior = select::prior_sigmas(setting.effect);
        let hardly = setting.sigmas.iter().zip(&prior).any(|(sigma, prior)| *prior > 0.0 && sigma > prior);
        let reason = hardly.then_some("the flights hardly excite some of its parameters");
        Some(NotFound { setting, evidence, reason })
    }

    /// A drift that was not found, with the size from which on the flights exclude it.
    fn drift(&self, setting: &EffectSetting) -> NotFound {
        let value = |size: f64| {
            let noise = &self.point.noise;
            self.search.with_random_walk(&self.problems, &self.point.added, setting, size, noise)
                - self.log_likelihood
        };
        let sizes = setting.effect.sizes_to_try();
        let values = map(self.search.workers, sizes.len(), |k| value(sizes[k]));
        let evidence = evidence::log_mean_exp(values.iter().copied());
        let top = values.iter().copied().fold(0.0, f64::max);
        let excluded = sizes.iter().zip(&values).find(|(_, v)| **v < top - EXCLUDED).map(|s| *s.0);
        let mut setting = setting.clone();
        setting.sigmas = vec![excluded.unwrap_or(0.0) / 3.0];
        let reason = if excluded.is_some() { None } else { Some("these flights exclude no size of it") };
        NotFound { setting, evidence, reason }
    }

    /// An event that was not found, with what a jump in the middle of the flight would be known to.
    fn event(&self, setting: &EffectSetting) -> Option<NotFound> {
        let shocks = map(self.search.workers, self.problems.len(), |k| {
            self.problems[k].shocks(&self.point.noise, &self.search.settings.options)
        });
        let candidate = self.search.jump(setting, &shocks)?;
        let flight = shocks.first()?;
        let middle = flight.get(flight.len() / 2)?;
        let (_, information) = if setting.effect.event() == Some(crate::effects::Event::GyroBias) {
            middle.gyro
        } else {
            middle.fix
        };
        let covariance = information.try_inverse()?;
        let sigma = Vector3::from_fn(|i, _| covariance[(i, i)].max(0.0).sqrt());
        let mut setting = setting.clone();
        setting.values.clone_from(&candidate.setting.values);
        setting.sigmas = vec![0.0, sigma.x, sigma.y, sigma.z];
        Some(NotFound { setting, evidence: candidate.evidence, reason: None })
    }

    fn not_found(&self) -> Vec<NotFound> {
        let full = self.fit(&self.all, &[]);
        let without = |effect: &'static dyn Effect, reason| NotFound {
            setting: EffectSetting {
                effect,
                values: vec![0.0; effect.len()],
                sigmas: vec![0.0; effect.len()],
            },
            evidence: 0.0,
            reason: Some(reason),
        };
        let there = |effect: &dyn Effect| {
            let name = effect.name();
            self.point.added.iter().any(|a| a.setting.effect.name() == name)
                || self.search.base.get(name).is_some()
                || self.search.assumes_truncation(effect)
        };
        let of = |effect: &&'static dyn Effect| {
            let Some(setting) = self.lacking.iter().find(|s| s.effect.name() == effect.name()) else {
                let reason = match effect.needs_known() {
                    _ if self.search.settings.without.contains(effect.name()) => {
                        "it was taken out of the catalogue"
                    }
                    Some(_) => {
                        "no motion separates it from another effect whose size the model does not give"
                    }
                    None => "the log holds no temperature of the inertial unit",
                };
                return without(*effect, reason);
            };
            let found = if select::is_linear(*effect) {
                full.as_ref().and_then(|f| self.linear(setting, f))
            } else if select::is_jump(*effect) {
                self.event(setting)
            } else if effect.truncates_samples() && !self.search.has_whole_counts() {
                Some(without(*effect, "the samples are finer than its steps"))
            } else if effect.is_empty() {
                let tried = self.search.discrete(std::slice::from_ref(setting), self.point);
                let evidence = tried.first().map(|c| c.evidence);
                let reason = "it is there or not; these samples speak against it";
                evidence.map(|evidence| NotFound { evidence, ..without(*effect, reason) })
            } else {
                Some(self.drift(setting))
            };
            found.unwrap_or_else(|| without(*effect, "these flights say nothing about it"))
        };
        let mut out: Vec<NotFound> = REGISTRY.iter().filter(|e| !there(**e)).map(of).collect();
        out.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        out
    }
}

impl Survey {
    /// Takes the catalogue in at a point, whose values and sigmas are then those to be reported.
    pub(super) fn take(search: &Search<'_>, point: &mut Point) -> Self {
        let (values, not_found) = {
            let linear = Linear::new(search, point);
            (linear.values(), linear.not_found())
        };
        if let Some(values) = values {
            point.added = values;
        }
        let known = |s: &EffectSetting| Added { setting: s.clone(), prior: vec![(0.0, 0.0); s.values.len()] };
        let given = point.added.iter().take(search.given.len()).cloned();
        let held = search
            .base
            .effects
            .iter()
            .filter(|s| point.added.iter().all(|a| a.setting.effect.name() != s.effect.name()));
        let truncated = REGISTRY.iter().filter(|e| {
            search.base.get(e.name()).is_none()
                && point.added.iter().all(|a| a.setting.effect.name() != e.name())
                && search.assumes_truncation(**e)
        });
        let truncated = truncated.map(|e| known(&EffectSetting::unknown(*e)));
        let assumed = given.chain(held.map(known)).chain(truncated);
        let registered = |a: &Added| REGISTRY.iter().any(|e| e.name() == a.setting.effect.name());
        Self { assumed: assumed.filter(registered).collect(), not_found }
    }
}

#[cfg(test)]
mod tests {
    use super::super::flight::Flight;
    use super::super::noise::Noise;
    use super::super::{Serial, tests::fly};
    use super::*;
    use crate::effects;
    use crate::model::Model;

    /// A rate that goes with a product of forces on one axis, found as a formula that may act on all of them.
    #[test]
    fn axes_of_a_formula_that_show_nothing_are_held_at_nothing() {
        let (base, settings) = (Model::default(), select::Settings::default());
        let formula = effects::find("formula:gyro~f_y*f_z").unwrap();
        let truth = EffectSetting::known(formula, &[4e-4, 0.0, 0.0]).unwrap();
        let mut model = base.clone();
        model.set(truth.clone());
        let flight = Flight::prepare(&fly(&model, 5), &base).unwrap();
        let flights = [&flight];
        let measured = Noise::measured(&base, &flights);
        let search = Search::new(&flights, &base, &settings, &Serial, &measured);
        let prior = select::prior_sigmas(formula).into_iter().map(|s| (0.0, s)).collect();
        let added = Added { setting: EffectSetting { sigmas: vec![0.0; 3], ..truth }, prior };
        let mut point = search.best(&[added], &measured);
        let all = point.added.last().unwrap().setting.clone();
        assert!(all.values.iter().all(|v| *v != 0.0), "{all:?}");
        Survey::take(&search, &mut point);
        let held = &point.added.last().unwrap().setting;
        assert_eq!(held.values[1..], [0.0; 2]);
        assert!((held.values[0] - 4e-4).abs() < 3.0 * held.sigmas[0] && held.sigmas[0] < 1e-4, "{held:?}");
        assert!(held.sigmas.iter().zip(&all.sigmas).all(|(h, a)| *h > 0.5 * a), "{held:?} {all:?}");
    }
}
