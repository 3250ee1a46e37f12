//! One system id is not one vehicle: what two of them, an exchanged one, and a second station come to, over real sockets.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::mission_link::files::{self, Contents};
use gaware_mission::airframe::Airframe;
use gaware_mission::fence::{Fence, FenceCircle};
use gaware_mission::item::{Autopilot as Firmware, Home, LatLon, Mission, MissionItem, command};
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::scenario::scenario;
use gaware_sitl::shell::{Options, Server, Speed};
use std::collections::BTreeSet;
use support::{Ended, Folder, Gaware, page};
use tokio::net::UdpSocket;
use tokio_util::sync::CancellationToken;

const A: u64 = 0x0a;
const B: u64 = 0x0b;

fn mission(legs: usize) -> Mission {
    let at = |k: usize| LatLon { lat_deg: 47.397 + 1e-3 * k as f64, lon_deg: 8.545 };
    let mut items = vec![MissionItem::at(command::NAV_TAKEOFF, [0.0; 4], at(0), 60.0)];
    items.extend((1..=legs).map(|k| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], at(k), 60.0)));
    Mission { home: Some(Home { lat_e7: 473_970_000, lon_e7: 85_450_000, alt_m: 441.0 }), items }
}

fn fence(radius_m: f64) -> Fence {
    let center = LatLon { lat_deg: 47.402, lon_deg: 8.55 };
    Fence { circles: vec![FenceCircle { inclusion: false, center, radius_m }], ..Fence::default() }
}

/// A plan for a quadrotor.
fn plan(folder: &Folder, name: &str, contents: &Contents) -> String {
    let path = folder.file(name);
    let text = files::text_of(path.as_ref(), contents, Firmware::ArduPilot, 2).unwrap();
    std::fs::write(&path, text).unwrap();
    path
}

fn legs(legs: usize, radius_m: f64) -> Contents {
    Contents { mission: mission(legs), fence: fence(radius_m), ..Contents::default() }
}

/// A simulated quadrotor with this hardware id and system id 1; the address to connect to.
async fn quadrotor(endpoint: &str, uid: u64, delay_s: f64, stop: &CancellationToken) -> String {
    let parameters = vec![("ANGLE_MAX", 3000.0)];
    let config = AutopilotConfig { uid, parameters, ..AutopilotConfig::default() };
    let autopilot = Autopilot::playing(config, &scenario("mission_multirotor").unwrap());
    let server = Server::bind(&endpoint.parse().unwrap()).await.unwrap();
    let address = server.address().to_owned();
    let link_faults = LinkFaults { delay_s, ..LinkFaults::default() };
    let options = Options { link_faults, speed: Speed::Times(1.0), ..Options::default() };
    let stop = stop.clone();
    tokio::spawn(async move { server.run(autopilot, options, stop).await });
    address
}

/// A router: everyone who speaks to it hears all of these vehicles from one place, and all of them hear everyone.
async fn router(vehicles: &[String]) -> String {
    let station = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let address = format!("udpout:{}", station.local_addr().unwrap());
    let station = std::sync::Arc::new(station);
    let peers = std::sync::Arc::new(std::sync::Mutex::new(BTreeSet::new()));
    let mut behind = Vec::new();
    for vehicle in vehicles {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        socket.connect(vehicle.strip_prefix("udpout:").unwrap()).await.unwrap();
        let socket = std::sync::Arc::new(socket);
        behind.push(socket.clone());
        let (station, peers) = (station.clone(), peers.clone());
        tokio::spawn(async move {
            let mut bytes = vec![0; 2048];
            loop {
                let Ok(n) = socket.recv(&mut bytes).await else { continue };
                let to: Vec<_> = peers.lock().unwrap().iter().copied().collect();
                for peer in to {
                    let _ = station.send_to(&bytes[..n], peer).await;
                }
            }
        });
    }
    tokio::spawn(async move {
        let mut bytes = vec![0; 2048];
        loop {
            let Ok((n, from)) = station.recv_from(&mut bytes).await else { continue };
            peers.lock().unwrap().insert(from);
            for socket in &behind {
                let _ = socket.send(&bytes[..n]).await;
            }
        }
    });
    address
}

