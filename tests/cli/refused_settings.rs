//! Mistakes in `--set` and contradictory keys are refused with the text of the setting.

use crate::support::{Job, Mistake, SLOPES, all_refused, check_all, directory, edited, run};

/// Slopes are not linear. They are refused with methods that need a matrix.
#[test]
fn slopes_are_refused_with_methods_that_need_a_matrix() {
    let rows: &[(&[&str], &[&str])] = &[
        (&[], &["schrodingerized", "not linear", "ssp-rk3"]),
        (&SLOPES[..1], &["exponential", "not linear", "ssp-rk3"]),
        (&[SLOPES[0], SLOPES[1], "solver.verify=true"], &["solver.verify"]),
    ];
    check_all(rows, |(settings, wording)| {
        let settings = [&["scheme.limiter=van-leer"], *settings].concat();
        let wording = [*wording, &["scheme.limiter", "van-leer"]].concat();
        Mistake::set("example1.toml", &settings, &wording).refused_by_reader()
    });
    let settings = ["scheme.limiter=superbee", SLOPES[0], SLOPES[1]];
    let wording = ["superbee", "minmod", "van-leer"];
    let mistake = Mistake::set("example1.toml", &settings, &wording);
    mistake.refused_by_reader().unwrap();
}

/// Closed ends are refused for what enters: a given inflow, and level sets, which always do.
#[test]
fn closed_ends_are_refused_where_something_enters() {
    let rows = [
        ("example1.toml", "inflow.value=1", "nothing enters through closed ends: leave inflow"),
        ("example2.toml", "scheme.degree=2", "level sets of measure-valued data enter through"),
        ("example2.toml", "inflow.value=0", "level sets of measure-valued data enter through"),
    ];
    check_all(&rows, |&(name, setting, wording)| {
        let settings = ["scheme.ends=closed", "scheme.flux=0.5", setting];
        Mistake::set(name, &settings, &["scheme.ends", wording]).refused_by_reader()
    });
}

/// A text or a number instead of a table is refused with an example of the correct form.
#[test]
fn a_missing_table_is_refused_with_an_example() {
    let rows = [
        ("potential=[{ table = \"V.csv\" }]", "a table as { file = \"V.csv\" } expected"),
        ("initial.table=f.h5", "a table as { file = \"f.h5\" } expected"),
        ("inflow.table=3", "a table as { file = \"V.csv\" } expected"),
        ("initial=exp(-x^2)", "a table as { f = \"exp(-x^2)\" } expected"),
        ("potential=[0.2]", "a table as { value = \"0\" } expected"),
        ("inflow=1 if v > 0 else 0", "a table as { value = \"1 if v > 0 else 0\" } expected"),
        ("axis.0.x=[-1, 1]", "a table as { lower = -1.0, upper = 1.0, cells = 64 } expected"),
        ("time=2", "a table as { end = 1.0 } expected"),
        ("exact=formula", "a table as { kind = \"characteristics\" } expected"),
        ("solver.warp=3", "solver.warp = 3: a table expected"),
    ];
    check_all(&rows, |(setting, wording)| {
        Mistake::set("example1.toml", &[setting], &[wording]).refused_by_reader()
    });
}

/// If a required key is misspelt, the message names the misspelt key and the right one.
#[test]
fn misspelt_required_keys_are_named() {
    let place = directory();
    let (path, line) = edited(place.path(), "end = 1.0", "edn = 1.0");
    let path = path.display().to_string();
    let location = format!("{path}:{line}:");
    let wording = ["edn", "mean \"end\"", &location];
    let mistake = Mistake::set(&path, &[], &wording);
    mistake.refused_by_reader().unwrap();
}

/// An implicit method without a step, in the file or by `--set`, is refused.
#[test]
fn a_missing_step_is_named_with_its_file() {
    let place = directory();
    for method in ["crank-nicolson", "backward-euler"] {
        let new = format!("method = \"{method}\"");
        let (path, _) = edited(place.path(), "method = \"chebyshev\"", &new);
        let path = path.display().to_string();
        let wording = ["solver.propagator.step", "missing", &path];
        let mistake = Mistake::set(&path, &[], &wording);
        mistake.refused_by_reader().unwrap();
        let setting = format!("solver.propagator.method={method}");
        let mistake = Mistake::set("example1.toml", &[&setting], &wording[..2]);
        mistake.refused_by_reader().unwrap();
    }
}

