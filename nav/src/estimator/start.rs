//! The beginning of an estimation, and each time that it begins anew.

use super::{BIAS_AFTER_RESTART, CERTAIN_TILT, Estimator, EstimatorEvent, State};
use crate::alignment::Gathering;
use crate::averaging::Averager;
use crate::drift::DriftBank;
use crate::filter::{Filter, Fusion, Initial};
use crate::ground::REFERENCE_ERROR;
use crate::heading::{HeadingBank, MEMBERS};
use crate::mechanization::NavState;
use crate::model::SourceHistory;
use crate::noise_meter::NoiseMeter;
use crate::quantisation::Dequantiser;
use crate::rotation::c_nb_from_euler;
use crate::sample::{GnssFix, ImuSample, RestartReason};
use std::sync::Arc;

/// Trust in "a stationary vehicle does not turn": truncation and slow sway, rad/s.
const STANDING_RATE_SIGMA: f64 = 1.5e-3;
/// Where the sigma of the tilt became larger before the attitude was lost, the constants of no longer ago than this go on, s.
const CERTAIN_WITHIN_S: f64 = 300.0;

impl Estimator {
    /// Begins with this fix, where enough is known for it. A heading that is known only after its search has begun ends that: PX4 has one about a second
    /// after its first samples, and a vehicle that hovers shows none.
    pub(super) fn try_start(&mut self, fix: &GnssFix) {
        let (searched, gathering) = match &self.state {
            State::Gathering(gathering) => (None, gathering),
            State::Searching(bank, gathering) => (Some(bank), gathering),
            State::Running(_) => return,
        };
        let position_sigma = fix.position_sigma_m.unwrap_or(self.model.gnss.position_sigma_m);
        let velocity_sigma = fix.velocity_sigma_m_per_s.unwrap_or(self.model.gnss.velocity_sigma_m_per_s);
        let (Some(start), Some(mean)) =
            (gathering.start(fix, position_sigma, velocity_sigma), gathering.mean())
        else {
            return;
        };
        let refuted = |bank: &HeadingBank| !start.heading_known || bank.refutes(&start.initial.nav.c_nb());
        if searched.is_some_and(refuted) {
            return;
        }
        let by_place = self.ground.gave(fix);
        if by_place {
            self.ground.begin(start.heading_known);
        }
        // Rest shows no heading, however long it lasts: it is searched by the first fix.
        let heading_settled = start.heading_known || by_place;
        let make = |initial: &Initial| {
            let mut filter = match &self.before {
                Some(old) => old.restarted(initial, self.bias_share),
                None => Filter::new(&self.model, initial),
            };
            filter.set_stream(self.kind(), self.extra_noise());
            if by_place && !self.ground.reference_known() {
                filter.set_reference_error(REFERENCE_ERROR);
            }
            filter.place_by_fix();
            filter.propagate(&ImuSample { t_s: initial.t_s, ..mean });
            if start.stationary {
                filter.observe_stationary(STANDING_RATE_SIGMA);
            }
            let fusion = Fusion::without_window(filter).recognising_rest();
            if heading_settled { fusion.looking_back() } else { fusion }
        };
        self.state = if heading_settled {
            State::Running(Box::new(DriftBank::new(make(&start.initial))))
        } else {
            let euler = start.initial.nav.euler();
            let members = (0..MEMBERS).map(|k| {
                let yaw = std::f64::consts::TAU * k as f64 / MEMBERS as f64;
                let nav = NavState::from_ned(
                    fix.position,
                    &start.initial.nav.v_n(),
                    &c_nb_from_euler(euler.x, euler.y, yaw),
                );
                make(&Initial { nav, ..start.initial.clone() })
            });
            State::Searching(HeadingBank::new(members), gathering.clone())
        };
    }

    /// Motion starts anew, and the constants too where they are not kept; the source is the same.
    pub(super) fn align_anew(&mut self, event: EstimatorEvent, keep_constants: bool) {
        self.events.push(event);
        self.before = self.filter().filter(|_| keep_constants).map(|f| self.certain_before(f));
        self.bias_share = 0.0;
        self.vague_since_s = None;
        self.kept.clear();
        self.state = State::Gathering(Gathering::default());
    }

    /// The filter whose constants go on after this one: itself, or how it was when its tilt was last certain. While samples are missing the
    /// tilt is not, and the products of its errors let the biases walk, by a hundred times what was known of them; the biases themselves
    /// stay what they were.
    fn certain_before(&self, filter: &Filter) -> Arc<Filter> {
        let before = self.certain.as_deref().filter(|_| filter.tilt_sigma() >= CERTAIN_TILT);
        let aged = before.and_then(|certain| {
            let age_s = filter.t_s() - certain.t_s();
            (0.0..CERTAIN_WITHIN_S).contains(&age_s).then(|| certain.aged(age_s))
        });
        Arc::new(aged.unwrap_or_else(|| filter.clone()))
    }

    pub(super) fn restart(&mut self, reason: RestartReason) {
        let before_fault = if reason == RestartReason::SensorFault { self.kept.pop_front() } else { None };
        if let Some(filter) = self.filter() {
            self.before = Some(before_fault.unwrap_or_else(|| Arc::new(filter.clone())));
        }
        self.kept.clear();
        self.certain = None;
        self.vague_since_s = None;
        self.bias_share = BIAS_AFTER_RESTART;
        self.meter = NoiseMeter::default();
        self.averager = Averager::of(&self.model);
        self.dequantiser = Dequantiser::new(self.crossings.quantisation());
        self.state = State::Gathering(Gathering::default());
        self.last = None;
        self.ground.restart();
        self.source = SourceHistory::default();
    }
}
