//! Tests files of the warped field: they are written from the modes, read again, and refused if
//! they are damaged.

use crate::bits::report_bits;
use crate::dense_twins::cells_of_axes;
use crate::exchange::{dealt, mode_value};
use crate::pieces::{cell_numbers, meshes};
use crate::support::dense::case;
use crate::support::prepared::{block_of, resources};
use hdf5::File;
use num_complex::Complex64;
use phasewarp::base::error::Error;
use phasewarp::parallel::communicator::{Communicator, Group, World};
use phasewarp::parallel::partition::{Block, ProcessMesh};
use phasewarp::plan::Plan;
use phasewarp::problem::case::{Case, WarpedStart};
use phasewarp::results::dataset::FileAttributes;
use phasewarp::results::readback;
use phasewarp::results::warped;
use phasewarp::results::warped::initial_file::{ModesFromFile, ReadingDomain, WarpedFile};
use phasewarp::results::warped::spread::Spread;
use phasewarp::schrodingerization::profile::series::Series;
use phasewarp::solve::rank_modes::{ModeProgress, RankModes};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The domain of files whose plateau is not checked.
const ANYWHERE: ReadingDomain = ReadingDomain { point: 0.0, ends: [0.0; 2] };

/// A directory that all ranks share, deleted when the value is dropped.
pub struct SharedDirectory {
    _directory: Option<tempfile::TempDir>,
    pub path: PathBuf,
}

impl SharedDirectory {
    pub fn new(group: &Group) -> Self {
        let directory = (group.rank() == 0).then(|| tempfile::tempdir().expect("a directory"));
        let name = directory.as_ref().map(|d| d.path().display().to_string());
        Self { path: group.broadcast_text(&name.unwrap_or_default()).into(), _directory: directory }
    }
}

/// A rank of a mesh and its block.
struct Rank {
    communicator: Communicator,
    block: Block,
    /// Number in the grid of each cell of the block.
    number: Vec<usize>,
    /// `π` of the block's cells.
    pi: Vec<f64>,
}

/// `π` of a cell of the grid.
fn weight(cell: usize) -> f64 {
    1.0 + (cell % 3) as f64
}

impl Rank {
    fn new(world: &World, case: &Case, mesh: &ProcessMesh) -> Self {
        let communicator = Communicator::new(world, mesh);
        let block = block_of(case, mesh, &communicator);
        let number = cell_numbers(&block);
        Self { pi: number.iter().map(|&cell| weight(cell)).collect(), communicator, block, number }
    }

    fn spread<'a>(&'a self, case: &'a Case, modes: &'a [Vec<usize>], buffers: u64) -> Spread<'a> {
        Spread {
            communicator: &self.communicator,
            space: &case.space,
            block: &self.block,
            modes,
            pi: &self.pi,
            buffers,
        }
    }

    /// The number of rows of a mode: the cells and one auxiliary unknown.
    fn rows(&self) -> usize {
        self.block.cells() + 1
    }

    /// Memory for the modes of this rank.
    fn room(&self, modes: &[Vec<usize>]) -> RankModes {
        RankModes::new(self.rows(), modes[self.communicator.modes.rank()].clone())
    }
}

/// The phase of mode `l`, which is stored separately from its values.
fn phase(l: usize) -> Complex64 {
    Complex64::from_polar(1.0, 0.7 * l as f64)
}

/// The first point in `p`.
const LOWER: f64 = -2.3;

/// The file of a warped field holds the direct sum over the modes at each point and cell, with the
/// same bits on every mesh. Reading the file gives the modes again.
pub fn warped_file(world: &World) {
    let shared = SharedDirectory::new(&world.group());
    for (name, file, cells) in
        [("a line", "example1.toml", &[5, 7][..]), ("a plane", "example3.toml", &[3, 2, 4, 3])]
    {
        let cells = cells_of_axes(cells);
        let cells: Vec<&str> = cells.iter().map(String::as_str).collect();
        let case = case(file, &cells);
        // A planned series whose modes the points resolve, and one with a mode without partner.
        let transform = |mu: f64| Complex64::new(1.0, -0.4) / Complex64::new(1.0, 0.1 * mu);
        for series in
            [Series::analytic(5.1, 13, transform), Series::analytic_points(5.1, 22, transform)]
        {
            for mesh in meshes(world, &case) {
                // Buffers for one cell, for some cells, and for all.
                for buffers in [1, 3000, 16 << 20] {
                    let field = WarpedField {
                        name,
                        case: &case,
                        series: &series,
                        rank: Rank::new(world, &case, &mesh),
                        modes: dealt(series.modes(), mesh.groups),
                        buffers,
                    };
                    field.write(&shared.path, &mesh, world);
                    let given = field.check_file(world, &shared.path.join("warped_f.h5"));
                    field.check_modes(&given);
                    world.group().barrier();
                }
            }
        }
    }
}

