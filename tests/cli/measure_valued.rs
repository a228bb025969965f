//! Measure-valued data: the level-set fields and their moments.

use crate::support::{
    INTERFACES, Job, Mistake, Summary, all_refused, case, check, check_all, datasets, directory,
    distance, run, text_of, written,
};

/// The fields `phi` and `psi_x` of one run, with one matrix and one pass over the modes, equal
/// those of separate runs with plain data: to the bit by the classical method, and to the tolerance
/// by modes, whose plan depends on the field.
#[test]
fn fields_of_one_run_equal_those_of_separate_runs() {
    let size = ["axis.0.x.cells=38", "axis.0.v.cells=30", "time.end=0.9"];
    let measure: String = text_of(case("example2.toml")).unwrap();
    let w = "0.9 if x <= -2 else 0.9 - 0.225*(x + 2)^2 if x <= 0 \
             else -0.9 + 0.225*(x - 2)^2 if x < 2 else -0.9";
    let (before, after) = (measure.find("[initial]").unwrap(), measure.find("[time]").unwrap());
    let plain = |f: &str| {
        format!(
            "{}[initial]\nf = \"{f}\"\n[inflow]\nvalue = \"initial\"\n{}",
            &measure[..before],
            &measure[after..]
        )
    };
    let place = directory();
    let file = |name: &str, text: String| {
        let path = place.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let runs = [
        file("measure.toml", measure.clone()),
        file("phi.toml", plain("1")),
        file("psi.toml", plain(&format!("v - ({w})"))),
    ];
    for (method, limit) in [("classical", 0.0), ("schrodingerized", 2e-9)] {
        let solved = runs.each_ref().map(|path| {
            let results = directory();
            let job = Job::new(["run", path]).set(&size).set(&[
                &format!("solver.method={method}"),
                "solver.tolerance=1e-9",
                "exact={}",
            ]);
            job.solve(results.path()).unwrap();
            datasets(results.path()).unwrap()
        });
        let [together, phi, psi] = solved;
        for (name, alone) in [("/phi", phi), ("/psi", psi)] {
            let found = distance(&together[name].numbers(), &alone["/f"].numbers());
            assert!(found <= limit, "{method}: {name} differs by {found:e}");
        }
    }
}

/// Example 2 by the classical method, with an interface or a degree and this number of cells or
/// elements along both axes.
fn classical_example_2(scheme: &str, cells: usize) -> Summary {
    let grid = ["x", "v"].map(|axis| format!("axis.0.{axis}.cells={cells}"));
    let grid = grid.each_ref().map(String::as_str);
    run("example2.toml").set(&["solver.method=classical", scheme]).set(&grid).summary().unwrap()
}

/// Example 2: the errors of density, mean velocity and mass fall as the number of cells grows. The
/// exact mass is 4 + 2 · 0.9 · 1.8.
#[test]
fn error_of_example_2_against_the_exact_moments() {
    for interface in INTERFACES {
        let rows = [64, 256].map(|cells| {
            let summary = classical_example_2(&format!("scheme.interface={interface}"), cells);
            let number = |key: &str| summary.number(key).unwrap();
            assert!((number("mass_exact") - 7.24).abs() < 1e-6);
            let mass = (number("mass") - number("mass_exact")).abs();
            let errors = ["error_density_l1", "error_velocity_l1"].map(number);
            [errors[0], errors[1], mass]
        });
        let [coarse, fine] = rows;
        for (k, limit) in [1.3, 0.25, 0.3].into_iter().enumerate() {
            let falls = fine[k] < 0.8 * coarse[k] && fine[k] < limit;
            assert!(falls, "{interface}: {coarse:?} {fine:?}");
        }
    }
}

/// The moments in the file follow from its `phi` and `psi` by the paper's formula in two
/// dimensions.
#[test]
fn moments_of_example_3_are_those_of_its_level_sets() {
    let place = directory();
    run("example3.toml").on(2).solve(place.path()).unwrap();
    let all = datasets(place.path()).unwrap();
    let numbers = |name: &str| all[name].numbers();
    let (phi, psi, density) = (numbers("/phi"), numbers("/psi"), numbers("/density"));
    let (momentum, axis) = (numbers("/momentum"), numbers("/axis/vx"));
    let (n, h) = (8, 0.075);
    let mut most: f64 = 0.0;
    for x in 0..n * n {
        let at = |a: usize, i: usize, j: usize| psi[((a * n * n + x) * n + i) * n + j];
        let around = |i: usize| (i.saturating_sub(1), (i + 1).min(n - 1));
        let (mut rho, mut m) = (0.0, 0.0);
        for i in 0..n {
            for j in 0..n {
                let ((a, b), (c, d)) = (around(i), around(j));
                let by_x = |k| (at(k, b, j) - at(k, a, j)) / ((b - a) as f64 * h);
                let by_y = |k| (at(k, i, d) - at(k, i, c)) / ((d - c) as f64 * h);
                let determinant: f64 = by_x(0) * by_y(1) - by_y(0) * by_x(1);
                let omega = determinant.abs().max(1.0) * h;
                let mut f = phi[(x * n + i) * n + j] * h * h;
                for k in 0..2 {
                    let y = at(k, i, j) / omega;
                    let bell = (1.0 + (std::f64::consts::PI * y).cos()) / (2.0 * omega);
                    f *= if y.abs() <= 1.0 { bell } else { 0.0 };
                }
                rho += f;
                m += axis[i] * f;
            }
        }
        assert!((rho - density[x]).abs() < 1e-12, "{x}: {rho} {}", density[x]);
        assert!((m - momentum[x]).abs() < 1e-12, "{x}: {m}");
        most = most.max(rho);
    }
    assert!(most > 1.0);
}

#[test]
fn mistakes_in_measure_valued_data_are_refused() {
    let rows: &[(&str, &[&str])] = &[
        ("initial.f=1", &["initial.f", "either"]),
        ("initial.velocity=[]", &["initial.velocity", "0 formulas", "list of 1"]),
        ("initial.velocity=[\"0\", \"1\"]", &["initial.velocity", "2 formulas", "list of 1"]),
        ("initial.velocity=0.9*x", &["initial.velocity", "a list of formulas"]),
        ("initial.velocity=[true]", &["initial.velocity.0", "true", "a formula in quotes"]),
        ("initial.velocity=[\"v\"]", &["initial.velocity", "unknown name \"v\""]),
        ("initial.density=v^2", &["initial.density", "unknown name \"v\""]),
        ("exact={f=\"x\"}", &["exact.f", "measure-valued"]),
        ("output.delta_width=wide", &["output.delta_width", "determinant", "gradient"]),
        ("axis.0.x.degree=1", &["axis.0.v.degree", "a degree of 1 or more expected", "1 or more"]),
        ("scheme.flux=0.5", &["scheme.flux", "a degree of 1 or more", "leave it out"]),
        ("initial={density=\"1\"}", &["initial.velocity", "list of 1"]),
        ("initial={velocity=[\"1\"]}", &["initial.density", "missing"]),
    ];
    all_refused(rows, |(setting, wording), _| Mistake::set("example2.toml", &[setting], wording));
    let rows: [([&str; 2], &[&str]); 2] = [
        (["scheme.degree=2", "output.delta_width=gradient"], &["output.delta_width", "degree 0"]),
        (["exact={}", "potential.0.reflection=0.5"], &["potential.0.reflection", "two velocities"]),
    ];
    all_refused(&rows, |(settings, wording), _| Mistake::set("example2.toml", settings, wording));
    // Mistakes that only values on the grid show.
    let rows = [
        ("initial.density=sqrt(x)", ["initial.density", "NaN"]),
        ("initial.velocity=[\"sqrt(x)\"]", ["initial.velocity", "NaN"]),
    ];
    check_all(&rows, |(setting, wording)| {
        check("example2.toml").set(&[setting]).is_refused(wording)
    });
}

/// Elements sum the density over the zeros of the level set, without a delta function. For example
/// 2 their errors with degree 1 are smaller than those of degree 0 with the same number of
/// unknowns.
#[test]
fn elements_of_example_2_are_more_accurate_than_the_delta_function() {
    let rows = [("scheme.interface=hat", 64), ("scheme.degree=1", 32)];
    let [cells, elements] = rows.map(|(scheme, count)| {
        let summary = classical_example_2(scheme, count);
        let number = |key: &str| summary.number(key).unwrap();
        assert!((number("mass_exact") - 7.24).abs() < 1e-6);
        ["error_density_l1", "error_velocity_l1"].map(number)
    });
    let better = elements[0] < 0.7 * cells[0] && elements[1] < 0.9 * cells[1];
    assert!(better, "{cells:?} {elements:?}");
}

/// Moments of elements, at the end and before, have the same bits on one rank and on three or four,
/// which split space, or space and the modes.
#[test]
fn moments_of_elements_have_the_same_bits_on_any_ranks() {
    let runs = [(1, "1"), (3, "3"), (4, "2")].map(|(ranks, blocks)| {
        let place = directory();
        Job::new(["run", &case("example2.toml"), "--ranks-x", blocks])
            .set(&["scheme.degree=2", "axis.0.x.cells=10", "axis.0.v.cells=8", "time.end=0.9"])
            .set(&["output.moments_every=0.3", "solver.tolerance=1e-4"])
            .on(ranks)
            .solve(place.path())
            .unwrap();
        datasets(place.path()).unwrap()
    });
    for name in [
        "/density", "/momentum", "/history/density", "/phi", "/density_exact",
        "/history/density_exact", "/history/momentum_exact",
    ] {
        let [one, rest @ ..] = runs.each_ref().map(|all| all[name].numbers());
        assert!(one.iter().any(|x| *x != 0.0), "{name}");
        assert!(rest.iter().all(|other| *other == one), "{name}");
    }
}

/// In two dimensions, elements of example 3 have the exact mass.
#[test]
fn elements_of_example_3_have_the_exact_mass() {
    let summary = run("example3.toml")
        .set(&["scheme.degree=1", "axis.0.x.cells=4", "axis.1.x.cells=4"])
        .set(&["axis.0.v.cells=4", "axis.1.v.cells=4", "solver.method=classical"])
        .on(2)
        .summary()
        .unwrap();
    let number = |key: &str| summary.number(key).unwrap();
    assert!((number("mass_exact") - 0.1564).abs() < 1e-4);
    assert!((number("mass") - number("mass_exact")).abs() < 0.01, "{}", number("mass"));
}

/// A sheet that lies on faces of the velocity elements has its density, as one between faces has.
/// The polynomials of the elements on both sides have their zeros beyond these faces.
#[test]
fn sheets_on_faces_of_velocity_elements_keep_their_density() {
    let text = "[[axis]]\nx = { lower = 3, upper = 5, cells = 40, boundary = \"periodic\" }\n\
        v = { lower = -0.4, upper = 1.6, cells = 20 }\n\
        [[potential]]\nwhere = \"x > 3.8 && x < 4.3\"\nvalue = \"-0.3\"\n\
        [[potential]]\nvalue = \"0\"\n[initial]\ndensity = \"1+0.5*cos(pi*x)\"\n\
        velocity = [\"sqrt(0.49+2*0.3) if x > 3.8 && x < 4.3 else 0.7\"]\n[time]\nend = 1.5\n\
        [exact]\nkind = \"characteristics\"\n[solver]\nmethod = \"classical\"\n";
    let place = directory();
    let path = written(place.path(), text).unwrap();
    // With 25 elements the sheet lies between faces.
    let rows = [(2, 20), (3, 20), (4, 20), (3, 25), (2, 40), (4, 40)];
    check_all(&rows, |&(degree, cells)| {
        let set = [format!("scheme.degree={degree}"), format!("axis.0.v.cells={cells}")];
        let job = Job::new(["run", &path]).set(&set.each_ref().map(String::as_str));
        let summary = job.summary()?;
        let error = summary.number("error_density_l1_relative")?;
        summary.require(error < 0.03, || format!("error of the density {error}"))?;
        let mass = summary.number("mass")?;
        summary.require((mass - 2.0).abs() < 0.015, || format!("mass {mass}"))
    });
}
