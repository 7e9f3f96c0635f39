//! Expands an instanced scene into a plain cloud that renders to the same image: Eq. 6 of the InstGS paper.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::DVec3;

use crate::math::covariance::{normalised_quat, quat_from_rotation, quat_multiply};
use crate::math::sh::{SH_C0, ShRotation, widened};
use crate::math::similarity::Similarity;
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::{ColorMatrix, Instance, InstancedScene, SAME_COLOR, SourceRange};
use crate::scene::offsets::Offsets;

impl InstancedScene {
    /// Every instance's Gaussians in the world frame, in flat order: instances in file order, each in template order and
    /// then its own, then the background. The SH degree is the scene's; SH is rotated exactly. Computed in f64 and rounded once to
    /// f32.
    ///
    /// The scene must be valid (`validate`), so that an instance's linear part is a similarity s R. Quaternions of
    /// instances are normalised; the background is copied bit by bit.
    pub fn flatten(&self) -> Gaussians {
        self.flatten_where(|_, _| true)
    }

    /// The same without what instances hide (see [`InstancedScene::hides`]): the same picture, but not the flat order.
    pub fn flatten_shown(&self) -> Gaussians {
        self.flatten_where(|instance, local| !self.hides(instance, local))
    }

    /// The Gaussians of instances for whose template's `is_kept` is true, and what is no template's.
    fn flatten_where(&self, is_kept: impl Fn(&Instance, u32) -> bool) -> Gaussians {
        let capacity = usize::try_from(self.expanded_len()).unwrap_or(0);
        let mut world = Gaussians::with_capacity(self.sh_degree(), capacity);
        for (k, instance) in self.instances.iter().enumerate() {
            self.flatten_instance(instance, self.color_matrix(k), &is_kept, &mut world);
            self.flatten_own(instance, self.own_range(k), &mut world);
        }
        world.append(&self.background);
        world
    }

    /// What instance `k` shows, in the world frame: its template's Gaussians with its offsets and colours, then its own. The SH degree
    /// is that of the templates.
    pub fn flatten_one(&self, k: usize) -> Gaussians {
        let mut world = Gaussians::with_capacity(self.templates.sh_degree, 0);
        self.flatten_instance(&self.instances[k], self.color_matrix(k), &|_, _| true, &mut world);
        self.flatten_own(&self.instances[k], self.own_range(k), &mut world);
        world
    }

    /// The same pictures without colour matrices, for files that have none: they go into offsets. Instances that share offsets and
    /// have the same matrix share a run of these, and those that look like their template still have none. The scene itself if it
    /// has no matrices.
    pub fn with_colors_in_offsets(&self) -> Cow<'_, InstancedScene> {
        if self.color_from_template.is_empty() {
            return Cow::Borrowed(self);
        }
        let mut offsets = Offsets::default();
        let mut instances = self.instances.clone();
        let mut runs = BTreeMap::new();
        for (instance, matrix) in instances.iter_mut().zip(&self.color_from_template) {
            if instance.first_offset.is_none() && *matrix == SAME_COLOR {
                continue;
            }
            let bits = matrix.map(|row| row.map(f32::to_bits));
            let first = *runs.entry((instance.template, instance.first_offset, bits)).or_insert_with(|| {
                let first = offsets.len() as u32;
                self.push_colored(instance, matrix, &mut offsets);
                first
            });
            instance.first_offset = Some(first);
        }
        Cow::Owned(InstancedScene { instances, offsets, color_from_template: Vec::new(), ..self.clone() })
    }

    /// Appends the offsets of an instance, with which its Gaussians have the colours that its matrix gives them.
    fn push_colored(&self, instance: &Instance, matrix: &ColorMatrix, offsets: &mut Offsets) {
        let old = &self.offsets;
        let range = self.template_ranges[instance.template as usize];
        for local in 0..range.count as usize {
            let (i, record) = (range.first as usize + local, instance.first_offset.map(|f| f as usize + local));
            let shown = Local::shown(self, instance, Some(matrix), local).sh;
            let template = self.templates.sh_of(i);
            let mut difference = shown.iter().zip(template).map(|(own, &shared)| narrowed(*own - widened(shared)));
            offsets.means.push(record.map_or([0.0; 3], |m| old.means[m]));
            offsets.opacity_logits.push(record.map_or(0.0, |m| old.opacity_logits[m]));
            offsets.sh_dc.extend(difference.next());
            offsets.sh_rest.extend(difference);
            if !old.log_scales.is_empty() {
                offsets.log_scales.push(record.map_or([0.0; 3], |m| old.log_scales[m]));
            }
            if !old.quats.is_empty() {
                offsets.quats.push(record.map_or([0.0; 4], |m| old.quats[m]));
            }
        }
    }

    /// Appends the Gaussians that an instance has of its template and keeps to `world`.
    fn flatten_instance(
        &self,
        instance: &Instance,
        color_matrix: Option<&ColorMatrix>,
        is_kept: &impl Fn(&Instance, u32) -> bool,
        world: &mut Gaussians,
    ) {
        let to_world = ToWorld::new(&instance.world_from_template);
        let kept =
            (0..self.template_ranges[instance.template as usize].count).filter(|&local| is_kept(instance, local));
        kept.for_each(|local| to_world.push(Local::shown(self, instance, color_matrix, local as usize), world));
    }

    /// Appends the Gaussians that an instance has of its own to `world`.
    fn flatten_own(&self, instance: &Instance, range: SourceRange, world: &mut Gaussians) {
        let to_world = ToWorld::new(&instance.world_from_template);
        range.indices().for_each(|i| to_world.push(Local::of(&self.own, i), world));
    }
}

