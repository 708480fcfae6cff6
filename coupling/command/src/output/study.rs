//! What `study` writes: one table as CSV and as Parquet, a row per run, also per run without results. Times stand apart, so that the same runs give the
//! same tables wherever they were carried out.

use std::io::{self, Write};
use std::sync::Arc;

use coupling::study::Study;
use coupling::study::rows::{Cell, OfGroup, Row, Rows};
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

use super::tables::cell;

/// Columns that say which run a row is.
const WHICH: [&str; 4] = ["run", "subject", "setting", "sample"];
/// Column that says whose values of the sample they are, where it has several.
const SET: &str = "set";
/// Columns that say how a run ended.
const ENDED: [&str; 2] = ["status", "reason"];

/// Columns of `indices.csv`.
const INDEX_COLUMNS: [&str; 9] = [
    "number",
    "subject",
    "setting",
    "vary",
    "samples",
    "first_order",
    "first_order_error",
    "total",
    "total_error",
];

/// Status of a run that is not done.
const MISSING: &str = "missing";

/// `table.csv`. What varies is written with its value in the run; numbers of runs without results are empty.
pub fn write_csv(w: &mut dyn Write, study: &Study, rows: &Rows) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(w);
    let names = rows.inputs.iter().chain(&rows.numbers).map(String::as_str);
    let set = study.indices.then_some(SET);
    csv.write_record(WHICH.into_iter().chain(set).chain(ENDED).chain(names))?;
    for (run, row) in rows.runs.iter().enumerate() {
        let of = |f: &dyn Fn(&Row) -> String| row.as_ref().map_or(String::new(), f);
        let which = [
            run.to_string(),
            of(&|r| study.subjects[r.subject].name.clone()),
            of(&|r| study.settings[r.setting].name.clone()),
            of(&|r| r.sample.to_string()),
        ];
        let set = study.indices.then(|| of(&|r| study.set_name(r.set).to_string()));
        let ended = [status(row.as_ref()).to_string(), of(&|r| r.reason.clone().unwrap_or_default())];
        let inputs = (0..rows.inputs.len()).map(|k| {
            of(&|r| match &r.values[k] {
                Cell::Number(number) => cell(*number),
                Cell::Word(word) => word.clone(),
            })
        });
        let number = |k: usize| row.as_ref().and_then(|r| rows.number(r, k));
        let numbers = (0..rows.numbers.len()).map(|k| number(k).map_or(String::new(), cell));
        csv.write_record(which.into_iter().chain(set).chain(ended).chain(inputs).chain(numbers))?;
    }
    csv.flush()
}

fn status(row: Option<&Row>) -> &'static str {
    row.map_or(MISSING, |row| row.status.name())
}

/// `seconds.csv`: what every run took.
pub fn write_seconds(w: &mut dyn Write, rows: &Rows) -> io::Result<()> {
    writeln!(w, "run,seconds")?;
    rows.done().try_for_each(|(run, row)| writeln!(w, "{run},{}", cell(row.seconds)))
}

/// `indices.csv`: Sobol indices with their standard errors.
pub fn write_indices(w: &mut dyn Write, study: &Study, rows: &Rows, indices: &[OfGroup]) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(w);
    csv.write_record(INDEX_COLUMNS)?;
    for of in indices {
        let [first, total] = [of.index.first, of.index.total].map(|pair| pair.map(cell));
        csv.write_record([
            rows.numbers[of.number].as_str(),
            &study.subjects[of.subject].name,
            &study.settings[of.setting].name,
            &study.groups[of.group],
            &of.samples.to_string(),
            &first[0],
            &first[1],
            &total[0],
            &total[1],
        ])?;
    }
    csv.flush()
}

/// A column of the Parquet table.
enum Column {
    Count(Vec<Option<i64>>),
    Number(Vec<Option<f64>>),
    Word(Vec<Option<ByteArray>>),
}

/// `table.parquet`: the same table, one row group; cells that are empty in the CSV are null.
pub fn write_parquet(w: &mut dyn Write, study: &Study, rows: &Rows) -> io::Result<()> {
    let columns = columns(study, rows);
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

fn columns<'a>(study: &'a Study, rows: &'a Rows) -> Vec<(String, Column)> {
    let runs = || rows.runs.iter().map(Option::as_ref);
    let word = |of: &dyn Fn(&'a Row) -> Option<&'a str>| {
        Column::Word(runs().map(|r| r.and_then(of).map(ByteArray::from)).collect())
    };
    let mut columns = vec![
        ("run".to_string(), Column::Count((0..rows.runs.len()).map(|run| Some(run as i64)).collect())),
        ("subject".into(), word(&|r| Some(&study.subjects[r.subject].name))),
        ("setting".into(), word(&|r| Some(&study.settings[r.setting].name))),
        ("sample".into(), Column::Count(runs().map(|r| Some(r?.sample as i64)).collect())),
    ];
    if study.indices {
        columns.push((SET.into(), word(&|r| Some(study.set_name(r.set)))));
    }
    let statuses = runs().map(|r| Some(ByteArray::from(status(r)))).collect();
    columns.push(("status".into(), Column::Word(statuses)));
    columns.push(("reason".into(), word(&|r| r.reason.as_deref())));
    for (k, name) in rows.inputs.iter().enumerate() {
        let is_word = runs().flatten().any(|r| matches!(r.values[k], Cell::Word(_)));
        let column = match is_word {
            true => Column::Word(
                runs()
                    .map(|r| {
                        Some(match &r?.values[k] {
                            Cell::Word(word) => ByteArray::from(word.as_str()),
                            Cell::Number(number) => ByteArray::from(cell(*number).as_str()),
                        })
                    })
                    .collect(),
            ),
            false => Column::Number(
                runs().map(|r| if let Cell::Number(n) = r?.values[k] { Some(n) } else { None }).collect(),
            ),
        };
        columns.push((name.clone(), column));
    }
    for (k, name) in rows.numbers.iter().enumerate() {
        columns.push((name.clone(), Column::Number(runs().map(|r| rows.number(r?, k)).collect())));
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
