//! Whether a vehicle leaned as it was demanded, and what its motors had in reserve.

use super::{HealthLog, Series, keep};
use crate::advice::on_board::OnBoard;
use crate::health::checks::{Finding, Grade};
use crate::health::rows::{Row, fullest, rows};
use crate::logs::VehicleClass;
use gaware_nav::math::{acos, cos, sin};
use gaware_nav::operating::{Channel, MOTORS, Operating};
use nalgebra::Vector3;

/// ArduPilot's crash check: a lean that is further than this from the demanded one, rad …
const AWAY: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// … for so long, s (ArduCopter `crash_check.cpp`: `CRASH_CHECK_ANGLE_DEVIATION_DEG`, `CRASH_CHECK_TRIGGER_SEC`); half as long is worth a look.
const AWAY_S: [f64; 2] = [1.0, 2.0];
/// What swings is away again and again: the time counts within so long, s. A crash swung between 5° and 90° for 5 s and was away for 1.2 s at a
/// time (beast36.bin).
const AWAY_WITHIN_S: f64 = 5.0;
/// Beyond this the vehicle is upside down, rad.
const UPSIDE_DOWN: f64 = 0.5 * std::f64::consts::PI;
/// Leans are kept this far apart, µs: what takes seconds is seen.
const SPACING_US: u64 = 100_000;
/// A demand that is older than this is none, µs.
const STALE_US: u64 = 1_000_000;
/// An output at its limit for so long in a row is no gust, s.
const LIMIT_S: f64 = 1.0;
/// Motors whose outputs are at their least for so long have stopped, s: a heartbeat says a second late that the vehicle is disarmed …
const STOPPED_S: f64 = 2.0;
/// … and they turned so shortly before, s.
const TURNED_S: f64 = 1.0;
/// `SERVOn_FUNCTION`: motors 1 to 8, 9 to 12 (ArduPilot `SRV_Channel.h`).
const MOTOR_FUNCTIONS: [std::ops::RangeInclusive<i64>; 2] = [33..=40, 82..=85];
/// An output is at a limit within so much, µs.
const NEAR_US: f64 = 3.0;

/// How far a lean is from level and from the demanded one, rad.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lean {
    tilt: f64,
    away: Option<f64>,
}

/// Leans and outputs over a log.
#[derive(Debug, Clone, Default)]
pub(super) struct Control {
    demanded: Option<(u64, [f64; 2])>,
    leans: Series<Lean>,
    outputs: Series<[f64; MOTORS]>,
}

/// The vertical axis of the body of a roll and a pitch, whatever the heading.
fn axis([roll, pitch]: [f64; 2]) -> Vector3<f64> {
    Vector3::new(cos(roll) * sin(pitch), -sin(roll), cos(roll) * cos(pitch))
}

impl Control {
    pub(super) fn demand(&mut self, t_us: u64, lean: [f64; 2]) {
        self.demanded = Some((t_us, lean));
    }

    pub(super) fn attitude(&mut self, t_us: u64, lean: [f64; 2]) {
        if self.leans.last().is_some_and(|(last, _)| t_us < last + SPACING_US) {
            return;
        }
        let up = axis(lean);
        let angle = |other: &Vector3<f64>| acos(up.dot(other).clamp(-1.0, 1.0));
        let demanded = self.demanded.filter(|(t, _)| t_us.saturating_sub(*t) < STALE_US);
        let lean = Lean { tilt: angle(&Vector3::z()), away: demanded.map(|(_, lean)| angle(&axis(lean))) };
        if lean.tilt.is_finite() {
            keep(&mut self.leans, t_us, lean);
        }
    }

    pub(super) fn outputs(&mut self, t_us: u64, values: &Operating) {
        let outputs = std::array::from_fn(|k| values.get(Channel::Motor(k as u8)).unwrap_or(f64::NAN));
        if outputs.iter().any(|v| v.is_finite())
            && self.outputs.last().is_none_or(|(last, _)| t_us >= last + SPACING_US)
        {
            keep(&mut self.outputs, t_us, outputs);
        }
    }
}

/// Whether rotors alone carry it: what is demanded of wings is not followed in every mode.
fn is_carried_by_rotors(board: &OnBoard) -> bool {
    board.class.is_some_and(VehicleClass::is_carried_by_rotors)
}

impl HealthLog {
    /// Whether the log says how the vehicle leaned.
    pub(super) fn has_leans(&self) -> bool {
        !self.control.leans.is_empty()
    }

