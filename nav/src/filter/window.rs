//! Large initial errors: once the attitude is known, what led there is run again, linearised where the vehicle really was.
//!
//! While the attitude is uncertain by many degrees each fix brings little, and each is applied with a slightly wrong
//! Jacobian; the errors of a hundred such updates add up and the covariance comes out too small. So the steps
//! since the start are kept, and when the attitude has become known they are run again as a *linear* filter about the
//! trajectory that ends in the present estimate: the error's mean is carried along instead of being put into the
//! state. This is the iterated extended Kalman smoother at the first state (Bell 1994, "The iterated Kalman smoother as
//! a Gauss-Newton method").

use super::Filter;
use super::layout::index;
use super::nav_map::{Dense, Recentring};
use crate::consistency::error;
use crate::mechanization::{Increment, NavState, step};
use crate::sample::{GnssFix, ImuSample};
use nalgebra::{SMatrix, Vector3};

/// Attitude uncertainty above which a window is kept, rad.
const OPEN: f64 = 0.05;
/// Attitude uncertainty below which it is run again, rad.
const CLOSE: f64 = 0.03;
/// Without the attitude getting known a window ends after this long, s, and the next begins.
const LONGEST_S: f64 = 20.0;
/// A window that took less than this share off the attitude uncertainty is not worth running again.
const WORTH: f64 = 0.2;
/// Passes: Gauss-Newton steps.
const PASSES: usize = 3;

/// One step of a filter, to be repeated.
#[derive(Debug, Clone)]
pub(super) enum Step {
    /// To the time of a sample.
    Sample(ImuSample),
    /// To a time before the next sample.
    To(f64, ImuSample),
    /// A fix at the present time.
    Fix(GnssFix),
}

/// The filter at the start of the window and every step since.
#[derive(Debug, Clone)]
pub(super) struct Window {
    prior: Filter,
    /// Each step with the noise beyond the model's at its time.
    steps: Vec<(Step, (f64, f64))>,
}

fn uncertainty(filter: &Filter) -> f64 {
    filter.covariance().block3(index::ATTITUDE).diagonal().max().max(0.0).sqrt()
}

impl Window {
    /// A window from this filter on, where its attitude is uncertain enough.
    pub(super) fn open(filter: &Filter) -> Option<Self> {
        (uncertainty(filter) > OPEN).then(|| Self { prior: filter.clone(), steps: Vec::new() })
    }

    /// Keeps a step.
    pub(super) fn keep(&mut self, step: Step, extra_noise: (f64, f64)) {
        self.steps.push((step, extra_noise));
    }

    /// Whether it is time to run the window again (or to give it up).
    pub(super) fn is_over(&self, now: &Filter) -> bool {
        uncertainty(now) < CLOSE || now.t_s() - self.prior.t_s() > LONGEST_S
    }

    /// The present state anew: the window run again about the trajectory that ends in `now`. `None` where that is not
    /// worth it or leads nowhere.
    pub(super) fn run_again(&self, now: &Filter) -> Option<Filter> {
        if uncertainty(now) > (1.0 - WORTH) * uncertainty(&self.prior) {
            return None;
        }
        let mut best = now.clone();
        for _ in 0..PASSES {
            best = self.pass(&best)?;
        }
        let sound = best.covariance().is_sound() && best.nav().r_e.iter().all(|x| x.is_finite());
        sound.then_some(best)
    }

    fn pass(&self, now: &Filter) -> Option<Filter> {
        let mut filter = self.prior.clone();
        filter.start_linear(&self.traced_back(now), now)?;
        for (step, extra_noise) in &self.steps {
            filter.set_stream(now.kind(), *extra_noise);
            match step {
                Step::Sample(sample) => filter.propagate(sample),
                Step::To(t_s, next) => filter.propagate_to(*t_s, next),
                Step::Fix(fix) => drop(filter.update(fix)),
            }
        }
        filter.end_linear();
        Some(filter)
    }

