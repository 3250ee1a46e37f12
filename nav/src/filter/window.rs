//! What led to the present run again, linearised where the vehicle really was, once the attitude has become known.
//!
//! While the attitude is uncertain each fix brings little, and each is applied with a slightly wrong Jacobian; the errors of a
//! hundred such updates add up and the covariance comes out too small, or the estimates biased. It takes many degrees in a
//! vehicle that stands, a degree in one whose accelerometer biases wait for the first turns (the vertical one
//! then is wrong by the others' squares over 2 g), and a tenth of a degree where G is learned at 80 g. So while it is like that the
//! steps are kept, and when the attitude has become known they are run again as a *linear* filter about the
//! trajectory that ends in the present estimate: the error's mean is carried along instead of being put into the
//! state. This is the iterated extended Kalman smoother at the first state (Bell 1994, "The iterated Kalman smoother as
//! a Gauss-Newton method").

use super::force_rate::ForceRates;
use super::layout::index;
use super::{Filter, FixOutcome};
use crate::consistency::error;
use crate::displacement::Displacement;
use crate::effects::BiasWalk;
use crate::mechanization::{Increment, NavState, step};
use crate::sample::{GnssFix, ImuSample};
use std::sync::Arc;

/// A window is kept from this uncertainty on.
const OPEN: Doubt = Doubt { attitude: 0.05, force: 5e-4 };
/// Below this uncertainty it is run again.
const CLOSE: Doubt = Doubt { attitude: 0.03, force: 2e-4 };
/// Without the attitude getting known a window ends after this long, s, and the next begins.
const LONGEST_S: f64 = 60.0;
/// When the attitude uncertainty has fallen to this share, what there is of the window is run again.
const FELL: f64 = 0.7;
/// … but not before the window has grown to so many times its length then: all passes together cost a few lengths of it.
const GROWN: f64 = 1.3;
/// Passes: Gauss-Newton steps.
const PASSES: usize = 3;
/// A pass under which the fixes are less likely by more than this, nats, is not taken over: the trajectory that it was
/// linearised about is wrong, because the model is.
const WORSE: f64 = 3.0;
/// No further pass when the last one moved no state by more than this share of its sigma.
const SETTLED: f64 = 0.02;

/// How far the attitude is from being known.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Doubt {
    /// 1-sigma of its worst axis, rad.
    attitude: f64,
    /// What linearisation leaves out of the specific force, ½ ε × (ε × f), as the product of the RMS of both factors, m/s².
    force: f64,
}

impl Doubt {
    fn of(filter: &Filter) -> Self {
        let p = filter.covariance().block3(index::ATTITUDE);
        let force = filter.regressor.motion().force;
        Self {
            attitude: p.diagonal().max().max(0.0).sqrt(),
            // E|ε × f|² = tr P |f|² − fᵀ P f.
            force: 0.5
                * (p.trace() * (p.trace() * force.norm_squared() - force.dot(&(p * force)))).max(0.0).sqrt(),
        }
    }

    fn exceeds(&self, limit: &Self) -> bool {
        self.attitude > limit.attitude || self.force > limit.force
    }

    fn worse(&self, other: &Self) -> Self {
        Self { attitude: self.attitude.max(other.attitude), force: self.force.max(other.force) }
    }

    /// Whether this is much less than `before`, where that was worth a window.
    fn fell(&self, before: &Self) -> bool {
        let attitude = before.attitude > CLOSE.attitude && self.attitude < FELL * before.attitude;
        // The force goes with the square of the attitude.
        attitude || (before.force > CLOSE.force && self.force < FELL * FELL * before.force)
    }
}

/// How well a pass agrees with the fixes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Agreement {
    /// Logarithm of the likelihood of all innovations.
    log_likelihood: f64,
    /// Groups of measurements that were refused.
    refused: u32,
}

impl Agreement {
    fn take(&mut self, outcome: &FixOutcome) {
        for group in [&outcome.position, &outcome.velocity].into_iter().filter(|g| g.dof > 0) {
            self.log_likelihood += group.log_likelihood;
            self.refused += u32::from(!group.used);
        }
    }

    /// Whether this is as good as `other`, but for what relinearisation moves at random.
    fn holds_against(&self, other: &Self) -> bool {
        self.refused <= other.refused && self.log_likelihood > other.log_likelihood - WORSE
    }
}

