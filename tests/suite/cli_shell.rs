//! What the program gives a shell and its user besides scenes: completions, man pages, explanations of keys, the player.

use std::fs;
use std::process::Command as Process;

use serde_json::Value;

use crate::common::program::{built, error_of, program};

fn stdout_of(args: &[&str]) -> String {
    String::from_utf8(program().args(args).assert().success().get_output().stdout.clone()).unwrap()
}

/// bash loads the script and completes with it; of zsh and fish, which may not be installed, the script is looked at.
#[test]
fn completions_know_commands_and_flags() {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("instgs-vk.bash");
    fs::write(&script, stdout_of(&["completions", "bash"])).unwrap();
    let complete = |words: &[&str]| {
        let list = words.join(" ");
        let last = words.len() - 1;
        let program = format!(
            "source {}; COMP_WORDS=({list}); COMP_CWORD={last}; run=$(complete -p instgs-vk); run=${{run##*-F }}; \
             ${{run%% *}} instgs-vk \"${{COMP_WORDS[{last}]}}\" \"${{COMP_WORDS[{last}-1]}}\"; \
             printf '%s\\n' \"${{COMPREPLY[@]}}\"",
            script.display()
        );
        let output = Process::new("bash").args(["-c", &program]).output().unwrap();
        String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(complete(&["instgs-vk", "comp"]), ["completions", "compare"]);
    assert_eq!(complete(&["instgs-vk", "train", "--dry"]), ["--dry-run"]);
    assert!(complete(&["instgs-vk", "completions", "zs"]).contains(&"zsh".to_owned()));
    assert_eq!(complete(&["instgs-vk", "nothing-begins-so"]), [""]);
    for (shell, line) in [("zsh", "#compdef instgs-vk"), ("fish", "complete -c instgs-vk")] {
        let script = stdout_of(&["completions", shell]);
        assert!(script.contains(line) && script.contains("dry-run") && script.contains("tables"), "{shell}");
        assert!(!script.contains("u{"), "{shell}: control characters are as they are");
    }
    program().args(["completions", "tcsh"]).assert().code(2);
}

#[test]
fn every_command_has_a_man_page() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("man1");
    let said = stdout_of(&["man", out.to_str().unwrap()]);
    let pages = fs::read_dir(&out).unwrap().count();
    assert!(said.starts_with(&format!("{pages} man pages in ")), "{said}");
    for (page, words) in [
        ("instgs-vk", "instgs\\-vk\\-train(1)"),
        ("instgs-vk-train", "\\-\\-dry\\-run"),
        ("instgs-vk-config-show", "Dotted name"),
    ] {
        let text = fs::read_to_string(out.join(format!("{page}.1"))).unwrap();
        let title = page.replace('-', "\\-");
        assert!(text.contains(".TH") && text.contains(words), "{page}: {words}: {text}");
        assert!(text.contains(&title), "{page}: {title}: {text}");
    }
    assert!(!out.join("instgs-vk-help.1").exists());
}

#[test]
fn keys_are_listed_and_explained() {
    let all = stdout_of(&["config", "list"]);
    assert!(all.lines().count() > 100 && all.contains("joint.steps = 27000"), "{all}");
    let some = stdout_of(&["config", "list", "mcmc."]);
    assert!(some.lines().all(|line| line.starts_with("mcmc.")) && some.lines().count() == 9, "{some}");
    let text = stdout_of(&["config", "show", "densify.recycle"]);
    for words in ["densify.recycle = 0.0", "A cloud at its cap", "a number from 0.0, below 1.0", "instgs_renders: 0.05"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 110), "{text}");
    let json: Value = serde_json::from_str(&stdout_of(&["config", "show", "steps", "--json"])).unwrap();
    assert_eq!((json["key"].as_str(), json["default"].as_str()), (Some("steps"), Some("30000")));
    assert!(json["presets"].as_array().unwrap().iter().any(|preset| preset[0] == "quick"), "{json}");
    let json: Value = serde_json::from_str(&stdout_of(&["config", "list", "--json"])).unwrap();
    assert_eq!(json.as_array().unwrap().len(), all.lines().count());
    let text = error_of(program().args(["config", "show", "densify.recicle"]));
    assert!(text.contains("densify.recycle") && text.contains("config list"), "{text}");
    assert!(error_of(program().args(["config", "show", "densify"])).contains("config list"));
    assert!(error_of(program().args(["config", "list", "nothing-has-this"])).contains("no key"));
}

/// A copy of the program without a player beside it, in a folder of its own.
#[cfg(unix)]
fn alone() -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("bin/instgs-vk");
    fs::create_dir(folder.path().join("bin")).unwrap();
    fs::copy(built("instgs-vk"), &copy).unwrap();
    (folder, copy)
}

/// A program that prints its own path and its arguments, and ends with exit code 7.
#[cfg(unix)]
fn write_player(path: &std::path::Path) {
    use std::os::unix::fs::PermissionsExt;
    fs::write(path, "#!/bin/sh\nprintf '%s|' \"$0\" \"$@\"\nexit 7\n").unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(unix)]
#[test]
fn view_starts_the_player_with_its_flags() {
    let (folder, copy) = alone();
    let run = |args: &[&str]| Process::new(&copy).args(args).env("PATH", folder.path()).output().unwrap();
    let missing = run(&["view", "a.instgs"]);
    let text = String::from_utf8(missing.stderr).unwrap();
    assert_eq!(missing.status.code(), Some(1));
    assert!(text.starts_with("error: instgs-player is neither") && text.lines().count() == 1, "{text}");
    let on_path = folder.path().join("instgs-player");
    write_player(&on_path);
    let said = |args: &[&str]| {
        let output = run(args);
        assert_eq!(output.status.code(), Some(7), "the player's exit code");
        String::from_utf8(output.stdout).unwrap()
    };
    let want = format!("{}|--|-a b.instgs|", on_path.display());
    assert_eq!(said(&["view", "--", "-a b.instgs"]), want);
    let beside = copy.with_file_name("instgs-player");
    write_player(&beside);
    let want = format!("{}|--show|templates|--device|llvm|--|a.instgs|", beside.display());
    assert_eq!(said(&["--device", "llvm", "view", "a.instgs", "--show", "templates"]), want);
    assert_eq!(run(&["view"]).status.code(), Some(2));
}

/// A script that is cut off, or a report, is worse than none.
#[test]
#[cfg(target_os = "linux")]
fn output_that_cannot_be_written_is_an_error() {
    for args in [&["completions", "bash"][..], &["config", "list", "--json"]] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let output = Process::new(built("instgs-vk")).args(args).stdout(full).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{args:?}: {text}");
        assert!(text.contains("cannot write all of the output"), "{text}");
    }
}
