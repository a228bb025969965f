//! Memory of a run on a rank, in bytes, before anything is allocated.

use crate::base::memory::NamedBytes;
use crate::matrix::assembly::layer_bytes;
use crate::matrix::bounds::{AssembledSize, Bounds};
use crate::matrix::inflow::{AuxiliaryRow, VaryingInflow};
use crate::matrix::lanes::{LANES, Lanes};
use crate::matrix::observables::MOMENTS;
use crate::parallel::partition::{BlockSize, ProcessMesh, largest_part};
use crate::problem::case::{Case, Data, Embedding, Integrator, Limiter, Storage, TableFile};
use crate::problem::exact::sheet::curve_points;
use crate::problem::grid::{Axis, PhaseSpace};
use crate::problem::limits::{MOST_WINDOW_SAMPLES, WINDOW_SAMPLES};
use crate::problem::potential::Potential;
use crate::problem::table::Table;
use crate::propagate::descriptor;
use crate::propagate::evolution::MatrixShare;
use crate::propagate::intermediate_moments::IntermediateMoments;
use crate::propagate::method::BatchCoupling;
use crate::scheme::reduce::grid;
use crate::schrodingerization::warp_plan::WarpPlan;
use num_complex::Complex64;
use std::ops::Range;

/// Bytes that the program and its libraries allocate, with buffers of HDF5 and MPI. It is the rest
/// of the peaks in the table of `docs/reliability.md`, without pages of files.
const PROGRAM_BYTES: u64 = 6 << 20;

/// Bytes that MPI allocates in addition on several ranks.
const EXCHANGE_BYTES: u64 = 1 << 20;

/// Bytes that HDF5 takes on the fullest rank while a dataset is written in chunks: the larger of
/// two steps. Fitted to 1 to 4 ranks, 4096 to 16384 chunks of 1 to 25 cells, one and two
/// dimensions.
mod chunk {
    /// The first step, for each chunk of the dataset.
    pub const FIRST_STEP: u64 = 4700;
    /// The first step in addition, on several ranks.
    pub const FIRST_STEP_TOGETHER: u64 = 7 << 18;
    /// The second step, for each chunk of the dataset.
    pub const SECOND_STEP: u64 = 950;

    /// The second step in addition, for each chunk that the rank writes a part of.
    pub struct ChunkBytes {
        /// Whatever its shape.
        pub each: u64,
        /// For each group of pieces.
        pub group: u64,
        /// For each piece: a run of cells in storage order, or a group in another.
        pub piece: u64,
    }

    /// Where chunks are written as they are.
    pub const PLAIN: ChunkBytes = ChunkBytes { each: 10_430, group: 130, piece: 100 };
    /// Where they are compressed.
    pub const COMPRESSED: ChunkBytes = ChunkBytes { each: 7130, group: 0, piece: 45 };
}

/// Bytes of a region of `V`: its keys, as they are given, read and stored, and its formulas.
const REGION_BYTES: u64 = 6 << 10;

/// Bytes of a rank, of `ranks` in all, that are pages of the files of the program and its
/// libraries. Their number depends on the kernel's page cache; this is the largest that was
/// measured.
pub fn program_file_bytes(ranks: usize) -> u64 {
    // Several ranks also load the parts of MPI that connect them.
    if ranks > 1 { 59 << 19 } else { 53 << 19 }
}

/// Bytes of the program and its libraries on a rank, of `ranks` in all.
pub fn program_bytes(ranks: usize) -> u64 {
    PROGRAM_BYTES + u64::from(ranks > 1) * EXCHANGE_BYTES + program_file_bytes(ranks)
}

/// Bytes of an output time beside its numbers: its lists, and the lists of its datasets while they
/// are written.
const TIME_BYTES: u64 = 5 << 9;

/// Bytes of a rank's buffers, unless one cell takes more.
pub const BUFFERS: u64 = 16 << 20;

/// Bytes of a mode that a rank stores, in addition to its rows: its number and its progress.
pub const RANK_MODE_BYTES: u64 = 48;

/// Bytes of a mode in the tables that every rank has: its coefficient, tolerance, work and batch,
/// and copies of them.
const TABLES_OF_A_MODE: u64 = 112;

/// Bytes of a mode in the plan as text, while the results are written.
const TEXT_OF_A_MODE: u64 = 40;

