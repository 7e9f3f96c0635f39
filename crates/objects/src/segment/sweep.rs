//! Contributions of all views of a cloud. They are rendered on first use and kept within a memory budget: later sweeps
//! render only the views beyond it. The result does not depend on the budget.

use std::sync::Arc;

use instgs_io::masks::Mask;
use instgs_vk::gpu::Gpu;
use instgs_vk::render::{Contribution, ContributionRenderer, RenderError, RenderOptions};
use instgs_vk::scene::{Camera, InstancedScene};

use super::error::SegmentError;

/// Default memory budget, bytes. A view takes ten bytes for each pair of a Gaussian and a mask that meet in it: this
/// holds 200 views of 200,000 Gaussians, and is a quarter of what training such a scene takes.
pub const KEPT_BYTES: u64 = 512 << 20;

/// One view of a sweep.
#[derive(Clone, Copy, Debug)]
pub struct ViewEntries<'a> {
    /// Index of the view in the cameras.
    pub view: usize,
    /// Camera of the view, at the size that was rendered.
    pub camera: &'a Camera,
    /// Ids present in the view's mask, ascending, without 0; empty without a mask.
    pub ids: &'a [u16],
    /// Sorted by Gaussian, then by id; all of id 0 without a mask.
    pub contributions: &'a [Contribution],
}

/// Gives the mask of a view by index, or `None` if it has none.
type MaskOfView<'a, E> = Box<dyn FnMut(usize) -> Result<Option<Mask>, E> + 'a>;

/// Sweeps over the views of a plain cloud; `E` is the error type of the masks' source.
pub struct ViewContributions<'a, E> {
    renderer: ContributionRenderer,
    render: RenderOptions,
    cameras: &'a [Camera],
    mask_of_view: MaskOfView<'a, E>,
    budget_bytes: u64,
    kept_bytes: u64,
    rendered: usize,
    /// Contributions of each view that fitted the budget.
    kept: Vec<Option<Kept>>,
}

impl<'a, E: From<SegmentError>> ViewContributions<'a, E> {
    /// Prepares sweeps over the `cameras` of a plain cloud, rendered as it was trained. `mask_of_view` gives the mask
    /// of a view by its index in `cameras`, or `None` if it has none; it is called again in later sweeps for views
    /// beyond `budget_bytes`. A mask of another size than the camera is resized.
    ///
    /// # Errors
    /// A cloud that has instances or does not fit on the device.
    pub fn new(
        gpu: &Arc<Gpu>,
        cloud: &InstancedScene,
        cameras: &'a [Camera],
        mask_of_view: impl FnMut(usize) -> Result<Option<Mask>, E> + 'a,
        render: RenderOptions,
        budget_bytes: u64,
    ) -> Result<Self, SegmentError> {
        let renderer = ContributionRenderer::new(gpu, cloud).map_err(SegmentError::Cloud)?;
        let kept = cameras.iter().map(|_| None).collect();
        let mask_of_view = Box::new(mask_of_view);
        Ok(Self { renderer, render, cameras, mask_of_view, budget_bytes, kept_bytes: 0, rendered: 0, kept })
    }

    /// Number of views in a sweep.
    pub fn view_count(&self) -> usize {
        self.cameras.len()
    }

    /// Size of the contributions in memory, bytes.
    pub fn kept_bytes(&self) -> u64 {
        self.kept_bytes
    }

    /// Number of views rendered so far, including those rendered again by later sweeps.
    pub fn rendered(&self) -> usize {
        self.rendered
    }

