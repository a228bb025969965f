//! The keys that give the degrees of a case, for messages: an axis may have a key of its own.

use crate::problem::case::{Case, DEGREE_KEY};

impl Case {
    /// The key that gives the degree of axis number `k` (first the space axes, then those of the
    /// velocity): an axis may have its own.
    pub fn degree_key(&self, k: usize) -> String {
        let n = self.space.dimension();
        let own =
            if k < n { format!("axis.{k}.x.degree") } else { format!("axis.{}.v.degree", k - n) };
        if self.settings.contains_key(&own) { own } else { DEGREE_KEY.to_owned() }
    }

    /// The keys that give this `degree` to axes of more than one cell, for messages:
    /// `axis.0.x.degree, axis.0.v.degree and scheme.degree`. [`DEGREE_KEY`] if no axis has this
    /// degree.
    pub fn degree_keys(&self, degree: usize) -> String {
        let axes = self.space.axes().enumerate();
        let of_degree = axes.filter(|(_, axis)| axis.cells > 1 && axis.nodes.degree == degree);
        let mut keys: Vec<String> = Vec::new();
        for key in of_degree.map(|(k, _)| self.degree_key(k)) {
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        let Some(last) = keys.pop() else { return DEGREE_KEY.to_owned() };
        if keys.is_empty() { last } else { format!("{} and {last}", keys.join(", ")) }
    }
}
