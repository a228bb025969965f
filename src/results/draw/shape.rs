//! Lines, markers and pictures in pixels.

use crate::results::figure::palette::{Marker, PAPER, Style};
use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// Pixels per point, so that figures are sharp at twice their size.
pub const PIXELS: f64 = 2.0;

/// Success, or why `plotters` could not draw.
pub type Drawn = Result<(), String>;

/// A place in pixels from the upper left corner of an area.
pub type PixelPoint = [f64; 2];

/// A part of the sheet.
pub type Area<DB> = DrawingArea<DB, Shift>;

/// A length in points, as whole pixels.
pub fn pixels(points: f64) -> i32 {
    (points * PIXELS).round() as i32
}

/// A place as `plotters` takes it.
pub fn rounded([x, y]: PixelPoint) -> (i32, i32) {
    (x.round() as i32, y.round() as i32)
}

/// Draws an element of `plotters`.
pub fn put<'b, DB, E>(area: &Area<DB>, element: &'b E) -> Drawn
where
    DB: DrawingBackend,
    &'b E: plotters::element::PointCollection<'b, (i32, i32)>,
    E: plotters::element::Drawable<DB>,
{
    area.draw(element).map_err(|e| e.to_string())
}

/// A filled rectangle between two corners.
pub fn rectangle<DB: DrawingBackend>(
    area: &Area<DB>,
    corners: [PixelPoint; 2],
    colour: RGBColor,
) -> Drawn {
    put(area, &Rectangle::new(corners.map(rounded), colour.filled()))
}

/// Draws a line through `places`, with the dashes of `style`.
///
/// The line is cut at sharp corners, which would stick out in a bitmap.
pub fn line<DB: DrawingBackend>(area: &Area<DB>, places: &[PixelPoint], style: &Style) -> Drawn {
    let mut places: Vec<_> = places.iter().copied().map(rounded).collect();
    places.dedup();
    let stroke = style.colour.stroke_width(pixels(style.width).max(1) as u32);
    for piece in pieces(&places) {
        match style.dashes() {
            None => put(area, &PathElement::new(piece, stroke))?,
            Some([dash, gap]) => {
                let [dash, gap] = [dash, gap].map(pixels);
                put(area, &DashedPathElement::new(piece, dash, gap, stroke))?;
            }
        }
    }
    Ok(())
}

/// Draws an interval about a value, from `ends[0]` to `ends[1]` along the vertical axis.
pub fn interval<DB: DrawingBackend>(
    area: &Area<DB>,
    [x, y]: PixelPoint,
    ends: [f64; 2],
    style: &Style,
) -> Drawn {
    let stroke = style.colour.stroke_width(pixels(style.width) as u32);
    let [x, low, y, high] = [x, ends[0], y, ends[1]].map(|c| c.round() as i32);
    put(area, &ErrorBar::new_vertical(x, low, y, high, stroke, pixels(3.0) as u32))
}

/// The cells of a map that the pixels of a picture show.
pub struct PixelCells {
    /// By column of pixels, from the left.
    pub columns: Vec<usize>,
    /// By row of pixels, from the top.
    pub rows: Vec<usize>,
}

/// Draws a picture with its upper left corner at `corner`; `colour(column, row)` is that of a cell.
pub fn picture<DB: DrawingBackend>(
    area: &Area<DB>,
    corner: PixelPoint,
    cells: &PixelCells,
    colour: impl Fn(usize, usize) -> RGBColor,
) -> Drawn {
    let PixelCells { columns, rows } = cells;
    let width = 3 * columns.len();
    let mut bytes: Vec<u8> = Vec::with_capacity(width * rows.len());
    for (k, row) in rows.iter().enumerate() {
        if k > 0 && rows[k - 1] == *row {
            bytes.extend_from_within(bytes.len() - width..);
            continue;
        }
        for of_a_cell in columns.chunk_by(|a, b| a == b) {
            let RGBColor(r, g, b) = colour(of_a_cell[0], *row);
            of_a_cell.iter().for_each(|_| bytes.extend([r, g, b]));
        }
    }
    let size = (columns.len() as u32, rows.len() as u32);
    let element = BitMapElement::with_owned_buffer(rounded(corner), size, bytes);
    let element = element.ok_or("a picture's pixels are not as many as its size says")?;
    put(area, &element)
}

