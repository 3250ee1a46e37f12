//! Operating data: what the vehicle does beside moving, as the autopilot reports it (throttle, battery, outputs, speed of the air, flight
//! mode). No part of the navigation; effects and the search for them may depend on it.

use crate::math::exp;
use crate::sample::{ImuSample, Sample};
use serde::{Deserialize, Serialize};

/// What is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Channel {
    /// Share of full throttle.
    Throttle,
    /// Current drawn from the battery, A.
    Current,
    /// Voltage of the battery, V.
    Voltage,
    /// Speed of the air, m/s.
    Airspeed,
    /// Number of the flight mode.
    Mode,
    /// Output of the autopilot of this number (from 0) as share of its range: motors and control surfaces.
    Motor(u8),
}

/// Outputs that are kept.
pub const MOTORS: usize = 8;
/// Number of channels.
pub const CHANNELS: usize = 5 + MOTORS;

impl Channel {
    /// Every channel.
    pub fn all() -> impl Iterator<Item = Self> {
        [Self::Throttle, Self::Current, Self::Voltage, Self::Airspeed, Self::Mode]
            .into_iter()
            .chain((0..MOTORS as u8).map(Self::Motor))
    }

    fn index(self) -> usize {
        match self {
            Self::Throttle => 0,
            Self::Current => 1,
            Self::Voltage => 2,
            Self::Airspeed => 3,
            Self::Mode => 4,
            Self::Motor(k) => 5 + usize::from(k).min(MOTORS - 1),
        }
    }

    /// As in effects files and reports.
    pub fn name(self) -> &'static str {
        ["throttle", "current", "voltage", "airspeed", "mode"].get(self.index()).copied().unwrap_or_else(
            || {
                ["motor_1", "motor_2", "motor_3", "motor_4", "motor_5", "motor_6", "motor_7", "motor_8"]
                    [self.index() - 5]
            },
        )
    }
}

/// Values of the channels at one instant, absent where nothing reports them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Operating([Option<f32>; CHANNELS]);

impl Operating {
    /// One channel's value.
    pub fn get(&self, channel: Channel) -> Option<f64> {
        self.0[channel.index()].map(f64::from)
    }

    /// The same with this value; a number that is none leaves it absent.
    #[must_use]
    pub fn with(mut self, channel: Channel, value: f64) -> Self {
        self.0[channel.index()] = value.is_finite().then_some(value as f32);
        self
    }

    /// The same with this value where there is one.
    #[must_use]
    pub fn and(self, channel: Channel, value: Option<f64>) -> Self {
        value.map_or(self, |v| self.with(channel, v))
    }

    /// Whether nothing is reported.
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(Option::is_none)
    }

    /// What `newer` reports in place of these.
    pub fn update(&mut self, newer: &Self) {
        self.0.iter_mut().zip(newer.0).filter(|(_, new)| new.is_some()).for_each(|(old, new)| *old = new);
    }
}

/// What one message reports.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OperatingSample {
    /// Time, s, on the time base of the inertial samples.
    pub t_s: f64,
    /// The channels of the message.
    pub values: Operating,
}

/// Values are kept at this step, s: reports come at 1 to 50 Hz, and fixes see the integral between them.
const STEP_S: f64 = 0.1;
/// Between reports further apart than this a channel is absent, s.
const GAP_S: f64 = 5.0;

/// The channels along a flight.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OperatingSeries {
    start_s: f64,
    grid: Vec<Operating>,
}

impl OperatingSeries {
    /// Of the samples of a stretch.
    pub fn of(samples: &[Sample]) -> Self {
        let mut reports: Vec<OperatingSample> = samples
            .iter()
            .filter_map(|s| match s {
                Sample::Operating(report) if report.t_s.is_finite() => Some(*report),
                _ => None,
            })
            .collect();
        reports.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        let Some((first, last)) = reports.first().zip(reports.last()) else { return Self::default() };
        let start_s = first.t_s;
        let cells = ((last.t_s - start_s) / STEP_S).ceil().max(0.0) as usize + 1;
        let mut series = Self { start_s, grid: vec![Operating::default(); cells] };
        for channel in Channel::all() {
            let own: Vec<(f64, f64)> =
                reports.iter().filter_map(|r| Some((r.t_s, r.values.get(channel)?))).collect();
            series.fill(channel, &own);
        }
        series
    }

