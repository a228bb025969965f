//! Entries of rows, and the lines that rows are gathered into: the nodes of an element along the
//! first space axis.

/// An entry: local column, `s` and `k`.
pub type MatrixEntry = (u32, f64, f64);

/// Most rows of a line: the nodes of an element of the largest degree.
pub const MOST_NODES: usize = 9;

/// Does `$work` with the constant `$NODES`, which is the number `$count` of nodes of an element:
/// loops over nodes are compiled for each number of them.
macro_rules! for_nodes {
    ($count:expr, $NODES:ident => $work:expr) => {
        $crate::matrix::row_lines::for_nodes!(@ $count, $NODES => $work; 2 3 4 5 6 7 8 9)
    };
    (@ $count:expr, $NODES:ident => $work:expr; $($number:literal)*) => {
        match $count {
            $($number => {
                const $NODES: usize = $number;
                $work
            })*
            nodes => unreachable!("an element has 2 to 9 nodes, not {nodes}"),
        }
    };
}
pub(crate) use for_nodes;

const _: () = assert!(MOST_NODES == 9, "`for_nodes` has an arm for each number of nodes");

/// The lines that rows of cells are gathered into. The nodes of a line are `stride` rows apart, and
/// the lines of a layer of elements begin in its first `stride` rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowLines {
    /// Rows of a line of cells.
    pub nodes: usize,
    /// Distance from one row of a line to the next.
    pub stride: usize,
    /// Number of rows of cells; the rows behind them are lines of one row.
    pub cells: usize,
}

impl RowLines {
    /// Every row is a line of its own.
    pub(crate) const SINGLE: RowLines = RowLines { nodes: 1, stride: 1, cells: 0 };

    /// Number of lines of cells.
    pub fn of_cells(&self) -> usize {
        self.cells / self.nodes
    }

    /// The first row of a line of cells.
    #[inline(always)]
    pub fn first(&self, line: usize) -> usize {
        line / self.stride * (self.nodes - 1) * self.stride + line
    }

    /// The rows of a line of cells.
    pub fn rows_of_cells(&self, line: usize) -> impl Iterator<Item = usize> + use<> {
        let (first, stride) = (self.first(line), self.stride);
        (0..self.nodes).map(move |node| first + node * stride)
    }

    /// The rows of any line.
    pub fn rows(&self, line: usize) -> impl Iterator<Item = usize> + use<> {
        let (stride, of_cells) = (self.stride, self.of_cells());
        let (first, count) = if line < of_cells {
            (self.first(line), self.nodes)
        } else {
            (self.cells + (line - of_cells), 1)
        };
        (0..count).map(move |node| first + node * stride)
    }

    /// The line of a row, and the number of the row in the line.
    #[inline(always)]
    pub fn line_and_node(&self, row: usize) -> (usize, usize) {
        if self.nodes == 1 {
            return (row, 0);
        }
        if row >= self.cells {
            return (self.of_cells() + (row - self.cells), 0);
        }
        let (plane, within) = (row / self.stride, row % self.stride);
        (plane / self.nodes * self.stride + within, plane % self.nodes)
    }
}
