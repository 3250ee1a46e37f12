//! The Python module `gaware._gaware`: the library's own functions with Python's types around them. No logic of its own.
//!
//! Work runs without the interpreter's lock. Tables go over as Arrow streams (the PyCapsule interface), documents as the JSON text of the
//! program, errors as exceptions with the program's sentences.

mod fleet;
mod flight;
mod model;
mod table;

use gaware::commands::CommandError;
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(gaware, GawareError, PyException, "The work failed; the text says why and what to do.");
create_exception!(gaware, LogError, GawareError, "A log cannot be read.");
create_exception!(gaware, ModelError, GawareError, "A model cannot be read.");

/// The exception with the sentence of the command line.
fn failed(error: CommandError) -> PyErr {
    let text = error.to_string();
    match error {
        CommandError::Log(_) | CommandError::Explain(gaware::explain::ExplainError::Log(_)) => {
            LogError::new_err(text)
        }
        CommandError::Model(_) => ModelError::new_err(text),
        _ => GawareError::new_err(text),
    }
}

/// The module.
#[pymodule]
fn _gaware(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("GawareError", module.py().get_type::<GawareError>())?;
    module.add("LogError", module.py().get_type::<LogError>())?;
    module.add("ModelError", module.py().get_type::<ModelError>())?;
    module.add_class::<model::Model>()?;
    module.add_class::<table::Table>()?;
    module.add_class::<flight::Flight>()?;
    module.add_class::<flight::Explanation>()?;
    module.add_function(wrap_pyfunction!(flight::replay, module)?)?;
    module.add_function(wrap_pyfunction!(flight::explain, module)?)?;
    module.add_function(wrap_pyfunction!(fleet::fleet_find, module)?)?;
    module.add_function(wrap_pyfunction!(fleet::fleet_analyse, module)?)?;
    module.add_function(wrap_pyfunction!(fleet::fleet_tables, module)?)?;
    module.add_function(wrap_pyfunction!(fleet::fleet_write, module)?)?;
    module.add_function(wrap_pyfunction!(fleet::fleet_family, module)?)?;
    Ok(())
}
