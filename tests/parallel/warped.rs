//! Full runs: the distributed transpose, and the warped field as a file.

use super::*;
use phasewarp::parallel::communicator::transpose::Transpose;
use phasewarp::results::dataset::About;
use phasewarp::results::readback;
use phasewarp::results::warped;
use phasewarp::results::warped::{Given, Spread};
use phasewarp::schrodingerization::profile::series::Series;
use phasewarp::solve::kept::{KeptModes, Passage};
use std::path::PathBuf;

/// Mode `l` of cell `cell`: any numbers, the same on any ranks.
fn value(l: usize, cell: usize) -> Complex64 {
    let number = 1000 * cell + l;
    Complex64::new(noise(number, 1), noise(number, 2))
}

/// Modes dealt out unevenly: mode `l` to rank `(l² + 1) mod ranks`, so that some may have none; ascending.
fn dealt(modes: usize, ranks: usize) -> Vec<Vec<usize>> {
    let of = |rank: usize| (0..modes).filter(move |l| (l * l + 1) % ranks == rank);
    (0..ranks).map(|rank| of(rank).collect()).collect()
}

/// Every mode of some cells from some modes of every cell, and back, in every process mesh: uneven shares, ranks without modes or
/// cells, messages of a few numbers.
pub fn transpose_and_back(world: &World) {
    let case = case("example1.toml", &["axis.0.x.cells=5", "axis.0.v.cells=4"]);
    for mesh in meshes(world, &case) {
        let communicator = Communicator::new(world, &mesh);
        let group = &communicator.modes;
        let (rank, size) = (group.rank(), group.size());
        for (modes, cells) in [(1, 1), (7, 5), (2, 11), (10, 3), (0, 4), (5, 0), (33, 29)] {
            let lists = dealt(modes, size);
            for (at_once, most) in [(1, 1), (2, 3), (4, 1 << 20)] {
                let mut transpose = Transpose::in_pieces(group, lists.clone(), at_once, most);
                assert_eq!(transpose.modes(), modes);
                let mine = lists[rank].iter();
                // Rows beyond the cells stay where they are.
                let rows = cells + 2;
                let field: Vec<Complex64> = mine
                    .flat_map(|&l| (0..rows).map(move |cell| value(l, cell)))
                    .collect();
                let mut back = vec![Complex64::ZERO; field.len()];
                let mut all = vec![Complex64::ZERO; at_once * modes];
                for first in (0..cells).step_by(at_once * size) {
                    let ranges: Vec<Range<usize>> = (0..size)
                        .map(|r| {
                            let at = |r: usize| (first + r * at_once).min(cells);
                            at(r)..at(r + 1)
                        })
                        .collect();
                    all.fill(Complex64::new(f64::NAN, f64::NAN));
                    transpose.to_cells(&field, rows, &ranges, &mut all);
                    for (i, cell) in ranges[rank].clone().enumerate() {
                        for l in 0..modes {
                            assert_eq!(all[i * modes + l], value(l, cell), "mode {l}, {cell}");
                        }
                    }
                    transpose.to_modes(&all, &ranges, &mut back, rows);
                }
                for (k, (found, expected)) in back.iter().zip(&field).enumerate() {
                    let inside = k % rows < cells;
                    let expected = if inside { *expected } else { Complex64::ZERO };
                    assert_eq!(*found, expected, "{mesh:?}, {modes} modes, {cells} cells");
                }
            }
        }
    }
}

/// A directory that all ranks know, gone in the end.
struct Shared {
    _directory: Option<tempfile::TempDir>,
    path: PathBuf,
}

impl Shared {
    fn new(group: &Group) -> Self {
        let directory = (group.rank() == 0).then(|| tempfile::tempdir().expect("a directory"));
        let name = directory
            .as_ref()
            .map_or(String::new(), |d| d.path().display().to_string());
        Self {
            path: group.broadcast_text(&name).into(),
            _directory: directory,
        }
    }
}

