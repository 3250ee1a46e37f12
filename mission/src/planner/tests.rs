use super::*;
use crate::airframe::EXAMPLES;
use crate::fence::{Fence, FenceCircle, FencePolygon, LocalFence};
use crate::flight::Flyer;
use crate::item::{Autopilot, command};
use crate::maneuver::{Entry, Side};
use crate::predictor::sensors::SensorPredictor;
use crate::predictor::{BoundPredictor, Targets};
use gaware_nav::identify::aids::foreseen::Planned;
use gaware_nav::math::{cos, sin};
use gaware_nav::model::{GElements, Model};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

const HOME: Home = Home { lat_e7: 474_000_000, lon_e7: 85_000_000, alt_m: 450.0 };

/// Information about three imaginary states from the spread of each axis of specific force: enough to search by.
#[derive(Clone)]
struct Spread([f64; 3]);

impl Predictor for Spread {
    fn fly(&mut self, kinematics: &[Kinematics], _fix_interval_s: f64) {
        for k in kinematics {
            let d = k.force - Vector3::new(0.0, 0.0, -9.80665);
            (0..3).for_each(|i| self.0[i] += d[i] * d[i] * 0.05);
        }
    }

    fn sigmas(&self) -> Vec<NamedSigma> {
        let named = |i: usize| NamedSigma {
            name: ["g1", "g2", "g3"][i].into(),
            sigma: 360.0 / (1.0 + self.0[i]).sqrt(),
            target: 5.0,
            unit: "deg/h/g".into(),
        };
        (0..3).map(named).collect()
    }
}

/// For these sensors, in a wind of (3, −2) m/s and a field as in Switzerland.
fn sensors(airframe: &Airframe, planned: &[Planned]) -> SensorPredictor {
    let frame = LocalFrame::new(HOME.place());
    let entry = Entry::cruising(airframe, Vector3::new(0.0, 0.0, -100.0), 0.5);
    let start = Maneuver::Climb.kinematics(airframe, &entry, &Vector3::zeros())[0];
    let bound = BoundPredictor::from_priors(&Model::standard(), &start, frame, HOME, Targets::default());
    SensorPredictor::new(bound, airframe, planned, [3.0, -2.0], Vector3::new(21.5e-6, 1.4e-6, 43.3e-6))
}

/// Sigma over target of a parameter after a maneuver that a pilot flies.
fn ratio_after(airframe: &Airframe, planned: &[Planned], maneuver: Maneuver, name: &str) -> f64 {
    let mut predictor = sensors(airframe, planned);
    let entry = Entry::cruising(airframe, Vector3::new(0.0, 0.0, -100.0), 0.5);
    for _ in 0..3 {
        predictor.fly(&maneuver.kinematics(airframe, &entry, &Vector3::new(3.0, -2.0, 0.0)), 0.2);
    }
    let sigmas = predictor.sigmas();
    sigmas.iter().find(|s| s.name == name).map(NamedSigma::ratio).expect("a parameter of these sensors")
}

/// What separates the parameters of sensors, as the pilot's words say: without it they stay far more uncertain.
#[test]
fn a_parameter_of_a_sensor_needs_what_separates_it() {
    use Maneuver::{Climb, CrabLegs, HoverSteps, TwoSpeedCircles, YawTurns};
    let [wing, rotor] = ["small_fixed_wing", "quadrotor"].map(|n| Airframe::example(n).expect("shipped"));
    let (all, two) = ([Planned::Airspeed, Planned::Barometer], [Planned::Compass, Planned::Barometer]);
    for (airframe, planned, name, with, without, times) in [
        // On one course wind and scale are the same.
        (&wing, &all, "as_scale", TwoSpeedCircles, Climb, 2.0),
        (&wing, &all, "b_scale", Climb, TwoSpeedCircles, 2.0),
        (&rotor, &two, "bp_right", CrabLegs, YawTurns, 2.0),
        (&rotor, &two, "b_delay", HoverSteps, YawTurns, 2.0),
        (&rotor, &two, "mh_x", YawTurns, HoverSteps, 1.2),
    ] {
        let [with, without] = [with, without].map(|m| ratio_after(airframe, planned, m, name));
        assert!(without > times * with, "{name}: {with} and {without}");
    }
}

