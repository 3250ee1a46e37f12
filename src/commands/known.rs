//! What is known of a vehicle before its samples come: where it is, what its unit's file says, and which error of attitude matters to it.

use super::CommandError;
use super::unit::with_unit;
use crate::engine::meaning::LIMIT_DEG;
use crate::pipeline::Beside;
use gaware_nav::earth::Geodetic;
use gaware_nav::model::Model;
use std::path::{Path, PathBuf};

/// Where the vehicle is.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct PlaceArgs {
    /// Where the vehicle is, in degrees and m above sea level, for as long as no fix says so: 47.4,8.5,440 (or without the height). A vehicle that is turned by hand indoors needs it for the
    /// Earth's rate; without it that counts as an unknown of 15 deg/h.
    #[arg(long, value_name = "LAT,LON[,ALT]", value_parser = place, allow_hyphen_values = true)]
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
    /// Where the file of a unit is to be looked for; nowhere where one is given.
    pub fn folder(&self) -> Option<PathBuf> {
        Some(self.units.clone()).filter(|folder| self.unit.is_none() && folder.is_dir())
    }

    /// The file that is given, or that of the vehicle of this log; the user is told which was found.
    ///
    /// # Errors
    /// A log that cannot be read.
    pub fn of_log(&self, log: &Path, vehicle: Option<u8>) -> Result<Self, CommandError> {
        let Some(folder) = self.folder() else { return Ok(self.clone()) };
        let Some(id) = Beside::read(log, vehicle)?.on_board.board else { return Ok(self.clone()) };
        let unit = crate::unit::find(&folder, &id)?;
        if let Some(path) = &unit {
            crate::sinks::log::line(&format!("unit {id}: begins from {}", path.display()));
        }
        Ok(Self { unit, units: folder })
    }

    /// The model with what the file says; a model only where there is one or a file.
    ///
    /// # Errors
    /// The file cannot be read, or is none.
    pub fn on(&self, model: Option<Model>) -> Result<Option<Model>, CommandError> {
        if self.unit.is_none() {
            return Ok(model);
        }
        let mut model = model.unwrap_or_else(Model::standard);
        with_unit(&mut model, self.unit.as_deref())?;
        Ok(Some(model))
    }
}

/// Latitude and longitude in degrees, and a height.
fn place(text: &str) -> Result<Geodetic, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [lat, lon, ref alt @ ..] if lat.abs() <= 90.0 && lon.abs() <= 180.0 && alt.len() < 2 => {
            Ok(Geodetic::from_degrees(lat, lon, alt.first().copied().unwrap_or(0.0)))
        }
        _ => Err("write latitude and longitude in degrees, as in --home 47.4,8.5".to_owned()),
    }
}

/// An angle that an attitude can be wrong by.
fn limit(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|d| *d > 0.0 && *d <= 90.0);
    number.ok_or_else(|| "write degrees above 0, as in --limit 0.5".to_owned())
}
