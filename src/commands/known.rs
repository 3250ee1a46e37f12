//! What is known of a vehicle before its samples come: where it is, what its unit's file says, and which error of attitude matters to it.

use super::CommandError;
use super::unit::today;
use crate::engine::meaning::LIMIT_DEG;
use crate::figures;
use crate::logs::mcap::recorded_setup;
use crate::pipeline::Beside;
use crate::unit::known::{self, KnownUnit};
use crate::unit::{Unit, UnitError};
use gaware_nav::earth::Geodetic;
use gaware_nav::model::Model;
use std::path::{Path, PathBuf};

/// Where the vehicle is.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct PlaceArgs {
    /// Where the vehicle is, in degrees and m above sea level, for as long as no fix says so: 47.4,8.5,440 (or without the height). A vehicle that is turned by hand indoors needs it for the
    /// Earth's rate; without it that counts as an unknown of 15 deg/h.
    #[arg(long, value_name = "LAT,LON[,ALT]", value_parser = figures::place, allow_hyphen_values = true)]
    pub home: Option<Geodetic>,
}

/// The file of the unit.
#[derive(Debug, Clone, clap::Args)]
pub struct UnitFileArgs {
    /// What is known of this inertial unit (see `gaware unit`): where the estimate begins, as priors of the model.
    #[arg(long, value_name = "FILE")]
    pub unit: Option<PathBuf>,
    /// Folder of unit files; without --unit the one of this vehicle's hardware id is used, where the folder has it.
    #[arg(long, value_name = "DIR", default_value = "units")]
    pub units: PathBuf,
    /// Begin without the file of the unit, also where the folder has it.
    #[arg(long, conflicts_with = "unit")]
    pub no_unit: bool,
}

/// All of it.
#[derive(Debug, Clone, clap::Args)]
pub struct KnownArgs {
    /// Where the vehicle is.
    #[command(flatten)]
    pub place: PlaceArgs,
    /// The file of the unit.
    #[command(flatten)]
    pub unit: UnitFileArgs,
    /// Error of attitude that matters to this vehicle, deg: what G does in a turn is judged against it.
    #[arg(long, value_name = "DEG", default_value_t = LIMIT_DEG, value_parser = limit)]
    pub limit: f64,
}

impl UnitFileArgs {
    /// Which file an estimate for hardware with this id begins from: every command asks here. Without an id only the one that was named.
    ///
    /// # Errors
    /// The file is none, or of other hardware; the folder cannot be read.
    pub fn decide(&self, hardware_id: Option<&str>) -> Result<Option<KnownUnit>, UnitError> {
        let path = match (&self.unit, hardware_id) {
            _ if self.no_unit => None,
            (Some(path), _) => Some(path.clone()),
            (None, Some(id)) if self.units.is_dir() => crate::unit::find(&self.units, id)?,
            (None, _) => None,
        };
        let Some(path) = path else { return Ok(None) };
        KnownUnit::of(&path, Unit::read(&path)?, hardware_id).map(Some)
    }

    /// Whether the vehicle's id could change what [`Self::decide`] says.
    pub fn asks_for_id(&self) -> bool {
        !self.no_unit && (self.unit.is_some() || self.units.is_dir())
    }

    /// The file for the vehicle of this log; the user is told which.
    ///
    /// # Errors
    /// A log that cannot be read, and as [`Self::decide`].
    pub fn of_log(&self, log: &Path, vehicle: Option<u8>) -> Result<Option<KnownUnit>, CommandError> {
        if !self.asks_for_id() {
            return Ok(None);
        }
        if self.unit.is_none() && recorded_setup(log).is_some() {
            // A recording of a run holds what was known then, and its replay repeats the run.
            return Ok(None);
        }
        let id = Beside::read(log, vehicle)?.on_board.board;
        let known = self.decide(id.as_deref())?.filter(|k| self.unit.is_some() || !k.is_from(log));
        known.iter().for_each(|k| crate::sinks::log::line(&k.words(&today())));
        Ok(known)
    }
}

/// The model with what the file says today; a model only where there is one or a file.
pub fn with_known(model: Option<Model>, known: Option<&KnownUnit>) -> Option<Model> {
    known::with_known(model, known, &today())
}

/// An angle that an attitude can be wrong by.
fn limit(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|d| *d > 0.0 && *d <= 90.0);
    number.ok_or_else(|| "write degrees above 0, as in --limit 0.5".to_owned())
}
