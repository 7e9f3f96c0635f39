//! How an `.instgs` file is packed, by its header alone.

use std::io::Read;
use std::path::Path;

use crate::pages;
use crate::scene_small::SUFFIX;
use crate::small::CODED;

/// A longer header is not that of a scene.
const MOST_HEADER_BYTES: u64 = 64 << 20;

/// What a scene's file loses if the scene is written as [`save_scene`](crate::save_scene) does, in full: one line for the user, or
/// `None` if it is neither packed nor in pages. Files of other formats, and those that cannot be read, lose nothing.
pub fn packing_lost(path: &Path) -> Option<String> {
    let is_scene = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("instgs"));
    let packing = if is_scene { packing_of(path)? } else { return None };
    let again = match (packing.pack, packing.has_pages) {
        (None, false) => return None,
        (None, true) => "--pages".into(),
        (Some(pack), false) => format!("--pack {pack}"),
        (Some(pack), true) => format!("--pack {pack} --pages"),
    };
    Some(format!(
        "{} was written with {again}, and this is not: export {again} makes such a file of it",
        path.display()
    ))
}

/// How a file is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Packing {
    /// The value of `--pack`; `None` for floats.
    pack: Option<&'static str>,
    has_pages: bool,
}

/// `None` if the file has no header that can be read.
fn packing_of(path: &Path) -> Option<Packing> {
    let mut file = std::fs::File::open(path).ok()?;
    let mut length = [0; 8];
    file.read_exact(&mut length).ok()?;
    let mut json = Vec::new();
    file.take(u64::from_le_bytes(length).min(MOST_HEADER_BYTES)).read_to_end(&mut json).ok()?;
    let header: serde_json::Map<String, serde_json::Value> = serde_json::from_slice(&json).ok()?;
    let dtype = |name: &str| header.get(name).and_then(|tensor| tensor["dtype"].as_str()).unwrap_or("");
    let quarter = ["offset.means", "offset.sh_dc", "offset.opacity_logits"].map(dtype).contains(&"U8");
    let half = ["template.sh", "background.sh", "offset.sh_dc"].map(dtype).contains(&"F16");
    let pack = match () {
        () if header.keys().any(|name| name.ends_with(CODED) || name.ends_with(SUFFIX)) => Some("small"),
        () if quarter => Some("q8"),
        () if half => Some("f16"),
        () => None,
    };
    Some(Packing { pack, has_pages: header.keys().any(|name| pages::is_of_pages(name)) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{IoError, Pack, save_scene, write_scene_file_in_pages, write_scene_file_packed};
    use instgs_samples::sample_scene;

    #[test]
    fn what_is_written_in_full_says_how_it_was_packed() -> Result<(), IoError> {
        let folder = tempfile::tempdir().map_err(|e| IoError::os(Path::new("."), "no folder", &e))?;
        let (path, scene) = (folder.path().join("a.instgs"), sample_scene());
        for (pack, name) in [(Pack::F16, "f16"), (Pack::Q8, "q8"), (Pack::Small, "small")] {
            write_scene_file_packed(&path, &scene, pack)?;
            assert_eq!(packing_of(&path), Some(Packing { pack: Some(name), has_pages: false }));
            let lost = packing_lost(&path).unwrap_or_default();
            assert!(lost.contains(&format!("export --pack {name} makes")), "{lost}");
        }
        write_scene_file_in_pages(&path, &scene, Pack::F16)?;
        assert_eq!(packing_of(&path), Some(Packing { pack: Some("f16"), has_pages: true }));
        save_scene(&path, &scene)?;
        assert_eq!(packing_lost(&path), None);
        // No scene, and no file.
        std::fs::write(&path, [255; 20]).map_err(|e| IoError::os(&path, "cannot write", &e))?;
        assert_eq!((packing_lost(&path), packing_lost(&folder.path().join("b.instgs"))), (None, None));
        Ok(())
    }
}
