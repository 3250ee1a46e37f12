//! Samples that come faster than fixes can see, as fewer interval means that do the same.
//!
//! Rotation and velocity of a group are composed sample by sample, so that coning and sculling within it are in them. Its mean is the
//! constant rate and specific force that turn and accelerate the body by as much: with the rotation vector φ and the velocity Δv in the axes of
//! the group's start, φ/T and J(φ)⁻¹ Δv/T (Forster, Carlone, Dellaert & Scaramuzza 2017; J: Barfoot 2017, eq. 7.77).

use crate::effects::ActsOn;
use crate::filter::unseen::GAP_S;
use crate::mechanization::{Increment, Motion};
use crate::model::Model;
use crate::rotation::{exp, left_jacobian_inverse, log};
use crate::sample::{ImuSample, SampleKind};
use nalgebra::{UnitQuaternion, Vector3};

/// Samples that come faster are averaged down to about this, Hz: the fixes see nothing of what lies above. Of 112 logs with a true attitude one
/// changed by more than .1°, to the better (`gaware replay LOG… --truth-from 20 --json`, 2026-11-30).
const ENOUGH_HZ: f64 = 50.0;
/// Averaging goes on until samples come so much less often than when it began: a rate at the limit begins it once.
const SLOWER: f64 = 1.3;

/// How many samples so far apart, s, go into one mean.
pub(crate) fn at_once(interval_s: f64) -> usize {
    (1.0 / (ENOUGH_HZ * interval_s.max(1e-4))).round().max(1.0) as usize
}

/// What the samples of a group make of the body.
#[derive(Debug, Clone, Copy)]
struct Group {
    begun_s: f64,
    turned: UnitQuaternion<f64>,
    dv: Vector3<f64>,
}

impl Group {
    fn begin(t_s: f64) -> Self {
        Self { begun_s: t_s, turned: UnitQuaternion::identity(), dv: Vector3::zeros() }
    }

    fn add(&mut self, last: &ImuSample, next: &ImuSample, kind: SampleKind) {
        let motion = |s: &ImuSample| Motion { rate: s.gyro, force: s.accel };
        let step = Increment::between(&motion(last), &motion(next), kind, next.t_s - last.t_s);
        self.dv += self.turned * step.dv;
        self.turned *= exp(&step.dtheta);
    }

    fn mean(&self, end: &ImuSample) -> ImuSample {
        let (span_s, turn) = (end.t_s - self.begun_s, log(&self.turned));
        let accel = left_jacobian_inverse(&turn) * self.dv / span_s;
        ImuSample { gyro: turn / span_s, accel, ..*end }
    }
}

/// Takes samples and gives fewer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Averager {
    /// Whether every sample counts, however fast they come …
    none: bool,
    /// … and if not, whether they come so fast that it does anything.
    averages: bool,
    last: Option<ImuSample>,
    group: Option<Group>,
}

impl Averager {
    /// For what this model estimates: what an error that is not linear in the motion adds to a mean is not what the mean shows (vibration is lost).
    pub(crate) fn of(model: &Model) -> Self {
        let mut acts = model.effects.iter().filter(|s| s.effect.acts_on(ActsOn::Samples));
        Self { none: acts.any(|s| !s.effect.is_linear()), ..Self::default() }
    }

    /// Takes a sample of this kind; such samples are `interval_s` apart. Gives what there is to go on with, if anything.
    pub(crate) fn take(
        &mut self,
        sample: &ImuSample,
        kind: SampleKind,
        interval_s: f64,
    ) -> Option<ImuSample> {
        let last = self.last.replace(*sample);
        let limit = if self.averages { SLOWER } else { 1.0 };
        self.averages = !self.none && interval_s > 0.0 && at_once(interval_s / limit) > 1;
        // One that is not newer is left to whoever comes after: time may have begun anew.
        let Some(last) = last.filter(|last| self.averages && sample.t_s > last.t_s) else {
            self.group = None;
            return Some(*sample);
        };
        let group = self.group.get_or_insert(Group::begin(last.t_s));
        let dt = sample.t_s - last.t_s;
        let mean = if dt > GAP_S {
            // Nothing is known of it but its ends.
            let half = if kind == SampleKind::Point { 0.5 } else { 1.0 };
            let (gyro, accel) = (last.gyro.lerp(&sample.gyro, half), last.accel.lerp(&sample.accel, half));
            ImuSample { gyro, accel, ..*sample }
        } else {
            group.add(&last, sample, kind);
            if sample.t_s - group.begun_s < (at_once(interval_s) as f64 - 0.5) * interval_s {
                return None;
            }
            group.mean(sample)
        };
        *group = Group::begin(sample.t_s);
        Some(mean)
    }

    /// What kind of samples it gives.
    pub(crate) fn kind(&self, taken: SampleKind) -> SampleKind {
        if self.averages { SampleKind::IntervalMean } else { taken }
    }

    /// How far apart they are where it takes some that are `interval_s` apart, s.
    pub(crate) fn interval_s(&self, interval_s: f64) -> f64 {
        if self.averages { interval_s * at_once(interval_s) as f64 } else { interval_s }
    }
}

