//! Path segments of constant attitude, found while flying, and how much the specific force changes on each.
//!
//! The paper's conditions speak of ḟ on segments with Ċ = 0. Differencing would differentiate noise; the demeaned Gram
//! matrix S = Σ Δt (f − f̄)(f − f̄)ᵀ has the same rank (design, section 4). Specific force is averaged over blocks
//! of half a second, and of S the part that alternates from block to block is taken off (half the sum of the squared
//! differences of neighbours, von Neumann 1941), so that only sustained changes count, slower than 0.5 Hz. A direction is
//! kept only if it changes by more than what vibration, tilt within the tolerance and the drift of an accelerometer
//! explain together.
//!
//! **What "more" means.** If nothing but vibration moves the blocks, what is left of S in a direction is a quadratic
//! form in independent normal block means of variance ψ/Δt, with mean 0, Frobenius norm √(n/2) for n blocks and operator
//! norm at most 1. With probability 1 − e^(−x) it stays below ψ (2√(x n/2) + 2x) (Laurent & Massart 2000, lemma 1), and
//! in all directions at once below 1.25 times that with x + ln 9261 for x (a net of mesh 0.1, Vershynin 2018,
//! sec. 4.4.1). ψ is measured by the scatter of the samples within the blocks, ν degrees of freedom in all; with
//! probability 1 − e^(−x) it is at most ν/(√ν − √3 − √(2x))² times what they show (Davidson & Szarek 2001, thm. II.13).
//! x is chosen so that in ten minutes of looking at every block the chance of one false direction is below
//! [`FALSE_ALARMS_IN_TEN_MINUTES`].
//!
//! **What it cannot determine.** A vibration line that aliases to below 0.5 Hz is a slow change of the samples and looks like
//! one; so does a vehicle that is shaken slowly by hand without turning, and rightly.

use crate::math::ln;
use crate::rotation::skew;
use nalgebra::{Matrix3, Vector3};

/// Attitude stays constant within this angle, rad: 2°. A body vector then moves by less than 4 % of its size.
pub const ATTITUDE_TOLERANCE: f64 = 0.035;
/// Shorter stretches are no segments, s: the half-second blocks could not show a change.
pub const SHORTEST_SEGMENT_S: f64 = 1.0;
/// Length of a block, s: vibration averages out, throttle and elevator do not.
pub const BLOCK_S: f64 = 0.5;
/// Fewest samples of a block: its scatter must be measurable. At 2 Hz a block lasts two seconds.
pub const BLOCK_SAMPLES: u32 = 4;
/// Chance of one false direction in ten minutes of vibration.
pub const FALSE_ALARMS_IN_TEN_MINUTES: f64 = 1e-3;
/// Bandwidth of the autopilots' accelerometer low-pass, Hz: a block has no more independent samples than twice this
/// per second, however fast they come.
const BANDWIDTH_HZ: f64 = 20.0;
/// RMS change that a drifting accelerometer explains, m/s²: 10 mg, a consumer part that warms up.
const DRIFT: f64 = 0.1;
/// Margin on the tilt that the integrated rate shows, in angle.
const TILT_MARGIN: f64 = 2.0;
/// Longest gap within a segment, s: two samples lost at the slowest useful rate.
const LONGEST_GAP_S: f64 = 1.5;

/// Directions in a net of mesh 0.1 on the sphere, and what lies between them at most.
const NET: f64 = 9261.0;
const NET_FACTOR: f64 = 1.25;

/// x of the module's text: two bounds, each looked at once per block for ten minutes.
fn confidence() -> f64 {
    let looks = 600.0 / BLOCK_S;
    ln(2.0 * looks / FALSE_ALARMS_IN_TEN_MINUTES)
}

/// One inertial sample as the detector wants it.
#[derive(Debug, Clone, Copy)]
pub struct SegmentSample {
    /// Time, s.
    pub t_s: f64,
    /// Time since the sample before, s.
    pub dt_s: f64,
    /// Rate of the body relative to Earth ω_eb^b with bias and G removed, rad/s.
    pub rate: Vector3<f64>,
    /// 1-sigma of what may be left of bias and G in it, rad/s.
    pub rate_sigma: f64,
    /// Specific force f^b, m/s².
    pub force: Vector3<f64>,
}

/// A mean and its Gram matrix about the mean, by exact updates (West 1979, the weighted form of Welford's).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Scatter {
    /// Sum of weights.
    pub weight: f64,
    /// Weighted mean.
    pub mean: Vector3<f64>,
    /// Σ w (x − mean)(x − mean)ᵀ.
    pub gram: Matrix3<f64>,
}

