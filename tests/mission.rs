//! `gaware mission` against the simulated autopilot over real sockets.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::commands::mission::{ConnectArgs, DownloadArgs, LinkArgs, UploadArgs, download, upload};
use gaware::mission_link::files;
use gaware_mission::fence::{Fence, FenceCircle};
use gaware_mission::files::waypoints;
use gaware_mission::item::{Autopilot as Firmware, Home, LatLon, Mission, MissionItem, command};
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::scenario::scenario;
use gaware_sitl::shell::{Options, Server, Speed};
use std::path::{Path, PathBuf};
use support::Gaware;
use support::page::{exchange, post};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

fn mission(legs: usize) -> Mission {
    let at = |k: usize| LatLon { lat_deg: 47.397 + 1e-3 * k as f64, lon_deg: 8.545 };
    let mut items = vec![MissionItem::at(command::NAV_TAKEOFF, [0.0; 4], at(0), 60.0)];
    items.extend((1..=legs).map(|k| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], at(k), 60.0)));
    Mission { home: Some(Home { lat_e7: 473_970_000, lon_e7: 85_450_000, alt_m: 441.0 }), items }
}

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("gaware-mission-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn mission(&self, name: &str, legs: usize) -> PathBuf {
        let path = self.file(name);
        std::fs::write(&path, waypoints::write(&mission(legs))).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A simulated vehicle; the address to connect to.
async fn vehicle(endpoint: &str, flavour: Flavour, faults: LinkFaults, stop: &CancellationToken) -> String {
    let config = AutopilotConfig { flavour, ..AutopilotConfig::default() };
    let autopilot = Autopilot::playing(config, &scenario("mission_multirotor").unwrap());
    let server = Server::bind(&endpoint.parse().unwrap()).await.unwrap();
    let address = server.address().to_owned();
    let options = Options { link_faults: faults, speed: Speed::Times(1.0), ..Options::default() };
    let stop = stop.clone();
    tokio::spawn(async move { server.run(autopilot, options, stop).await });
    address
}

fn link(address: &str, file: PathBuf) -> LinkArgs {
    let connect = vec![address.parse().unwrap()];
    LinkArgs {
        to: ConnectArgs { connect, vehicle: None, patience: 20, signing_key: None, json: false },
        file,
    }
}

fn get(address: &str, file: PathBuf) -> DownloadArgs {
    DownloadArgs { link: link(address, file), list: None }
}

fn put(address: &str, file: PathBuf, backup: PathBuf) -> UploadArgs {
    UploadArgs {
        link: link(address, file),
        backup: Some(backup),
        airframe: None,
        no_fence: false,
        force: false,
        even_while_flying: false,
    }
}

/// Upload, upload another, look at the backup, restore it, download and compare.
async fn round_trip(name: &str, endpoint: &str, flavour: Flavour, faults: LinkFaults) {
    let (folder, stop) = (Folder::new(name), CancellationToken::new());
    let address = vehicle(endpoint, flavour, faults, &stop).await;
    let (first, second) = (folder.mission("first.waypoints", 3), folder.mission("second.waypoints", 5));
    let told = upload(&put(&address, first, folder.file("b1.plan")), &stop, |_| ()).await.unwrap();
    assert!(told.text.contains("4 items is on the vehicle"), "{told}");
    let backup = folder.file("b2.plan");
    upload(&put(&address, second, backup.clone()), &stop, |_| ()).await.unwrap();
    assert_eq!(files::read(&backup).unwrap().0.items.len(), 4);
    upload(&put(&address, backup, folder.file("b3.plan")), &stop, |_| ()).await.unwrap();
    let read = folder.file("read.plan");
    download(&get(&address, read.clone()), &stop).await.unwrap();
    let on_board = files::read(&read).unwrap().0;
    let firmware = match flavour {
        Flavour::ArduPilot => Firmware::ArduPilot,
        Flavour::Px4 => Firmware::Px4,
    };
    assert_eq!(gaware_mission::compare::differences(firmware, &mission(3), &on_board), vec![]);
    // A file that is there is not overwritten.
    assert!(download(&get(&address, read), &stop).await.unwrap_err().to_string().contains("cannot write"));
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn missions_go_to_ardupilot_and_back_over_tcp() {
    round_trip("ap", "tcpin:127.0.0.1:0", Flavour::ArduPilot, LinkFaults::default()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn missions_go_to_px4_and_back_over_a_bad_udp_link() {
    let faults =
        LinkFaults { loss: 0.02, duplicate: 0.05, reorder: 0.1, delay_s: 0.01, ..LinkFaults::default() };
    round_trip("px4", "udpin:127.0.0.1:0", Flavour::Px4, faults).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refused_mission_leaves_the_previous_one() {
    let (folder, stop) = (Folder::new("refused"), CancellationToken::new());
    let address = vehicle("tcpin:127.0.0.1:0", Flavour::ArduPilot, LinkFaults::default(), &stop).await;
    let good = folder.mission("good.waypoints", 2);
    upload(&put(&address, good, folder.file("b1.plan")), &stop, |_| ()).await.unwrap();
    let mut wrong = mission(4);
    wrong.items[2].command = 31_010;
    let path = folder.file("wrong.waypoints");
    std::fs::write(&path, waypoints::write(&wrong)).unwrap();
    let told =
        upload(&put(&address, path, folder.file("b2.plan")), &stop, |_| ()).await.unwrap_err().to_string();
    assert!(told.contains("the previous mission is on the vehicle"), "{told}");
    let read = folder.file("read.waypoints");
    download(&get(&address, read.clone()), &stop).await.unwrap();
    assert_eq!(files::read(&read).unwrap().0.items.len(), 3);
    stop.cancel();
}

/// Uploads 25 items over 4 others by the program itself and kills it, as a power cut would, when a third of them is on the vehicle.
async fn killed_upload(folder: &Folder, address: &str, stop: &CancellationToken) {
    let first = folder.mission("first.waypoints", 3);
    upload(&put(address, first, folder.file("b1.plan")), stop, |_| ()).await.unwrap();
    let second = folder.mission("second.waypoints", 24);
    let args = ["mission", "upload", "--connect", address];
    let files = [second.to_str().unwrap(), "--backup"];
    let backup = folder.file("b2.plan");
    let command = Gaware::start(&[&args[..], &files[..], &[backup.to_str().unwrap()]].concat());
    tokio::task::spawn_blocking(move || {
        command.line_with("8 of 2");
        command.kill();
    })
    .await
    .unwrap();
}

/// What the program says when it takes the upload up from its journal.
async fn taken_up(folder: &Folder, address: &str, more: &'static [&'static str]) -> support::Ended {
    let journal = folder.file("mission-transfer-system1-0100000152505541.journal");
    let (address, journal) = (address.to_owned(), journal.to_str().unwrap().to_owned());
    let run =
        move || support::gaware(&[&["mission", "restore", "--connect", &address, &journal], more].concat());
    tokio::task::spawn_blocking(run).await.unwrap()
}

fn slow() -> LinkFaults {
    LinkFaults { delay_s: 0.04, ..LinkFaults::default() }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_upload_is_taken_up_and_the_previous_mission_put_back() {
    let (folder, stop) = (Folder::new("killed"), CancellationToken::new());
    let address = vehicle("tcpin:127.0.0.1:0", Flavour::ArduPilot, slow(), &stop).await;
    killed_upload(&folder, &address, &stop).await;
    // Nothing goes over it before that is settled: its backup would be of the mixture.
    let third = folder.mission("third.waypoints", 2);
    let told = upload(&put(&address, third, folder.file("b3.plan")), &stop, |_| ()).await.unwrap_err();
    assert!(told.to_string().contains("gaware mission restore"), "{told}");
    let ended = taken_up(&folder, &address, &[]).await;
    assert_eq!(ended.code(), Some(0), "{}{}", ended.stdout, ended.stderr);
    assert!(ended.stdout.contains("on the vehicle was: A MIXTURE: "), "{}", ended.stdout);
    assert!(ended.stdout.contains("now it is the previous mission of 4 items"), "{}", ended.stdout);
    let read = folder.file("read.waypoints");
    download(&get(&address, read.clone()), &stop).await.unwrap();
    let on_board = files::read(&read).unwrap().0;
    assert_eq!(gaware_mission::compare::differences(Firmware::ArduPilot, &mission(3), &on_board), vec![]);
    // It is settled: no journal, and uploads go again.
    assert!(!folder.file("mission-transfer-system1-0100000152505541.journal").exists());
    let fourth = folder.mission("fourth.waypoints", 2);
    upload(&put(&address, fourth, folder.file("b4.plan")), &stop, |_| ()).await.unwrap();
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_upload_is_taken_up_and_the_new_mission_brought() {
    let (folder, stop) = (Folder::new("killed-new"), CancellationToken::new());
    let address = vehicle("tcpin:127.0.0.1:0", Flavour::Px4, slow(), &stop).await;
    killed_upload(&folder, &address, &stop).await;
    let ended = taken_up(&folder, &address, &["--new"]).await;
    assert_eq!(ended.code(), Some(0), "{}{}", ended.stdout, ended.stderr);
    // PX4 takes a mission whole or not at all.
    assert!(ended.stdout.contains("on the vehicle was: the previous mission, whole"), "{}", ended.stdout);
    assert!(ended.stdout.contains("now it is the new mission of 25 items"), "{}", ended.stdout);
    let read = folder.file("read.waypoints");
    download(&get(&address, read.clone()), &stop).await.unwrap();
    let on_board = files::read(&read).unwrap().0;
    assert_eq!(gaware_mission::compare::differences(Firmware::Px4, &mission(24), &on_board), vec![]);
    assert!(!folder.file("mission-transfer-system1-0100000152505541.journal").exists());
    stop.cancel();
}

/// The document of a transfer by the program itself, and its exit status.
async fn document(args: &[&str]) -> (serde_json::Value, Option<i32>) {
    let args: Vec<String> = args.iter().map(|a| (*a).to_owned()).collect();
    let run = move || support::gaware(&args.iter().map(String::as_str).collect::<Vec<_>>());
    let ended = tokio::task::spawn_blocking(run).await.unwrap();
    (ended.json(), ended.code())
}

#[tokio::test(flavor = "multi_thread")]
async fn machines_read_in_a_document_what_is_on_the_vehicle() {
    let (folder, stop) = (Folder::new("json"), CancellationToken::new());
    let address = vehicle("tcpin:127.0.0.1:0", Flavour::ArduPilot, LinkFaults::default(), &stop).await;
    let name = |path: &Path| path.to_str().unwrap().to_owned();
    let (first, backup) = (name(&folder.mission("first.waypoints", 3)), name(&folder.file("b1.plan")));
    let link = ["--connect", &address, "--json"];
    let (told, code) =
        document(&[&["mission", "upload", &first, "--backup", &backup], &link[..]].concat()).await;
    assert_eq!((told["schema"].as_str(), code), (Some("gaware.mission/1"), Some(0)), "{told:#}");
    assert_eq!((&told["action"], &told["on_vehicle"]), (&"upload".into(), &"new".into()));
    assert_eq!((&told["items"], &told["backup"]), (&4.into(), &backup.as_str().into()));
    let mut wrong = mission(4);
    wrong.items[2].command = 31_010;
    let refused = folder.file("wrong.waypoints");
    std::fs::write(&refused, waypoints::write(&wrong)).unwrap();
    let (refused, second) = (name(&refused), name(&folder.file("b2.plan")));
    let (told, code) =
        document(&[&["mission", "upload", &refused, "--backup", &second], &link[..]].concat()).await;
    assert_eq!((&told["done"], code), (&false.into(), Some(1)), "{told:#}");
    assert_eq!((&told["on_vehicle"], &told["items"]), (&"previous".into(), &4.into()), "{told:#}");
    let read = name(&folder.file("read.plan"));
    let (told, code) = document(&[&["mission", "download", &read], &link[..]].concat()).await;
    assert_eq!((&told["file"], code), (&read.as_str().into(), Some(0)), "{told:#}");
    assert_eq!((&told["items"], &told["on_vehicle"]), (&4.into(), &"unchanged".into()));
    let third = name(&folder.file("b3.plan"));
    let (told, code) =
        document(&[&["mission", "restore", &second, "--backup", &third], &link[..]].concat()).await;
    assert_eq!(
        (&told["action"], &told["done"], code),
        (&"restore".into(), &true.into(), Some(0)),
        "{told:#}"
    );
    stop.cancel();
}

const TOKEN: &str = "fly-the-steep-turn";

/// A run beside the vehicle, with a planned mission and its page; the page's address.
fn run_with_page(link: &str, mission: &Path) -> (Gaware, String) {
    let mission = mission.to_str().unwrap();
    let companion = Gaware::start(&[
        "run",
        "--connect",
        link,
        "--no-record",
        "--headless",
        "--web",
        "127.0.0.1:0",
        "--web-token",
        TOKEN,
        "--mission",
        mission,
    ]);
    let line = companion.line_with("web page: http://");
    let page = line.split("//").nth(1).unwrap().split('/').next().unwrap().to_owned();
    (companion, page)
}

/// Asks the page to upload; status and message.
async fn ask(page: &str, token: Option<&str>, body: &str) -> (u16, String) {
    post(page, "/api/v1/mission/upload", token, body).await
}

/// Asks the page for this until it is so.
async fn page_says(page: &str, path: &str, so: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
    let request = format!(
        "GET {path} HTTP/1.1\r\nHost: {page}\r\nAuthorization: Bearer {TOKEN}\r\nConnection: close\r\n\r\n"
    );
    loop {
        let (status, body) = exchange(page, &request).await;
        assert_eq!(status, 200, "{body}");
        let said = serde_json::from_str(&body).unwrap();
        if so(&said) {
            return said;
        }
    }
}

/// Waits until the companion has an inertial sample: a run that ends without any is none.
async fn estimating(page: &str) {
    page_says(page, "/api/v1/status", |s| s["imu"]["samples"].as_u64().unwrap() > 0).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_after_an_upload_sees_that_its_mission_is_on_the_vehicle() {
    for (name, flavour) in [("seen-ap", Flavour::ArduPilot), ("seen-px4", Flavour::Px4)] {
        let (folder, stop) = (Folder::new(name), CancellationToken::new());
        let address = vehicle("udpin:127.0.0.1:0", flavour, LinkFaults::default(), &stop).await;
        let planned = folder.mission("planned.waypoints", 6);
        upload(&put(&address, planned.clone(), folder.file("b1.plan")), &stop, |_| ()).await.unwrap();
        for (mission, state, words) in [
            (planned, "on_vehicle", "planned.waypoints is on the vehicle: read and compared"),
            (folder.mission("other.waypoints", 5), "ready", "on the vehicle is another mission of 7 items"),
        ] {
            let (companion, page) = run_with_page(&address, &mission);
            let looked =
                |s: &serde_json::Value| s["mission"]["text"].as_str().unwrap().contains("on the vehicle");
            let said = page_says(&page, "/api/v1/sinks", looked).await;
            assert_eq!(said["mission"]["state"], state, "{said:#}");
            assert!(said["mission"]["text"].as_str().unwrap().contains(words), "{said:#}");
            estimating(&page).await;
            companion.terminate();
            assert_eq!(companion.ended().code(), Some(0));
        }
        stop.cancel();
    }
}

/// Asks until the companion has heard the vehicle.
async fn upload_from(page: &str) -> (u16, String) {
    loop {
        let (status, message) = ask(page, Some(TOKEN), "{\"confirm\": true}").await;
        if !message.contains("not heard") {
            return (status, message);
        }
    }
}

async fn on_board(folder: &Folder, address: &str, stop: &CancellationToken) -> Mission {
    let read = folder.file("on-board.plan");
    let _ = std::fs::remove_file(&read);
    download(&get(address, read.clone()), stop).await.unwrap();
    files::read(&read).unwrap().0
}

#[tokio::test(flavor = "multi_thread")]
async fn the_page_uploads_with_token_and_confirmation_only_and_keeps_the_mission_before() {
    for (name, flavour) in [("page-ap", Flavour::ArduPilot), ("page-px4", Flavour::Px4)] {
        let (folder, stop) = (Folder::new(name), CancellationToken::new());
        let address = vehicle("udpin:127.0.0.1:0", flavour, LinkFaults::default(), &stop).await;
        let first = folder.mission("first.waypoints", 2);
        upload(&put(&address, first, folder.file("b1.plan")), &stop, |_| ()).await.unwrap();
        let planned = folder.file("planned.plan");
        let center = LatLon { lat_deg: 47.4, lon_deg: 8.545 };
        let circle = FenceCircle { inclusion: true, center, radius_m: 2500.0 };
        let fence = Fence { circles: vec![circle], ..Fence::default() };
        let firmware = if flavour == Flavour::Px4 { Firmware::Px4 } else { Firmware::ArduPilot };
        let contents = files::Contents { mission: mission(6), fence, ..files::Contents::default() };
        std::fs::write(&planned, files::text_of(&planned, &contents, firmware, 2).unwrap()).unwrap();
        let (companion, page) = run_with_page(&address, &planned);
        assert_eq!(ask(&page, None, "{\"confirm\": true}").await.0, 401);
        assert_eq!(ask(&page, Some("not-the-token"), "{\"confirm\": true}").await.0, 401);
        assert_eq!(ask(&page, Some(TOKEN), "{}").await.0, 400);
        let (status, message) = upload_from(&page).await;
        assert_eq!(status, 200, "{message}");
        assert!(message.contains("7 items is on the vehicle, read back and compared"), "{message}");
        assert!(message.contains("its geofence (1 circle) too"), "{message}");
        estimating(&page).await;
        companion.terminate();
        assert_eq!(companion.ended().code(), Some(0));
        assert_eq!(on_board(&folder, &address, &stop).await.items.len(), 7);
        let backup = std::fs::read_dir(&folder.0).unwrap().map(|e| e.unwrap().path());
        let backup: Vec<_> = backup.filter(|p| p.to_str().unwrap().contains("mission-backup-")).collect();
        assert_eq!(backup.len(), 1);
        assert_eq!(files::read(&backup[0]).unwrap().0.items.len(), 3);
        stop.cancel();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_page_refuses_while_a_mission_is_flown_and_leaves_what_is_on_board() {
    let (folder, stop) = (Folder::new("page-flying"), CancellationToken::new());
    let address = vehicle("udpin:127.0.0.1:0", Flavour::ArduPilot, LinkFaults::default(), &stop).await;
    let first = folder.mission("first.waypoints", 3);
    upload(&put(&address, first, folder.file("b1.plan")), &stop, |_| ()).await.unwrap();
    fly(address.strip_prefix("udpout:").unwrap()).await;
    let (companion, page) = run_with_page(&address, &folder.mission("planned.waypoints", 6));
    let (status, message) = upload_from(&page).await;
    assert_eq!(status, 409, "{message}");
    assert!(message.contains("the vehicle is flying a mission"), "{message}");
    estimating(&page).await;
    // The simulated vehicle answers whoever spoke last.
    companion.terminate();
    assert_eq!(companion.ended().code(), Some(0));
    assert_eq!(on_board(&folder, &address, &stop).await.items.len(), 4);
    stop.cancel();
}

/// The pilot's station arms and starts the mission; returns when the vehicle says that it flies it.
async fn fly(vehicle: &str) {
    use gaware::link::frame::{Frame, Sender};
    use gaware::mission_link::vehicle::Vehicle;
    use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
    let socket = tokio::net::UdpSocket::bind("127.0.0.1:0").await.unwrap();
    socket.connect(vehicle).await.unwrap();
    let pilot = Sender { system_id: 255, component_id: 190 };
    let flies = async {
        loop {
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
                let frame = Frame::encode(pilot, 0, &MavMessage::COMMAND_LONG(data));
                socket.send(frame.raw()).await.unwrap();
            }
            let mut datagram = vec![0; 2048];
            let n = socket.recv(&mut datagram).await.unwrap();
            datagram.truncate(n);
            let frame = Frame::parse(datagram.into()).ok();
            if frame.and_then(|f| Vehicle::from_heartbeat(&f)).is_some_and(|v| v.state.flying_mission) {
                return;
            }
        }
    };
    tokio::time::timeout(support::PATIENCE, flies).await.unwrap();
}

/// `MISSION_ITEM_INT`.
const ITEM_INT: [u8; 3] = [73, 0, 0];

/// A wire to a TCP vehicle that breaks once so many items have gone up, and comes back when it is told to.
async fn breakable(vehicle: &str, items: usize) -> (String, watch::Receiver<bool>, watch::Sender<bool>) {
    let vehicle = vehicle.strip_prefix("tcpout:").unwrap().to_owned();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("tcpout:{}", listener.local_addr().unwrap());
    let (broken, seen) = watch::channel(false);
    let (mend, mut mended) = watch::channel(false);
    tokio::spawn(async move {
        let mut left = items;
        loop {
            let (station, _) = listener.accept().await.unwrap();
            let vehicle = TcpStream::connect(&vehicle).await.unwrap();
            carry(station, vehicle, &mut left).await;
            broken.send_replace(true);
            if mended.wait_for(|m| *m).await.is_err() {
                return;
            }
        }
    });
    (address, seen, mend)
}

/// Until somebody closes, or the last of these items went up.
async fn carry(station: TcpStream, vehicle: TcpStream, left: &mut usize) {
    let (mut from_station, mut to_station) = station.into_split();
    let (mut from_vehicle, mut to_vehicle) = vehicle.into_split();
    let up = async {
        let mut waiting = Vec::new();
        while from_station.read_buf(&mut waiting).await.unwrap_or(0) > 0 {
            while let Some(length) =
                waiting.get(1).map(|n| 12 + usize::from(*n)).filter(|n| waiting.len() >= *n)
            {
                let frame: Vec<u8> = waiting.drain(..length).collect();
                if frame[7..10] == ITEM_INT {
                    *left = left.wrapping_sub(1);
                    if *left == 0 {
                        return;
                    }
                }
                to_vehicle.write_all(&frame).await.unwrap();
            }
        }
    };
    tokio::select! {
        () = up => {}
        _ = tokio::io::copy(&mut from_vehicle, &mut to_station) => {}
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_broken_wire_has_left_is_settled_when_it_is_back() {
    let mut tests = Vec::new();
    for flavour in [Flavour::ArduPilot, Flavour::Px4] {
        for gives_up in [false, true] {
            tests.push(tokio::spawn(broken_wire(flavour, gives_up)));
        }
    }
    for test in tests {
        test.await.unwrap();
    }
}

/// With or without a user who gives up while the wire is broken.
async fn broken_wire(flavour: Flavour, gives_up: bool) {
    let (folder, stop) = (Folder::new(&format!("broken-{flavour:?}-{gives_up}")), CancellationToken::new());
    let address = vehicle("tcpin:127.0.0.1:0", flavour, LinkFaults::default(), &stop).await;
    let first = folder.mission("first.waypoints", 3);
    upload(&put(&address, first, folder.file("b1.plan")), &stop, |_| ()).await.unwrap();
    let (through, mut broken, mend) = breakable(&address, 6).await;
    let enough = CancellationToken::new();
    let user = tokio::spawn({
        let enough = enough.clone();
        async move {
            broken.wait_for(|b| *b).await.unwrap();
            if gives_up {
                enough.cancel();
            }
        }
    });
    let second = put(&through, folder.mission("second.waypoints", 12), folder.file("b2.plan"));
    let result = upload(&second, &enough, |text| {
        // Only once it wants to know what is left.
        if text == "reading back" {
            mend.send_replace(true);
        }
    });
    let result = tokio::time::timeout(support::PATIENCE, result).await.unwrap();
    user.await.unwrap();
    let (told, items) = match result {
        Ok(told) if !gives_up => (told.text, 13),
        Err(error) if gives_up => (error.to_string(), 4),
        other => panic!("{flavour:?} {gives_up}: {other:?}"),
    };
    assert_eq!(told.contains("the previous mission is on the vehicle"), gives_up, "{told}");
    assert_eq!(on_board(&folder, &address, &stop).await.items.len(), items);
    stop.cancel();
}
