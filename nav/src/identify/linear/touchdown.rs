//! Where a vehicle that came down comes to rest. Contact with the ground takes milliseconds, and a blow between two samples is in neither of them: on 25 Hz logs of a simulator all of
//! .5 m/s, which passed for a drift of the accelerometers by 141 ± 25 mg/√h.

use crate::rss;
use crate::sample::{FixVelocity, GnssFix};

/// Slower than this a vehicle rests, m/s …
const RESTS: f64 = 0.2;
/// … where it does so for this long, s.
const RESTS_S: f64 = 3.0;
/// It came down by at least this before, m/s …
const DESCENDS: f64 = 0.25;
/// … within this long, s: fixes are late and smooth. Multirotors touch down at .3 to .7 m/s (`LAND_SPEED` .5, `MPC_LAND_SPEED` .7).
const BEFORE_S: f64 = 1.0;
/// A place that is as far as this above the lowest one of the recording is in the air, m.
const ABOVE_M: f64 = 3.0;

fn speed(fix: &GnssFix) -> Option<(f64, f64)> {
    match fix.velocity {
        FixVelocity::Full([n, e, d]) => Some((rss(rss(n, e), d), d)),
        _ => None,
    }
}

/// From when to when a blow may have been, s, and as much as it may have stopped, m/s.
pub(super) fn touchdowns(fixes: &[GnssFix]) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
    let lowest_m = fixes.iter().map(|f| f.position.height_m).fold(f64::INFINITY, f64::min);
    let rests = |f: &GnssFix| speed(f).is_some_and(|v| v.0 < RESTS);
    let one = move |k: usize| {
        let fix = fixes.get(k)?;
        let came_to_rest = rests(fix) && !rests(fixes.get(k.checked_sub(1)?)?);
        let after = fixes[k..].iter().take_while(|f| f.t_s < fix.t_s + RESTS_S);
        if !came_to_rest || fix.position.height_m > lowest_m + ABOVE_M || !after.clone().all(rests) {
            return None;
        }
        let before = fixes[..k].iter().rev().take_while(|f| f.t_s > fix.t_s - BEFORE_S).filter_map(speed);
        let came_down = before.map(|v| v.1).fold(0.0, f64::max);
        (came_down > DESCENDS).then_some((fix.t_s - BEFORE_S, fix.t_s, came_down))
    };
    (0..fixes.len()).filter_map(one)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;

    /// Down at .5 m/s from 20 m, and rest from 40 s on, but for `walks`.
    fn fixes(rest_m: f64, walks: impl Fn(f64) -> bool) -> Vec<GnssFix> {
        let fix = |k: u32| {
            let t_s = f64::from(k) * 0.2;
            let down = if (10.0..40.0).contains(&t_s) { 0.5 } else { 0.0 };
            let height_m = rest_m + 0.5 * (40.0 - t_s.max(10.0)).max(0.0);
            GnssFix {
                t_s,
                position: Geodetic::from_degrees(47.0, 8.0, if k == 0 { 500.0 } else { height_m }),
                velocity: FixVelocity::Full([if walks(t_s) { 1.0 } else { 0.01 }, 0.0, down]),
                position_sigma_m: None,
                velocity_sigma_m_per_s: None,
                yaw_rad: None,
            }
        };
        (0..300).map(fix).collect()
    }

    #[test]
    fn a_descent_that_ends_on_the_ground_is_a_touchdown_and_one_in_the_air_is_none() {
        let landed: Vec<_> = touchdowns(&fixes(500.0, |_| false)).collect();
        assert_eq!(landed.len(), 1);
        let (from_s, to_s, speed) = landed[0];
        assert!(from_s < 40.0 && (40.0..40.5).contains(&to_s) && (speed - 0.5).abs() < 1e-9, "{landed:?}");
        assert_eq!(touchdowns(&fixes(520.0, |_| false)).count(), 0, "hovers 20 m above the start");
        assert_eq!(touchdowns(&fixes(500.0, |t_s| t_s > 41.0)).count(), 0, "goes on at once");
    }
}
