//! The error of a yaw: over the whole flight, and for a while.

use super::{BLOCK_S, Interval, residual};
use gaware_nav::math::atan2;
use gaware_nav::rotation::c_nb_from_euler;
use nalgebra::{Matrix4, Vector3, Vector4};

/// Prior of an accelerometer bias, m/s² (30 mg), and noise of a change of velocity, m/s.
const BIAS_SIGMA: f64 = 0.3;
const NOISE: f64 = 0.3;
/// An error of the yaw that is not known better is not said, deg.
const MOST_SIGMA_DEG: f64 = 10.0;
/// A yaw is judged over so long, s, in steps of half of that.
const WINDOW_S: f64 = 2.0 * BLOCK_S;
/// With fewer intervals nothing is said of a window.
const FEWEST: usize = 6;
/// An error for a while is said where it exceeds this, deg …
const OFF_DEG: f64 = 20.0;
/// … and so many of its sigmas: there are some hundred windows in an hour …
const OFF_SIGMAS: f64 = 5.0;
/// … while another attitude's is within this share of it.
const OTHERS: f64 = 0.3;

/// A time in which a yaw is off, while that of another attitude is not.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Begin, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Largest error, deg.
    pub off_deg: f64,
    /// Its sigma, deg.
    pub sigma_deg: f64,
    /// Whose yaw is right then.
    pub against: String,
}

/// The error of a yaw over a window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    from_s: f64,
    off_deg: f64,
    sigma_deg: f64,
}

/// The constant accelerometer bias that fits best.
pub(super) fn bias(intervals: &[Interval]) -> Vector3<f64> {
    fit(intervals, 0.0, false).0.xyz()
}

/// The yaw of each window by the horizontal changes of velocity: the angle between what is turned and what GNSS says (Wahba's problem in the plane).
pub(super) fn windows(intervals: &[Interval], bias: &Vector3<f64>) -> Vec<Window> {
    let Some((first, last)) = intervals.first().zip(intervals.last()) else { return Vec::new() };
    let step = 0.5 * WINDOW_S;
    let (begin, end) = ((first.t_s / step).floor() as i64, (last.t_s / step).floor() as i64);
    let window = |k: i64| {
        let from_s = k as f64 * step;
        let at = |t_s: f64| intervals.partition_point(|i| i.t_s < t_s);
        let own = &intervals[at(from_s)..at(from_s + WINDOW_S)];
        if own.len() < FEWEST {
            return None;
        }
        let pairs = || own.iter().map(|i| (i.gain.force - i.gain.turn * bias, i.gained));
        let (cross, dot, square) = pairs().fold((0.0, 0.0, 0.0), |(cross, dot, square), (g, m)| {
            (cross + g.x * m.y - g.y * m.x, dot + g.x * m.x + g.y * m.y, square + g.x * g.x + g.y * g.y)
        });
        let yaw = atan2(cross, dot);
        let left: f64 = own.iter().map(|i| residual(i, bias, yaw).xy().norm_squared()).sum();
        let noise = (left / (2.0 * own.len() as f64)).sqrt().max(NOISE);
        // What would correct it is the negative of its error.
        Some(Window {
            from_s,
            off_deg: -yaw.to_degrees(),
            sigma_deg: (noise / square.max(1e-9).sqrt()).to_degrees(),
        })
    };
    (begin..=end).filter_map(window).collect()
}

/// The longest time in which a yaw is off and that of one of the others is not.
pub(super) fn stretch<'a>(
    own: &[Window],
    others: impl Iterator<Item = (&'a str, &'a [Window])>,
) -> Option<Stretch> {
    let against = |(name, other): (&str, &[Window])| {
        let mut all: Vec<Stretch> = Vec::new();
        for w in own.iter().filter(|w| w.off_deg.abs() > OFF_DEG.max(OFF_SIGMAS * w.sigma_deg)) {
            let same = other.iter().find(|o| o.from_s == w.from_s);
            let right = |o: &&Window| {
                o.off_deg.abs() < OTHERS * w.off_deg.abs() && OFF_SIGMAS * o.sigma_deg < w.off_deg.abs()
            };
            if same.filter(right).is_none() {
                continue;
            }
            let to_s = w.from_s + WINDOW_S;
            match all.last_mut().filter(|s| w.from_s <= s.to_s && s.off_deg * w.off_deg > 0.0) {
                Some(s) => {
                    s.to_s = to_s;
                    if w.off_deg.abs() > s.off_deg.abs() {
                        (s.off_deg, s.sigma_deg) = (w.off_deg, w.sigma_deg);
                    }
                }
                None => all.push(Stretch {
                    from_s: w.from_s,
                    to_s,
                    off_deg: w.off_deg,
                    sigma_deg: w.sigma_deg,
                    against: name.to_owned(),
                }),
            }
        }
        all
    };
    let length = |s: &Stretch| s.to_s - s.from_s;
    others.flat_map(against).max_by(|a, b| length(a).total_cmp(&length(b)))
}

