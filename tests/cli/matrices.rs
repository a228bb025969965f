//! `phasewarp export-matrix`: its files are consistent with each other.
//! python/tests/test_matrices.py checks that they are the system of a run.

use crate::simulator::vector;
use crate::support::{Job, case, check_all, directory, near, text_of};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

const GRID: &[&str] = &["axis.0.x.cells=8", "axis.0.v.cells=6"];

/// Exports: a case, its settings, and the number of ranks.
const EXPORTS: &[(&str, &[&str], usize)] = &[
    ("example1.toml", &[], 1),
    ("example1.toml", &["inflow.value=0.3"], 2),
    ("example1.toml", &["inflow.value=0.3", "solver.warp.inflow=scalar"], 1),
    ("example1.toml", &["scheme.degree=2"], 1),
    ("example1.toml", &["solver.method=classical"], 1),
    ("harmonic_step.toml", &["solver.warp.weights=none"], 1),
];

/// The entries of a matrix by row and column, which count from 0.
pub type Entries = BTreeMap<(usize, usize), f64>;

/// Reads all entries of a file in the Matrix Market format.
pub fn matrix(path: &Path) -> Result<Entries, String> {
    let text = text_of(path)?;
    let (head, lines) = text.split_once('\n').ok_or("empty")?;
    let mirrored = match head.rsplit(' ').next() {
        Some("general") => None,
        Some("symmetric") => Some(1.0),
        Some("skew-symmetric") => Some(-1.0),
        _ => return Err(format!("{}: {head}", path.display())),
    };
    let mut numbers = lines.lines().filter(|line| !line.starts_with('%')).map(|line| {
        let words: Option<Vec<f64>> = line.split(' ').map(|word| word.parse().ok()).collect();
        words.filter(|words| words.len() == 3).ok_or(format!("{}: {line}", path.display()))
    });
    let size = numbers.next().ok_or("no size")??;
    let mut entries = Entries::new();
    let mut count = 0;
    for line in numbers {
        let line = line?;
        let (i, j, value) = (line[0] as usize - 1, line[1] as usize - 1, line[2]);
        count += 1;
        entries.insert((i, j), value);
        if let Some(sign) = mirrored.filter(|_| i != j) {
            entries.insert((j, i), sign * value);
        }
    }
    near("entries", f64::from(count), size[2], 0.0)?;
    Ok(entries)
}

#[test]
fn the_exported_parts_s_and_k_sum_to_a() {
    check_all(EXPORTS, |(name, settings, ranks)| {
        let place = directory();
        let path = place.path().display().to_string();
        let job = Job::new(["export-matrix", &case(name), "-o", &path]).set(GRID).set(settings);
        job.on(*ranks).succeed()?;
        let read = |name: &str| matrix(&place.path().join(name));
        let (a, s, k) = (read("A.mtx")?, read("S.mtx")?, read("K.mtx")?);
        let roots = vector(&place.path().join("weights.npy"))?;
        let (b, start) = (place.path().join("b_f.npy"), place.path().join("initial_f.npy"));
        let (b, start) = (vector(&b)?, vector(&start)?);
        near("unknowns", start.len() as f64, roots.len() as f64, 0.0)?;
        // D A = (S + K) D on the cells. The columns after them couple to the auxiliary unknowns r;
        // their sum is b.
        let largest = a.values().fold(0.0, |m: f64, x| m.max(x.abs()));
        let mut entering = vec![0.0; b.len()];
        let places = a.keys().chain(s.keys()).chain(k.keys());
        for &(i, j) in places.collect::<BTreeSet<_>>() {
            let at = |m: &Entries| m.get(&(i, j)).copied().unwrap_or(0.0);
            let sum = (at(&s) + at(&k)) * roots[j] / roots[i];
            match (i < b.len(), j < b.len()) {
                (true, true) => near(&format!("A[{i}, {j}]"), at(&a), sum, 1e-12 * largest)?,
                (true, false) => entering[i] += sum * start[j] / roots[j],
                _ => near(&format!("row {i} of an auxiliary unknown"), sum, 0.0, 1e-12)?,
            }
        }
        if settings.contains(&"solver.method=classical") {
            return Ok(());
        }
        for (i, (b, entering)) in b.iter().zip(entering).enumerate() {
            near(&format!("b[{i}]"), *b, entering, 1e-12 * largest)?;
        }
        let enters = b.iter().any(|b| *b != 0.0);
        near("enters", f64::from(enters), f64::from(settings.contains(&"inflow.value=0.3")), 0.0)
    });
}

#[test]
fn cases_that_matrices_do_not_describe_are_refused() {
    let rows: &[(&[&str], &str)] = &[
        (&["inflow.value=t"], "inflow.value depends on t"),
        (
            &["initial={warped=\"none.h5\"}", "exact={f=\"0\"}"],
            "initial.warped: the start is in that file",
        ),
    ];
    check_all(rows, |(settings, wording)| {
        let place = directory();
        let path = place.path().display().to_string();
        let job = Job::new(["export-matrix", &case("example1.toml"), "-o", &path]);
        job.set(GRID).set(settings).is_refused(&[wording])
    });
}
