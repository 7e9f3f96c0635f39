//! Files of a run folder, configurations, and scripts of the player.

use std::fs;
use std::path::Path;

use instgs_eval::lpips::{InputRange, Lpips, Net};
use instgs_io::checkpoint::Values;
use instgs_io::{Checkpoint, checkpoint, read_exposures, write_exposures};
use instgs_objects::pipeline::config::RunConfig;
use instgs_player::script;
use instgs_train::config::{Layers, to_toml};
use instgs_train::event_log::{EventLog, read_events};

use crate::seeds::runs as files;
use crate::{Seed, SeedError, Target, must, path, repair, taken};

pub(super) const TARGETS: &[Target] = &[
    Target { name: "checkpoint", seeds: checkpoint_seeds, repair: Some(repair::checkpoint), read: read_checkpoint },
    Target { name: "events", seeds: event_seeds, repair: None, read: read_log },
    Target { name: "exposures", seeds: exposure_seeds, repair: None, read: read_all_exposures },
    Target { name: "config", seeds: config_seeds, repair: None, read: read_config },
    Target { name: "settings", seeds: setting_seeds, repair: None, read: read_settings },
    Target { name: "script", seeds: script_seeds, repair: None, read: read_script },
    Target { name: "weights", seeds: weight_seeds, repair: Some(repair::safetensors), read: read_weights },
];

fn checkpoint_seeds() -> Result<Vec<Seed>, SeedError> {
    let folder = tempfile::tempdir()?;
    Ok(vec![Seed::new("three types", files::checkpoint(folder.path())?)])
}

fn read_checkpoint(bytes: &[u8], folder: &Path) -> bool {
    let Some(found) = taken(checkpoint::parse(bytes, path())) else { return false };
    for name in found.tensors.keys() {
        taken(found.clone().take::<f32>(name, &[3], path()));
    }
    let file = folder.join("x.safetensors");
    must(found.write(&file), "a checkpoint that was read is not written");
    let again = must(Checkpoint::read(&file), "a checkpoint that was written is not read");
    let shapes = |of: &Checkpoint| of.tensors.iter().map(|(n, t)| (n.clone(), t.shape.clone())).collect::<Vec<_>>();
    let bits = |of: &Checkpoint| {
        let of_tensor = |values: &Values| -> Vec<u64> {
            match values {
                Values::F32(values) => values.iter().map(|v| u64::from(v.to_bits())).collect(),
                Values::U32(values) => values.iter().map(|v| u64::from(*v)).collect(),
                Values::U64(values) => values.clone(),
            }
        };
        of.tensors.values().flat_map(|tensor| of_tensor(&tensor.values)).collect::<Vec<_>>()
    };
    assert!((again.step, &again.metadata) == (found.step, &found.metadata), "a checkpoint does not come back");
    assert!(
        shapes(&again) == shapes(&found) && bits(&again) == bits(&found),
        "its tensors do not come back bit by bit"
    );
    true
}

fn event_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("a run", files::EVENTS)])
}

/// Read as a report does, then resumed, after which every line is an event.
fn read_log(bytes: &[u8], folder: &Path) -> bool {
    let file = folder.join("events.jsonl");
    must(fs::write(&file, bytes), "the scratch folder");
    let all = taken(read_events(&file)).is_some();
    let resumed = taken(EventLog::resume(&file, 18, &mut |events| events.iter().map(|e| e.step() <= 18).collect()));
    if let Some((_, kept)) = resumed {
        let left = must(read_events(&file), "a resumed log is not read");
        assert_eq!(left.len(), kept.events.len());
    }
    all
}

fn exposure_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("two", files::EXPOSURES)])
}

fn read_all_exposures(bytes: &[u8], folder: &Path) -> bool {
    let (given, again) = (folder.join("exposures.json"), folder.join("again.json"));
    must(fs::write(&given, bytes), "the scratch folder");
    let Some(exposures) = taken(read_exposures(&given)) else { return false };
    must(write_exposures(&again, &exposures), "exposures that were read are not written");
    assert!(must(read_exposures(&again), "exposures that were written are not read") == exposures);
    true
}

fn config_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("all keys", files::config()?), Seed::new("short", files::SHORT_CONFIG)])
}

fn read_config(bytes: &[u8], _: &Path) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let read = |text: &str| Layers::<RunConfig>::new().text(text, "x.toml").and_then(Layers::finish);
    let Some(config) = taken(read(text)) else { return false };
    let written = must(to_toml(&config), "a configuration that was read is not written");
    assert!(must(read(&written), "a configuration that was written is not read") == config);
    true
}

fn setting_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("three", files::SETTINGS)])
}

fn read_settings(bytes: &[u8], _: &Path) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let layers = text.lines().try_fold(Layers::<RunConfig>::new(), Layers::set);
    taken(layers.and_then(Layers::finish)).is_some()
}

fn script_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("every step", files::SCRIPT)])
}

fn read_script(bytes: &[u8], _: &Path) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    taken(script::parse(text, path())).is_some()
}

/// A tensor of the size that the first layer has; the file is too short for the others.
fn weight_seeds() -> Result<Vec<Seed>, SeedError> {
    let header = r#"{"features.0.weight":{"dtype":"F32","shape":[64,3,11,11],"data_offsets":[0,16]},
        "lin0.model.1.weight":{"dtype":"F32","shape":[1,4,1,1],"data_offsets":[16,32]}}"#;
    let length = (header.len() as u64).to_le_bytes();
    Ok(vec![Seed::new("two layers", [&length, header.as_bytes(), &[0; 32]].concat())])
}

fn read_weights(bytes: &[u8], folder: &Path) -> bool {
    let file = folder.join("weights.safetensors");
    must(fs::write(&file, bytes), "the scratch folder");
    taken(Lpips::load(Net::Alex, InputRange::MinusOneToOne, &file)).is_some()
}
