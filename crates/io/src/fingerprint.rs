//! The fingerprint of a data set: whether a run that is resumed still has the photos, masks and cameras that it began with.
//!
//! Of a large file only its length and blocks spread over it are hashed. What is written anew by a program differs there;
//! a file that was altered on purpose, between the blocks, is not noticed.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::{IoError, View};

/// Length up to which a file is hashed as a whole, bytes.
const WHOLE: u64 = 128 << 10;
/// Length of a block of a larger file, bytes.
const BLOCK: u64 = 16 << 10;
/// Number of blocks of a larger file, from its first byte to its last.
const BLOCKS: u64 = WHOLE / BLOCK;
/// Bytes of a hash that are kept.
const HASH_BYTES: usize = 16;
/// Relative difference of extents below which they are the same: other processors may round otherwise.
const SAME_EXTENT: f64 = 1e-9;

/// What a training run is given, hashed. It does not depend on where the files are.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Fingerprint {
    /// The training views, in the order that the run counts them by.
    pub train: Vec<ViewPrint>,
    /// The test views.
    pub test: Vec<ViewPrint>,
    /// Scene extent, scene units: it comes from cameras and points, and rates of learning depend on it.
    pub extent: f64,
    /// Further files, by what they are.
    pub files: BTreeMap<String, FilePrint>,
}

/// The hashes of one view.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ViewPrint {
    /// Name of the view, unique in the data set.
    pub name: String,
    /// Hash of camera and lens.
    pub camera: String,
    /// The photo.
    pub photo: FilePrint,
    /// The mask of its pixels that count, if it has one.
    pub mask: Option<FilePrint>,
}

/// Length and hash of one file.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct FilePrint {
    /// Path of the file, for messages; empty in a fingerprint that was read.
    #[serde(skip)]
    pub path: PathBuf,
    /// Length, bytes.
    pub bytes: u64,
    /// Hash of the file, or of blocks of it, in hexadecimal.
    pub hash: String,
}

impl Fingerprint {
    /// Hashes the views of a run and the files that it also goes by; `extent` is that of the scene.
    ///
    /// # Errors
    /// The first file that cannot be read or is no regular file.
    pub fn of(train: &[View], test: &[View], extent: f64, files: &[(&str, &Path)]) -> Result<Self, IoError> {
        let all = |views: &[View]| views.par_iter().map(ViewPrint::of).collect::<Result<Vec<_>, _>>();
        let files = files.iter().map(|(name, path)| Ok(((*name).to_owned(), FilePrint::of(path)?)));
        Ok(Self { train: all(train)?, test: all(test)?, extent, files: files.collect::<Result<_, IoError>>()? })
    }

    /// What differs from an `earlier` fingerprint, one line each; empty if nothing does.
    pub fn changes_since(&self, earlier: &Self) -> Vec<String> {
        let mut out = Vec::new();
        let (before, now) = (earlier.by_name(), self.by_name());
        for (name, (view, is_test)) in &now {
            match before.get(name) {
                Some((was, was_test)) => out.extend(view.change_since(was, *is_test, *was_test)),
                None => out.push(format!("{}: is a new view", view.photo.path.display())),
            }
        }
        let gone = before.keys().filter(|name| !now.contains_key(*name));
        out.extend(gone.map(|name| format!("{name}: this view is gone")));
        for (name, file) in &self.files {
            let was = earlier.files.get(name);
            out.extend(was.and_then(|was| file.change_since(was, name)));
        }
        let order = |print: &Self| print.train.iter().map(|view| view.name.clone()).collect::<Vec<_>>();
        if out.is_empty() && order(self) != order(earlier) {
            out.push("the training views have another order".into());
        }
        let (extent, was) = (self.extent, earlier.extent);
        if out.is_empty() && (extent - was).abs() > SAME_EXTENT * was.abs() {
            out.push(format!("the scene's extent is {extent:.4}, and was {was:.4}: its points changed"));
        }
        out
    }

    /// For each training view its index in an `earlier` fingerprint, if it has the same photo there.
    pub fn places_in(&self, earlier: &Self) -> Vec<Option<usize>> {
        let same = |view: &ViewPrint, was: &ViewPrint| view.name == was.name && view.photo.is_same(&was.photo);
        self.train.iter().map(|view| earlier.train.iter().position(|was| same(view, was))).collect()
    }

