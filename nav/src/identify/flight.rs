//! One recorded flight, prepared once so that many models can be run over the very same samples and fixes.

use super::by_hand::ByHand;
use super::guess::Guesses;
use super::linear::Unseen;
use super::linear::reference::Reference;
use super::linear::reference::delay_s;
use super::rounding::Rounding;
use super::simulated::{self, Still};
use super::stationary;
use super::statistics::{median, quantile};
use super::stretch::Stretch;
use crate::averaging::{self, averaged};
use crate::effects::{Conditions, MISTAKES, Surroundings};
use crate::filter::Initial;
use crate::filter::force_rate::ForceRates;
use crate::mechanization::NavState;
use crate::model::Model;
use crate::noise_meter::{MEMORY_S, NoiseMeter};
use crate::operating::{LagSeries, OperatingSeries};
use crate::quantisation::Dequantiser;
use crate::sample::{
    AirSample, FieldSample, GnssFix, ImuSample, ImuStream, Quantisation, Sample, SampleKind,
};
use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

pub use super::stretch::{ENOUGH_FIXES, ENOUGH_S, TooLittle};

/// 1-sigma of what all time stamps are off by without anybody calling it a delay, s.
const CLOCK_S: f64 = 2e-3;
/// The same where somebody knows the delay: that is the receiver's own, counted from the true motion. The samples are late
/// themselves, by the autopilot's low-pass (two poles at 20 Hz: 11 ms) and up to a loop until they are sent, and no data
/// sheet gives by how much.
const CLOCK_OF_KNOWN_DELAY_S: f64 = 0.01;
/// A fix this many sigmas off that is inconsistent with its neighbours is left out.
const OUTLIER_NIS: f64 = 60.0;
/// Samples are whole counts where so many of them are, to this share of a count. The likelihood of the fixes hardly speaks against truncation in vibration:
/// `imu_truncation` was named of samples of a log that are on no such grid (one of six noisy flights made by other means, 2026-11-30).
const MOSTLY: f64 = 0.95;
const OF_A_COUNT: f64 = 0.02;

/// Samples and fixes from one start to the end.
#[derive(Debug, Clone)]
pub struct Flight {
    stream: ImuStream,
    initial: Initial,
    raw: Vec<ImuSample>,
    fixes: Vec<GnssFix>,
    fields: Vec<FieldSample>,
    air: Vec<AirSample>,
    prepared: Vec<(Quantisation, Vec<ImuSample>)>,
    /// What the rounding leaves unknown, for each way to read it.
    rounding: Vec<(Quantisation, Rounding)>,
    force_rates: Arc<ForceRates>,
    by_hand: ByHand,
    operating: Arc<OperatingSeries>,
    lags: Arc<LagSeries>,
    unseen: Unseen,
    guesses: Guesses,
    interval_s: f64,
    measured_noise: (f64, f64),
    /// The same while the unit rested between turns by hand: when, s, and what the samples showed.
    shown_at_rest: Vec<(f64, [f64; 2])>,
    /// Whether its samples are whole counts of 1 mrad/s and 1 mg.
    whole_counts: bool,
    known_delay_s: Option<f64>,
    /// Kind of the samples before they were averaged.
    averaged: Option<SampleKind>,
    moved_s: f64,
    /// By how much the positions stretched north and east, where they were those of a simulator's sphere.
    sphere: Option<[f64; 2]>,
    /// Where it flew, if that Earth does not turn.
    still: Option<Still>,
    /// How much of the recording gaps cut off that nothing bridges, s.
    unbridged_s: f64,
    /// The samples with one fault over time undone, each made when it is first asked for.
    undone: Vec<(&'static str, Quantisation, OnceLock<Vec<ImuSample>>)>,
}

impl Flight {
    /// Prepares the longest stretch without a restart. `model` is the one that is assumed at first: it finds the start.
    ///
    /// # Errors
    /// When the recording is too poor to say anything.
    pub fn prepare(samples: &[Sample], model: &Model) -> Result<Self, TooLittle> {
        let Stretch {
            stream,
            initial,
            raw,
            mut fixes,
            fields,
            air,
            by_hand,
            unseen,
            guesses,
            unbridged_s,
            operating,
        } = Stretch::of(samples, model)?;
        let sphere = simulated::stretch(&fixes);
        if let (Some(by), Some(origin)) = (sphere, fixes.first().map(|f| f.position)) {
            fixes.iter_mut().for_each(|f| f.position = simulated::undone(&origin, f.position, by));
        }
        let mut flight = Self {
            force_rates: Arc::new(ForceRates::new(&raw, stream.kind)),
            operating: Arc::new(operating),
            lags: Arc::new(LagSeries::of(&raw)),
            guesses,
            by_hand,
            unseen,
            stream,
            initial,
            raw,
            fixes,
            fields,
            air,
            prepared: Vec::new(),
            rounding: Vec::new(),
            interval_s: 0.0,
            measured_noise: (0.0, 0.0),
            whole_counts: false,
            shown_at_rest: Vec::new(),
            averaged: None,
            moved_s: 0.0,
            undone: Vec::new(),
            sphere,
            still: None,
            unbridged_s,
            known_delay_s: model.effects.iter().any(|s| s.effect.delays_fixes()).then(|| delay_s(model, 0.0)),
        };
        flight.measure_noise();
        if stationary::stands(&flight.raw, &flight.fixes, flight.measured_noise) {
            return Err(TooLittle::Standing);
        }
        flight.dequantise(model);
        if sphere.is_some() {
            flight.put_on_earth(model);
        }
        flight.drop_outliers(model);
        Ok(flight)
    }

