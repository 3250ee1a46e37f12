//! Identification: which effect does a model lack, how sure is that, and where does the gap lie.
//!
//! One run over a flight linearised about its trajectory ([`linear`]) gives, for every parameter of every
//! effect at once, the score b and the information Λ of the likelihood of the innovations. With the prior of an
//! effect's definition the marginal likelihood of "the effect is there" over "it is not" follows in closed form
//! ([`evidence`]). That ratio is a Bayes factor: with a right noise model, that of an effect which is not there exceeds `exp(t)` with a
//! probability of at most `exp(−t)` (Markov's inequality), whatever the number of its parameters. This bounds one effect that is tried once: .037
//! at the threshold of 3.3. Over the 21 effects of the catalogue the bounds add up to .77, so the threshold alone does not control the catalogue.
//! The faults of a source pay for their number, and so do formulas, for the number that a flight may have and for being outside (together .041 at
//! most); a jump is averaged over its instants. Nothing bounds what noise that is refitted for each candidate adds. How often a clean
//! flight is given a name is therefore measured: 4 of 300 (`study blind --clean`; docs/explain.md). Noise is fitted first ([`noise`]) so that it does not pass for an effect;
//! effects are then added one by one at the values that the flights say ([`select`]).

pub mod aids;
pub mod air;
pub mod beyond;
mod by_hand;
pub mod compass;
pub mod evidence;
pub mod flight;
mod guess;
pub mod holdout;
pub mod judge;
pub mod linear;
pub mod noise;
pub mod pass;
pub mod residual;
pub(crate) mod rounding;
pub mod select;
mod simulated;
pub mod size;
mod stationary;
mod statistics;
mod stretch;
pub mod survey;
pub mod watched;

use std::sync::Mutex;

/// Somebody who can do several things at once. This crate starts no threads itself.
pub trait Workers: Sync {
    /// Does `job(0) … job(jobs − 1)` in any order and returns when all are done.
    fn run(&self, jobs: usize, job: &(dyn Fn(usize) + Sync));
}

/// One after the other.
#[derive(Debug, Clone, Copy, Default)]
pub struct Serial;

impl Workers for Serial {
    fn run(&self, jobs: usize, job: &(dyn Fn(usize) + Sync)) {
        (0..jobs).for_each(job);
    }
}

/// The results of several jobs in order, so that sums do not depend on scheduling.
pub fn map<T: Send>(workers: &dyn Workers, jobs: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let results: Mutex<Vec<(usize, T)>> = Mutex::new(Vec::with_capacity(jobs));
    workers.run(jobs, &|k| {
        let result = job(k);
        if let Ok(mut all) = results.lock() {
            all.push((k, result));
        }
    });
    let mut all = results.into_inner().unwrap_or_default();
    all.sort_by_key(|(k, _)| *k);
    all.into_iter().map(|(_, r)| r).collect()
}

#[cfg(test)]
pub(crate) mod tests;
