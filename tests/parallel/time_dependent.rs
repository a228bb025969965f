//! Tests an inflow that depends on time, in classical steps and by modes, against one dense
//! exponential.

use crate::bits::report_bits;
use crate::dense_twins::cells_of_axes;
use crate::pieces::{gather_cells, meshes};
use crate::streamed::StreamedRun;
use crate::support::dense::{Dense, System, case, distance, exponential, order_of};
use crate::support::prepared::{Prepared, block_of, prepare};
use phasewarp::matrix::block_matrix::BlockMatrix;
use phasewarp::parallel::communicator::{GhostExchange, World};
use phasewarp::problem::case::{Case, Integrator, Method};
use phasewarp::propagate::classical::{Classical, ClassicalSpan, EXACT, duhamel_panels};
use phasewarp::propagate::time_dependent_inflow;

/// How an inflow varies with time.
#[derive(Clone, Copy)]
enum Wave {
    /// `b(1 + sin ωt)`.
    Sine,
    /// `b(1 − cos ωt)`: no inflow at the start.
    FromNothing,
}

/// A case with a time-dependent inflow, and its exact field.
pub struct Varying {
    pub name: &'static str,
    pub case: Case,
    /// `f(T)`.
    expected: Vec<f64>,
}

const OMEGA: f64 = 3.0;

impl Varying {
    /// A case whose `b` comes from the inflow `formula`.
    fn new(name: &'static str, file: &str, cells: &[usize], formula: &str, set: &[&str]) -> Self {
        Self::with(Wave::Sine, name, file, cells, formula, set)
    }

    fn with(
        wave: Wave,
        name: &'static str,
        file: &str,
        cells: &[usize],
        formula: &str,
        set: &[&str],
    ) -> Self {
        let cells = cells_of_axes(cells);
        let with = |factor: &str| {
            let inflow = format!("inflow.value='({formula})*{factor}'");
            let cells = cells.iter().map(String::as_str);
            let all: Vec<&str> = cells.chain(set.iter().copied()).chain([&inflow[..]]).collect();
            case(file, &all)
        };
        let factor = match wave {
            Wave::Sine => format!("(1 + sin({OMEGA}*t))"),
            Wave::FromNothing => format!("(1 - cos({OMEGA}*t))"),
        };
        Self { name, expected: exact(&with("1"), wave), case: with(&factor) }
    }

    pub fn all() -> Vec<Self> {
        let velocities = "axis.0.v={lower=-1.0,upper=1.3,cells=9}";
        let slopes = |name, formula, set: &[&str]| {
            let set = [&[velocities], set].concat();
            Self::new(name, "slope_jump.toml", &[7], formula, &set)
        };
        let full = ["solver.warp.inflow='full'", "solver.warp.delta='max'"];
        let plane = "1 if x < -1.2 else 0";
        let elements = [
            "axis.0.v={lower=-1.0,upper=1.5,cells=5,degree=1}",
            "axis.0.x.degree=2",
            "initial.f='(2 + x)*(3 + v)'",
        ];
        vec![
            slopes("varying", "1 + x + 2*v", &[]),
            Self::with(
                Wave::FromNothing,
                "varying, from nothing",
                "slope_jump.toml",
                &[7],
                "1 + x + 2*v",
                &[velocities],
            ),
            slopes("varying, full", "0.9 + x + 2*v", &full),
            slopes("varying, scalar", "1.1 + x + 2*v", &["solver.warp.inflow='scalar'"]),
            Self::new("varying, two dimensions", "barrier2d.toml", &[5, 3, 4, 4], plane, &[]),
            Self::new("varying, elements", "slope_jump.toml", &[3], "1 + x + 2*v", &elements),
            Self::new(
                "varying, elements, full",
                "slope_jump.toml",
                &[3],
                "1.1 + x + 2*v",
                &[elements[0], elements[1], elements[2], full[0], full[1]],
            ),
            Self::new(
                "varying, elements, scalar",
                "slope_jump.toml",
                &[3],
                "1.2 + x + 2*v",
                &[elements[0], elements[1], elements[2], "solver.warp.inflow='scalar'"],
            ),
        ]
    }
}