#[test]
fn mistakes_in_a_set_option_are_named_with_its_text() {
    let rows: &[(&str, &[&str])] = &[
        ("solver.tolerence=1e-3", &["solver.tolerence", "mean \"tolerance\""]),
        ("solvre.tolerance=1e-3", &["solvre", "mean \"solver\""]),
        ("solver.tolerance=small", &["solver.tolerance", "\"small\"", "number"]),
        ("solver.tolerance=", &["solver.tolerance", "number"]),
        ("solver.tolerance=1", &["solver.tolerance = 1", "at most 0.1"]),
        ("solver.tolerance=-1e-3", &["solver.tolerance = -1e-3", "above 0"]),
        ("axis.0.x.cells=0", &["axis.0.x.cells = 0", "at least 1"]),
        ("axis.0.x.cells=-3", &["axis.0.x.cells = -3", "at least 1"]),
        ("axis.5.x.cells=3", &["\"5\"", "axis", "1 entries"]),
        ("axis.x.x.cells=3", &["\"x\"", "axis", "index"]),
        ("axis.0.x.cells.more=3", &["axis.0.x.cells", "not a table"]),
        ("axis.0.x.upper=-2", &["axis.0.x.upper = -2", "above", "-1.5"]),
        ("time.end=inf", &["time.end = inf", "finite"]),
        (
            "solver.propagator.step=0.1",
            &["solver.propagator.step = 0.1", "\"chebyshev\"", "leave it out"],
        ),
        ("solver.propagator.method=crank", &["solver.propagator.method", "\"crank-nicolson\""]),
        (
            "solver.propagator={method='crank-nicolson',step=0}",
            &["solver.propagator.step = 0", "above 0"],
        ),
        (
            "solver.propagator={method='krylov',step=-0.1}",
            &["solver.propagator.step = -0.1", "above 0"],
        ),
        (
            "solver.propagator={method='backward-euler',step=1e-9}",
            &["solver.propagator.step = 1e-9", "steps"],
        ),
        ("time.end=nan", &["time.end = nan", "finite"]),
        ("initial.f=x + * v", &["initial.f", "character 5"]),
        ("inflow.value=1 +", &["inflow.value"]),
        ("potential=[]", &["potential", "at least one"]),
        ("potential=3", &["potential", "list of tables"]),
        ("scheme.interface=hats", &["scheme.interface", "mean \"hat\""]),
        ("time", &["key=value"]),
        ("=3", &["key"]),
    ];
    all_refused(rows, |(setting, wording), _| {
        let text = format!("--set {setting}: ");
        Mistake::set("example1.toml", &[setting], &[wording, &[text.as_str()][..]].concat())
    });
}

/// Mistakes that are found on the grid or in the plan are reported with their file.
#[test]
fn late_mistakes_name_the_file() {
    let rows = [
        ("value = \"0.2\"", "value = \"1/(x + 1.5)\"", "potential"),
        ("tolerance = 1e-6", "tolerance = 1e-15", "solver.tolerance"),
    ];
    check_all(&rows, |(old, new, key)| {
        let place = directory();
        let (path, _) = edited(place.path(), old, new);
        let path = path.display().to_string();
        Job::new(["plan", &path]).is_refused(&[key, &path])
    });
}

/// Invalid boundaries, and blocks along an axis that must stay whole.
#[test]
fn invalid_boundaries_are_refused() {
    let rows: [(&str, &[&str]); 3] = [
        ("axis.0.x.boundary=reflecting", &["axis.0.x.boundary", "reflecting", "periodic"]),
        ("axis.0.v.boundary=periodic", &["axis.0.v.boundary", "velocity"]),
        ("axis.0.x.boundry=periodic", &["boundry", "boundary"]),
    ];
    check_all(&rows, |(setting, wording)| {
        Mistake::set("periodic2d.toml", &[setting], wording).refused_by_reader()
    });
    let place = directory();
    let job = run("periodic2d.toml").with(["--ranks-x", "1,2"]);
    job.on(2).into(place.path()).is_refused(&["--ranks-x", "2 blocks", "y", "periodic"]).unwrap();
}
