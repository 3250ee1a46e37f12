//! The third view: directions in the space of the constant states that the flight gave no information about.
//!
//! The information that fixes bring about the constants c, with motion as a nuisance that is eliminated, is
//! O = P_c⁻¹ − P_c0⁻¹: the marginal posterior information minus the prior one. For a linear system without process noise
//! that is the observability Gramian Σ ΦᵀHᵀR⁻¹HΦ of the constants (Jazwinski 1970, section 7.5; Maybeck 1979, section 5.7)
//! after the Schur complement over motion; with process noise it also counts what the noise washes away, as it should.
//! The Gramian mixes units, so it is whitened by the prior sigmas D: W = D O D. Its eigenvectors are those of the
//! normalised covariance M = D⁻¹ P_c D⁻¹, and its eigenvalues 1/μ − 1 with μ those of M (Ham & Brown 1983): μ = 1 means
//! that a direction is known as before the flight. So no inverse is needed and a singular Gramian is no special case.

use nalgebra::{DMatrix, SymmetricEigen};

/// A direction is unobservable while its sigma is above this share of the prior one (information below three priors' worth).
pub const UNOBSERVABLE_SIGMA_RATIO: f64 = 0.5;
/// A state takes part in unobservable directions if they make up this share of its remaining variance.
const TAKES_PART: f64 = 0.5;
/// … and if its own sigma is still above this share of the prior one: a trace of an unobservable state leaves a state known.
const KNOWN_SIGMA_RATIO: f64 = 0.1;
/// Weights below this share of the largest one of a direction are not named.
const NAMED_WEIGHT: f64 = 0.25;

/// One direction that the flight has left unobservable.
#[derive(Debug, Clone, PartialEq)]
pub struct UnobservableDirection {
    /// States that take part, ascending, with weights of unit norm in all, each state in units of its remaining sigma:
    /// (+0.7, −0.7) is a pair whose errors are tied with opposite signs. The first weight is positive.
    pub weights: Vec<(usize, f64)>,
}

/// The whitened Gramian of the constant states.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gramian {
    /// Eigenvalues of W, largest first: prior's worths of information.
    pub information: Vec<f64>,
    /// Directions that are not unobservable.
    pub rank: usize,
    /// A sparse basis of the unobservable subspace.
    pub unobservable: Vec<UnobservableDirection>,
}

/// From the posterior covariance of the constants and their prior sigmas, SI. Prior sigmas must be positive.
pub fn analyse(posterior: &DMatrix<f64>, prior_sigmas: &[f64]) -> Gramian {
    let n = prior_sigmas.len();
    let usable = posterior.shape() == (n, n) && posterior.iter().all(|v| v.is_finite());
    if n == 0 || !usable || prior_sigmas.iter().any(|s| s.is_nan() || *s <= 0.0) {
        return Gramian::default();
    }
    let whitened = DMatrix::from_fn(n, n, |i, j| {
        0.5 * (posterior[(i, j)] + posterior[(j, i)]) / (prior_sigmas[i] * prior_sigmas[j])
    });
    let eigen = SymmetricEigen::new(whitened.clone());
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let variance = |k: usize| eigen.eigenvalues[k].max(f64::MIN_POSITIVE);
    let unobservable: Vec<usize> = order
        .iter()
        .copied()
        .filter(|k| variance(*k) > UNOBSERVABLE_SIGMA_RATIO * UNOBSERVABLE_SIGMA_RATIO)
        .collect();
    let loadings = DMatrix::from_fn(n, unobservable.len(), |i, j| {
        if whitened[(i, i)] < KNOWN_SIGMA_RATIO * KNOWN_SIGMA_RATIO {
            return 0.0;
        }
        eigen.eigenvectors[(i, unobservable[j])]
            * (variance(unobservable[j]) / whitened[(i, i)].max(f64::MIN_POSITIVE)).sqrt()
    });
    Gramian {
        information: order.iter().map(|k| (1.0 / variance(*k) - 1.0).max(0.0)).collect(),
        rank: n - unobservable.len(),
        unobservable: sparse_basis(loadings),
    }
}

/// Eigenvectors of equal eigenvalues come in any rotation; elimination with full pivoting sorts them by state.
fn sparse_basis(mut a: DMatrix<f64>) -> Vec<UnobservableDirection> {
    let (n, k) = a.shape();
    for i in 0..n {
        if a.row(i).norm_squared() < TAKES_PART {
            a.row_mut(i).fill(0.0);
        }
    }
    let mut free: Vec<usize> = (0..k).collect();
    let mut pivots = vec![false; n];
    let mut out = Vec::new();
    while !free.is_empty() {
        let candidates = (0..n).filter(|i| !pivots[*i]).flat_map(|i| free.iter().map(move |j| (i, *j)));
        let size = |(i, j): &(usize, usize)| a[(*i, *j)].abs();
        let Some((row, column)) = candidates.max_by(|x, y| size(x).total_cmp(&size(y))) else { break };
        let pivot = a[(row, column)];
        if pivot.abs() < NAMED_WEIGHT {
            break;
        }
        let scaled = a.column(column) / pivot;
        for j in (0..k).filter(|j| *j != column) {
            let share = a[(row, j)];
            let rest = a.column(j) - &scaled * share;
            a.set_column(j, &rest);
        }
        a.set_column(column, &scaled);
        pivots[row] = true;
        free.retain(|j| *j != column);
        out.push(column);
    }
    let mut directions: Vec<_> = out.iter().filter_map(|j| named(a.column(*j).as_slice())).collect();
    directions.sort_by_key(|d| d.weights.first().map(|w| w.0));
    directions
}