    fn fill(&mut self, channel: Channel, reports: &[(f64, f64)]) {
        let mut next = 0;
        for k in 0..self.grid.len() {
            let t_s = self.start_s + k as f64 * STEP_S;
            while reports.get(next).is_some_and(|r| r.0 <= t_s) {
                next += 1;
            }
            let before = next.checked_sub(1).and_then(|k| reports.get(k));
            let value = match (before, reports.get(next)) {
                // A mode lasts until another one is reported.
                (Some(old), _) if channel == Channel::Mode => Some(old.1),
                (Some(old), Some(new)) if new.0 - old.0 <= GAP_S => {
                    Some(old.1 + (new.1 - old.1) * (t_s - old.0) / (new.0 - old.0))
                }
                (Some(old), None) if t_s - old.0 <= GAP_S => Some(old.1),
                (None, Some(new)) if new.0 - t_s <= GAP_S => Some(new.1),
                _ => None,
            };
            self.grid[k] = self.grid[k].and(channel, value);
        }
    }

    /// Interpolated at a time; absent outside of what is reported.
    pub fn at(&self, t_s: f64) -> Operating {
        let place = (t_s - self.start_s) / STEP_S;
        let clamped = place.clamp(0.0, self.grid.len().saturating_sub(1) as f64);
        let Some(here) =
            self.grid.get(clamped as usize).filter(|_| (place - clamped).abs() * STEP_S <= GAP_S)
        else {
            return Operating::default();
        };
        let Some(next) = self.grid.get(clamped as usize + 1) else { return *here };
        let share = clamped.fract() as f32;
        let mut out = *here;
        for (k, (value, next)) in out.0.iter_mut().zip(next.0).enumerate() {
            if k != Channel::Mode.index() {
                *value = value.zip(next).map(|(a, b)| a + (b - a) * share);
            }
        }
        out
    }

    /// Whether nothing is reported.
    pub fn is_empty(&self) -> bool {
        self.grid.is_empty()
    }

    /// Smallest and largest value of a channel; nothing where less than half of the time has one.
    pub fn range(&self, channel: Channel) -> Option<(f64, f64)> {
        let values: Vec<f64> = self.grid.iter().filter_map(|o| o.get(channel)).collect();
        let whole = !values.is_empty() && 2 * values.len() >= self.grid.len();
        whole.then(|| values.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v))))
    }

    /// Flight modes with the share of the time that each was flown.
    pub fn modes(&self) -> Vec<(u32, f64)> {
        let mut counts = std::collections::BTreeMap::new();
        let numbers = self.grid.iter().filter_map(|o| o.get(Channel::Mode)).filter(|m| *m >= 0.0);
        numbers.for_each(|m| *counts.entry(m as u32).or_insert(0_usize) += 1);
        counts.into_iter().map(|(mode, n)| (mode, n as f64 / self.grid.len() as f64)).collect()
    }

    /// The same at another time.
    pub fn move_by(&mut self, by_s: f64) {
        self.start_s += by_s;
    }
}

/// Number of lags.
pub const LAGS: usize = 4;
/// Time constants of the lags that effects may have, s: from a sensor's package to a whole board.
pub const LAGS_S: [f64; LAGS] = [10.0, 30.0, 100.0, 300.0];

/// A quantity behind first-order lags; it starts in equilibrium.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LagBank {
    last: Option<(f64, f64)>,
    lagged: [f64; LAGS],
}

impl LagBank {
    /// Takes the next value and gives those behind the lags.
    pub fn push(&mut self, t_s: f64, value: f64) -> [f64; LAGS] {
        match self.last {
            // Exact for a quantity that is a straight line between its values.
            Some((last_s, last)) if t_s > last_s => {
                let dt = t_s - last_s;
                for (lagged, tau) in self.lagged.iter_mut().zip(LAGS_S) {
                    let behind = tau * (value - last) / dt;
                    *lagged = (value - behind) + (*lagged - last + behind) * exp(-dt / tau);
                }
            }
            Some(_) => {}
            None => self.lagged = [value; LAGS],
        }
        self.last = Some((t_s, value));
        self.lagged
    }
}

