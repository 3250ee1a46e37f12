//! What a search saw from each point, for a second one over the same flights that has more candidates.

use super::closer::is_far_behind;
use super::{Beside, Candidate, Options, Point};
use crate::effects::Effect;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// A point to the bit, what counted, and which candidates were asked.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Key {
    numbers: Vec<u64>,
    effects: Vec<&'static str>,
    names: Option<Vec<&'static str>>,
}

/// What was seen from a point.
#[derive(Debug, Clone)]
pub(super) struct Looked {
    /// Best first. Only the best has its own trajectories: no other is gone on from.
    pub(super) looks: Vec<(Candidate, Point)>,
    /// Every candidate at a glance.
    pub(super) remaining: Vec<(&'static str, f64)>,
}

impl Looked {
    /// Whether a candidate beside these is worth a closer look.
    pub(super) fn leaves_hope(&self, candidate: &Candidate) -> bool {
        let top = self.remaining.iter().map(|r| r.1).fold(f64::NEG_INFINITY, f64::max);
        !is_far_behind(candidate.evidence, top)
    }
}

/// What searches over the same flights and the same model saw so far.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    all: Arc<Mutex<HashMap<Key, Looked>>>,
    /// Candidates that the first search did not have.
    new: Beside,
}

impl Seen {
    /// The same for a search that has these candidates beside those of the first.
    pub fn with(&self, new: &[&'static dyn Effect]) -> Self {
        Self { all: self.all.clone(), new: Beside::default().and(new) }
    }

    /// Those of these names that the first search did not have.
    pub(super) fn new_names(&self, names: Option<&[&'static str]>) -> Vec<&'static str> {
        self.new.iter().map(Effect::name).filter(|n| names.is_none_or(|own| own.contains(n))).collect()
    }

    fn key(&self, point: &Point, names: Option<&[&'static str]>, options: &Options) -> Key {
        let is_new = |name: &&'static str| self.new.iter().any(|e| e.name() == *name);
        let Options { settle_s, block_s, held_out_every, phase } = *options;
        let values = point.added.iter().flat_map(|a| a.setting.values.iter().copied());
        let figures = point.noise.get().into_iter().chain([settle_s, block_s]);
        let own = [point.evidence, point.log_likelihood, f64::from(held_out_every), f64::from(phase)];
        Key {
            numbers: values.chain(figures).chain(own).map(f64::to_bits).collect(),
            effects: point.added.iter().map(|a| a.setting.effect.name()).collect(),
            names: names.map(|n| n.iter().filter(|n| !is_new(n)).copied().collect()),
        }
    }

    /// What was seen from this point.
    pub(super) fn at(
        &self,
        point: &Point,
        names: Option<&[&'static str]>,
        options: &Options,
    ) -> Option<Looked> {
        let key = self.key(point, names, options);
        self.all.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned()
    }

    /// Keeps what was seen, unless new candidates were among it.
    pub(super) fn keep(
        &self,
        point: &Point,
        names: Option<&[&'static str]>,
        options: &Options,
        (looks, remaining): (&[(Candidate, Point)], &[(&'static str, f64)]),
    ) {
        if self.new.iter().next().is_some() {
            return;
        }
        let mut looks = looks.to_vec();
        looks.iter_mut().skip(1).for_each(|l| l.1.references = point.references.clone());
        let looked = Looked { looks, remaining: remaining.to_vec() };
        let key = self.key(point, names, options);
        self.all.lock().unwrap_or_else(PoisonError::into_inner).insert(key, looked);
    }
}
