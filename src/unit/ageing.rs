//! Days between dates, and what they do to constants.

/// Random walk of a constant in an hour, as a share of its prior sigma: that of the filter's tolerances.
const WALK_PER_RTH: f64 = 0.01;

/// Days since 1970-01-01 of a date (H. Hinnant, "chrono-Compatible Low-Level Date Algorithms", `days_from_civil`).
pub(super) fn days(date: &str) -> Option<i64> {
    let mut parts = date.splitn(3, '-').map(|p| p.parse::<i64>().ok());
    let (year, month, day) = (parts.next()??, parts.next()??, parts.next()??);
    if !(1970..=9999).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let yoe = year.rem_euclid(400);
    let doy = (153 * (month + if month > 2 { -3 } else { 9 }) + 2) / 5 + day - 1;
    Some(era * 146_097 + yoe * 365 + yoe / 4 - yoe / 100 + doy - 719_468)
}

/// Days from one date to another; 0 where either is none.
pub(super) fn between(from: &str, to: &str) -> f64 {
    days(from).zip(days(to)).map_or(0.0, |(a, b)| (b - a).unsigned_abs() as f64)
}

/// Share of its prior sigma by which a constant may have walked in so many days.
pub(super) fn walk(days: f64) -> f64 {
    (WALK_PER_RTH * (24.0 * days).sqrt()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        for since in [0, 59, 11_016, 19_782, 20_781] {
            let text = crate::figures::day(since as f64 * 86_400.0);
            assert_eq!(days(&text), Some(since), "{text}");
        }
        for wrong in ["", "2026", "2026-13-01", "2026-01-32", "soon", "1066-10-14"] {
            assert_eq!(days(wrong), None, "{wrong}");
        }
        assert_eq!(between("2026-11-24", "2026-12-24"), 30.0);
    }

    #[test]
    fn a_month_costs_a_quarter_of_what_was_not_known_and_never_more_than_all() {
        assert!((walk(30.0) - 0.268).abs() < 1e-3);
        assert_eq!((walk(0.0), walk(1e9)), (0.0, 1.0));
    }
}
