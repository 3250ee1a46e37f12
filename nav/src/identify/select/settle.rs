//! Values: the added effects where they fit best, about trajectories that are straight enough there.

use super::super::evidence::{self, Column};
use super::super::linear::Problem;
use super::super::linear::reference::Reference;
use super::super::map;
use super::super::noise::Noise;
use super::super::pass::Information;
use super::search::Trajectories;
use super::{Added, Point, Search};
use crate::identify::watched::Watched;
use crate::model::EffectSetting;
use std::sync::Arc;

/// Gauss-Newton steps when values are looked for.
pub(in crate::identify) const STEPS: usize = 4;
/// A trajectory that turns by less than this when it is found anew is good enough to linearise about, rad.
const STRAIGHT: f64 = 0.01;
/// One that turns by more than this was no place to linearise about: it is looked for from the start, rad.
const CROOKED: f64 = 0.1;
/// A trajectory is found anew at most so often …
const MOST_BENDS: usize = 3;
/// … and no more once the flights are as likely about it as about the one before, nats: what still turns is what no fix shows, such as
/// the heading before take-off.
const SAME_NATS: f64 = 0.1;
/// A step shorter than this share of the sigma is none …
const SMALL: f64 = 0.1;
/// … and one shorter than this is taken within the linear model, which ends the search for values.
const LINEAR: f64 = 1.0;
/// A step after which the flights are less likely was too far: it is tried again at this share …
const SHORTER: f64 = 0.3;
/// … at most so often.
const MOST_SHORTENED: usize = 2;

/// The flights linearised at some values.
struct Linearised {
    added: Vec<Added>,
    references: Trajectories,
    problems: Vec<Problem>,
}

/// These effects as what is watched.
pub(super) fn watching(added: &[Added]) -> Watched {
    Watched { effects: added.iter().map(|a| a.setting.clone()).collect() }
}

