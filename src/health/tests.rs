//! Flights made note by note, and recorded failures where they are at hand.

use super::checks::{Check, Grade, checks, verdict};
use super::*;
use crate::advice::on_board::OnBoard;
use crate::logs;
use gaware_nav::sample::FixVelocity;

fn at(log: &mut HealthLog, t_s: f64, note: HealthNote) {
    log.take(&Record { t_us: (t_s * 1e6) as u64, item: Item::Note(LogNote::Health(note)) });
}

fn ratio(log: &mut HealthLog, t_s: f64, channel: Channel, value: f64) {
    log.take(&Record { t_us: (t_s * 1e6) as u64, item: Item::Note(LogNote::Filter(vec![(channel, value)])) });
}

/// A minute of flight from 10 s on, healthy.
fn flight() -> HealthLog {
    let mut log = HealthLog::default();
    at(&mut log, 0.0, HealthNote::Mode("LOITER".into()));
    at(&mut log, 5.0, HealthNote::Armed(true));
    at(&mut log, 10.0, HealthNote::InAir(true));
    for k in 0..70 {
        let t = f64::from(k);
        let gnss = HealthNote::Gnss {
            fix_type: 3,
            satellites: Some(14.0),
            hdop: Some(0.7),
            jamming: None,
            interference: false,
        };
        at(&mut log, t, gnss);
        at(&mut log, t, HealthNote::Vibration(0, 8.0));
        at(&mut log, t, HealthNote::Battery { volts: 15.6, cells: Some(4.0), remaining: Some(0.7) });
        ratio(&mut log, t, Channel::VelocityRatio, 0.2);
    }
    log
}

fn of<'a>(all: &'a [Check], part: &str) -> &'a Check {
    all.iter().find(|c| c.part == part).unwrap()
}

#[test]
fn a_healthy_flight_is_healthy_and_what_is_not_in_the_log_is_named() {
    let mut log = flight();
    at(&mut log, 70.0, HealthNote::InAir(false));
    at(&mut log, 71.0, HealthNote::Armed(false));
    let all = checks(&log, false, &OnBoard::default());
    assert!(verdict(&log, &all).starts_with("Healthy in all"), "{} {all:?}", verdict(&log, &all));
    assert_eq!(of(&all, "motors").grade, Grade::Unknown);
    assert_eq!(of(&all, "battery and supply").grade, Grade::Ok);
}

#[test]
fn what_kills_an_estimator_is_bad_from_its_onset() {
    let mut log = flight();
    for k in 0..60 {
        ratio(&mut log, 70.0 + 0.1 * f64::from(k), Channel::PositionRatio, 1.3);
    }
    let all = checks(&log, false, &OnBoard::default());
    let own = of(&all, "autopilot's estimator");
    assert_eq!((own.grade, own.t_s), (Grade::Bad, Some(70.0)));
    assert!(
        verdict(&log, &all).starts_with("Bad: autopilot's estimator from 70.0 s"),
        "{}",
        verdict(&log, &all)
    );
}

#[test]
fn a_short_rejection_is_worth_a_look_and_one_on_the_ground_nothing() {
    let mut log = flight();
    for k in 0..30 {
        ratio(&mut log, 2.0 + 0.1 * f64::from(k), Channel::VelocityRatio, 2.0);
        ratio(&mut log, 70.0 + 0.1 * f64::from(k), Channel::HeightRatio, 2.0);
    }
    let all = checks(&log, false, &OnBoard::default());
    let own = of(&all, "autopilot's estimator");
    assert_eq!((own.grade, own.t_s), (Grade::Look, Some(70.0)), "{}", own.text);
}

