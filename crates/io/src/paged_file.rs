//! An `.instgs` file with its background in pages, of which rows are read when they are wanted.
//!
//! Opening it reads everything but the background and the finer levels of its pages. A page's rows follow each other in each
//! tensor, so that a page takes ten reads.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, Metadata, TensorInfo, TensorView};

use crate::error::{IoError, Place};
use crate::pages::{FINE, STAND_INS, is_of_pages};
use crate::scene_file::{page_table_of, scene_of};
use instgs_vk::scene::gaussians::{MAX_SH_DEGREE, sh_coefficients};
use instgs_vk::scene::lod::pages::{Page, PageTable};
use instgs_vk::scene::{Gaussians, InstancedScene, SourceRange};

/// The length of the header that a safetensors file begins with, and the longest header.
const LENGTH_BYTES: u64 = 8;
const LONGEST_HEADER: u64 = 100_000_000;

/// An open file with pages.
#[derive(Debug)]
pub struct PagedFile {
    path: PathBuf,
    file: File,
    /// The scene, with the stand-ins as its background; all parameters are finite.
    pub scene: InstancedScene,
    /// The pages of the background.
    pub table: PageTable,
    /// Length of the file in bytes.
    pub file_bytes: u64,
    full: CloudPlace,
    fine: CloudPlace,
}

/// Where the rows of a cloud are.
#[derive(Clone, Copy, Debug)]
struct CloudPlace {
    sh_degree: u32,
    rows: u64,
    means: Column,
    quats: Column,
    log_scales: Column,
    opacity_logits: Column,
    sh: Column,
}

/// Where the numbers of a tensor are.
#[derive(Clone, Copy, Debug)]
struct Column {
    /// Byte of the file at which it begins.
    begin: u64,
    half: bool,
    /// Numbers of a row.
    width: usize,
}

