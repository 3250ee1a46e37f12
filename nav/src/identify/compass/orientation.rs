//! Whether a compass is turned by a quarter or an eighth of a turn, or has an axis reversed: a wrong orientation parameter or driver.

use super::Instant;
use crate::effects::{COMPASS, ParameterGroup};
use crate::identify::evidence::{self, Column};
use crate::identify::pass::Information;
use crate::math::atan2;
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::f64::consts::FRAC_PI_4;

/// What attitude errors, motors and uncalibrated iron leave at an instant, T: as much as the likeliest orientation leaves, within these limits. Under a copter
/// 11 to 31 mG were left of fields that another orientation missed by 42 to 89 mG, and with 50 mG for all of them two orientations were as likely (four
/// flights of one vehicle, 2026-11-30). The least is what 1° of attitude error makes of the Earth's field.
const SIGMA_T: (f64, f64) = (8e-7, 50e-7);
/// Errors are the same for so long, s: no two instants within it count as two.
const SAME_S: f64 = 5.0;
/// Odds from which another orientation is named, nats: there are 63 others.
const THRESHOLD: f64 = 12.0;
/// Orientations that are behind the best by less than this are as possible, nats: 63 others at this distance would have 6 % of the odds. In one heading
/// several explain a field (a reversed z axis is nearly an upside-down compass turned by an eighth, where the heading is 22°).
const APART: f64 = 7.0;
/// Nothing is said of a quarter turn where our own heading is known worse than this, rad.
const WELL_KNOWN: f64 = 0.2;

/// How a compass is turned: its field is `turned` times the one that it should have.
#[derive(Debug, Clone, PartialEq)]
pub struct Orientation {
    /// A rotation, or a reflection.
    pub turned: Matrix3<f64>,
    /// Logarithm of the odds against the orientation that the autopilot has.
    pub evidence: f64,
    /// Others that this flight does not tell from it, the likeliest first.
    pub others: Vec<Matrix3<f64>>,
}

impl Orientation {
    /// Its inverse.
    pub fn undo(&self) -> Matrix3<f64> {
        self.turned.transpose()
    }

    /// Whether this flight tells it from all others.
    pub fn is_known(&self) -> bool {
        self.others.is_empty()
    }

    /// Whether an axis is reversed, which no orientation parameter undoes.
    pub fn is_reflection(&self) -> bool {
        is_reflection(&self.turned)
    }

    /// In words; of several that are possible three at most.
    pub fn words(&self) -> String {
        if self.is_known() {
            return words(&self.turned);
        }
        let possible: Vec<String> =
            std::iter::once(&self.turned).chain(&self.others).take(3).map(words).collect();
        let more = match (self.others.len() + 1).saturating_sub(possible.len()) {
            0 => String::new(),
            n => format!(", or {n} more"),
        };
        format!(
            "is mounted or read in another way than its parameters say, in which one this flight does not show: it {}{more}",
            possible.join(", or ")
        )
    }
}

fn is_reflection(turned: &Matrix3<f64>) -> bool {
    turned.determinant() < 0.0
}

/// Roll of 0 or 180° followed by a yaw in steps of 45°, deg, where it is such.
fn roll_yaw_deg(turned: &Matrix3<f64>) -> Option<(f64, f64)> {
    let upside_down = turned[(2, 2)] < 0.0;
    let yaw = atan2(turned[(1, 0)], turned[(0, 0)]);
    let again = turn(upside_down, yaw);
    let degrees = (yaw.to_degrees() + 360.0).rem_euclid(360.0).round();
    ((again - turned).norm() < 1e-6).then_some((if upside_down { 180.0 } else { 0.0 }, degrees % 360.0))
}

/// One orientation in words: how the compass is mounted against what its parameters say. The field that it shows is turned the other way.
fn words(turned: &Matrix3<f64>) -> String {
    if let Some((roll, yaw)) = roll_yaw_deg(&turned.transpose()) {
        return match (roll, yaw) {
            (0.0, yaw) => format!("is turned by {yaw:.0}° to the right (yaw {yaw:.0}°)"),
            (_, 0.0) => "is upside down (roll 180°)".to_owned(),
            (_, yaw) => format!("is upside down and turned by {yaw:.0}° (roll 180°, yaw {yaw:.0}°)"),
        };
    }
    let axis = |row: usize| {
        let k = (0..3).max_by(|a, b| turned[(row, *a)].abs().total_cmp(&turned[(row, *b)].abs()));
        let k = k.unwrap_or_default();
        format!("{}{}", if turned[(row, k)] < 0.0 { "−" } else { "" }, ["x", "y", "z"][k])
    };
    let what = if is_reflection(turned) { "has an axis reversed" } else { "is turned" };
    format!("{what}: its x, y, z are {}, {}, {} of the vehicle", axis(0), axis(1), axis(2))
}

fn turn(upside_down: bool, yaw: f64) -> Matrix3<f64> {
    let roll = if upside_down { std::f64::consts::PI } else { 0.0 };
    Rotation3::from_euler_angles(roll, 0.0, yaw).into_inner()
}

/// Steps of 45° about the vertical axis, upright and upside down, and every exchange and reversal of axes.
fn candidates() -> Vec<Matrix3<f64>> {
    let eighths = (0..16).map(|k| turn(k >= 8, f64::from(k % 8) * FRAC_PI_4));
    let mut all: Vec<Matrix3<f64>> = eighths.collect();
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    for order in orders {
        for signs in 0..8_u8 {
            let mut m = Matrix3::zeros();
            for (row, column) in order.into_iter().enumerate() {
                m[(row, column)] = if signs & (1 << row) == 0 { 1.0 } else { -1.0 };
            }
            if all.iter().all(|other| (other - m).norm() > 1e-6) {
                all.push(m);
            }
        }
    }
    all
}

