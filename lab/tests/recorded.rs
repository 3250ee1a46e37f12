//! Accuracy on flights with an independent truth.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests panic")]

use gaware_lab::recorded;
use std::path::PathBuf;

/// By how much a figure may get worse before somebody has to look, above those that stand in [`CSV_SETS`].
const CSV_SLACK: f64 = 1.05;
/// Position N/E/D m, velocity m/s, roll/pitch/yaw deg, as they were when last looked at.
const CSV_SETS: [(&str, [[f64; 3]; 3]); 2] = [("qdr", QDR), ("sim_thor", SIM_THOR)];
const QDR: [[f64; 3]; 3] = [[0.396, 0.486, 0.953], [0.107, 0.138, 0.091], [0.759, 0.562, 1.791]];
const SIM_THOR: [[f64; 3]; 3] = [[0.206, 0.227, 0.207], [0.040, 0.037, 0.020], [0.086, 0.057, 0.137]];

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn the_sets_with_independent_truth_are_as_accurate_as_before() {
    let folder =
        PathBuf::from(std::env::var_os("GAWARE_FLIGHTS").expect("GAWARE_FLIGHTS names their folder"));
    for (name, bounds) in CSV_SETS {
        let setup = recorded::setup(name).unwrap();
        let flight = recorded::CsvFlight::read(&folder.join(setup.folder), setup.fixes).unwrap();
        let result = recorded::run(&flight, &setup);
        let found = [result.position_rms_m, result.velocity_rms_m_per_s, result.attitude_rms_deg];
        println!("{name}: {found:.3?}, best of the others {:?}", result.best_of_others);
        for (ours, bound) in found.iter().flatten().zip(bounds.iter().flatten()) {
            assert!(*ours <= CSV_SLACK * bound, "{name}: {ours} against {bound}");
        }
        // The errors of a flight hang together: one draw may well lie above the sigmas, but not by twice.
        for (ours, sigma) in found.iter().flatten().zip(result.own_sigma.iter().flatten()) {
            assert!(*ours <= 2.0 * sigma, "{name}: {ours}, expected {sigma}");
        }
    }
}
