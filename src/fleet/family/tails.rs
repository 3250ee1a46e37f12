//! Tails of distributions, for tests of significance.

use gaware_nav::math::{atan, cbrt, exp, sin_cos};

/// The probability that Student's t with this many degrees of freedom is beyond `t` on either side (Abramowitz & Stegun 26.7.3, 26.7.4: exact
/// for whole numbers of degrees).
pub fn student(t: f64, freedom: usize) -> f64 {
    if freedom == 0 || !t.is_finite() {
        return if t.is_infinite() && freedom > 0 { 0.0 } else { 1.0 };
    }
    // The series are long, and the normal distribution is close by then.
    if freedom > 400 {
        return normal(t);
    }
    let theta = atan(t.abs() / (freedom as f64).sqrt());
    let (sin, cos) = sin_cos(theta);
    let odd = freedom % 2 == 1;
    // cos θ + 2/3 cos³θ + … up to cos^(ν−2), or 1 + 1/2 cos²θ + … likewise.
    let mut term = if odd { cos } else { 1.0 };
    let mut sum = if freedom == 1 { 0.0 } else { term };
    for k in (if odd { 3 } else { 2 }..=freedom.saturating_sub(2)).step_by(2) {
        term *= cos * cos * (k as f64 - 1.0) / k as f64;
        sum += term;
    }
    let inside = if odd { std::f64::consts::FRAC_2_PI * (theta + sin * sum) } else { sin * sum };
    (1.0 - inside).clamp(0.0, 1.0)
}

/// The probability that a normal variable is beyond `z` on either side: erfc by Chebyshev fit (Press et al., Numerical Recipes, 6.2; relative error
/// below 1.2e-7).
pub fn normal(z: f64) -> f64 {
    const C: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * x);
    let polynomial = C.iter().rev().fold(0.0, |sum, c| sum * t + c);
    (t * exp(-x * x + polynomial)).clamp(0.0, 1.0)
}

/// The probability that χ² with this many degrees of freedom is larger than `chi2` (Wilson & Hilferty 1931).
pub fn chi2_above(chi2: f64, freedom: usize) -> f64 {
    if freedom == 0 {
        return 1.0;
    }
    let k = 2.0 / (9.0 * freedom as f64);
    let z = (cbrt(chi2 / freedom as f64) - (1.0 - k)) / k.sqrt();
    let beyond = 0.5 * normal(z);
    if z > 0.0 { beyond } else { 1.0 - beyond }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_tables() {
        // Two-sided 5 % and 1 % points of t; 5 % points of the normal distribution and of χ².
        for (freedom, t05, t01) in [
            (1, 12.706, 63.657),
            (2, 4.303, 9.925),
            (3, 3.182, 5.841),
            (4, 2.776, 4.604),
            (5, 2.571, 4.032),
            (10, 2.228, 3.169),
            (11, 2.201, 3.106),
            (120, 1.980, 2.617),
        ] {
            assert!((student(t05, freedom) - 0.05).abs() < 1e-4, "{freedom}: {}", student(t05, freedom));
            assert!((student(-t01, freedom) - 0.01).abs() < 1e-4, "{freedom}: {}", student(t01, freedom));
        }
        assert!((normal(1.959_964) - 0.05).abs() < 1e-6);
        assert!((normal(5.0) / 5.733e-7 - 1.0).abs() < 1e-3);
        for (freedom, chi2) in [(5, 11.07), (10, 18.307), (15, 24.996)] {
            assert!((chi2_above(chi2, freedom) - 0.05).abs() < 1e-3);
        }
    }
}
