use super::*;
use crate::airframe::{Airframe, EXAMPLES};
use crate::item::LatLon;

fn frame() -> LocalFrame {
    LocalFrame::new(LatLon { lat_deg: 47.4, lon_deg: 8.5 })
}

fn at(number: u16, params: [f32; 4], n: f64, e: f64, height: f32) -> MissionItem {
    MissionItem::at(number, params, frame().to_place(Vector2::new(n, e)), height)
}

fn flyer<'a>(airframe: &'a Airframe, wind: f64) -> Flyer<'a> {
    let state = Entry::cruising(airframe, Vector3::new(0.0, 0.0, -80.0), 0.0);
    Flyer::new(airframe, frame(), Vector3::new(0.6, -0.8, 0.0) * wind, state)
}

#[test]
fn waypoints_are_reached_in_wind_and_at_their_height() {
    for (_, text) in EXAMPLES {
        let airframe = Airframe::from_toml(text).expect("shipped");
        let wind = 0.6 * airframe.speed_cruise_m_per_s;
        let mut flyer = flyer(&airframe, wind);
        let items = [
            at(16, [0.0; 4], 600.0, 0.0, 100.0),
            at(16, [0.0; 4], 600.0, 500.0, 100.0),
            at(16, [0.0; 4], 0.0, 0.0, 80.0),
        ];
        let flight = flyer.fly(&items).expect("in the wind's reach");
        for item in &items {
            let p = frame().to_local(item.place().expect("a waypoint"));
            let nearest = flight
                .samples
                .iter()
                .map(|k| (k.north_east_m() - p).norm().max((k.height_m() - f64::from(item.z)).abs()))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 45.0, "{}: {nearest} m from {p}", airframe.name);
        }
        assert!(flight.begun_s.windows(2).all(|w| w[0] < w[1]));
    }
}

#[test]
fn circles_keep_their_radius_and_direction() {
    for (_, text) in EXAMPLES {
        let airframe = Airframe::from_toml(text).expect("shipped");
        let wind = 0.4 * airframe.speed_cruise_m_per_s;
        let radius = airframe.planned_radius_m(airframe.speed_cruise_m_per_s + wind);
        for side in [-1.0, 1.0] {
            let mut flyer = flyer(&airframe, wind);
            let params = [2.0, 0.0, (side * radius) as f32, 0.0];
            let flight = flyer.fly(&[at(18, params, 300.0, 100.0, 80.0)]).expect("flyable");
            let late = &flight.samples[flight.samples.len() * 3 / 4..];
            let center = Vector2::new(300.0, 100.0);
            for k in late {
                let off = (k.north_east_m() - center).norm() - radius;
                assert!(off.abs() < 0.2 * radius, "{}: {off} of {radius}", airframe.name);
                let v = k.velocity_ned_m_per_s.xy();
                assert!((k.north_east_m() - center).perp(&v) * side > 0.0);
            }
        }
    }
}

#[test]
fn what_cannot_be_predicted_is_said() {
    let airframe = Airframe::example("small_fixed_wing").expect("shipped");
    let items = [at(16, [0.0; 4], 300.0, 0.0, 80.0), at(82, [0.0; 4], 0.0, 0.0, 80.0)];
    let error = flyer(&airframe, 0.0).fly(&items).expect_err("splines are not modelled");
    assert_eq!(error.to_string(), "item 2: spline waypoint is not predicted");
    let error = flyer(&airframe, 25.0).fly(&[at(16, [0.0; 4], -600.0, 800.0, 80.0)]);
    assert_eq!(error.map(|_| ()), Err(FlightError::NotReached { item: 1 }));
}
