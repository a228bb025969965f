//! Valid HDF5 files with other contents than those of a run: other shapes, types, numbers and
//! texts. The readers of results, of start fields and of tables refuse or accept them. Some of the
//! accepted results are drawn.
//!
//! The readers are called in the process of the fuzzer. The program calls HDF5 in a separate
//! process only because of files that crash HDF5 itself (`hostile.rs`).

use crate::fuzzing::mutate::Corpus;
use crate::fuzzing::{Random, Reader, fuzz};
use crate::support::{case, change_hdf5, directory, run, text_of};
use hdf5::types::{FixedAscii, FixedUnicode, VarLenUnicode};
use phasewarp::base::checksum::{of_text, run_checksum};
use phasewarp::parallel::communicator::World;
use phasewarp::problem::case::{Case, WarpedStart};
use phasewarp::results::pictures;
use phasewarp::results::start_field::origin;
use phasewarp::results::table_file::with_tables;
use phasewarp::results::untrusted;
use phasewarp::results::warped::initial_file::WarpedFile;
use std::fs;
use std::path::Path;
use std::str::FromStr;
use tempfile::TempDir;

/// The type of a new object.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Reals,
    Singles,
    Integers,
    Bytes,
    Switches,
    Texts,
    LongTexts,
    Group,
}

const KINDS: [Kind; 8] = [
    Kind::Reals,
    Kind::Singles,
    Kind::Integers,
    Kind::Bytes,
    Kind::Switches,
    Kind::Texts,
    Kind::LongTexts,
    Kind::Group,
];

const NUMBERS: [f64; 14] = [
    0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    3.0,
    1e-300,
    1e6,
    1e17,
    1e149,
    -1e149,
    1e308,
    f64::NAN,
    f64::INFINITY,
];

/// A change of a file.
#[derive(Debug)]
enum Change {
    Remove(String),
    /// The object `from` also gets the name `to`, which replaces another object.
    Rename {
        from: String,
        to: String,
    },
    /// A new dataset of this shape, whose values start at `first` and increase by `step`.
    Replace {
        name: String,
        kind: Kind,
        shape: Vec<usize>,
        first: f64,
        step: f64,
    },
    /// Another value of a number in a dataset.
    Number {
        name: String,
        at: usize,
        value: f64,
    },
    Text {
        name: String,
        text: String,
    },
    Attribute {
        of: String,
        name: String,
        kind: Kind,
        value: f64,
        text: String,
    },
    NoAttribute {
        of: String,
        name: String,
    },
}

/// A reader of HDF5 files.
#[derive(Clone, Copy, Debug)]
enum FileReader {
    Result,
    Field,
    WarpedField,
    Table,
}

/// Results have most to be read.
const READERS: [FileReader; 6] = [
    FileReader::Result,
    FileReader::Result,
    FileReader::Result,
    FileReader::Field,
    FileReader::WarpedField,
    FileReader::Table,
];

#[derive(Debug)]
struct Input {
    /// The index of the file that is changed.
    file: usize,
    changes: Vec<Change>,
    /// Who reads it.
    reader: FileReader,
    /// Whether an accepted result is drawn, which takes longer.
    drawn: bool,
}

/// A file of a run.
struct Original {
    bytes: Vec<u8>,
    /// The names of its datasets.
    datasets: Vec<String>,
    /// The attributes of the file (`/`) and of its datasets: name of the object and of the
    /// attribute.
    attributes: Vec<(String, String)>,
}

impl Original {
    fn read(path: &Path) -> hdf5::Result<Self> {
        let bytes = fs::read(path).expect("a file");
        let file = hdf5::File::open(path)?;
        let mut datasets = Vec::new();
        let mut groups = vec![file.group("/")?];
        while let Some(group) = groups.pop() {
            datasets.extend(group.datasets()?.iter().map(|dataset| dataset.name()));
            groups.extend(group.groups()?);
        }
        let mut attributes: Vec<(String, String)> =
            file.attr_names()?.into_iter().map(|name| ("/".to_owned(), name)).collect();
        for dataset in &datasets {
            let names = file.dataset(dataset)?.attr_names()?;
            attributes.extend(names.into_iter().map(|name| (dataset.clone(), name)));
        }
        Ok(Self { bytes, datasets, attributes })
    }

