//! Beyond the catalogue: formulas over all drivers that the flights have compete with the effects of the catalogue, by the same evidence.
//!
//! Sparse regression over a library of candidate terms (Brunton, Proctor & Kutz 2016, "Discovering governing equations from data by sparse
//! identification of nonlinear dynamical systems", PNAS 113), with the marginal likelihood in place of a threshold on coefficients (Tipping 2001, "Sparse
//! Bayesian learning and the relevance vector machine", JMLR 1). Every formula is screened at a glance twice, some at a time: with nothing named, and
//! beside what the catalogue named. Where one comes near what the catalogue explains, or explains what it leaves, the selection is
//! made again with the best of them among its candidates. A formula pays for the size of the grammar
//! ([`Effect::prior_cost`]).

use super::flight::Flight;
use super::judge::Judged;
use super::noise::Claims;
use super::select::{self, Added, Candidate, Glance, Point, Search, Selection, Settings};
use super::size::Flown;
use super::{Workers, judge, residual};
use crate::effects::data::grammar;
use crate::effects::{Effect, data};
use crate::math::ln;
use crate::model::{EffectSetting, Model};
use crate::rss;

/// So many formulas are watched at once: the cost of a pass grows with the square of its columns.
const AT_ONCE: usize = 24;
/// So many of the best at each point are tried closely.
const TRIED: usize = 5;
/// A formula this far behind the best effect of the catalogue at a glance may still win when noise and values are fitted, nats …
const BEHIND: f64 = 12.0;
/// … or by this share of its evidence.
const BEHIND_SHARE: f64 = 0.2;
/// So many that a search leaves over are looked at: the more, the less each says.
const LEFT_OVER: usize = 3;
/// A formula with this evidence beside all that was named is tried, nats: below the threshold for a name, since a glance does not fit the noise.
const WORTH: f64 = 1.0;

/// A selection that adds the best effect at each step may end worse than the one without formulas: not by more than this, nats.
const GREEDY: f64 = 10.0;

/// Those of the formulas that are worth a closer look at a point, at a glance, best first: more likely than `bar` beside its effects, or about as likely
/// in the place of one of them as that effect itself. The price of the grammar is included, and they are of a size that a name is given to.
fn screen(
    search: &Search<'_>,
    point: &Point,
    formulas: &[&'static dyn Effect],
    (bar, flown): (f64, &Flown),
) -> Vec<&'static dyn Effect> {
    let places = search.given.len()..point.added.len();
    let mut beside: Vec<Candidate> = Vec::new();
    let mut instead: Vec<Vec<Candidate>> = vec![Vec::new(); places.len()];
    for some in formulas.chunks(AT_ONCE) {
        let glance = glance(search, point, some);
        beside.extend(glance.beside().into_iter().filter(|c| c.evidence > bar));
        for (k, found) in places.clone().zip(&mut instead) {
            let Some((own, all)) = glance.instead_of(k) else { continue };
            found.extend(all.into_iter().filter(|c| c.evidence > reach(own)));
        }
    }
    let mut out: Vec<&'static dyn Effect> = Vec::new();
    for mut some in std::iter::once(beside).chain(instead) {
        some.retain(|c| !flown.size(&c.setting, &search.base).negligible);
        some.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        for c in some.into_iter().take(TRIED) {
            if out.iter().all(|e| e.name() != c.setting.effect.name()) {
                out.push(c.setting.effect);
            }
        }
    }
    out
}

/// One look at those of the formulas that a point lacks.
fn glance<'p>(search: &Search<'_>, point: &'p Point, formulas: &[&'static dyn Effect]) -> Glance<'p> {
    let lacks = |e: &&&'static dyn Effect| point.added.iter().all(|a| a.setting.effect.name() != e.name());
    let lacking: Vec<EffectSetting> = formulas.iter().filter(lacks).map(|e| nothing(*e)).collect();
    search.glance_unmasked_at(point, &lacking)
}

/// The evidence from which a formula may still win against an effect that has this one at a glance, nats.
fn reach(own: f64) -> f64 {
    (own - BEHIND.max(BEHIND_SHARE * own)).max(WORTH)
}

/// The flights as a point has them.
fn flown(search: &Search<'_>, point: &Point) -> Flown {
    let (model, references, problems) = search.at(point);
    let (nis, n) = search.nis(&problems, &point.noise);
    let all = search.flights.iter().zip(references.iter());
    let motions: Vec<_> =
        all.map(|(flight, reference)| residual::motions(flight, &model, reference)).collect();
    Flown::new(search.flights, motions.iter().map(|m| m.iter()), nis / n.max(1) as f64)
}

