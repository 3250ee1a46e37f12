//! The paper's conditions (a), (b), (c) (conclusion of its section 3, with Ċ = 0), judged on the Gram matrices of
//! segments instead of on differences.
//!
//! A direction counts once σ_g² / λ of the significant part of S reaches the target of a row of G. A condition that has
//! been met stays met: what a flight has shown is not forgotten. They are sufficient, not necessary; the covariance
//! may know more, for example from turns.

use super::segments::{PathSegment, SegmentDetector, SegmentEvent, SegmentSample};
use crate::effects::unit;
use nalgebra::{Matrix3, Vector3};

/// Segments that (b) and (c) want, "more than one".
const SEGMENTS: u32 = 2;
/// Progress of (b) and (c) as long as all came from one segment.
const ONE_SEGMENT_ONLY: f64 = 0.9;
/// However quiet the gyros, a change must be worth half a m/s² held for four seconds, (m/s²)² s: less is what speed
/// (Coriolis), trim and fuel do by themselves.
const LEAST_NEEDED: f64 = 1.0;
/// Names of the body axes, as pilots say them.
const AXES: [&str; 3] = ["forward", "right", "down"];

/// What makes a direction count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConditionSettings {
    /// White noise of the gyros with their quantisation, rad/s/√Hz.
    pub gyro_noise: f64,
    /// 1-sigma that a coefficient of G must reach, rad/s per m/s².
    pub target_sigma: f64,
}

impl ConditionSettings {
    /// For gyros of this noise (rad/s/√Hz): to 40 deg/h/g, a ninth of what a consumer data sheet allows.
    pub fn new(gyro_noise: f64) -> Self {
        Self { gyro_noise, target_sigma: 40.0 * unit::DEG_PER_H_PER_G.si }
    }

    /// Gram along a direction that reaches the target, (m/s²)² s.
    pub fn needed(&self) -> f64 {
        (self.gyro_noise / self.target_sigma).powi(2).max(LEAST_NEEDED)
    }
}

/// One condition.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ConditionStatus {
    /// Whether it is met.
    pub met: bool,
    /// How far, 0 to 1.
    pub progress: f64,
    /// What is missing, in words; empty when met.
    pub missing: String,
}

/// All three.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ConditionsStatus {
    /// Two independent changes of specific force on one segment: attitude and biases.
    pub a: ConditionStatus,
    /// Each element of specific force changes, on more than one segment: diagonal G.
    pub b: ConditionStatus,
    /// Three independent changes, on more than one segment: full G.
    pub c: ConditionStatus,
}

/// Watches a flight for the conditions; constant effort and memory per sample.
#[derive(Debug, Clone)]
pub struct PathConditions {
    settings: ConditionSettings,
    detector: SegmentDetector,
    /// Σ of the significant Grams of closed segments, and how many had one.
    closed: Matrix3<f64>,
    excited: u32,
    /// The significant Gram of the segment that is best for (a).
    best: Matrix3<f64>,
    status: ConditionsStatus,
}

impl PathConditions {
    /// Nothing seen yet.
    pub fn new(settings: ConditionSettings) -> Self {
        let mut new = Self {
            settings,
            detector: SegmentDetector::new(settings.gyro_noise),
            closed: Matrix3::zeros(),
            excited: 0,
            best: Matrix3::zeros(),
            status: ConditionsStatus::default(),
        };
        new.judge();
        new
    }

    /// Takes in one sample; true when the status was judged anew.
    pub fn push(&mut self, x: &SegmentSample) -> bool {
        match self.detector.push(x) {
            None => return false,
            Some(SegmentEvent::Block) => {}
            Some(SegmentEvent::Closed(segment)) => self.take(&segment),
        }
        self.judge();
        true
    }

    /// Ends the open segment: the stream ended or starts anew.
    pub fn finish(&mut self) {
        if let Some(segment) = self.detector.finish() {
            self.take(&segment);
        }
        self.judge();
    }

    /// The conditions now.
    pub fn status(&self) -> &ConditionsStatus {
        &self.status
    }

    /// The segment under way.
    pub fn segment(&self) -> Option<&PathSegment> {
        self.detector.open()
    }

    /// Segments with a significant change of specific force so far, the open one included.
    pub fn excited_segments(&self) -> u32 {
        self.excited + u32::from(self.segment().is_some_and(PathSegment::is_excited))
    }

    /// Σ of the significant Grams over all segments, (m/s²)² s: the rank of the paper's A.
    pub fn gram(&self) -> Matrix3<f64> {
        self.closed + self.segment().map_or_else(Matrix3::zeros, |s| s.excitation)
    }

