//! What stands between a plan and the wrong vehicle, over real sockets: choice of the vehicle, pre-flight check, geofence, refusals, signals, signing.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::link::frame::{Frame, Sender};
use gaware::link::signing::{Key, Signer, Trust, Verifier};
use gaware::mission_link::files;
use gaware_mission::fence::{Fence, FenceCircle, FencePolygon};
use gaware_mission::item::{Autopilot as Firmware, Home, LatLon, Mission, MissionItem, command};
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::scenario::scenario;
use gaware_sitl::shell::{Options, Server, Speed};
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};
use std::time::{SystemTime, UNIX_EPOCH};
use support::{Ended, Folder, Gaware};
use tokio::net::UdpSocket;
use tokio_util::sync::CancellationToken;

const PLACE: LatLon = LatLon { lat_deg: 47.397, lon_deg: 8.545 };

fn mission(legs: usize) -> Mission {
    let at = |k: usize| LatLon { lat_deg: PLACE.lat_deg + 1e-3 * k as f64, ..PLACE };
    let mut items = vec![MissionItem::at(command::NAV_TAKEOFF, [0.0; 4], at(0), 60.0)];
    items.extend((1..=legs).map(|k| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], at(k), 60.0)));
    Mission { home: Some(Home { lat_e7: 473_970_000, lon_e7: 85_450_000, alt_m: 441.0 }), items }
}

fn fence(radius_m: f64) -> Fence {
    let corner = |n: f64, e: f64| LatLon { lat_deg: PLACE.lat_deg + n, lon_deg: PLACE.lon_deg + e };
    let corners = vec![corner(0.01, 0.01), corner(0.01, -0.01), corner(-0.01, -0.01), corner(-0.01, 0.01)];
    Fence {
        polygons: vec![FencePolygon { inclusion: true, corners }],
        circles: vec![FenceCircle { inclusion: false, center: corner(0.005, 0.005), radius_m }],
    }
}

/// A plan for a quadrotor.
fn plan(folder: &Folder, name: &str, mission: &Mission, fence: &Fence, firmware: Firmware) -> String {
    let path = folder.file(name);
    let contents =
        files::Contents { mission: mission.clone(), fence: fence.clone(), ..files::Contents::default() };
    let text = files::text_of(path.as_ref(), &contents, firmware, 2).unwrap();
    std::fs::write(&path, text).unwrap();
    path
}

/// A simulated quadrotor with these parameters changed; the address to connect to.
async fn quadrotor(
    endpoint: &str,
    config: AutopilotConfig,
    faults: LinkFaults,
    stop: &CancellationToken,
) -> String {
    let autopilot = Autopilot::playing(config, &scenario("mission_multirotor").unwrap());
    let server = Server::bind(&endpoint.parse().unwrap()).await.unwrap();
    let address = server.address().to_owned();
    let options = Options { link_faults: faults, speed: Speed::Times(1.0), ..Options::default() };
    let stop = stop.clone();
    tokio::spawn(async move { server.run(autopilot, options, stop).await });
    address
}

async fn plain(flavour: Flavour, stop: &CancellationToken) -> String {
    let config = AutopilotConfig { flavour, ..AutopilotConfig::default() };
    quadrotor("tcpin:127.0.0.1:0", config, LinkFaults::default(), stop).await
}

