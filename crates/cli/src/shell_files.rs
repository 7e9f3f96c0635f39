//! `instgs-vk completions` and `instgs-vk man`: what shells and `man` know of this program, made from its own definitions.

use std::path::{Path, PathBuf};

use clap::{Args, Command, ValueEnum};
use clap_complete::Shell;
use clap_mangen::Man;

use super::evidence;
use instgs_console::args::create_folder;
use instgs_console::{CliError, Printer};
use instgs_io::atomic_write;

/// Prints the completions of a shell: a script that it loads.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk completions bash > ~/.local/share/bash-completion/completions/instgs-vk\n  \
    instgs-vk completions zsh > ~/.zfunc/_instgs-vk        (with fpath+=~/.zfunc before compinit in ~/.zshrc)\n  \
    instgs-vk completions fish > ~/.config/fish/completions/instgs-vk.fish")]
pub(super) struct CompletionsArgs {
    /// The shell that is to complete commands and flags
    #[arg(value_name = "SHELL")]
    shell: ShellArg,
}

#[derive(Clone, Copy, ValueEnum)]
enum ShellArg {
    Bash,
    Zsh,
    Fish,
}

/// Writes the man pages of the program and its commands to a folder.
#[derive(Args)]
#[command(after_help = "Example:\n  instgs-vk man ~/.local/share/man/man1        (then: man instgs-vk-train)")]
pub(super) struct ManArgs {
    /// Folder for the pages; created if necessary
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

pub(super) fn completions(args: &CompletionsArgs, command: Command, printer: &Printer) -> Result<(), CliError> {
    let shell = match args.shell {
        ShellArg::Bash => Shell::Bash,
        ShellArg::Zsh => Shell::Zsh,
        ShellArg::Fish => Shell::Fish,
    };
    let mut command = with_evidence(command);
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, name.clone(), &mut script);
    printer.file(one_spelling(&name, &String::from_utf8_lossy(&script)).as_bytes())
}

/// clap_complete 4.6.11 spells a "-" of the program's name in two ways in its script for bash, which then finds no flags.
fn one_spelling(name: &str, script: &str) -> String {
    script.replace(&name.replace('-', "__subcmd__"), &name.replace('-', "__"))
}

/// The commands of `instgs-evidence` by name; their flags are known only to that program.
fn with_evidence(command: Command) -> Command {
    evidence::COMMANDS.iter().fold(command, |all, (name, what)| all.subcommand(Command::new(*name).about(*what)))
}

pub(super) fn man(args: &ManArgs, command: Command, printer: &Printer) -> Result<(), CliError> {
    create_folder(&args.folder)?;
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let count = write_pages(&command, &args.folder)?;
    printer.line(format_args!("{count} man pages in {}", args.folder.display()));
    Ok(())
}

/// Writes the page of a command, for instance `instgs-vk-train.1`, and those of its subcommands; returns their number.
fn write_pages(command: &Command, folder: &Path) -> Result<usize, CliError> {
    let page = Man::new(command.clone());
    atomic_write(&folder.join(page.get_filename()), |out| page.render(out))?;
    let of_subcommands: Result<Vec<usize>, CliError> =
        command.get_subcommands().map(|sub| write_pages(sub, folder)).collect();
    Ok(1 + of_subcommands?.into_iter().sum::<usize>())
}