/// What the catalogue's strongest effect explains by itself, nats.
fn strongest(selection: &Selection) -> f64 {
    selection.steps.iter().map(|s| s.evidence).fold(0.0, f64::max)
}

/// Formulas that may be what flights show, given what the catalogue makes of them, and what that is worth.
fn promising(
    flights: &[&Flight],
    catalogue: &Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> (Vec<&'static dyn Effect>, f64) {
    let formulas = grammar::formulas(flights);
    let (search, point) = over_all(flights, catalogue, settings, workers);
    let flown = flown(&search, &point);
    let worth = worth(flights, &point, catalogue);
    let mut tried = screen(&search, &point, &formulas, (WORTH, &flown));
    if !catalogue.added.is_empty() {
        let all = all_data(catalogue, settings);
        let search = Search::new(flights, &catalogue.base, &all, workers, &catalogue.base_noise);
        let point = search.best(&[], &catalogue.base_noise);
        let own: Vec<EffectSetting> = catalogue.added.iter().map(|a| nothing(a.setting.effect)).collect();
        let glance = search.glance(&point, &own).into_iter().map(|c| c.evidence).fold(0.0, f64::max);
        let top = if glance > 0.0 { glance } else { strongest(catalogue) };
        for effect in screen(&search, &point, &formulas, (reach(top), &flown)) {
            if tried.iter().all(|t| t.name() != effect.name()) {
                tried.push(effect);
            }
        }
    }
    (tried, worth)
}

/// Settings that count what a selection held out, too.
fn all_data(selection: &Selection, settings: &Settings) -> Settings {
    Settings { options: selection.options.all(), ..*settings }
}

/// A search that counts all data, and a selection as these show it. Two selections may have held out different parts: a step that one of them names
/// must not be held out.
fn over_all<'a>(
    flights: &'a [&'a Flight],
    selection: &Selection,
    settings: &Settings,
    workers: &'a dyn Workers,
) -> (Search<'a>, Point) {
    let search = judge::about(flights, selection, &all_data(selection, settings), workers);
    let point = search.best(&selection.added, &selection.noise);
    (search, point)
}

fn nothing(effect: &'static dyn Effect) -> EffectSetting {
    EffectSetting { sigmas: vec![0.0; effect.len()], ..EffectSetting::unknown(effect) }
}

/// What a selection is worth: log-likelihood of all data, less what its parameters and formulas cost (Schwarz 1978).
fn worth(flights: &[&Flight], point: &Point, selection: &Selection) -> f64 {
    let fixes: usize = flights.iter().map(|f| f.fixes().len()).sum();
    let cost =
        |a: &Added| 0.5 * a.setting.effect.len() as f64 * ln(fixes as f64) + a.setting.effect.prior_cost();
    point.log_likelihood - selection.added.iter().map(cost).sum::<f64>()
}

/// Whether a formula is named in it, alone or in a group.
fn names_formula(selection: &Selection) -> bool {
    selection.steps.iter().flat_map(|s| &s.group).any(|name| name.starts_with(data::FORMULA))
}

