//! `phasewarp stability`: the measured limits of stability agree with theory.

use crate::support::{Job, case, check_all, directory, json_of, number, of_case, text_of};
use serde_json::Value;

/// The panels `only` of a case, with a budget that does not limit them.
fn stability(name: &str, only: &str) -> Job {
    Job::new(["stability", &case(name), "--only", only, "--budget", "1h"]).within(300)
}

/// Runs the job and returns `stability.json`.
fn found(job: &Job) -> Result<Value, String> {
    let place = directory();
    job.clone().into(place.path()).succeed()?;
    json_of(place.path().join("stability.json"))
}

fn panel<'a>(all: &'a Value, name: &str) -> Result<&'a Value, String> {
    let panels = all["panels"].as_array().into_iter().flatten();
    let mut panels = panels.filter(|p| p["name"] == name);
    panels.next().ok_or_else(|| format!("no panel {name}: {}", all["left_out"]))
}

/// The measured and the theoretical value of the only border of a panel whose name contains
/// `words`.
fn border(all: &Value, name: &str, words: &str) -> Result<[f64; 2], String> {
    let borders = panel(all, name)?["borders"].as_array().into_iter().flatten();
    let named = |b: &&Value| b["name"].as_str().is_some_and(|n| n.contains(words));
    let list: Vec<&Value> = borders.filter(named).collect();
    let [one] = list[..] else {
        return Err(format!("{name}, {words}: {list:?}"));
    };
    let number = |key: &str| one[key].as_f64().ok_or(format!("{words}: {one}"));
    Ok([number("measured")?, number("theory")?])
}

fn expect(holds: bool, what: impl Fn() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(what()) }
}

/// Steps of forward Euler and of SSP-RK3 keep the largest value exactly up to cfl 1, and do not
/// explode below von Neumann's limit.
#[test]
fn explicit_steps_fail_where_theory_predicts() {
    let small =
        |x: usize, v: usize| vec![format!("axis.0.x.cells={x}"), format!("axis.0.v.cells={v}")];
    let rows: [(&str, Vec<String>, usize); 5] = [
        ("example1.toml", small(24, 18), 1),
        ("well.toml", small(36, 20), 2),
        ("example2.toml", small(20, 16), 3),
        ("slope_jump.toml", small(24, 22), 1),
        ("barrier2d.toml", Vec::new(), 1),
    ];
    check_all(&rows, |(name, set, ranks)| {
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        let all = found(&stability(name, "cfl").set(&set).on(*ranks))?;
        for method in ["forward Euler", "SSP-RK3"] {
            let [kept, theory] = border(&all, "cfl", &format!("{method}: largest"))?;
            // With a force, the tried data are not the worst ones.
            let worst = if *name == "slope_jump.toml" { 1.3 } else { 1.0 + 1e-4 };
            expect(kept >= theory * (1.0 - 1e-6) && kept <= worst * theory, || {
                format!("{name}, {method}: {kept}, theory {theory}")
            })?;
            let [explodes, least] = border(&all, "cfl", &format!("{method}: explodes"))?;
            expect(explodes >= 0.999 * least && explodes < 3.0 * least, || {
                format!("{name}, {method}: explodes at {explodes}, theory {least}")
            })?;
        }
        let [euler, _] = border(&all, "cfl", "forward Euler: explodes")?;
        let [runge, _] = border(&all, "cfl", "SSP-RK3: explodes")?;
        expect(euler < runge && runge > 1.256, || format!("{name}: {euler}, {runge}"))
    });
}