    fn change(&self, texts: &Corpus, random: &mut Random) -> Change {
        let name = random.of_list(&self.datasets).clone();
        let (value, kind) = (*random.of_list(&NUMBERS), *random.of_list(&KINDS));
        let (of, attribute) = random.of_list(&self.attributes).clone();
        match random.below(12) {
            0 => Change::Remove(name),
            1 => Change::Rename { from: name, to: random.of_list(&self.datasets).clone() },
            2..=4 => {
                let lengths = [0, 1, 2, 3, 4, 5, 6, 8, 16, 40];
                let shape: Vec<usize> =
                    (0..random.below(5)).map(|_| *random.of_list(&lengths)).collect();
                let kind = if random.once_in(3) { kind } else { Kind::Reals };
                let step = *random.of_list(&[0.0, 0.25, 1.0, -1.0, 1e100]);
                Change::Replace { name, kind, shape, first: value, step }
            }
            5..=7 => Change::Number { name, at: random.below(1000), value },
            8 | 9 => {
                let name = random.of_list(&["/case", "/plan", "/case"]).to_string();
                Change::Text { name, text: texts.changed(random) }
            }
            10 => Change::NoAttribute { of, name: attribute },
            _ => {
                Change::Attribute { of, name: attribute, kind, value, text: texts.changed(random) }
            }
        }
    }
}

fn numbers(first: f64, step: f64, count: usize) -> Vec<f64> {
    (0..count).map(|k| first + step * k as f64).collect()
}

/// Replaces a dataset by another one with a correct checksum.
fn replace(
    file: &hdf5::File,
    name: &str,
    kind: Kind,
    shape: &[usize],
    values: &[f64],
) -> hdf5::Result<()> {
    if file.link_exists(name) {
        file.unlink(name)?;
    }
    fn put<T: hdf5::H5Type>(
        file: &hdf5::File,
        name: &str,
        shape: &[usize],
        values: &[f64],
        number: impl Fn(f64) -> T,
    ) -> hdf5::Result<()> {
        let dataset = file.new_dataset::<T>().shape(shape).create(name)?;
        let list: Vec<T> = values.iter().map(|v| number(*v)).collect();
        dataset.write_raw(&list)?;
        let sum = run_checksum(0, values.iter().map(|v| v.to_bits()));
        dataset.new_attr::<u64>().create("checksum")?.write_scalar(&sum)
    }
    match kind {
        Kind::Reals => put(file, name, shape, values, |v| v),
        Kind::Singles => put(file, name, shape, values, |v| v as f32),
        Kind::Integers => put(file, name, shape, values, |v| v as i64),
        Kind::Bytes => put(file, name, shape, values, |v| v as u8),
        Kind::Switches => put(file, name, shape, values, |v| v > 0.0),
        Kind::Texts => put(file, name, shape, values, |v| {
            FixedAscii::<8>::from_ascii(&format!("{v:.1e}")).unwrap_or_default()
        }),
        Kind::LongTexts => put(file, name, shape, values, |v| {
            VarLenUnicode::from_str(&format!("{v:e}")).unwrap_or_default()
        }),
        Kind::Group => file.create_group(name).map(drop),
    }
}

/// The size of a stored text in bytes.
const LONGEST: usize = 4096;

