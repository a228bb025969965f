//! Tests the input of a quantum computer against dense matrices: oracles, sparsity, and the norm of
//! its state.

use crate::bits::report_bits;
use crate::dense_twins::Twin;
use crate::pieces::{Weighted, meshes, one_block};
use crate::support::dense::Dense;
use num_complex::Complex64;
use phasewarp::parallel::communicator::World;
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use phasewarp::problem::case::{Alpha, ProfileChoice};
use phasewarp::quantum::access::{LargestEntries, Scratch, SparseAccess};
use phasewarp::quantum::measurement_window::Deviation;
use phasewarp::quantum::probability::square_sum;
use phasewarp::quantum::sparsity::{Sparsity, measure};
use phasewarp::quantum::walk::value_bits;
use phasewarp::schrodingerization::profile::series::Series;
use phasewarp::schrodingerization::profile::series::points;
use std::f64::consts::TAU;

/// Points in `p` of the oracles.
const POINTS: usize = 6;
/// Period in `p` of the oracles.
const PERIOD: f64 = 9.0;

/// The oracles give `H = H1 ⊗ D_μ − H2 ⊗ I` of the dense twin with weights and inflow: they find
/// every nonzero entry exactly once and no other entry. `H` is Hermitian, no row has more entries
/// than stated, and values with m bits are the nearest ones.
pub fn oracles(world: &World) {
    let group = world.group();
    for twin in Twin::all() {
        let mesh = one_block(world, &twin.case);
        let weighted = Weighted::new(world, &twin, &mesh);
        let access = SparseAccess::new(&twin.case, &weighted.prepared.system, POINTS, PERIOD);
        let access = access.expect("V is finite");
        assert_eq!(access.unknowns(), twin.size(), "{}", twin.name);
        assert_eq!(access.order(), POINTS * twin.size());
        let oracle = Oracle {
            name: twin.name,
            access: &access,
            number: &weighted.number,
            s: weighted.generator.symmetric(),
            k: weighted.generator.skew(),
        };
        // All rows of small twins, and a quarter of the rows of large ones, which depends on the
        // number of ranks. The ranks share the rows.
        let stride = if access.order() < 600 { 1 } else { 4 };
        let rows = ((group.size() - 1) % stride..access.order()).step_by(stride);
        let mut scratch = Scratch::default();
        let (mut largest, mut fullest) = (0.0f64, 0);
        for j in rows.skip(group.rank()).step_by(group.size()) {
            let found = oracle.entries(&mut scratch, j);
            fullest = fullest.max(found.len());
            largest = largest.max(oracle.compare(&mut scratch, j, &found));
        }
        assert!(largest <= access.largest() * (1.0 + 1e-13));
        let (largest, fullest) = (group.max(largest), group.max_count(fullest));
        oracle.check_rounding(&mut scratch);
        if stride == 1 {
            assert_eq!(fullest, access.sparsity(), "{}", twin.name);
            let most = largest / access.largest();
            assert!((most - 1.0).abs() < 1e-13, "{}: {most}", twin.name);
        }
    }
}

/// The unit of `m`-bit values, the weight of their last bit: `‖H‖_max/(2^{m−1} − 1)`.
fn unit(access: &SparseAccess<'_>, m: u32) -> f64 {
    access.largest() / ((1i64 << (m - 1)) - 1) as f64
}

/// `|H_jk⟩_m`: the real and imaginary part of a value as whole numbers of [`unit`]s, rounded to the
/// nearest. Each has `m` bits, one of them the sign, with `m` from 2 to 52.
fn rounded(access: &SparseAccess<'_>, value: Complex64, m: u32) -> [i64; 2] {
    [value.re, value.im].map(|x| (x / unit(access, m)).round() as i64)
}

/// The oracles of a twin and its dense matrix.
struct Oracle<'a> {
    name: &'static str,
    access: &'a SparseAccess<'a>,
    number: &'a [usize],
    s: Dense,
    k: Dense,
}

