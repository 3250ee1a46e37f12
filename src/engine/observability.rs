//! The three views of observability together, and where they disagree.

use super::estimate::Constants;
use super::snapshot::{Condition, Conditions, Direction, Observability, StateStatus, Status};
use gaware_nav::earth::rotation_rate;
use gaware_nav::estimator::Estimator;
use gaware_nav::filter::Filter;
use gaware_nav::filter::calibration::MotionJacobian;
use gaware_nav::filter::layout::{StateName, index};
use gaware_nav::observability::conditions::{ConditionSettings, ConditionStatus, PathConditions};
use gaware_nav::observability::covariance::{self, Knowledge, Targets};
use gaware_nav::observability::gramian;
use gaware_nav::observability::segments::{PathSegment, SegmentSample};
use gaware_nav::observability::words::{VehicleKind, describe};
use gaware_nav::sample::ImuSample;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// The uncertainty of the corrected rate is judged anew after so long, s: it changes slowly.
const RATE_SIGMA_EVERY_S: f64 = 0.5;

/// Watches the corrected samples of a flight for the paper's conditions.
#[derive(Debug, Clone)]
pub struct ConditionWatch {
    targets: Targets,
    conditions: Option<PathConditions>,
    last_s: Option<f64>,
    rate_sigma: f64,
    judged_s: f64,
    jacobian: MotionJacobian,
}

impl ConditionWatch {
    /// For these targets.
    pub fn new(targets: Targets) -> Self {
        Self {
            targets,
            conditions: None,
            last_s: None,
            rate_sigma: 0.0,
            judged_s: f64::NEG_INFINITY,
            jacobian: MotionJacobian::default(),
        }
    }

    /// Takes the newest sample of an estimator; nothing happens while it has no filter, as bias and G are not known.
    pub fn push(&mut self, estimator: &Estimator) {
        let (Some(filter), Some(sample)) = (estimator.filter(), estimator.last_sample()) else { return };
        let Some(last) = self.last_s.replace(sample.t_s) else { return };
        let motion = filter.calibration().motion(filter.model(), sample);
        if sample.t_s - self.judged_s >= RATE_SIGMA_EVERY_S {
            self.judged_s = sample.t_s;
            self.rate_sigma = self.sigma_of_rate(filter, sample);
        }
        let x = SegmentSample {
            t_s: sample.t_s,
            dt_s: sample.t_s - last,
            rate: motion.rate - filter.nav().q_eb.inverse() * rotation_rate(),
            rate_sigma: self.rate_sigma,
            force: motion.force,
        };
        if self.conditions.is_none() {
            let (rounding, _) = estimator.rounding_noise();
            let noise = (estimator.model().imu.gyro_noise.powi(2) + rounding).sqrt();
            self.conditions = Some(PathConditions::new(Self::settings(noise, &self.targets)));
        }
        self.push_motion(&x);
    }

    /// Watches with these conditions, whose samples are pushed as motion.
    pub fn of(targets: Targets, conditions: PathConditions) -> Self {
        Self { conditions: Some(conditions), ..Self::new(targets) }
    }

    /// Conditions for gyros of this white noise with their rounding, rad/s/√Hz, and these targets.
    pub fn settings(gyro_noise: f64, targets: &Targets) -> ConditionSettings {
        ConditionSettings { target_sigma: targets.g, ..ConditionSettings::new(gyro_noise) }
    }

    /// Takes a sample that needs no correction.
    pub fn push_motion(&mut self, x: &SegmentSample) {
        if let Some(conditions) = &mut self.conditions {
            conditions.push(x);
        }
    }

    /// The segment of constant attitude under way.
    pub fn segment(&self) -> Option<&PathSegment> {
        self.conditions.as_ref().and_then(PathConditions::segment)
    }

    /// The time base starts anew; what was shown stays shown.
    pub fn restart(&mut self) {
        if let Some(conditions) = &mut self.conditions {
            conditions.finish();
        }
        (self.last_s, self.judged_s) = (None, f64::NEG_INFINITY);
    }

    /// 1-sigma of what biases and effects leave in the corrected rate, all axes together, rad/s.
    fn sigma_of_rate(&mut self, filter: &Filter, sample: &ImuSample) -> f64 {
        let (model, layout) = (filter.model(), filter.layout());
        let motion = filter.calibration().motion(model, sample);
        filter.calibration().jacobian(model, layout, sample, &motion, &mut self.jacobian);
        let p = filter.covariance();
        let mut variance = 0.0;
        for (i, a) in self.jacobian.rate.iter().enumerate() {
            for (j, b) in self.jacobian.rate.iter().enumerate() {
                variance += a.dot(b) * p.at(index::GYRO_BIAS + i, index::GYRO_BIAS + j);
            }
        }
        variance.max(0.0).sqrt()
    }

    fn status(&self) -> Conditions {
        let Some(conditions) = &self.conditions else {
            let none = Condition {
                missing: "no corrected samples yet: the filter does not run".to_owned(),
                ..Condition::default()
            };
            return Conditions { a: none.clone(), b: none.clone(), c: none };
        };
        let of =
            |c: &ConditionStatus| Condition { met: c.met, progress: c.progress, missing: c.missing.clone() };
        let status = conditions.status();
        Conditions { a: of(&status.a), b: of(&status.b), c: of(&status.c) }
    }
}

/// The three views of a filter.
pub fn observability(
    watch: &ConditionWatch,
    filter: &Filter,
    targets: &Targets,
    vehicle: VehicleKind,
) -> Observability {
    of(watch, &Constants::of_filter(filter), Some(filter), targets, vehicle)
}

