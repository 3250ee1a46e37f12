use super::*;
use gaware_mission::item::{LatLon, MissionItem, command};
use gaware_mission::params::ParamType;

fn vehicle(uid: Option<&str>) -> Identity {
    let uid = uid.map(|u| u.parse().unwrap());
    let home = Some([47.0, 8.0]);
    Identity { uid, autopilot: Autopilot::ArduPilot, mav_type: 2, system_id: 1, component_id: 1, home }
}

fn mission(legs: u32) -> Mission {
    let at = |k: u32| LatLon { lat_deg: 47.0 + f64::from(k) * 1e-3, lon_deg: 8.0 };
    let items = (0..legs).map(|k| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], at(k), 60.0));
    Mission { home: None, items: items.collect() }
}

fn content() -> Content {
    Content::Mission { previous: mission(3), new: mission(5), fences: None }
}

fn values() -> Content {
    let name = "GPS1_DELAY_MS".parse().unwrap();
    Content::Parameters(vec![Pair { name, kind: ParamType::Real32, old: 0.0, new: 120.0 }])
}

fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("gaware-journal-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

#[test]
fn a_journal_blocks_its_own_vehicle_alone() {
    let folder = folder("own");
    for content in [content(), values()] {
        let (a, b) = (vehicle(Some("0a")), vehicle(Some("0b")));
        let kind = content.kind();
        let journal = Journal::begin(&folder, a, content.clone()).unwrap();
        let read = Journal::read(&journal.path).unwrap();
        assert!(read.vehicle == a && read.content.same(&content, a.autopilot), "{read:?}");
        let said = kind.check(&folder, &a).unwrap_err().to_string();
        assert!(said.contains("to this vehicle, system 1 (ArduPilot, quadrotor), hardware id 0a"), "{said}");
        // The same system id, another aircraft.
        kind.check(&folder, &b).unwrap();
        let other = Journal::begin(&folder, b, content).unwrap();
        let said = journal.check_vehicle(&b).unwrap_err();
        assert!(
            said.contains("hardware id 0a, home 47.00000, 8.00000; connected is another vehicle"),
            "{said}"
        );
        assert_eq!(journal.check_vehicle(&a), Ok(None));
        // One that gives no hardware id may be either.
        let said = kind.check(&folder, &vehicle(None)).unwrap_err().to_string();
        assert!(said.contains("which may be this vehicle"), "{said}");
        assert!(journal.check_vehicle(&vehicle(None)).unwrap().is_some());
        other.end().unwrap();
        journal.end().unwrap();
    }
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn journals_of_earlier_versions_are_read_and_say_that_they_name_no_hardware() {
    let folder = folder("old");
    let plan = |m: Mission| plan::document(&PlanFile::new(m, Fence::default(), Autopilot::ArduPilot, 2));
    let old = serde_json::json!({
        "schema": "gaware.transfer/1", "system_id": 1, "autopilot": "ardupilot", "begun_unix_s": 5,
        "with_fence": false, "previous": plan(mission(3)), "new": plan(mission(5))
    });
    let params = serde_json::json!({
        "schema": "gaware.parameter-change/1", "system_id": 1, "autopilot": "ardupilot",
        "parameters": [{"name": "GPS1_DELAY_MS", "kind": 9, "old": 0.0, "new": 120.0}]
    });
    for (name, document, expected) in [
        ("mission-transfer-system1.journal", old, content()),
        ("parameter-change-system1.journal", params, values()),
    ] {
        let path = folder.join(name);
        std::fs::write(&path, document.to_string()).unwrap();
        let journal = Journal::read(&path).unwrap();
        assert!(
            journal.vehicle.uid.is_none() && journal.content.same(&expected, Autopilot::ArduPilot),
            "{journal:?}"
        );
        let here = vehicle(Some("0a"));
        let warning = journal.check_vehicle(&here).unwrap().unwrap();
        assert!(warning.contains("not certain that this is the same vehicle"), "{warning}");
        assert!(expected.kind().check(&folder, &here).is_err(), "it may be about this one");
        let other = Identity { autopilot: Autopilot::Px4, ..here };
        assert!(journal.check_vehicle(&other).is_err());
        // Damage is no reason to forget it.
        std::fs::write(&path, "{}").unwrap();
        assert!(expected.kind().check(&folder, &here).is_err());
    }
    let _ = std::fs::remove_dir_all(&folder);
}
