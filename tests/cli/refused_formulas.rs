//! Formulas that are not finite, and files that are not cases, are refused with a short message.

use crate::support::{
    Job, Mistake, all_refused, case, check, check_all, directory, parsed, refused, run, text_of,
};

/// The largest length of a message in characters.
const LONGEST_MESSAGE: usize = 2000;

const NOT_FINITE: &[(&str, &str, &[&str])] = &[
    ("initial.f", "sqrt(-x)", &["NaN", "x = 0.0", "v = -1.4"]),
    ("initial.f", "1/(x - 0.01171875)", &["inf", "x = 0.01171875"]),
    ("initial.f", "exp(800*abs(v))", &["inf", "v = -1.4"]),
    // A mistake that only one rank finds, which need not be the first.
    ("initial.f", "sqrt(1.4 - x)", &["NaN", "x = 1.4"]),
    ("potential.0.value", "1/(x + 1.5)", &["inf", "x = -1.5"]),
    ("potential.0.value", "sqrt(-1.4 - x)", &["NaN", "x = -1.3"]),
    ("inflow.value", "ln(v)", &["NaN", "v = -"]),
    ("inflow.value", "1e308*v^2*1e10", &["inf", "x = -1.5"]),
];

/// A formula that is not finite somewhere is reported with its text, its value and the place, by
/// `check` and by `run` on two ranks.
#[test]
fn formulas_that_are_not_finite_are_reported_with_the_place() {
    let rows: Vec<_> = NOT_FINITE.iter().enumerate().collect();
    check_all(&rows, |(k, (key, formula, wording))| {
        let setting = format!("{key}=\"{formula}\"");
        let wording: Vec<&str> = wording.iter().copied().chain([*formula, *key]).collect();
        check("example1.toml").set(&[&setting]).is_refused(&wording)?;
        // `run` finds every third, among them one that only the second rank finds.
        if k % 3 != 0 {
            return Ok(());
        }
        let place = directory();
        let job = run("example1.toml").set(&[&setting]).with(["--ranks-x", "2"]);
        job.into(place.path()).on(2).is_refused(&wording)
    });
}

/// A division by a constant 0 is refused with its place, wherever formulas stand.
#[test]
fn divisions_by_a_constant_zero_are_refused_with_their_place() {
    let rows = [
        ("initial.f", "exp(-x^2/0)", 9),
        ("initial.f", "exp(-x^2/width)", 9),
        ("potential.0.value", "0.2 + x/(1 - 1)", 8),
        ("potential.0.where", "x/0 < 1", 2),
        ("inflow.value", "exp(-v^2/0)", 9),
        ("time.end", "1/width", 2),
    ];
    check_all(&rows, |(key, formula, at)| {
        let place = format!("division by zero at character {at}");
        let value = format!("{key} = \"{formula}\"");
        let settings = ["constants.width=0", &format!("{key}=\"{formula}\"")];
        Mistake::set("example1.toml", &settings, &[&place, &value]).refused_by_reader()
    });
    let guarded = "initial.f=\"exp(-x^2/width) if width > 0 else exp(-x^2)\"";
    parsed("example1.toml", &["constants.width=0", guarded]).unwrap();
}

/// Formulas for `α` that give no profile are refused with the mistake, its place, and the expected
/// values.
#[test]
fn formulas_for_alpha_that_make_no_profile_are_refused() {
    let rows: [(&str, &[&str]); 14] = [
        ("ln(p)", &["NaN", "p = -0.0625", "every p < 0"]),
        ("1 - sqrt(p + 3)", &["NaN", "p = -3.0", "every p < 0"]),
        ("1 + x", &["unknown name \"x\"", "character 5", "p, pi"]),
        ("1 +", &["ends where"]),
        (
            "1 if p > -50 else 0",
            &["g = e^(alpha p) = 1.0e0", "less than 1e-17 expected", "p below -4000"],
        ),
        ("0.001 - 0*p", &["1.0000e-3", "less than 1e-17 expected", "alpha = 0.01"]),
        ("-1 + 0*p", &["-1.0000e0", "at most 1e6"]),
        ("-1 - p^2/40", &["at most 1e6", "p = -"]),
        ("1e5 + 0*p", &["1.0000e5", "beside p = 0", "-100 and 100"]),
        ("1/sqrt(-p)", &["beside p = 0"]),
        ("5 + sin(1e3*p)", &["changes too fast", "p = -"]),
        ("2 - 2 - 1", &["between 0.01 and 100"]),
        ("50 + 51", &["between 0.01 and 100"]),
        ("true", &["a formula in quotes expected"]),
    ];
    // `run` on two ranks refuses them, too: one that is not finite, and one without a profile.
    let by_run = ["ln(p)", "-1 + 0*p"];
    check_all(&rows, |(formula, wording)| {
        let alpha = format!("solver.warp.alpha={formula}");
        let settings = ["solver.warp.profile=exponential", &alpha];
        let wording: Vec<&str> =
            ["solver.warp.alpha", *formula].into_iter().chain(wording.iter().copied()).collect();
        check("example1.toml").set(&settings).is_refused(&wording)?;
        if !by_run.contains(formula) {
            return Ok(());
        }
        let place = directory();
        run("example1.toml").set(&settings).into(place.path()).on(2).is_refused(&wording)
    });
    // A formula for another profile, and a constant with the name of the coordinate p.
    let rows: [(&str, &[&str]); 2] = [
        ("solver.warp.alpha=1 - p", &["solver.warp.alpha", "1 - p", "\"exponential\" only"]),
        ("constants.p=2", &["constants.p", "already means something"]),
    ];
    check_all(&rows, |(setting, wording)| {
        Mistake::set("example1.toml", &[setting], wording).refused_by_reader()
    });
}