/// Tables of at most so many modes are not listed.
const MANY_MODES: usize = 4096;

/// Bytes of `modes` modes that a rank stores, of `rows` rows each.
pub fn rank_modes_bytes(rows: u64, modes: u64) -> u64 {
    modes * (rows * size_of::<Complex64>() as u64 + RANK_MODE_BYTES)
}

/// A case, and the part of its plan that is the same for any ranks.
#[derive(Clone, Copy, Debug)]
pub struct PlannedWork<'a> {
    /// The case.
    pub case: &'a Case,
    /// Bounds on its generator.
    pub bounds: &'a Bounds,
    /// The modes; `None` for the classical method.
    pub warp: Option<&'a WarpPlan>,
}

/// Planned bytes on the fullest rank of `mesh` for a run that keeps all modes, with `points` points
/// in `p`.
pub(crate) fn memory_of_points(work: PlannedWork<'_>, mesh: &ProcessMesh, points: usize) -> u64 {
    let modes = points / 2 + 1;
    let piece = match descriptor(work.case.propagator.method).batch_coupling() {
        BatchCoupling::Independent | BatchCoupling::Coupled => LANES,
        BatchCoupling::Sequential => 1,
    };
    let most = modes.min(piece * modes.div_ceil(piece).div_ceil(mesh.groups));
    let warp = work.warp.map(|warp| WarpPlan { points: Some(points), modes, ..warp.clone() });
    let list = arrays(PlannedWork { warp: warp.as_ref(), ..work }, mesh, most);
    list.iter().map(|a| a.bytes).sum()
}

/// Bytes that HDF5 takes while it writes a dataset of the user's grid in chunks, with all times if
/// fields are written at several. Measured on one rank: 11.4 kB a chunk of one cell, 8.0 kB if it
/// is compressed.
fn chunk_bytes(case: &Case, mesh: &ProcessMesh) -> u64 {
    let (space, storage) = (grid(case), &case.output.storage);
    let at_a_time = storage.most_chunks(&space);
    if at_a_time == 0 {
        return 0;
    }
    let times = case.shown_times().filter(|time| time.fields).count().max(1);
    let all = (at_a_time * times) as u64;
    let own = own_chunks(&space, storage, mesh, at_a_time) as u64;
    let step = if storage.compression > 0 { chunk::COMPRESSED } else { chunk::PLAIN };
    let [groups, pieces] = pieces_of_a_chunk(case, &space);
    let of_own = step.each + step.group * groups + step.piece * pieces;
    let together = u64::from(mesh.ranks() > 1) * chunk::FIRST_STEP_TOGETHER;
    (chunk::FIRST_STEP * all + together).max(chunk::SECOND_STEP * all + of_own * own)
}

/// The groups and the pieces of a chunk of the largest dataset, if the user gives chunks: a group
/// along each axis but the last, from the first one on along which the chunk has several cells, and
/// as many groups in it as it has cells.
fn pieces_of_a_chunk(case: &Case, space: &PhaseSpace) -> [u64; 2] {
    // Components of a gradient are in one chunk.
    let components = if case.is_measure_valued() { space.dimension() } else { 1 };
    let chunks = case.output.storage.chunks.iter().flatten().zip(space.axes());
    let lengths = chunks.map(|(&length, axis)| length.min(axis.cells));
    let lengths = std::iter::once(components).chain(lengths).take(2 * space.dimension());
    let [mut groups, mut pieces, mut inner] = [0, 0, 1];
    for length in lengths.skip_while(|&length| length == 1) {
        groups += inner;
        inner *= length as u64;
        pieces += inner;
    }
    [groups, pieces]
}

/// The most of `chunks` chunks of `space` that a rank writes a part of.
fn own_chunks(space: &PhaseSpace, storage: &Storage, mesh: &ProcessMesh, chunks: usize) -> usize {
    let shares =
        (0..mesh.ranks()).map(|rank| mesh.share(space, rank % mesh.blocks(), rank / mesh.blocks()));
    let Some(lengths) = &storage.chunks else {
        // Planned chunks are as long as the last axes, and short along the first.
        let layers = shares.map(|share| share[0].len()).max().unwrap_or(0);
        return (chunks * layers).div_ceil(space.x[0].cells);
    };
    let touched = |(share, length): (&Range<usize>, &usize)| {
        share.end.div_ceil(*length).saturating_sub(share.start / length)
    };
    let in_space = shares.map(|share| share.iter().zip(lengths).map(touched).product::<usize>());
    let velocities = lengths.iter().zip(space.axes()).skip(space.dimension());
    let velocities = velocities.map(|(length, axis)| axis.cells.div_ceil(*length));
    in_space.max().unwrap_or(0) * velocities.product::<usize>()
}

