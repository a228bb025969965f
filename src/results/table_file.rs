//! `initial.table`, `potential.N.table`, `inflow.table`: functions on tensor grids in HDF5 or CSV
//! files, which one rank reads for all.

use crate::base::checksum;
use crate::base::error::Error;
use crate::base::row_major::number;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, TIME, TableFile, TableOf};
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::table::{ShortTable, Table, TableAxis, check_size};
use crate::results::FileResult;
use crate::results::readback::numbers;
use crate::results::untrusted::{self, Inspection};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Largest size of a CSV file in bytes.
const MOST_TEXT: u64 = 256 << 20;

/// `case` with all tables that it names; those that were not read yet are read. Collective over
/// `world`.
///
/// # Errors
/// [`Error::Case`](crate::base::error::Error::Case), the same on all ranks, that says what is wrong
/// with a file.
pub fn with_tables<'a>(world: &Group, case: &'a Case) -> Result<Cow<'a, Case>, Error> {
    let mut case = Cow::Borrowed(case);
    for k in 0..case.tables.len() {
        if case.tables[k].checksum.is_none() {
            let table = read_for_all(world, &case, &case.tables[k])?;
            case = Cow::Owned(case.into_owned().with_table(k, table));
        }
    }
    Ok(case)
}

/// Reads the table of `file` for all ranks. It must cover the grid of `case`. Collective over
/// `world`.
fn read_for_all(world: &Group, case: &Case, file: &TableFile) -> Result<Table, Error> {
    let found = world.on_first_rank(|| {
        read(file).map(Some).map_err(|TableMistake { keys, what }| {
            let keys: Vec<String> =
                keys.iter().map(|key| format!("{}.{key}", file.of.key())).collect();
            case.wrong_table(file, &keys, &what)
        })
    })?;
    let table = shared(world, found).map_err(|what| file.wrong(&what))?;
    for (position, ends) in case.coordinate_ends() {
        if let Some(ShortTable { beyond, what }) = table.beyond(position, ends) {
            let keys = end_keys(position).into_iter().zip(beyond).filter(|(_, beyond)| *beyond);
            let keys: Vec<String> = keys.map(|(key, _)| key).collect();
            return Err(case.wrong_table(file, &keys, &what));
        }
    }
    Ok(table)
}

/// The keys of the ends of the coordinate at `position` in formulas.
fn end_keys(position: usize) -> [String; 2] {
    let (axis, ends) = match position {
        TIME => ("time".to_owned(), ["start", "end"]),
        0..MAX_DIMENSION => (format!("axis.{position}.x"), ["lower", "upper"]),
        _ => (format!("axis.{}.v", position - MAX_DIMENSION), ["lower", "upper"]),
    };
    ends.map(|end| format!("{axis}.{end}"))
}

/// A mistake in the file of a table, or in what the case expects there.
#[derive(Debug)]
struct TableMistake {
    /// The keys beside the table's `file` that may be wrong: `dataset`, `axes`.
    keys: &'static [&'static str],
    /// What is wrong.
    what: String,
}

impl TableMistake {
    fn by(keys: &'static [&'static str], what: String) -> Self {
        Self { keys, what }
    }
}

impl<T: Into<String>> From<T> for TableMistake {
    fn from(what: T) -> Self {
        Self { keys: &[], what: what.into() }
    }
}

/// `case` with those of its tables whose files have not changed since a result was computed.
/// `checksums` are the attributes of the result, which include those of the tables. Only one rank
/// calls it.
pub fn with_tables_known(mut case: Case, checksums: &BTreeMap<String, String>) -> Case {
    for k in 0..case.tables.len() {
        let file = &case.tables[k];
        let known = checksums.get(&checksum_name(file.of));
        let found = known.and_then(|known| {
            let table = read(file).ok()?;
            (checksum::text(table.checksum()) == *known).then_some(table)
        });
        if let Some(table) = found {
            case = case.with_table(k, table);
        }
    }
    case
}

