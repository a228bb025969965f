//! Texts: fonts, which are part of the program, widths and line breaks.

use crate::results::draw::shape::{Area, Drawn, PIXELS, PixelPoint, rectangle, rounded};
use crate::results::figure::palette::{FAINT, PAPER};
use plotters::prelude::*;
use plotters::style::register_font;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::sync::Once;

/// Font family that SVG files name; PNG files use the font in the program.
const FAMILY: &str = "DejaVu Sans, Verdana, sans-serif";

/// A font of `size` points; `plotters` draws letters at `1/1.24` of the size it is given.
fn font(size: f64, weight: FontStyle) -> FontDesc<'static> {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // This cannot fail, as the fonts in the program are valid.
        let _ = register_font(FAMILY, FontStyle::Normal, dejavu::sans::regular());
        let _ = register_font(FAMILY, FontStyle::Bold, dejavu::sans::bold());
    });
    FontDesc::new(FontFamily::Name(FAMILY), 1.24 * PIXELS * size, weight)
}

fn anchored(font: FontDesc<'static>, colour: RGBColor) -> TextStyle<'static> {
    TextStyle { font, color: colour.to_backend_color(), pos: Pos::new(HPos::Left, VPos::Center) }
}

/// Letters of `size` points that begin at a place and are centred on it vertically.
pub fn style(size: f64, colour: RGBColor) -> TextStyle<'static> {
    anchored(font(size, FontStyle::Normal), colour)
}

/// The style of bold letters of this size and colour.
pub fn bold(size: f64, colour: RGBColor) -> TextStyle<'static> {
    anchored(font(size, FontStyle::Bold), colour)
}

/// Draws a text in one line.
pub fn draw<DB: DrawingBackend>(
    area: &Area<DB>,
    text: &str,
    place: PixelPoint,
    style: &TextStyle<'_>,
) -> Drawn {
    area.draw_text(text, style, rounded(place)).map_err(|e| e.to_string())
}

/// Size of notes in points.
const NOTE: f64 = 8.5;

/// The background of a [`note`]: its upper left and its lower right corner.
pub fn ground(text: &str, place: PixelPoint, right: f64) -> [PixelPoint; 2] {
    let wide = PIXELS * width(text, NOTE);
    let left = (place[0] + 3.0 * PIXELS).min(right - wide - 2.0 * PIXELS);
    let (beside, half) = (PIXELS, 6.0 * PIXELS);
    [[left - beside, place[1] - half], [left + wide + beside, place[1] + half]]
}

/// Draws a small text beside `place`, on a background that keeps it legible. It is moved to the
/// left if it would go beyond `right`.
pub fn note<DB: DrawingBackend>(
    area: &Area<DB>,
    text: &str,
    place: PixelPoint,
    right: f64,
) -> Drawn {
    let ground = ground(text, place, right);
    rectangle(area, ground, PAPER)?;
    draw(area, text, [ground[0][0] + PIXELS, place[1]], &style(NOTE, FAINT))
}

/// Length of `text` in points.
pub fn width(text: &str, size: f64) -> f64 {
    let found = font(size, FontStyle::Normal).box_size(text);
    found.map_or(0.6 * size * text.chars().count() as f64, |(w, _)| f64::from(w) / PIXELS)
}

/// `text` in lines of at most `most` points, broken at spaces.
pub fn wrapped(text: &str, size: f64, most: f64) -> Vec<String> {
    let mut lines = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            let longer = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
            if !line.is_empty() && width(&longer, size) > most {
                lines.push(std::mem::replace(&mut line, word.to_owned()));
            } else {
                line = longer;
            }
        }
        lines.push(line);
    }
    lines
}

/// `text` in lines of at most `most` points, at most `count` for each line of the text. What does
/// not fit is replaced by `…`.
pub fn fitted(text: &str, size: f64, most: f64, count: usize) -> Vec<String> {
    let cut = |line: &str| {
        // No letter is narrower than a tenth of its height.
        let mut short: String = line.chars().take((10.0 * most / size) as usize).collect();
        while width(&format!("{short}…"), size) > most && short.pop().is_some() {}
        short + "…"
    };
    let of_line = |line: &str| {
        let mut lines = wrapped(line, size, most);
        let more = lines.len() > count;
        lines.truncate(count);
        let last = lines.len().saturating_sub(1);
        for (k, line) in lines.iter_mut().enumerate() {
            if (k == last && more) || width(line, size) > most {
                *line = cut(line);
            }
        }
        lines
    };
    text.lines().flat_map(of_line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_has_few_lines_and_stays_in_its_width() {
        let short = "one\nt = 2";
        assert_eq!(fitted(short, 14.0, 200.0, 2), ["one", "t = 2"]);
        let long = format!("{}\nt = 2", "word ".repeat(60));
        for text in [long.as_str(), &"w".repeat(400), &"ä ".repeat(500)] {
            let lines = fitted(text, 14.0, 200.0, 2);
            assert!(lines.len() <= 3 && lines.iter().any(|l| l.ends_with('…')), "{lines:?}");
            assert!(lines.iter().all(|line| width(line, 14.0) <= 200.0), "{lines:?}");
        }
        assert!(fitted("", 14.0, 200.0, 2).is_empty());
    }

    #[test]
    fn lines_are_broken_where_they_must_be() {
        let text = "one two three four five six seven";
        let lines = wrapped(text, 10.0, 80.0);
        assert!(lines.len() > 2);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|l| width(l, 10.0) <= 80.0));
        // A word that is too long stands alone, and nothing is lost.
        assert_eq!(wrapped("a incomprehensibilities b", 10.0, 20.0).len(), 3);
        assert_eq!(wrapped("a\nb", 10.0, 500.0), ["a", "b"]);
    }
}