/// The arrays of the fullest rank, in bytes, if a rank has at most `most` modes. It is the largest
/// of six lists: while the matrix is assembled, while particles of the exact flow are traced,
/// during the solve, while the error of the grid is estimated, while results are expanded to the
/// user's grid, and while they are written.
pub(crate) fn arrays(work: PlannedWork<'_>, mesh: &ProcessMesh, most: usize) -> Vec<NamedBytes> {
    let PlannedWork { case, warp, .. } = work;
    let rank = FullestRank::new(work, mesh);
    let solving = match warp {
        Some(warp) => rank.modes(warp, most),
        None => rank.classical(),
    };
    let results = rank.results(warp);
    let mut expanding: Vec<NamedBytes> = results.iter().cloned().chain(rank.expanded()).collect();
    let writing = [rank.writing(warp), expanding.clone()].concat();
    // Their errors are integrals, for which the exact solution is traced once more.
    let has_integrals = case.space.whole_degree() > 0 && case.traces_exact();
    expanding.push(if has_integrals { rank.traced() } else { rank.traced_at_end() });
    let estimating = results.into_iter().chain(rank.estimate()).collect();
    let bytes = |list: &Vec<NamedBytes>| -> u64 { list.iter().map(|a| a.bytes).sum() };
    let lists = [expanding, estimating, solving, vec![rank.traced()]];
    let largest = lists.into_iter().max_by_key(bytes).unwrap_or_default();
    let mut running = [rank.system(), largest].concat();
    running.extend(warp.and_then(tables_of_modes));

    [rank.assembling(), running, writing].into_iter().max_by_key(bytes).unwrap_or_default()
}

/// The sizes of the fullest rank of a mesh.
struct FullestRank<'a> {
    case: &'a Case,
    bounds: &'a Bounds,
    mesh: &'a ProcessMesh,
    /// Points of space of the block.
    points: u64,
    /// Cells of the block.
    cells: u64,
    /// Ghosts of the block.
    ghosts: u64,
    auxiliary: u64,
    inflow_rows: u64,
    /// Bytes of the sources of a time-dependent inflow.
    sources: u64,
}

impl<'a> FullestRank<'a> {
    fn new(PlannedWork { case, bounds, .. }: PlannedWork<'a>, mesh: &'a ProcessMesh) -> Self {
        let BlockSize { points, cells, ghosts, .. } = mesh.fullest_block(&case.space);
        let [points, cells, ghosts] = [points, cells, ghosts].map(|n| n as u64);
        // Before the matrix is assembled: all rows that may have inflow.
        let ends = match &bounds.assembled {
            Some(found) => (found.inflow_rows_per_cell * cells as f64).ceil() as u64,
            None => inflow_rows(case, bounds, cells),
        };
        let (inflow_rows, auxiliary) = match (bounds.inflow, case.warp.inflow) {
            (false, _) => (0, 0),
            (true, Embedding::Boundary) => (ends, ends),
            (true, Embedding::Full) => (cells, cells),
            (true, Embedding::Scalar) => (ends, 1),
        };
        let sources = match &bounds.assembled {
            Some(found) => (found.source_bytes_per_cell * cells as f64) as u64,
            None if bounds.inflow && case.varies() => ends * VaryingInflow::ROW_BYTES as u64,
            None => 0,
        };
        Self { case, bounds, mesh, points, cells, ghosts, auxiliary, inflow_rows, sources }
    }

    /// Rows of the matrix.
    fn rows(&self) -> u64 {
        self.cells + self.auxiliary
    }

    /// Length of a vector: rows and ghosts.
    fn length(&self) -> u64 {
        self.rows() + self.ghosts
    }

    fn entries(&self) -> u64 {
        self.rows() * entries_of_a_row(self.case, self.bounds)
    }

    fn fields(&self) -> u64 {
        self.case.fields.len() as u64
    }

    /// Bytes of the result's cells that a rank keeps after the sums are shared among mode groups.
    fn share(&self) -> u64 {
        largest_share(self.cells, &self.case.space.x[0], self.mesh)
    }

