//! The layers of a configuration, from the defaults up.

use std::collections::BTreeMap;
use std::path::Path;

use toml::{Table, Value};

use super::TrainConfig;
use super::error::{ConfigError, one_line};
use super::keys::{self, KEYS};
use crate::io::read_bytes;

/// Name and text of each preset that `--config` knows; the first two hold the defaults.
pub const PRESETS: [(&str, &str); 6] = [
    ("default", include_str!("../../../../configs/default.toml")),
    ("instgs", include_str!("../../../../configs/instgs.toml")),
    ("quick", include_str!("../../../../configs/quick.toml")),
    ("paper", include_str!("../../../../configs/paper.toml")),
    ("mcmc", include_str!("../../../../configs/mcmc.toml")),
    ("instgs_quick", include_str!("../../../../configs/instgs_quick.toml")),
];

/// Longest value that an error repeats, characters.
const VALUE_SHOWN: usize = 60;

/// Puts a configuration together; each layer overrides those before it. Errors come with the layer that has them.
///
/// ```
/// use instgs_vk::train::config::ConfigBuilder;
/// let config = ConfigBuilder::new().file("quick")?.set("rates.quats=2e-3")?.flag("--steps", "steps", 300)?.finish()?;
/// assert_eq!((config.steps, config.rates.quats), (300, 2e-3));
/// # Ok::<(), instgs_vk::train::config::ConfigError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct ConfigBuilder {
    /// Value and origin by key.
    values: BTreeMap<&'static str, (Value, String)>,
}

impl ConfigBuilder {
    /// Nothing but the defaults, which [`Self::finish`] puts below everything.
    pub fn new() -> Self {
        Self::default()
    }

    /// `--config`: the name of a preset, or else the path of a TOML file.
    ///
    /// # Errors
    /// No such file, not TOML, an unknown key, or a value that its key does not take.
    pub fn file(self, name_or_path: &str) -> Result<Self, ConfigError> {
        if let Some((name, text)) = PRESETS.iter().find(|(name, _)| *name == name_or_path) {
            return self.text(text, &format!("preset {name}"));
        }
        let path = Path::new(name_or_path);
        let bytes = read_bytes(path).map_err(|e| {
            let names: Vec<&str> = PRESETS.iter().map(|(name, _)| *name).collect();
            e.advise(format!("--config takes a TOML file or a preset ({})", names.join(", ")))
        })?;
        let origin = path.display().to_string();
        let text = String::from_utf8(bytes)
            .map_err(|_| ConfigError::Syntax { origin: origin.clone(), what: "is not UTF-8 text".into() })?;
        self.text(&text, &origin)
    }

    /// TOML text; `origin` names it in errors.
    ///
    /// # Errors
    /// Not TOML, an unknown key, or a value that its key does not take.
    pub fn text(mut self, text: &str, origin: &str) -> Result<Self, ConfigError> {
        let table: Table = text.parse().map_err(|e: toml::de::Error| {
            let line = e.span().and_then(|s| text.get(..s.start)).map_or(1, |t| 1 + t.matches('\n').count());
            ConfigError::Syntax { origin: format!("{origin}: line {line}"), what: one_line(e.message()) }
        })?;
        self.table("", &table, origin)?;
        Ok(self)
    }

    /// `--set KEY=VALUE`: a dotted key and a TOML value; what is not TOML is taken as a string, so words need no quotes.
    ///
    /// # Errors
    /// No `=`, an unknown key, or a value that the key does not take.
    pub fn set(mut self, assignment: &str) -> Result<Self, ConfigError> {
        let origin = "--set";
        let Some((key, text)) = assignment.split_once('=') else {
            let what = format!("{} has no \"=\"; write KEY=VALUE, for instance steps=500", shown(assignment));
            return Err(ConfigError::Syntax { origin: origin.into(), what });
        };
        let value = text.trim().parse().unwrap_or_else(|_| Value::String(text.trim().into()));
        self.assign(key.trim(), &value, origin)?;
        Ok(self)
    }

