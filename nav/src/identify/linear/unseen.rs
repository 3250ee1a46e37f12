//! What a vehicle does while its samples are lost.
//!
//! A gap is bridged by interpolation between the samples on both sides. How far off that is the same flight shows: the
//! interpolation is tried where no sample is lost, over the same time. What it misses is averaged over those places whose samples at
//! both ends are most like those of the gap, and over the whole flight: a vehicle that flies level before and after a gap may
//! have rolled in between. What is missed has long tails (on a flight between waypoints one place in forty is beyond three times
//! the mean square), so both together are doubled. How velocity and attitude go together within a gap depends on when it was
//! that the vehicle rolled, so each counts by itself.
//!
//! Samples that are lost one by one leave holes, which are many and short: each adds the mean square of what interpolation misses at
//! places like it, and hides no fix.

use super::index;
use super::rough;
use super::touchdown;
use crate::earth::STANDARD_GRAVITY;
use crate::filter::unseen::{GAP_S, MOTION};
use crate::identify::statistics::median;
use crate::linear::interval::{NavCovariance, error};
use crate::mechanization::{Increment, Motion, NavState};
use crate::rotation::exp;
use crate::sample::{GnssFix, ImuSample, SampleKind};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// Interpolation is tried at most so often for a length …
const TRIALS: usize = 300;
/// … and so many of them are most like a gap; with fewer the flight says nothing of itself.
const ALIKE: usize = 40;
/// Sigmas are larger than the roots of mean squares by this factor: tails are long.
const LONG_TAILS: f64 = 2.0;
/// After a gap in which the vehicle turned by more than this unseen, rad …
const FAR: f64 = 0.1;
/// … it takes this long until the fixes have made its attitude certain again, s.
const SETTLE_S: f64 = 5.0;
/// Lengths of gaps are separated by this, s.
const LENGTHS_S: f64 = 0.1;
/// Samples further apart than so many usual intervals have lost one between them: twice, less what stamps jitter.
const HOLE_INTERVALS: f64 = 1.75;
/// This much rate, rad/s, is as unlike as that much specific force, m/s².
const RATE_PER_FORCE: f64 = 0.05;

/// A stretch without samples.
#[derive(Debug, Clone)]
struct Gap {
    from_s: f64,
    to_s: f64,
    missed: NavCovariance,
    /// Whether the vehicle is known to have turned so far unseen that the fixes after it are nonlinear.
    turned: bool,
}

/// The gaps of a flight, the holes that single lost samples leave, and its touchdowns: between two samples.
#[derive(Debug, Clone, Default)]
pub(in crate::identify) struct Unseen {
    gaps: Vec<Gap>,
    holes: Vec<Gap>,
    blows: Vec<Gap>,
    /// Steps in which the vehicle turns faster than its samples follow.
    rough: Vec<Gap>,
}

/// Interpolation over a stretch of known samples: those at its ends, and what it missed.
struct Trial {
    ends: [ImuSample; 2],
    missed: NavCovariance,
}

/// What a vehicle may have done of which nothing is known.
fn anything(length_s: f64) -> NavCovariance {
    let mut q = NavCovariance::zeros();
    let size = [
        (index::POSITION, 0.5 * MOTION.1 * length_s * length_s),
        (index::VELOCITY, MOTION.1 * length_s),
        (index::ATTITUDE, MOTION.0 * length_s),
    ];
    for (at, sigma) in size {
        (0..3).for_each(|k| q[(at + k, at + k)] = sigma * sigma);
    }
    q
}

fn motion(sample: &ImuSample) -> Motion {
    Motion { rate: sample.gyro, force: sample.accel }
}

/// From rest at the origin, without gravity.
fn moved(from: &NavState, inc: &Increment) -> NavState {
    NavState {
        r_e: from.r_e + from.v_e * inc.dt + from.q_eb * inc.dp,
        v_e: from.v_e + from.q_eb * inc.dv,
        q_eb: from.q_eb * exp(&inc.dtheta),
    }
}

fn unlike(a: &[ImuSample; 2], b: &[ImuSample; 2]) -> f64 {
    let one = |a: &ImuSample, b: &ImuSample| {
        (a.gyro - b.gyro).norm_squared() + ((a.accel - b.accel) * RATE_PER_FORCE).norm_squared()
    };
    one(&a[0], &b[0]) + one(&a[1], &b[1])
}