/// Samples of this kind that are `interval_s` apart as those there are to go on with.
pub(crate) fn averaged(samples: &[ImuSample], kind: SampleKind, interval_s: f64) -> Vec<ImuSample> {
    let mut averager = Averager::default();
    samples.iter().filter_map(|sample| averager.take(sample, kind, interval_s)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;
    use crate::math::{cos, sin};
    use crate::mechanization::{NavState, step};
    use crate::model::EffectSetting;
    use crate::rotation::c_nb_from_euler;

    /// A cone of 2 deg at 8 Hz, accelerations in phase with it, and a turn.
    fn shaken(t_s: f64) -> ImuSample {
        let (s, c) = (sin(50.0 * t_s), cos(50.0 * t_s));
        let gyro = Vector3::new(1.7 * c, -1.7 * s, 0.4);
        let accel = Vector3::new(3.0 * s, 2.0 * c, -9.8 + sin(2.0 * t_s));
        ImuSample { t_s, gyro, accel, temperature_degc: Some(20.0 + t_s) }
    }

    fn navigate(samples: &[ImuSample], kind: SampleKind) -> NavState {
        let place = Geodetic::from_degrees(48.0, 11.0, 500.0);
        let start = NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(0.1, -0.2, 2.0));
        let motion = |s: &ImuSample| Motion { rate: s.gyro, force: s.accel };
        samples.windows(2).fold(start, |nav, w| {
            step(&nav, &Increment::between(&motion(&w[0]), &motion(&w[1]), kind, w[1].t_s - w[0].t_s))
        })
    }

    /// Coning and sculling of a group are in its mean: attitude and velocity after 10 s are those of all samples.
    #[test]
    fn means_lead_where_all_samples_lead() {
        let samples: Vec<_> = (0..=2000).map(|k| shaken(f64::from(k) * 0.005)).collect();
        let means = averaged(&samples, SampleKind::Point, 0.005);
        assert_eq!(means.len(), 501);
        let (all, few) = (navigate(&samples, SampleKind::Point), navigate(&means, SampleKind::IntervalMean));
        let turned = log(&(all.q_eb.inverse() * few.q_eb)).norm();
        assert!(turned < 2e-5, "{turned} rad");
        let off = (all.v_e - few.v_e).norm();
        assert!(off < 1e-3, "{off} m/s");
        // Sums alone would miss what the cone turns the body by.
        let sums: Vec<_> = samples
            .chunks(4)
            .map(|c| {
                let mean = |f: fn(&ImuSample) -> Vector3<f64>| c.iter().map(f).sum::<Vector3<f64>>() / 4.0;
                ImuSample { gyro: mean(|s| s.gyro), accel: mean(|s| s.accel), ..c[c.len() - 1] }
            })
            .collect();
        let missed = log(&(all.q_eb.inverse() * navigate(&sums, SampleKind::IntervalMean).q_eb)).norm();
        assert!(missed > 100.0 * turned, "{missed} rad");
    }

    #[test]
    fn slow_samples_pass_as_they_are_and_a_rate_at_the_limit_changes_once() {
        let slow: Vec<_> = (0..50).map(|k| shaken(f64::from(k) * 0.02)).collect();
        assert_eq!(averaged(&slow, SampleKind::Point, 0.02), slow);
        let mut averager = Averager::default();
        let mut changes = 0;
        for k in 0..100 {
            let interval_s = 1.0 / (75.0 + f64::from(k % 3));
            let before = averager.kind(SampleKind::Point);
            averager.take(&shaken(f64::from(k) * 0.0133), SampleKind::Point, interval_s);
            changes += usize::from(averager.kind(SampleKind::Point) != before);
        }
        assert_eq!(changes, 1);
    }

    #[test]
    fn what_is_not_linear_in_the_motion_gets_every_sample() {
        for (name, means) in
            [("accel_nonlinearity", false), ("accel_lever_arm", false), ("accel_scale_factor", true)]
        {
            let mut model = Model::default();
            model.set(EffectSetting::unknown(crate::effects::find(name).unwrap()));
            let mut averager = Averager::of(&model);
            let all = (0..100).map(|k| shaken(f64::from(k) * 0.0025));
            let given = all.filter_map(|s| averager.take(&s, SampleKind::Point, 0.0025)).count();
            assert_eq!(given == 100, !means, "{name}: {given}");
            assert_eq!(averager.kind(SampleKind::Point) == SampleKind::IntervalMean, means);
        }
    }

    /// A boot that went unnoticed: the samples after it are means of what came after it.
    #[test]
    fn time_may_begin_anew() {
        let times =
            (0..40).map(|k| 100.0 + f64::from(k) * 0.005).chain((0..40).map(|k| f64::from(k) * 0.005));
        let samples: Vec<_> = times.map(|t_s| ImuSample { t_s, ..shaken(0.0) }).collect();
        let means = averaged(&samples, SampleKind::Point, 0.005);
        let after = means.iter().skip_while(|s| s.t_s > 50.0);
        assert_eq!(after.clone().count(), 10);
        for mean in after {
            assert!(
                (mean.gyro - samples[0].gyro).norm() < 1e-9 && (mean.accel - samples[0].accel).norm() < 0.1
            );
        }
    }

    /// A second without samples at a high rate of turn: the mean is that of its ends, not of an angle that went round.
    #[test]
    fn a_gap_is_judged_by_its_ends() {
        let at = |t_s: f64, z: f64| ImuSample { t_s, gyro: Vector3::new(0.0, 0.0, z), ..shaken(0.0) };
        let samples = [at(0.0, 6.0), at(0.005, 6.0), at(1.005, 8.0), at(1.01, 8.0)];
        let means = averaged(&samples, SampleKind::Point, 0.005);
        assert_eq!(means.len(), 2, "the first, and one over the gap");
        assert!((means[1].gyro.z - 7.0).abs() < 1e-12);
    }
}
