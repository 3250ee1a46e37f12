//! The file of a unit that an estimate begins from.

use super::{Unit, UnitError};
use crate::figures::counted;
use crate::inputs::Input;
use gaware_nav::model::Model;
use std::path::{Path, PathBuf};

/// The model with what the file says on this day (as `2026-11-24`); a model only where there is one or a file.
pub fn with_known(model: Option<Model>, known: Option<&KnownUnit>, today: &str) -> Option<Model> {
    match known {
        Some(known) => Some(known.model(model, today)),
        None => model,
    }
}

/// The file that an estimate begins from.
#[derive(Debug, Clone)]
pub struct KnownUnit {
    /// Where it stands.
    pub path: PathBuf,
    /// What it says.
    pub unit: Unit,
}

impl KnownUnit {
    /// The file for hardware with this id.
    ///
    /// # Errors
    /// It is of other hardware.
    pub fn of(path: &Path, unit: Unit, hardware_id: Option<&str>) -> Result<Self, UnitError> {
        unit.check_hardware(path, hardware_id)?;
        Ok(Self { path: path.to_owned(), unit })
    }

    /// A model, the standard one where none is given, with what the file says on this day (as `2026-11-24`).
    pub fn model(&self, given: Option<Model>, today: &str) -> Model {
        let mut model = given.unwrap_or_else(Model::standard);
        self.unit.apply(&mut model, today);
        model
    }

    /// In a sentence, as it is on this day (as `2026-11-24`).
    pub fn words(&self, today: &str) -> String {
        let origin = &self.unit.origin;
        let id = origin.hardware_id.as_deref().unwrap_or("of unknown hardware");
        let count = self.unit.measured().len();
        let aged = self.unit.aged_words(today).map_or_else(String::new, |words| format!("; {words}"));
        format!(
            "unit {id}: begins from {} of {} ({} measured{aged}; --no-unit leaves it out)",
            self.path.display(),
            origin.date,
            counted(count, "constant")
        )
    }

    /// Whether it was made from this recording, by name.
    pub fn is_from(&self, log: &Path) -> bool {
        self.unit.origin.from.contains(&Input::from(log).name())
    }

    /// What is said where recordings contradict it.
    pub fn contradicted_words(&self, said: &str) -> String {
        format!(
            "the recordings are inconsistent with {} ({said}): it is left out, and they are explained without it. Measure the unit again (gaware ground), or check what has changed (mounting, another sensor, warm-up)",
            self.path.display()
        )
    }
}
