//! The tiny models of the fixtures, and the library that runs models.

use std::io::Write;
use std::path::PathBuf;
use std::sync::OnceLock;

use instgs_detect::library::library_name;
use instgs_detect::{ModelsFolder, Photo, RuntimeOptions, Segmenter};
use safetensors::SafeTensors;

/// Models with random weights and what PyTorch makes with them; `tools/models/make_mask_model_fixtures.py` writes it.
pub(crate) fn models_folder() -> PathBuf {
    crate::common::repository().join("tests/fixtures/models")
}

/// True if models can be run here. Without ONNX Runtime's library this is said aloud, whether output is captured or not;
/// with `INSTGS_NEED_ONNXRUNTIME=1`, or with a variable that names a library that cannot be loaded, the test fails.
pub(crate) fn has_onnxruntime() -> bool {
    static HAS: OnceLock<bool> = OnceLock::new();
    *HAS.get_or_init(|| {
        let Err(error) = Segmenter::open(&models(), &runtime()) else { return true };
        let needed = std::env::var("INSTGS_NEED_ONNXRUNTIME").as_deref() == Ok("1");
        let named = std::env::var_os("ORT_DYLIB_PATH").is_some_and(|v| !v.is_empty());
        assert!(!needed && !named && error.to_string().contains("tools/setup_onnxruntime"), "{error}");
        let _ = writeln!(std::io::stderr(), "TESTS THAT RUN MODELS DID NOT RUN: {error}");
        false
    })
}

/// The library that `tools/setup_onnxruntime` fetched, unless the user names another: tests run in their package's folder, from
/// where it is not found by itself.
pub(crate) fn runtime() -> RuntimeOptions {
    let fetched = crate::common::repository().join(".cache/onnxruntime").join(library_name());
    let named = std::env::var_os("ORT_DYLIB_PATH").is_some_and(|v| !v.is_empty());
    RuntimeOptions { library: (!named && fetched.is_file()).then_some(fetched), ..RuntimeOptions::default() }
}

/// The fixture's models.
pub(crate) fn models() -> ModelsFolder {
    ModelsFolder::open(&models_folder()).unwrap()
}

/// The tensors of `expected.safetensors`.
pub(crate) struct Tensors(Vec<u8>);

impl Tensors {
    /// Reads the file.
    pub(crate) fn read() -> std::io::Result<Self> {
        Ok(Self(std::fs::read(models_folder().join("expected.safetensors"))?))
    }

    /// Shape and bytes of a tensor.
    fn bytes(&self, name: &str) -> (Vec<usize>, Vec<u8>) {
        let all = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = all.tensor(name).unwrap();
        (tensor.shape().to_vec(), tensor.data().to_vec())
    }

    /// Its shape.
    pub(crate) fn shape(&self, name: &str) -> Vec<usize> {
        self.bytes(name).0
    }

    /// Its values, f32.
    pub(crate) fn floats(&self, name: &str) -> Vec<f32> {
        self.bytes(name).1.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    /// Its values, i64.
    pub(crate) fn integers(&self, name: &str) -> Vec<i64> {
        self.bytes(name).1.as_chunks::<8>().0.iter().map(|b| i64::from_le_bytes(*b)).collect()
    }

    /// The photo that all of it is about.
    pub(crate) fn photo(&self) -> Photo {
        let (shape, bytes) = self.bytes("photo");
        Photo { width: shape[1], height: shape[0], rgb: bytes.as_chunks::<3>().0.to_vec() }
    }
}