/// One step of a filter, to be repeated.
#[derive(Debug, Clone)]
pub(super) enum Step {
    /// To the time of a sample.
    Sample(ImuSample),
    /// To a time before the next sample.
    To(f64, ImuSample),
    /// A fix at the present time, with the motion around it.
    Fix(GnssFix, Option<Arc<ForceRates>>),
}

/// The filter at the start of the window and every step since.
#[derive(Debug, Clone)]
pub(super) struct Window {
    prior: Filter,
    /// Each step with the noise beyond the model's at its time.
    steps: Vec<(Step, (f64, f64))>,
    /// The greatest uncertainty since it was opened or last run again.
    worst: Doubt,
    /// How well the present state's pass agrees with the fixes.
    agreement: Agreement,
    /// Not run again before this time, s, unless it is over.
    rests_until_s: f64,
}

impl Window {
    /// A window from this filter on, where its attitude is uncertain enough.
    pub(super) fn open(filter: &Filter) -> Option<Self> {
        let worst = Doubt::of(filter);
        worst.exceeds(&OPEN).then(|| Self {
            prior: filter.clone(),
            steps: Vec::new(),
            worst,
            agreement: Agreement::default(),
            rests_until_s: filter.t_s(),
        })
    }

    /// What is run again has this walk of the biases too.
    pub(super) fn set_walk(&mut self, walk: BiasWalk) {
        self.prior.set_walk(walk);
    }

    /// Keeps a step.
    pub(super) fn keep(&mut self, step: Step, extra_noise: (f64, f64)) {
        self.steps.push((step, extra_noise));
    }

    /// Takes what became of the last fix.
    pub(super) fn record(&mut self, outcome: &FixOutcome) {
        self.agreement.take(outcome);
    }

    /// Whether fixes have failed to come for so long that it must be given up: it would fill the memory.
    pub(super) fn is_stale(&self, now: &Filter) -> bool {
        now.t_s() - self.prior.t_s() > 2.0 * LONGEST_S
    }

    /// Whether no more can come of it.
    pub(super) fn is_over(&self, now: &Filter) -> bool {
        !Doubt::of(now).exceeds(&CLOSE) || now.t_s() - self.prior.t_s() > LONGEST_S
    }

    /// The present state anew where it is time for that: the window run again about the trajectory that ends in `now`.
    pub(super) fn look_back(&mut self, now: &Filter) -> Option<Filter> {
        let doubt = Doubt::of(now);
        self.worst = self.worst.worse(&doubt);
        let resting = now.t_s() < self.rests_until_s && !self.is_over(now);
        if resting || !now.regressor.moved_lately() || !doubt.fell(&self.worst) {
            return None;
        }
        let again = self.run_again(now);
        self.worst = Doubt::of(again.as_ref().unwrap_or(now));
        self.rests_until_s = self.prior.t_s() + GROWN * (now.t_s() - self.prior.t_s());
        again
    }

    /// `None` where it gives nothing better.
    fn run_again(&mut self, now: &Filter) -> Option<Filter> {
        let mut best = now.clone();
        let mut agreement = Agreement::default();
        for _ in 0..PASSES {
            let next;
            (next, agreement) = self.pass(&best)?;
            let moved = error(&best, next.nav(), next.calibration());
            best = next;
            if (0..moved.len()).all(|s| moved[s].abs() <= SETTLED * best.covariance().sigma(s)) {
                break;
            }
        }
        let sound = best.covariance().is_sound() && best.nav().r_e.iter().all(|x| x.is_finite());
        if !sound || !agreement.holds_against(&self.agreement) {
            return None;
        }
        self.agreement = agreement;
        Some(best)
    }

    fn pass(&self, now: &Filter) -> Option<(Filter, Agreement)> {
        let mut filter = self.prior.clone();
        let mut agreement = Agreement::default();
        filter.start_linear(&self.traced_back(now), now)?;
        for (step, extra_noise) in &self.steps {
            filter.set_stream(now.kind(), *extra_noise);
            match step {
                Step::Sample(sample) => filter.take(sample),
                Step::To(t_s, next) => filter.propagate_to(*t_s, next),
                Step::Fix(fix, nearby) => agreement.take(&filter.update_among(fix, nearby.clone())),
            }
        }
        filter.end_linear();
        Some((filter, agreement))
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
        let first = self.prior.last.as_ref().map_or(*self.prior.motion(), motion);
        back(self.prior.t_s(), first);
        nav
    }
}

