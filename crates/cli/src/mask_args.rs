//! The source of the masks, as flags of the commands that train.

use std::path::PathBuf;

use clap::Args;

use instgs_console::CliError;
use instgs_console::args::absolute;
use instgs_objects::pipeline::config::ConfigBuilder;

/// At most one of a folder, boxes and words may be given.
#[derive(Args)]
pub struct MaskArgs {
    /// Masks: a folder with a PNG of object ids per image, or other programs' masks (COCO, labelme, a PNG per object),
    /// see docs/masks.md [default: DATA/masks]; for instgs
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// boxes.json: boxes around objects, in the world or in photos of training views, to make masks from; for instgs
    #[arg(long, value_name = "JSON", conflicts_with_all = ["masks", "prompt"])]
    boxes: Option<PathBuf>,
    /// What to detect in the photos to make masks from, for instance "car. chair."; for instgs
    #[arg(long, value_name = "TEXT", conflicts_with = "masks")]
    prompt: Option<String>,
    /// Folder of the models that --prompt needs; see tools/models
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
}

impl MaskArgs {
    /// The flags, each with whether it was given.
    pub fn given(&self) -> impl Iterator<Item = (&'static str, bool)> {
        [
            ("--masks", self.masks.is_some()),
            ("--boxes", self.boxes.is_some()),
            ("--prompt", self.prompt.is_some()),
            ("--models", self.models.is_some()),
        ]
        .into_iter()
    }

    /// True if `--models` was given.
    pub fn has_models(&self) -> bool {
        self.models.is_some()
    }

    /// Adds the given flags to a configuration.
    pub fn put_into(&self, mut builder: ConfigBuilder) -> Result<ConfigBuilder, CliError> {
        if let Some(prompt) = &self.prompt {
            builder = builder.flag("--prompt", "prompt", prompt.as_str())?;
        }
        let paths = [
            ("--masks", "masks", &self.masks),
            ("--boxes", "boxes", &self.boxes),
            ("--models", "models", &self.models),
        ];
        for (flag, key, path) in paths {
            if let Some(path) = path {
                builder = builder.flag(flag, key, absolute(flag, path)?)?;
            }
        }
        Ok(builder)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        masks: MaskArgs,
    }

    #[test]
    fn flags_become_values_and_exclude_each_other() -> Result<(), Box<dyn std::error::Error>> {
        let parse = |words: &str| Line::try_parse_from(format!("x {words}").split_whitespace());
        for (words, want) in [
            ("", [None, None, None, None]),
            ("--masks /m", [Some("/m"), None, None, None]),
            ("--boxes /b.json", [None, Some("/b.json"), None, None]),
            ("--prompt car. --models /n", [None, None, Some("car."), Some("/n")]),
        ] {
            let config = parse(words)?.masks.put_into(ConfigBuilder::new())?.finish()?.pipeline;
            let [masks, boxes, models] =
                [&config.masks, &config.boxes, &config.models].map(|path| path.as_deref().and_then(Path::to_str));
            assert_eq!([masks, boxes, config.prompt.as_deref(), models], want, "{words}");
        }
        for both in ["--boxes b --masks m", "--boxes b --prompt car.", "--masks m --prompt car."] {
            assert!(parse(both).is_err(), "{both}");
        }
        Ok(())
    }
}
