//! The trajectory that the sensors beside the inertial unit are judged by: a flight linearised about the values that it gives the effects of its model.

use crate::identify::Workers;
use crate::identify::evidence::{self, Column};
use crate::identify::flight::Flight;
use crate::identify::linear::Problem;
use crate::identify::linear::reference::Reference;
use crate::identify::noise::Noise;
use crate::identify::pass::Options;
use crate::identify::watched::Watched;
use crate::model::Model;

/// A latency of .1 s is found to a few milliseconds by the first pass, and the second is linear.
const PASSES: usize = 2;

/// A linearised flight with what its model leaves open.
#[derive(Debug)]
pub struct Settled {
    pub(in crate::identify) noise: Noise,
    /// The model with the values that the flight gives it.
    pub(in crate::identify) model: Model,
    pub(in crate::identify) reference: Reference,
    pub(in crate::identify) problem: Problem,
    /// Prior sigma and prior mean less value of each watched parameter of the model; sigma 0: known.
    pub(in crate::identify) prior: Vec<(f64, f64)>,
}

impl Settled {
    /// Settles the trajectory of a flight under a model. `noise`: where it was fitted already.
    pub fn new(flight: &Flight, base: &Model, noise: Option<Noise>, workers: &dyn Workers) -> Self {
        let noise = noise.unwrap_or_else(|| Noise::measured(base, &[flight]));
        let mut model = base.clone();
        let mut settled = Self::about(flight, base, &model, noise, workers);
        for _ in 0..PASSES {
            let open = Column::open(settled.prior.iter().copied());
            if open.is_empty() {
                break;
            }
            let run = settled.problem.run(&noise, &Options::default().all());
            let Some(fit) = evidence::fit(&run.information[0], &open) else { break };
            let slots = slots(&model);
            for (column, step) in open.iter().zip(fit.step.iter()) {
                let (e, p) = slots[column.at];
                model.effects[e].values[p] += step;
            }
            settled = Self::about(flight, base, &model, noise, workers);
        }
        settled
    }

    /// How far inertial data and fixes are from agreeing along it: the mean squared normalised innovation per degree of freedom, of all fixes.
    pub fn nis_per_dof(&self) -> f64 {
        self.problem.run(&self.noise, &Options::default()).nis_per_dof(0)
    }

    fn about(flight: &Flight, base: &Model, model: &Model, noise: Noise, workers: &dyn Workers) -> Self {
        let reference = Reference::find(flight, model, &noise, workers);
        let watched = Watched { effects: model.effects.clone() };
        let problem = Problem::new(flight, model, &reference, &watched, workers);
        let prior = slots(model).into_iter().map(|(e, p)| {
            let (own, now) = (&base.effects[e], &model.effects[e]);
            (own.sigmas[p], own.values[p] - now.values[p])
        });
        let prior = prior.collect();
        Self { noise, model: model.clone(), reference, prior, problem }
    }
}

fn slots(model: &Model) -> Vec<(usize, usize)> {
    Watched { effects: model.effects.clone() }.slots()
}
