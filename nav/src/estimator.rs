//! From the first sample to the last: waiting, aligning, searching the heading, running, starting anew.
//!
//! One type takes the whole stream of [`Sample`]s and holds whatever state the estimation is in. It is deterministic:
//! the same samples give the same result, bit for bit.

use crate::alignment::Gathering;
use crate::averaging::Averager;
use crate::drift::DriftBank;
use crate::effects::BiasWalk;
use crate::filter::{Filter, FixOutcome, Fusion, LOST_ATTITUDE, PassedOver};
use crate::ground::PlaceAid;
use crate::heading::HeadingBank;
use crate::mechanization::NavState;
use crate::model::{Model, SourceHistory};
use crate::noise_meter::NoiseMeter;
use crate::operating::Operating;
use crate::quantisation::Dequantiser;
use crate::quantisation::crossings::Crossings;
use crate::receiver::ReceiverMeter;
use crate::sample::{GnssFix, ImuSample, ImuStream, Quantisation, Sample, SampleKind};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::sync::Arc;

/// Without samples for longer than this the attitude is not known any more, s.
const LOST_AFTER_S: f64 = 1.5;
/// Where nothing has corrected an attitude that is too uncertain for so long, it begins anew, s.
const VAGUE_AT_MOST_S: f64 = 10.0;
/// A sensor fault is found within this time of its begin; what was learned since is dropped, s.
const FAULT_FOUND_WITHIN_S: f64 = 3.0;
/// Filters are kept for that so often, s.
const KEPT_EVERY_S: f64 = 1.0;
/// Up to this sigma of the tilt, rad, products of errors do not count beside the biases.
const CERTAIN_TILT: f64 = 0.05;
/// What a reboot may do to the biases, as a share of their prior sigma.
const BIAS_AFTER_RESTART: f64 = 0.1;

/// What the estimation is doing.
#[derive(Debug, Clone)]
enum State {
    /// Gathering samples, waiting for a fix.
    Gathering(Gathering),
    /// Several headings possible, for as long as no one says which: what a start with a heading would need is gathered on.
    Searching(HeadingBank, Gathering),
    /// One filter, or several that differ in how fast the gyro biases drift.
    Running(Box<DriftBank>),
}

/// What the estimation did on its own, for people to know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EstimatorEvent {
    /// Inertial samples were missing for so long, s, that the attitude is aligned anew; the constants are kept.
    AlignedAfterGap {
        /// Length of the gap, s.
        gap_s: f64,
    },
    /// GNSS was missing for so long that the attitude is aligned anew; the constants are kept.
    AlignedAfterOutage,
    /// The attitude became too uncertain, by many short gaps or a long flight that shows nothing of it, and is aligned anew; the
    /// constants are kept.
    AlignedAsVague {
        /// The sigma of its worst axis, rad.
        sigma_rad: f64,
    },
    /// The biases drift faster or slower than was assumed; the estimate goes on with another random walk of theirs.
    BiasesDrift {
        /// The random walk that the fixes ask for beyond the model's own.
        walk: BiasWalk,
    },
    /// The first fix after a start on the ground without one: the motion starts from fixes now.
    PlaceKnown {
        /// Whether the constants are kept: a vehicle that flew smoothly had passed for one at rest where they are not.
        constants_kept: bool,
    },
    /// What was measured contradicts the unit's own file: nothing of it is believed any more, and the motion starts anew.
    UnitContradicted {
        /// The constant that lies farthest from what the file says …
        worst: &'static str,
        /// … and by how many sigmas.
        sigmas: f64,
        /// How many constants contradict it.
        constants: usize,
    },
    /// The vehicle left the ground, or its place on it, before the first fix: its motion waits for one, the constants are kept.
    PlaceLeft,
    /// Integer samples that seemed truncated are rounded, or the other way round; everything starts anew.
    Rounding {
        /// Whether they are rounded.
        rounds: bool,
    },
    /// The filter was not finite or not positive any more: everything starts anew.
    Failed {
        /// Whether the constants were sound and are kept.
        constants_kept: bool,
    },
}

/// Which of its states the estimation is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// No inertial sample yet.
    WaitingForImu,
    /// Samples, but no fix.
    WaitingForGnss,
    /// Several headings possible.
    SearchingHeading,
    /// One filter runs.
    Running,
}

