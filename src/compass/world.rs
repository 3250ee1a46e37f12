//! The Earth's magnetic field at a place and date, by NOAA's world magnetic model.

use gaware_nav::earth::Geodetic;
use gaware_nav::math::atan2;
use gaware_nav::rotation::wrap_pi;
use nalgebra::Vector3;
use world_magnetic_model::GeomagneticField;
use world_magnetic_model::time::Date;
use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;
use world_magnetic_model::uom::si::magnetic_flux_density::nanotesla;

/// The models in use hold from 2020 to 2029. Before and after, the nearest date is taken: the declination changes by .1 to .2° a year at middle
/// latitudes (NOAA, secular variation).
const YEARS: (i32, i32) = (2020, 2029);

/// The field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldField {
    /// North, east, down, T.
    pub field_n: Vector3<f64>,
    /// Declination, deg.
    pub declination_deg: f64,
    /// Its 1-sigma by the model's error model, deg.
    pub declination_sigma_deg: f64,
    /// Year that it was evaluated for, and the year of the flight where the log says.
    pub years: (i32, Option<i32>),
}

impl WorldField {
    /// At a place; `unix_s`: the date, where it is known. Nothing where the model does not hold (far above the ground).
    pub fn at(place: &Geodetic, unix_s: Option<f64>) -> Option<Self> {
        let days = unix_s.map(|t| (t / 86_400.0).floor());
        let date = days.and_then(|d| Date::from_julian_day(2_440_588 + d as i32).ok());
        let own = date.map(Date::year);
        let used = match date {
            Some(date) if date.year() < YEARS.0 => Date::from_ordinal_date(YEARS.0, 1).ok()?,
            Some(date) if date.year() > YEARS.1 => Date::from_ordinal_date(YEARS.1, 365).ok()?,
            Some(date) => date,
            None => Date::from_ordinal_date(2025, 1).ok()?,
        };
        let field = GeomagneticField::new(
            Length::new::<meter>(place.height_m as f32),
            Angle::new::<degree>(place.lat_rad.to_degrees() as f32),
            Angle::new::<degree>(wrap_pi(place.lon_rad).to_degrees() as f32),
            used,
        )
        .ok()?;
        let tesla = |v: f32| f64::from(v) * 1e-9;
        Some(Self {
            field_n: Vector3::new(
                tesla(field.x().get::<nanotesla>()),
                tesla(field.y().get::<nanotesla>()),
                tesla(field.z().get::<nanotesla>()),
            ),
            declination_deg: f64::from(field.declination().get::<degree>()),
            declination_sigma_deg: f64::from(field.declination_uncertainty().get::<degree>()),
            years: (used.year(), own),
        })
    }

    /// In words.
    pub fn words(&self) -> String {
        let (used, own) = self.years;
        let date = match own {
            Some(own) if own == used => String::new(),
            Some(own) => format!(" (for {used}, the nearest year that the model has to {own})"),
            None => format!(" (for {used}: the log has no date)"),
        };
        format!(
            "World magnetic model at the place{date}: {:.0} mG, declination {:.1}° ± {:.1}°, inclination {:.0}°",
            self.field_n.norm() * 1e7,
            self.declination_deg,
            self.declination_sigma_deg,
            atan2(self.field_n.z, self.field_n.xy().norm()).to_degrees()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NOAA's test values of WMM2020 at 2020.0, sea level (Chulliat et al. 2020, "The US/UK World Magnetic Model for 2020-2025", table 3a).
    #[test]
    fn the_field_is_that_of_noaas_test_values() {
        for (lat, lon, xyz) in [
            (80.0, 0.0, [6570.4, -146.3, 54_606.0]),
            (0.0, 120.0, [39_624.3, 109.9, -10_932.5]),
            (-80.0, -120.0, [5940.6, 15_772.1, -52_480.8]),
        ] {
            let place = Geodetic::from_degrees(lat, lon, 0.0);
            let found = WorldField::at(&place, Some(1_577_836_800.0)).unwrap().field_n * 1e9;
            assert!((found - Vector3::from(xyz)).norm() < 1.0, "{found} {xyz:?}");
        }
    }

    #[test]
    fn old_and_undated_logs_take_the_nearest_year_and_say_so() {
        let place = Geodetic::from_degrees(47.4, 8.5, 500.0);
        let old = WorldField::at(&place, Some(1_400_000_000.0)).unwrap();
        assert_eq!(old.years, (2020, Some(2014)));
        assert!(old.words().contains("nearest year"), "{}", old.words());
        assert!(WorldField::at(&place, None).unwrap().words().contains("no date"));
        let now = WorldField::at(&place, Some(1_784_000_000.0)).unwrap();
        assert!((now.declination_deg - 3.6).abs() < 0.1 && now.declination_sigma_deg < 0.6, "{now:?}");
    }
}