#[test]
fn events_in_flight_are_graded_and_dated() {
    let mut log = flight();
    let fault = |what, on, grave| HealthNote::Fault { what, on, grave };
    at(&mut log, 31.0, fault("EKF failsafe", true, true));
    at(&mut log, 30.0, HealthNote::Clipped(0, 3.0));
    at(&mut log, 32.0, HealthNote::Clipped(0, 300.0));
    at(&mut log, 33.0, HealthNote::Lane(0));
    at(&mut log, 34.0, HealthNote::Lane(1));
    at(&mut log, 35.0, HealthNote::Motors(0.5));
    at(&mut log, 36.0, HealthNote::Motors(0.0));
    at(&mut log, 37.0, HealthNote::Text(Level::Error, "EKF variance".into()));
    at(&mut log, 69.0, HealthNote::Battery { volts: 12.8, cells: None, remaining: Some(0.15) });
    let all = checks(&log, false, &OnBoard::default());
    for (part, grade, t_s) in [
        ("autopilot's estimator", Grade::Bad, 31.0),
        ("vibration", Grade::Bad, 32.0),
        ("motors", Grade::Bad, 36.0),
        ("messages", Grade::Bad, 37.0),
        ("battery and supply", Grade::Bad, 69.0),
        ("end of the log", Grade::Look, 69.0),
    ] {
        assert_eq!((of(&all, part).grade, of(&all, part).t_s), (grade, Some(t_s)), "{:?}", of(&all, part));
    }
    assert!(of(&all, "autopilot's estimator").text.contains("lane switched once, first to 1 at 34.0 s"));
}

/// A fix at this time, on the ground plan of a flight at 500 m.
fn fix_at(t_us: u64, [lat, lon]: [f64; 2], velocity: [f64; 3]) -> Record {
    let fix = GnssFix {
        t_s: 0.0,
        position: gaware_nav::earth::Geodetic::from_degrees(lat, lon, 500.0),
        velocity: FixVelocity::Full(velocity),
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    };
    Record { t_us, item: Item::Measurement(Measurement::Fix(None, fix)) }
}

#[test]
fn a_fix_that_is_not_where_the_last_one_leads_has_jumped() {
    let mut log = flight();
    for k in 0..20 {
        let lat = 47.0 + if k < 10 { 0.0 } else { 0.001 };
        log.take(&fix_at(20_000_000 + 200_000 * k, [lat, 8.0], [0.0; 3]));
    }
    let all = checks(&log, false, &OnBoard::default());
    assert_eq!(
        (of(&all, "GNSS").grade, of(&all, "GNSS").t_s),
        (Grade::Bad, Some(22.0)),
        "{:?}",
        of(&all, "GNSS")
    );
}

#[test]
fn a_flight_across_the_antimeridian_has_not_jumped() {
    let mut log = flight();
    for k in 0..40_u64 {
        // 20 m/s to the east, from 179.9995° on.
        let lon = 179.9995 + 4.0 * k as f64 / 111_195.0;
        let lon = if lon > 180.0 { lon - 360.0 } else { lon };
        log.take(&fix_at(20_000_000 + 200_000 * k, [0.0, lon], [0.0, 20.0, 0.0]));
    }
    let all = checks(&log, false, &OnBoard::default());
    assert_ne!(of(&all, "GNSS").grade, Grade::Bad, "{:?}", of(&all, "GNSS"));
}

/// Fixes of a steady flight that a link delivers in bursts of five: none of them has jumped.
#[test]
fn fixes_that_arrive_late_and_together_have_not_jumped() {
    let mut log = flight();
    for k in 0..50_u64 {
        let t_s = 20.0 + 0.2 * k as f64;
        let fix = GnssFix {
            t_s: 0.0,
            position: gaware_nav::earth::Geodetic::from_degrees(47.0 + 15.0 * t_s / 111_195.0, 8.0, 500.0),
            velocity: FixVelocity::Full([15.0, 0.0, 0.0]),
            position_sigma_m: None,
            velocity_sigma_m_per_s: None,
            yaw_rad: None,
        };
        let arrived_us = 20_000_000 + 1_000_000 * (k / 5 + 1) + 3000 * (k % 5);
        let item = Item::Measurement(Measurement::Fix(Stamp::from_seconds(t_s), fix));
        log.take(&Record { t_us: arrived_us, item });
    }
    let all = checks(&log, false, &OnBoard::default());
    assert!(!of(&all, "GNSS").text.contains("jumps"), "{:?}", of(&all, "GNSS"));
}

/// A log that ArduPilot begins when it is armed says of arming the end alone.
#[test]
fn a_log_that_says_only_that_it_is_disarmed_was_armed_before() {
    let mut log = HealthLog::default();
    at(&mut log, 700.0, HealthNote::Mode("POSHOLD".into()));
    at(&mut log, 833.0, HealthNote::Armed(false));
    at(&mut log, 835.0, HealthNote::Supply(5.0));
    assert_eq!(log.armed(), Some(vec![(0.0, 133.0)]));
}

