//! Tests of the page's bytes; `tools/check_page` opens it in a browser.

use std::collections::BTreeSet;
use std::error::Error;
use std::fs;
use std::io::Read;

use flate2::read::DeflateDecoder;
use instgs_samples::{ring, sample_scene, with_ablations, with_levels, with_low_sh_offsets, with_own};
use instgs_vk::scene::instanced_scene::Group;

use super::base85::bytes_of_base85;
use super::*;
use crate::scene_file::parse_scene_file;

/// Closes elements, opens a script, and looks like a placeholder.
const HOSTILE: &str = "</script><script>alert(1)</script><!--&\"'{{SCENE}}";

fn options(pack: Pack) -> PageOptions<'static> {
    PageOptions { pack, small: None, camera: None, up: DVec3::Z }
}

/// The page of a scene at a file name in a folder of its own.
fn page(name: &str, scene: &InstancedScene, options: &PageOptions<'_>) -> Result<String, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(name);
    write_page(&path, scene, options)?;
    Ok(fs::read_to_string(path)?)
}

/// The text of the script element with this id.
fn element<'a>(page: &'a str, id: &str) -> &'a str {
    let (_, after) = page.split_once(&format!("id=\"{id}\">")).expect("the element is there");
    after.split_once("</script>").expect("it ends").0
}

#[test]
fn holds_the_packed_scene_and_is_the_same_each_time() -> Result<(), Box<dyn Error>> {
    for scene in [sample_scene(), with_ablations(), with_low_sh_offsets(), with_own(), InstancedScene::default()] {
        for pack in [Pack::F32, Pack::F16, Pack::Q8, Pack::Small] {
            let text = page("x.html", &scene, &options(pack))?;
            assert_eq!(text, page("x.html", &scene, &options(pack))?);
            let mut file = Vec::new();
            DeflateDecoder::new(&bytes_of_base85(element(&text, "scene-data"))[..]).read_to_end(&mut file)?;
            let path = Path::new("x.instgs");
            assert_eq!(file, packed_scene_file_bytes(&scene, pack, path)?);
            assert_eq!(parse_scene_file(&file, path)?.expanded_len(), scene.expanded_len());
        }
    }
    // A page has no levels of detail.
    let [with, without] = [with_levels(), sample_scene()].map(|scene| page("x.html", &scene, &options(Pack::F32)));
    assert_eq!(with?, without?);
    Ok(())
}

#[test]
fn nothing_from_a_file_breaks_out() -> Result<(), Box<dyn Error>> {
    let plain = page("x.html", &sample_scene(), &options(Pack::Small))?;
    let mut scene = sample_scene();
    scene.source = HOSTILE.into();
    scene.groups = vec![Group { template_id: 0, name: Some(HOSTILE.into()), instance_ids: vec![0] }];
    let camera = Camera { name: HOSTILE.into(), ..ring(DVec3::Z).remove(0) };
    // A slash is the one character that no file name has.
    let name = format!("{}.html", HOSTILE.replace('/', ":"));
    let text = page(&name, &scene, &PageOptions { camera: Some(&camera), ..options(Pack::F32) })?;
    for mark in ["<script", "</script", "<!--", "alert(1)</script>"] {
        assert_eq!(text.matches(mark).count(), plain.matches(mark).count(), "{mark}");
    }
    assert!(text.contains("<title>&lt;:script&gt;&lt;script&gt;alert(1)"), "the title is escaped, once");
    assert!(text.contains("&amp;&quot;&#39;{{SCENE}}</title>"), "what is filled in is not filled in again");
    let start: serde_json::Value = serde_json::from_str(element(&text, "start-data"))?;
    assert_eq!(start["camera"]["name"], HOSTILE);
    Ok(())
}

#[test]
fn begins_at_the_camera_or_around_the_scene() -> Result<(), Box<dyn Error>> {
    let scene = sample_scene();
    let start = |text: &str| serde_json::from_str::<serde_json::Value>(element(text, "start-data"));
    let without = start(&page("x.html", &scene, &options(Pack::Small))?)?;
    assert!(without["camera"].is_null());
    assert_eq!(without["up"], serde_json::json!([0.0, 0.0, 1.0]));
    assert_eq!(without["distance"].as_f64(), Some(Orbit::around(&scene, Some(DVec3::Z)).distance));
    let camera = ring(DVec3::Z).remove(3);
    let with = start(&page("x.html", &scene, &PageOptions { camera: Some(&camera), ..options(Pack::Small) })?)?;
    assert_eq!(with["camera"]["width"], camera.width);
    assert_eq!(with["camera"]["view_from_world"].as_array().map(Vec::len), Some(4));
    Ok(())
}

#[test]
fn is_whole_and_light_and_asks_no_other_machine() -> Result<(), Box<dyn Error>> {
    let text = page("x.html", &InstancedScene::default(), &options(Pack::Small))?;
    assert!(TEMPLATE.matches("{{").count() >= 10, "names that lack a value are errors");
    assert!(text.len() < 300_000, "{} bytes beside the scene", text.len());
    for outside in ["http:", "https:", "//cdn", "src=", "@import"] {
        assert!(!text.contains(outside), "{outside}");
    }
    Ok(())
}

#[test]
fn a_template_and_its_values_fit() {
    let values = [("A", "1"), ("B", "{{A}}")];
    assert_eq!(filled("{{B}}x{{A}}{{A}}", &values).as_deref(), Ok("{{A}}x11"));
    for (template, what) in [("{{A}}{{B}}{{C}}", "has C, which"), ("{{A}}", "no place for B"), ("{{A}}{{B", "no end")] {
        assert!(filled(template, &values).is_err_and(|e| e.contains(what)), "{template}");
    }
}

/// Names that a module declares at its top level.
fn declared(module: &str) -> Vec<&str> {
    module
        .lines()
        .filter_map(|line| {
            let line = line.strip_prefix("export ").unwrap_or(line);
            let line = line.strip_prefix("async ").unwrap_or(line);
            let rest = ["function ", "class ", "const ", "let "].iter().find_map(|word| line.strip_prefix(word))?;
            rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().filter(|name| !name.is_empty())
        })
        .collect()
}

#[test]
fn modules_link_to_plain_scripts() {
    for modules in [&WORKER[..], &MAIN[..]] {
        let script = linked(modules);
        assert!(script.lines().all(|line| !line.starts_with("import") && !line.starts_with("export")));
        assert!(!script.contains("</script") && !script.contains("<!--"));
        let names: Vec<&str> = modules.iter().flat_map(|module| declared(module)).collect();
        assert!(names.len() > 20, "{names:?}");
        let different: BTreeSet<&str> = names.iter().copied().collect();
        assert_eq!(different.len(), names.len(), "a name is declared twice: {names:?}");
        // Each module uses only what stands before it: classes and constants are not hoisted.
        for (at, module) in modules.iter().enumerate() {
            for line in module.lines().filter(|line| line.starts_with("import ")) {
                assert!(line.ends_with("\";"), "an import takes one line: {line}");
                let (names, _) = line["import ".len()..].split_once(" from ").expect("an import of names");
                for name in names.trim_matches(['{', '}', ' ']).split(", ") {
                    assert!(modules[..at].iter().any(|before| declared(before).contains(&name)), "{line}: {name}");
                }
            }
        }
    }
}