/// A condition with the value NaN is refused; it does not count as false.
#[test]
fn conditions_that_are_not_finite_are_refused() {
    let job = check("example1.toml").set(&["potential.0.where=\"sqrt(x)\""]);
    job.is_refused(&["where", "sqrt(x)", "NaN"]).unwrap();
}

/// An exact solution that is not finite is refused before the solve.
#[test]
fn exact_solution_is_checked_before_the_solve() {
    let place = directory();
    let job = run("example1.toml").set(&["exact={f=\"sqrt(-x)\"}"]);
    job.into(place.path()).on(2).is_refused(&["exact.f", "sqrt(-x)", "NaN", "x = 0.0"]).unwrap();
}

/// Files that are not TOML, contain no case, or have too deep or too long contents are refused.
#[test]
fn files_that_are_not_cases_are_refused() {
    let deep = |open: &str, middle: &str, close: &str| {
        format!("a = {}{middle}{}\n", open.repeat(20_000), close.repeat(20_000))
    };
    let text = text_of(case("example1.toml")).unwrap();
    let formula = |f: String| text.replace("value = \"0.2\"", &format!("value = \"{f}\""));
    let rows: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("empty", b"".to_vec(), &["axis", "1 to 3"]),
        ("comment", b"# nothing\n".to_vec(), &["axis"]),
        ("prose", b"this is not a case file\n".to_vec(), &[":1:"]),
        ("binary", vec![0x89, b'H', b'D', b'F', 0xff, 0xfe, 0], &["UTF-8"]),
        ("zeros", vec![0; 1000], &[]),
        ("json", b"{\"axis\": 3}".to_vec(), &[":1:"]),
        ("large", vec![b'#'; (1 << 20) + 1], &["1048576"]),
        ("lists", deep("[", "", "]").into_bytes(), &["recurs"]),
        ("tables", deep("{a=", "1", "}").into_bytes(), &["recurs"]),
        ("key", format!("{}a = 1\n", "a.".repeat(20_000)).into_bytes(), &["recurs"]),
        ("heading", format!("[{}a]\n", "a.".repeat(20_000)).into_bytes(), &["recurs"]),
        (
            "parentheses",
            formula(format!("{}1{}", "(".repeat(60), ")".repeat(60))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "functions",
            formula(format!("{}x{}", "abs(".repeat(900), ")".repeat(900))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "signs",
            formula(format!("{}x", "-".repeat(9_000))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "powers",
            formula(format!("x{}", "^x".repeat(4_000))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "terms",
            formula(format!("x{}", "+x".repeat(6_000))).into_bytes(),
            &["potential.0.value", "10000"],
        ),
    ];
    all_refused(&rows, |(name, bytes, wording), place| {
        let path = place.join(format!("{name}.toml"));
        std::fs::write(&path, bytes).expect("a file");
        let path = path.display().to_string();
        Mistake::set(&path, &[], &[wording, &[path.as_str()][..]].concat())
    });
    // A formula with almost the largest number of terms is accepted.
    let place = directory();
    let path = place.path().join("long.toml");
    std::fs::write(&path, formula(format!("x{}", "+x".repeat(4_900)))).unwrap();
    Job::new(["check", &path.display().to_string()]).succeed().unwrap();
}

/// Messages are short: a value of thousands of characters is not repeated in full.
#[test]
fn messages_stay_short() {
    let long = format!("initial.f=\"{}\"", "-".repeat(9_000));
    let finished = check("example1.toml").set(&[&long]).run().unwrap();
    refused(&finished, &["initial.f"]).unwrap();
    let length = finished.errors.chars().count();
    assert!(length <= LONGEST_MESSAGE, "a message of {length} characters");
}
