//! Lines, shapes and texts in points, on whatever `plotters` draws to.

use crate::results::figure::palette::{Colour, FAINT, Marker, PAPER, Style};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontTransform, register_font};
use std::sync::Once;

/// Pixels of a point: figures are sharp when enlarged twice.
pub const PIXELS: f64 = 2.0;

/// What a viewer of an SVG looks for; for the rest the font is in the program.
const FAMILY: &str = "DejaVu Sans, Verdana, sans-serif";

/// What cannot be drawn, and why.
pub type Drawn = Result<(), String>;

/// A place in points from the upper left corner.
pub type Place = [f64; 2];

/// Where a text stands beside its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Left,
    /// It is centred there.
    Centre,
    /// It ends there.
    Right,
}

/// A drawing in points.
pub struct Canvas<'a, DB: DrawingBackend> {
    root: &'a DrawingArea<DB, Shift>,
}

fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // The fonts are part of the program: they are fonts.
        let _ = register_font(FAMILY, FontStyle::Normal, dejavu::sans::regular());
        let _ = register_font(FAMILY, FontStyle::Bold, dejavu::sans::bold());
    });
}

/// `plotters` gives letters `1/1.24` of the size it is told.
fn font(size: f64, bold: bool) -> FontDesc<'static> {
    register();
    let style = if bold {
        FontStyle::Bold
    } else {
        FontStyle::Normal
    };
    FontDesc::new(FontFamily::Name(FAMILY), 1.24 * PIXELS * size, style)
}

/// Length of `text` in points.
pub fn text_width(text: &str, size: f64) -> f64 {
    let found = font(size, false).box_size(text);
    found.map_or(0.6 * size * text.chars().count() as f64, |(w, _)| {
        f64::from(w) / PIXELS
    })
}

/// `text` in lines of at most `width` points, broken at spaces.
pub fn wrapped(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            let longer = if line.is_empty() {
                word.to_owned()
            } else {
                format!("{line} {word}")
            };
            if !line.is_empty() && text_width(&longer, size) > width {
                lines.push(std::mem::replace(&mut line, word.to_owned()));
            } else {
                line = longer;
            }
        }
        lines.push(line);
    }
    lines
}

fn pixels([x, y]: Place) -> (i32, i32) {
    ((x * PIXELS).round() as i32, (y * PIXELS).round() as i32)
}

fn rgb([r, g, b]: Colour) -> RGBColor {
    RGBColor(r, g, b)
}

impl<'a, DB: DrawingBackend> Canvas<'a, DB> {
    /// On `root`, made white.
    pub fn new(root: &'a DrawingArea<DB, Shift>) -> Result<Self, String> {
        root.fill(&rgb(PAPER)).map_err(|e| e.to_string())?;
        Ok(Self { root })
    }

