//! A log of a fleet with what came of it.

use super::flight::{Flight, FlightEntry};
use serde_json::Value;

/// What the path of a log says of its flight.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Named {
    /// The inertial unit.
    pub unit: Option<String>,
    /// The firmware.
    pub firmware: Option<String>,
}

/// A log with its result, or the reason why there is none in this run.
#[derive(Debug, Clone)]
pub struct FleetLog {
    /// Path as it was found.
    pub path: String,
    /// What the name says.
    pub named: Named,
    /// What came of it.
    pub result: Result<FlightEntry, String>,
}

impl FleetLog {
    /// The inertial unit: what the name says, or the board that the log names.
    pub fn unit(&self) -> Option<&str> {
        self.named.unit.as_deref().or(self.flight()?.board.as_deref())
    }

    /// The firmware: what the name says, or what the log does.
    pub fn firmware(&self) -> Option<&str> {
        self.named.firmware.as_deref().or(self.flight()?.firmware.as_deref())
    }

    /// The flight, where there is one.
    pub fn flight(&self) -> Option<&Flight> {
        self.result.as_ref().ok()?.flight.as_ref()
    }

    /// Why it takes no part in what the flights of the units have in common.
    pub fn left_out(&self) -> Option<&str> {
        self.failure().or_else(|| {
            self.unit().is_none().then_some("its inertial unit is not known: give a rule with --names")
        })
    }

    /// Why there is no estimate.
    pub fn failure(&self) -> Option<&str> {
        match &self.result {
            Ok(entry) => entry.failed.as_deref().or_else(|| without_estimate(entry.flight.as_ref()?)),
            Err(reason) => Some(reason),
        }
    }
}

/// Why a log that was read has no estimate.
fn without_estimate(flight: &Flight) -> Option<&'static str> {
    // One that ends while the attitude is found anew has been estimated all the same.
    let used = flight.summary.get("gnss").and_then(|g| g.get("used")).and_then(Value::as_u64);
    if used.is_some_and(|n| n > 0) {
        return None;
    }
    match flight.summary.get("phase")?.as_str()? {
        "waiting_for_imu" => Some("no estimate: the log has no inertial samples"),
        "waiting_for_gnss" => Some("no estimate: the log has no GNSS fix that can be used"),
        "aligning" => Some("no estimate: the log ends before roll and pitch are known"),
        "searching_heading" => Some("no estimate: the heading cannot be found without motion"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_log_that_ends_while_the_attitude_is_found_anew_is_not_refused() {
        let of = |used: u64| {
            let summary = json!({"phase": "aligning", "gnss": {"used": used}}).as_object().cloned();
            let flight = Flight { summary: summary.unwrap(), ..Flight::default() };
            without_estimate(&flight).is_some()
        };
        assert_eq!((of(0), of(440)), (true, false));
    }
}
