//! Tests each propagator of a mode against `exp(−i(μS + iK)T) u` by Taylor series.

use crate::*;

/// Wavenumbers of a batch, from none to more than plans ask for.
pub const WAVENUMBERS: [f64; LANES] = [0.0, 0.05, 0.3, 1.0, 2.0, 4.0, 9.0, 20.0];

/// `exp(−i(μS + iK)T) u` for each of `wavenumbers` by Taylor series, the work dealt out to the ranks.
pub fn references(
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

/// `√Σ|x_i|²`.
pub fn size(x: &[Complex64]) -> f64 {
    x.iter().map(|z| z.norm_sqr()).sum::<f64>().sqrt()
}

/// `‖x − y‖`.
pub fn apart(x: &[Complex64], y: &[Complex64]) -> f64 {
    let difference: Vec<Complex64> = x.iter().zip(y).map(|(a, b)| a - b).collect();
    size(&difference)
}

impl Weighted {
    /// Propagates the state with `wavenumbers` over `time`; the report, and `w(T)` and the leading term of its error for each
    /// mode, by the numbers of the twin.
    pub fn propagate(
        &mut self,
        propagator: &mut dyn Propagator,
        batch: &BatchSpec,
        time: f64,
    ) -> (BatchReport, Vec<Vec<Complex64>>, Vec<Vec<Complex64>>) {
        let (rows, unknowns) = (self.problem.matrix.rows(), self.state.len());
        let mut system = Evolution {
            matrix: &self.problem.matrix,
            exchange: &mut self.problem.exchange,
            space: &self.communicator.space,
            rate: self.bounds.rate,
            growth: self.bounds.growth,
            time,
            terms: self.problem.terms,
        };
        let initial = Initial::real(&self.problem.states[0][..rows], norm(&self.state));
        let report = (propagator.propagate(&mut system, batch, &initial)).expect("it converges");
        let all = |lanes: &[Lanes], l: usize, phase: Complex64| -> Vec<Complex64> {
            let part = |part: usize| {
                let counted = 0..self.problem.matrix.counted_rows();
                let entries = counted.map(|i| (self.number[i], lanes[i].0[part * LANES + l]));
                gather(&self.communicator.space, unknowns, entries)
            };
            (part(0).iter().zip(&part(1)))
                .map(|(&re, &im)| Complex64::new(re, im) * phase)
                .collect()
        };
        let state = |l: usize| all(propagator.state(), l, report.phases[l]);
        let error = |l: usize| all(propagator.step_error()?, l, report.phases[l]).into();
        (
            report,
            (0..batch.modes).map(state).collect(),
            (0..batch.modes).filter_map(error).collect(),
        )
    }
}

/// Against `exp(−i(μS + iK)T) u`; the norm is kept; a series that is cut keeps the promise of its tail.
pub fn chebyshev_propagation(world: &World) {
    for twin in Twin::all() {
        let time = twin.case.end;
        // The weights are the same on any mesh, and so is the reference.
        let mut reference = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let reference =
                reference.get_or_insert_with(|| references(world, &weighted, &WAVENUMBERS, time));
            let Bounds { rate, growth, .. } = weighted.bounds;
            let degrees = |tail: f64| {
                let mut series = Vec::new();
                WAVENUMBERS.map(|mu| {
                    let tau = Interval::new(mu, rate, growth).half_width * time;
                    bessel_series(&mut series, tau, tail);
                    series.len() - 1
                })
            };
            let whole = degrees(1e-16).into_iter().max().unwrap_or(0);
            let matrix = &weighted.problem.matrix;
            let shape = BlockingShape {
                depth: 5,
                width: 2,
                parts: 2,
            };
            let blocking = Blocking::possible(matrix).then(|| Blocking::new(matrix, &shape));
            let mut chebyshev = Chebyshev::blocked(matrix, whole, None);
            let mut blocked = Chebyshev::blocked(matrix, whole, blocking);
            for tolerance in [1e-16, 1e-6] {
                let work = degrees(tolerance);
                let batch = BatchSpec {
                    modes: LANES,
                    wavenumbers: WAVENUMBERS,
                    tolerances: [tolerance; LANES],
                    work,
                };
                let (report, found, errors) = weighted.propagate(&mut chebyshev, &batch, time);
                assert!(errors.is_empty() && report.solves == 0);
                assert_eq!(report.applications, work.iter().sum::<usize>());
                let (_, same, _) = weighted.propagate(&mut blocked, &batch, time);
                assert!(same == found, "{}, {mesh:?}: blocked", twin.name);
                let full = norm(&weighted.state);
                for l in 0..LANES {
                    let error = apart(&found[l], &reference[l]) / full;
                    let change = size(&found[l]) / full - 1.0;
                    let tail = report.tails[l];
                    let at = format!(
                        "{}, {mesh:?}, mu = {}, degree {}: error {error:e}, tail {tail:e}, norm {change:e}",
                        twin.name, WAVENUMBERS[l], work[l]
                    );
                    assert!(
                        error <= 1e-12 + tail && change.abs() <= 1e-12 + tail,
                        "{at}"
                    );
                    // Each series is long enough for its lane, and no longer.
                    assert!(tail <= tolerance * (1.0 + 1e-9) + 1e-15, "{at}");
                    assert!(tolerance < 1e-9 || tail > 1e-9, "{at}");
                }
            }
        }
    }
}

