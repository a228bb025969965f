//! Tests an inflow that depends on time, directly and mode by mode.

use crate::recovery::stream;
use crate::*;

/// Scenes with an inflow `b(1 + sin ωt)`, and `f(T)` by one dense exponential: `1`, `sin ωt` and `cos ωt` obey a linear system.
pub struct Varying {
    pub name: &'static str,
    pub twin: Twin,
    pub expected: Vec<f64>,
}

impl Varying {
    /// The problem of `case`, one like this scene's, on `mesh`; without a dense twin.
    pub fn weighted(&self, world: &World, case: &Case, mesh: &Mesh) -> Weighted {
        let communicator = Communicator::new(world, mesh);
        let block = Block::new(&case.space, mesh, communicator.space.rank());
        let allowed = Bounds::new(case).expect("V is finite");
        let sizes = (2 * LANES, 100);
        let problem = Problem::new(case, &allowed, &communicator, block, sizes)
            .expect("weights and steps are found");
        Weighted {
            number: numbers(&self.twin, &problem.matrix),
            bounds: problem.bounds(case, &allowed),
            communicator,
            problem,
            pi: Vec::new(),
            generator: Dense::zero(0),
            state: Vec::new(),
        }
    }

    pub fn all() -> Vec<Self> {
        let omega = 3.0;
        let scene = |name, file: &str, formula: &str, overrides: &[&str]| {
            let with = |time: &str| {
                let value = format!("inflow.value='({formula})*{time}'");
                let mut all = overrides.to_vec();
                all.push(&value);
                Twin::new(name, file, &all)
            };
            // The twin with the inflow at time zero gives A and b; its auxiliary unknowns are left alone.
            let constant = with("1");
            let cells = constant.cells;
            let system = System::of_rows(&constant.case);
            let mut dense = Dense::from_fn(cells + 3, |i, j| match i < cells && j < cells {
                true => system.generator.at(i, j),
                false => 0.0,
            });
            let mut state = constant.field(&constant.state).to_vec();
            for (i, &b) in system.inflow.iter().enumerate() {
                dense.add(i, cells, b);
                dense.add(i, cells + 1, b);
            }
            dense.add(cells + 1, cells + 2, omega);
            dense.add(cells + 2, cells + 1, -omega);
            state.extend([1.0, 0.0, 1.0]);
            let mut expected = exponential(&dense, &state, constant.case.end);
            expected.truncate(cells);
            let mut twin = with(&format!("(1 + sin({omega}*t))"));
            // Rows that draw on the inflow have an unknown, whatever enters now.
            if twin.case.warp.inflow == Embedding::Boundary {
                twin.inflow = (0..cells).filter(|&i| system.draw[i] > 0.0).collect();
            }
            let unknowns =
                twin.inflow.len() + usize::from(twin.case.warp.inflow == Embedding::Scalar);
            twin.generator = Dense::zero(cells + unknowns);
            Self {
                name,
                twin,
                expected,
            }
        };
        let slopes = [
            "axis.0.x.cells=7",
            "axis.0.v={lower=-1.0,upper=1.3,cells=9}",
        ];
        let with = |more: &[&'static str]| [&slopes[..], more].concat();
        let formula = "1 + x + 2*v";
        vec![
            scene("varying", "slope_jump.toml", formula, &with(&[])),
            scene(
                "varying, full",
                "slope_jump.toml",
                "0.9 + x + 2*v",
                &with(&["solver.warp.inflow='full'", "solver.warp.delta='max'"]),
            ),
            scene(
                "varying, scalar",
                "slope_jump.toml",
                "1.1 + x + 2*v",
                &with(&["solver.warp.inflow='scalar'"]),
            ),
            scene(
                "varying, two dimensions",
                "barrier2d.toml",
                "1 if x < -1.2 else 0",
                &[
                    "axis.0.x.cells=5",
                    "axis.0.v.cells=3",
                    "axis.1.x.cells=4",
                    "axis.1.v.cells=4",
                ],
            ),
        ]
    }
}

/// Duhamel's formula to round-off; forward Euler, SSP-RK3 and the commutator-free stages with their orders.
pub fn varying_inflow_directly(world: &World) {
    for scene in Varying::all() {
        let (case, expected) = (&scene.twin.case, &scene.expected);
        let time = case.end;
        for mesh in meshes(world, case) {
            let name = format!("{}, {mesh:?}", scene.name);
            let communicator = Communicator::new(world, &mesh);
            let block = Block::new(&case.space, &mesh, communicator.space.rank());
            let direct = Case {
                method: Method::Classical,
                ..case.clone()
            };
            let bounds = Bounds::new(&direct).expect("V is finite");
            let mut problem = Problem::new(&direct, &bounds, &communicator, block, (1, 100))
                .expect("no weights are needed");
            assert!(problem.schedule.is_none());
            let rate = bounds.rate;
            let number = numbers(&scene.twin, &problem.matrix);
            let cells = problem.matrix.block.cells();
            let pi = problem.weights.pi.clone();
            let mut run =
                |work: &mut dyn FnMut(&mut Classical<'_>, &mut GhostExchange, &mut [f64])| {
                    let mut state = problem.states[0].clone();
                    let mut classical =
                        Classical::new(&problem.matrix).with_source(&case.fields[0], &pi);
                    work(&mut classical, &mut problem.exchange, &mut state);
                    let entries = (0..cells).map(|i| (number[i], state[i]));
                    gather(&communicator.space, scene.twin.cells, entries)
                };
            let found = run(&mut |classical, exchange, state| {
                classical.duhamel(exchange, state, (rate, time), duhamel_panels(rate * time));
            });
            let error = distance(&found, expected);
            assert!(error <= 1e-12, "{name}: Duhamel {error:e}");
            report_bits(world, &format!("Duhamel of {}", scene.name), &found);

            let order =
                |name: &str, order: f64, coarse: usize, run: &mut dyn FnMut(usize) -> Vec<f64>| {
                    let errors = [coarse, 2 * coarse].map(|steps| distance(&run(steps), expected));
                    let found = (errors[0] / errors[1]).log2();
                    assert!(
                        (found - order).abs() < 0.25,
                        "{name}: order {found}, {errors:?}"
                    );
                };
            let steps = (8.0 * rate * time).ceil() as usize;
            for (integrator, theory) in [(Integrator::ForwardEuler, 1.0), (Integrator::SspRk3, 3.0)]
            {
                order(
                    &format!("{name}, {integrator:?}"),
                    theory,
                    steps,
                    &mut |steps| {
                        run(&mut |classical, exchange, state| {
                            classical.steps(exchange, state, integrator, time, steps);
                        })
                    },
                );
            }
            let block = Block::new(&case.space, &mesh, communicator.space.rank());
            let matrix = BlockMatrix::assemble(case, block).expect("finite formulas");
            order(&format!("{name}, commutator-free"), 4.0, 16, &mut |steps| {
                let values = time_dependent_inflow::stage_values(case, &matrix, steps);
                let rows = matrix.inflow.len();
                run(&mut |classical, exchange, state| {
                    for stage in 0..2 * steps {
                        let held = &values[stage * rows..(stage + 1) * rows];
                        classical.hold(held.iter().copied());
                        let part = time / (2 * steps) as f64;
                        classical.exponential(exchange, state, (rate, part), EXACT);
                    }
                })
            });
        }
    }
}

/// The streamed run with an inflow that varies, within its tolerance, its steps within their share of it; the same bits on
/// every mesh.
pub fn varying_inflow_by_modes(world: &World) {
    for mut scene in Varying::all() {
        for tolerance in [1e-4, 1e-8] {
            scene.twin.case.tolerance = tolerance;
            for mesh in meshes(world, &scene.twin.case) {
                let name = format!("{}, {mesh:?}, {tolerance:e}", scene.name);
                let twin = &scene.twin;
                let mut weighted = scene.weighted(world, &twin.case, &mesh);
                let (problem, bounds) = (&mut weighted.problem, &weighted.bounds);
                let schedule = problem.schedule.as_ref().expect("steps");
                assert!(
                    schedule.error <= time_dependent_inflow::TIME_SHARE * tolerance,
                    "{name}"
                );
                assert_eq!(bounds.stages, 2 * schedule.steps);
                let communicator = &weighted.communicator;
                let ratio = problem.probe(communicator, bounds.rate, &[twin.case.end]);
                let size = problem.norm(communicator, &problem.states[0], false);
                let (_, fields) = stream(world, &twin.case, &mesh, &mut weighted, ratio, size);
                let error = distance(&fields[0], &scene.expected);
                assert!(error <= tolerance, "{name}: error {error:e}");
                let name = format!("the field of {} at {tolerance:e}", scene.name);
                report_bits(world, &name, &fields.concat());
            }
        }
    }
}
