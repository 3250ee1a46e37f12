//! One look at every candidate, linearised about the present point.

use super::super::evidence::{Column, Fit, SCALES, fit, log_mean_exp};
use super::super::linear::Problem;
use super::super::map;
use super::super::noise::Noise;
use super::super::pass::Information;
use super::search::together;
use super::settle::{at_nothing, loss, open};
use super::{Added, Candidate, Point, Search, is_drift, is_jump, is_linear, prior_sigmas};
use crate::effects::{BiasWalk, Effect, MISTAKES};
use crate::identify::watched::Watched;
use crate::math::ln;
use crate::model::{EffectSetting, Model};
use crate::sample::{Quantisation, Steps};

/// Faults of the source that turn the flight upside down are tested where something has this much evidence, nats.
const GROSS: f64 = 100.0;

/// Where what a drift follows is named, this share of it may be left: of a lagged temperature (70 and 90 deg/h/K) beside a walk the gain was greatest at
/// 0.4 to 0.75, and within 7 nats of that down to 0.2.
const SLOWER: f64 = 0.4;

/// Of two effects in the place of one, the first is one of so many that are likeliest there alone.
const PAIRED: usize = 6;

impl Search<'_> {
    /// Every candidate, or those of these names; best first.
    pub(super) fn scan(&self, point: &Point, names: Option<&[&'static str]>) -> Vec<Candidate> {
        let wanted = |effect: &dyn Effect| names.is_none_or(|n| n.contains(&effect.name()));
        let mut lacking = self.lacking(&point.added);
        lacking.retain(|s| wanted(s.effect));
        let mut candidates = self.glance(point, &lacking);
        for better in self.about_values(&lacking, point) {
            match candidates.iter_mut().find(|c| c.setting.effect.name() == better.setting.effect.name()) {
                Some(about_zero) if about_zero.evidence >= better.evidence => {}
                Some(about_zero) => *about_zero = better,
                None => candidates.push(better),
            }
        }
        let problems = self.problems(point, &Watched::default());
        let jumping: Vec<&EffectSetting> = lacking.iter().filter(|s| is_jump(s.effect)).collect();
        if !jumping.is_empty() {
            let shocks = map(self.workers, problems.len(), |k| {
                problems[k].shocks(&point.noise, &self.settings.options)
            });
            candidates.extend(jumping.into_iter().filter_map(|s| self.jump(s, &shocks)));
        }
        candidates.extend(self.random_walks(&lacking, &problems, point));
        // What follows linearises the flights anew; of an hour these take tens of megabytes.
        drop(problems);
        candidates.extend(self.discrete(&lacking, point));
        let top = candidates.iter().map(|c| c.evidence).fold(0.0, f64::max);
        // What turns a flight upside down shows before anything else, or once another such thing is set right; among the
        // rivals of one it is looked for again.
        let added = &point.added[self.given.len()..];
        let first = added.last().is_none_or(|a| a.setting.effect.is_source_mistake());
        candidates.extend(self.mistakes(point, &wanted, (first && top > GROSS) || names.is_some()));
        candidates.retain(|c| c.evidence.is_finite());
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        candidates
    }

    /// These linear effects beside those of a point, in no order.
    pub(in crate::identify) fn glance(&self, point: &Point, lacking: &[EffectSetting]) -> Vec<Candidate> {
        self.glance_unmasked_at(point, lacking).beside()
    }

    /// One run over the flights for these linear effects at a point.
    pub(super) fn glance_at<'p>(&self, point: &'p Point, lacking: &[EffectSetting]) -> Glance<'p> {
        self.glance_with(point, lacking, &[self.walk(&point.added)])
    }

    /// The same beside a part of each drift, too: what is looked at [`Glance::beside`] all of it may be masked.
    pub(in crate::identify) fn glance_unmasked_at<'p>(
        &self,
        point: &'p Point,
        lacking: &[EffectSetting],
    ) -> Glance<'p> {
        self.glance_with(point, lacking, &self.walks_at(point))
    }

    /// One linearisation for some random walks of the biases, that of the point first.
    fn glance_with<'p>(&self, point: &'p Point, lacking: &[EffectSetting], walks: &[BiasWalk]) -> Glance<'p> {
        let lacking: Vec<EffectSetting> = lacking.iter().filter(|s| is_linear(s.effect)).cloned().collect();
        let effects = point.added.iter().map(|a| &a.setting).chain(&lacking).cloned().collect();
        let watched = Watched { effects };
        let runs = self.run_through(point, &watched, walks, None);
        let mut ways = runs.into_iter().map(|runs| {
            let (log_likelihood, [mut information, _]) = together(runs);
            self.correlate(&point.added, &watched, &mut information);
            (log_likelihood, information)
        });
        let (log_likelihood, information) =
            ways.next().unwrap_or_else(|| (0.0, Information::zeros(watched.slots().len())));
        let slower = ways.map(|(own, information)| (own - log_likelihood, information)).collect();
        Glance { added: &point.added, lacking, watched, information, slower }
    }

    /// The random walk of the biases at a point, and those with a share of each drift: one follows whatever there is, and masks it.
    fn walks_at(&self, point: &Point) -> Vec<BiasWalk> {
        let drifts = (0..point.added.len()).filter(|k| is_drift(point.added[*k].setting.effect));
        let slower = drifts.map(|k| {
            let mut added = point.added.clone();
            added[k].setting.values.iter_mut().for_each(|v| *v *= SLOWER);
            self.walk(&added)
        });
        std::iter::once(self.walk(&point.added)).chain(slower).collect()
    }

    /// Effects that are linear near each of several values alone, linearised about each.
    fn about_values(&self, lacking: &[EffectSetting], point: &Point) -> Vec<Candidate> {
        let tries: Vec<(&EffectSetting, f64)> =
            lacking.iter().flat_map(|s| s.effect.values_to_try().iter().map(move |v| (s, *v))).collect();
        // The places of a unit that was turned by hand say nothing of a receiver.
        if tries.is_empty() || self.flights.iter().all(|f| f.received().next().is_none()) {
            return Vec::new();
        }
        // What a trajectory that is found anew gains by itself is no evidence.
        let alone = self.settle(&point.added, &point.noise, point, 0).0.evidence.max(point.evidence);
        let cost = ln(SCALES.len() as f64);
        map(self.workers, tries.len(), |k| {
            let (lacking, value) = tries[k];
            let setting = EffectSetting { values: vec![value], ..lacking.clone() };
            let prior: Vec<(f64, f64)> =
                lacking.values.iter().copied().zip(prior_sigmas(setting.effect)).collect();
            let mut added = point.added.clone();
            added.push(Added { setting: setting.clone(), prior: prior.clone() });
            let (with, _) = self.settle(&added, &point.noise, point, 0);
            // One of several widths of the prior, as where it is linear about zero.
            Candidate { setting, prior, evidence: with.evidence - alone - cost, cost }
        })
    }

    /// Drifts of several sizes.
    fn random_walks(&self, lacking: &[EffectSetting], problems: &[Problem], point: &Point) -> Vec<Candidate> {
        let drifts: Vec<&EffectSetting> = lacking.iter().filter(|s| is_drift(s.effect)).collect();
        let tries: Vec<(usize, f64)> = drifts
            .iter()
            .enumerate()
            .flat_map(|(i, s)| s.effect.sizes_to_try().iter().map(move |size| (i, *size)))
            .collect();
        let values = map(self.workers, tries.len(), |k| {
            let (i, size) = tries[k];
            self.with_random_walk(problems, &point.added, drifts[i], size, &point.noise)
                - point.log_likelihood
        });
        let of = |i: usize| tries.iter().zip(&values).filter(move |(t, _)| t.0 == i);
        (0..drifts.len())
            .filter_map(|i| {
                let (best, top) = of(i).max_by(|a, b| a.1.total_cmp(b.1)).map(|(t, v)| (t.1, *v))?;
                let evidence = log_mean_exp(of(i).map(|o| *o.1));
                let setting = EffectSetting { values: vec![best], ..drifts[i].clone() };
                Some(Candidate { setting, prior: vec![(best, 0.0)], evidence, cost: top - evidence })
            })
            .collect()
    }

    /// Log-likelihood with these effects when the biases also walk like this.
    pub(in crate::identify) fn with_random_walk(
        &self,
        problems: &[Problem],
        added: &[Added],
        drift: &EffectSetting,
        size: f64,
        noise: &Noise,
    ) -> f64 {
        let walk = self.walk(added).and(drift.effect.bias_walk(&[size]));
        problems.iter().map(|p| p.run_walking(walk, noise, &self.settings.options).log_likelihood[0]).sum()
    }

    /// Effects without parameters: there or not.
    pub(in crate::identify) fn discrete(&self, lacking: &[EffectSetting], point: &Point) -> Vec<Candidate> {
        let model = self.model(&point.added);
        let tries: Vec<&EffectSetting> = lacking
            .iter()
            .filter(|s| s.effect.is_empty())
            .filter(|s| {
                !s.effect.truncates_samples() || !self.truncates_already(&model) && self.has_whole_counts()
            })
            .collect();
        map(self.workers, tries.len(), |k| {
            let mut added = point.added.clone();
            added.push(Added { setting: tries[k].clone(), prior: Vec::new() });
            let (with, _) = self.settle(&added, &point.noise, point, 0);
            let evidence = with.evidence - point.evidence;
            Candidate { setting: tries[k].clone(), prior: Vec::new(), evidence, cost: 0.0 }
        })
    }

    /// Faults of the source. What they do is gross, so the trajectory is found anew for each, without what was added.
    fn mistakes(&self, point: &Point, wanted: &dyn Fn(&dyn Effect) -> bool, gross: bool) -> Vec<Candidate> {
        let shows = |m: &dyn Effect| self.flights.iter().any(|f| m.shows_in(f.reported()));
        let lacking: Vec<&'static dyn Effect> = MISTAKES
            .iter()
            .filter(|m| self.base.get(m.name()).is_none() && wanted(**m))
            .filter(|m| point.added.iter().all(|a| a.setting.effect.name() != m.name()))
            .filter(|m| (gross || m.needs_neighbours()) && shows(**m))
            .copied()
            .collect();
        map(self.workers, lacking.len(), |k| {
            let setting = EffectSetting { effect: lacking[k], values: Vec::new(), sigmas: Vec::new() };
            let mut added = point.added.clone();
            added.push(Added { setting: setting.clone(), prior: Vec::new() });
            let (with, _) = self.settle_anew(&added, &point.noise);
            // Each is one of many, and all together are as likely as one effect of the table.
            let cost = ln(MISTAKES.len() as f64);
            Candidate { setting, prior: Vec::new(), evidence: with.evidence - point.evidence - cost, cost }
        })
    }

    /// Whether this effect is what the source says of its samples.
    pub(in crate::identify) fn assumes_truncation(&self, effect: &dyn Effect) -> bool {
        effect.truncates_samples() && self.truncates_already(&self.base)
    }

    /// Whether the samples of all flights are counts that something may have truncated.
    pub(in crate::identify) fn has_whole_counts(&self) -> bool {
        self.flights.iter().all(|f| f.has_whole_counts())
    }

    fn truncates_already(&self, model: &Model) -> bool {
        self.flights.iter().all(
            |f| matches!(model.quantisation_of(f.stream()), Quantisation::Truncate(s) if s == Steps::RAW_IMU),
        )
    }
}

