//! The inner loop: one step of a Chebyshev or Lanczos recurrence for a batch of modes, in one pass
//! over the matrix.
//!
//! ```text
//! y ← a ((−iμ S + K) x + i c x) + y + coefficient · start
//! ```
//!
//! where each lane has a scale `a`, a shift `c` and a wavenumber `μ` of its own, and `start` is
//! what a series is of: a real vector that the lanes share, a vector for each lane, or nothing.
//!
//! Vectors are `[row][re: B lanes][im: B lanes]`: every operation is vertical over modes. The same
//! loop is compiled three times, for AVX-512, for AVX2 with FMA and for any processor; which one
//! runs is decided once at start.

use crate::base::error::{Error, Result};
use crate::matrix::lanes::{LANES, Lanes, StartRow, StepConstants, multiply_add};
use crate::matrix::rows::Rows;
use std::ops::Range;
use std::sync::OnceLock;

/// Nothing is added.
impl StartRow for () {
    #[inline(always)]
    fn add<const FMA: bool>(_: &[Self], _: usize, _: &[f64; LANES], _: &mut [f64; 2 * LANES]) {}
}

/// A real vector, the same in every lane.
impl StartRow for f64 {
    #[inline(always)]
    fn add<const FMA: bool>(
        start: &[Self],
        i: usize,
        coefficient: &[f64; LANES],
        out: &mut [f64; 2 * LANES],
    ) {
        let value = start[i];
        for l in 0..LANES {
            out[l] = multiply_add::<FMA>(coefficient[l], value, out[l]);
        }
    }
}

/// `S x` and `K x` of a row: sums so far.
#[derive(Clone, Copy)]
struct Products {
    s: [f64; 2 * LANES],
    k: [f64; 2 * LANES],
}

impl Products {
    const ZERO: Self = Self { s: [0.0; 2 * LANES], k: [0.0; 2 * LANES] };

    /// Adds the entries of row `i` that are not to the nodes of its line.
    #[inline(always)]
    fn add_others<const FMA: bool>(
        &mut self,
        matrix: &Rows,
        template: usize,
        i: usize,
        x: &[Lanes],
    ) {
        for (column, s, k) in matrix.others(template, i) {
            // SAFETY: every column is below the reach of the rows, which `x` has, as `step_lines`
            // asserts.
            let Lanes(value) = unsafe { x.get_unchecked(column) };
            for part in 0..2 * LANES {
                self.s[part] = multiply_add::<FMA>(s, value[part], self.s[part]);
                self.k[part] = multiply_add::<FMA>(k, value[part], self.k[part]);
            }
        }
    }

    /// The step of a row: `a ((−iμ S + K) x + i c x) + y`.
    #[inline(always)]
    fn finish<const FMA: bool>(
        &self,
        constants: &StepConstants,
        own: &[f64; 2 * LANES],
        out: &[f64; 2 * LANES],
    ) -> [f64; 2 * LANES] {
        let mut new = *out;
        for l in 0..LANES {
            let (a, c, mu) = (constants.scale[l], constants.shift[l], constants.wavenumber[l]);
            // (−iμ S + K + ic)(re + i im) = (μ S im + K re − c im) + i(−μ S re + K im + c re)
            let re = multiply_add::<FMA>(mu, self.s[LANES + l], self.k[l]);
            let im = multiply_add::<FMA>(-mu, self.s[l], self.k[LANES + l]);
            let re = multiply_add::<FMA>(-c, own[LANES + l], re);
            let im = multiply_add::<FMA>(c, own[l], im);
            new[l] = multiply_add::<FMA>(a, re, new[l]);
            new[LANES + l] = multiply_add::<FMA>(a, im, new[LANES + l]);
        }
        new
    }
}

/// The vectors of a step.
struct Vectors<'a, R> {
    y: &'a mut [Lanes],
    x: &'a [Lanes],
    start: &'a [R],
}