/// A selection of the catalogue's effects, or one in which formulas have taken places.
pub fn select(
    flights: &[&Flight],
    base: &Model,
    catalogue: Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> Selection {
    let (tried, catalogue_worth) = promising(flights, &catalogue, settings, workers);
    if tried.is_empty() {
        return catalogue;
    }
    let settings = Settings { beside: settings.beside.and(&tried), ..*settings };
    let found = select::select(flights, base, &settings, workers);
    if !names_formula(&found) {
        return catalogue;
    }
    let (_, point) = over_all(flights, &found, &settings, workers);
    if worth(flights, &point, &found) > catalogue_worth - GREEDY { found } else { catalogue }
}

/// Formulas that would come next where a search ended because it had enough effects: those that are likely beside all it found, best first. Where it ended
/// because nothing was likely any more there is none: whatever was has been looked at closely, and is named or refuted.
pub fn left_over(
    flights: &[&Flight],
    judged: &Judged,
    settings: &Settings,
    workers: &dyn Workers,
) -> Vec<EffectSetting> {
    let selection = &judged.selection;
    let (claims, added) =
        (Claims::new(&selection.base, flights), selection.added.len() + judged.removed.len());
    if !select::are_enough(added, settings, &claims, &selection.noise) {
        return Vec::new();
    }
    let (search, point) = over_all(flights, selection, settings, workers);
    let mut likely: Vec<Candidate> = grammar::formulas(flights)
        .chunks(AT_ONCE)
        .flat_map(|some| glance(&search, &point, some).beside())
        .filter(|c| c.evidence > settings.threshold)
        .collect();
    likely.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    likely.truncate(LEFT_OVER);
    let looks = search.close_looks(&likely, &point, &point).into_iter();
    looks.filter(|l| l.0.evidence > settings.threshold).map(|l| l.0.setting).collect()
}

/// What a flight says of one effect of a model.
#[derive(Debug, Clone)]
pub struct Confirmation {
    /// The effect as the model has it, with the sigmas of an earlier flight.
    pub earlier: EffectSetting,
    /// As this flight has it, from a prior that knows nothing of the earlier one.
    pub here: EffectSetting,
    /// Logarithm of the odds that it is there at all, nats.
    pub evidence: f64,
}

impl Confirmation {
    /// Difference of each parameter in sigmas of both.
    pub fn differences(&self) -> Vec<f64> {
        let both = self.here.values.iter().zip(&self.earlier.values);
        let sigmas = self.here.sigmas.iter().zip(&self.earlier.sigmas).map(|(&a, &b)| rss(a, b));
        both.zip(sigmas).map(|((a, b), s)| if s > 0.0 { (a - b) / s } else { 0.0 }).collect()
    }
}

/// Looks in flights for effects of a model as if nobody had seen them before; `base` is the model without them.
pub fn confirm(
    flights: &[&Flight],
    base: &Model,
    effects: &[EffectSetting],
    settings: &Settings,
    workers: &dyn Workers,
) -> Vec<Confirmation> {
    let settings = Settings { options: settings.options.all(), ..*settings };
    let measured = super::noise::Noise::measured(base, flights);
    let mut search = Search::new(flights, base, &settings, workers, &measured);
    let start = search.start(&measured);
    let one = |earlier: &EffectSetting| {
        let candidate = search.glance(&start, &[nothing(earlier.effect)]).into_iter().next()?;
        let (look, point) =
            search.close_looks(std::slice::from_ref(&candidate), &start, &start).into_iter().next().unzip();
        // It is one that was named before, and pays for no grammar.
        let evidence =
            look.map_or(candidate.evidence, |l: Candidate| l.evidence) + earlier.effect.prior_cost();
        let prior = select::prior_sigmas(earlier.effect).into_iter().map(|s| (0.0, 2.0 * s)).collect();
        let own = Added { setting: candidate.setting, prior };
        let noise = point.map_or(start.noise, |p: Point| p.noise);
        let best = search.best(&[own], &noise);
        let here = best.added.into_iter().find(|a| a.setting.effect.name() == earlier.effect.name())?.setting;
        Some(Confirmation { earlier: earlier.clone(), here, evidence })
    };
    effects.iter().filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::fly;
    use super::super::{Serial, pass::Options};
    use super::*;
    use crate::effects::GpsLatency;

    /// A selection that names a step holds out other parts than one that does not: their likelihoods are of different data.
    #[test]
    fn a_selection_is_worth_the_same_whatever_it_held_out() {
        let (base, settings) = (Model::default(), Settings::default());
        let mut truth = base.clone();
        truth.set(EffectSetting::known(&GpsLatency, &[0.12]).unwrap());
        let flight = Flight::prepare(&fly(&truth, 5), &base).unwrap();
        let flights = [&flight];
        let selection = select::select(&flights, &base, &settings, &Serial);
        assert!(!selection.added.is_empty());
        let worth = |selection: &Selection| {
            let (_, point) = over_all(&flights, selection, &settings, &Serial);
            worth(&flights, &point, selection)
        };
        let other = Selection {
            options: Options { phase: selection.options.phase + 1, ..selection.options },
            ..selection.clone()
        };
        assert_eq!(worth(&selection), worth(&other));
        assert!(worth(&selection) > selection.log_likelihood[1] + 100.0, "all data, not a part");
        let without = Selection { added: Vec::new(), steps: Vec::new(), ..selection.clone() };
        assert!(worth(&without) < worth(&selection) - 100.0);
    }
}