#[test]
fn a_text_of_a_failsafe_is_a_failsafe() {
    let mut log = flight();
    at(&mut log, 40.0, HealthNote::Text(Level::Error, "Failsafe - Short event on".into()));
    at(&mut log, 41.0, HealthNote::Text(Level::Error, "Crash: disarming".into()));
    let all = checks(&log, false, &OnBoard::default());
    assert_eq!((of(&all, "failsafes").grade, of(&all, "failsafes").t_s), (Grade::Bad, Some(40.0)));
    assert_eq!((of(&all, "messages").grade, of(&all, "messages").t_s), (Grade::Bad, Some(41.0)));
}

/// The texts and bad receivers of a bench are of no flight, and the verdict says so.
#[test]
fn a_log_that_was_never_armed_is_of_no_flight() {
    let mut log = HealthLog::default();
    at(&mut log, 0.0, HealthNote::Armed(false));
    for k in 0..60 {
        let gnss = HealthNote::Gnss {
            fix_type: 0,
            satellites: Some(0.0),
            hdop: None,
            jamming: None,
            interference: false,
        };
        at(&mut log, f64::from(k), gnss);
        ratio(&mut log, f64::from(k), Channel::HeadingRatio, 3.8);
    }
    at(&mut log, 30.0, HealthNote::Text(Level::Error, "PreArm: check fence".into()));
    let all = checks(&log, false, &OnBoard::default());
    assert!(all.iter().all(|c| c.grade <= Grade::Look), "{all:?}");
    assert_eq!((of(&all, "GNSS").grade, of(&all, "compass").grade), (Grade::Look, Grade::Look), "{all:?}");
    assert_eq!(of(&all, "messages").grade, Grade::Ok);
    assert_eq!(verdict(&log, &all), "The vehicle was never armed in this log. Look at GNSS, compass.");
}

fn multirotor(parameters: &[(&str, f64)]) -> OnBoard {
    let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    OnBoard { class: Some(crate::logs::VehicleClass::Multirotor), parameters, ..OnBoard::default() }
}

/// A minute of flight from 10 s on whose pitch follows the demand, but for these stretches.
fn leaning(away: impl Fn(f64) -> f64) -> HealthLog {
    let mut log = flight();
    for k in 0..700 {
        let t = 0.1 * f64::from(k);
        let pitch = 0.3 * gaware_nav::math::sin(t);
        at(&mut log, t, HealthNote::Demanded([0.0, pitch]));
        let actual = [0.0, pitch + away(t).to_radians(), 0.0];
        let item = Item::Measurement(Measurement::Attitude(Stamp::from_seconds(t).unwrap(), actual));
        log.take(&Record { t_us: (t * 1e6) as u64, item });
    }
    log
}

#[test]
fn a_vehicle_that_does_not_lean_as_demanded_is_out_of_control() {
    let between = |from: f64, to: f64, size: f64| move |t: f64| if t > from && t < to { size } else { 0.0 };
    let own = |log: &HealthLog, board: &OnBoard| of(&checks(log, false, board), "attitude").clone();
    let rotors = multirotor(&[]);
    assert_eq!(own(&leaning(|_| 5.0), &rotors).grade, Grade::Ok);
    assert_eq!(own(&leaning(between(30.0, 30.6, 60.0)), &rotors).grade, Grade::Ok, "a gust");
    assert_eq!(own(&leaning(between(3.0, 8.0, 60.0)), &rotors).grade, Grade::Ok, "on the ground");
    let crash = own(&leaning(between(40.0, 45.0, 60.0)), &rotors);
    assert_eq!((crash.grade, crash.t_s.map(f64::round)), (Grade::Bad, Some(40.0)), "{}", crash.text);
    assert!(crash.text.contains("60° away from what is demanded"), "{}", crash.text);
    // Wings do not follow it in every mode.
    assert_eq!(own(&leaning(between(40.0, 45.0, 60.0)), &OnBoard::default()).grade, Grade::Ok);
    let over = own(&leaning(between(40.0, 45.0, 150.0)), &OnBoard::default());
    assert_eq!(over.grade, Grade::Look);
    assert!(over.text.starts_with("upside down for 4.8 s from 40.1 s"), "{}", over.text);
    assert_eq!(of(&checks(&flight(), false, &rotors), "attitude").grade, Grade::Unknown);
}