/// The Krylov propagator meets each mode's tolerance, takes no more applications than planned, keeps norms, and has the
/// same bits on every mesh.
pub fn krylov_propagation(world: &World) {
    for mut twin in Twin::unshared() {
        let time = twin.case.end;
        let mut reference = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let reference =
                reference.get_or_insert_with(|| references(world, &weighted, &WAVENUMBERS, time));
            for (tolerance, step) in [(1e-11, None), (1e-4, Some(0.03 * time))] {
                twin.case.propagator = Propagation {
                    method: PropagatorMethod::Krylov,
                    step,
                };
                let mut krylov = Krylov::new(&weighted.problem.matrix, step);
                let mut scratch = Vec::new();
                let planned = WAVENUMBERS.map(|mu| {
                    let span = Span { time, tolerance };
                    let (propagation, bounds) = (&twin.case.propagator, &weighted.bounds);
                    work(propagation, bounds, mu, span, &mut scratch)
                });
                let batch = BatchSpec {
                    modes: LANES,
                    wavenumbers: WAVENUMBERS,
                    tolerances: [tolerance; LANES],
                    work: [0; LANES],
                };
                let (report, found, errors) = weighted.propagate(&mut krylov, &batch, time);
                assert!(errors.is_empty() && report.solves == 0 && report.unitary);
                let full = norm(&weighted.state);
                for l in 0..LANES {
                    let error = apart(&found[l], &reference[l]) / full;
                    let change = size(&found[l]) / full - 1.0;
                    let at = format!(
                        "{}, {mesh:?}, mu = {}, tolerance {tolerance:e}: error {error:e}, bound {:e}, norm {change:e}",
                        twin.name, WAVENUMBERS[l], report.tails[l]
                    );
                    assert!(report.tails[l] <= tolerance * (1.0 + 1e-9) + 1e-13, "{at}");
                    assert!(error <= 1e-12 + report.tails[l], "{at}");
                    assert!(change.abs() <= 1e-12, "{at}");
                }
                let most = planned.into_iter().max().unwrap_or(0);
                let took = report.applications / LANES;
                assert!(took <= most, "{}: {took} {most}", twin.name);
                // A long step is as long as it may be: more than a basis is used, and fewer than single steps.
                assert!(step.is_none() || took >= 34, "{}: {took}", twin.name);
                let flat: Vec<f64> = found.iter().flatten().flat_map(|z| [z.re, z.im]).collect();
                let name = format!("Krylov for {} at {tolerance:e}", twin.name);
                report_bits(world, &name, &flat);
            }
        }
    }
}

/// Crank–Nicolson converges with order 2 and keeps norms, backward Euler with order 1 and loses them; the leading term of
/// the error is the error. On every mesh.
pub fn orders_of_the_implicit_methods(world: &World) {
    const SLOW: [f64; 2] = [0.0, 0.5];
    let mut wavenumbers = [SLOW[1]; LANES];
    wavenumbers[..SLOW.len()].copy_from_slice(&SLOW);
    for twin in Twin::unshared() {
        let mut reference = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let time = 1.0 / weighted.bounds.rate;
            let reference =
                reference.get_or_insert_with(|| references(world, &weighted, &SLOW, time));
            let full = norm(&weighted.state);
            for (order, coarse) in [(2, 8), (1, 32)] {
                let mut runs = Vec::new();
                for steps in [coarse, 2 * coarse] {
                    let matrix = &weighted.problem.matrix;
                    let mut implicit = Implicit::new(matrix, order, mesh.blocks() > 1)
                        .expect("the pattern is analysed");
                    let batch = BatchSpec {
                        modes: SLOW.len(),
                        wavenumbers,
                        tolerances: [1e-6; LANES],
                        work: [steps; LANES],
                    };
                    let (report, found, errors) = weighted.propagate(&mut implicit, &batch, time);
                    assert_eq!(report.solves, SLOW.len() * steps);
                    assert!(report.applications >= report.solves);
                    assert_eq!(report.unitary, order == 2);
                    runs.push((report, found, errors));
                }
                for l in 0..SLOW.len() {
                    let error = |run: usize| apart(&runs[run].1[l], &reference[l]) / full;
                    let found = (error(0) / error(1)).log2();
                    let change = size(&runs[1].1[l]) / full - 1.0;
                    let rest: Vec<Complex64> = (runs[1].1[l].iter().zip(&runs[1].2[l]))
                        .map(|(w, e)| w - e)
                        .collect();
                    let missed = apart(&rest, &reference[l]) / full / error(1);
                    let at = format!(
                        "{}, {mesh:?}, mu = {}, order {order}: {found}, error {:e}, norm {change:e}, leading term misses {missed}",
                        twin.name,
                        SLOW[l],
                        error(1)
                    );
                    assert!((found - order as f64).abs() < 0.1, "{at}");
                    assert!(error(1) > 1e-7 && missed < 0.2, "{at}");
                    if order == 2 {
                        assert!(change.abs() <= 1e-13 + runs[1].0.tails[l], "{at}");
                        assert!(runs[1].0.tails[l] < 1e-10, "{at}");
                    } else {
                        assert!(change < -1e-6, "{at}");
                    }
                }
            }
        }
    }
}

