//! Dense matrices and Taylor series: slow and simple references for the fast code of the crate. The
//! cases and the pseudo-random numbers of the tests.
#![allow(dead_code)] // each test program uses a part of it

use faer::{Mat, Side};
use num_complex::Complex64;
use phasewarp::problem::case::Case;
use phasewarp::scheme::rows::{Row, Scheme};
use std::path::{Path, PathBuf};

/// The path of the file `name` in `cases/`.
pub fn case_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("cases").join(name)
}

/// The case of the file `name` in `cases/`, with overrides as in `--set`, or why it is refused.
pub fn parsed(name: &str, overrides: &[&str]) -> Result<Case, String> {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    Case::load(&case_path(name), &overrides).map_err(|e| e.to_string())
}

/// The case of the file `name` in `cases/`, with overrides as in `--set`.
pub fn case(name: &str, overrides: &[&str]) -> Case {
    parsed(name, overrides).unwrap_or_else(|e| panic!("{e}"))
}

/// The step of the counter of SplitMix64 (Steele, Lea, Flood 2014).
pub const INCREMENT: u64 = 0x9e37_79b9_7f4a_7c15;

/// The number that SplitMix64 gives at a value of its counter.
pub fn mixed(mut h: u64) -> u64 {
    for (shift, factor) in [(30, 0xbf58_476d_1ce4_e5b9_u64), (27, 0x94d0_49bb_1331_11eb), (31, 1)] {
        h = (h ^ (h >> shift)).wrapping_mul(factor);
    }
    h
}

/// [`mixed`] as a number in [0, 1).
fn mixed_in_unit(h: u64) -> f64 {
    (mixed(h) >> 11) as f64 / (1u64 << 53) as f64
}

/// A pseudo-random number in [0, 1) that depends on `seed` only.
pub fn random(seed: u64) -> f64 {
    mixed_in_unit((seed + 1).wrapping_mul(INCREMENT))
}

/// A pseudo-random number in [-1, 1) that depends on `index` and `seed` only, so that data are the
/// same on any number of ranks.
pub fn noise(index: usize, seed: u64) -> f64 {
    2.0 * mixed_in_unit((index as u64).wrapping_add(seed.wrapping_mul(INCREMENT))) - 1.0
}

/// `√Σ|x_i|²`.
pub fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The relative l2 distance `‖x − y‖/‖y‖`.
pub fn distance(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len(), "fields of different sizes");
    let difference: Vec<f64> = x.iter().zip(y).map(|(x, y)| x - y).collect();
    norm(&difference) / norm(y)
}

/// The order of convergence of two errors, the second of steps or cells so many times shorter.
pub fn order_of([coarse, fine]: [f64; 2], shorter: f64) -> f64 {
    (coarse / fine).ln() / shorter.ln()
}

/// A square matrix.
#[derive(Clone, Debug)]
pub struct Dense {
    /// Number of rows and columns.
    pub size: usize,
    /// The entries, row by row.
    values: Vec<f64>,
}

impl Dense {
    pub fn from_fn(size: usize, mut value: impl FnMut(usize, usize) -> f64) -> Self {
        let values = (0..size * size).map(|e| value(e / size, e % size)).collect();
        Self { size, values }
    }

    pub fn zero(size: usize) -> Self {
        Self::from_fn(size, |_, _| 0.0)
    }

