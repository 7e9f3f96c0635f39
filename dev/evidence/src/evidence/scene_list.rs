//! The list of scenes that evidence is gathered from: a TOML file. See `configs/rescene.toml`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::io::read_bytes;
use crate::synth::dataset::RECIPES;

/// Why a list cannot be used; one line.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {what}", path = path.display())]
pub struct ListError {
    path: PathBuf,
    what: String,
}

/// A list of scenes, and the sizes at which it can be run.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneList {
    /// Preset or file of the training configuration, as `--config`.
    pub config: String,
    /// By name.
    pub sizes: BTreeMap<String, Size>,
    /// What is measured.
    pub scenes: Vec<Scene>,
    /// Other settings, trained from the plain clouds of the scenes that ask for them.
    #[serde(default)]
    pub ablations: Vec<AblationSetting>,
}

/// How large pictures and runs are.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// Views of data sets that are made.
    pub views: u32,
    /// Their width and height, pixels.
    pub pixels: [u32; 2],
    /// Settings of all runs, `KEY=VALUE`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Settings of runs on data sets that exist.
    #[serde(default)]
    pub set_real: Vec<String>,
    /// Steps that plain clouds are trained on; without, by the clock, so that figures differ from run to run.
    pub more_steps: Option<u64>,
    /// Timed frames of each scene.
    pub frames: u32,
}

/// A scene, or one for each of several seeds.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Generator to make it with.
    pub synth: Option<String>,
    /// Seeds of the generator: a scene each.
    #[serde(default)]
    pub seeds: Vec<u64>,
    /// Number of objects of the generator.
    pub instances: Option<u32>,
    /// How much of what objects of a kind differ by is shown, 0..=1; 1 if not given.
    pub differences: Option<f64>,
    /// Folder of a data set that exists, from where the list is.
    pub data: Option<PathBuf>,
    /// Known groups instead of found ones: `groups.json` of the data set.
    #[serde(default)]
    pub true_groups: bool,
    /// Why it is measured.
    #[serde(default)]
    pub part: Part,
    /// Settings of this scene, `KEY=VALUE`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Instead of the size's.
    pub more_steps: Option<u64>,
    /// The ablations are run on it (on the first seed).
    #[serde(default)]
    pub ablations: bool,
}

/// Why a scene is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// It counts in the tables of means.
    #[default]
    Scene,
    /// The method's failure case: its objects are not alike.
    Failure,
    /// A point of the plots over the number of instances.
    Scaling,
    /// A point of the plot over how much instances differ.
    Differences,
}

/// A setting to compare with.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AblationSetting {
    /// Table that it belongs to.
    pub table: String,
    /// What it is.
    pub name: String,
    /// Settings, `KEY=VALUE`; none = as the scene itself.
    #[serde(default)]
    pub set: Vec<String>,
}

/// One scene to be run.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneJob {
    /// Of its folder and in tables, for instance `cars_1`.
    pub name: String,
    /// Where its data set is, or how it is made.
    pub source: Source,
    /// Known groups instead of found ones.
    pub true_groups: bool,
    /// Why it is measured.
    pub part: Part,
    /// Settings in their order, `KEY=VALUE`.
    pub set: Vec<String>,
    /// Steps that plain clouds are trained on; `None` = by the clock.
    pub more_steps: Option<u64>,
    /// The ablations are run on it.
    pub ablations: bool,
}

/// Where a data set comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// It is made.
    Synth {
        /// Generator.
        recipe: String,
        /// Seed of the generator.
        seed: u64,
        /// Number of objects; `None` = the generator's own.
        instances: Option<u32>,
        /// How much of their differences is shown, 0..=1.
        differences: f64,
    },
    /// It exists.
    Folder(PathBuf),
}