    fn take(&mut self, segment: &PathSegment) {
        self.closed += segment.excitation;
        self.excited += u32::from(segment.is_excited());
        self.consider(&segment.excitation);
    }

    /// Keeps the segment that went furthest toward two directions.
    fn consider(&mut self, excitation: &Matrix3<f64>) {
        let reached = |m: &Matrix3<f64>| {
            let known = self.directions(m);
            (known[0].0 + known[1].0, m.trace())
        };
        if reached(excitation) > reached(&self.best) {
            self.best = *excitation;
        }
    }

    /// Share of the needed Gram (at most 1) and direction, best first.
    fn directions(&self, gram: &Matrix3<f64>) -> [(f64, Vector3<f64>); 3] {
        let eigen = gram.symmetric_eigen();
        let mut out = [0, 1, 2].map(|k| {
            let share = (eigen.eigenvalues[k] / self.settings.needed()).clamp(0.0, 1.0);
            (eigen.eigenvalues[k], share, Vector3::from(eigen.eigenvectors.column(k)))
        });
        out.sort_by(|x, y| y.0.total_cmp(&x.0));
        out.map(|(_, share, direction)| (share, direction))
    }

    fn judge(&mut self) {
        if let Some(excitation) = self.segment().map(|s| s.excitation) {
            self.consider(&excitation);
        }
        let (a, b, c) = (self.condition_a(), self.condition_b(), self.condition_c());
        let merge = |old: &mut ConditionStatus, new: ConditionStatus| {
            if !old.met {
                let progress = new.progress.max(old.progress);
                *old = ConditionStatus { progress, ..new };
            }
        };
        merge(&mut self.status.a, a);
        merge(&mut self.status.b, b);
        merge(&mut self.status.c, c);
    }

    fn condition_a(&self) -> ConditionStatus {
        let known = self.directions(&self.best);
        let progress = 0.5 * (known[0].0 + known[1].0);
        let missing = match known.iter().filter(|(share, _)| *share >= 1.0).count() {
            0 => "specific force has not changed enough at constant attitude".to_owned(),
            1 => {
                let had = main_axis(&known[0].1);
                let others: Vec<_> = AXES.iter().filter(|a| **a != AXES[had]).copied().collect();
                format!(
                    "on one segment specific force changed {} only; change {} or {} on the same segment",
                    AXES[had], others[0], others[1]
                )
            }
            _ => String::new(),
        };
        ConditionStatus { met: missing.is_empty(), progress, missing }
    }

    fn condition_b(&self) -> ConditionStatus {
        let diagonal = self.gram().diagonal();
        let shares = [0, 1, 2].map(|k| (diagonal[k] / self.settings.needed()).clamp(0.0, 1.0));
        let lacking: Vec<_> = (0..3).filter(|k| shares[*k] < 1.0).map(|k| AXES[k]).collect();
        self.over_segments(shares, &lacking)
    }

    fn condition_c(&self) -> ConditionStatus {
        let known = self.directions(&self.gram());
        // Which axes the unknown directions span most: the diagonal of their projector.
        let mut unknown = Vector3::zeros();
        let mut count = 0;
        for (_, direction) in known.iter().filter(|(share, _)| *share < 1.0) {
            unknown += direction.component_mul(direction);
            count += 1;
        }
        let mut axes = [0, 1, 2];
        axes.sort_by(|x, y| unknown[*y].total_cmp(&unknown[*x]));
        let mut lacking_axes = axes[..count].to_vec();
        lacking_axes.sort_unstable();
        let lacking: Vec<_> = lacking_axes.iter().map(|k| AXES[*k]).collect();
        self.over_segments(known.map(|(share, _)| share), &lacking)
    }

    /// A condition on three shares that must come from more than one segment.
    fn over_segments(&self, shares: [f64; 3], lacking: &[&str]) -> ConditionStatus {
        let mut progress = shares.iter().sum::<f64>() / 3.0;
        let missing = if !lacking.is_empty() {
            format!("specific force has not changed enough at constant attitude: {}", lacking.join(", "))
        } else if self.excited_segments() < SEGMENTS {
            "a second segment of constant attitude with changing specific force".to_owned()
        } else {
            String::new()
        };
        if !missing.is_empty() && lacking.is_empty() {
            progress = progress.min(ONE_SEGMENT_ONLY);
        }
        ConditionStatus { met: missing.is_empty(), progress, missing }
    }
}

/// The axis along which a direction lies most.
fn main_axis(direction: &Vector3<f64>) -> usize {
    direction.iamax()
}

#[cfg(test)]
mod tests;
