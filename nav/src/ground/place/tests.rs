//! When the place may speak, and when it must not.

use super::*;
use crate::earth::STANDARD_GRAVITY;
use crate::math::sin;

const NOISE: SampleNoise = SampleNoise { rate: 1.5e-6, force: 2e-3, least: [1.5e-6, 2e-3] };

/// A vehicle at 50 Hz: `moves` says rate, rad/s, and specific force along the vertical, m/s², at a time.
struct Vehicle {
    aid: PlaceAid,
    t_s: f64,
    given: usize,
}

impl Vehicle {
    fn new() -> Self {
        let mut aid = PlaceAid::default();
        aid.set_flight(false, false);
        Self { aid, t_s: 0.0, given: 0 }
    }

    fn for_s(&mut self, seconds: f64, rate: f64, speed: Option<f64>) -> usize {
        let (before, until_s) = (self.given, self.t_s + seconds);
        let mut k = 0_u32;
        while self.t_s < until_s {
            // Noise that is the same in every run, of the size that the detector expects.
            let noise = |sigma: f64| sigma * 1.4 * sin(f64::from(k) * 12.9898 + 0.3);
            let gyro = Vector3::new(noise(1.2e-3), 0.0, rate * if k % 50 < 25 { 1.0 } else { -1.0 });
            let accel = Vector3::new(0.0, noise(0.03), -STANDARD_GRAVITY);
            let sample = ImuSample { t_s: self.t_s, gyro, accel, temperature_degc: None };
            if let Some(speed) = speed.filter(|_| k.is_multiple_of(10)) {
                let _ = self.aid.take_fix(&fix(self.t_s, speed), self.t_s);
            }
            self.given += usize::from(self.aid.take(&sample, &NOISE).is_some());
            (k, self.t_s) = (k + 1, self.t_s + 0.02);
        }
        self.given - before
    }
}

fn fix(t_s: f64, north: f64) -> GnssFix {
    GnssFix {
        t_s,
        position: Geodetic::from_degrees(47.0, 8.0, 400.0),
        velocity: FixVelocity::Horizontal([north, 0.0]),
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    }
}

#[test]
fn it_speaks_once_a_second_of_a_vehicle_that_stands_and_in_hands_and_not_beside_fixes() {
    let mut v = Vehicle::new();
    assert_eq!(v.for_s(3.0, 0.0, None), 0, "not before it has stood for a while");
    let standing = v.for_s(20.0, 0.0, None);
    assert!((17..=20).contains(&standing), "{standing}");
    let turning = v.for_s(16.0, 0.6, None);
    assert!((1..=3).contains(&turning), "{turning}");
    assert_eq!(v.for_s(20.0, 0.0, Some(0.1)), 0, "a receiver says more");
    assert!(v.for_s(20.0, 0.0, None) > 15, "its antenna is covered now");
    assert!(v.aid.place.is_some_and(|p| (p.lat_rad.to_degrees() - 47.0).abs() < 1e-9));
}

#[test]
fn a_vehicle_that_was_carried_away_or_reports_that_it_flies_has_no_place() {
    let mut v = Vehicle::new();
    v.for_s(20.0, 0.0, None);
    v.for_s(HANDS_S + 1.0, 0.3, None);
    assert_eq!(v.for_s(30.0, 0.3, None), 0);
    assert!(v.for_s(20.0, 0.0, None) > 10, "it stands again");
    v.aid.set_flight(true, true);
    assert_eq!(v.for_s(20.0, 0.0, None), 0);
}

/// Flights of hours in smooth air, with receivers that fail.
#[test]
fn a_smooth_cruise_without_fixes_is_not_taken_for_rest() {
    let mut v = Vehicle::new();
    v.for_s(20.0, 0.0, Some(0.0));
    v.for_s(30.0, 0.3, Some(20.0));
    assert_eq!(v.for_s(600.0, 0.0, None), 0);
    v.aid.restart();
    assert_eq!(v.for_s(600.0, 0.0, None), 0, "nor after a restart");
    v.for_s(20.0, 0.0, Some(0.0));
    assert!(v.for_s(20.0, 0.0, None) > 10, "it has landed");
}

#[test]
fn an_armed_vehicle_must_have_stood_longer_and_stays_gone_once_it_has_left() {
    let mut v = Vehicle::new();
    v.aid.set_flight(false, true);
    assert_eq!(v.for_s(STOOD_S + 3.0, 0.0, None), 0);
    assert!(v.for_s(5.0, 0.0, None) > 2);
    v.for_s(3.0, 0.3, None);
    for _ in 0..REFUSED {
        let stamp_s = v.t_s;
        v.aid.given.push_back(stamp_s);
        assert!(v.aid.settle(stamp_s, true));
    }
    assert!(v.aid.left);
    assert_eq!(v.for_s(60.0, 0.0, None), 0);
    v.aid.set_flight(false, false);
    assert!(v.for_s(60.0, 0.0, None) > 30, "disarmed and at rest it is back");
}

#[test]
fn a_fast_fix_tells_a_flight_from_a_rest_and_a_slow_one_goes_on() {
    let began = |heading_known: bool, place: bool| {
        let mut v = Vehicle::new();
        if place {
            v.aid.set_place(Geodetic::from_degrees(47.0, 8.0, 0.0));
        }
        v.for_s(20.0, 0.0, None);
        v.aid.begin(heading_known);
        v
    };
    let contact = |v: &mut Vehicle, speed: f64| v.aid.take_fix(&fix(v.t_s, speed), v.t_s);
    assert_eq!(contact(&mut began(true, true), 20.0), Contact::NeverStood);
    let mut first = began(true, false);
    assert!(!first.aid.reference_known() && began(true, true).aid.reference_known());
    assert_eq!(contact(&mut first, 0.2), Contact::Known);
    assert_eq!(contact(&mut first, 0.2), Contact::GoesOn, "the second one");
    let mut carried = began(true, false);
    carried.for_s(30.0, 0.5, None);
    assert_eq!(contact(&mut carried, 14.0), Contact::Known, "in a car: the constants go on");
}
