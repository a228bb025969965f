//! Tests each propagator of a mode against `exp(−i(μS + iK)T) u` by Taylor series.

use crate::bits::report_bits;
use crate::dense_twins::Twin;
use crate::pieces::{Weighted, gather, meshes};
use crate::support::dense::{evolve, norm, order_of};
use crate::support::prepared::parts;
use faer::Mat;
use faer::linalg::solvers::Solve;
use num_complex::Complex64;
use phasewarp::matrix::blocking::fastest::FastestBlocking;
use phasewarp::matrix::blocking::{Blocking, BlockingShape};
use phasewarp::matrix::bounds::Bounds;
use phasewarp::matrix::lanes::{LANES, Lanes};
use phasewarp::matrix::observables::{MomentsOf, VelocityFactors};
use phasewarp::parallel::communicator::World;
use phasewarp::parallel::partition::ProcessMesh;
use phasewarp::problem::case::{Propagation, PropagatorMethod};
use phasewarp::propagate::bessel::bessel_series;
use phasewarp::propagate::chebyshev::Chebyshev;
use phasewarp::propagate::evolution::{BatchSpec, InitialState, SeriesSize};
use phasewarp::propagate::implicit::Implicit;
use phasewarp::propagate::intermediate_moments::IntermediateMoments;
use phasewarp::propagate::krylov::Krylov;
use phasewarp::propagate::method::{BatchReport, Propagator};
use phasewarp::propagate::{PropagationSpan, work};
use std::collections::BTreeMap;

/// Wavenumbers of a batch, from 0 to more than those of plans.
const WAVENUMBERS: [f64; LANES] = [0.0, 0.05, 0.3, 1.0, 2.0, 4.0, 9.0, 20.0];

/// `exp(−i(μS + iK)T) u` for each of `wavenumbers` by Taylor series. The ranks share the work.
fn references(
    world: &World,
    weighted: &Weighted,
    wavenumbers: &[f64],
    time: f64,
) -> Vec<Vec<Complex64>> {
    let group = world.group();
    let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
    (wavenumbers.iter().enumerate())
        .map(|(l, &mu)| {
            let mut flat = vec![f64::NEG_INFINITY; 2 * s.size];
            if l % group.size() == group.rank() {
                let state = evolve(&s, &k, mu, &weighted.state, time);
                flat = state.iter().flat_map(|z| [z.re, z.im]).collect();
            }
            group.max_into(&mut flat);
            flat.chunks(2).map(|z| Complex64::new(z[0], z[1])).collect()
        })
        .collect()
}

/// Calls `check` with the twin on every mesh, and with the references of `wavenumbers` at a time.
fn for_every_mesh(
    world: &World,
    twin: &Twin,
    wavenumbers: &[f64],
    time: impl Fn(&Weighted) -> f64,
    mut check: impl FnMut(&mut Weighted, &ProcessMesh, &[Vec<Complex64>]),
) {
    // The weights are the same on any mesh, and so is the reference.
    let mut reference = None;
    for mesh in meshes(world, &twin.case) {
        let mut weighted = Weighted::new(world, twin, &mesh);
        let once = || references(world, &weighted, wavenumbers, time(&weighted));
        let reference = reference.get_or_insert_with(once);
        check(&mut weighted, &mesh, reference);
    }
}

/// The time of the case.
fn whole_time(weighted: &Weighted) -> f64 {
    weighted.prepared.case.end
}

/// `√Σ|x_i|²`.
fn size(x: &[Complex64]) -> f64 {
    x.iter().map(|z| z.norm_sqr()).sum::<f64>().sqrt()
}

fn minus(x: &[Complex64], y: &[Complex64]) -> Vec<Complex64> {
    x.iter().zip(y).map(|(a, b)| a - b).collect()
}

/// The result of a batch.
struct Propagated {
    report: BatchReport,
    /// `w(T)` of each mode, by the numbers of the twin.
    states: Vec<Vec<Complex64>>,
    /// The leading term of its error, for methods with a time step.
    step_errors: Vec<Vec<Complex64>>,
    /// `‖w(0)‖`.
    initial_size: f64,
}

