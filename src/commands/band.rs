//! The band of heights that maneuvers keep to.

/// Where maneuvers may lead.
#[derive(Debug, Clone, Copy, Default, PartialEq, clap::Args)]
pub struct BandArgs {
    /// Lowest height above home for maneuvers, m (default: `run` 40 for wings and 15 for rotors, `demo` the same).
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub floor: Option<f64>,
    /// Highest height above home for maneuvers, m (default: `run` 120; `demo` 160 for wings and 70 for rotors).
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub ceiling: Option<f64>,
}

/// A band that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BandError {
    /// Infinite or no number.
    #[error("--{0} {1} is no number to plan with")]
    NoNumber(&'static str, f64),
    /// Underground.
    #[error("--floor {0} is below the ground: it is a height above home in m")]
    BelowGround(f64),
    /// Upside down.
    #[error("--floor {0} is not below --ceiling {1}: heights above home in m, the lower one first")]
    Order(f64, f64),
    /// There is no guidance that it could bound.
    #[error("--floor and --ceiling bound the maneuvers that are proposed: say with --airframe what flies")]
    NoAirframe,
}

impl BandArgs {
    /// Whether either was given.
    pub fn is_given(&self) -> bool {
        self.floor.is_some() || self.ceiling.is_some()
    }

    /// The usual band with what was given instead, m.
    ///
    /// # Errors
    /// What comes of it is none.
    pub fn or(&self, usual: [f64; 2]) -> Result<[f64; 2], BandError> {
        check([self.floor.unwrap_or(usual[0]), self.ceiling.unwrap_or(usual[1])])
    }
}

/// A lowest and a highest height above home that can be meant, m.
///
/// # Errors
/// They cannot.
pub fn check([floor, ceiling]: [f64; 2]) -> Result<[f64; 2], BandError> {
    match [("floor", floor), ("ceiling", ceiling)].into_iter().find(|(_, v)| !v.is_finite()) {
        Some((name, value)) => Err(BandError::NoNumber(name, value)),
        None if floor < 0.0 => Err(BandError::BelowGround(floor)),
        None if floor >= ceiling => Err(BandError::Order(floor, ceiling)),
        None => Ok([floor, ceiling]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_is_two_heights_above_the_ground_the_lower_one_first() {
        let band = |floor, ceiling| BandArgs { floor, ceiling }.or([40.0, 120.0]);
        assert_eq!(band(None, None), Ok([40.0, 120.0]));
        assert_eq!(band(Some(60.0), None), Ok([60.0, 120.0]));
        assert_eq!(band(Some(60.0), Some(300.0)), Ok([60.0, 300.0]));
        assert_eq!(band(Some(130.0), None), Err(BandError::Order(130.0, 120.0)));
        assert_eq!(band(Some(-1.0), None), Err(BandError::BelowGround(-1.0)));
        assert!(matches!(band(None, Some(f64::NAN)), Err(BandError::NoNumber("ceiling", _))));
    }
}
