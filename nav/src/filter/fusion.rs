//! Fixes at their own time: the filter waits at the time of the last fix, samples queue up in front of it, and a fix is
//! applied when the samples around its time of validity are there.
//!
//! The state at the present is the filter run through the queue. A fix may be up to [`BUFFER_S`] old; without fixes the
//! filter follows at that distance.

use super::aid::stationarity::detector::{Detector, SampleNoise};
use super::force_rate::{self, BEFORE_S, ForceRates};
use super::window::{Step, Window};
use super::{Filter, FixOutcome};
use crate::effects::BiasWalk;
use crate::mechanization::{self, Increment, Motion, NavState};
use crate::sample::{GnssFix, ImuSample};
use std::collections::VecDeque;
use std::sync::Arc;

/// How far back a fix may lie, s.
pub const BUFFER_S: f64 = 1.5;
/// A stationary vehicle's filter stays this far behind the newest sample, s: what turns out to be the first motion must not
/// have been taken for rest.
const REST_DELAY_S: f64 = 1.0;
/// A fix this little before the filter's own time is applied all the same, s.
const LATE_S: f64 = 1e-3;
/// More fixes than this never wait: a clock that stands still must not fill the memory.
const MAX_WAITING: usize = 64;

/// Fixes that were not used because of their time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PassedOver {
    /// Older than [`BUFFER_S`] when they came.
    pub late: u64,
    /// Valid before a time that the filter had reached already: at the start, or when the estimate of their delay has grown.
    pub overtaken: u64,
}

impl std::ops::AddAssign for PassedOver {
    fn add_assign(&mut self, other: Self) {
        self.late += other.late;
        self.overtaken += other.overtaken;
    }
}

/// A filter with the samples and fixes that it has not reached yet.
#[derive(Debug, Clone)]
pub struct Fusion {
    filter: Filter,
    samples: VecDeque<ImuSample>,
    /// Those just behind the filter, for fixes that depend on the motion before them.
    passed: VecDeque<ImuSample>,
    fixes: VecDeque<GnssFix>,
    passed_over: PassedOver,
    window: Option<Box<Window>>,
    looks_back: bool,
    /// The state ahead of the filter as predicted last: time, state, motion at that time.
    ahead: Option<(f64, NavState, Motion)>,
    detector: Option<Box<Detector>>,
}

impl Fusion {
    /// Around a filter. Where its attitude is uncertain, what follows is run again once it has become known.
    pub fn new(filter: Filter) -> Self {
        Self::without_window(filter).looking_back()
    }

    /// Around a filter of which nothing is ever run again: for one of many hypotheses.
    pub fn without_window(filter: Filter) -> Self {
        let (samples, passed, fixes) = (VecDeque::new(), VecDeque::new(), VecDeque::new());
        let passed_over = PassedOver::default();
        Self {
            filter,
            samples,
            passed,
            fixes,
            passed_over,
            window: None,
            looks_back: false,
            ahead: None,
            detector: None,
        }
    }

    /// The same, but from now on what leads to a known attitude is run again.
    #[must_use]
    pub fn looking_back(self) -> Self {
        let window = self.open_window();
        Self { window, looks_back: true, ..self }
    }

    /// The same, but a stationary vehicle is recognised and held.
    #[must_use]
    pub fn recognising_rest(self) -> Self {
        Self { detector: Some(Box::default()), ..self }
    }

    /// The filter at the time of the last fix it used (or [`BUFFER_S`] behind).
    pub fn filter(&self) -> &Filter {
        &self.filter
    }

    /// The same, to be changed.
    pub fn filter_mut(&mut self) -> &mut Filter {
        &mut self.filter
    }

    /// Lets the biases walk by so much beyond the model from now on, and in what is run again.
    pub fn set_walk(&mut self, walk: BiasWalk) {
        self.filter.set_walk(walk);
        if let Some(window) = &mut self.window {
            window.set_walk(walk);
        }
    }

    /// Fixes that were not used because of their time.
    pub fn passed_over(&self) -> PassedOver {
        self.passed_over
    }

    /// Time of the newest sample, s.
    pub fn now_s(&self) -> f64 {
        self.samples.back().map_or(self.filter.t_s(), |s| s.t_s)
    }

    /// Takes a sample; those not newer than the newest, and impossible ones, are ignored.
    pub fn push_imu(&mut self, sample: ImuSample) {
        let now = self.now_s();
        if !sample.is_usable() || self.samples.back().is_some_and(|s| sample.t_s <= s.t_s) {
            return;
        }
        if let Some(detector) = &mut self.detector {
            let dt = (sample.t_s - now).max(1e-4);
            detector.push_imu(&sample, &self.filter.sample_noise(dt));
        }
        self.samples.push_back(sample);
    }

    /// Takes a fix; one that is not finite is ignored.
    pub fn push_fix(&mut self, fix: GnssFix) {
        if !fix.is_plausible() {
            self.passed_over.late += 1;
            return;
        }
        if let Some(detector) = &mut self.detector {
            detector.push_fix(&fix, self.filter.model().gnss.velocity_sigma_m_per_s);
        }
        if self.fixes.len() == MAX_WAITING {
            self.fixes.pop_front();
            self.passed_over.late += 1;
        }
        self.fixes.push_back(fix);
    }

