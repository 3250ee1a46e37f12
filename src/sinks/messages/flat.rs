//! What readers of recordings can plot: flat objects with schemas that every parser takes.
//!
//! Foxglove reads JSON schemas without references, unions with null and arrays of arrays. [`plain`] brings derived schemas into that form;
//! [`States`] gives the estimate as the columns of the export's table of states.

use crate::engine::snapshot::Snapshot;
use crate::export::table::{Cell, Put, Row};
use crate::export::{Table, flat_object, flat_schema};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value};

/// The schema of a type, inline, without unions with null.
pub fn plain<T: JsonSchema>() -> Value {
    let mut settings = SchemaSettings::draft07();
    settings.inline_subschemas = true;
    let mut schema = Value::from(settings.into_generator().into_root_schema_for::<T>());
    without_null(&mut schema);
    schema
}

/// What may be null is written only where it is not.
fn without_null(schema: &mut Value) {
    match schema {
        Value::Object(map) => {
            if let Some(Value::Array(types)) = map.get("type") {
                let own = types.iter().find(|t| **t != "null").cloned().unwrap_or_default();
                map.insert("type".to_owned(), own);
            }
            map.values_mut().for_each(without_null);
        }
        Value::Array(all) => all.iter_mut().for_each(without_null),
        _ => {}
    }
}

/// The estimate at one instant as a row of the table of states.
pub struct States(Table);

/// When.
struct At<'a>(&'a Snapshot);

impl Row for At<'_> {
    fn visit(&self, put: &mut Put<'_>) {
        put("elapsed_s", "Time since the first sample, s", Cell::Number(self.0.elapsed_s));
        put("t_s", "Time on the autopilot's base (since boot), s", Cell::Number(self.0.t_s));
    }
}

impl States {
    /// Of this snapshot.
    pub fn new(snapshot: &Snapshot) -> Self {
        let mut table =
            Table::new("states", "The estimate: motion, attitude, biases, G, innovations, with sigmas.");
        table.push(&[&At(snapshot), snapshot]);
        Self(table)
    }

    /// Names of the columns: effects have theirs as soon as they are estimated.
    pub fn names(&self) -> Vec<String> {
        self.0.columns.iter().map(|c| c.name.clone()).collect()
    }

    /// The schema of these columns.
    pub fn schema(&self) -> Value {
        flat_schema(&self.0)
    }

    /// The row; what there is no value of is not in it.
    pub fn object(&self) -> Map<String, Value> {
        flat_object(&self.0, 0)
    }
}
