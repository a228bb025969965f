//! Tests what the streamed run recovers from the modes, by every profile and propagator.

use crate::time_dependent::Varying;
use crate::*;

/// How a field is recovered: profile, reading, coefficients, tolerance, propagator and its number of steps.
pub type Recovery = (
    ProfileChoice,
    RecoveryMethod,
    Coefficients,
    f64,
    PropagatorMethod,
    Option<u32>,
);

/// Profiles, readings and coefficients, with tolerances that each can afford here; propagators.
pub const RECOVERIES: [Recovery; 15] = {
    use Coefficients::{Analytic, Sampled};
    use ProfileChoice::{Acl, Designed, Exponential, Gaussian, LowSomma, Planned, Smooth};
    use PropagatorMethod::{BackwardEuler, Chebyshev, CrankNicolson, Krylov};
    use RecoveryMethod::{Integral, LeastSquares, Point};
    [
        (Designed, Point, Analytic, 1e-9, Chebyshev, None),
        (Designed, Integral, Analytic, 1e-7, Chebyshev, None),
        (Planned, LeastSquares, Analytic, 1e-6, Chebyshev, None),
        (Designed, Point, Analytic, 1e-9, Krylov, None),
        (Gaussian, Point, Analytic, 1e-4, Chebyshev, None),
        (Gaussian, Point, Analytic, 1e-9, Chebyshev, None),
        (Gaussian, LeastSquares, Sampled, 1e-6, Chebyshev, None),
        (LowSomma { c: None }, Point, Analytic, 1e-8, Chebyshev, None),
        (
            LowSomma { c: None },
            Integral,
            Sampled,
            1e-5,
            Chebyshev,
            None,
        ),
        (Smooth { order: 8 }, Point, Sampled, 1e-4, Chebyshev, None),
        (
            Exponential { alpha: 1.0 },
            Point,
            Sampled,
            3e-2,
            Chebyshev,
            None,
        ),
        (
            Acl { beta: 0.75 },
            LeastSquares,
            Analytic,
            3e-2,
            Chebyshev,
            None,
        ),
        (Gaussian, Point, Analytic, 1e-9, Krylov, None),
        (Gaussian, Point, Analytic, 1e-4, CrankNicolson, Some(20)),
        (Gaussian, Point, Analytic, 1e-3, BackwardEuler, Some(40)),
    ]
};

/// What each mode group keeps of a block's cells: a piece of its first axis.
pub fn shares(block: &Block, groups: usize) -> Vec<Range<usize>> {
    let leading = block.ranges[0].len();
    let layer = block.cells() / leading;
    (0..groups)
        .map(|group| split(&(0..leading), groups, group))
        .map(|piece| piece.start * layer..piece.end * layer)
        .collect()
}

/// What the streamed run recovers on this mesh, whole and without weights, by each reading; and its plan.
pub fn stream(
    world: &World,
    case: &Case,
    mesh: &Mesh,
    weighted: &mut Weighted,
    ratio: f64,
    norm: f64,
) -> (WarpPlan, Vec<Vec<f64>>) {
    let own = |plan: &Plan, group: usize| plan.layout.groups[group].clone();
    let (plan, fields, applications) = stream_in(world, case, mesh, weighted, (ratio, norm), own);
    assert_eq!(applications, plan.applications);
    (plan, fields)
}