    fn draw<'b, E>(&self, element: &'b E) -> Drawn
    where
        &'b E: plotters::element::PointCollection<'b, (i32, i32)>,
        E: plotters::element::Drawable<DB>,
    {
        self.root.draw(element).map_err(|e| e.to_string())
    }

    /// A line through `places`; in pieces where it turns back on itself, since a bitmap's corner would stick out as far as it is sharp.
    pub fn line(&self, places: &[Place], colour: Colour, width: f64) -> Drawn {
        let mut places: Vec<_> = places.iter().copied().map(pixels).collect();
        places.dedup();
        let width = (width * PIXELS).round().max(1.0) as u32;
        pieces(&places).into_iter().try_for_each(|piece| {
            self.draw(&PathElement::new(piece, rgb(colour).stroke_width(width)))
        })
    }

    /// The same in dashes, as `style` says.
    pub fn styled(&self, places: &[Place], style: &Style) -> Drawn {
        let dashes = style.dashes();
        if dashes.is_empty() {
            return self.line(places, style.colour, style.width);
        }
        dashed(places, dashes)
            .iter()
            .try_for_each(|dash| self.line(dash, style.colour, style.width))
    }

    /// A rectangle between two corners, filled.
    pub fn rectangle(&self, corners: [Place; 2], colour: Colour) -> Drawn {
        let corners = corners.map(pixels);
        self.draw(&Rectangle::new(corners, rgb(colour).filled()))
    }

    /// A text in one line; `up` where it runs upwards.
    pub fn text(
        &self,
        text: &str,
        place: Place,
        (size, colour): (f64, Colour),
        (anchor, up, bold): (Anchor, bool, bool),
    ) -> Drawn {
        let h = match anchor {
            Anchor::Left => HPos::Left,
            Anchor::Centre => HPos::Center,
            Anchor::Right => HPos::Right,
        };
        let mut font = font(size, bold);
        if up {
            font = font.transform(FontTransform::Rotate270);
        }
        let colour = rgb(colour);
        let style = TextStyle::from(font)
            .color(&colour)
            .pos(Pos::new(h, VPos::Center));
        self.draw(&Text::new(text.to_owned(), pixels(place), style))
    }

    /// A small text that begins at `place`, on a ground that keeps it legible; at its end where it would leave `right`.
    pub fn note(&self, text: &str, place: Place, right: f64) -> Drawn {
        const SIZE: f64 = 8.5;
        if text.is_empty() {
            return Ok(());
        }
        let width = text_width(text, SIZE);
        let left = (place[0] + 3.0).min(right - width - 2.0);
        self.rectangle(
            [
                [left - 1.0, place[1] - 6.0],
                [left + width + 1.0, place[1] + 6.0],
            ],
            PAPER,
        )?;
        let at = [left, place[1]];
        self.text(text, at, (SIZE, FAINT), (Anchor::Left, false, false))
    }

    /// A picture whose colours are given for each pixel, from the upper left corner, row by row.
    pub fn picture(&self, corner: Place, size: [u32; 2], colours: &[u8]) -> Drawn {
        let size = (size[0], size[1]);
        let element = BitMapElement::with_owned_buffer(pixels(corner), size, colours.to_vec());
        match element {
            Some(element) => self.draw(&element),
            None => Err("a picture's pixels are not as many as its size says".to_owned()),
        }
    }

    /// A marker.
    pub fn marker(&self, [x, y]: Place, style: &Style) -> Drawn {
        const R: f64 = 3.6;
        let Some(marker) = style.marker else {
            return Ok(());
        };
        let corners: &[Place] = match marker {
            Marker::Circle => {
                let radius = (R * PIXELS).round() as i32;
                let centre = pixels([x, y]);
                if style.filled {
                    return self.draw(&Circle::new(centre, radius, rgb(style.colour).filled()));
                }
                self.draw(&Circle::new(centre, radius, rgb(PAPER).filled()))?;
                let stroke = rgb(style.colour).stroke_width((1.3 * PIXELS) as u32);
                return self.draw(&Circle::new(centre, radius, stroke));
            }
            Marker::Cross => {
                let r = 0.85 * R;
                self.line(&[[x - r, y - r], [x + r, y + r]], style.colour, 1.6)?;
                return self.line(&[[x - r, y + r], [x + r, y - r]], style.colour, 1.6);
            }
            Marker::Plus => {
                self.line(&[[x - R, y], [x + R, y]], style.colour, 1.6)?;
                return self.line(&[[x, y - R], [x, y + R]], style.colour, 1.6);
            }
            Marker::Square => &[[-0.85, -0.85], [0.85, -0.85], [0.85, 0.85], [-0.85, 0.85]],
            Marker::Diamond => &[[0.0, -1.2], [1.2, 0.0], [0.0, 1.2], [-1.2, 0.0]],
            Marker::Up => &[[0.0, -1.1], [1.05, 0.8], [-1.05, 0.8]],
            Marker::Down => &[[0.0, 1.1], [1.05, -0.8], [-1.05, -0.8]],
        };
        let at = |[dx, dy]: Place| [x + R * dx, y + R * dy];
        let fill = if style.filled { style.colour } else { PAPER };
        let around: Vec<_> = corners.iter().copied().map(at).map(pixels).collect();
        self.draw(&Polygon::new(around, rgb(fill)))?;
        let closed: Vec<Place> = corners
            .iter()
            .chain(&corners[..1])
            .copied()
            .map(at)
            .collect();
        self.line(&closed, style.colour, 1.0)
    }
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

/// A line cut into dashes.
fn dashed(places: &[Place], dashes: &[f64]) -> Vec<Vec<Place>> {
    let mut all = Vec::new();
    let (mut k, mut left) = (0, dashes[0]);
    let mut dash = places.first().map_or(Vec::new(), |p| vec![*p]);
    for pair in places.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let mut gone = 0.0;
        while length - gone > left {
            gone += left;
            let part = gone / length;
            let at = [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])];
            if k % 2 == 0 {
                dash.push(at);
                all.push(std::mem::take(&mut dash));
            } else {
                dash = vec![at];
            }
            k += 1;
            left = dashes[k % dashes.len()];
        }
        left -= length - gone;
        if k % 2 == 0 {
            dash.push(b);
        }
    }
    if dash.len() > 1 {
        all.push(dash);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_cut_at_sharp_corners_only() {
        let places = [(0, 0), (9, 0), (9, 9), (8, 0), (7, 9), (7, 20)];
        let found = pieces(&places);
        assert_eq!(found, [&places[..3], &places[2..4], &places[3..]]);
        assert_eq!(pieces(&places[..1]), [&places[..1]]);
    }

    #[test]
    fn dashes_are_as_long_as_they_should_be() {
        // Around a corner, 3 and 4 long.
        let found = dashed(&[[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]], &[2.0, 1.0]);
        assert_eq!(
            found,
            [
                vec![[0.0, 0.0], [2.0, 0.0]],
                vec![[3.0, 0.0], [3.0, 2.0]],
                vec![[3.0, 3.0], [3.0, 4.0]],
            ]
            .map(|d| d.to_vec())
            .to_vec()
        );
        let length: f64 = dashed(&[[0.0, 0.0], [1000.0, 0.0]], &[8.0, 3.0, 2.0, 3.0])
            .iter()
            .map(|d| d[d.len() - 1][0] - d[0][0])
            .sum();
        assert!((length - 1000.0 * 10.0 / 16.0).abs() < 10.0);
    }

    #[test]
    fn lines_are_broken_where_they_must_be() {
        let text = "one two three four five six seven";
        let lines = wrapped(text, 10.0, 80.0);
        assert!(lines.len() > 2);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|l| text_width(l, 10.0) <= 80.0));
        // A word that is too long stands alone, and nothing is lost.
        assert_eq!(wrapped("a incomprehensibilities b", 10.0, 20.0).len(), 3);
        assert_eq!(wrapped("a\nb", 10.0, 500.0), ["a", "b"]);
    }
}
