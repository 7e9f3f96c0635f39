//! Puts a configuration together from layers: defaults, files, `--set` and flags.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::path::Path;

use toml::{Table, Value};

use super::error::{ConfigError, one_line};
use super::keys::{self, Key};
use instgs_io::read_bytes;
use instgs_vk::scene::gaussians::MAX_SH_DEGREE;

/// Longest value that an error repeats, characters.
const VALUE_SHOWN: usize = 60;

/// The key of the method, which has defaults of its own.
const METHOD: &str = "method";

/// A configuration that [`Layers`] can put together.
pub trait Configuration: Sized {
    /// Every key, in the order in which a file is written.
    fn keys() -> Vec<Key>;

    /// Names and texts of the files that together hold the default of every key. Of a key in several of them the first
    /// counts, but see [`Self::replaces_defaults`].
    fn defaults() -> &'static [(&'static str, &'static str)];

    /// True if the file `name` of [`Self::defaults`] replaces what the files before it say, where the layers above the
    /// defaults choose `method`.
    fn replaces_defaults(_name: &str, _method: Option<&str>) -> bool {
        false
    }

    /// Names and texts of the built-in files that `--config` knows.
    fn presets() -> &'static [(&'static str, &'static str)];

    /// Builds the configuration from a table that has every key.
    ///
    /// # Errors
    /// A key that is missing or unknown, or a value of the wrong type.
    fn from_table(table: Table) -> Result<Self, toml::de::Error>;

    /// A table with every key.
    ///
    /// # Errors
    /// A value that TOML cannot hold.
    fn to_table(&self) -> Result<Table, toml::ser::Error>;

    /// Checks rules between several keys; `shown` gives a key with its value and the place where it was set.
    ///
    /// # Errors
    /// Two values that do not go together.
    fn check(&self, shown: &dyn Fn(&str) -> String) -> Result<(), ConfigError>;
}

/// What runs did before there were keys for it.
const OLDER_RUNS: &str = "
[rates]
decay_steps = 0
[densify]
growth = \"clone_or_split\"
recycle = 0.0
[offsets]
sh_every = 1
[joint]
instances_every = 1
decay_start = 0.0
decay_steps = 0
grow_fraction = 0.0
own_share = 0.0
color_matrix_rate = 0.0
";

/// Puts a configuration together; each layer overrides those before it. An error names the layer that caused it.
///
/// ```
/// use instgs_train::config::ConfigBuilder;
/// let config = ConfigBuilder::new().file("quick")?.set("rates.quats=2e-3")?.flag("--steps", "steps", 300)?.finish()?;
/// assert_eq!((config.steps, config.rates.quats), (300, 2e-3));
/// # Ok::<(), instgs_train::config::ConfigError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Layers<C> {
    keys: Vec<Key>,
    /// Value and origin by key.
    values: BTreeMap<&'static str, (Value, String)>,
    result: PhantomData<C>,
}

impl<C: Configuration> Default for Layers<C> {
    fn default() -> Self {
        Self::new()
    }
}

impl<C: Configuration> Layers<C> {
    /// No layers yet; [`Self::finish`] puts the defaults below all that follow.
    pub fn new() -> Self {
        Self { keys: C::keys(), values: BTreeMap::new(), result: PhantomData }
    }

    /// Adds the layer of `--config`: the name of a preset, or else the path of a TOML file. The name of the defaults takes
    /// back what the layers below say of their keys, but for the method: it has the defaults of that method.
    ///
    /// # Errors
    /// The file does not exist or is not TOML, or it has an unknown key or a value that its key does not accept.
    pub fn file(mut self, name_or_path: &str) -> Result<Self, ConfigError> {
        if let Some((name, text)) = C::defaults().first().filter(|(name, _)| *name == name_or_path) {
            // They are below all layers anyway; added here they would hide the defaults of a method.
            let defaults = Self::new().text(text, &format!("preset {name}"))?;
            self.values.retain(|key, _| *key == METHOD || !defaults.values.contains_key(key));
            return Ok(self);
        }
        if let Some((name, text)) = C::presets().iter().find(|(name, _)| *name == name_or_path) {
            return self.text(text, &format!("preset {name}"));
        }
        let path = Path::new(name_or_path);
        let bytes = read_bytes(path).map_err(|e| {
            let names: Vec<&str> = C::presets().iter().map(|(name, _)| *name).collect();
            e.advise(format!("--config takes a TOML file or a preset ({})", names.join(", ")))
        })?;
        let origin = path.display().to_string();
        let text = String::from_utf8(bytes)
            .map_err(|_| ConfigError::Syntax { origin: origin.clone(), what: "is not UTF-8 text".into() })?;
        self.text(&text, &origin)
    }

    /// Adds the configuration that a run has written, perhaps by a version before some of the keys: those it does not have keep
    /// what such a run has done so far.
    ///
    /// # Errors
    /// As [`Layers::file`].
    pub fn run_file(self, path: &Path) -> Result<Self, ConfigError> {
        self.text(OLDER_RUNS, "runs of older versions")?.file(&path.display().to_string())
    }

    /// Adds a layer of TOML text; `origin` names it in errors.
    ///
    /// # Errors
    /// The text is not TOML, or it has an unknown key or a value that its key does not accept.
    pub fn text(mut self, text: &str, origin: &str) -> Result<Self, ConfigError> {
        let table: Table = text.parse().map_err(|e: toml::de::Error| {
            let line = e.span().and_then(|s| text.get(..s.start)).map_or(1, |t| 1 + t.matches('\n').count());
            ConfigError::Syntax { origin: format!("{origin}: line {line}"), what: one_line(e.message()) }
        })?;
        self.table("", &table, origin)?;
        Ok(self)
    }

