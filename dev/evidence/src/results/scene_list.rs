//! The list of scenes for the evidence: a TOML file like `configs/rescene.toml`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use instgs_io::read_bytes;
use instgs_synth::dataset::{ObjectCount, RECIPES};

/// Why a list cannot be used; one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum ListError {
    /// The list's file cannot be read, or what it says cannot be run.
    #[error("{path}: {what}", path = path.display())]
    File {
        /// Path of the list.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The list has no size with this name.
    #[error("the list has no size {name}; it has {}", sizes.join(", "))]
    Size {
        /// The name that was asked for.
        name: String,
        /// The names of the list's sizes.
        sizes: Vec<String>,
    },
}

/// A list of scenes, with the sizes at which it can be run.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneList {
    /// Preset or file of the training configuration, as for `--config`.
    pub config: String,
    /// Sizes of a run, by name.
    pub sizes: BTreeMap<String, Size>,
    /// Scenes to measure, in order.
    pub scenes: Vec<Scene>,
    /// Ablations: settings that are trained from the plain clouds of the scenes that ask for them.
    #[serde(default)]
    pub ablations: Vec<AblationSetting>,
}

/// Size of pictures and length of runs.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// Number of views of generated data sets.
    pub views: u32,
    /// Width and height of their photos, pixels.
    pub pixels: [u32; 2],
    /// Settings of all runs, `KEY=VALUE`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Settings of runs on existing data sets, `KEY=VALUE`.
    #[serde(default)]
    pub set_real: Vec<String>,
    /// Steps that plain clouds are trained on; `None` = by wall time, so that figures vary from run to run.
    pub more_steps: Option<u64>,
    /// Number of timed frames of each scene.
    pub frames: u32,
}

/// A scene, or several that differ in their seed.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name of the generator, for a generated data set.
    pub synth: Option<String>,
    /// Seeds of the generator: one scene each.
    #[serde(default)]
    pub seeds: Vec<u64>,
    /// Number of objects, for a generated data set.
    pub instances: Option<u32>,
    /// Part of the differences between objects of a kind that is shown, 0..=1; 1 by default.
    pub differences: Option<f64>,
    /// Folder of an existing data set, relative to the list.
    pub data: Option<PathBuf>,
    /// Whether groups are read from the data set's `groups.json` instead of being found.
    #[serde(default)]
    pub true_groups: bool,
    /// Purpose of the measurement.
    #[serde(default)]
    pub part: Part,
    /// Settings of this scene at every size, `KEY=VALUE`: none that goes with the length of runs or the size of pictures.
    #[serde(default)]
    pub set: Vec<String>,
    /// Replaces `more_steps` of every size.
    pub more_steps: Option<u64>,
    /// What holds at one size alone, by its name.
    #[serde(default)]
    pub sizes: BTreeMap<String, SceneAtSize>,
    /// Whether the ablations are run on it, for the first seed.
    #[serde(default)]
    pub ablations: bool,
}

/// What a scene replaces at one size.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneAtSize {
    /// Settings, `KEY=VALUE`; they win over those of the scene and of the size.
    #[serde(default)]
    pub set: Vec<String>,
    /// Replaces `more_steps` of the scene and of the size.
    pub more_steps: Option<u64>,
}

/// Purpose of a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Counts in the tables of means.
    #[default]
    Scene,
    /// The method's failure case: the objects are not alike.
    Failure,
    /// A point of the plots over the number of instances.
    Scaling,
    /// A point of the plot over the differences between instances.
    Differences,
}

/// A setting to compare with the scene's own.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AblationSetting {
    /// Key of the table that it belongs to.
    pub table: String,
    /// Name of the setting.
    pub name: String,
    /// Settings, `KEY=VALUE`; none = those of the scene itself.
    #[serde(default)]
    pub set: Vec<String>,
}