    /// The program and its libraries.
    fn program(&self) -> NamedBytes {
        NamedBytes::new("program and libraries", program_bytes(self.mesh.ranks()))
    }

    /// Arrays while the rows of the matrix are assembled, layer by layer along the first x-axis.
    fn assembling(&self) -> Vec<NamedBytes> {
        let first = &self.case.space.x[0];
        let layers = (largest_part(first, self.mesh.space[0]) / first.nodes.count()).max(1) as u64;
        let (contributions, before, changed) = match &self.bounds.assembled {
            Some(found) => {
                let AssembledSize { contributions_per_row, .. } = *found;
                (contributions_per_row, found.bytes_per_row_before, found.changed_bytes_per_row)
            }
            None if self.case.is_galerkin() => {
                let entries = entries_of_a_row(self.case, self.bounds) as f64;
                let each = self.stored_rows() as f64 / self.rows() as f64;
                // Both an entry and that of the transpose, of which a part are at the same place.
                (1.5 * entries, each, 2.0 * each)
            }
            // Equal rows are assembled once.
            None => (0.0, 0.0, 0.0),
        };
        let [before, changed] = [before, changed].map(|each| (each * self.rows() as f64) as u64);
        let sorted = layer_bytes(layers, self.cells / layers, contributions);
        let more = sorted.max(changed.saturating_sub(before));
        let mut list = vec![
            self.program(),
            self.inflow(0),
            NamedBytes::new("rows of the matrix as they are assembled", before),
            NamedBytes::new("layers of them, or weighted rows", more),
            // Weights and the vectors with which they are found.
            NamedBytes::new("weights", 4 * 8 * self.length()),
        ];
        list.extend(self.given());
        list
    }

    /// The rows with inflow, and what enters at each of so many `stages`.
    fn inflow(&self, stages: u64) -> NamedBytes {
        let each = size_of::<AuxiliaryRow>() as u64 + 8 * stages;
        NamedBytes::new("inflow", self.inflow_rows * each + self.sources)
    }

    /// Bytes of the rows of the matrix, before it is assembled: a bound for any weights. Equal rows
    /// are stored once: those of cells of one kind with neighbours of the same kinds. With weights
    /// all rows differ; with elements rows differ from node to node.
    fn stored_rows(&self) -> u64 {
        let (space, bounds, rows) = (&self.case.space, self.bounds, self.rows());
        let n = space.dimension() as u64;
        let nodes: u64 = space.x.iter().map(|a| a.nodes.count() as u64).product();
        let around = nodes * (bounds.kinds as u64 * (1 + 2 * n) + 3u64.pow(n as u32));
        let distinct = if bounds.weighted {
            rows
        } else {
            rows.min(space.velocity_cells() as u64 * around + 2 * self.auxiliary)
        };
        4 * rows + (20 * self.entries() + 8 * rows) / rows * distinct
    }

    /// Arrays that exist during the whole run: matrix, states, inflow.
    fn system(&self) -> Vec<NamedBytes> {
        let bounds = self.bounds;
        let stored = match &bounds.assembled {
            Some(found) => (found.bytes_per_row * self.rows() as f64) as u64,
            None => self.stored_rows(),
        };
        let matrix = stored + 16 * self.points;
        let mut list = vec![
            self.program(),
            NamedBytes::new("matrix (S, K)", matrix),
            NamedBytes::new("states, weights", 8 * (1 + self.fields()) * self.length()),
        ];
        list.extend(self.exact());
        list.extend(self.given());
        if self.inflow_rows > 0 {
            list.push(self.inflow(bounds.stages as u64));
        }
        if bounds.stages > 0 {
            list.push(NamedBytes::new("field of the time steps", 8 * self.cells));
        }
        list
    }

    /// What the case holds: its tables, and its regions of `V` if they are many.
    fn given(&self) -> Vec<NamedBytes> {
        const FEW: usize = 16;
        let table = |file: &TableFile, table: &Table| {
            NamedBytes::new(format!("table of {}", file.of.key()), 8 * table.values().len() as u64)
        };
        // Copies of a case share the table.
        let tables = self.case.table_values().map(|(file, values)| table(file, values));
        let mut list: Vec<NamedBytes> = tables.collect();
        let regions = self.case.potential.len();
        if regions > FEW {
            list.push(NamedBytes::new("regions of V", REGION_BYTES * regions as u64));
        }
        list
    }