#[test]
fn a_motor_without_reserve_and_motors_that_stop_are_seen() {
    let board = multirotor(&[
        ("SERVO1_FUNCTION", 33.0),
        ("SERVO2_FUNCTION", 34.0),
        ("SERVO3_FUNCTION", 7.0),
        ("MOT_PWM_MIN", 1000.0),
        ("MOT_PWM_MAX", 2000.0),
        ("MOT_SPIN_MAX", 0.95),
    ]);
    let given = |second: &dyn Fn(f64) -> f64| {
        let mut log = flight();
        for k in 0..700 {
            let t = 0.1 * f64::from(k);
            let values = gaware_nav::operating::Operating::default()
                .with(gaware_nav::operating::Channel::Motor(0), if second(t) > 0.0 { 0.5 } else { 0.0 })
                .with(gaware_nav::operating::Channel::Motor(1), second(t))
                .with(gaware_nav::operating::Channel::Motor(2), 1.0);
            let item = Item::Measurement(Measurement::Operating(None, values));
            log.take(&Record { t_us: (t * 1e6) as u64, item });
        }
        of(&checks(&log, false, &board), "motors").clone()
    };
    assert_eq!(given(&|_| 0.6).grade, Grade::Ok);
    assert_eq!(given(&|t| if t < 9.0 { 0.95 } else { 0.6 }).grade, Grade::Ok, "on the ground");
    let full = given(&|t| if t > 30.0 && t < 33.0 { 0.95 } else { 0.6 });
    assert_eq!((full.grade, full.t_s.map(f64::round)), (Grade::Look, Some(30.0)), "{}", full.text);
    assert!(full.text.contains("motor output 2 at its limit for 2.8 s"), "{}", full.text);
    let stopped = given(&|t| if t > 50.0 { 0.0 } else { 0.6 });
    assert_eq!((stopped.grade, stopped.t_s.map(f64::round)), (Grade::Bad, Some(50.0)), "{}", stopped.text);
}

/// A battery of 14 cells that was never full in this log, and the limits of its owner.
#[test]
fn cells_and_limits_of_a_battery_are_those_of_the_parameters() {
    let mut log = flight();
    log.battery.clear();
    for k in 0..70 {
        let volts = if k < 40 { 51.0 } else { 49.2 };
        at(&mut log, f64::from(k), HealthNote::Battery { volts, cells: None, remaining: None });
    }
    log.cells = None;
    let own = |board: &OnBoard| of(&checks(&log, false, board), "battery and supply").clone();
    let counted = own(&OnBoard::default());
    assert!(counted.text.contains("12 cells, counted by the highest voltage"), "{}", counted.text);
    let known = own(&multirotor(&[("MOT_BAT_VOLT_MAX", 60.9), ("BATT_LOW_VOLT", 50.4)]));
    assert_eq!((known.grade, known.t_s), (Grade::Look, Some(40.0)), "{}", known.text);
    assert!(known.text.contains("3.51 V for each of 14 cells"), "{}", known.text);
    assert!(known.text.contains("below BATT_LOW_VOLT (50.4 V) for 29.0 s from 40.0 s"), "{}", known.text);
    assert_eq!(own(&multirotor(&[("BATT_CRT_VOLT", 50.4)])).grade, Grade::Bad);
}

#[test]
fn a_receiver_that_falls_silent_in_flight_is_seen_and_a_link_that_does_is_not() {
    let silent = |receiver: &dyn Fn(f64) -> bool, others: &dyn Fn(f64) -> bool| {
        let mut log = HealthLog::default();
        at(&mut log, 0.0, HealthNote::Armed(true));
        at(&mut log, 1.0, HealthNote::InAir(true));
        for k in 0..700 {
            let t = 0.1 * f64::from(k);
            if k % 2 == 0 && receiver(t) {
                let (satellites, hdop) = (Some(14.0), Some(0.7));
                let gnss =
                    HealthNote::Gnss { fix_type: 3, satellites, hdop, jamming: None, interference: false };
                at(&mut log, t, gnss);
            }
            if others(t) {
                at(&mut log, t, HealthNote::Vibration(0, 8.0));
            }
        }
        of(&checks(&log, false, &OnBoard::default()), "GNSS").clone()
    };
    assert_eq!(silent(&|_| true, &|_| true).grade, Grade::Ok);
    let gone = silent(&|t| t < 40.0, &|_| true);
    assert_eq!((gone.grade, gone.t_s.map(f64::round)), (Grade::Bad, Some(40.0)), "{}", gone.text);
    assert!(gone.text.contains("no word of the receiver for 29 s"), "{}", gone.text);
    assert_eq!(silent(&|t| !(30.0..33.0).contains(&t), &|_| true).grade, Grade::Look);
    let link = |t: f64| !(30.0..50.0).contains(&t);
    assert_eq!(silent(&link, &link).grade, Grade::Ok, "nothing came at all");
}

