//! Tests of the layers, the error messages and the built-in files.

use super::*;
use crate::config::{Background, ConfigBuilder, Growth, Init, Method, PRESETS, Strategy, TrainConfig};
use instgs_vk::math::halves::Halves;

type Test = Result<(), Box<dyn std::error::Error>>;

/// The error's text; empty if the result is no error.
fn text_of<T>(result: Result<T, ConfigError>) -> String {
    result.err().map(|e| e.to_string()).unwrap_or_default()
}

#[test]
fn defaults_are_those_of_3dgs() {
    let c = TrainConfig::default();
    assert_eq!((c.steps, c.seed, c.width, c.sh_degree, c.sh_every), (30_000, 0, 0, 3, 1000));
    assert_eq!((c.method, c.init, c.background), (Method::Gaussians, Init::Points, Background::Black));
    assert_eq!((c.strategy, c.antialias, c.max_gaussians), (Strategy::Densify, false, 3_000_000));
    assert_eq!((c.init_opacity, c.init_scale, c.init_scene), (0.1, 1.0, None));
    assert_eq!((c.lambda_dssim, c.near, c.checkpoint_every), (0.2, 0.2, 5000));
    assert_eq!((c.rates.means, c.rates.means_final, c.rates.sh_dc), (1.6e-4, 1.6e-6, 2.5e-3));
    assert_eq!((c.rates.sh_rest, c.rates.opacity, c.rates.eps), (1.25e-4, 0.025, 1e-15));
    assert_eq!((c.densify.start, c.densify.stop, c.densify.every), (500, 15_000, 100));
    assert_eq!((c.densify.gradient_threshold, c.densify.split_fraction), (2e-4, 0.01));
    assert_eq!((c.densify.growth, c.densify.halves()), (Growth::Halves, Halves { shrink: 1.6, opacity: 0.6 }));
    assert_eq!(c.densify.halves(), Halves::default());
    assert_eq!((c.densify.screen_size_max_px, c.densify.world_size_max), (0.0, 0.1));
    assert_eq!((c.mcmc.growth, c.mcmc.noise, c.mcmc.stop), (1.05, 5e5, 25_000));
    assert_eq!((c.densify.stop_fraction, c.mcmc.stop_fraction), (1.0, 1.0));
}

#[test]
fn runs_of_older_versions_go_on_as_they_began() -> Test {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("config.toml");
    std::fs::write(&path, "[rates]\nfinal_factor = 0.5\n")?;
    let older = ConfigBuilder::new().run_file(&path)?;
    let resumed = older.clone().finish()?;
    assert_eq!((resumed.densify.growth, resumed.rates.decay_steps), (Growth::CloneOrSplit, 0));
    assert_eq!((resumed.joint.decay_steps, resumed.joint.decay_start), (0, 0.0));
    // The joint phase did not grow, and instances had nothing but offsets.
    assert_eq!(
        (resumed.joint.grow_fraction, resumed.joint.own_share, resumed.joint.color_matrix_rate),
        (0.0, 0.0, 0.0)
    );
    assert_eq!(resumed.densify.recycle, 0.0);
    assert_eq!(resumed.rates.final_factor, 0.5);
    assert_eq!(older.set("densify.growth=halves")?.finish()?.densify.growth, Growth::Halves);
    for (before, degree) in [("true", 3), ("false", 0)] {
        std::fs::write(&path, format!("[offsets]\nsh_rest = {before}\n"))?;
        assert_eq!(ConfigBuilder::new().run_file(&path)?.finish()?.offsets.sh_degree, degree);
    }
    std::fs::write(&path, TrainConfig::default().to_toml()?)?;
    assert_eq!(ConfigBuilder::new().run_file(&path)?.finish()?, TrainConfig::default());
    Ok(())
}

/// Above other layers, as where a run goes on with `--config default`.
#[test]
fn the_defaults_take_back_what_is_below_them() -> Test {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("config.toml");
    std::fs::write(&path, "method = \"instgs\"\nsteps = 10\n[joint]\nsteps = 20\n")?;
    let resumed = ConfigBuilder::new().run_file(&path)?.file("default")?.set("seed=5")?.finish()?;
    let fresh = ConfigBuilder::new().set("method=instgs")?.set("seed=5")?.finish()?;
    assert_eq!(resumed, fresh);
    assert_eq!(ConfigBuilder::new().file("quick")?.file("default")?.finish()?, TrainConfig::default());
    Ok(())
}

