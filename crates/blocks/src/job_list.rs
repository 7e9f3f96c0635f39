//! The list of commands that train the blocks: one a line, for GNU parallel, Slurm's arrays, or Ray.

use std::path::Path;

use instgs_io::{IoError, atomic_write};

use crate::plan::Plan;

/// Name of the list, beside the plan.
pub const JOBS: &str = "jobs.txt";
/// Folder of a block's run, in the folder of the block.
const RUN: &str = "run";

/// One command per block of the plan in `folder` (absolute), with more arguments for every one of them. A command that is given
/// again continues its run, or ends at once if that is finished.
pub fn job_lines(plan: &Plan, folder: &Path, more: &[String]) -> Vec<String> {
    let line = |block: &crate::plan::Block| {
        let data = folder.join(&block.name);
        let paths = [data.clone(), data.join(RUN)].map(|path| quoted(&path.to_string_lossy()));
        let mut words =
            vec!["instgs-vk".to_owned(), "train".into(), paths[0].clone(), "--out".into(), paths[1].clone()];
        words.push("--resume".into());
        words.extend(more.iter().map(|word| quoted(word)));
        words.join(" ")
    };
    plan.blocks.iter().map(line).collect()
}

/// Writes the list into the folder of the plan.
///
/// # Errors
/// It cannot be written.
pub fn write_jobs(folder: &Path, lines: &[String]) -> Result<(), IoError> {
    atomic_write(&folder.join(JOBS), |out| lines.iter().try_for_each(|line| writeln!(out, "{line}")))
}

/// A word as a shell takes it: in quotes where it has characters that mean something to one.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_where_a_shell_would_take_them_apart() {
        assert_eq!(quoted("steps=300"), "steps=300");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
