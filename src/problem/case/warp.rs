//! `[solver.warp]`: all settings of the auxiliary variable `p`.

use crate::base::error::Result;
use crate::problem::case::alpha::Alpha;
use crate::problem::case::file::CaseFile;
use crate::problem::case::initial::LiouvilleField;
use crate::problem::case::reader::{Formula, List, NumberOr, Words};
use crate::problem::limits::{
    BETAS, LARGEST_INTERVAL_END, LARGEST_NUMBER, LARGEST_RECOVERY, LARGEST_SHIFT, LOW_SOMMA_POINTS,
    MOST_ORDER, MOST_POINTS, SIGMAS,
};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Default of `solver.warp.order`.
pub const DEFAULT_ORDER: usize = 8;
/// Default of `solver.warp.beta`.
pub const DEFAULT_BETA: f64 = 0.75;

/// The profile `g(p)` with its parameter (see [`crate::schrodingerization::profile`]).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum ProfileChoice {
    /// `Designed` or `Gaussian`, whichever is planned to take less work.
    Planned,
    /// A trigonometric polynomial that is `e^{−p}` where it must be, by least squares.
    Designed,
    /// `e^{−p}` cut off by a normal distribution function.
    Gaussian {
        /// The width `σ > 0` of the switch; planned if not given.
        #[serde(skip_serializing_if = "Option::is_none")]
        sigma: Option<f64>,
    },
    /// `e^{−p}` for `p ≥ 0`, `e^{αp}` for `p < 0` (the paper's).
    Exponential {
        /// The rate `α`, which may depend on `p`.
        alpha: Alpha,
    },
    /// `e^{−|p|}` with the polynomial of degree `2r+1` between −1 and 0 that is smooth to `r`
    /// derivatives.
    Smooth {
        /// The number `r` of continuous derivatives.
        order: usize,
    },
    /// `e^{−|p|}` convolved with a Gaussian, read at `c` (Low and Somma, arXiv 2508.19238).
    LowSomma {
        /// The recovery point `c > 0`; planned if not given.
        c: Option<f64>,
    },
    /// The kernel of An, Childs and Lin (arXiv 2312.03916).
    Acl {
        /// The exponent `β`, within [`BETAS`](crate::problem::limits::BETAS).
        beta: f64,
    },
}

impl ProfileChoice {
    /// Whether the profile is a series that is known on its domain only, and no function on the
    /// line.
    pub fn is_series(&self) -> bool {
        matches!(self, Self::Designed)
    }
}

impl fmt::Display for ProfileChoice {
    /// Prints the name of the profile and its parameter.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Planned => f.write_str("planned"),
            Self::Designed => f.write_str("designed"),
            Self::Gaussian { sigma: None } => f.write_str("gaussian, planned sigma"),
            Self::Gaussian { sigma: Some(sigma) } => write!(f, "gaussian, sigma {sigma:.4}"),
            Self::Exponential { alpha: Alpha::Constant(alpha) } if *alpha >= 10.0 => {
                write!(f, "exponential, alpha {alpha:.2}")
            }
            Self::Exponential { alpha } => write!(f, "exponential, alpha {alpha:.4}"),
            Self::Smooth { order } => write!(f, "smooth, order {order}"),
            Self::LowSomma { c: None } => f.write_str("low-somma, planned c"),
            Self::LowSomma { c: Some(c) } => write!(f, "low-somma, c {c:.4}"),
            Self::Acl { beta } => write!(f, "acl, beta {beta:.4}"),
        }
    }
}

/// The source of the Fourier coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coefficients {
    /// Values of `ĝ` itself.
    #[default]
    Analytic,
    /// The discrete Fourier transform of samples of `g` on `[L, R)` (the paper's).
    Sampled,
}

/// How `u` is read from the warped field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RecoveryMethod {
    /// From one point: `e^{p◇} v(p◇)`.
    #[default]
    Point,
    /// From the integral of `v` over `p ≥ p◇`.
    Integral,
    /// From several points at and above `p◇`, by least squares.
    LeastSquares,
}

/// How the inflow becomes part of a homogeneous system.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Embedding {
    /// An auxiliary unknown for each row with inflow.
    #[default]
    Boundary,
    /// An auxiliary unknown for every row (the paper's).
    Full,
    /// One auxiliary unknown for all rows.
    Scalar,
}

