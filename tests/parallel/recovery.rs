//! Tests the fields that streamed runs recover from the modes: with every profile and propagator,
//! at output times, and with any batches.

use crate::bits::report_bits;
use crate::dense_twins::{Twin, cells_of_axes};
use crate::pieces::{Weighted, gather, gather_field, meshes, point_numbers};
use crate::streamed::{Streamed, StreamedRun, mixed};
use crate::support::dense::{case, distance, evolve, exponential, norm};
use crate::support::prepared::{Prepared, prepare};
use crate::time_dependent::Varying;
use phasewarp::matrix::observables::{MOMENTS, VelocityFactors};
use phasewarp::parallel::communicator::World;
use phasewarp::parallel::partition::ProcessMesh;
use phasewarp::problem::case::{
    Alpha, Case, Coefficients, Embedding, OutputTime, ProfileChoice, Propagation, PropagatorMethod,
    RecoveryMethod, Shift,
};
use phasewarp::problem::formula::{Constants, Expression};
use phasewarp::problem::legs::Leg;
use phasewarp::propagate::descriptor;
use phasewarp::propagate::method::BatchCoupling;

/// How a field is recovered.
struct Recovery {
    profile: ProfileChoice,
    reading: RecoveryMethod,
    coefficients: Coefficients,
    tolerance: f64,
    method: PropagatorMethod,
    /// Steps of an implicit method.
    steps: Option<u32>,
}

/// Every profile with several readings and coefficients, at tolerances that do not need too many
/// modes, and every propagator.
fn recoveries() -> Vec<Recovery> {
    use Coefficients::{Analytic, Sampled};
    use ProfileChoice::{Acl, Designed, Exponential, Gaussian, LowSomma, Planned, Smooth};
    use PropagatorMethod::{BackwardEuler, CrankNicolson, Krylov};
    use RecoveryMethod::{Integral, LeastSquares, Point};
    const GAUSSIAN: ProfileChoice = Gaussian { sigma: None };
    const LOW_SOMMA: ProfileChoice = LowSomma { c: None };
    let exponential = |alpha: &str| {
        let alpha = Expression::parse(alpha, &[&["p"]], &Constants::new()).expect("a formula");
        Exponential { alpha: Alpha::of(&alpha).expect("a profile") }
    };
    vec![
        by_series(Designed, Point, Analytic, 1e-9),
        by_series(Designed, Integral, Analytic, 1e-7),
        by_series(Planned, LeastSquares, Analytic, 1e-6),
        by_method(Designed, 1e-9, Krylov, None),
        by_series(GAUSSIAN, Point, Analytic, 1e-4),
        by_series(GAUSSIAN, Point, Analytic, 1e-9),
        by_series(GAUSSIAN, LeastSquares, Sampled, 1e-6),
        by_series(LOW_SOMMA, Point, Analytic, 1e-8),
        by_series(LOW_SOMMA, Integral, Sampled, 1e-5),
        by_series(Smooth { order: 8 }, Point, Sampled, 1e-4),
        by_series(exponential("1"), Point, Sampled, 3e-2),
        by_series(exponential("2 - p"), LeastSquares, Analytic, 3e-2),
        by_series(exponential("-1 + (-p)^5"), Point, Sampled, 1e-4),
        by_series(Acl { beta: 0.75 }, LeastSquares, Analytic, 3e-2),
        by_method(GAUSSIAN, 1e-9, Krylov, None),
        by_method(GAUSSIAN, 1e-4, CrankNicolson, Some(20)),
        by_method(GAUSSIAN, 1e-3, BackwardEuler, Some(40)),
    ]
}

/// A recovery with the Chebyshev series.
fn by_series(
    profile: ProfileChoice,
    reading: RecoveryMethod,
    coefficients: Coefficients,
    tolerance: f64,
) -> Recovery {
    Recovery {
        profile,
        reading,
        coefficients,
        tolerance,
        method: PropagatorMethod::Chebyshev,
        steps: None,
    }
}

/// A recovery at a point with analytic coefficients.
fn by_method(
    profile: ProfileChoice,
    tolerance: f64,
    method: PropagatorMethod,
    steps: Option<u32>,
) -> Recovery {
    Recovery {
        method,
        steps,
        ..by_series(profile, RecoveryMethod::Point, Coefficients::Analytic, tolerance)
    }
}