/// The loop over lines that are one row.
#[inline(always)]
fn step_rows<const FMA: bool, R: StartRow>(
    matrix: &Rows,
    lines: Range<usize>,
    constants: &StepConstants,
    vectors: &mut Vectors<'_, R>,
) {
    let behind = matrix.lines().cells - matrix.lines().of_cells();
    let Vectors { y, x, start } = vectors;
    let rows = lines.start + behind..lines.end + behind;
    let pairs = y[rows.clone()].iter_mut().zip(&x[rows.clone()]);
    for (i, (Lanes(out), Lanes(own))) in rows.zip(pairs) {
        let mut products = Products::ZERO;
        products.add_others::<FMA>(matrix, matrix.template(i - behind), i, x);
        let mut new = products.finish::<FMA>(constants, own, out);
        R::add::<FMA>(start, i, &constants.coefficient, &mut new);
        *out = new;
    }
}

/// The loop over lines of several rows, [`ROWS`] of them at a time: each node is read once for all
/// of these.
#[inline(always)]
fn step_nodes<const FMA: bool, R: StartRow>(
    matrix: &Rows,
    lines: Range<usize>,
    constants: &StepConstants,
    vectors: &mut Vectors<'_, R>,
) {
    let nodes = matrix.lines().nodes;
    for line in lines {
        for from in (0..nodes).step_by(ROWS) {
            let rows = LineRows { line, from };
            match nodes - from {
                1 => step_some::<FMA, 1, R>(matrix, rows, constants, vectors),
                2 => step_some::<FMA, 2, R>(matrix, rows, constants, vectors),
                3 => step_some::<FMA, 3, R>(matrix, rows, constants, vectors),
                _ => step_some::<FMA, ROWS, R>(matrix, rows, constants, vectors),
            }
        }
    }
}

/// Rows of a line whose sums stay in registers.
const ROWS: usize = 4;

/// Some rows of a line of cells, from one of its nodes on.
#[derive(Clone, Copy)]
struct LineRows {
    line: usize,
    from: usize,
}

/// A step of `COUNT` rows of a line.
#[inline(always)]
fn step_some<const FMA: bool, const COUNT: usize, R: StartRow>(
    matrix: &Rows,
    rows: LineRows,
    constants: &StepConstants,
    vectors: &mut Vectors<'_, R>,
) {
    let Vectors { y, x, start } = vectors;
    let lines = matrix.lines();
    let (first, template) = (lines.first(rows.line), matrix.template(rows.line) + rows.from);
    let dense: [&[f64]; COUNT] = std::array::from_fn(|m| matrix.dense_row(template + m));
    let mut products = [[0.0; 2 * LANES]; COUNT];
    for n in 0..lines.nodes {
        let Lanes(value) = &x[first + n * lines.stride];
        for m in 0..COUNT {
            let k = dense[m][n];
            for part in 0..2 * LANES {
                products[m][part] = multiply_add::<FMA>(k, value[part], products[m][part]);
            }
        }
    }
    for m in 0..COUNT {
        let i = first + (rows.from + m) * lines.stride;
        let mut products = Products { k: products[m], ..Products::ZERO };
        products.add_others::<FMA>(matrix, template + m, i, x);
        let mut new = products.finish::<FMA>(constants, &x[i].0, &y[i].0);
        R::add::<FMA>(start, i, &constants.coefficient, &mut new);
        y[i].0 = new;
    }
}

/// The loop over lines.
#[inline(always)]
fn step_lines<const FMA: bool, R: StartRow>(
    matrix: &Rows,
    lines: Range<usize>,
    constants: &StepConstants,
    y: &mut [Lanes],
    x: &[Lanes],
    start: &[R],
) {
    assert!(x.len() >= matrix.reach(), "vector and matrix do not fit");
    let end = matrix.lines().of_cells();
    let gathered = lines.start.min(end)..lines.end.min(end);
    let single = lines.start.max(end)..lines.end.max(end);
    let mut vectors = Vectors { y, x, start };
    step_nodes::<FMA, R>(matrix, gathered, constants, &mut vectors);
    step_rows::<FMA, R>(matrix, single, constants, &mut vectors);
}

