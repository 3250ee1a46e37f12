//! From the first sample to the last: waiting, aligning, searching the heading, running, starting anew.
//!
//! One type takes the whole stream of [`Sample`]s and holds whatever state the estimation is in. It is deterministic:
//! the same samples give the same result, bit for bit.

use crate::alignment::Gathering;
use crate::filter::{Filter, FixOutcome, Fusion, Initial, PassedOver};
use crate::heading::{HeadingBank, MEMBERS};
use crate::mechanization::NavState;
use crate::model::Model;
use crate::noise_meter::NoiseMeter;
use crate::quantisation::Dequantiser;
use crate::rotation::c_nb_from_euler;
use crate::sample::{GnssFix, ImuSample, ImuStream, Quantisation, RestartReason, Sample};

/// Trust in "a standing vehicle does not turn": truncation and slow sway, rad/s.
const STANDING_RATE_SIGMA: f64 = 1.5e-3;
/// What a reboot may do to the biases, as a share of their prior sigma.
const BIAS_AFTER_RESTART: f64 = 0.1;

/// What the estimation is doing.
#[derive(Debug, Clone)]
enum State {
    /// Gathering samples, waiting for a fix.
    Gathering(Gathering),
    /// Several headings possible.
    Searching(HeadingBank),
    /// One filter.
    Running(Box<Fusion>),
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
    meter: NoiseMeter,
    state: State,
    /// The last filter before a restart: its constants go on.
    before: Option<Box<Filter>>,
    last: Option<ImuSample>,
    /// The newest one as the source told it.
    told: Option<ImuSample>,
}

impl Estimator {
    /// With this model.
    pub fn new(model: Model) -> Self {
        Self {
            model,
            stream: ImuStream::default(),
            dequantiser: Dequantiser::new(Quantisation::None),
            meter: NoiseMeter::default(),
            state: State::Gathering(Gathering::default()),
            before: None,
            last: None,
            told: None,
        }
    }

    /// Takes the next item and returns what became of the fixes whose time has come.
    pub fn feed(&mut self, sample: &Sample) -> Vec<FixOutcome> {
        match sample {
            Sample::Stream(stream) => self.new_stream(stream),
            Sample::Imu(raw) => return self.feed_imu(raw),
            Sample::Fix(fix) => self.feed_fix(fix),
            Sample::Attitude(hint) => {
                if let State::Gathering(gathering) = &mut self.state {
                    gathering.push_hint(*hint);
                }
            }
            Sample::Restart(reason) => self.restart(*reason),
        }
        Vec::new()
    }

    /// What the estimation is doing.
    pub fn stage(&self) -> Stage {
        match &self.state {
            State::Gathering(g) if g.is_empty() => Stage::WaitingForImu,
            State::Gathering(_) => Stage::WaitingForGnss,
            State::Searching(_) => Stage::SearchingHeading,
            State::Running(_) => Stage::Running,
        }
    }

    /// The filter at the time of its last fix, once there is one.
    pub fn filter(&self) -> Option<&Filter> {
        match &self.state {
            State::Gathering(_) => None,
            State::Searching(bank) => bank.best().map(Fusion::filter),
            State::Running(fusion) => Some(fusion.filter()),
        }
    }

    /// The filter at the newest sample.
    pub fn predicted(&self) -> Option<Filter> {
        match &self.state {
            State::Gathering(_) => None,
            State::Searching(bank) => bank.best().map(Fusion::predicted),
            State::Running(fusion) => Some(fusion.predicted()),
        }
    }

    /// Time (s), position, velocity and attitude at the newest sample; cheaper than [`Estimator::predicted`].
    pub fn predicted_nav(&self) -> Option<(f64, NavState)> {
        match &self.state {
            State::Gathering(_) => None,
            State::Searching(bank) => bank.best().map(Fusion::predicted_nav),
            State::Running(fusion) => Some(fusion.predicted_nav()),
        }
    }