/// Draws a marker.
pub fn marker<DB: DrawingBackend>(area: &Area<DB>, [x, y]: PixelPoint, style: &Style) -> Drawn {
    const R: f64 = 3.6 * PIXELS;
    let Some(marker) = style.marker else { return Ok(()) };
    let at = |[dx, dy]: PixelPoint| [x + R * dx, y + R * dy];
    let outline = |width: f64| Style { width, dash: 0, ..*style };
    let stroke = |ends: [PixelPoint; 2]| line(area, &ends.map(at), &outline(1.6));
    let fill = if style.filled { style.colour } else { PAPER };
    let corners: &[PixelPoint] = match marker {
        Marker::Circle => {
            let (centre, radius) = (rounded([x, y]), R.round() as i32);
            put(area, &Circle::new(centre, radius, fill.filled()))?;
            let edge = style.colour.stroke_width((1.3 * PIXELS) as u32);
            return if style.filled {
                Ok(())
            } else {
                put(area, &Circle::new(centre, radius, edge))
            };
        }
        Marker::Cross => {
            stroke([[-0.85, -0.85], [0.85, 0.85]])?;
            return stroke([[-0.85, 0.85], [0.85, -0.85]]);
        }
        Marker::Plus => {
            stroke([[-1.0, 0.0], [1.0, 0.0]])?;
            return stroke([[0.0, -1.0], [0.0, 1.0]]);
        }
        Marker::Square => &[[-0.85, -0.85], [0.85, -0.85], [0.85, 0.85], [-0.85, 0.85]],
        Marker::Diamond => &[[0.0, -1.2], [1.2, 0.0], [0.0, 1.2], [-1.2, 0.0]],
        Marker::Up => &[[0.0, -1.1], [1.05, 0.8], [-1.05, 0.8]],
        Marker::Down => &[[0.0, 1.1], [1.05, -0.8], [-1.05, -0.8]],
    };
    let around: Vec<PixelPoint> = corners.iter().copied().map(at).collect();
    let inside: Vec<_> = around.iter().copied().map(rounded).collect();
    put(area, &Polygon::new(inside, fill))?;
    let closed: Vec<PixelPoint> = around.iter().chain(&around[..1]).copied().collect();
    line(area, &closed, &outline(1.0))
}

/// A line cut where it turns by more than a right angle.
fn pieces(places: &[(i32, i32)]) -> Vec<Vec<(i32, i32)>> {
    let along = |a: (i32, i32), b: (i32, i32)| [b.0 - a.0, b.1 - a.1].map(i64::from);
    let mut pieces = Vec::new();
    let mut first = 0;
    for (k, corner) in places.windows(3).enumerate() {
        let (u, v) = (along(corner[0], corner[1]), along(corner[1], corner[2]));
        if u[0] * v[0] + u[1] * v[1] < 0 {
            pieces.push(places[first..k + 2].to_vec());
            first = k + 1;
        }
    }
    pieces.push(places[first..].to_vec());
    pieces
}

/// The pieces of a line within a rectangle, by the algorithm of Liang and Barsky. The line is
/// broken at places that are not finite.
///
/// `plotters` would move places outside to the edge of the rectangle, which bends the line.
pub fn clipped(places: &[PixelPoint], corners: [PixelPoint; 2]) -> Vec<Vec<PixelPoint>> {
    let mut pieces: Vec<Vec<PixelPoint>> = Vec::new();
    let [[left, top], [right, bottom]] = corners;
    let mut joined = false;
    for pair in places.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        if !a.iter().chain(&b).all(|x| x.is_finite()) {
            joined = false;
            continue;
        }
        let d = [b[0] - a[0], b[1] - a[1]];
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for (c, lower, upper) in [(0, left, right), (1, top, bottom)] {
            if d[c] == 0.0 {
                if !(lower..=upper).contains(&a[c]) {
                    to = -1.0;
                }
                continue;
            }
            let ends = [(lower - a[c]) / d[c], (upper - a[c]) / d[c]];
            from = from.max(ends[0].min(ends[1]));
            to = to.min(ends[0].max(ends[1]));
        }
        if from > to {
            joined = false;
            continue;
        }
        let at = |t: f64| [a[0] + t * d[0], a[1] + t * d[1]];
        match pieces.last_mut().filter(|_| joined && from == 0.0) {
            Some(piece) => piece.push(at(to)),
            None => pieces.push(vec![at(from), at(to)]),
        }
        joined = to == 1.0;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: [PixelPoint; 2] = [[0.0, 0.0], [10.0, 10.0]];

    #[test]
    fn lines_end_at_the_frame() {
        let through = clipped(&[[-5.0, 5.0], [15.0, 5.0]], BOX);
        assert_eq!(through, [[[0.0, 5.0], [10.0, 5.0]]]);
        assert!(clipped(&[[-5.0, -1.0], [15.0, -1.0]], BOX).is_empty());
        // A line that leaves and enters again has two pieces, a line inside has one.
        let out = clipped(&[[5.0, 5.0], [5.0, 15.0], [7.0, 15.0], [7.0, 5.0]], BOX);
        assert_eq!(out, [[[5.0, 5.0], [5.0, 10.0]], [[7.0, 10.0], [7.0, 5.0]]]);
        assert_eq!(clipped(&[[1.0, 1.0], [2.0, 2.0], [3.0, 1.0]], BOX)[0].len(), 3);
        let broken =
            clipped(&[[1.0, 1.0], [2.0, 2.0], [f64::NAN, 1.0], [3.0, 3.0], [4.0, 4.0]], BOX);
        assert_eq!(broken.len(), 2);
    }

    #[test]
    fn lines_are_cut_at_sharp_corners_only() {
        let places = [(0, 0), (9, 0), (9, 9), (8, 0), (7, 9), (7, 20)];
        let found = pieces(&places);
        assert_eq!(found, [&places[..3], &places[2..4], &places[3..]]);
        assert_eq!(pieces(&places[..1]), [&places[..1]]);
    }
}