/// The step of some lines.
pub struct Step<'a, R> {
    /// The rows.
    pub matrix: &'a Rows,
    /// The lines.
    pub lines: Range<usize>,
    /// Constants of the lanes.
    pub constants: &'a StepConstants,
    /// What is changed.
    pub y: &'a mut [Lanes],
    /// What the matrix is applied to; it reaches as far as the rows do.
    pub x: &'a [Lanes],
    /// What is added.
    pub start: &'a [R],
}

impl<R: StartRow> Compiled for Step<'_, R> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        // One by one: the compiler then knows that `y` is nothing of the others.
        step_lines::<FMA, R>(self.matrix, self.lines, self.constants, self.y, self.x, self.start);
    }
}

/// Work that is compiled for each instruction set.
pub trait Compiled {
    /// Does it. `#[inline(always)]`, as only then it is compiled for the set. `FMA` only where the
    /// processor has fused multiply-add: elsewhere `mul_add` is a slow library call.
    fn run<const FMA: bool>(self);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn on_avx512(work: impl Compiled) {
    work.run::<true>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn on_avx2(work: impl Compiled) {
    work.run::<true>();
}

/// What loops are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// AVX-512.
    Avx512,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// What every processor of the architecture has.
    Generic,
}

/// Variable of the environment that names an instruction set.
pub const VARIABLE: &str = "PHASEWARP_INSTRUCTION_SET";

impl InstructionSet {
    /// The one that [`VARIABLE`] names, else the best that this processor has; asked once.
    pub fn here() -> Self {
        static HERE: OnceLock<InstructionSet> = OnceLock::new();
        let best = || Self::all().next().unwrap_or(Self::Generic);
        *HERE.get_or_init(|| Self::chosen().ok().flatten().unwrap_or_else(best))
    }

    /// The one that [`VARIABLE`] names; none where it is not set.
    ///
    /// # Errors
    /// [`Error::Input`] where this processor has none of that name.
    pub fn chosen() -> Result<Option<Self>> {
        let Some(name) = std::env::var_os(VARIABLE) else {
            return Ok(None);
        };
        match Self::all().find(|set| name == set.name()) {
            Some(set) => Ok(Some(set)),
            None => Err(Error::Input(format!(
                "{VARIABLE}={}: this processor has {}",
                name.display(),
                Self::all().map(Self::name).collect::<Vec<_>>().join(", ")
            ))),
        }
    }

    /// Whether it rounds `a b + c` once, as a fused multiply-add does: those that do so give the
    /// same bits.
    pub fn is_fused(self) -> bool {
        match self {
            Self::Avx512 | Self::Avx2 => true,
            // Every aarch64 processor has fused multiply-add.
            Self::Generic => cfg!(target_arch = "aarch64"),
        }
    }

    /// All that this processor has, the best first.
    pub fn all() -> impl Iterator<Item = Self> {
        [Self::Avx512, Self::Avx2, Self::Generic].into_iter().filter(|set| set.is_here())
    }

    /// Does some work as it was compiled for this set.
    ///
    /// # Panics
    /// Where the processor does not have it.
    pub fn run(self, work: impl Compiled) {
        assert!(self.is_here(), "{self:?} is not there");
        match self {
            // SAFETY: the processor has AVX-512, as was just asked.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { on_avx512(work) },
            // SAFETY: the processor has AVX2 and FMA, as was just asked.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { on_avx2(work) },
            _ => work.run::<{ cfg!(target_arch = "aarch64") }>(),
        }
    }