impl SceneList {
    /// Reads and checks a list.
    ///
    /// # Errors
    /// A file that cannot be read, is not TOML, has unknown keys, or scenes that cannot be.
    pub fn read(path: &Path) -> Result<Self, ListError> {
        let fail = |what: String| ListError { path: path.into(), what };
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
                    let (_, least, most) = recipe.instances;
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
        }
        let jobs = self.jobs(Path::new(""), &Size::nothing());
        let twice = jobs.iter().enumerate().find(|(i, job)| jobs[..*i].iter().any(|other| other.name == job.name));
        twice.map_or(Ok(()), |(_, job)| Err(format!("{} is listed twice", job.name)))
    }

    /// The size of that name.
    ///
    /// # Errors
    /// There is none; one line for the user.
    pub fn size(&self, name: &str) -> Result<&Size, String> {
        self.sizes.get(name).ok_or_else(|| {
            let names: Vec<&str> = self.sizes.keys().map(String::as_str).collect();
            format!("the list has no size {name}; it has {}", names.join(", "))
        })
    }

    /// Every scene by itself; `folder` is where the list is.
    pub fn jobs(&self, folder: &Path, size: &Size) -> Vec<SceneJob> {
        self.scenes.iter().flat_map(|scene| scene.jobs(folder, size)).collect()
    }
}

impl Size {
    fn nothing() -> Self {
        Self { views: 2, pixels: [1, 1], set: Vec::new(), set_real: Vec::new(), more_steps: None, frames: 0 }
    }
}

impl Scene {
    /// True if it has what only a data set that is made can have.
    fn is_made(&self) -> bool {
        self.instances.is_some() || self.differences.is_some() || !self.seeds.is_empty()
    }

    fn jobs(&self, folder: &Path, size: &Size) -> Vec<SceneJob> {
        let job = |name: String, source: Source, ablations: bool, of_size: &[String]| SceneJob {
            name,
            source,
            true_groups: self.true_groups,
            part: self.part,
            set: [&size.set, of_size, &self.set].concat(),
            more_steps: self.more_steps.or(size.more_steps),
            ablations,
        };
        if let Some(data) = &self.data {
            let name = data.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return vec![job(name, Source::Folder(folder.join(data)), self.ablations, &size.set_real)];
        }
        let recipe = self.synth.clone().unwrap_or_default();
        let of_seed = |(i, &seed): (usize, &u64)| {
            let count = self.instances.map_or(String::new(), |k| format!("_of_{k}"));
            let alike = self.differences.map_or(String::new(), |d| format!("_differing_{d}"));
            let differences = self.differences.unwrap_or(1.0);
            let source = Source::Synth { recipe: recipe.clone(), seed, instances: self.instances, differences };
            job(format!("{recipe}{count}{alike}_{seed}"), source, self.ablations && i == 0, &[])
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
set = ["steps=20"]
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
        let jobs = list.jobs(Path::new("at"), list.size("small")?);
        let names: Vec<&str> = jobs.iter().map(|job| job.name.as_str()).collect();
        assert_eq!(names, ["cars_1", "cars_2", "cars_of_4_1", "room"]);
        assert_eq!(jobs.iter().map(|j| j.ablations).collect::<Vec<_>>(), [true, false, false, false]);
        assert_eq!(jobs.iter().map(|j| j.more_steps).collect::<Vec<_>>(), [Some(5), Some(5), Some(7), Some(5)]);
        assert_eq!((&jobs[3].source, jobs[2].part), (&Source::Folder("at/../room".into()), Part::Scaling));
        assert_eq!(jobs[3].set, ["steps=10", "width=64", "steps=20"]);
        assert!(list.size("large").is_err_and(|e| e.contains("small")));
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
        ] {
            let error = read(&LIST.replacen(from, to, 1)).expect_err(from);
            assert!(error.contains(words) && error.lines().count() == 1, "{from}: {error}");
        }
    }

    #[test]
    fn the_repository_s_own_lists_are_whole() -> Test {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
        let list = SceneList::read(&configs.join("rescene.toml"))?;
        let jobs = list.jobs(&configs, list.size("ci")?);
        let counts = |job: &&SceneJob| matches!(job.part, Part::Scene | Part::Failure);
        let counted = jobs.iter().filter(counts).filter(|j| matches!(j.source, Source::Synth { .. }));
        assert_eq!(counted.count(), 20, "the five generators with four seeds");
        let small = SceneList::read(&configs.join("bench/ci.toml"))?;
        assert!(!small.jobs(&configs, small.size("ci")?).is_empty());
        Ok(())
    }
}