    pub fn diagonal(values: &[f64]) -> Self {
        Self::from_fn(values.len(), |i, j| if i == j { values[i] } else { 0.0 })
    }

    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.values[i * self.size + j]
    }

    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        self.values[i * self.size + j] += value;
    }

    pub fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.size..(i + 1) * self.size]
    }

    pub fn row_sum(&self, i: usize) -> f64 {
        self.row(i).iter().sum()
    }

    pub fn column_sum(&self, j: usize) -> f64 {
        (0..self.size).map(|i| self.at(i, j)).sum()
    }

    /// The matrix with `more` rows and columns of zeros after its own.
    pub fn enlarged(&self, more: usize) -> Self {
        let inside = |i: usize| i < self.size;
        Self::from_fn(
            self.size + more,
            |i, j| if inside(i) && inside(j) { self.at(i, j) } else { 0.0 },
        )
    }

    /// The largest magnitude of an entry.
    pub fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |m, v| m.max(v.abs()))
    }

    pub fn transposed(&self) -> Self {
        Self::from_fn(self.size, |i, j| self.at(j, i))
    }

    /// `S = (A + Aᵀ)/2`.
    pub fn symmetric(&self) -> Self {
        Self::from_fn(self.size, |i, j| 0.5 * (self.at(i, j) + self.at(j, i)))
    }

    /// `K = (A − Aᵀ)/2`.
    pub fn skew(&self) -> Self {
        Self::from_fn(self.size, |i, j| 0.5 * (self.at(i, j) - self.at(j, i)))
    }

    /// `D A D⁻¹`, `D = diag(√π)`.
    pub fn weighted(&self, pi: &[f64]) -> Self {
        Self::from_fn(self.size, |i, j| self.at(i, j) * (pi[i] / pi[j]).sqrt())
    }

    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        (0..self.size).map(|i| self.row(i).iter().zip(x).map(|(a, x)| a * x).sum()).collect()
    }

    /// The least and the largest eigenvalue of a symmetric matrix.
    pub fn ends_of_spectrum(&self) -> [f64; 2] {
        let matrix = Mat::from_fn(self.size, self.size, |i, j| self.at(i, j));
        let values = matrix.self_adjoint_eigenvalues(Side::Lower).expect("finite entries");
        [values[0], values[values.len() - 1]]
    }
}

/// The least and the largest eigenvalue of `μS + iK`.
pub fn ends_of_spectrum(s: &Dense, k: &Dense, mu: f64) -> [f64; 2] {
    let h = Mat::from_fn(s.size, s.size, |i, j| Complex64::new(mu * s.at(i, j), k.at(i, j)));
    let values = h.self_adjoint_eigenvalues(Side::Lower).expect("finite entries");
    [values[0], values[values.len() - 1]]
}

/// Fails unless all entries of the matrices agree to `tolerance`, and names the entry that differs
/// most.
pub fn assert_same(what: &str, found: &Dense, expected: &Dense, tolerance: f64) {
    assert_eq!(found.size, expected.size, "{what}: sizes");
    let (mut worst, mut place) = (0.0, (0, 0));
    for i in 0..found.size {
        for j in 0..found.size {
            let difference = (found.at(i, j) - expected.at(i, j)).abs();
            assert!(!difference.is_nan(), "{what}: entry ({i}, {j}) is NaN");
            if difference > worst {
                (worst, place) = (difference, (i, j));
            }
        }
    }
    let (i, j) = place;
    assert!(
        worst <= tolerance,
        "{what}: entry ({i}, {j}) is {}, {} expected; differs by {worst:e}, {tolerance:e} allowed",
        found.at(i, j),
        expected.at(i, j)
    );
}

/// The same as [`assert_same`] for vectors.
pub fn assert_close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}: lengths");
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!(
            (a - b).abs() <= tolerance,
            "{what}: entry {i} is {a}, {b} expected; {tolerance:e} allowed"
        );
    }
}

/// The semi-discrete system `f' = A f + b` as a dense matrix and vectors.
#[derive(Clone, Debug)]
pub struct System {
    /// `A`.
    pub generator: Dense,
    /// `b`.
    pub inflow: Vec<f64>,
    /// For each row, the rate at which the value of the inflow enters.
    pub inflow_rate: Vec<f64>,
    /// `g_i`: the inflow of the row adds `−½ g_i x_i²` to `xᵀSx`; for degree 0 equal to
    /// `inflow_rate`.
    pub damping: Vec<f64>,
    /// `Σ rate b²` over all that enters a row; `b²/g` for degree 0.
    pub strength: Vec<f64>,
}