/// Temperatures behind lags along a flight, °C above 25, on the grid of the operating data.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LagSeries {
    start_s: f64,
    grid: Vec<[f32; LAGS]>,
}

impl LagSeries {
    /// Of inertial samples; empty where they carry no temperature.
    pub fn of(samples: &[ImuSample]) -> Self {
        let mut series = Self { start_s: samples.first().map_or(0.0, |s| s.t_s), grid: Vec::new() };
        let mut bank = LagBank::default();
        for sample in samples {
            let Some(t) = sample.temperature_degc else { continue };
            if sample.t_s >= series.start_s + series.grid.len() as f64 * STEP_S {
                let lagged = bank.push(sample.t_s, t - 25.0).map(|v| v as f32);
                // After a gap the grid goes on in time.
                let cells = ((sample.t_s - series.start_s) / STEP_S) as usize + 1;
                series.grid.resize(cells.max(series.grid.len()), lagged);
            }
        }
        series
    }

    /// At a time; the nearest there is.
    pub fn at(&self, t_s: f64) -> [f64; LAGS] {
        let last = self.grid.len().saturating_sub(1) as f64;
        let place = ((t_s - self.start_s) / STEP_S).clamp(0.0, last);
        self.grid.get(place as usize).map_or([0.0; LAGS], |v| v.map(f64::from))
    }

    /// The same at another time.
    pub fn move_by(&mut self, by_s: f64) {
        self.start_s += by_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lag_follows_a_ramp_by_its_time_constant_and_a_step_by_its_exponential() {
        let mut ramp = LagBank::default();
        let mut lagged = [0.0; LAGS];
        for k in 0..30_000 {
            lagged = ramp.push(f64::from(k) * 0.1, f64::from(k) * 0.1);
        }
        for (lagged, tau) in lagged.iter().zip(LAGS_S) {
            assert!((2999.9 - lagged - tau).abs() < 0.02 * tau, "{lagged} {tau}");
        }
        let mut step = LagBank::default();
        step.push(0.0, 0.0);
        step.push(1e-6, 1.0);
        let after = step.push(30.0, 1.0);
        assert!((after[1] - (1.0 - exp(-1.0f64))).abs() < 1e-3, "{after:?}");
    }

    fn report(t_s: f64, channel: Channel, value: f64) -> Sample {
        Sample::Operating(OperatingSample { t_s, values: Operating::default().with(channel, value) })
    }

    #[test]
    fn values_are_interpolated_modes_last_and_gaps_are_absent() {
        let samples = [
            report(0.0, Channel::Current, 10.0),
            report(0.0, Channel::Mode, 3.0),
            report(1.0, Channel::Current, 20.0),
            report(9.0, Channel::Current, 30.0),
            report(9.5, Channel::Mode, 5.0),
        ];
        let series = OperatingSeries::of(&samples);
        let at = |t_s: f64| series.at(t_s);
        assert!((at(0.25).get(Channel::Current).unwrap() - 12.5).abs() < 1e-4);
        assert_eq!(at(5.0).get(Channel::Current), None);
        assert_eq!((at(5.0).get(Channel::Mode), at(9.6).get(Channel::Mode)), (Some(3.0), Some(5.0)));
        assert_eq!(at(5.0).get(Channel::Throttle), None);
        assert!(at(30.0).is_empty() && at(-30.0).is_empty());
    }

    #[test]
    fn a_flight_without_reports_has_none() {
        let series = OperatingSeries::of(&[]);
        assert!(series.is_empty() && series.at(3.0).is_empty());
        assert_eq!(series.range(Channel::Current), None);
    }

    #[test]
    fn names_are_those_of_the_contract() {
        let names: Vec<&str> = Channel::all().map(Channel::name).collect();
        assert_eq!(names.len(), CHANNELS);
        assert_eq!((names[1], names[5], names[12]), ("current", "motor_1", "motor_8"));
    }
}
