//! Mistakes in the case file are refused with their line, key and value.

use crate::support::{Mistake, all_refused, edited};

/// What is replaced in `cases/example1.toml`, the mistake that replaces it, and words that the
/// refusal contains.
type Row = (&'static str, &'static str, &'static [&'static str]);

/// The line of the axis `x`.
const X: &str = "x = { lower = -1.5, upper = 1.5, cells = 128 }";

/// Unknown keys, with the nearest known one.
const UNKNOWN_KEYS: &[Row] = &[
    ("tolerance = 1e-6", "tolerence = 1e-6", &["solver.tolerence", "mean \"tolerance\""]),
    ("[solver.propagator]", "[solver.propogator]", &["propogator", "mean \"propagator\""]),
    ("title     =", "tittle    =", &["tittle", "mean \"title\""]),
    ("end = 1.0", "end = 1.0\nbegin = 0", &["time.begin", "known here: start, end"]),
    ("end = 1.0", "end = 1.0\ndegree = 2", &["time.degree", "or scheme.degree?)"]),
    (
        "end = 1.0",
        "end = 1.0\nboundary = 2",
        &["time.boundary", "(did you mean axis.N.x.boundary?)"],
    ),
];

/// Wrong types.
const WRONG_TYPES: &[Row] = &[
    ("tolerance = 1e-6", "tolerance = \"small\"", &["solver.tolerance", "\"small\"", "number"]),
    ("verify    = false", "verify    = 0", &["solver.verify", "0", "true or false"]),
    ("end = 1.0", "end = 1979-05-27", &["time.end", "1979-05-27", "number"]),
    ("end = 1.0", "end = [1.0]", &["time.end", "number"]),
    (X, "x = 128", &["axis.0.x", "128", "table"]),
    ("value = \"0.2\"", "value = true", &["potential.0.value", "true", "formula"]),
    ("title     = \"Step down (example 1)\"", "title = 1", &["title", "1", "text"]),
];

/// The embedding of the inflow and the shift; `t` where a formula cannot depend on it.
const INFLOW_AND_SHIFT: &[Row] = &[
    (
        "inflow  = \"boundary\"",
        "inflow  = \"diagonal\"",
        &["solver.warp.inflow", "diagonal", "boundary", "full", "scalar"],
    ),
    (
        "inflow  = \"boundary\"",
        "inflow  = \"full\"\ndelta = 0",
        &["solver.warp.delta", "0", "above 0", "max"],
    ),
    (
        "inflow  = \"boundary\"",
        "inflow  = \"full\"\ndelta = -1.5",
        &["solver.warp.delta", "-1.5", "above 0"],
    ),
    (
        "inflow  = \"boundary\"",
        "inflow  = \"full\"\ndelta = \"mx\"",
        &["solver.warp.delta", "mx", "mean \"max\""],
    ),
    ("inflow  = \"boundary\"", "shift = inf", &["solver.warp.shift", "inf", "finite"]),
    (
        "inflow  = \"boundary\"",
        "shift = \"growht\"",
        &["solver.warp.shift", "growht", "mean \"growth\""],
    ),
    ("value = \"0.2\"", "value = \"0.2*t\"", &["potential.0.value", "unknown name \"t\""]),
    ("f = \"1 if x^2", "f = \"t if x^2", &["initial.f", "unknown name \"t\""]),
];

/// Numbers of cells.
const CELLS: &[Row] = &[
    (X, "x = { lower = -1.5, upper = 1.5, cells = 0 }", &["axis.0.x.cells", "0", "at least 1"]),
    (X, "x = { lower = -1.5, upper = 1.5, cells = -7 }", &["axis.0.x.cells", "-7", "at least 1"]),
    (X, "x = { lower = -1.5, upper = 1.5, cells = 12.5 }", &["axis.0.x.cells", "12.5", "whole"]),
    (
        X,
        "x = { lower = -1.5, upper = 1.5, cells = 10000000000000000 }",
        &["axis.0.x.cells", "memory"],
    ),
    (
        X,
        "x = { lower = -1.5, upper = 1.5, cells = 99999999999999999999 }",
        &["axis.0.x.cells", "99999999999999999999"],
    ),
    (X, "x = { lower = -1.5, upper = 1.5 }", &["axis.0.x.cells", "missing"]),
];