    /// Applies the next fix whose time has come and says what became of it; call it until it returns `None`.
    pub fn poll(&mut self) -> Option<FixOutcome> {
        self.begin_or_end_rest();
        let now = self.now_s();
        let ripe_s = now
            - match (self.filter.is_stationary(), self.filter.looks_around_fixes()) {
                (true, _) => REST_DELAY_S,
                (false, true) => force_rate::after_s(self.filter.kernel()),
                (false, false) => 0.0,
            };
        while let Some(fix) = self.fixes.front() {
            let valid_s = fix.t_s - self.filter.fix_delay_s(fix.t_s);
            if valid_s > ripe_s {
                break;
            }
            let fix = self.fixes.pop_front()?;
            if valid_s < self.filter.t_s() - LATE_S {
                if valid_s < now - BUFFER_S {
                    self.passed_over.late += 1;
                } else {
                    self.passed_over.overtaken += 1;
                }
                continue;
            }
            self.ahead = None;
            self.advance_to(valid_s);
            let nearby = self.nearby(valid_s);
            let outcome = self.filter.update_among(&fix, nearby.clone());
            self.keep(Step::Fix(fix, nearby));
            if let Some(window) = &mut self.window {
                window.record(&outcome);
            }
            if outcome.position.recovered || outcome.velocity.recovered {
                // What was started anew cannot be run again.
                self.window = None;
            }
            self.look_back();
            return Some(outcome);
        }
        while let Some(sample) = self.samples.pop_front_if(|s| s.t_s < now - BUFFER_S) {
            self.take(sample);
            self.filter.arrive();
        }
        None
    }

    /// Holds a vehicle that has become stationary, and lets one go that has moved.
    fn begin_or_end_rest(&mut self) {
        let Some(detector) = &mut self.detector else { return };
        if self.filter.moves_by_its_fixes() {
            detector.start_over();
        }
        match (detector.is_stationary(), self.filter.is_stationary()) {
            (true, false) => {
                self.filter.begin_hold();
                if self.filter.is_stationary() {
                    self.window = None;
                } else {
                    detector.start_over();
                }
            }
            (false, true) => {
                self.filter.end_hold();
                self.window = if self.looks_back { Window::open(&self.filter).map(Box::new) } else { None };
            }
            _ => {}
        }
    }

    fn open_window(&self) -> Option<Box<Window>> {
        if self.filter.is_stationary() { None } else { Window::open(&self.filter).map(Box::new) }
    }

    /// The filter at the time of the newest sample.
    pub fn predicted(&self) -> Filter {
        let mut filter = self.filter.clone();
        self.samples.iter().for_each(|s| filter.take(s));
        filter.arrive();
        filter
    }

    /// Position, velocity and attitude at the time of the newest sample, s, without the covariance: cheap. What the samples
    /// since the last call add is all that is computed, until a fix changes the state.
    pub fn predicted_nav(&mut self) -> (f64, NavState) {
        if self.filter.is_stationary() {
            self.ahead = None;
            return (self.now_s(), *self.filter.nav());
        }
        let filter = &self.filter;
        let from_filter = || (filter.t_s(), *filter.nav(), *filter.motion());
        let ahead = self.ahead.filter(|(t_s, ..)| *t_s >= filter.t_s());
        let (mut t_s, mut nav, mut motion) = ahead.unwrap_or_else(from_filter);
        let from = self.samples.partition_point(|s| s.t_s <= t_s);
        for sample in self.samples.range(from..) {
            let next = filter.calibration().motion(filter.model(), sample);
            nav = mechanization::step(
                &nav,
                &Increment::between(&motion, &next, filter.kind(), sample.t_s - t_s),
            );
            (t_s, motion) = (sample.t_s, next);
        }
        self.ahead = Some((t_s, nav, motion));
        (t_s, nav)
    }

    fn advance_to(&mut self, t_s: f64) {
        while let Some(sample) = self.samples.pop_front_if(|s| s.t_s <= t_s) {
            self.take(sample);
        }
        if self.filter.t_s() < t_s
            && let Some(next) = self.samples.front().copied()
        {
            self.filter.propagate_to(t_s, &next);
            self.keep(Step::To(t_s, next));
        }
    }

    /// The motion around an instant that the filter has reached, where its model asks for it.
    fn nearby(&self, t_s: f64) -> Option<Arc<ForceRates>> {
        let samples = || self.passed.iter().chain(&self.samples);
        let rates = || ForceRates::around_instant(samples(), t_s, self.filter.kind());
        if self.filter.looks_around_fixes() { rates().map(Arc::new) } else { None }
    }

    fn take(&mut self, sample: ImuSample) {
        if self.filter.looks_around_fixes() {
            while self.passed.pop_front_if(|s| s.t_s < sample.t_s - BEFORE_S).is_some() {}
            self.passed.push_back(sample);
        }
        if self.filter.is_gap_before(&sample) {
            // Nothing can be run again across it.
            self.window = None;
        }
        self.filter.take(&sample);
        self.keep(Step::Sample(sample));
    }

    fn keep(&mut self, step: Step) {
        if let Some(window) = &mut self.window {
            window.keep(step, self.filter.extra_noise);
            self.window.take_if(|w| w.is_stale(&self.filter));
        }
    }

    /// Runs the window again where it is time for that, and opens the next where the attitude is uncertain.
    fn look_back(&mut self) {
        if !self.looks_back {
            return;
        }
        if let Some(window) = &mut self.window {
            if let Some(again) = window.look_back(&self.filter) {
                self.filter = again;
            }
            if !window.is_over(&self.filter) {
                return;
            }
        }
        self.window = self.open_window();
    }
}

impl Filter {
    /// What white noise and rounding leave in one sample.
    fn sample_noise(&self, dt: f64) -> SampleNoise {
        SampleNoise::of(&self.model().imu, self.extra_noise, self.rounding, dt)
    }
}
