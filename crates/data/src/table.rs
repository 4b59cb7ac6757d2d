//! Arrow columns and Parquet files.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::types::{Float64Type, Int32Type, Int64Type};
use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, BinaryArray, BooleanArray, FixedSizeListArray, ListArray, PrimitiveArray,
    RecordBatch, StringArray, StructArray,
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::arrow_reader::{ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder};
use parquet::arrow::{ArrowWriter, ProjectionMask};
use parquet::basic::Compression;
use parquet::errors::ParquetError;
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::properties::{EnabledStatistics, WriterProperties};

use crate::panics::catch_panics;
use crate::{DataError, files};

/// Columns under construction, in insertion order; all must have the same number of rows.
#[derive(Debug, Default)]
pub struct Columns {
    fields: Vec<Field>,
    arrays: Vec<ArrayRef>,
}

impl Columns {
    /// Adds a column of 64-bit floats without nulls.
    pub fn f64(&mut self, name: &str, values: impl IntoIterator<Item = f64>) {
        self.push(name, Arc::new(PrimitiveArray::<Float64Type>::from_iter_values(values)), false);
    }

    /// Adds a column of signed 64-bit integers without nulls.
    pub fn i64(&mut self, name: &str, values: impl IntoIterator<Item = i64>) {
        self.push(name, Arc::new(PrimitiveArray::<Int64Type>::from_iter_values(values)), false);
    }

    /// Adds a column of 32-bit integers, some of which may be null.
    pub fn optional_i32(&mut self, name: &str, values: impl IntoIterator<Item = Option<i32>>) {
        self.push(name, Arc::new(PrimitiveArray::<Int32Type>::from_iter(values)), true);
    }

    /// Adds a column of truth values.
    pub fn bool(&mut self, name: &str, values: impl IntoIterator<Item = bool>) {
        let values: Vec<bool> = values.into_iter().collect();
        self.push(name, Arc::new(BooleanArray::from(values)), false);
    }

    /// Adds a column of truth values, some of which may be null.
    pub fn optional_bool(&mut self, name: &str, values: impl IntoIterator<Item = Option<bool>>) {
        let values: Vec<Option<bool>> = values.into_iter().collect();
        self.push(name, Arc::new(BooleanArray::from(values)), true);
    }

    /// Adds a column of UTF-8 texts without nulls.
    pub fn text<S: AsRef<str>>(&mut self, name: &str, values: impl IntoIterator<Item = S>) {
        self.push(name, Arc::new(StringArray::from_iter_values(values)), false);
    }

    /// Adds a column of variable-length lists.
    pub fn lists<T: ArrowPrimitiveType>(&mut self, name: &str, rows: &[&[T::Native]]) {
        let values = PrimitiveArray::<T>::from_iter_values(rows.iter().flat_map(|row| row.iter().copied()));
        self.nested(name, Arc::new(values), rows.iter().map(|row| row.len()));
    }

    /// Adds a column of variable-length lists of texts.
    pub fn text_lists<T: AsRef<str>>(&mut self, name: &str, rows: &[impl AsRef<[T]>]) {
        let values = StringArray::from_iter_values(rows.iter().flat_map(AsRef::as_ref));
        self.nested(name, Arc::new(values), rows.iter().map(|row| row.as_ref().len()));
    }

    /// Adds a column of fixed-size lists; length 1 gives a scalar column.
    pub fn vectors<T: ArrowPrimitiveType>(&mut self, name: &str, length: usize, values: Vec<T::Native>) {
        let values: ArrayRef = Arc::new(PrimitiveArray::<T>::from_iter_values(values));
        if length == 1 {
            return self.push(name, values, false);
        }
        let item = Arc::new(Field::new("item", values.data_type().clone(), false));
        let array = FixedSizeListArray::new(item, i32::try_from(length).unwrap_or(i32::MAX), values, None);
        self.push(name, Arc::new(array), false);
    }