impl Oracle<'_> {
    /// `H_jk` of the dense twin.
    fn exact(&self, j: usize, column: usize) -> Complex64 {
        let number = |j: usize| (self.number[j / POINTS], j % POINTS);
        let ((i, l), (other, m)) = (number(j), number(column));
        let mu = TAU * (l as f64 - 3.0) / PERIOD;
        if l == m {
            Complex64::new(mu * self.s.at(i, other), self.k.at(i, other))
        } else {
            Complex64::ZERO
        }
    }

    /// The columns that the location oracle finds in row `j`. Checks that they are ascending, and
    /// that the values are Hermitian and not zero.
    fn entries(&self, scratch: &mut Scratch, j: usize) -> Vec<usize> {
        let (access, name) = (self.access, self.name);
        let mut found = Vec::new();
        for entry in 0..=access.sparsity() {
            let column = access.location(scratch, j, entry);
            let value = access.value(scratch, j, column);
            if column == access.order() {
                assert_eq!(value, Complex64::ZERO);
                break;
            }
            let ascending = found.last().is_none_or(|last| *last < column);
            assert!(ascending, "{name}: row {j}");
            found.push(column);
            let back = access.value(scratch, column, j);
            let hermitian = (value - back.conj()).norm() <= 1e-14 * access.largest();
            assert!(hermitian, "{name}: {j} {column}");
            assert!(value != Complex64::ZERO);
            for bits in [4, 20, 50] {
                self.check_bits(value, bits);
            }
        }
        assert!(found.len() <= access.sparsity(), "{name}: row {j}");
        found
    }

    /// Checks that the value with `m` bits is the nearest one.
    fn check_bits(&self, value: Complex64, m: u32) {
        let access = self.access;
        let unit = unit(access, m);
        let [re, im] = rounded(access, value, m);
        for (bits, x) in [(re, value.re), (im, value.im)] {
            let off = (bits as f64 * unit - x).abs();
            // More bits than a double has add no information.
            let round_off = 1e-15 * access.largest();
            assert!(off <= 0.5 * unit + round_off, "{m} bits: {off:e} {unit:e}");
            assert!(bits.unsigned_abs() < 1 << (m - 1));
        }
    }

    /// With the number of bits that the walk uses, the error of `H`, and so that of `e^{−iH}`, is
    /// below the tolerance. With `log₂ 1/ε` bits it is not.
    fn check_rounding(&self, scratch: &mut Scratch) {
        let (access, tolerance) = (self.access, 1e-3);
        let tau = access.sparsity() as f64 * access.largest();
        // Lower and upper bound of the spectral norm of the error.
        let mut error = |m: u32| {
            let (mut sum_of_row, mut norm_of_row) = (0.0f64, 0.0f64);
            for j in (0..access.order()).step_by((access.order() / 100).max(1)) {
                let (mut sum, mut square) = (0.0, 0.0);
                for entry in 0..access.sparsity() {
                    let k = access.location(scratch, j, entry);
                    let value = access.value(scratch, j, k);
                    let [re, im] = rounded(access, value, m);
                    let unit = unit(access, m);
                    let off = value - Complex64::new(re as f64 * unit, im as f64 * unit);
                    sum += off.norm();
                    square += off.norm_sqr();
                }
                sum_of_row = sum_of_row.max(sum);
                norm_of_row = norm_of_row.max(square.sqrt());
            }
            [norm_of_row, sum_of_row]
        };
        let bits = value_bits(tau, tolerance);
        let [_, above] = error(bits);
        assert!(above <= tolerance, "{}: {bits} bits, {above:e}", self.name);
        if tau > 100.0 {
            let few = (1.0 / tolerance).log2().ceil() as u32;
            let [below, _] = error(few);
            assert!(below > tolerance, "{}: {few} bits, {below:e}", self.name);
        }
    }

    /// Checks that the values in row `j` are those of the twin, and zero where no entry was found.
    /// Returns the largest magnitude.
    fn compare(&self, scratch: &mut Scratch, j: usize, found: &[usize]) -> f64 {
        let mut largest = 0.0f64;
        for column in 0..self.access.order() {
            let (value, exact) = (self.access.value(scratch, j, column), self.exact(j, column));
            largest = largest.max(exact.norm());
            let close = (value - exact).norm() <= 1e-13 * self.access.largest();
            assert!(close, "{}: {j} {column}: {value} {exact}", self.name);
            let present = found.contains(&column);
            assert_eq!(value != Complex64::ZERO, present, "{}: {j} {column}", self.name);
        }
        largest
    }
}

/// Nonzeros of rows and columns are those of the dense twins, on every mesh.
pub fn sparsity(world: &World) {
    for twin in Twin::all() {
        for mesh in meshes(world, &twin.case) {
            let weighted = Weighted::new(world, &twin, &mesh);
            let name = format!("{}, {mesh:?}", twin.name);
            let prepared = &weighted.prepared;
            let space = &prepared.communicator.space;
            let found = measure(&twin.case, &prepared.system.matrix, space);
            let found = found.expect("V is finite");
            check_counts(&twin, &weighted, &found, &name);
            // The row of a common unknown is not the part of one rank.
            let entries = LargestEntries::of(&prepared.system.matrix, space);
            let fullest = found.counts.iter().find(|c| c.matrix == "H").map(|c| c.rows.most);
            assert_eq!(Some(entries.nonzeros), fullest, "{name}");
            // The stated bounds hold, and bounds are stated only for cases to which they apply.
            for c in &found.counts {
                assert!(c.rows.holds && c.columns.holds, "{name}: {c:?}");
                let unstated = c.rows.bound.is_none() && c.columns.bound.is_none();
                assert!(found.bounded || unstated, "{name}");
            }
            let places = found.counts.iter().flat_map(|c| [&c.rows.unknown, &c.columns.unknown]);
            // Twins that differ only in their couplings have the same places.
            let text = |p: &str| p.bytes().map(f64::from).sum();
            let bits: Vec<f64> = places.map(|p| text(p)).chain([text(twin.name)]).collect();
            let name = format!("places of the fullest rows of {}", twin.name);
            report_bits(world, &name, &bits);
        }
    }
}