    /// Arrays that exist in addition to the results while they are written, when the system is
    /// gone.
    fn writing(&self, warp: Option<&WarpPlan>) -> Vec<NamedBytes> {
        let copies = 1 + u64::from(self.mesh.ranks() > 1);
        let mut list = vec![
            self.program(),
            NamedBytes::new("values being written", 8 * copies * self.share()),
            NamedBytes::new("chunks being written", chunk_bytes(self.case, self.mesh)),
        ];
        if let Some(tables) = warp.and_then(tables_of_modes) {
            let modes = warp.map_or(0, |warp| warp.modes as u64);
            list.extend([
                tables,
                NamedBytes::new("plan as text", TEXT_OF_A_MODE * modes),
                NamedBytes::new("window of a measurement", window_bytes(modes)),
            ]);
        }
        list.extend(self.exact());
        list.extend(self.given());
        list
    }

    /// Arrays of a run by modes in addition to the system, with at most `most` modes on a rank.
    fn modes(&self, warp: &WarpPlan, most: usize) -> Vec<NamedBytes> {
        let case = self.case;
        let share = MatrixShare {
            case,
            bounds: self.bounds,
            mesh: self.mesh,
            rows: self.rows(),
            length: self.length(),
            entries: self.entries(),
        };
        let mut list = descriptor(case.propagator.method).arrays(&share);
        let mut buffers = 0;
        if let Some(points) = warp.points {
            let exchanged = ExchangedModes {
                modes: warp.modes as u64,
                most: most as u64,
                groups: self.mesh.groups as u64,
                points: points as u64,
                cells: self.cells,
            };
            buffers = exchanged.buffer_bytes();
            list.push(NamedBytes::new("kept modes", rank_modes_bytes(self.rows(), most as u64)));
            if warp.modes > MANY_MODES {
                let bytes = window_bytes(warp.modes as u64);
                list.push(NamedBytes::new("window of a measurement", bytes));
            }
            list.push(NamedBytes::new("buffers of the transpose", buffers));
            if case.warped_start.is_some() {
                list.push(NamedBytes::new("start between its points", line_bytes(points as u64)));
            }
        }
        // Sums of one field at a time on the block; recovered fields on a rank's share of it.
        let (readings, plateau) = (warp.readings.len() as u64, warp.plateau.len() as u64);
        let steps = u64::from(case.propagator.method.order() > 0);
        let sums = 16 * (readings + plateau + steps) * self.cells;
        // They are freed before kept modes are written, but the allocator keeps a part of them
        // beside the buffers for that: about half, as was measured.
        list.push(NamedBytes::new("recovery sums", sums - sums.min(buffers) / 2));
        list.extend(self.between_legs(warp, &share));
        list.extend(self.at_start(self.share()));
        // For each earlier field; the last field stores one number in place of the two integers of
        // a sum.
        let before = (readings + steps) * (self.fields() - 1);
        list.push(NamedBytes::new("recovered fields", 8 * (before + 1) * self.share()));
        list.push(NamedBytes::new("ghost exchange", 2 * 128 * self.ghosts));
        list
    }

    /// Arrays of a run by modes that takes its time in legs.
    fn between_legs(&self, warp: &WarpPlan, share: &MatrixShare<'_>) -> Vec<NamedBytes> {
        let mut list = Vec::new();
        // The state of a batch at its start or between two legs.
        let between = size_of::<Lanes>() as u64 * self.rows();
        if self.case.warped_start.is_some() && warp.legs.len() == 1 {
            list.push(NamedBytes::new("start of a batch", between));
        }
        if warp.legs.len() > 1 {
            list.push(NamedBytes::new("between legs", between));
        }
        let passed = warp.legs.iter().map(|leg| leg.passed.len()).max().unwrap_or(0);
        if passed > 0 {
            let largest = warp.largest_work() as u64;
            let bytes = IntermediateMoments::bytes(share, self.points, passed as u64, largest);
            list.push(NamedBytes::new("moments on the way", bytes));
        }
        if !self.case.output.times.is_empty() {
            let early = self.early_sums(warp.points.is_some())
                + self.early(self.fields() - 1)
                + TIME_BYTES * self.case.output.times.len() as u64;
            list.push(NamedBytes::new("output times", early));
        }
        list
    }

