//! Runs compared with exact solutions: errors and their orders, bounds of the field, refraction and
//! mass.

use crate::random_cases::{Choices, check_scenes};
use crate::support::{
    INTERFACES, Job, SLOPES, Stored, Summary, at_most, check_all, datasets, directory,
    finite_volumes, near, refused, run, shrunk, written,
};
use std::collections::BTreeMap;

/// The L1 error of example 1 at two sizes. Its order is about ½, as the solution jumps.
#[test]
fn error_of_example_1_against_the_exact_solution() {
    let rows = [("hat", 0.4614, 0.3297), ("conservative", 0.4605, 0.3296)];
    check_all(&rows, |&(interface, coarse, fine)| {
        let error = |cells: usize, expected: f64| -> Result<f64, String> {
            let place = directory();
            let summary = run("example1.toml")
                .on(2)
                .set(&[
                    &format!("axis.0.x.cells={cells}"),
                    &format!("axis.0.v.cells={cells}"),
                    &format!("scheme.interface={interface}"),
                ])
                .solve(place.path())?;
            let l1 = summary.number("error_l1")?;
            summary.holds(near("error_l1", l1, expected, 1e-4))?;
            // The same error from the fields in the file.
            let stored = datasets(place.path())?;
            let exact = stored
                .get("/exact")
                .ok_or_else(|| format!("no /exact in result.h5\n  command: {}", summary.command))?;
            let volume = (3.0 / cells as f64).powi(2);
            let pairs = stored["/f"].numbers().into_iter().zip(exact.numbers());
            let sum: f64 = pairs.map(|(f, g)| (f - g).abs()).sum();
            summary.holds(near("error_l1 from result.h5", volume * sum, l1, 1e-12))?;
            Ok(l1)
        };
        let order = (error(64, coarse)? / error(128, fine)?).log2();
        near(&format!("order of error_l1, {interface}"), order, 0.5, 0.1)
    });
}

/// Slopes reduce the L1 error of example 1, at two sizes. The numbers of the hat interface are from
/// a separate implementation of the formulas; those of the conservative interface are close to
/// them, as without slopes.
#[test]
fn slopes_gain_on_example_1() {
    let rows = [
        ("hat", "minmod", [0.2735, 0.1742], 1e-4),
        ("hat", "van-leer", [0.2227, 0.1356], 1e-4),
        ("conservative", "minmod", [0.2735, 0.1742], 2e-3),
        ("conservative", "van-leer", [0.2227, 0.1356], 2e-3),
    ];
    check_all(&rows, |&(interface, limiter, expected, by)| {
        for (cells, expected) in [64, 128].into_iter().zip(expected) {
            let job = run("example1.toml").set(&SLOPES).set(&[
                &format!("axis.0.x.cells={cells}"),
                &format!("axis.0.v.cells={cells}"),
                &format!("scheme.interface={interface}"),
                &format!("scheme.limiter={limiter}"),
            ]);
            let summary = job.summary()?;
            summary.holds(near("error_l1", summary.number("error_l1")?, expected, by))?;
        }
        Ok(())
    });
}