    /// The mechanisation run backwards from the present estimate to the start of the window.
    fn traced_back(&self, now: &Filter) -> NavState {
        let motion = |s: &ImuSample| now.calibration().motion(now.model(), s);
        let samples = self.steps.iter().rev().filter_map(|(s, _)| match s {
            Step::Sample(sample) => Some(sample),
            _ => None,
        });
        let (mut nav, mut t_s, mut at) = (*now.nav(), now.t_s(), *now.motion());
        let mut back = |to_s: f64, next: crate::mechanization::Motion| {
            // A mean belongs to the interval that ends at its time: going back, that is the later of the two.
            let other = if now.kind() == crate::sample::SampleKind::Point { next } else { at };
            nav = step(&nav, &Increment::between(&at, &other, now.kind(), to_s - t_s));
            (t_s, at) = (to_s, next);
        };
        for sample in samples.filter(|s| s.t_s < now.t_s()) {
            back(sample.t_s, motion(sample));
        }
        let first = self.prior.last.as_ref().map_or(self.prior.motion, motion);
        back(self.prior.t_s(), first);
        nav
    }
}

impl Filter {
    /// From here on the mean error is carried along: the state is that of `nav` with the constants of `like`, the mean and
    /// covariance those of this filter, expressed about it.
    fn start_linear(&mut self, nav: &NavState, like: &Filter) -> Option<()> {
        let (own_nav, own_constants) = (self.nav, self.calibration.clone());
        self.nav = *nav;
        self.calibration = like.calibration.clone();
        let mean = error(self, &own_nav, &own_constants);
        let part = |at: usize| Vector3::new(mean[at], mean[at + 1], mean[at + 2]);
        let forward =
            Recentring::new(&part(index::POSITION), &part(index::VELOCITY), &part(index::ATTITUDE)).dense();
        let inverse = SMatrix::<f64, 9, 9>::from_fn(|i, j| forward[i][j]).try_inverse()?;
        self.p.transform(&Dense(std::array::from_fn(|i| std::array::from_fn(|j| inverse[(i, j)]))));
        self.carried = Some(mean);
        self.refresh_motion();
        self.regressor.let_through();
        self.refresh_motion();
        Some(())
    }

    /// Puts the carried error into the state.
    fn end_linear(&mut self) {
        if let Some(mean) = self.carried.take() {
            self.correct(&mean);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::{self, Geodetic};
    use crate::filter::{Fusion, Initial};
    use crate::model::Model;
    use crate::rotation::{c_nb_from_euler, exp};
    use crate::sample::FixVelocity;

    /// A standing vehicle whose filter starts 40° off in roll: after the window the estimate is that of a filter that
    /// started at the truth with the same prior, to a small part of its sigma.
    #[test]
    fn a_large_initial_error_leaves_no_trace() {
        let place = Geodetic::from_degrees(47.0, 8.0, 400.0);
        let truth = NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(0.0, 0.0, 1.0));
        let to_body = truth.q_eb.inverse();
        let estimate = |off: f64| {
            let nav = NavState { q_eb: truth.q_eb * exp(&Vector3::new(off, 0.0, 0.0)), ..truth };
            let initial = Initial {
                t_s: 0.0,
                nav,
                position_sigma_m: [1.0; 3],
                velocity_sigma_m_per_s: [0.3; 3],
                attitude_sigma_rad: [0.7, 0.7, 0.01],
            };
            let mut fusion = Fusion::new(Filter::new(&Model::default(), &initial));
            for i in 0..800 {
                let t_s = f64::from(i) * 0.01;
                fusion.push_imu(ImuSample {
                    t_s,
                    gyro: to_body * earth::rotation_rate(),
                    accel: to_body * -earth::gravity(&truth.r_e),
                    temperature_degc: None,
                });
                if i % 10 == 9 {
                    fusion.push_fix(GnssFix {
                        t_s,
                        position: place,
                        velocity: FixVelocity::Full([0.0; 3]),
                        position_sigma_m: None,
                        velocity_sigma_m_per_s: None,
                        yaw_rad: None,
                    });
                }
                while fusion.poll().is_some() {}
            }
            fusion.filter().clone()
        };
        let (good, bad) = (estimate(0.0), estimate(0.7));
        let off = good.nav().q_eb.rotation_to(&bad.nav().q_eb).scaled_axis();
        let tilt_sigma = good.covariance().sigma(index::ATTITUDE);
        assert!(off.xy().norm() < 0.1 * tilt_sigma, "{off} {tilt_sigma}");
        let ratio = bad.covariance().sigma(index::ATTITUDE) / tilt_sigma;
        assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
    }
}
