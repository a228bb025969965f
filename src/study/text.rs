//! Seconds as studies print them.

use crate::base::text::short;

/// Seconds for people, with what `--time` of a batch system takes where they are many.
pub fn seconds_text(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "unknown".to_owned();
    }
    if seconds >= 1e12 {
        return format!("{seconds:.0e} s");
    }
    if seconds < 100.0 {
        return format!("{} s", short(seconds));
    }
    let whole = seconds.ceil() as u64;
    let (hours, minutes) = (whole / 3600, whole / 60 % 60);
    format!("{seconds:.0} s ({hours}:{minutes:02}:{:02})", whole % 60)
}

/// Seconds with a unit.
pub fn time_text(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => format!("{:.2} ms", 1e3 * s),
        s if s < 1.0 => format!("{:.1} ms", 1e3 * s),
        s if s < 100.0 => format!("{s:.1} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s if s < 3.6e6 => format!("{:.0} h", s / 3600.0),
        s => format!("{:.0e} h", s / 3600.0),
    }
}