    /// The newest inertial sample as the filters see it, its rounding undone.
    pub fn last_sample(&self) -> Option<&ImuSample> {
        self.last.as_ref()
    }

    /// 1-sigma of heading over all hypotheses while it is searched, rad.
    pub fn searched_yaw_sigma(&self) -> Option<f64> {
        match &self.state {
            State::Searching(bank) => Some(bank.yaw_sigma()),
            _ => None,
        }
    }

    /// Fixes that were not used because of their time.
    pub fn passed_over(&self) -> PassedOver {
        match &self.state {
            State::Running(fusion) => fusion.passed_over(),
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
            self.dequantiser = Dequantiser::new(self.model.quantisation_of(stream));
            self.meter = NoiseMeter::default();
        }
    }

    fn feed_imu(&mut self, raw: &ImuSample) -> Vec<FixOutcome> {
        self.meter.push(raw);
        let undone = self.model.undo_source_after(raw, self.told.as_ref());
        self.told = Some(*raw);
        let Some(undone) = undone else { return Vec::new() };
        let sample = self.dequantiser.undo(&undone);
        self.last = Some(sample);
        let (kind, noise) = (self.stream.kind, self.extra_noise());
        match &mut self.state {
            State::Gathering(gathering) => {
                gathering.push_imu(sample);
                Vec::new()
            }
            State::Searching(bank) => {
                bank.for_each(|f| f.filter_mut().set_stream(kind, noise));
                bank.push_imu(sample);
                let outcomes = bank.poll();
                if let Some(winner) = bank.winner() {
                    self.state = State::Running(Box::new(winner.looking_back()));
                }
                outcomes
            }
            State::Running(fusion) => {
                fusion.filter_mut().set_stream(kind, noise);
                fusion.push_imu(sample);
                std::iter::from_fn(|| fusion.poll()).collect()
            }
        }
    }

    /// What rounding adds to the noise of gyros, (rad/s)²/Hz, and accelerometers, (m/s²)²/Hz, at the present rate.
    pub fn rounding_noise(&self) -> (f64, f64) {
        self.dequantiser.noise_density(self.meter.interval_s())
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
            State::Gathering(_) => self.try_start(fix),
            State::Searching(bank) => bank.push_fix(*fix),
            State::Running(fusion) => fusion.push_fix(*fix),
        }
    }

    fn try_start(&mut self, fix: &GnssFix) {
        let State::Gathering(gathering) = &self.state else { return };
        let position_sigma = fix.position_sigma_m.unwrap_or(self.model.gnss.position_sigma_m);
        let velocity_sigma = fix.velocity_sigma_m_per_s.unwrap_or(self.model.gnss.velocity_sigma_m_per_s);
        let (Some(start), Some(mean)) =
            (gathering.start(fix, position_sigma, velocity_sigma), gathering.mean())
        else {
            return;
        };
        let make = |initial: &Initial| {
            let mut filter = match &self.before {
                Some(old) => old.restarted(initial, BIAS_AFTER_RESTART),
                None => Filter::new(&self.model, initial),
            };
            filter.set_stream(self.stream.kind, self.extra_noise());
            filter.propagate(&ImuSample { t_s: initial.t_s, ..mean });
            if start.standing {
                filter.observe_standing(STANDING_RATE_SIGMA);
            }
            if start.heading_known { Fusion::new(filter) } else { Fusion::without_window(filter) }
        };
        self.state = if start.heading_known {
            State::Running(Box::new(make(&start.initial)))
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
            State::Searching(HeadingBank::new(members))
        };
    }

    fn restart(&mut self, _reason: RestartReason) {
        if let Some(filter) = self.filter() {
            self.before = Some(Box::new(filter.clone()));
        }
        self.meter = NoiseMeter::default();
        self.dequantiser = Dequantiser::new(self.model.quantisation_of(&self.stream));
        self.state = State::Gathering(Gathering::default());
        self.last = None;
        self.told = None;
    }
}
