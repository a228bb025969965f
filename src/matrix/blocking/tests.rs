//! The shapes that are planned, the tiles and the choice of the fastest.

use super::*;
use crate::matrix::blocking::fastest::{BYTES_PER_ROW, FastestBlocking, SHARE};
use crate::parallel::partition::{Block, ProcessMesh};
use crate::problem::case::Case;
use std::collections::BTreeSet;

/// The matrix of a step of `V` on as many elements along `x` and `v`.
fn matrix(degree: usize, elements: usize) -> BlockMatrix {
    matrix_of("where = \"x < 0\"\nvalue = \"0.2\"", degree, [elements; 2])
}

/// The matrix of a potential that is 0 where it is not given, on `elements` along `x` and `v`.
fn matrix_of(potential: &str, degree: usize, elements: [usize; 2]) -> BlockMatrix {
    matrix_of_block(potential, degree, elements, -1.5, 1)
}

/// The matrix of [`matrix_of`] on the first of `blocks` blocks, for velocities from `lower` on.
fn matrix_of_block(
    potential: &str,
    degree: usize,
    elements: [usize; 2],
    lower: f64,
    blocks: usize,
) -> BlockMatrix {
    let axis = |name: &str, lower: f64, upper: f64, elements: usize| {
        format!("{name} = {{ lower = {lower}, upper = {upper}, cells = {elements} }}\n")
    };
    let text = format!(
        "[[axis]]\n{}{}[[potential]]\n{potential}\n\
         [[potential]]\nvalue = \"0\"\n[scheme]\ndegree = {degree}\n\
         [initial]\nf = \"exp(-x^2)\"\n[time]\nend = 1.0\n",
        axis("x", -1.0, 1.0, elements[0]),
        axis("v", lower, 1.5, elements[1])
    );
    let case = Case::parse("case", &text, &[]).expect("a case");
    let block = Block::new(&case.space, &ProcessMesh { space: vec![blocks], groups: 1 }, 0);
    let mut matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
    matrix.gather_elements();
    matrix
}

/// The shape for a core with 1 MiB of its own and 16 MiB of the last-level cache.
fn planned(degree: usize, elements: usize) -> Option<[usize; 3]> {
    let matrix = matrix(degree, elements);
    let caches = Caches { own: 1048576.0, last: 16777216.0 }.part(SHARE);
    let parts = matrix.independent_velocities();
    let shape = BlockingShape::planned(&matrix, caches, BYTES_PER_ROW, parts)?;
    Some([shape.depth, shape.width, shape.parts])
}

/// Small grids are not blocked, nor elements in the last-level cache whose tiles do not fit
/// into that of a core. For grids in memory, tiles in the last-level cache have many levels.
#[test]
fn blocking_is_where_the_model_saves_time() {
    for (degree, elements, expected) in [
        (0, 32, None),
        (0, 128, Some([14, 1, 1])),
        (0, 512, Some([16, 1, 1])),
        (3, 8, None),
        // 290 bytes a row: four tiles of 512 rows take 594 kB, and 577 kB may be filled.
        (3, 32, None),
        (4, 26, None),
        (8, 14, None),
        (8, 28, Some([16, 1, 2])),
    ] {
        assert_eq!(planned(degree, elements), expected, "degree {degree}, {elements}");
    }
}

/// The neighbours of merged tiles are those of the rows of these tiles.
#[test]
fn merged_tiles_have_the_neighbours_of_their_rows() {
    let step = "where = \"x < 0\"\nvalue = \"0.2\"";
    // Of two blocks, with particles at rest, which are not coupled to ghosts.
    let rests = matrix_of_block(step, 0, [24, 8], -0.1, 2);
    let all = [(0, 24), (2, 9)]
        .map(|(degree, elements)| (degree, elements, matrix_of(step, degree, [elements; 2])));
    for (degree, elements, matrix) in all.into_iter().chain([(0, 12, rests)]) {
        let fine = Tiling::new(&matrix, 8).neighbours(&matrix);
        for parts in [1, 2, 4, 8] {
            let (merged, own) = (fine.merged(parts), Tiling::new(&matrix, parts));
            let own = own.neighbours(&matrix);
            assert!(own.ends.len() >= elements * parts && merged.border == own.border);
            for tile in 0..own.ends.len() {
                let [a, b] = [&merged, &own].map(|n| BTreeSet::from_iter(n.of(tile)));
                assert_eq!(a, b, "degree {degree}, {parts} parts, tile {tile}");
            }
        }
    }
}