    fn is_here(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => std::is_x86_feature_detected!("avx512f"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma")
            }
            Self::Generic => true,
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Name of the instruction set.
    pub fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Generic if cfg!(target_arch = "aarch64") => "neon",
            Self::Generic => "generic",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::rows::{Builder, Entry, Lines};

    /// Numbers of anything between −1 and 1.
    fn noise(number: usize) -> f64 {
        (number as f64 * 12.9898).sin()
    }

    fn lanes(row: usize) -> Lanes {
        Lanes(std::array::from_fn(|part| noise(100 * row + part)))
    }

    /// Rows of cells that reach around a circle and, the first ones, to ghosts behind the rows.
    fn entries(rows: usize, cells: usize, ghosts: usize) -> Vec<Vec<Entry>> {
        let row = |i: usize| {
            let mut columns = vec![i, (i + 1) % cells, (i + cells - 2) % cells];
            columns.extend((i < ghosts).then_some(rows + i));
            let entry = |(m, j): (usize, usize)| (j as u32, noise(7 * i + m), noise(3 * i + m));
            columns.into_iter().enumerate().map(entry).collect()
        };
        (0..rows).map(row).collect()
    }

    /// Every set against the formula, on rows one by one and gathered, of which the last reads the
    /// last ghost.
    #[test]
    fn steps_are_those_of_the_formula() {
        let (rows, cells, ghosts) = (27, 24, 3);
        let list = entries(rows, cells, ghosts);
        let mut builder = Builder::with_capacity(rows);
        list.iter().for_each(|row| builder.push(row));
        let single = builder.finish();
        let gathered = [(2, 3), (3, 2), (4, 1), (6, 4)]
            .map(|(nodes, stride)| single.gathered(Lines { nodes, stride, cells }));
        let x: Vec<Lanes> = (0..rows + ghosts).map(lanes).collect();
        let before: Vec<Lanes> = (0..rows).map(|i| lanes(1000 + i)).collect();
        let start: Vec<f64> = (0..rows).map(|i| noise(5 * i)).collect();
        let constants = StepConstants {
            scale: std::array::from_fn(|l| 0.5 + noise(l)),
            shift: std::array::from_fn(|l| noise(l + 10)),
            wavenumber: std::array::from_fn(|l| l as f64 - 3.0),
            coefficient: std::array::from_fn(|l| noise(l + 20)),
        };
        for (matrix, set) in gathered
            .iter()
            .chain([&single])
            .flat_map(|m| InstructionSet::all().map(move |s| (m, s)))
        {
            let mut y = before.clone();
            let lines = 0..matrix.line_count();
            let constants = &constants;
            set.run(Step { matrix, lines, constants, y: &mut y, x: &x, start: &start });
            for (i, row) in list.iter().enumerate() {
                for l in 0..LANES {
                    let at = |j: u32| [l, LANES + l].map(|part| x[j as usize].0[part]);
                    let sum = |of: fn(&Entry) -> f64, part: usize| -> f64 {
                        row.iter().map(|entry| of(entry) * at(entry.0)[part]).sum()
                    };
                    let (a, c) = (constants.scale[l], constants.shift[l]);
                    let (mu, own) = (constants.wavenumber[l], at(i as u32));
                    let re = mu * sum(|e| e.1, 1) + sum(|e| e.2, 0) - c * own[1];
                    let im = -mu * sum(|e| e.1, 0) + sum(|e| e.2, 1) + c * own[0];
                    let old = [l, LANES + l].map(|part| before[i].0[part]);
                    let expected =
                        [a * re + old[0] + constants.coefficient[l] * start[i], a * im + old[1]];
                    let found = [l, LANES + l].map(|part| y[i].0[part]);
                    for (found, expected) in found.iter().zip(expected) {
                        let close = (found - expected).abs() < 1e-13;
                        assert!(close, "{set:?} {:?} row {i} lane {l}", matrix.lines());
                    }
                }
            }
        }
    }
}