/// Where nothing is exceeded, nothing explodes; up to there no pattern that the curves show grows,
/// and beyond it does by forward Euler: on cells of degree 0 after a few per cent; on elements,
/// whose unstable waves show late, in 200 steps after 15 %. By the spectral radius the border of
/// the first case is 4.50, and its norms grow by 1e8 at 4.574.
#[test]
fn no_pattern_grows_where_its_largest_value_or_norm_is_kept() {
    let grid = |x: usize, v: usize, degree: usize| {
        let [x, v] = [format!("axis.0.x.cells={x}"), format!("axis.0.v.cells={v}")];
        vec![x, v, format!("scheme.degree={degree}")]
    };
    let step = ["potential.0.value=0.1*x", "potential.1.value=0.3", "axis.0.x.lower=-1"];
    let step = step.iter().chain(&["axis.0.x.upper=1", "axis.0.v.lower=-1.4"]);
    let step: Vec<String> =
        step.chain(&["axis.0.v.upper=1.4"]).map(|word| word.to_string()).collect();
    let rows = [
        ("example1.toml", [step, grid(8, 16, 2)].concat(), [4.45, 4.53], 1.15),
        ("smooth-beams.toml", grid(6, 12, 4), [4.5, 4.67], 1.15),
        ("example1.toml", grid(24, 18, 0), [0.999, 1.001], 1.03),
    ];
    check_all(&rows, |(name, set, [least, most], beyond)| {
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        let all = found(&stability(name, "cfl").set(&set).set(&["exact={}"]))?;
        let borders = panel(&all, "cfl")?["borders"].as_array().cloned().unwrap_or_default();
        for (curve, method) in ["forward Euler", "SSP-RK3"].into_iter().enumerate() {
            let of = |words: &str| {
                let name = |b: &&Value| b["name"].as_str().map(str::to_owned).unwrap_or_default();
                let mut named = borders.iter().filter(|b| name(b).starts_with(method));
                named.find_map(|b| name(&b).contains(words).then(|| b["measured"].as_f64())?)
            };
            // Steps of forward Euler may always grow on elements.
            let (kept, explodes) = (of("kept").unwrap_or(0.0), of("explodes"));
            let explodes = explodes.ok_or("no border of explosions")?;
            let size = || format!("{name}, {method}: {kept} kept, {explodes} explodes");
            expect(kept <= explodes, size)?;
            if method == "SSP-RK3" {
                expect((*least..=*most).contains(&kept), size)?;
            }
            let points = panel(&all, "cfl")?["curves"][curve]["points"].as_array().cloned();
            for p in points.iter().flatten() {
                let [x, growth] = ["x", "measured"].map(|key| number(&p[key]));
                expect(x > kept || growth <= 1.0 + 1e-12, || format!("{}: {p}", size()))?;
                // The curve is of the first pattern, and that of SSP-RK3 may grow from the second.
                let is_euler = method == "forward Euler" && kept > 0.0;
                expect(!is_euler || x < beyond * kept || growth > 1.0, || {
                    format!("{}: {p}", size())
                })?;
            }
        }
        Ok(())
    });
}

/// λ⁺ of example 1 with the hat and the conservative interface on refined grids has the known
/// values. With weights it is never above the certificate.
#[test]
fn growth_of_example_1_by_refinement() {
    let all = found(&stability("example1.toml", "growth").on(2)).unwrap();
    let curves = panel(&all, "growth").unwrap()["curves"].as_array().cloned();
    let expected: [(&str, &[(f64, f64)]); 2] = [
        ("hat, no weights", &[(32.0, 0.080), (64.0, 2.788), (128.0, 2.0707)]),
        ("conservative", &[(32.0, -0.0023), (64.0, -0.0006), (128.0, -0.00015)]),
    ];
    let curve = |name: &str| {
        let of = curves.iter().flatten().find(|c| c["name"] == name);
        of.and_then(|c| c["points"].as_array()).cloned().unwrap_or_default()
    };
    for (name, numbers) in expected {
        for (cells, lambda) in numbers {
            let at = curve(name).into_iter().find(|p| p["x"] == *cells);
            let measured = at.and_then(|p| p["measured"].as_f64()).unwrap_or(f64::NAN).ln();
            let near = (measured - lambda).abs() <= 6e-3 * lambda.abs() + 6e-5;
            assert!(near, "{name} at {cells}: {measured}, {lambda} expected");
        }
    }
    for p in curve("hat, no weights") {
        let [measured, theory] = ["measured", "theory"].map(|k| number(&p[k]));
        assert!(theory <= 1.02 * measured && measured < 2.5 * theory, "{p}");
    }
    // The sentence refers to the finest grid, to which the borders refer, too.
    let verdict = panel(&all, "growth").unwrap()["verdict"].to_string();
    let finest = curve("conservative").last().map(|p| p["x"].clone());
    let finest = finest.and_then(|x| x.as_f64()).unwrap_or(f64::NAN);
    let conservative = "conservative: does not amplify";
    assert!(verdict.contains(conservative), "{verdict}");
    assert!(verdict.contains(&format!("at {finest} cells")), "{verdict}");
    let on_it = format!("conservative: lambda+ at {finest} cells");
    border(&all, "growth", &on_it).unwrap();
    for p in curve("hat, dissipative weights") {
        let [measured, theory] = ["measured", "theory"].map(|k| number(&p[k]));
        assert!(measured <= theory + 1e-6 && theory < 1.5, "{p}");
    }
}

