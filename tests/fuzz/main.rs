//! The program `instgs-fuzz`: every reader for a moment, and readers with planted faults; and files of a few kilobytes that
//! claim all that a reader accepts.

#[path = "../common/program.rs"]
#[allow(dead_code, reason = "other tests use more of it")]
mod program;

use std::alloc::System;
use std::path::Path;

use assert_cmd::Command;
use cap::Cap;
use instgs_fuzz::seeds::clouds::cloud;
use instgs_io::scene_write::packed_scene_file_bytes;
use instgs_io::{IoError, Pack, scene_file, sog, spz};
use instgs_vk::scene::{Gaussians, InstancedScene, SourceRange};
use program::built;

/// Counts what this program's readers allocate.
#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, usize::MAX);

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

/// The most memory that a reader may take for a file of so few bytes.
const MOST_BYTES: usize = 64 << 20;
const FEW_BYTES: usize = 8192;

/// A few Gaussians that differ, and as many equal ones as asked for, which compress to nearly nothing.
fn crowded(sh_degree: u32, equal: usize) -> Gaussians {
    let mut all = cloud(sh_degree, 4);
    let mut many = all.range(SourceRange { first: 3, count: 1 });
    many.sh.fill([0.0; 3]);
    while many.len() < equal {
        let double = many.clone();
        many.append(&double);
    }
    all.append(&many);
    all
}

/// Whether a reader takes the file; if it takes more memory than is allowed, this process ends.
fn is_read<T>(read: impl Fn(&[u8], &Path) -> Result<T, IoError>, bytes: &[u8]) -> bool {
    ALLOCATOR.set_limit(ALLOCATOR.allocated() + MOST_BYTES).unwrap();
    let outcome = read(bytes, Path::new("crowded"));
    ALLOCATOR.set_limit(usize::MAX).unwrap();
    outcome.is_ok()
}

/// The claim grows until the reader refuses it.
#[test]
fn a_few_kilobytes_take_no_more_than_64_mib() {
    let path = Path::new("crowded");
    let small = |cloud: Gaussians| {
        let scene = InstancedScene { background: cloud, ..InstancedScene::default() };
        packed_scene_file_bytes(&scene, Pack::Small, path)
    };
    // What a reader takes, and of a file that is no longer short.
    let claims = |name: &str, write: &dyn Fn(usize) -> Vec<u8>, is_read: &dyn Fn(&[u8]) -> bool| {
        let files = (10..20).map(|power| write(1 << power));
        let short = files.filter(|bytes| bytes.len() <= FEW_BYTES);
        let read: Vec<bool> = short.map(|bytes| is_read(&bytes)).collect();
        assert!(read.first() == Some(&true), "{name}: {read:?}");
        read
    };
    let written = |outcome: Result<Vec<u8>, IoError>| outcome.unwrap();
    let spz = claims("spz", &|n| written(spz::spz_bytes(&crowded(3, n), false, path)), &|bytes| {
        is_read(spz::parse_spz, bytes)
    });
    // Without a palette, which takes seconds to find.
    let sog = claims("sog", &|n| written(sog::sog_bytes(&crowded(0, n), false, path)), &|bytes| {
        is_read(sog::parse_sog, bytes)
    });
    assert_eq!((spz.last(), sog.last()), (Some(&false), Some(&false)), "{spz:?} {sog:?}");
    // Its writer leaves positions as floats where their coded form would claim too much, so that files get longer.
    claims("small", &|n| written(small(crowded(3, n))), &|bytes| is_read(scene_file::parse_scene_file, bytes));
}
