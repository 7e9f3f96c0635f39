//! An order of Gaussians that is fast to draw.

use crate::math::morton::morton_order;
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::InstancedScene;

impl InstancedScene {
    /// Sorts the background along a Morton curve: its chunks get small, so that more of them are out of sight, and splats that are
    /// blended together lie together in memory. Trained clouds have the order in which their Gaussians were made. Templates are
    /// in this order already.
    ///
    /// The picture is the same, but where Gaussians have equal depths to the bit: the first of the scene is in front. A scene with
    /// foreign tensors stays as it is, since they may be parallel to the background.
    pub fn order_background(&mut self) {
        if !self.foreign_tensors.is_empty() {
            return;
        }
        let order = morton_order(&self.background.means);
        self.background.reorder(&order);
    }
}

impl Gaussians {
    /// Brings the Gaussians into an order: indices of before, each once.
    pub fn reorder(&mut self, order: &[u32]) {
        let coefficients = self.sh_coefficients();
        permute(&mut self.means, order, 1);
        permute(&mut self.quats, order, 1);
        permute(&mut self.log_scales, order, 1);
        permute(&mut self.opacity_logits, order, 1);
        permute(&mut self.sh, order, coefficients);
    }
}

/// Brings rows of `width` values into an order.
fn permute<T: Copy>(values: &mut Vec<T>, order: &[u32], width: usize) {
    let row = |i: u32| &values[i as usize * width..][..width];
    *values = order.iter().flat_map(|&i| row(i)).copied().collect();
}

#[cfg(test)]
mod tests {
    use crate::math::rng::Rng;
    use crate::scene::instanced_scene::ForeignTensor;
    use crate::scene::{Gaussians, InstancedScene};

    fn cloud() -> Gaussians {
        let mut rng = Rng::new(1);
        let mut cloud = Gaussians::with_capacity(1, 500);
        for i in 0..500 {
            cloud.means.push([0; 3].map(|_| rng.range(-1.0, 1.0) as f32));
            cloud.quats.push([i as f32, 1.0, 2.0, 3.0]);
            cloud.log_scales.push([-(i as f32), 0.0, 1.0]);
            cloud.opacity_logits.push(i as f32);
            (0..4).for_each(|c| cloud.sh.push([i as f32, c as f32, 0.5]));
        }
        cloud
    }

    /// Sum of distances between neighbours in the order.
    fn length(cloud: &Gaussians) -> f32 {
        cloud.means.windows(2).map(|m| (0..3).map(|k| (m[0][k] - m[1][k]).powi(2)).sum::<f32>().sqrt()).sum()
    }

    #[test]
    fn neighbours_come_together_and_rows_stay_whole() {
        let before = cloud();
        let mut scene = InstancedScene::from_cloud(before.clone());
        scene.order_background();
        let after = &scene.background;
        assert!(length(after) < 0.4 * length(&before), "{} of {}", length(after), length(&before));
        let mut seen = vec![false; before.len()];
        for i in 0..after.len() {
            let was = after.opacity_logits[i] as usize;
            assert!(!std::mem::replace(&mut seen[was], true));
            let of = |cloud: &Gaussians, i: usize| {
                (cloud.means[i], cloud.quats[i], cloud.log_scales[i], cloud.sh_of(i).to_vec())
            };
            assert_eq!(of(after, i), of(&before, was));
        }
        assert_eq!(after.sh.len(), before.sh.len());
    }

    #[test]
    fn foreign_tensors_keep_their_rows() {
        let foreign = ForeignTensor { dtype: "U8".into(), shape: vec![500], bytes: vec![0; 500] };
        let mut scene = InstancedScene::from_cloud(cloud());
        scene.foreign_tensors.insert("labels".into(), foreign);
        let before = scene.clone();
        scene.order_background();
        assert_eq!(scene, before);
    }
}