/// For monotone data, which have no extrema, the order is 2 with slopes and 1 without: for
/// transport alone, with a force, and in the plane, with two of three methods each.
#[test]
fn slopes_are_of_second_order() {
    // S rises from 0 to 1, so that the data are 0 at the ends where particles enter: the lower ends
    // in x and the upper end in v.
    let rise = |of: &str, at: f64, width: f64| format!("(1 + tanh(({of} - ({at}))/{width}))/2");
    let line = |potential: &str, x: &str, v: &str| {
        let f = |x: &str, v: &str| {
            format!("{} * {}", rise(x, -0.5, 0.5), rise(&format!("2.5 - ({v})"), 0.0, 0.35))
        };
        (potential.to_owned(), f("x", "v"), f(x, v))
    };
    let transport = line("0", "x - v*t", "v");
    let force = line("0.5*x", "x - v*t - 0.25*t^2", "v + 0.5*t");
    let cloud = |x: &str, y: &str| format!("{} * {}", rise(x, -0.3, 0.5), rise(y, -0.2, 0.6));
    let plane = ("0".to_owned(), cloud("x", "y"), cloud("x - vx*t", "y - vy*t"));
    // Name, potential with initial and exact f, axes by refinement, end time.
    type Scene<'a> = (&'a str, &'a (String, String, String), fn(usize) -> String, f64);
    let axes_line = |n: usize| {
        format!(
            "[[axis]]\nx = {{ lower = -4, upper = 5, cells = {} }}\n\
             v = {{ lower = 0.5, upper = 4.5, cells = 6 }}\n",
            72 * n
        )
    };
    let axes_force = |n: usize| {
        format!(
            "[[axis]]\nx = {{ lower = -4, upper = 5, cells = {} }}\n\
             v = {{ lower = 0.5, upper = 4.9, cells = {} }}\n",
            36 * n,
            22 * n
        )
    };
    let axes_plane = |n: usize| {
        format!(
            "[[axis]]\nx = {{ lower = -3.5, upper = 3.5, cells = {} }}\n\
             v = {{ lower = 0.4, upper = 1.2, cells = 3 }}\n\
             [[axis]]\nx = {{ lower = -4, upper = 4, cells = {} }}\n\
             v = {{ lower = 0.3, upper = 0.9, cells = 2 }}\n",
            24 * n,
            26 * n
        )
    };
    let scenes: [Scene<'_>; 3] = [
        ("transport", &transport, axes_line, 0.5),
        ("force", &force, axes_force, 0.5),
        ("plane", &plane, axes_plane, 0.6),
    ];
    // Each of the three twice.
    let mut rows = Vec::new();
    let methods = [("none", 1.0), ("minmod", 2.0), ("van-leer", 2.0)];
    for (k, scene) in scenes.iter().enumerate() {
        for (limiter, order) in [methods[k], methods[(k + 1) % 3]] {
            rows.push((scene, limiter, order));
        }
    }
    check_all(&rows, |((name, (potential, initial, exact), axes, end), limiter, order)| {
        let error = |n: usize| -> Result<f64, String> {
            let place = directory();
            let file = place.path().join("smooth.toml");
            let text = format!(
                "{}[[potential]]\nvalue = \"{potential}\"\n[initial]\nf = \"{initial}\"\n\
                 [time]\nend = {end}\n\
                 [scheme]\nlimiter = \"{limiter}\"\n[solver]\nmethod = \"classical\"\n\
                 [solver.classical]\nintegrator = \"ssp-rk3\"\n[exact]\nf = \"{exact}\"\n",
                axes(n)
            );
            std::fs::write(&file, text).map_err(|e| e.to_string())?;
            let job = Job::new(["run".to_owned(), file.display().to_string()]);
            job.solve(place.path())?.number("error_l1")
        };
        let (coarse, fine) = (error(4)?, error(8)?);
        let what = format!("order, {name}, {limiter} (errors {coarse:e}, {fine:e})");
        near(&what, (coarse / fine).log2(), *order, 0.2)
    });
}

/// With slopes and the longest step, the field stays between the minimum and the maximum of the
/// data and of the inflow.
#[test]
fn slopes_keep_the_bounds() {
    let mut rows = Vec::new();
    let methods =
        [("minmod", "forward-euler"), ("van-leer", "forward-euler"), ("van-leer", "ssp-rk3")];
    // A time-dependent inflow does not support slopes.
    let names = finite_volumes().into_iter().filter(|name| name != "pulsed_inflow.toml");
    for (n, name) in names.enumerate() {
        // Two of the methods, one with each interface.
        for (m, interface) in INTERFACES.into_iter().enumerate() {
            let (limiter, integrator) = methods[(n + m) % 3];
            rows.push((name.clone(), limiter, integrator, interface));
        }
    }
    check_all(&rows, |(name, limiter, integrator, interface)| {
        let summary = run(name)
            .set(shrunk(name))
            .set(&[
                "solver.method=classical",
                "solver.classical.cfl=1",
                "exact={}",
                &format!("solver.classical.integrator={integrator}"),
                &format!("scheme.limiter={limiter}"),
                &format!("scheme.interface={interface}"),
            ])
            .summary()?;
        // Every case has data and inflow between 0 and 1.
        let (least, most) = (summary.number("minimum")?, summary.number("maximum")?);
        summary.require(least >= -1e-14 && most <= 1.0 + 1e-14, || {
            format!("f from {least:e} to {most}")
        })
    });
}