    /// Noise that the samples show beyond what is smooth, per hertz: a start for the fit.
    fn measure_noise(&mut self) {
        let mut meter = NoiseMeter::default();
        let (mut gyro, mut accel) = (Vec::new(), Vec::new());
        for (i, sample) in self.raw.iter().enumerate() {
            meter.push(sample);
            if i % 100 == 99 {
                let (g, a) = meter.excess(0.0, 0.0);
                gyro.push(g);
                accel.push(a);
                if self.by_hand.rests(sample.t_s - MEMORY_S, sample.t_s).is_some() {
                    self.shown_at_rest.push((sample.t_s, [g, a]));
                }
            }
        }
        let usual = |of: Vec<f64>| median(of.into_iter()).unwrap_or(0.0);
        self.measured_noise = (usual(gyro), usual(accel));
        self.interval_s = meter.interval_s();
    }

    /// Whether its samples are whole counts, as integers are: whether they were truncated to such is a question only then.
    pub(in crate::identify) fn has_whole_counts(&self) -> bool {
        self.whole_counts
    }

    fn dequantise(&mut self, model: &Model) {
        let mut wanted = vec![model.quantisation_of(&self.stream)];
        let steps = crate::sample::Steps::RAW_IMU;
        let whole = |v: &nalgebra::Vector3<f64>, step: f64| {
            v.iter().all(|x| (x / step - (x / step).round()).abs() < OF_A_COUNT)
        };
        let count =
            self.raw.iter().filter(|s| whole(&s.gyro, steps.gyro) && whole(&s.accel, steps.accel)).count();
        self.whole_counts = count as f64 >= MOSTLY * self.raw.len() as f64;
        let truncated = Quantisation::Truncate(steps);
        if !wanted.contains(&truncated) {
            wanted.push(truncated);
        }
        for q in wanted {
            let (samples, rounding) = Rounding::undo(&self.raw, q, self.interval_s);
            self.prepared.push((q, samples));
            self.rounding.push((q, rounding));
        }
        if averaging::at_once(self.interval_s) > 1 {
            let kind = self.stream.kind;
            for (_, samples) in &mut self.prepared {
                *samples = averaged(samples, kind, self.interval_s);
            }
            self.averaged = Some(kind);
            self.stream.kind = SampleKind::IntervalMean;
        }
        self.forget_undone();
    }