impl PagedFile {
    /// Opens a file; `None` if it is no `.instgs` with pages.
    ///
    /// # Errors
    /// The file cannot be read, or what is read of it is damaged.
    pub fn open(path: &Path) -> Result<Option<Self>, IoError> {
        if path.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("instgs")) {
            return Ok(None);
        }
        let fail = |e: std::io::Error| IoError::os(path, "cannot read", &e);
        // Opening a pipe might never end.
        let kind = std::fs::metadata(path).map_err(fail)?;
        if !kind.is_file() {
            return Ok(None);
        }
        let mut file = File::open(path).map_err(fail)?;
        let mut header = vec![0; LENGTH_BYTES as usize];
        if kind.len() < LENGTH_BYTES {
            return Ok(None);
        }
        file.read_exact(&mut header).map_err(fail)?;
        let length = u64::from_le_bytes(*header.first_chunk().unwrap_or(&[0; 8]));
        // What is damaged is for the reader of whole files to say.
        if length > LONGEST_HEADER.min(kind.len() - LENGTH_BYTES) {
            return Ok(None);
        }
        header.resize(length as usize, 0);
        file.read_exact(&mut header).map_err(fail)?;
        let Ok(metadata) = serde_json::from_slice::<Metadata>(&header) else { return Ok(None) };
        let tensors = metadata.tensors();
        if !tensors.keys().any(|name| is_of_pages(name)) {
            return Ok(None);
        }
        let data = LENGTH_BYTES + length;
        let end = tensors.values().map(|info| info.data_offsets.1 as u64).max().unwrap_or(0);
        let end = data.saturating_add(end);
        if kind.len() != end {
            let what = format!("has {} bytes, and its tensors end at {end}", kind.len());
            return Err(IoError::damaged(path, what));
        }
        let (full, fine) =
            (CloudPlace::of("background", &metadata, data, path)?, CloudPlace::of(FINE, &metadata, data, path)?);
        let is_paged = |name: &str| name.starts_with("background.") || name.starts_with(&format!("{FINE}."));
        let mut bytes: BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)> = BTreeMap::new();
        for (name, info) in tensors.iter().filter(|(name, _)| !is_paged(name)) {
            let (begin, end) = info.data_offsets;
            let mut content = vec![0; end.saturating_sub(begin)];
            file.seek(SeekFrom::Start(data + begin as u64)).map_err(fail)?;
            file.read_exact(&mut content).map_err(fail)?;
            // What stands in is the background of this scene.
            let name = match name.strip_prefix(&format!("{STAND_INS}.")) {
                Some(field) => format!("background.{field}"),
                None => name.clone(),
            };
            bytes.insert(name, (info.dtype, info.shape.clone(), content));
        }
        let (mut of_scene, mut of_pages) = (BTreeMap::new(), BTreeMap::new());
        for (name, (dtype, shape, content)) in &bytes {
            let view = TensorView::new(*dtype, shape.clone(), content).map_err(|e| {
                IoError::damaged(path, format!("does not hold what it says: {e}")).at(Place::Tensor(name.clone()))
            })?;
            if is_of_pages(name) { &mut of_pages } else { &mut of_scene }.insert(name.clone(), view);
        }
        let of_file = metadata.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
        let (mut scene, table) = (scene_of(of_scene, of_file, path)?, page_table_of(of_pages, path)?);
        let again = |what: String| Err(IoError::new(path, what).advise("write it again: instgs-vk export --pages"));
        if scene.drop_non_finite() > 0 {
            return again("has Gaussians with a number that is not finite, and pages of all of them".into());
        }
        scene.drop_stale_levels();
        let degrees = [scene.background.sh_degree, fine.sh_degree];
        if degrees != [full.sh_degree; 2] {
            return again(format!("has pages of SH degrees {degrees:?} and a background of {}", full.sh_degree));
        }
        let [of_blocks, of_levels, of_stand_ins] = table.rows();
        for (what, has, want) in [
            ("background", full.rows, of_blocks),
            (FINE, fine.rows, of_levels),
            (STAND_INS, scene.background.len() as u64, of_stand_ins),
        ] {
            if has != want {
                return again(format!("has {has} Gaussians of {what}, and pages of {want}"));
            }
        }
        Ok(Some(Self { path: path.to_owned(), file, scene, table, file_bytes: kind.len(), full, fine }))
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of Gaussians that are stored, levels aside.
    pub fn source_len(&self) -> u64 {
        (self.scene.source_len() - self.scene.background.len()) as u64 + self.full.rows
    }

    /// The Gaussians of a page: at full detail, then those of its finer levels.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(&mut self, page: &Page) -> Result<Gaussians, IoError> {
        let mut out = self.rows(self.full, page.full)?;
        out.append(&self.rows(self.fine, page.fine)?);
        Ok(out)
    }

    fn rows(&mut self, of: CloudPlace, range: SourceRange) -> Result<Gaussians, IoError> {
        Ok(Gaussians {
            sh_degree: of.sh_degree,
            means: self.column(of.means, range)?.as_chunks().0.to_vec(),
            quats: self.column(of.quats, range)?.as_chunks().0.to_vec(),
            log_scales: self.column(of.log_scales, range)?.as_chunks().0.to_vec(),
            opacity_logits: self.column(of.opacity_logits, range)?,
            sh: self.column(of.sh, range)?.as_chunks().0.to_vec(),
        })
    }

    fn column(&mut self, column: Column, range: SourceRange) -> Result<Vec<f32>, IoError> {
        let row_bytes = column.width * if column.half { 2 } else { 4 };
        let mut bytes = vec![0; range.count as usize * row_bytes];
        let at = column.begin + u64::from(range.first) * row_bytes as u64;
        let fail = |e: std::io::Error| IoError::os(&self.path, "cannot read", &e);
        self.file.seek(SeekFrom::Start(at)).map_err(fail)?;
        self.file.read_exact(&mut bytes).map_err(fail)?;
        Ok(if column.half {
            bytes.as_chunks().0.iter().map(|&b| half::f16::from_le_bytes(b).to_f32()).collect()
        } else {
            bytes.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect()
        })
    }
}

