//! A table as an Apache Parquet file. A number that is absent is null; the meaning of the columns is in the file's metadata under
//! their names.

use super::table::{Column, Table, Values};
use ::parquet::basic::{LogicalType, Repetition, Type as Physical};
use ::parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType};
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use ::parquet::schema::types::Type;
use std::io;
use std::sync::Arc;

/// The whole file.
pub fn bytes(table: &Table) -> io::Result<Vec<u8>> {
    written(table).map_err(io::Error::other)
}

fn written(table: &Table) -> Result<Vec<u8>, ParquetError> {
    let fields = table.columns.iter().map(|c| field(c).map(Arc::new)).collect::<Result<_, _>>()?;
    let schema = Type::group_type_builder(table.name).with_fields(fields).build()?;
    let about = table.columns.iter().map(|c| KeyValue::new(c.name.clone(), c.about.clone()));
    let mark = KeyValue::new("written_by".to_owned(), crate::outputs::mark::blank());
    let properties = WriterProperties::builder()
        .set_created_by(format!("gaware {}", env!("CARGO_PKG_VERSION")))
        .set_key_value_metadata(Some(about.chain([mark]).collect()))
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for column in &table.columns {
        let Some(mut out) = group.next_column()? else { break };
        put(&column.values, &mut out)?;
        out.close()?;
    }
    group.close()?;
    writer.into_inner()
}

fn field(column: &Column) -> Result<Type, ParquetError> {
    let (physical, repetition, logical) = match &column.values {
        Values::Number(_) => (Physical::DOUBLE, Repetition::OPTIONAL, None),
        Values::Text(_) => (Physical::BYTE_ARRAY, Repetition::REQUIRED, Some(LogicalType::String)),
        Values::Flag(_) => (Physical::BOOLEAN, Repetition::REQUIRED, None),
    };
    Type::primitive_type_builder(&column.name, physical)
        .with_repetition(repetition)
        .with_logical_type(logical)
        .build()
}

fn put(values: &Values, out: &mut SerializedColumnWriter<'_>) -> Result<(), ParquetError> {
    match values {
        Values::Number(v) => {
            let there: Vec<f64> = v.iter().copied().filter(|x| !x.is_nan()).collect();
            let levels: Vec<i16> = v.iter().map(|x| i16::from(!x.is_nan())).collect();
            out.typed::<DoubleType>().write_batch(&there, Some(&levels), None)?;
        }
        Values::Text(v) => {
            let words: Vec<ByteArray> = v.iter().map(|x| ByteArray::from(x.as_str())).collect();
            out.typed::<ByteArrayType>().write_batch(&words, None, None)?;
        }
        Values::Flag(v) => {
            out.typed::<BoolType>().write_batch(v, None, None)?;
        }
    }
    Ok(())
}