/// `δ`, the initial value of the auxiliary unknowns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Delta {
    /// Chosen by the plan from the growth that the auxiliary unknowns add.
    Planned,
    /// `δ = max |b|` (the paper's).
    #[serde(rename = "max")]
    Largest,
    /// `δ` is this number.
    Given(f64),
}

impl Delta {
    /// `δ`, unless it is planned; `largest` is the largest inflow.
    pub fn given(self, largest: f64) -> Option<f64> {
        match self {
            Self::Planned => None,
            Self::Largest => Some(largest),
            Self::Given(delta) => Some(delta),
        }
    }
}

/// `σ` of the spectral shift `u = e^{σt} ũ`, `ũ' = (A − σ) ũ`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shift {
    /// `σ` is the bound on the growth rate, so that `ũ` does not grow.
    Growth,
    /// `σ` is this number.
    Given(f64),
}

impl Shift {
    /// `σ` for a growth rate of at most `growth`.
    pub fn of(self, growth: f64) -> f64 {
        match self {
            Self::Growth => growth,
            Self::Given(sigma) => sigma,
        }
    }
}

/// The settings of `[solver.warp]`, after the checks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Warp {
    /// The profile `g(p)` and its parameter.
    pub profile: ProfileChoice,
    /// The source of the Fourier coefficients.
    pub coefficients: Coefficients,
    /// The interval `[L, R]` in `p`; planned if not given.
    pub interval: Option<[f64; 2]>,
    /// The number `N_p` of points in `p`; planned if not given.
    pub points: Option<usize>,
    /// The recovery point `p◇`; planned if not given.
    pub recovery: Option<f64>,
    /// How the field is read from the warped field.
    pub recovery_method: RecoveryMethod,
    /// Whether the unknowns have dissipative weights.
    pub weights: bool,
    /// How the inflow becomes part of a homogeneous system.
    pub inflow: Embedding,
    /// The initial value `δ` of the auxiliary unknowns.
    pub delta: Delta,
    /// The spectral shift `σ` in `u = e^{σt} ũ`.
    pub shift: Shift,
    /// The part of `solver.tolerance` to which the profile is planned.
    pub share: f64,
}

impl Warp {
    /// The profile to plan. `Planned` becomes the Gaussian if a key is given that a designed
    /// profile does not take, as that one is not a function on the whole line.
    pub fn choice(&self) -> ProfileChoice {
        match (&self.profile, self.key_without_design()) {
            (ProfileChoice::Planned, Some(_)) => ProfileChoice::Gaussian { sigma: None },
            (given, _) => given.clone(),
        }
    }

    /// The first given key that a designed profile does not take.
    pub fn key_without_design(&self) -> Option<&'static str> {
        let sampled = self.coefficients == Coefficients::Sampled;
        let keys = [
            ("coefficients", sampled),
            ("interval", self.interval.is_some()),
            ("points", self.points.is_some()),
        ];
        keys.into_iter().find(|(_, given)| *given).map(|(key, _)| key)
    }

    /// Refuses embeddings that several fields cannot share, as there is one matrix for all fields.
    pub fn check_embedding(&self, file: &CaseFile<'_>, fields: &[LiouvilleField]) -> Result<()> {
        let key = "solver.warp.inflow";
        if fields.len() > 1 && fields.iter().any(LiouvilleField::varies) {
            return file.refuse(
                key,
                "inflow may depend on t only with initial.f; the auxiliary unknowns of \
                 measure-valued data are constant in time",
            );
        }
        let entering = fields.iter().filter(|f| f.enters()).count();
        if entering > 1 && self.inflow == Embedding::Scalar {
            return file.refuse(
                key,
                format!(
                    "\"scalar\" couples one unknown to all rows by the inflow of one field, and \
                     {entering} fields have inflow here; choose \"boundary\" or \"full\""
                ),
            );
        }
        Ok(())
    }
}