impl Gaussians {
    /// The cloud in the frame that a similarity maps it to, SH included; as it is if that is its own.
    pub fn placed(self, world_from_cloud: Similarity) -> Self {
        if world_from_cloud == Similarity::IDENTITY {
            return self;
        }
        let scene = InstancedScene {
            template_ranges: vec![SourceRange { first: 0, count: self.len() as u32 }],
            templates: self,
            instances: vec![Instance { template: 0, world_from_template: world_from_cloud, first_offset: None }],
            ..InstancedScene::default()
        };
        scene.flatten()
    }
}

/// A Gaussian in the frame of a template, in f64.
pub(crate) struct Local {
    mean: DVec3,
    quat: [f64; 4],
    log_scales: DVec3,
    logit: f64,
    sh: Vec<DVec3>,
}

impl Local {
    fn of(cloud: &Gaussians, i: usize) -> Self {
        Self {
            mean: widened(cloud.means[i]),
            quat: cloud.quats[i].map(f64::from),
            log_scales: widened(cloud.log_scales[i]),
            logit: f64::from(cloud.opacity_logits[i]),
            sh: cloud.sh_of(i).iter().map(|&c| widened(c)).collect(),
        }
    }

    /// What an instance shows of Gaussian `local` of its template: offsets added, colour matrix applied.
    pub(crate) fn shown(
        scene: &InstancedScene,
        instance: &Instance,
        color_matrix: Option<&ColorMatrix>,
        local: usize,
    ) -> Self {
        let range = scene.template_ranges[instance.template as usize];
        let mut one = Self::of(&scene.templates, range.first as usize + local);
        if let Some(o) = instance.first_offset.map(|first| first as usize + local) {
            one.mean += widened(scene.offsets.means[o]);
            one.logit += f64::from(scene.offsets.opacity_logits[o]);
            one.sh[0] += widened(scene.offsets.sh_dc[o]);
            one.sh[1..].iter_mut().zip(scene.offsets.rest_of(o)).for_each(|(sh, &d)| *sh += widened(d));
            one.log_scales += scene.offsets.log_scales.get(o).map_or(DVec3::ZERO, |&d| widened(d));
            let d_quat = scene.offsets.quats.get(o).copied().unwrap_or_default();
            one.quat.iter_mut().zip(d_quat).for_each(|(q, d)| *q += f64::from(d));
        }
        if let Some(matrix) = color_matrix {
            recolour(matrix, &mut one.sh);
        }
        one
    }

    /// Appends it, rounded to f32, to a cloud of the same SH degree.
    pub(crate) fn push_to(self, cloud: &mut Gaussians) {
        cloud.means.push(narrowed(self.mean));
        cloud.quats.push(self.quat.map(|c| c as f32));
        cloud.log_scales.push(narrowed(self.log_scales));
        cloud.opacity_logits.push(self.logit as f32);
        cloud.sh.extend(self.sh.into_iter().map(narrowed));
    }
}