impl Scatter {
    /// Takes in one vector with a positive weight.
    pub fn add(&mut self, x: &Vector3<f64>, weight: f64) {
        let before = self.weight;
        self.weight += weight;
        let delta = x - self.mean;
        self.mean += delta * (weight / self.weight);
        self.gram += delta * delta.transpose() * (weight * before / self.weight);
    }
}

/// Samples of the block under way.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    samples: u32,
    duration_s: f64,
    force: Scatter,
    tilt: Scatter,
}

impl Block {
    fn is_full(&self) -> bool {
        self.samples >= BLOCK_SAMPLES && self.duration_s >= BLOCK_S * (1.0 - 1e-6)
    }
}

/// A stretch of constant attitude: what its specific force did.
#[derive(Debug, Clone, PartialEq)]
pub struct PathSegment {
    /// Time of its first sample, s.
    pub start_s: f64,
    /// Time of the last sample taken into a block, s.
    pub end_s: f64,
    /// Samples in finished blocks.
    pub samples: u64,
    /// Finished blocks.
    pub blocks: u32,
    /// Block means of specific force, weighted by time: m/s² and (m/s²)² s.
    pub force: Scatter,
    /// What of the Gram is more than vibration, tilt and drift explain, (m/s²)² s; the largest so far.
    pub excitation: Matrix3<f64>,
    /// Σ Δt δδᵀ / 2 over the differences δ of neighbouring block means, and the last block's mean.
    alternating: Matrix3<f64>,
    last: Vector3<f64>,
    /// Block means of the integrated rotation, rad and rad² s.
    tilt: Scatter,
    /// Σ over blocks of (degrees of freedom × ψ) and of degrees of freedom.
    noise: Matrix3<f64>,
    noise_dof: f64,
}

impl PathSegment {
    fn new(start_s: f64) -> Self {
        Self {
            start_s,
            end_s: start_s,
            samples: 0,
            blocks: 0,
            force: Scatter::default(),
            excitation: Matrix3::zeros(),
            alternating: Matrix3::zeros(),
            last: Vector3::zeros(),
            tilt: Scatter::default(),
            noise: Matrix3::zeros(),
            noise_dof: 0.0,
        }
    }

    /// Time covered by finished blocks, s.
    pub fn duration_s(&self) -> f64 {
        self.force.weight
    }

    /// Whether any direction of specific force changed significantly.
    pub fn is_excited(&self) -> bool {
        self.excitation.trace() > 0.0
    }

    fn add(&mut self, block: &Block, t_s: f64) {
        let n = f64::from(block.samples);
        let independent = n.min(2.0 * BANDWIDTH_HZ * block.duration_s);
        if block.samples < BLOCK_SAMPLES || independent < 2.0 {
            return;
        }
        self.end_s = t_s;
        if self.blocks > 0 {
            let step = block.force.mean - self.last;
            self.alternating += step * step.transpose() * (0.5 * block.duration_s);
        }
        self.last = block.force.mean;
        self.samples += u64::from(block.samples);
        self.blocks += 1;
        self.force.add(&block.force.mean, block.duration_s);
        self.tilt.add(&block.tilt.mean, block.duration_s);
        let within = block.force.gram / (n - 1.0);
        self.noise += within * ((independent - 1.0) * block.duration_s / independent);
        self.noise_dof += independent - 1.0;
        let excitation = self.significant();
        if excitation.trace() > self.excitation.trace() {
            self.excitation = excitation;
        }
    }

    /// The part of the Gram in directions that pass the test of the module's text.
    fn significant(&self) -> Matrix3<f64> {
        let x = confidence();
        let known = self.noise_dof.sqrt() - 3.0_f64.sqrt() - (2.0 * x).sqrt();
        if self.blocks < 2 || known <= 0.0 || self.duration_s() < SHORTEST_SEGMENT_S {
            return Matrix3::zeros();
        }
        let any_direction = x + ln(NET);
        let chance = 2.0 * (any_direction * f64::from(self.blocks) / 2.0).sqrt() + 2.0 * any_direction;
        let vibration = self.noise * (NET_FACTOR * chance / (known * known));
        let lever = skew(&self.force.mean);
        let tilt = lever * self.tilt.gram * lever.transpose() * (TILT_MARGIN * TILT_MARGIN);
        let drift = Matrix3::from_diagonal_element(DRIFT * DRIFT * self.duration_s());
        let Some(explained) = (vibration + tilt + drift).cholesky() else { return Matrix3::zeros() };
        let l = explained.l();
        let Some(inverse) = l.try_inverse() else { return Matrix3::zeros() };
        let whiten = |m: Matrix3<f64>| inverse * m * inverse.transpose();
        let sustained = whiten(self.force.gram - self.alternating).symmetric_eigen();
        let mut passing = Matrix3::zeros();
        for k in 0..3 {
            if sustained.eigenvalues[k] > 1.0 {
                let direction = sustained.eigenvectors.column(k);
                passing += direction * direction.transpose();
            }
        }
        l * passing * whiten(self.force.gram) * passing * l.transpose()
    }
}