    /// Adds one `--set KEY=VALUE`: a dotted key and a TOML value. A value that is not TOML counts as a string, so words
    /// need no quotes.
    ///
    /// # Errors
    /// There is no `=`, the key is unknown, or it does not accept the value.
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

    /// Adds a value set by a flag of its own, such as `--steps 500`; `flag` names it in errors, `key` is the key that
    /// it sets.
    ///
    /// # Errors
    /// The key does not accept the value.
    pub fn flag(mut self, flag: &str, key: &str, value: impl Into<Value>) -> Result<Self, ConfigError> {
        self.assign(key, &value.into(), flag)?;
        Ok(self)
    }

    /// Puts the layers above the defaults and checks the result.
    ///
    /// # Errors
    /// Values that do not go together.
    pub fn finish(self) -> Result<C, ConfigError> {
        let mut all = Self::new();
        let method = self.values.get(METHOD).and_then(|(value, _)| value.as_str());
        for (name, defaults) in C::defaults() {
            let layer = Self::new().text(defaults, &format!("preset {name}"))?;
            let replaces = C::replaces_defaults(name, method);
            for (key, value) in layer.values {
                if replaces || !all.values.contains_key(key) {
                    all.values.insert(key, value);
                }
            }
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
        let config = C::from_table(table).map_err(|e| ConfigError::unwritable(&e.to_string()))?;
        config.check(&|key| {
            let origin = all.values.get(key).map(|(value, origin)| format!("{key} = {value} ({origin})"));
            origin.unwrap_or_else(|| key.into())
        })?;
        Ok(config)
    }

    fn table(&mut self, prefix: &str, table: &Table, origin: &str) -> Result<(), ConfigError> {
        table.iter().try_for_each(|(name, value)| self.assign(&format!("{prefix}{name}"), value, origin))
    }

    fn assign(&mut self, name: &str, value: &Value, origin: &str) -> Result<(), ConfigError> {
        let (name, value) = renamed(name, value);
        let value = value.as_ref();
        let section = format!("{name}.");
        let known = self.keys.iter().find(|key| key.name == name).copied();
        match (known, value) {
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
            (None, Value::Table(inner))
                if !inner.is_empty() || self.keys.iter().any(|k| k.name.starts_with(&section)) =>
            {
                self.table(&section, inner, origin)
            }
            _ => Err(ConfigError::UnknownKey {
                origin: origin.into(),
                key: shown(name),
                nearest: keys::nearest(&self.keys, name).into(),
            }),
        }
    }
}

/// A key and a value of an older version as they are now.
fn renamed<'a>(name: &'a str, value: &'a Value) -> (&'a str, Cow<'a, Value>) {
    match (name, value) {
        ("offsets.sh_rest", Value::Boolean(all)) => {
            ("offsets.sh_degree", Cow::Owned(Value::Integer(if *all { MAX_SH_DEGREE.into() } else { 0 })))
        }
        _ => (name, Cow::Borrowed(value)),
    }
}

/// A configuration as TOML with every key, as in `RUN/config.toml`; loading it gives an equal one.
///
/// # Errors
/// A value that TOML cannot hold: a whole number above 2^63 - 1, which loading refuses too.
pub fn to_toml<C: Configuration>(config: &C) -> Result<String, ConfigError> {
    let (table, keys) = (table_of(config)?, C::keys());
    let mut out = "# Resolved configuration. The same run again: instgs-vk train --config FILE\n\n".to_owned();
    let mut sections: Vec<(&str, String)> = Vec::new();
    for key in keys {
        let missing = || ConfigError::unwritable(&format!("{} has no value", key.name));
        let Some((section, name)) = key.name.split_once('.') else {
            out += &format!("{} = {}\n", key.name, table.get(key.name).ok_or_else(missing)?);
            continue;
        };
        let value = table.get(section).and_then(|inner| inner.get(name)).ok_or_else(missing)?;
        let line = format!("{name} = {value}\n");
        match sections.iter_mut().find(|(known, _)| *known == section) {
            Some((_, lines)) => *lines += &line,
            None => sections.push((section, line)),
        }
    }
    out.extend(sections.into_iter().map(|(section, lines)| format!("\n[{section}]\n{lines}")));
    Ok(out)
}

/// Lists the keys whose values differ, each as (key, value in `own`, value in `other`), the values as TOML.
///
/// # Errors
/// The same errors as [`to_toml`].
pub fn differences<C: Configuration>(own: &C, other: &C) -> Result<Vec<(String, String, String)>, ConfigError> {
    let mut out = Vec::new();
    add_differences("", &table_of(own)?, &table_of(other)?, &mut out);
    Ok(out)
}

fn table_of<C: Configuration>(config: &C) -> Result<Table, ConfigError> {
    config.to_table().map_err(|e| ConfigError::unwritable(&e.to_string()))
}

/// Adds the differences of two tables, which have the same keys because they come from the same type.
fn add_differences(prefix: &str, own: &Table, other: &Table, out: &mut Vec<(String, String, String)>) {
    for (key, value) in own {
        let path = format!("{prefix}{key}");
        match (value, other.get(key)) {
            (Value::Table(own), Some(Value::Table(other))) => add_differences(&format!("{path}."), own, other, out),
            (own, Some(other)) if own != other => out.push((path, own.to_string(), other.to_string())),
            _ => (),
        }
    }
}

/// Text of the user as an error shows it: one line, cut to [`VALUE_SHOWN`] characters.
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
