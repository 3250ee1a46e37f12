//! The page of simulated fleets with known truth, and of names that try to be markup.

use super::*;
use crate::fleet::family::study;
use crate::fleet::family::tests::{flight_of, simulated};

/// The page without its scripts and styles.
fn body(page: &str) -> &str {
    page.split("<body>").nth(1).and_then(|b| b.split("<script").next()).unwrap()
}

#[test]
fn the_first_screen_names_what_was_injected_and_leads_to_its_plot() {
    let logs = simulated(101, true).logs;
    let study = study(&logs);
    let page = html("archive", &logs, &study).unwrap();
    let body = body(&page);
    assert!(
        body.contains("200 flights of 12 inertial units with 3 firmwares: 1 value out of family, 1 shift")
    );
    let at = |name: &str| study.family.parameters.iter().position(|p| p.name == name).unwrap();
    for link in [
        format!("<a href=\"#p{}\" data-mark=\"5\">u05, gyro_g_sensitivity g22</a>: ", at("g22")),
        format!("<a href=\"#p{}\" data-relative=\"1\">gps_latency latency</a>: ", at("latency")),
        format!("<a href=\"#p{}\" data-unit=\"8\">u08, accel_bias ba_z</a>: ", at("ba_z")),
    ] {
        assert!(body.contains(&link), "{link}");
    }
    // Every figure of the result is in a table.
    for p in &study.family.parameters {
        for u in &p.units {
            let constant = with_sigma(u.constant.value, u.constant.sigma).replace(' ', "\u{a0}");
            assert!(body.contains(&constant), "{} {}: {constant}", u.unit, p.name);
        }
    }
    assert!(
        !body.contains("NaN") && !body.contains("inf") && !page.contains("src=") && !page.contains("<link")
    );
}

#[test]
fn names_of_others_stay_text() {
    let mut logs = simulated(101, true).logs;
    let evil = "</script><script>alert(1)</script><img src=x>";
    for log in logs.iter_mut().take(24) {
        log.path = format!("{evil}.tlog");
        let flight = flight_of(log);
        flight.board = flight.board.as_ref().map(|b| format!("{evil}{b}"));
        flight.firmware = Some(evil.to_owned());
        flight.parameters.iter_mut().for_each(|p| p.value += 1e3);
    }
    let mut broken = logs[0].clone();
    broken.result = Err(format!("reason {evil}"));
    logs.push(broken);
    let page = html(evil, &logs, &study(&logs)).unwrap();
    assert!(!page.contains("<script>alert") && !page.contains("<img src=x>"));
    assert!(page.contains("&lt;script&gt;alert(1)") && page.contains("\\u003c/script>"));
}

#[test]
fn a_fleet_without_units_says_what_to_do_and_a_small_one_has_its_figures() {
    let mut logs = simulated(1, false).logs;
    logs.truncate(4);
    let page = html("small", &logs, &study(&logs)).unwrap();
    assert!(body(&page).contains("4 flights of 4 inertial units"), "{}", body(&page));
    logs.iter_mut().for_each(|log| flight_of(log).board = None);
    let page = html("small", &logs, &study(&logs)).unwrap();
    assert!(body(&page).contains("No log names its inertial unit") && !body(&page).contains("<section"));
    assert!(body(&page).contains("Logs that are in no figure above") && body(&page).contains("4 left out"));
    assert_eq!(body(&page).matches("its inertial unit is not known").count(), 4);
    let page = html("none", &[], &study(&[])).unwrap();
    assert!(body(&page).contains("0 logs"));
}

#[test]
fn flights_that_all_have_the_same_date_are_counted() {
    let mut logs = simulated(1, false).logs;
    logs.truncate(24);
    assert!(Axis::new(&logs, &study(&logs)).dated);
    logs.iter_mut().for_each(|log| flight_of(log).start_unix_s = Some(1.75e9));
    assert!(!Axis::new(&logs, &study(&logs)).dated);
    logs.truncate(1);
    assert!(Axis::new(&logs, &study(&logs)).dated, "one flight has a date");
}
