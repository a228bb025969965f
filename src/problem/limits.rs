//! Limits of the settings of a case. The reader checks them, and other rooms rely on them.

/// Least number of values in a planned chunk: 256 KiB, of which HDF5's default cache holds four.
pub const CHUNK: usize = 1 << 15;

/// Largest number of chunks of a dataset. HDF5 takes up to 17 kB for each while they are written.
pub const MOST_CHUNKS: usize = 1 << 14;

/// Largest number of modes `l ≥ 0` of a run.
pub const MOST_MODES: usize = 1 << 22;

/// Largest number `N_p` of points in `p`.
pub const MOST_POINTS: usize = 2 * MOST_MODES - 2;

/// Samples of a series by modes in its shortest wave, about, by which the window of a measurement
/// is found.
pub const WINDOW_SAMPLES: usize = 8;

/// Largest number of these samples that are transformed together: 8 MiB.
pub const MOST_WINDOW_SAMPLES: usize = 1 << 20;

/// Number of coordinates `[x, y, z, vx, vy, vz, t]` that a formula may use.
pub const COORDINATES: usize = 7;

/// Largest `r` of the smooth profile: `solver.warp.order`.
pub const MOST_ORDER: usize = 16;

/// The least and the largest `β` of the profile of An, Childs and Lin.
pub const BETAS: [f64; 2] = [0.3, 0.95];

/// The least and the largest `α` of the exponential profile. Beyond these it practically jumps.
pub const ALPHAS: [f64; 2] = [0.01, 100.0];

/// The point below which the left part of that profile is negligible, for any `α(p)`.
pub const EXTENSION_END: f64 = -4000.0;

/// Largest value of the left part of that profile.
pub const LARGEST_EXTENSION: f64 = 1e6;

/// The least and the largest `c` of the profile of Low and Somma. For a larger one, the profile is
/// below round-off where it is read.
pub const LOW_SOMMA_POINTS: [f64; 2] = [0.05, 16.0];

/// The least and the largest `σ` of the Gaussian profile.
pub const SIGMAS: [f64; 2] = [0.05, 20.0];

/// Largest number of emulated shots. Beyond it, rounding errors of probabilities show in the
/// counts.
pub const MOST_SHOTS: f64 = 1e15;

/// Largest number of evaluations of a run of amplitude estimation, with a register of 40 qubits.
pub const MOST_EVALUATIONS: f64 = (1u64 << 40) as f64;

/// Lengths, velocities and times lie between the inverse of this and this, so that their products
/// stay finite.
pub const LARGEST_NUMBER: f64 = 1e100;

/// Largest `solver.tolerance`.
pub const LARGEST_TOLERANCE: f64 = 0.1;

/// Largest `|p|` at which a field is read, for `solver.warp.recovery` and `output.plateau`. Beyond
/// it `e^p` overflows or vanishes.
pub const LARGEST_RECOVERY: f64 = 300.0;

/// Largest `|p|` of an end of `solver.warp.interval`.
pub const LARGEST_INTERVAL_END: f64 = 1e9;

/// Largest `|σT|` of a spectral shift.
pub const LARGEST_SHIFT: f64 = 25.0;

/// Largest number of phase-space cells of a case. The plan compares memory with the machine.
pub const MOST_CELLS: f64 = 1e12;

/// Largest number of space cells. `V` is evaluated on all of them before anything else.
pub const MOST_SPACE_CELLS: f64 = 1e8;

/// Largest number of time steps of a propagator.
pub const MOST_STEPS: f64 = 1e7;

/// Longest case file, in bytes.
pub const LONGEST_FILE: u64 = 1 << 20;