impl Propagated {
    /// `‖w − reference‖/‖w(0)‖` of mode `l`.
    fn error(&self, l: usize, reference: &[Complex64]) -> f64 {
        size(&minus(&self.states[l], reference)) / self.initial_size
    }

    /// The same error after the leading term is subtracted.
    fn error_beyond_leading(&self, l: usize, reference: &[Complex64]) -> f64 {
        let rest = minus(&self.states[l], &self.step_errors[l]);
        size(&minus(&rest, reference)) / self.initial_size
    }

    /// `‖w(T)‖/‖w(0)‖ − 1` of mode `l`.
    fn change_of_norm(&self, l: usize) -> f64 {
        size(&self.states[l]) / self.initial_size - 1.0
    }
}

/// Propagates the first field over `time`.
fn propagate(
    weighted: &mut Weighted,
    propagator: &mut dyn Propagator,
    batch: &BatchSpec,
    time: f64,
) -> Propagated {
    let mut parts = parts(&mut weighted.prepared, time);
    let report = propagator.propagate(&mut parts.evolution, batch, &parts.initial[0]);
    let report = report.expect("it converges");
    let rows = parts.evolution.matrix.counted_rows();
    let whole = |lanes: &[Lanes], l: usize| -> Vec<Complex64> {
        let part = |part: usize| {
            let value = |i: usize| (weighted.number[i], lanes[i].0[part * LANES + l]);
            gather(&parts.communicator.space, weighted.state.len(), (0..rows).map(value))
        };
        (part(0).into_iter().zip(part(1)))
            .map(|(re, im)| Complex64::new(re, im) * report.phases[l])
            .collect()
    };
    let modes = 0..batch.modes;
    let errors = propagator.step_error();
    let step_errors: Vec<_> = modes.clone().filter_map(|l| Some(whole(errors?, l))).collect();
    let initial_size = norm(&weighted.state);
    for (l, error) in step_errors.iter().enumerate() {
        let (mu, steps) = (batch.wavenumbers[l], batch.largest_work());
        let bound = propagator.largest_step_error(&parts.evolution, mu, steps) * initial_size;
        assert!(size(error) <= bound, "mu = {mu}, {steps} steps: {:e} {bound:e}", size(error));
    }
    Propagated {
        states: modes.map(|l| whole(propagator.state(), l)).collect(),
        step_errors,
        initial_size,
        report,
    }
}

/// The Chebyshev series keeps norms, and its truncation error is below its tail.
pub fn chebyshev_propagation(world: &World) {
    for twin in Twin::all() {
        let time = twin.case.end;
        for_every_mesh(world, &twin, &WAVENUMBERS, whole_time, |weighted, mesh, reference| {
            for tolerance in [1e-16, 1e-6] {
                let name = format!("{}, {mesh:?}", twin.name);
                chebyshev_series(weighted, &name, tolerance, reference, time);
            }
        });
    }
}

/// The degree of the series of each wavenumber whose tail is below `tail`.
fn degrees(bounds: &Bounds, time: f64, tail: f64) -> [usize; LANES] {
    let mut series = Vec::new();
    WAVENUMBERS.map(|mu| {
        let tau = bounds.interval(mu).half_width * time;
        bessel_series(&mut series, tau, tail);
        series.len() - 1
    })
}