/// The same with the batches that `batches` gives each mode group; and the applications it took.
pub fn stream_in(
    world: &World,
    case: &Case,
    mesh: &Mesh,
    weighted: &mut Weighted,
    (ratio, norm): (f64, f64),
    batches: impl Fn(&Plan, usize) -> Vec<Batch>,
) -> (WarpPlan, Vec<Vec<f64>>, usize) {
    let problem = &mut weighted.problem;
    let resources = Resources {
        ranks: world.group().size(),
        ranks_x: Some(mesh.space.clone()),
        memory_per_rank: None,
    };
    let plan = Plan::with_bounds(case, weighted.bounds.clone(), &resources, ratio).expect("a plan");
    assert_eq!(plan.layout.mesh, *mesh);
    let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");
    let rows = problem.matrix.rows();
    let initial = Initial::real(&problem.states[0][..rows], norm);
    let setting = plan.propagator_setting(warp_plan);
    let mut propagator =
        propagator(&setting, problem.schedule.as_ref(), &problem.matrix).expect("a propagator");
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &weighted.communicator.space,
        rate: weighted.bounds.rate,
        growth: weighted.bounds.growth,
        time: case.end,
        terms: problem.terms,
    };
    let shares = shares(&problem.matrix.block, mesh.groups);
    let group = weighted.communicator.modes.rank();
    let recovered = modes::run(
        &Task {
            communicator: &weighted.communicator,
            warp: warp_plan,
            legs: &[Leg {
                time: system.time,
                moments_only: false,
            }],
            batches: &batches(&plan, group),
            initial: &[initial],
            shares: &shares,
            moments: None,
        },
        &mut system,
        &mut *propagator,
        &mut Progress::silent(),
        Besides::default(),
    )
    .expect("a unitary run");
    assert!(recovered.unitarity_defect.unwrap_or(0.0) <= 1.0);
    let applications = weighted
        .communicator
        .modes
        .sum_count(recovered.applications);
    let fields = recovered.fields[0].iter().map(|field| {
        assert_eq!(field.len(), shares[group].clone().len());
        let entries = shares[group]
            .clone()
            .zip(field)
            .map(|(i, u)| (weighted.number[i], u / problem.weights.pi[i].sqrt()));
        gather(&world.group(), case.space.cells(), entries)
    });
    (warp_plan.clone(), fields.collect(), applications)
}