#[test]
fn presets_load_and_say_what_they_are() -> Test {
    for (name, _) in PRESETS {
        let config = ConfigBuilder::new().file(name)?.finish()?;
        assert_eq!(ConfigBuilder::new().text(&config.to_toml()?, "x")?.finish()?, config, "{name}");
    }
    let mcmc = ConfigBuilder::new().file("mcmc")?.finish()?;
    assert_eq!((mcmc.strategy, mcmc.init_opacity, mcmc.init_scale), (Strategy::Mcmc, 0.5, 0.1));
    let quick = ConfigBuilder::new().file("quick")?.finish()?;
    assert!(quick.steps <= 2000);
    assert_eq!((quick.densify.stop_fraction, quick.rates.log_scales), (0.7, 1e-2));
    Ok(())
}

#[test]
fn what_is_written_loads_to_the_same_values() -> Test {
    let sets = ["rates.means=0.1", "rates.eps=1.2345678901234567e-15", "seed=9223372036854775807", "near=1e-3"];
    let mut builder = ConfigBuilder::new();
    for set in sets.iter().chain(&[
        "init_scene=a \"b\" \\ \u{e4}.ply",
        "init=random",
        "antialias=true",
        "background=\"white\"",
        "mcmc.noise = 3",
    ]) {
        builder = builder.set(set)?;
    }
    let config = builder.finish()?;
    assert_ne!(config, TrainConfig::default());
    assert_eq!(ConfigBuilder::new().text(&config.to_toml()?, "x")?.finish()?, config);
    Ok(())
}

#[test]
fn later_layers_win_and_the_rest_stays() -> Test {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("my.toml");
    std::fs::write(&path, "steps = 10\nwidth = 20\nrates.quats = 0.5\n[densify]\nevery = 7\n")?;
    let config = ConfigBuilder::new()
        .file(&path.display().to_string())?
        .set("width=30")?
        .set("rates = { sh_dc = 0.25 }")?
        .flag("--steps", "steps", 40)?
        .finish()?;
    assert_eq!((config.steps, config.width, config.densify.every), (40, 30, 7));
    assert_eq!((config.rates.quats, config.rates.sh_dc, config.rates.means), (0.5, 0.25, 1.6e-4));
    Ok(())
}

#[test]
fn unknown_keys_name_the_nearest() {
    for (set, want) in [
        ("step=5", "--set: unknown key step; did you mean steps?"),
        ("opacity=5", "--set: unknown key opacity; did you mean rates.opacity?"),
        ("rates=5", "--set: unknown key rates; did you mean rates.means?"),
        ("rates.means.x=5", "--set: unknown key rates.means.x; did you mean rates.means?"),
        ("=5", "--set: unknown key ; did you mean seed?"),
    ] {
        assert_eq!(text_of(ConfigBuilder::new().set(set)), want);
    }
    let file = text_of(ConfigBuilder::new().text("[densify]\nevrey = 3", "my.toml"));
    assert_eq!(file, "my.toml: unknown key densify.evrey; did you mean densify.every?");
    let section = text_of(ConfigBuilder::new().text("[rate]\nmeans = 3", "my.toml"));
    assert_eq!(section, "my.toml: unknown key rate.means; did you mean rates.means?");
    assert!(text_of(ConfigBuilder::new().text("[rate]", "my.toml")).contains("unknown key rate;"));
    assert_eq!(text_of(ConfigBuilder::new().text("[rates]", "my.toml")), "");
}

