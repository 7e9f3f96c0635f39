//! The error of dividing and joining; each is one line for the user.

use instgs_io::IoError;
use instgs_objects::register::RegisterError;
use instgs_objects::template::TemplateError;
use instgs_vk::scene::instanced_scene::SceneError;

/// Why a data set could not be divided, or why blocks could not be joined.
#[derive(Debug, thiserror::Error)]
pub enum BlocksError {
    /// A file is missing, damaged, or does not fit the others.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The blocks' templates could not be registered to each other.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// An object could not become an instance of another block's template.
    #[error(transparent)]
    Template(#[from] TemplateError),
    /// The joined scene is not valid.
    #[error("the joined scene: {0}")]
    Scene(#[from] SceneError),
}