/// The beam follows Snell's law before the strip, in it and behind it, by the moments in the file.
#[test]
fn the_lens_refracts_its_beam() {
    let place = directory();
    let cells = [36, 16];
    let job = run("lens2d.toml").set(&[
        "axis.1.x.cells=16",
        "solver.method=classical",
        "solver.classical.integrator=ssp-rk3",
        "scheme.limiter=van-leer",
    ]);
    let summary = job.on(2).solve(place.path()).unwrap();
    let stored = datasets(place.path()).unwrap();
    let (density, momentum) = (stored["/density"].numbers(), stored["/momentum"].numbers());
    let points = density.len();
    assert_eq!(points, cells[0] * cells[1]);
    // The tangent of the beam's angle in a range of columns of cells: Σ v_y f / Σ v_x f.
    let tangent = |columns: std::ops::Range<usize>| {
        let sum = |axis: usize| -> f64 {
            columns
                .clone()
                .map(|i| momentum[axis * points + i * cells[1]..][..cells[1]].iter().sum::<f64>())
                .sum()
        };
        sum(1) / sum(0)
    };
    let (before, inside, behind) = (tangent(8..12), tangent(20..24), tangent(28..32));
    // The mean of the beam is (0.8, 0.45); in the strip vx = √(0.64 − 0.3).
    for (what, found, expected) in [
        ("before", before, 0.45 / 0.8),
        ("inside", inside, 0.45 / (0.64f64 - 0.3).sqrt()),
        ("behind", behind, 0.45 / 0.8),
    ] {
        let off = (found / expected - 1.0).abs();
        assert!(
            off < 0.05,
            "{what}: tan = {found:.4}, {expected:.4} expected: {}",
            summary.command
        );
    }
}

/// The conservative interface keeps the mass to round-off if particles are trapped and transmitted
/// at both walls of a well and none reach the ends of the box.
#[test]
fn conservative_interface_keeps_the_mass() {
    let change = |settings: &[&str]| -> Result<f64, String> {
        let summary = run("well.toml").set(&["time.end=0.2"]).set(settings).summary()?;
        let (after, before) = (summary.number("mass")?, summary.number("mass_initial")?);
        summary.require(before > 0.1, || format!("mass_initial {before}"))?;
        Ok((after / before - 1.0).abs())
    };
    let conservative = "scheme.interface=conservative";
    for (settings, limit) in [
        ([conservative, "solver.method=classical"], 1e-12),
        ([conservative, "solver.tolerance=2e-13"], 1e-12),
    ] {
        at_most(&format!("change of mass, {settings:?}"), change(&settings).unwrap(), limit)
            .unwrap();
    }
    // Control: particles reach the walls, where the hat interface changes the mass.
    let hat = change(&["scheme.interface=hat", "solver.method=classical"]).unwrap();
    assert!(hat > 1e-5, "hat: change of mass {hat:e}; the well's walls were not met");
}

/// A box that empties: of the particles with 0.5 < v < 1 those with v < x/T are left, so that the
/// density is x/T − ½ between 0 and ½. Its front lies within the first cell or the first cells.
#[test]
fn exact_densities_are_averages_over_cells_with_a_front() {
    const TEXT: &str = "[[axis]]\nx = { lower = 0, upper = 1, cells = 8 }\n\
        v = { lower = 0.5, upper = 1, cells = 10 }\n[[potential]]\nvalue = \"0\"\n\
        [initial]\nf = \"1\"\n[time]\nend = 0.02\n[solver]\ntolerance = 1e-2\n\
        [exact]\nkind = \"characteristics\"\n";
    // ∫₀ˣ of the density.
    let integral = |x: f64, time: f64| {
        let (rising, full) = ((x - 0.5 * time).clamp(0.0, 0.5 * time), (x - time).max(0.0));
        0.5 * rising * rising / time + 0.5 * full
    };
    for (cells, time) in [(8, 0.02), (32, 0.005), (8, 0.1), (7, 0.3)] {
        let place = directory();
        let path = place.path().join("case.toml");
        std::fs::write(&path, TEXT).expect("a case");
        let job = Job::new(["run", &path.display().to_string()]);
        let job = job.set(&[&format!("axis.0.x.cells={cells}"), &format!("time.end={time}")]);
        let results = place.path().join("results");
        let summary = job.solve(&results).unwrap();
        let found = datasets(&results).unwrap()["/density_exact"].numbers();
        let width = 1.0 / f64::from(cells);
        for (i, found) in found.iter().enumerate() {
            let faces = [i as f64 * width, (i + 1) as f64 * width];
            let expected = (integral(faces[1], time) - integral(faces[0], time)) / width;
            near(&format!("cell {i} of {cells}, T = {time}"), *found, expected, 1e-4).unwrap();
        }
        near("mass_exact", summary.number("mass_exact").unwrap(), integral(1.0, time), 1e-4)
            .unwrap();
    }
}