impl Search<'_> {
    /// Moves the added effects to the values that fit best and says how good that is; with the flights linearised there.
    /// Starts from the trajectories of `from`.
    pub(in crate::identify) fn settle(
        &self,
        added: &[Added],
        noise: &Noise,
        from: &Point,
        steps: usize,
    ) -> (Point, Vec<Problem>) {
        let settled = self.climb(self.linearised(added.to_vec(), &from.references), noise, steps);
        self.straighten(settled, noise, steps)
    }

    /// The same with other noise, from flights that are linearised at a point already. Only what is no state (the size of a
    /// drift) may differ from it.
    pub(super) fn settle_again(
        &self,
        added: &[Added],
        noise: &Noise,
        at: &Point,
        mut problems: Vec<Problem>,
    ) -> (Point, Vec<Problem>) {
        let walk = self.walk(added);
        problems.iter_mut().for_each(|p| p.set_walk(walk));
        let at = Linearised { added: added.to_vec(), references: at.references.clone(), problems };
        self.straighten(self.climb(at, noise, STEPS), noise, STEPS)
    }

    /// The same from trajectories that are found with these effects.
    pub(super) fn settle_anew(&self, added: &[Added], noise: &Noise) -> (Point, Vec<Problem>) {
        let references = Arc::new(self.trajectories(&self.model(added), noise));
        self.climb(self.linearised(added.to_vec(), &references), noise, 0)
    }

    fn linearised(&self, added: Vec<Added>, references: &Trajectories) -> Linearised {
        let (references, problems) = self.linearise(references, &self.model(&added), &watching(&added));
        Linearised { added, references, problems }
    }

    /// Linearises anew about the trajectories that a point shows, as long as they turn.
    fn straighten(
        &self,
        mut settled: (Point, Vec<Problem>),
        noise: &Noise,
        steps: usize,
    ) -> (Point, Vec<Problem>) {
        for turn in 0..MOST_BENDS {
            let better = self.smoothed(&settled.0, &settled.1);
            let bends = better.iter().zip(settled.0.references.iter()).map(|(b, r)| b.bend(r));
            let bend = bends.fold(0.0, f64::max);
            if bend <= STRAIGHT {
                break;
            }
            let before = settled.0.log_likelihood;
            let from = if bend > CROOKED {
                let Some(anew) = self.linearised_anew(&settled.0, better, turn == 0) else { break };
                anew
            } else {
                let (point, problems) = settled;
                drop(problems);
                self.linearised(point.added, &Arc::new(better))
            };
            settled = self.climb(from, noise, steps);
            if bend <= CROOKED && (settled.0.log_likelihood - before).abs() < SAME_NATS {
                break;
            }
        }
        settled
    }

    /// The trajectories that the flights show as they were linearised at a point.
    fn smoothed(&self, point: &Point, problems: &[Problem]) -> Vec<Reference> {
        map(self.workers, problems.len(), |k| point.references[k].smoothed(&problems[k], &point.noise))
    }

    /// The flights linearised at a point whose trajectories turn far: about those that are found from the start and, where
    /// that is not the `first` attempt or leads to the same ones again, about the smoothed ones if they are likelier. `None` where
    /// the same ones stay the likeliest: what turns is what no fix shows.
    fn linearised_anew(&self, point: &Point, smoothed: Vec<Reference>, first: bool) -> Option<Linearised> {
        let about = |references| self.linearised(point.added.clone(), &Arc::new(references));
        let likelihood = |l: &Linearised| self.part_likelihood(&l.problems, &point.noise, 0);
        let anew = self.trajectories(&self.model(&point.added), &point.noise);
        let same = anew.iter().zip(point.references.iter()).all(|(a, b)| a.bend(b) <= STRAIGHT);
        if same {
            return Some(about(smoothed)).filter(|s| likelihood(s) > point.log_likelihood + SAME_NATS);
        }
        let anew = about(anew);
        if first {
            return Some(anew);
        }
        let smoothed = about(smoothed);
        Some(if likelihood(&anew) > likelihood(&smoothed) { anew } else { smoothed })
    }

    fn climb(&self, from: Linearised, noise: &Noise, steps: usize) -> (Point, Vec<Problem>) {
        let mut at = from;
        let mut best: Option<Reached> = None;
        let (mut taken, mut shortened) = (0, 0);
        while let Some(fitted) = self.fit_values(&mut at, noise) {
            let Fitted { fit, watched, evidence, log_likelihood, height } = fitted;
            // A step too far is taken again, shorter. The evidence says nothing of that: the volume of the posterior is
            // part of it, and changes from place to place.
            if let Some(best) = best.as_mut().filter(|b| height <= b.height) {
                if shortened == MOST_SHORTENED || best.step.reach * SHORTER < SMALL {
                    break;
                }
                shortened += 1;
                best.step.shorten();
                at = self.linearised(best.step.from(&best.point.added), &best.point.references);
                continue;
            }
            let Linearised { added, references, mut problems } = at;
            let step = Step::new(&fit, &watched, &added);
            let mut point = Point { added, noise: *noise, evidence, log_likelihood, references };
            if taken == steps || step.reach < SMALL {
                return (point, problems);
            }
            let next = step.from(&point.added);
            if step.reach < LINEAR {
                problems.iter_mut().for_each(|p| p.move_by(&step.by));
                (point.added, point.log_likelihood) = (next, log_likelihood + fit.gain);
                return (point, problems);
            }
            taken += 1;
            // Linearised flights are large: those of the best values are made again where no step leads on from them.
            drop(problems);
            at = self.linearised(next, &point.references);
            best = Some(Reached { point, step, height });
        }
        // Where not even the first is a maximum, the flights stay linearised as they are, and nothing speaks for it.
        match best {
            Some(Reached { point, .. }) => {
                drop(at);
                let again = self.linearised(point.added.clone(), &point.references);
                (point, again.problems)
            }
            None => {
                let Linearised { added, references, problems } = at;
                (Point { added, references, ..self.empty(noise) }, problems)
            }
        }
    }

    /// The fit of the linear model at some values; `None` where they are no place for a maximum.
    fn fit_values(&self, at: &mut Linearised, noise: &Noise) -> Option<Fitted> {
        let watched = watching(&at.added);
        let (log_likelihood, [mut information, _]) = self.run(&at.problems, noise);
        let of_unit = self.correlate(&at.added, &watched, &mut information);
        let fit = fit_added(&information, &watched, &mut at.added)?;
        let of_samples = self.evidence_of_samples(&at.added);
        let evidence = log_likelihood + fit.evidence + of_samples + of_unit;
        let height = log_likelihood + fit.imitated + of_samples + of_unit + log_prior(&at.added, &watched);
        Some(Fitted { fit, watched, evidence, log_likelihood, height })
    }
}