/// The segment under way with what it needs to go on.
#[derive(Debug, Clone)]
struct Open {
    segment: PathSegment,
    block: Block,
    /// Integrated rotation since the start, rad: small, so that a vector will do.
    turned: Vector3<f64>,
    /// Time since the start and what a leftover bias may have turned in it, s and rad.
    elapsed_s: f64,
    drifted: f64,
}

impl Open {
    fn new(t_s: f64) -> Self {
        Self {
            segment: PathSegment::new(t_s),
            block: Block::default(),
            turned: Vector3::zeros(),
            elapsed_s: 0.0,
            drifted: 0.0,
        }
    }
}

/// What a sample brought.
#[derive(Debug, Clone, PartialEq)]
pub enum SegmentEvent {
    /// A block of the open segment was finished.
    Block,
    /// The attitude has left the tolerance (or samples were missing): this segment is over, the next has begun.
    Closed(Box<PathSegment>),
}

/// Finds segments in a stream of samples; constant effort and memory per sample.
#[derive(Debug, Clone)]
pub struct SegmentDetector {
    gyro_noise: f64,
    open: Option<Open>,
}

impl SegmentDetector {
    /// For gyros with this white noise, rad/s/√Hz.
    pub fn new(gyro_noise: f64) -> Self {
        Self { gyro_noise, open: None }
    }

    /// The segment under way, finished blocks only.
    pub fn open(&self) -> Option<&PathSegment> {
        self.open.as_ref().map(|o| &o.segment)
    }

    /// Takes in one sample. Samples that are not finite are skipped.
    pub fn push(&mut self, x: &SegmentSample) -> Option<SegmentEvent> {
        let finite = x.rate.iter().chain(x.force.iter()).all(|v| v.is_finite());
        if !finite || !x.t_s.is_finite() {
            return None;
        }
        if !(x.dt_s > 0.0 && x.dt_s <= LONGEST_GAP_S) {
            return self.start_anew(x.t_s);
        }
        let open = self.open.get_or_insert_with(|| Open::new(x.t_s - x.dt_s));
        open.elapsed_s += x.dt_s;
        open.turned += x.rate * x.dt_s;
        open.drifted += x.rate_sigma.abs() * x.dt_s;
        // Noise and a leftover bias must not break a segment, but neither may they mask a real turn.
        let sigma = (self.gyro_noise * self.gyro_noise * open.elapsed_s + open.drifted.powi(2)).sqrt();
        let limit = ATTITUDE_TOLERANCE + (3.0 * sigma).min(ATTITUDE_TOLERANCE);
        if open.turned.norm() > limit {
            return self.start_anew(x.t_s);
        }
        open.block.samples += 1;
        open.block.duration_s += x.dt_s;
        open.block.force.add(&x.force, 1.0);
        open.block.tilt.add(&open.turned, 1.0);
        if open.block.is_full() {
            open.segment.add(&open.block, x.t_s);
            open.block = Block::default();
            return Some(SegmentEvent::Block);
        }
        None
    }

    /// Ends the open segment, for example when the stream ends, and gives it back if it is one.
    pub fn finish(&mut self) -> Option<PathSegment> {
        let Open { mut segment, block, .. } = self.open.take()?;
        // The beginning of a turn: the attitude is still constant and the force has already changed.
        let end_s = segment.end_s.max(segment.start_s) + block.duration_s;
        segment.add(&block, end_s);
        (segment.duration_s() >= SHORTEST_SEGMENT_S).then_some(segment)
    }