/// The streamed run by every profile and propagator: within its tolerance of `exp(AT) f0`, or as far from it as the
/// step's error says; with the same bits on every mesh, or for every number of mode groups.
pub fn recovered_field(world: &World) {
    use PropagatorMethod::{BackwardEuler, Chebyshev, CrankNicolson, Krylov};
    let ranks = world.group().size();
    for mut twin in Twin::all() {
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        let expected = twin.field(&expected);
        for (profile, recovery, coefficients, tolerance, method, steps) in RECOVERIES {
            // What one unknown shares with all rows, only the Chebyshev series applies.
            if twin.case.warp.inflow == Embedding::Scalar && method != Chebyshev {
                continue;
            }
            twin.case.tolerance = tolerance;
            twin.case.warp.profile = profile;
            twin.case.warp.recovery_method = recovery;
            twin.case.warp.coefficients = coefficients;
            twin.case.propagator = Propagation {
                method,
                step: steps.map(|n| time / f64::from(n)),
            };
            let what =
                format!("{profile:?}, {recovery:?}, {coefficients:?}, {tolerance:e}, {method:?}");
            let mut unsplit: Option<Vec<f64>> = None;
            // The mesh that does not split space first.
            let mut meshes = meshes(world, &twin.case);
            meshes.sort_by_key(Mesh::blocks);
            for mesh in meshes {
                let name = format!("{}, {mesh:?}, {what}", twin.name);
                let mut weighted = Weighted::new(world, &twin, &mesh);
                let problem = &mut weighted.problem;
                let ratio = problem.probe(&weighted.communicator, weighted.bounds.rate, &[time]);
                let truth = norm(&weighted.state) / norm(expected);
                assert!(
                    (truth..1.5 * truth).contains(&ratio),
                    "{name}: {ratio} {truth}"
                );
                let resources = Resources {
                    ranks,
                    ranks_x: Some(mesh.space.clone()),
                    memory_per_rank: None,
                };
                let plan =
                    Plan::with_bounds(&twin.case, weighted.bounds.clone(), &resources, ratio)
                        .expect("a plan");
                assert_eq!(plan.layout.mesh, mesh);
                let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");

                let rows = problem.matrix.rows();
                let initial = Initial::real(&problem.states[0][..rows], norm(&weighted.state));
                let mut propagator =
                    propagator(&plan.propagator_setting(warp_plan), None, &problem.matrix)
                        .expect("a propagator");
                let mut system = Evolution {
                    matrix: &problem.matrix,
                    exchange: &mut problem.exchange,
                    space: &weighted.communicator.space,
                    rate: weighted.bounds.rate,
                    growth: weighted.bounds.growth,
                    time,
                    terms: problem.terms,
                };
                let shares = shares(&problem.matrix.block, mesh.groups);
                let group = weighted.communicator.modes.rank();
                let batches = &plan.layout.groups[group];
                let recovered = modes::run(
                    &Task {
                        communicator: &weighted.communicator,
                        warp: warp_plan,
                        legs: &[Leg {
                            time: system.time,
                            moments_only: false,
                        }],
                        batches,
                        initial: &[initial],
                        shares: &shares,
                        moments: None,
                    },
                    &mut system,
                    &mut *propagator,
                    &mut Progress::silent(),
                    Besides::default(),
                )
                .expect("a unitary run");
                let planned = batches.iter().flat_map(|b| &b.modes);
                let planned: usize = planned.map(|&l| warp_plan.work[l]).sum();
                let (applications, solves) = (recovered.applications, recovered.solves);
                match method {
                    Chebyshev => assert_eq!((applications, solves), (planned, 0), "{name}"),
                    Krylov => assert!(applications <= planned && solves == 0, "{name}"),
                    _ => assert_eq!(solves, planned, "{name}"),
                }
                // Who keeps norms is checked for it; what is lost is reported.
                let kept = recovered.norm_kept.expect("a state that is not zero");
                match recovered.unitarity_defect {
                    Some(defect) => assert!(defect <= 1.0 && method != BackwardEuler, "{name}"),
                    None => assert!(method == BackwardEuler && kept < 0.9999, "{name}: {kept}"),
                }
                let loss = 1.0 - kept;
                assert!(
                    method != CrankNicolson || loss.abs() < 1e-11,
                    "{name}: {loss}"
                );

                assert_eq!(recovered.fields[0].len(), 2);
                let all = |field: &Vec<f64>| {
                    assert_eq!(field.len(), shares[group].clone().len());
                    let entries = shares[group].clone().zip(field).map(|(i, u)| {
                        let number = weighted.number[i];
                        (number, u / weighted.pi[number].sqrt())
                    });
                    gather(&world.group(), twin.cells, entries)
                };
                let fields: Vec<Vec<f64>> = recovered.fields[0].iter().map(all).collect();
                let error = distance(&fields[0], expected);
                if steps.is_some() {
                    let leading = norm(&all(&recovered.step_errors[0])) / norm(expected);
                    let found = leading / error;
                    assert!((0.5..2.0).contains(&found), "{name}: {leading:e} {error:e}");
                    let name = format!("the field of {} by {method:?}", twin.name);
                    if mesh.blocks() == 1 {
                        report_bits(world, &name, &fields.concat());
                    }
                    let unsplit = unsplit.get_or_insert_with(|| fields[0].clone());
                    let difference = distance(&fields[0], unsplit);
                    // Residuals of round-off, amplified by the recovery.
                    let amplified =
                        warp_plan.amplification * norm(&weighted.state) / norm(expected);
                    let allowed = 2e-16 * f64::from(steps.unwrap_or(0)) * amplified;
                    assert!(
                        difference <= allowed,
                        "{name}, {mesh:?}: {difference:e} {allowed:e}"
                    );
                    continue;
                }
                assert!(recovered.step_errors.is_empty(), "{name}");
                assert!(error <= tolerance, "{name}: error {error:e}");
                // The second recovery point tells how large it is.
                let estimate =
                    distance(&fields[1], &fields[0]) / warp_plan.estimator_efficiency / error;
                let factor = if profile == ProfileChoice::Gaussian {
                    3.0
                } else {
                    5.0
                };
                assert!(
                    (1.0 / factor..factor).contains(&estimate),
                    "{name}: {estimate}"
                );
                let name = format!("the field of {} by {what}", twin.name);
                report_bits(world, &name, &fields.concat());
            }
        }
    }
}