/// A warped field whose modes are spread over the ranks of a mesh.
struct WarpedField<'a> {
    name: &'static str,
    case: &'a Case,
    series: &'a Series,
    rank: Rank,
    modes: Vec<Vec<usize>>,
    buffers: u64,
}

impl WarpedField<'_> {
    fn write(&self, directory: &Path, mesh: &ProcessMesh, world: &World) {
        let plan = Plan::new(self.case, &resources(world, mesh), 1.5).expect("a plan");
        let rows = self.rank.rows();
        let mut kept = self.rank.room(&self.modes);
        let mine = &self.modes[self.rank.communicator.modes.rank()];
        for (k, &l) in mine.iter().enumerate() {
            let values = kept.values_mut()[k * rows..].iter_mut();
            for (x, &cell) in values.zip(&self.rank.number) {
                *x = mode_value(l, cell);
            }
            kept.progress_mut()[k] = ModeProgress { phase: phase(l), ..ModeProgress::start(1.0) };
        }
        let about = FileAttributes {
            case: self.case,
            plan: &plan,
            time: 0.5,
            seconds: &BTreeMap::new(),
            provenance: &[],
        };
        let spread = self.rank.spread(self.case, &self.modes, self.buffers);
        let path = directory.join("warped_f.h5");
        warped::write(&path, &about, &spread, self.series, LOWER, &kept).expect("a file");
        assert!(!directory.join("warped_f.h5.partial").exists());
    }

    /// Checks that the file holds the sum over the modes.
    fn check_file(&self, world: &World, path: &Path) -> WarpedFile {
        let group = world.group();
        let datasets = readback::check(&group, path).expect("a file as written");
        let axes = self.case.space.shape().len();
        assert_eq!(datasets, axes + 4, "w, axes, p, case, plan");
        let start = WarpedStart { path: path.to_owned(), place: "here".to_owned() };
        let given = WarpedFile::new(&group, &start, &self.case.space).expect("a warped field");
        let length = given.interval[1] - given.interval[0];
        assert!((length - self.series.period).abs() < 1e-13);
        if group.rank() == 0 {
            let file = File::open(path).expect("a file");
            let w = file.dataset("w").expect("a dataset");
            let found: Vec<f64> = w.read_raw().expect("numbers");
            let cells = self.case.space.cells();
            assert_eq!(found.len(), cells * given.points);
            for (k, found) in found.iter().enumerate() {
                let (cell, j) = (k / given.points, k % given.points);
                let p = LOWER + self.series.period * j as f64 / given.points as f64;
                let expected = self.sum(cell, p);
                let close = (found - expected).abs() < 1e-12;
                assert!(close, "{}: {found} {expected}", self.name);
            }
            report_bits(world, &format!("w of {}, {}", self.name, given.points), &found);
        }
        given
    }

    /// `w(p)` in a cell, divided by the weight.
    fn sum(&self, cell: usize, p: f64) -> f64 {
        let series = self.series;
        let term = |l: usize| {
            let wave = Complex64::from_polar(1.0, series.wavenumber(l) * p);
            (series.factor(l) * wave * phase(l) * mode_value(l, cell)).re
        };
        (0..series.modes()).map(term).sum::<f64>() / weight(cell).sqrt()
    }

    /// Checks the modes that are read from the file, for a series with unit factors.
    fn check_modes(&self, given: &WarpedFile) {
        let ones = Series::ones(self.series.period, given.points);
        let groups = self.rank.communicator.modes.size();
        let modes = dealt(ones.modes(), groups);
        let spread = self.rank.spread(self.case, &modes, self.buffers);
        let mut back = self.rank.room(&modes);
        let (kept, domain) = (&mut back, ANYWHERE);
        given
            .read(ModesFromFile { spread: &spread, series: &ones, kept, domain })
            .expect("it can be read");
        let rows = self.rank.rows();
        for (k, &l) in modes[self.rank.communicator.modes.rank()].iter().enumerate() {
            let found = &back.values()[k * rows..(k + 1) * rows];
            for (found, &cell) in found.iter().zip(&self.rank.number) {
                let expected = self.unit_mode(&ones, l, cell);
                let close = (found - expected).norm() < 1e-12;
                assert!(close, "mode {l}: {found} {expected}");
            }
            assert_eq!(found[rows - 1], Complex64::ZERO);
        }
    }

    /// The expected mode `l` of a cell in the series `ones`.
    fn unit_mode(&self, ones: &Series, l: usize, cell: usize) -> Complex64 {
        if l >= self.series.modes() {
            return Complex64::ZERO;
        }
        let x = self.series.coefficients[l] * phase(l) * mode_value(l, cell);
        if !ones.is_unpaired(l) {
            return x;
        }
        // The points contain only its real part.
        let wave = Complex64::from_polar(1.0, ones.wavenumber(l) * LOWER);
        (wave * x).re / wave
    }
}