fn chebyshev_series(
    weighted: &mut Weighted,
    name: &str,
    tolerance: f64,
    reference: &[Vec<Complex64>],
    time: f64,
) {
    let most = degrees(&weighted.prepared.bounds, time, 1e-16).into_iter().max();
    let most = most.expect("some wavenumbers");
    let work = degrees(&weighted.prepared.bounds, time, tolerance);
    let batch =
        BatchSpec { modes: LANES, wavenumbers: WAVENUMBERS, tolerances: [tolerance; LANES], work };
    let matrix = &weighted.prepared.system.matrix;
    let blocking = |depth| {
        let shape = BlockingShape { depth, width: 2, parts: 2 };
        Blocking::possible(matrix).then(|| Blocking::new(matrix, &shape))
    };
    // Blocked steps alone, and candidates in another order and of other depths on each rank.
    let rank = weighted.prepared.communicator.world.rank();
    let mut mixed = vec![blocking(2 + rank), None, blocking(7 - rank)];
    mixed.rotate_left(rank % 3);
    let [mut plain, mut blocked, mut mixed] = [vec![None], vec![blocking(5)], mixed]
        .map(|all| Chebyshev::blocked(matrix, most, FastestBlocking::of(all)));
    let found = propagate(weighted, &mut plain, &batch, time);
    assert!(found.step_errors.is_empty() && found.report.solves == 0);
    assert_eq!(found.report.applications, work.iter().sum::<usize>());
    for (way, chebyshev) in [("blocked", &mut blocked), ("mixed", &mut mixed)] {
        let same = propagate(weighted, chebyshev, &batch, time).states == found.states;
        assert!(same, "{name}: {way}");
    }
    passing_times(weighted, &mut plain, &batch, name, time);
    for l in 0..LANES {
        let (error, change) = (found.error(l, &reference[l]), found.change_of_norm(l));
        let tail = found.report.tails[l];
        let at = format!(
            "{name}, mu = {}, degree {}: error {error:e}, tail {tail:e}, norm {change:e}",
            WAVENUMBERS[l], work[l]
        );
        let allowed = 1e-12 + tail;
        assert!(error <= allowed && change.abs() <= allowed, "{at}");
        // Each series is as long as its lane needs, and not longer.
        assert!(tail <= tolerance * (1.0 + 1e-9) + 1e-15, "{at}");
        assert!(tolerance < 1e-9 || tail > 1e-9, "{at}");
    }
}

/// A series that reads moments at intermediate times has the same final state, and the moments have
/// the same bits with single and with blocked steps.
fn passing_times(
    weighted: &mut Weighted,
    chebyshev: &mut Chebyshev,
    batch: &BatchSpec,
    name: &str,
    time: f64,
) {
    let most = chebyshev.largest_degree();
    let size = SeriesSize { largest_degree: most, applications: most };
    let space = weighted.prepared.case.space.clone();
    let factors = VelocityFactors::new(&space);
    let mut parts = parts(&mut weighted.prepared, time);
    let matrix = parts.evolution.matrix;
    let moments = MomentsOf { factors: &factors, pi: parts.pi, least: 1.0 };
    let shape = BlockingShape { depth: 3, width: 2, parts: 1 };
    let blocking = Blocking::possible(matrix).then(|| Blocking::new(matrix, &shape));
    let (evolution, start) = (&mut parts.evolution, &parts.initial[0]);
    chebyshev.propagate(evolution, batch, start).expect("a series");
    let whole = chebyshev.state()[..matrix.rows()].to_vec();
    let read = [None, blocking].map(|blocking| {
        let mut passed = IntermediateMoments::new(matrix, &moments, 2, size)
            .blocked(FastestBlocking::of(vec![blocking]));
        let weights = std::array::from_fn(|l| Complex64::cis(0.3 * l as f64));
        passed.begin(&[0.2 * time, 0.9 * time], &weights);
        let report = chebyshev.propagate_past(evolution, batch, start, &mut passed);
        let applications = report.expect("a series").applications;
        assert_eq!(applications, batch.work.iter().sum::<usize>(), "{name}");
        let far = whole.iter().zip(chebyshev.state()).flat_map(|(Lanes(a), Lanes(b))| {
            let apart = |part: usize| (a[part] - b[part]).abs();
            (0..2 * LANES).map(apart).collect::<Vec<f64>>()
        });
        assert!(far.fold(0.0, f64::max) <= 1e-12 * start.norms[0], "{name}");
        (0..2).flat_map(|t| passed.at(t).flatten().copied().collect::<Vec<_>>()).collect::<Vec<_>>()
    });
    assert!(read[0] == read[1] && read[0].iter().flatten().any(|x| *x != 0.0), "{name}");
}

