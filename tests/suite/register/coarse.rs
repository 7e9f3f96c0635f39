//! Objects of few Gaussians, as short training leaves them.

use glam::{DMat3, DVec3, Vec3};
use instgs_objects::register::{RegisterOptions, Registered};
use instgs_vk::math::covariance::quat_from_rotation;
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::Gaussians;

use super::labelled::{Labelled, Recipe};

/// How an object is made coarse: into how many Gaussians, and how.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Coarse {
    /// Each stands for the points nearest to it, with their mean and spread.
    Merged(usize),
    /// Some of the points, wider; and as many faint ones that are off.
    Sampled(usize),
}

impl Labelled {
    /// The same scene with few Gaussians for each object.
    fn coarse(&self, how: Coarse, seed: u64) -> Self {
        let (mut cloud, mut labels) = (Gaussians::with_capacity(0, 0), Vec::new());
        let mut rng = Rng::new(seed).fork(0xC0A5);
        for &id in self.categories.keys() {
            let own: Vec<usize> = (0..self.labels.len()).filter(|&i| self.labels[i] == id).collect();
            match how {
                Coarse::Merged(count) => self.push_merged(&own, count, &mut cloud, &mut rng),
                Coarse::Sampled(count) => self.push_sampled(&own, count, &mut cloud, &mut rng),
            }
            labels.resize(cloud.len(), id);
        }
        let (categories, cameras, truth) = (self.categories.clone(), self.cameras.clone(), self.truth.clone());
        Self { cloud, labels, categories, cameras, truth }
    }

    fn place(&self, i: usize) -> DVec3 {
        Vec3::from(self.cloud.means[i]).as_dvec3()
    }

    fn drawn(own: &[usize], count: usize, rng: &mut Rng) -> Vec<usize> {
        let mut order = own.to_vec();
        rng.shuffle(&mut order);
        order.truncate(count);
        order
    }

    fn push_merged(&self, own: &[usize], count: usize, cloud: &mut Gaussians, rng: &mut Rng) {
        let centres = Self::drawn(own, count, rng);
        let mut parts = vec![Vec::new(); centres.len()];
        for &i in own {
            let distance = |c: &usize| self.place(centres[*c]).distance_squared(self.place(i));
            let nearest = (0..centres.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            parts[nearest].push(i);
        }
        for part in parts.iter().filter(|part| !part.is_empty()) {
            let mean = part.iter().map(|&i| self.place(i)).sum::<DVec3>() / part.len() as f64;
            let mut moments = [[0.0; 3]; 3];
            for d in part.iter().map(|&i| self.place(i) - mean) {
                (0..9).for_each(|k| moments[k / 3][k % 3] += d[k / 3] * d[k % 3] / part.len() as f64);
            }
            let [thin, middle, long] = symmetric_eigen(moments);
            let axes = [long, middle, thin].map(|(_, v)| DVec3::from_array(v));
            let rotation = DMat3::from_cols(axes[0], axes[1], axes[0].cross(axes[1]));
            let scale = |pair: (f64, [f64; 3])| pair.0.max(1e-10).sqrt().ln() as f32;
            cloud.means.push(mean.as_vec3().to_array());
            cloud.quats.push(quat_from_rotation(rotation).map(|q| q as f32));
            cloud.log_scales.push([scale(long), scale(middle), scale(thin)]);
            cloud.opacity_logits.push(rng.range(0.5, 3.0) as f32);
            cloud.sh.push(self.cloud.sh[part[0]]);
        }
    }

    fn push_sampled(&self, own: &[usize], count: usize, cloud: &mut Gaussians, rng: &mut Rng) {
        let drawn = Self::drawn(own, 2 * count, rng);
        // As wide as to cover what the left out ones did.
        let wider = (own.len() as f64 / count as f64).sqrt().ln().min(2.0) as f32;
        let (low, high) = own.iter().fold((self.place(own[0]), self.place(own[0])), |(low, high), &i| {
            (low.min(self.place(i)), high.max(self.place(i)))
        });
        for (k, &i) in drawn.iter().enumerate() {
            let faint = k >= count;
            let off = if faint { 0.01 * low.distance(high) } else { 0.0 } * rng.normal_vector();
            cloud.means.push((self.place(i) + off).as_vec3().to_array());
            cloud.quats.push(self.cloud.quats[i]);
            cloud.log_scales.push(self.cloud.log_scales[i].map(|s| s + wider));
            cloud.opacity_logits.push(if faint { -1.3 } else { rng.range(0.0, 3.0) as f32 });
            cloud.sh.push(self.cloud.sh[i]);
        }
    }
}

/// What comes of coarse objects of a scene.
pub(crate) fn of_coarse(recipe: Recipe, how: Coarse) -> (Labelled, Registered) {
    let labelled = recipe.labelled().coarse(how, recipe.seed);
    let found = labelled.register(&RegisterOptions::default()).unwrap();
    (labelled, found)
}
