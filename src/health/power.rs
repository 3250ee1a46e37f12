//! Battery and supply of the board.

use super::HealthLog;
use crate::advice::on_board::OnBoard;
use crate::health::checks::{Finding, Grade, graded_below};
use crate::health::rows::rows;

/// A cell of a lithium battery under load, V: low and empty.
const CELL_V: [f64; 2] = [3.5, 3.3];
/// A full cell, V; one of high voltage.
const FULL_CELL_V: f64 = 4.25;
const FULLEST_CELL_V: f64 = 4.4;
/// Less than this is no battery that is measured, V.
const NO_BATTERY_V: f64 = 2.5;
/// Share of the battery that is left.
const REMAINING: [f64; 2] = [0.2, 0.1];
/// ArduPilot, "Power supply": the board's supply must stay above 4.3 V and vary by less than 0.15 V.
const SUPPLY_V: [f64; 2] = [4.6, 4.3];
/// So long below its limit a battery is low, s (ArduPilot `BATT_LOW_TIMER`).
const LOW_S: f64 = 10.0;

/// Cells in series, and how they are known.
fn cells(log: &HealthLog, board: &OnBoard, highest_v: f64) -> (f64, &'static str) {
    let of = |name: &str| board.get(name).filter(|v| *v > 0.0);
    if let Some(cells) = log.cells.or_else(|| of("BAT1_N_CELLS").or(of("BAT_N_CELLS"))) {
        return (cells, "");
    }
    // The voltage of a full battery, by which the thrust is scaled.
    if let Some(full_v) = of("MOT_BAT_VOLT_MAX") {
        return ((full_v / FULLEST_CELL_V).ceil(), "");
    }
    ((highest_v / FULL_CELL_V).ceil().max(1.0), ", counted by the highest voltage")
}

impl HealthLog {
    /// What battery and supply show in flight.
    pub(super) fn power(&self, board: &OnBoard, in_flight: &dyn Fn(f64) -> bool) -> Vec<Finding> {
        let mut found = Vec::new();
        let flown = |series: &[(u64, (f64, Option<f64>))]| -> Vec<(f64, f64, Option<f64>)> {
            let all = series.iter().map(|(t, (v, r))| (self.s(*t), *v, *r));
            all.filter(|(t, ..)| in_flight(*t)).collect()
        };
        let volts = flown(&self.battery);
        if let Some((t, v, _)) = volts.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
            let highest = self.battery.iter().map(|(_, (v, _))| *v).fold(0.0, f64::max);
            if highest < NO_BATTERY_V {
                let text = format!("the battery is not measured ({v:.2} V): no failsafe can act on it");
                found.push((Grade::Look, Some(*t), text));
            } else {
                let (cells, how) = cells(self, board, highest);
                let cell = v / cells;
                let text =
                    format!("{v:.1} V at least, {cell:.2} V for each of {cells:.0} cells{how}, at {t:.1} s");
                found.push((graded_below(cell, CELL_V), Some(*t), text));
            }
        }
        let limits =
            [("BATT_CRT_VOLT", Grade::Bad), ("BATT_LOW_VOLT", Grade::Look), ("FS_BATT_VOLTAGE", Grade::Look)];
        let measured = self.battery.iter().any(|(_, (v, _))| *v >= NO_BATTERY_V);
        let own = limits.into_iter().filter(|_| measured).find_map(|(name, grade)| {
            let limit = board.get(name).filter(|v| *v > 0.0)?;
            let below = rows(volts.iter().map(|(t, v, _)| (*t, limit - v)), 0.0);
            let row = below.into_iter().find(|row| row.length_s() >= LOW_S)?;
            let text =
                format!("below {name} ({limit:.1} V) for {:.1} s from {:.1} s", row.length_s(), row.start);
            Some((grade, Some(row.start), text))
        });
        found.extend(own);
        let left = volts.iter().filter_map(|v| Some((v.0, v.2?))).min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((t, left)) = left.filter(|(_, left)| *left < REMAINING[0] && *left > 0.0) {
            let text = format!("{:.0} % left at {t:.1} s", 100.0 * left);
            found.push((graded_below(left, REMAINING), Some(t), text));
        }
        let supply = self.supply.iter().map(|(t, v)| (self.s(*t), *v)).filter(|(t, _)| in_flight(*t));
        if let Some((t, volts)) = supply.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|s| s.1 < SUPPLY_V[0]) {
            let text = format!("supply of the board {volts:.2} V at {t:.1} s");
            found.push((graded_below(volts, SUPPLY_V), Some(t), text));
        }
        found
    }
}
