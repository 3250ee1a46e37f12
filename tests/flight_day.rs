//! A flight day with the program's own commands: plan, pre-flight check, upload with the fence over a mission that was left in the middle, flight, landing, report, explain;
//! with a gyro that drifts on one day, and a return that no one planned on another.
//! The simulated autopilots refuse, cut and rewrite as the firmware does (docs/firmware-rules.md).

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::link::frame::{Frame, Sender};
use gaware::link::framer::Framer;
use gaware::mission_link::codec;
use gaware::mission_link::vehicle::Vehicle;
use gaware_mission::transfer::{Address, MissionMessage};
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::TcpStream;
use support::{Ended, Folder, Gaware, Processors, gaware};

/// What happens on the day.
#[derive(Clone, Copy, PartialEq)]
enum Story {
    /// All of the plan is flown.
    Planned,
    /// It is, with gyros that drift as those of a board that warms up.
    GyrosDrift,
    /// Before it lands the autopilot returns.
    Return,
}

/// One vehicle of one firmware, with a GNSS latency that is hidden in it.
struct Day {
    folder: Folder,
    airframe: String,
    rotor: bool,
    firmware: &'static str,
    story: Story,
}

const HOME: &str = "47.397,8.545,441";
const HIDDEN: &str = "gps_latency=0.25";
/// 180 deg/h a minute, the drift of ArduPilot's simulator, as a random walk of as much in that time.
const DRIFT: &str = "gyro_bias_drift=1400";
/// As strong as the way that ends in a return, which is short, needs to tell it from a drift: 30 nats, where what the gyros have by themselves has 3 to 7 and
/// is as often taken for one.
const STRONG_G: &str = "gyro_g_sensitivity=[[400,200,-200],[200,400,0],[-300,0,400]]";

impl Day {
    /// An airframe of the program, told which firmware flies it.
    fn new(airframe: &str, firmware: &'static str, story: Story) -> Self {
        let folder = Folder::new(&format!("day-{airframe}-{firmware}"));
        let own = format!("{}/mission/airframes/{airframe}.toml", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(own).unwrap();
        let file = folder.file("airframe.toml");
        std::fs::write(
            &file,
            text.replace("autopilot = \"ardupilot\"", &format!("autopilot = \"{firmware}\"")),
        )
        .unwrap();
        Self { folder, airframe: file, rotor: airframe == "quadrotor", firmware, story }
    }

    fn plan(&self) -> String {
        let budget = if self.rotor { "120" } else { "280" };
        let (plan, made) = self.plan_with(&["--budget", budget]);
        assert!(made.stdout.contains("enforced by the vehicle: the geofence"), "{}", made.stdout);
        plan
    }

    /// A plan that lands, with these arguments beside.
    fn plan_with(&self, more: &[&str]) -> (String, Ended) {
        let plan = self.folder.file("day.plan");
        let place = ["--home", HOME, "--land", "--radius", "2000", "--ceiling", "200"];
        let made =
            done(&[&["plan", "--airframe", &self.airframe, "--out", &plan], &place[..], more].concat());
        (plan, made)
    }

    /// The vehicle with this error, and these arguments beside.
    fn vehicle(&self, hidden: &str, more: &[&str]) -> (Gaware, String) {
        let scenario = if self.rotor { "mission_multirotor" } else { "mission_fixed_wing" };
        let gyros = match self.story {
            Story::Planned => &[][..],
            Story::GyrosDrift => &["--hide", DRIFT],
            Story::Return => &["--hide", STRONG_G],
        };
        let own = ["sim", "--scenario", scenario, "--autopilot", self.firmware];
        let link = ["--listen", "tcpin:127.0.0.1:0", "--speed", "10", "--until-landed", "--hide", hidden];
        let vehicle = Gaware::start(&[&own[..], &link[..], more, gyros].concat());
        let address = vehicle.line();
        (vehicle, address)
    }
}

fn items_of(plan: &str) -> usize {
    let plan: Value = serde_json::from_str(&std::fs::read_to_string(plan).unwrap()).unwrap();
    plan.pointer("/mission/items").and_then(Value::as_array).map_or(0, Vec::len)
}

/// Runs a command that must end well.
fn done(args: &[&str]) -> Ended {
    let ended = gaware(args);
    assert_eq!(ended.code(), Some(0), "{args:?}: {}{}", ended.stdout, ended.stderr);
    ended
}

/// A station's link to the vehicle.
struct Pilot {
    socket: TcpStream,
    framer: Framer,
    bytes: [u8; 4096],
}

impl Pilot {
    fn new(address: &str) -> Self {
        let socket = TcpStream::connect(address.strip_prefix("tcpout:").unwrap()).unwrap();
        socket.set_read_timeout(Some(support::PATIENCE)).unwrap();
        Self { socket, framer: Framer::new(), bytes: [0; 4096] }
    }