/// Start files for a grid of 3 × 2 cells.
struct Files<'a> {
    group: &'a Group,
    path: PathBuf,
    case: Case,
}

/// Valid points in `p`.
const POINTS: [f64; 4] = [-1.0, -0.5, 0.0, 0.5];

/// `initial.warped` with this file.
fn start_at(path: &Path) -> WarpedStart {
    WarpedStart { path: path.to_owned(), place: "initial.warped".to_owned() }
}

impl Files<'_> {
    /// Reads a file that `write` fills.
    fn given(&self, write: impl Fn(&File)) -> Result<WarpedFile, Error> {
        if self.group.rank() == 0 {
            write(&File::create(&self.path).expect("a file"));
        }
        self.group.barrier();
        let found = WarpedFile::new(self.group, &start_at(&self.path), &self.case.space);
        self.group.barrier();
        found
    }

    /// Writes all axes, with `p` as the points.
    fn axes(&self, file: &File, p: &[f64]) {
        self.axes_with(file, &self.case.space.v[0].centres(), p);
    }

    fn axes_with(&self, file: &File, v: &[f64], p: &[f64]) {
        file.create_group("axis").expect("a group");
        let x = self.case.space.x[0].centres();
        for (name, values) in [("axis/x", &x[..]), ("axis/vx", v), ("axis/p", p)] {
            let dataset = file.new_dataset::<f64>().shape(values.len()).create(name);
            dataset.expect("a dataset").write(values).expect("numbers");
        }
    }
}

/// Writes a field of ones.
fn new_w(file: &File, shape: [usize; 3]) -> hdf5::Dataset {
    let dataset = file.new_dataset::<f64>().shape(shape).create("w").expect("a dataset");
    dataset.write_raw(&vec![1.0; shape.iter().product()]).expect("numbers");
    dataset
}