#[test]
fn bad_values_name_key_value_range_and_origin() {
    for (set, want) in [
        ("steps=0", "--set: steps = 0: must be a whole number from 1 to 100000000"),
        ("steps=ten", "--set: steps = \"ten\": must be a whole number from 1 to 100000000"),
        ("steps=-3", "--set: steps = -3: must be a whole number from 1 to 100000000"),
        ("steps=", "--set: steps = \"\": must be a whole number from 1 to 100000000"),
        ("lambda_dssim=1.5", "--set: lambda_dssim = 1.5: must be a number from 0.0 to 1.0"),
        ("near=nan", "--set: near = nan: must be a number above 0.0, at most 1000000.0"),
        ("antialias=1", "--set: antialias = 1: must be true or false"),
        ("init=sfm", "--set: init = \"sfm\": must be one of \"points\", \"random\""),
        ("method=inst", "--set: method = \"inst\": must be one of \"3dgs\", \"instgs\""),
        ("rates.beta1=1", "--set: rates.beta1 = 1: must be a number from 0.0, below 1.0"),
        ("init_opacity=1", "--set: init_opacity = 1: must be a number above 0.0, below 1.0"),
        ("init_scale=0", "--set: init_scale = 0: must be a number above 0.0, at most 1000.0"),
        ("init_scene=3", "--set: init_scene = 3: must be a text"),
        ("densify.stop_fraction=0", "--set: densify.stop_fraction = 0: must be a number above 0.0, at most 1.0"),
    ] {
        assert_eq!(text_of(ConfigBuilder::new().set(set)), want);
    }
    let flag = text_of(ConfigBuilder::new().flag("--width", "width", 100_000));
    assert_eq!(flag, "--width: width = 100000: must be a whole number from 0 to 65536");
    let file = text_of(ConfigBuilder::new().text("sh_degree = 4", "a/my.toml"));
    assert_eq!(file, "a/my.toml: sh_degree = 4: must be a whole number from 0 to 3");
    let long = text_of(ConfigBuilder::new().set(&format!("steps=\"{}\n{}\"", "ä".repeat(50), "b".repeat(500))));
    assert!(long.contains("...: must be") && long.chars().count() < 150 && !long.contains('\n'), "{long}");
}

#[test]
fn syntax_errors_are_one_line_with_the_line() {
    let file = text_of(ConfigBuilder::new().text("steps = 5\n\nwidth = = 3\n", "my.toml"));
    assert!(file.starts_with("my.toml: line 3: ") && !file.contains('\n'), "{file}");
    let twice = text_of(ConfigBuilder::new().text("steps = 5\nsteps = 6\n", "my.toml"));
    assert!(twice.starts_with("my.toml: line 2: "), "{twice}");
    assert!(text_of(ConfigBuilder::new().set("steps")).contains("no \"=\""));
    // A line break must not bring in a second key.
    assert!(text_of(ConfigBuilder::new().set("steps=5\nwidth=6")).contains("steps = "));
    let missing = text_of(ConfigBuilder::new().file("no/such.toml"));
    assert!(missing.contains("no/such.toml") && missing.contains("preset (default, quick, mcmc)"), "{missing}");
}

#[test]
fn values_that_do_not_go_together_are_refused() -> Test {
    let text = text_of(ConfigBuilder::new().set("densify.start=20000")?.finish());
    assert_eq!(text, "densify.start = 20000 (--set) must be at most densify.stop = 15000 (preset default)");
    assert!(!text_of(ConfigBuilder::new().set("mcmc.stop=1")?.finish()).is_empty());
    assert!(
        !text_of(
            ConfigBuilder::new().set("densify.opacity_reset_every=9")?.set("densify.opacity_reset_to=0.005")?.finish()
        )
        .is_empty()
    );
    // The rates of templates are of no use to a plain cloud.
    let recycling =
        |method: &str| ConfigBuilder::new().set("densify.recycle=0.1")?.set("template_rates.opacity=0")?.set(method);
    recycling("method=3dgs")?.finish()?;
    let text = text_of(recycling("method=instgs")?.finish());
    assert!(text.starts_with("template_rates.opacity = 0.0 (--set) must be above 0 with densify.recycle"), "{text}");
    ConfigBuilder::new().set("densify.opacity_reset_to=0.005")?.set("densify.opacity_reset_every=0")?.finish()?;
    assert!(!text_of(ConfigBuilder::new().set("init=random")?.set("max_gaussians=9")?.finish()).is_empty());
    ConfigBuilder::new().set("max_gaussians=9")?.finish()?;
    Ok(())
}