impl Recovery {
    fn set(&self, case: &mut Case) {
        case.tolerance = self.tolerance;
        case.warp.profile = self.profile.clone();
        case.warp.recovery_method = self.reading;
        case.warp.coefficients = self.coefficients;
        case.propagator =
            Propagation { method: self.method, step: self.steps.map(|n| case.end / f64::from(n)) };
    }

    /// A name that differs for different recoveries.
    fn name(&self) -> String {
        let Self { profile, reading, coefficients, tolerance, method, .. } = self;
        format!("{profile:?}, {reading:?}, {coefficients:?}, {tolerance:e}, {method:?}")
    }
}

/// Whether a method applies to a case: only the Chebyshev series supports an unknown that all rows
/// share.
fn applies(method: PropagatorMethod, case: &Case) -> bool {
    case.warp.inflow != Embedding::Scalar || method == PropagatorMethod::Chebyshev
}

/// A series needs the planned applications, Lanczos at most those, and an implicit method the
/// planned solves.
fn check_work(run: &Streamed, method: PropagatorMethod, name: &str) {
    use PropagatorMethod::{Chebyshev, Krylov};
    let (applications, solves) = (run.recovered.applications, run.recovered.solves);
    match method {
        Chebyshev => assert_eq!((applications, solves), (run.planned, 0), "{name}"),
        Krylov => assert!(applications <= run.planned && solves == 0, "{name}"),
        _ => assert_eq!(solves, run.planned, "{name}"),
    }
}

/// Methods that keep norms report the defect. Backward Euler does not, and it reduces the norm.
fn check_norms(run: &Streamed, method: PropagatorMethod, name: &str) {
    let kept = run.recovered.norm_kept.expect("a state that is not zero");
    match run.recovered.unitarity_defect {
        Some(defect) => {
            assert!(defect <= 1.0 && method != PropagatorMethod::BackwardEuler, "{name}");
        }
        None => {
            let loses = method == PropagatorMethod::BackwardEuler && kept < 0.9999;
            assert!(loses, "{name}: {kept}");
        }
    }
    let loss = 1.0 - kept;
    let lossless = method == PropagatorMethod::CrankNicolson;
    assert!(!lossless || loss.abs() < 1e-11, "{name}: {loss}");
}

/// With every profile and propagator, the field of a streamed run differs from `exp(AT) f0` by at
/// most the tolerance, or by the reported error of the step. It has the same bits on every mesh, or
/// for every number of mode groups. Twins with one element are left out: they have so few
/// frequencies that the two readings may have the same error. Other checks cover them.
///
/// On more than two ranks, a mesh that splits space is tested with a sixth of the recoveries, which
/// changes with the twin and the mesh, as ranks that share a core wait for each other at every
/// exchange.
pub fn recovered_field(world: &World) {
    let several = |twin: &Twin| twin.case.space.x[0].elements() > 1;
    let all = recoveries();
    let apart = if world.group().size() > 2 { 6 } else { 1 };
    for (t, mut twin) in Twin::all().into_iter().filter(several).enumerate() {
        let expected = exponential(&twin.generator, &twin.state, twin.case.end);
        let expected = twin.in_norm(twin.field(&expected));
        let recoveries = all.iter().filter(|r| applies(r.method, &twin.case));
        let recoveries: Vec<&Recovery> = recoveries.collect();
        // For each recovery, the field on the mesh that does not split space, which is the first
        // one.
        let mut unsplit: Vec<Vec<f64>> = Vec::new();
        for (m, mesh) in meshes(world, &twin.case).into_iter().enumerate() {
            let taken = |k: usize| mesh.blocks() == 1 || (t + m + k).is_multiple_of(apart);
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let size = norm(&weighted.state);
            let ratio = weighted.prepared.probe();
            let exact = Exact { size, field: &expected };
            check_probe(ratio, exact.ratio(), &format!("{}, {mesh:?}", twin.name));
            for (k, recovery) in recoveries.iter().enumerate().filter(|(k, _)| taken(*k)) {
                recovery.set(&mut twin.case);
                let name = format!("the field of {} by {}", twin.name, recovery.name());
                let at = format!("{name}, {mesh:?}");
                let run = StreamedRun::new(&twin.case, &mesh, ratio);
                let found = exact.compare(world, &twin, &run, &mut weighted.prepared);
                check_work(&found.run, recovery.method, &at);
                check_norms(&found.run, recovery.method, &at);
                assert_eq!(found.fields.len(), 2, "{at}");
                if mesh.blocks() == 1 {
                    unsplit.push(found.scaled[0].clone());
                }
                if let Some(steps) = recovery.steps {
                    found.check_step_error(&unsplit[k], steps, &at);
                } else {
                    found.check_tolerance(recovery, &at);
                }
                if recovery.steps.is_none() || mesh.blocks() == 1 {
                    report_bits(world, &name, &found.fields.concat());
                }
            }
        }
    }
}

