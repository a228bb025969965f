//! Limits of the settings of a case. The reader checks them and upper rooms rely on them.

/// Elements of a planned chunk at least: 256 KiB, of which HDF5's default cache holds four.
pub const CHUNK: usize = 1 << 15;

/// Most chunks of a dataset: HDF5 takes up to 17 kB for each while they are written.
pub const MOST_CHUNKS: usize = 1 << 14;

/// Most modes `l ≥ 0` of a run.
pub const MOST_MODES: usize = 1 << 22;

/// Largest `r`.
pub const MOST_ORDER: usize = 16;

/// The least and the largest `β` for which tails and values are computed.
pub const BETAS: [f64; 2] = [0.3, 0.95];

/// The least and the largest `α` of the exponential profile: beyond, it is practically a jump.
pub const ALPHAS: [f64; 2] = [0.01, 100.0];

/// The point below which the left part of that profile is negligible, for any `α(p)`.
pub const EXTENSION_END: f64 = -4000.0;

/// Largest value of the left part of that profile.
pub const LARGEST_EXTENSION: f64 = 1e6;

/// The least and the largest `c` of the profile of Low and Somma: beyond, it is read where it is
/// round-off.
pub const CS: [f64; 2] = [0.05, 16.0];

/// The least and the largest `σ` of the Gaussian profile.
pub const SIGMAS: [f64; 2] = [0.05, 20.0];

/// Largest number of emulated shots. Beyond it, rounding errors of probabilities show in the
/// counts.
pub const MOST_SHOTS: f64 = 1e15;

/// Most evaluations of a run of amplitude estimation: the register has 40 qubits then.
pub const MOST_EVALUATIONS: f64 = (1u64 << 40) as f64;

/// Lengths, velocities and times lie between the inverse of this and this: their products stay
/// finite.
pub const MOST: f64 = 1e100;

/// Largest `solver.tolerance`.
pub const LARGEST_TOLERANCE: f64 = 0.1;

/// Largest `|σT|` of a spectral shift.
pub const LARGEST_SHIFT: f64 = 25.0;

/// Most phase-space cells of a case; the plan checks memory against the machine.
pub const MOST_CELLS: f64 = 1e12;

/// Most space cells: `V` is evaluated on all of them before anything else.
pub const MOST_SPACE_CELLS: f64 = 1e8;

/// Most time steps of a propagator.
pub const MOST_STEPS: f64 = 1e7;

/// Longest case file, in bytes.
pub const LONGEST_FILE: u64 = 1 << 20;