/// The whole warped field in a file, from any modes: the naive sum over the modes at each point and cell, the same bits on every mesh; read
/// again, the modes come back.
pub fn warped_file(world: &World) {
    let group = world.group();
    let shared = Shared::new(&group);
    let path = shared.path.join("warped_f.h5");
    for (name, file, cells) in [
        (
            "a line",
            "example1.toml",
            &["axis.0.x.cells=5", "axis.0.v.cells=7"][..],
        ),
        (
            "a plane",
            "example3.toml",
            &[
                "axis.0.x.cells=3",
                "axis.0.v.cells=2",
                "axis.1.x.cells=4",
                "axis.1.v.cells=3",
            ],
        ),
    ] {
        let case = case(file, cells);
        let (space, lower) = (&case.space, -2.3);
        let global: Vec<usize> = space.shape();
        let cells: usize = global.iter().product();
        // Of a planned series, which its points resolve, and with a mode that stands for itself.
        let transform = |mu: f64| Complex64::new(1.0, -0.4) / Complex64::new(1.0, 0.1 * mu);
        for series in [
            Series::analytic(5.1, 13, transform),
            Series::analytic_points(5.1, 22, transform),
        ] {
            // Buffers for one cell, for some, for all.
            let budgets = [1, 3000, 16 << 20];
            let each = |mesh: Mesh| budgets.map(|buffers| (mesh.clone(), buffers));
            for (mesh, buffers) in meshes(world, &case).into_iter().flat_map(each) {
                let resources = Resources {
                    ranks: group.size(),
                    ranks_x: Some(mesh.space.clone()),
                    ..Resources::default()
                };
                let plan = Plan::new(&case, &resources, 1.5).expect("a plan");
                let communicator = Communicator::new(world, &mesh);
                let block = Block::new(space, &mesh, communicator.space.rank());
                let modes = dealt(series.modes(), mesh.groups);
                // The cells of the block by their numbers in the grid.
                let mut number = vec![0; block.cells()];
                block.for_each_own(|first, local| {
                    for v in 0..block.velocity_cells {
                        number[local + v] = first + v;
                    }
                });
                let weight = |cell: usize| 1.0 + (cell % 3) as f64;
                let pi: Vec<f64> = number.iter().map(|&cell| weight(cell)).collect();
                let spread = Spread {
                    communicator: &communicator,
                    space,
                    block: &block,
                    modes: &modes,
                    pi: &pi,
                    buffers,
                };
                // One row more than cells, as an auxiliary unknown has.
                let rows = block.cells() + 1;
                let mine = &modes[communicator.modes.rank()];
                let phase = |l: usize| Complex64::from_polar(1.0, 0.7 * l as f64);
                let mut kept = KeptModes::new(rows, mine.clone());
                for (k, &l) in mine.iter().enumerate() {
                    let lines = kept.values_mut()[k * rows..].iter_mut();
                    for (x, &cell) in lines.zip(&number) {
                        *x = value(l, cell);
                    }
                    kept.passages_mut()[k] = Passage {
                        phase: phase(l),
                        ..Passage::start(1.0)
                    };
                }
                let about = About {
                    case: &case,
                    plan: &plan,
                    time: 0.5,
                    seconds: &BTreeMap::new(),
                    provenance: &[],
                };
                let field = (&series, lower);
                warped::write(&shared.path, "warped_f.h5", &about, &spread, field, &kept)
                    .expect("a file");
                assert!(!shared.path.join("warped_f.h5.partial").exists());
                let datasets = readback::check(&group, &path).expect("a file as written");
                assert_eq!(datasets, space.shape().len() + 4, "w, axes, p, case, plan");

                let given = Given::new(&group, &path, &case, "here").expect("a warped field");
                let points = given.points;
                assert!((given.interval[1] - given.interval[0] - series.period).abs() < 1e-13);
                if group.rank() == 0 {
                    let file = hdf5::File::open(&path).expect("a file");
                    let w = file.dataset("w").expect("a dataset");
                    let found: Vec<f64> = w.read_raw().expect("numbers");
                    assert_eq!(found.len(), cells * points);
                    for (at, found) in found.iter().enumerate() {
                        let (cell, j) = (at / points, at % points);
                        let p = lower + series.period * j as f64 / points as f64;
                        let term = |l: usize| {
                            let wave = Complex64::from_polar(1.0, series.wavenumber(l) * p);
                            (series.factor(l) * wave * phase(l) * value(l, cell)).re
                        };
                        let sum: f64 = (0..series.modes()).map(term).sum();
                        let expected = sum / weight(cell).sqrt();
                        assert!(
                            (found - expected).abs() < 1e-12,
                            "{name}: {found} {expected}"
                        );
                    }
                    report_bits(world, &format!("w of {name}, {points}"), &found);
                }

                // Of the values at all points, whatever they came from, the modes of unit factors.
                let ones = Series::ones(series.period, points);
                let modes = dealt(ones.modes(), mesh.groups);
                let spread = Spread {
                    modes: &modes,
                    ..spread
                };
                let mine = &modes[communicator.modes.rank()];
                let mut back = KeptModes::new(rows, mine.clone());
                given
                    .read(&spread, &ones, &mut back)
                    .expect("it can be read");
                for (k, &l) in mine.iter().enumerate() {
                    for (i, &cell) in number.iter().enumerate() {
                        let expected = if l < series.modes() {
                            // In both series the mode has the same partners; alone, only its real part on the points is seen.
                            let x = series.coefficients[l] * phase(l) * value(l, cell);
                            if ones.is_alone(l) {
                                let wave = Complex64::from_polar(1.0, ones.wavenumber(l) * lower);
                                (wave * x).re / wave
                            } else {
                                x
                            }
                        } else {
                            Complex64::ZERO
                        };
                        let found = back.values()[k * rows + i];
                        assert!(
                            (found - expected).norm() < 1e-12,
                            "mode {l}: {found} {expected}"
                        );
                    }
                    assert_eq!(back.values()[k * rows + rows - 1], Complex64::ZERO);
                }
                group.barrier();
            }
        }
    }
}

