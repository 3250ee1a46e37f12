//! Figures and dates as people read them, the same on every page and screen.

use gaware_nav::earth::Geodetic;
use gaware_nav::math::log10;
use std::fmt::Display;

/// Decimal places that show two significant figures of a sigma.
pub fn two_figures(sigma: f64) -> usize {
    (1.0 - log10(sigma.abs().max(1e-12)).floor()).clamp(0.0, 12.0) as usize
}

/// A value with its sigma, both to the second significant figure of the sigma (GUM, JCGM 100:2008, 7.2.6).
pub fn with_sigma(value: f64, sigma: f64) -> String {
    let digits = two_figures(sigma);
    format!("{value:.digits$} ± {sigma:.digits$}")
}

/// A number of things: `1 item`, `3 items`.
pub fn counted<N: Display + PartialEq + From<u8>>(n: N, what: &str) -> String {
    let s = if n == N::from(1) { "" } else { "s" };
    format!("{n} {what}{s}")
}

/// The same with what became of them: `1 item was`, `3 items were`.
pub fn counted_were(n: usize, what: &str) -> String {
    format!("{} {}", counted(n, what), if n == 1 { "was" } else { "were" })
}

/// Day of a time in seconds since 1970 (UTC), as `2024-02-29`.
pub fn day(unix_s: f64) -> String {
    let (year, month, day) = civil((unix_s / 86_400.0).floor() as i64);
    format!("{year}-{month:02}-{day:02}")
}

/// Year, month and day of the proleptic Gregorian calendar from the days since 1970-01-01 (H. Hinnant, "chrono-Compatible
/// Low-Level Date Algorithms", `civil_from_days`). Beyond 5 million years in either direction the day is that of the limit.
pub fn civil(days: i64) -> (i64, i64, i64) {
    let z = days.clamp(-2_000_000_000, 2_000_000_000) + 719_468;
    let era = z.div_euclid(146_097);
    let doe = z.rem_euclid(146_097);
    let yoe = (doe - doe / 1460 + doe / 36_524 - doe / 146_096) / 365;
    let doy = doe - (365 * yoe + yoe / 4 - yoe / 100);
    let mp = (5 * doy + 2) / 153;
    let (day, month) = (doy - (153 * mp + 2) / 5 + 1, if mp < 10 { mp + 3 } else { mp - 9 });
    (yoe + 400 * era + i64::from(month <= 2), month, day)
}

/// Where vehicles fly: from the Dead Sea to above any of their ceilings, m above sea level.
const ALTITUDES_M: std::ops::RangeInclusive<f64> = -500.0..=30_000.0;

/// Latitude and longitude in degrees, and a height in m where it is given, as people write them.
///
/// # Errors
/// How to write them.
pub fn place(text: &str) -> Result<Geodetic, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    let (lat, lon, alt_m) = match numbers.as_deref() {
        Some(&[lat, lon]) => (lat, lon, 0.0),
        Some(&[lat, lon, alt_m]) => (lat, lon, alt_m),
        _ => (f64::NAN, f64::NAN, f64::NAN),
    };
    if lat.abs() > 90.0 || lon.abs() > 180.0 || lat.is_nan() || lon.is_nan() {
        return Err("write latitude and longitude in degrees, as in 47.4,8.5".to_owned());
    }
    if !ALTITUDES_M.contains(&alt_m) {
        return Err(format!(
            "write the altitude above sea level in m, from {} to {}, as in 47.4,8.5,440",
            ALTITUDES_M.start(),
            ALTITUDES_M.end()
        ));
    }
    Ok(Geodetic::from_degrees(lat, lon, alt_m))
}

/// Reads a number of seconds that is not negative.
///
/// # Errors
/// How to write it.
pub fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|s| s.is_finite() && *s >= 0.0);
    number.ok_or_else(|| "write a number of seconds, 0 or more".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_on_the_earth() {
        assert!(
            place("47.4,8.5").is_ok() && place(" 47.4, 8.5, 440").is_ok() && place("-33,151,-10").is_ok()
        );
        for wrong in
            ["47.4", "47.4,8.5,nan", "47.4,8.5,1e9", "47.4,8.5,440,1", "nan,8.5", "91,8.5", "a,47.4,8.5"]
        {
            assert!(place(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn one_thing_is_no_plural() {
        assert_eq!((counted(1usize, "item"), counted(0u64, "item")), ("1 item".into(), "0 items".into()));
        assert_eq!(
            (counted_were(1, "item"), counted_were(2, "item")),
            ("1 item was".into(), "2 items were".into())
        );
    }

    #[test]
    fn a_value_has_the_places_of_two_figures_of_its_sigma() {
        assert_eq!(with_sigma(-267.4, 71.38), "-267 ± 71");
        assert_eq!(with_sigma(0.0712, 0.00204), "0.0712 ± 0.0020");
    }

    #[test]
    fn days_become_dates() {
        assert_eq!([civil(0), civil(19_782), civil(-1)], [(1970, 1, 1), (2024, 2, 29), (1969, 12, 31)]);
        assert_eq!(day(86_400.0 * 19_782.9), "2024-02-29");
        // What a damaged list of a fleet may hold.
        assert!(!day(f64::MAX).is_empty() && !day(f64::NAN).is_empty());
    }
}