/// The recovered field is right for recovery points between the end of the growth and the beginning
/// of round-off.
#[test]
fn the_plateau_begins_and_ends_where_theory_predicts() {
    let grid = ["axis.0.x.cells=32", "axis.0.v.cells=26"];
    check_all(&["example1.toml", "step_up.toml", "example2.toml"], |name| {
        let all = found(&stability(name, "recovery").set(&grid).on(2))?;
        for kind in ["hat, dissipative weights", "hat, no weights"] {
            let [left, theory] = border(&all, "recovery", &format!("{kind}: plateau begins"))?;
            expect(left <= theory + 0.3, || format!("{name}, {kind}: {left}, {theory}"))?;
            // Theory adds the magnitudes of the rounding errors of all modes, which is too large.
            let [right, theory] = border(&all, "recovery", &format!("{kind}: round-off"))?;
            expect((theory - 0.5..theory + 3.0).contains(&right) && right > left + 4.0, || {
                format!("{name}, {kind}: ends at {right}, {theory}")
            })?;
        }
        let points = &panel(&all, "recovery")?["curves"][0]["points"];
        let points = points.as_array().ok_or("no points")?;
        // Before the plateau the field is wrong; on the plateau it is right to ten digits.
        let error = |p: &Value| number(&p["measured"]);
        let least = points.iter().map(error).fold(f64::INFINITY, f64::min);
        expect(error(&points[0]) > 1e-3 && least < 1e-10, || format!("{name}: {least}"))?;
        for p in points {
            let theory = number(&p["theory"]);
            expect(error(p) <= 3.0 * theory, || format!("{name}: {p}"))?;
        }
        Ok(())
    });
}

/// Errors at both ends of the interval begin where theory predicts. A run on the shortest accepted
/// interval meets its tolerance.
#[test]
fn intervals_fail_where_theory_predicts() {
    let grid = ["axis.0.x.cells=20", "axis.0.v.cells=15"];
    check_all(&["example1.toml", "well.toml"], |name| {
        let all = found(&stability(name, "interval").set(&grid))?;
        let [left, theory] = border(&all, "interval", "wraps around")?;
        expect(left >= 1.02 * theory && left < 0.3 * theory, || {
            format!("{name}: L = {left}, {theory}")
        })?;
        let [right, theory] = border(&all, "interval", "cut off")?;
        expect(right <= theory + 0.5 && right > 0.7 * theory, || {
            format!("{name}: R = {right}, {theory}")
        })?;
        let [error, tolerance] = border(&all, "interval", "a run accepts")?;
        expect(error <= tolerance, || format!("{name}: {error}, tolerance {tolerance}"))
    });
}

/// The planned couplings of the inflow lose at most three times as much as the best `δ`.
#[test]
fn planned_couplings_are_close_to_the_best_delta() {
    let grid = ["axis.0.x.cells=24", "axis.0.v.cells=20"];
    let job = stability("inflow_barrier.toml", "delta").set(&grid).on(2);
    let all = found(&job).unwrap();
    let [planned, least] = border(&all, "delta", "planned couplings").unwrap();
    assert!(planned < 3.0 * least, "{planned} {least}");
    let growing = &panel(&all, "delta").unwrap()["curves"][1]["points"];
    for p in growing.as_array().unwrap() {
        let [measured, theory] = ["measured", "theory"].map(|k| p[k].as_f64());
        // A value that overflows is missing.
        if let (Some(measured), Some(theory)) = (measured, theory) {
            assert!(theory <= measured * (1.0 + 1e-6), "{p}");
        }
    }
    let all = found(&stability("example1.toml", "delta")).unwrap();
    assert!(all["left_out"].to_string().contains("nothing enters"), "{all}");
}

