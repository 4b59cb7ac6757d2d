//! Numeric columns of Arrow tables, as `f64`.

use std::collections::BTreeMap;

use arrow_array::cast::AsArray;
use arrow_array::types::{
    Float16Type, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type, UInt32Type,
};
use arrow_array::{Array, GenericListArray, OffsetSizeTrait, RecordBatch};
use arrow_schema::DataType;

/// Image files in a column, `None` where a row has none: in the field `bytes` of a structure, or the column itself.
/// `None` for a column of another type.
pub fn image_files(column: &dyn Array) -> Option<Vec<Option<&[u8]>>> {
    let within = column.as_struct_opt().and_then(|fields| fields.column_by_name("bytes"));
    let files: &dyn Array = within.map_or(column, |files| files);
    let small = files.as_binary_opt::<i32>().map(|files| files.iter().collect());
    small.or_else(|| Some(files.as_binary_opt::<i64>()?.iter().collect()))
}

/// Numeric columns of one episode by name.
pub type Rows = BTreeMap<String, Column>;

/// Column of vectors, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column {
    /// Element type as in `info.json`, e.g. `float32`.
    pub dtype: &'static str,
    /// Number of elements per row.
    pub width: usize,
    /// Elements of all rows, row by row.
    pub values: Vec<f64>,
}

impl Column {
    /// Column of an Arrow array; `None` if the array is not numeric or its rows differ in length.
    pub fn of(array: &dyn Array) -> Option<Self> {
        if array.null_count() > 0 {
            return None;
        }
        let plain = |dtype, values| Some(Self { dtype, width: 1, values });
        match array.data_type() {
            DataType::Float32 => {
                plain("float32", array.as_primitive::<Float32Type>().values().iter().map(|v| f64::from(*v)).collect())
            }
            DataType::Float16 => {
                plain("float16", array.as_primitive::<Float16Type>().values().iter().map(|v| v.to_f64()).collect())
            }
            DataType::Int8 => {
                plain("int8", array.as_primitive::<Int8Type>().values().iter().map(|v| f64::from(*v)).collect())
            }
            DataType::Int16 => {
                plain("int16", array.as_primitive::<Int16Type>().values().iter().map(|v| f64::from(*v)).collect())
            }
            DataType::UInt8 => {
                plain("uint8", array.as_primitive::<UInt8Type>().values().iter().map(|v| f64::from(*v)).collect())
            }
            DataType::UInt16 => {
                plain("uint16", array.as_primitive::<UInt16Type>().values().iter().map(|v| f64::from(*v)).collect())
            }
            DataType::UInt32 => {
                plain("uint32", array.as_primitive::<UInt32Type>().values().iter().map(|v| f64::from(*v)).collect())
            }
            DataType::Float64 => plain("float64", array.as_primitive::<Float64Type>().values().to_vec()),
            DataType::Int32 => {
                plain("int32", array.as_primitive::<Int32Type>().values().iter().map(|v| f64::from(*v)).collect())
            }
            DataType::Int64 => {
                plain("int64", array.as_primitive::<Int64Type>().values().iter().map(|v| *v as f64).collect())
            }
            DataType::Boolean => {
                plain("bool", array.as_boolean().values().iter().map(|v| f64::from(u8::from(v))).collect())
            }
            DataType::FixedSizeList(..) => {
                let lists = array.as_fixed_size_list();
                let width = usize::try_from(lists.value_length()).ok()?;
                let inner = Self::of(lists.values())?;
                Some(Self { width: width * inner.width, ..inner })
            }
            DataType::List(_) => Self::of_lists(array.as_list::<i32>()),
            DataType::LargeList(_) => Self::of_lists(array.as_list::<i64>()),
            _ => None,
        }
    }

    fn of_lists<Offset: OffsetSizeTrait>(lists: &GenericListArray<Offset>) -> Option<Self> {
        let rows = lists.len();
        let width = if rows == 0 { 0 } else { lists.value_length(0).as_usize() };
        let is_even = (0..rows).all(|row| lists.value_length(row).as_usize() == width);
        let (from, to) = (lists.value_offsets().first()?.as_usize(), lists.value_offsets().last()?.as_usize());
        let inner = Self::of(&lists.values().slice(from, to - from))?;
        is_even.then_some(Self { width: width * inner.width, ..inner })
    }

    /// Elements of one row.
    pub fn row(&self, row: usize) -> &[f64] {
        self.values.get(row * self.width..(row + 1) * self.width).unwrap_or_default()
    }
}

/// Numbers of one cell, nested lists flattened; `None` for text and null cells.
pub fn cell(batch: &RecordBatch, name: &str, row: usize) -> Option<Vec<f64>> {
    let column = batch.column_by_name(name)?;
    if row >= column.len() { None } else { Some(Column::of(&column.slice(row, 1))?.values) }
}

/// Text of a cell, with the count 1; for a list of texts, the first one and the length of the list. `None` for other
/// types.
pub fn text(batch: &RecordBatch, name: &str, row: usize) -> Option<(String, usize)> {
    let column = batch.column_by_name(name)?;
    if row >= column.len() || column.is_null(row) {
        return None;
    }
    match column.data_type() {
        DataType::Utf8 => Some((column.as_string::<i32>().value(row).to_owned(), 1)),
        DataType::LargeUtf8 => Some((column.as_string::<i64>().value(row).to_owned(), 1)),
        DataType::List(_) => {
            let texts = column.as_list::<i32>().value(row);
            let first = texts.as_string_opt::<i32>().filter(|texts| !texts.is_empty())?.value(0).to_owned();
            Some((first, texts.len()))
        }
        _ => None,
    }
}

/// All texts of a cell that holds a list of texts; `None` for other types.
pub fn texts(batch: &RecordBatch, name: &str, row: usize) -> Option<Vec<String>> {
    let lists = batch.column_by_name(name)?.as_list_opt::<i32>()?;
    if row >= lists.len() || lists.is_null(row) {
        return None;
    }
    let texts = lists.value(row);
    Some(texts.as_string_opt::<i32>()?.iter().map(|text| text.unwrap_or_default().to_owned()).collect())
}

/// Integer in a cell; `None` if it is null or of another type.
pub fn integer(batch: &RecordBatch, name: &str, row: usize) -> Option<i64> {
    let column = batch.column_by_name(name)?.as_primitive_opt::<Int64Type>()?;
    (row < column.len() && !column.is_null(row)).then(|| column.value(row))
}