/// What is wrong with a file to start from is said, the same on all ranks.
pub fn warped_files_refused(world: &World) {
    let group = world.group();
    let shared = Shared::new(&group);
    let path = shared.path.join("start.h5");
    let case = case("example1.toml", &["axis.0.x.cells=3", "axis.0.v.cells=2"]);
    let [x, v] = [case.space.x[0].centres(), case.space.v[0].centres()];
    let p = [-1.0, -0.5, 0.0, 0.5];
    let put = |change: &dyn Fn(&hdf5::File)| {
        if group.rank() == 0 {
            let file = hdf5::File::create(&path).expect("a file");
            change(&file);
        }
        group.barrier();
        let found = Given::new(&group, &path, &case, "initial.warped");
        group.barrier();
        found
    };
    let list = |file: &hdf5::File, name: &str, values: &[f64]| {
        let builder = file.new_dataset::<f64>().shape(values.len());
        let dataset = builder.create(name).expect("a dataset");
        dataset.write(values).expect("numbers");
    };
    let axes = |file: &hdf5::File, p: &[f64]| {
        file.create_group("axis").expect("a group");
        list(file, "axis/x", &x);
        list(file, "axis/vx", &v);
        list(file, "axis/p", p);
    };
    let w = |file: &hdf5::File, shape: &[usize]| {
        let builder = file.new_dataset::<f64>().shape(shape);
        builder.create("w").expect("a dataset");
    };
    let good = put(&|file| {
        axes(file, &p);
        w(file, &[3, 2, 4]);
    });
    let good = good.expect("a warped field");
    assert_eq!((good.points, good.interval), (4, [-1.0, 1.0]));
    type Damage<'a> = (&'a str, &'a dyn Fn(&hdf5::File));
    // Single precision is near enough.
    let single = put(&|file| {
        axes(file, &[-0.9, -0.4, 0.1, 0.6].map(|p| f64::from(p as f32)));
        w(file, &[3, 2, 4]);
    });
    assert_eq!(single.expect("a warped field").points, 4);
    let bad: [Damage<'_>; 9] = [
        ("holds no dataset /w", &|file| axes(file, &p)),
        ("holds no dataset /axis/x", &|file| w(file, &[3, 2, 4])),
        ("/w has the shape [3, 3, 4]; [3, 2]", &|file| {
            axes(file, &p);
            w(file, &[3, 3, 4]);
        }),
        ("/axis/p holds 4 points, /w 6", &|file| {
            axes(file, &p);
            w(file, &[3, 2, 6]);
        }),
        ("/w has 3 points in p; an even number", &|file| {
            axes(file, &p[..3]);
            w(file, &[3, 2, 3]);
        }),
        ("in equal steps: point 2 is off by 6.7e-2", &|file| {
            axes(file, &[-1.0, -0.5, 0.0, 0.6]);
            w(file, &[3, 2, 4]);
        }),
        ("/axis/p is not ascending in equal steps", &|file| {
            axes(file, &[0.5, 0.0, -0.5, -1.0]);
            w(file, &[3, 2, 4]);
        }),
        ("/w holds other than real numbers", &|file| {
            axes(file, &p);
            let builder = file.new_dataset::<num_complex::Complex64>();
            builder.shape([3, 2, 4]).create("w").expect("a dataset");
        }),
        ("/axis/vx holds other cell centres", &|file| {
            file.create_group("axis").expect("a group");
            list(file, "axis/x", &x);
            list(
                file,
                "axis/vx",
                &v.iter().map(|v| v + 0.1).collect::<Vec<_>>(),
            );
            list(file, "axis/p", &p);
            w(file, &[3, 2, 4]);
        }),
    ];
    for (message, change) in bad {
        let error = put(change).expect_err(message);
        assert!(error.to_string().contains(message), "{error}");
        assert!(error.to_string().contains("initial.warped"), "{error}");
        assert_eq!(error.exit_code(), 2, "{message}");
    }
    // No file, and what is none.
    let readme = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("README.md");
    for (path, message) in [
        (&shared.path.join("none.h5"), "No such file"),
        (&shared.path, "is no file"),
        (&readme, "cannot be read as HDF5"),
    ] {
        let error = Given::new(&group, path, &case, "initial.warped").expect_err(message);
        let text = error.to_string();
        assert!(
            text.contains(message) && text.lines().count() == 1,
            "{text}"
        );
        assert_eq!(error.exit_code(), 2, "{error}");
    }

    // Contents are looked at when they are read: a number that is none, a changed one.
    let mesh = Mesh {
        space: vec![1],
        groups: group.size(),
    };
    let communicator = Communicator::new(world, &mesh);
    let block = Block::new(&case.space, &mesh, communicator.space.rank());
    let ones = Series::ones(2.0, 4);
    let modes = dealt(ones.modes(), mesh.groups);
    let spread = Spread {
        communicator: &communicator,
        space: &case.space,
        block: &block,
        modes: &modes,
        pi: &[1.0; 6],
        buffers: 100,
    };
    for (message, number, checksum) in [
        ("/w is NaN at", f64::NAN, None),
        ("its checksum differs", 1.0, Some(7u64)),
    ] {
        let given = put(&|file| {
            axes(file, &p);
            let builder = file.new_dataset::<f64>().shape([3, 2, 4]);
            let w = builder.create("w").expect("a dataset");
            let mut values = [0.25; 24];
            values[13] = number;
            w.write_raw(&values).expect("numbers");
            if let Some(sum) = checksum {
                let attribute = w
                    .new_attr::<u64>()
                    .create("checksum")
                    .expect("an attribute");
                attribute.write_scalar(&sum).expect("a number");
            }
        });
        let mut kept = KeptModes::new(6, modes[communicator.modes.rank()].clone());
        let read = given.expect("a file").read(&spread, &ones, &mut kept);
        let error = read.expect_err(message);
        assert!(error.to_string().contains(message), "{error}");
        assert_eq!(error.exit_code(), 2, "{error}");
        group.barrier();
    }
}
