//! Tests of the built-in files, and of a configuration whose two parts are in one file.

use std::collections::BTreeSet;

use super::*;
use instgs_train::config::{Method, keys::KEYS as TRAINER_KEYS};

type Test = Result<(), Box<dyn std::error::Error>>;

/// The dotted keys of a TOML text, in no particular order.
fn keys_of(text: &str) -> Result<BTreeSet<String>, toml::de::Error> {
    let table: Table = text.parse()?;
    let keys = table.into_iter().flat_map(|(name, value)| match value {
        Value::Table(inner) => inner.into_iter().map(|(key, _)| format!("{name}.{key}")).collect(),
        _ => vec![name],
    });
    Ok(keys.collect())
}

#[test]
fn defaults_tables_and_structs_have_the_same_keys() -> Test {
    let names = |keys: &[Key]| keys.iter().map(|key| key.name.to_owned()).collect::<BTreeSet<_>>();
    let (trainer, own) = (names(&TRAINER_KEYS), names(&keys::KEYS));
    assert_eq!((trainer.len(), own.len()), (TRAINER_KEYS.len(), keys::KEYS.len()), "a key is listed twice");
    assert!(trainer.is_disjoint(&own), "a key has two owners");
    assert_eq!(keys_of(PRESETS[0].1)?, trainer);
    // And what is different with templates and instances.
    let methods = ["method", "steps", "rates.final_factor", "densify.recycle"].map(String::from).into();
    assert_eq!(keys_of(PRESETS[1].1)?, &own | &methods);
    assert_eq!(keys_of(&RunConfig::default().to_toml()?)?, &trainer | &own);
    assert_eq!(keys_of(&TrainConfig::default().to_toml()?)?, trainer);
    Ok(())
}

/// Above each key, or above its group of keys, there is a comment.
#[test]
fn every_default_is_explained() {
    for (name, text) in &PRESETS[..2] {
        let mut explained = false;
        for line in text.lines() {
            // A comment above a section explains all of it.
            explained = line.starts_with('#') || explained && !line.is_empty();
            assert!(explained || line.is_empty() || line.starts_with('['), "{name}: no comment above: {line}");
            assert!(line.len() <= 120, "{line}");
        }
    }
}

#[test]
fn presets_and_reports_load_to_the_same_values() -> Test {
    for (name, _) in PRESETS {
        let config = ConfigBuilder::new().file(name)?.finish()?;
        assert_eq!(ConfigBuilder::new().text(&config.to_toml()?, "x")?.finish()?, config, "{name}");
        assert_eq!(serde_json::from_str::<RunConfig>(&serde_json::to_string(&config)?)?, config, "{name}");
    }
    let paper = ConfigBuilder::new().file("paper")?.finish()?.train;
    assert_eq!((paper.steps, paper.densify.start, paper.densify.stop), (30_000, 500, 30_000));
    let quick = ConfigBuilder::new().file("instgs_quick")?.finish()?;
    assert_eq!((quick.train.method, quick.pipeline.template.count_factor), (Method::Instanced, 1.3));
    let missing = ConfigBuilder::new().file("no/such.toml").err().map(|e| e.to_string()).unwrap_or_default();
    assert!(
        missing.contains(
            "preset (default, instgs, quick, paper, mcmc, instgs_quick, instgs_early, instgs_renders, instgs_sparse)"
        ),
        "{missing}"
    );
    Ok(())
}

/// `instgs.toml` has values of the trainer's keys for one method only.
#[test]
fn methods_have_defaults_of_their_own() -> Test {
    let of = |layers: &[&str]| -> Result<_, Box<dyn std::error::Error>> {
        let add = |builder: ConfigBuilder, set: &&str| builder.set(set);
        let config = layers.iter().try_fold(ConfigBuilder::new(), add)?.finish()?.train;
        Ok((config.steps, config.joint.steps, config.densify.recycle))
    };
    assert_eq!(of(&[])?, (30_000, 27_000, 0.0));
    assert_eq!(of(&["method=3dgs"])?, of(&[])?);
    assert_eq!(of(&["method=instgs"])?, (3_000, 27_000, 0.05));
    assert_eq!(of(&["method=instgs", "steps=70", "joint.steps=30"])?, (70, 30, 0.05));
    let default = ConfigBuilder::new().file("default")?.set("method=instgs")?.finish()?;
    assert_eq!((default.train.steps, default.train.rates.final_factor), (3_000, 1.0));
    assert_eq!(ConfigBuilder::new().file("default")?.finish()?, RunConfig::default());
    let preset = ConfigBuilder::new().file("instgs")?.finish()?;
    assert_eq!(preset, ConfigBuilder::new().set("method=instgs")?.finish()?);
    assert_eq!(ConfigBuilder::new().file("instgs_quick")?.finish()?.train.densify.recycle, 0.0);
    // A preset's own value stays if another method is asked for.
    assert_eq!(ConfigBuilder::new().file("instgs_renders")?.set("method=3dgs")?.finish()?.train.densify.recycle, 0.05);
    // As long as 7,000 steps of a plain cloud (docs/results.md).
    let renders = ConfigBuilder::new().file("instgs_renders")?.finish()?.train;
    assert_eq!((renders.steps, renders.joint.steps, renders.joint.max_expanded), (2_000, 4_200, 1.2));
    Ok(())
}

/// Nothing is matched from zero offsets, or without any.
#[test]
fn unmatched_gaussians_need_differences() -> Test {
    let with = |text: &str| ConfigBuilder::new().file("instgs_early")?.text(text, "x")?.finish();
    assert!(with("").is_ok());
    let zero = with("[offsets]\ninit = \"zero\"").err().map(|e| e.to_string()).unwrap_or_default();
    assert!(zero.contains("template.unmatched") && zero.contains("offsets.init"), "{zero}");
    let none = "[offsets]\nposition = false\nsh_dc = false\nopacity = false\ncovariance = false";
    assert!(with(none).is_err());
    Ok(())
}

/// An empty string in a file of this version or an older one is `None`.
#[test]
fn an_empty_text_is_none() -> Test {
    let config = ConfigBuilder::new().text("masks = \"\"\nboxes = \"a/b.json\"\ninit_scene = \"\"", "x")?.finish()?;
    assert_eq!((&config.pipeline.masks, &config.train.init_scene), (&None, &None));
    assert_eq!(config.pipeline.boxes.as_deref(), Some("a/b.json".as_ref()));
    assert!(config.to_toml()?.contains("masks = \"\"\nboxes = \"a/b.json\"\n"));
    Ok(())
}

#[test]
fn differences_have_both_values() -> Test {
    let config = RunConfig::default();
    assert!(config.differences(&config.clone())?.is_empty());
    let mut other = config.clone();
    other.train.steps = 7;
    other.train.joint.refine_poses = !config.train.joint.refine_poses;
    other.pipeline.joint.prune_weight = 0.5;
    let want = [
        ("steps", config.train.steps.to_string(), "7".to_owned()),
        ("joint.refine_poses", "true".to_owned(), "false".to_owned()),
        ("joint.prune_weight", format!("{:?}", config.pipeline.joint.prune_weight), "0.5".to_owned()),
    ];
    let mut found = config.differences(&other)?;
    found.sort_by_key(|(key, ..)| std::cmp::Reverse(key.clone()));
    assert_eq!(found, want.map(|(key, own, other)| (key.to_owned(), own, other)));
    Ok(())
}