    /// Leans away from what is demanded, and upside down.
    pub(super) fn leans(&self, board: &OnBoard, in_flight: &dyn Fn(f64) -> bool) -> Vec<Finding> {
        let rotors = is_carried_by_rotors(board);
        let flown = || {
            let all = self.control.leans.iter().map(|(t, lean)| (self.s(*t), *lean));
            all.filter(|(t, _)| in_flight(*t))
        };
        let away = flown().filter_map(|(t, lean)| Some((t, lean.away.filter(|_| rotors)?)));
        let mut found = Vec::new();
        if let Some((row, whole_s)) = fullest(away, AWAY, AWAY_WITHIN_S).filter(|(_, s)| *s >= AWAY_S[0]) {
            let grade = if whole_s >= AWAY_S[1] { Grade::Bad } else { Grade::Look };
            let text = format!(
                "leans up to {:.0}° away from what is demanded, more than {:.0}° for {whole_s:.1} s of {AWAY_WITHIN_S:.0} s from {:.1} s: out of control, or held by the ground",
                row.peak.to_degrees(),
                AWAY.to_degrees(),
                row.start
            );
            found.push((grade, Some(row.start), text));
        }
        // A submarine flies as it likes.
        let tilts = flown().filter(|_| board.class != Some(VehicleClass::Submarine));
        if let Some(row) = longest(rows(tilts.map(|(t, lean)| (t, lean.tilt)), UPSIDE_DOWN), AWAY_S[0]) {
            let grade = if rotors && row.length_s() >= AWAY_S[1] { Grade::Bad } else { Grade::Look };
            let text = format!("upside down for {:.1} s from {:.1} s", row.length_s(), row.start);
            found.push((grade, Some(row.start), text));
        }
        found
    }

    /// The outputs that turn motors; none where the parameters do not say.
    fn motors(&self, board: &OnBoard) -> Vec<usize> {
        let turns = |k: &usize| {
            let function = board.get(&format!("SERVO{}_FUNCTION", k + 1)).map_or(-1, |v| v as i64);
            MOTOR_FUNCTIONS.iter().any(|range| range.contains(&function))
        };
        if self.control.outputs.is_empty() || !is_carried_by_rotors(board) {
            return Vec::new();
        }
        (0..MOTORS).filter(turns).collect()
    }

    /// Whether the log says what its motors were given.
    pub(super) fn has_motors(&self, board: &OnBoard) -> bool {
        !self.stopped.is_empty() || !self.motors(board).is_empty() && pwm_limits(board).is_some()
    }

    /// Motors without reserve, and the instants at which all outputs are at their least.
    pub(super) fn motor_limits(&self, board: &OnBoard, in_flight: &dyn Fn(f64) -> bool) -> Vec<Finding> {
        let motors = self.motors(board);
        let Some([least, most]) = pwm_limits(board).filter(|_| !motors.is_empty()) else { return Vec::new() };
        let flown = || {
            let all = self.control.outputs.iter().map(|(t, outputs)| (self.s(*t), outputs));
            all.filter(|(t, _)| in_flight(*t))
        };
        let mut found = Vec::new();
        for k in &motors {
            let at_limit = rows(flown().map(|(t, outputs)| (t, 1000.0 + 1000.0 * outputs[*k])), most);
            let whole: f64 = at_limit.iter().map(Row::length_s).sum();
            if let Some(row) = longest(at_limit, LIMIT_S) {
                let text = format!(
                    "motor output {} at its limit for {:.1} s from {:.1} s ({whole:.1} s in all): no thrust in reserve",
                    k + 1,
                    row.length_s(),
                    row.start
                );
                found.push((Grade::Look, Some(row.start), text));
            }
        }
        let spare = |outputs: &[f64; MOTORS]| {
            let most = motors.iter().map(|k| 1000.0 + 1000.0 * outputs[*k]).fold(f64::MIN, f64::max);
            least - most
        };
        // After arming motors wait; those that stop have turned just before.
        let turned = |start: f64| {
            flown().any(|(t, outputs)| (start - TURNED_S..start).contains(&t) && spare(outputs) < 0.0)
        };
        let mut stops = rows(flown().map(|(t, outputs)| (t, spare(outputs))), 0.0);
        stops.retain(|row| turned(row.start));
        if let Some(row) = longest(stops, STOPPED_S) {
            let text = format!("all motor outputs are at their least in flight from {:.1} s", row.start);
            found.push((Grade::Bad, Some(row.start), text));
        }
        found
    }
}

/// The least and the largest output that motors are given, µs: between `MOT_PWM_MIN` and `MOT_PWM_MAX` up to `MOT_SPIN_MAX` (ArduPilot
/// `AP_MotorsMulticopter`).
fn pwm_limits(board: &OnBoard) -> Option<[f64; 2]> {
    let [low, high, spin] = ["MOT_PWM_MIN", "MOT_PWM_MAX", "MOT_SPIN_MAX"].map(|name| board.get(name));
    let (low, high, spin) = (low?, high?, spin?);
    (low > 0.0 && high > low).then_some([low + NEAR_US, low + spin * (high - low) - NEAR_US])
}

/// The longest of the rows that last so long.
fn longest(rows: Vec<Row>, least_s: f64) -> Option<Row> {
    let longest = rows.into_iter().max_by(|a, b| a.length_s().total_cmp(&b.length_s()));
    longest.filter(|row| row.length_s() >= least_s)
}
