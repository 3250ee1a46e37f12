//! Files that a user names: missions, models, airframes. What is accepted can be written and read again, and be worked with.

use super::engine::{self, FLIGHT};
use super::refused;
use gaware::engine::{Engine, EngineOptions};
use gaware::mission_link::files::Contents;
use gaware::mission_link::vehicle::Vehicle;
use gaware::pipeline::Pipeline;
use gaware::preflight::{self, Against, Facts};
use gaware::sensors::ConverterOptions;
use gaware_mission::airframe::{Airframe, EXAMPLES};
use gaware_mission::files::{plan as plan_file, waypoints as waypoints_file};
use gaware_mission::item::{Autopilot, Mission, MissionKind};
use gaware_mission::maneuver::{Entry, Maneuver};
use gaware_mission::transfer::Address;
use gaware_mission::transfer::verified::VehicleState;
use gaware_nav::effects::data::{check as effects_file, expression::Expression};
use gaware_nav::effects::{Instant, REGISTRY, Sensor};
use gaware_nav::model::{EffectSetting, Model};
use nalgebra::Vector3;

/// One input in so many also goes through what costs milliseconds, …
const DEEP_EVERY: u64 = 16;
/// … and one in so many through what costs tens of them: a flight, or every maneuver.
const DEEPEST_EVERY: u64 = 128;
/// Frames of the flight that a model or an airframe has to go through, some seconds.
const FRAMES: usize = 1500;

/// `.plan`, up to the check before an upload.
pub fn plan(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    let file = match plan_file::read(&text) {
        Ok(file) => file,
        Err(error) => return refused(&error),
    };
    let written = plan_file::write(&file);
    match plan_file::read(&written) {
        Ok(again) => assert_eq!(plan_file::write(&again), written),
        Err(error) => panic!("what was written is refused: {error}"),
    }
    let contents = Contents {
        mission: file.mission,
        fence: file.fence,
        rally_points: file.rally_points,
        ..Contents::default()
    };
    check(&contents);
    true
}

/// `QGC WPL 110`, up to the check before an upload.
pub fn waypoints(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    let mission = match waypoints_file::read(&text) {
        Ok(mission) => mission,
        Err(error) => return refused(&error),
    };
    let written = waypoints_file::write(&mission);
    match waypoints_file::read(&written) {
        Ok(again) => assert_eq!(waypoints_file::write(&again), written),
        Err(error) => panic!("what was written is refused: {error}"),
    }
    check(&Contents { mission, ..Contents::default() });
    true
}

/// The check before an upload, and the way to the wire and back.
fn check(contents: &Contents) {
    const ON_THE_GROUND: VehicleState =
        VehicleState { armed: false, mission_mode: false, flying_mission: false, in_flight: false };
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let address = Address { system: 1, component: 1 };
        let vehicle = Vehicle { address, mav_type: 1, autopilot, state: ON_THE_GROUND, uid: None };
        let against = Against { plan: Some(contents), airframe: None };
        let rows = preflight::check(&Facts::new(vehicle), against);
        assert!(rows.iter().all(|r| !r.text.is_empty()));
        for kind in [MissionKind::Mission, MissionKind::Fence, MissionKind::Rally] {
            let list = contents.list(kind);
            let back = Mission::from_wire_list(kind, autopilot, &list.wire_list(kind, autopilot));
            assert_eq!(back.items.len(), list.items.len(), "{kind:?}");
        }
    }
}

/// A hash that decides which inputs are gone into more deeply: one in `every`.
fn is_deep(data: &[u8], every: u64) -> bool {
    let hash = data
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3));
    (hash >> 32).is_multiple_of(every)
}

/// `model.toml`. A model that is accepted keeps the covariance sound in flight.
pub fn model(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    let model = match Model::from_toml(&text) {
        Ok(model) => model,
        Err(error) => return refused(&error),
    };
    let written = model.to_toml();
    match Model::from_toml(&written) {
        Ok(again) => assert_eq!(again.to_toml(), written),
        Err(error) => panic!("what was written is refused: {error}\n{written}"),
    }
    if is_deep(data, DEEPEST_EVERY) {
        fly(Engine::new(model, EngineOptions::default()));
    }
    true
}