    fn forget_undone(&mut self) {
        let over_time = || MISTAKES.iter().filter(|m| m.needs_neighbours() || m.changes_unit());
        let places =
            self.prepared.iter().flat_map(|(q, _)| over_time().map(|m| (m.name(), *q, OnceLock::new())));
        self.undone = places.collect();
    }

    /// Adds what a unit on the Earth would have measured beside that of a simulator over a sphere that does not turn.
    fn put_on_earth(&mut self, model: &Model) {
        let noise = super::noise::Noise::measured(model, &[&*self]);
        let still = Still::of(&Reference::filtered(self, model, &noise));
        self.prepared.iter_mut().for_each(|(_, samples)| still.on_earth(samples));
        self.still = Some(still);
    }

    /// Leaves out single fixes that are inconsistent with their neighbours, for all models alike.
    fn drop_outliers(&mut self, model: &Model) {
        let noise = super::noise::Noise::measured(model, &[&*self]);
        let (reference, innovations) = Reference::first_pass(self, model, &noise);
        let mut nis = vec![0.0; self.fixes.len()];
        for (knot, [position, velocity, _]) in reference.knots.iter().zip(innovations) {
            nis[knot.fix] = position.max(velocity) / noise.tolerance();
        }
        // What the model lacks puts several fixes in a row off.
        let consistent = |i: usize| nis.get(i).is_none_or(|n| *n <= crate::filter::gate(3));
        let alone = |i: usize| nis[i] > OUTLIER_NIS && consistent(i.wrapping_sub(1)) && consistent(i + 1);
        let keep: Vec<bool> = (0..nis.len()).map(|i| !alone(i)).collect();
        let mut at = 0;
        self.fixes.retain(|_| {
            at += 1;
            keep[at - 1]
        });
    }

    /// Where every model starts.
    pub fn initial(&self) -> &Initial {
        &self.initial
    }

    /// The fixes after the start.
    pub fn fixes(&self) -> &[GnssFix] {
        &self.fixes
    }

    /// By how much the positions of the recording stretch north and east against its velocities, where they are those of a simulator that flies over a
    /// sphere; that is taken out of [`Self::fixes`].
    pub fn sphere(&self) -> Option<[f64; 2]> {
        self.sphere
    }

    /// What its compasses measured.
    pub fn fields(&self) -> &[FieldSample] {
        &self.fields
    }

    /// What its barometers and airspeed sensors measured.
    pub fn air(&self) -> &[AirSample] {
        &self.air
    }

    /// What the samples are.
    pub fn stream(&self) -> &ImuStream {
        &self.stream
    }

    /// How fast the specific force changes.
    pub(crate) fn force_rates(&self) -> &Arc<ForceRates> {
        &self.force_rates
    }

    /// What the samples around an instant show.
    pub fn around(&self, t_s: f64) -> Surroundings {
        self.force_rates.around(t_s, 0.0)
    }

    /// What the vehicle does beside moving.
    pub fn operating(&self) -> &OperatingSeries {
        &self.operating
    }

    /// What of the vehicle's conditions the recording says by itself.
    pub fn conditions(&self, t_s: f64) -> Conditions {
        Conditions {
            operating: self.operating.at(t_s),
            elapsed_s: t_s - self.initial.t_s,
            lagged_degc: self.lags.at(t_s),
            ..Conditions::default()
        }
    }

    /// What the vehicle may have done where samples are lost.
    pub(super) fn unseen(&self) -> &Unseen {
        &self.unseen
    }

    /// Rest and place of a unit that was turned by hand.
    pub(super) fn by_hand(&self) -> &ByHand {
        &self.by_hand
    }

    /// The fixes that a receiver gave.
    pub(super) fn received(&self) -> impl Iterator<Item = &GnssFix> {
        self.fixes.iter().filter(|f| !self.by_hand.gave(f))
    }

