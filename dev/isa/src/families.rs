//! Families of AMD's GPUs, compiled for by Mesa's driver RADV without a GPU: told a family, it makes a device that can only
//! compile. It reads the family when it is loaded, so this program runs itself once for each.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::figures::DeviceFigures;

/// Folders in which Vulkan's loader on Linux looks for drivers.
const DRIVER_FOLDERS: [&str; 3] = ["/usr/share/vulkan/icd.d", "/usr/local/share/vulkan/icd.d", "/etc/vulkan/icd.d"];

/// Why there are no figures.
#[derive(Debug, thiserror::Error)]
pub enum FamilyError {
    /// Mesa's driver for AMD's GPUs is not installed.
    #[error(
        "Mesa's driver for AMD's GPUs is not at {}: install Mesa's Vulkan drivers (tools/setup does), name the file with \
         --driver, or pass --allow-missing to go without",
        looked_at.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    NoDriver {
        /// Paths that its manifest could have.
        looked_at: Vec<PathBuf>,
    },
    /// The program could not be run again.
    #[error("compiling for {family}: cannot run {}: {source}", program.display())]
    Start {
        /// Family of GPUs.
        family: String,
        /// This program.
        program: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The driver, or this program, failed.
    #[error("compiling for {family} failed ({status}): {said}")]
    Failed {
        /// Family of GPUs.
        family: String,
        /// How the process ended.
        status: std::process::ExitStatus,
        /// What it wrote to stderr.
        said: String,
    },
    /// The process did not report figures.
    #[error("compiling for {family}: the report is not what it should be: {reason}")]
    Report {
        /// Family of GPUs.
        family: String,
        /// What is wrong with it.
        reason: String,
    },
}

/// The manifest of Mesa's driver for AMD's GPUs: `named`, or that of the system for this machine's architecture.
///
/// # Errors
/// It is not there.
pub fn find_driver(named: Option<&Path>) -> Result<PathBuf, FamilyError> {
    let file = format!("radeon_icd.{}.json", std::env::consts::ARCH);
    let of_system = || DRIVER_FOLDERS.iter().map(|folder| Path::new(folder).join(&file)).collect();
    let looked_at = named.map_or_else(of_system, |path| vec![path.into()]);
    match looked_at.iter().find(|path| path.is_file()) {
        Some(path) => Ok(path.clone()),
        None => Err(FamilyError::NoDriver { looked_at }),
    }
}

/// Compiles for all families at once.
///
/// # Errors
/// The first family that fails.
pub fn compile_for<'a>(
    families: impl Iterator<Item = &'a String>,
    driver: &Path,
) -> Result<BTreeMap<String, DeviceFigures>, FamilyError> {
    let started =
        families.map(|family| Ok((family, Running::start(family, driver)?))).collect::<Result<Vec<_>, _>>()?;
    started.into_iter().map(|(family, running)| Ok((family.clone(), running.finish(family)?))).collect()
}

/// The command that compiles for one family and reports as JSON.
fn command_for(program: &Path, family: &str, driver: &Path) -> Command {
    let mut command = Command::new(program);
    command
        .args(["here", "--json"])
        // The new name of this variable, and the one that older loaders know.
        .env("VK_DRIVER_FILES", driver)
        .env("VK_ICD_FILENAMES", driver)
        .env("RADV_FORCE_FAMILY", family)
        // A kernel that comes from the cache has no statistics.
        .env("MESA_SHADER_CACHE_DISABLE", "1")
        .env_remove("VK_INSTANCE_LAYERS")
        .env_remove("INSTGS_DEVICE")
        // Budgets are of the kernels as they are, not of those that somebody measures with other numbers.
        .env_remove("INSTGS_TUNING")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// A process of this program that compiles; ended if it is given up.
struct Running(Option<Child>);

impl Running {
    fn start(family: &str, driver: &Path) -> Result<Self, FamilyError> {
        let start =
            |source, program: &Path| FamilyError::Start { family: family.into(), program: program.into(), source };
        let program = std::env::current_exe().map_err(|e| start(e, Path::new("this program")))?;
        let child = command_for(&program, family, driver).spawn();
        child.map(|child| Self(Some(child))).map_err(|e| start(e, &program))
    }

    fn finish(mut self, family: &str) -> Result<DeviceFigures, FamilyError> {
        let report = |reason: String| FamilyError::Report { family: family.into(), reason };
        let child = self.0.take().ok_or_else(|| report("there is none".into()))?;
        let output = child.wait_with_output().map_err(|e| report(e.to_string()))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            return Err(FamilyError::Failed { family: family.into(), status: output.status, said });
        }
        let figures: DeviceFigures = serde_json::from_slice(&output.stdout).map_err(|e| report(e.to_string()))?;
        // An unknown family makes the driver offer no such device, and the loader may then take another driver's.
        if !figures.driver.to_lowercase().starts_with("radv") {
            return Err(report(format!("it is of {} by {}", figures.device, figures.driver)));
        }
        Ok(figures)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            // It may have ended by itself.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::*;

    #[test]
    fn what_the_user_set_for_other_work_does_not_reach_the_compiler() {
        let command = command_for(Path::new("program"), "navi21", Path::new("driver.json"));
        let variables: BTreeMap<&OsStr, Option<&OsStr>> = command.get_envs().collect();
        let of = |name: &str| variables.get(OsStr::new(name)).copied();
        for name in ["INSTGS_TUNING", "INSTGS_DEVICE", "VK_INSTANCE_LAYERS"] {
            assert_eq!(of(name), Some(None), "{name} is removed");
        }
        assert_eq!(of("RADV_FORCE_FAMILY"), Some(Some(OsStr::new("navi21"))));
    }
}
