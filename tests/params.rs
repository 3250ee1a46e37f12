//! `gaware params` against the simulated autopilot over real sockets, in both dialects.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::scenario::scenario;
use gaware_sitl::shell::{Options, Server, Speed};
use serde_json::Value;
use support::{Ended, Folder, Gaware, page};
use tokio_util::sync::CancellationToken;

/// A simulated vehicle; the address to connect to.
async fn vehicle(
    playing: &str,
    endpoint: &str,
    flavour: Flavour,
    faults: LinkFaults,
    stop: &CancellationToken,
) -> String {
    // An analytic flight is armed as soon as it does not wait for a station.
    let config = AutopilotConfig { flavour, wait_for_station: false, ..AutopilotConfig::default() };
    let autopilot = Autopilot::playing(config, &scenario(playing).unwrap());
    let server = Server::bind(&endpoint.parse().unwrap()).await.unwrap();
    let address = server.address().to_owned();
    let options = Options { link_faults: faults, speed: Speed::Times(1.0), ..Options::default() };
    let stop = stop.clone();
    tokio::spawn(async move { server.run(autopilot, options, stop).await });
    address
}

async fn params(args: &[&str]) -> Ended {
    let args: Vec<String> = ["params"].iter().chain(args).map(|a| (*a).to_owned()).collect();
    let run = move || support::gaware(&args.iter().map(String::as_str).collect::<Vec<_>>());
    tokio::task::spawn_blocking(run).await.unwrap()
}

