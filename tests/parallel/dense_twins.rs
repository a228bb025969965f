//! What the checks compare with: cases as dense matrices (twins), and a rank's piece of each.

use crate::*;

/// A case and its dense system with auxiliary unknowns: cells in their order, then those of rows, or the common one.
pub struct Twin {
    pub name: &'static str,
    pub case: Case,
    /// Cells, without the auxiliary unknowns.
    pub cells: usize,
    /// `A`, homogeneous.
    pub generator: Dense,
    /// Rows with an auxiliary unknown of their own, ascending.
    pub inflow: Vec<usize>,
    /// `(row, auxiliary unknown, g_i)` where `κ_i ≠ 0`.
    pub coupled: Vec<(usize, usize, f64)>,
    /// `u(0)`.
    pub state: Vec<f64>,
}

impl Twin {
    pub fn new(name: &'static str, file: &str, overrides: &[&str]) -> Self {
        let case = case(file, overrides);
        let System {
            generator: a,
            inflow: b,
            draw,
        } = System::of_rows(&case);
        let cells = a.size;
        let enters: Vec<usize> = (0..cells).filter(|&i| b[i] != 0.0).collect();
        let embedding = case.warp.inflow;
        let inflow: Vec<usize> = match embedding {
            Embedding::Boundary => enters.clone(),
            Embedding::Full if !enters.is_empty() => (0..cells).collect(),
            _ => Vec::new(),
        };
        let shared = embedding == Embedding::Scalar && !enters.is_empty();
        let mut state: Vec<f64> = (0..cells)
            .map(|i| {
                case.fields[0]
                    .initial
                    .eval(&case.space.point(&case.space.cell(i)))
            })
            .collect();
        let size = cells + inflow.len() + usize::from(shared);
        let mut generator = Dense::from_fn(size, |i, j| {
            if i < cells && j < cells {
                a.at(i, j)
            } else {
                0.0
            }
        });
        // r' = 0. A given δ: κ_i = |b_i|/δ, r_i(0) = ±δ. Planned: κ_i² = 2 g_i θ, and δ² = Σ b_i²/(2 g_i θ) for the scalar.
        let growth = INFLOW_GROWTH / case.end;
        let largest = b.iter().fold(0.0f64, |m, b| m.max(b.abs()));
        let given = match case.warp.delta {
            Delta::Planned => None,
            Delta::Largest => Some(largest),
            Delta::Given(delta) => Some(delta),
        };
        let mut coupled = Vec::new();
        if shared {
            let sum: f64 = enters.iter().map(|&i| b[i] * b[i] / (2.0 * draw[i])).sum();
            let delta = given.unwrap_or((sum / growth).sqrt());
            for &i in &enters {
                generator.add(i, cells, b[i] / delta);
                coupled.push((i, cells, draw[i]));
            }
            state.push(delta);
        }
        for (m, &i) in inflow.iter().enumerate() {
            let coupling = given.map_or((2.0 * draw[i] * growth).sqrt(), |d| b[i].abs() / d);
            if b[i] == 0.0 {
                state.push(given.unwrap_or(0.0));
                continue;
            }
            generator.add(i, cells + m, coupling);
            coupled.push((i, cells + m, draw[i]));
            state.push(b[i] / coupling);
        }
        Self {
            name,
            case,
            cells,
            generator,
            inflow,
            coupled,
            state,
        }
    }

    /// `θ`: the largest `κ²/(2g)` of the auxiliary unknowns, summed over the rows that share one.
    pub fn theta(&self) -> f64 {
        let mut added = vec![0.0; self.size()];
        for &(i, m, draw) in &self.coupled {
            added[m] += self.generator.at(i, m).powi(2) / (2.0 * draw);
        }
        added.into_iter().fold(0.0, f64::max)
    }

    /// Those whose matrix couples every unknown to neighbours only.
    pub fn unshared() -> Vec<Self> {
        let neighbours = |twin: &Self| twin.case.warp.inflow != Embedding::Scalar;
        Self::all().into_iter().filter(neighbours).collect()
    }

