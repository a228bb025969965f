//! `solver.warp.alpha`: `g(p) = e^{α(p) p}` for `p < 0`, the left part of the exponential profile.

use crate::base::error::Result;
use crate::base::piecewise::{Failure, Piecewise};
use crate::base::text::shortened;
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::Formula;
use crate::problem::formula::Expression;
use crate::problem::limits::{ALPHAS, EXTENSION_END, LARGEST_EXTENSION};
use serde::{Serialize, Serializer};
use std::fmt;
use std::sync::Arc;

/// Default of `solver.warp.alpha`.
pub const DEFAULT_ALPHA: f64 = 1.0;
/// The variables of formulas for `α`.
pub const NAMES: [&[&str]; 1] = [&["p"]];
/// Values of `g` up to this count as zero. Any plan tolerates more from neighbouring periods.
const NOTHING: f64 = 1e-17;

/// `α` of the exponential profile.
#[derive(Clone, Debug, PartialEq)]
pub enum Alpha {
    /// `α` is the same for every `p < 0`.
    Constant(f64),
    /// `α` depends on `p`, by a formula.
    Formula(Arc<LeftExtension>),
}

/// `e^{α(p) p}` for `p < 0`, with a formula for `α`.
#[derive(Clone, PartialEq)]
pub struct LeftExtension {
    text: String,
    /// `e^{α(p) p}` to round-off, from the point where it is no longer negligible to 0.
    pub values: Piecewise,
}

impl Alpha {
    /// Reads `solver.warp.alpha`.
    pub(crate) fn read(file: &CaseFile<'_>, given: Option<&Formula>) -> Result<Self> {
        let key = "solver.warp.alpha";
        let Some(Formula(text)) = given else { return Ok(Self::Constant(DEFAULT_ALPHA)) };
        let alpha = file.formula(key, text, &NAMES)?;
        Self::of(&alpha).or_else(|message| file.refuse(key, message))
    }

    /// `α` given by a formula whose only coordinate is `p`.
    ///
    /// # Errors
    /// A sentence that says what is wrong: a constant is out of bounds, or `g` does not decay,
    /// becomes large or changes too fast.
    pub fn of(alpha: &Expression) -> std::result::Result<Self, String> {
        let [least, most] = ALPHAS;
        match alpha.constant() {
            Some(constant) if (least..=most).contains(&constant) => Ok(Self::Constant(constant)),
            Some(_) => Err(format!("must be between {least} and {most}")),
            None => {
                let (text, values) = (alpha.text().to_owned(), extension(alpha)?);
                Ok(Self::Formula(Arc::new(LeftExtension { text, values })))
            }
        }
    }
}

/// `e^{α(p) p}`; NaN where `α` is NaN.
fn value(alpha: &Expression, p: f64) -> f64 {
    (alpha.eval(&[p]) * p).exp()
}

/// The left part of the profile, or a sentence that says why `α` gives none.
fn extension(alpha: &Expression) -> std::result::Result<Piecewise, String> {
    /// The point at which `α(0⁻)` is checked.
    const BESIDE: f64 = -1e-9;
    let most = ALPHAS[1];
    let first = alpha.eval(&[BESIDE]);
    if first.abs() > most {
        return Err(format!(
            "is {first:.4e} beside p = 0; between -{most} and {most} expected there, beyond which \
             g practically jumps"
        ));
    }
    let lower = lower_end(alpha)?;
    let fitted = Piecewise::fit(&|p| value(alpha, p), [lower, 0.0], LARGEST_EXTENSION);
    fitted.map_err(|failure| match failure {
        Failure::Unbounded { at } => unbounded(alpha, at),
        Failure::Rough { at } => {
            format!("changes too fast about p = {at:.6}; give a smoother formula, or fewer jumps")
        }
    })
}

/// `α(p)` rounded for messages.
fn shown(alpha: &Expression, p: f64) -> String {
    // Adding zero turns -0 into 0.
    format!("{:.4e}", alpha.eval(&[p]) + 0.0)
}

/// The error of a formula with which `g(p)` is too large or undefined.
fn unbounded(alpha: &Expression, p: f64) -> String {
    let (a, g) = (shown(alpha, p), value(alpha, p));
    if g.is_nan() {
        format!("is {a} at p = {p:.6}; a number expected for every p < 0")
    } else {
        format!(
            "is {a} at p = {p:.6}, where g = e^(alpha p) = {g:.1e}; at most \
         {LARGEST_EXTENSION:e} for p < 0"
        )
    }
}

/// A point below which `e^{α(p) p}` is negligible. The search ends beyond any allowed interval.
fn lower_end(alpha: &Expression) -> std::result::Result<f64, String> {
    /// Points are equally spaced down to here, and then in equal ratios down to `END`.
    const NEAR: f64 = -64.0;
    const STEP: f64 = 0.0625;
    const RATIO: f64 = 1.01;
    const END: f64 = -1e9;
    let next = |p: &f64| Some(if *p > NEAR { p - STEP } else { p * RATIO });
    let points = std::iter::successors(Some(-STEP), next).take_while(|p| *p > END);
    let mut lower = None;
    for p in points {
        let g = value(alpha, p);
        if g.is_nan() || g > LARGEST_EXTENSION {
            return Err(unbounded(alpha, p));
        }
        if g <= NOTHING {
            lower = lower.or(Some(p));
        } else if p >= EXTENSION_END {
            lower = None;
        } else {
            return Err(format!(
                "is {} at p = {p:.6}, where g = e^(alpha p) = {g:.1e} is not small; for p below \
                 {EXTENSION_END} less than {NOTHING:e} expected, as with alpha = {}",
                shown(alpha, p),
                ALPHAS[0]
            ));
        }
    }
    Ok(lower.unwrap_or(EXTENSION_END))
}

impl fmt::Debug for LeftExtension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.text, f)
    }
}

impl Serialize for Alpha {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Self::Constant(alpha) => serializer.serialize_f64(*alpha),
            Self::Formula(extension) => serializer.serialize_str(&extension.text),
        }
    }
}

impl fmt::Display for Alpha {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Largest number of characters of a formula in a message.
        const MOST_SHOWN: usize = 60;
        match self {
            Self::Constant(alpha) => fmt::Display::fmt(alpha, f),
            Self::Formula(extension) => f.write_str(&shortened(&extension.text, MOST_SHOWN)),
        }
    }
}