/// A few seconds of the flight.
fn fly(engine: Engine) {
    let mut pipeline = Pipeline::new(ConverterOptions::default(), engine, f64::INFINITY);
    for (t_us, frame) in FLIGHT.frames.iter().take(FRAMES) {
        pipeline.frame(*t_us, frame);
    }
    engine::check(&pipeline);
}

/// `airframe.toml`. Each maneuver of an airframe that is accepted can be predicted.
pub fn airframe(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    let airframe = match Airframe::from_toml(&text) {
        Ok(airframe) => airframe,
        Err(error) => return refused(&error),
    };
    match airframe.to_toml().map(|text| Airframe::from_toml(&text)) {
        Ok(Ok(again)) => assert_eq!(again, airframe),
        other => panic!("what was written is refused: {other:?}"),
    }
    let maneuvers = Maneuver::all(&airframe);
    for maneuver in &maneuvers {
        assert!(maneuver.duration_s(&airframe).is_finite(), "{maneuver:?}");
    }
    let all = if is_deep(data, DEEPEST_EVERY) { maneuvers.as_slice() } else { &[] };
    for maneuver in all {
        let extent = format!("{:?}", maneuver.extent(&airframe));
        assert!(!extent.contains("NaN") && !extent.contains("inf"), "{maneuver:?}: {extent}");
    }
    if !is_deep(data, DEEP_EVERY) {
        return true;
    }
    if let Some(maneuver) = maneuvers.get(data.len() % maneuvers.len().max(1)) {
        let entry = Entry::cruising(&airframe, Vector3::zeros(), 1.0);
        let path = maneuver.kinematics(&airframe, &entry, &Vector3::new(2.0, -1.0, 0.0));
        let last = format!("{:?}", path.last());
        assert!(!last.contains("NaN") && !last.contains("inf"), "{maneuver:?}: {last}");
    }
    true
}

/// `effects.toml`, and expressions by themselves. What is accepted has a value or none on every sample, and reads as it is written.
pub fn effects(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    let (before, after) =
        (Instant::default(), Instant { t_s: 1.0, rate: Vector3::repeat(1e3), ..Instant::default() });
    if let Ok(expression) = Expression::parse(&text) {
        for x in [&before, &after] {
            let _ =
                (expression.value(x), [Sensor::Gyro, Sensor::Accel].map(|of| expression.by_motion(x, of)));
        }
        let again = Expression::parse(expression.text());
        assert!(again.is_ok_and(|e| e.dimension() == expression.dimension()), "{text}");
        return true;
    }
    // Effects live as long as the program: whole files are tried, of one kind of content each, and not defined.
    match effects_file(&text) {
        Ok(()) => true,
        Err(error) => refused(&error),
    }
}

/// Expressions and files as people write them.
pub fn effects_seeds() -> Vec<Vec<u8>> {
    let texts = [
        "w_x*|w_x| - 2*f_z^2/(1 + throttle)",
        "lag(temperature, 30) - temperature",
        "is(mode, 5)*sin(heading)",
        "above(height, 60) - dead(heading, 0.3)",
        "schema = \"gaware.effects/1\"\n[[effect]]\nname = \"esc\"\ntarget = \"gyro\"\nz = \"current\"\nunit = \"deg/h/A\"\n",
    ];
    texts.iter().map(|t| t.as_bytes().to_vec()).collect()
}

/// Models as the program writes them.
pub fn model_seeds() -> Vec<Vec<u8>> {
    let mut all = Model::default();
    REGISTRY.iter().for_each(|effect| all.set(EffectSetting::unknown(*effect)));
    let models = [Model::standard(), Model::calibrated(), Model::standard().with_tolerances(), all];
    models.map(|m| m.to_toml().into_bytes()).to_vec()
}

/// The airframes that come with the program.
pub fn airframe_seeds() -> Vec<Vec<u8>> {
    EXAMPLES.iter().map(|(_, text)| text.as_bytes().to_vec()).collect()
}
