use super::*;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// SHA-256 of an empty file.
const OF_NOTHING: &str = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

fn manifest() -> serde_json::Value {
    let file = |name: &str| serde_json::json!({"file": name, "bytes": 0, "sha256": OF_NOTHING});
    let mut graph = file("d.onnx");
    graph["data"] = serde_json::json!([file("d.onnx.data")]);
    serde_json::json!({
        "format": FORMAT,
        "detector": {"kind": "grounding-dino", "source": "a", "opset": 20, "graph": graph, "tokenizer": file("t.json"),
                     "shortest_px": 800, "longest_px": 1333, "canvas_px": null,
                     "mean": [0.5, 0.5, 0.5], "std": [0.2, 0.2, 0.2], "max_tokens": 256, "fixed_tokens": null},
        "segmenter": {"kind": "sam", "source": "b", "encoder": file("e.onnx"), "decoder": file("m.onnx"),
                      "side_px": 1024, "mask_px": 256, "mean": [0.5, 0.5, 0.5], "std": [0.2, 0.2, 0.2]}
    })
}

fn write(folder: &Path, manifest: &serde_json::Value) -> Outcome {
    Ok(std::fs::write(folder.join(MANIFEST), manifest.to_string())?)
}

fn error(folder: &Path) -> String {
    ModelsFolder::open(folder).err().map(|e| e.to_string()).unwrap_or_default()
}

#[test]
fn what_is_missing_is_named_with_the_command_that_makes_it() -> Outcome {
    let folder = tempfile::tempdir()?;
    let root = folder.path();
    assert!(error(&root.join("none")).contains(DETECTOR_COMMAND));
    assert!(error(root).contains("models.json: is missing") && error(root).contains(SEGMENTER_COMMAND));
    write(root, &manifest())?;
    for (name, command) in [
        ("d.onnx", DETECTOR_COMMAND),
        ("d.onnx.data", DETECTOR_COMMAND),
        ("t.json", DETECTOR_COMMAND),
        ("e.onnx", SEGMENTER_COMMAND),
        ("m.onnx", SEGMENTER_COMMAND),
    ] {
        let text = error(root);
        assert!(text.contains(&format!("{name}: cannot be used")) && text.contains(command), "{text}");
        std::fs::write(root.join(name), "cut")?;
        assert!(error(root).contains("has 3 bytes, but models.json says 0"), "{}", error(root));
        std::fs::write(root.join(name), "")?;
    }
    let models = ModelsFolder::open(root)?;
    assert_eq!(models.path(&models.detector.graph), root.join("d.onnx"));
    for key in ["detector", "segmenter"] {
        let mut part = manifest();
        part[key] = serde_json::Value::Null;
        write(root, &part)?;
        assert!(error(root).contains(&format!("{key}: is missing; make it with: python3")), "{}", error(root));
    }
    Ok(())
}

#[test]
fn nonsense_is_named() -> Outcome {
    let folder = tempfile::tempdir()?;
    let root = folder.path();
    for (model, field, value, want) in [
        ("", "format", serde_json::json!("instgs-models/9"), "format: has the format"),
        ("detector", "kind", serde_json::json!("yolo"), "detector.kind: is \"yolo\""),
        ("detector", "shortest_px", serde_json::json!(2000), "above longest_px"),
        ("detector", "longest_px", serde_json::json!(1000000), "1 to 16384"),
        ("detector", "canvas_px", serde_json::json!([0, 10]), "detector.canvas_px: is 0"),
        ("detector", "max_tokens", serde_json::json!(0), "4 to 65536"),
        ("detector", "fixed_tokens", serde_json::json!(300), "4 to 256"),
        ("detector", "mean", serde_json::json!([0.5, 0.5]), "models.json"),
        ("segmenter", "kind", serde_json::json!("fast"), "can use \"sam\""),
        ("segmenter", "side_px", serde_json::json!(0), "segmenter.side_px: is 0"),
        ("segmenter", "mask_px", serde_json::json!(-1), "models.json"),
        ("segmenter", "std", serde_json::json!([0.2, 0.0, 0.2]), "not above 0"),
    ] {
        let mut changed = manifest();
        if model.is_empty() {
            changed[field] = value
        } else {
            changed[model][field] = value
        }
        write(root, &changed)?;
        let text = error(root);
        assert!(text.contains(want) && !text.contains('\n'), "{text} lacks {want}");
    }
    std::fs::write(root.join(MANIFEST), "{")?;
    assert!(error(root).contains("models.json"));
    Ok(())
}

#[cfg(feature = "onnx")]
#[test]
fn other_contents_are_noticed() -> Outcome {
    let folder = tempfile::tempdir()?;
    let root = folder.path();
    let mut changed = manifest();
    for name in ["d.onnx", "d.onnx.data", "t.json", "e.onnx", "m.onnx"] {
        std::fs::write(root.join(name), "")?;
    }
    std::fs::write(root.join("d.onnx.data"), "abc")?;
    changed["detector"]["graph"]["data"][0]["bytes"] = serde_json::json!(3);
    write(root, &changed)?;
    let models = ModelsFolder::open(root)?;
    models.check_contents(&models.segmenter.encoder)?;
    let text = models.check_contents(&models.detector.graph).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("d.onnx.data: has the SHA-256 ba7816bf") && text.contains("make it again"), "{text}");
    Ok(())
}
