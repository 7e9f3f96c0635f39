//! `instgs-vk config`: what each key of the configuration is for.

use clap::{Args, Subcommand};

use instgs_console::table::Table;
use instgs_console::{CliError, Printer};
use instgs_objects::pipeline::config::{ConfigBuilder, PRESETS, RunConfig};
use instgs_train::config::{ConfigError, KeyText, explain};

/// Width of explanations on a terminal, characters.
const TEXT_WIDTH: usize = 100;

/// Lists the keys of the configuration, or explains one.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk config list\n  \
    instgs-vk config list joint\n  \
    instgs-vk config show densify.recycle")]
pub(super) struct ConfigArgs {
    #[command(subcommand)]
    command: ConfigCommand,
}

#[derive(Subcommand)]
enum ConfigCommand {
    List(ListArgs),
    Show(ShowArgs),
}

/// Lists every key with its default and the values that it accepts.
#[derive(Args)]
#[command(after_help = "Examples:\n  instgs-vk config list\n  instgs-vk config list rates --json")]
struct ListArgs {
    /// Only keys that contain this text
    #[arg(value_name = "TEXT")]
    text: Option<String>,
    /// Report as JSON on stdout
    #[arg(long)]
    json: bool,
}

/// Explains a key: its purpose, default, accepted values, and the presets that change it.
#[derive(Args)]
#[command(after_help = "Examples:\n  instgs-vk config show max_gaussians\n  instgs-vk config show joint.steps --json")]
struct ShowArgs {
    /// Dotted name, for instance joint.steps
    #[arg(value_name = "KEY")]
    key: String,
    /// Report as JSON on stdout
    #[arg(long)]
    json: bool,
}

#[derive(serde::Serialize)]
struct KeyReport {
    key: &'static str,
    default: String,
    accepts: String,
    text: String,
    section: String,
    /// Presets that set another value, each with it.
    presets: Vec<(&'static str, String)>,
}

impl ConfigArgs {
    /// True if stdout carries only the JSON report.
    pub(super) fn json_on_stdout(&self) -> bool {
        match &self.command {
            ConfigCommand::List(args) => args.json,
            ConfigCommand::Show(args) => args.json,
        }
    }
}

pub(super) fn run(args: &ConfigArgs, printer: &Printer) -> Result<(), CliError> {
    match &args.command {
        ConfigCommand::List(args) => list(args, printer),
        ConfigCommand::Show(args) => show(args, printer),
    }
}

fn list(args: &ListArgs, printer: &Printer) -> Result<(), CliError> {
    let wanted = |key: &KeyText| args.text.as_ref().is_none_or(|text| key.name.contains(text.as_str()));
    let keys: Vec<KeyText> = explain::<RunConfig>().into_iter().filter(wanted).collect();
    if keys.is_empty() {
        let text = args.text.as_deref().unwrap_or_default();
        return Err(CliError::msg(format!("no key contains \"{text}\"; instgs-vk config list shows all keys")));
    }
    let presets = preset_values()?;
    let reports: Vec<KeyReport> = keys.into_iter().map(|key| report(key, &presets)).collect();
    if args.json {
        return printer.json(&reports);
    }
    let mut width = 0;
    for key in &reports {
        width = width.max(key.key.len() + key.default.len());
    }
    for KeyReport { key, default, accepts, .. } in &reports {
        let gap = " ".repeat(width - key.len() - default.len());
        printer.line(format_args!("{key} = {default}{gap}  {accepts}"));
    }
    Ok(())
}

fn show(args: &ShowArgs, printer: &Printer) -> Result<(), CliError> {
    let Some(key) = explain::<RunConfig>().into_iter().find(|key| key.name == args.key) else {
        return Err(unknown(&args.key));
    };
    let report = report(key, &preset_values()?);
    if args.json {
        return printer.json(&report);
    }
    printer.line(format_args!("{} = {}", report.key, report.default));
    for text in [&report.text, &report.section].into_iter().filter(|text| !text.is_empty()) {
        printer.line(format_args!("\n{}", wrapped(text)));
    }
    printer.line("");
    let mut table = Table::default();
    table.row([format!("accepts  {}", report.accepts)]);
    for (preset, value) in &report.presets {
        table.row([format!("preset   {preset}: {value}")]);
    }
    printer.line(table);
    Ok(())
}

/// The error of a `--set` with the same key, which names the nearest one.
fn unknown(key: &str) -> CliError {
    match ConfigBuilder::new().set(&format!("{key}=0")) {
        Err(ConfigError::UnknownKey { nearest, .. }) => {
            CliError::msg(format!("{key} is no key; did you mean {nearest}? instgs-vk config list shows all keys"))
        }
        // A section, or a key with "=" in it.
        _ => CliError::msg(format!("{key} is no key; instgs-vk config list shows all keys")),
    }
}

/// Name, and (key, value, default) of what each preset changes.
type PresetValues = Vec<(&'static str, Vec<(String, String, String)>)>;

fn preset_values() -> Result<PresetValues, CliError> {
    let default = RunConfig::default();
    let of = |(name, _): &(&'static str, &str)| -> Result<_, CliError> {
        Ok((*name, ConfigBuilder::new().file(name)?.finish()?.differences(&default)?))
    };
    PRESETS.iter().map(of).collect()
}

fn report(key: KeyText, presets: &PresetValues) -> KeyReport {
    let value = |values: &[(String, String, String)]| {
        values.iter().find(|(name, ..)| *name == key.name).map(|(_, own, _)| own.clone())
    };
    KeyReport {
        key: key.name,
        accepts: key.takes.to_string(),
        presets: presets.iter().filter_map(|(name, values)| Some((*name, value(values)?))).collect(),
        default: key.default,
        text: key.text,
        section: key.section,
    }
}

/// The text in lines of at most [`TEXT_WIDTH`] characters.
fn wrapped(text: &str) -> String {
    let (mut out, mut width) = (String::new(), 0);
    for word in text.split_whitespace() {
        let length = word.chars().count();
        let fits = width + 1 + length <= TEXT_WIDTH;
        if width > 0 {
            out.push(if fits { ' ' } else { '\n' });
        }
        width = if width > 0 && fits { width + 1 + length } else { length };
        out += word;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_train::config::Configuration;

    #[test]
    fn every_key_is_explained() {
        let texts = explain::<RunConfig>();
        let names: Vec<&str> = texts.iter().map(|text| text.name).collect();
        let keys: Vec<&str> = RunConfig::keys().iter().map(|key| key.name).collect();
        assert_eq!(names, keys);
        for text in texts {
            assert!(text.text.len() + text.section.len() > 20, "{} has no explanation", text.name);
        }
    }

    #[test]
    fn lines_break_between_words() {
        let text = ["word"; 60].join(" ");
        let lines: Vec<usize> = wrapped(&text).lines().map(str::len).collect();
        assert_eq!(lines, [99, 99, 99]);
        assert_eq!(wrapped("a b"), "a b");
    }
}