/// The estimate of the largest `‖u(0)‖/‖f(t)‖` is at least the exact value, and not much larger.
fn check_probe(found: f64, exact: f64, name: &str) {
    let close = (exact..1.5 * exact).contains(&found);
    assert!(close, "{name}: {found} {exact}");
}

/// The reference of a recovered field.
struct Exact<'a> {
    /// `exp(AT) f0` in the norm of the scheme.
    field: &'a [f64],
    /// `‖u(0)‖`.
    size: f64,
}

/// A field recovered on a mesh.
struct RecoveredField {
    run: Streamed,
    /// The whole field of each reading.
    fields: Vec<Vec<f64>>,
    /// The same in the norm of the scheme.
    scaled: Vec<Vec<f64>>,
    /// Relative distance of the first from `exp(AT) f0`.
    error: f64,
    /// The norm of the leading term of the time step's error, relative to that of the field.
    step_error: Option<f64>,
    /// The amplification from an error of a mode, relative to `‖u(0)‖`, to that of the field,
    /// relative to its norm.
    amplification: f64,
}

impl Exact<'_> {
    /// `‖u(0)‖/‖f(T)‖`.
    fn ratio(&self) -> f64 {
        self.size / norm(self.field)
    }

    fn compare(
        &self,
        world: &World,
        twin: &Twin,
        run: &StreamedRun<'_>,
        on: &mut Prepared,
    ) -> RecoveredField {
        let run = run.run(world, on);
        let fields = run.fields(world, on);
        let scaled: Vec<Vec<f64>> = fields.iter().map(|field| twin.in_norm(field)).collect();
        let relative = |share: &Vec<f64>| {
            norm(&twin.in_norm(&gather_field(world, on, share))) / norm(self.field)
        };
        RecoveredField {
            error: distance(&scaled[0], self.field),
            step_error: run.recovered.step_errors.first().map(relative),
            amplification: run.plan.amplification * self.ratio(),
            fields,
            scaled,
            run,
        }
    }
}

impl RecoveredField {
    /// The error is about its leading term. With split space, linear solvers leave residuals of the
    /// size of round-off, which the recovery amplifies.
    fn check_step_error(&self, unsplit: &[f64], steps: u32, name: &str) {
        let (error, leading) = (self.error, self.step_error.expect("a leading term"));
        let close = (0.5..2.0).contains(&(leading / error));
        assert!(close, "{name}: {leading:e} {error:e}");
        let difference = distance(&self.scaled[0], unsplit);
        let allowed = 2e-16 * f64::from(steps) * self.amplification;
        assert!(difference <= allowed, "{name}: {difference:e} {allowed:e}");
    }

    /// The error is within the tolerance, and the second recovery point gives its size.
    fn check_tolerance(&self, recovery: &Recovery, name: &str) {
        assert!(self.step_error.is_none(), "{name}");
        let error = self.error;
        assert!(error <= recovery.tolerance, "{name}: error {error:e}");
        let estimate = distance(&self.scaled[1], &self.scaled[0])
            / self.run.plan.estimator_quality.efficiency
            / error;
        let gaussian = recovery.profile == ProfileChoice::Gaussian { sigma: None };
        // If the plan doubts the estimate, the two readings may have similar errors.
        let factor = match (self.run.plan.estimate_doubt(), gaussian) {
            (Some(_), _) => 20.0,
            (None, true) => 3.0,
            (None, false) => 5.0,
        };
        let close = (1.0 / factor..factor).contains(&estimate);
        assert!(close, "{name}: {estimate}");
    }
}

/// Output times as fractions of the end time, and whether fields are written there or only moments.
const OUTPUT_TIMES: [(f64, bool); 10] = [
    (0.1, false),
    (0.23, true),
    (0.3, false),
    (0.4, false),
    (0.45, false),
    (0.5, false),
    (0.6, false),
    (0.71, true),
    (0.8, false),
    (0.95, false),
];