/// Modes dealt to the groups one by one, in batches of 1 to 8 of no order.
pub fn mixed(plan: &Plan, group: usize) -> Vec<Batch> {
    let (modes, groups) = (
        plan.warp.as_ref().map_or(0, |w| w.modes),
        plan.layout.groups.len(),
    );
    let mut mine: Vec<usize> = (0..modes).filter(|l| l % groups == group).collect();
    // Far ones side by side.
    mine.sort_by_key(|l| (7 * l) % 11);
    let mut batches = Vec::new();
    while !mine.is_empty() {
        let count = (batches.len() % LANES + 1).min(mine.len());
        let modes: Vec<usize> = mine.drain(..count).collect();
        batches.push(Batch { modes, cost: 0 });
    }
    batches
}

/// What is read at output times, fields and moments alone, is within the tolerance of `exp(At) f0` there, by every propagator,
/// with the same bits on every mesh that may have them; and the moments are those of the field.
pub fn results_before_the_end(world: &World) {
    use PropagatorMethod::{Chebyshev, CrankNicolson, Krylov};
    const PARTS: [(f64, bool); 3] = [(0.23, true), (0.4, false), (0.71, true)];
    let ranks = world.group().size();
    for mut twin in Twin::all() {
        let time = twin.case.end;
        twin.case.times = PARTS
            .map(|(part, fields)| OutputTime {
                time: part * time,
                fields,
            })
            .to_vec();
        let legs = Leg::all(&twin.case);
        assert_eq!(
            legs.iter().map(|l| l.moments_only).collect::<Vec<_>>(),
            [false, true, false, false]
        );
        let exact = [0.23, 0.4, 0.71, 1.0].map(|part| {
            twin.field(&exponential(&twin.generator, &twin.state, part * time))
                .to_vec()
        });
        let factors = VelocityFactors::new(&twin.case.space);
        for (method, tolerance) in [(Chebyshev, 1e-9), (Krylov, 1e-5), (CrankNicolson, 1e-3)] {
            if twin.case.warp.inflow == Embedding::Scalar && method != Chebyshev {
                continue;
            }
            twin.case.tolerance = tolerance;
            twin.case.propagator = Propagation {
                method,
                step: (method == CrankNicolson).then_some(time / 90.0),
            };
            for mesh in meshes(world, &twin.case) {
                if method == CrankNicolson && mesh.blocks() > 1 {
                    continue;
                }
                let name = format!("{}, {mesh:?}, {method:?}", twin.name);
                let mut weighted = Weighted::new(world, &twin, &mesh);
                let problem = &mut weighted.problem;
                let ratio = problem.probe(
                    &weighted.communicator,
                    weighted.bounds.rate,
                    &twin.case.legs(),
                );
                let largest = exact
                    .iter()
                    .map(|f| norm(&weighted.state) / norm(f))
                    .fold(1.0, f64::max);
                assert!(
                    (largest..1.5 * largest).contains(&ratio),
                    "{name}: {ratio} {largest}"
                );
                let resources = Resources {
                    ranks,
                    ranks_x: Some(mesh.space.clone()),
                    memory_per_rank: None,
                };
                let plan =
                    Plan::with_bounds(&twin.case, weighted.bounds.clone(), &resources, ratio)
                        .expect("a plan");
                let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");
                let rows = problem.matrix.rows();
                let initial = Initial::real(&problem.states[0][..rows], norm(&weighted.state));
                let mut propagator =
                    propagator(&plan.propagator_setting(warp_plan), None, &problem.matrix)
                        .expect("a propagator");
                let shares = shares(&problem.matrix.block, mesh.groups);
                let group = weighted.communicator.modes.rank();
                let mut system = Evolution {
                    matrix: &problem.matrix,
                    exchange: &mut problem.exchange,
                    space: &weighted.communicator.space,
                    rate: weighted.bounds.rate,
                    growth: weighted.bounds.growth,
                    time,
                    terms: problem.terms,
                };
                let moments = MomentsOf {
                    factors: &factors,
                    pi: &problem.weights.pi[..problem.matrix.block.cells()],
                };
                let recovered = modes::run(
                    &Task {
                        communicator: &weighted.communicator,
                        warp: warp_plan,
                        legs: &legs,
                        batches: &plan.layout.groups[group],
                        initial: &[initial],
                        shares: &shares,
                        moments: Some(&moments),
                    },
                    &mut system,
                    &mut *propagator,
                    &mut Progress::silent(),
                    Besides::default(),
                )
                .expect("a unitary run");
                let planned: usize = plan.layout.groups[group]
                    .iter()
                    .flat_map(|b| &b.modes)
                    .map(|&l| warp_plan.work[l])
                    .sum();
                match method {
                    Chebyshev => assert_eq!(recovered.applications, planned, "{name}"),
                    Krylov => assert!(recovered.applications <= planned, "{name}"),
                    _ => assert_eq!(recovered.solves, planned, "{name}"),
                }
                let all = |u: &[f64]| {
                    let entries = shares[group].clone().zip(u).map(|(i, u)| {
                        let number = weighted.number[i];
                        (number, u / weighted.pi[number].sqrt())
                    });
                    gather(&world.group(), twin.cells, entries)
                };
                let early = &recovered.early[0];
                let mut bits = Vec::new();
                for (found, exact) in [
                    (&early[0], &exact[0]),
                    (&early[2], &exact[2]),
                    (&recovered.fields[0][0], &exact[3]),
                ] {
                    let found = all(found);
                    let error = distance(&found, exact);
                    assert!(error <= tolerance, "{name}: {error:e}");
                    // The tolerance is not met by standing still.
                    assert!(
                        distance(twin.field(&twin.state), exact) > 10.0 * tolerance,
                        "{name}"
                    );
                    bits.extend(found);
                }
                // Sums over the velocities at each point, gathered as if they were the first cells there.
                let nv = factors.cells();
                let (sums, _) = early[1].as_chunks::<MOMENTS>();
                assert_eq!(sums.len() * nv, shares[group].len(), "{name}");
                let size = norm(&exact[1]);
                let exact: Vec<[f64; MOMENTS]> = factors.at_points(&exact[1]).collect();
                for m in 0..MOMENTS {
                    let entries = shares[group]
                        .clone()
                        .step_by(nv)
                        .zip(sums)
                        .map(|(i, sums)| (weighted.number[i] / nv, sums[m]));
                    let found = gather(&world.group(), twin.cells / nv, entries);
                    let exact: Vec<f64> = exact.iter().map(|sums| sums[m]).collect();
                    let apart: Vec<f64> = found.iter().zip(&exact).map(|(a, b)| a - b).collect();
                    // A sum of so many velocities, each in its own direction off.
                    let allowed = tolerance * factors.norms()[m] * size;
                    assert!(
                        norm(&apart) <= allowed,
                        "{name}, moment {m}: {:e} {allowed:e}",
                        norm(&apart)
                    );
                    assert!(
                        m > 0 || norm(&exact) > 100.0 * allowed,
                        "{name}, moment {m}"
                    );
                    bits.extend(found);
                }
                report_bits(
                    world,
                    &format!("results before the end of {} by {method:?}", twin.name),
                    &bits,
                );
            }
        }
    }
}

