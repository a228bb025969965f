//! A recovered field: its readings at the end, and its states before.

/// A field on a rank's share of the cells by each reading of the modes; by one reading, if it is
/// not recovered from modes.
#[derive(Clone, Debug)]
pub struct FieldReadings(Vec<Vec<f64>>);

impl FieldReadings {
    /// The field by its `readings`, at least one.
    pub fn new(readings: Vec<Vec<f64>>) -> Self {
        debug_assert!(!readings.is_empty());
        Self(readings)
    }

    /// The field by a single reading.
    pub fn single(field: Vec<f64>) -> Self {
        Self(vec![field])
    }

    /// The field by the first reading, which counts as the field.
    pub fn first(&self) -> &[f64] {
        &self.0[0]
    }

    /// The field by the second reading, if there is one; its distance to the first shows the error.
    pub fn second(&self) -> Option<&[f64]> {
        self.0.get(1).map(Vec::as_slice)
    }

    /// The field by each reading.
    pub fn each(&self) -> impl Iterator<Item = &[f64]> {
        self.0.iter().map(Vec::as_slice)
    }

    /// The field by the first reading, without the others.
    pub fn into_first(mut self) -> Vec<f64> {
        self.0.swap_remove(0)
    }

    /// The readings changed by `change`.
    pub fn map(self, change: impl FnMut(Vec<f64>) -> Vec<f64>) -> Self {
        Self(self.0.into_iter().map(change).collect())
    }
}

/// A field on a rank's share of the cells at the output times before the end.
#[derive(Clone, Debug, Default)]
pub struct FieldHistory {
    /// `ũ` by the first reading at each time; at times that need moments only, sums over the
    /// velocities for the moments of `f`, point by point.
    pub times: Vec<Vec<f64>>,
}
