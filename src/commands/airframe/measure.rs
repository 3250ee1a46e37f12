//! What a flight says about the airframe: each number by itself, with what it rests on.

use gaware_mission::airframe::{Airframe, AirframeError};
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::{acos, cos, sin};
use nalgebra::{Matrix2, Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, SQRT_2};

/// Least time in flight, s.
pub const LEAST_FLIGHT_S: f64 = 60.0;
/// In flight above this share of the fastest ground speed.
const FLYING_SHARE: f64 = 0.35;
/// A vehicle that was never faster than this has not flown, m/s.
const FLYING_M_PER_S: f64 = 3.0;
/// In flight from this height above the lowest of the log on, m, and how long a step may count for it, s.
const CLEAR_M: f64 = 10.0;
const LONGEST_STEP_S: f64 = 1.0;
/// More bank than this is a turn; less than the second is level, rad.
const TURN_RAD: f64 = 0.35;
const LEVEL_RAD: f64 = 0.17;
/// Least time in turns from which the side force is fitted, s.
const LEAST_TURNS_S: f64 = 20.0;
/// Residuals of the side force are alike for about so many steps (half a Dutch roll).
const ALIKE: f64 = 10.0;
/// A load peaks this soon after a roll begins and is steady from then on, s.
const PEAK_S: f64 = 2.5;
const STEADY_S: f64 = 6.0;
/// Speed and height change over this time, in steps.
const SLOPE_STEPS: usize = 10;
/// Share of a flight beyond which values count as chance.
const TAIL: f64 = 0.02;

/// The vehicle at one instant, means over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// s.
    pub t_s: f64,
    /// rad.
    pub roll: f64,
    /// rad.
    pub pitch: f64,
    /// m/s.
    pub velocity_ned: Vector3<f64>,
    /// rad/s.
    pub rate: Vector3<f64>,
    /// m/s².
    pub force: Vector3<f64>,
    /// m/s, where the log holds it.
    pub airspeed: Option<f64>,
}

/// One number.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Key in the airframe file.
    pub key: &'static str,
    /// In the unit of the key.
    pub value: f64,
    /// Standard error, where it has one.
    pub sigma: Option<f64>,
    /// What it rests on.
    pub evidence: String,
}

impl Measured {
    fn new(key: &'static str, value: f64, evidence: impl Into<String>) -> Self {
        Self { key, value, sigma: None, evidence: evidence.into() }
    }

    /// The value of the same key in an airframe.
    pub fn of(&self, airframe: &Airframe) -> Option<f64> {
        let mut airframe = airframe.clone();
        field(&mut airframe, self.key).map(|v| *v)
    }
}

fn field<'a>(a: &'a mut Airframe, key: &str) -> Option<&'a mut f64> {
    Some(match key {
        "side_force_g" => &mut a.side_force_g,
        "roll_side_force_g" => &mut a.roll_side_force_g,
        "load_overshoot" => &mut a.load_overshoot,
        "bank_max_deg" => &mut a.bank_max_deg,
        "roll_rate_max_deg_per_s" => &mut a.roll_rate_max_deg_per_s,
        "yaw_rate_max_deg_per_s" => &mut a.yaw_rate_max_deg_per_s,
        "climb_max_m_per_s" => &mut a.climb_max_m_per_s,
        "descent_max_m_per_s" => &mut a.descent_max_m_per_s,
        "speed_min_m_per_s" => &mut a.speed_min_m_per_s,
        "speed_cruise_m_per_s" => &mut a.speed_cruise_m_per_s,
        "speed_max_m_per_s" => &mut a.speed_max_m_per_s,
        "acceleration_m_per_s2" => &mut a.acceleration_m_per_s2,
        "braking_m_per_s2" => &mut a.braking_m_per_s2,
        _ => return None,
    })
}

