//! A rank's part of a twin: a block of its matrix, its system prepared as in a run, and whole
//! vectors gathered from all ranks.

use crate::dense_twins::Twin;
use crate::support::dense::Dense;
use crate::support::prepared::{Prepared, block_of, prepare};
use phasewarp::matrix::block_matrix::{BlockMatrix, Operator};
use phasewarp::matrix::bounds::Bounds;
use phasewarp::matrix::lanes::{LANES, Lanes};
use phasewarp::parallel::communicator::{Communicator, GhostExchange, Group, World};
use phasewarp::parallel::partition::{Block, ProcessMesh};
use phasewarp::problem::case::{Case, Embedding};

/// All meshes of the ranks of `world` that the grid of `case` allows, sorted by the number of
/// blocks.
pub fn meshes(world: &World, case: &Case) -> Vec<ProcessMesh> {
    fn visit(case: &Case, ranks: usize, parts: &mut Vec<usize>, list: &mut Vec<ProcessMesh>) {
        let Some(axis) = case.space.x.get(parts.len()) else {
            let space = parts.clone();
            list.push(ProcessMesh { space, groups: ranks });
            return;
        };
        let most = case.space.most_blocks(parts.len()).min(axis.cells);
        for blocks in (1..=ranks.min(most)).filter(|b| ranks.is_multiple_of(*b)) {
            parts.push(blocks);
            visit(case, ranks / blocks, parts, list);
            parts.pop();
        }
    }
    let mut list = Vec::new();
    visit(case, world.group().size(), &mut Vec::new(), &mut list);
    assert!(list.iter().all(|m| m.ranks() == world.group().size()));
    list.sort_by_key(ProcessMesh::blocks);
    list
}

/// The mesh with one block; all ranks are mode groups.
pub fn one_block(world: &World, case: &Case) -> ProcessMesh {
    ProcessMesh { space: vec![1; case.space.dimension()], groups: world.group().size() }
}

/// Calls `check` with every twin, mesh and piece.
pub fn for_every_piece(world: &World, mut check: impl FnMut(&Twin, &ProcessMesh, &mut Piece)) {
    for twin in Twin::all() {
        for mesh in meshes(world, &twin.case) {
            check(&twin, &mesh, &mut Piece::assemble(world, &twin, &mesh));
        }
    }
}

/// The number in the grid of each cell of the block.
pub fn cell_numbers(block: &Block) -> Vec<usize> {
    let mut number = vec![usize::MAX; block.cells()];
    block.for_each_own(|first, local| {
        (0..block.velocity_cells).for_each(|v| number[local + v] = first + v);
    });
    number
}

/// The number in the twin of each local row of `matrix`, then of each ghost.
fn row_numbers(twin: &Twin, matrix: &BlockMatrix) -> Vec<usize> {
    let (block, rows) = (&matrix.block, matrix.rows());
    let mut number = cell_numbers(block);
    if twin.case.warp.inflow == Embedding::Scalar {
        number.resize(rows, twin.cells);
    }
    for aux in &matrix.inflow[..rows - number.len()] {
        let place = twin.inflow.binary_search(&number[aux.row as usize]);
        number.push(twin.cells + place.expect("a row with inflow"));
    }
    number.resize(matrix.length(), usize::MAX);
    block.for_each_ghost(|first, ghost| {
        (0..block.velocity_cells).for_each(|v| number[rows + ghost + v] = first + v);
    });
    number
}

/// Gathers a vector of length `size` from all ranks of `group` on every rank. Every entry has one
/// owner.
pub fn gather(group: &Group, size: usize, entries: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
    let mut values = vec![f64::NEG_INFINITY; size];
    let mut owned = 0;
    for (i, value) in entries {
        values[i] = value;
        owned += 1;
    }
    assert_eq!(group.sum_count(owned), size, "every entry has one owner");
    group.max_into(&mut values);
    let missing = values.contains(&f64::NEG_INFINITY);
    assert!(!missing, "every entry has an owner");
    values
}

/// This rank's part of the matrix of a twin, without weights.
pub struct Piece {
    pub communicator: Communicator,
    pub matrix: BlockMatrix,
    pub exchange: GhostExchange,
    /// The number in the twin of each local row, then of each ghost.
    pub number: Vec<usize>,
}

impl Piece {
    pub fn new(twin: &Twin, communicator: Communicator, matrix: BlockMatrix) -> Self {
        let exchange = GhostExchange::new(&communicator.space, &matrix.block, 2 * LANES);
        let number = row_numbers(twin, &matrix);
        Self { communicator, matrix, exchange, number }
    }

    pub fn assemble(world: &World, twin: &Twin, mesh: &ProcessMesh) -> Self {
        let communicator = Communicator::new(world, mesh);
        assert_eq!(communicator.space.size(), mesh.blocks());
        assert_eq!(communicator.modes.size(), mesh.groups);
        let block = block_of(&twin.case, mesh, &communicator);
        let mut matrix = BlockMatrix::assemble(&twin.case, block).expect("formulas are finite");
        let mut pi = vec![1.0; matrix.length()];
        matrix.couple(&communicator.space, &twin.case, &mut pi);
        assert!(pi.iter().all(|&pi| pi == 1.0), "{}", twin.name);
        Self::new(twin, communicator, matrix)
    }

    /// One real number for each local row, as a function of the row's number in the twin. Ghosts
    /// are NaN until they are exchanged.
    pub fn reals(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        self.local(f64::NAN, value)
    }