async fn gaware(args: &[&str]) -> Ended {
    let args: Vec<String> = args.iter().map(|a| (*a).to_owned()).collect();
    let run = move || support::gaware(&args.iter().map(String::as_str).collect::<Vec<_>>());
    tokio::task::spawn_blocking(run).await.unwrap()
}

/// Items and radius of the fence on the only vehicle there.
async fn on_board(folder: &Folder, name: &str, address: &str) -> (usize, Option<f64>) {
    let read = folder.file(name);
    let told = gaware(&["mission", "download", &read, "--connect", address]).await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    let (mission, fence) = files::read(read.as_ref()).unwrap();
    (mission.items.len(), fence.circles.first().map(|c| c.radius_m))
}

async fn upload(folder: &Folder, plan: &str, backup: &str, address: &str) -> Ended {
    gaware(&["mission", "upload", plan, "--backup", &folder.file(backup), "--connect", address]).await
}

#[tokio::test(flavor = "multi_thread")]
async fn two_vehicles_with_one_id_on_one_port_get_nothing_from_any_command() {
    // With two hardware ids, and with one as all of PX4's own simulations have.
    for (name, other) in [("twins", B), ("same-uid", A)] {
        let (folder, stops) = (Folder::new(name), [CancellationToken::new(), CancellationToken::new()]);
        let free = UdpSocket::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap();
        quadrotor(&format!("udpout:{free}"), A, 0.0, &stops[0]).await;
        quadrotor(&format!("udpout:{free}"), other, 0.0, &stops[1]).await;
        let connect = format!("udpin:{free}");
        let plan = plan(&folder, "plan.plan", &legs(9, 50.0));
        let values = folder.file("values.param");
        std::fs::write(&values, "GPS1_POS_X,0.3\n").unwrap();
        let (read, backup) = (folder.file("read.plan"), folder.file("backup.plan"));
        for args in [
            &["mission", "upload", &plan, "--backup", &backup, "--force"][..],
            &["mission", "upload", &plan, "--backup", &backup, "--vehicle", "1"],
            &["mission", "download", &read],
            &["mission", "restore", &plan, "--backup", &backup],
            &["mission", "clear", "--type", "mission", "--backup", &backup],
            &["params", "apply", "--yes", &values, "--backup", &backup],
            &["params", "backup", &backup],
            &["preflight"],
        ] {
            let told = gaware(&[args, &["--connect", &connect]].concat()).await;
            assert_eq!(told.code(), Some(1), "{args:?}: {}", told.stdout);
            let words = "system 1 is heard from two places, 127.0.0.1:";
            assert!(told.stderr.contains(words), "{args:?}: {}", told.stderr);
            assert!(told.stderr.contains("nothing was changed"), "{args:?}: {}", told.stderr);
        }
        assert!(!std::path::Path::new(&backup).exists() && !std::path::Path::new(&read).exists());
        // Each of them alone has what it had.
        stops[0].cancel();
        assert_eq!(on_board(&folder, "other.plan", &connect).await, (0, None));
        stops[1].cancel();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn two_vehicles_with_one_id_behind_one_router_are_told_apart_by_their_hardware() {
    let (folder, stop) = (Folder::new("router"), CancellationToken::new());
    let (a, b) = (
        quadrotor("udpin:127.0.0.1:0", A, 0.0, &stop).await,
        quadrotor("udpin:127.0.0.1:0", B, 0.0, &stop).await,
    );
    let both = router(&[a.clone(), b.clone()]).await;
    let plan = plan(&folder, "plan.plan", &legs(9, 50.0));
    let told = upload(&folder, &plan, "b1.plan", &both).await;
    assert_eq!(told.code(), Some(1), "{}", told.stdout);
    let named = |ids: [&str; 2]| told.stderr.contains(&format!("hardware ids {} and {}", ids[0], ids[1]));
    assert!(named(["0a", "0b"]) || named(["0b", "0a"]), "{}", told.stderr);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_page_refuses_two_vehicles_with_one_id() {
    const TOKEN: &str = "two-of-them-on-it";
    let (folder, stop) = (Folder::new("page-twins"), CancellationToken::new());
    let free = UdpSocket::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap();
    quadrotor(&format!("udpout:{free}"), A, 0.0, &stop).await;
    quadrotor(&format!("udpout:{free}"), B, 0.0, &stop).await;
    let plan = plan(&folder, "plan.plan", &legs(9, 50.0));
    let connect = format!("udpin:{free}");
    let args = ["run", "--connect", &connect, "--no-record", "--headless", "--web", "127.0.0.1:0"];
    let companion = Gaware::start(&[&args[..], &["--web-token", TOKEN, "--mission", &plan]].concat());
    let line = companion.line_with("web page: http://");
    let address = line.split("//").nth(1).unwrap().split('/').next().unwrap().to_owned();
    let (status, text) = loop {
        let asked = page::post(&address, "/api/v1/mission/upload", Some(TOKEN), "{\"confirm\": true}").await;
        if !asked.1.contains("not heard") {
            break asked;
        }
    };
    assert!(status != 200 && text.contains("heard from two places"), "{status} {text}");
    companion.terminate();
    companion.ended();
    stop.cancel();
}

/// Kills an upload of 25 items by the program itself when a third of it is on the vehicle.
async fn killed(folder: &Folder, plan: &str, address: &str) {
    let backup = folder.file("killed-backup.plan");
    let command = Gaware::start(&["mission", "upload", plan, "--backup", &backup, "--connect", address]);
    let kill = move || {
        command.line_with("8 of 2");
        command.kill();
    };
    tokio::task::spawn_blocking(kill).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_vehicle_exchanged_after_a_killed_upload_keeps_its_own_mission() {
    let (folder, stop) = (Folder::new("exchanged"), CancellationToken::new());
    let a = quadrotor("tcpin:127.0.0.1:0", A, 0.04, &stop).await;
    let b = quadrotor("tcpin:127.0.0.1:0", B, 0.0, &stop).await;
    let first = plan(&folder, "first.plan", &legs(3, 40.0));
    for (address, backup) in [(&a, "a0.plan"), (&b, "b0.plan")] {
        let told = upload(&folder, &first, backup, address).await;
        assert_eq!(told.code(), Some(0), "{}", told.stderr);
    }
    let long = plan(&folder, "long.plan", &legs(24, 60.0));
    killed(&folder, &long, &a).await;
    let journal = folder.file("mission-transfer-system1-0a.journal");
    for more in [&[][..], &["--new"], &["--force"]] {
        let told = gaware(&[&["mission", "restore", &journal, "--connect", &b], more].concat()).await;
        assert_eq!(told.code(), Some(1), "{}", told.stdout);
        let words = "is about system 1 (ArduPilot, quadrotor), hardware id 0a";
        assert!(told.stderr.contains(words), "{}", told.stderr);
        assert!(told.stderr.contains("connected is another vehicle, system 1"), "{}", told.stderr);
        assert!(told.stderr.contains("nothing was changed"), "{}", told.stderr);
    }
    assert_eq!(on_board(&folder, "b-read.plan", &b).await, (4, Some(40.0)));
    // It is no obstacle to an upload to the other one, but to one to its own.
    let second = plan(&folder, "second.plan", &legs(5, 70.0));
    let told = upload(&folder, &second, "b1.plan", &b).await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    let told = upload(&folder, &second, "a1.plan", &a).await;
    assert!(told.stderr.contains("to this vehicle, system 1"), "{}", told.stderr);
    let told = gaware(&["mission", "restore", &journal, "--connect", &a, "--json"]).await;
    assert_eq!(told.code(), Some(0), "{}{}", told.stdout, told.stderr);
    let kept = told.json()["backup"].as_str().unwrap().to_owned();
    let on_it = files::read_contents(kept.as_ref()).unwrap();
    assert_eq!(on_it.backup_of.and_then(|v| v.uid).map(|u| u.to_string()).as_deref(), Some("0a"));
    assert_eq!(on_board(&folder, "a-read.plan", &a).await, (4, Some(40.0)));
    // A backup of one is not for the other.
    let told =
        gaware(&["mission", "restore", &kept, "--connect", &b, "--backup", &folder.file("x.plan")]).await;
    assert!(told.stderr.contains("the file is a backup of system 1"), "{}", told.stderr);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_came_after_a_killed_upload_is_put_over_only_by_force_and_kept() {
    let (folder, stop) = (Folder::new("came-after"), CancellationToken::new());
    let a = quadrotor("tcpin:127.0.0.1:0", A, 0.04, &stop).await;
    let long = plan(&folder, "long.plan", &legs(24, 60.0));
    killed(&folder, &long, &a).await;
    // Another station has sent a mission since.
    let elsewhere = Folder::new("came-after-elsewhere");
    let mut theirs = legs(6, 90.0);
    theirs.mission.items.iter_mut().for_each(|i| i.z = 75.0);
    let theirs = plan(&elsewhere, "theirs.plan", &theirs);
    let told = upload(&elsewhere, &theirs, "b.plan", &a).await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    let journal = folder.file("mission-transfer-system1-0a.journal");
    let told = gaware(&["mission", "restore", &journal, "--connect", &a]).await;
    assert_eq!(told.code(), Some(1), "{}", told.stdout);
    assert!(
        told.stderr.contains("is neither the previous mission nor the new one, but 7 items"),
        "{}",
        told.stderr
    );
    assert_eq!(on_board(&folder, "still.plan", &a).await, (7, Some(90.0)));
    let told = gaware(&["mission", "restore", &journal, "--connect", &a, "--force", "--json"]).await;
    assert_eq!(told.code(), Some(0), "{}{}", told.stdout, told.stderr);
    let kept = files::read(told.json()["backup"].as_str().unwrap().as_ref()).unwrap();
    assert_eq!((kept.0.items.len(), kept.1.circles[0].radius_m), (7, 90.0));
    assert_eq!(on_board(&folder, "after.plan", &a).await, (0, None));
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn parameters_of_an_exchanged_vehicle_are_left_alone() {
    let (folder, stop) = (Folder::new("params-exchanged"), CancellationToken::new());
    let a = quadrotor("tcpin:127.0.0.1:0", A, 0.1, &stop).await;
    let b = quadrotor("tcpin:127.0.0.1:0", B, 0.0, &stop).await;
    let values = folder.file("values.param");
    std::fs::write(&values, "GPS1_DELAY_MS,96\nGPS1_POS_X,0.31\nGPS1_POS_Y,0.32\nGPS1_POS_Z,0.33\n").unwrap();
    let backup = folder.file("backup.param");
    let command = Gaware::start(&["params", "apply", "--yes", &values, "--backup", &backup, "--connect", &a]);
    let kill = move || {
        command.line_with("setting");
        command.kill();
    };
    tokio::task::spawn_blocking(kill).await.unwrap();
    let journal = folder.file("parameter-change-system1-0a.journal");
    let told = gaware(&["params", "restore", &journal, "--connect", &b]).await;
    assert_eq!(told.code(), Some(1), "{}", told.stdout);
    assert!(told.stderr.contains("connected is another vehicle, system 1"), "{}", told.stderr);
    let told =
        gaware(&["params", "restore", &backup, "--connect", &b, "--backup", &folder.file("x.param")]).await;
    assert!(told.stderr.contains("is for the vehicle with hardware id 0a"), "{}", told.stderr);
    let told =
        gaware(&["params", "apply", "--yes", &values, "--backup", &folder.file("b.param"), "--connect", &b])
            .await;
    assert_eq!(told.code(), Some(0), "a change of another vehicle is no obstacle: {}", told.stderr);
    let told = gaware(&["params", "restore", &journal, "--connect", &a, "--json"]).await;
    assert_eq!(told.code(), Some(0), "{}{}", told.stdout, told.stderr);
    let kept = std::fs::read_to_string(told.json()["backup"].as_str().unwrap()).unwrap();
    assert!(kept.contains("uid=0a") && kept.contains("GPS1_POS_X"), "{kept}");
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn of_two_uploads_at_once_only_the_one_that_is_on_the_vehicle_says_so() {
    let stop = CancellationToken::new();
    let a = quadrotor("udpin:127.0.0.1:0", A, 0.0, &stop).await;
    let address = router(&[a]).await;
    let folders = [Folder::new("at-once-1"), Folder::new("at-once-2")];
    let plans = [plan(&folders[0], "p.plan", &legs(20, 40.0)), plan(&folders[1], "p.plan", &legs(13, 80.0))];
    let both = folders.iter().zip(&plans).map(|(folder, plan)| upload(folder, plan, "b.plan", &address));
    let mut both = both.collect::<Vec<_>>();
    let (second, first) = (both.pop().unwrap(), both.pop().unwrap());
    let order = std::sync::atomic::AtomicUsize::new(0);
    let next = || order.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
    let (first, second) = tokio::join!(async { (first.await, next()) }, async { (second.await, next()) });
    let (items, _) = on_board(&folders[0], "read.plan", &address).await;
    // The one that ended first may have been right when it ended: on a slow machine the other one's mission comes minutes later.
    let (last, own) = if first.1 == 1 { (&first.0, 21) } else { (&second.0, 14) };
    let says_so = last.code() == Some(0);
    assert!(!says_so || items == own, "{items} items are on it: {}{}", last.stdout, last.stderr);
    assert!(says_so || last.stderr.contains("mission"), "it says what is on the vehicle: {}", last.stderr);
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_the_pre_flight_check_stops_no_upload_brings() {
    const TOKEN: &str = "far-too-steep-turns";
    let (folder, stop) = (Folder::new("one-check"), CancellationToken::new());
    let address = quadrotor("udpin:127.0.0.1:0", A, 0.0, &stop).await;
    // Steeper than the simulated vehicle allows.
    let file = folder.file("steep.toml");
    let text = include_str!("../mission/airframes/quadrotor.toml")
        .replace("bank_max_deg = 30.0", "bank_max_deg = 35.0");
    std::fs::write(&file, &text).unwrap();
    let airframe = Some(Airframe::from_toml(&text).unwrap());
    let planned = plan(&folder, "planned.plan", &Contents { airframe, ..legs(5, 50.0) });
    let words = "ANGLE_MAX is 30°, bank_max_deg of the airframe file 35°";
    let told = gaware(&["preflight", "--plan", &planned, "--connect", &address]).await;
    assert!(told.code() == Some(1) && told.stderr.contains(words), "{}{}", told.stdout, told.stderr);
    let told = upload(&folder, &planned, "b1.plan", &address).await;
    assert!(told.code() == Some(1) && told.stderr.contains(words), "{}{}", told.stdout, told.stderr);
    // A file without an airframe, checked against one that is named.
    let bare = plan(&folder, "bare.plan", &legs(5, 50.0));
    let backup = folder.file("b2.plan");
    let named = ["mission", "upload", &bare, "--airframe", &file, "--backup", &backup, "--connect", &address];
    let told = gaware(&named).await;
    assert!(told.code() == Some(1) && told.stderr.contains(words), "{}{}", told.stdout, told.stderr);
    let args = ["run", "--connect", &address, "--no-record", "--headless", "--web", "127.0.0.1:0"];
    let companion = Gaware::start(&[&args[..], &["--web-token", TOKEN, "--mission", &planned]].concat());
    let line = companion.line_with("web page: http://");
    let at = line.split("//").nth(1).unwrap().split('/').next().unwrap().to_owned();
    let (status, text) = loop {
        let asked = page::post(&at, "/api/v1/mission/upload", Some(TOKEN), "{\"confirm\": true}").await;
        if !asked.1.contains("not heard") {
            break asked;
        }
    };
    assert!(status != 200 && text.contains(words), "{status} {text}");
    companion.terminate();
    companion.ended();
    assert_eq!(on_board(&folder, "none.plan", &address).await, (0, None));
    let backup = folder.file("b3.plan");
    let told = gaware(&[
        "mission",
        "upload",
        &planned,
        "--force",
        "--json",
        "--backup",
        &backup,
        "--connect",
        &address,
    ])
    .await;
    assert_eq!(told.code(), Some(0), "{}", told.stderr);
    assert!(told.json()["overridden"][0].as_str().unwrap().contains(words), "{}", told.stdout);
    stop.cancel();
}