/// A staircase of 90 steps has the same exact density on a grid whose faces miss every other edge
/// as on one with a face at each.
#[test]
fn many_edges_within_cells_are_met_by_the_exact_solution() {
    let steps: String = (1..90)
        .map(|k| format!("[[potential]]\nwhere = \"x < {k}/90\"\nvalue = \"0.3*({k}/90)^2\"\n"))
        .collect();
    let text = format!(
        "{steps}[[potential]]\nvalue = \"0.3\"\n[[axis]]\n\
         x = {{ lower = 0, upper = 1, cells = 45 }}\n\
         v = {{ lower = -1, upper = 1.5, cells = 20 }}\n\
         [initial]\nf = \"exp(-((x - 0.3)^2/0.02 + (v - 0.7)^2/0.05))\"\n[time]\nend = 0.4\n\
         [solver]\nmethod = \"classical\"\n[exact]\nkind = \"characteristics\"\n"
    );
    let place = directory();
    let path = written(place.path(), &text).unwrap();
    let density = |cells: usize| {
        let results = place.path().join(cells.to_string());
        Job::new(["run", &path])
            .set(&[&format!("axis.0.x.cells={cells}")])
            .solve(&results)
            .unwrap();
        datasets(&results).unwrap()["/density_exact"].numbers()
    };
    let [coarse, fine] = [45, 90].map(density);
    let scale = fine.iter().fold(0.0, |most: f64, d| most.max(*d));
    for (i, (found, pair)) in coarse.iter().zip(fine.chunks(2)).enumerate() {
        let expected = 0.5 * (pair[0] + pair[1]);
        near(&format!("cell {i}"), found / scale, expected / scale, 1e-3).unwrap();
    }
}

/// A formula that is undefined on a face, x = 0, says nothing about the cells beside it.
#[test]
fn exact_densities_need_no_values_on_faces() {
    let place = directory();
    let exact = "exact.f='(sin(40*x)/x + 50)/90'";
    let grid = ["axis.0.x.cells=8", "axis.0.x.lower=-1", "axis.0.x.upper=1", "axis.0.v.cells=8"];
    let settings = ["exact={}", exact, "scheme.interface=conservative", "solver.tolerance=1e-2"];
    let job = run("example1.toml").set(&grid).set(&settings);
    let summary = job.solve(place.path()).unwrap();
    let density = datasets(place.path()).unwrap()["/density_exact"].numbers();
    assert!(density.iter().all(|density| density.is_finite()), "{density:?}");
    assert!(summary.number("mass_exact").is_ok_and(f64::is_finite));
}

/// What enters is given by the formula outside of the box: conditions such as `x < lower` hold
/// there, for cells, elements, the exact solution and the ledger, at ends in space and in velocity.
#[test]
fn what_enters_is_evaluated_outside_of_the_box() {
    const TEXT: &str = "[[axis]]\nx = { lower = -1, upper = 1.25, cells = 9 }\n\
        v = { lower = -1, upper = 1, cells = 8 }\n[[potential]]\nvalue = \"0\"\n\
        [initial]\nf = \"0\"\n[time]\nend = 0.5\n[solver]\ntolerance = 1e-6\n\
        [exact]\nkind = \"characteristics\"\n";
    let ends = [
        ("0.7 if x < -1 else 0", "0.7 if x <= -1 else 0", "0"),
        ("0.7 if x > 1.25 else 0", "0.7 if x >= 1.25 else 0", "0"),
        ("0.7 if v > 1 else 0", "0.7 if v >= 1 else 0", "0.4*x"),
    ];
    let rows = [(&ends[0], 0), (&ends[0], 3), (&ends[1], 1), (&ends[2], 0), (&ends[2], 3)];
    check_all(&rows, |&(&(outside, at_end, potential), degree)| {
        let place = directory();
        let path = written(place.path(), TEXT)?;
        let solve = |inflow: &str, name: &str, ranks: usize| -> Result<_, String> {
            let results = place.path().join(name);
            let job = Job::new(["run", &path]).on(ranks);
            let set = [
                format!("inflow.value='{inflow}'"),
                format!("potential.0.value={potential}"),
                format!("scheme.degree={degree}"),
            ];
            let summary = job.set(&set.each_ref().map(String::as_str)).solve(&results)?;
            let all = datasets(&results)?;
            let fields = ["/f", "/exact", "/density_exact"].map(|name| all[name].bytes.clone());
            let mass = &summary.value["ledger"]["mass"];
            let entered = ["entered", "entered_estimate"].map(|key| mass[key].as_f64());
            let enters = entered.iter().all(|mass| *mass > Some(0.01));
            summary.require(enters, || format!("entered {entered:?}"))?;
            let error = summary.number("error_l1")?;
            summary.require(error < 0.3, || format!("error_l1 {error}"))?;
            Ok((fields, entered))
        };
        if solve(outside, "outside", 2)? == solve(at_end, "at-end", 1)? {
            Ok(())
        } else {
            Err(format!("{outside}: another result than of {at_end}"))
        }
    });
}