    /// One, two and three dimensions, both interfaces, with and without inflow; no length is divisible by 2, 3 and 4.
    pub fn all() -> Vec<Self> {
        vec![
            Self::new(
                "example 1",
                "example1.toml",
                &["axis.0.x.cells=10", "axis.0.v.cells=8"],
            ),
            Self::new(
                "slopes, inflow",
                "slope_jump.toml",
                &[
                    "axis.0.x.cells=7",
                    "axis.0.v={lower=-1.0,upper=1.3,cells=9}",
                    "inflow.value='1 + x + 2*v'",
                ],
            ),
            Self::new(
                "well",
                "well.toml",
                &["axis.0.x.cells=11", "axis.0.v.cells=10"],
            ),
            Self::new(
                "conservative barrier, inflow",
                "inflow_barrier.toml",
                &[
                    "axis.0.x.cells=9",
                    "axis.0.v.cells=14",
                    "scheme.interface='conservative'",
                ],
            ),
            Self::new(
                "two dimensions, inflow",
                "barrier2d.toml",
                &[
                    "axis.0.x.cells=5",
                    "axis.0.v.cells=3",
                    "axis.1.x.cells=4",
                    "axis.1.v.cells=4",
                    "potential.0.value='0.2 + 0.1*x - 0.1*y'",
                    "inflow.value='1 if x < -1.2 else 0'",
                ],
            ),
            Self::new(
                "three dimensions",
                "step3d.toml",
                &[
                    "axis.0.x.cells=4",
                    "axis.0.v.cells=4",
                    "axis.1.x.cells=3",
                    "axis.1.v.cells=2",
                    "axis.2.x.cells=2",
                    "axis.2.v.cells=2",
                    "potential.1.value='0.1 + 0.05*y'",
                ],
            ),
            // Axes that close on themselves: the first, where layers are assembled and blocks are opened one after the other, and another.
            Self::new(
                "periodic, a jump at the end, inflow of velocities",
                "slope_jump.toml",
                &[
                    "axis.0.x={lower=-1.5,upper=1.5,cells=9,boundary='periodic'}",
                    "axis.0.v.cells=7",
                    "inflow.value='1 + x + 2*v'",
                ],
            ),
            Self::new(
                "periodic along the step",
                "periodic2d.toml",
                &[
                    "axis.0.x.cells=6",
                    "axis.0.v.cells=4",
                    "axis.1.x.cells=5",
                    "axis.1.v.cells=3",
                    "potential.0.value='0.1*y'",
                    "inflow.value='1 if x < -1.2 else 0'",
                ],
            ),
            Self::new(
                "periodic across the step, two cells along it",
                "periodic2d.toml",
                &[
                    "axis.0.x.boundary=periodic",
                    "axis.0.x.cells=4",
                    "axis.0.v.cells=6",
                    "axis.1.x={lower=-0.5,upper=0.5,cells=3}",
                    "axis.1.v.cells=3",
                    "scheme.interface='conservative'",
                ],
            ),
            // The other embeddings of the inflow, δ planned and given.
            Self::slopes(
                "full",
                &[
                    "axis.0.v={lower=-1.0,upper=1.31,cells=9}",
                    "solver.warp.inflow='full'",
                ],
            ),
            Self::slopes(
                "full, largest",
                &[
                    "axis.0.v={lower=-1.0,upper=1.32,cells=9}",
                    "solver.warp.inflow='full'",
                    "solver.warp.delta='max'",
                ],
            ),
            Self::slopes(
                "boundary, given",
                &[
                    "axis.0.v={lower=-1.0,upper=1.33,cells=9}",
                    "solver.warp.delta=4.5",
                ],
            ),
            Self::slopes(
                "scalar",
                &[
                    "axis.0.v={lower=-1.0,upper=1.34,cells=9}",
                    "solver.warp.inflow='scalar'",
                ],
            ),
            Self::slopes(
                "scalar, given",
                &[
                    "axis.0.v={lower=-1.0,upper=1.35,cells=9}",
                    "solver.warp.inflow='scalar'",
                    "solver.warp.delta=14",
                ],
            ),
            Self::new(
                "conservative barrier, scalar, largest",
                "inflow_barrier.toml",
                &[
                    "axis.0.x.cells=9",
                    "axis.0.v.cells=14",
                    "scheme.interface='conservative'",
                    "solver.warp.inflow='scalar'",
                    "solver.warp.delta='max'",
                ],
            ),
            Self::new(
                "two dimensions, scalar",
                "barrier2d.toml",
                &[
                    "axis.0.x.cells=5",
                    "axis.0.v.cells=3",
                    "axis.1.x.cells=4",
                    "axis.1.v.cells=4",
                    "inflow.value='1 if x < -1.2 else 0'",
                    "solver.warp.inflow='scalar'",
                ],
            ),
        ]
    }