/// The plan is flown in the other winds too, and what it promises is what its own path shows.
#[test]
fn plans_for_sensors_end_in_a_hold_and_promise_what_their_path_shows() {
    for (name, _) in EXAMPLES {
        let airframe = Airframe::example(name).expect("shipped");
        let planned = if airframe.is_fixed_wing() {
            vec![Planned::Airspeed, Planned::Barometer]
        } else {
            vec![Planned::Compass, Planned::Barometer]
        };
        let predictor = sensors(&airframe, &planned);
        let own = Request { within_reach_only: true, ..request(name, circle(1500.0)) };
        let plan = plan(&own, predictor.clone()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(!plan.maneuvers.is_empty() && plan.promised().count() > 2, "{name}: {:?}", plan.states);
        assert!(plan.notes.iter().all(|n| !n.contains("sideslip")), "{:?}", plan.notes);
        let mut again = predictor;
        again.fly(&plan.path, 0.2);
        for (state, sigma) in plan.states.iter().zip(again.sigmas()) {
            assert!((state.sigma / sigma.sigma - 1.0).abs() < 0.1, "{name}: {state:?} {sigma:?}");
        }
    }
}

fn circle(radius_m: f64) -> Fence {
    let circle = FenceCircle { inclusion: true, center: HOME.place(), radius_m };
    Fence { polygons: Vec::new(), circles: vec![circle] }
}

fn request(name: &str, fence: Fence) -> Request {
    Request {
        airframe: Airframe::example(name).expect("shipped"),
        home: HOME,
        take_off: false,
        landing: false,
        start: HOME.place(),
        start_height_m: 100.0,
        start_heading_deg: 30.0,
        limits: Limits { fence, floor_m: 50.0, ceiling_m: 160.0, wind_ned_m_per_s: [3.0, -2.0, 0.0] },
        budget_s: 240.0,
        within_reach_only: false,
        fix_interval_s: 0.2,
        beam: 1,
    }
}

#[test]
fn a_plan_has_maneuvers_sigmas_and_a_hold_at_its_end() {
    for (name, _) in EXAMPLES {
        let mut request = request(name, circle(1500.0));
        (request.airframe.side_force_g, request.airframe.roll_side_force_g) = (0.0, 0.0);
        let plan = plan(&request, Spread([0.0; 3])).unwrap_or_else(|e| panic!("{name}: {e}"));
        // PX4's fixed wings must land, after the time for maneuvers.
        let lands = name == "large_fixed_wing";
        assert!(lands || plan.duration_s <= 240.0 && !plan.maneuvers.is_empty());
        let last = if lands { command::NAV_LAND } else { command::NAV_LOITER_UNLIM };
        assert_eq!(plan.mission.items.last().map(|i| i.command), Some(last));
        let (first, last) = (&plan.sigmas[0], &plan.sigmas[plan.sigmas.len() - 1]);
        assert!(last.sigmas[0].sigma < 0.3 * first.sigmas[0].sigma, "{name}");
        assert!((last.t_s - plan.duration_s).abs() < 0.1);
        let listed = plan.maneuvers.last().map(|m| *m.items.end());
        let end_items = if lands { 5 } else { 1 };
        assert_eq!(listed, Some(plan.mission.items.len() - end_items));
        let dark = plan.notes.iter().any(|n| n.contains("g2") && n.contains("sideslip"));
        assert_eq!(dark, request.airframe.is_fixed_wing(), "{:?}", plan.notes);
    }
}

/// No state of these reaches its target in the time there is: the plan goes on as long as they still get better, and not to no end.
#[test]
fn a_plan_without_a_budget_goes_on_for_states_that_stay_short() {
    let mut request = request("small_fixed_wing", circle(1500.0));
    (request.within_reach_only, request.budget_s) = (true, 900.0);
    let made = plan(&request, Spread([0.0; 3])).expect("space enough");
    assert!(made.states.iter().any(|s| s.reach == Reach::Short), "{:?}", made.states);
    assert!(made.maneuvers.len() >= 4, "{:?}", made.maneuvers);
    let last = made.maneuvers.last().expect("maneuvers");
    let at = |t_s: f64| made.sigmas.iter().find(|s| s.t_s >= t_s).expect("a time of the plan");
    let (before, after) = (at(last.start_s), at(last.end_s));
    let better = before.sigmas.iter().zip(&after.sigmas).map(|(b, a)| 1.0 - a.sigma / b.sigma);
    assert!(better.fold(0.0, f64::max) < 0.15, "the last one hardly helps");
    assert!(made.duration_s < 900.0);
}

#[test]
fn the_best_maneuver_for_what_is_missing_is_chosen() {
    // z is known well, x not at all: straight runs with changing speed.
    let mut request = request("small_fixed_wing", circle(1200.0));
    request.budget_s = 150.0;
    let plan = plan(&request, Spread([0.0, 0.0, 1e6])).expect("space enough");
    let first = plan.maneuvers[0].maneuver;
    assert!(!matches!(first, Maneuver::SteadyTurn(_) | Maneuver::FigureEight), "{first:?}");
}

#[test]
fn a_take_off_comes_first_and_its_climb_stays_inside() {
    let mut request = request("small_fixed_wing", circle(900.0));
    request.take_off = true;
    let (a, wind) = (&request.airframe, request.limits.wind());
    request.start = climb_out(a, request.home, request.start_heading_deg, 100.0, &wind);
    let made = plan(&request, Spread([0.0; 3])).expect("space enough");
    assert_eq!(made.mission.items[0].command, command::NAV_TAKEOFF);
    assert_eq!(made.mission.items[1].command, command::DO_CHANGE_SPEED);
    assert_eq!(made.mission.items[2].command, command::NAV_LOITER_TURNS);
    assert_eq!(*made.maneuvers[0].items.start(), 4);
    assert!(made.maneuvers[0].start_s > 10.0, "the circle comes first");
    request.limits.fence = circle(500.0);
    let said = plan(&request, Spread([0.0; 3])).expect_err("the climb is longer").to_string();
    assert!(said.contains("take off in another direction"), "{said}");
}

#[test]
fn a_wider_search_is_never_worse_than_the_greedy_one() {
    let score = |beam| {
        let mut request = request("quadrotor", circle(600.0));
        (request.beam, request.budget_s) = (beam, 200.0);
        let plan = plan(&request, Spread([0.0; 3])).expect("space enough");
        let last = plan.sigmas.last().map(|s| s.sigmas.clone()).unwrap_or_default();
        let reach: Vec<Reach> = plan.states.iter().map(|s| s.reach).collect();
        search::log_score(&last, &reach)
    };
    let (greedy, wide) = (score(1), score(DEFAULT_BEAM));
    assert!(wide <= greedy, "{wide} {greedy}");
}

/// A square whose corners are not in order.
fn crossed() -> Fence {
    let frame = LocalFrame::new(HOME.place());
    let corners = [(1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0)];
    let corners = corners.map(|(n, e)| frame.to_place(Vector2::new(n, e) * 900.0)).to_vec();
    Fence { polygons: vec![FencePolygon { inclusion: true, corners }], circles: Vec::new() }
}

#[test]
fn what_cannot_be_flown_safely_is_refused_with_the_reason() {
    let refusal = |change: &dyn Fn(&mut Request)| {
        let mut request = request("large_fixed_wing", circle(900.0));
        change(&mut request);
        plan(&request, Spread([0.0; 3])).expect_err("not safe").to_string()
    };
    type Change<'a> = &'a dyn Fn(&mut Request);
    let cases: [(Change<'_>, &str); 9] = [
        (&|r| r.limits.fence = circle(120.0), "hold at the end cannot be reached safely"),
        (&|r| r.limits.wind_ned_m_per_s = [20.0, 0.0, 0.0], "wind of 20.0 m/s is more than 14.4"),
        (&|r| r.limits.ceiling_m = 52.0, "leave no height"),
        (&|r| r.budget_s = 20.0, "20 s are too short for any maneuver"),
        (&|r| r.budget_s = -1.0, "must be positive"),
        (&|r| r.start_height_m = 400.0, "outside floor and ceiling"),
        (&|r| r.limits.fence.circles[0].radius_m = f64::NAN, "geofence circle 1: a radius of NaN m"),
        (&|r| r.limits.fence = crossed(), "its edges 1 and 3 cross: are its corners in order?"),
        (
            &|r| (r.take_off, r.home.lat_e7) = (true, r.home.lat_e7 + 10_000_000),
            "the fence of another place?",
        ),
    ];
    for (change, message) in cases {
        let said = refusal(change);
        assert!(said.contains(message), "{said}");
    }
}

fn predictor(airframe: &Airframe, entry: &Entry) -> BoundPredictor {
    let frame = LocalFrame::new(HOME.place());
    let start = Maneuver::Climb.kinematics(airframe, entry, &Vector3::zeros())[0];
    let model = Model::default().with_g(GElements::Full, None);
    BoundPredictor::from_priors(&model, &start, frame, HOME, Targets::default())
}

/// The sigma of a state after a maneuver in still air.
fn after(predictor: &BoundPredictor, airframe: &Airframe, maneuver: Maneuver, name: &str) -> f64 {
    let entry = Entry::cruising(airframe, Vector3::new(0.0, 0.0, -100.0), 0.0);
    let mut predictor = predictor.clone();
    predictor.fly(&maneuver.kinematics(airframe, &entry, &Vector3::zeros()), 0.2);
    predictor.sigmas().iter().find(|s| s.name == name).expect("a state of the model").sigma
}

/// The paper's flights are coordinated.
fn coordinated() -> Airframe {
    Airframe::example("small_fixed_wing").expect("shipped").with_side_force(0.0, 0.0)
}

#[test]
fn the_information_bound_values_maneuvers_as_the_paper_says() {
    let airframe = coordinated();
    let entry = Entry::cruising(&airframe, Vector3::new(0.0, 0.0, -100.0), 0.0);
    let predictor = predictor(&airframe, &entry);
    let after = |maneuver, name: &str| after(&predictor, &airframe, maneuver, name);
    // Coordinated flight leaves column y unobservable; sideslip does not. Prior: 360 deg/h/g.
    let turn = Maneuver::SteadyTurn(Side::Right);
    assert!(after(turn, "g12") > 359.5);
    assert!(after(Maneuver::Sideslip, "g12") < 330.0);
    // Speed changes show column x better than circles do, circles column z better than speed changes.
    let both = [Maneuver::VaryingSpeed, Maneuver::FigureEight];
    let [speed_x, turn_x] = both.map(|m| after(m, "g21"));
    let [speed_z, turn_z] = both.map(|m| after(m, "g13"));
    assert!(speed_x < 0.8 * turn_x, "{speed_x} {turn_x}");
    assert!(turn_z < 0.8 * speed_z, "{turn_z} {speed_z}");
}

#[test]
fn a_plan_on_the_information_bound_reaches_what_it_can() {
    let mut request = request("small_fixed_wing", circle(900.0));
    (request.airframe, request.budget_s) = (coordinated(), 180.0);
    let entry = Entry::cruising(&request.airframe, Vector3::new(0.0, 0.0, -100.0), 0.5);
    let plan = plan(&request, predictor(&request.airframe, &entry)).expect("space enough");
    let (first, last) = (&plan.sigmas[0], &plan.sigmas[plan.sigmas.len() - 1]);
    for name in ["g11", "g31", "g33"] {
        let of = |s: &SigmasAt| s.sigmas.iter().find(|s| s.name == name).map_or(0.0, |s| s.sigma);
        assert!(of(last) < 0.6 * of(first), "{name}: {} to {}", of(first), of(last));
    }
    assert!(plan.sigmas.iter().all(|s| s.sigmas.iter().all(|n| n.sigma.is_finite())));
}

/// A vehicle that slips in its turns excites column y, which is unobservable in coordinated flight, and needs both sides for that.
#[test]
fn the_side_force_of_turns_is_used_and_turns_go_to_both_sides() {
    let mut request = request("small_fixed_wing", circle(900.0));
    request.budget_s = 300.0;
    let planned = |airframe: Airframe| {
        let request = Request { airframe, ..request.clone() };
        let entry = Entry::cruising(&request.airframe, Vector3::new(0.0, 0.0, -100.0), 0.5);
        plan(&request, predictor(&request.airframe, &entry)).expect("space enough")
    };
    let sigma =
        |plan: &Plan, name: &str| plan.states.iter().find(|s| s.name == name).map_or(f64::NAN, |s| s.sigma);
    let (slips, neat) = (planned(request.airframe.clone()), planned(coordinated()));
    assert!(
        sigma(&slips, "g12") < 0.5 * sigma(&neat, "g12"),
        "{} {}",
        sigma(&slips, "g12"),
        sigma(&neat, "g12")
    );
    for plan in [&slips, &neat] {
        let sides: f64 = plan.maneuvers.iter().filter_map(|m| m.maneuver.side()).map(Side::sign).sum();
        assert!(sides.abs() <= 1.0, "{:?}", plan.maneuvers);
    }
}

/// What is predicted to end just below its target may end above it.
#[test]
fn what_barely_meets_its_target_is_not_promised() {
    let state = |sigma| PlannedState {
        name: "g33".to_owned(),
        unit: "deg/h/g".to_owned(),
        sigma,
        target: 40.0,
        reach: Reach::Known,
    };
    assert!(state(31.0).known());
    assert!(!state(36.0).known());
}

fn any_fence() -> impl Strategy<Value = Fence> {
    let corners = prop::collection::vec(250.0..1100.0f64, 5..9);
    let hole = prop::option::of((200.0..500.0f64, 0.0..std::f64::consts::TAU, 20.0..80.0f64));
    (corners, hole).prop_map(|(radii, hole)| {
        let frame = LocalFrame::new(HOME.place());
        let n = radii.len() as f64;
        let at = |angle: f64, r: f64| frame.to_place(Vector2::new(cos(angle), sin(angle)) * r);
        let corners =
            radii.iter().enumerate().map(|(k, r)| at(k as f64 * std::f64::consts::TAU / n, *r)).collect();
        let circles = hole.map(|(r, angle, size)| FenceCircle {
            inclusion: false,
            center: at(angle, r),
            radius_m: size,
        });
        Fence {
            polygons: vec![FencePolygon { inclusion: true, corners }],
            circles: circles.into_iter().collect(),
        }
    })
}

fn any_request() -> impl Strategy<Value = Request> {
    let wind = (0.0..0.6f64, 0.0..std::f64::consts::TAU);
    let air = (0..3usize, 0.8..1.25f64, 0.85..1.15f64);
    (any_fence(), wind, air, 0.0..360.0f64, 30.0..80.0f64, 25.0..150.0f64).prop_map(
        |(fence, (share, toward), (kind, scale, bank), heading, floor, band)| {
            let mut request = request(EXAMPLES[kind].0, fence);
            let a = &mut request.airframe;
            a.speed_cruise_m_per_s *= scale.clamp(a.speed_min_m_per_s / a.speed_cruise_m_per_s, 1.2);
            a.speed_max_m_per_s = a.speed_max_m_per_s.max(a.speed_cruise_m_per_s);
            a.bank_max_deg *= bank;
            a.load_factor_max = a.load_factor_max.max(1.02 / cos(a.bank_max_deg.to_radians()));
            let wind = share * a.speed_cruise_m_per_s;
            request.limits.wind_ned_m_per_s = [wind * cos(toward), wind * sin(toward), 0.0];
            (request.limits.floor_m, request.limits.ceiling_m) = (floor, floor + band);
            request.start_height_m = floor + band / 2.0;
            request.start_heading_deg = heading;
            request.budget_s = 150.0;
            request
        },
    )
}

#[test]
fn a_multirotor_that_is_to_land_comes_down_at_home_and_stays_within_the_limits() {
    let mut request = request("quadrotor", circle(1500.0));
    request.landing = true;
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        request.airframe.autopilot = autopilot;
        let plan = plan(&request, Spread([0.0; 3])).expect("there is room");
        let [.., above, land] = &plan.mission.items[..] else { panic!("{:?}", plan.mission.items) };
        assert_eq!(
            (above.command, land.command),
            (command::NAV_WAYPOINT, command::NAV_LAND),
            "{:?}",
            plan.notes
        );
        let home = Some(HOME.place());
        assert!(above.place() == home && land.place() == home);
        let end = plan.path.last().expect("it flies");
        assert!(end.height_m().abs() < 1.0 && end.north_east_m().norm() < 3.0, "{end:?}");
        assert_inside(&request, &plan, 1.0);
    }
}

/// What a plan promised, checked with nothing of the planner but the flight model, in a wind of its own.
fn assert_inside(request: &Request, plan: &Plan, wind_share: f64) {
    let frame = LocalFrame::new(HOME.place());
    let fence = LocalFence::new(&request.limits.fence, &frame);
    let (a, limits) = (&request.airframe, &request.limits);
    let lands = plan.mission.items.last().is_some_and(|i| i.command == command::NAV_LAND);
    assert_eq!(lands, request.landing || a.is_fixed_wing() && a.autopilot == Autopilot::Px4);
    for item in &plan.mission.items {
        if let Some(place) = item.place() {
            assert!(fence.clearance(frame.to_local(place)) > 0.0);
        }
        if item.place().is_some() && item.command != command::NAV_LAND {
            assert!(f64::from(item.z) >= limits.floor_m && f64::from(item.z) <= limits.ceiling_m);
        }
        if item.command == command::DO_CHANGE_SPEED {
            let speed = f64::from(item.params[1]);
            assert!(speed >= a.speed_min_m_per_s - 1e-3 && speed <= a.speed_max_m_per_s + 1e-3);
        }
    }
    let entry = Entry::cruising(
        a,
        Vector3::new(0.0, 0.0, -request.start_height_m),
        request.start_heading_deg.to_radians(),
    );
    let mut flyer = Flyer::new(a, frame, limits.wind() * wind_share, entry);
    let flight = flyer.fly(&plan.mission.items).expect("planned");
    for path in [&plan.path, &flight.samples] {
        // Only a landing goes below the floor, and not up again.
        let high = path.iter().rposition(|k| k.height_m() >= limits.floor_m - 2.0).expect("it flies");
        assert!(lands || high + 1 == path.len());
        for (n, k) in path.iter().enumerate() {
            assert!(fence.clearance(k.north_east_m()) > 0.0, "{} s: outside the fence", k.t_s);
            assert!(n > high || k.height_m() >= limits.floor_m - 2.0);
            assert!(k.height_m() <= limits.ceiling_m + 2.0);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]
    #[test]
    fn no_plan_leaves_a_random_fence(request in any_request(), wind_share in 0.0..1.0f64) {
        prop_assert_eq!(request.airframe.validate(), Ok(()));
        match plan(&request, Spread([0.0; 3])) {
            Ok(plan) => assert_inside(&request, &plan, wind_share),
            Err(e) => prop_assert!(e.to_string().starts_with("no plan: "), "{e}"),
        }
    }
}

/// A third equal maneuver in a row is there only where it takes a tenth off some sigma.
#[test]
fn no_maneuver_is_flown_a_third_time_for_little() {
    for name in ["small_fixed_wing", "quadrotor"] {
        let request = Request { budget_s: 600.0, ..request(name, circle(1500.0)) };
        let plan = plan(&request, Spread([0.0; 3])).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(plan.maneuvers.len() > 3, "{name}: {:?}", plan.maneuvers);
        let at = |t_s: f64| plan.sigmas.iter().take_while(|s| s.t_s <= t_s + 1.0).last().unwrap();
        for three in plan.maneuvers.windows(3).filter(|w| w.iter().all(|m| m.maneuver == w[0].maneuver)) {
            let (before, after) = (at(three[2].start_s), at(three[2].end_s));
            let gain = before
                .sigmas
                .iter()
                .zip(&after.sigmas)
                .map(|(b, a)| 1.0 - a.sigma / b.sigma)
                .fold(0.0, f64::max);
            assert!(gain > 0.08, "{name}: {:?} gains {gain}", three[2]);
        }
        assert!(plan.notes.iter().any(|n| n.contains("by hand on the ground")), "{:?}", plan.notes);
    }
}

#[test]
fn a_circle_that_is_too_small_is_told_with_one_that_is_not() {
    let small = request("large_fixed_wing", circle(300.0));
    assert!(plan(&small, Spread([0.0; 3])).is_err());
    let radius_m = radius_that_fits(&small, Spread([0.0; 3])).unwrap();
    assert!((350.0..3000.0).contains(&radius_m), "{radius_m}");
    assert!(
        search::Search::new(&request("large_fixed_wing", circle(radius_m))).unwrap().begins(Spread([0.0; 3]))
    );
}