fn apply(file: &hdf5::File, change: &Change) -> hdf5::Result<()> {
    match change {
        Change::Remove(name) => file.unlink(name),
        Change::Rename { from, to } => {
            if from != to && file.link_exists(from) {
                if file.link_exists(to) {
                    file.unlink(to)?;
                }
                file.link_hard(from, to)?;
            }
            Ok(())
        }
        Change::Replace { name, kind, shape, first, step } => {
            let values = numbers(*first, *step, shape.iter().product());
            replace(file, name, *kind, shape, &values)
        }
        Change::Number { name, at, value } => {
            let dataset = file.dataset(name)?;
            let mut values = dataset.read_raw::<f64>()?;
            let count = values.len().max(1);
            if let Some(number) = values.get_mut(at % count) {
                *number = *value;
            }
            dataset.write_raw(&values)?;
            let sum = run_checksum(0, values.iter().map(|v| v.to_bits()));
            dataset.attr("checksum")?.write_scalar(&sum)
        }
        Change::Text { name, text } => {
            if file.link_exists(name) {
                file.unlink(name)?;
            }
            let dataset = file.new_dataset::<FixedUnicode<LONGEST>>().create(&**name)?;
            let fits = text.chars().take(LONGEST / 4).filter(|c| *c != '\0').collect::<String>();
            let stored = FixedUnicode::<LONGEST>::from_str(&fits).unwrap_or_default();
            dataset.write_scalar(&stored)?;
            let mut bytes = fits.into_bytes();
            bytes.resize(LONGEST, 0);
            dataset.new_attr::<u64>().create("checksum")?.write_scalar(&of_text(&bytes))
        }
        Change::NoAttribute { of, name } => at(file, of)?.delete_attr(name),
        Change::Attribute { of, name, kind, value, text } => {
            let at = at(file, of)?;
            let _ = at.delete_attr(name);
            match kind {
                Kind::Integers => {
                    at.new_attr::<u64>().create(&**name)?.write_scalar(&(*value as u64))
                }
                Kind::Texts | Kind::LongTexts => {
                    let text = text.replace('\0', "");
                    let text = VarLenUnicode::from_str(&text).unwrap_or_default();
                    at.new_attr::<VarLenUnicode>().create(&**name)?.write_scalar(&text)
                }
                Kind::Bytes => {
                    let two = [1.0, *value];
                    at.new_attr::<f64>().shape([2]).create(&**name)?.write_raw(&two)
                }
                _ => at.new_attr::<f64>().create(&**name)?.write_scalar(value),
            }
        }
    }
}

fn at(file: &hdf5::File, name: &str) -> hdf5::Result<hdf5::Location> {
    match name {
        "/" => Ok((*file.group("/")?).clone()),
        name => Ok((**file.dataset(name)?).clone()),
    }
}

/// The readers of HDF5 files, tried on changed files.
struct Files {
    originals: Vec<Original>,
    texts: Corpus,
    place: TempDir,
    world: World,
    /// Cases that start from the file as a field, as a warped field, and from its table.
    cases: [Case; 3],
}

/// The index of the original that is a warped field.
const WARPED: usize = 0;

/// Settings of a grid with few cells.
const SMALL: [&str; 3] = ["axis.0.x.cells=6", "axis.0.v.cells=4", "time.end=0.2"];

impl Files {
    /// A case that reads the file `path` as its start field (`field`), as a table (`table`), or
    /// not.
    fn case(key: &str, path: &Path) -> Case {
        let set = |text: &str| text.to_owned();
        let mut settings: Vec<String> = SMALL[..2].iter().map(|text| set(text)).collect();
        let path = path.display();
        settings.extend(match key {
            "field" => {
                vec![format!("initial.field='{path}'"), set("time.start=0.2"), set("time.end=0.4")]
            }
            "table" => vec![format!("initial={{table={{file='{path}'}}}}"), set("exact={f='0'}")],
            _ => vec![],
        });
        let file = case("example1.toml");
        Case::load(Path::new(&file), &settings).expect("a case")
    }

