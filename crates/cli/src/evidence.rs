//! The subcommands of the program `instgs-evidence`, which is installed in the same folder: data sets with known truth,
//! and comparisons of instanced and plain scenes. They are a program of their own because users need neither a ray
//! tracer nor tables of evidence.

use std::ffi::OsString;
use std::process::ExitCode;

use super::programs;
use instgs_console::CliError;

const PROGRAM: &str = "instgs-evidence";

/// Names of the subcommands, and what each does.
pub(crate) const COMMANDS: [(&str, &str); 4] = [
    ("demo", "All steps on generated photos of eight cars: trains, compares, draws"),
    ("synth", "Makes a ray-traced data set with known poses, masks and depths"),
    ("compare", "Trains an instanced scene and 3DGS of the same time and bytes, and compares them"),
    ("tables", "The comparison for a list of scenes, with rivals, ablations and plots"),
];

/// The paragraph of `--help` about them.
pub(crate) fn help() -> String {
    let lines = COMMANDS.map(|(name, what)| format!("\n  {name:<10}{what}"));
    format!("Commands that run the program {PROGRAM} (each has --help):{}", lines.concat())
}

/// Runs the program `instgs-evidence` with the same arguments if the subcommand belongs to it; `None` if it does not.
pub(crate) fn run_if_asked(args: impl Iterator<Item = OsString>) -> Option<Result<ExitCode, CliError>> {
    let args: Vec<OsString> = args.collect();
    let name = subcommand(&args)?;
    COMMANDS.iter().any(|(known, _)| *known == name).then(|| run(&args, name))
}

/// The first argument that is no flag, not the value of `--device` (which may come before a subcommand), and not `help`.
fn subcommand(args: &[OsString]) -> Option<&str> {
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        match arg.to_str()? {
            "--device" => args.next(),
            flag if flag.starts_with('-') || flag == "help" => None,
            name => return Some(name),
        };
    }
    None
}

fn run(args: &[OsString], name: &str) -> Result<ExitCode, CliError> {
    match programs::beside(PROGRAM)? {
        Some(program) => programs::become_program(&program, args),
        None => Err(CliError::msg(format!(
            "{name} is a command of {PROGRAM}, which is not beside this program: cargo build --release makes it"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_subcommand_is_found_behind_flags() {
        let of = |words: &str| {
            let args: Vec<OsString> = words.split_whitespace().map(OsString::from).collect();
            subcommand(&args).map(str::to_string)
        };
        assert_eq!(of("demo --out x").as_deref(), Some("demo"));
        assert_eq!(of("--device llvm synth cars").as_deref(), Some("synth"));
        assert_eq!(of("--device=0 tables a").as_deref(), Some("tables"));
        assert_eq!(of("help demo").as_deref(), Some("demo"));
        assert_eq!(of("train --out demo").as_deref(), Some("train"));
        assert_eq!((of("--version"), of("")), (None, None));
    }
}
