//! `gaware mission` against the simulated autopilot over real sockets.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use gaware::commands::mission::{LinkArgs, UploadArgs, download, upload};
use gaware::mission_link::files;
use gaware_mission::files::waypoints;
use gaware_mission::item::{Autopilot as Firmware, Home, LatLon, Mission, MissionItem, command};
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::scenario::scenario;
use gaware_sitl::shell::{Options, Server, Speed};
use std::path::PathBuf;
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
    LinkArgs { connect: vec![address.parse().unwrap()], file, vehicle: None, patience: 20 }
}

fn put(address: &str, file: PathBuf, backup: PathBuf) -> UploadArgs {
    UploadArgs { link: link(address, file), backup: Some(backup), even_while_flying: false }
}

/// Upload, upload another, look at the backup, restore it, download and compare.
async fn round_trip(name: &str, endpoint: &str, flavour: Flavour, faults: LinkFaults) {
    let (folder, stop) = (Folder::new(name), CancellationToken::new());
    let address = vehicle(endpoint, flavour, faults, &stop).await;
    let (first, second) = (folder.mission("first.waypoints", 3), folder.mission("second.waypoints", 5));
    let told = upload(&put(&address, first, folder.file("b1.plan")), &stop, |_| ()).await.unwrap();
    assert!(told.contains("4 items is on the vehicle"), "{told}");
    let backup = folder.file("b2.plan");
    upload(&put(&address, second, backup.clone()), &stop, |_| ()).await.unwrap();
    assert_eq!(files::read(&backup).unwrap().0.items.len(), 4);
    upload(&put(&address, backup, folder.file("b3.plan")), &stop, |_| ()).await.unwrap();
    let read = folder.file("read.plan");
    download(&link(&address, read.clone()), &stop).await.unwrap();
    let on_board = files::read(&read).unwrap().0;
    let firmware = match flavour {
        Flavour::ArduPilot => Firmware::ArduPilot,
        Flavour::Px4 => Firmware::Px4,
    };
    assert_eq!(gaware_mission::compare::differences(firmware, &mission(3), &on_board), vec![]);
    // A file that is there is not overwritten.
    assert!(download(&link(&address, read), &stop).await.unwrap_err().to_string().contains("cannot write"));
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
    download(&link(&address, read.clone()), &stop).await.unwrap();
    assert_eq!(files::read(&read).unwrap().0.items.len(), 3);
    stop.cancel();
}