/// `f(T)` by one dense exponential, as `f`, `1`, `sin ωt` and `cos ωt` satisfy a linear system.
/// `case` has the inflow `b` without its time factor.
fn exact(case: &Case, wave: Wave) -> Vec<f64> {
    let system = System::of_rows(case);
    let cells = system.generator.size;
    let (one, sine, cosine) = (cells, cells + 1, cells + 2);
    let mut dense: Dense = system.generator.enlarged(3);
    for (i, &b) in system.inflow.iter().enumerate() {
        dense.add(i, one, b);
        match wave {
            Wave::Sine => dense.add(i, sine, b),
            Wave::FromNothing => dense.add(i, cosine, -b),
        }
    }
    dense.add(sine, cosine, OMEGA);
    dense.add(cosine, sine, -OMEGA);
    let initial = &case.fields[0].initial;
    let value = |i| initial.eval(&case.space.point(&case.space.cell(i)));
    let state: Vec<f64> = (0..cells).map(value).chain([1.0, 0.0, 1.0]).collect();
    let mut expected = exponential(&dense, &state, case.end);
    expected.truncate(cells);
    expected
}

/// Duhamel's formula is exact to round-off. Forward Euler, SSP-RK3 and the commutator-free stages
/// converge with their orders.
pub fn varying_inflow_directly(world: &World) {
    for scene in Varying::all() {
        let time = scene.case.end;
        let direct = Case { method: Method::Classical, ..scene.case.clone() };
        for mesh in meshes(world, &scene.case) {
            let name = format!("{}, {mesh:?}", scene.name);
            let mut prepared = prepare(world, &direct, &mesh);
            assert!(prepared.system.schedule.is_none());
            let rate = prepared.bounds.rate;
            let found = solve(&mut prepared, &direct, |classical, exchange, state| {
                let span = ClassicalSpan { rate, time };
                classical.duhamel(exchange, state, span, &duhamel_panels(&direct, rate));
            });
            let error = distance(&found, &scene.expected);
            assert!(error <= 1e-12, "{name}: Duhamel {error:e}");
            report_bits(world, &format!("Duhamel of {}", scene.name), &found);

            let coarse = (8.0 * rate * time).ceil() as usize;
            for (integrator, order) in [(Integrator::ForwardEuler, 1.0), (Integrator::SspRk3, 3.0)]
            {
                let errors = [coarse, 2 * coarse].map(|steps| {
                    let found = solve(&mut prepared, &direct, |classical, exchange, state| {
                        classical.steps(exchange, state, integrator, time, steps);
                    });
                    distance(&found, &scene.expected)
                });
                check_order(&format!("{name}, {integrator:?}"), order, errors);
            }
            let block = block_of(&scene.case, &mesh, &prepared.communicator);
            let matrix = BlockMatrix::assemble(&scene.case, block).expect("finite formulas");
            let errors = [16, 32].map(|steps| {
                let found = commutator_free(&mut prepared, &direct, &matrix, steps);
                distance(&found, &scene.expected)
            });
            check_order(&format!("{name}, commutator-free"), 4.0, errors);
        }
    }
}

/// The second error is that of half the time step.
fn check_order(name: &str, order: f64, errors: [f64; 2]) {
    let found = order_of(errors, 2.0);
    assert!((found - order).abs() < 0.25, "{name}: order {found}, {errors:?}");
}