/// The part of a flight in the air: a wing that rolls on a runway is slower than any that flies.
pub fn in_flight(mut all: Vec<Instant>) -> Vec<Instant> {
    let speed = |i: &Instant| i.velocity_ned.xy().norm();
    let fastest = all.iter().map(speed).fold(0.0, f64::max);
    let least = FLYING_M_PER_S.max(FLYING_SHARE * fastest);
    let mut height = 0.0;
    let heights: Vec<f64> = std::iter::once(0.0)
        .chain(all.windows(2).map(|w| {
            height -= (w[1].t_s - w[0].t_s).min(LONGEST_STEP_S) * w[1].velocity_ned.z;
            height
        }))
        .collect();
    let (low, high) = heights.iter().fold((0.0, 0.0), |(l, h): (f64, f64), x| (l.min(*x), h.max(*x)));
    // A log of level flight alone has no ground in it.
    let clear = if high - low > 2.0 * CLEAR_M { low + CLEAR_M } else { low };
    let flies: Vec<bool> =
        all.iter().zip(&heights).map(|(i, height)| speed(i) > least && *height >= clear).collect();
    let first = flies.iter().position(|f| *f).unwrap_or(all.len());
    let last = flies.iter().rposition(|f| *f).map_or(first, |k| k + 1);
    all.truncate(last);
    all.split_off(first.min(last))
}

/// Everything that this flight measures.
pub fn all(flight: &[Instant], wing: bool) -> Vec<Measured> {
    let mut found = speeds(flight, wing);
    found.extend(attitudes(flight, wing));
    if wing {
        found.extend(side_force(flight));
        found.extend(load_overshoot(flight));
    }
    found
}

/// The value that this share of the values is below.
fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.retain(|v| v.is_finite());
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    values.get((share * last as f64).round() as usize).copied()
}

/// Airspeeds where the log has them; otherwise ground speeds, whose mean over all courses is near enough.
fn speeds(flight: &[Instant], wing: bool) -> Vec<Measured> {
    let with_air = flight.iter().filter(|i| i.airspeed.is_some()).count();
    let air = wing && 2 * with_air > flight.len();
    let speed = |i: &Instant| if air { i.airspeed } else { Some(i.velocity_ned.xy().norm()) };
    let all: Vec<f64> = flight.iter().filter_map(speed).collect();
    let what = if air { "airspeed" } else { "ground speed, wind included" };
    let slopes = |of: &dyn Fn(&Instant) -> Option<f64>| -> Vec<f64> {
        let pairs = flight.iter().zip(flight.iter().skip(SLOPE_STEPS));
        pairs
            .filter(|(a, b)| b.t_s > a.t_s && b.t_s - a.t_s < 2.0)
            .filter_map(|(a, b)| Some((of(b)? - of(a)?) / (b.t_s - a.t_s)))
            .collect()
    };
    let along = slopes(&speed);
    let up: Vec<f64> = flight
        .windows(SLOPE_STEPS)
        .map(|w| -w.iter().map(|i| i.velocity_ned.z).sum::<f64>() / SLOPE_STEPS as f64)
        .collect();
    let mut rows = vec![
        ("speed_cruise_m_per_s", quantile(all.clone(), 0.5), format!("median {what}")),
        ("speed_max_m_per_s", quantile(all.clone(), 1.0 - TAIL), format!("{what}, fastest 2 % left out")),
        ("acceleration_m_per_s2", quantile(along.clone(), 1.0 - TAIL), format!("change of {what} in 1 s")),
        ("braking_m_per_s2", quantile(along, TAIL).map(|v| -v), format!("change of {what} in 1 s")),
        ("climb_max_m_per_s", quantile(up.clone(), 1.0 - TAIL), "mean over 1 s".to_owned()),
        ("descent_max_m_per_s", quantile(up, TAIL).map(|v| -v), "mean over 1 s".to_owned()),
    ];
    if wing {
        rows.push(("speed_min_m_per_s", quantile(all, TAIL), format!("{what}, slowest 2 % left out")));
    }
    rows.into_iter().filter_map(|(key, value, why)| Some(Measured::new(key, value?, why))).collect()
}

