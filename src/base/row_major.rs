//! Row-major numbers of the elements of an array (the last index runs fastest), and boxes of it.

use std::ops::Range;

/// The index along each axis of the element `number` of an array of these `lengths`, row-major.
pub fn indices(number: usize, lengths: &[usize]) -> Vec<usize> {
    let mut rest = number;
    let mut indices: Vec<usize> = lengths.iter().rev().map(|n| (rest % n, rest /= n).0).collect();
    indices.reverse();
    indices
}

/// The number of an element of an array of these `lengths`, row-major: the inverse of [`indices`].
pub fn number(
    lengths: impl IntoIterator<Item = usize>,
    indices: impl IntoIterator<Item = usize>,
) -> usize {
    lengths.into_iter().zip(indices).fold(0, |number, (length, index)| number * length + index)
}

/// Number of elements of a box.
pub fn volume(ranges: &[Range<usize>]) -> usize {
    ranges.iter().map(Range::len).product()
}

/// Row-major position of the element at `indices` in a box; `None` if it is outside.
pub fn position(ranges: &[Range<usize>], indices: &[usize]) -> Option<usize> {
    ranges.iter().zip(indices).try_fold(0, |position, (range, index)| {
        range.contains(index).then(|| position * range.len() + index - range.start)
    })
}

/// A box of a dataset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DatasetBox {
    /// First element along each axis.
    pub start: Vec<usize>,
    /// Elements along each axis.
    pub count: Vec<usize>,
}

impl DatasetBox {
    /// One range an axis.
    pub fn of(ranges: &[Range<usize>]) -> Self {
        Self {
            start: ranges.iter().map(|r| r.start).collect(),
            count: ranges.iter().map(|r| r.len()).collect(),
        }
    }

    /// All of a dataset of this shape.
    pub fn whole(shape: &[usize]) -> Self {
        Self { start: vec![0; shape.len()], count: shape.to_vec() }
    }

    /// This box in a dataset with one more axis, the first, of which it has the range `first`.
    pub fn after(mut self, first: Range<usize>) -> Self {
        self.start.insert(0, first.start);
        self.count.insert(0, first.len());
        self
    }

    /// Number of elements.
    pub fn size(&self) -> usize {
        self.count.iter().product()
    }

    /// Splits a dataset of this shape into boxes of about `most` elements, in storage order.
    pub fn pieces(shape: &[usize], most: usize) -> impl Iterator<Item = Self> + use<> {
        // A box is whole along the axes after `axis`, a range along it, one element along those
        // before.
        let mut axis = shape.len().saturating_sub(1);
        let mut beyond = 1;
        while axis > 0 && beyond * shape[axis] <= most {
            beyond *= shape[axis];
            axis -= 1;
        }
        let along = shape.get(axis).copied().unwrap_or(1);
        let step = (most / beyond.max(1)).clamp(1, along.max(1));
        let parts = along.div_ceil(step);
        let before: usize = shape.iter().take(axis).product();
        let shape = shape.to_vec();
        (0..before * parts).map(move |piece| {
            let part = piece % parts;
            let mut slab = Self::whole(&shape);
            slab.start[..axis].copy_from_slice(&indices(piece / parts, &shape[..axis]));
            slab.count[..axis].fill(1);
            if let Some(n) = shape.get(axis) {
                slab.start[axis] = part * step;
                slab.count[axis] = step.min(n - part * step);
            }
            slab
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_their_indices() {
        let lengths = [3, 1, 4];
        assert_eq!(indices(7, &lengths), [1, 0, 3]);
        for element in 0..12 {
            assert_eq!(number(lengths, indices(element, &lengths)), element);
        }
    }

    #[test]
    fn positions_are_counted_from_the_start_of_a_box() {
        let ranges = [2..4, 5..6, 0..3];
        assert_eq!(volume(&ranges), 6);
        // Further indices do not count.
        assert_eq!(position(&ranges, &[3, 5, 1, 7]), Some(4));
        for outside in [[1, 5, 1], [2, 6, 1], [2, 5, 3]] {
            assert_eq!(position(&ranges, &outside), None);
        }
    }
}
