//! The ratios of the bounds on the spectra of `S` and `H` to the values that Lanczos finds.

use crate::dense::{case, case_path, noise};
use faer::{Mat, Side};
use num_complex::Complex64;
use phasewarp::matrix::bounds::{Bounds, SpectralInterval};
use phasewarp::problem::case::Case;
use phasewarp::scheme::rows::{Row, Scheme};

/// The number of Lanczos steps.
const STEPS: usize = 90;

/// The values of `μ` for which `μS + iK` is compared.
const MUS: [f64; 4] = [0.0, 0.5, -2.0, 9.0];

/// The number of these forms and, last, `S` alone.
const FORMS: usize = MUS.len() + 1;

/// A value for each form. Their Krylov spaces are built at the same time, which reads the matrix
/// once.
type Each<T> = [T; FORMS];

/// `D A D⁻¹` and its transpose, by rows.
struct Sparse {
    rows: [Vec<Vec<(usize, f64)>>; 2],
}

/// The tridiagonal matrix of a Krylov space.
#[derive(Default)]
struct Tridiagonal {
    diagonal: Vec<f64>,
    /// The entries next to the diagonal, and last the norm of the remaining vector.
    beside: Vec<f64>,
}

impl Tridiagonal {
    /// Whether the space cannot grow.
    fn is_over(&self) -> bool {
        self.beside.last().is_some_and(|&b| b < 1e-12)
    }

    /// The least and the largest eigenvalue.
    fn ends(&self) -> [f64; 2] {
        let m = self.diagonal.len();
        let t = Mat::from_fn(m, m, |i, j| match i.abs_diff(j) {
            0 => self.diagonal[i],
            1 => self.beside[i.min(j)],
            _ => 0.0,
        });
        let values = t.self_adjoint_eigenvalues(Side::Lower).expect("finite entries");
        [values[0], values[m - 1]]
    }
}

impl Sparse {
    fn new(case: &Case) -> Self {
        let space = &case.space;
        let scheme = Scheme::whole(case).expect("V is finite");
        let root: Vec<f64> =
            (0..space.cells()).map(|i| space.relative_volume(&space.cell(i)).sqrt()).collect();
        let mut rows = [vec![Vec::new(); root.len()], vec![Vec::new(); root.len()]];
        let mut row = Row::default();
        for i in 0..root.len() {
            scheme.row(&mut row, i);
            for &(j, a) in &row.entries {
                let weighted = a * root[i] / root[j];
                rows[0][i].push((j, weighted));
                rows[1][j].push((i, weighted));
            }
        }
        Self { rows }
    }

    /// The product of each form with its vector in `x`.
    fn apply(&self, x: &[Each<Complex64>]) -> Vec<Each<Complex64>> {
        let sum = |row: &[(usize, f64)]| {
            let mut sum = Each::<Complex64>::default();
            for &(j, a) in row {
                sum.iter_mut().zip(&x[j]).for_each(|(sum, x)| *sum += x * a);
            }
            sum
        };
        let factors: Each<Complex64> = std::array::from_fn(|k| match MUS.get(k) {
            Some(&mu) => 0.5 * Complex64::new(mu, 1.0),
            None => Complex64::new(0.5, 0.0),
        });
        let [a, t] = &self.rows;
        let products = a.iter().zip(t).map(|(a, t)| {
            let (a, t) = (sum(a), sum(t));
            std::array::from_fn(|k| factors[k] * a[k] + factors[k].conj() * t[k])
        });
        products.collect()
    }

    /// The least and the largest eigenvalue of each form on a Krylov space of `steps` vectors:
    /// inner bounds of its spectrum.
    fn ends(&self, steps: usize) -> Each<[f64; 2]> {
        let size = self.rows[0].len();
        let norms = |x: &[Each<Complex64>]| -> Each<f64> {
            std::array::from_fn(|k| x.iter().map(|x| x[k].norm_sqr()).sum::<f64>().sqrt())
        };
        let scaled = |x: Vec<Each<Complex64>>, by: Each<f64>| -> Vec<Each<Complex64>> {
            x.into_iter().map(|x| std::array::from_fn(|k| x[k] / by[k])).collect()
        };
        let start = |i| [Complex64::new(noise(i, 1), noise(i, 2)); FORMS];
        let x: Vec<_> = (0..size).map(start).collect();
        let lengths = norms(&x);
        let mut x = scaled(x, lengths);
        let mut before = vec![Each::default(); size];
        let mut spaces: Each<Tridiagonal> = Default::default();
        for _ in 0..steps.min(size) {
            let mut y = self.apply(&x);
            let last: Each<f64> =
                std::array::from_fn(|k| spaces[k].beside.last().copied().unwrap_or(0.0));
            let mut a = Each::<f64>::default();
            for ((y, b), x) in y.iter_mut().zip(&before).zip(&x) {
                for k in 0..FORMS {
                    y[k] -= b[k] * last[k];
                    a[k] += (x[k].conj() * y[k]).re;
                }
            }
            for (y, x) in y.iter_mut().zip(&x) {
                (0..FORMS).for_each(|k| y[k] -= x[k] * a[k]);
            }
            let b = norms(&y);
            for (k, space) in spaces.iter_mut().enumerate().filter(|(_, s)| !s.is_over()) {
                space.diagonal.push(a[k]);
                space.beside.push(b[k]);
            }
            if spaces.iter().all(Tridiagonal::is_over) {
                break;
            }
            before = x;
            // A space that cannot grow stays as it is, and its later vectors are not used.
            x = scaled(y, b.map(|b| b.max(f64::MIN_POSITIVE)));
        }
        std::array::from_fn(|k| spaces[k].ends())
    }
}