/// What one run over the flights shows, at a point, of effects that it lacks.
pub(in crate::identify) struct Glance<'p> {
    added: &'p [Added],
    lacking: Vec<EffectSetting>,
    watched: Watched,
    information: Information,
    /// The same with a part of each drift, and how much likelier the flights are so.
    slower: Vec<(f64, Information)>,
}

impl Glance<'_> {
    /// Each of them beside all those of the point; of its drifts that may be a part.
    pub(in crate::identify) fn beside(&self) -> Vec<Candidate> {
        let old = self.columns(None);
        let Some(own) = fit(&self.information, &old) else { return Vec::new() };
        let slower = self.slower.iter().filter_map(|(more, information)| {
            Some((more + fit(information, &old)?.evidence - own.evidence, information))
        });
        let ways: Vec<(f64, &Information)> =
            std::iter::once((0.0, &self.information)).chain(slower).collect();
        let best = |setting| {
            let beside = ways.iter().filter_map(|(more, information)| {
                let found = self.candidate(setting, information, &old)?;
                Some(Candidate { evidence: found.evidence + more, ..found })
            });
            beside.max_by(|a, b| a.evidence.total_cmp(&b.evidence))
        };
        self.lacking.iter().filter_map(best).collect()
    }

    /// Each of them in the place of effect number `k` of the point, and the evidence that this one has there itself; `None` where that is more than
    /// a linear model can say.
    pub(in crate::identify) fn instead_of(&self, k: usize) -> Option<(f64, Vec<Candidate>)> {
        let own = loss(&self.information, self.added, &self.watched, k)?;
        let (held, old) = self.without(k);
        Some((own, self.lacking.iter().filter_map(|s| self.candidate(s, &held, &old)).collect()))
    }

    /// The two of them that are likeliest together in the place of effect number `k` of the point, of which one is among the likeliest alone, and by how
    /// much they are likelier than that, nats.
    pub(super) fn two_instead_of(&self, k: usize) -> Option<([Candidate; 2], f64)> {
        let (own, mut alone) = self.instead_of(k)?;
        alone.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        alone.truncate(PAIRED);
        let (held, others) = self.without(k);
        let pairs = alone.into_iter().filter_map(|first| {
            let old = [others.as_slice(), &self.columns_of(&first)].concat();
            let second = self
                .lacking
                .iter()
                .filter(|s| s.effect.name() != first.setting.effect.name())
                .filter_map(|s| self.candidate(s, &held, &old))
                .max_by(|a, b| a.evidence.total_cmp(&b.evidence))?;
            let more = first.evidence + second.evidence - own;
            Some(([first, second], more))
        });
        pairs.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The information where effect number `k` of the point does nothing, and the columns of the others.
    fn without(&self, k: usize) -> (Information, Vec<Column>) {
        (at_nothing(&self.information, self.added, &self.watched, k).0, self.columns(Some(k)))
    }

    /// The columns of the point's effects, but for `gone`.
    fn columns(&self, gone: Option<usize>) -> Vec<Column> {
        let slots = self.watched.slots();
        let mut columns = open(self.added, &self.watched);
        columns.retain(|c| Some(slots[c.at].0) != gone);
        columns
    }

    /// Those of an effect that the point lacks, with its prior.
    fn columns_of(&self, found: &Candidate) -> Vec<Column> {
        let name = found.setting.effect.name();
        let own = self.watched.slots().into_iter().enumerate();
        let own = own.filter(|(_, slot)| self.watched.effects[slot.0].effect.name() == name);
        own.map(|(at, slot)| Column { at, sigma: found.prior[slot.1].1, offset: 0.0 }).collect()
    }

    /// An effect beside those whose columns these are, by information about a point where all others do nothing.
    fn candidate(
        &self,
        setting: &EffectSetting,
        information: &Information,
        old: &[Column],
    ) -> Option<Candidate> {
        let slots = self.watched.slots();
        let index = self.watched.effects.iter().position(|s| s.effect.name() == setting.effect.name())?;
        let new: Vec<usize> = (0..slots.len()).filter(|k| slots[*k].0 == index).collect();
        let own = prior_sigmas(setting.effect);
        let without = fit(information, old)?;
        let fits: Vec<(f64, Fit)> = SCALES
            .iter()
            .filter_map(|scale| {
                let new = new.iter().map(|k| Column { at: *k, sigma: own[slots[*k].1] * scale, offset: 0.0 });
                let all: Vec<Column> = old.iter().copied().chain(new).collect();
                fit(information, &all).map(|f| (*scale, f))
            })
            .collect();
        let evidence = log_mean_exp(fits.iter().map(|f| f.1.evidence)) - without.evidence;
        let (scale, best) = fits.into_iter().max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence))?;
        let mut found = setting.clone();
        let prior = setting.values.iter().zip(&own).map(|(v, s)| (*v, s * scale)).collect();
        for (i, k) in new.iter().enumerate() {
            found.values[slots[*k].1] += best.step[old.len() + i];
        }
        let evidence = evidence - setting.effect.prior_cost();
        let cost = best.evidence - without.evidence - evidence;
        Some(Candidate { setting: found, prior, evidence, cost })
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::Serial;
    use super::super::super::flight::Flight;
    use super::super::super::noise::Noise;
    use super::super::super::tests::{fly, fly_in_gusts};
    use super::super::{Candidate, Search, Settings};
    use super::Glance;
    use crate::earth::Geodetic;
    use crate::effects::{GpsLatency, data};
    use crate::model::{EffectSetting, Model};
    use crate::sample::{FixVelocity, GnssFix, Sample};
    use nalgebra::Vector3;

    /// A flight whose fixes are late by this, s.
    fn late(by_s: f64) -> Vec<Sample> {
        let mut truth = Model::default();
        truth.set(EffectSetting::known(&GpsLatency, &[by_s]).unwrap());
        fly_in_gusts(&truth, 5, 4.0)
    }

    /// What a first contest finds best, and what its evidence was at a glance.
    fn found(samples: &[Sample], base: &Model) -> (Candidate, f64) {
        let flight = Flight::prepare(samples, base).unwrap();
        let flights = [&flight];
        let measured = Noise::measured(base, &flights);
        let mut search = Search::new(&flights, base, &Settings::default(), &Serial, &measured);
        let start = search.start(&measured);
        let scanned = search.scan(&start, None);
        let glance = scanned.iter().find(|c| c.setting.effect.name() == "gps_latency").unwrap().evidence;
        let mut looks = search.close_looks(&scanned, &start, &start);
        (looks.remove(0).0, glance)
    }

    /// Where the acceleration of now is not that of a delay ago, the fixes show the delay all the same.
    #[test]
    fn a_delay_is_seen_at_a_glance_in_gusts() {
        let (best, glance) = found(&late(0.12), &Model::default());
        assert_eq!(best.setting.effect.name(), "gps_latency", "{best:?}");
        assert!((best.setting.values[0] - 0.12).abs() < 0.005, "{best:?}");
        assert!(glance > 0.3 * best.evidence, "{glance} of {}", best.evidence);
    }

    /// Each fix in its place is so much of itself and the rest of the one before, as of a receiver that interpolates between two: late by the share of
    /// their interval, 0.2 s, that the older one has.
    fn interpolated(older: f64) -> Vec<Sample> {
        let mut samples = late(0.0);
        let mut last: Option<GnssFix> = None;
        for sample in &mut samples {
            let Sample::Fix(fix) = sample else { continue };
            let own = *fix;
            let before = last.replace(own).unwrap_or(own);
            let place = own.position.to_ecef().lerp(&before.position.to_ecef(), older);
            fix.position = Geodetic::from_ecef(&place);
            let (n, b) = (own.velocity.components(), before.velocity.components());
            fix.velocity = FixVelocity::Horizontal([0, 1].map(|k| n[k] + older * (b[k] - n[k])));
        }
        samples
    }

    /// The acceleration of an instant is not what a delay moves such a velocity by, and where one of the two fixes weighs more, the middle is not
    /// the mean.
    #[test]
    fn a_delay_of_a_receiver_that_interpolates_is_found_in_gusts() {
        for older in [0.5, 0.75] {
            let (best, _) = found(&interpolated(older), &Model::default().with_receiver());
            assert_eq!(best.setting.effect.name(), "gps_latency", "{best:?}");
            assert!((best.setting.values[0] - 0.2 * older).abs() < 0.005, "{older} {best:?}");
        }
    }

    /// A drift that was named first has taken the place of what goes with the time: beside the whole of it nothing is left.
    #[test]
    fn what_a_drift_masks_is_seen_beside_a_part_of_it() {
        let base = Model::default();
        let mut samples = fly(&base, 5);
        for sample in &mut samples {
            if let Sample::Imu(imu) = sample {
                imu.gyro += Vector3::new(9.5e-5, -9.5e-5, 9.5e-5) * imu.t_s;
            }
        }
        let flight = Flight::prepare(&samples, &base).unwrap();
        let flights = [&flight];
        let measured = Noise::measured(&base, &flights);
        let mut search = Search::new(&flights, &base, &Settings::default(), &Serial, &measured);
        let start = search.start(&measured);
        let scanned = search.scan(&start, Some(&["gyro_bias_drift"]));
        let (_, point) = search.close_looks(&scanned, &start, &start).remove(0);
        let time = data::find("formula:gyro~time").unwrap();
        let lacking = [EffectSetting { sigmas: vec![0.0; 3], ..EffectSetting::unknown(time) }];
        let glance = search.glance_unmasked_at(&point, &lacking);
        let seen = glance.beside();
        let beside_a_part = seen[0].evidence;
        let beside_all = Glance { slower: Vec::new(), ..glance }.beside()[0].evidence;
        let threshold = search.settings.threshold;
        assert!(beside_all < threshold && beside_a_part > threshold, "{beside_all}, {beside_a_part}");
        let (look, _) = search.close_looks(&seen, &point, &point).remove(0);
        assert!(look.evidence > beside_a_part - 1.0, "{look:?}");
    }
}