/// Name of the attribute of a result that holds the path of a table; `table_file` for `f0`.
pub(crate) fn file_name(of: TableOf) -> String {
    format!("{}_file", attribute(of))
}

/// Name of the attribute of a result that holds the checksum of a table.
pub(crate) fn checksum_name(of: TableOf) -> String {
    format!("{}_checksum", attribute(of))
}

fn attribute(of: TableOf) -> String {
    match of {
        TableOf::Initial => "table".to_owned(),
        _ => of.key().replace('.', "_"),
    }
}

/// Sends the table of the first rank to all ranks. Collective over `world`.
fn shared(world: &Group, found: Option<Table>) -> FileResult<Table> {
    let axes = found.as_ref().map_or(&[][..], Table::axes);
    let axes = axes.iter().map(|axis| (axis.name.clone(), axis.position, axis.points.len()));
    let heads: Vec<(String, usize, usize)> =
        world.of_first_rank(|| Ok(axes.collect())).map_err(|e| e.to_string())?;
    let shape: Vec<usize> = heads.iter().map(|(_, _, points)| *points).collect();
    // All ranks take the largest value, and all but the first have −∞.
    let numbers = |own: Option<&[f64]>, count: usize| {
        let mut numbers = own.map_or_else(|| vec![f64::NEG_INFINITY; count], <[f64]>::to_vec);
        world.max_into(&mut numbers);
        numbers
    };
    let axes = heads.into_iter().enumerate().map(|(a, (name, position, count))| {
        let own = found.as_ref().map(|table| &table.axes()[a].points[..]);
        TableAxis { name, position, points: numbers(own, count) }
    });
    let axes: Vec<TableAxis> = axes.collect();
    let values = numbers(found.as_ref().map(Table::values), shape.iter().product());
    Table::new(axes, values)
}

/// Reads the table of a file. Only one rank calls it.
fn read(file: &TableFile) -> Result<Table, TableMistake> {
    let found = std::fs::metadata(&file.path).map_err(|e| e.to_string())?;
    if !found.is_file() {
        return Err("is no file".into());
    }
    let ending = file.path.extension().unwrap_or_default();
    if !ending.eq_ignore_ascii_case("csv") {
        return of_hdf5(file);
    }
    let bytes = found.len();
    if bytes > MOST_TEXT {
        return Err(format!("{bytes} bytes; at most {MOST_TEXT} of a CSV file are read").into());
    }
    let text = std::fs::read_to_string(&file.path).map_err(|e| e.to_string())?;
    of_text(file, &text)
}

/// The table of an HDF5 file: a dataset, with the points of its axes in `/axis/NAME` or `/NAME`.
fn of_hdf5(file: &TableFile) -> Result<Table, TableMistake> {
    let axes = file.axes();
    let places = |name: &str| [format!("axis/{name}"), name.to_owned()];
    let names = axes.iter().flat_map(|(_, names)| names.iter().flat_map(|name| places(name)));
    let names: Vec<String> = [file.dataset.clone()].into_iter().chain(names).collect();
    let opened = untrusted::open_given(&file.path, Inspection::Table(names))?;
    let dataset = opened.dataset(&file.dataset);
    let dataset = dataset.map_err(|_| {
        TableMistake::by(&["dataset"], format!("holds no dataset /{}", file.dataset))
    })?;
    let shape = dataset.shape();
    if shape.len() != axes.len() {
        let what = format!(
            "/{} has the shape {shape:?}; the axes {} are expected, others by axes = [\"…\"]",
            file.dataset,
            file.axes_text()
        );
        return Err(TableMistake::by(&["axes", "dataset"], what));
    }
    let axis = |(position, names): &(usize, Vec<&str>)| {
        let there = |place: &String| opened.link_exists(place);
        let place = names.iter().flat_map(|name| places(name)).find(there);
        let place = place.ok_or_else(|| {
            TableMistake::by(&["axes"], format!("holds no dataset /axis/{}", names[0]))
        })?;
        let dataset = opened.dataset(&place).map_err(|_| format!("/{place} is no dataset"))?;
        let points = numbers(&place, &dataset)?;
        Ok(TableAxis { name: names[0].to_owned(), position: *position, points })
    };
    let axes = axes.iter().map(axis).collect::<Result<Vec<TableAxis>, TableMistake>>()?;
    for (axis, count) in axes.iter().zip(&shape) {
        if axis.points.len() != *count {
            let (name, points) = (&axis.name, axis.points.len());
            let what = format!(
                "/{} has {count} values along {name}, which has {points} points",
                file.dataset
            );
            return Err(TableMistake::by(&["axes", "dataset"], what));
        }
    }
    Ok(Table::new(axes, numbers(&file.dataset, &dataset)?)?)
}

