//! What the file of the unit says of several constants together.
//!
//! Fits take a prior sigma for each parameter by itself. What a joint covariance C says beyond those, C⁻¹ − diag(C)⁻¹, counts like a measurement: its
//! information and its score at the point of linearisation are added to those of the flights.

use super::Added;
use crate::identify::pass::Information;
use crate::identify::watched::Watched;
use crate::model::JointPrior;
use nalgebra::{DMatrix, DVector};

/// A prior sigma that differs by more from that of the joint covariance is another prior.
const SAME: f64 = 0.01;

/// Adds it to the information of the watched parameters, and gives its logarithm at these values.
pub(super) fn correlate(
    joint: Option<&JointPrior>,
    added: &[Added],
    watched: &Watched,
    information: &mut Information,
) -> f64 {
    let Some(joint) = joint else { return 0.0 };
    let mut own = Vec::new();
    for (column, (e, p)) in watched.slots().into_iter().enumerate() {
        let Some(effect) = added.get(e) else { continue };
        let (Some((name, _)), (mean, sigma)) = (effect.setting.parameters().nth(p), effect.prior[p]) else {
            continue;
        };
        let at = joint.names.iter().position(|n| n == name);
        if let Some(at) = at.filter(|k| (joint.covariance_si[*k][*k].sqrt() / sigma - 1.0).abs() < SAME) {
            own.push((column, at, joint.covariance_si[at][at].sqrt(), mean - effect.setting.values[p]));
        }
    }
    let n = own.len();
    let correlation =
        DMatrix::from_fn(n, n, |i, j| joint.covariance_si[own[i].1][own[j].1] / (own[i].2 * own[j].2));
    let Some(inverse) = correlation.cholesky().map(|c| c.inverse()) else { return 0.0 };
    let beyond = DMatrix::from_fn(n, n, |i, j| {
        (inverse[(i, j)] - f64::from(u8::from(i == j))) / (own[i].2 * own[j].2)
    });
    let offset = DVector::from_fn(n, |i, _| own[i].3);
    let score = &beyond * &offset;
    for (i, (column, ..)) in own.iter().enumerate() {
        information.score[*column] += score[i];
        for (j, (other, ..)) in own.iter().enumerate() {
            information.matrix[(*column, *other)] += beyond[(i, j)];
        }
    }
    -0.5 * offset.dot(&score)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects;
    use crate::identify::evidence::{self, Column};
    use crate::model::EffectSetting;

    /// A flight that knows one of two correlated constants tells the other as far as the file ties them: the fit is that of the textbook with the whole
    /// covariance as prior.
    #[test]
    fn a_flight_that_knows_one_constant_tells_what_the_file_ties_to_it() {
        let mut setting = EffectSetting::unknown(&effects::GYRO_SCALE_FACTOR);
        let sigmas = [4e-4, 5e-4, 3e-4];
        setting.values = vec![1e-4, -2e-4, 0.0];
        let prior: Vec<_> = [0.0; 3].into_iter().zip(sigmas).collect();
        setting.sigmas = vec![0.0; 3];
        let added = [Added { setting: setting.clone(), prior }];
        let ties = DMatrix::from_row_slice(3, 3, &[1.0, 0.95, 0.2, 0.95, 1.0, 0.1, 0.2, 0.1, 1.0]);
        let prior = DMatrix::from_fn(3, 3, |i, j| ties[(i, j)] * sigmas[i] * sigmas[j]);
        let joint = JointPrior {
            names: ["sg_z", "bg_x", "sg_x", "sg_y"].map(str::to_owned).to_vec(),
            covariance_si: vec![
                vec![prior[(2, 2)], 0.0, prior[(2, 0)], prior[(2, 1)]],
                vec![0.0, 1e-6, 0.0, 0.0],
                vec![prior[(0, 2)], 0.0, prior[(0, 0)], prior[(0, 1)]],
                vec![prior[(1, 2)], 0.0, prior[(1, 0)], prior[(1, 1)]],
            ],
            unmeasured_si: vec![3e-3; 4],
        };
        let watched = Watched { effects: vec![setting] };
        let mut information = Information::zeros(3);
        (information.matrix[(0, 0)], information.score[0]) = (1e10, 2e6);
        let flight = information.clone();
        let said = correlate(Some(&joint), &added, &watched, &mut information);
        let offset: Vec<f64> = added[0].setting.values.iter().map(|v| -v).collect();
        let columns = Column::open(sigmas.into_iter().zip(offset.iter().copied()));
        let fit = evidence::fit(&information, &columns).unwrap();
        let precision = prior.clone().try_inverse().unwrap();
        let covariance = (&precision + &flight.matrix).try_inverse().unwrap();
        let o = DVector::from_vec(offset);
        let step = &covariance * (&precision * &o + &flight.score);
        assert!((&fit.step - &step).norm() < 1e-9 * step.norm(), "{} {step}", fit.step);
        assert!((&fit.covariance - &covariance).norm() < 1e-9 * covariance.norm());
        assert!(fit.covariance[(1, 1)].sqrt() < 0.4 * sigmas[1], "the other is known through it");
        let whole = -0.5 * (o.transpose() * &precision * &o)[0];
        let own: f64 = o.iter().zip(sigmas).map(|(o, s)| -0.5 * (o / s).powi(2)).sum();
        assert!((said - (whole - own)).abs() < 1e-9 * whole.abs(), "{said} {whole} {own}");
        assert_eq!(correlate(None, &added, &watched, &mut information.clone()), 0.0);
    }

    #[test]
    fn another_prior_than_that_of_the_file_stands_alone() {
        let setting = EffectSetting::unknown(&effects::GYRO_SCALE_FACTOR);
        let added = [Added { setting: setting.clone(), prior: vec![(0.0, 1e-3); 3] }];
        let joint = JointPrior {
            names: vec!["sg_x".to_owned(), "sg_y".to_owned()],
            covariance_si: vec![vec![1e-8, 9e-9], vec![9e-9, 1e-8]],
            unmeasured_si: vec![3e-3; 2],
        };
        let watched = Watched { effects: vec![setting] };
        let mut information = Information::zeros(3);
        assert_eq!(correlate(Some(&joint), &added, &watched, &mut information), 0.0);
        assert_eq!(information, Information::zeros(3));
    }
}