/// With every propagator, fields and moments at output times differ from those of `exp(At) f0` by
/// at most the tolerance, with the same bits on every mesh on which the method has equal bits.
pub fn results_before_the_end(world: &World) {
    use PropagatorMethod::{Chebyshev, CrankNicolson, Krylov};
    for mut twin in Twin::all() {
        let time = twin.case.end;
        let times = OUTPUT_TIMES.map(|(part, fields)| OutputTime { time: part * time, fields });
        twin.case.output.times = times.to_vec();
        let moments_only: Vec<bool> =
            (Leg::all(&twin.case).iter()).map(|leg| leg.moments_only).collect();
        let wanted = OUTPUT_TIMES.map(|(_, fields)| !fields);
        assert_eq!(moments_only, [&wanted[..], &[false]].concat());
        let at = |time| exponential(&twin.generator, &twin.state, time);
        let times = times.iter().map(|output| output.time).chain([time]);
        let exact: Vec<Vec<f64>> = times.map(|time| twin.field(&at(time)).to_vec()).collect();
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let ratio = weighted.prepared.probe();
            let ratios = exact.iter().map(|f| norm(&weighted.state) / norm(&twin.in_norm(f)));
            let at = format!("{}, {mesh:?}", twin.name);
            check_probe(ratio, ratios.fold(1.0, f64::max), &at);
            for (method, tolerance) in [(Chebyshev, 1e-9), (Krylov, 1e-5), (CrankNicolson, 1e-3)] {
                // Residuals of an implicit step depend on the blocks.
                let split = method == CrankNicolson && mesh.blocks() > 1;
                if split || !applies(method, &twin.case) {
                    continue;
                }
                twin.case.tolerance = tolerance;
                let step = (method == CrankNicolson).then_some(time / 90.0);
                twin.case.propagator = Propagation { method, step };
                let run = StreamedRun::new(&twin.case, &mesh, ratio);
                let run = run.run(world, &mut weighted.prepared);
                let at = format!("{at}, {method:?}");
                check_work(&run, method, &at);
                // Only fields divide a series into legs; moments are read within it.
                let legs = if method == Chebyshev { 3 } else { OUTPUT_TIMES.len() + 1 };
                assert_eq!(run.plan.legs.len(), legs, "{at}");
                let found = results_of_a_run(world, &run, &weighted.prepared, &twin, &exact, &at);
                let name = format!("results before the end of {} by {method:?}", twin.name);
                report_bits(world, &name, &found);
                if method == CrankNicolson {
                    let mut at_once = twin.case.clone();
                    at_once.output.times.clear();
                    let single = StreamedRun::new(&at_once, &mesh, ratio);
                    let single = single.run(world, &mut weighted.prepared);
                    check_error_of_steps(&run, &single, &at);
                }
            }
        }
    }
}

/// The leading term of the error at the end counts all steps from the start: it is close to that of
/// a run without results before the end.
fn check_error_of_steps(run: &Streamed, single: &Streamed, name: &str) {
    let [found, expected] = [run, single].map(|run| norm(&run.recovered.step_errors[0]));
    let close = expected == 0.0 || (0.7..1.4).contains(&(found / expected));
    assert!(close, "{name}: {found:e} {expected:e}");
}

/// If the bound on the spectrum is too small, a series is not unitary. The run ends with an error
/// on every rank.
pub fn changed_norms_are_refused(world: &World) {
    let case = case("step_up.toml", &["axis.0.x.cells=8", "axis.0.v.cells=9"]);
    for mesh in meshes(world, &case) {
        let mut prepared = prepare(world, &case, &mesh);
        let ratio = prepared.probe();
        let (system, communicator) = (&prepared.system, &prepared.communicator);
        let mut state = vec![1.0; system.matrix.length()];
        assert!(system.norm(communicator, &state).is_finite(), "{mesh:?}");
        state[0] = f64::NAN;
        let norms = [system.norm(communicator, &state), system.field_norm(communicator, &state)];
        assert!(norms.iter().all(|norm| norm.is_nan()), "{mesh:?}: {norms:?}");
        let run = StreamedRun::new(&case, &mesh, ratio);
        assert!(run.attempt(world, &mut prepared).is_ok(), "{mesh:?}");
        prepared.bounds.rate *= 0.5;
        let error = run.attempt(world, &mut prepared).err().map(|error| error.to_string());
        assert!(error.is_some_and(|error| error.contains("norm")), "{mesh:?}");
    }
}