    /// The fields at time zero, of `cells` cells each, if they are kept to be written.
    fn at_start(&self, cells: u64) -> Option<NamedBytes> {
        self.case.output.at_start.filter(|start| start.fields)?;
        Some(NamedBytes::new("fields at time 0", 8 * self.fields() * cells))
    }

    /// Arrays of a classical run in addition to the system: initial values, results and the vectors
    /// of the integrator.
    fn classical(&self) -> Vec<NamedBytes> {
        let (case, cells, length) = (self.case, self.cells, self.length());
        // Only vectors whose memory is touched count.
        let vectors = match case.classical.integrator {
            Integrator::ForwardEuler => 1,
            Integrator::Exponential | Integrator::SspRk3 => 2,
        };
        let mut list = vec![
            // All fields, and the state of the current one.
            NamedBytes::new("fields", 8 * (self.fields() * cells + length)),
            NamedBytes::new("integrator", 8 * vectors * length),
        ];
        if !case.output.times.is_empty() {
            list.push(NamedBytes::new("output times", self.early(self.fields())));
        }
        list.extend(self.at_start(cells));
        if case.scheme.limiter != Limiter::None {
            list.push(NamedBytes::new("slopes", self.slopes()));
        }
        list
    }

    /// Bytes of limited slopes: one for each unknown, two neighbours for each space cell and axis,
    /// what is beyond faces at ends of the box and at jumps, and what enters along velocity axes.
    fn slopes(&self) -> u64 {
        const FACE: u64 = 40;
        const SOURCE: u64 = 16;
        let space = &self.case.space;
        let speeds = self.cells / self.points;
        // Two between which it is interpolated, transmitted and reflected.
        let sources = if self.case.reflects() { 4 } else { 2 };
        let layers = largest_part(&space.x[0], self.mesh.space[0]);
        let own_cells = |a: usize| largest_part(&space.x[a], self.mesh.space[a]) as u64;
        let across = |a: usize| {
            let jumps = self.points.min(self.bounds.most_jump_faces(a, layers) as u64) * speeds;
            let ends = u64::from(!space.periodic[a]) * self.cells / own_cells(a);
            let lines = self.cells / space.v[a].cells as u64;
            let entering = u64::from(self.bounds.has_forces() && self.bounds.inflow) * 16 * lines;
            // A block has both ends of an axis if it is not cut.
            let ends = ends * (3 - self.mesh.space[a].min(2) as u64);
            let faces = FACE * (ends + 2 * jumps) + 2 * SOURCE * sources * jumps;
            16 * self.points + faces + entering
        };
        8 * self.length() + (0..space.dimension()).map(across).sum::<u64>()
    }

    /// The results, which exist in addition to the system after the solve.
    fn results(&self, warp: Option<&WarpPlan>) -> Vec<NamedBytes> {
        let case = self.case;
        let (readings, plateau) =
            warp.map_or((1, 0), |w| (w.readings.len() as u64, w.plateau.len() as u64));
        let steps = u64::from(warp.is_some() && case.propagator.method.order() > 0);
        let numbers = (readings + steps) * self.fields() + plateau;
        let mut list = vec![NamedBytes::new("recovered fields", 8 * numbers * self.share())];
        if !case.output.times.is_empty() {
            let early = self.early(self.fields()) + self.early_moments();
            list.push(NamedBytes::new("output times", early));
        }
        list.extend(self.at_start(self.share()));
        list
    }

    /// Memory of the estimate of the grid's error: vectors for one axis after the other and `V`, or
    /// the coefficients of elements.
    fn estimate(&self) -> Option<NamedBytes> {
        let space = &self.case.space;
        let is_coarse = |axis: &Axis| axis.nodes.degree == 0 && axis.cells > 1;
        let bytes = match &self.case.data {
            Data::Measure { .. } => return None,
            // Four vectors, one more beside elements, and two bytes of flags.
            Data::Density if space.axes().any(is_coarse) => {
                let vectors = if space.whole_degree() > 0 { 5 } else { 4 };
                (vectors * 8 + 2) * self.cells + Potential::CELL_BYTES * self.points
            }
            Data::Density => 2 * 8 * self.cells,
        };
        Some(NamedBytes::new("estimate of the grid's error", bytes))
    }