/// The whole field after `work` has propagated the classical system from time zero.
fn solve(
    prepared: &mut Prepared,
    case: &Case,
    work: impl FnOnce(&mut Classical<'_>, &mut GhostExchange, &mut [f64]),
) -> Vec<f64> {
    let system = &mut prepared.system;
    let mut state = system.states[0].clone();
    let mut classical =
        Classical::new(&system.matrix).with_source(&case.fields[0], &system.weights.pi);
    work(&mut classical, &mut system.exchange, &mut state);
    let cells = 0..system.matrix.block.cells();
    state.truncate(cells.end);
    let state = system.weights.unweighted(&cells, state);
    gather_cells(prepared, &state)
}

/// Propagates in steps of two stages, each with a constant inflow.
fn commutator_free(
    prepared: &mut Prepared,
    case: &Case,
    matrix: &BlockMatrix,
    steps: usize,
) -> Vec<f64> {
    let rate = prepared.bounds.rate;
    let part = case.end / (2 * steps) as f64;
    let values = time_dependent_inflow::stage_values(case, matrix, steps);
    let rows = matrix.inflow.len();
    let root = |m: usize| prepared.system.weights.pi[matrix.inflow[m].row as usize].sqrt();
    let roots: Vec<f64> = (0..rows).map(root).collect();
    solve(prepared, case, |classical, exchange, state| {
        for stage in 0..2 * steps {
            let held = &values[stage * rows..(stage + 1) * rows];
            classical.set_inflow(held.iter().zip(&roots).map(|(b, root)| b * root));
            classical.exponential(exchange, state, ClassicalSpan { rate, time: part }, EXACT);
        }
    })
}

/// A streamed run is within its tolerance, and its time steps within their share of it. It has the
/// same bits on every mesh.
pub fn varying_inflow_by_modes(world: &World) {
    for mut scene in Varying::all() {
        for tolerance in [1e-4, 1e-8] {
            scene.case.tolerance = tolerance;
            for mesh in meshes(world, &scene.case) {
                let name = format!("{}, {mesh:?}, {tolerance:e}", scene.name);
                let mut prepared = prepare(world, &scene.case, &mesh);
                let schedule = prepared.system.schedule.as_ref().expect("steps");
                assert!(schedule.error <= time_dependent_inflow::TIME_SHARE * tolerance, "{name}");
                assert_eq!(prepared.bounds.stages, 2 * schedule.steps);
                let ratio = prepared.probe();
                let run = StreamedRun::new(&scene.case, &mesh, ratio);
                let run = run.run_as_planned(world, &mut prepared);
                let fields = run.fields(world, &prepared);
                let error = distance(&fields[0], &scene.expected);
                assert!(error <= tolerance, "{name}: error {error:e}");
                let name = format!("the field of {} at {tolerance:e}", scene.name);
                report_bits(world, &name, &fields.concat());
            }
        }
    }
}

/// A short pulse lies between the sampling times of the first attempts, which agree without it. The
/// steps of the run still resolve it.
pub fn short_pulses_are_seen(world: &World) {
    let cells = cells_of_axes(&[7]);
    let with = |inflow: &str| {
        let cells = cells.iter().map(String::as_str);
        let velocities = "axis.0.v={lower=-1.0,upper=1.3,cells=9}";
        let all: Vec<&str> = cells.chain([velocities, inflow]).collect();
        case("slope_jump.toml", &all)
    };
    let end = with("inflow.value='0'").end;
    let (at, width) = (0.375 * end, 0.003 * end);
    let pulse = format!("inflow.value='(1 + x + 2*v)*exp(-((t - {at})/{width})^2)'");
    let case = Case { tolerance: 1e-4, ..with(&pulse) };
    for mesh in meshes(world, &case) {
        let prepared = prepare(world, &case, &mesh);
        let matrix = &prepared.system.matrix;
        let schedule = prepared.system.schedule.as_ref().expect("steps");
        let values = time_dependent_inflow::stage_values(&case, matrix, schedule.steps);
        let stage = end / schedule.stages() as f64;
        for (m, most) in matrix.entering.values(&case.fields[0], at).enumerate() {
            let held = values.iter().skip(m).step_by(matrix.inflow.len());
            let found = stage * held.sum::<f64>();
            let expected = most * width * std::f64::consts::PI.sqrt();
            let error = (found - expected).abs();
            assert!(error <= 1e-3 * expected.abs(), "{mesh:?}, row {m}: {found}, {expected}");
        }
    }
}