/// `[solver.warp]` as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct WarpTable {
    profile: ProfileName,
    alpha: Option<Formula>,
    order: Option<i64>,
    sigma: Option<f64>,
    c: Option<f64>,
    beta: Option<f64>,
    coefficients: Coefficients,
    interval: Option<List<f64>>,
    points: Option<i64>,
    recovery: Option<f64>,
    recovery_method: RecoveryMethod,
    weights: WeightsKey,
    inflow: Embedding,
    delta: Option<NumberOr<DeltaWord>>,
    shift: Option<NumberOr<ShiftWord>>,
    share: Option<f64>,
}

/// The words that `solver.warp.profile` takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ProfileName {
    #[default]
    Planned,
    Designed,
    Gaussian,
    Exponential,
    Smooth,
    LowSomma,
    Acl,
}

/// The words that `solver.warp.weights` takes.
#[derive(Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum WeightsKey {
    #[default]
    Dissipative,
    None,
}

/// The words that `solver.warp.delta` takes instead of a number.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum DeltaWord {
    Max,
}

impl Words for DeltaWord {
    const ALL: &'static [&'static str] = &["max"];
}

/// The words that `solver.warp.shift` takes instead of a number.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ShiftWord {
    Growth,
}

impl Words for ShiftWord {
    const ALL: &'static [&'static str] = &["growth"];
}

impl WarpTable {
    /// Checks the settings for a run of duration `time`.
    pub fn check(&self, file: &CaseFile<'_>, time: f64) -> Result<Warp> {
        let interval = self.interval(file)?;
        let warp = Warp {
            profile: self.profile(file)?,
            coefficients: self.coefficients,
            interval,
            points: self.points(file)?,
            recovery: self.recovery(file, interval)?,
            recovery_method: self.recovery_method,
            weights: self.weights == WeightsKey::Dissipative,
            inflow: self.inflow,
            delta: self.delta(file)?,
            shift: self.shift(file, time)?,
            share: self.share(file)?,
        };
        match warp.key_without_design() {
            Some(key) if warp.profile.is_series() => file.refuse(
                &format!("solver.warp.{key}"),
                "needs a profile that is a function on the whole line, and solver.warp.profile = \
                 \"designed\" is a series that is known on its domain only; choose \"gaussian\" or \
                 another profile, or leave the key out",
            ),
            _ => Ok(warp),
        }
    }

    /// The profile with its own parameter. Parameters of other profiles are refused.
    fn profile(&self, file: &CaseFile<'_>) -> Result<ProfileChoice> {
        let parameters = [
            ("sigma", "gaussian", ProfileName::Gaussian),
            ("alpha", "exponential", ProfileName::Exponential),
            ("order", "smooth", ProfileName::Smooth),
            ("c", "low-somma", ProfileName::LowSomma),
            ("beta", "acl", ProfileName::Acl),
        ];
        for (name, profile, own) in parameters {
            let key = format!("solver.warp.{name}");
            if own != self.profile && file.has(&key) {
                let message = format!("belongs to solver.warp.profile = \"{profile}\" only");
                return file.refuse(&key, message);
            }
        }
        let within = |name: &str, value: f64, limits: [f64; 2]| {
            file.between(&format!("solver.warp.{name}"), value, limits)
        };
        Ok(match self.profile {
            ProfileName::Planned => ProfileChoice::Planned,
            ProfileName::Designed => ProfileChoice::Designed,
            ProfileName::Gaussian => ProfileChoice::Gaussian {
                sigma: self.sigma.map(|s| within("sigma", s, SIGMAS)).transpose()?,
            },
            ProfileName::Exponential => {
                ProfileChoice::Exponential { alpha: Alpha::read(file, self.alpha.as_ref())? }
            }
            ProfileName::Smooth => {
                let order = self
                    .order
                    .map_or(Ok(DEFAULT_ORDER), |order| file.count("solver.warp.order", order, 1))?;
                within("order", order as f64, [1.0, MOST_ORDER as f64])?;
                ProfileChoice::Smooth { order }
            }
            ProfileName::LowSomma => ProfileChoice::LowSomma {
                c: self.c.map(|c| within("c", c, LOW_SOMMA_POINTS)).transpose()?,
            },
            ProfileName::Acl => ProfileChoice::Acl {
                beta: within("beta", self.beta.unwrap_or(DEFAULT_BETA), BETAS)?,
            },
        })
    }