/// Bounds of axes.
const BOUNDS: &[Row] = &[
    (
        X,
        "x = { lower = 1.5, upper = -1.5, cells = 128 }",
        &["axis.0.x.upper", "-1.5", "above", "1.5"],
    ),
    (X, "x = { lower = 1.5, upper = 1.5, cells = 128 }", &["axis.0.x.upper", "1.5", "above"]),
    (
        X,
        "x = { lower = 1.0, upper = 1.0000000000000002, cells = 128 }",
        &["axis.0.x", "double precision"],
    ),
    (X, "x = { lower = -1e308, upper = 1e308, cells = 128 }", &["axis.0.x", "1e100"]),
];

/// Numbers that are not finite, or out of their range.
const RANGES: &[Row] = &[
    (X, "x = { lower = nan, upper = 1.5, cells = 128 }", &["axis.0.x.lower", "nan", "finite"]),
    (X, "x = { lower = -1.5, upper = inf, cells = 128 }", &["axis.0.x.upper", "inf", "finite"]),
    (X, "x = { lower = -1e999, upper = 1.5, cells = 128 }", &["axis.0.x.lower", "1e999", "finite"]),
    ("end = 1.0", "end = nan", &["time.end", "nan", "finite"]),
    ("end = 1.0", "end = -inf", &["time.end", "inf", "finite"]),
    ("end = 1.0", "end = 0", &["time.end", "0", "above 0"]),
    ("end = 1.0", "end = -1.0", &["time.end", "-1", "above 0"]),
    ("cfl        = 0.9", "cfl = 1.5", &["solver.classical.cfl", "1.5", "at most 1"]),
];

/// Tolerances.
const TOLERANCES: &[Row] = &[
    ("tolerance = 1e-6", "tolerance = 0", &["solver.tolerance", "0", "above 0", "0.1"]),
    ("tolerance = 1e-6", "tolerance = -1e-6", &["solver.tolerance", "-1e-6", "above 0"]),
    ("tolerance = 1e-6", "tolerance = 1", &["solver.tolerance", "1", "at most 0.1"]),
    ("tolerance = 1e-6", "tolerance = nan", &["solver.tolerance", "nan", "finite"]),
];

/// Formulas, and the regions in which they hold.
const FORMULAS: &[Row] = &[
    ("value = \"0.2\"", "value = \"0.2 +* x\"", &["potential.0.value", "0.2 +* x", "character 6"]),
    ("value = \"0.2\"", "value = \"0.2*v\"", &["potential.0.value", "0.2*v", "\"v\""]),
    ("value = \"0.2\"", "value = \"(1 + 2\"", &["potential.0.value", "(1 + 2"]),
    ("value = \"0.2\"", "value = \"\"", &["potential.0.value"]),
    ("where = \"x < 0\"", "where = \"x < < 0\"", &["potential.0.where", "x < < 0", "character 5"]),
    ("where = \"x < 0\"", "where = \"y < 0\"", &["potential.0.where", "\"y\"", "known here: x"]),
    ("where = \"x < 0\"", "where = \"sine(x) < 0\"", &["potential.0.where", "\"sine\"", "sin"]),
    (
        "value = \"0\"                                     # low side",
        "where = \"x > 0\"\nvalue = \"0\"  # low side",
        &["potential.1.where", "x > 0", "last"],
    ),
    ("where = \"x < 0\"", "", &["potential.0.where", "missing", "last"]),
];