/// Grazing: where λ⁺ has its largest spike, the chains of cells at a face explain most of it.
#[test]
fn grazing_spikes_are_explained_by_chains_at_a_face() {
    let grid = ["axis.0.x.cells=32", "axis.0.v.cells=32"];
    let all = found(&stability("example1.toml", "grazing").set(&grid).on(2)).unwrap();
    let points = panel(&all, "grazing").unwrap()["curves"][0]["points"].clone();
    let points = points.as_array().unwrap();
    assert!(points.len() > 60, "{}", points.len());
    for p in points {
        let [measured, theory] = ["measured", "theory"].map(|k| number(&p[k]));
        assert!(theory <= measured + 0.05, "{p}");
    }
    let [measured, theory] = border(&all, "grazing", "largest lambda+").unwrap();
    assert!(measured > 1.0 && theory > 0.7 * measured, "{measured} {theory}");
    // The largest spike is between the equally spaced heights and is located by additional points.
    let [place, _] = border(&all, "grazing", "height at which it is largest").unwrap();
    let (mut even, mut next) = (0.0f64, 0);
    for p in points {
        let [x, height] = ["measured", "x"].map(|k| number(&p[k]));
        next += i32::from((height - place).abs() < 0.02);
        even = even.max(if (height - place).abs() < 1e-3 { 0.0 } else { x });
    }
    assert!(measured > even && next > 1, "{measured} at {place}, {even} elsewhere, {next} near");
    let printed = panel(&all, "grazing").unwrap()["verdict"].to_string();
    assert!(printed.contains("the highest spike by theory"), "{printed}");
    let without = ["potential=[{value='0.3*x'}]", "exact={}"];
    let all = found(&stability("example1.toml", "grazing,growth").set(&without)).unwrap();
    assert_eq!(all["left_out"].as_array().map(Vec::len), Some(2), "{all}");
}

/// For elements, SSP-RK3 keeps the norm up to the limit of theory, and forward Euler never does.
/// The panels about growth at jumps are not applicable. The limits of recovery, interval and
/// tolerance are like those of degree 0.
#[test]
fn limits_of_elements_agree_with_theory() {
    let grid = ["axis.0.x.cells=4", "axis.0.v.cells=4", "scheme.degree=2"];
    let only = "cfl,growth,grazing,recovery,interval,step,tolerance";
    let all = found(&stability("example1.toml", only).set(&grid)).unwrap();
    let [kept, theory] = border(&all, "cfl", "SSP-RK3: norm kept").unwrap();
    assert!(kept >= theory && theory == 1.0, "{kept} {theory}");
    let [explodes, least] = border(&all, "cfl", "SSP-RK3: explodes").unwrap();
    assert!(explodes >= least && least > 1.0, "{explodes} {least}");
    assert!(border(&all, "cfl", "forward Euler: norm kept").is_err());
    let left_out = all["left_out"].to_string();
    assert_eq!(left_out.matches("not applicable").count(), 2, "{left_out}");
    let [left, by_theory] = border(&all, "recovery", "elements: plateau begins").unwrap();
    assert!(left <= by_theory + 0.3, "{left} {by_theory}");
    let [error, tolerance] = border(&all, "interval", "a run accepts").unwrap();
    assert!(error <= tolerance, "{error} {tolerance}");
    let [order, theory] = border(&all, "step", "Crank-Nicolson: order").unwrap();
    assert!((order - theory).abs() < 0.25, "{order}");
    let [reached, smallest] = border(&all, "tolerance", "designed").unwrap();
    assert!(smallest < 1e-9 && reached < 2.0 * smallest, "{reached} {smallest}");
}

/// The implicit methods converge with their orders.
#[test]
fn implicit_methods_have_their_orders() {
    let grid = ["axis.0.x.cells=12", "axis.0.v.cells=10", "time.end=0.5"];
    let all = found(&stability("example1.toml", "step").set(&grid)).unwrap();
    for (method, within) in [("Crank-Nicolson", 0.25), ("backward Euler", 0.15)] {
        let [order, theory] = border(&all, "step", &format!("{method}: order")).unwrap();
        assert!((order - theory).abs() < within, "{method}: {order}");
    }
}

/// Accepted tolerances are met, down to round-off.
#[test]
fn accepted_tolerances_are_kept() {
    let grid = ["axis.0.x.cells=10", "axis.0.v.cells=8"];
    let all = found(&stability("example1.toml", "tolerance").set(&grid)).unwrap();
    let found = panel(&all, "tolerance").unwrap();
    let verdict = found["verdict"].to_string();
    assert!(verdict.contains("designed down to"), "{verdict}");
    for name in ["designed", "gaussian"] {
        let [reached, smallest] = border(&all, "tolerance", name).unwrap();
        assert!(smallest < 1e-10 && reached < 2.0 * smallest, "{name}: {reached} {smallest}");
    }
    for curve in found["curves"].as_array().unwrap() {
        for p in curve["points"].as_array().unwrap() {
            let [measured, theory] = ["measured", "theory"].map(|k| number(&p[k]));
            assert!(measured <= 1.5 * theory, "{}: {p}", curve["name"]);
        }
    }
}