    fn start_anew(&mut self, t_s: f64) -> Option<SegmentEvent> {
        let closed = self.finish();
        self.open = Some(Open::new(t_s));
        closed.map(|segment| SegmentEvent::Closed(Box::new(segment)))
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;
    use proptest::prelude::*;

    fn feed(
        detector: &mut SegmentDetector,
        seconds: f64,
        rate: [f64; 3],
        force: [f64; 3],
    ) -> Vec<PathSegment> {
        let dt_s = 0.02;
        let n = (seconds / dt_s).round() as u32;
        (0..n)
            .filter_map(|k| {
                let x = SegmentSample {
                    t_s: f64::from(k) * dt_s,
                    dt_s,
                    rate: rate.into(),
                    rate_sigma: 1e-4,
                    force: force.into(),
                };
                match detector.push(&x) {
                    Some(SegmentEvent::Closed(segment)) => Some(*segment),
                    _ => None,
                }
            })
            .collect()
    }

    proptest! {
        #[test]
        fn updates_equal_the_two_pass_sums(
            data in prop::collection::vec(([-50.0..50.0f64, -50.0..50.0, -50.0..50.0], 0.1..2.0f64), 1..40)
        ) {
            let mut scatter = Scatter::default();
            for (x, w) in &data {
                scatter.add(&Vector3::from(*x), *w);
            }
            let total: f64 = data.iter().map(|(_, w)| w).sum();
            let mean: Vector3<f64> = data.iter().map(|(x, w)| Vector3::from(*x) * *w).sum::<Vector3<f64>>() / total;
            let gram: Matrix3<f64> =
                data.iter().map(|(x, w)| { let d = Vector3::from(*x) - mean; d * d.transpose() * *w }).sum();
            prop_assert!((scatter.mean - mean).norm() < 1e-9);
            prop_assert!((scatter.gram - gram).norm() < 1e-7);
        }
    }

    #[test]
    fn straight_flight_is_one_segment_and_a_turn_ends_it() {
        let mut detector = SegmentDetector::new(1e-4);
        assert!(feed(&mut detector, 20.0, [0.0; 3], [0.0, 0.0, -9.8]).is_empty());
        let ended = feed(&mut detector, 2.0, [0.0, 0.0, 0.2], [0.0, 0.0, -9.8]);
        assert_eq!(ended.len(), 1);
        assert!((ended[0].duration_s() - 20.0).abs() < 0.3, "{}", ended[0].duration_s());
        assert!(!ended[0].is_excited());
    }

    #[test]
    fn a_steady_turn_has_no_segment() {
        let mut detector = SegmentDetector::new(1e-4);
        assert!(feed(&mut detector, 20.0, [0.0, 0.0, 0.15], [0.0, 0.0, -11.0]).is_empty());
    }

    #[test]
    fn a_leftover_bias_within_its_sigma_costs_nothing_until_twice_the_tolerance() {
        let mut detector = SegmentDetector::new(1e-4);
        let dt_s = 0.02;
        let mut first_end = None;
        for k in 0..2000_u32 {
            let t_s = f64::from(k) * dt_s;
            let rate = Vector3::new(5e-3, 0.0, 0.0);
            let x = SegmentSample { t_s, dt_s, rate, rate_sigma: 5e-3, force: Vector3::new(0.0, 0.0, -9.8) };
            if let (Some(SegmentEvent::Closed(s)), None) = (detector.push(&x), first_end) {
                first_end = Some(s.duration_s());
            }
        }
        let lasted = first_end.unwrap_or(f64::INFINITY);
        assert!((lasted - 2.0 * ATTITUDE_TOLERANCE / 5e-3).abs() < 0.6, "{lasted}");
    }

    #[test]
    fn rocking_within_the_tolerance_is_tilt_not_thrust() {
        let mut detector = SegmentDetector::new(1e-4);
        let dt_s = 0.02;
        for k in 0..15_000_u32 {
            let t_s = f64::from(k) * dt_s;
            // 1.5° of roll at 0.1 Hz: gravity moves along the right axis.
            let (angle, w) = (0.026, 0.628);
            let roll = angle * sin(w * t_s);
            let x = SegmentSample {
                t_s,
                dt_s,
                rate: Vector3::new(angle * w * cos(w * t_s), 0.0, 0.0),
                rate_sigma: 1e-4,
                force: Vector3::new(0.0, -9.8 * sin(roll), -9.8 * cos(roll)),
            };
            assert!(!matches!(detector.push(&x), Some(SegmentEvent::Closed(_))));
        }
        assert!(detector.open().is_some_and(|s| s.duration_s() > 290.0 && !s.is_excited()));
    }

    #[test]
    fn garbage_and_gaps_are_survived() {
        let mut detector = SegmentDetector::new(1e-4);
        feed(&mut detector, 5.0, [0.0; 3], [0.0, 0.0, -9.8]);
        feed(&mut detector, 5.0, [f64::NAN; 3], [0.0, f64::INFINITY, -9.8]);
        let gap = SegmentSample {
            t_s: 60.0,
            dt_s: 50.0,
            rate: Vector3::zeros(),
            rate_sigma: 0.0,
            force: Vector3::zeros(),
        };
        let Some(SegmentEvent::Closed(segment)) = detector.push(&gap) else { panic!("a gap ends a segment") };
        assert!((segment.duration_s() - 5.0).abs() < 0.1);
        assert!(detector.finish().is_none());
    }
}