/// The placement of an instance, with what it does to rotations, scales and SH.
struct ToWorld<'a> {
    placement: &'a Similarity,
    quat: [f64; 4],
    ln_scale: f64,
    sh_rotation: ShRotation,
}

impl<'a> ToWorld<'a> {
    fn new(placement: &'a Similarity) -> Self {
        Self {
            placement,
            quat: quat_from_rotation(placement.rotation()),
            ln_scale: placement.scale().ln(),
            sh_rotation: ShRotation::new(placement.rotation()),
        }
    }

    fn push(&self, one: Local, world: &mut Gaussians) {
        world.means.push(narrowed(self.placement.transform_point(one.mean)));
        let quat = quat_multiply(self.quat, normalised_quat(one.quat));
        world.quats.push(quat.map(|c| c as f32));
        world.log_scales.push(narrowed(one.log_scales + self.ln_scale));
        world.opacity_logits.push(one.logit as f32);
        let missing = world.sh_coefficients() - one.sh.len();
        world.sh.extend(self.sh_rotation.rotate(&one.sh).into_iter().map(narrowed));
        world.sh.extend(std::iter::repeat_n([0.0; 3], missing));
    }
}

/// The SH coefficients of M rgb + b from those of rgb, which is 0.5 more than they sum to.
pub(crate) fn recolour(matrix: &ColorMatrix, sh: &mut [DVec3]) {
    let rows = matrix.map(|row| row.map(f64::from));
    let linear = |v: DVec3| DVec3::from_array(rows.map(|[r, g, b, _]| DVec3::new(r, g, b).dot(v)));
    sh.iter_mut().for_each(|sh| *sh = linear(*sh));
    let shift = linear(DVec3::splat(0.5)) + DVec3::from_array(rows.map(|row| row[3])) - 0.5;
    sh[0] += shift / SH_C0;
}