    /// Calls a reader of the file and returns whether it accepts the file. An error without a
    /// message or exit code is a fault.
    fn read_by(&self, reader: FileReader, drawn: bool) -> Result<bool, String> {
        let (path, world) = (self.place.path().join("result.h5"), self.world.group());
        let [field, warped, table] = &self.cases;
        let outcome = match reader {
            FileReader::Result => untrusted::open(self.place.path()).map(|stored| {
                if drawn {
                    // Pictures are drawn if possible; a refusal concerns one figure.
                    let _ = pictures::draw(&stored, None, &[]);
                }
            }),
            FileReader::Field => {
                let start = field.start_field.as_ref().ok_or("no field to start from")?;
                origin(&world, start, field).map(drop)
            }
            FileReader::WarpedField => {
                let start = WarpedStart { path, place: "initial.warped".to_owned() };
                WarpedFile::new(&world, &start, &warped.space).map(drop)
            }
            FileReader::Table => with_tables(&world, table).map(drop),
        };
        match outcome {
            Ok(()) => Ok(true),
            Err(error) if error.to_string().is_empty() || error.exit_code() == 0 => {
                Err(format!("exit code {}: {error}", error.exit_code()))
            }
            Err(_) => Ok(false),
        }
    }
}

impl Reader for Files {
    type Input = Input;
    const INPUTS: u64 = 300;

    fn new() -> Self {
        let rows: [(&str, &[&str], &str); 5] = [
            // [`WARPED`]
            ("example1.toml", &["output.warped_field=true", "exact={f='0'}"], "warped_f.h5"),
            ("example1.toml", &["readout={cells=[[3]]}", "output.plateau={points=3}"], "result.h5"),
            (
                "smooth-beams.toml",
                &["scheme.degree=2", "output.fields_every=0.1", "output.xdmf=true"],
                "result.h5",
            ),
            ("example2.toml", &["output.compression=4"], "result.h5"),
            ("quadrant2d.toml", &["axis.1.x.cells=4", "axis.1.v.cells=4"], "result.h5"),
        ];
        let originals = rows.map(|(name, settings, file)| {
            let place = directory();
            let job = run(name).set(&SMALL).set(&["solver.tolerance=1e-2"]).set(settings);
            job.solve(place.path()).expect("a run");
            Original::read(&place.path().join(file)).expect("a file of it")
        });
        let texts = ["example1", "example2", "smooth-beams", "quadrant2d"]
            .map(|name| text_of(case(&format!("{name}.toml"))).unwrap());
        let place = directory();
        let path = place.path().join("result.h5");
        Self {
            originals: originals.into(),
            texts: Corpus::new(texts.into()),
            cases: ["field", "", "table"].map(|key| Self::case(key, &path)),
            place,
            world: World::start().expect("MPI starts"),
        }
    }

    fn input(&self, random: &mut Random) -> Input {
        let file = random.below(self.originals.len());
        let original = &self.originals[file];
        let count = random.below(3) + 1;
        let changes = (0..count).map(|_| original.change(&self.texts, random)).collect();
        // A warped field is no result, which the other readers should see.
        let reader = match file {
            WARPED if !random.once_in(4) => FileReader::WarpedField,
            _ => *random.of_list(&READERS),
        };
        Input { file, changes, reader, drawn: random.once_in(20) }
    }

    fn read(&mut self, input: &Input) -> Result<bool, String> {
        let place = self.place.path();
        let path = place.join("result.h5");
        fs::write(&path, &self.originals[input.file].bytes).map_err(|e| e.to_string())?;
        fs::write(place.join("summary.json"), "{}").map_err(|e| e.to_string())?;
        change_hdf5(&path, |file| {
            for change in &input.changes {
                // A change may fail after an earlier one.
                let _ = apply(file, change);
            }
            Ok(())
        })?;
        self.read_by(input.reader, input.drawn)
    }
}

#[test]
fn changed_schemas_are_refused_or_read() {
    fuzz::<Files>("schema::changed_schemas_are_refused_or_read");
}
