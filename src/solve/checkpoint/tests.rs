use super::*;
use crate::parallel::partition::{Block, Mesh};
use crate::problem::grid::{Axis, PhaseSpace};
use crate::solve::checkpoint::file;
use crate::solve::checkpoint::file::{Destination, Header, RankFile};
use crate::solve::kept::KeptModes;
use crate::solve::kept::Passage;
use crate::solve::snapshot::Fingerprint;
use crate::solve::snapshot::Kept;
use crate::solve::snapshot::KeptMode;
use crate::solve::snapshot::Numbers;
use crate::solve::snapshot::Start;
use crate::solve::snapshot::State;
use crate::solve::told::Told;
use num_complex::Complex64;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const SUMS: [usize; 2] = [6, 4];
const RESULTS: [usize; 3] = [6, 4, 1];
const MODES: usize = 7;

fn space(x: &[usize]) -> PhaseSpace {
    let axis = |&cells: &usize| Axis::new(0.0, 1.0, cells);
    let v: &[usize] = if x.len() == 1 { &[6] } else { &[2, 3] };
    PhaseSpace {
        x: x.iter().map(axis).collect(),
        v: v.iter().map(axis).collect(),
        periodic: [false; 3],
    }
}

/// A number of anything: of array `array`, at number `index` of the whole grid.
fn value(array: usize, index: usize) -> u64 {
    crate::base::checksum::of_run((1000 * array + index) as u64, std::iter::once(7))
}

fn real(array: usize, index: usize) -> f64 {
    value(array, index) as i64 as f64
}

/// Points of the box as numbers of the whole grid.
fn global_points(space: &PhaseSpace, ranges: &[Range<usize>]) -> Vec<usize> {
    let whole: Vec<Range<usize>> = space.x.iter().map(|a| 0..a.cells).collect();
    let runs = crate::parallel::partition::common_runs(ranges, &whole);
    runs.iter()
        .flat_map(|run| run.to..run.to + run.length)
        .collect()
}

/// Cells of a block that have an auxiliary unknown.
fn auxiliary(space: &PhaseSpace, ranges: &[Range<usize>]) -> Vec<u64> {
    let velocities = space.velocity_cells();
    let cells = global_points(space, ranges).into_iter();
    let cells = cells.flat_map(|point| point * velocities..(point + 1) * velocities);
    cells
        .filter(|cell| cell % 5 == 2)
        .map(|cell| cell as u64)
        .collect()
}

fn settings(given: &[(&str, &str)]) -> BTreeMap<String, String> {
    let given = given.iter();
    given
        .map(|&(key, value)| (key.to_owned(), value.to_owned()))
        .collect()
}

fn fingerprint() -> Fingerprint {
    Fingerprint {
        program: "1".to_owned(),
        settings: settings(&[("time.end", "2"), ("output.xdmf", "true")]),
        start: Some(Start {
            points: ([4, 5], 6),
            values: Some(7),
        }),
        plan: 3,
    }
}

fn passage(mode: usize) -> Passage {
    Passage {
        legs: mode % 3 + 1,
        phase: Complex64::new(0.1 * mode as f64, 1.0 / 3.0),
        norm: std::f64::consts::PI,
        allowed: 1e-12,
    }
}

/// The rows of a mode on a block: cells, then auxiliary unknowns.
fn rows(space: &PhaseSpace, ranges: &[Range<usize>], mode: usize) -> Vec<Complex64> {
    let velocities = space.velocity_cells();
    let number = |array: usize, index: usize| {
        Complex64::new(real(array + mode, index), real(array + 50 + mode, index))
    };
    let cells = global_points(space, ranges).into_iter();
    let cells = cells.flat_map(|point| point * velocities..(point + 1) * velocities);
    let behind = auxiliary(space, ranges).into_iter();
    (cells.map(|cell| number(100, cell)))
        .chain(behind.map(|cell| number(200, cell as usize)))
        .collect()
}

/// Part of the sum that mode group `group` has; all of it together is `value`.
fn part(array: usize, index: usize, (group, groups): (usize, usize)) -> i64 {
    let others = |group: usize| value(array + 10 * (group + 1), index) as i64 >> 8;
    if group + 1 < groups {
        others(group)
    } else {
        let rest: i64 = (0..group).map(others).sum();
        (value(array, index) as i64 >> 4) - rest
    }
}