    /// The results on the user's grid, if the computed one is another.
    fn expanded(&self) -> Option<NamedBytes> {
        let Self { case, mesh, .. } = self;
        let shown = grid(case);
        if shown == case.space {
            return None;
        }
        // A single layer of cells is not divided among the groups.
        let groups = mesh.groups.min(case.space.x[0].cells);
        let mesh = ProcessMesh { space: mesh.space.clone(), groups };
        let share = largest_share(self.cells_on(&shown), &shown.x[0], &mesh);
        let times = 1 + case.shown_times().filter(|t| t.fields).count() as u64;
        Some(NamedBytes::new("results as shown", 8 * self.fields() * times * share))
    }

    /// Cells of the block on the user's grid.
    fn cells_on(&self, shown: &PhaseSpace) -> u64 {
        let layers = (shown.x.iter().zip(&self.mesh.space)).map(|(a, p)| largest_part(a, *p));
        (layers.product::<usize>() * shown.velocity_cells()) as u64
    }

    /// The exact solution, which is stored once.
    fn exact(&self) -> Option<NamedBytes> {
        let case = self.case;
        case.exact.as_ref()?;
        let shown = grid(case);
        let cells = self.cells_on(&shown);
        let n = case.space.dimension() as u64;
        let points = case.space.space_cells() as u64;
        let space_cells = cells / shown.velocity_cells() as u64;
        let values = match case.data {
            Data::Density => 8 * cells,
            // Mass and momentum of the share and their results, the curve, whose arrays grow by
            // doubling, and the owners of all cells.
            Data::Measure { .. } => {
                32 * (1 + n) * space_cells + 64 * curve_points(case) as u64 + 4 * points
            }
        };
        // Its moments at every time, or at the end.
        let earlier = if case.has_exact_history() { case.shown_times().count() } else { 0 };
        let times = 1 + earlier as u64;
        let moments = 8 * self.moments_of_a_point() * times * space_cells;
        Some(NamedBytes::new("exact solution", values + moments))
    }

    /// What traces particles of the exact flow: the whole potential, on every rank.
    fn traced(&self) -> NamedBytes {
        NamedBytes::new("potential of the exact flow", self.bounds.traced_bytes(self.case))
    }

    /// What traces paths back from nodes of the result, and the squares of `f` by which these are
    /// drawn.
    fn traced_at_end(&self) -> NamedBytes {
        let squares = 2 * 8 * grid(self.case).space_cells() as u64;
        let bytes = match self.bounds.traced_at_end_bytes(self.case) {
            0 => 0,
            bytes => bytes + squares,
        };
        NamedBytes::new("potential of the exact flow", bytes)
    }

    /// Numbers that are stored for a field at a point of space, at each output time: its moments,
    /// or the values of all velocities.
    fn early_numbers(&self) -> impl Iterator<Item = u64> + '_ {
        let velocities = self.case.space.velocity_cells() as u64;
        self.case.output.times.iter().map(move |time| match (time.fields, &self.case.data) {
            (false, Data::Density) => MOMENTS as u64,
            _ => velocities,
        })
    }

    /// Sums of one field at the output times, on the block: for all times, or for one time after
    /// the other if the modes are kept.
    fn early_sums(&self, kept: bool) -> u64 {
        let numbers = self.early_numbers();
        16 * self.points * if kept { numbers.max().unwrap_or(0) } else { numbers.sum() }
    }

    /// Results of `fields` fields at the output times.
    fn early(&self, fields: u64) -> u64 {
        let points = self.share() / self.case.space.velocity_cells() as u64;
        self.early_numbers().map(|numbers| 8 * points * fields * numbers).sum()
    }

    /// Moments at the output times, and the exact ones, or a copy while they are written.
    fn early_moments(&self) -> u64 {
        let points = self.share() / self.case.space.velocity_cells() as u64;
        let numbers = 2 * 8 * self.moments_of_a_point() * points;
        (numbers + TIME_BYTES) * self.case.output.times.len() as u64
    }

    /// Number of values that the moments have at a point: density, momentum and mean velocity along
    /// each axis, kinetic energy.
    fn moments_of_a_point(&self) -> u64 {
        2 + 2 * self.case.space.dimension() as u64
    }
}