/// A force in few cells couples the velocities of an element. No range of velocities is a part
/// of an element, so that ranges nest for any number of elements.
#[test]
fn ranges_of_velocities_nest_where_a_force_acts_in_few_cells() {
    let force = "where = \"x < -0.9\"\nvalue = \"x + 0.9\"";
    for (degree, elements) in [(8, [20, 15]), (8, [20, 7]), (3, [20, 30])] {
        let matrix = matrix_of(force, degree, elements);
        let most = matrix.independent_velocities();
        assert!(1 < most && most <= elements[1], "{most} ranges of {} elements", elements[1]);
        let most = 1 << most.ilog2();
        let shape = |parts| Some(BlockingShape { depth: 2, width: 1, parts });
        let all = FastestBlocking::of_shapes(&matrix, 1000, &[shape(most), shape(most / 2)]);
        let parts: Vec<_> = all.all().iter().flatten().map(|b| b.shape().parts).collect();
        assert_eq!(parts, [most, most / 2]);
    }
}

/// Each candidate is timed twice, and the least time counts. The last pass of a series may be
/// shorter, and does not count.
#[test]
fn the_fastest_candidate_is_kept() {
    let matrix = matrix(0, 8);
    let shape = |depth| BlockingShape { depth, width: 1, parts: 1 };
    let deep = |depth| Some(Blocking::new(&matrix, &shape(depth)));
    let mut fastest = FastestBlocking::of(vec![None, deep(2), deep(3)]);
    for (depth, seconds) in [(1, 0.5), (2, 0.6), (3, 3.0), (1, 0.9), (2, 9.0), (3, 1.2)] {
        assert_eq!(fastest.depth(), depth);
        if depth > 1 {
            fastest.passed(1, 0.0);
        }
        fastest.passed(depth, seconds);
    }
    // 0.5, 0.3 and 0.4 seconds a step.
    assert_eq!(fastest.depth(), 2);
    fastest.passed(2, 100.0);
    assert_eq!(fastest.depth(), 2);
}

/// Where no series is as long as a pass, passes are timed as they are.
#[test]
fn candidates_deeper_than_every_series_are_timed() {
    let matrix = matrix(0, 8);
    let deep = |depth| Some(Blocking::new(&matrix, &BlockingShape { depth, width: 1, parts: 1 }));
    let mut fastest = FastestBlocking::of(vec![deep(6), deep(5), None]);
    for _ in 0..20 {
        let depth = fastest.depth();
        // Series of 4 steps, of 1 second a step with blocking, and of half of it without.
        match depth {
            1 => fastest.passed(1, 0.5),
            _ => fastest.passed(4, 4.0),
        }
    }
    assert_eq!(fastest.depth(), 1);
}

/// Where there are too few steps for trials, the first shape is taken as it is.
#[test]
fn few_steps_are_not_tried_in_several_ways() {
    let matrix = matrix(0, 8);
    let shape = |depth| Some(BlockingShape { depth, width: 1, parts: 1 });
    // 12 steps for the planning and 2 (1 + 2 + 3) timed ones, and three times as many.
    for (steps, expected) in [(71, vec![2]), (72, vec![2, 3, 1]), (1000, vec![2, 3, 1])] {
        let fastest = FastestBlocking::of_shapes(&matrix, steps, &[shape(2), shape(3)]);
        let depths = fastest.all().iter().map(|c| c.as_ref().map_or(1, Blocking::depth));
        assert_eq!(depths.collect::<Vec<_>>(), expected, "{steps} steps");
    }
    let single = FastestBlocking::of_shapes(&matrix, 10, &[None, shape(3)]);
    assert_eq!((single.all().len(), single.depth()), (1, 1));
}