/// Accelerometer bias and, where wanted, yaw that fit best, with the inverse of the normal matrix; Gauss-Newton from this yaw.
fn fit(intervals: &[Interval], yaw: f64, turns: bool) -> (Vector4<f64>, Matrix4<f64>) {
    let mut x = Vector4::new(0.0, 0.0, 0.0, yaw);
    let mut inverse = Matrix4::identity();
    for _ in 0..6 {
        let prior = Vector4::new(BIAS_SIGMA, BIAS_SIGMA, BIAS_SIGMA, if turns { 10.0 } else { 1e-9 })
            .map(|s| s.powi(-2));
        let mut normal = Matrix4::from_diagonal(&prior);
        let mut right = -prior.component_mul(&(x - Vector4::new(0.0, 0.0, 0.0, yaw)));
        for i in intervals {
            let (rows, r) = rows(i, &x);
            normal += rows.transpose() * rows / (NOISE * NOISE);
            right += rows.transpose() * r / (NOISE * NOISE);
        }
        inverse = normal.try_inverse().unwrap_or_else(Matrix4::zeros);
        x += inverse * right;
    }
    (x, inverse)
}

/// Derivatives of what the turned force gains, by bias and yaw, and the residual.
fn rows(i: &Interval, x: &Vector4<f64>) -> (nalgebra::Matrix3x4<f64>, Vector3<f64>) {
    let turn = c_nb_from_euler(0.0, 0.0, x.w);
    let gained = turn * (i.gain.force - i.gain.turn * x.xyz());
    let mut rows = nalgebra::Matrix3x4::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-turn * i.gain.turn));
    rows.set_column(3, &Vector3::new(-gained.y, gained.x, 0.0));
    rows.row_mut(2).scale_mut(i.vertical);
    (rows, residual(i, &x.xyz(), x.w))
}

/// The constant error of the yaw, deg, with a sigma from the scatter over blocks (sandwich).
pub(super) fn off(intervals: &[Interval]) -> Option<(f64, f64)> {
    let cost =
        |x: &Vector4<f64>| intervals.iter().map(|i| residual(i, &x.xyz(), x.w).norm_squared()).sum::<f64>();
    let starts = (0..6).map(|k| fit(intervals, f64::from(k) * std::f64::consts::FRAC_PI_3, true));
    let (x, inverse) = starts.min_by(|a, b| cost(&a.0).total_cmp(&cost(&b.0)))?;
    let mut scores: Vec<(i64, Vector4<f64>)> = Vec::new();
    for i in intervals {
        let (rows, r) = rows(i, &x);
        let score = rows.transpose() * r / (NOISE * NOISE);
        let block = (i.t_s / BLOCK_S).floor() as i64;
        match scores.last_mut().filter(|s| s.0 == block) {
            Some((_, sum)) => *sum += score,
            None => scores.push((block, score)),
        }
    }
    let middle: Matrix4<f64> = scores.iter().map(|(_, s)| s * s.transpose()).sum();
    let scatter = (inverse * middle * inverse)[(3, 3)].max(0.0).sqrt().to_degrees();
    // What the accelerations can show at all: a simulated vehicle at rest scatters by nothing.
    let shown = inverse[(3, 3)].max(0.0).sqrt().to_degrees();
    // What would correct it is the negative of its error.
    let off = -gaware_nav::rotation::wrap_pi(x.w).to_degrees();
    (scatter > 0.0 && scatter.max(shown) < MOST_SIGMA_DEG).then_some((off, scatter))
}