/// The tables of the modes that every rank has, if they are many.
fn tables_of_modes(warp: &WarpPlan) -> Option<NamedBytes> {
    let each = TABLES_OF_A_MODE + 8 * (warp.different_legs() as u64).saturating_sub(1);
    let bytes = each * warp.modes as u64;
    (warp.modes > MANY_MODES).then(|| NamedBytes::new("tables of the modes", bytes))
}

/// Bytes of the transforms by which the window of a measurement is found, which are kept: values,
/// scratch and factors, as measured.
fn window_bytes(modes: u64) -> u64 {
    const OF_TWO_SAMPLES: u64 = 46;
    let samples = (WINDOW_SAMPLES as u64 * modes).next_power_of_two();
    OF_TWO_SAMPLES * samples.min(MOST_WINDOW_SAMPLES as u64) / 2
}

/// Rows with inflow of a block of `cells` cells, at most.
fn inflow_rows(case: &Case, bounds: &Bounds, cells: u64) -> u64 {
    let space = &case.space;
    // Half of the velocities at each of the two ends of an x-axis that is not periodic.
    let ends: u64 = (space.x.iter().zip(space.periodic))
        .filter(|(_, periodic)| !periodic)
        .map(|(a, _)| cells / a.cells as u64)
        .sum();
    // With elements and a force, all nodes of the elements at one end of a velocity axis have
    // inflow.
    if bounds.has_forces() && case.is_galerkin() {
        ends + space.v.iter().map(|v| cells / v.elements() as u64).sum::<u64>()
    } else {
        ends
    }
}

/// Cells of the largest share that a rank has of its block of `cells` cells, which the mode groups
/// divide along `axis`, the first one of space.
fn largest_share(cells: u64, axis: &Axis, mesh: &ProcessMesh) -> u64 {
    let layers = largest_part(axis, mesh.space[0]) as u64;
    let elements = axis.elements().div_ceil(mesh.space[0]).div_ceil(mesh.groups);
    cells / layers * (elements * axis.nodes.count()) as u64
}

/// Entries of a row of `(S, K)` on average, without couplings to auxiliary unknowns: for degree 0
/// of a row away from jumps of `V`, for elements as if all of them were at jumps, if there are any.
fn entries_of_a_row(case: &Case, bounds: &Bounds) -> u64 {
    let space = &case.space;
    let along = |a: usize| {
        let (x, v) = (&space.x[a], &space.v[a]);
        // The element's other nodes, and the one across a face.
        let transport = match x.nodes.degree {
            0 => 2,
            k => k + 1,
        };
        // Also all nodes of both neighbours: traces depend on all Gauss nodes of an element.
        let force = match v.nodes.degree {
            0 => 2,
            k => 3 * (k + 1) - 1,
        };
        // The energies of an element overlap up to three elements across the jump, which couples
        // the first and the last node of an element of space.
        let jump = if !case.is_galerkin() {
            0
        } else {
            (2 * 3 * v.nodes.count()).div_ceil(x.nodes.count().max(2))
        };
        transport
            + usize::from(bounds.forces[a]) * force
            + usize::from(bounds.jumps_across[a]) * jump
    };
    1 + (0..space.dimension()).map(|a| along(a) as u64).sum::<u64>()
}

/// The modes and cells that the ranks of the mode groups of a block exchange.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExchangedModes {
    /// All modes.
    pub modes: u64,
    /// Most modes on a rank.
    pub most: u64,
    /// Ranks that share the block.
    pub groups: u64,
    /// Points in `p`.
    pub points: u64,
    /// Cells of the block.
    pub cells: u64,
}

impl ExchangedModes {
    /// Bytes of a rank's buffers for one cell: all its modes, its values, and messages in both
    /// directions.
    fn cell_bytes(&self) -> u64 {
        let messages = if self.groups > 1 { 2 * self.most } else { 0 };
        16 * (self.modes + messages) + 8 * self.points
    }

    /// Cells of a rank in a round: as many of the block as fit into `buffers` bytes.
    pub fn cells_at_once(&self, buffers: u64) -> u64 {
        (buffers / self.cell_bytes()).clamp(1, self.cells.div_ceil(self.groups))
    }

    /// Bytes of a rank's buffers.
    fn buffer_bytes(&self) -> u64 {
        self.cell_bytes() * self.cells_at_once(BUFFERS) + line_bytes(self.points)
    }
}

/// Bytes of a line in `p` and of the scratch of its transform.
fn line_bytes(points: u64) -> u64 {
    4 * 16 * points
}