/// Checks the bounds of a case. Returns the largest ratio of an interval, or of the bound of `S`,
/// to the value that Lanczos finds.
fn widest(name: &str, case: &Case) -> f64 {
    let bounds = Bounds::new(case).expect("V is finite");
    let generator = Sparse::new(case);
    let ends = generator.ends(STEPS);
    let mut widest = 1.0f64;
    for (mu, [low, high]) in MUS.into_iter().zip(ends) {
        let SpectralInterval { centre, half_width } = bounds.interval(mu);
        let slack = 1e-12 * half_width;
        let holds = centre - half_width - slack <= low && high <= centre + half_width + slack;
        assert!(holds, "{name}, mu = {mu}: [{low}, {high}] in {centre} +- {half_width}");
        widest = widest.max(2.0 * half_width / (high - low));
    }
    let low = -ends[FORMS - 1][0];
    let allowed = bounds.dissipation;
    assert!(low <= allowed * (1.0 + 1e-12) + 1e-12, "{name}: {low} {allowed}");
    if allowed == 0.0 { widest } else { widest.max(allowed / low) }
}

/// Potentials along x: name and formulas.
const POTENTIALS: [(&str, &str); 8] = [
    ("constant", "[{value='0'}]"),
    ("step", "[{where='x<0',value='0.2'},{value='0'}]"),
    ("well", "[{where='abs(x)<0.5',value='0'},{value='0.3'}]"),
    ("reflecting step", "[{where='x<0',value='0.2',reflection='0.3'},{value='0'}]"),
    ("slope", "[{value='0.4*x'}]"),
    ("harmonic", "[{value='x^2/2'}]"),
    ("harmonic step", "[{where='x<0.25',value='x^2/2'},{value='x^2/2+0.1'}]"),
    ("wave", "[{value='0.3*cos(pi*x)'}]"),
];