    /// Each on a grid of its own, or their bits would be the same.
    pub fn slopes(name: &'static str, overrides: &[&str]) -> Self {
        let mut all = vec!["axis.0.x.cells=7", "inflow.value='1 + x + 2*v'"];
        all.extend(overrides);
        Self::new(name, "slope_jump.toml", &all)
    }

    pub fn size(&self) -> usize {
        self.generator.size
    }

    /// `f` of a state: cells only.
    pub fn field<'a>(&self, state: &'a [f64]) -> &'a [f64] {
        &state[..self.cells]
    }
}

/// Every mesh of the ranks of `world` that the grid of `case` admits.
pub fn meshes(world: &World, case: &Case) -> Vec<Mesh> {
    fn visit(case: &Case, ranks: usize, parts: &mut Vec<usize>, list: &mut Vec<Mesh>) {
        let Some(axis) = case.space.x.get(parts.len()) else {
            list.push(Mesh {
                space: parts.clone(),
                groups: ranks,
            });
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
    list
}

/// This rank's part of a twin.
pub struct Piece {
    pub communicator: Communicator,
    pub matrix: BlockMatrix,
    pub exchange: GhostExchange,
    /// Number in the twin of each local row, then of each ghost.
    pub number: Vec<usize>,
}

impl Piece {
    pub fn new(twin: &Twin, communicator: Communicator, matrix: BlockMatrix) -> Self {
        let exchange = GhostExchange::new(&communicator.space, &matrix.block, 2 * LANES);
        let number = numbers(twin, &matrix);
        Self {
            communicator,
            matrix,
            exchange,
            number,
        }
    }

    pub fn assemble(world: &World, twin: &Twin, mesh: &Mesh) -> Self {
        let communicator = Communicator::new(world, mesh);
        assert_eq!(communicator.space.size(), mesh.blocks());
        assert_eq!(communicator.modes.size(), mesh.groups);
        let block = Block::new(&twin.case.space, mesh, communicator.space.rank());
        let mut matrix = BlockMatrix::assemble(&twin.case, block).expect("formulas are finite");
        let mut pi = vec![1.0; matrix.length()];
        matrix.couple(&communicator.space, &twin.case, &mut pi);
        assert!(pi.iter().all(|&pi| pi == 1.0), "{}", twin.name);
        Self::new(twin, communicator, matrix)
    }

    /// The local part of a vector of the twin; ghosts hold NaN until they are exchanged.
    pub fn scatter(&self, vector: &[f64]) -> Vec<f64> {
        let mut local = vec![f64::NAN; self.matrix.length()];
        for (local, &i) in local[..self.matrix.rows()].iter_mut().zip(&self.number) {
            *local = vector[i];
        }
        local
    }

    /// The whole vector, on every rank, from the rows of all; each has one owner in the space group.
    pub fn gather(&self, twin: &Twin, local: &[f64]) -> Vec<f64> {
        let rows = self.matrix.counted_rows();
        let space = &self.communicator.space;
        gather(
            space,
            twin.size(),
            (0..rows).map(|i| (self.number[i], local[i])),
        )
    }

    /// The whole `(S, K)`, dense.
    pub fn gather_matrix(&self, world: &World, twin: &Twin) -> (Dense, Dense) {
        let size = twin.size();
        let space = &self.communicator.space;
        assert_eq!(space.sum_count(self.matrix.counted_rows()), size);
        let (mut s, mut k) = (vec![f64::NEG_INFINITY; size * size], vec![0.0; 0]);
        k.clone_from(&s);
        for i in 0..self.matrix.rows() {
            let mut last = None;
            for (column, es, ek) in self.matrix.row(i) {
                let j = self.number[column];
                assert!(last < Some(j), "{}: row {i} is not in order", twin.name);
                last = Some(j);
                let place = self.number[i] * size + j;
                (s[place], k[place]) = (es, ek);
            }
        }
        // Over the world: all mode groups hold the same.
        world.group().max_into(&mut s);
        world.group().max_into(&mut k);
        let entry = |values: &[f64], i: usize, j: usize| match values[i * size + j] {
            f64::NEG_INFINITY => 0.0,
            value => value,
        };
        (
            Dense::from_fn(size, |i, j| entry(&s, i, j)),
            Dense::from_fn(size, |i, j| entry(&k, i, j)),
        )
    }
}

/// Number in the twin of each local row of `matrix`, then of each ghost.
pub fn numbers(twin: &Twin, matrix: &BlockMatrix) -> Vec<usize> {
    let mut number = vec![usize::MAX; matrix.length()];
    let velocities = matrix.block.velocity_cells;
    let (cells, rows) = (matrix.block.cells(), matrix.rows());
    matrix.block.for_each_own(|first, local| {
        (0..velocities).for_each(|v| number[local + v] = first + v);
    });
    matrix.block.for_each_ghost(|first, ghost| {
        (0..velocities).for_each(|v| number[rows + ghost + v] = first + v);
    });
    if twin.case.warp.inflow == Embedding::Scalar {
        number[cells..rows].fill(twin.cells);
        return number;
    }
    for (m, aux) in matrix.inflow.iter().enumerate() {
        let place = twin.inflow.binary_search(&number[aux.row as usize]);
        number[cells + m] = twin.cells + place.expect("a row with inflow");
    }
    number
}

/// Entries of a vector of length `size`, from all ranks of `group`, on every rank. Every entry has one owner.
pub fn gather(group: &Group, size: usize, entries: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
    let mut values = vec![f64::NEG_INFINITY; size];
    let mut owned = 0;
    for (i, value) in entries {
        values[i] = value;
        owned += 1;
    }
    assert_eq!(group.sum_count(owned), size, "every entry has one owner");
    group.max_into(&mut values);
    assert!(
        !values.contains(&f64::NEG_INFINITY),
        "every entry has an owner"
    );
    values
}

/// Calls `check` with every twin, mesh and piece.
pub fn for_every_piece(world: &World, mut check: impl FnMut(&Twin, &Mesh, &mut Piece)) {
    for twin in Twin::all() {
        for mesh in meshes(world, &twin.case) {
            check(&twin, &mesh, &mut Piece::assemble(world, &twin, &mesh));
        }
    }
}

/// A vector of the twin that is the same on any ranks.
pub fn random(twin: &Twin, seed: u64) -> Vec<f64> {
    (0..twin.size()).map(|i| noise(i, seed)).collect()
}

/// The problem as a run sets it up, with weights where it takes them; and what the twin becomes by them.
pub struct Weighted {
    pub communicator: Communicator,
    pub problem: Problem,
    pub bounds: Bounds,
    pub number: Vec<usize>,
    /// `π`, by the numbers of the twin.
    pub pi: Vec<f64>,
    /// `D A D⁻¹`.
    pub generator: Dense,
    /// `D u(0)`.
    pub state: Vec<f64>,
}

impl Weighted {
    pub fn new(world: &World, twin: &Twin, mesh: &Mesh) -> Self {
        let communicator = Communicator::new(world, mesh);
        let block = Block::new(&twin.case.space, mesh, communicator.space.rank());
        let allowed = Bounds::new(&twin.case).expect("V is finite");
        let problem = Problem::new(&twin.case, &allowed, &communicator, block, (2 * LANES, 100))
            .expect("weights are found");
        let bounds = problem.bounds(&twin.case, &allowed);
        // Left alone, the hat interface grows as it likes.
        let round_off = 1e-14 * bounds.rate;
        assert!(bounds.growth <= allowed.growth + round_off || !twin.case.warp.weights);
        let number = numbers(twin, &problem.matrix);
        let rows = problem.matrix.counted_rows();
        let entries = (0..rows).map(|i| (number[i], problem.weights.pi[i]));
        let pi = gather(&communicator.space, twin.size(), entries);
        Self {
            generator: twin.generator.weighted(&pi),
            state: twin
                .state
                .iter()
                .zip(&pi)
                .map(|(u, pi)| u * pi.sqrt())
                .collect(),
            communicator,
            problem,
            bounds,
            number,
            pi,
        }
    }
}

/// Eigenvalues of `μS + iK`, ascending.
pub fn eigenvalues(s: &Dense, k: &Dense, mu: f64) -> Vec<f64> {
    let h = Mat::from_fn(s.size, s.size, |i, j| {
        Complex64::new(mu * s.at(i, j), k.at(i, j))
    });
    h.self_adjoint_eigenvalues(Side::Lower)
        .expect("the eigenvalues of a Hermitian matrix")
}

/// One block, all ranks in its mode groups.
pub fn one_block(world: &World, case: &Case) -> Mesh {
    Mesh {
        space: vec![1; case.space.dimension()],
        groups: world.group().size(),
    }
}