/// The Krylov propagator meets the tolerance of each mode, needs at most the planned applications,
/// keeps norms, and has the same bits on every mesh.
pub fn krylov_propagation(world: &World) {
    for twin in Twin::unshared() {
        let time = twin.case.end;
        for_every_mesh(world, &twin, &WAVENUMBERS, whole_time, |weighted, _, reference| {
            for (tolerance, step) in [(1e-11, None), (1e-4, Some(0.03 * time))] {
                let span = PropagationSpan { time, tolerance };
                let found = krylov_steps(weighted, twin.name, step, span, reference);
                let numbers = found.states.iter().flatten().flat_map(|z| [z.re, z.im]);
                let name = format!("Krylov for {} at {tolerance:e}", twin.name);
                report_bits(world, &name, &numbers.collect::<Vec<f64>>());
            }
        });
    }
}

fn krylov_steps(
    weighted: &mut Weighted,
    name: &str,
    step: Option<f64>,
    span: PropagationSpan,
    reference: &[Vec<Complex64>],
) -> Propagated {
    let PropagationSpan { time, tolerance } = span;
    let mut scratch = Vec::new();
    let bounds = &weighted.prepared.bounds;
    let propagation = Propagation { method: PropagatorMethod::Krylov, step };
    let planned = WAVENUMBERS.map(|mu| work(&propagation, bounds, mu, span, &mut scratch));
    let batch = BatchSpec {
        modes: LANES,
        wavenumbers: WAVENUMBERS,
        tolerances: [tolerance; LANES],
        work: [0; LANES],
    };
    let mut krylov = Krylov::new(&weighted.prepared.system.matrix, step);
    let found = propagate(weighted, &mut krylov, &batch, time);
    let report = &found.report;
    assert!(found.step_errors.is_empty() && report.solves == 0 && report.unitary);
    for l in 0..LANES {
        let (error, change) = (found.error(l, &reference[l]), found.change_of_norm(l));
        let tail = report.tails[l];
        let at = format!(
            "{name}, mu = {}, {tolerance:e}: error {error:e}, bound {tail:e}, norm {change:e}",
            WAVENUMBERS[l]
        );
        assert!(tail <= tolerance * (1.0 + 1e-9) + 1e-13, "{at}");
        assert!(error <= 1e-12 + tail, "{at}");
        assert!(change.abs() <= 1e-12, "{at}");
    }
    let most = planned.into_iter().max().expect("some wavenumbers");
    let took = report.applications / LANES;
    assert!(took <= most, "{name}: {took} {most}");
    // A given step needs at least this number of applications.
    assert!(step.is_none() || took >= 34, "{name}: {took}");
    found
}

/// On every mesh, Crank–Nicolson converges with order 2 and keeps norms, and backward Euler
/// converges with order 1 and reduces them. The reported leading term is most of the error.
pub fn orders_of_the_implicit_methods(world: &World) {
    for twin in Twin::unshared() {
        for_every_mesh(world, &twin, &SLOW, short_time, |weighted, mesh, reference| {
            for (order, coarse) in [(2, 8), (1, 32)] {
                let runs = [coarse, 2 * coarse].map(|steps| {
                    let found = implicit_steps(weighted, mesh, order, steps);
                    assert_eq!(found.report.solves, SLOW.len() * steps);
                    assert!(found.report.applications >= found.report.solves);
                    assert_eq!(found.report.unitary, order == 2);
                    found
                });
                let name = format!("{}, {mesh:?}, order {order}", twin.name);
                order_of_convergence(&runs, &name, order, reference);
            }
        });
    }
}

/// Wavenumbers that a few implicit steps resolve.
const SLOW: [f64; 2] = [0.0, 0.5];

/// The time `1/rate`, over which they are taken.
fn short_time(weighted: &Weighted) -> f64 {
    1.0 / weighted.prepared.bounds.rate
}

/// `steps` steps of Crank–Nicolson (order 2) or backward Euler (order 1) over the [`short_time`].
fn implicit_steps(
    weighted: &mut Weighted,
    mesh: &ProcessMesh,
    order: usize,
    steps: usize,
) -> Propagated {
    let mut wavenumbers = [SLOW[1]; LANES];
    wavenumbers[..SLOW.len()].copy_from_slice(&SLOW);
    let batch = BatchSpec {
        modes: SLOW.len(),
        wavenumbers,
        tolerances: [1e-6; LANES],
        work: [steps; LANES],
    };
    let time = short_time(weighted);
    propagate(weighted, &mut implicit(weighted, mesh, order), &batch, time)
}

