//! What drives a simulated vehicle: throttle, current, voltage and outputs that go with its motion, and what an autopilot reports of them.
//!
//! The thrust that a motion needs gives the throttle; an auto-throttle that hunts adds to it. Current grows with throttle to the power 1.6
//! (momentum theory: power ∝ thrust^1.5, and losses), voltage sags with current over the battery's resistance and with the charge used.

use crate::noise::{GaussMarkov, Noise, Purpose};
use crate::truth::Truth;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::powf;
use gaware_nav::operating::{Channel, Operating};

/// What carries the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrier {
    /// One propeller, ailerons, elevator, rudder.
    Wings,
    /// Four rotors.
    Rotors,
}

/// Thrust per mass at full throttle, m/s²: a sport model of a thrust-to-weight ratio of 1.2, a multirotor of 2.
const FULL: [f64; 2] = [12.0, 2.0 * STANDARD_GRAVITY];
/// Drag per mass of wings: constant, m/s², and by the square of the speed, 1/m.
const DRAG: (f64, f64) = (0.5, 0.006);
/// 1-sigma and correlation time of an auto-throttle that hunts, share and s.
const HUNTS: (f64, f64) = (0.08, 6.0);
/// Current of the avionics, and at full throttle, A.
const CURRENT_A: (f64, f64) = (0.8, 45.0);
/// Full battery, V; its resistance, Ω; charge that it loses a volt with, C.
const BATTERY: (f64, f64, f64) = (16.4, 0.02, 9000.0);
/// Share of an output's range by rate, s/rad.
const OUTPUT_BY_RATE: [f64; 2] = [0.25, 0.08];
/// 1-sigma of what is reported: current, A, voltage, V, speed, m/s.
const REPORTED: [f64; 3] = [0.1, 0.02, 0.4];

/// The powertrain along a flight.
#[derive(Debug, Clone)]
pub struct Powertrain {
    carrier: Carrier,
    hunting: GaussMarkov,
    noise: Noise,
    charge_c: f64,
    at_s: Option<f64>,
    now: Operating,
}

impl Powertrain {
    /// Of this seed.
    pub fn new(carrier: Carrier, seed: u64) -> Self {
        Self {
            carrier,
            hunting: GaussMarkov::new(Noise::new(seed, Purpose::Throttle)),
            noise: Noise::new(seed, Purpose::Reports),
            charge_c: 0.0,
            at_s: None,
            now: Operating::default(),
        }
    }

    /// As it is at this truth; call it in order of time.
    pub fn at(&mut self, truth: &Truth) -> Operating {
        let speed = truth.v_n.norm();
        let wanted = match self.carrier {
            Carrier::Wings => (truth.force.x + DRAG.0 + DRAG.1 * speed * speed) / FULL[0],
            Carrier::Rotors => -truth.force.z / FULL[1],
        };
        let hunting = HUNTS.0 * self.hunting.at(truth.t_s, HUNTS.1).x;
        let throttle = (wanted + hunting).clamp(0.0, 1.0);
        let current = CURRENT_A.0 + CURRENT_A.1 * powf(throttle, 1.6);
        self.charge_c +=
            current * self.at_s.replace(truth.t_s).map_or(0.0, |last| (truth.t_s - last).max(0.0));
        let (full, ohm, per_volt) = BATTERY;
        let [p, q, r] = (truth.rate_eb * OUTPUT_BY_RATE[self.carrier as usize]).into();
        let outputs = match self.carrier {
            Carrier::Wings => [0.5 + p, 0.5 + q, throttle, 0.5 + r],
            Carrier::Rotors => {
                [throttle - p + q + r, throttle + p - q + r, throttle + p + q - r, throttle - p - q - r]
            }
        };
        let now = Operating::default()
            .with(Channel::Throttle, throttle)
            .with(Channel::Current, current)
            .with(Channel::Voltage, full - ohm * current - self.charge_c / per_volt)
            .with(Channel::Airspeed, speed);
        let outputs = (0..).zip(outputs).map(|(k, v): (u8, f64)| (Channel::Motor(k), v.clamp(0.0, 1.0)));
        self.now = outputs.fold(now, |now, (channel, v)| now.with(channel, v));
        self.now
    }

    /// As it was at the last instant.
    pub fn now(&self) -> &Operating {
        &self.now
    }

    /// What the autopilot reports of the last instant.
    pub fn reported(&mut self) -> Operating {
        let channels = [Channel::Current, Channel::Voltage, Channel::Airspeed];
        channels.into_iter().zip(REPORTED).fold(self.now, |out, (channel, sigma)| {
            let noise = sigma * self.noise.normal();
            out.and(channel, out.get(channel).map(|v| (v + noise).max(0.0)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::{Flown, fixed_wing::FixedWing};
    use crate::truth::Trajectory;

    #[test]
    fn current_goes_with_thrust_and_voltage_sags_with_it() {
        let mut flight = Flown::new(FixedWing::new(true));
        let mut powertrain = Powertrain::new(Carrier::Wings, 1);
        let of = |o: &Operating, c| o.get(c).unwrap();
        let all: Vec<Operating> =
            (0..2000).map(|k| powertrain.at(&flight.truth_at(f64::from(k) * 0.1))).collect();
        let (low, high): (Vec<_>, Vec<_>) = all.iter().partition(|o| of(o, Channel::Throttle) < 0.3);
        let mean = |v: &[&Operating], c| v.iter().map(|o| of(o, c)).sum::<f64>() / v.len() as f64;
        assert!(low.len() > 50 && high.len() > 50, "{} {}", low.len(), high.len());
        assert!(mean(&high, Channel::Current) > 1.5 * mean(&low, Channel::Current));
        assert!(of(&all[1999], Channel::Voltage) < of(&all[0], Channel::Voltage));
    }
}
