//! What a campaign shows: counts with their 95 % intervals, and the confusion matrix.

use super::Outcome;
use crate::statistics::wilson_95;
use gaware::explain::contract::Verdict;
use serde::Serialize;
use std::collections::BTreeMap;

/// So many of so many.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Share {
    /// How many.
    pub count: usize,
    /// Of how many.
    pub of: usize,
    /// Their ratio; 0 of nothing.
    pub share: f64,
    /// 95 % interval of the share (Wilson).
    pub interval_95: [f64; 2],
}

impl Share {
    pub(super) fn new(count: usize, of: usize) -> Self {
        let share = if of == 0 { 0.0 } else { count as f64 / of as f64 };
        Self { count, of, share, interval_95: wilson_95(count, of) }
    }
}

/// What a campaign shows, over its flights.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Injected effects that the oracle could have named alone.
    pub oracle: Share,
    /// Of the oracle's: named alone and right.
    pub alone_right_where_oracle: Share,
    /// Named alone and right.
    pub alone_right: Share,
    /// Of the flights on which something was named: the truth inside a group.
    pub in_group: Share,
    /// Nothing named although something was injected.
    pub nothing: Share,
    /// Of all flights with something injected: a wrong name stood alone.
    pub wrong_alone: Share,
    /// Something was named beside what was injected.
    pub too_many: Share,
    /// Clean flights with something named.
    pub false_alarms: Share,
    /// Of the flights with something injected on which something was named: the held-out data are more likely with each of the effects
    /// than without it.
    pub held_out_shrinks: Share,
    /// Where the injected effects were taken out of the catalogue and an oracle saw them: the verdict says that nothing is missing.
    pub unnoticed: Share,
    /// Of the same: a wrong name stood alone, and the verdict was that this explains the flight.
    pub explained_wrongly: Share,
    /// Parameters of named effects within two sigma of the truth.
    pub within_2_sigma: Share,
    /// The same within three.
    pub within_3_sigma: Share,
    /// Of flights with several injected effects: all inside a group.
    pub both_found: Share,
    /// Of those where the oracle could name all: all inside a group.
    pub both_found_where_oracle: Share,
}

fn inside(o: &Outcome, name: &str) -> bool {
    o.groups.iter().any(|g| g.contains(&name))
}

fn alone(o: &Outcome, name: &str) -> bool {
    o.groups.iter().any(|g| g[..] == [name])
}

/// Sums up a campaign.
pub fn summarise(outcomes: &[Outcome]) -> Summary {
    let (clean, flown): (Vec<&Outcome>, Vec<&Outcome>) = outcomes.iter().partition(|o| o.hidden.is_empty());
    let count = |all: &[&Outcome], what: &dyn Fn(&Outcome) -> bool| all.iter().filter(|o| what(o)).count();
    let of_flown = |what: &dyn Fn(&Outcome) -> bool| Share::new(count(&flown, what), flown.len());
    // One entry per injected effect: flight, name, whether the oracle could name it.
    let each: Vec<(&Outcome, &'static str, bool)> = flown
        .iter()
        .flat_map(|o| o.hidden.iter().zip(&o.oracle).map(|(name, seen)| (*o, *name, seen.alone)))
        .collect();
    let seen = each.iter().filter(|e| e.2).count();
    let named: Vec<&Outcome> = flown.iter().filter(|o| !o.groups.is_empty()).copied().collect();
    let pairs: Vec<&Outcome> = flown.iter().filter(|o| o.hidden.len() > 1).copied().collect();
    let seen_pairs: Vec<&Outcome> =
        pairs.iter().filter(|o| o.oracle.iter().all(|s| s.alone)).copied().collect();
    let both = |o: &Outcome| o.hidden.iter().all(|h| inside(o, h));
    let errors: Vec<f64> = flown.iter().flat_map(|o| &o.errors_in_sigmas).copied().collect();
    let within = |sigmas: f64| Share::new(errors.iter().filter(|e| e.abs() < sigmas).count(), errors.len());
    let unknown: Vec<&Outcome> =
        flown.iter().filter(|o| o.verdict.is_some() && o.oracle.iter().any(|s| s.alone)).copied().collect();
    let verdict = |v: Verdict| Share::new(count(&unknown, &|o| o.verdict == Some(v)), unknown.len());
    Summary {
        unnoticed: verdict(Verdict::NothingMissing),
        explained_wrongly: verdict(Verdict::Explained),
        oracle: Share::new(seen, each.len()),
        alone_right_where_oracle: Share::new(each.iter().filter(|e| e.2 && alone(e.0, e.1)).count(), seen),
        alone_right: Share::new(each.iter().filter(|e| alone(e.0, e.1)).count(), each.len()),
        in_group: Share::new(count(&named, &|o| o.hidden.iter().any(|h| inside(o, h))), named.len()),
        nothing: of_flown(&|o| o.groups.is_empty()),
        wrong_alone: of_flown(&|o| o.groups.iter().any(|g| g.len() == 1 && !o.hidden.contains(&g[0]))),
        too_many: of_flown(&|o| o.groups.len() > o.hidden.len()),
        false_alarms: Share::new(count(&clean, &|o| !o.groups.is_empty()), clean.len()),
        held_out_shrinks: Share::new(count(&named, &|o| o.held_out.iter().all(|h| h.1 > 0.0)), named.len()),
        within_2_sigma: within(2.0),
        within_3_sigma: within(3.0),
        both_found: Share::new(count(&pairs, &both), pairs.len()),
        both_found_where_oracle: Share::new(count(&seen_pairs, &both), seen_pairs.len()),
    }
}

/// The confusion matrix: injected effects → what was named → how often. A group is joined by `|`, several by `+`.
pub fn confusion(outcomes: &[Outcome]) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut matrix: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for o in outcomes {
        let named = o.groups.iter().map(|g| g.join("|")).collect::<Vec<_>>().join(" + ");
        let named = if named.is_empty() { "nothing".to_owned() } else { named };
        let hidden = if o.hidden.is_empty() { "none".to_owned() } else { o.hidden.join(" + ") };
        *matrix.entry(hidden).or_default().entry(named).or_default() += 1;
    }
    matrix
}