/// The estimation as a whole.
#[derive(Debug, Clone)]
pub struct Estimator {
    model: Model,
    stream: ImuStream,
    dequantiser: Dequantiser,
    crossings: Crossings,
    meter: NoiseMeter,
    averager: Averager,
    receiver: ReceiverMeter,
    state: State,
    /// The last filter before a restart: its constants go on.
    before: Option<Arc<Filter>>,
    /// The filter of the last seconds, oldest first: what a fault has not reached yet.
    kept: VecDeque<Arc<Filter>>,
    /// The filter when its tilt was last certain: what short gaps make of the biases since is only the uncertainty of the tilt.
    certain: Option<Arc<Filter>>,
    last: Option<ImuSample>,
    /// Since when the attitude of the one filter is vague, s.
    vague_since_s: Option<f64>,
    /// What undoing the source's faults needs of the samples before.
    source: SourceHistory,
    /// How far the biases may have moved since `before`, as a share of their prior sigma.
    bias_share: f64,
    events: Vec<EstimatorEvent>,
    /// What is known of a vehicle on the ground without fixes.
    ground: PlaceAid,
    /// What the vehicle does beside moving, as last reported.
    operating: Operating,
}

impl Estimator {
    /// With this model.
    pub fn new(model: Model) -> Self {
        let stream = ImuStream::default();
        let crossings = Crossings::of(&stream, &model);
        Self {
            averager: Averager::of(&model),
            model,
            stream,
            dequantiser: Dequantiser::new(crossings.quantisation()),
            crossings,
            meter: NoiseMeter::default(),
            receiver: ReceiverMeter::default(),
            state: State::Gathering(Gathering::default()),
            before: None,
            kept: VecDeque::new(),
            certain: None,
            last: None,
            vague_since_s: None,
            source: SourceHistory::default(),
            bias_share: BIAS_AFTER_RESTART,
            events: Vec::new(),
            ground: PlaceAid::default(),
            operating: Operating::default(),
        }
        .of_unknown_flight()
    }

    /// What the estimation did on its own since the last call.
    pub fn take_events(&mut self) -> Vec<EstimatorEvent> {
        std::mem::take(&mut self.events)
    }

    /// Whether the vehicle is recognised as stationary.
    pub fn is_stationary(&self) -> bool {
        self.filter().is_some_and(Filter::is_stationary)
    }

    /// Takes the next item and returns what became of the fixes whose time has come.
    pub fn feed(&mut self, sample: &Sample) -> Vec<FixOutcome> {
        match sample {
            Sample::Stream(stream) => self.new_stream(stream),
            Sample::Imu(raw) => return self.feed_imu(raw),
            Sample::Fix(fix) => self.feed_receiver(fix),
            Sample::Attitude(hint) => {
                if let State::Gathering(gathering) | State::Searching(_, gathering) = &mut self.state {
                    gathering.push_hint(*hint);
                }
            }
            Sample::Restart(reason) => self.restart(*reason),
            // The vehicle goes on; what the new calibration leaves of the biases is learnt like any change of them.
            Sample::Recalibrated | Sample::Field(_) | Sample::Air(_) => {}
            Sample::Place(place) => self.ground.set_home(*place),
            Sample::Operating(report) => self.operating.update(&report.values),
        }
        Vec::new()
    }

    /// What the estimation is doing.
    pub fn stage(&self) -> Stage {
        match &self.state {
            State::Gathering(g) if g.is_empty() => Stage::WaitingForImu,
            State::Gathering(_) => Stage::WaitingForGnss,
            State::Searching(..) => Stage::SearchingHeading,
            State::Running(_) => Stage::Running,
        }
    }

    /// The filter at the time of its last fix, once there is one.
    pub fn filter(&self) -> Option<&Filter> {
        match &self.state {
            State::Gathering(_) => None,
            State::Searching(bank, _) => bank.best().map(Fusion::filter),
            State::Running(bank) => Some(bank.filter()),
        }
    }

    /// The filter whose constants go on after the last restart.
    pub fn before_restart(&self) -> Option<&Filter> {
        self.before.as_deref()
    }

    /// The filter at the newest sample.
    pub fn predicted(&self) -> Option<Filter> {
        match &self.state {
            State::Gathering(_) => None,
            State::Searching(bank, _) => bank.best().map(Fusion::predicted),
            State::Running(bank) => Some(bank.fusion().predicted()),
        }
    }

    /// Time (s), position, velocity and attitude at the newest sample; cheaper than [`Estimator::predicted`].
    pub fn predicted_nav(&mut self) -> Option<(f64, NavState)> {
        match &mut self.state {
            State::Gathering(_) => None,
            State::Searching(bank, _) => bank.best_mut().map(Fusion::predicted_nav),
            State::Running(bank) => Some(bank.predicted_nav()),
        }
    }

