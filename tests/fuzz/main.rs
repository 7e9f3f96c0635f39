//! The program `instgs-fuzz`: every reader for a moment, and readers with planted faults.

#[path = "../common/program.rs"]
#[allow(dead_code, reason = "other tests use more of it")]
mod program;

use assert_cmd::Command;
use program::built;

fn fuzz(arguments: &[&str]) -> Command {
    let mut command = Command::new(built("instgs-fuzz"));
    command.args(arguments);
    command
}

/// No reader breaks a promise on these inputs, the same ones each time. `tools/fuzz` looks longer.
#[test]
fn every_reader_withstands_damaged_files() {
    let output = fuzz(&["--inputs", "512", "--out"]).arg(tempfile::tempdir().unwrap().path()).assert().success();
    let table = String::from_utf8(output.get_output().stdout.clone()).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split_whitespace().collect()).collect();
    let known = instgs_fuzz::targets::all();
    assert_eq!(rows.len(), known.len(), "{table}");
    for (row, target) in rows.iter().zip(known) {
        assert_eq!((row[0], row[1], row[row.len() - 1]), (target.name, "512", "0"), "{table}");
        // Weights of a network are too large for a seed that is read.
        assert!(target.name == "weights" || row[2] != "0", "no input of {} is accepted: {table}", target.name);
    }
}

/// A reader that panics, takes all memory, all of the stack, or does not come back: each input at fault is saved, and does it again.
#[test]
fn planted_faults_are_found_and_saved() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let cases = [
        ("planted-panic", "panicked at"),
        ("planted-memory", "memory allocation of"),
        ("planted-stack", "overflowed its stack"),
        ("planted-time", "an input takes more than 0.3 s"),
    ];
    for (target, words) in cases {
        // On a busy machine others must not run into the clock.
        let seconds = if target == "planted-time" { "0.3" } else { "30" };
        let limits = ["--inputs", "2000", "--seconds-per-input", seconds, "--out", out, target];
        let output = fuzz(&limits).assert().code(1).get_output().clone();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains(words) && said.contains("saved as"), "{said}");
        let saved = said.lines().find_map(|line| line.split_once("saved as ")).unwrap().1;
        assert!(std::fs::read(saved).unwrap()[0] > 250, "{said}");
        if target == "planted-panic" {
            fuzz(&["--read", saved, target]).assert().code(101);
        }
    }
    assert!(
        fuzz(&["planted-memory", "--inputs", "64", "--seed", "1", "--memory", "0"])
            .assert()
            .code(1)
            .get_output()
            .stdout
            .is_empty()
    );
}
