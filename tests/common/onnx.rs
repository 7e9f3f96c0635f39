//! The tiny models of the fixtures, and the library that runs models.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use instgs_vk::detect::{ModelsFolder, RuntimeOptions, Segmenter};

/// Models with random weights and what PyTorch makes with them; `tools/models/make_mask_model_fixtures.py` writes it.
pub(crate) fn models_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/models")
}

/// True if models can be run here. Without ONNX Runtime's library this is said aloud, whether output is captured or not;
/// with `INSTGS_NEED_ONNXRUNTIME=1`, or with a variable that names a library that cannot be loaded, the test fails.
pub(crate) fn has_onnxruntime() -> bool {
    static HAS: OnceLock<bool> = OnceLock::new();
    *HAS.get_or_init(|| {
        let models = ModelsFolder::open(&models_folder()).unwrap();
        let Err(error) = Segmenter::open(&models, &RuntimeOptions::default()) else { return true };
        let needed = std::env::var("INSTGS_NEED_ONNXRUNTIME").as_deref() == Ok("1");
        let named = std::env::var_os("ORT_DYLIB_PATH").is_some_and(|v| !v.is_empty());
        assert!(!needed && !named && error.to_string().contains("tools/setup_onnxruntime"), "{error}");
        let _ = writeln!(std::io::stderr(), "TESTS THAT RUN MODELS DID NOT RUN: {error}");
        false
    })
}
