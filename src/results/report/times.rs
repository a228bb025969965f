//! Phase space and density at several times, of which one is shown: a slider without a script.
//!
//! Every time is a radio button followed by its picture. The pictures are stacked, and the style
//! sheet shows the one whose button is checked. The buttons form the track below.

use crate::base::text::short;
use crate::results::FileResult;
use crate::results::draw::raster::Palette;
use crate::results::pictures::cut::Cut;
use crate::results::pictures::film::Film;
use crate::results::pictures::stored::{StoredRun, StoredTime};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

/// The largest number of pictures of a page: one or two MiB, at some tens of KiB each.
const MOST_TIMES: usize = 24;
/// The largest number of labels below the track.
const MOST_LABELS: usize = 7;

/// The pictures.
pub struct Times {
    frames: Vec<TimePicture>,
    /// Number of times that the run stores.
    stored: usize,
    /// The reason why there is no exact density, if the case names an exact solution.
    without_exact: Option<String>,
}

/// A time and its picture.
struct TimePicture {
    time: f64,
    /// PNG, in Base64.
    picture: String,
}

impl Times {
    /// The pictures of a run, through `cut` or else the densest cut; `None` for a run with fields
    /// at one time only.
    pub fn new(run: &StoredRun, cut: Option<Cut>) -> FileResult<Option<Self>> {
        let all = run.snapshots()?;
        if all.len() < 2 {
            return Ok(None);
        }
        let chosen = spread(all.len(), MOST_TIMES).into_iter();
        let chosen: Vec<StoredTime> = chosen.map(|k| all[k]).collect();
        let cut = cut.unwrap_or_else(|| Cut::densest(run, &chosen));
        let film = Film::new(run, &cut, chosen)?;
        let mut palette = Palette::of(&film.frame(0)?);
        let mut frames = Vec::with_capacity(film.count());
        for k in 0..film.count() {
            let raster = film.frame(k)?.raster().map_err(|e| e.to_string())?;
            let png = palette.png(&raster)?;
            frames.push(TimePicture { time: film.time(k), picture: STANDARD.encode(png) });
        }
        Ok(Some(Self { frames, stored: all.len(), without_exact: film.without_exact }))
    }

    /// The slider, set to the end of the run.
    pub fn html(&self) -> Markup {
        let count = self.frames.len();
        let labels = spread(count, MOST_LABELS);
        let columns = format!("grid-template-columns:repeat({count},minmax(0,1fr))");
        let at = |k: usize| format!("t = {}", short(self.frames[k].time));
        html! {
            figure id="picture-times" class="times" {
                div class="track" style=(columns) {
                    @for (k, frame) in self.frames.iter().enumerate() {
                        input type="radio" name="time" id={ "time-" (k) } title=(at(k))
                            aria-label=(at(k)) checked[k + 1 == count];
                        img alt={ "Phase space and density at " (at(k)) }
                            src={ "data:image/png;base64," (frame.picture) };
                    }
                    @for k in labels {
                        label for={ "time-" (k) } style={ "grid-column:" (k + 1) } {
                            (short(self.frames[k].time))
                        }
                    }
                }
                figcaption {
                    "Choose a time below the picture, by the mouse or by the arrow keys. "
                    @if count < self.stored {
                        (count) " of " (self.stored) " stored times are here. "
                    }
                    code { "phasewarp movie" } " shows "
                    @if count < self.stored { "all of them" } @else { "them as a movie" } "."
                    @if let Some(why) = &self.without_exact {
                        " The exact density is left out: " (why) "."
                    }
                }
            }
        }
    }
}

/// At most `most` of the numbers from 0 to `count - 1`, in equal steps except for the last one.
fn spread(count: usize, most: usize) -> Vec<usize> {
    let last = count - 1;
    let step = last.div_ceil((most - 1).max(1)).max(1);
    let mut chosen: Vec<usize> = (0..count).step_by(step).collect();
    match chosen.last() {
        Some(&end) if end == last => {}
        Some(&end) if chosen.len() > 1 && 2 * (last - end) < step => {
            chosen.pop();
            chosen.push(last);
        }
        _ => chosen.push(last),
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_spread_evenly() {
        assert_eq!(spread(5, 7), [0, 1, 2, 3, 4]);
        assert_eq!(spread(101, 3), [0, 50, 100]);
        assert_eq!(spread(1, 3), [0]);
        for count in 2..200 {
            let chosen = spread(count, MOST_TIMES);
            assert_eq!((chosen[0], chosen[chosen.len() - 1]), (0, count - 1));
            assert!(chosen.windows(2).all(|w| w[0] < w[1]) && chosen.len() <= MOST_TIMES);
        }
    }
}