    /// A state at the first fix after a gap with the attitude of a first guess, where there was a gap since the last fix and
    /// somebody saw the vehicle after it.
    pub(super) fn guessed(&self, since_s: f64, t_s: f64, predicted: &NavState) -> Option<NavState> {
        self.guesses.at(&self.unseen, since_s, t_s, predicted)
    }

    /// 1-sigma of what all time stamps are off by under a model, beyond the delay that it says, s. A delay that was found on
    /// the flight itself is one relative to the samples.
    pub(crate) fn clock_sigma_s(&self, model: &Model) -> f64 {
        let known = self.known_delay_s.is_some_and(|known| (known - delay_s(model, 0.0)).abs() < 1e-9);
        if known { CLOCK_OF_KNOWN_DELAY_S } else { CLOCK_S }
    }

    /// Interval between samples, s.
    pub fn interval_s(&self) -> f64 {
        self.interval_s
    }

    /// The same of the samples that the estimation goes through.
    pub(super) fn sample_s(&self) -> f64 {
        self.interval_s.max(1e-4) * averaging::at_once(self.interval_s) as f64
    }

    /// Seconds from the start to the last sample.
    pub fn duration_s(&self) -> f64 {
        self.raw.last().map_or(0.0, |s| s.t_s - self.initial.t_s)
    }

    /// Whether the samples carry a temperature.
    pub fn has_temperature(&self) -> bool {
        self.raw.first().is_some_and(|s| s.temperature_degc.is_some())
    }

    /// Variance per hertz of gyro and accelerometer samples beyond smooth motion.
    pub fn measured_noise(&self) -> (f64, f64) {
        self.measured_noise
    }

    /// Variance per hertz of gyro and accelerometer samples of a unit that rests, without what rounding adds as the model reads it: nothing but the sensors'
    /// own noise, where the support gives way least. `None` where the unit was not turned by hand.
    pub fn noise_at_rest(&self, model: &Model) -> Option<[f64; 2]> {
        let rounding = self.rounding(model);
        let sensor = |k: usize| {
            let without = self.shown_at_rest.iter().map(|(t_s, shown)| {
                let (gyro, accel) = rounding.at(*t_s);
                (shown[k] - [gyro, accel][k]).max(0.0)
            });
            quantile(without, (1, 4))
        };
        Some([sensor(0)?, sensor(1)?])
    }

    /// Share of its time in which samples are missing, 0 to 1.
    pub fn missing_share(&self) -> f64 {
        let seconds = self.duration_s();
        if seconds > 0.0 { (self.unseen.missing_s(self.interval_s) / seconds).min(1.0) } else { 0.0 }
    }

    /// Whether the samples are so noisy that their noise may pass for what drives an effect.
    pub fn is_noisy(&self) -> bool {
        super::linear::is_strong(self.measured_noise)
    }

    /// The samples as this belief about rounding reads them.
    pub(crate) fn samples(&self, q: Quantisation) -> &[ImuSample] {
        self.prepared.iter().find(|(p, _)| *p == q).map_or(&self.raw, |(_, s)| s)
    }

    /// What the rounding leaves unknown as a model reads the samples.
    pub(crate) fn rounding(&self, model: &Model) -> Rounding {
        let q = model.quantisation_of(&self.stream);
        let own = self.rounding.iter().find(|(p, _)| *p == q);
        own.map_or_else(|| Rounding::undo(&self.raw, q, self.interval_s).1, |(_, r)| r.clone())
    }

    /// What rounding adds to the variance per hertz of gyros and accelerometers at an instant, as a model reads the samples.
    pub fn rounding_noise(&self, model: &Model) -> impl Fn(f64) -> (f64, f64) + use<> {
        let rounding = self.rounding(model);
        move |t_s| rounding.at(t_s)
    }