/// One scene to run, with its settings.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneJob {
    /// Name of its folder and in tables, for instance `cars_1`.
    pub name: String,
    /// Source of its data set.
    pub source: Source,
    /// Whether groups are read from the data set instead of being found.
    pub true_groups: bool,
    /// Purpose of the measurement.
    pub part: Part,
    /// Settings in order, `KEY=VALUE`.
    pub set: Vec<String>,
    /// Steps that plain clouds are trained on; `None` = by wall time.
    pub more_steps: Option<u64>,
    /// Whether the ablations are run on it.
    pub ablations: bool,
}

/// Source of a data set.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// It is generated by `synth`.
    Synth {
        /// Name of the generator.
        recipe: String,
        /// Seed of the generator.
        seed: u64,
        /// Number of objects; `None` = the generator's default.
        instances: Option<u32>,
        /// Part of the differences that is shown, 0..=1.
        differences: f64,
    },
    /// An existing data set in this folder.
    Folder(PathBuf),
}

impl SceneList {
    /// Reads and checks a list.
    ///
    /// # Errors
    /// A file that cannot be read, is not TOML or has unknown keys; impossible scenes; scenes with the same name.
    pub fn read(path: &Path) -> Result<Self, ListError> {
        let fail = |what: String| ListError::File { path: path.into(), what };
        let bytes = read_bytes(path).map_err(|e| fail(format!("cannot be read: {e}")))?;
        let text = String::from_utf8(bytes).map_err(|_| fail("is not UTF-8 text".into()))?;
        let list: Self = toml::from_str(&text).map_err(|e| {
            let line = e.span().and_then(|s| text.get(..s.start)).map_or(1, |t| 1 + t.matches('\n').count());
            fail(format!("line {line}: {}", e.message().lines().collect::<Vec<_>>().join(" ")))
        })?;
        list.check().map_err(fail)?;
        Ok(list)
    }

    fn check(&self) -> Result<(), String> {
        for (i, scene) in self.scenes.iter().enumerate() {
            let at = |what: String| Err(format!("scene {}: {what}", i + 1));
            match (&scene.synth, &scene.data) {
                (Some(name), None) => {
                    let Some(recipe) = RECIPES.iter().find(|r| r.name == *name) else {
                        let names: Vec<&str> = RECIPES.iter().map(|r| r.name).collect();
                        return at(format!("there is no generator {name}; there are {}", names.join(", ")));
                    };
                    let ObjectCount { least, most, .. } = recipe.instances;
                    if let Some(k) = scene.instances.filter(|k| !(least..=most).contains(k)) {
                        return at(format!("{name} makes {least} to {most} objects, not {k}"));
                    }
                    if let Some(d) = scene.differences.filter(|d| !(0.0..=1.0).contains(d)) {
                        return at(format!("differences are 0 to 1, not {d}"));
                    }
                    if scene.seeds.is_empty() {
                        return at("needs seeds, for instance seeds = [1]".into());
                    }
                }
                (None, Some(_)) if scene.is_made() => {
                    return at("instances, differences and seeds are for synth, not for data".into());
                }
                (None, Some(data)) if data.file_name().is_none() => return at("data names no folder".into()),
                (None, Some(_)) => {}
                _ => return at("needs either synth or data".into()),
            }
            if let Some(name) = scene.sizes.keys().find(|name| !self.sizes.contains_key(*name)) {
                let names: Vec<&str> = self.sizes.keys().map(String::as_str).collect();
                return at(format!("sizes: the list has no size {name}; it has {}", names.join(", ")));
            }
        }
        // Names are the same at every size.
        let jobs: Vec<SceneJob> = self.scenes.iter().flat_map(|s| s.jobs(Path::new(""), &AtSize::nothing())).collect();
        let twice = jobs.iter().enumerate().find(|(i, job)| jobs[..*i].iter().any(|other| other.name == job.name));
        twice.map_or(Ok(()), |(_, job)| Err(format!("{} is listed twice", job.name)))
    }

    /// The size with the given name.
    ///
    /// # Errors
    /// The list has none of this name.
    pub fn size(&self, name: &str) -> Result<&Size, ListError> {
        let missing = || ListError::Size { name: name.into(), sizes: self.sizes.keys().cloned().collect() };
        self.sizes.get(name).ok_or_else(missing)
    }

