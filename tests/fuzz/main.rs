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
/// Gaussians that differ, before as many equal ones as a file can claim.
const DIFFERENT: usize = 100;

/// Some Gaussians that differ, and many equal ones, which compress to nearly nothing.
fn crowded(sh_degree: u32, equal: usize) -> Gaussians {
    let mut all = cloud(sh_degree, DIFFERENT);
    let mut many = all.range(SourceRange { first: 3, count: 1 });
    many.sh.fill([0.0; 3]);
    while many.len() < equal {
        let double = many.clone();
        many.append(&double);
    }
    all.append(&many.range(SourceRange { first: 0, count: equal as u32 }));
    all
}

/// Reads a file, which must not take more memory than is allowed: an allocation that fails is an error, or ends this process.
fn is_read<T>(read: impl Fn(&[u8], &Path) -> Result<T, IoError>, bytes: &[u8]) -> bool {
    ALLOCATOR.set_limit(ALLOCATOR.allocated() + MOST_BYTES).unwrap();
    let outcome = read(bytes, Path::new("crowded"));
    ALLOCATOR.set_limit(usize::MAX).unwrap();
    outcome.is_ok()
}

/// The file of at most [`FEW_BYTES`] with the most Gaussians that a writer makes, and how many.
fn fullest(write: impl Fn(usize) -> Result<Vec<u8>, IoError>) -> (Vec<u8>, usize) {
    let counts = std::iter::successors(Some(140_000), |&equal| Some(equal * 9 / 10).filter(|&equal| equal > 1000));
    let files = counts.filter_map(|equal| write(equal).ok().map(|bytes| (bytes, DIFFERENT + equal)));
    files.into_iter().find(|(bytes, _)| bytes.len() <= FEW_BYTES).unwrap()
}

/// What writers make is read in little memory, and what claims more Gaussians than that is refused.
#[test]
fn a_few_kilobytes_take_no_more_than_64_mib() {
    let path = Path::new("crowded");
    let small = |equal| {
        let scene = InstancedScene { background: crowded(3, equal), ..InstancedScene::default() };
        packed_scene_file_bytes(&scene, Pack::Small, path)
    };
    let (mut file, spz) = fullest(|equal| spz::spz_bytes(&crowded(3, equal), false, path));
    assert!(is_read(spz::parse_spz, &file), "{spz}");
    // The number of splats.
    file[8..12].copy_from_slice(&140_000u32.to_le_bytes());
    let refused = spz::parse_spz(&file, path).err().unwrap().to_string();
    assert!(refused.contains("more than is plausible"), "{refused}");
    // Without a palette, which takes seconds to find.
    let (file, sog) = fullest(|equal| sog::sog_bytes(&crowded(0, equal), false, path));
    assert!(is_read(sog::parse_sog, &file), "{sog}");
    let (file, small) = fullest(small);
    assert!(is_read(scene_file::parse_scene_file, &file), "{small}");
    assert!(spz > 10_000 && sog > 20_000 && small > 1_500, "{spz} {sog} {small}");
}