fn attitudes(flight: &[Instant], wing: bool) -> Vec<Measured> {
    let share = 0.5 * TAIL;
    let most = |of: &dyn Fn(&Instant) -> f64| quantile(flight.iter().map(of).collect(), 1.0 - share);
    let lean = |i: &Instant| {
        if wing { i.roll.abs() } else { acos((cos(i.roll) * cos(i.pitch)).clamp(-1.0, 1.0)) }
    };
    let mut rows = vec![
        ("bank_max_deg", most(&lean), "steepest 1 % left out"),
        ("roll_rate_max_deg_per_s", most(&|i| i.rate.x.abs()), "fastest 1 % left out"),
    ];
    if !wing {
        rows.push(("yaw_rate_max_deg_per_s", most(&|i| i.rate.z.abs()), "fastest 1 % left out"));
    }
    rows.into_iter().filter_map(|(key, v, why)| Some(Measured::new(key, v?.to_degrees(), why))).collect()
}

/// f_y/g = −s √2 sin φ cos θ + r p/(π/2) by least squares: what turns and rolls add to the side force.
fn side_force(flight: &[Instant]) -> Vec<Measured> {
    let turning: Vec<&Instant> = flight.iter().filter(|i| i.roll.abs() > TURN_RAD).collect();
    let spacing = flight.windows(2).map(|w| w[1].t_s - w[0].t_s).filter(|d| *d < 1.0).fold(0.0, f64::max);
    let seconds = spacing.min(0.2) * turning.len() as f64;
    if seconds < LEAST_TURNS_S {
        return Vec::new();
    }
    let row = |i: &Instant| Vector2::new(-SQRT_2 * sin(i.roll) * cos(i.pitch), i.rate.x / FRAC_PI_2);
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for i in flight {
        let h = row(i);
        normal += h * h.transpose();
        right += h * (i.force.y / STANDARD_GRAVITY);
    }
    let Some(inverse) = normal.try_inverse() else { return Vec::new() };
    let x = inverse * right;
    let squares: f64 = flight.iter().map(|i| (i.force.y / STANDARD_GRAVITY - row(i).dot(&x)).powi(2)).sum();
    let variance = squares / flight.len() as f64 * ALIKE;
    let sides = [-1.0, 1.0].map(|s| turning.iter().filter(|i| i.roll * s > 0.0).count());
    let all = turning.len().max(1);
    let evidence = [
        format!("{seconds:.0} s of turns, {} % of them right", 100 * sides[1] / all),
        format!("residual {:.3} g RMS", (squares / flight.len() as f64).sqrt()),
    ];
    let keys = ["side_force_g", "roll_side_force_g"];
    (0..2)
        .map(|k| Measured {
            sigma: Some((variance * inverse[(k, k)]).sqrt()),
            ..Measured::new(keys[k], x[k], evidence[k].as_str())
        })
        .collect()
}

/// For each roll from level flight into a turn that lasts: peak of the load over that of a level turn at the bank that follows. Nine
/// of ten are below.
fn load_overshoot(flight: &[Instant]) -> Option<Measured> {
    let mut ratios = Vec::new();
    let mut highest: f64 = 0.0;
    let mut level_s = f64::NEG_INFINITY;
    let mut done_s = f64::NEG_INFINITY;
    for (k, i) in flight.iter().enumerate() {
        highest = highest.max(-i.force.z / STANDARD_GRAVITY);
        if i.roll.abs() < LEVEL_RAD {
            level_s = i.t_s;
        }
        let rolled_in = i.roll.abs() > TURN_RAD && i.t_s - level_s < PEAK_S && i.t_s > done_s;
        if !rolled_in {
            continue;
        }
        done_s = i.t_s + STEADY_S;
        let after: Vec<&Instant> = flight.iter().skip(k).take_while(|j| j.t_s < i.t_s + STEADY_S).collect();
        let stays = after.iter().all(|j| j.roll * i.roll.signum() > 0.5 * TURN_RAD);
        let (early, late): (Vec<&Instant>, Vec<&Instant>) =
            after.iter().partition(|j| j.t_s < i.t_s + PEAK_S);
        let peak = early.iter().map(|j| -j.force.z / STANDARD_GRAVITY).fold(0.0, f64::max);
        // What a level turn at the bank that follows needs: a pilot who lets the nose drop carries less.
        let bank = late.iter().map(|j| j.roll.abs()).sum::<f64>() / late.len().max(1) as f64;
        if stays && !late.is_empty() && bank > TURN_RAD {
            ratios.push(peak * cos(bank.min(1.4)));
        }
    }
    let turns = ratios.len();
    let value = quantile(ratios, 0.9)?.max(1.0);
    let why = format!(
        "peak over the load of a level turn in {turns} turns; highest load of the flight {highest:.1} g"
    );
    Some(Measured::new("load_overshoot", value, why))
}