    /// A flag of its own, such as `--steps 500`; `flag` names it in errors, `key` is what it sets.
    ///
    /// # Errors
    /// A value that the key does not take.
    pub fn flag(mut self, flag: &str, key: &str, value: impl Into<Value>) -> Result<Self, ConfigError> {
        self.assign(key, &value.into(), flag)?;
        Ok(self)
    }

    /// The configuration.
    ///
    /// # Errors
    /// Values that do not go together.
    pub fn finish(self) -> Result<TrainConfig, ConfigError> {
        // The first two presets are the defaults: each has keys that the other has not.
        let mut all = Self::new();
        for (name, defaults) in &PRESETS[..2] {
            all = all.text(defaults, &format!("preset {name}"))?;
        }
        all.values.extend(self.values);
        let mut table = Table::new();
        for (key, (value, _)) in &all.values {
            let place = match key.split_once('.') {
                None => table.insert((*key).into(), value.clone()),
                Some((section, key)) => {
                    let section = table.entry(section).or_insert_with(|| Value::Table(Table::new()));
                    section.as_table_mut().and_then(|t| t.insert(key.into(), value.clone()))
                }
            };
            debug_assert!(place.is_none(), "{key} twice");
        }
        let config: TrainConfig = table.try_into().map_err(|e| ConfigError::unwritable(&e.to_string()))?;
        all.check(&config)?;
        Ok(config)
    }

    fn table(&mut self, prefix: &str, table: &Table, origin: &str) -> Result<(), ConfigError> {
        table.iter().try_for_each(|(name, value)| self.assign(&format!("{prefix}{name}"), value, origin))
    }

    fn assign(&mut self, name: &str, value: &Value, origin: &str) -> Result<(), ConfigError> {
        let section = format!("{name}.");
        match (keys::find(name), value) {
            (Some(key), _) => {
                let accepted = key.takes.accept(value).ok_or_else(|| ConfigError::Value {
                    origin: origin.into(),
                    key: name.into(),
                    value: shown(&value.to_string()),
                    allowed: key.takes.to_string(),
                })?;
                self.values.insert(key.name, (accepted, origin.into()));
                Ok(())
            }
            (None, Value::Table(inner)) if !inner.is_empty() || KEYS.iter().any(|k| k.name.starts_with(&section)) => {
                self.table(&section, inner, origin)
            }
            _ => Err(ConfigError::UnknownKey {
                origin: origin.into(),
                key: shown(name),
                nearest: keys::nearest(name).into(),
            }),
        }
    }

    /// What no single key can see.
    fn check(&self, config: &TrainConfig) -> Result<(), ConfigError> {
        let shown = |key: &str| {
            let origin = self.values.get(key).map(|(value, origin)| format!("{key} = {value} ({origin})"));
            origin.unwrap_or_else(|| key.into())
        };
        let require = |fits: bool, first: &str, relation: &'static str, second: &str| match fits {
            true => Ok(()),
            false => Err(ConfigError::Conflict { first: shown(first), relation, second: shown(second) }),
        };
        let (densify, mcmc) = (&config.densify, &config.mcmc);
        require(densify.start <= densify.stop, "densify.start", "at most", "densify.stop")?;
        require(mcmc.start <= mcmc.stop, "mcmc.start", "at most", "mcmc.stop")?;
        // Otherwise the pruning after a reset would remove every Gaussian.
        require(
            densify.opacity_reset_every == 0 || densify.opacity_reset_to > densify.opacity_min,
            "densify.opacity_reset_to",
            "above",
            "densify.opacity_min",
        )?;
        require(
            config.init != super::Init::Random || config.init_count <= config.max_gaussians,
            "init_count",
            "at most",
            "max_gaussians",
        )
    }
}

/// A text of the user in an error: one line, not too long.
fn shown(text: &str) -> String {
    let line = one_line(text);
    match line.char_indices().nth(VALUE_SHOWN) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}

#[cfg(test)]
#[path = "load_tests.rs"]
mod tests;
