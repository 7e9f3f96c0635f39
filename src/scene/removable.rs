//! What can be taken out of a scene one by one: for pruning by what pictures lose.

use glam::DVec3;

use crate::scene::instanced_scene::{Instance, InstancedScene, SourceRange};

/// The opacity logit of a template's Gaussian where one instance does not show it: 6e-6 after the sigmoid, far below 1/255, so
/// that it is never blended.
pub const HIDDEN_LOGIT: f32 = -12.0;

impl InstancedScene {
    /// True if an instance hides a template's Gaussian by an offset record, as pruning leaves it, so that it is never drawn.
    /// `gaussian` is an index into the templates' Gaussians, `record` one into the offset records.
    pub fn is_hidden(&self, gaussian: usize, record: usize) -> bool {
        // Packing rounds.
        self.templates.opacity_logits[gaussian] + self.offsets.opacity_logits[record] <= HIDDEN_LOGIT + 0.1
    }

    /// True if an instance hides Gaussian `local` of its template.
    pub fn hides(&self, instance: &Instance, local: u32) -> bool {
        let first = self.template_ranges[instance.template as usize].first;
        instance.first_offset.is_some_and(|record| self.is_hidden((first + local) as usize, (record + local) as usize))
    }

    /// Number of expanded Gaussians that instance `k` hides: they are stored, but never drawn.
    pub fn hidden_in(&self, k: usize) -> u64 {
        let instance = &self.instances[k];
        if instance.first_offset.is_none() {
            return 0;
        }
        let count = self.template_ranges[instance.template as usize].count;
        (0..count).filter(|&local| self.hides(instance, local)).count() as u64
    }

    /// The same of all instances.
    pub fn hidden_len(&self) -> u64 {
        (0..self.instances.len()).map(|k| self.hidden_in(k)).sum()
    }
}

/// One Gaussian, or the way that some instances show a template's Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// A template's Gaussian where instances show it by this offset record.
    Record {
        /// Index into the offset records.
        record: u32,
        /// Index into the templates' Gaussians.
        gaussian: u32,
    },
    /// A template's Gaussian in the instances without offsets, by its index into the templates' Gaussians.
    Template(u32),
    /// An instance's own Gaussian, by its index into the own ones.
    Own(u32),
    /// A background Gaussian, by its index.
    Background(u32),
}

/// Something that can be removed without a change to anything else, and who shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Removable {
    /// What it is.
    pub part: Part,
    first_user: usize,
    users: usize,
}

impl Removable {
    /// How many expanded Gaussians it is.
    pub fn draws(&self) -> usize {
        self.users.max(1)
    }
}

/// A scene from which parts were removed.
#[derive(Clone, Debug, PartialEq)]
pub struct Removed {
    /// The scene without them. A template's Gaussian that no instance shows any more is no longer stored.
    pub scene: InstancedScene,
    /// By how many expanded Gaussians fewer are drawn.
    pub fewer: usize,
    /// How many of these are still stored, since other instances show the same Gaussian of their template.
    pub hidden: usize,
}

/// All that can be removed: each expanded Gaussian belongs to exactly one. What no instance shows is not among them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Removables {
    /// Ordered by their parts.
    pub all: Vec<Removable>,
    /// Instances that show the parts, one run for each.
    users: Vec<u32>,
    /// By instance, and then for the background, the flat index of its first expanded Gaussian.
    first_flat: Vec<usize>,
    /// By instance, how a local index follows from a part: what instances have of templates and of their own.
    firsts: Vec<Firsts>,
}

/// The first Gaussians that an instance shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Firsts {
    /// Its template, among the templates' Gaussians.
    template: SourceRange,
    /// Index of its first own Gaussian.
    own: u32,
}