/// Interpolation over this long, where no samples are further apart than `most_s`.
fn trials(samples: &[ImuSample], kind: SampleKind, length_s: f64, most_s: f64) -> Vec<Trial> {
    let rest = NavState { r_e: Vector3::zeros(), v_e: Vector3::zeros(), q_eb: UnitQuaternion::identity() };
    let stride = (samples.len() / TRIALS).max(1);
    let one = |from: usize| {
        let first = samples.get(from)?;
        let to = samples.partition_point(|s| s.t_s <= first.t_s + length_s);
        let last = samples.get(to)?;
        let mut seen = rest;
        for pair in samples[from..=to].windows(2) {
            let dt = pair[1].t_s - pair[0].t_s;
            if dt > most_s {
                return None;
            }
            seen = moved(&seen, &Increment::between(&motion(&pair[0]), &motion(&pair[1]), kind, dt));
        }
        let across = Increment::between(&motion(first), &motion(last), kind, last.t_s - first.t_s);
        let e = error(&moved(&rest, &across), &seen);
        Some(Trial { ends: [*first, *last], missed: e * e.transpose() })
    };
    (0..samples.len()).step_by(stride).filter_map(one).collect()
}

/// Mean squares of what interpolation misses at the places most like this one, and anywhere; `None` where too few were tried.
fn missed(trials: &[Trial], ends: &[ImuSample; 2]) -> Option<[NavCovariance; 2]> {
    if trials.len() < ALIKE {
        return None;
    }
    let mut by_likeness: Vec<(f64, &Trial)> = trials.iter().map(|t| (unlike(&t.ends, ends), t)).collect();
    by_likeness.sort_by(|a, b| a.0.total_cmp(&b.0));
    let alike = by_likeness.iter().take(ALIKE).map(|t| t.1.missed).sum::<NavCovariance>() / ALIKE as f64;
    let anywhere = trials.iter().map(|t| t.missed).sum::<NavCovariance>() / trials.len() as f64;
    Some([alike, anywhere].map(|q| NavCovariance::from_diagonal(&q.diagonal())))
}

/// The median of the intervals between samples, s.
fn usual_interval_s(samples: &[ImuSample]) -> f64 {
    median(samples.windows(2).map(|w| w[1].t_s - w[0].t_s)).unwrap_or(0.0)
}

/// Those of them, in order of time, that have a part between two times.
fn between(all: &[Gap], from_s: f64, to_s: f64) -> impl Iterator<Item = &Gap> {
    all.iter().skip(all.partition_point(|g| g.to_s <= from_s)).take_while(move |g| g.from_s < to_s)
}

impl Unseen {
    /// Of samples in order of time.
    pub(in crate::identify) fn of(samples: &[ImuSample], kind: SampleKind) -> Self {
        let usual_s = usual_interval_s(samples);
        let mut own = Self::default();
        let mut tried: BTreeMap<(bool, usize), Vec<Trial>> = BTreeMap::new();
        for pair in samples.windows(2) {
            let length_s = pair[1].t_s - pair[0].t_s;
            let is_gap = length_s > GAP_S;
            if !is_gap && length_s <= HOLE_INTERVALS * usual_s {
                continue;
            }
            // Lengths are separated by tenths of a second, those of holes by samples.
            let (unit_s, most_s) =
                if is_gap { (LENGTHS_S, GAP_S) } else { (usual_s, HOLE_INTERVALS * usual_s) };
            let class = (length_s / unit_s - 1e-3).ceil().max(1.0);
            let trials = tried
                .entry((is_gap, class as usize))
                .or_insert_with(|| trials(samples, kind, class * unit_s, most_s));
            let found = missed(trials, &[pair[0], pair[1]]);
            let missed = match found {
                Some([alike, _]) if !is_gap => alike,
                Some([alike, anywhere]) => (alike + anywhere) * LONG_TAILS.powi(2),
                None if is_gap => anything(length_s),
                // The bend of the samples around it is all that so short a flight shows.
                None => continue,
            };
            let gap = Gap { from_s: pair[0].t_s, to_s: pair[1].t_s, missed, turned: false };
            if is_gap { own.gaps.push(gap) } else { own.holes.push(gap) }
        }
        let rough = rough::steps(samples, kind, usual_s, HOLE_INTERVALS * usual_s).into_iter();
        own.rough = rough
            .map(|step| {
                let mut missed = NavCovariance::zeros();
                for k in 0..3 {
                    missed[(index::ATTITUDE + k, index::ATTITUDE + k)] = step.missed[0][k];
                    missed[(index::VELOCITY + k, index::VELOCITY + k)] = step.missed[1][k];
                }
                Gap { from_s: step.from_s, to_s: step.to_s, missed, turned: false }
            })
            .collect();
        own
    }