/// The base with what was measured, rounded to what the measurement is worth.
///
/// # Errors
/// What was measured is inconsistent with what was given.
pub fn apply(base: &Airframe, measured: &[Measured]) -> Result<Airframe, AirframeError> {
    let mut fitted = base.clone();
    for m in measured {
        if let Some(value) = field(&mut fitted, m.key) {
            *value = (m.value * 1000.0).round() / 1000.0;
        }
    }
    // A side force that is not significant, or to the inside, is none.
    fitted.side_force_g = fitted.side_force_g.clamp(0.0, 0.4);
    fitted.roll_side_force_g = fitted.roll_side_force_g.clamp(-0.5, 0.5);
    fitted.load_overshoot = fitted.load_overshoot.clamp(1.0, 4.0);
    if fitted.is_fixed_wing() {
        // The structure is not what a flight measures: the bank stays within the load that the file gives.
        let by_load = acos(1.0 / fitted.load_factor_max.max(1.01)).to_degrees();
        fitted.bank_max_deg = fitted.bank_max_deg.min((by_load * 10.0).floor() / 10.0).min(75.0);
        let tightest = fitted.turn_radius_m(fitted.speed_min_m_per_s, fitted.bank_max_deg.to_radians());
        fitted.turn_radius_min_m = fitted.turn_radius_min_m.max(tightest.ceil());
    }
    fitted = fitted.fitted();
    fitted.validate()?;
    Ok(fitted)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// PX4's own simulator took off from a runway and rolled out: 7.7 m/s were the slowest airspeed of an aircraft that flies at 10.
    #[test]
    fn rolling_on_the_runway_is_no_flight() {
        let at = |k: usize, speed: f64, down: f64| Instant {
            t_s: 0.1 * k as f64,
            roll: 0.0,
            pitch: 0.0,
            velocity_ned: Vector3::new(speed, 0.0, down),
            rate: Vector3::zeros(),
            force: Vector3::zeros(),
            airspeed: Some(speed),
        };
        // Rolls to 10 m/s in 5 s, climbs 60 m, flies, descends, rolls out.
        let of = |k: usize| match k {
            0..50 => at(k, 0.2 * k as f64, 0.0),
            50..250 => at(k, 12.0, -3.0),
            250..950 => at(k, 11.0 + (k % 50) as f64 * 0.05, 0.0),
            950..1150 => at(k, 12.0, 3.0),
            _ => at(k, (10.0 - 0.05 * (k - 1150) as f64).max(0.0), 0.0),
        };
        let whole: Vec<Instant> = (0..1400).map(of).collect();
        let slowest = |flight: Vec<Instant>| {
            speeds(&flight, true).iter().find(|m| m.key == "speed_min_m_per_s").map(|m| m.value)
        };
        assert!(slowest(in_flight(whole.clone())).is_some_and(|v| v > 10.9));
        // Without take-off and landing nothing is cut.
        let level = whole.get(250..950).unwrap_or_default().to_vec();
        assert_eq!(in_flight(level.clone()).len(), level.len());
    }
}
