//! One loop per effect and dialect; `gaware study loop` runs many.

use super::*;
use crate::demo::Settings;
use gaware_mission::airframe::Airframe;

/// Time for the maneuvers, s: enough turns and speed changes for these effects.
const BUDGET_S: f64 = 200.0;

fn prepared(firmware: Firmware) -> Prepared {
    let mut airframe = Airframe::example("small_fixed_wing").unwrap();
    airframe.autopilot = firmware;
    Prepared::new(Settings::new(airframe, Some(BUDGET_S))).unwrap()
}

#[test]
fn a_hidden_delay_is_explained_applied_and_the_autopilots_own_innovations_become_smaller() {
    for firmware in [Firmware::ArduPilot, Firmware::Px4] {
        let done = run(&prepared(firmware), Correctable::GpsLatency, 3, &|_| ()).unwrap();
        let r = &done.result;
        assert!(r.right_parameter, "{r:?}");
        assert!(r.corrected.iter().all(|c| c.error_sigmas.abs() < 3.5), "{:?}", r.corrected);
        assert_eq!(r.comparison.verdict, crate::compare::Verdict::Smaller, "{}", r.comparison.text);
    }
}