    /// The newest inertial sample as the filters see it, its rounding undone.
    pub fn last_sample(&self) -> Option<&ImuSample> {
        self.last.as_ref()
    }

    /// 1-sigma of roll, pitch, yaw, rad; over all hypotheses while the heading is searched.
    pub fn euler_sigma(&self) -> Option<Vector3<f64>> {
        match &self.state {
            State::Gathering(_) => None,
            State::Searching(bank, _) => Some(bank.euler_sigma()),
            State::Running(bank) => Some(bank.filter().euler_sigma()),
        }
    }

    /// The random walk of the biases that the fixes ask for beyond the model's own; 0 where they ask for none.
    pub fn walk(&self) -> BiasWalk {
        match &self.state {
            State::Running(bank) => bank.walk(),
            _ => BiasWalk::default(),
        }
    }

    /// Fixes that were not used because of their time.
    pub fn passed_over(&self) -> PassedOver {
        match &self.state {
            State::Running(bank) => bank.passed_over(),
            _ => PassedOver::default(),
        }
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The mean of the samples while no filter runs.
    pub fn gathered_mean(&self) -> Option<ImuSample> {
        match &self.state {
            State::Gathering(g) => g.mean(),
            _ => None,
        }
    }

    fn new_stream(&mut self, stream: &ImuStream) {
        if *stream != self.stream {
            self.stream = stream.clone();
            self.crossings = Crossings::of(stream, &self.model);
            self.dequantiser = Dequantiser::new(self.crossings.quantisation());
            self.meter = NoiseMeter::default();
            self.averager = Averager::of(&self.model);
        }
    }

    fn feed_imu(&mut self, raw: &ImuSample) -> Vec<FixOutcome> {
        if !raw.is_usable() {
            return Vec::new();
        }
        if let Some(last) = self.last
            && raw.t_s - last.t_s > LOST_AFTER_S
            && self.filter().is_some()
        {
            self.align_anew(EstimatorEvent::AlignedAfterGap { gap_s: raw.t_s - last.t_s }, true);
        }
        let Some(undone) = self.model.undo_source_after(raw, &mut self.source) else { return Vec::new() };
        self.check_rounding(&undone);
        if !self.is_stationary() {
            self.dequantiser.moves();
        }
        let sample = self.dequantiser.undo(&undone);
        self.meter.push(&sample);
        self.last = Some(sample);
        match self.averager.take(&sample, self.stream.kind, self.meter.interval_s()) {
            Some(sample) => self.propagate(sample),
            None => Vec::new(),
        }
    }

    /// Whether the samples are integers of the kind that their message stands for. What was learnt of those of another kind is wrong: half a count is
    /// 100 deg/h, and turned into 1500 ppm of a scale factor that was known to 240.
    fn check_rounding(&mut self, raw: &ImuSample) {
        if let Some(quantisation) = self.crossings.push(raw) {
            self.dequantiser = Dequantiser::new(quantisation);
            let rounds = matches!(quantisation, Quantisation::Round(_));
            self.align_anew(EstimatorEvent::Rounding { rounds }, false);
        }
    }

    /// Goes on by a sample as the filters see it.
    fn propagate(&mut self, sample: ImuSample) -> Vec<FixOutcome> {
        let (kind, noise) = (self.kind(), self.extra_noise());
        let (rounding, scatter) = (self.dequantiser.constant_error(), self.scatter());
        let (operating, at_rest) = (self.operating, self.dequantiser.at_rest());
        let set_source = |filter: &mut Filter| {
            filter.set_operating(&operating);
            filter.set_stream(kind, noise);
            filter.set_rounding_error(rounding, &at_rest);
            filter.set_scatter(scatter);
        };
        let outcomes = match &mut self.state {
            State::Gathering(gathering) => {
                gathering.push_imu(sample);
                Vec::new()
            }
            State::Searching(bank, gathering) => {
                gathering.push_imu(sample);
                bank.for_each(|f| set_source(f.filter_mut()));
                bank.push_imu(sample);
                let outcomes = bank.poll();
                if bank.is_empty() {
                    self.events.push(EstimatorEvent::Failed { constants_kept: false });
                    self.state = State::Gathering(Gathering::default());
                } else if let Some(winner) = bank.winner() {
                    self.state = State::Running(Box::new(DriftBank::new(winner.looking_back())));
                }
                outcomes
            }
            State::Running(bank) => {
                bank.for_each(|f| set_source(f.filter_mut()));
                bank.push_imu(sample);
                let walk = bank.walk();
                bank.allow_shaking(!self.ground.aids(sample.t_s));
                let outcomes = bank.poll();
                if bank.walk() != walk {
                    self.events.push(EstimatorEvent::BiasesDrift { walk: bank.walk() });
                }
                outcomes
            }
        };
        self.look_after_health();
        self.keep_filter();
        self.doubt_unit();
        if let Some(fix) = self.ground.take(&sample, &self.sample_noise(noise, rounding)) {
            self.feed_fix(&fix);
        }
        let outcomes = self.of_receiver(outcomes);
        if self.ground.lost() {
            self.align_anew(EstimatorEvent::PlaceLeft, true);
        }
        outcomes
    }

    /// Keeps the filter as it is now and then, in case that the sensor turns out to be at fault already.
    fn keep_filter(&mut self) {
        let State::Running(bank) = &self.state else { return };
        let filter = bank.filter();
        if self.kept.back().is_some_and(|kept| filter.t_s() - kept.t_s() < KEPT_EVERY_S) {
            return;
        }
        let now = Arc::new(filter.clone());
        if now.tilt_sigma() < CERTAIN_TILT {
            self.certain = Some(now.clone());
        }
        self.kept.push_back(now);
        // The oldest is the youngest of those that are old enough.
        while self.kept.get(1).is_some_and(|next| filter.t_s() - next.t_s() >= FAULT_FOUND_WITHIN_S) {
            self.kept.pop_front();
        }
    }

    /// A filter that failed or lost its attitude starts anew.
    fn look_after_health(&mut self) {
        let Some(filter) = self.filter() else { return };
        if filter.has_failed() {
            let sound = filter.has_sound_constants();
            self.align_anew(EstimatorEvent::Failed { constants_kept: sound }, sound);
        } else if filter.is_lost() {
            self.align_anew(EstimatorEvent::AlignedAfterOutage, true);
        } else if let Some(sigma_rad) = self.vague_for_long() {
            self.align_anew(EstimatorEvent::AlignedAsVague { sigma_rad }, true);
        }
    }

    /// The sigma of an attitude that has been vague for too long, rad. A search is no such case: each of its members is certain.
    fn vague_for_long(&mut self) -> Option<f64> {
        let State::Running(bank) = &self.state else {
            self.vague_since_s = None;
            return None;
        };
        let (t_s, sigma_rad) = (bank.filter().t_s(), bank.filter().attitude_sigma());
        if sigma_rad <= LOST_ATTITUDE {
            self.vague_since_s = None;
            return None;
        }
        let since_s = *self.vague_since_s.get_or_insert(t_s);
        (t_s - since_s > VAGUE_AT_MOST_S).then_some(sigma_rad)
    }

    /// What the motion has shown of the receiver's velocities.
    pub fn receiver(&self) -> &ReceiverMeter {
        &self.receiver
    }

    /// What rounding adds to the noise of gyros, (rad/s)²/Hz, and accelerometers, (m/s²)²/Hz, at the present rate.
    pub fn rounding_noise(&self) -> (f64, f64) {
        self.dequantiser.noise_density(self.meter.interval_s())
    }

    /// Whether the samples that the filters see are points or means.
    fn kind(&self) -> SampleKind {
        self.averager.kind(self.stream.kind)
    }

    /// Variances of one of them as far as it is no smooth motion: of a mean of several as much less as of white noise.
    fn scatter(&self) -> (f64, f64) {
        let (gyro, accel) = self.meter.scatter();
        let interval_s = self.meter.interval_s();
        let share = if interval_s > 0.0 { interval_s / self.averager.interval_s(interval_s) } else { 1.0 };
        (gyro * share, accel * share)
    }

    /// Variance per hertz beyond the model's: rounding and vibration.
    fn extra_noise(&self) -> (f64, f64) {
        let imu = &self.model.imu;
        let (gyro, accel) = (imu.gyro_noise * imu.gyro_noise, imu.accel_noise * imu.accel_noise);
        let rounding = self.rounding_noise();
        let excess = self.meter.excess(gyro + rounding.0, accel + rounding.1);
        (rounding.0 + excess.0, rounding.1 + excess.1)
    }

    fn feed_fix(&mut self, fix: &GnssFix) {
        match &mut self.state {
            State::Gathering(_) => {}
            State::Searching(bank, _) => bank.push_fix(*fix),
            State::Running(bank) => return bank.push_fix(*fix),
        }
        if fix.is_plausible() {
            self.try_start(fix);
        }
    }
}

mod on_ground;
mod start;
#[cfg(test)]
mod tests;
mod unit;