fn implicit(weighted: &Weighted, mesh: &ProcessMesh, order: usize) -> Implicit {
    let matrix = &weighted.prepared.system.matrix;
    Implicit::new(matrix, order, mesh.blocks() > 1).expect("the pattern is analysed")
}

/// Checks the order and the norms of two runs; the second one has half the time step.
fn order_of_convergence(
    runs: &[Propagated; 2],
    name: &str,
    order: usize,
    reference: &[Vec<Complex64>],
) {
    let [coarse, fine] = runs;
    for l in 0..SLOW.len() {
        let error = fine.error(l, &reference[l]);
        let found = order_of([coarse.error(l, &reference[l]), error], 2.0);
        let (change, tail) = (fine.change_of_norm(l), fine.report.tails[l]);
        let missed = fine.error_beyond_leading(l, &reference[l]) / error;
        let at = format!(
            "{name}, mu = {}: {found}, error {error:e}, norm {change:e}, rest {missed}",
            SLOW[l]
        );
        assert!((found - order as f64).abs() < 0.1, "{at}");
        assert!(error > 1e-8 && missed < 0.2, "{at}");
        if order == 2 {
            assert!(change.abs() <= 1e-13 + tail && tail < 1e-10, "{at}");
        } else {
            assert!(change < -1e-6, "{at}");
        }
    }
}

/// Steps with `Δt‖H‖` around 1000, as in the paper's set-up, against dense solves.
pub fn long_implicit_steps(world: &World) {
    const FASTEST: f64 = 370.0;
    let mut wavenumbers = [FASTEST; LANES];
    wavenumbers[..2].copy_from_slice(&[0.0, 5.0]);
    let batch =
        BatchSpec { modes: 3, wavenumbers, tolerances: [1e-6; LANES], work: [LONG_STEPS; LANES] };
    for twin in Twin::unshared() {
        let mut expected: BTreeMap<(usize, usize), Vec<Complex64>> = BTreeMap::new();
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let step = 1000.0 / (2.0 * FASTEST * weighted.prepared.bounds.rate);
            let time = LONG_STEPS as f64 * step;
            for order in [2, 1] {
                let mut method = implicit(&weighted, &mesh, order);
                let found = propagate(&mut weighted, &mut method, &batch, time);
                for (l, &mu) in wavenumbers[..batch.modes].iter().enumerate() {
                    let expected = (expected.entry((order, l)))
                        .or_insert_with(|| dense_implicit_steps(&weighted, order, mu, step));
                    let error = found.error(l, expected);
                    let at = format!("{}, {mesh:?}, mu = {mu}, order {order}", twin.name);
                    assert!(error <= 1e-11, "{at}: {error:e}");
                }
                // A solution that is no number is no solution.
                let mut parts = parts(&mut weighted.prepared, time);
                let mut start = vec![1.0; parts.evolution.matrix.length()];
                start[0] = f64::NAN;
                let start = InitialState::real(&start, 1.0);
                let report = method.propagate(&mut parts.evolution, &batch, &start);
                assert!(report.is_err(), "{}, {mesh:?}, order {order}", twin.name);
            }
        }
    }
}

const LONG_STEPS: usize = 2;

/// [`LONG_STEPS`] steps with a dense factorisation of `1 + iaH`, `a = Δt/2` for Crank–Nicolson and
/// `Δt` for backward Euler.
fn dense_implicit_steps(weighted: &Weighted, order: usize, mu: f64, step: f64) -> Vec<Complex64> {
    let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
    let a = if order == 2 { 0.5 * step } else { step };
    let shifted = Mat::from_fn(s.size, s.size, |i, j| {
        let unit = f64::from(u8::from(i == j));
        Complex64::new(unit - a * k.at(i, j), a * mu * s.at(i, j))
    });
    let factors = shifted.partial_piv_lu();
    let mut w = Mat::from_fn(s.size, 1, |i, _| Complex64::from(weighted.state[i]));
    for _ in 0..LONG_STEPS {
        let z = factors.solve(&w);
        w = if order == 2 { &z + &z - &w } else { z };
    }
    (0..s.size).map(|i| w[(i, 0)]).collect()
}