impl Filter {
    /// From here on the mean error is carried along: the state is that of `nav` with the constants of `like`, the mean and
    /// covariance those of this filter, expressed about it.
    fn start_linear(&mut self, nav: &NavState, like: &Filter) -> Option<()> {
        self.arrive();
        self.recentre();
        let old = self.about.clone();
        (self.about.nav, self.about.calibration) = (*nav, like.calibration().clone());
        let gauss_markov = std::mem::replace(&mut self.x, vec![0.0; self.layout.len()]);
        let mean = error(self, &old.nav, &old.calibration);
        self.p.transform(&self.about.nav.recentring(&Displacement::of(&mean)).inverse()?);
        self.x = mean;
        if let Some(w) = self.layout.gauss_markov() {
            self.x[w..].copy_from_slice(&gauss_markov[w..]);
        }
        self.pinned = true;
        self.refresh_motion();
        self.regressor.let_through();
        self.refresh_motion();
        self.find_estimate();
        Some(())
    }

    /// Moves what is linearised about to the estimate, which it follows again.
    fn end_linear(&mut self) {
        self.arrive();
        self.pinned = false;
        self.recentre();
        self.find_estimate();
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{asin, sin};

    use super::*;
    use crate::earth::{self, Geodetic};
    use crate::effects::GpsLatency;
    use crate::filter::{Fusion, Initial};
    use crate::model::{EffectSetting, Model};
    use crate::rotation::{c_nb_from_euler, exp};
    use crate::sample::FixVelocity;
    use nalgebra::Vector3;

    const PLACE: (f64, f64, f64) = (47.0, 8.0, 400.0);

    fn at_rest(yaw: f64) -> NavState {
        let place = Geodetic::from_degrees(PLACE.0, PLACE.1, PLACE.2);
        NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(0.0, 0.0, yaw))
    }

    fn started(nav: NavState, model: &Model, attitude_sigma_rad: [f64; 3]) -> Filter {
        let initial = Initial {
            t_s: 0.0,
            nav,
            position_sigma_m: [1.0; 3],
            velocity_sigma_m_per_s: [0.3; 3],
            attitude_sigma_rad,
        };
        Filter::new(model, &initial)
    }

    /// A vehicle that stays in place, level, and turns about the vertical: yaw and its rate over time; fixes at 10 Hz.
    fn stay(fusion: &mut Fusion, samples: u32, bias: &Vector3<f64>, yaw: impl Fn(f64) -> (f64, f64)) {
        for i in 0..samples {
            let t_s = f64::from(i) * 0.01;
            let (angle, rate) = yaw(t_s);
            let truth = at_rest(angle);
            let to_body = truth.q_eb.inverse();
            fusion.push_imu(ImuSample {
                t_s,
                gyro: to_body * earth::rotation_rate() + Vector3::z() * rate,
                accel: to_body * -earth::gravity(&truth.r_e) + bias,
                temperature_degc: None,
            });
            if i % 10 == 9 {
                fusion.push_fix(GnssFix {
                    t_s,
                    position: truth.geodetic(),
                    velocity: FixVelocity::Full([0.0; 3]),
                    position_sigma_m: None,
                    velocity_sigma_m_per_s: None,
                    yaw_rad: None,
                });
            }
            while fusion.poll().is_some() {}
        }
    }

    /// A stationary vehicle whose filter starts 40° off in roll: after the window the estimate is that of a filter that
    /// started at the truth with the same prior, to a small part of its sigma.
    #[test]
    fn a_large_initial_error_leaves_no_trace() {
        let estimate = |off: f64| {
            let truth = at_rest(1.0);
            let nav = NavState { q_eb: truth.q_eb * exp(&Vector3::new(off, 0.0, 0.0)), ..truth };
            let mut fusion = Fusion::new(started(nav, &Model::default(), [0.7, 0.7, 0.01]));
            stay(&mut fusion, 800, &Vector3::zeros(), |_| (1.0, 0.0));
            fusion.filter().clone()
        };
        let (good, bad) = (estimate(0.0), estimate(0.7));
        let off = good.nav().q_eb.rotation_to(&bad.nav().q_eb).scaled_axis();
        let tilt_sigma = good.covariance().sigma(index::ATTITUDE);
        assert!(off.xy().norm() < 0.1 * tilt_sigma, "{off} {tilt_sigma}");
        let ratio = bad.covariance().sigma(index::ATTITUDE) / tilt_sigma;
        assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
    }

