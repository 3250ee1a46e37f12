//! `gaware.Table`: a table of the export as an Arrow stream.

use crate::GawareError;
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, BooleanArray, Float64Array, RecordBatch, RecordBatchIterator, StringArray};
use arrow_schema::{DataType, Field, Schema};
use gaware::export::table::{Column, Values};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict};
use std::collections::HashMap;
use std::sync::Arc;

/// A table with named columns. Every Arrow library reads it: polars.DataFrame(table), pyarrow.table(table).
#[pyclass(module = "gaware", frozen)]
pub struct Table {
    name: &'static str,
    about: &'static str,
    columns: Vec<(String, String)>,
    batch: RecordBatch,
}

impl Table {
    /// The columns are moved, not copied.
    pub fn new(table: gaware::export::Table) -> PyResult<Self> {
        let (name, about) = (table.name, table.about);
        let columns = table.columns.iter().map(|c| (c.name.clone(), c.about.clone())).collect();
        let (fields, arrays): (Vec<Field>, Vec<ArrayRef>) = table.columns.into_iter().map(column).unzip();
        let schema = Schema::new(fields);
        let batch = RecordBatch::try_new(Arc::new(schema), arrays)
            .map_err(|e| GawareError::new_err(e.to_string()))?;
        Ok(Self { name, about, columns, batch })
    }

    /// The columns with these names, of the same values.
    pub fn select(&self, name: &'static str, wanted: impl Fn(&str) -> bool) -> PyResult<Self> {
        let kept: Vec<usize> = (0..self.columns.len())
            .filter(|k| self.columns.get(*k).is_some_and(|(name, _)| wanted(name)))
            .collect();
        let batch = self.batch.project(&kept).map_err(|e| GawareError::new_err(e.to_string()))?;
        let columns = kept.iter().filter_map(|k| self.columns.get(*k).cloned()).collect();
        Ok(Self { name, about: self.about, columns, batch })
    }
}

/// A number that is absent is null, as in the Parquet files.
fn column(column: Column) -> (Field, ArrayRef) {
    let (kind, nullable, array): (_, _, ArrayRef) = match column.values {
        Values::Number(v) => {
            let nulls = v.iter().any(|x| x.is_nan()).then(|| v.iter().map(|x| !x.is_nan()).collect());
            (DataType::Float64, true, Arc::new(Float64Array::new(v.into(), nulls)))
        }
        Values::Text(v) => (DataType::Utf8, false, Arc::new(StringArray::from(v))),
        Values::Flag(v) => (DataType::Boolean, false, Arc::new(BooleanArray::from(v))),
    };
    let about = HashMap::from([("about".to_owned(), column.about)]);
    (Field::new(column.name, kind, nullable).with_metadata(about), array)
}

#[pymethods]
impl Table {
    /// Name, as of the files of an export.
    #[getter]
    fn name(&self) -> &'static str {
        self.name
    }

    /// What a row is.
    #[getter]
    fn about(&self) -> &'static str {
        self.about
    }

    /// Meaning of each column by its name.
    #[getter]
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, about) in &self.columns {
            dict.set_item(name, about)?;
        }
        Ok(dict)
    }

    fn __len__(&self) -> usize {
        self.batch.num_rows()
    }

    fn __repr__(&self) -> String {
        format!(
            "<gaware.Table {}: {} rows, {} columns>",
            self.name,
            self.batch.num_rows(),
            self.columns.len()
        )
    }

    /// The Arrow PyCapsule interface. The stream has the types of the table: a requested schema is not followed, as the interface allows.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        let batches = RecordBatchIterator::new([Ok(self.batch.clone())], self.batch.schema());
        let stream = FFI_ArrowArrayStream::new(Box::new(batches));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }

    /// As a pandas.DataFrame.
    fn to_pandas<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        Self::to_pyarrow(slf)?.call_method0("to_pandas")
    }

    /// As a polars.DataFrame.
    fn to_polars<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("polars")?.call_method1("DataFrame", (slf,))
    }

    /// As a pyarrow.Table.
    fn to_pyarrow<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("pyarrow")?.call_method1("table", (slf,))
    }
}
