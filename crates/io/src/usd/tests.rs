//! Both kinds of files have the same prims; `tools/check_usd` opens them with Pixar's library.

use glam::DVec3;
use openusd::sdf::AbstractData;
use std::path::Path;

use super::children::LISTS;
use super::layer::{LABEL, SCENE, SPLATS};
use super::text::quoted;
use super::{write_usda, write_usdc};
use crate::IoError;
use instgs_samples::{sample_scene, with_own};
use instgs_vk::scene::InstancedScene;

fn written(scene: &InstancedScene, ending: &str) -> Result<Vec<u8>, IoError> {
    let folder = tempfile::tempdir().map_err(|e| IoError::os(Path::new("."), "no folder", &e))?;
    let path = folder.path().join("a").with_extension(ending);
    let write = if ending == "usda" { write_usda } else { write_usdc };
    write(&path, scene, DVec3::NEG_Y)?;
    crate::read_bytes(&path)
}

#[test]
fn instances_are_prims_and_plain_ones_references() -> Result<(), IoError> {
    for mut scene in [sample_scene(), with_own()] {
        let plain = (0..scene.instances.len()).filter(|&k| scene.looks_like_template(k)).count();
        let bytes = written(&scene, "usda")?;
        assert_eq!(written(&scene, "usda")?, bytes);
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.starts_with("#usda 1.0\n"));
        assert_eq!(text.matches(&format!("def {SPLATS} \"instance_")).count(), scene.instances.len());
        assert_eq!(text.matches("prepend references").count(), plain);
        assert_eq!(text.matches('{').count(), text.matches('}').count());
        scene.background.means[0][1] = f32::NAN;
        for ending in ["usda", "usdc"] {
            assert!(written(&scene, ending).is_err_and(|e| e.to_string().contains("not finite")));
        }
    }
    assert_eq!(quoted("a \"b\"\\"), "a \\\"b\\\"\\\\");
    Ok(())
}

/// Text and binary as `openusd` reads them: every path, every field and every value.
#[test]
fn binary_and_text_have_the_same_prims() -> Result<(), IoError> {
    for mut scene in [sample_scene(), with_own()] {
        // What must not be written. Quotes are left to the test below: `openusd` does not take a text's escapes away.
        scene.groups[0].name = Some("chair\u{1b} a".into());
        let bytes = written(&scene, "usdc")?;
        assert_eq!(written(&scene, "usdc")?, bytes, "the same scene gives the same bytes");
        let text = String::from_utf8_lossy(&written(&scene, "usda")?).into_owned();
        let from_text = openusd::usda::parse(&text).expect("the text is read");
        let binary =
            openusd::usdc::CrateData::open(std::io::Cursor::new(bytes), true).expect("the binary file is read");
        assert_eq!(binary.spec_paths(), from_text.spec_paths());
        for path in binary.spec_paths() {
            assert_eq!(binary.spec_type(&path), from_text.spec_type(&path), "{path}");
            let mut fields = from_text.list_fields(&path).unwrap_or_default();
            fields.retain(|field| field != "custom");
            for field in fields {
                let (a, b) = (binary.get_field(&path, &field), from_text.get_field(&path, &field));
                let (a, b) = (a.expect("in the binary file"), b.expect("in the text"));
                assert_eq!(*a, *b, "{path} {field}");
            }
        }
    }
    Ok(())
}

/// Only text needs escapes.
#[test]
fn a_label_with_quotes_is_written_as_it_is() -> Result<(), IoError> {
    let mut scene = sample_scene();
    scene.groups[0].name = Some("chair \"a\" \\".into());
    let bytes = written(&scene, "usdc")?;
    let binary = openusd::usdc::CrateData::open(std::io::Cursor::new(bytes), true).expect("the binary file is read");
    let at = openusd::sdf::Path::new(&format!("/{SCENE}/instance_0.{LABEL}")).expect("a path");
    let label = binary.get_field(&at, "default").expect("a label");
    assert_eq!(*label, openusd::sdf::Value::TokenVec(vec!["chair \"a\" \\".into()]));
    Ok(())
}

/// Pixar's library finds no prims where lists of children have another type.
#[test]
fn lists_of_children_are_vectors_of_tokens() -> Result<(), IoError> {
    let bytes = written(&with_own(), "usdc")?;
    let file = openusd::usdc::CrateFile::open(std::io::Cursor::new(bytes)).expect("the binary file is read");
    let mut lists = 0;
    for field in &file.fields {
        if LISTS.contains(&file.tokens[field.token_index].as_str()) {
            assert_eq!(field.value_rep.0 >> 48, 41, "no array, and of the type for vectors of tokens");
            lists += 1;
        }
    }
    assert!(lists >= 3, "{lists} lists: of the root, of /scene and of a prim's attributes at least");
    Ok(())
}