/// Where the modes of a batch are independent, or go one after the other, the field has the same bits and takes as many
/// applications whatever modes are together; a Krylov basis, whose dimension is that of the longest, is seen to have others.
pub fn modes_in_any_company(world: &World) {
    let methods = [
        (PropagatorMethod::Chebyshev, None),
        (PropagatorMethod::CrankNicolson, Some(5.0)),
        (PropagatorMethod::Krylov, None),
    ];
    for (method, steps) in methods {
        let mut alike = true;
        for mut twin in Twin::unshared() {
            let time = twin.case.end;
            twin.case.tolerance = 1e-4;
            twin.case.propagator = Propagation {
                method,
                step: steps.map(|n| time / n),
            };
            for mesh in meshes(world, &twin.case) {
                let mut weighted = Weighted::new(world, &twin, &mesh);
                let size = norm(&weighted.state);
                let mut run = |batches: fn(&Plan, usize) -> Vec<Batch>| {
                    let case = &twin.case;
                    let found = stream_in(world, case, &mesh, &mut weighted, (2.0, size), batches);
                    let bits = found.1.concat().into_iter().map(f64::to_bits);
                    (bits.collect::<Vec<u64>>(), found.2)
                };
                let planned = run(|plan, group| plan.layout.groups[group].clone());
                let mixed = run(mixed);
                let same = planned == mixed;
                alike &= same;
                let name = format!("{}, {mesh:?}, {method:?}", twin.name);
                assert!(
                    same || descriptor(method).batch_coupling() == BatchCoupling::Coupled,
                    "{name}"
                );
            }
        }
        assert_eq!(
            alike,
            descriptor(method).batch_coupling() != BatchCoupling::Coupled,
            "{method:?}"
        );
    }
    for scene in Varying::all() {
        let mut case = scene.twin.case.clone();
        case.tolerance = 1e-4;
        for mesh in meshes(world, &case) {
            let mut weighted = scene.weighted(world, &case, &mesh);
            let size =
                (weighted.problem).norm(&weighted.communicator, &weighted.problem.states[0], false);
            let mut run = |batches: fn(&Plan, usize) -> Vec<Batch>| {
                let found = stream_in(world, &case, &mesh, &mut weighted, (2.0, size), batches);
                let bits = found.1.concat().into_iter().map(f64::to_bits);
                (bits.collect::<Vec<u64>>(), found.2)
            };
            let planned = run(|plan, group| plan.layout.groups[group].clone());
            assert!(run(mixed) == planned, "{}, {mesh:?}", scene.name);
        }
    }
}