impl System {
    pub fn zero(size: usize) -> Self {
        let zeros = || vec![0.0; size];
        Self {
            generator: Dense::zero(size),
            inflow: zeros(),
            inflow_rate: zeros(),
            damping: zeros(),
            strength: zeros(),
        }
    }

    /// The system of the rows that the crate computes.
    pub fn of_rows(case: &Case) -> Self {
        let scheme = Scheme::whole(case).unwrap_or_else(|e| panic!("{e}"));
        let mut system = Self::zero(case.space.cells());
        let mut row = Row::default();
        for i in 0..case.space.cells() {
            scheme.row(&mut row, i);
            for &(j, value) in &row.entries {
                system.generator.add(i, j, value);
            }
            system.inflow[i] = row.inflow[0];
            system.inflow_rate[i] = row.inflow_rate;
            system.damping[i] = row.damping;
            let entering = case.fields[0].entering();
            let square = |point: &[f64; 6]| entering.at_point(point, 0.0).powi(2);
            system.strength[i] = match case.space.degree() {
                0 if row.inflow_rate == 0.0 => 0.0,
                0 => row.inflow[0].powi(2) / row.inflow_rate,
                _ => row.sources.iter().map(|source| source.rate * square(&source.point)).sum(),
            };
        }
        system
    }
}

/// `exp(L t) x` by Taylor series over short steps; `bound ≥ ‖L‖` in some norm.
fn taylor(
    apply: impl Fn(&[Complex64]) -> Vec<Complex64>,
    bound: f64,
    x: &[Complex64],
    time: f64,
) -> Vec<Complex64> {
    // Steps of ‖L‖ dt ≤ 1/2: the 18th term is below 1e-21.
    let steps = (2.0 * bound * time).ceil().max(1.0);
    let dt = time / steps;
    let mut state = x.to_vec();
    for _ in 0..steps as usize {
        let mut term = state.clone();
        for k in 1..=18 {
            term = apply(&term);
            for (state, term) in state.iter_mut().zip(&mut term) {
                *term *= dt / f64::from(k);
                *state += *term;
            }
        }
    }
    state
}

/// Row by row, the entries `(column, a, b)` of which `a` or `b` is not zero.
fn pairs(a: &Dense, b: &Dense) -> Vec<Vec<(usize, f64, f64)>> {
    let row = |i: usize| {
        (0..a.size)
            .map(|j| (j, a.at(i, j), b.at(i, j)))
            .filter(|&(_, a, b)| a != 0.0 || b != 0.0)
            .collect()
    };
    (0..a.size).map(row).collect()
}

/// `exp(−i(μS + iK) t) x = exp((−iμS + K) t) x` for a real `x`.
pub fn evolve(s: &Dense, k: &Dense, mu: f64, x: &[f64], time: f64) -> Vec<Complex64> {
    let rows: Vec<Vec<(usize, Complex64)>> = pairs(s, k)
        .into_iter()
        .map(|row| row.into_iter().map(|(j, s, k)| (j, Complex64::new(k, -mu * s))).collect())
        .collect();
    let bound = rows.iter().map(|row| row.iter().map(|(_, h)| h.norm()).sum()).fold(0.0, f64::max);
    let apply =
        |x: &[Complex64]| rows.iter().map(|row| row.iter().map(|&(j, h)| h * x[j]).sum()).collect();
    let x: Vec<Complex64> = x.iter().map(|&x| x.into()).collect();
    taylor(apply, bound, &x, time)
}

/// `exp(A t) x`.
pub fn exponential(a: &Dense, x: &[f64], time: f64) -> Vec<f64> {
    let zero = Dense::zero(a.size);
    evolve(&zero, a, 0.0, x, time).into_iter().map(|z| z.re).collect()
}
