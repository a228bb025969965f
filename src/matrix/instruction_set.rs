//! The instruction set that loops are compiled for, chosen once at the start.

use crate::base::error::{Error, Result};
use crate::matrix::vector::{self, Portable, Vector};
use std::sync::OnceLock;

/// Work that is compiled for each instruction set.
pub trait Vectorized {
    /// Does the work with vectors `V` and `ROWS` rows of a line at a time (see `step_lines`). It
    /// must be `#[inline(always)]` to be compiled for the instruction set. `FMA` is set only if the
    /// processor has fused multiply-add: elsewhere `mul_add` is a slow library call. `WHOLE` is set
    /// where the registers hold the sums of all rows of an element at once.
    fn run<V: Vector, const FMA: bool, const ROWS: usize, const WHOLE: bool>(self);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn on_avx512(work: impl Vectorized) {
    work.run::<vector::Avx512, true, 4, true>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn on_avx2(work: impl Vectorized) {
    work.run::<vector::Avx2, true, 2, false>();
}

/// The instruction set that loops are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// AVX-512.
    Avx512,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// The set that every processor of the architecture has.
    Generic,
}

/// Environment variable that names an instruction set.
pub const INSTRUCTION_SET_VARIABLE: &str = "PHASEWARP_INSTRUCTION_SET";

impl InstructionSet {
    /// The set that [`INSTRUCTION_SET_VARIABLE`] names, or else the best of this processor;
    /// determined once.
    pub fn here() -> Self {
        static HERE: OnceLock<InstructionSet> = OnceLock::new();
        let best = || Self::all().next().unwrap_or(Self::Generic);
        *HERE.get_or_init(|| Self::chosen().ok().flatten().unwrap_or_else(best))
    }

    /// The set that [`INSTRUCTION_SET_VARIABLE`] names; none if it is not set.
    ///
    /// # Errors
    /// [`Error::Input`] if this processor has no set of that name.
    pub fn chosen() -> Result<Option<Self>> {
        let Some(name) = std::env::var_os(INSTRUCTION_SET_VARIABLE) else {
            return Ok(None);
        };
        match Self::all().find(|set| name == set.name()) {
            Some(set) => Ok(Some(set)),
            None => Err(Error::Input(format!(
                "{INSTRUCTION_SET_VARIABLE}={}: this processor has {}",
                name.display(),
                Self::all().map(Self::name).collect::<Vec<_>>().join(", ")
            ))),
        }
    }

    /// Whether it rounds `a b + c` once, by a fused multiply-add. All sets that do give the same
    /// bits.
    pub fn is_fused(self) -> bool {
        match self {
            Self::Avx512 | Self::Avx2 => true,
            // Every aarch64 processor has fused multiply-add.
            Self::Generic => cfg!(target_arch = "aarch64"),
        }
    }

    /// All sets that this processor has, the best first.
    pub fn all() -> impl Iterator<Item = Self> {
        [Self::Avx512, Self::Avx2, Self::Generic].into_iter().filter(|set| set.is_here())
    }

    /// Does `work` as compiled for this set.
    ///
    /// # Panics
    /// If the processor does not have the set.
    pub fn run(self, work: impl Vectorized) {
        assert!(self.is_here(), "this processor has no {self:?}");
        match self {
            // SAFETY: the processor has AVX-512, as was just checked.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { on_avx512(work) },
            // SAFETY: the processor has AVX2 and FMA, as was just checked.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { on_avx2(work) },
            _ => {
                const FMA: bool = cfg!(target_arch = "aarch64");
                work.run::<Portable<FMA>, FMA, 2, false>();
            }
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