/// Particles pass a step of `V` within a formula if their energy is above it: as much
/// mass arrives behind it as closed formulas of the paths say.
#[test]
fn steps_within_a_formula_have_their_height() {
    const TEXT: &str = "[[axis]]\nx = { lower = -1, upper = 1, cells = 60 }\n\
        v = { lower = -1.6, upper = 1.6, cells = 72 }\n[[potential]]\nvalue = \"0\"\n\
        [initial]\nf = \"exp(-400*(v-1.035)^2 - 30*(x+0.5)^2)\"\n[time]\nend = 1.2\n\
        [exact]\nkind = \"characteristics\"\n[solver]\nmethod = \"classical\"\n";
    let (time, place_of_face) = (1.2, 0.1);
    let expected = |step: f64| {
        let passes = |x: f64, v: f64| {
            if x > step {
                return x + v * time > place_of_face;
            }
            let [left, square] = [time - (step - x) / v, v * v - 1.0];
            square > 0.0 && left > 0.0 && step + square.sqrt() * left > place_of_face
        };
        let (mut sum, parts) = (0.0, 4000);
        for i in 0..parts {
            let x = -1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(parts);
            for j in 0..800 {
                let v = 0.8 + 0.5 * (f64::from(j) + 0.5) / 800.0;
                let f = (-400.0 * (v - 1.035).powi(2) - 30.0 * (x + 0.5).powi(2)).exp();
                sum += if passes(x, v) { f } else { 0.0 };
            }
        }
        sum * 2.0 / f64::from(parts) * 0.5 / 800.0
    };
    let place = directory();
    let path = written(place.path(), TEXT).unwrap();
    for (number, (value, step)) in
        [("0.5*step(x)", 0.0), ("0.5 if x > 0.03 else 0", 0.03)].into_iter().enumerate()
    {
        let results = place.path().join(number.to_string());
        let set = format!("potential.0.value={value}");
        Job::new(["run", &path]).set(&[&set]).solve(&results).unwrap();
        let density = datasets(&results).unwrap()["/density_exact"].numbers();
        let mass = density[33..].iter().sum::<f64>() / 30.0;
        near(value, mass, expected(step), 0.05 * expected(step)).unwrap();
    }
}

/// A barrier within an element, between the points at which the element evaluates its formula, is
/// met by particles wherever a warning names it: the exact solution is that of the barrier written
/// as a region, and in one dimension particles show the error of a run that lost it.
#[test]
fn barriers_between_the_nodes_of_elements_are_met() {
    /// A second axis.
    const Y: &str = "[[axis]]\nx = { lower = -1, upper = 1, cells = 3 }\n\
        v = { lower = -1, upper = 1, cells = 2 }\n";
    /// The second axis, degree, cells, and the barrier's centre and half-width in elements from
    /// x = 0.
    const ROWS: [(&str, usize, usize, f64, f64); 10] = [
        ("", 2, 20, 0.1, 0.04),
        ("", 3, 20, 0.1, 0.04),
        ("", 4, 20, 0.12, 0.04),
        ("", 1, 40, 3.5 / 13.0, 0.03),
        ("", 0, 160, 7.5 / 13.0, 1.0 / 30.0),
        ("", 0, 300, 1.5 / 13.0, 1.0 / 30.0),
        ("", 0, 1000, 9.5 / 13.0, 1.0 / 16.0),
        (Y, 0, 48, 9.5 / 13.0, 1.0 / 16.0),
        (Y, 0, 48, 9.5 / 13.0, 1.0 / 40.0),
        (Y, 1, 16, 3.5 / 13.0, 0.03),
    ];
    check_all(&ROWS, |&(second_axis, degree, cells, centre, half)| {
        let place = directory();
        let path = written(
            place.path(),
            &format!(
                "[[axis]]\nx = {{ lower = -1, upper = 1, cells = {cells} }}\n\
                 v = {{ lower = -1.4, upper = 1.4, cells = 24 }}\n{second_axis}\
                 [initial]\nf = \"exp(-((x + 0.5)^2/0.03 + (vx - 0.7)^2/0.04))\"\n\
                 [time]\nend = 2\n[scheme]\ndegree = {degree}\n\
                 [solver]\nmethod = \"classical\"\n"
            ),
        )?;
        let width = 2.0 / cells as f64;
        let inside = format!("abs(x - {}) < {}", centre * width, half * width);
        let formula = format!("potential=[{{value='0.3 if {inside} else 0'}}]");
        let region = format!("potential=[{{where='{inside}',value='0.3'}},{{value='0'}}]");
        let run = |potential: &str| {
            let exact = "exact.kind='characteristics'";
            Job::new(["run", &path]).set(&[potential, exact]).solve(directory().path())
        };
        let formula = run(&formula)?;
        let region = run(&region)?.number("error_l2_relative")?;
        let [measured, traced] = [
            formula.number("error_l2_relative")?,
            formula.value["accuracy"]["particles"]["field_mean"].as_f64().unwrap_or(0.0),
        ];
        at_most("1 beside the error with a region", 1.0, region)?;
        formula.holds(near("the error with a formula", measured, region, 0.05 * region))?;
        match second_axis {
            "" => formula.holds(near("the error by particles", traced, region, 0.5 * region)),
            _ => Ok(()),
        }
    });
}

