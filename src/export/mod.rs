//! Time series of replayed flights as tables for other tools: CSV, Parquet and MCAP, all with the same columns.
//!
//! One row type describes each table once: name with unit, meaning, value. `docs/export.md` lists the columns. Every table has the
//! columns `log` and `elapsed_s`, by which tables of several flights are joined. Nothing here estimates anything.

mod csv;
mod gather;
mod mcap;
mod parquet;
mod rows;
pub mod table;

pub use gather::{Gather, Gathered};
pub use mcap::{object as flat_object, schema as flat_schema};
pub use table::Table;

use crate::outputs::{OutputError, Outputs};
use std::path::{Path, PathBuf};

/// Why tables cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The name has an ending that no format has.
    #[error("cannot export to {0}: use a folder, or a file that ends in .csv, .parquet or .mcap")]
    Format(PathBuf),
    /// The file or folder cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Two logs of one name: rows could not be separated.
    #[error("two logs are named {0}: rename one, rows of the export carry the name of their log")]
    SameName(String),
}

impl ExportError {
    /// Whether the arguments are wrong, rather than the work has failed.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Format(_) | Self::SameName(_) => true,
            Self::Output(error) => error.is_usage(),
        }
    }
}

/// What to write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Csv,
    Parquet,
    Mcap,
}

/// A file with the table of states, or a folder with a file for each table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Target {
    path: PathBuf,
    /// `None`: a folder.
    format: Option<Format>,
}

impl Target {
    /// By the ending of the name.
    ///
    /// # Errors
    /// An ending that no format has.
    pub fn new(path: &Path) -> Result<Self, ExportError> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let format = match ending.as_deref() {
            None => None,
            _ if path.is_dir() => None,
            Some("csv") => Some(Format::Csv),
            Some("parquet") => Some(Format::Parquet),
            Some("mcap") => Some(Format::Mcap),
            Some(_) => return Err(ExportError::Format(path.to_owned())),
        };
        Ok(Self { path: path.to_owned(), format })
    }

    /// Whether the files of these tables may be written, before there are any.
    ///
    /// # Errors
    /// One of them is an input, or somebody else's.
    pub fn check<'a>(
        &self,
        names: impl IntoIterator<Item = &'a str>,
        outputs: &Outputs,
    ) -> Result<(), OutputError> {
        match self.format {
            Some(_) => outputs.check(&self.path),
            None => names.into_iter().try_for_each(|name| outputs.check(&self.file(name))),
        }
    }

    /// The file of a table in a folder.
    fn file(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}.parquet"))
    }

    /// Writes the tables: a .csv or .parquet file has the states alone, an .mcap file and a folder have all tables (the folder as
    /// Parquet). The files written, in order.
    ///
    /// # Errors
    /// As [`Self::check`], and what the system says.
    pub fn write(&self, tables: &[Table], outputs: &Outputs) -> Result<Vec<PathBuf>, ExportError> {
        let written = |path: &Path, content: std::io::Result<Vec<u8>>| {
            let wrong = |source| OutputError::Write { path: path.to_owned(), source };
            outputs.write(path, content.map_err(wrong)?)?;
            Ok(path.to_owned())
        };
        let states = || tables.iter().filter(|t| t.name == rows::STATES);
        match self.format {
            Some(Format::Csv) => states().map(|t| written(&self.path, csv::bytes(t))).collect(),
            Some(Format::Parquet) => states().map(|t| written(&self.path, parquet::bytes(t))).collect(),
            Some(Format::Mcap) => Ok(vec![written(&self.path, mcap::bytes(tables))?]),
            None => {
                outputs.folder(&self.path)?;
                tables.iter().map(|t| written(&self.file(t.name), parquet::bytes(t))).collect()
            }
        }
    }
}

/// The names of the tables of a replay.
pub fn names() -> Vec<&'static str> {
    gather::example().iter().map(|table| table.name).collect()
}

/// The columns of every table, as `docs/export.md` has them.
pub fn columns_in_words() -> String {
    in_words(&gather::example())
}

/// The columns of tables, each with its type and meaning.
pub fn in_words(tables: &[Table]) -> String {
    let mut out = String::new();
    for table in tables {
        out.push_str(&format!(
            "\n## {}\n\n{}\n\n| column | type | meaning |\n|---|---|---|\n",
            table.name, table.about
        ));
        for column in &table.columns {
            out.push_str(&format!("| `{}` | {} | {} |\n", column.name, column.values.kind(), column.about));
        }
    }
    out
}

#[cfg(test)]
mod tests;