/// Choices among words.
const CHOICES: &[Row] = &[
    (
        "interface = \"hat\"",
        "interface = \"hatt\"",
        &["scheme.interface", "hatt", "mean \"hat\"", "conservative"],
    ),
    (
        "method    = \"schrodingerized\"",
        "method = \"classic\"",
        &["solver.method", "mean \"classical\""],
    ),
    (
        "weights = \"dissipative\"",
        "weights = \"dissipatif\"",
        &["solver.warp.weights", "mean \"dissipative\"", "none"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"gausian\"",
        &["solver.warp.profile", "mean \"gaussian\"", "low-somma"],
    ),
    (
        "integrator = \"exponential\"",
        "integrator = \"rk4\"",
        &["solver.classical.integrator", "rk4", "ssp-rk3"],
    ),
];

/// Parameters of profiles.
const PROFILES: &[Row] = &[
    (
        "profile = \"planned\"",
        "profile = \"gaussian\"\nalpha = 2",
        &["solver.warp.alpha", "2", "exponential"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"smooth\"\norder = 17",
        &["solver.warp.order", "17", "between 1 and 16"],
    ),
    ("profile = \"planned\"", "profile = \"acl\"\nbeta = 1.0", &["solver.warp.beta", "0.95"]),
    (
        "profile = \"planned\"",
        "profile = \"designed\"\npoints = 32",
        &["solver.warp.points", "designed", "gaussian"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"designed\"\ninterval = [-50, 90]",
        &["solver.warp.interval", "designed", "gaussian"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"gaussian\"\npoints = 33",
        &["solver.warp.points", "33", "even"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"gaussian\"\ninterval = [1, 2]",
        &["solver.warp.interval", "[1, 2]", "below"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"gaussian\"\ninterval = [-1, 2, 3]",
        &["solver.warp.interval", "two numbers"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"gaussian\"\nrecovery = -1",
        &["solver.warp.recovery", "-1", "between 0"],
    ),
    (
        "profile = \"planned\"",
        "profile = \"gaussian\"\nshare = 2",
        &["solver.warp.share", "2", "between 0.001 and 1"],
    ),
];

/// Keys of the exact solution.
const EXACT: &[Row] = &[
    ("kind = \"characteristics\"", "kind = \"exact\"", &["exact.kind", "exact", "characteristics"]),
    ("kind = \"characteristics\"", "kind = \"characteristics\"\nf = \"0\"", &["exact.f", "either"]),
    (
        "kind = \"characteristics\"",
        "kind = \"characteristics\"\nmoments = \"start\"",
        &["exact.moments", "start", "all", "end"],
    ),
    ("kind = \"characteristics\"", "moments = \"end\"", &["exact.moments", "exact.kind"]),
];

/// Keys of the output.
const OUTPUT: &[Row] = &[
    ("recovery_points = 2", "recovery_points = 3", &["output.recovery_points", "3", "1", "2"]),
    (
        "recovery_points = 2",
        "recovery_points = 2\nplateau = { points = 1 }",
        &["output.plateau.points", "1", "at least 2"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nplateau = { from = 2, to = 1 }",
        &["output.plateau.to", "above from = 2"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nmoment_times = [0.5, 1.0]",
        &["output.moment_times", "1 given", "below time.end = 1"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nfield_times = 0.5",
        &["output.field_times", "0.5", "list of numbers"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nmoments_every = 0",
        &["output.moments_every", "at least 0.0001 expected"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\ncompression = 10",
        &["output.compression", "10", "0 (none) to 9"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\ncompression = \"gzip\"",
        &["output.compression", "gzip", "whole number"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nchunks = [8]",
        &["output.chunks", "list of 2 whole numbers"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nchunks = [8, 0]",
        &["output.chunks", "whole numbers above 0"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nchunks = [2, 2]\nfields_every = 0.1",
        &["output.chunks", "chunks at 10 times with fields; at most 16384"],
    ),
    (
        "recovery_points = 2",
        "recovery_points = 2\nchunks = [1, 128]\nmoments_every = 0.005",
        &["output.chunks", "chunks at 200 times with moments; at most 16384"],
    ),
    ("recovery_points = 2", "recovery_points = 2\nxdmf = 1", &["output.xdmf", "true or false"]),
];

/// Text that is not TOML.
const INVALID: &[Row] = &[
    ("end = 1.0", "end = = 1.0", &[]),
    ("end = 1.0", "end = 1.0 2.0", &[]),
    ("end = 1.0", "end = 1.0 s", &["numbers have no units"]),
    ("end = 1.0", "end = 1,0", &["decimal point"]),
    ("interface = \"hat\"", "interface = \"hat", &[]),
    ("interface = \"hat\"", "interface = hat", &["texts are in quotes"]),
    ("end = 1.0", "end = 2*pi", &["formulas and other texts are in quotes"]),
    ("end = 1.0", "end = -pi", &["formulas and other texts are in quotes"]),
    ("end = 1.0", "end = 2pi", &["formulas and other texts are in quotes"]),
    ("recovery_points = 2", "recovery_points = 2\n[time]", &["time"]),
];

/// The tables above.
const TABLES: &[&[Row]] = &[
    UNKNOWN_KEYS, WRONG_TYPES, INFLOW_AND_SHIFT, CELLS, BOUNDS, RANGES, TOLERANCES, FORMULAS,
    CHOICES, PROFILES, EXACT, OUTPUT, INVALID,
];

#[test]
fn mistakes_in_a_file_are_reported_with_their_line() {
    all_refused(&TABLES.concat(), |(old, new, wording), place| {
        let (path, mut line) = edited(place, old, new);
        // If the new text has two lines, the mistake is on the second one.
        if new.contains('\n') && !new.starts_with("where") {
            line += 1;
        }
        let path = path.display().to_string();
        // A missing key is reported for its table, which starts on an earlier line.
        let location =
            if wording.contains(&"missing") { path.clone() } else { format!("{path}:{line}:") };
        let wording = wording.iter().map(|s| (*s).to_owned());
        Mistake { path, settings: Vec::new(), wording: wording.chain([location]).collect() }
    });
}