fn file(folder: &Folder, name: &str, text: &str) -> String {
    let path = folder.file(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// The value of a parameter as the vehicle shows it.
async fn on_board(address: &str, name: &str) -> Option<f64> {
    let shown = params(&["show", "--all", "--connect", address, "--json"]).await;
    assert_eq!(shown.code(), Some(0), "{}", shown.stderr);
    let document = shown.json();
    let all = document["parameters"].as_array().unwrap();
    all.iter().find(|p| p["name"] == name).and_then(|p| p["value"].as_f64())
}

/// Apply, look at the vehicle and the backup, restore the backup, look again.
async fn round_trip(
    test: &str,
    flavour: Flavour,
    endpoint: &str,
    faults: LinkFaults,
    delay: &str,
    place: &str,
) {
    let (folder, stop) = (Folder::new(test), CancellationToken::new());
    let address = vehicle("mission_multirotor", endpoint, flavour, faults, &stop).await;
    let all = folder.file("all.param");
    let read = params(&["backup", "--connect", &address, &all, "--json"]).await;
    assert_eq!(read.code(), Some(0), "{}", read.stderr);
    let (before, whole) = (read.json(), std::fs::read_to_string(&all).unwrap());
    assert!(whole.contains(delay) && before["count"].as_u64().unwrap() > 15, "{whole}");
    let old = on_board(&address, delay).await.unwrap();
    let advice = match flavour {
        Flavour::ArduPilot => format!("# for vehicle: ArduPilot multirotor\n{delay},96\n{place},0.31\n"),
        Flavour::Px4 => {
            format!("# for vehicle: PX4 multirotor\n1\t1\t{delay}\t96\t9\n1\t1\t{place}\t0.31\t9\n")
        }
    };
    let (advice, backup) = (file(&folder, "advice.param", &advice), folder.file("backup.param"));
    let applied =
        params(&["apply", "--yes", "--connect", &address, &advice, "--backup", &backup, "--json"]).await;
    let document = applied.json();
    // What changes is said even where nobody is asked.
    let change = format!("{place}: 0 → 0.31");
    assert!(applied.stderr.contains(&change), "{}", applied.stderr);
    assert_eq!((applied.code(), &document["changed"]), (Some(0), &Value::from(2)), "{document:#}");
    assert_eq!((&document["on_vehicle"], &document["reboot_due"]), (&"new".into(), &true.into()));
    assert!(
        document["text"].as_str().unwrap().contains(&format!("{delay} counts only after it")),
        "{document:#}"
    );
    assert_eq!(on_board(&address, delay).await, Some(96.0));
    assert_eq!(on_board(&address, place).await, Some(0.31));
    // A file that is there is not overwritten.
    let again = params(&["apply", "--yes", "--connect", &address, &advice, "--backup", &backup]).await;
    assert!(again.code() == Some(1) && again.stderr.contains("cannot write"), "{}", again.stderr);
    let second = folder.file("second.param");
    let restored = params(&["restore", "--connect", &address, &backup, "--backup", &second]).await;
    assert_eq!(restored.code(), Some(0), "{}{}", restored.stdout, restored.stderr);
    assert_eq!((on_board(&address, delay).await, on_board(&address, place).await), (Some(old), Some(0.0)));
    // All of it is as before: the same file, and on PX4 the same hash.
    let last = folder.file("last.param");
    let read = params(&["backup", "--connect", &address, &last, "--json"]).await.json();
    assert_eq!(std::fs::read_to_string(&last).unwrap(), whole);
    assert_eq!((&read["hash"], read["hash"].is_u64()), (&before["hash"], flavour == Flavour::Px4));
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn parameters_of_ardupilot_are_changed_and_put_back_over_tcp() {
    let none = LinkFaults::default();
    round_trip("params-ap", Flavour::ArduPilot, "tcpin:127.0.0.1:0", none, "GPS1_DELAY_MS", "GPS1_POS_X")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn parameters_of_px4_are_changed_and_put_back_over_a_link_that_loses_a_fifth() {
    let bad = LinkFaults { loss: 0.2, delay_s: 0.01, ..LinkFaults::default() };
    round_trip("params-px4", Flavour::Px4, "udpin:127.0.0.1:0", bad, "EKF2_GPS_DELAY", "EKF2_GPS_POS_X")
        .await;
}

const TOKEN: &str = "set-the-delay";

/// Asks the page until the companion has heard the vehicle.
async fn set_from(page: &str) -> (u16, String) {
    loop {
        let asked = page::post(page, "/api/v1/parameters/apply", Some(TOKEN), "{\"confirm\": true}").await;
        if !asked.1.contains("not heard") {
            return asked;
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_page_sets_parameters_with_token_and_confirmation_only_and_keeps_the_values_before() {
    for (name, flavour, delay) in [
        ("params-page-ap", Flavour::ArduPilot, "GPS1_DELAY_MS"),
        ("params-page-px4", Flavour::Px4, "EKF2_GPS_DELAY"),
    ] {
        let (folder, stop) = (Folder::new(name), CancellationToken::new());
        let none = LinkFaults::default();
        let address = vehicle("mission_multirotor", "udpin:127.0.0.1:0", flavour, none, &stop).await;
        let old = on_board(&address, delay).await.unwrap();
        let wanted = file(&folder, "wanted.param", &format!("{delay},96\n"));
        let link = ["run", "--connect", &address, "--no-record", "--headless", "--web", "127.0.0.1:0"];
        let companion = Gaware::start(&[&link[..], &["--web-token", TOKEN, "--params", &wanted]].concat());
        let line = companion.line_with("web page: http://");
        let page = line.split("//").nth(1).unwrap().split('/').next().unwrap().to_owned();
        let path = "/api/v1/parameters/apply";
        assert_eq!(page::post(&page, path, None, "{\"confirm\": true}").await.0, 401);
        assert_eq!(page::post(&page, path, Some(TOKEN), "{\"confirm\": false}").await.0, 400);
        let mission = page::post(&page, "/api/v1/mission/upload", Some(TOKEN), "{\"confirm\": true}").await;
        assert!(mission.0 == 409, "{mission:?}");
        assert_eq!(on_board(&address, delay).await, Some(old), "it was not confirmed");
        let (status, text) = set_from(&page).await;
        assert_eq!(status, 200, "{text}");
        assert!(text.contains("reboot of the autopilot is due"), "{text}");
        assert_eq!(on_board(&address, delay).await, Some(96.0));
        let mut kept = std::fs::read_dir(folder.file(".")).unwrap().filter_map(|e| {
            let path = e.unwrap().path();
            path.to_str().unwrap().contains("params-backup-").then(|| std::fs::read_to_string(path).unwrap())
        });
        let kept = kept.next().unwrap();
        assert!(kept.contains(delay), "{kept}");
        companion.terminate();
        companion.ended();
        stop.cancel();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_files_are_refused_with_a_sentence_and_nothing_is_changed() {
    let (folder, stop) = (Folder::new("params-bad"), CancellationToken::new());
    let none = LinkFaults::default();
    let address = vehicle("mission_multirotor", "tcpin:127.0.0.1:0", Flavour::ArduPilot, none, &stop).await;
    let whole = folder.file("before.param");
    let kept = params(&["backup", "--connect", &address, &whole]).await;
    assert_eq!(kept.code(), Some(0), "{}", kept.stderr);
    assert!(!kept.stderr.lines().any(|l| l.starts_with("0 of ")), "counted back: {}", kept.stderr);
    for (k, (text, said)) in [
        ("NO_SUCH,1\nGPS1_POS_X,0.3\n", "does not answer for NO_SUCH"),
        (
            "GPS1_POS_X,0.3\nGPS1_DELAY_MS,334\n",
            "GPS1_DELAY_MS is to be 334; its documented range is 0 to 250",
        ),
        ("GPS1_POS_X,0.3\nGPS2_TYPE,300\n", "300 is no value of GPS2_TYPE, which is of type int8"),
        ("1\t1\tGPS1_POS_X\t1\t6\n", "of type float on the vehicle and of type int32 in the file"),
        ("GPS1_POS_X,0.3\nSTAT_BOOTCNT,1\n", "STAT_BOOTCNT reads 7 after it was set to 1"),
        ("# for vehicle: PX4\nGPS1_POS_X,0.3\n", "is for PX4; this is ArduPilot"),
        (
            "# for vehicle: ArduPilot fixed_wing\nGPS1_POS_X,0.3\n",
            "is for a fixed wing; this is a multirotor",
        ),
        ("GPS1_POS_X,nan\n", "line 1: the value of GPS1_POS_X is not a finite number"),
        ("{\"no\": 1}\n", "is no name of a parameter"),
        ("hello\n", "is neither NAME,VALUE"),
    ]
    .into_iter()
    .enumerate()
    {
        let (path, backup) =
            (file(&folder, &format!("{k}.param"), text), folder.file(&format!("{k}.backup")));
        let ended = params(&["apply", "--yes", "--connect", &address, &path, "--backup", &backup]).await;
        assert_eq!(ended.code(), Some(1), "{text}: {}", ended.stdout);
        assert!(ended.stderr.contains(said), "{text}: {}", ended.stderr);
    }
    let after = folder.file("after.param");
    assert_eq!(params(&["backup", "--connect", &address, &after]).await.code(), Some(0));
    assert_eq!(std::fs::read_to_string(&after).unwrap(), std::fs::read_to_string(&whole).unwrap());
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn an_armed_vehicle_is_refused() {
    let (folder, stop) = (Folder::new("params-armed"), CancellationToken::new());
    let none = LinkFaults::default();
    let address = vehicle("fixed_wing", "tcpin:127.0.0.1:0", Flavour::ArduPilot, none, &stop).await;
    let path = file(&folder, "a.param", "GPS1_POS_X,0.3\n");
    let backup = folder.file("backup.param");
    let ended = params(&["apply", "--yes", "--connect", &address, &path, "--backup", &backup]).await;
    assert!(ended.code() == Some(1) && ended.stderr.contains("the vehicle is armed"), "{}", ended.stderr);
    assert!(!std::path::Path::new(&backup).exists());
    stop.cancel();
}

/// A file of an explanation says where its values come from; without a terminal and without --yes nothing is set.
#[tokio::test(flavor = "multi_thread")]
async fn a_change_shows_what_it_replaces_and_is_not_made_without_a_yes() {
    let (folder, stop) = (Folder::new("params-asks"), CancellationToken::new());
    let fast = LinkFaults::default();
    let address = vehicle("mission_multirotor", "tcpin:127.0.0.1:0", Flavour::ArduPilot, fast, &stop).await;
    let text = "# from: gaware explain of a.tlog; verdict: explained; ArduPilot 4.6\n# for vehicle: ArduPilot\nGPS1_DELAY_MS,96\n";
    let (advice, backup) = (file(&folder, "advice.param", text), folder.file("backup.param"));
    let ended = params(&["apply", "--connect", &address, &advice, "--backup", &backup]).await;
    assert_eq!(ended.code(), Some(2), "{}", ended.stderr);
    for said in
        ["gaware explain of a.tlog; verdict: explained", "GPS1_DELAY_MS: 0 → 96 ms", "no terminal", "--yes"]
    {
        assert!(ended.stderr.contains(said), "{said}: {}", ended.stderr);
    }
    assert_eq!(on_board(&address, "GPS1_DELAY_MS").await, Some(0.0));
    // What flew is another vehicle.
    let other = file(&folder, "other.param", "# for vehicle: ArduPilot uid=00ff\nGPS1_DELAY_MS,96\n");
    let ended = params(&["apply", "--yes", "--connect", &address, &other, "--backup", &backup]).await;
    assert!(ended.code() == Some(1) && ended.stderr.contains("hardware id 00ff"), "{}", ended.stderr);
    assert_eq!(on_board(&address, "GPS1_DELAY_MS").await, Some(0.0));
    stop.cancel();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_change_is_taken_up_and_the_old_values_put_back() {
    let (folder, stop) = (Folder::new("params-killed"), CancellationToken::new());
    let slow = LinkFaults { delay_s: 0.1, ..LinkFaults::default() };
    let address = vehicle("mission_multirotor", "tcpin:127.0.0.1:0", Flavour::ArduPilot, slow, &stop).await;
    let text = "GPS1_DELAY_MS,96\nGPS1_POS_X,0.31\nGPS1_POS_Y,0.32\nGPS1_POS_Z,0.33\nINS_POS1_X,0.1\nINS_POS1_Y,0.1\n";
    let (advice, backup) = (file(&folder, "advice.param", text), folder.file("backup.param"));
    let command =
        Gaware::start(&["params", "apply", "--yes", "--connect", &address, &advice, "--backup", &backup]);
    tokio::task::spawn_blocking(move || {
        command.line_with("setting");
        command.kill();
    })
    .await
    .unwrap();
    // Nothing goes over it before that is settled.
    let other = folder.file("other.param");
    let refused = params(&["apply", "--yes", "--connect", &address, &advice, "--backup", &other]).await;
    assert!(refused.stderr.contains("gaware params restore"), "{}", refused.stderr);
    let journal = folder.file("parameter-change-system1-0100000152505541.journal");
    // A value that the vehicle does not give is not known to be one of ours: nothing is written over it unasked.
    let whole = std::fs::read_to_string(&journal).unwrap();
    std::fs::write(&journal, whole.replace("INS_POS1_Y", "INS_POS9_Y")).unwrap();
    let unknown = params(&["restore", "--connect", &address, &journal]).await;
    let said = "INS_POS9_Y without an answer (old 0, new 0.1)";
    assert!(unknown.code() == Some(1) && unknown.stderr.contains(said), "{}", unknown.stderr);
    std::fs::write(&journal, whole).unwrap();
    let ended = params(&["restore", "--connect", &address, &journal]).await;
    assert_eq!(ended.code(), Some(0), "{}{}", ended.stdout, ended.stderr);
    assert!(ended.stdout.contains("the old values of 6 parameters are on the vehicle"), "{}", ended.stdout);
    assert!(!std::path::Path::new(&journal).exists());
    assert_eq!(on_board(&address, "GPS1_DELAY_MS").await, Some(0.0));
    assert_eq!(on_board(&address, "INS_POS1_Y").await, Some(0.0));
    stop.cancel();
}