/// Entries of the fullest row and of the fullest column of a matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fullest {
    row: usize,
    column: usize,
}

/// The counts of `A` and `H` are those of the twin. No part of `A` has more nonzeros per row than
/// `A`, and all parts together have at least as many.
fn check_counts(twin: &Twin, weighted: &Weighted, found: &Sparsity, name: &str) {
    let of = |matrix: &str| {
        let found = found.counts.iter().find(|c| c.matrix == matrix);
        let found = found.unwrap_or_else(|| panic!("{matrix} is counted"));
        Fullest { row: found.rows.most, column: found.columns.most }
    };
    let count = |size: usize, present: &dyn Fn(usize, usize) -> bool| {
        let row = |i: usize| (0..size).filter(|&j| present(i, j)).count();
        let column = |j: usize| (0..size).filter(|&i| present(i, j)).count();
        Fullest {
            row: (0..size).map(row).max().unwrap_or(0),
            column: (0..size).map(column).max().unwrap_or(0),
        }
    };
    let a = &twin.generator;
    assert_eq!(of("A"), count(twin.cells, &|i, j| a.at(i, j) != 0.0), "{name}");
    let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
    let coupled = |i, j| s.at(i, j) != 0.0 || k.at(i, j) != 0.0;
    assert_eq!(of("H"), count(twin.size(), &coupled), "{name}");
    let axes = &["A_x", "A_y", "A_z"][..twin.case.space.dimension()];
    let parts: Vec<Fullest> = axes.iter().map(|a| of(a)).chain([of("A_v")]).collect();
    let whole = of("A");
    let among = |p: &Fullest| p.row <= whole.row && p.column <= whole.column;
    assert!(parts.iter().all(among), "{name}");
    assert!(parts.iter().map(|p| p.row).sum::<usize>() >= whole.row, "{name}");
}

/// `C_w²/‖u(0)‖² = N_p Σ|c_l|²` equals `Σ_k g(p_k)²`, and a window ends where the series deviates
/// from the exponential. The ranks share the profiles.
pub fn norm_of_the_state(world: &World) {
    let mut twin = Twin::named("example 1");
    let group = world.group();
    let resources = Resources { ranks: group.size(), ..Resources::default() };
    let profiles = [
        (ProfileChoice::Designed, 1e-6),
        (ProfileChoice::Gaussian { sigma: None }, 1e-9),
        (ProfileChoice::Smooth { order: 4 }, 1e-4),
        (ProfileChoice::Exponential { alpha: Alpha::Constant(1.0) }, 1e-2),
    ];
    for (profile, tolerance) in profiles.into_iter().skip(group.rank()).step_by(group.size()) {
        twin.case.warp.profile = profile.clone();
        twin.case.tolerance = tolerance;
        let plan = Plan::new(&twin.case, &resources, 2.0).expect("a plan");
        let warp = plan.warp.as_ref().expect("a schrodingerized run");
        norm_of_series(&warp.series, &format!("{profile:?}"));
        let lambda = [plan.bounds.growth, plan.bounds.decay].map(|x| x * twin.case.end);
        let point = warp.readings[0].point;
        let allowed = 10.0 * warp.state_tolerance;
        end_of_window(&warp.series, point, lambda, allowed, &format!("{profile:?}"));
    }
}

/// The sum over the points does not depend on the first point.
fn norm_of_series(series: &Series, name: &str) {
    let count = points(series);
    assert!(count >= 2 * (series.modes() - 1));
    for origin in [-3.1, 0.4] {
        let at = |k: usize| origin + series.period * k as f64 / count as f64;
        let sum: f64 = (0..count).map(|k| series.value(at(k)).powi(2)).sum();
        let exact = count as f64 * square_sum(series);
        assert!((sum / exact - 1.0).abs() < 1e-10, "{name}: {sum} {exact}");
    }
}

/// Up to the end of the window, the series deviates from `e^{−p}` by at most `allowed` on all
/// points that the spectrum of `S T`, given by `lambda`, reaches. Beyond the window it deviates
/// more.
fn end_of_window(series: &Series, point: f64, lambda: [f64; 2], allowed: f64, name: &str) {
    let end = Deviation::new(series, point, lambda).window_end(allowed);
    let end = end.unwrap_or_else(|| panic!("{name}: no window"));
    assert!(end > point && end <= point + 12.0, "{name}: {point} {end}");
    let good = |p: f64| {
        (0..2000).all(|k| {
            let q = p - lambda[0] + (lambda[0] + lambda[1]) * f64::from(k) / 1999.0;
            (series.value(q) - (-q).exp()).abs() <= 1.5 * allowed * (-p).exp()
        })
    };
    let within = |k: i32| point + (end - point) * f64::from(k) / 8.0;
    assert!((0..=8).all(|k| good(within(k))), "{name}");
    let beyond = (1..=40).all(|k| good(end + 0.05 * f64::from(k)));
    assert!(end == point + 12.0 || !beyond, "{name}");
}