    /// The samples as a model reads them: its assumption about rounding, faults of the source undone.
    pub fn samples_of(&self, model: &Model) -> Cow<'_, [ImuSample]> {
        if model.effects.iter().any(|s| s.effect.needs_neighbours() || s.effect.changes_unit()) {
            return self.kept_undone(model).map_or_else(|| Cow::Owned(self.undone(model)), Cow::Borrowed);
        }
        let own = self.samples(model.quantisation_of(&self.stream));
        if model.effects.iter().any(|s| s.effect.is_source_mistake()) {
            return own.iter().map(|s| model.undo_source(s)).collect();
        }
        Cow::Borrowed(own)
    }
}

impl Flight {
    /// The same flight at another time: flights of one vehicle stand one after the other on one line of time, so that an instant
    /// belongs to one of them.
    #[must_use]
    pub fn moved(mut self, by_s: f64) -> Self {
        self.moved_s += by_s;
        self.initial.t_s += by_s;
        self.raw.iter_mut().for_each(|s| s.t_s += by_s);
        self.fixes.iter_mut().for_each(|f| f.t_s += by_s);
        self.fields.iter_mut().for_each(|f| f.t_s += by_s);
        self.air.iter_mut().for_each(|a| a.t_s += by_s);
        self.prepared.iter_mut().flat_map(|p| &mut p.1).for_each(|s| s.t_s += by_s);
        self.rounding.iter_mut().for_each(|(_, r)| r.move_by(by_s));
        let kind = self.averaged.unwrap_or(self.stream.kind);
        self.force_rates = Arc::new(ForceRates::new(&self.raw, kind));
        Arc::make_mut(&mut self.operating).move_by(by_s);
        Arc::make_mut(&mut self.lags).move_by(by_s);
        self.unseen.move_by(by_s);
        self.by_hand.move_by(by_s);
        self.shown_at_rest.iter_mut().for_each(|(t_s, _)| *t_s += by_s);
        self.guesses.move_by(by_s);
        self.still.iter_mut().for_each(|s| s.move_by(by_s));
        self.forget_undone();
        self
    }

    /// By how much it was moved, s.
    pub fn moved_s(&self) -> f64 {
        self.moved_s
    }

    /// How much of the recording is left out because no attitude leads across the gaps in its samples, s.
    pub fn unbridged_s(&self) -> f64 {
        self.unbridged_s
    }

    /// Start and end, s.
    pub fn span_s(&self) -> (f64, f64) {
        (self.initial.t_s, self.initial.t_s + self.duration_s())
    }

    /// The samples as the source reported them.
    pub fn reported(&self) -> &[ImuSample] {
        &self.raw
    }

    /// The same where there is only one such fault: the search asks for it over and over.
    fn kept_undone(&self, model: &Model) -> Option<&[ImuSample]> {
        let q = model.quantisation_of(&self.stream);
        let mut mistakes = model.effects.iter().map(|s| s.effect).filter(|e| e.is_source_mistake());
        let name = mistakes.next().filter(|_| mistakes.next().is_none())?.name();
        let (_, _, kept) = self.undone.iter().find(|(n, p, _)| *n == name && *p == q)?;
        Some(kept.get_or_init(|| self.undone(model)))
    }

    /// Faults of the source undone in the samples as they were reported, and then all the rest.
    fn undone(&self, model: &Model) -> Vec<ImuSample> {
        let mut samples = self.raw.clone();
        for setting in model.effects.iter().rev().filter(|s| s.effect.is_source_mistake()) {
            samples = setting.effect.undo_sequence(&samples);
        }
        let mut dequantiser = Dequantiser::new(model.quantisation_of(&self.stream));
        let samples: Vec<ImuSample> = samples.iter().map(|s| dequantiser.undo(s)).collect();
        let mut samples = match self.averaged {
            Some(kind) => averaged(&samples, kind, self.interval_s),
            None => samples,
        };
        if let Some(still) = &self.still {
            still.on_earth(&mut samples);
        }
        samples
    }
}
