//! The attitude across a gap in the samples: that of another filter, which saw what this one did not.
//!
//! It is no measurement. A vehicle that rolled unseen is linearised about where the other filter had it at the first fix after the
//! gap, while mean and covariance stay those of the gap: linearising about an attitude that is half a radian off loses
//! the vehicle. And where both filters' attitudes differ across the gap by more than interpolation usually misses, the
//! gap's covariance is widened by that. Without another filter's attitude a gap that leaves the attitude uncertain ends the stretch.

use super::linear::Unseen;
use crate::mechanization::NavState;
use crate::rotation::{c_nb_from_euler, exp, log};
use crate::sample::{AttitudeHint, ImuSample, Sample};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

/// After gaps that leave the attitude more certain than this there is nothing to guess, rad.
const UNCERTAIN: f64 = 0.1;
/// Guesses farther apart than this do not show what lies between them, s.
const APART_S: f64 = 0.3;
/// An attitude this far from a gap, with samples between, still leads across it, s.
const NEAR_S: f64 = 1.0;
/// The first fix after a gap comes within this, s.
const AFTER_S: f64 = 3.0;

/// Attitudes of another filter in order of time.
type Attitudes = Vec<(f64, UnitQuaternion<f64>)>;

/// Attitudes of another filter after the gaps of a flight.
#[derive(Debug, Clone, Default)]
pub(super) struct Guesses(Attitudes);