    /// Adds the touchdowns that these fixes show, where samples are points.
    pub(in crate::identify) fn add_touchdowns(&mut self, fixes: &[GnssFix], kind: SampleKind) {
        let blow = |(from_s, to_s, speed): (f64, f64, f64)| {
            let mut missed = NavCovariance::zeros();
            (0..3).for_each(|k| missed[(index::VELOCITY + k, index::VELOCITY + k)] = speed * speed);
            Gap { from_s, to_s, missed, turned: false }
        };
        if kind == SampleKind::Point {
            self.blows = touchdown::touchdowns(fixes).map(blow).collect();
        }
    }

    /// What is missed between two times. Unseen motion lasts: its variances grow with the square, that of the position with the
    /// fourth power, of the time since the last sample.
    pub(super) fn within(&self, from_s: f64, to_s: f64) -> Option<NavCovariance> {
        let mut sum: Option<NavCovariance> = None;
        for gap in [&self.gaps, &self.holes, &self.blows, &self.rough]
            .into_iter()
            .flat_map(|all| between(all, from_s, to_s))
        {
            let length_s = gap.to_s - gap.from_s;
            let share = |t_s: f64| ((t_s.clamp(gap.from_s, gap.to_s) - gap.from_s) / length_s).powi(2);
            let (a, b) = (share(from_s), share(to_s));
            let (square, fourth) = ((b - a).sqrt(), (b * b - a * a).sqrt());
            let scale = |k: usize| if k < index::VELOCITY { fourth } else { square };
            let q = NavCovariance::from_fn(|i, j| gap.missed[(i, j)] * scale(i) * scale(j));
            sum = Some(sum.map_or(q, |s| s + q));
        }
        sum
    }

    /// 1-sigma of the attitude that is missed between two times, rad; 0 where nothing is.
    pub(in crate::identify) fn attitude_sigma(&self, from_s: f64, to_s: f64) -> f64 {
        let variance =
            |q: NavCovariance| (0..3).map(|k| q[(index::ATTITUDE + k, index::ATTITUDE + k)]).sum::<f64>();
        self.within(from_s, to_s).map_or(0.0, |q| variance(q).sqrt())
    }

    /// Whether samples are missing between two times.
    pub(in crate::identify) fn hides(&self, from_s: f64, to_s: f64) -> bool {
        let first = self.gaps.partition_point(|g| g.to_s <= from_s);
        self.gaps.get(first).is_some_and(|g| g.from_s < to_s)
    }

    /// Whether a gap in which the vehicle turned far has ended a moment before.
    pub(super) fn unsettles(&self, t_s: f64) -> bool {
        let first = self.gaps.partition_point(|g| g.to_s <= t_s - SETTLE_S);
        self.gaps.get(first..).unwrap_or_default().iter().take_while(|g| g.to_s <= t_s).any(|g| g.turned)
    }

    /// How long samples are missing, s, that usually come in this interval.
    pub(in crate::identify) fn missing_s(&self, usual_s: f64) -> f64 {
        self.gaps.iter().chain(&self.holes).map(|g| g.to_s - g.from_s - usual_s).sum()
    }

    /// Beginning and end of every gap, s.
    pub(in crate::identify) fn spans_s(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.gaps.iter().map(|g| (g.from_s, g.to_s))
    }

    /// Widens gap number `k` where interpolation is known to have missed this much of the attitude, rad: as much is then possible, and what
    /// gravity makes of it in the meantime.
    pub(in crate::identify) fn widen(&mut self, k: usize, missed: &Vector3<f64>) {
        let Some(gap) = self.gaps.get_mut(k) else { return };
        gap.turned |= missed.norm() > FAR;
        let length_s = gap.to_s - gap.from_s;
        let force = STANDARD_GRAVITY * missed.norm();
        for axis in 0..3 {
            for (at, size) in [
                (index::ATTITUDE, missed[axis]),
                (index::VELOCITY, force * length_s / 2.0),
                (index::POSITION, force * length_s * length_s / 6.0),
            ] {
                let own = &mut gap.missed[(at + axis, at + axis)];
                *own = own.max(size * size);
            }
        }
    }

