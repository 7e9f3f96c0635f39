//! The loaded runtime library, and sessions for graphs.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ort::LoadDynamicError;
use ort::environment::Environment;
use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use ort::session::Session;

use super::DetectError;
use super::library::{ADVICE, LIBRARY_VARIABLE, RuntimeOptions, check_whole, find_library};
use super::provider::Provider;
use instgs_io::IoError;

/// A process can load one runtime library, once. The environment is never dropped, so the library outlives everything
/// made with it.
static LOADED: Mutex<Option<(Environment, PathBuf)>> = Mutex::new(None);

/// ONNX Runtime, ready to run models.
pub(super) struct Runtime {
    environment: Environment,
    library: PathBuf,
    provider: Provider,
}

impl Runtime {
    /// Loads the library that [`find_library`] finds, or reuses it if it is already loaded, and checks that it supports
    /// the provider.
    ///
    /// # Errors
    /// A library that is missing, wrong, too old, or not the one loaded before; a provider that it was built without.
    pub(super) fn load(options: &RuntimeOptions) -> Result<Self, DetectError> {
        let working = std::env::current_dir().map_err(|e| IoError::new(Path::new("."), e.to_string()))?;
        let variable = std::env::var_os(LIBRARY_VARIABLE);
        let library = find_library(options.library.as_deref(), variable.as_deref(), &working)?;
        let environment = environment(&library)?;
        let runtime = Self { environment, library, provider: options.provider };
        runtime.check_provider()?;
        Ok(runtime)
    }

    fn check_provider(&self) -> Result<(), DetectError> {
        let has = |provider: Provider| {
            is_available(provider).map_err(|e| IoError::new(&self.library, format!("cannot list its providers: {e}")))
        };
        if has(self.provider)? {
            return Ok(());
        }
        let mut others = Vec::new();
        for provider in Provider::ALL {
            others.extend(has(provider)?.then_some(provider.name()));
        }
        let reason = format!(
            "{} was built without {}; it has {}: take one of those, or a build of the library that has it",
            self.library.display(),
            self.provider,
            others.join(", ")
        );
        Err(DetectError::Option { option: "--provider", reason })
    }

    /// Loads a graph from a file.
    ///
    /// # Errors
    /// A graph that the library cannot read or run, and a device that it cannot use.
    pub(super) fn session(&self, path: &Path) -> Result<Session, IoError> {
        let fail = |e: ort::Error| IoError::new(path, format!("cannot be loaded by ONNX Runtime: {e}"));
        let mut builder = Session::builder(&self.environment).map_err(fail)?;
        if self.provider != Provider::Cpu {
            let no_device = |e: ort::Error<_>| {
                IoError::new(&self.library, format!("cannot run models on {}: {e}", self.provider))
                    .advise("check the device's driver and libraries, or use --provider cpu")
            };
            builder = builder.with_execution_providers(dispatches(self.provider)).map_err(no_device)?;
        }
        builder.commit_from_file(path).map_err(fail)
    }
}

/// The only environment of this process, for the library at `path`.
fn environment(path: &Path) -> Result<Environment, IoError> {
    // Poisoning is harmless: the value is set last, so a panic has changed nothing.
    let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((environment, own)) = loaded.as_ref() {
        return match own == path {
            true => Ok(environment.clone()),
            false => {
                let what = format!("cannot be loaded: this process already uses {}", own.display());
                Err(IoError::new(path, what))
            }
        };
    }
    let unusable = |e: LoadDynamicError| match e {
        LoadDynamicError::Dlopen { error, .. } => {
            // The source is the system's own message.
            let reason = error.source().map_or(error.to_string(), ToString::to_string);
            IoError::new(path, format!("ONNX Runtime's library cannot be loaded: {reason}")).advise(ADVICE)
        }
        LoadDynamicError::BadVersion { version_str, .. } => {
            let what =
                format!("is ONNX Runtime {version_str}, but this program needs 1.{} or newer", ort::MINOR_VERSION);
            IoError::new(path, what).advise(ADVICE)
        }
        LoadDynamicError::MissingApi { .. } | LoadDynamicError::InvalidVersionString => {
            IoError::new(path, "is a library, but not ONNX Runtime's").advise(ADVICE)
        }
    };
    check_whole(path)?;
    let builder = ort::init_from(path).map_err(unusable)?;
    let built = builder.with_name("instgs-vk").with_telemetry(false).build();
    let environment = built.map_err(|e| IoError::new(path, format!("ONNX Runtime does not start: {e}")))?;
    *loaded = Some((environment.clone(), path.into()));
    Ok(environment)
}

/// Whether the loaded library was built with the provider.
fn is_available(provider: Provider) -> ort::Result<bool> {
    match provider {
        Provider::Cpu => Ok(true),
        Provider::Cuda => ep::CUDA::is_available(),
        Provider::TensorRt => ep::TensorRT::is_available(),
        Provider::Rocm => ep::ROCm::is_available(),
        Provider::CoreMl => ep::CoreML::is_available(),
        Provider::DirectMl => ep::DirectML::is_available(),
    }
}

/// Providers to register; a failure is an error, not a silent fallback to the processor.
fn dispatches(provider: Provider) -> Vec<ExecutionProviderDispatch> {
    let cuda = || ep::CUDA::default().build();
    let wanted = match provider {
        Provider::Cpu => vec![],
        Provider::Cuda => vec![cuda()],
        Provider::TensorRt => vec![ep::TensorRT::default().build(), cuda()],
        Provider::Rocm => vec![ep::ROCm::default().build()],
        Provider::CoreMl => vec![ep::CoreML::default().build()],
        Provider::DirectMl => vec![ep::DirectML::default().build()],
    };
    wanted.into_iter().map(ExecutionProviderDispatch::error_on_failure).collect()
}