/// A mass against which errors on elements are measured is that of the formula, also where an edge
/// of `V`, at which the density jumps, lies within an element.
#[test]
fn edges_within_elements_are_integrated() {
    let text = "[[axis]]\nx = { lower = 0, upper = 3, cells = 6, boundary = \"periodic\" }\n\
        v = { lower = -3, upper = 3, cells = 24 }\n[[potential]]\nwhere = \"x < 1.07\"\n\
        value = 0\n[[potential]]\nvalue = 0.5\n[initial]\n\
        f = \"exp(-v^2/0.6)*(1 if x < 1.07 else exp(-0.5/0.3))\"\n[time]\nend = 0.6\n\
        [solver]\nmethod = \"classical\"\n[exact]\nkind = \"characteristics\"\n";
    // ∫ exp(−v²/0.6) dv over the box; what lies beyond it is less than 1e-6 of that.
    let velocities = (0.6 * std::f64::consts::PI).sqrt();
    let mass = velocities * (1.07 + 1.93 * (-0.5f64 / 0.3).exp());
    check_all(&[1, 2, 3, 8], |degree| {
        let place = directory();
        let path = written(place.path(), text)?;
        let degree = format!("scheme.degree={degree}");
        let summary = Job::new(["run", &path]).set(&[&degree]).on(2).solve(place.path())?;
        let off = (summary.number("mass_exact")? / mass - 1.0).abs();
        summary.holds(at_most("error of mass_exact", off, 1e-5))
    });
    // In two dimensions, a corner within an element; densities to 1e-3 of the largest.
    let plane = "[[axis]]\nx = { lower = 0, upper = 3, cells = 4 }\n\
        v = { lower = -3, upper = 3, cells = 8 }\n[[axis]]\n\
        x = { lower = 0, upper = 2, cells = 3 }\nv = { lower = -3, upper = 3, cells = 8 }\n\
        [[potential]]\nwhere = \"x < 1.07 && y < 0.77\"\nvalue = 0\n[[potential]]\n\
        value = 0.5\n[initial]\nf = \"exp(-(vx^2 + vy^2)/0.6)*(1 if x < 1.07 && y < 0.77 else \
        exp(-0.5/0.3))\"\n[inflow]\nvalue = \"initial\"\n[time]\nend = 0.1\n[scheme]\n\
        degree = 2\n[solver]\nmethod = \"classical\"\n[exact]\nkind = \"characteristics\"\n";
    let corner = 1.07 * 0.77;
    let mass = velocities * velocities * (corner + (6.0 - corner) * (-0.5f64 / 0.3).exp());
    let place = directory();
    let path = written(place.path(), plane).unwrap();
    let summary = Job::new(["run", &path]).on(3).solve(place.path()).unwrap();
    let off = (summary.number("mass_exact").unwrap() / mass - 1.0).abs();
    summary.holds(at_most("error of mass_exact in the plane", off, 1e-3)).unwrap();
}

