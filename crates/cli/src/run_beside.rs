//! The configuration of the run that a scene lies in: how its training drew it, which its file does not say.

use std::path::Path;

use instgs_console::Printer;
use instgs_io::RunFolder;
use instgs_objects::pipeline::config::ConfigBuilder;
use instgs_train::config::TrainConfig;

/// The configuration of the run in whose folder a scene lies; the default if there is none, or, with a warning, none that can be
/// read.
pub(super) fn config_beside(scene: &Path, printer: &Printer) -> TrainConfig {
    let file = RunFolder::new(scene.parent().unwrap_or(Path::new("."))).config();
    if !file.is_file() {
        return TrainConfig::default();
    }
    let config = ConfigBuilder::new().run_file(&file).and_then(ConfigBuilder::finish);
    config.map_or_else(
        |error| {
            printer.warning(format_args!(
                "{error}: the scene is taken as one of the default configuration (near plane, photos as they are, black behind)"
            ));
            TrainConfig::default()
        },
        |config| config.train,
    )
}