    /// All views by name, and whether they are test views.
    fn by_name(&self) -> BTreeMap<&str, (&ViewPrint, bool)> {
        let mut out = BTreeMap::new();
        out.extend(self.train.iter().map(|view| (view.name.as_str(), (view, false))));
        out.extend(self.test.iter().map(|view| (view.name.as_str(), (view, true))));
        out
    }
}

impl ViewPrint {
    fn of(view: &View) -> Result<Self, IoError> {
        let mask = view.mask_path.as_ref().filter(|path| path.exists());
        Ok(Self {
            name: view.camera.name.clone(),
            camera: camera_hash(view),
            photo: FilePrint::of(&view.image_path)?,
            mask: mask.map(|path| FilePrint::of(path)).transpose()?,
        })
    }

    fn change_since(&self, was: &Self, is_test: bool, was_test: bool) -> Option<String> {
        let of_view = |what: &str| Some(format!("{}: {what}", self.photo.path.display()));
        if let Some(change) = self.photo.change_since(&was.photo, "photo") {
            return Some(change);
        }
        match (&self.mask, &was.mask) {
            (Some(mask), Some(was)) => {
                if let Some(change) = mask.change_since(was, "mask") {
                    return Some(change);
                }
            }
            (Some(mask), None) => return Some(format!("{}: is a new mask", mask.path.display())),
            (None, Some(_)) => return of_view("its mask is gone"),
            (None, None) => {}
        }
        if self.camera != was.camera {
            return of_view("its camera changed");
        }
        match (is_test, was_test) {
            (true, false) => of_view("is a test view, and was trained on"),
            (false, true) => of_view("is trained on, and was a test view"),
            _ => None,
        }
    }
}

impl FilePrint {
    /// Hashes one file: all of it, or of a large one its length and blocks of it.
    ///
    /// # Errors
    /// A file that cannot be read or is no regular file.
    pub fn of(path: &Path) -> Result<Self, IoError> {
        let fail = |e: std::io::Error| IoError::os(path, "cannot read", &e);
        let kind = std::fs::metadata(path).map_err(fail)?;
        // A pipe may never end, or never begin.
        if !kind.is_file() {
            return Err(IoError::new(path, "is no regular file").advise("copy its content to a file"));
        }
        let (bytes, mut hash) = (kind.len(), Sha256::new());
        let mut file = File::open(path).map_err(fail)?;
        if bytes <= WHOLE {
            let mut content = Vec::new();
            file.take(WHOLE).read_to_end(&mut content).map_err(fail)?;
            hash.update(&content);
        } else {
            let mut block = [0; BLOCK as usize];
            for k in 0..BLOCKS {
                file.seek(SeekFrom::Start(block_start(bytes, k))).map_err(fail)?;
                file.read_exact(&mut block).map_err(fail)?;
                hash.update(block);
            }
        }
        Ok(Self { path: path.into(), bytes, hash: shortened(hash) })
    }

    fn is_same(&self, other: &Self) -> bool {
        (self.bytes, &self.hash) == (other.bytes, &other.hash)
    }

    /// One line on what changed of a file, which is a `kind`.
    fn change_since(&self, was: &Self, kind: &str) -> Option<String> {
        let path = self.path.display();
        let (now, then) = (self.bytes, was.bytes);
        match self.is_same(was) {
            true => None,
            false if now == then => Some(format!("{path}: this {kind} has the same length and another content")),
            false => Some(format!("{path}: this {kind} has {now} bytes, and had {then}")),
        }
    }
}

/// Offset of block `k` of a file of more than [`WHOLE`] bytes.
fn block_start(bytes: u64, k: u64) -> u64 {
    (u128::from(bytes - BLOCK) * u128::from(k) / u128::from(BLOCKS - 1)) as u64
}

fn camera_hash(view: &View) -> String {
    let mut hash = Sha256::new();
    let camera = &view.camera;
    [camera.width, camera.height].iter().for_each(|side| hash.update(side.to_le_bytes()));
    let mut numbers = vec![camera.fx, camera.fy, camera.cx, camera.cy];
    numbers.extend(camera.view_from_world.as_flattened());
    if let Some(lens) = &view.distortion {
        numbers.extend([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3]);
        numbers.extend(lens.fisheye.iter().flatten());
    }
    numbers.iter().for_each(|number| hash.update(number.to_le_bytes()));
    shortened(hash)
}