/// What the linear model says at some values.
struct Fitted {
    fit: evidence::Fit,
    watched: Watched,
    evidence: f64,
    log_likelihood: f64,
    /// Logarithm of the posterior density at these very values, but for a constant: what the steps climb.
    height: f64,
}

/// The best values so far, and the step that leads on from them.
struct Reached {
    point: Point,
    step: Step,
    height: f64,
}

/// The columns of the watched parameters of these effects, which are watched before all others, whose prior lets them move.
pub(in crate::identify) fn open(added: &[Added], watched: &Watched) -> Vec<Column> {
    let own =
        |(e, p): (usize, usize)| added.get(e).map(|a| (a.prior[p].1, a.prior[p].0 - a.setting.values[p]));
    Column::open(watched.slots().into_iter().map_while(own))
}

/// Logarithm of the prior density at the present values, but for a constant.
fn log_prior(added: &[Added], watched: &Watched) -> f64 {
    -0.5 * open(added, watched).iter().map(|c| (c.offset / c.sigma).powi(2)).sum::<f64>()
}

/// Evidence that goes when an effect goes, by score and information about values close to the best: its parameters are held
/// where they do nothing. `None` for an effect with anything that is no state.
pub(super) fn loss(
    information: &Information,
    added: &[Added],
    watched: &Watched,
    effect: usize,
) -> Option<f64> {
    let gone = &added[effect].setting;
    if gone.effect.is_empty() || !gone.effect.groups().iter().all(|g| g.is_state()) {
        return None;
    }
    let (mut columns, slots) = (open(added, watched), watched.slots());
    let with = evidence::fit(information, &columns)?;
    columns.retain(|c| slots[c.at].0 != effect);
    let (held, moved) = at_nothing(information, added, watched, effect);
    let without = evidence::fit(&held, &columns)?;
    Some(with.evidence - without.evidence - moved)
}

/// Score and information with the parameters of an effect back where the prior is centred (for an effect that was found: at nothing), and what that
/// gains of the log-likelihood.
pub(super) fn at_nothing(
    information: &Information,
    added: &[Added],
    watched: &Watched,
    effect: usize,
) -> (Information, f64) {
    let slots = watched.slots();
    let mut held = information.clone();
    let mut moved = 0.0;
    for Column { at: k, offset: by, .. } in open(added, watched) {
        if slots[k].0 != effect {
            continue;
        }
        moved += by * held.score[k] - 0.5 * by * by * held.matrix[(k, k)];
        for j in 0..held.score.len() {
            held.score[j] -= by * information.matrix[(j, k)];
        }
    }
    (held, moved)
}

fn fit_added(information: &Information, watched: &Watched, added: &mut [Added]) -> Option<evidence::Fit> {
    let columns = open(added, watched);
    let fit = evidence::fit(information, &columns)?;
    let slots = watched.slots();
    for (i, column) in columns.iter().enumerate() {
        let (e, p) = slots[column.at];
        set(&mut added[e].setting, p, fit.covariance[(i, i)]);
    }
    Some(fit)
}

fn set(setting: &mut EffectSetting, parameter: usize, variance: f64) {
    setting.sigmas[parameter] = variance.max(0.0).sqrt();
}

/// The way from the present values to those that fit best.
struct Step {
    /// By watched parameter.
    by: Vec<f64>,
    slots: Vec<(usize, usize)>,
    /// The longest of them, in sigmas.
    reach: f64,
}

