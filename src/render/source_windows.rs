//! Scenes whose arrays of source Gaussians are larger than a binding: kernels see them in windows, one dispatch each.
//!
//! A work-group handles one chunk, and a chunk belongs to the window in which it begins. Windows overlap by a chunk, so that
//! all of it can be seen.

use std::ops::Range;

use crate::gpu::interface::types;
use crate::gpu::{Buffer, BufferPart};
use crate::scene::parameters::Rows;
use crate::scene::{Owner, Parameter, ParameterSet};

/// Windows begin at multiples of as many rows: then parts of buffers begin at multiples of `PART_ALIGNMENT` bytes, since the
/// rows of all arrays have an even number of bytes.
const ROW_ALIGNMENT: u32 = 128;

/// The windows of a scene: runs of the same number of source Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct SourceWindows {
    /// Rows of source Gaussians of posed clouds and background, by SH band from 0.
    bands: [[u32; 2]; 4],
    /// Source Gaussians of a window.
    each: u32,
    /// Gaussians that a window shows beyond its own: those of the chunk that begins last.
    overlap: u32,
}

/// One window.
#[derive(Clone, Copy, Debug)]
pub struct SourceWindow {
    /// What kernels know of it.
    pub shown: types::SourceWindow,
    /// By SH band from 0, which has a row for every source Gaussian as all other arrays have: the end of the rows that it shows.
    ends: [u32; 4],
}

impl SourceWindows {
    /// The windows for arrays with `rows` rows, of which the widest have `row_bytes` bytes, on a device whose bindings have at
    /// most `binding_bytes`; `None` if there is no room for two chunks of `chunk_size` Gaussians.
    pub fn new(rows: &ParameterSet<Rows>, row_bytes: u64, binding_bytes: u64, chunk_size: u32) -> Option<Self> {
        let bands = [Parameter::Sh0, Parameter::Sh1, Parameter::Sh2, Parameter::Sh3];
        let bands = bands.map(|band| rows[band].map(|rows| rows as u32));
        let shown = u32::try_from(binding_bytes / row_bytes).unwrap_or(u32::MAX);
        let total = bands[0][0] + bands[0][1];
        // Rows of bands begin up to a multiple earlier.
        let each = if total <= shown { total } else { shown.checked_sub(chunk_size + ROW_ALIGNMENT)? };
        let each = if total <= shown { each.max(1) } else { each / ROW_ALIGNMENT * ROW_ALIGNMENT };
        (each > 0).then_some(Self { bands, each, overlap: chunk_size })
    }

    /// Number of source Gaussians.
    fn total(&self) -> u32 {
        self.bands[0][0] + self.bands[0][1]
    }

    /// True if there are several.
    pub fn are_several(&self) -> bool {
        self.total() > self.each
    }

    /// The windows in order; one with everything if the arrays fit.
    pub fn iter(&self) -> impl Iterator<Item = SourceWindow> + use<'_> {
        let count = if self.are_several() { self.total().div_ceil(self.each) } else { 1 };
        (0..count).map(|k| self.window(k * self.each))
    }

    fn window(&self, first: u32) -> SourceWindow {
        let end = self.total().min(first.saturating_add(self.each).saturating_add(self.overlap));
        let begin_of = |band: usize| self.row(band, first) / ROW_ALIGNMENT * ROW_ALIGNMENT;
        SourceWindow {
            shown: types::SourceWindow { first, count: self.each, first_in_band: [1, 2, 3].map(begin_of) },
            ends: [0, 1, 2, 3].map(|band| self.row(band, end)),
        }
    }

    /// The first row of an SH band that belongs to no Gaussian before `source`.
    fn row(&self, band: usize, source: u32) -> u32 {
        let [posed, background] = self.bands[band];
        let posed_sources = self.bands[0][0];
        source.min(posed_sources).min(posed) + source.saturating_sub(posed_sources).min(background)
    }
}

impl SourceWindow {
    /// True if the SH bands up to `sh_degree` begin with the rows of its first Gaussian, as where all clouds have these bands.
    pub fn bands_begin_alike(&self, sh_degree: u32) -> bool {
        self.shown.first_in_band.iter().take(sh_degree as usize).all(|&row| row == self.shown.first)
    }