/// The three views now. `filter` is absent where nothing has been estimated yet.
pub(super) fn of(
    watch: &ConditionWatch,
    constants: &Constants,
    filter: Option<&Filter>,
    targets: &Targets,
    vehicle: VehicleKind,
) -> Observability {
    let conditions = watch.status();
    let states = states(constants, targets);
    // Tolerances are nuisances as motion is: the block of the others is their marginal covariance.
    let (sought, names): (Vec<usize>, Vec<StateName>) =
        constants.layout.names().iter().cloned().enumerate().filter(|(_, name)| !name.is_tolerance).unzip();
    let posterior = match filter {
        Some(f) => f.covariance().block(&sought.iter().map(|k| index::GYRO_BIAS + k).collect::<Vec<_>>()),
        None => DMatrix::from_diagonal(&DVector::from_iterator(
            sought.len(),
            sought.iter().map(|k| constants.sigma[*k].powi(2)),
        )),
    };
    let start: Vec<f64> = sought.iter().map(|k| constants.unmeasured[*k]).collect();
    let gramian = gramian::analyse(&posterior, &start);
    let unobservable_directions: Vec<_> = describe(&gramian, &names, vehicle)
        .into_iter()
        .map(|d| Direction {
            states: d.states.into_iter().map(|(name, w)| (name.to_owned(), w)).collect::<BTreeMap<_, _>>(),
            text: d.text,
        })
        .collect();
    let disagreement = disagreement(&conditions, &states, &unobservable_directions);
    Observability {
        conditions,
        states,
        unobservable_directions,
        disagreement,
        gramian_rank: gramian.rank,
        gramian_states: names.len(),
    }
}

fn states(constants: &Constants, targets: &Targets) -> Vec<StateStatus> {
    let names = constants.layout.names().iter();
    names
        .zip(&constants.sigma)
        .zip(&constants.unmeasured)
        .filter(|((name, _), _)| !name.is_tolerance)
        .map(|((name, sigma), start)| {
            let k = covariance::judge(name, *sigma, *start, targets);
            StateStatus {
                name: k.name.to_owned(),
                status: match k.knowledge {
                    Knowledge::Unobservable => Status::Unobservable,
                    Knowledge::Weak => Status::Weak,
                    Knowledge::Converging => Status::Converging,
                    Knowledge::Observable => Status::Observable,
                },
                sigma_ratio: k.ratio,
                sigma: k.sigma / k.unit.si,
                target: k.target / k.unit.si,
                unit: k.unit.symbol.to_owned(),
            }
        })
        .collect()
}

/// Which view is stricter and why; empty where all three say the same.
fn disagreement(conditions: &Conditions, states: &[StateStatus], unobservable: &[Direction]) -> String {
    let is_g = |s: &&StateStatus| s.name.starts_with('g') && s.unit == "deg/h/g";
    let g: Vec<&StateStatus> = states.iter().filter(is_g).collect();
    let lacking = |of: &dyn Fn(&str) -> bool| -> Vec<&str> {
        let not = g.iter().filter(|s| s.status != Status::Observable);
        not.map(|s| s.name.as_str()).filter(|n| of(n)).collect()
    };
    let diagonal = |n: &str| matches!(n, "g11" | "g22" | "g33");
    let full = g.len() > 3;
    let mut said = Vec::new();
    let pairs = [
        (full, "c", &conditions.c, "G", lacking(&|_| true)),
        (!g.is_empty(), "b", &conditions.b, "the diagonal of G", lacking(&diagonal)),
    ];
    for (_, name, condition, what, lacking) in pairs.into_iter().filter(|p| p.0) {
        if !condition.met && lacking.is_empty() {
            said.push(format!(
                "{what} is observable by its covariance although condition ({name}) is not met: the condition is \
                 stricter, it counts changes of specific force at constant attitude alone and is sufficient, not \
                 necessary; fixes in turns have made {what} observable too"
            ));
        } else if condition.met && !lacking.is_empty() {
            said.push(format!(
                "condition ({name}) is met but {} not yet below target: the covariance is stricter, it also counts \
                 noise and all that is estimated together with {what}",
                lacking.join(", ")
            ));
            break;
        }
    }
    let tied: Vec<&str> = states
        .iter()
        .filter(|s| {
            s.status == Status::Observable && unobservable.iter().any(|d| d.states.contains_key(&s.name))
        })
        .map(|s| s.name.as_str())
        .collect();
    if !tied.is_empty() {
        said.push(format!(
            "{} reached the target but not free of others: the directions are stricter, they ask for every combination",
            tied.join(", ")
        ));
    }
    said.join(". ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(name: &str, status: Status) -> StateStatus {
        StateStatus { name: name.to_owned(), status, unit: "deg/h/g".to_owned(), ..StateStatus::default() }
    }

    fn full(status: Status) -> Vec<StateStatus> {
        ["g11", "g12", "g13", "g21", "g22", "g23", "g31", "g32", "g33"].map(|n| state(n, status)).into()
    }

    #[test]
    fn turns_that_showed_g_are_given_as_the_reason() {
        let said = disagreement(&Conditions::default(), &full(Status::Observable), &[]);
        assert!(said.contains("condition (c) is not met") && said.contains("turns"), "{said}");
        assert_eq!(disagreement(&Conditions::default(), &full(Status::Weak), &[]), "");
    }

    #[test]
    fn a_condition_met_too_early_names_the_states_that_lag() {
        let mut states = full(Status::Observable);
        states[4].status = Status::Converging;
        let met = Condition { met: true, ..Condition::default() };
        let conditions = Conditions { c: met.clone(), b: met, ..Conditions::default() };
        let said = disagreement(&conditions, &states, &[]);
        assert!(said.contains("(c) is met but g22 not yet") && !said.contains("(b)"), "{said}");
    }
}
