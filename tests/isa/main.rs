//! The program `instgs-isa` as `tools/isa` runs it.

#[path = "../common/program.rs"]
#[allow(dead_code, reason = "other tests use more of it")]
mod program;

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use instgs_isa::families::find_driver;
use program::{built, error_of, repository};
use tempfile::TempDir;

fn isa(arguments: &[&str]) -> Command {
    let mut command = Command::new(built("instgs-isa"));
    command.current_dir(repository()).args(arguments);
    command
}

/// A file of budgets in a folder of its own.
fn budgets(text: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("isa.toml");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn an_unknown_kernel_is_an_error_before_anything_is_compiled() {
    let (_folder, path) = budgets("[families.gfx1100]\nkernels.tile_bland.waves = 8\n");
    let error = error_of(&mut isa(&["--budgets", text(&path), "--driver", "/nowhere.json"]));
    assert!(error.contains("isa.toml: there is no kernel tile_bland"), "{error}");
}

#[test]
fn a_missing_driver_is_an_error_unless_it_may_be_missing() {
    let error = error_of(&mut isa(&["--driver", "/nowhere.json"]));
    assert!(error.contains("/nowhere.json") && error.contains("--allow-missing"), "{error}");
    let allowed = isa(&["--driver", "/nowhere.json", "--allow-missing"]).assert().success();
    let said = String::from_utf8(allowed.get_output().stderr.clone()).unwrap();
    assert!(said.starts_with("warning: NO KERNEL WAS COMPILED"), "{said}");
}

#[test]
fn kernels_beyond_a_budget_are_named_one_a_line() {
    #[allow(clippy::print_stderr, reason = "a skipped test must be heard")]
    if let Err(error) = find_driver(None) {
        eprintln!("NOT TESTED: {error}");
        return;
    }
    // A SIMD unit of this family has room for 16; the blend is longer than 100 bytes, the others may be as long as they like.
    let (folder, path) = budgets("[families.gfx1100]\nevery.waves = 1\nkernels.tile_blend.code_bytes = 100\n");
    let table = folder.path().join("table.md");
    let output = isa(&["--budgets", text(&path), "--write-table", text(&table)]).assert().code(1).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    let broken: Vec<&str> = said.lines().filter(|line| line.starts_with("warning: ")).collect();
    assert_eq!(broken.len(), 2, "with TRAINING and without: {said}");
    for line in broken {
        assert!(
            line.starts_with("warning: tile_blend (TILE_SIZE=")
                && line.contains(" TRAINING=")
                && line.contains("on gfx1100: code_bytes "),
            "{line}"
        );
        assert!(line.ends_with(", budget at most 100"), "{line}");
    }
    let table = std::fs::read_to_string(table).unwrap();
    assert!(table.contains("| kernel | gfx1100, 32 lanes |") && table.contains("\n| adam | "), "{table}");
}