fn write_all(directory: &Path, space: &PhaseSpace, mesh: &Mesh) -> Vec<file::Written> {
    (0..mesh.ranks())
        .map(|rank| {
            let (block, group) = (rank % mesh.blocks(), rank / mesh.blocks());
            let ranges = mesh.ranges(space, block);
            let share = mesh.share(space, block, group);
            let sums: Vec<Vec<i64>> = (SUMS.iter().enumerate())
                .map(|(k, width)| {
                    let points = global_points(space, &ranges).into_iter();
                    let numbers = points.flat_map(|p| 2 * width * p..2 * width * (p + 1));
                    numbers.map(|i| part(k, i, (group, mesh.groups))).collect()
                })
                .collect();
            let results: Vec<Vec<f64>> = (RESULTS.iter().enumerate())
                .map(|(k, width)| expected_result(space, &share, k, *width))
                .collect();
            let modes: Vec<usize> = (0..MODES).filter(|l| l % mesh.groups == group).collect();
            let kept: Vec<Vec<Complex64>> = modes
                .iter()
                .map(|&mode| rows(space, &ranges, mode))
                .collect();
            let snapshot = Snapshot {
                state: State {
                    finished: modes.clone(),
                    beyond: vec![1.0 / 3.0, 1e-300, 0.1 + 0.2],
                    ..State::default()
                },
                sums: (sums.iter().zip(SUMS))
                    .map(|(values, width)| Numbers { width, values })
                    .collect(),
                results: (results.iter().zip(RESULTS))
                    .map(|(values, width)| Numbers { width, values })
                    .collect(),
                kept: Some(Kept {
                    auxiliary: auxiliary(space, &ranges),
                    modes: (modes.iter().zip(&kept))
                        .map(|(&mode, rows)| KeptMode {
                            mode,
                            passage: passage(mode),
                            rows,
                        })
                        .collect(),
                }),
            };
            let header = Header {
                fingerprint: fingerprint(),
                generation: 3,
                rank,
                velocity_cells: space.velocity_cells(),
                sums: SUMS.to_vec(),
                results: RESULTS.to_vec(),
                auxiliary: auxiliary(space, &ranges).len(),
                kept: modes.iter().map(|&mode| (mode, passage(mode))).collect(),
                state: snapshot.state.clone(),
                block: ranges,
                share,
            };
            let path = file_of(directory, rank);
            let written = file::write(&path, &header, &snapshot).expect("a file");
            assert_eq!(file::check(&path, &written), Ok(()));
            assert_eq!(RankFile::open(&path).expect("a file").header, header);
            written
        })
        .collect()
}

fn file_of(directory: &Path, rank: usize) -> PathBuf {
    directory.join(format!("{rank}"))
}

fn expected_result(space: &PhaseSpace, share: &[Range<usize>], k: usize, width: usize) -> Vec<f64> {
    let points = global_points(space, share).into_iter();
    let numbers = points.flat_map(|p| width * p..width * (p + 1));
    numbers.map(|i| real(20 + k, i)).collect()
}