    /// Calls `visit` for every view, in order.
    ///
    /// # Errors
    /// A camera that cannot be rendered; a mask whose number of ids is not its size; errors of `visit` and
    /// `mask_of_view`.
    pub fn for_each(&mut self, mut visit: impl FnMut(ViewEntries<'_>) -> Result<(), E>) -> Result<(), E> {
        let cameras = self.cameras;
        for (view, camera) in cameras.iter().enumerate() {
            if let Some(kept) = &self.kept[view] {
                let contributions = kept.contributions.expand();
                visit(ViewEntries { view, camera, ids: &kept.ids, contributions: &contributions })?;
                continue;
            }
            let (ids, contributions) = self.render(view, camera)?;
            visit(ViewEntries { view, camera, ids: &ids, contributions: &contributions })?;
            self.keep(view, ids, &contributions);
        }
        Ok(())
    }

    /// Ids and contributions of a view. A view without a mask has no ids, but still tells which Gaussians are seen.
    fn render(&mut self, view: usize, camera: &Camera) -> Result<(Vec<u16>, Vec<Contribution>), E> {
        let invalid = |reason| SegmentError::View { view: camera.name.clone(), error: RenderError::Camera(reason) };
        camera.validate().map_err(invalid)?;
        let none = || Mask { width: camera.width, height: camera.height, ids: vec![0; pixels(camera)] };
        let mask = fitted((self.mask_of_view)(view)?.unwrap_or_else(none), camera)?;
        let failed = |error| SegmentError::View { view: camera.name.clone(), error };
        let (contributions, _) = self.renderer.contributions(camera, &self.render, &mask.ids).map_err(failed)?;
        self.rendered += 1;
        Ok((mask.ids_present().into_keys().collect(), contributions))
    }

    fn keep(&mut self, view: usize, ids: Vec<u16>, contributions: &[Contribution]) {
        let left = self.budget_bytes - self.kept_bytes;
        // Not worth packing if it cannot fit.
        if contributions.len() as u64 * Packed::ENTRY_BYTES > left {
            return;
        }
        let contributions = Packed::new(contributions);
        if contributions.bytes() <= left {
            self.kept_bytes += contributions.bytes();
            self.kept[view] = Some(Kept { ids, contributions });
        }
    }
}

fn pixels(camera: &Camera) -> usize {
    camera.width as usize * camera.height as usize
}

/// The mask, resized to the camera's picture if needed.
fn fitted(mask: Mask, camera: &Camera) -> Result<Mask, SegmentError> {
    let (width, height) = (mask.width, mask.height);
    if mask.ids.len() as u64 != u64::from(width) * u64::from(height) {
        return Err(SegmentError::Mask { view: camera.name.clone(), len: mask.ids.len(), width, height });
    }
    let fits = (width, height) == (camera.width, camera.height);
    Ok(if fits { mask } else { mask.resized(camera.width, camera.height) })
}

/// Ids and contributions of one view in memory.
struct Kept {
    ids: Vec<u16>,
    contributions: Packed,
}

/// Contributions of a view in ten bytes each; a [`Contribution`] takes sixteen.
struct Packed {
    gaussians: Vec<u32>,
    ids: Vec<u16>,
    /// Low 32 bits of the weights; the high 32 are 0 up to 256 pixels.
    weights: Vec<u32>,
    /// Index and high 32 bits of the weights where those are not 0; ascending.
    high_weights: Vec<(usize, u32)>,
}

impl Packed {
    const ENTRY_BYTES: u64 = (size_of::<u32>() + size_of::<u16>() + size_of::<u32>()) as u64;

    fn new(contributions: &[Contribution]) -> Self {
        let high = |(i, c): (usize, &Contribution)| Some((i, (c.weight >> 32) as u32)).filter(|(_, high)| *high > 0);
        Self {
            gaussians: contributions.iter().map(|c| c.gaussian).collect(),
            ids: contributions.iter().map(|c| c.id).collect(),
            weights: contributions.iter().map(|c| c.weight as u32).collect(),
            high_weights: contributions.iter().enumerate().filter_map(high).collect(),
        }
    }

    fn bytes(&self) -> u64 {
        let high = self.high_weights.len() * size_of::<(usize, u32)>();
        self.gaussians.len() as u64 * Self::ENTRY_BYTES + high as u64
    }

    fn expand(&self) -> Vec<Contribution> {
        let entries = self.gaussians.iter().zip(&self.ids).zip(&self.weights);
        let entry =
            |((&gaussian, &id), &low): ((&u32, &u16), &u32)| Contribution { gaussian, id, weight: u64::from(low) };
        let mut out: Vec<Contribution> = entries.map(entry).collect();
        for &(i, high) in &self.high_weights {
            out[i].weight += u64::from(high) << 32;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packing_loses_nothing() {
        let weights = [1, u64::from(u32::MAX), 1 << 32, (7 << 32) + 3, 1 << 53];
        let entry = |(i, &weight): (usize, &u64)| Contribution {
            gaussian: u32::MAX - i as u32,
            id: u16::MAX - i as u16,
            weight,
        };
        let contributions: Vec<Contribution> = weights.iter().enumerate().map(entry).collect();
        let packed = Packed::new(&contributions);
        assert_eq!(packed.expand(), contributions);
        assert_eq!((packed.bytes(), packed.high_weights.len()), (5 * 10 + 3 * 16, 3));
        assert_eq!(Packed::new(&[]).expand(), []);
    }
}