fn attitudes(samples: &[Sample]) -> Attitudes {
    let own = |hint: &AttitudeHint| {
        let [roll, pitch, yaw] = hint.roll_pitch_yaw;
        let c_nb = Rotation3::from_matrix_unchecked(c_nb_from_euler(roll, pitch, yaw));
        (hint.t_s, UnitQuaternion::from_rotation_matrix(&c_nb))
    };
    let hints = samples.iter().filter_map(|s| match s {
        Sample::Attitude(hint) => Some(own(hint)),
        _ => None,
    });
    let mut all: Attitudes = hints.filter(|(_, q)| q.coords.iter().all(|c| c.is_finite())).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// The attitudes right before and right after a gap.
fn around(all: &Attitudes, from_s: f64, to_s: f64) -> Option<[(f64, UnitQuaternion<f64>); 2]> {
    let before = *all.get(all.partition_point(|a| a.0 <= from_s).checked_sub(1)?)?;
    let after = *all.get(all.partition_point(|a| a.0 < to_s))?;
    (from_s - before.0 < NEAR_S && after.0 - to_s < NEAR_S).then_some([before, after])
}

/// How the samples say that the vehicle turned between two times, with interpolation over gaps.
fn turned(raw: &[ImuSample], from_s: f64, to_s: f64) -> UnitQuaternion<f64> {
    let first = raw.partition_point(|s| s.t_s <= from_s).saturating_sub(1);
    let mut q = UnitQuaternion::identity();
    for pair in raw.get(first..).unwrap_or_default().windows(2).take_while(|pair| pair[0].t_s < to_s) {
        let dt = pair[1].t_s.min(to_s) - pair[0].t_s.max(from_s);
        q *= exp(&((pair[0].gyro + pair[1].gyro) * (0.5 * dt.max(0.0))));
    }
    q
}

/// Widens the gaps of samples in order of time by what the other filter's attitudes show that interpolation missed; returns the
/// ends of those that leave the attitude uncertain and that no attitude leads across, s.
pub(super) fn learn(samples: &[Sample], raw: &[ImuSample], unseen: &mut Unseen) -> Vec<f64> {
    let all = attitudes(samples);
    let spans: Vec<(f64, f64)> = unseen.spans_s().collect();
    let mut blind = Vec::new();
    for (k, (from_s, to_s)) in spans.into_iter().enumerate() {
        match around(&all, from_s, to_s) {
            Some([before, after]) => {
                let missed: Vector3<f64> =
                    log(&(turned(raw, before.0, after.0).inverse() * (before.1.inverse() * after.1)));
                unseen.widen(k, &missed);
            }
            None if unseen.attitude_sigma(from_s, to_s) > UNCERTAIN => blind.push(to_s),
            None => {}
        }
    }
    blind
}

impl Guesses {
    /// Those of a recording that come after a gap.
    pub(super) fn of(samples: &[Sample], unseen: &Unseen) -> Self {
        let mut after = attitudes(samples);
        after.retain(|a| unseen.hides(a.0 - AFTER_S, a.0));
        Self(after)
    }

    /// The same at another time.
    pub(super) fn move_by(&mut self, by_s: f64) {
        self.0.iter_mut().for_each(|g| g.0 += by_s);
    }

    /// The state as predicted at the first fix after a gap, with the attitude that was guessed; `None` where the samples
    /// since the last fix say enough.
    pub(super) fn at(
        &self,
        unseen: &Unseen,
        since_s: f64,
        t_s: f64,
        predicted: &NavState,
    ) -> Option<NavState> {
        if unseen.attitude_sigma(since_s, t_s) < UNCERTAIN {
            return None;
        }
        let next = self.0.partition_point(|g| g.0 < t_s);
        let (a, b) = (self.0.get(next.checked_sub(1)?)?, self.0.get(next)?);
        let apart_s = b.0 - a.0;
        if apart_s > APART_S || unseen.hides(a.0, b.0) {
            return None;
        }
        let share = if apart_s > 0.0 { (t_s - a.0) / apart_s } else { 0.0 };
        let c_nb = a.1.try_slerp(&b.1, share, 1e-9)?.to_rotation_matrix().into_inner();
        let place = NavState::from_ned(predicted.geodetic(), &predicted.v_n(), &c_nb);
        Some(NavState { q_eb: place.q_eb, ..*predicted })
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;
    use crate::sample::SampleKind;

    /// A vehicle that flies straight, but for a second of which it rolls by 0.6 rad and is not seen.
    fn rolled(with_attitude: bool) -> (Vec<Sample>, Vec<ImuSample>) {
        let roll = |t_s: f64| 0.6 * (t_s - 50.0).clamp(0.0, 1.0);
        let all = (0..5000).map(|k| f64::from(k) * 0.02);
        let raw = all.clone().filter(|t| !(50.0..51.0).contains(t)).map(|t_s| ImuSample {
            t_s,
            gyro: Vector3::new(1e-3 * sin(3.0 * t_s), 0.3 * sin(0.7 * t_s), 0.0),
            accel: Vector3::new(0.0, 0.0, -9.8),
            temperature_degc: None,
        });
        let pitch = |t_s: f64| 0.3 / 0.7 * (1.0 - cos(0.7 * t_s));
        let hint = |t_s: f64| AttitudeHint { t_s, roll_pitch_yaw: [roll(t_s), pitch(t_s), 0.0] };
        let hints =
            all.filter(|t| with_attitude && !(50.0..51.0).contains(t)).map(|t| Sample::Attitude(hint(t)));
        (hints.collect(), raw.collect())
    }

    #[test]
    fn a_roll_that_no_sample_shows_widens_its_gap() {
        let (hints, raw) = rolled(true);
        let mut unseen = Unseen::of(&raw, SampleKind::Point);
        let before = unseen.attitude_sigma(50.0, 51.0);
        assert_eq!(learn(&hints, &raw, &mut unseen), [] as [f64; 0]);
        let after = unseen.attitude_sigma(50.0, 51.0);
        assert!(before < 0.2 && (0.55..0.75).contains(&after), "{before} {after}");
    }

    #[test]
    fn without_an_attitude_an_uncertain_gap_is_blind() {
        let (hints, raw) = rolled(false);
        // So short a flight says nothing of its own gaps.
        let few: Vec<ImuSample> =
            raw.iter().filter(|s| (46.0..55.0).contains(&s.t_s)).step_by(12).copied().collect();
        let mut unseen = Unseen::of(&few, SampleKind::Point);
        let blind = learn(&hints, &few, &mut unseen);
        assert!(blind.iter().any(|t| (51.0..51.3).contains(t)), "{blind:?}");
    }
}