    fn send(&mut self, frame: &Frame) {
        self.socket.write_all(frame.raw()).unwrap();
    }

    /// What the next piece of the link holds.
    fn frames(&mut self) -> Vec<Frame> {
        let n = self.socket.read(&mut self.bytes).unwrap();
        assert!(n > 0, "the vehicle has closed the link");
        self.framer.push(&self.bytes[..n]);
        std::iter::from_fn(|| self.framer.next_frame()).collect()
    }
}

const STATION: Sender = Sender { system_id: 255, component_id: 190 };

/// Another station leaves the mission at an item, as a flight before does; returns when the vehicle reports it.
fn leave_mission_at(address: &str, item: u16) {
    let mut pilot = Pilot::new(address);
    let to = Address { system: 1, component: 1 };
    let (id, payload) = codec::encode(to, &MissionMessage::SetCurrent { seq: item });
    pilot.send(&Frame::of_payload(STATION, 0, id, &payload).unwrap());
    loop {
        let reported = pilot
            .frames()
            .iter()
            .filter_map(codec::decode)
            .any(|e| matches!(e.message, MissionMessage::Current { seq, .. } if seq == item));
        if reported {
            return;
        }
    }
}

/// The pilot arms and starts the mission; returns when the vehicle says that it flies it.
fn start_mission(address: &str) {
    let mut pilot = Pilot::new(address);
    for number in 0..=u8::MAX {
        for (command, param1) in
            [(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0), (MavCmd::MAV_CMD_MISSION_START, 0.0)]
        {
            let data = COMMAND_LONG_DATA {
                command,
                param1,
                target_system: 1,
                target_component: 1,
                ..Default::default()
            };
            pilot.send(&Frame::encode(STATION, number, &MavMessage::COMMAND_LONG(data)));
        }
        // About two heartbeats' worth of what the vehicle sends.
        for _ in 0..100 {
            let flies = |f: &Frame| Vehicle::from_heartbeat(f).is_some_and(|v| v.state.flying_mission);
            if pilot.frames().iter().any(flies) {
                return;
            }
        }
    }
    panic!("the vehicle does not start its mission");
}

/// A mission of the day before: the same route, a little higher.
fn other_plan(day: &Day, plan: &str) -> String {
    let mut other: Value = serde_json::from_str(&std::fs::read_to_string(plan).unwrap()).unwrap();
    let altitude = other.pointer_mut("/mission/items/1/params/6").unwrap();
    *altitude = serde_json::json!(altitude.as_f64().unwrap() + 1.0);
    let path = day.folder.file("other.plan");
    std::fs::write(&path, other.to_string()).unwrap();
    path
}

/// Uploads over a mission that was left in the middle: another one, and then the same once more. Each begins with its first item, and the check
/// before the flight says when it does not.
fn upload_after_a_flight(day: &Day, plan: &str, address: &str) {
    let link = ["--connect", address];
    let check = || gaware(&[&["preflight", "--plan", plan, "--json"], &link[..]].concat());
    let upload = |file: &str, backup: &str| {
        let backup = day.folder.file(backup);
        let uploaded =
            done(&[&["mission", "upload", file, "--backup", &backup, "--json"], &link[..]].concat()).json();
        assert_eq!(
            (&uploaded["done"], &uploaded["on_vehicle"]),
            (&true.into(), &"new".into()),
            "{uploaded:#}"
        );
    };
    upload(&other_plan(day, plan), "before.plan");
    for backup in ["other-before.plan", "same-before.plan"] {
        leave_mission_at(address, 5);
        let stopped = check();
        assert_eq!(stopped.code(), Some(1), "{}", stopped.stdout);
        assert!(stopped.stderr.contains("the current item is 5"), "{}", stopped.stderr);
        upload(plan, backup);
        let ready = check();
        assert_eq!(ready.code(), Some(0), "{}{}", ready.stdout, ready.stderr);
    }
}

fn flight_day(airframe: &str, firmware: &'static str, story: Story) {
    let day = Day::new(airframe, firmware, story);
    let plan = day.plan();
    let before_landing = format!("return@{}", items_of(&plan) - 1);
    let fault: &[&str] = if story == Story::Return { &["--fault", &before_landing] } else { &[] };
    let (vehicle, address) = day.vehicle(HIDDEN, fault);
    let link = ["--connect", address.as_str()];

    let table =
        done(&[&["preflight", "--plan", &plan, "--airframe", &day.airframe, "--json"], &link[..]].concat())
            .json();
    assert_eq!(table["ready"], true, "{table:#}");
    upload_after_a_flight(&day, &plan, &address);
    let fence = day.folder.file("fence.plan");
    done(&[&["mission", "download", &fence, "--type", "fence"], &link[..]].concat());
    let fence: Value = serde_json::from_str(&std::fs::read_to_string(fence).unwrap()).unwrap();
    assert_eq!(fence["geoFence"]["circles"].as_array().map(Vec::len), Some(1), "{fence:#}");

    // With less than a processor the flight is another one.
    let processor = Processors::take();
    start_mission(&address);
    let recording = day.folder.file("day.mcap");
    let station = Gaware::start(
        &[&["run", "--record", &recording, "--headless", "--json", "--mission", &plan], &link[..]].concat(),
    );
    let landed = vehicle.ended();
    assert_eq!(landed.code(), Some(0), "{}", landed.stderr);
    station.terminate();
    let summary = station.ended();
    drop(processor);
    assert_eq!(summary.code(), Some(0), "{}", summary.stderr);
    let replayed = done(&["replay", &recording, "--json"]);
    assert_eq!(summary.stdout, replayed.stdout, "the replay repeats the run");
    nothing_else_was_asked_for(&day, &recording);
    look_back(&day, &recording, &summary.json());
}

/// While the autopilot flies its mission nobody is asked to fly anything else; and it has flown it.
fn nothing_else_was_asked_for(day: &Day, recording: &str) {
    let bytes = std::fs::read(recording).unwrap();
    let snapshots = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let flown: Vec<Value> = snapshots
        .filter(|m| m.channel.topic == "/snapshot")
        .map(|m| serde_json::from_slice(&m.data).unwrap())
        .collect();
    // On the ground, in the mission, in its landing: the autopilot flies all of it, and no order goes out before or after either.
    for snapshot in &flown {
        let situation = &snapshot["situation"];
        assert!(
            situation["kind"] != "maneuver" && snapshot["guidance"]["instruction"] == "",
            "{situation:#}"
        );
        assert!(!snapshot["guidance"]["last_result"].as_str().unwrap().starts_with("since"), "{situation:#}");
        let flies = snapshot["mission"]["flying"] == true && snapshot["phase"] == "running";
        assert!(!flies || situation["headline"] != "Monitoring", "{situation:#}");
    }
    let says = |headline: &str| flown.iter().any(|s| s["situation"]["headline"] == headline);
    assert_eq!(says("Autopilot returns"), day.story == Story::Return, "what the screens say of a return");
    let flown: Vec<Value> = flown.into_iter().filter(|s| s["mission"]["flying"] == true).collect();
    assert!(flown.len() > 20, "{} snapshots in the mission", flown.len());
    for snapshot in flown {
        assert_eq!(snapshot["mission"]["stuck"], "", "{:#}", snapshot["mission"]);
    }
}

/// What the commands after the flight say of it.
fn look_back(day: &Day, recording: &str, summary: &Value) {
    assert_eq!(summary["autopilot"], day.firmware, "{summary:#}");
    assert_eq!(summary["phase"], "running", "{summary:#}");
    let page = day.folder.file("flight.html");
    done(&["report", recording, "--out", &page]);
    let page = std::fs::read_to_string(page).unwrap();
    let words_of_wings = ["rudder", "aileron", "throttle"];
    assert!(!day.rotor || !words_of_wings.iter().any(|w| page.contains(w)), "words of another aircraft");
    let explained = done(&["explain", recording, "--json", "--out", &day.folder.file("explained")]).json();
    let effects = explained["effects"].as_array().unwrap();
    let latency = effects.iter().find(|e| e["names"] == serde_json::json!(["gps_latency"]));
    let latency = &latency.unwrap_or_else(|| panic!("{}", explained["summary"]))["parameters"]["gps_latency"];
    let of = |name: &str| latency[name].as_f64().unwrap();
    assert!((of("value_s") - 0.25).abs() < 3.0 * of("sigma_s"), "{latency}");
    let named = |name: &str| effects.iter().any(|e| e["names"].as_array().unwrap().contains(&name.into()));
    assert_eq!(named("gyro_bias_drift"), day.story == Story::GyrosDrift, "{}", explained["summary"]);
    assert!(day.story != Story::Return || named("gyro_g_sensitivity"), "{}", explained["summary"]);
}

#[test]
fn a_flight_day_of_a_plane_with_ardupilot() {
    flight_day("small_fixed_wing", "ardupilot", Story::Planned);
}

#[test]
fn a_flight_day_of_a_plane_with_px4_and_gyros_that_drift() {
    flight_day("large_fixed_wing", "px4", Story::GyrosDrift);
}

#[test]
fn a_flight_day_of_a_quadrotor_with_ardupilot_that_returns() {
    flight_day("quadrotor", "ardupilot", Story::Return);
}

#[test]
fn a_flight_day_of_a_quadrotor_with_px4() {
    flight_day("quadrotor", "px4", Story::Planned);
}

/// From `plan --for` to the report of its flight: the barometer's error is named alone, its value holds, and its sigma is about what the plan promises. A pitot tube
/// that shows too much is found too, although the wind at the ground is another one than in flight.
#[test]
fn a_plan_for_sensors_keeps_what_it_promises() {
    const WIND: [&str; 2] = ["--wind", "3,-2"];
    let day = Day::new("small_fixed_wing", "ardupilot", Story::Planned);
    let (plan, made) = day.plan_with(&[&["--for", "airspeed,barometer", "--json"], &WIND[..]].concat());
    let made = made.json();
    assert_eq!(made["for"], serde_json::json!(["airspeed", "barometer"]), "{made:#}");
    let states = made["states"].as_array().unwrap();
    let wash = states.iter().find(|s| s["name"] == "b_thrust").unwrap();
    assert_eq!(wash["reach"], "known", "{wash}");
    let promised = wash["sigma"].as_f64().unwrap();

    let (vehicle, address) =
        day.vehicle("baro_thrust=60", &[&WIND[..], &["--hide", "airspeed_scale=20"]].concat());
    let link = ["--connect", address.as_str()];
    let backup = day.folder.file("before.plan");
    done(&[&["mission", "upload", &plan, "--backup", &backup], &link[..]].concat());
    // With less than a processor the flight is another one.
    let processor = Processors::take();
    start_mission(&address);
    let recording = day.folder.file("day.mcap");
    let station = Gaware::start(&[&["run", "--record", &recording, "--headless"], &link[..]].concat());
    let landed = vehicle.ended();
    assert_eq!(landed.code(), Some(0), "{}", landed.stderr);
    station.terminate();
    assert_eq!(station.ended().code(), Some(0));
    drop(processor);

    let explained = done(&["explain", &recording, "--json", "--out", &day.folder.file("explained")]).json();
    let sensors = explained["air"]["sensors"].as_array().unwrap();
    let named =
        |s: &Value| s["effects"].as_array().unwrap().iter().map(|e| e["names"].clone()).collect::<Vec<_>>();
    let injected = [("Airspeed sensor 1", "airspeed_scale", 20.0), ("Barometer 1", "baro_thrust", 60.0)];
    for sensor in sensors {
        let own = injected.iter().filter(|i| sensor["sensor"] == i.0);
        let expected: Vec<Value> = own.map(|i| serde_json::json!([i.1])).collect();
        assert_eq!(named(sensor), expected, "{sensor:#}");
    }
    assert_eq!(sensors.len(), 3, "{sensors:#?}");
    let found = |i: usize| {
        let sensor = sensors.iter().find(|s| s["sensor"] == injected[i].0).unwrap();
        ["value", "sigma"].map(|of| sensor["effects"][0]["parameters"][0][of].as_f64().unwrap())
    };
    for (k, (.., truth)) in injected.iter().enumerate() {
        let [value, sigma] = found(k);
        assert!((value - truth).abs() < 3.0 * sigma, "{value} ± {sigma}, not {truth}");
    }
    let kept = found(1)[1] / promised;
    assert!((0.5..2.0).contains(&kept), "promised {promised}, times {kept}");
}