/// Steps with `Δt‖H‖` around 1000, as in the paper's set-up, against dense solves.
pub fn long_implicit_steps(world: &World) {
    const STEPS: usize = 2;
    let wavenumbers = [0.0, 5.0, 370.0, 370.0, 370.0, 370.0, 370.0, 370.0];
    let batch = BatchSpec {
        modes: 3,
        wavenumbers,
        tolerances: [1e-6; LANES],
        work: [STEPS; LANES],
    };
    for twin in Twin::unshared() {
        let mut expected: BTreeMap<(usize, usize), Vec<Complex64>> = BTreeMap::new();
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let step = 1000.0 / (2.0 * 370.0 * weighted.bounds.rate);
            let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
            for order in [2, 1] {
                let matrix = &weighted.problem.matrix;
                let mut implicit = Implicit::new(matrix, order, mesh.blocks() > 1)
                    .expect("the pattern is analysed");
                let time = STEPS as f64 * step;
                let (_, found, _) = weighted.propagate(&mut implicit, &batch, time);
                for l in 0..batch.modes {
                    let mu = wavenumbers[l];
                    let expected = expected.entry((order, l)).or_insert_with(|| {
                        let a = if order == 2 { 0.5 * step } else { step };
                        let shifted = Mat::from_fn(s.size, s.size, |i, j| {
                            let unit = f64::from(u8::from(i == j));
                            Complex64::new(unit - a * k.at(i, j), a * mu * s.at(i, j))
                        });
                        let factors = shifted.partial_piv_lu();
                        let mut w =
                            Mat::from_fn(s.size, 1, |i, _| Complex64::from(weighted.state[i]));
                        for _ in 0..STEPS {
                            let z = factors.solve(&w);
                            w = if order == 2 { &z + &z - &w } else { z };
                        }
                        (0..s.size).map(|i| w[(i, 0)]).collect()
                    });
                    let error = apart(&found[l], expected) / norm(&weighted.state);
                    assert!(
                        error <= 1e-11,
                        "{}, {mesh:?}, mu = {mu}, order {order}: {error:e}",
                        twin.name
                    );
                }
            }
        }
    }
}

/// The spectrum of `μS + iK` lies in the interval of the Chebyshev series, for what the growth is known to be.
pub fn spectrum_in_its_interval(world: &World) {
    let mut twins = Twin::all();
    let grid = ["axis.0.x.cells=18", "axis.0.v.cells=16"];
    let with = |set: &'static str| [grid[0], grid[1], set];
    let none = "solver.warp.weights='none'";
    let conservative = "scheme.interface='conservative'";
    twins.push(Twin::new("example 1, hat", "example1.toml", &grid));
    twins.push(Twin::new("no weights", "example1.toml", &with(none)));
    twins.push(Twin::new("well, hat", "well.toml", &grid));
    twins.push(Twin::new(
        "well, conservative",
        "well.toml",
        &with(conservative),
    ));
    let group = world.group();
    let mut turn = 0;
    for twin in twins {
        let weighted = Weighted::new(world, &twin, &one_block(world, &twin.case));
        let Bounds { rate, growth, .. } = weighted.bounds;
        let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
        for mu in [0.0, 0.4, 2.0, 7.0, 30.0] {
            // The work dealt out to the ranks.
            turn += 1;
            if turn % group.size() != group.rank() {
                continue;
            }
            let values = eigenvalues(&s, &k, mu);
            let (low, high) = (values[0], values[values.len() - 1]);
            let holds = |growth: f64| {
                let Interval { centre, half_width } = Interval::new(mu, rate, growth);
                let slack = 1e-13 * half_width;
                centre - half_width - slack <= low && high <= centre + half_width + slack
            };
            let at = format!("{}, mu = {mu}: [{low}, {high}], growth {growth}", twin.name);
            assert!(holds(growth), "{at}");
            // The growth matters: without it the interval is too small, where weights were left out.
            if twin.name == "no weights" && mu >= 7.0 {
                assert!(!holds(0.0), "{at}");
            }
        }
    }
}
