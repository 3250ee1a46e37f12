//! A small campaign: two vehicles of each kind, the faults that a flight day brings.

use super::*;
use gaware::parallel::Silent;

fn campaign(faults: &[&str]) -> Faults {
    let faults = faults.iter().map(|f| (*f).to_owned()).collect();
    run(&Settings { seeds: 2, seed: 1, faults }, &Silent).unwrap()
}

fn named<'a>(all: &'a Faults, name: &str) -> &'a FaultResult {
    all.faults.iter().find(|f| f.fault == name).unwrap_or_else(|| panic!("{name} was not flown"))
}

#[test]
fn an_unknown_fault_is_answered_with_the_known_ones() {
    let asked = Settings { seeds: 1, seed: 1, faults: vec!["gremlins".into()] };
    let said = run(&asked, &Silent).unwrap_err().to_string();
    assert!(said.contains("no fault is called gremlins") && said.contains("gnss-jump-500m"), "{said}");
}

#[test]
fn faults_of_the_link_are_survived_reported_and_leave_the_sigmas_true() {
    let all = campaign(&["loss-20", "jitter-2s", "bit-errors", "silence-60s", "flood-20x"]);
    assert_eq!(all.failures(), Vec::<String>::new());
    assert!(named(&all, "loss-20").lost.frames > 500.0);
    assert!(named(&all, "silence-60s").lost.gaps_s > 58.0);
    // Late frames are no reboot, also where two inertial messages come side by side.
    assert_eq!(named(&all, "jitter-2s").lost.restarts, 0.0, "{:?}", named(&all, "jitter-2s").lost);
}

#[test]
fn few_samples_a_range_that_is_exceeded_and_a_deceived_receiver_leave_the_sigmas_true() {
    let all = campaign(&["rate-tenth", "clipped", "spoof-2m/s"]);
    assert_eq!(all.failures(), Vec::<String>::new());
}

#[test]
fn faults_of_clocks_and_sensors_are_survived_reported_and_leave_the_sigmas_true() {
    let all =
        campaign(&["reboot", "clock-and-back-0.5s", "wrap-32-bit", "samples-behind", "frozen", "gnss-jump"]);
    assert_eq!(all.failures(), Vec::<String>::new());
    // A wrong position is taken over only after half a minute, and the sensors' constants do not follow it.
    let jump = named(&all, "gnss-jump-500m");
    assert!(jump.shown.iter().any(|s| s.text.contains("GNSS position jump") && s.after_s <= 2.0), "{jump:?}");
}