    /// The rows that it shows of a parameter of source Gaussians.
    fn rows(&self, parameter: Parameter) -> Range<u32> {
        let begins =
            [self.shown.first, self.shown.first_in_band[0], self.shown.first_in_band[1], self.shown.first_in_band[2]];
        let band = if let Owner::ShBand(l) = parameter.owner() { l as usize } else { 0 };
        begins[band]..self.ends[band]
    }

    /// What it shows of a buffer whose rows have `row_bytes` bytes and belong to source Gaussians as those of `parameter` do.
    pub fn part<T: bytemuck::NoUninit>(&self, buffer: &Buffer<T>, parameter: Parameter, row_bytes: u64) -> BufferPart {
        let rows = self.rows(parameter);
        buffer.part(u64::from(rows.start) * row_bytes, u64::from(rows.end) * row_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::source_layout::CloudSize;

    fn windows(clouds: [CloudSize; 2], shown: u64) -> Option<SourceWindows> {
        let rows = ParameterSet::from_fn(|parameter| parameter.source_rows(clouds).unwrap_or([0, 0]));
        SourceWindows::new(&rows, 84, 84 * shown, 32)
    }

    fn cloud(len: usize, sh_degree: u32) -> CloudSize {
        CloudSize { len, sh_degree }
    }

    #[test]
    fn what_fits_is_one_window() {
        for (posed, background) in [(0, 0), (0, 1000), (1000, 0), (400, 600)] {
            let windows = windows([cloud(posed, 1), cloud(background, 3)], 1000).unwrap();
            assert!(!windows.are_several());
            let all: Vec<SourceWindow> = windows.iter().collect();
            assert_eq!(all.len(), 1);
            assert_eq!((all[0].shown.first, all[0].rows(Parameter::Means)), (0, 0..(posed + background) as u32));
            assert_eq!(all[0].rows(Parameter::Sh2), 0..background as u32);
        }
    }

    /// Every chunk belongs to one window, which has room for what it shows, and shows all rows of the chunk.
    #[test]
    fn windows_show_their_chunks_and_fit() {
        for clouds in
            [[cloud(700, 3), cloud(1900, 3)], [cloud(700, 0), cloud(1900, 3)], [cloud(1500, 3), cloud(900, 1)]]
        {
            let windows = windows(clouds, 1000).unwrap();
            assert!(windows.are_several());
            let all: Vec<SourceWindow> = windows.iter().collect();
            let posed = clouds[0].len as u32;
            let chunks = (0..posed).step_by(32).chain((posed..posed + clouds[1].len as u32).step_by(32));
            for chunk in chunks {
                let owners = all.iter().filter(|w| chunk.wrapping_sub(w.shown.first) < w.shown.count);
                let [owner] = owners.collect::<Vec<_>>()[..] else { panic!("chunk {chunk}") };
                let cloud = usize::from(chunk >= posed);
                let end = (chunk + 32).min(if cloud == 0 { posed } else { posed + clouds[1].len as u32 });
                let sources = owner.rows(Parameter::LogScales);
                assert!(sources.start <= chunk && end <= sources.end, "{sources:?}");
                for (l, band) in [(1, Parameter::Sh1), (2, Parameter::Sh2), (3, Parameter::Sh3)] {
                    let first = match cloud {
                        1 if clouds[0].sh_degree < l => 0,
                        1 => posed,
                        _ => 0,
                    };
                    let rows = owner.rows(band);
                    let own = first + chunk - if cloud == 1 { posed } else { 0 }
                        ..first + end - if cloud == 1 { posed } else { 0 };
                    let shows = rows.start <= own.start && own.end <= rows.end;
                    assert!(shows || clouds[cloud].sh_degree < l, "{rows:?} {own:?}");
                }
            }
            for window in &all {
                for parameter in [Parameter::Means, Parameter::Sh1, Parameter::Sh2, Parameter::Sh3] {
                    let rows = window.rows(parameter);
                    assert!(rows.len() <= 1000 && rows.start.is_multiple_of(ROW_ALIGNMENT), "{rows:?}");
                }
            }
        }
    }

    #[test]
    fn there_is_room_for_at_least_a_chunk() {
        let cloud = [cloud(0, 0), cloud(5000, 3)];
        assert!(windows(cloud, 32 + 127 + 128).is_none());
        assert_eq!(windows(cloud, 32 + 128 + 128).map(|w| w.iter().count()), Some(5000usize.div_ceil(128)));
    }
}
