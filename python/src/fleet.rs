//! What `gaware.fleet` is made of: the same worker, tables and files as of "gaware fleet".

use crate::flight::{listen, parsed};
use crate::model::Model;
use crate::table::Table;
use crate::{GawareError, failed};
use gaware::commands::{fleet, fleet_report};
use gaware::fleet::family::family;
use gaware::fleet::find::{self, NameRule};
use gaware::fleet::flight::{FlightEntry, Work};
use gaware::fleet::log::{FleetLog, Named};
use gaware::fleet::tables;
use gaware::fleet::{FleetError, store};
use gaware::outputs::Outputs;
use gaware::parallel;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

fn wrong(error: FleetError) -> PyErr {
    failed(error.into())
}

/// All logs of files, folders and patterns.
#[pyfunction]
pub fn fleet_find(places: Vec<String>) -> PyResult<Vec<PathBuf>> {
    find::logs(&places).map_err(wrong)
}

/// Replays and explains one log in this process; its result as JSON, from the folder `out` where it is there already. `threads`: the most
/// that this process takes from now on.
#[pyfunction]
#[pyo3(signature = (log, model=None, explain=true, out=None, source=None, vehicle=None, threads=None))]
#[allow(clippy::too_many_arguments, reason = "named in Python")]
pub fn fleet_analyse(
    py: Python<'_>,
    log: PathBuf,
    model: Option<Model>,
    explain: bool,
    out: Option<PathBuf>,
    source: Option<&str>,
    vehicle: Option<u8>,
    threads: Option<usize>,
) -> PyResult<String> {
    if let Some(threads) = threads {
        parallel::use_at_most(threads);
    }
    let work = Work { model: model.map(|m| m.0), explain, converter: listen(source, vehicle)? };
    let entry = py.detach(|| store::analysed(&log, &work, out.as_deref()));
    serde_json::to_string(&entry.map_err(wrong)?).map_err(|e| GawareError::new_err(e.to_string()))
}

/// A log, its result as JSON, or why there is none.
type LogResult = (String, Option<String>, Option<String>);

fn logs(results: Vec<LogResult>, names: Option<&str>) -> PyResult<Vec<FleetLog>> {
    let rule = names.map(NameRule::new).transpose().map_err(wrong)?;
    let log = |(path, entry, failed): LogResult| {
        let entry = entry.map(|text| {
            serde_json::from_str::<FlightEntry>(&text).map_err(|e| GawareError::new_err(e.to_string()))
        });
        Ok(FleetLog {
            named: rule.as_ref().map_or_else(Named::default, |rule| rule.read(Path::new(&path))),
            path,
            result: entry.transpose()?.ok_or_else(|| failed.unwrap_or_default()),
        })
    };
    results.into_iter().map(log).collect()
}

/// The tables flights and effects.
#[pyfunction]
#[pyo3(signature = (results, names=None))]
pub fn fleet_tables(results: Vec<LogResult>, names: Option<&str>) -> PyResult<Vec<Table>> {
    tables::tables(&logs(results, names)?).into_iter().map(Table::new).collect()
}

/// Writes tables and list of a fleet, as "gaware fleet --out" does.
#[pyfunction]
#[pyo3(signature = (results, out, names=None))]
pub fn fleet_write(results: Vec<LogResult>, out: PathBuf, names: Option<&str>) -> PyResult<Vec<PathBuf>> {
    fleet::write(&out, &logs(results, names)?, &Outputs::default()).map_err(failed)
}

/// What the flights of each unit have in common, of a folder that "gaware fleet" wrote.
#[pyfunction]
#[pyo3(signature = (out, names=None))]
pub fn fleet_family<'py>(py: Python<'py>, out: PathBuf, names: Option<&str>) -> PyResult<Bound<'py, PyAny>> {
    let logs = fleet_report::read_fleet(&out, names).map_err(wrong)?;
    parsed(py, &serde_json::to_string(&family(&logs)).unwrap_or_default())
}