    /// Checks `solver.warp.interval`, `[L, R]`.
    fn interval(&self, file: &CaseFile<'_>) -> Result<Option<[f64; 2]>> {
        let key = "solver.warp.interval";
        let Some(List(ends)) = &self.interval else { return Ok(None) };
        let &[lower, upper] = ends.as_slice() else {
            return file.refuse(key, "a list of two numbers, [L, R], expected");
        };
        if lower >= 0.0 || upper <= 0.0 {
            let message = format!(
                "[{lower}, {upper}] given; L below 0 and R above 0 expected, as the profile \
                 changes at 0"
            );
            return file.refuse(key, message);
        }
        if -lower > LARGEST_INTERVAL_END || upper > LARGEST_INTERVAL_END {
            let message = format!(
                "[{lower}, {upper}] given; ends between -{LARGEST_INTERVAL_END:e} and \
                 {LARGEST_INTERVAL_END:e} expected"
            );
            return file.refuse(key, message);
        }
        Ok(Some([lower, upper]))
    }

    /// Checks `solver.warp.points`, `N_p`.
    fn points(&self, file: &CaseFile<'_>) -> Result<Option<usize>> {
        let key = "solver.warp.points";
        let Some(points) = self.points else { return Ok(None) };
        let points = file.count(key, points, 2)?;
        if !points.is_multiple_of(2) || points > MOST_POINTS {
            return file.refuse(key, format!("must be even, and at most {MOST_POINTS}"));
        }
        Ok(Some(points))
    }

    /// Checks `solver.warp.recovery`, `p◇`.
    fn recovery(&self, file: &CaseFile<'_>, interval: Option<[f64; 2]>) -> Result<Option<f64>> {
        let key = "solver.warp.recovery";
        let Some(point) = self.recovery else { return Ok(None) };
        file.between(key, point, [0.0, LARGEST_RECOVERY])?;
        match interval {
            Some([_, upper]) if point >= upper => {
                let message = format!("must be below the end of solver.warp.interval, {upper}");
                file.refuse(key, message)
            }
            _ => Ok(Some(point)),
        }
    }

    /// Checks `solver.warp.delta`: a number or `"max"`.
    fn delta(&self, file: &CaseFile<'_>) -> Result<Delta> {
        let least = 1.0 / LARGEST_NUMBER;
        let message = || {
            format!(
                "must be above 0, between {least:e} and {LARGEST_NUMBER:e}; or \"max\" for \
                 max |b|; leave it out to have it planned"
            )
        };
        match self.delta {
            None => Ok(Delta::Planned),
            Some(NumberOr::Word(DeltaWord::Max)) => Ok(Delta::Largest),
            Some(NumberOr::Number(delta)) => file
                .within("solver.warp.delta", delta, least..=LARGEST_NUMBER, message)
                .map(Delta::Given),
        }
    }

    /// Checks `solver.warp.share`: a part of the tolerance, by default all of it.
    fn share(&self, file: &CaseFile<'_>) -> Result<f64> {
        const LEAST: f64 = 1e-3;
        let share = self.share.unwrap_or(1.0);
        file.between("solver.warp.share", share, [LEAST, 1.0])
    }

    /// Checks `solver.warp.shift`: a number or `"growth"`, by default 0.
    fn shift(&self, file: &CaseFile<'_>, time: f64) -> Result<Shift> {
        let key = "solver.warp.shift";
        let shift = match self.shift {
            None => 0.0,
            Some(NumberOr::Word(ShiftWord::Growth)) => return Ok(Shift::Growth),
            Some(NumberOr::Number(shift)) => shift,
        };
        file.within(key, shift, -LARGEST_NUMBER..=LARGEST_NUMBER, || {
            format!("must be between -{LARGEST_NUMBER:e} and {LARGEST_NUMBER:e}")
        })?;
        let growth = shift * time;
        file.within(key, growth, -LARGEST_SHIFT..=LARGEST_SHIFT, || {
            format!(
                "times a duration of {time:e} is {growth:.1}; from -{LARGEST_SHIFT} to \
                 {LARGEST_SHIFT} expected, as e^{{shift T}} leaves no digits beyond"
            )
        })?;
        Ok(Shift::Given(shift))
    }
}