/// Checks the error about a user's file: one line that contains `message`, and exit code 2.
fn check_refusal(error: &Error, message: &str) {
    let text = error.to_string();
    assert!(text.contains(message), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert_eq!(error.exit_code(), 2, "{text}");
}

/// Faults of a start file are reported in the same way on all ranks.
pub fn warped_files_refused(world: &World) {
    let group = world.group();
    let shared = SharedDirectory::new(&group);
    let files = Files {
        group: &group,
        path: shared.path.join("start.h5"),
        case: case("example1.toml", &["axis.0.x.cells=3", "axis.0.v.cells=2"]),
    };
    accepted_files(&files);
    refused_files(&files);
    // A missing file, a directory, and a file that is not HDF5.
    let readme = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("README.md");
    for (path, message) in [
        (&shared.path.join("none.h5"), "No such file"),
        (&shared.path, "is no file"),
        (&readme, "cannot be read as HDF5"),
    ] {
        let found = WarpedFile::new(&group, &start_at(path), &files.case.space);
        check_refusal(&found.expect_err(message), message);
    }
    refused_contents(world, &files);
}

fn accepted_files(files: &Files<'_>) {
    let good = files.given(|file| {
        files.axes(file, &POINTS);
        new_w(file, [3, 2, 4]);
    });
    let good = good.expect("a warped field");
    assert_eq!((good.points, good.interval), (4, [-1.0, 1.0]));
    // Points in single precision are accepted.
    let single = files.given(|file| {
        files.axes(file, &[-0.9, -0.4, 0.1, 0.6].map(|p| f64::from(p as f32)));
        new_w(file, [3, 2, 4]);
    });
    assert_eq!(single.expect("a warped field").points, 4);
}

/// Missing datasets, and axes or a shape that do not fit the case.
fn refused_files(files: &Files<'_>) {
    type Write<'a> = &'a dyn Fn(&File);
    let field = |file: &File, p: &[f64], shape: [usize; 3]| {
        files.axes(file, p);
        new_w(file, shape);
    };
    let shifted = files.case.space.v[0].centres().iter().map(|v| v + 0.1).collect::<Vec<_>>();
    let bad: [(&str, Write<'_>); 9] = [
        ("holds no dataset /w", &|file| files.axes(file, &POINTS)),
        ("holds no dataset /axis/x", &|file| drop(new_w(file, [3, 2, 4]))),
        ("/w has the shape [3, 3, 4]; [3, 2]", &|file| field(file, &POINTS, [3, 3, 4])),
        ("/axis/p holds 4 points, /w 6", &|file| field(file, &POINTS, [3, 2, 6])),
        ("/w has 3 points in p; an even number", &|file| field(file, &POINTS[..3], [3, 2, 3])),
        ("in equal steps: point 2 is off by 6.7e-2", &|file| {
            field(file, &[-1.0, -0.5, 0.0, 0.6], [3, 2, 4]);
        }),
        ("/axis/p is not ascending in equal steps", &|file| {
            field(file, &[0.5, 0.0, -0.5, -1.0], [3, 2, 4]);
        }),
        ("/w holds other than real numbers", &|file| {
            files.axes(file, &POINTS);
            let dataset = file.new_dataset::<Complex64>().shape([3, 2, 4]).create("w");
            dataset.and_then(|w| w.write_raw(&[Complex64::ONE; 24])).expect("a dataset");
        }),
        ("/axis/vx holds other cell centres", &|file| {
            files.axes_with(file, &shifted, &POINTS);
            new_w(file, [3, 2, 4]);
        }),
    ];
    for (message, write) in bad {
        let error = files.given(write).expect_err(message);
        check_refusal(&error, message);
        assert!(error.to_string().contains("initial.warped"), "{error}");
    }
}

/// A NaN and a changed number are found when the field is read.
fn refused_contents(world: &World, files: &Files<'_>) {
    let mesh = ProcessMesh { space: vec![1], groups: files.group.size() };
    let rank = Rank::new(world, &files.case, &mesh);
    let ones = Series::ones(2.0, 4);
    let modes = dealt(ones.modes(), mesh.groups);
    let spread = rank.spread(&files.case, &modes, 100);
    for (message, number, checksum) in
        [("/w is NaN at", f64::NAN, None), ("its checksum differs", 1.0, Some(7u64))]
    {
        let given = files.given(|file| {
            files.axes(file, &POINTS);
            let w = new_w(file, [3, 2, 4]);
            let mut values = [0.25; 24];
            values[13] = number;
            w.write_raw(&values).expect("numbers");
            if let Some(sum) = checksum {
                let attribute = w.new_attr::<u64>().create("checksum");
                attribute.expect("an attribute").write_scalar(&sum).expect("a number");
            }
        });
        let mut kept = rank.room(&modes);
        let read = given.expect("a file").read(ModesFromFile {
            spread: &spread,
            series: &ones,
            kept: &mut kept,
            domain: ANYWHERE,
        });
        check_refusal(&read.expect_err(message), message);
        files.group.barrier();
    }
}
