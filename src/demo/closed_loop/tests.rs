//! Two loops; `gaware study loop` runs many.

use super::*;
use crate::compare::Verdict;
use crate::demo::Settings;
use gaware_mission::airframe::Airframe;

/// Time for the maneuvers, s: enough turns and speed changes for these effects.
const BUDGET_S: f64 = 200.0;

fn done(firmware: Firmware, effect: Correctable, seed: u64) -> LoopResult {
    let mut airframe = Airframe::example("small_fixed_wing").unwrap();
    airframe.autopilot = firmware;
    let prepared = Prepared::new(Settings::new(airframe, Some(BUDGET_S))).unwrap();
    let result = run(&prepared, effect, seed, &|_| ()).unwrap().result;
    assert!(result.right_parameter, "{result:?}");
    assert!(result.corrected.iter().all(|c| c.error_sigmas.abs() < 3.0), "{:?}", result.corrected);
    result
}

#[test]
fn an_antenna_elsewhere_is_explained_and_applied_and_the_autopilots_own_innovations_become_smaller() {
    let result = done(Firmware::ArduPilot, Correctable::GpsLeverArm, 5);
    assert_eq!(result.corrected.iter().filter(|c| c.parameter.starts_with("GPS1_POS")).count(), 3);
    assert_eq!(result.comparison.verdict, Verdict::Smaller, "{}", result.comparison.text);
}

#[test]
fn the_delay_of_fixes_is_found_and_written_in_the_dialect_of_px4() {
    let result = done(Firmware::Px4, Correctable::GpsLatency, 3);
    assert!(result.corrected.iter().any(|c| c.parameter == "EKF2_GPS_DELAY"), "{:?}", result.corrected);
    assert_ne!(result.comparison.verdict, Verdict::Larger, "{}", result.comparison.text);
}