/// A small disc, whose edge lies along no axis, takes no more points than a square: the exact
/// solution meets a staircase there, too.
#[test]
fn curved_edges_are_not_cut() {
    let text = "[[axis]]\nx = { lower = -1, upper = 1, cells = 4 }\n\
        v = { lower = -1, upper = 1, cells = 4 }\n[[axis]]\n\
        x = { lower = -1, upper = 1, cells = 4 }\nv = { lower = -1, upper = 1, cells = 4 }\n\
        [[potential]]\nwhere = \"abs(x) < 0.11 && abs(y) < 0.11\"\nvalue = 0.1\n\
        [[potential]]\nvalue = 0\n[initial]\nf = \"exp(-x^2 - y^2 - vx^2 - vy^2)\"\n\
        [time]\nend = 0.1\n[scheme]\ndegree = 1\n[solver]\nmethod = \"classical\"\n\
        [exact]\nkind = \"characteristics\"\n";
    let place = directory();
    let path = written(place.path(), text).unwrap();
    let disc = "potential.0.where='x^2 + y^2 < 0.012'";
    let memory = |set: &[&str]| {
        let summary = Job::new(["run", &path, "--force"]).set(set).solve(place.path()).unwrap();
        summary.number("memory_anonymous_bytes_per_rank").unwrap()
    };
    let [square, disc] = [&[][..], &[disc]].map(memory);
    assert!(disc < square + 16e6, "{square} {disc}");
}

/// In random scenes, a function of the energy that is also what enters stays as it is: the exact
/// solution by characteristics is the initial one, for steps, slopes and wells, on both sides of
/// each jump, around periodic axes and at any ends of the box. The ledger sees as much enter as
/// leave.
#[test]
fn random_equilibria_stay() {
    check_scenes(24, 0.7, |choices| {
        let text = equilibrium(choices);
        let place = directory();
        let path = written(place.path(), &text)?;
        let finished = Job::new(["run", &path]).into(place.path()).run()?;
        if finished.code == Some(2) {
            return refused(&finished, &[]).map(|()| false);
        }
        let summary = Summary::read(finished, place.path())?;
        let stored = datasets(place.path())?;
        let (exact, expected) = (stored["/exact"].numbers(), of_energy(&stored));
        near("values", exact.len() as f64, expected.len() as f64, 0.0)?;
        let largest = expected.iter().copied().fold(0.0, f64::max);
        let pairs = exact.iter().zip(&expected);
        let off = pairs.map(|(f, e)| (f - e).abs()).fold(0.0, f64::max) / largest;
        summary.holds(at_most("distance to the equilibrium", off, 1e-8))?;
        let mass = &summary.value["ledger"]["mass"];
        let [entered, entered_error, left, left_error] =
            ["entered_estimate", "entered_error", "left_estimate", "left_error"]
                .map(|key| mass[key].as_f64().ok_or(key));
        let (entered, entered_error) = (entered?, entered_error?);
        let (left, left_error) = (left?, left_error?);
        let scatter = 4.0 * f64::hypot(entered_error, left_error) + 0.02 * (entered + left);
        summary.holds(at_most("what enters less what leaves", (entered - left).abs(), scatter))?;
        Ok(true)
    });
}

/// `exp(−v²/2 − V)` at the nodes of stored results, velocities fastest.
fn of_energy(stored: &BTreeMap<String, Stored>) -> Vec<f64> {
    let mut energies = stored["/potential"].numbers();
    for name in ["/axis/vx", "/axis/vy", "/axis/vz"] {
        let Some(velocities) = stored.get(name) else { break };
        let kinetic: Vec<f64> = velocities.numbers().iter().map(|v| 0.5 * v * v).collect();
        energies = energies.iter().flat_map(|e| kinetic.iter().map(move |k| e + k)).collect();
    }
    energies.iter().map(|energy| (-energy).exp()).collect()
}

