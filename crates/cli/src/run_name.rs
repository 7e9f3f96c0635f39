//! The run folder of `train` without `--out`: `runs/NAME-DATE`, or with a number behind it if that exists.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use instgs_console::CliError;
use instgs_io::{IoError, run_folder};

/// Folder of all runs that have no `--out`.
const RUNS: &str = "runs";
const SECONDS_A_DAY: u64 = 24 * 60 * 60;

/// The first of `runs/NAME-DATE`, `runs/NAME-DATE-2`, ... that does not exist: NAME is that of the data set's folder, DATE the
/// present day in UTC, so that a run has the same name wherever it is started.
pub(super) fn unused(data: &Path) -> PathBuf {
    names(data).find(|path| !path.exists()).unwrap_or_default()
}

/// The same, and creates the folder, which nobody else had before.
///
/// # Errors
/// The folder cannot be created.
pub(super) fn claim(data: &Path) -> Result<PathBuf, CliError> {
    run_folder::create(Path::new(RUNS))?;
    for path in names(data) {
        match std::fs::create_dir(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(IoError::os(&path, "cannot create", &error).into()),
            Ok(()) => return Ok(path),
        }
    }
    Err(CliError::msg("no name for a run folder is left; choose one with --out"))
}

fn names(data: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    let days = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs() / SECONDS_A_DAY);
    let first = format!("{}-{}", name(data), date(days));
    (1..u32::MAX)
        .map(move |number| Path::new(RUNS).join(if number == 1 { first.clone() } else { format!("{first}-{number}") }))
}

/// The name of the data set's folder, also of `.` and `a/..`, as a name that needs no quotes in a shell.
fn name(data: &Path) -> String {
    let full = std::fs::canonicalize(data).unwrap_or_else(|_| data.into());
    let name = full.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let safe: String = name.chars().map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect();
    // A leading "-" would be taken for a flag, a leading "." hides the folder.
    let safe = safe.trim_start_matches(['-', '.']);
    if safe.is_empty() { "run".into() } else { safe.into() }
}

/// The date so many days after 1970-01-01, as `2026-11-26`.
fn date(mut days: u64) -> String {
    let is_leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let mut year = 1970;
    while days >= 365 + u64::from(is_leap(year)) {
        days -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let mut month = 1;
    for length in [31, 28 + u64::from(is_leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    format!("{year}-{month:02}-{:02}", days + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_know_leap_years() {
        // Of `date -u -d @$((86400 * DAYS)) +%F`.
        let known = [
            (0, "1970-01-01"),
            (58, "1970-02-28"),
            (59, "1970-03-01"),
            (364, "1970-12-31"),
            (789, "1972-02-29"),
            (11_016, "2000-02-29"),
            (11_017, "2000-03-01"),
            (20_783, "2026-11-26"),
            (47_540, "2100-02-28"),
            (47_541, "2100-03-01"),
        ];
        for (days, want) in known {
            assert_eq!(date(days), want, "{days}");
        }
    }

    #[test]
    fn names_are_those_of_folders_and_safe() {
        assert_eq!(name(Path::new("no/such/park")), "park");
        assert_eq!(name(Path::new("no/a b$c")), "a_b_c");
        assert_eq!(name(Path::new("no/-.x")), "x");
        assert_eq!(name(Path::new("/")), "run");
        let here = std::env::current_dir().map(|path| name(&path)).unwrap_or_default();
        assert_eq!(name(Path::new(".")), here);
    }
}