/// The time since boot begins anew in flight, and a receiver reports a fix at zero and zero.
#[test]
fn an_autopilot_that_restarts_in_flight_and_a_fix_without_a_place_are_seen() {
    use crate::link::frame::{Frame, Sender};
    use mavlink::dialects::ardupilotmega as m;
    let flight = |boot_ms: &dyn Fn(u32) -> u32, lat: &dyn Fn(u32) -> i32| {
        let mut log = HealthLog::default();
        let mut send = |t_ms: u32, message: &m::MavMessage| {
            let frame = Frame::encode(Sender { system_id: 1, component_id: 1 }, 0, message);
            log.take(&Record { t_us: u64::from(t_ms) * 1000, item: Item::Frame(frame) });
        };
        for t_ms in (0..60_000).step_by(200) {
            send(
                t_ms,
                &m::MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
                    mavtype: m::MavType::MAV_TYPE_QUADROTOR,
                    autopilot: m::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
                    base_mode: m::MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
                    ..Default::default()
                }),
            );
            let time_boot_ms = boot_ms(t_ms);
            send(t_ms, &m::MavMessage::ATTITUDE(m::ATTITUDE_DATA { time_boot_ms, ..Default::default() }));
            send(
                t_ms,
                &m::MavMessage::GPS_RAW_INT(m::GPS_RAW_INT_DATA {
                    fix_type: m::GpsFixType::GPS_FIX_TYPE_3D_FIX,
                    lat: lat(t_ms),
                    satellites_visible: 12,
                    ..Default::default()
                }),
            );
        }
        checks(&log, false, &OnBoard::default())
    };
    let all = flight(&|t| 100_000 + t, &|_| 470_000_000);
    assert_eq!((of(&all, "failsafes").grade, of(&all, "GNSS").grade), (Grade::Ok, Grade::Ok), "{all:?}");
    let all = flight(&|t| if t < 30_000 { 100_000 + t } else { t - 29_000 }, &|_| 470_000_000);
    assert_eq!((of(&all, "failsafes").grade, of(&all, "failsafes").t_s), (Grade::Bad, Some(30.0)), "{all:?}");
    assert!(of(&all, "failsafes").text.contains("the autopilot restarted at 30.0 s"), "{all:?}");
    let all = flight(&|t| t, &|t| if t < 30_000 { 470_000_000 } else { 0 });
    assert_eq!((of(&all, "GNSS").grade, of(&all, "GNSS").t_s), (Grade::Bad, Some(30.0)), "{all:?}");
}