/// Compares all fields and moments of a run with the fields `exact`, and returns them.
fn results_of_a_run(
    world: &World,
    run: &Streamed,
    prepared: &Prepared,
    twin: &Twin,
    exact: &[Vec<f64>],
    name: &str,
) -> Vec<f64> {
    let tolerance = twin.case.tolerance;
    let early = &run.recovered.early[0].times;
    let mut all = Vec::new();
    assert_eq!(early.len(), OUTPUT_TIMES.len(), "{name}");
    let end = run.recovered.fields[0].first();
    let found = early.iter().map(Vec::as_slice).chain([end]).zip(exact);
    let with_fields = OUTPUT_TIMES.iter().map(|(_, fields)| *fields).chain([true]);
    for ((found, exact), fields) in found.zip(with_fields) {
        if !fields {
            all.extend(check_moments(world, prepared, twin, found, exact, name));
            continue;
        }
        let found = gather_field(world, prepared, found);
        let error = distance(&twin.in_norm(&found), &twin.in_norm(exact));
        assert!(error <= tolerance, "{name}: {error:e}");
        // Control: the initial field is not within the tolerance.
        let moved = distance(twin.field(&twin.state), exact);
        assert!(moved > 10.0 * tolerance, "{name}: {moved:e}");
        all.extend(found);
    }
    all
}

/// Compares the moments from `share`, this rank's sums over the velocities, with those of the field
/// `exact`, and returns them.
fn check_moments(
    world: &World,
    prepared: &Prepared,
    twin: &Twin,
    share: &[f64],
    exact: &[f64],
    name: &str,
) -> Vec<f64> {
    let factors = VelocityFactors::new(&twin.case.space);
    let points = point_numbers(prepared);
    let (sums, _) = share.as_chunks::<MOMENTS>();
    assert_eq!(sums.len(), points.len(), "{name}");
    let size = norm(&twin.in_norm(exact));
    let exact: Vec<[f64; MOMENTS]> = factors.at_points(exact).collect();
    let mut all = Vec::new();
    for m in 0..MOMENTS {
        let entries = points.iter().copied().zip(sums.iter().map(|sums| sums[m]));
        let found = gather(&world.group(), exact.len(), entries);
        let exact: Vec<f64> = exact.iter().map(|sums| sums[m]).collect();
        let apart: Vec<f64> = found.iter().zip(&exact).map(|(a, b)| a - b).collect();
        let error = norm(&apart);
        // The errors of the terms of a sum over velocities add up.
        let allowed = twin.case.tolerance * factors.norms()[m] * size;
        assert!(error <= allowed, "{name}, moment {m}: {error:e} {allowed:e}");
        assert!(m > 0 || norm(&exact) > 100.0 * allowed, "{name}, moment {m}");
        all.extend(found);
    }
    all
}

/// If the modes of a batch are independent or are propagated one by one, the bits of the field and
/// the number of applications do not depend on the batches. With Krylov they do: the dimension of a
/// basis is that of the slowest mode of the batch. On more than two ranks, a mesh that splits space
/// is tested with one of the methods by turn.
pub fn modes_in_any_batch(world: &World) {
    let methods = [
        (PropagatorMethod::Chebyshev, None),
        (PropagatorMethod::CrankNicolson, Some(5.0)),
        (PropagatorMethod::Krylov, None),
    ];
    let mut alike = [true; 3];
    let apart = if world.group().size() > 2 { 3 } else { 1 };
    for (t, mut twin) in Twin::unshared().into_iter().enumerate() {
        for (m, mesh) in meshes(world, &twin.case).into_iter().enumerate() {
            let mut prepared = prepare(world, &twin.case, &mesh);
            let taken = |k: usize| mesh.blocks() == 1 || (t + m + k).is_multiple_of(apart);
            for (k, (method, steps)) in methods.into_iter().enumerate().filter(|(k, _)| taken(*k)) {
                let step = steps.map(|n| twin.case.end / n);
                twin.case.propagator = Propagation { method, step };
                let same = alike_in_any_batch(world, &mut prepared, &mut twin.case, &mesh);
                assert!(same || coupled(method), "{}, {mesh:?}, {method:?}", twin.name);
                alike[k] &= same;
            }
        }
    }
    for ((method, _), alike) in methods.into_iter().zip(alike) {
        assert_eq!(alike, !coupled(method), "{method:?}");
    }
    for mut scene in Varying::all() {
        scene.case.tolerance = 1e-4;
        for mesh in meshes(world, &scene.case) {
            let mut prepared = prepare(world, &scene.case, &mesh);
            let same = alike_in_any_batch(world, &mut prepared, &mut scene.case, &mesh);
            assert!(same, "{}, {mesh:?}", scene.name);
        }
    }
}