    /// A level vehicle whose forward accelerometer is 0.4 m/s² off takes that for pitch until it turns; in between it learns
    /// a vertical bias that is wrong by 0.4² / 2 g. Once turned it must not assume that any more.
    #[test]
    fn what_tilt_made_of_the_vertical_bias_is_forgotten_once_the_tilt_is_known() {
        const BIAS: f64 = 0.4;
        let model = Model::default();
        let false_pitch = asin(BIAS / earth::STANDARD_GRAVITY);
        let place = Geodetic::from_degrees(PLACE.0, PLACE.1, PLACE.2);
        let nav = NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(0.0, false_pitch, 0.0));
        let vertical_bias = |mut fusion: Fusion| {
            stay(&mut fusion, 3000, &Vector3::new(BIAS, 0.0, 0.0), |t_s| {
                let turning = (t_s - 10.0).clamp(0.0, 6.0);
                (0.5 * turning, if turning > 0.0 && turning < 6.0 { 0.5 } else { 0.0 })
            });
            fusion.filter().calibration().accel_bias.z.abs()
        };
        let start = started(nav, &model, [0.05, 0.05, 0.01]);
        let blind = vertical_bias(Fusion::without_window(start.clone()));
        let seeing = vertical_bias(Fusion::new(start));
        let wrong = BIAS * BIAS / (2.0 * earth::STANDARD_GRAVITY);
        // Counting the products of errors keeps the rest of it away from the bias.
        assert!(blind > 0.2 * wrong, "the flight does not show the effect: {blind}");
        assert!(seeing < 0.1 * wrong, "{seeing} of {wrong}");
    }

    /// The window's steps come at the times that an old delay gave them; the estimate must be that of a filter that knew
    /// the delay from the start.
    #[test]
    fn a_window_about_another_delay_counts_the_fixes_at_their_own_time() {
        const TRUE_DELAY_S: f64 = 0.12;
        let estimate = |believed_s: f64| {
            let mut model = Model::default();
            let mut latency = EffectSetting::unknown(&GpsLatency);
            (latency.values[0], latency.sigmas[0]) = (believed_s, 0.08);
            model.set(latency);
            let mut fusion = Fusion::new(started(at_rest(0.0), &model, [0.1, 0.1, 0.1]));
            forward_and_back(&mut fusion, TRUE_DELAY_S);
            let filter = fusion.filter();
            let state = filter.layout().find("latency").unwrap();
            (filter.fix_delay_s(filter.t_s()), filter.covariance().sigma(state))
        };
        let ((good, sigma), (bad, _)) = (estimate(TRUE_DELAY_S), estimate(0.03));
        assert!((good - TRUE_DELAY_S).abs() < 0.2 * sigma, "{good} {sigma}");
        assert!((bad - good).abs() < 0.2 * sigma, "{bad} {good} {sigma}");
    }

    /// A level sledge that goes north and back, A sin² long, for 20 s; fixes at 10 Hz come late.
    fn forward_and_back(fusion: &mut Fusion, delay_s: f64) {
        const AMPLITUDE_M_PER_S: f64 = 10.0;
        const RATE: f64 = 0.6;
        let speed = |t: f64| if t > 0.0 { AMPLITUDE_M_PER_S * sin(RATE * t).powi(2) } else { 0.0 };
        let way = |t: f64| {
            if t > 0.0 { AMPLITUDE_M_PER_S * (0.5 * t - sin(2.0 * RATE * t) / (4.0 * RATE)) } else { 0.0 }
        };
        let rest = at_rest(0.0);
        let north = rest.geodetic().c_en().column(0).into_owned();
        let at = |t: f64| NavState { r_e: rest.r_e + north * way(t), v_e: north * speed(t), ..rest };
        let to_body = rest.q_eb.inverse();
        for i in 0..2000 {
            let t_s = f64::from(i) * 0.01;
            let nav = at(t_s);
            let acceleration = north * (AMPLITUDE_M_PER_S * RATE * sin(2.0 * RATE * t_s));
            let coriolis = earth::rotation_rate().cross(&nav.v_e) * 2.0;
            fusion.push_imu(ImuSample {
                t_s,
                gyro: to_body * earth::rotation_rate(),
                accel: to_body * (acceleration + coriolis - earth::gravity(&nav.r_e)),
                temperature_degc: None,
            });
            if i % 10 == 9 && t_s > delay_s {
                let then = at(t_s - delay_s);
                fusion.push_fix(GnssFix {
                    t_s,
                    position: then.geodetic(),
                    velocity: FixVelocity::Full(then.v_n().into()),
                    position_sigma_m: None,
                    velocity_sigma_m_per_s: None,
                    yaw_rad: None,
                });
            }
            while fusion.poll().is_some() {}
        }
    }
}