impl CloudPlace {
    fn of(group: &str, metadata: &Metadata, data: u64, path: &Path) -> Result<Self, IoError> {
        let error = |field: &str, what: String| IoError::new(path, what).at(Place::Tensor(format!("{group}.{field}")));
        let tensor = |field: &str| -> Result<&TensorInfo, IoError> {
            let info = metadata.info(&format!("{group}.{field}"));
            info.ok_or_else(|| error(field, "is missing, and the file has pages".into()))
        };
        let rows = tensor("means")?.shape.first().copied().unwrap_or(0);
        let column = |field: &str, inner: &[usize]| -> Result<Column, IoError> {
            let info = tensor(field)?;
            if info.shape.first() != Some(&rows) || info.shape[1..] != *inner {
                return Err(error(field, format!("has the shape {:?}, not {rows} rows of {inner:?}", info.shape)));
            }
            let half = match info.dtype {
                Dtype::F32 => false,
                Dtype::F16 => true,
                other => return Err(error(field, format!("has the type {other:?}, not F32 or F16"))),
            };
            let width = inner.iter().product();
            let (begin, end) = info.data_offsets;
            let row_bytes = width * if half { 2 } else { 4 };
            if end.checked_sub(begin) != rows.checked_mul(row_bytes) {
                return Err(error(field, format!("lies at bytes {begin} to {end}, which are not {rows} rows")));
            }
            Ok(Column { begin: data + begin as u64, half, width })
        };
        let coefficients = tensor("sh")?.shape.get(1).copied().unwrap_or(0);
        let sh_degree = (0..=MAX_SH_DEGREE).find(|&degree| sh_coefficients(degree) == coefficients);
        let sh_degree =
            sh_degree.ok_or_else(|| error("sh", format!("has {coefficients} coefficients, not 1, 4, 9 or 16")))?;
        Ok(Self {
            sh_degree,
            rows: rows as u64,
            means: column("means", &[3])?,
            quats: column("quats", &[4])?,
            log_scales: column("log_scales", &[3])?,
            opacity_logits: column("opacity_logits", &[])?,
            sh: column("sh", &[coefficients, 3])?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pack, read_scene_file, save_scene, write_scene_file_in_pages, write_scene_file_packed};
    use instgs_samples::{sample, with_levels};
    use instgs_vk::scene::lod::pages::PagedBackground;

    type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

    fn scene() -> InstancedScene {
        InstancedScene { background: sample(2, 9000), ..with_levels() }
    }

    #[test]
    fn pages_are_the_rows_of_the_background_and_its_levels() -> Result {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.instgs");
        for pack in [Pack::F32, Pack::F16, Pack::Q8] {
            write_scene_file_in_pages(&path, &scene(), pack)?;
            let mut file = PagedFile::open(&path)?.ok_or("no pages")?;
            // What any other reader makes of the file, and what it would be without pages.
            let whole = read_scene_file(&path)?;
            let paged = PagedBackground::of(&scene().background);
            let ordered = InstancedScene { background: paged.full.clone(), ..scene() };
            let plain = folder.path().join("plain.instgs");
            write_scene_file_packed(&plain, &ordered, pack)?;
            assert_eq!(whole, read_scene_file(&plain)?);
            assert_eq!(InstancedScene { background: whole.background.clone(), ..file.scene.clone() }, whole);
            assert_eq!(file.table, paged.table);
            assert_eq!(file.source_len(), whole.source_len() as u64);
            let pages = file.table.pages();
            assert!(pages.len() > 1);
            let mut fine = 0;
            for page in &pages {
                let rows = file.read(page)?;
                let full = rows.range(SourceRange { first: 0, count: page.full.count });
                assert_eq!(full, whole.background.range(page.full));
                assert_eq!(rows.means[page.full.count as usize..], paged.fine.range(page.fine).means);
                fine += page.fine.count;
            }
            assert_eq!((fine as usize, file.scene.background.len()), (paged.fine.len(), paged.stand_ins.len()));
        }
        assert!(write_scene_file_in_pages(&path, &scene(), Pack::Small).is_err());
        Ok(())
    }

    #[test]
    fn files_without_pages_are_none() -> Result {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.instgs");
        save_scene(&path, &scene())?;
        assert!(PagedFile::open(&path)?.is_none());
        for bytes in [&b""[..], b"12345678", b"\xff\xff\xff\xff\xff\xff\xff\x7f{}"] {
            std::fs::write(&path, bytes)?;
            assert!(PagedFile::open(&path)?.is_none());
        }
        assert!(PagedFile::open(folder.path())?.is_none());
        assert!(PagedFile::open(&folder.path().join("b.ply"))?.is_none());
        assert!(PagedFile::open(&folder.path().join("missing.instgs")).is_err());
        Ok(())
    }

    #[test]
    fn damaged_files_are_errors() -> Result {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.instgs");
        write_scene_file_in_pages(&path, &scene(), Pack::F16)?;
        let good = std::fs::read(&path)?;
        std::fs::write(&path, &good[..good.len() - 1])?;
        let message = PagedFile::open(&path).err().ok_or("opened")?.to_string();
        assert!(message.contains("its tensors end at"), "{message}");
        // Another block of the name of a tensor, and of the type of another.
        for (from, to, part) in [
            ("page.levels", "page.levelz", "page.levelz"),
            ("page_fine.sh", "page_fine.hs", "page_fine.sh"),
            ("background.means", "background.snaem", "background.means"),
            ("page.level_cells", "page.level_coded", "page.level_coded"),
        ] {
            let mut bytes = good.clone();
            let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).ok_or("not there")?;
            bytes[at..at + from.len()].copy_from_slice(to.as_bytes());
            std::fs::write(&path, &bytes)?;
            let message = PagedFile::open(&path).err().ok_or("opened")?.to_string();
            assert!(message.contains(part), "{from}: {message}");
        }
        Ok(())
    }
}