    /// All scenes as single jobs at the size with the given name; `folder` is that of the list.
    ///
    /// # Errors
    /// The list has no size of this name.
    pub fn jobs(&self, folder: &Path, size: &str) -> Result<Vec<SceneJob>, ListError> {
        let at = AtSize { name: size, size: Some(self.size(size)?) };
        Ok(self.scenes.iter().flat_map(|scene| scene.jobs(folder, &at)).collect())
    }
}

/// A size with its name.
struct AtSize<'a> {
    name: &'a str,
    /// `None` = nothing but the scene's own settings.
    size: Option<&'a Size>,
}

impl AtSize<'_> {
    fn nothing() -> Self {
        Self { name: "", size: None }
    }
}

impl Scene {
    /// Whether it has keys that are only allowed for generated data sets.
    fn is_made(&self) -> bool {
        self.instances.is_some() || self.differences.is_some() || !self.seeds.is_empty()
    }

    fn jobs(&self, folder: &Path, at: &AtSize<'_>) -> Vec<SceneJob> {
        let own = self.sizes.get(at.name).cloned().unwrap_or_default();
        let of_size = |of: fn(&Size) -> &Vec<String>| at.size.map_or(&[][..], |size| of(size));
        let of_real = if self.data.is_some() { of_size(|size| &size.set_real) } else { &[] };
        let job = |name: String, source: Source, ablations: bool| SceneJob {
            name,
            source,
            true_groups: self.true_groups,
            part: self.part,
            set: [of_size(|size| &size.set), of_real, &self.set, &own.set].concat(),
            more_steps: own.more_steps.or(self.more_steps).or(at.size.and_then(|size| size.more_steps)),
            ablations,
        };
        if let Some(data) = &self.data {
            let name = data.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return vec![job(name, Source::Folder(folder.join(data)), self.ablations)];
        }
        let recipe = self.synth.clone().unwrap_or_default();
        let of_seed = |(i, &seed): (usize, &u64)| {
            let count = self.instances.map_or(String::new(), |k| format!("_of_{k}"));
            let alike = self.differences.map_or(String::new(), |d| format!("_differing_{d}"));
            let differences = self.differences.unwrap_or(1.0);
            let source = Source::Synth { recipe: recipe.clone(), seed, instances: self.instances, differences };
            job(format!("{recipe}{count}{alike}_{seed}"), source, self.ablations && i == 0)
        };
        self.seeds.iter().enumerate().map(of_seed).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Test = Result<(), Box<dyn std::error::Error>>;

    const LIST: &str = r#"
config = "instgs_quick"
[sizes.small]
views = 8
pixels = [64, 36]
set = ["steps=10"]
set_real = ["width=64"]
more_steps = 5
frames = 3
[sizes.long]
views = 9
pixels = [64, 36]
set = ["steps=900"]
frames = 3
[[scenes]]
synth = "cars"
seeds = [1, 2]
ablations = true
[[scenes]]
synth = "cars"
seeds = [1]
instances = 4
part = "scaling"
more_steps = 7
[[scenes]]
data = "../room"
set = ["template.count_factor=2"]
[scenes.sizes.small]
set = ["steps=20"]
more_steps = 6
[[ablations]]
table = "offsets"
name = "none"
"#;

    fn read(text: &str) -> Result<SceneList, String> {
        let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
        let path = folder.path().join("list.toml");
        std::fs::write(&path, text).map_err(|e| e.to_string())?;
        SceneList::read(&path).map_err(|e| e.to_string())
    }

    #[test]
    fn a_list_becomes_jobs() -> Test {
        let list = read(LIST)?;
        let jobs = list.jobs(Path::new("at"), "small")?;
        let names: Vec<&str> = jobs.iter().map(|job| job.name.as_str()).collect();
        assert_eq!(names, ["cars_1", "cars_2", "cars_of_4_1", "room"]);
        assert_eq!(jobs.iter().map(|j| j.ablations).collect::<Vec<_>>(), [true, false, false, false]);
        assert_eq!(jobs.iter().map(|j| j.more_steps).collect::<Vec<_>>(), [Some(5), Some(5), Some(7), Some(6)]);
        assert_eq!((&jobs[3].source, jobs[2].part), (&Source::Folder("at/../room".into()), Part::Scaling));
        assert_eq!(jobs[3].set, ["steps=10", "width=64", "template.count_factor=2", "steps=20"]);
        let missing = "the list has no size large; it has long, small";
        assert!(list.jobs(Path::new("at"), "large").is_err_and(|e| e.to_string() == missing));
        // What a scene says of one size does not hold at another.
        let long = list.jobs(Path::new("at"), "long")?;
        assert_eq!(long[3].set, ["steps=900", "template.count_factor=2"]);
        assert_eq!(long.iter().map(|j| j.more_steps).collect::<Vec<_>>(), [None, None, Some(7), None]);
        Ok(())
    }

    #[test]
    fn what_cannot_be_is_refused_in_one_line() {
        for (from, to, words) in [
            ("\"cars\"", "\"boats\"", "no generator boats"),
            ("instances = 4", "instances = 4000", "4000"),
            ("instances = 4", "differences = 1.5", "differences are 0 to 1"),
            ("seeds = [1, 2]", "", "needs seeds"),
            ("seeds = [1, 2]", "seeds = [1, 1]", "cars_1 is listed twice"),
            ("data = \"../room\"", "data = \"../room\"\nsynth = \"cars\"", "either synth or data"),
            ("data = \"../room\"", "data = \"../room\"\nseeds = [1]", "for synth"),
            ("data = \"../room\"", "data = \"..\"", "no folder"),
            ("frames = 3", "frame = 3", "line 9"),
            ("[scenes.sizes.small]", "[scenes.sizes.large]", "no size large; it has long, small"),
            ("more_steps = 6", "views = 6", "line 30"),
        ] {
            let error = read(&LIST.replacen(from, to, 1)).expect_err(from);
            assert!(error.contains(words) && error.lines().count() == 1, "{from}: {error}");
        }
    }

    #[test]
    fn the_repository_s_own_lists_are_whole() -> Test {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let list = SceneList::read(&configs.join("rescene.toml"))?;
        let jobs = list.jobs(&configs, "ci")?;
        let counts = |job: &&SceneJob| matches!(job.part, Part::Scene | Part::Failure);
        let counted = jobs.iter().filter(counts).filter(|j| matches!(j.source, Source::Synth { .. }));
        assert_eq!(counted.count(), 20, "the five generators with four seeds");
        // No scene is shorter or smaller at the lengths of the papers than the size says.
        let size = list.size("paper")?;
        let of_size = |key: &str| {
            let mut all = size.set.iter().chain(&size.set_real);
            all.rfind(|set| set.starts_with(key)).cloned()
        };
        for job in list.jobs(&configs, "paper")? {
            assert_eq!(job.more_steps, None, "{}", job.name);
            for key in ["steps=", "joint.steps=", "max_gaussians=", "width="] {
                let last = job.set.iter().rfind(|set| set.starts_with(key));
                assert!(last.is_none() || last == of_size(key).as_ref(), "{}: {last:?}", job.name);
            }
        }
        // The headline: the rivals are trained 5,000 steps more than the start, which the preset says.
        let headline = SceneList::read(&configs.join("results.toml"))?;
        for (size, max_expanded) in [("long", None), ("same_cap", Some("joint.max_expanded=1"))] {
            let jobs = headline.jobs(&configs, size)?;
            assert_eq!(jobs.len(), 8);
            for job in jobs {
                assert_eq!(job.more_steps, Some(5000), "{}", job.name);
                assert!(job.set.iter().any(|set| set == "max_gaussians=40000"), "{}", job.name);
                let set = job.set.iter().find(|set| set.starts_with("joint.max_expanded"));
                assert_eq!(set.map(String::as_str), max_expanded, "{}", job.name);
            }
        }
        let small = SceneList::read(&configs.join("bench/ci.toml"))?;
        assert!(!small.jobs(&configs, "ci")?.is_empty());
        Ok(())
    }
}