    /// Adds a column of images in the layout of the `datasets` library: a struct of the file's bytes and an unused
    /// path.
    pub fn images(&mut self, name: &str, files: &[Vec<u8>]) {
        let bytes: ArrayRef = Arc::new(BinaryArray::from_iter_values(files));
        let paths: ArrayRef = Arc::new(StringArray::new_null(files.len()));
        let array = StructArray::from(vec![
            (Arc::new(Field::new("bytes", DataType::Binary, true)), bytes),
            (Arc::new(Field::new("path", DataType::Utf8, true)), paths),
        ]);
        self.push(name, Arc::new(array), true);
    }

    /// Adds a column of nested lists of shape `[C][1][1]` per row, as LeRobot stores image statistics.
    pub fn channel_lists(&mut self, name: &str, rows: &[&[f64]]) {
        let ones = || std::iter::repeat_n(1, rows.iter().map(|row| row.len()).sum());
        let values = PrimitiveArray::<Float64Type>::from_iter_values(rows.iter().flat_map(|row| row.iter().copied()));
        let inner = list_of(Arc::new(values), ones());
        let middle = list_of(inner, ones());
        self.nested(name, middle, rows.iter().map(|row| row.len()));
    }

    /// The columns as a record batch.
    ///
    /// # Errors
    /// If their lengths differ.
    pub fn batch(self) -> Result<RecordBatch, arrow_schema::ArrowError> {
        RecordBatch::try_new(Arc::new(Schema::new(self.fields)), self.arrays)
    }

    fn nested(&mut self, name: &str, values: ArrayRef, lengths: impl IntoIterator<Item = usize>) {
        self.push(name, list_of(values, lengths), false);
    }

    fn push(&mut self, name: &str, array: ArrayRef, nullable: bool) {
        self.fields.push(Field::new(name, array.data_type().clone(), nullable));
        self.arrays.push(array);
    }
}

fn list_of(values: ArrayRef, lengths: impl IntoIterator<Item = usize>) -> ArrayRef {
    let item = Arc::new(Field::new("item", values.data_type().clone(), false));
    Arc::new(ListArray::new(item, OffsetBuffer::from_lengths(lengths), values, None))
}

/// Intended use of a table, which determines its encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Native store: no dictionary encoding, to keep every bit, -0.0 included.
    Record,
    /// Data sets: small, with column statistics per row group, by which readers find episodes.
    Dataset,
}

/// Parquet writer: Snappy, one row group per batch. Equal batches give equal bytes.
#[derive(Debug)]
pub struct TableWriter {
    writer: ArrowWriter<Vec<u8>>,
    path: std::path::PathBuf,
}

impl TableWriter {
    /// A writer; `path` is used in error messages only.
    pub fn new(path: &Path, schema: Arc<Schema>, purpose: Purpose) -> Result<Self, DataError> {
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_dictionary_enabled(purpose == Purpose::Dataset)
            .set_statistics_enabled(match purpose {
                Purpose::Record => EnabledStatistics::None,
                Purpose::Dataset => EnabledStatistics::Chunk,
            })
            .set_max_row_group_row_count(None)
            .set_created_by("genmanip".into())
            .build();
        let writer = ArrowWriter::try_new(Vec::new(), schema, Some(properties))
            .map_err(|error| DataError::table(path, error))?;
        Ok(Self { writer, path: path.to_owned() })
    }

    /// Appends rows to the row group that [`TableWriter::finish`] closes.
    pub fn add(&mut self, batch: &RecordBatch) -> Result<(), DataError> {
        self.writer.write(batch).map_err(|error| DataError::table(&self.path, error))
    }

    /// Writes a batch as a row group of its own.
    pub fn write(&mut self, batch: &RecordBatch) -> Result<(), DataError> {
        self.writer.write(batch).and_then(|()| self.writer.flush()).map_err(|error| DataError::table(&self.path, error))
    }

    /// Writes the footer; returns the bytes of the file.
    pub fn finish(self) -> Result<Vec<u8>, DataError> {
        let path = self.path;
        self.writer.into_inner().map_err(|error| DataError::table(&path, error))
    }
}