/// Logarithm of the marginal likelihood of an orientation, with every effect of the compass open, and the RMS of what it leaves, T.
fn evidence_of(
    turned: &Matrix3<f64>,
    instants: &[&Instant],
    has_current: bool,
    weight: f64,
) -> Option<(f64, f64)> {
    let undo = turned.transpose();
    let prior = |g: &ParameterGroup| {
        let is_open = has_current || g.unit.suffix != "mgauss_per_a";
        std::iter::repeat_n((if is_open { g.prior_sigma } else { 0.0 }, 0.0), g.shape.len())
    };
    let priors: Vec<(f64, f64)> = COMPASS.iter().flat_map(|e| e.groups()).flat_map(prior).collect();
    let mut information = Information::zeros(priors.len());
    let mut misfit = 0.0;
    let mut columns = Vec::with_capacity(priors.len());
    for i in instants {
        let residual: Vector3<f64> = undo * i.measured - i.x.field;
        misfit += weight * residual.norm_squared();
        columns.clear();
        for effect in COMPASS {
            let mut own = vec![Vector3::zeros(); effect.len()];
            if let Some(on) = effect.on_field() {
                on.field_jacobian(&vec![0.0; own.len()], &i.x, &mut own);
            }
            columns.extend(own);
        }
        for (a, by_a) in columns.iter().enumerate() {
            information.score[a] += weight * by_a.dot(&residual);
            for (b, by_b) in columns.iter().enumerate() {
                information.matrix[(a, b)] += weight * by_a.dot(by_b);
            }
        }
    }
    let fit = evidence::fit(&information, &Column::open(priors))?;
    let left = (misfit - 2.0 * fit.gain).max(0.0) / (weight * 3.0 * instants.len().max(1) as f64);
    Some((fit.evidence - 0.5 * misfit, left.sqrt()))
}

/// The orientation that the field shows, where it is beyond chance another one than the autopilot has.
pub(super) fn find(instants: &[Option<Instant>], has_current: bool, yaw_sigma: f64) -> Option<Orientation> {
    if yaw_sigma > WELL_KNOWN {
        return None;
    }
    let all: Vec<&Instant> = instants.iter().flatten().collect();
    let (first, last) = (all.first()?.elapsed_s, all.last()?.elapsed_s);
    let independent = ((last - first) / SAME_S).max(1.0).min(all.len() as f64);
    let every = all.len().div_ceil(600).max(1);
    let thinned: Vec<&Instant> = all.iter().step_by(every).copied().collect();
    // The likeliest first, with its evidence and what it leaves.
    let ranked = |sigma: f64| {
        let weight = independent / thinned.len() as f64 / (sigma * sigma);
        let of = |turned: Matrix3<f64>| {
            let (evidence, left) = evidence_of(&turned, &thinned, has_current, weight)?;
            Some((evidence, left, turned))
        };
        let mut found: Vec<_> = candidates().into_iter().filter_map(of).collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found
    };
    let left = ranked(SIGMA_T.1).first()?.1;
    let found = ranked(left.clamp(SIGMA_T.0, SIGMA_T.1));
    let as_it_is = found.iter().find(|(.., turned)| *turned == Matrix3::identity())?.0;
    let &(best, _, turned) = found.first().filter(|best| best.0 > as_it_is + THRESHOLD)?;
    let others = found.iter().skip(1).take_while(|o| best - o.0 < APART).map(|o| o.2).collect();
    Some(Orientation { turned, evidence: best - as_it_is, others })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::FieldInstant;
    use crate::math::{cos, sin};
    use crate::rotation::c_nb_from_euler;

    /// A compass whose z axis is reversed, for two minutes in headings this far about 22°, rad, with a tenth of it as tilt.
    fn reversed(headings: f64) -> Option<Orientation> {
        let field_n = Vector3::new(212e-7, 9.5e-7, 427e-7);
        let reversed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let instant = |k: u32| {
            let t = f64::from(k) * 0.2;
            let tilt = 0.1 * headings;
            let c_nb = c_nb_from_euler(tilt * sin(t), tilt * cos(1.3 * t), 0.38 + headings * sin(0.2 * t));
            let x = FieldInstant {
                field: c_nb.transpose() * field_n,
                by_declination: c_nb.transpose() * Vector3::z().cross(&field_n),
                ..FieldInstant::default()
            };
            // What motors and attitude errors leave of it, 20 mG RMS.
            let left = Vector3::new(sin(3.1 * t), sin(4.3 * t + 1.0), sin(5.7 * t + 2.0)) * 28e-7;
            Some(Instant { elapsed_s: t, c_nb, measured: reversed * x.field + left, x })
        };
        let instants: Vec<_> = (0..600).map(instant).collect();
        find(&instants, false, 0.02)
    }

    #[test]
    fn an_orientation_is_named_alone_only_where_the_flight_shows_it() {
        let turning = reversed(3.0).unwrap();
        assert_eq!(turning.words(), "has an axis reversed: its x, y, z are x, y, −z of the vehicle");
        assert!(turning.others.is_empty());
        let hovering = reversed(0.1).unwrap();
        let z_reversed = turning.turned;
        let is_possible = hovering.turned == z_reversed || hovering.others.contains(&z_reversed);
        assert!(is_possible && !hovering.others.is_empty(), "{hovering:?}");
        assert!(hovering.words().contains("which one this flight does not show"), "{}", hovering.words());
    }
}
