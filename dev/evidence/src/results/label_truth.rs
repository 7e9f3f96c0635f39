//! True labels of a cloud's Gaussians for data sets with depth: the object at the nearest point of the true surfaces.

use std::path::Path;

use glam::Vec3;

use instgs_io::ktx2::read_ktx2;
use instgs_io::{IoError, MaskFolder, View};
use instgs_objects::pipeline::CloudLabels;
use instgs_objects::segment::accuracy::{in_ids_of, mean_accuracy};
use instgs_synth::dataset::frame::Lens;
use instgs_vk::math::nearest::PointSet;

/// Every how many pixels of a depth image a point is taken, in both directions: neighbours show the same object.
const STRIDE: usize = 2;
/// Gaussians with a smaller contribution over all pictures, pixels, are not judged: no picture shows where they belong.
const SEEN_PX: f32 = 1.0;

/// Mean accuracy of the labels of a cloud with the means `means`, over the objects of the data set; `None` if the data
/// set has no depth images.
///
/// # Errors
/// An image that cannot be read, or whose size is not that of its mask and camera.
pub fn label_accuracy(
    data: &Path,
    views: &[View],
    masks: &MaskFolder,
    means: &[[f32; 3]],
    labels: &CloudLabels,
) -> Result<Option<f64>, IoError> {
    let depth = data.join("depth");
    if !depth.is_dir() {
        return Ok(None);
    }
    let (mut places, mut ids) = (Vec::new(), Vec::new());
    for view in views {
        let Some(mask) = masks.of_view(view)? else { continue };
        let name = Path::new(&view.camera.name).with_extension("ktx2");
        let picture = read_ktx2(&depth.join(name))?;
        let size = (picture.width, picture.height);
        if size != (mask.width, mask.height) || size != (view.camera.width, view.camera.height) {
            let what = format!("is {}x{}, but its mask or camera has another size", size.0, size.1);
            return Err(IoError::new(&depth.join(&view.camera.name), what));
        }
        let lens = Lens::new(&view.camera);
        let width = picture.width as usize;
        for i in 0..picture.values.len() {
            let (x, y, z) = (i % width, i / width, picture.values[i]);
            if x % STRIDE != 0 || y % STRIDE != 0 || z <= 0.0 {
                continue;
            }
            let ray = lens.ray(x as f64 + 0.5, y as f64 + 0.5);
            let place: Vec3 = ray.origin + ray.direction * z;
            places.push(place.to_array());
            ids.push(u32::from(mask.ids[i]));
        }
    }
    let surface = PointSet::new(&places);
    let (mut truth, mut judged) = (Vec::new(), Vec::new());
    for (i, mean) in means.iter().enumerate().filter(|(i, _)| labels.weights_px[*i] > SEEN_PX) {
        let nearest = surface.nearest_one(*mean);
        truth.push(nearest.map_or(0, |n| ids[n.index as usize]));
        judged.push(labels.labels[i]);
    }
    Ok(Some(mean_accuracy(&truth, &in_ids_of(&truth, &judged))))
}