/// Encodes a Parquet file with one row group; `metadata` is added to the schema.
pub fn to_parquet(
    path: &Path,
    columns: Columns,
    purpose: Purpose,
    metadata: Option<(&str, String)>,
) -> Result<Vec<u8>, DataError> {
    let batch = columns.batch().map_err(|error| DataError::table(path, error))?;
    // At most one entry, so the iteration order is deterministic.
    let metadata: std::collections::HashMap<String, String> =
        metadata.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    let schema = Arc::new(batch.schema().as_ref().clone().with_metadata(metadata));
    let batch = batch.with_schema(Arc::clone(&schema)).map_err(|error| DataError::table(path, error))?;
    let mut writer = TableWriter::new(path, schema, purpose)?;
    writer.write(&batch)?;
    writer.finish()
}

/// Maximum size of decoded columns, bytes. Bounds memory for damaged or hostile files.
const MAX_TABLE_BYTES: i64 = 512 << 20;

/// Batch size when streaming a data set, rows. Chosen by hand: bounds memory.
const ROWS_PER_BATCH: usize = 4096;

fn uncompressed_size(column: &ColumnChunkMetaData) -> i64 {
    let (bytes, entries) = (column.uncompressed_size(), column.num_values());
    // A negative size is invalid and must not cancel out in a sum.
    if bytes < 0 || entries < 0 { i64::MAX } else { bytes.max(entries.saturating_mul(8)) }
}

/// All rows of a Parquet file in one batch; an error unless there are `rows` of them.
pub fn from_parquet(path: &Path, bytes: Vec<u8>, rows: usize) -> Result<RecordBatch, DataError> {
    let fail = |error: ParquetError| DataError::table(path, error);
    let opened = catch_panics(path, || ParquetRecordBatchReaderBuilder::try_new(bytes::Bytes::from(bytes)))?;
    let builder = opened.map_err(fail)?;
    let about = builder.metadata();
    if usize::try_from(about.file_metadata().num_rows()).ok() != Some(rows) {
        let got = about.file_metadata().num_rows();
        return Err(DataError::table(path, format!("expected {rows} rows according to episode.json, got {got}")));
    }
    let columns = || about.row_groups().iter().flat_map(|group| group.columns());
    let total = columns().map(uncompressed_size).fold(0_i64, i64::saturating_add);
    if total > MAX_TABLE_BYTES {
        let expected = MAX_TABLE_BYTES >> 20;
        return Err(DataError::table(path, format!("expected columns of at most {expected} MiB, got {total} bytes")));
    }
    let schema = Arc::clone(builder.schema());
    let mut reader = builder.with_batch_size(rows.max(1)).build().map_err(fail)?;
    let batch = match catch_panics(path, || reader.next())? {
        Some(batch) => batch.map_err(|error| DataError::table(path, error))?,
        None => RecordBatch::new_empty(schema),
    };
    if batch.num_rows() == rows {
        return Ok(batch);
    }
    Err(DataError::table(path, format!("expected {rows} rows, got {}", batch.num_rows())))
}

/// A Parquet file, read by columns in batches.
pub struct Table {
    path: PathBuf,
    builder: ParquetRecordBatchReaderBuilder<File>,
}

impl Table {
    /// Opens a Parquet file.
    ///
    /// # Errors
    /// If it cannot be read or is not a Parquet file.
    pub fn open(path: &Path) -> Result<Self, DataError> {
        let file = files::open(path)?;
        let opened = catch_panics(path, || ParquetRecordBatchReaderBuilder::try_new(file))?;
        let builder = opened.map_err(|error| DataError::table(path, error))?;
        Ok(Self { path: path.into(), builder })
    }