/// The numbers are the same on any ranks.
#[test]
fn the_same_numbers_on_any_ranks() {
    let grid = ["axis.0.x.cells=10", "axis.0.v.cells=8"];
    let only = "cfl,growth,recovery,grazing";
    let csv = |ranks: usize| -> Result<String, String> {
        let place = directory();
        let job = stability("step_up.toml", only).set(&grid);
        job.on(ranks).into(place.path()).succeed()?;
        text_of(place.path().join("stability.csv"))
    };
    let reference = csv(1).unwrap();
    for line in reference.lines().skip(1) {
        // Names with commas are in quotes.
        let fields: Vec<&str> = line.rsplit('"').next().unwrap_or_default().split(',').collect();
        assert_eq!(fields.len(), 5, "{line}");
        assert!(["theory", "bound"].contains(&fields[4]), "{line}");
    }
    expect(csv(3).unwrap() == reference, || "3 ranks: other numbers".to_owned()).unwrap();
}

/// Every case has all panels or a reason for a missing one, within its budget, and figures.
#[test]
fn every_case_has_panels_and_figures_within_its_budget() {
    let cases = [
        "example3.toml", "harmonic_step.toml", "pulsed_inflow.toml", "lens2d.toml", "step3d.toml",
        "paper/example2.toml",
    ];
    let rows: Vec<_> = cases.into_iter().enumerate().collect();
    check_all(&rows, |(k, name)| {
        let place = directory();
        let job = Job::new(["stability", &case(name), "--budget", "2s"]).on(1 + k % 2);
        job.into(place.path()).succeed()?;
        let all = json_of(place.path().join("stability.json"))?;
        let count = |key: &str| all[key].as_array().map_or(0, Vec::len);
        expect(count("panels") + count("left_out") == 8, || format!("{name}: {all}"))?;
        let svg = text_of(place.path().join("stability.svg"))?;
        expect(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), || {
            format!("{name}: no SVG")
        })?;
        let png = std::fs::read(place.path().join("stability.png")).map_err(|e| e.to_string())?;
        expect(png.starts_with(b"\x89PNG"), || format!("{name}: no PNG"))
    });
}

/// On a fine grid, too, no trial begins that takes longer than what is left.
#[test]
fn a_fine_grid_ends_within_the_budget() {
    let place = directory();
    let fine = ["axis.0.x.cells=4000", "axis.0.v.cells=4000"];
    let job = of_case("stability", "example1.toml").set(&fine).with(["--budget", "2s"]);
    let finished = job.into(place.path()).succeed().expect("panels");
    let used = finished.processor_seconds;
    assert!(used < 5.0, "{}", finished.report(&format!("{used} s of a processor")));
}

/// Ordinary runs with settings beyond the limits are refused or print a warning with the key, the
/// value and the limit.
#[test]
fn runs_beyond_the_limits_are_refused_or_print_a_warning() {
    let small = ["axis.0.x.cells=64", "axis.0.v.cells=64"];
    let place = directory();
    let job = of_case("check", "example1.toml").set(&small);
    let printed = job.clone().set(&["solver.warp.weights=none"]).succeed().unwrap();
    for words in
        ["solver.warp.weights = \"none\"", "growth x time", "where 1 is much", "dissipative"]
    {
        assert!(printed.output.contains(words), "{words}: {}", printed.output);
    }
    assert!(!job.succeed().unwrap().output.contains("growth x time"));
    let inflow = of_case("check", "inflow_barrier.toml");
    let printed = inflow.set(&["solver.warp.delta=0.02"]).succeed();
    let printed = printed.map(|f| f.output).unwrap_or_else(|e| e);
    assert!(printed.contains("solver.warp.delta"), "{printed}");
    let cfl = ["solver.method=classical", "solver.classical.cfl=1.01"];
    let job = of_case("run", "example1.toml").set(&cfl);
    job.into(place.path()).is_refused(&["cfl", "1.01"]).unwrap();
}