/// A case in one dimension with about `nodes` unknowns per axis.
fn scene(potential: &str, degrees: [usize; 2], flux: f64, ends: &str, nodes: usize) -> Case {
    let elements = degrees.map(|k| nodes / (k + 1) / 4 * 4);
    let (ends, boundary) = match ends {
        "periodic" => ("open", "periodic"),
        _ => (ends, "inflow"),
    };
    let text = format!(
        "potential = {potential}\n[scheme]\nflux = {flux}\nends = '{ends}'\n[[axis]]\n\
         x = {{ lower = -1.0, upper = 1.0, cells = {}, degree = {}, boundary = '{boundary}' }}\n\
         v = {{ lower = -1.2, upper = 1.2, cells = {}, degree = {} }}\n\
         [initial]\nf = '1'\n[time]\nend = 1.0\n",
        elements[0], degrees[0], elements[1], degrees[1]
    );
    Case::parse("scene", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// The bounds are sharp for half of the combinations of `V`, degrees and fluxes, with open, closed
/// and periodic ends.
#[test]
fn bounds_are_sharp_in_one_dimension() {
    let mut found = Vec::new();
    for (p, (name, potential)) in POTENTIALS.iter().enumerate() {
        for (d, degrees) in
            [[0, 0], [1, 1], [2, 2], [3, 3], [4, 4], [0, 3], [3, 0], [1, 4]].iter().enumerate()
        {
            for (f, flux) in [0.0, 0.3, 0.5, 1.0].into_iter().enumerate() {
                let number = p + d + f;
                let ends = ["open", "closed", "open", "periodic"][number / 2 % 4];
                // The potential of a periodic scene must not jump at the end.
                let periodic_slope = ends == "periodic" && name.contains("slope");
                let case = scene(potential, *degrees, flux, ends, 72);
                if number % 2 == 1 || !case.is_galerkin() || periodic_slope {
                    continue;
                }
                let name = format!("{name}, degrees {degrees:?}, flux {flux}, {ends}");
                found.push((widest(&name, &case), name));
            }
        }
    }
    report(found, 1.15);
}

/// With the central flux, only the open ends dissipate. The wave is flat at the ends and steep
/// inside the elements there, and the bound uses the largest force of an element.
#[test]
fn bounds_hold_where_the_ends_alone_dissipate() {
    let case = scene(POTENTIALS[7].1, [3, 3], 0.0, "open", 72);
    report(vec![(widest("wave", &case), "wave".to_owned())], 1.35);
}

/// The bounds are sharp for the cases of `cases/` on small grids, without inflow.
#[test]
fn bounds_are_sharp_on_the_cases() {
    let files = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/cases"));
    let names = files.expect("the cases").map(|file| file.expect("a file").file_name());
    let mut names: Vec<String> = names.filter_map(|name| name.into_string().ok()).collect();
    names.retain(|name| name.ends_with(".toml"));
    names.sort();
    assert!(names.len() > 15, "{names:?}");
    let mut found = Vec::new();
    for (number, name) in names.iter().enumerate() {
        let given = case(name, &[]);
        let (n, rotated) = (given.space.dimension(), number % 3);
        let trials: &[(usize, f64)] = match n {
            1 => &[(0, 0.0), (1, 0.25), (2, 0.5), (3, 1.0), (4, 0.5), (6, 0.0), (8, 0.5)],
            2 => &[(0, 0.0), (0, 0.5), (1, 0.25), (2, 0.5), (4, 1.0)],
            _ => &[(0, 0.5), (1, 0.25), (2, 0.5)],
        };
        for (k, &(degree, flux)) in trials.iter().enumerate() {
            // Closed ends are refused with inflow.
            let ends = if given.enters() || (k + rotated) % 2 == 0 { "open" } else { "closed" };
            // Bounds are less sharp on axes with slopes and fewer than about twelve elements
            // (docs/high-order.md).
            let nodes = [if degree > 4 { 144 } else { 72 }, 12, 5][n - 1] / (degree + 1);
            let mut settings = vec![
                format!("scheme.degree={degree}"),
                format!("scheme.flux={flux}"),
                format!("scheme.ends='{ends}'"),
            ];
            for a in 0..n {
                for axis in ["x", "v"] {
                    settings.push(format!("axis.{a}.{axis}.cells={}", (nodes / 2 * 2).max(2)));
                }
            }
            let Ok(case) = Case::load(&case_path(name), &settings) else {
                assert!(degree == 0, "{name}: {settings:?}");
                continue;
            };
            let name = format!("{name}, degree {degree}, flux {flux}, {ends}");
            found.push((widest(&name, &case.without_inflow()), name));
        }
    }
    report(found, 1.15);
}

/// The bounds are sharp in two dimensions, for jumps at a corner and at a square and for slopes
/// along both axes. The limit is larger, as four elements per axis do not contain the shortest
/// waves that the bounds allow.
#[test]
fn bounds_are_sharp_in_two_dimensions() {
    let potentials = [
        "[{where='max(x,y)<0',value='0.2'},{value='0'}]",
        "[{where='max(abs(x),abs(y))<0.5',value='0'},{value='0.3'}]",
        "[{value='0.4*x^2+0.3*x*y+0.5*y^2'}]",
    ];
    let mut found = Vec::new();
    for (p, potential) in potentials.iter().enumerate() {
        for (k, degrees) in [[0, 0], [1, 1], [2, 0], [1, 3]].into_iter().enumerate() {
            let (flux, ends) =
                ([0.0, 0.3, 0.5, 1.0][(p + k) % 4], ["open", "closed"][(p + k / 2) % 2]);
            let axis = |kx: usize, kv: usize| {
                format!(
                    "[[axis]]\n\
                     x = {{ lower = -1.0, upper = 1.0, cells = {}, degree = {kx} }}\n\
                     v = {{ lower = -1.2, upper = 1.2, cells = {}, degree = {kv} }}\n",
                    (12 / (kx + 1) / 4 * 4).max(4),
                    12 / (kv + 1) / 2 * 2
                )
            };
            let text = format!(
                "potential = {potential}\n[scheme]\nflux = {flux}\nends = '{ends}'\n{}{}\
                 [initial]\nf = '1'\n[time]\nend = 1.0\n",
                axis(degrees[0], degrees[1]),
                axis(degrees[1], degrees[0])
            );
            let case = Case::parse("scene", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
            if case.is_galerkin() {
                let name = format!("{potential}, degrees {degrees:?}, flux {flux}, {ends}");
                found.push((widest(&name, &case), name));
            }
        }
    }
    report(found, 1.25);
}

/// Fails where a ratio is above `most`.
fn report(mut found: Vec<(f64, String)>, most: f64) {
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let line = |(ratio, name): &(f64, String)| format!("{ratio:.3} {name}\n");
    let worst: String = found.iter().take(30).map(line).collect();
    println!("the largest ratios of {} scenes:\n{worst}", found.len());
    assert!(found[0].0 < most, "{worst}");
}