/// The table of a CSV file: a line with the names of columns, then one line per value in any order.
fn of_text(file: &TableFile, text: &str) -> Result<Table, TableMistake> {
    let text = text.trim_start_matches('\u{feff}');
    let is_data = |(_, line): &(usize, &str)| !line.is_empty() && !line.starts_with('#');
    let mut lines = (1..).zip(text.lines().map(str::trim)).filter(is_data);
    let (_, head) = lines.next().ok_or("is empty")?;
    let names: Vec<&str> = head.split(',').map(|name| name.trim().trim_matches('"')).collect();
    let Columns { axes, value: column_of_value } = Columns::of(file, &names)?;
    let mut places: Vec<Vec<f64>> = vec![Vec::new(); axes.len()];
    let mut values = Vec::new();
    for (number, line) in lines {
        let mut count = 0;
        let mut own = places.iter_mut();
        for (column, word) in line.split(',').map(str::trim).enumerate() {
            let finite = word.parse().ok().filter(|value: &f64| value.is_finite());
            let value = finite.ok_or_else(|| {
                let name = names.get(column).map_or(String::new(), |n| format!(" ({n})"));
                let column = column + 1;
                format!("line {number}, column {column}{name}: \"{word}\" is not a finite number")
            })?;
            count += 1;
            if column == column_of_value {
                values.push(value);
            } else if let Some(place) = own.next() {
                place.push(value);
            }
        }
        if count != axes.len() + 1 {
            let expected = axes.len() + 1;
            return Err(format!("line {number}: {count} numbers, {expected} expected").into());
        }
    }
    Ok(on_grid(axes, &places, &values)?)
}

/// The columns of a CSV file.
struct Columns {
    /// Name and position of each axis, in the order of the columns.
    axes: Vec<(String, usize)>,
    /// The column of the value.
    value: usize,
}

impl Columns {
    /// The columns with these `names`, from the first line.
    fn of(file: &TableFile, names: &[&str]) -> Result<Self, TableMistake> {
        let (mut axes, mut value) = (Vec::new(), None);
        for (column, &name) in names.iter().enumerate() {
            match file.position_of_axis(name) {
                Some(position) => axes.push((name.to_owned(), position)),
                None if name == file.dataset && value.is_none() => value = Some(column),
                None => {
                    let what = format!(
                        "column \"{name}\" in the first line is neither one of the axes {} nor \
                         the value \"{}\"{}",
                        file.axes_text(),
                        file.dataset,
                        hint_on_column(file, name)
                    );
                    return Err(TableMistake::by(&["axes", "dataset"], what));
                }
            }
        }
        let none = || {
            let what = format!("has no column \"{}\" in the first line", file.dataset);
            TableMistake::by(&["dataset"], what)
        };
        Ok(Self { axes, value: value.ok_or_else(none)? })
    }
}

/// A hint for the error that the first line of a CSV file has an unknown column of this name.
fn hint_on_column(file: &TableFile, name: &str) -> String {
    let expected = format!("{},{}", file.axes_text().replace(", ", ","), file.dataset);
    if name.contains([';', '\t']) {
        format!("; columns are separated by commas: \"{expected}\" expected")
    } else if name.parse::<f64>().is_ok() {
        format!("; the first line names the columns: \"{expected}\" expected")
    } else if file.has_axis(name) {
        format!("; {}.axes makes it one: a list of some of {}", file.of.key(), file.all_axes_text())
    } else {
        String::new()
    }
}