/// Rounds to the stored precision, f32.
fn narrowed(v: DVec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::math::sh::eval_sh;
    use crate::math::similarity::Similarity;
    use crate::scene::instanced_scene::SourceRange;
    use crate::scene::removable::HIDDEN_LOGIT;

    fn one(sh_degree: u32) -> Gaussians {
        let mut out = Gaussians::with_capacity(sh_degree, 1);
        out.means.push([1.0, 0.0, 0.0]);
        out.quats.push([2.0, 0.0, 0.0, 0.0]);
        out.log_scales.push([0.0, -1.0, -2.0]);
        out.opacity_logits.push(0.5);
        out.sh.extend((0..out.sh_coefficients()).map(|c| [c as f32, 0.0, 1.0]));
        out
    }

    /// One Gaussian by hand: quarter turn about z, scale 2, translation (0, 0, 5).
    #[test]
    fn one_gaussian_by_hand() {
        let quarter = DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z);
        let scene = InstancedScene {
            templates: one(1),
            template_ranges: vec![SourceRange { first: 0, count: 1 }],
            instances: vec![Instance {
                template: 0,
                world_from_template: Similarity::from_parts(quarter, 2.0, DVec3::new(0.0, 0.0, 5.0)),
                first_offset: Some(0),
            }],
            offsets: Offsets {
                means: vec![[0.5, 0.0, 0.0]],
                sh_dc: vec![[10.0, 20.0, 30.0]],
                opacity_logits: vec![0.25],
                ..Offsets::default()
            },
            background: one(2),
            ..InstancedScene::default()
        };
        let flat = scene.flatten();
        assert_eq!((flat.len(), flat.sh_degree, flat.sh.len()), (2, 2, 18));
        assert_eq!(flat.means[0], [0.0, 3.0, 5.0]);
        let h = std::f32::consts::FRAC_1_SQRT_2;
        assert_eq!(flat.quats[0], [h, 0.0, 0.0, h]);
        assert!((flat.log_scales[0][1] - (2f32.ln() - 1.0)).abs() < 1e-6);
        assert_eq!(flat.opacity_logits[0], 0.75);
        // Template function: 1 (-C1 y) + 2 (C1 z) + 3 (-C1 x) in red. In the world, x_template = y, y_template = -x:
        // 1 (C1 x) + 2 (C1 z) - 3 (C1 y), coefficients (3, 2, -1).
        let red: Vec<f32> = flat.sh_of(0).iter().map(|c| c[0]).collect();
        let want = [10.0, 3.0, 2.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert!(red.iter().zip(want).all(|(got, want): (&f32, f32)| (got - want).abs() < 1e-6), "{red:?}");
        assert_eq!(flat.filtered(|i| i == 1), scene.background);
    }

    /// Colours by hand: SH of degree 1 in one direction, then M rgb + b.
    #[test]
    fn colour_matrices_go_into_coefficients_and_into_offsets() {
        let mut templates = one(1);
        templates.sh = vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [-0.1, 0.2, 0.1], [0.3, -0.2, 0.1]];
        let instance = |first_offset| Instance {
            template: 0,
            world_from_template: Similarity::from_parts(DMat3::IDENTITY, 2.0, DVec3::X),
            first_offset,
        };
        let matrix = [[0.5, 0.25, 0.0, 0.1], [0.0, 1.5, -0.5, 0.0], [0.25, 0.0, 0.75, -0.2]];
        let scene = InstancedScene {
            templates,
            template_ranges: vec![SourceRange { first: 0, count: 1 }],
            instances: vec![instance(None), instance(Some(0))],
            color_from_template: vec![matrix; 2],
            offsets: Offsets {
                means: vec![[0.0; 3]],
                sh_dc: vec![[0.5, -0.5, 0.25]],
                opacity_logits: vec![0.0],
                ..Offsets::default()
            },
            ..InstancedScene::default()
        };
        scene.validate().unwrap();
        let dir = DVec3::new(0.6, 0.0, 0.8);
        let flat = scene.flatten();
        for (k, d_sh_dc) in [[0.0; 3], scene.offsets.sh_dc[0]].into_iter().enumerate() {
            let own = eval_sh(1, &scene.templates.sh, dir) + SH_C0 * widened(d_sh_dc) + 0.5;
            let [r, g, b] = matrix.map(|row| row.map(f64::from)).map(|[r, g, b, t]| own.dot(DVec3::new(r, g, b)) + t);
            let got = eval_sh(1, flat.sh_of(k), dir) + 0.5;
            assert!((got - DVec3::new(r, g, b)).length() < 1e-6, "{got}");
        }
        let plain = scene.with_colors_in_offsets().into_owned();
        plain.validate().unwrap();
        assert!(plain.color_from_template.is_empty() && plain.offsets.len() == 2);
        let again = plain.flatten();
        let differ = |(a, b): (&[f32; 3], &[f32; 3])| (widened(*a) - widened(*b)).length() > 1e-6;
        assert!(!again.sh.iter().zip(&flat.sh).any(differ));
        assert_eq!((again.means, again.opacity_logits), (flat.means, flat.opacity_logits));
        // Instances that share offsets and matrix share the new ones, and one that looks like its template has none.
        let mut more = scene.clone();
        more.instances.extend([instance(Some(0)), instance(None), instance(Some(0))]);
        more.color_from_template.extend([matrix, SAME_COLOR, SAME_COLOR]);
        let shared = more.with_colors_in_offsets();
        let firsts: Vec<_> = shared.instances.iter().map(|instance| instance.first_offset).collect();
        assert_eq!((firsts, shared.offsets.len()), (vec![Some(0), Some(1), Some(1), None, Some(2)], 3));
        assert!(!shared.flatten().sh.iter().zip(&more.flatten().sh).any(differ));
    }

    /// What an instance hides is in the flat order, but not in files of what is shown.
    #[test]
    fn what_is_hidden_is_left_out_of_what_is_shown() {
        let mut templates = one(0);
        templates.append(&one(0));
        let placed = |first_offset| Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset };
        let scene = InstancedScene {
            templates,
            template_ranges: vec![SourceRange { first: 0, count: 2 }],
            instances: vec![placed(Some(0)), placed(None), placed(Some(0))],
            offsets: Offsets {
                means: vec![[0.0; 3]; 2],
                sh_dc: vec![[0.0; 3]; 2],
                opacity_logits: vec![0.0, HIDDEN_LOGIT - 0.5],
                ..Offsets::default()
            },
            background: one(0),
            ..InstancedScene::default()
        };
        assert_eq!((scene.flatten().len(), scene.hidden_len()), (7, 2));
        let shown = scene.flatten_shown();
        assert!(shown.len() == 5 && shown.opacity_logits.iter().all(|&logit| logit == 0.5));
    }
}
