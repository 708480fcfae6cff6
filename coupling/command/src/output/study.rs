//! What `study` writes: one table as CSV and as Parquet, a row per run, also per run without results. Times stand apart, so that the same runs give the
//! same tables wherever they were carried out.

use std::io::{self, Write};
use std::sync::Arc;

use coupling::study::rows::Rows;
use coupling::study::run::Done;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

use super::tables::cell;

/// Columns that say which run a row is, and how it ended.
const WHICH: [&str; 6] = ["run", "subject", "setting", "sample", "status", "reason"];

/// Status of a run that is not done.
const MISSING: &str = "missing";

/// `table.csv`. What varies is written with its value in the run; numbers of runs without results are empty.
pub fn write_csv(w: &mut dyn Write, rows: &Rows) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(w);
    csv.write_record(
        WHICH
            .into_iter()
            .chain(rows.inputs.iter().map(String::as_str))
            .chain(rows.numbers.iter().map(String::as_str)),
    )?;
    for (run, done) in rows.runs.iter().enumerate() {
        let which = match done {
            Some(d) => [
                run.to_string(),
                d.subject.clone(),
                d.setting.clone(),
                d.sample.to_string(),
                d.status.name().to_string(),
                d.reason.clone().unwrap_or_default(),
            ],
            None => [run.to_string(), "".into(), "".into(), "".into(), MISSING.into(), "".into()],
        };
        let inputs = rows
            .inputs
            .iter()
            .map(|name| input(done.as_ref(), name).map_or(String::new(), |v| v.to_string()));
        let numbers = rows.numbers.iter().map(|name| number(done.as_ref(), name).map_or(String::new(), cell));
        csv.write_record(which.into_iter().chain(inputs).chain(numbers))?;
    }
    csv.flush()
}

/// A value of what varies: a number as JSON writes it, or a word.
enum Input<'a> {
    Number(f64),
    Word(&'a str),
}

impl std::fmt::Display for Input<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Input::Number(number) => f.write_str(&cell(*number)),
            Input::Word(word) => f.write_str(word),
        }
    }
}

fn input<'a>(done: Option<&'a Done>, name: &str) -> Option<Input<'a>> {
    match done?.values.get(name)? {
        serde_json::Value::String(word) => Some(Input::Word(word)),
        value => value.as_f64().map(Input::Number),
    }
}

fn number(done: Option<&Done>, name: &str) -> Option<f64> {
    done?.numbers.get(name).copied()
}

/// `seconds.csv`: what every run took.
pub fn write_seconds(w: &mut dyn Write, rows: &Rows) -> io::Result<()> {
    writeln!(w, "run,seconds")?;
    rows.done().try_for_each(|done| writeln!(w, "{},{}", done.run, cell(done.seconds)))
}

/// A column of the Parquet table.
enum Column {
    Count(Vec<Option<i64>>),
    Number(Vec<Option<f64>>),
    Word(Vec<Option<ByteArray>>),
}

/// `table.parquet`: the same table, one row group; cells that are empty in the CSV are null.
pub fn write_parquet(w: &mut dyn Write, rows: &Rows) -> io::Result<()> {
    let columns = columns(rows);
    let schema = schema(&columns).map_err(io::Error::other)?;
    let mut bytes = Vec::new();
    let properties = Arc::new(WriterProperties::builder().build());
    let mut writer =
        SerializedFileWriter::new(&mut bytes, Arc::new(schema), properties).map_err(io::Error::other)?;
    let mut group = writer.next_row_group().map_err(io::Error::other)?;
    columns.iter().try_for_each(|(_, column)| write_column(&mut group, column)).map_err(io::Error::other)?;
    group.close().map_err(io::Error::other)?;
    writer.close().map_err(io::Error::other)?;
    w.write_all(&bytes)
}

fn columns(rows: &Rows) -> Vec<(String, Column)> {
    let word = |of: &dyn Fn(&Done) -> Option<String>| {
        Column::Word(
            rows.runs.iter().map(|d| d.as_ref().and_then(of).map(|w| ByteArray::from(w.as_str()))).collect(),
        )
    };
    let status = |d: &Option<Done>| d.as_ref().map_or(MISSING, |d| d.status.name());
    let mut columns = vec![
        ("run".to_string(), Column::Count((0..rows.runs.len()).map(|run| Some(run as i64)).collect())),
        ("subject".into(), word(&|d| Some(d.subject.clone()))),
        ("setting".into(), word(&|d| Some(d.setting.clone()))),
        ("sample".into(), Column::Count(rows.runs.iter().map(|d| Some(d.as_ref()?.sample as i64)).collect())),
        ("status".into(), Column::Word(rows.runs.iter().map(|d| Some(ByteArray::from(status(d)))).collect())),
        ("reason".into(), word(&|d| d.reason.clone())),
    ];
    for name in &rows.inputs {
        let values: Vec<Option<Input>> = rows.runs.iter().map(|d| input(d.as_ref(), name)).collect();
        let is_word = values.iter().flatten().any(|v| matches!(v, Input::Word(_)));
        let column = match is_word {
            true => Column::Word(
                values.iter().map(|v| v.as_ref().map(|v| ByteArray::from(v.to_string().as_str()))).collect(),
            ),
            false => Column::Number(
                values
                    .iter()
                    .map(|v| v.as_ref().and_then(|v| if let Input::Number(n) = v { Some(*n) } else { None }))
                    .collect(),
            ),
        };
        columns.push((name.clone(), column));
    }
    for name in &rows.numbers {
        columns.push((
            name.clone(),
            Column::Number(rows.runs.iter().map(|d| number(d.as_ref(), name)).collect()),
        ));
    }
    columns
}

fn schema(columns: &[(String, Column)]) -> parquet::errors::Result<Type> {
    let field = |(name, column): &(String, Column)| {
        let (physical, logical) = match column {
            Column::Count(_) => (Physical::INT64, None),
            Column::Number(_) => (Physical::DOUBLE, None),
            Column::Word(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let builder = Type::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL);
        builder.with_logical_type(logical).build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    Type::group_type_builder("study").with_fields(fields).build()
}

fn write_column<W: Write + Send>(
    group: &mut SerializedRowGroupWriter<W>,
    column: &Column,
) -> parquet::errors::Result<()> {
    let mut writer = group.next_column()?.expect("a column of the schema");
    match column {
        Column::Count(values) => {
            let (present, levels) = levels(values);
            writer.typed::<Int64Type>().write_batch(&present, Some(&levels), None)?;
        }
        Column::Number(values) => {
            let (present, levels) = levels(values);
            writer.typed::<DoubleType>().write_batch(&present, Some(&levels), None)?;
        }
        Column::Word(values) => {
            let (present, levels) = levels(values);
            writer.typed::<ByteArrayType>().write_batch(&present, Some(&levels), None)?;
        }
    }
    writer.close()
}

/// What is there, and for every row whether it is.
fn levels<T: Clone>(values: &[Option<T>]) -> (Vec<T>, Vec<i16>) {
    (values.iter().flatten().cloned().collect(), values.iter().map(|v| i16::from(v.is_some())).collect())
}