/// A scene with random regions of `V`, whose edges are faces, and `f = exp(−v²/2 − V)` at the start
/// and in what enters.
fn equilibrium(choices: &mut Choices) -> String {
    let dimension = choices.of(&[1, 1, 2, 2, 3]);
    let names = &["x", "y", "z"][..dimension];
    let counts = [[4, 7, 10], [3, 4, 5], [2, 2, 3]][dimension - 1];
    let (mut axes, mut faces) = (String::new(), Vec::new());
    for _ in names {
        let (lower, width) = (choices.of(&[-1.5, -0.3, 2.0]), choices.of(&[1.0, 1.75, 3.0]));
        let cells = choices.of(&counts);
        let boundary = choices.of(&["inflow", "inflow", "periodic"]);
        // Elements may have jumps if v = 0 is a face.
        let (v, upper, count) =
            choices.of(&[(-1.2, 1.2, 4), (-1.0, 0.5, 3), (0.2, 1.8, 2), (-2.0, 0.4, 6)]);
        axes += &format!(
            "[[axis]]\nx = {{ lower = {lower}, upper = {}, cells = {cells}, boundary = \
             \"{boundary}\" }}\nv = {{ lower = {v}, upper = {upper}, cells = {count} }}\n",
            lower + width,
        );
        let face = |k: usize| lower + width * k as f64 / cells as f64;
        faces.push([face(1), face(cells / 2), face(cells - 1)]);
    }
    let value = |choices: &mut Choices| {
        let [slope, bend] = [[0.0, 0.0, 0.5, -0.4], [0.0, 0.0, 0.5, -0.3]];
        format!(
            "{} + {}*{} + {}*({} - 0.3)^2",
            choices.of(&[0.0, 0.2, -0.3, 1.0]),
            choices.of(&slope),
            choices.of(names),
            choices.of(&bend),
            choices.of(names),
        )
    };
    let mut energy = value(choices);
    let mut regions = format!("[[potential]]\nvalue = \"{energy}\"\n");
    for _ in 0..choices.of(&[0, 1, 1, 2]) {
        let mut place = Vec::new();
        for _ in 0..choices.of(&[1, 1, 2]) {
            let k = choices.of(&[0, 1, 2][..dimension]);
            let sign = choices.of(&["<", "<=", ">", ">="]);
            place.push(format!("{} {sign} {:?}", names[k], choices.of(&faces[k])));
        }
        let (place, value) = (place.join(" && "), value(choices));
        energy = format!("(({value}) if {place} else ({energy}))");
        regions = format!("[[potential]]\nwhere = \"{place}\"\nvalue = \"{value}\"\n{regions}");
    }
    let squares: Vec<String> = names.iter().map(|name| format!("v{name}^2")).collect();
    format!(
        "{axes}{regions}[initial]\nf = \"exp(-({})/2 - ({energy}))\"\n[inflow]\nvalue = \
         \"initial\"\n[time]\nend = {}\n[scheme]\ndegree = {}\n[solver]\nmethod = \
         \"classical\"\n[solver.classical]\nintegrator = \"ssp-rk3\"\n\
         [exact]\nkind = \"characteristics\"\n[output]\nexpand = true\n",
        squares.join(" + "),
        choices.of(&[0.3137, 1.0173, 2.9171]),
        choices.of(&[0, 0, 1, if dimension < 3 { 3 } else { 1 }]),
    )
}

/// The density of a formula that is smooth along the velocities, in two dimensions, is known far
/// better than the run, without a warning; its error is estimated, and not far too small or large.
/// That of a formula that jumps there is estimated, too.
#[test]
fn densities_of_formulas_are_known_well() {
    const GIBBS: &str = r#"
        initial.f = "exp(-2*(vx^2/2 + vy^2/2 + (0.3 if x > 1.4 && y > 0 else 0)))"
        inflow.value = "initial"
        exact.f = "exp(-2*(vx^2/2 + vy^2/2 + (0.3 if x > 1.4 && y > 0 else 0)))"
        time.end = 0.01
        scheme.interface = "hat"
        solver.method = "classical"
        potential = [{ where = "x > 1.4 && y > 0", value = 0.3 }, { value = 0 }]
        [[axis]]
        x = { lower = 1, upper = 2.2, cells = 6 }
        v = { lower = -2.4, upper = 2.4, cells = 8 }
        [[axis]]
        x = { lower = -0.5, upper = 0.5, cells = 4 }
        v = { lower = -2.4, upper = 2.4, cells = 8 }
    "#;
    let place = directory();
    let file = written(place.path(), GIBBS).unwrap();
    let known = |settings: &[&str], expected: f64| -> [f64; 2] {
        let results = directory();
        let job = Job::new(["run", &file]).set(settings);
        let summary = job.solve(results.path()).unwrap();
        let warns = summary.warnings().contains("exact density");
        assert!(!warns || !settings.is_empty(), "{}", summary.warnings());
        let density = datasets(results.path()).unwrap()["/density_exact"].numbers();
        let error = (density[0] / expected - 1.0).abs();
        [error, summary.number("exact_density_error").unwrap()]
    };
    let along = std::f64::consts::PI.sqrt() * libm::erf(2.4);
    let [error, estimate] = known(&[], along * along);
    assert!(error < estimate && estimate < 1e-5, "{estimate} estimated, {error}");
    // A disc of velocities.
    let disc = ["initial.f=1 if vx^2 + vy^2 < 1.3 else 0", "exact.f=1 if vx^2 + vy^2 < 1.3 else 0"];
    let [error, estimate] = known(&disc, 1.3 * std::f64::consts::PI);
    assert!(error < 3.0 * estimate && estimate < 0.01, "{estimate} estimated, {error}");
}
