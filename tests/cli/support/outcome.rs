//! The outcome of a job: its output by rank, its exit code and its `summary.json`.

use phasewarp::base::text::COLUMNS;
use serde_json::Value;
use std::path::Path;

/// Separates the output of rank 0, of the other ranks and of mpirun itself. mpirun marks every
/// piece that it gets from a rank with `[job,rank]<stdout>:`, also in the middle of a line or of a
/// letter.
pub fn untag(bytes: &[u8]) -> [String; 3] {
    let mut printed = [const { Vec::new() }; 3];
    let (mut speaker, mut rest) = (2, bytes);
    while let Some((&byte, after)) = rest.split_first() {
        if let Some((rank, after)) = mark(rest) {
            (speaker, rest) = (rank.min(1), after);
            continue;
        }
        printed[speaker].push(byte);
        if byte == b'\n' {
            speaker = 2;
        }
        rest = after;
    }
    printed.map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

/// The rank in a mark at the start of `bytes`, and the bytes after the mark.
fn mark(bytes: &[u8]) -> Option<(usize, &[u8])> {
    let after = bytes.strip_prefix(b"[")?;
    let end = after.iter().position(|&byte| byte == b']')?;
    let (job, after) = (std::str::from_utf8(&after[..end]).ok()?, &after[end + 1..]);
    // The text may have a bracket right before a mark.
    if job.contains('[') {
        return None;
    }
    let stdout = after.strip_prefix(b"<stdout>:");
    let after = stdout.or_else(|| after.strip_prefix(b"<stderr>:"))?;
    Some((job.rsplit(',').next()?.parse().ok()?, after))
}

#[test]
fn marks_are_taken_out_of_words_and_letters() {
    let printed = "[7,0]<stdout>:[1 [7,0]<stdout>:2] \u{c3}[7,1]<stderr>:no\nmpirun: [x]\n";
    // The two bytes of ö with a mark between them.
    let mut bytes: Vec<u8> = printed.chars().map(|c| c as u8).collect();
    bytes.splice(0..0, *b"[7,0]<stdout>:\xc3[7,0]<stdout>:\xb6\n");
    let [first, others, launcher] = untag(&bytes);
    assert_eq!(first, "ö\n[1 2] \u{fffd}");
    assert_eq!((others.as_str(), launcher.as_str()), ("no\n", "mpirun: [x]\n"));
}

/// Joins the lines that the program wrapped at a limited width: a line is indented and the line
/// before it had no room for its first word.
pub fn unwrapped(printed: &str) -> String {
    let width = |text: &str| text.chars().count();
    let mut joined = String::with_capacity(printed.len());
    let mut last = "";
    for line in printed.split_inclusive('\n') {
        let word = line.split_whitespace().next().unwrap_or_default();
        let room = last.trim_end_matches('\n');
        // Rows of a table are not joined.
        let has_columns = line.trim().contains("  ");
        let full = !has_columns && width(room) + 1 + width(word) > COLUMNS;
        let is_rest = line.starts_with(' ') && (full || room.ends_with(" \\"));
        if is_rest && joined.ends_with('\n') {
            joined.pop();
            // The mark of a continued line of a shell command.
            let end = joined.strip_suffix(" \\").unwrap_or(&joined).len();
            joined.truncate(end);
            joined.push(' ');
        }
        joined.push_str(if is_rest { line.trim_start_matches(' ') } else { line });
        last = line;
    }
    joined
}

/// A job that has ended.
#[derive(Clone, Debug)]
pub struct Finished {
    /// The command.
    pub command: String,
    /// Exit code of mpirun or of the program; none if a signal ended it.
    pub code: Option<i32>,
    /// The exit code in a shell: 128 plus the signal if a signal ended it.
    pub shell_code: i32,
    /// Both streams of rank 0, as they were printed.
    pub printed: String,
    /// Standard output of rank 0, [`unwrapped`].
    pub output: String,
    /// Standard error of rank 0, [`unwrapped`].
    pub errors: String,
    /// The output of other ranks, on either stream.
    pub others: String,
    /// The error messages of mpirun itself.
    pub launcher: String,
    /// Seconds from start to end.
    pub seconds: f64,
    /// Processor time of it and of all processes below it, in seconds.
    pub processor_seconds: f64,
}

impl Finished {
    /// The standard output, parsed as JSON.
    pub fn json(&self) -> Result<Value, String> {
        serde_json::from_str(&self.output).map_err(|e| self.report(&format!("no JSON: {e}")))
    }

    /// Returns an error with the whole output unless the job ended with this exit code and an error
    /// message that contains all of `words`.
    pub fn ended(&self, code: i32, words: &[&str]) -> Result<(), String> {
        if self.code != Some(code) {
            return Err(self.report(&format!("exit code {code} expected")));
        }
        self.contains(&self.errors, words)
    }

    /// Returns an error with the whole output unless `printed` contains all of `words`.
    pub fn contains(&self, printed: &str, words: &[&str]) -> Result<(), String> {
        match words.iter().find(|words| !printed.contains(**words)) {
            Some(words) => Err(self.report(&format!("\"{words}\" is not printed"))),
            None => Ok(()),
        }
    }

    /// The message `what` with the command and the whole output.
    pub fn report(&self, what: &str) -> String {
        let ending = match self.code {
            Some(code) => format!("exit code {code}"),
            None => "ended by a signal".to_owned(),
        };
        let (seconds, used) = (self.seconds, self.processor_seconds);
        let mut text = format!(
            "{what}\n  command: {}\n  {ending} after {seconds:.1} s ({used:.1} s of a processor)",
            self.command
        );
        // mpirun's own message about a nonzero exit code is redundant.
        let launcher = if self.errors.is_empty() { self.launcher.as_str() } else { "" };
        for (who, printed) in [
            ("stdout", self.output.as_str()),
            ("stderr", &self.errors),
            ("other ranks", &self.others),
            ("mpirun", launcher),
        ] {
            // The stack frames of a crash are left out.
            let lines = printed.lines().filter(|l| !l.starts_with('['));
            let printed = lines.collect::<Vec<_>>().join("\n");
            let printed: String = printed.trim_end().chars().take(1500).collect();
            if !printed.is_empty() {
                text += &format!("\n  {who}: {}", printed.replace('\n', "\n    "));
            }
        }
        text
    }
}

/// The `summary.json` of a run, with the command of the run.
#[derive(Clone, Debug)]
pub struct Summary {
    /// The command.
    pub command: String,
    /// The contents of the file.
    pub value: Value,
}

impl Summary {
    /// Reads the file of the run `finished` in `directory`.
    pub fn read(finished: Finished, directory: &Path) -> Result<Self, String> {
        let path = directory.join("summary.json");
        let fails =
            |e: &dyn std::fmt::Display| finished.report(&format!("{}: {e}", path.display()));
        let text = std::fs::read_to_string(&path).map_err(|e| fails(&e))?;
        let value = serde_json::from_str(&text).map_err(|e| fails(&e))?;
        Ok(Self { command: finished.command, value })
    }

    /// `outcome` with the command in its error.
    pub fn holds(&self, outcome: Result<(), String>) -> Result<(), String> {
        outcome.map_err(|what| format!("{what}\n  command: {}", self.command))
    }

    /// The warnings as one text.
    pub fn warnings(&self) -> String {
        self.value["warnings"].to_string()
    }

    /// A number; an error if the key has none.
    pub fn number(&self, key: &str) -> Result<f64, String> {
        self.value[key].as_f64().ok_or_else(|| {
            format!(
                "summary.json: {key} is {}, a number expected\n  command: {}",
                self.value[key], self.command
            )
        })
    }

    /// A boolean; an error if the key has none.
    pub fn boolean(&self, key: &str) -> Result<bool, String> {
        self.value[key].as_bool().ok_or_else(|| {
            format!(
                "summary.json: {key} is {}, true or false expected\n  command: {}",
                self.value[key], self.command
            )
        })
    }

    /// Returns an error with the command unless `holds`.
    pub fn require(&self, holds: bool, what: impl FnOnce() -> String) -> Result<(), String> {
        if holds { Ok(()) } else { Err(format!("{}\n  command: {}", what(), self.command)) }
    }
}

#[test]
fn wrapped_lines_are_joined() {
    use phasewarp::base::text::wrapped;
    let set = "--set 'a b'=c ".repeat(12);
    let text = format!("short\n  indented\nwarning: {}\n  phasewarp run {set}-o x\nend", set);
    assert!(wrapped(&text).lines().count() > 7, "{}", wrapped(&text));
    assert_eq!(unwrapped(&wrapped(&text)), text.replace(" \n", "\n"));
}
