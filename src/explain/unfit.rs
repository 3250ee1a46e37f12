//! Recordings from which names may be right, but no value is to be used.

use crate::health::logger::{LOG_LESS, LOSSY};
use gaware_nav::identify::flight::Flight;

/// Why no value of these flights is to be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unfit {
    /// The inertial samples are so noisy that their noise passes for the motion.
    Noisy,
    /// This share of the inertial samples is missing.
    Lossy(f64),
}

impl Unfit {
    /// Of flights; `None` where their samples are good.
    pub fn of(flights: &[&Flight]) -> Option<Self> {
        let missing = flights.iter().map(|f| f.missing_share()).fold(0.0, f64::max);
        let noisy = flights.iter().any(|f| f.is_noisy());
        if missing > LOSSY { Some(Self::Lossy(missing)) } else { noisy.then_some(Self::Noisy) }
    }

    /// What is said of the recording. White noise as PX4's simulator makes by default, laid over one of its flights whose fixes were 120 ms late and whose
    /// antenna was away: 96 ± 4 ms and 71 ± 3 ms (2026-11-26), and no antenna. Two of nine flights of a large copter, logged at 25 Hz, are as noisy.
    pub fn sentence(self) -> String {
        match self {
            Self::Noisy => "The inertial samples are very noisy (strong vibration in a slow log, or the noise of a simulator): values may be off by \
                            several sigma, and no parameter is proposed."
                .to_owned(),
            Self::Lossy(share) => format!(
                "{:.0} % of the inertial samples are missing from the recording (the logger could not write all that it was asked to, or the link lost \
                 messages): effects may be false, values off by several sigma, and no parameter is proposed.",
                100.0 * share
            ),
        }
    }

    /// Why a parameter is not proposed.
    pub fn bars(self) -> &'static str {
        match self {
            Self::Noisy => "the inertial samples are very noisy: the value may be off by several sigma",
            Self::Lossy(_) => {
                "many inertial samples are missing from the recording: the value may be off by several sigma"
            }
        }
    }

    /// What to do first.
    pub fn remedy(self) -> String {
        match self {
            Self::Noisy => "Look at the noise of the inertial unit first: mounting, filters, a faster log, or the settings of a simulator."
                .to_owned(),
            Self::Lossy(_) => format!("Record a flight without losses first: {LOG_LESS}."),
        }
    }
}