fn coupled(method: PropagatorMethod) -> bool {
    descriptor(method).batch_coupling() == BatchCoupling::Coupled
}

/// Whether bits and applications are the same in the planned batches and in mixed ones.
fn alike_in_any_batch(
    world: &World,
    prepared: &mut Prepared,
    case: &mut Case,
    mesh: &ProcessMesh,
) -> bool {
    case.tolerance = 1e-4;
    let planned = StreamedRun::new(case, mesh, 2.0);
    let mixed = StreamedRun { batches: mixed, ..planned.clone() };
    let [planned, mixed] = [planned, mixed].map(|run| {
        let run = run.run(world, prepared);
        let fields = run.fields(world, prepared).concat().into_iter();
        let bits: Vec<u64> = fields.map(f64::to_bits).collect();
        (bits, run.applications(prepared))
    });
    planned == mixed
}

/// Several fields in one pass over the modes have the same bits as each field alone.
pub fn fields_in_one_pass(world: &World) {
    let mut settings = cells_of_axes(&[4, 3, 5, 4]);
    settings.push("solver.tolerance=1e-5".to_owned());
    let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
    let case = case("example3.toml", &settings);
    assert_eq!(case.fields.len(), 3);
    for mesh in meshes(world, &case) {
        let mut prepared = prepare(world, &case, &mesh);
        let pass = StreamedRun::new(&case, &mesh, 2.0);
        let together = pass.run(world, &mut prepared).recovered;
        assert_eq!(together.fields.len(), 3);
        let mut applications = 0;
        for (k, field) in together.fields.iter().enumerate() {
            let alone = StreamedRun { fields: k..k + 1, ..pass.clone() };
            let alone = alone.run(world, &mut prepared).recovered;
            applications += alone.applications;
            for (a, b) in alone.fields[0].each().zip(field.each()) {
                let same = a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "field {k}, {mesh:?}");
                let moves = a.iter().any(|a| *a != 0.0);
                assert!(moves || a.is_empty(), "field {k}, {mesh:?}");
            }
        }
        assert_eq!(together.applications, applications);
    }
}

/// A run with the shift `u = e^{σt} ũ` against the sum over the modes of the matrix `A − σ`. The
/// program shifts only the readings.
pub fn shifted_field(world: &World) {
    for (sigma, name) in [(0.8, "slopes, inflow"), (-0.5, "example 1")] {
        let mut twin = Twin::named(name);
        twin.case.warp.shift = Shift::Given(sigma);
        twin.case.tolerance = 1e-7;
        let expected = exponential(&twin.generator, &twin.state, twin.case.end);
        let mut reference: Option<Vec<f64>> = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let prepared = &mut weighted.prepared;
            let run = StreamedRun::new(&twin.case, &mesh, 3.0).run_as_planned(world, prepared);
            let fields = run.fields(world, prepared);
            let reference =
                reference.get_or_insert_with(|| sum_over_modes(&twin, &weighted, &run, sigma));
            let error = distance(&fields[0], reference);
            // The difference is the truncation error of the series.
            assert!(error <= 1e-8, "{name}, {mesh:?}: {error:e}");
            let error = distance(&fields[0], twin.field(&expected));
            assert!(error <= 1e-7, "{name}, {mesh:?}: {error:e}");
        }
    }
}

/// `Re Σ_l e^{σT} e^{p◇} c_l e^{iμ_l p◇} exp(−i(μ_l (S − σ) + iK)T) u(0)` at `p◇ = 0`, divided by
/// the weights.
fn sum_over_modes(twin: &Twin, weighted: &Weighted, run: &Streamed, sigma: f64) -> Vec<f64> {
    let time = twin.case.end;
    let mut shifted = weighted.generator.symmetric();
    (0..shifted.size).for_each(|i| shifted.add(i, i, -sigma));
    let k = weighted.generator.skew();
    let mut sum = vec![0.0; twin.size()];
    for l in 0..run.plan.modes {
        let factor = (sigma * time).exp() * run.plan.series.factor(l);
        let mu = run.plan.series.wavenumber(l);
        let mode = evolve(&shifted, &k, mu, &weighted.state, time);
        for (sum, w) in sum.iter_mut().zip(mode) {
            *sum += (factor * w).re;
        }
    }
    let unweighted = sum.iter().zip(&weighted.pi).map(|(u, pi)| u / pi.sqrt());
    unweighted.take(twin.cells).collect()
}
