//! The search for a border by halving an interval.

/// The place of a border.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Located {
    /// The last number at which the condition holds.
    At(f64),
    /// The property does not hold at the first number.
    Below(f64),
    /// The property holds at the last number.
    Beyond(f64),
    /// The budget ended before it was known.
    Unknown,
}

impl Located {
    /// The place, if it was located.
    pub fn at(self) -> Option<f64> {
        match self {
            Self::At(x) => Some(x),
            _ => None,
        }
    }
}

impl std::fmt::Display for Located {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::At(x) => write!(out, "{x:.3}"),
            Self::Below(x) => write!(out, "something below {x}"),
            Self::Beyond(x) => write!(out, "something beyond {x}"),
            Self::Unknown => out.write_str("(not located within the budget)"),
        }
    }
}

/// An interval to search.
#[derive(Clone, Copy, Debug)]
pub struct Bisection {
    /// The lower end, at which the condition should hold.
    pub low: f64,
    /// The upper end, at which it should not hold.
    pub high: f64,
    /// Number of halvings.
    pub halvings: usize,
}

impl Bisection {
    /// The last number at which `holds`. Before each evaluation `is_over` decides whether to stop;
    /// both must be the same on all ranks. Collective.
    pub fn last(self, is_over: impl Fn() -> bool, mut holds: impl FnMut(f64) -> bool) -> Located {
        let (mut low, mut high) = (self.low, self.high);
        if is_over() {
            return Located::Unknown;
        }
        if !holds(low) {
            return Located::Below(low);
        }
        if holds(high) {
            return Located::Beyond(high);
        }
        for _ in 0..self.halvings {
            if is_over() {
                return Located::Unknown;
            }
            let middle = 0.5 * (low + high);
            if holds(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        Located::At(0.5 * (low + high))
    }
}