    /// A batch of numbers for each local row, in the same way.
    pub fn batch(&self, value: impl Fn(usize) -> [f64; 2 * LANES]) -> Vec<Lanes> {
        self.local(Lanes([f64::NAN; 2 * LANES]), |i| Lanes(value(i)))
    }

    fn local<T: Clone>(&self, ghost: T, value: impl Fn(usize) -> T) -> Vec<T> {
        let own = &self.number[..self.matrix.rows()];
        let mut list: Vec<T> = own.iter().map(|&i| value(i)).collect();
        list.resize(self.matrix.length(), ghost);
        list
    }

    /// The local part of a vector of the twin.
    pub fn scatter(&self, vector: &[f64]) -> Vec<f64> {
        self.reals(|i| vector[i])
    }

    /// Gathers the whole vector on every rank. Each row has one owner in the space group.
    pub fn gather(&self, twin: &Twin, local: &[f64]) -> Vec<f64> {
        let entries = (0..self.matrix.counted_rows()).map(|i| (self.number[i], local[i]));
        gather(&self.communicator.space, twin.size(), entries)
    }

    /// The product of a part of the matrix with `x` on the local rows.
    pub fn apply(&mut self, part: Operator, x: &mut [f64]) -> Vec<f64> {
        let mut image = vec![f64::NAN; self.matrix.length()];
        (self.matrix).apply(&mut self.exchange, part, &mut image, x);
        image
    }

    /// The whole `(S, K)` as dense matrices.
    pub fn gather_matrix(&self, world: &World, twin: &Twin) -> (Dense, Dense) {
        let size = twin.size();
        let space = &self.communicator.space;
        assert_eq!(space.sum_count(self.matrix.counted_rows()), size);
        let mut s = vec![f64::NEG_INFINITY; size * size];
        let mut k = s.clone();
        let line = |i: usize| self.matrix.stored().lines().line_and_node(i).0;
        let space_cell = |i: usize| i / self.matrix.block.velocity_cells;
        for i in 0..self.matrix.rows() {
            // Gathered rows begin with the entries of their line of nodes, and end with those along
            // velocity axes, which no partition parts.
            let mut last = None;
            for (column, es, ek) in self.matrix.row(i) {
                let j = self.number[column];
                if line(column) != line(i) && space_cell(column) != space_cell(i) {
                    assert!(last < Some(j), "{}: row {i} is not in order", twin.name);
                    last = Some(j);
                }
                let place = self.number[i] * size + j;
                (s[place], k[place]) = (es, ek);
            }
        }
        [s, k]
            .map(|mut entries| {
                // The maximum over the world: all mode groups have the same entries.
                world.group().max_into(&mut entries);
                let present = |entry: f64| {
                    if entry == f64::NEG_INFINITY { 0.0 } else { entry }
                };
                Dense::from_fn(size, |i, j| present(entries[i * size + j]))
            })
            .into()
    }
}

/// The number in the grid of each point of space in this rank's share of the results.
pub fn point_numbers(prepared: &Prepared) -> Vec<usize> {
    let block = &prepared.rank_cells.block;
    let number = cell_numbers(block);
    let firsts = prepared.rank_cells.mine.clone().step_by(block.velocity_cells);
    firsts.map(|i| number[i] / block.velocity_cells).collect()
}

/// Gathers the whole field on every rank from the states of the ranks.
pub fn gather_cells(prepared: &Prepared, state: &[f64]) -> Vec<f64> {
    let number = cell_numbers(&prepared.rank_cells.block);
    let entries = number.into_iter().zip(state.iter().copied());
    let cells = prepared.case.space.cells();
    gather(&prepared.communicator.space, cells, entries)
}

/// Gathers the whole field on every rank from the shares that the ranks recovered, without weights.
pub fn gather_field(world: &World, prepared: &Prepared, share: &[f64]) -> Vec<f64> {
    let mine = &prepared.rank_cells.mine;
    assert_eq!(share.len(), mine.len());
    let number = cell_numbers(&prepared.rank_cells.block);
    let field = prepared.unweighted(share.to_vec());
    let entries = number[mine.clone()].iter().copied().zip(field);
    gather(&world.group(), prepared.case.space.cells(), entries)
}

/// A prepared system with weights, and its dense twin in the same unknowns.
pub struct Weighted {
    pub prepared: Prepared,
    /// Number in the twin of each local row, then of each ghost.
    pub number: Vec<usize>,
    /// `π`, by the numbers of the twin.
    pub pi: Vec<f64>,
    /// `D A D⁻¹`, `D = diag(√π)`.
    pub generator: Dense,
    /// `D u(0)`.
    pub state: Vec<f64>,
}

impl Weighted {
    pub fn new(world: &World, twin: &Twin, mesh: &ProcessMesh) -> Self {
        let prepared = prepare(world, &twin.case, mesh);
        let allowed = Bounds::new(&twin.case).expect("V is finite");
        // Without weights, the hat interface may grow at any rate.
        let round_off = 1e-14 * prepared.bounds.rate;
        let unlimited = !twin.case.warp.weights;
        assert!(prepared.bounds.growth <= allowed.growth + round_off || unlimited);
        let system = &prepared.system;
        let number = row_numbers(twin, &system.matrix);
        let rows = system.matrix.counted_rows();
        let entries = (0..rows).map(|i| (number[i], system.weights.pi[i]));
        let pi = gather(&prepared.communicator.space, twin.size(), entries);
        let weighted = |(u, pi): (&f64, &f64)| u * pi.sqrt();
        Self {
            generator: twin.generator.weighted(&pi),
            state: twin.state.iter().zip(&pi).map(weighted).collect(),
            prepared,
            number,
            pi,
        }
    }
}