/// The table of `values` at the points `places`, which has one list of coordinates per axis. Every
/// point of the tensor grid must occur once.
fn on_grid(axes: Vec<(String, usize)>, places: &[Vec<f64>], values: &[f64]) -> FileResult<Table> {
    let sorted = |places: &Vec<f64>| {
        // Adding zero turns −0 into 0.
        let mut points: Vec<f64> = places.iter().map(|p| p + 0.0).collect();
        points.sort_by(f64::total_cmp);
        points.dedup();
        points
    };
    let points: Vec<Vec<f64>> = places.iter().map(sorted).collect();
    let shape: Vec<usize> = points.iter().map(Vec::len).collect();
    check_size(&shape)?;
    let count: usize = shape.iter().product();
    if values.len() != count {
        return Err(format!(
            "{} lines for {shape:?} different coordinates of {}: each point of the grid once \
             expected",
            values.len(),
            axes.iter().map(|(name, _)| &name[..]).collect::<Vec<_>>().join(", ")
        ));
    }
    let mut table = vec![f64::NAN; count];
    for (i, value) in values.iter().enumerate() {
        let along = places.iter().zip(&points);
        let place = number(
            shape.iter().copied(),
            along.map(|(places, points)| points.partition_point(|p| *p < places[i])),
        );
        if !table[place].is_nan() {
            let point: Vec<f64> = places.iter().map(|places| places[i]).collect();
            return Err(format!("the point {point:?} is given twice"));
        }
        table[place] = *value;
    }
    let axes = axes.into_iter().zip(points);
    let axes = axes.map(|((name, position), points)| TableAxis { name, position, points });
    Table::new(axes.collect(), table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn file() -> TableFile {
        TableFile::new(TableOf::Initial, Path::new("f0.csv"), "case: initial.table.file", 1)
    }

    #[test]
    fn lines_of_a_csv_file_stand_in_any_order() {
        let text = "# a comment\nv, f ,x\n1,10,0\n2,20,0\n\n1,30,0.5\n2,40,0.5\n";
        let table = of_text(&file(), text).unwrap();
        let at = |x: f64, v: f64| table.eval(&[x, 0.0, 0.0, v, 0.0, 0.0]);
        assert_eq!(
            [at(0.0, 1.0), at(0.0, 2.0), at(0.5, 1.0), at(0.25, 1.5)],
            [10.0, 20.0, 30.0, 25.0]
        );
    }

    #[test]
    fn tables_without_a_grid_are_refused() {
        for (text, reason) in [
            ("", "is empty"),
            ("x,v\n1,2\n", "no column \"f\""),
            ("x,w,f\n", "column \"w\" in the first line is neither one of the axes x, v"),
            ("x;v;f\n0;0;1\n", "separated by commas: \"x,v,f\" expected"),
            ("0,0,1\n", "the first line names the columns: \"x,v,f\" expected"),
            ("x,v,f\n0,0,one\n", "line 2, column 3 (f): \"one\" is not a finite number"),
            ("# NaN\n\nx,v,f\n0,nan,0\n", "line 4, column 2 (v): \"nan\" is not a finite number"),
            ("x,v,f\n0,0\n", "line 2: 2 numbers, 3 expected"),
            ("x,v,f\n0,0,1\n0,1,1\n1,0,1\n", "3 lines for [2, 2] different coordinates of x, v"),
            ("x,v,f\n0,0,1\n0,0,1\n1,1,1\n0,1,2\n", "the point [0.0, 0.0] is given twice"),
            ("x,f\n0,1\n", "points of the axis x: 1, at least 2"),
            ("x,x,f\n0,0,1\n0,1,1\n1,0,1\n1,1,1\n", "the axis x is given twice"),
        ] {
            let found = of_text(&file(), text).unwrap_err().what;
            assert!(found.contains(reason), "{text:?}: {found}");
        }
    }
}
