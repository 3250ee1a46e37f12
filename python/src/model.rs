//! `gaware.Model`.

use crate::{GawareError, ModelError, failed};
use gaware::commands::load_model;
use gaware_nav::model::Model as Inner;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Which sensor errors are assumed, with values and sigmas: the content of a model.toml.
#[pyclass(module = "gaware", frozen, from_py_object)]
#[derive(Clone)]
pub struct Model(pub Inner);

#[pymethods]
impl Model {
    /// The model that replay assumes where none is given: full G, GNSS latency and the tolerances of a consumer unit are estimated.
    #[staticmethod]
    fn standard() -> Self {
        Self(Inner::standard())
    }

    /// The model that explain begins with: noise and biases, no effects.
    #[staticmethod]
    fn empty() -> Self {
        Self(Inner::default())
    }

    /// Reads a model.toml.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        load_model(&path).map(Self).map_err(failed)
    }

    /// Reads the text of a model.toml.
    #[staticmethod]
    pub fn from_toml(text: &str) -> PyResult<Self> {
        Inner::from_toml(text).map(Self).map_err(|e| ModelError::new_err(e.to_string()))
    }

    /// The text of a model.toml.
    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    /// Writes a model.toml.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        std::fs::write(&path, self.0.to_toml())
            .map_err(|e| GawareError::new_err(format!("cannot write {}: {e}", path.display())))
    }

    /// Names of the effects that it assumes.
    #[getter]
    fn effects(&self) -> Vec<&'static str> {
        self.0.effects.iter().map(|e| e.effect.name()).collect()
    }

    /// The same model without an effect.
    fn without(&self, effect: &str) -> PyResult<Self> {
        if self.0.get(effect).is_none() {
            return Err(ModelError::new_err(format!("the model has no effect \"{effect}\"")));
        }
        let mut model = self.0.clone();
        model.remove(effect);
        Ok(Self(model))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0.to_toml() == other.0.to_toml()
    }

    fn __repr__(&self) -> String {
        format!("<gaware.Model: {}>", self.effects().join(", "))
    }

    /// Models go to other processes as their text.
    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (String,))> {
        let make = slf.get_type().getattr("from_toml")?.unbind();
        Ok((make, (slf.get().to_toml(),)))
    }
}