fn shortened(hash: Sha256) -> String {
    hash.finalize().iter().take(HASH_BYTES).map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::Split;
    use instgs_vk::scene::Camera;

    type Test = Result<(), Box<dyn std::error::Error>>;

    fn view(folder: &Path, name: &str) -> View {
        let view_from_world = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let camera =
            Camera { name: name.into(), width: 4, height: 3, fx: 2.0, fy: 2.0, cx: 2.0, cy: 1.5, view_from_world };
        let image_path = folder.join(format!("{name}.jpg"));
        View {
            camera,
            image_path,
            split: Split::Train,
            distortion: None,
            mask_path: Some(folder.join(format!("{name}.png"))),
        }
    }

    /// Three views in a folder; `b` is a large file.
    fn sample(folder: &Path) -> Result<Vec<View>, std::io::Error> {
        for (name, bytes) in [("a", 1000), ("b", 3 * WHOLE + 7), ("c", WHOLE)] {
            fs::write(folder.join(format!("{name}.jpg")), vec![7; bytes as usize])?;
        }
        fs::write(folder.join("a.png"), "mask")?;
        Ok(["a", "b", "c"].map(|name| view(folder, name)).into())
    }

    #[test]
    fn each_change_is_said_once_with_its_file() -> Test {
        let folder = tempfile::tempdir()?;
        let at = folder.path();
        let views = sample(at)?;
        let other = at.join("start");
        fs::write(&other, "x")?;
        let of = |train: &[View], extent| Fingerprint::of(train, &views[2..], extent, &[("start", &other)]);
        let stored = serde_json::to_string(&of(&views[..2], 2.0)?)?;
        assert!(!stored.contains(&at.display().to_string()), "depends on where the files are");
        let before: Fingerprint = serde_json::from_str(&stored)?;
        let said = |train: &[View], extent| Ok::<_, IoError>(of(train, extent)?.changes_since(&before));
        let same = || said(&views[..2], 2.0);
        assert_eq!(same()?, [""; 0]);

        let changed = |path: &Path, content: &[u8], words: &[&str]| {
            let good = fs::read(path)?;
            fs::write(path, content)?;
            let lines = same()?;
            fs::write(path, good)?;
            assert!(lines.len() == 1 && lines[0].starts_with(&path.display().to_string()), "{lines:?}");
            words.iter().for_each(|word| assert!(lines[0].contains(word), "{word}: {}", lines[0]));
            Ok::<_, Box<dyn std::error::Error>>(())
        };
        changed(&at.join("a.jpg"), &[7; 999], &["photo", "999 bytes", "had 1000"])?;
        changed(&at.join("a.jpg"), &[6; 1000], &["photo", "same length"])?;
        changed(&at.join("c.jpg"), &[1; WHOLE as usize], &["photo", "same length"])?;
        changed(&at.join("a.png"), b"Mask", &["mask", "same length"])?;
        changed(&other, b"y", &["start", "same length"])?;
        // The last byte of a large file, and its first.
        for place in [0, 3 * WHOLE as usize + 6] {
            let mut bytes = vec![7; 3 * WHOLE as usize + 7];
            bytes[place] = 8;
            changed(&at.join("b.jpg"), &bytes, &["same length"])?;
        }
        assert!(said(&views[..2], 2.1)?[0].contains("extent is 2.1000, and was 2.0000"));
        let turned = [views[1].clone(), views[0].clone()];
        assert!(said(&turned, 2.0)?[0].contains("another order"));
        assert!(said(&views[..1], 2.0)?[0].starts_with("b: this view is gone"));
        let mut nearer = views[..2].to_vec();
        nearer[1].camera.view_from_world[2][3] = 0.5;
        assert!(said(&nearer, 2.0)?[0].contains("b.jpg: its camera changed"));
        assert_eq!(same()?, [""; 0]);
        fs::write(at.join("b.png"), "mask")?;
        assert!(same()?[0].contains("b.png: is a new mask"));
        Ok(())
    }

    #[test]
    fn photos_keep_their_places_only_unchanged() -> Test {
        let folder = tempfile::tempdir()?;
        let views = sample(folder.path())?;
        let before = Fingerprint::of(&views, &[], 1.0, &[])?;
        fs::write(folder.path().join("c.jpg"), "another")?;
        let now = Fingerprint::of(&[views[2].clone(), views[1].clone()], &[], 1.0, &[])?;
        assert_eq!(now.places_in(&before), [None, Some(1)]);
        fs::remove_file(folder.path().join("b.jpg"))?;
        assert!(Fingerprint::of(&views, &[], 1.0, &[]).is_err_and(|e| e.to_string().contains("b.jpg")));
        Ok(())
    }
}