/// Runs the program to its end beside the simulation.
async fn gaware(args: &[&str]) -> Ended {
    let args: Vec<String> = args.iter().map(|a| (*a).to_owned()).collect();
    let run = move || support::gaware(&args.iter().map(String::as_str).collect::<Vec<_>>());
    tokio::task::spawn_blocking(run).await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_fence_goes_with_the_mission_and_comes_back_with_it() {
    for (name, flavour, firmware, enforced) in [
        (
            "fence-ap",
            Flavour::ArduPilot,
            Firmware::ArduPilot,
            "FENCE_ENABLE is 0: the vehicle does NOT enforce",
        ),
        ("fence-px4", Flavour::Px4, Firmware::Px4, "it holds its position at a breach (GF_ACTION 2)"),
    ] {
        let (folder, stop) = (Folder::new(name), CancellationToken::new());
        let address = plain(flavour, &stop).await;
        let link = ["--connect", &address];
        let first = plan(&folder, "first.plan", &mission(3), &fence(80.0), firmware);
        let args = ["mission", "upload", &first, "--backup", &folder.file("b1.plan")];
        let told = gaware(&[&args[..], &link].concat()).await;
        assert_eq!(told.code(), Some(0), "{}{}", told.stdout, told.stderr);
        assert!(told.stdout.contains("its geofence (1 polygon and 1 circle) too"), "{}", told.stdout);
        assert!(told.stdout.contains(enforced), "{}", told.stdout);
        // Another plan over it: its backup holds the real fence, and so does a download.
        let second = plan(&folder, "second.plan", &mission(5), &fence(120.0), firmware);
        let backup = folder.file("b2.plan");
        let args = ["mission", "upload", &second, "--backup", &backup];
        assert_eq!(gaware(&[&args[..], &link].concat()).await.code(), Some(0));
        assert_eq!(files::read(backup.as_ref()).unwrap().1.circles[0].radius_m, 80.0);
        let read = folder.file("read.plan");
        let told = gaware(&[&["mission", "download", &read], &link[..]].concat()).await;
        assert!(told.stdout.contains("with its geofence (1 polygon and 1 circle)"), "{}", told.stdout);
        let on_board = files::read(read.as_ref()).unwrap();
        assert_eq!((on_board.0.items.len(), on_board.1.circles[0].radius_m), (6, 120.0));
        // Only the fence of the backup.
        let args = ["mission", "restore", &backup, "--type", "fence", "--backup", &folder.file("b3.plan")];
        let told = gaware(&[&args[..], &link].concat()).await;
        assert!(told.stdout.contains("the new geofence of 5 items is on the vehicle"), "{}", told.stdout);
        let args = ["mission", "clear", "--type", "fence", "--backup", &folder.file("b4.plan")];
        let told = gaware(&[&args[..], &link].concat()).await;
        assert_eq!(told.code(), Some(0), "{}{}", told.stdout, told.stderr);
        let read = folder.file("cleared.plan");
        gaware(&[&["mission", "download", &read], &link[..]].concat()).await;
        let on_board = files::read(read.as_ref()).unwrap();
        assert_eq!((on_board.0.items.len(), on_board.1.is_empty()), (6, true));
        stop.cancel();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_fence_of_a_refused_mission_is_taken_back() {
    let (folder, stop) = (Folder::new("fence-back"), CancellationToken::new());
    let address = plain(Flavour::ArduPilot, &stop).await;
    let link = ["--connect", &address];
    let first = plan(&folder, "first.plan", &mission(3), &fence(80.0), Firmware::ArduPilot);
    let args = ["mission", "upload", &first, "--backup", &folder.file("b1.plan")];
    assert_eq!(gaware(&[&args[..], &link].concat()).await.code(), Some(0));
    let mut wrong = mission(5);
    wrong.items[3].command = 31_010;
    let second = plan(&folder, "second.plan", &wrong, &fence(120.0), Firmware::ArduPilot);
    let args = ["mission", "upload", &second, "--backup", &folder.file("b2.plan")];
    let told = gaware(&[&args[..], &link].concat()).await;
    assert_eq!(told.code(), Some(1));
    assert!(told.stderr.contains("refused item 4 (command 31010"), "{}", told.stderr);
    let read = folder.file("read.plan");
    gaware(&[&["mission", "download", &read], &link[..]].concat()).await;
    let on_board = files::read(read.as_ref()).unwrap();
    assert_eq!((on_board.0.items.len(), on_board.1.circles[0].radius_m), (4, 80.0));
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refused_upload_ends_with_its_own_sentence() {
    let (folder, stop) = (Folder::new("sentence"), CancellationToken::new());
    let config = AutopilotConfig { flavour: Flavour::ArduPilot, ..AutopilotConfig::default() };
    let address = quadrotor("tcpin:127.0.0.1:0", config, LinkFaults::default(), &stop).await;
    let mut wrong = mission(2);
    wrong.items[1].command = 31_010;
    let path = plan(&folder, "wrong.plan", &wrong, &Fence::default(), Firmware::ArduPilot);
    let args = ["mission", "upload", &path, "--backup", &folder.file("b.plan"), "--connect", &address];
    let told = gaware(&args).await;
    let last = told.stderr.lines().last().unwrap();
    assert!(last.starts_with("gaware: the previous mission is on the vehicle"), "{}", told.stderr);
    assert!(!told.stderr.contains("link is down"), "{}", told.stderr);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn two_vehicles_are_named_and_none_is_chosen() {
    let (folder, stop) = (Folder::new("two"), CancellationToken::new());
    let one = plain(Flavour::ArduPilot, &stop).await;
    let config = AutopilotConfig { flavour: Flavour::Px4, system_id: 2, ..AutopilotConfig::default() };
    let two = quadrotor("tcpin:127.0.0.1:0", config, LinkFaults::default(), &stop).await;
    let links = ["--connect", &one, "--connect", &two];
    let read = folder.file("read.plan");
    for args in [&["mission", "download", &read][..], &["preflight"][..]] {
        let told = gaware(&[args, &links[..]].concat()).await;
        assert_eq!(told.code(), Some(1));
        for name in ["system 1 (ArduPilot, quadrotor)", "system 2 (PX4, quadrotor)", "--vehicle"] {
            assert!(told.stderr.contains(name), "{}", told.stderr);
        }
    }
    let told = gaware(&[&["mission", "download", &read, "--vehicle", "2"], &links[..]].concat()).await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_ground_station_gets_no_mission() {
    let (folder, stop) = (Folder::new("station"), CancellationToken::new());
    let free = UdpSocket::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap();
    // A station that has a component and an autopilot like a vehicle's, and speaks first.
    let station = tokio::spawn(async move {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let data = HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_GCS,
            autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
            ..HEARTBEAT_DATA::default()
        };
        let sender = Sender { system_id: 255, component_id: 1 };
        let frame = Frame::encode(sender, 0, &MavMessage::HEARTBEAT(data));
        let mut pace = tokio::time::interval(std::time::Duration::from_millis(50));
        loop {
            pace.tick().await;
            let _ = socket.send_to(frame.raw(), free).await;
        }
    });
    let config = AutopilotConfig::default();
    quadrotor(&format!("udpout:{free}"), config, LinkFaults::default(), &stop).await;
    let path = plan(&folder, "plan.plan", &mission(3), &Fence::default(), Firmware::ArduPilot);
    let connect = format!("udpin:{free}");
    let args = ["mission", "upload", &path, "--backup", &folder.file("b.plan"), "--connect", &connect];
    let told = gaware(&args).await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    station.abort();
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_for_another_field_is_refused_and_force_says_what_it_overrides() {
    let (folder, stop) = (Folder::new("field"), CancellationToken::new());
    let address = plain(Flavour::ArduPilot, &stop).await;
    let mut elsewhere = mission(3);
    elsewhere.home = None;
    elsewhere.items.iter_mut().for_each(|i| i.x += 73_800_000);
    let path = plan(&folder, "elsewhere.plan", &elsewhere, &Fence::default(), Firmware::ArduPilot);
    let args = ["mission", "upload", &path, "--backup", &folder.file("b.plan"), "--connect", &address];
    let told = gaware(&args).await;
    assert_eq!(told.code(), Some(1));
    assert!(
        told.stderr.contains("nothing was changed: item 1, the first with a place, is 82"),
        "{}",
        told.stderr
    );
    assert!(told.stderr.contains(" km from the vehicle"), "{}", told.stderr);
    let told = gaware(&[&args[..], &["--force", "--json"]].concat()).await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    assert!(told.stderr.contains("--force overrides: item 1, the first with a place"), "{}", told.stderr);
    assert_eq!(told.json()["overridden"].as_array().unwrap().len(), 1);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_pre_flight_check_stops_wrong_set_ups() {
    let (folder, stop) = (Folder::new("preflight"), CancellationToken::new());
    let path = plan(&folder, "plan.plan", &mission(3), &fence(50.0), Firmware::ArduPilot);
    let px4 = plan(&folder, "px4.plan", &mission(3), &Fence::default(), Firmware::Px4);
    /// Changed parameters, plan, airframe, exit status, words.
    type Case<'a> = (&'a [(&'static str, f64)], &'a str, &'a str, i32, &'a str);
    let cases: [Case<'_>; 5] = [
        (&[], &path, "quadrotor", 0, "the vehicle's limits allow what quadrotor is said to do"),
        (
            &[("ANGLE_MAX", 2000.0)],
            &path,
            "quadrotor",
            1,
            "ANGLE_MAX is 20°, bank_max_deg of the airframe file 30°",
        ),
        (
            &[("FENCE_ENABLE", 1.0), ("FENCE_ALT_MAX", 40.0)],
            &path,
            "quadrotor",
            1,
            "FENCE_ALT_MAX is 40 m and the plan goes up to 60 m",
        ),
        (&[], &px4, "quadrotor", 1, "the plan was made for PX4, the vehicle runs ArduPilot"),
        (&[], &path, "small_fixed_wing", 1, "is a fixed wing, the vehicle is a quadrotor"),
    ];
    for (parameters, plan, airframe, code, words) in cases {
        let config = AutopilotConfig { parameters: parameters.to_vec(), ..AutopilotConfig::default() };
        let address = quadrotor("tcpin:127.0.0.1:0", config, LinkFaults::default(), &stop).await;
        let args = ["preflight", "--plan", plan, "--airframe", airframe, "--connect", &address];
        let told = gaware(&args).await;
        assert_eq!(told.code(), Some(code), "{}{}", told.stdout, told.stderr);
        assert!(told.stdout.contains(words), "{words}: {}", told.stdout);
        assert!(told.stdout.contains("firmware       ArduPilot 4.6.0"), "{}", told.stdout);
        assert!(told.stdout.contains("RAW_IMU, GPS_RAW_INT, ATTITUDE come on request"), "{}", told.stdout);
    }
    stop.cancel();
}

/// What the link of this unit shows on the ground is planned with; the rates are as before afterwards.
#[tokio::test(flavor = "multi_thread")]
async fn the_pre_flight_check_measures_noise_and_receiver_for_the_plan() {
    let (folder, stop) = (Folder::new("measured"), CancellationToken::new());
    let model = folder.file("model.toml");
    for flavour in [Flavour::ArduPilot, Flavour::Px4] {
        let config = AutopilotConfig { flavour, loop_rate_hz: 250.0, ..AutopilotConfig::default() };
        let address = quadrotor("tcpin:127.0.0.1:0", config, LinkFaults::default(), &stop).await;
        let args = ["preflight", "--measure", "6", "--model-out", &model, "--connect", &address];
        let told = gaware(&args).await;
        let line =
            told.stdout.lines().find(|l| l.contains("sensors ")).unwrap_or_else(|| panic!("{}", told.stdout));
        let has_noise = line.contains("gyro noise")
            && line.contains("deg/s/√Hz")
            && line.contains("fixes at 5.0 Hz with 0.50 m and 0.10 m/s");
        assert!(has_noise && line.contains("Hz"), "{line}");
        let standard = gaware_nav::model::Model::standard();
        let measured =
            gaware_nav::model::Model::from_toml(&std::fs::read_to_string(&model).unwrap()).unwrap();
        assert!(measured.imu.gyro_noise >= standard.imu.gyro_noise * 0.999, "{measured:?}");
        assert_eq!(measured.gnss.velocity_sigma_m_per_s[0], 0.1);
    }
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn altitudes_survive_any_number_of_backups() {
    let (folder, stop) = (Folder::new("altitudes"), CancellationToken::new());
    let address = plain(Flavour::ArduPilot, &stop).await;
    let mut planned = mission(8);
    // Each of them times 100 lies just below a whole number in single precision.
    for (item, z) in planned.items.iter_mut().zip([50.13, 50.09, 64.11, 33.37, 71.53, 90.07, 57.29, 16.07]) {
        item.z = z;
    }
    let mut file = plan(&folder, "plan.plan", &planned, &Fence::default(), Firmware::ArduPilot);
    for k in 0..3 {
        let backup = folder.file(&format!("b{k}.plan"));
        let args = ["mission", "upload", &file, "--backup", &backup, "--connect", &address];
        assert_eq!(gaware(&args).await.code(), Some(0));
        file = folder.file(&format!("read{k}.plan"));
        assert_eq!(gaware(&["mission", "download", &file, "--connect", &address]).await.code(), Some(0));
    }
    let on_board = files::read(file.as_ref()).unwrap().0;
    let z = |m: &Mission| m.items.iter().map(|i| format!("{:.2}", i.z)).collect::<Vec<_>>();
    assert_eq!(z(&on_board), z(&planned));
    stop.cancel();
}

/// An upload of 25 items that is about a third done.
async fn half_way(folder: &Folder, address: &str) -> Gaware {
    let first = plan(folder, "first.plan", &mission(3), &Fence::default(), Firmware::ArduPilot);
    let args = ["mission", "upload", &first, "--backup", &folder.file("b1.plan"), "--connect", address];
    assert_eq!(gaware(&args).await.code(), Some(0));
    let second = plan(folder, "second.plan", &mission(24), &Fence::default(), Firmware::ArduPilot);
    let args = ["mission", "upload", &second, "--backup", &folder.file("b2.plan"), "--connect", address];
    let command = Gaware::start(&args);
    tokio::task::spawn_blocking(move || {
        command.line_with("8 of 2");
        command
    })
    .await
    .unwrap()
}

fn signal(process: u32, name: &str) {
    let sent = std::process::Command::new("kill").args([name, &process.to_string()]).status().unwrap();
    assert!(sent.success());
}

async fn slow(stop: &CancellationToken) -> String {
    let faults = LinkFaults { delay_s: 0.04, ..LinkFaults::default() };
    quadrotor("tcpin:127.0.0.1:0", AutopilotConfig::default(), faults, stop).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_terminal_that_goes_away_leaves_no_half_mission() {
    let (folder, stop) = (Folder::new("hangup"), CancellationToken::new());
    let address = slow(&stop).await;
    let command = half_way(&folder, &address).await;
    signal(command.id(), "-HUP");
    let ended = tokio::task::spawn_blocking(move || command.ended()).await.unwrap();
    assert_eq!(ended.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("the previous mission is on the vehicle"), "{}", ended.stderr);
    let read = folder.file("read.plan");
    gaware(&["mission", "download", &read, "--connect", &address]).await;
    assert_eq!(files::read(read.as_ref()).unwrap().0.items.len(), 4);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_second_signal_ends_at_once_and_the_journal_stays() {
    let (folder, stop) = (Folder::new("twice"), CancellationToken::new());
    let address = slow(&stop).await;
    let command = half_way(&folder, &address).await;
    let ended = tokio::task::spawn_blocking(move || {
        signal(command.id(), "-INT");
        command.line_with("the same signal again ends at once");
        signal(command.id(), "-INT");
        command.ended()
    });
    let ended = ended.await.unwrap();
    assert_eq!(ended.code(), Some(1));
    assert!(ended.stderr.contains("ended at once, as asked"), "{}", ended.stderr);
    let journal = folder.file("mission-transfer-system1-0100000152505541.journal");
    let told = gaware(&["mission", "restore", &journal, "--connect", &address]).await;
    assert!(
        told.stdout.contains("now it is the previous mission of 4 items"),
        "{}{}",
        told.stdout,
        told.stderr
    );
    stop.cancel();
}

/// Between a vehicle that knows nothing of signing and a station: signs what comes from the vehicle, and lets only signed frames to it.
async fn signing_vehicle(key: [u8; 32], stop: &CancellationToken) -> String {
    let behind =
        quadrotor("udpin:127.0.0.1:0", AutopilotConfig::default(), LinkFaults::default(), stop).await;
    let vehicle = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    vehicle.connect(behind.strip_prefix("udpout:").unwrap()).await.unwrap();
    let station = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let address = format!("udpout:{}", station.local_addr().unwrap());
    let now_us = || SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_micros() as u64;
    let (mut signer, mut verifier) =
        (Signer::new(Key::new(key), 0), Verifier::new(Key::new(key), std::collections::BTreeMap::new()));
    tokio::spawn(async move {
        let (mut peer, mut up, mut down) = (None, vec![0; 2048], vec![0; 2048]);
        loop {
            tokio::select! {
                Ok((n, from)) = station.recv_from(&mut up) => {
                    peer = Some(from);
                    let frame = Frame::parse(up[..n].to_vec().into()).unwrap();
                    if verifier.judge(&frame, now_us()) == Trust::Genuine {
                        vehicle.send(frame.raw()).await.unwrap();
                    }
                }
                Ok(n) = vehicle.recv(&mut down) => {
                    let frame = Frame::parse(down[..n].to_vec().into()).unwrap();
                    if let Some(peer) = peer {
                        let _ = station.send_to(signer.sign(&frame, 1, now_us()).raw(), peer).await;
                    }
                }
            }
        }
    });
    address
}

/// A vehicle behind a wire that adds what PX4's navigator says of a mission once it was accepted.
async fn rejecting_vehicle(stop: &CancellationToken) -> String {
    use mavlink::dialects::ardupilotmega::EVENT_DATA;
    /// `MISSION_ACK`; its payload is empty but for the addressee when the mission was accepted.
    const ACK: u32 = 47;
    let config = AutopilotConfig { flavour: Flavour::Px4, ..AutopilotConfig::default() };
    let behind = quadrotor("udpin:127.0.0.1:0", config, LinkFaults::default(), stop).await;
    let vehicle = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    vehicle.connect(behind.strip_prefix("udpout:").unwrap()).await.unwrap();
    let station = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let address = format!("udpout:{}", station.local_addr().unwrap());
    let event = EVENT_DATA { id: 0x0181_1691, log_levels: 0x33, ..EVENT_DATA::default() };
    let event = Frame::encode(Sender { system_id: 1, component_id: 1 }, 0, &MavMessage::EVENT(event));
    tokio::spawn(async move {
        let (mut peer, mut up, mut down, mut said) = (None, vec![0; 2048], vec![0; 2048], false);
        loop {
            tokio::select! {
                Ok((n, from)) = station.recv_from(&mut up) => {
                    peer = Some(from);
                    vehicle.send(&up[..n]).await.unwrap();
                }
                Ok(n) = vehicle.recv(&mut down) => {
                    let Some(peer) = peer else { continue };
                    let _ = station.send_to(&down[..n], peer).await;
                    let accepted = Frame::parse(down[..n].to_vec().into())
                        .is_ok_and(|f| f.message_id == ACK && f.payload().get(2).is_none_or(|r| *r == 0));
                    if accepted && !std::mem::replace(&mut said, true) {
                        let _ = station.send_to(event.raw(), peer).await;
                    }
                }
            }
        }
    });
    address
}

#[tokio::test(flavor = "multi_thread")]
async fn a_mission_that_px4_rejects_by_an_event_is_not_called_uploaded() {
    let (folder, stop) = (Folder::new("event"), CancellationToken::new());
    let address = rejecting_vehicle(&stop).await;
    let path = plan(&folder, "plan.plan", &mission(3), &Fence::default(), Firmware::Px4);
    let args = ["mission", "upload", &path, "--backup", &folder.file("b.plan"), "--connect", &address];
    let told = gaware(&args).await;
    assert_eq!(told.code(), Some(1), "{}", told.stdout);
    let words = "accepted it and then rejected it: a landing is required (MIS_TKO_LAND_REQ)";
    assert!(told.stderr.contains(words), "{}", told.stderr);
    let read = folder.file("read.plan");
    gaware(&["mission", "download", &read, "--connect", &address]).await;
    assert_eq!(files::read(read.as_ref()).unwrap().0.items.len(), 0);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_vehicle_that_wants_signatures_gets_them() {
    let (folder, stop) = (Folder::new("signed"), CancellationToken::new());
    let address = signing_vehicle([7; 32], &stop).await;
    let key = folder.file("key");
    std::fs::write(&key, [7; 32]).unwrap();
    let read = folder.file("read.plan");
    let args = ["mission", "download", &read, "--connect", &address];
    let told = gaware(&[&args[..], &["--signing-key", &key]].concat()).await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    std::fs::remove_file(&read).unwrap();
    // Another key: the vehicle does not exist for us, nor we for it.
    std::fs::write(&key, [8; 32]).unwrap();
    let told = gaware(&[&args[..], &["--signing-key", &key, "--patience", "3"]].concat()).await;
    assert_eq!(told.code(), Some(1));
    assert!(told.stderr.contains("they are signed with another key"), "{}", told.stderr);
    stop.cancel();
}