/// Several fields on one matrix and in one pass over the modes have the bits they have alone, on every mesh the same.
pub fn fields_in_one_pass(world: &World) {
    let sizes = [("x", 0, 4), ("v", 0, 3), ("x", 1, 5), ("v", 1, 4)];
    let mut settings: Vec<String> = (sizes.iter())
        .map(|(kind, axis, cells)| format!("axis.{axis}.{kind}.cells={cells}"))
        .collect();
    settings.push("solver.tolerance=1e-5".to_owned());
    let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
    let case = case("example3.toml", &settings);
    assert_eq!(case.fields.len(), 3);
    for mesh in meshes(world, &case) {
        let communicator = Communicator::new(world, &mesh);
        let block = Block::new(&case.space, &mesh, communicator.space.rank());
        let bounds = Bounds::new(&case).expect("V is finite");
        let sizes = (2 * LANES, 100);
        let mut problem =
            Problem::new(&case, &bounds, &communicator, block, sizes).expect("weights are found");
        let bounds = problem.bounds(&case, &bounds);
        let resources = Resources {
            ranks: world.group().size(),
            ranks_x: Some(mesh.space.clone()),
            memory_per_rank: None,
        };
        let plan = Plan::with_bounds(&case, bounds.clone(), &resources, 2.0).expect("a plan");
        let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");
        let rows = problem.matrix.rows();
        let initial: Vec<Initial<'_>> = (problem.states.iter())
            .map(|state| Initial::real(&state[..rows], problem.norm(&communicator, state, false)))
            .collect();
        let shares = shares(&problem.matrix.block, mesh.groups);
        let mut system = Evolution {
            matrix: &problem.matrix,
            exchange: &mut problem.exchange,
            space: &communicator.space,
            rate: bounds.rate,
            growth: bounds.growth,
            time: case.end,
            terms: problem.terms,
        };
        let mut recover = |initial: &[Initial<'_>]| {
            let mut propagator =
                propagator(&plan.propagator_setting(warp_plan), None, system.matrix)
                    .expect("a propagator");
            let recovered = modes::run(
                &Task {
                    communicator: &communicator,
                    warp: warp_plan,
                    legs: &[Leg {
                        time: system.time,
                        moments_only: false,
                    }],
                    batches: &plan.layout.groups[communicator.modes.rank()],
                    initial,
                    shares: &shares,
                    moments: None,
                },
                &mut system,
                &mut *propagator,
                &mut Progress::silent(),
                Besides::default(),
            );
            recovered.expect("a unitary run")
        };
        let together = recover(&initial);
        assert_eq!(together.fields.len(), 3);
        let mut applications = 0;
        for (k, field) in initial.iter().enumerate() {
            let alone = recover(std::slice::from_ref(field));
            applications += alone.applications;
            for (a, b) in alone.fields[0].iter().zip(&together.fields[k]) {
                let same = a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "field {k}, {mesh:?}");
                let moves = a.iter().any(|a| *a != 0.0);
                assert!(moves || a.is_empty(), "field {k}, {mesh:?}");
            }
        }
        assert_eq!(together.applications, applications);
    }
}

