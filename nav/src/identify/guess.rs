//! A first guess of the attitude after a gap in the samples: that of another filter, which saw what this one did not.
//!
//! It is no measurement. A vehicle that rolled unseen is linearised about where the other filter had it at the first fix after the
//! gap, while mean and covariance stay those of the gap: linearising about an attitude that is half a radian off loses
//! the vehicle.

use super::linear::Unseen;
use crate::mechanization::NavState;
use crate::rotation::c_nb_from_euler;
use crate::sample::{AttitudeHint, Sample};
use nalgebra::{Rotation3, UnitQuaternion};

/// After gaps that leave the attitude more certain than this there is nothing to guess, rad.
const UNCERTAIN: f64 = 0.1;
/// Guesses farther apart than this do not show what lies between them, s.
const APART_S: f64 = 0.3;
/// The first fix after a gap comes within this, s.
const AFTER_S: f64 = 3.0;

/// Attitudes of another filter after the gaps of a flight.
#[derive(Debug, Clone, Default)]
pub(super) struct Guesses(Vec<(f64, UnitQuaternion<f64>)>);

impl Guesses {
    /// Those of a recording that come after a gap.
    pub(super) fn of(samples: &[Sample], unseen: &Unseen) -> Self {
        let own = |hint: &AttitudeHint| {
            let [roll, pitch, yaw] = hint.roll_pitch_yaw;
            let c_nb = Rotation3::from_matrix_unchecked(c_nb_from_euler(roll, pitch, yaw));
            (hint.t_s, UnitQuaternion::from_rotation_matrix(&c_nb))
        };
        let hints = samples.iter().filter_map(|s| match s {
            Sample::Attitude(hint) => Some(hint),
            _ => None,
        });
        let after = hints.filter(|h| unseen.hides(h.t_s - AFTER_S, h.t_s));
        let mut guesses: Vec<_> =
            after.map(own).filter(|(_, q)| q.coords.iter().all(|c| c.is_finite())).collect();
        guesses.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(guesses)
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