impl Step {
    fn new(fit: &evidence::Fit, watched: &Watched, added: &[Added]) -> Self {
        let slots = watched.slots();
        let mut by = vec![0.0; slots.len()];
        open(added, watched).iter().zip(fit.step.iter()).for_each(|(c, step)| by[c.at] = *step);
        let sigmas = slots.iter().map(|(e, p)| added[*e].setting.sigmas[*p]);
        let reach = by.iter().zip(sigmas).filter(|(by, _)| **by != 0.0).map(|(by, sigma)| by.abs() / sigma);
        Self { reach: reach.fold(0.0, f64::max), by, slots }
    }

    /// The values that it leads to.
    fn from(&self, added: &[Added]) -> Vec<Added> {
        let mut added = added.to_vec();
        for ((e, p), by) in self.slots.iter().zip(&self.by) {
            added[*e].setting.values[*p] += by;
        }
        added
    }

    fn shorten(&mut self) {
        self.by.iter_mut().for_each(|by| *by *= SHORTER);
        self.reach *= SHORTER;
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::flight::Flight;
    use super::super::super::{Serial, tests::fly};
    use super::super::{Settings, prior_sigmas};
    use super::*;
    use crate::effects::{GpsLeverArm, GpsSmoothing};
    use crate::model::Model;
    use crate::rotation::c_nb_from_euler;
    use crate::sample::{FixVelocity, Sample};
    use nalgebra::Vector3;

    /// The fixes of a flight as an antenna at `arm` would give them.
    fn with_antenna_at(arm: Vector3<f64>, samples: Vec<Sample>) -> Vec<Sample> {
        let (mut c_nb, mut rate) = (nalgebra::Matrix3::identity(), Vector3::zeros());
        let mut moved = samples;
        for sample in &mut moved {
            match sample {
                Sample::Imu(imu) => rate = imu.gyro,
                Sample::Attitude(hint) => {
                    let [roll, pitch, yaw] = hint.roll_pitch_yaw;
                    c_nb = c_nb_from_euler(roll, pitch, yaw);
                }
                Sample::Fix(fix) => {
                    let place = fix.position.to_ecef() + fix.position.c_en() * (c_nb * arm);
                    fix.position = crate::earth::Geodetic::from_ecef(&place);
                    let by = c_nb * rate.cross(&arm);
                    if let FixVelocity::Horizontal([n, e]) = &mut fix.velocity {
                        (*n, *e) = (*n + by.x, *e + by.y);
                    }
                }
                _ => {}
            }
        }
        moved
    }

    /// The further out the antenna, the better the flight shows how the receiver smooths: the volume of the posterior
    /// shrinks on the way to the maximum, and the evidence with it. Values must get there all the same.
    #[test]
    fn values_reach_the_maximum_though_the_evidence_falls_on_the_way() {
        let mut base = Model::default();
        base.set(EffectSetting::unknown(&GpsSmoothing));
        let settings = Settings::default();
        let samples = with_antenna_at(Vector3::new(12.0, 7.0, -10.0), fly(&Model::default(), 5));
        let flight = Flight::prepare(&samples, &base).unwrap();
        let flights = [&flight];
        let measured = Noise::measured(&base, &flights);
        let search = Search::new(&flights, &base, &settings, &Serial, &measured);
        let own = EffectSetting { sigmas: vec![0.0; 3], ..EffectSetting::unknown(&GpsLeverArm) };
        let prior = own.values.iter().copied().zip(prior_sigmas(&GpsLeverArm)).collect();
        let mut all = search.given.clone();
        all.push(Added { setting: own, prior });
        let (point, _) = search.settle(&all, &measured, &search.empty(&measured), STEPS);
        let (references, added) = (point.references.clone(), point.added.clone());
        let mut there = search.linearised(added, &references);
        let fitted = search.fit_values(&mut there, &measured).unwrap();
        let left = Step::new(&fitted.fit, &fitted.watched, &there.added);
        // A step that leads downhill is given up where its shorter form would be none.
        assert!(left.reach < SMALL / SHORTER, "{} sigmas from the maximum: {:?}", left.reach, point.added);
    }
}