    /// All rows of the selected columns in one batch.
    pub fn whole(self, is_wanted: impl Fn(&str) -> bool) -> Result<RecordBatch, DataError> {
        let rows = usize::try_from(self.builder.metadata().file_metadata().num_rows()).unwrap_or(0);
        let names = self.names();
        let wanted: Vec<&str> = names.iter().map(String::as_str).filter(|name| is_wanted(name)).collect();
        let (path, schema) = (self.path.clone(), Arc::clone(self.builder.schema()));
        // The column sizes are checked before memory for the rows is allocated.
        match self.batches(&wanted, rows.max(1))?.next() {
            Some(batch) if batch.as_ref().is_ok_and(|batch| batch.num_rows() != rows) => {
                Err(DataError::table(&path, format!("expected {rows} rows in one batch")))
            }
            Some(batch) => batch,
            None => Ok(RecordBatch::new_empty(schema)),
        }
    }

    /// Names of all columns in the file.
    pub fn names(&self) -> Vec<String> {
        let schema = self.builder.parquet_schema();
        schema.root_schema().get_fields().iter().map(|field| field.name().to_owned()).collect()
    }

    /// The given columns in batches.
    pub fn columns(
        self,
        names: &[&str],
    ) -> Result<impl Iterator<Item = Result<RecordBatch, DataError>> + use<>, DataError> {
        self.batches(names, ROWS_PER_BATCH)
    }

    /// The given columns in batches of at most `rows_per_batch` rows.
    pub fn batches(
        self,
        names: &[&str],
        rows_per_batch: usize,
    ) -> Result<impl Iterator<Item = Result<RecordBatch, DataError>> + use<>, DataError> {
        let Self { path, builder } = self;
        let schema = builder.parquet_schema();
        let known: Vec<&str> = schema.root_schema().get_fields().iter().map(|field| field.name()).collect();
        if let Some(missing) = names.iter().find(|name| !known.contains(*name)) {
            return Err(DataError::table(&path, format!("no column `{missing}`")));
        }
        let roots = names.iter().filter_map(|name| known.iter().position(|other| other == name));
        let mask = ProjectionMask::roots(schema, roots);
        let sizes = builder.metadata().row_groups().iter().map(|group| {
            let chosen = group.columns().iter().enumerate().filter(|(leaf, _)| mask.leaf_included(*leaf));
            chosen.map(|(_, column)| uncompressed_size(column)).fold(0_i64, i64::saturating_add)
        });
        if let Some(size) = sizes.into_iter().find(|size| !(0..=MAX_TABLE_BYTES).contains(size)) {
            let expected = MAX_TABLE_BYTES >> 20;
            return Err(DataError::table(
                &path,
                format!("expected columns of at most {expected} MiB, got {size} bytes"),
            ));
        }
        let reader = builder.with_projection(mask).with_batch_size(rows_per_batch).build();
        let mut reader = reader.map_err(|error| DataError::table(&path, error))?;
        let mut is_over = false;
        Ok(std::iter::from_fn(move || {
            let batch = if is_over { None } else { Some(catch_panics(&path, || reader.next())) };
            let batch = match batch? {
                Ok(batch) => batch?.map_err(|error| DataError::table(&path, error)),
                Err(damaged) => Err(damaged),
            };
            // Stop after an error, as the decoder's state is undefined.
            is_over = batch.is_err();
            Some(batch)
        }))
    }
}

/// A Parquet file with random access by row group.
pub struct RowGroups {
    path: PathBuf,
    file: File,
    metadata: ArrowReaderMetadata,
    /// Index of the first row of each group.
    firsts: Vec<usize>,
}

impl RowGroups {
    /// Opens a Parquet file.
    ///
    /// # Errors
    /// If it cannot be read or is not a Parquet file.
    pub fn open(path: &Path) -> Result<Self, DataError> {
        let file = files::open(path)?;
        let metadata = catch_panics(path, || ArrowReaderMetadata::load(&file, ArrowReaderOptions::new()))?;
        let metadata = metadata.map_err(|error| DataError::table(path, error))?;
        let rows = |count: i64| usize::try_from(count).unwrap_or(usize::MAX);
        let mut next = 0_usize;
        let firsts = metadata.metadata().row_groups().iter().map(|group| {
            let first = next;
            next = next.saturating_add(rows(group.num_rows()));
            first
        });
        Ok(Self { path: path.into(), file, firsts: firsts.collect(), metadata })
    }