fn named(column: &[f64]) -> Option<UnobservableDirection> {
    let largest = column.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let kept: Vec<(usize, f64)> =
        column.iter().copied().enumerate().filter(|(_, v)| v.abs() >= NAMED_WEIGHT * largest).collect();
    let norm = kept.iter().map(|(_, v)| v * v).sum::<f64>().sqrt();
    let scale = norm * kept.first()?.1.signum();
    (norm > 0.0)
        .then(|| UnobservableDirection { weights: kept.into_iter().map(|(i, v)| (i, v / scale)).collect() })
}

#[cfg(test)]
mod tests {
    use crate::math::powf;

    use super::*;
    use proptest::prelude::*;

    /// Posterior of prior sigmas after measurements h·c + noise of unit variance.
    fn after(prior: &[f64], rows: &[Vec<f64>]) -> DMatrix<f64> {
        let n = prior.len();
        let mut information = DMatrix::from_fn(n, n, |i, j| if i == j { prior[i].powi(-2) } else { 0.0 });
        for h in rows {
            information += DMatrix::from_fn(n, n, |i, j| h[i] * h[j]);
        }
        information.try_inverse().unwrap()
    }

    #[test]
    fn before_the_flight_every_state_is_dark_by_itself() {
        let g = analyse(&after(&[3.0, 1e-4, 20.0], &[]), &[3.0, 1e-4, 20.0]);
        assert_eq!(g.rank, 0);
        assert_eq!(
            g.unobservable.iter().map(|d| d.weights.clone()).collect::<Vec<_>>(),
            [[(0, 1.0)], [(1, 1.0)], [(2, 1.0)]]
        );
    }

    #[test]
    fn a_pair_known_as_a_sum_is_named_as_a_pair_whatever_its_units() {
        // Bias with a wide prior, g-sensitivity with a narrow one, three rows alike: stationary.
        let prior = [1800.0, 1800.0, 360.0, 360.0];
        let p = after(&prior, &[vec![1.0, 0.0, 1.0, 0.0], vec![0.0, 1.0, 0.0, 1.0]]);
        let g = analyse(&p, &prior);
        assert_eq!(g.rank, 2);
        let states: Vec<Vec<usize>> =
            g.unobservable.iter().map(|d| d.weights.iter().map(|w| w.0).collect()).collect();
        assert_eq!(states, [[0, 2], [1, 3]]);
        for direction in &g.unobservable {
            assert!((direction.weights[0].1 - 0.7).abs() < 0.05, "{direction:?}");
            assert!((direction.weights[1].1 + 0.7).abs() < 0.05, "{direction:?}");
        }
    }

    proptest! {
        /// Information never depends on the units that states are counted in, and equals that of the Gramian itself.
        #[test]
        fn eigenvalues_are_those_of_the_whitened_gramian(
            rows in prop::collection::vec(prop::collection::vec(-3.0..3.0f64, 4), 0..6),
            exponents in prop::collection::vec(-3.0..3.0f64, 4),
        ) {
            let unit: Vec<f64> = exponents.iter().map(|e| powf(10f64, *e)).collect();
            let scaled: Vec<Vec<f64>> =
                rows.iter().map(|h| h.iter().zip(&unit).map(|(h, u)| h / u).collect()).collect();
            let g = analyse(&after(&unit, &scaled), &unit);
            let direct = rows.iter().fold(DMatrix::zeros(4, 4), |s, h| {
                s + DMatrix::from_fn(4, 4, |i, j| h[i] * h[j])
            });
            let mut expected: Vec<f64> = SymmetricEigen::new(direct).eigenvalues.iter().copied().collect();
            expected.sort_by(|a, b| b.total_cmp(a));
            for (found, expected) in g.information.iter().zip(&expected) {
                prop_assert!((found - expected).abs() < 1e-6 * (1.0 + expected), "{found} {expected}");
            }
        }
    }

    #[test]
    fn nonsense_gives_nothing_instead_of_a_panic() {
        assert_eq!(analyse(&DMatrix::from_element(2, 2, f64::NAN), &[1.0, 1.0]), Gramian::default());
        assert_eq!(analyse(&DMatrix::identity(2, 2), &[1.0]), Gramian::default());
        assert_eq!(analyse(&DMatrix::identity(2, 2), &[1.0, 0.0]), Gramian::default());
    }
}