/// Firmware before 3.4 sends what it reports with the severity of an alert.
#[test]
fn texts_of_old_firmware_are_judged_by_their_words() {
    use crate::link::frame::{Frame, Sender};
    use mavlink::dialects::ardupilotmega as m;
    let mut log = HealthLog::default();
    let mut send = |t_s: f64, message: &m::MavMessage| {
        let frame = Frame::encode(Sender { system_id: 1, component_id: 1 }, 0, message);
        log.take(&Record { t_us: (t_s * 1e6) as u64, item: Item::Frame(frame) });
    };
    let heartbeat = |armed| m::HEARTBEAT_DATA {
        mavtype: m::MavType::MAV_TYPE_QUADROTOR,
        autopilot: m::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        base_mode: if armed { m::MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { m::MavModeFlag::empty() },
        ..Default::default()
    };
    let text = |text: &str| m::STATUSTEXT_DATA {
        severity: m::MavSeverity::MAV_SEVERITY_ALERT,
        text: text.into(),
        ..Default::default()
    };
    send(0.0, &m::MavMessage::HEARTBEAT(heartbeat(true)));
    for (k, words) in
        ["Arming motors", "Reached Command #1", "Low Battery!", "Crash: Disarming"].iter().enumerate()
    {
        send(1.0 + k as f64, &m::MavMessage::STATUSTEXT(text(words)));
    }
    let all = checks(&log, false, &OnBoard::default());
    let own = of(&all, "messages");
    assert_eq!((own.grade, own.t_s), (Grade::Bad, Some(4.0)), "{}", own.text);
    assert!(!own.text.contains("Reached") && !own.text.contains("Arming motors"), "{}", own.text);
}

fn recorded(name: &str) -> (HealthLog, Vec<Check>) {
    let mut reader = logs::open(crate::testing::flights().join(name)).unwrap();
    let mut log = HealthLog::default();
    reader.by_ref().flatten().for_each(|record| log.take(&record));
    let px4 = reader.autopilot() == Some("px4");
    let all = checks(&log, px4, &OnBoard::default());
    (log, all)
}

/// The vehicle tips over at 114.98 s of its clock (its own text), and its filter rejects velocity from 117.35 s and position from 117.94 s
/// on (PX4/flight-review-rs, snapshot of its diagnostics of this log).
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn the_recorded_failure_of_a_filter_is_bad_within_a_second_of_its_onset() {
    let (log, all) = recorded("real_px4_ekf_failure.ulg");
    let start_s = log.start_us.unwrap() as f64 * 1e-6;
    let own = of(&all, "autopilot's estimator");
    assert_eq!(own.grade, Grade::Bad, "{own:?}");
    let failsafe = of(&all, "failsafes");
    assert!((failsafe.t_s.unwrap() + start_s - 114.98).abs() < 1.0, "{failsafe:?} {start_s}");
    // 117.8 s of the vehicle's clock: the velocity is beyond its test for one sample as it tips over already; what lasts is the position.
    assert!((start_s - 46.94).abs() < 0.01, "{start_s}");
    assert!(own.text.contains("position test ratio above 1 for 5.5 s from 70.9 s"), "{own:?}");
    assert!(verdict(&log, &all).starts_with("Bad: "), "{}", verdict(&log, &all));
}

/// A minute of flight from 10 s on, with what an ArduPilot logger says each second: `lost` of 500 entries.
fn logged(lost: impl Fn(u32) -> f64) -> HealthLog {
    let mut log = flight();
    let mut sum = 11.0;
    for k in 0..70 {
        sum += lost(k);
        at(&mut log, f64::from(k) + 0.5, HealthNote::Lost(sum, 500.0 * f64::from(k)));
    }
    log
}

#[test]
fn entries_that_the_logger_lost_in_flight_are_counted_and_those_at_its_start_are_not() {
    let own =
        |lost: &dyn Fn(u32) -> f64| of(&checks(&logged(lost), false, &OnBoard::default()), "logger").clone();
    assert_eq!(own(&|_| 0.0).grade, Grade::Ok);
    assert_eq!(own(&|k| if k < 5 { 900.0 } else { 0.0 }).grade, Grade::Ok, "on the ground");
    let few = own(&|k| if k == 30 { 90.0 } else { 0.0 });
    assert_eq!((few.grade, few.t_s), (Grade::Look, Some(30.5)), "{}", few.text);
    assert!(few.text.contains("lost 0.30 % of its entries"), "{}", few.text);
    let many = own(&|k| if k > 20 { 500.0 } else { 0.0 });
    assert_eq!((many.grade, many.t_s), (Grade::Bad, Some(21.5)), "{}", many.text);
    assert_eq!(of(&checks(&flight(), false, &OnBoard::default()), "logger").grade, Grade::Unknown);
}

#[test]
fn pauses_of_a_logger_are_a_share_of_the_flight() {
    let mut log = flight();
    at(&mut log, 0.0, HealthNote::Pause(0.0));
    assert_eq!(of(&checks(&log, true, &OnBoard::default()), "logger").grade, Grade::Ok);
    at(&mut log, 40.0, HealthNote::Pause(0.3));
    at(&mut log, 60.0, HealthNote::Pause(0.6));
    let own = of(&checks(&log, true, &OnBoard::default()), "logger").clone();
    assert_eq!((own.grade, own.t_s), (Grade::Look, Some(40.0)), "{}", own.text);
    assert!(own.text.contains("2 pauses, the longest 0.60 s"), "{}", own.text);
}
