//! `gaware.replay` and `gaware.explain`.

use crate::model::Model;
use crate::table::Table;
use crate::{GawareError, failed};
use gaware::commands::replay::{ReplayRequest, replay as run_replay};
use gaware::engine::{Engine, EngineOptions};
use gaware::explain::{self as explaining, Explained, Request};
use gaware::export::{Gather, Gathered};
use gaware::sensors::{ConverterOptions, ImuSource};
use gaware_nav::identify::select::Settings;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Columns that say which row it is.
const KEYS: [&str; 3] = ["log", "elapsed_s", "t_s"];

/// Source of the samples, from a name.
pub fn listen(source: Option<&str>, vehicle: Option<u8>) -> PyResult<ConverterOptions> {
    let source = source.map(str::parse::<ImuSource>).transpose();
    Ok(ConverterOptions { source: source.map_err(|e| GawareError::new_err(e.to_string()))?, vehicle })
}

/// A document of the program as Python's own types.
pub fn parsed<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}

/// A replayed flight: its summary and its tables.
#[pyclass(module = "gaware", frozen)]
pub struct Flight {
    summary: String,
    tables: Vec<Py<Table>>,
}

impl Flight {
    fn table(&self, py: Python<'_>, name: &str) -> PyResult<Py<Table>> {
        for table in &self.tables {
            if table.getattr(py, "name")?.extract::<String>(py)? == name {
                return Ok(table.clone_ref(py));
            }
        }
        Err(GawareError::new_err(format!("there is no table {name}")))
    }

    fn part(&self, py: Python<'_>, name: &'static str, wanted: impl Fn(&str) -> bool) -> PyResult<Table> {
        self.table(py, "states")?.get().select(name, |column| KEYS.contains(&column) || wanted(column))
    }
}

#[pymethods]
impl Flight {
    /// The result, as "gaware replay --json" prints it.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        parsed(py, &self.summary)
    }

    /// All tables of the export.
    #[getter]
    fn tables(&self, py: Python<'_>) -> Vec<Py<Table>> {
        self.tables.iter().map(|t| t.clone_ref(py)).collect()
    }

    /// The estimate five times a second.
    #[getter]
    fn states(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, "states")
    }

    /// The columns of states that are 1-sigmas.
    #[getter]
    fn sigmas(&self, py: Python<'_>) -> PyResult<Table> {
        self.part(py, "sigmas", |column| column.contains("_sigma") && !column.starts_with("innovation_"))
    }

    /// The columns of states that are normalised innovations.
    #[getter]
    fn innovations(&self, py: Python<'_>) -> PyResult<Table> {
        self.part(py, "innovations", |column| column.starts_with("innovation_") || column.starts_with("nis_"))
    }

    /// The inertial samples that the estimator was given.
    #[getter]
    fn samples(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, "imu")
    }

    /// The GNSS fixes that the estimator was given.
    #[getter]
    fn fixes(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, "fixes")
    }

    /// The autopilot's own attitude.
    #[getter]
    fn attitude(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, "autopilot_attitude")
    }

    /// What changed, in words.
    #[getter]
    fn events(&self, py: Python<'_>) -> PyResult<Py<Table>> {
        self.table(py, "events")
    }
}

/// Runs a recorded flight through the estimator, as "gaware replay" does.
#[pyfunction]
#[pyo3(signature = (path, model=None, *, source=None, vehicle=None))]
pub fn replay(
    py: Python<'_>,
    path: PathBuf,
    model: Option<Model>,
    source: Option<&str>,
    vehicle: Option<u8>,
) -> PyResult<Flight> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let request = ReplayRequest {
        log: path.into(),
        model: model.map(|m| m.0),
        converter: listen(source, vehicle)?,
        truth_from_s: gaware::commands::replay::TRUTH_FROM_S,
    };
    let done = py.detach(|| {
        let gather =
            |model| Gather::new(Engine::new(model, EngineOptions::default()), name, Gathered::default());
        let (pipeline, document) = run_replay(&request, gather)?;
        let text = serde_json::to_string(&document).unwrap_or_default();
        Ok((text, pipeline.into_engine().into_tables().into_tables()))
    });
    let (summary, tables) = done.map_err(failed)?;
    let tables = tables.into_iter().map(|t| Py::new(py, Table::new(t)?)).collect::<PyResult<_>>()?;
    Ok(Flight { summary, tables })
}

/// What explain found.
#[pyclass(module = "gaware", frozen)]
pub struct Explanation(Explained);

#[pymethods]
impl Explanation {
    /// The result, as "gaware explain --json" prints it.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        parsed(py, &serde_json::to_string(&self.0.explanation).unwrap_or_default())
    }

    /// explained, ambiguous, nothing_missing or unexplained.
    #[getter]
    fn verdict(&self) -> String {
        let verdict = serde_json::to_value(self.0.explanation.verdict).unwrap_or_default();
        verdict.as_str().unwrap_or_default().to_owned()
    }

    /// The model with the effects added.
    #[getter]
    fn model(&self) -> Model {
        Model(self.0.model.clone())
    }

    /// Writes report.html, report.json and model.toml into a folder, as "gaware explain --out" does.
    fn write(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        py.detach(|| explaining::write(&self.0, &folder, &gaware::outputs::Outputs::default()))
            .map_err(|e| failed(e.into()))
    }

    fn __repr__(&self) -> String {
        format!("<gaware.Explanation: {}>", self.0.explanation.summary)
    }
}

/// Identifies unmodelled sensor errors in flights of one vehicle, as "gaware explain" does.
#[pyfunction]
#[pyo3(signature = (paths, model=None, *, validate=Vec::new(), parameters=None, source=None, vehicle=None))]
pub fn explain(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    model: Option<Model>,
    validate: Vec<PathBuf>,
    parameters: Option<PathBuf>,
    source: Option<&str>,
    vehicle: Option<u8>,
) -> PyResult<Explanation> {
    let request = Request {
        logs: paths.into_iter().map(Into::into).collect(),
        validate: validate.into_iter().map(Into::into).collect(),
        model: model.map(|m| m.0),
        converter: listen(source, vehicle)?,
        settings: Settings::default(),
        parameters: parameters.map(Into::into),
        whole: false,
        place: None,
    };
    let explained = py.detach(|| explaining::run(&request, &|_| {}));
    explained.map(Explanation).map_err(|e| failed(e.into()))
}