impl Removables {
    /// All that can be removed from a valid scene.
    pub fn of(scene: &InstancedScene) -> Self {
        let mut shown: Vec<(Part, u32)> = Vec::new();
        for (k, instance) in (0..).zip(&scene.instances) {
            let range = scene.template_ranges[instance.template as usize];
            let part = |local: u32| match instance.first_offset {
                Some(first) => Part::Record { record: first + local, gaussian: range.first + local },
                None => Part::Template(range.first + local),
            };
            shown.extend((0..range.count).map(|local| (part(local), k)));
            let own = scene.own_range(k as usize);
            shown.extend((own.first..own.first + own.count).map(|i| (Part::Own(i), k)));
        }
        shown.sort_unstable();
        let mut out = Self { users: shown.iter().map(|&(_, k)| k).collect(), ..Self::default() };
        let mut flat = 0;
        for (k, instance) in scene.instances.iter().enumerate() {
            let (template, own) = (scene.template_ranges[instance.template as usize], scene.own_range(k));
            out.first_flat.push(flat);
            out.firsts.push(Firsts { template, own: own.first });
            flat += (template.count + own.count) as usize;
        }
        out.first_flat.push(flat);
        let mut first_user = 0;
        for of_part in shown.chunk_by(|a, b| a.0 == b.0) {
            out.all.push(Removable { part: of_part[0].0, first_user, users: of_part.len() });
            first_user += of_part.len();
        }
        let background = (0..scene.background.len() as u32).map(Part::Background);
        out.all.extend(background.map(|part| Removable { part, first_user: 0, users: 0 }));
        out
    }

    /// Indices of the instances that show a part; none for the background.
    pub fn users(&self, of: &Removable) -> &[u32] {
        &self.users[of.first_user..of.first_user + of.users]
    }

    /// True if a part was made transparent by [`Removables::removed`].
    pub fn is_hidden(scene: &InstancedScene, of: &Removable) -> bool {
        let Part::Record { record, gaussian } = of.part else { return false };
        scene.is_hidden(gaussian as usize, record as usize)
    }