    /// Reads the row group that starts at row `first`, which must have `rows` rows.
    pub fn read(&self, first: usize, rows: usize) -> Result<RecordBatch, DataError> {
        let path = &self.path;
        let expected =
            || DataError::table(path, format!("expected one row group of {rows} rows starting at row {first}"));
        let group = self.firsts.binary_search(&first).map_err(|_| expected())?;
        let about = self.metadata.metadata().row_group(group);
        let size = about.columns().iter().map(uncompressed_size).fold(0_i64, i64::saturating_add);
        if !(0..=MAX_TABLE_BYTES).contains(&size) || usize::try_from(about.num_rows()).ok() != Some(rows) {
            return Err(expected());
        }
        let file = self.file.try_clone().map_err(DataError::io("read", &self.path))?;
        let builder = ParquetRecordBatchReaderBuilder::new_with_metadata(file, self.metadata.clone());
        let reader = builder.with_row_groups(vec![group]).with_batch_size(rows.max(1)).build();
        let mut reader = reader.map_err(|error| DataError::table(path, error))?;
        let batch = catch_panics(path, || reader.next())?.ok_or_else(expected)?;
        let batch = batch.map_err(|error| DataError::table(path, error))?;
        if batch.num_rows() == rows { Ok(batch) } else { Err(expected()) }
    }
}

/// Paths `chunk-…/file-….parquet` in a folder of a data set, sorted.
pub fn files_below(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut paths = Vec::new();
    for chunk in files::names(folder)?.iter().filter(|name| name.starts_with("chunk-")) {
        let chunk = folder.join(chunk);
        let names = files::names(&chunk)?;
        paths.extend(names.iter().filter(|name| name.ends_with(".parquet")).map(|name| chunk.join(name)));
    }
    Ok(paths)
}

/// Column of the given name and Arrow type; an error if it is missing or has another type. `path` is for messages.
pub fn column<'a, T: Array + 'static>(path: &Path, batch: &'a RecordBatch, name: &str) -> Result<&'a T, DataError> {
    let column = batch.column_by_name(name).ok_or_else(|| DataError::table(path, format!("no column `{name}`")))?;
    column.as_any().downcast_ref::<T>().ok_or_else(|| {
        DataError::table(path, format!("column `{name}` has the unexpected type {}", column.data_type()))
    })
}

/// Elements of a column of fixed-size lists, row-major; length 1 means a scalar column.
pub fn vector_column<T: ArrowPrimitiveType>(
    path: &Path,
    batch: &RecordBatch,
    name: &str,
    length: usize,
) -> Result<Vec<T::Native>, DataError> {
    if length == 1 {
        return Ok(column::<PrimitiveArray<T>>(path, batch, name)?.values().to_vec());
    }
    let lists: &FixedSizeListArray = column(path, batch, name)?;
    let values = lists.values();
    let numbers = values.as_any().downcast_ref::<PrimitiveArray<T>>();
    match numbers.filter(|_| usize::try_from(lists.value_length()).ok() == Some(length) && lists.null_count() == 0) {
        Some(numbers) => Ok(numbers.values().to_vec()),
        None => {
            let what = format!("column `{name}` holds {}, expected {length} numbers per row", lists.data_type());
            Err(DataError::table(path, what))
        }
    }
}

/// Lists of a column of lists, one per row.
pub fn list_column<T: ArrowPrimitiveType>(
    path: &Path,
    batch: &RecordBatch,
    name: &str,
) -> Result<Vec<Vec<T::Native>>, DataError> {
    let lists: &ListArray = column(path, batch, name)?;
    lists
        .iter()
        .map(|row| {
            let row = row.ok_or_else(|| DataError::table(path, format!("column `{name}` has a null entry")))?;
            let values = row
                .as_any()
                .downcast_ref::<PrimitiveArray<T>>()
                .ok_or_else(|| DataError::table(path, format!("column `{name}` holds {}", row.data_type())))?;
            Ok(values.values().to_vec())
        })
        .collect()
}