#[test]
fn what_a_mesh_wrote_is_read_on_any_other() {
    let one = space(&[11]);
    let two = space(&[5, 4]);
    let mesh = |space: &[usize], groups: usize| Mesh {
        space: space.to_vec(),
        groups,
    };
    // Some shares are empty: more groups than layers of a block.
    let meshes = [
        (
            &one,
            vec![
                mesh(&[1], 1),
                mesh(&[3], 1),
                mesh(&[1], 4),
                mesh(&[4], 3),
                mesh(&[2], 7),
            ],
        ),
        (
            &two,
            vec![
                mesh(&[1, 1], 2),
                mesh(&[2, 3], 1),
                mesh(&[5, 1], 2),
                mesh(&[1, 4], 3),
            ],
        ),
    ];
    for (space, meshes) in &meshes {
        let whole: Vec<Range<usize>> = space.x.iter().map(|a| 0..a.cells).collect();
        for from in meshes {
            let directory = tempfile::tempdir().expect("a directory");
            write_all(directory.path(), space, from);
            for to in meshes {
                let mut sums: Vec<Vec<i64>> = SUMS
                    .iter()
                    .map(|width| vec![0; 2 * width * file::points(&whole)])
                    .collect();
                for rank in 0..to.ranks() {
                    let (block, group) = (rank % to.blocks(), rank / to.blocks());
                    let ranges = to.ranges(space, block);
                    let share = to.share(space, block, group);
                    let own = global_points(space, &ranges);
                    let mut mine: Vec<Vec<i64>> = SUMS
                        .iter()
                        .map(|width| vec![0; 2 * width * own.len()])
                        .collect();
                    let cells = Block::new(space, to, block).cells();
                    let behind = auxiliary(space, &ranges);
                    let modes: Vec<usize> = (0..MODES).filter(|l| l % to.groups == group).collect();
                    let mut kept = KeptModes::new(cells + behind.len(), modes.clone());
                    let mut into = Destination {
                        block: &ranges,
                        share: &share,
                        sums: mine.iter_mut().map(|sum| &mut sum[..]).collect(),
                        results: (RESULTS.iter())
                            .map(|width| vec![0.0; width * file::points(&share)])
                            .collect(),
                        kept: Some((behind, &mut kept)),
                    };
                    for other in 0..from.ranks() {
                        let file =
                            RankFile::open(&file_of(directory.path(), other)).expect("a file");
                        let with_sums = other / from.blocks() % to.groups == group;
                        file.read_into(&mut into, with_sums).expect("a reading");
                    }
                    for (k, result) in into.results.iter().enumerate() {
                        assert_eq!(result, &expected_result(space, &share, k, RESULTS[k]));
                    }
                    for (sum, (mine, width)) in sums.iter_mut().zip(mine.iter().zip(SUMS)) {
                        let places = own.iter().flat_map(|p| 2 * width * p..2 * width * (p + 1));
                        places
                            .zip(mine)
                            .for_each(|(place, part)| sum[place] += part);
                    }
                    for &mode in &modes {
                        assert_eq!(kept.mode(mode), Some(&rows(space, &ranges, mode)[..]));
                        assert_eq!(kept.passage(mode), Some(passage(mode)));
                    }
                }
                for (k, sum) in sums.iter().enumerate() {
                    for (i, &found) in sum.iter().enumerate() {
                        assert_eq!(found, value(k, i) as i64 >> 4, "{from:?} to {to:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn every_flipped_bit_is_found() {
    let space = space(&[3]);
    let mesh = Mesh {
        space: vec![1],
        groups: 1,
    };
    let directory = tempfile::tempdir().expect("a directory");
    let written = write_all(directory.path(), &space, &mesh)[0];
    let path = file_of(directory.path(), 0);
    let bytes = std::fs::read(&path).expect("a file");
    for at in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        std::fs::write(&path, changed).expect("a file");
        assert!(file::check(&path, &written).is_err(), "byte {at}");
    }
    for length in [0, 7, 8, 16, 24, bytes.len() - 8, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..length]).expect("a file");
        assert!(file::check(&path, &written).is_err(), "{length} bytes");
        assert!(RankFile::open(&path).is_err(), "{length} bytes");
    }
}

#[test]
fn runs_that_differ_are_told_apart() {
    let own = fingerprint();
    assert_eq!(own.difference(&own), None);
    let start = |points, values| Some(Start { points, values });
    for (other, word) in [
        (
            Fingerprint {
                program: "2".to_owned(),
                ..own.clone()
            },
            "phasewarp 2",
        ),
        (
            Fingerprint {
                settings: settings(&[("time.end", "3"), ("output.xdmf", "true")]),
                ..own.clone()
            },
            "time.end is 3 there, 2 here",
        ),
        (
            Fingerprint {
                settings: settings(&[("time.end", "2")]),
                ..own.clone()
            },
            "output.xdmf is not given there, true here",
        ),
        (
            // Other points make another plan, too; that is not the reason.
            Fingerprint {
                start: start(([4, 5], 8), Some(7)),
                plan: 9,
                ..own.clone()
            },
            "initial.warped",
        ),
        (
            Fingerprint {
                start: start(([4, 5], 6), Some(8)),
                ..own.clone()
            },
            "initial.warped",
        ),
        (
            Fingerprint {
                plan: 9,
                ..own.clone()
            },
            "another plan",
        ),
    ] {
        assert!(own.difference(&other).is_some_and(|why| why.contains(word)));
    }
    // Before the file was read.
    let unread = Fingerprint {
        start: start(([4, 5], 6), None),
        ..own.clone()
    };
    assert_eq!(unread.difference(&own), None);
}

#[test]
fn mode_groups_together() {
    let told = |kept, defect, applications| Told {
        kept,
        defect,
        applications,
        solves: 2,
    };
    let state = |finished: &[usize], told: Told| State {
        finished: finished.to_vec(),
        beyond: vec![0.5],
        told,
        ..State::default()
    };
    let mut all = state(&[3, 4], told(Some(0.5), None, 7));
    all.add(state(&[1], told(Some(0.25), Some(0.1), 5)));
    all.add(state(&[], told(None, Some(0.3), 0)));
    let expected = Told {
        kept: Some(0.25),
        defect: Some(0.3),
        applications: 12,
        solves: 6,
    };
    assert_eq!(
        (all.finished, all.beyond.len(), all.told),
        (vec![3, 4, 1], 3, expected)
    );
}