    /// The indices of a part in the flat order of expanded Gaussians.
    pub fn flat_indices(&self, of: &Removable) -> impl Iterator<Item = usize> + '_ {
        let part = of.part;
        let background = match part {
            Part::Background(i) => Some(self.first_flat[self.firsts.len()] + i as usize),
            _ => None,
        };
        let of_user = move |&k: &u32| {
            let Firsts { template, own } = self.firsts[k as usize];
            let local = match part {
                Part::Record { gaussian, .. } | Part::Template(gaussian) => gaussian - template.first,
                Part::Own(i) => template.count + i - own,
                Part::Background(i) => i,
            };
            self.first_flat[k as usize] + local as usize
        };
        background.into_iter().chain(self.users(of).iter().map(of_user))
    }

    /// The places where a part is drawn, world units.
    pub fn centres_world(&self, scene: &InstancedScene, of: &Removable) -> Vec<DVec3> {
        let local = |mean: [f32; 3]| DVec3::from(mean.map(f64::from));
        let in_template = match of.part {
            Part::Record { record, gaussian } => {
                local(scene.templates.means[gaussian as usize]) + local(scene.offsets.means[record as usize])
            }
            Part::Template(i) => local(scene.templates.means[i as usize]),
            Part::Own(i) => local(scene.own.means[i as usize]),
            Part::Background(i) => return vec![local(scene.background.means[i as usize])],
        };
        let place = |&k: &u32| scene.instances[k as usize].world_from_template.transform_point(in_template);
        self.users(of).iter().map(place).collect()
    }

    /// The scene without the parts that are marked, in the order of [`Removables::all`]. A template's Gaussian that some instances
    /// still show is hidden in the others by their offsets; where they have none, it stays.
    pub fn removed(&self, scene: &InstancedScene, is_removed: &[bool]) -> Removed {
        let mut out = scene.clone();
        let mut is_shown = vec![false; scene.templates.len()];
        for (removable, &removed) in self.all.iter().zip(is_removed) {
            if let (Part::Record { gaussian, .. } | Part::Template(gaussian), false) = (removable.part, removed) {
                is_shown[gaussian as usize] |= !Self::is_hidden(scene, removable);
            }
        }
        let mut is_template_kept = vec![true; scene.templates.len()];
        let mut is_own_kept = vec![true; scene.own.len()];
        let mut is_background_kept = vec![true; scene.background.len()];
        let (mut fewer, mut hidden) = (0, 0);
        for (removable, _) in self.all.iter().zip(is_removed).filter(|(_, removed)| **removed) {
            match removable.part {
                Part::Record { gaussian, .. } if !is_shown[gaussian as usize] => {
                    is_template_kept[gaussian as usize] = false;
                }
                Part::Record { record, gaussian } => {
                    // What is not drawn needs no other offsets, and zeros cost files next to nothing.
                    out.offsets.clear(record as usize);
                    let logit = scene.templates.opacity_logits[gaussian as usize];
                    out.offsets.opacity_logits[record as usize] = HIDDEN_LOGIT - logit;
                    hidden += removable.draws();
                }
                Part::Template(gaussian) if !is_shown[gaussian as usize] => {
                    is_template_kept[gaussian as usize] = false;
                }
                Part::Template(_) => continue,
                Part::Own(i) => is_own_kept[i as usize] = false,
                Part::Background(i) => is_background_kept[i as usize] = false,
            }
            fewer += removable.draws();
        }
        let of_background = is_background_kept.iter().filter(|kept| !**kept).count();
        if of_background > 0 {
            out.background = out.background.filtered(|i| is_background_kept[i]);
        }
        let of_own = out.keep_own(|_, i| is_own_kept[i]);
        out.keep_templates(&is_template_kept, of_own + of_background);
        Removed { scene: out, fewer, hidden }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::gaussians::Gaussians;
    use crate::scene::offsets::Offsets;

    fn cloud(x: &[f32]) -> Gaussians {
        let mut out = Gaussians::with_capacity(0, x.len());
        for &x in x {
            out.means.push([x, 0.0, 0.0]);
            out.quats.push([1.0, 0.0, 0.0, 0.0]);
            out.log_scales.push([0.0; 3]);
            out.opacity_logits.push(1.0);
            out.sh.push([0.5; 3]);
        }
        out
    }

    /// Template 0 of three Gaussians: two instances with offsets of their own, two that share a run, one without. Template 1 of
    /// one: an instance without offsets. Two instances share an own Gaussian, one has another.
    fn sample() -> InstancedScene {
        let instance = |template, x: f64, first_offset| Instance {
            template,
            world_from_template: Similarity::from_parts(glam::DMat3::IDENTITY, 1.0, DVec3::new(x, 0.0, 0.0)),
            first_offset,
        };
        let records = cloud(&[0.5; 9]);
        let range = |first, count| SourceRange { first, count };
        InstancedScene {
            templates: cloud(&[1.0, 2.0, 3.0, 4.0]),
            template_ranges: vec![range(0, 3), range(3, 1)],
            instances: vec![
                instance(0, 10.0, Some(0)),
                instance(0, 20.0, Some(3)),
                instance(0, 30.0, Some(6)),
                instance(0, 40.0, Some(6)),
                instance(0, 50.0, None),
                instance(1, 60.0, None),
            ],
            own: cloud(&[5.0, 6.0]),
            own_ranges: vec![range(0, 1), range(0, 1), range(1, 1), range(0, 0), range(0, 0), range(0, 0)],
            offsets: Offsets {
                means: records.means,
                sh_dc: records.sh,
                opacity_logits: vec![0.0; 9],
                ..Offsets::default()
            },
            background: cloud(&[7.0, 8.0]),
            ..InstancedScene::default()
        }
    }

    fn is_seen(scene: &InstancedScene) -> Vec<[f32; 3]> {
        let flat = scene.flatten();
        (0..flat.len()).filter(|&i| flat.opacity_logits[i] > -6.0).map(|i| flat.means[i]).collect()
    }

    #[test]
    fn every_expanded_gaussian_is_one_part() {
        let scene = sample();
        let removables = Removables::of(&scene);
        let draws: usize = removables.all.iter().map(Removable::draws).sum();
        assert_eq!(draws as u64, scene.expanded_len());
        // 9 records, 3 + 1 without, 2 own ones, 2 of the background.
        assert_eq!(removables.all.len(), 17);
        let shared = Part::Record { record: 7, gaussian: 1 };
        let shared = removables.all.iter().find(|r| r.part == shared).expect("a shared record");
        assert_eq!((shared.draws(), removables.users(shared)), (2, &[2, 3][..]));
        assert_eq!(removables.centres_world(&scene, shared), [32.5, 42.5].map(|x| DVec3::new(x, 0.0, 0.0)));
        // Where a part says that it is drawn, the flat cloud has it; no place is missing or named twice.
        let flat = scene.flatten();
        let mut named = vec![0; flat.len()];
        for removable in &removables.all {
            let centres = removables.centres_world(&scene, removable);
            assert_eq!(removables.flat_indices(removable).count(), centres.len());
            for (at, centre) in removables.flat_indices(removable).zip(centres) {
                named[at] += 1;
                assert_eq!(DVec3::from(flat.means[at].map(f64::from)), centre, "{:?}", removable.part);
            }
        }
        assert!(named.iter().all(|&count| count == 1), "{named:?}");
    }

    #[test]
    fn what_is_removed_is_all_that_is_gone() {
        let scene = sample();
        let removables = Removables::of(&scene);
        let all = is_seen(&scene);
        // Each alone: as many pictures of a Gaussian fewer, the others as they were. What has no offsets stays if others show it.
        for (i, removable) in removables.all.iter().enumerate() {
            let marks: Vec<bool> = (0..removables.all.len()).map(|j| i == j).collect();
            let Removed { scene: left, fewer, .. } = removables.removed(&scene, &marks);
            left.validate().unwrap_or_else(|e| panic!("{:?}: {e}", removable.part));
            let stays = matches!(removable.part, Part::Template(gaussian) if gaussian < 3);
            let want = if stays { 0 } else { removable.draws() };
            assert_eq!((fewer, all.len() - is_seen(&left).len()), (want, want), "{:?}", removable.part);
            assert!(is_seen(&left).iter().all(|mean| all.contains(mean)), "{:?}", removable.part);
        }
        // A Gaussian that no instance shows any more is no longer stored.
        let of_first = |part: Part| matches!(part, Part::Record { gaussian: 0, .. } | Part::Template(0));
        let marks: Vec<bool> = removables.all.iter().map(|r| of_first(r.part)).collect();
        let Removed { scene: left, fewer, .. } = removables.removed(&scene, &marks);
        assert_eq!((fewer, left.templates.len(), left.offsets.len()), (5, 3, 6));
        assert_eq!(is_seen(&left).len(), all.len() - 5);
        // In two steps: what is hidden has no other offsets, and is gone with the last instance that shows it.
        let of_last = |part: Part| matches!(part, Part::Record { record: 6, .. } | Part::Template(0));
        let marks: Vec<bool> = removables.all.iter().map(|r| of_first(r.part) && !of_last(r.part)).collect();
        let Removed { scene: half, fewer, hidden } = removables.removed(&scene, &marks);
        assert_eq!((fewer, hidden, half.hidden_len(), half.templates.len()), (2, 2, 2, 4));
        assert!([0, 3].iter().all(|&m| half.offsets.means[m] == [0.0; 3] && half.offsets.sh_dc[m] == [0.0; 3]));
        assert!(half.offsets.means[6] == scene.offsets.means[6]);
        let marks: Vec<bool> = removables.all.iter().map(|r| of_last(r.part)).collect();
        let Removed { scene: left, fewer, hidden } = Removables::of(&half).removed(&half, &marks);
        assert_eq!((fewer, hidden, left.hidden_len(), left.templates.len(), left.offsets.len()), (3, 0, 0, 3, 6));
        // Everything.
        let Removed { scene: left, fewer, .. } = removables.removed(&scene, &vec![true; marks.len()]);
        assert_eq!((fewer as u64, left.source_len(), left.expanded_len()), (scene.expanded_len(), 0, 0));
    }
}