/// A run with `u = e^{σt} ũ` against the sum over the modes of a matrix that really is `A − σ`: the program shifts only what it
/// reads.
pub fn shifted_field(world: &World) {
    for (sigma, name) in [(0.8, "slopes, inflow"), (-0.5, "example 1")] {
        let mut twin = (Twin::all().into_iter().find(|t| t.name == name)).expect("a twin");
        let time = twin.case.end;
        twin.case.warp.shift = Shift::Given(sigma);
        twin.case.tolerance = 1e-7;
        let mut reference: Option<Vec<f64>> = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let size = norm(&weighted.state);
            let (plan, fields) = stream(world, &twin.case, &mesh, &mut weighted, 3.0, size);
            let twin = &twin;
            let reference = reference.get_or_insert_with(|| {
                let mut shifted = weighted.generator.symmetric();
                (0..shifted.size).for_each(|i| shifted.add(i, i, -sigma));
                let k = weighted.generator.skew();
                let mut sum = vec![0.0; twin.size()];
                for l in 0..plan.modes {
                    let mu = plan.series.wavenumber(l);
                    // e^{σT} e^{p◇} ṽ(p◇) at p◇ = 0.
                    let factor = (sigma * time).exp() * plan.series.factor(l);
                    let mode = evolve(&shifted, &k, mu, &weighted.state, time);
                    for (sum, w) in sum.iter_mut().zip(mode) {
                        *sum += (factor * w).re;
                    }
                }
                let unweighted = sum.iter().zip(&weighted.pi).map(|(u, pi)| u / pi.sqrt());
                unweighted.take(twin.cells).collect()
            });
            let error = distance(&fields[0], reference);
            // But for the series, each cut at its share.
            assert!(error <= 1e-8, "{name}, {mesh:?}: {error:e}");
            let expected = exponential(&twin.generator, &twin.state, time);
            let error = distance(&fields[0], twin.field(&expected));
            assert!(error <= 1e-7, "{name}, {mesh:?}: {error:e}");
        }
    }
}