    /// The same at another time.
    pub(in crate::identify) fn move_by(&mut self, by_s: f64) {
        for gap in self.gaps.iter_mut().chain(&mut self.holes).chain(&mut self.blows).chain(&mut self.rough) {
            gap.from_s += by_s;
            gap.to_s += by_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::math::sin;

    use super::*;

    /// A vehicle that weaves all the time, twice as much about x as about y, and not at all about z.
    fn samples(lost: impl Fn(f64) -> bool) -> Vec<ImuSample> {
        let at = |k: u32| {
            let t_s = f64::from(k) * 0.02;
            let weave = 0.4 * sin(1.3 * t_s);
            ImuSample {
                t_s,
                gyro: Vector3::new(weave, 0.5 * weave, 0.0),
                accel: Vector3::new(0.0, 0.0, -9.8),
                temperature_degc: None,
            }
        };
        (0..9000).map(at).filter(|s| !lost(s.t_s)).collect()
    }

    #[test]
    fn what_interpolation_misses_is_known_axis_by_axis() {
        let lost = |t_s: f64| (100.0..101.0).contains(&t_s);
        let unseen = Unseen::of(&samples(lost), SampleKind::Point);
        let within = |from: f64, to: f64, axis: usize| {
            let at = index::ATTITUDE + axis;
            unseen.within(from, to).map(|q| q[(at, at)].sqrt()).unwrap()
        };
        let [x, y, z] = std::array::from_fn(|axis| within(99.0, 102.0, axis));
        // A straight line over 1.1 s of 0.4 rad/s · sin(1.3 t) misses up to 0.4 · 1.3² · 1.1³ / 12 rad; its mean square is half of
        // that squared, and two such means are doubled.
        let mean = 0.4 * 1.3f64.powi(2) * 1.1f64.powi(3) / 12.0 * LONG_TAILS;
        assert!((0.6 * mean..1.5 * mean).contains(&x), "{x} {mean}");
        assert!((0.4..0.6).contains(&(y / x)) && z < 0.1 * x, "{x} {y} {z}");
        assert_eq!(unseen.within(40.0, 90.0), None);
        assert!(unseen.hides(100.9, 101.4) && !unseen.hides(101.1, 101.6) && !unseen.hides(99.0, 99.9));
        // Cut in two by a fix it is the same gap.
        let halves = crate::rss(within(99.0, 100.5, 0), within(100.5, 102.0, 0));
        assert!((halves / x - 1.0).abs() < 1e-9, "{halves} {x}");
    }

    #[test]
    fn a_hole_adds_what_interpolation_misses_there_and_hides_nothing() {
        let lost = |t_s: f64| (t_s * 10.0).rem_euclid(10.0) < 0.99 && t_s > 60.0;
        let samples = samples(lost);
        let unseen = Unseen::of(&samples, SampleKind::Point);
        assert!(unseen.gaps.is_empty() && !unseen.hides(0.0, 200.0));
        let holes = unseen.holes.len();
        assert!((115..=121).contains(&holes), "{holes}");
        // Five of the samples of a second are missing.
        assert!((unseen.missing_s(0.02) - 0.1 * 120.0).abs() < 0.3, "{}", unseen.missing_s(0.02));
        // A line over 0.12 s of 0.4 rad/s · sin(1.3 t) misses up to 0.4 · 1.3² · 0.12³ / 12 rad.
        let most = 0.4 * 1.3f64.powi(2) * 0.12f64.powi(3) / 12.0;
        let x = unseen.within(60.0, 180.0).unwrap()[(index::ATTITUDE, index::ATTITUDE)];
        let each = (x / holes as f64).sqrt();
        assert!((0.4 * most..most).contains(&each), "{each} {most}");
        assert_eq!(unseen.within(10.0, 50.0), None);
    }

    #[test]
    fn a_gap_is_as_wide_as_what_it_is_known_to_have_missed() {
        let lost = |t_s: f64| (100.0..102.0).contains(&t_s);
        let mut unseen = Unseen::of(&samples(lost), SampleKind::Point);
        let sigmas = |u: &Unseen| u.within(99.0, 103.0).unwrap().diagonal().map(f64::sqrt);
        let before = sigmas(&unseen);
        unseen.widen(0, &Vector3::new(1e-3, 0.0, -0.7));
        let after = sigmas(&unseen);
        assert_eq!(after[index::ATTITUDE], before[index::ATTITUDE]);
        assert!((after[index::ATTITUDE + 2] - 0.7).abs() < 1e-9, "{after}");
        // 0.7 rad of tilt for two seconds, growing: 7 m/s.
        assert!((6.5..7.5).contains(&after[index::VELOCITY]), "{after}");
        assert!(!unseen.unsettles(101.0) && unseen.unsettles(103.0) && !unseen.unsettles(108.0));
    }

    #[test]
    fn a_flight_that_is_all_gaps_says_nothing_of_itself() {
        let all: Vec<ImuSample> = samples(|_| false).into_iter().step_by(25).collect();
        let unseen = Unseen::of(&all, SampleKind::Point);
        let q = unseen.within(70.0, 70.5).unwrap();
        assert!((q[(index::ATTITUDE, index::ATTITUDE)].sqrt() - MOTION.0 * 0.5).abs() < 1e-9);
    }
}
