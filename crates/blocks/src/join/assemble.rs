//! Puts the joined scene together.

use std::collections::BTreeMap;

use instgs_objects::template::{Adopter, OffsetKinds, Unmatched};
use instgs_vk::scene::instanced_scene::SAME_COLOR;
use instgs_vk::scene::lod::{FittedLevel, template_print};
use instgs_vk::scene::{Gaussians, Group, Instance, InstancedScene, Offsets, SourceRange};

use super::kinds::{Kinds, UsedTemplate};
use super::objects::{BlockObject, KeptObject};
use super::seams::BlockBackground;
use super::{BlockReport, JoinInput, JoinReport, Joined, KindReport};
use crate::error::BlocksError;

/// What the scene is made of.
pub(super) struct Parts<'a> {
    pub found: &'a [BlockObject],
    pub kept: &'a [KeptObject],
    pub kinds: &'a Kinds,
    pub background: Vec<BlockBackground>,
}

/// The joined scene and its report.
pub(super) fn assemble(input: &JoinInput<'_>, parts: Parts<'_>) -> Result<Joined, BlocksError> {
    let Parts { found, kept, kinds, background } = parts;
    let mut builder = Builder::new(input.scenes);
    let mut report = JoinReport { warnings: kinds.warnings.clone(), ..JoinReport::default() };
    report.duplicates = kept.iter().map(|one| one.blocks.len() - 1).sum();
    let mut of_block = vec![0; input.scenes.len()];
    for (kind, &chief) in kinds.reference.iter().enumerate() {
        let reference = &kinds.used[chief];
        let template = input.scenes[reference.block]
            .templates
            .range(input.scenes[reference.block].template_ranges[reference.template]);
        let gaussians = template.len();
        let (levels, warning) = levels_of(input, kinds, kind, &template);
        builder.scene.fitted_levels.extend(levels);
        report.warnings.extend(warning);
        let members: Vec<(&BlockObject, &UsedTemplate)> = kept
            .iter()
            .map(|one| &found[one.object])
            .filter_map(|object| Some((object, kinds.of(input.scenes, object)?)))
            .filter(|(_, used)| used.kind == kind)
            .collect();
        members.iter().for_each(|(object, _)| of_block[object.block] += 1);
        builder.begin_template(template, reference.name.clone(), members.len());
        for (object, used) in &members {
            let is_reference = std::ptr::eq(*used, reference);
            builder.push_instance(&input.scenes[object.block], object.instance, used, is_reference);
        }
        report.templates.push(KindReport {
            name: reference.name.clone(),
            block: input.plan.blocks[reference.block].name.clone(),
            templates: kinds.used.iter().filter(|used| used.kind == kind).count(),
            instances: members.len(),
            gaussians,
        });
    }
    for (number, ((block, planned), instances)) in background.iter().zip(&input.plan.blocks).zip(of_block).enumerate() {
        builder.scene.background.append(&block.gaussians);
        report.blocks.push(BlockReport {
            name: planned.name.clone(),
            instances,
            beyond: input.scenes[number].instances.len() - found.iter().filter(|object| object.block == number).count(),
            background: block.gaussians.len(),
            outside: block.outside,
            covered: block.covered,
        });
    }
    let mut scene = builder.scene;
    scene.source = format!("instgs-vk: joined from {} blocks", input.scenes.len());
    scene.validate()?;
    Ok(Joined { scene, report })
}

/// The fitted levels of a kind's template, which stays as it is in its block; or a warning, if that block has none and another one
/// has levels of its template, which goes.
fn levels_of(
    input: &JoinInput<'_>,
    kinds: &Kinds,
    kind: usize,
    template: &Gaussians,
) -> (Vec<FittedLevel>, Option<String>) {
    let of = |block: usize, template: &Gaussians| -> Vec<FittedLevel> {
        let levels = &input.scenes[block].fitted_levels;
        if levels.is_empty() {
            return Vec::new();
        }
        let print = template_print(template);
        levels.iter().filter(|level| level.template_print == print).cloned().collect()
    };
    let chief = kinds.reference[kind];
    let levels = of(kinds.used[chief].block, template);
    if !levels.is_empty() {
        return (levels, None);
    }
    let lost = kinds.used.iter().enumerate().filter(|(u, used)| *u != chief && used.kind == kind).find(|(_, used)| {
        let scene = &input.scenes[used.block];
        !of(used.block, &scene.templates.range(scene.template_ranges[used.template])).is_empty()
    });
    let warning = lost.map(|(_, used)| {
        let (name, block) = (used.name.as_deref().unwrap_or("object"), &input.plan.blocks[used.block].name);
        format!(
            "{name}: the levels of detail of {block}'s template are left out with it; instgs-vk levels makes those of the joined \
             scene"
        )
    });
    (levels, warning)
}

/// Collects the joined scene, one template with its instances after the other, so that ranges and offsets stay consecutive.
struct Builder {
    scene: InstancedScene,
    /// Kinds of offsets that the blocks' scenes have.
    kinds: OffsetKinds,
    has_own: bool,
    has_colors: bool,
    /// The current template, once an object that was not made with it needs it.
    adopter: Option<Adopter>,
    /// By block and first record, where an instance's records were copied to: instances may share them.
    moved: BTreeMap<(usize, u32), u32>,
    next_id: u32,
}

impl Builder {
    fn new(scenes: &[InstancedScene]) -> Self {
        let any = |is: &dyn Fn(&InstancedScene) -> bool| scenes.iter().any(is);
        let has_offsets = any(&|scene| !scene.offsets.is_empty());
        let has_colors = any(&|scene| !scene.color_from_template.is_empty());
        // Clouds without Gaussians are read as degree 0.
        let degree_of = |cloud: fn(&InstancedScene) -> &Gaussians| {
            scenes.iter().map(|scene| cloud(scene).sh_degree).max().unwrap_or(0)
        };
        let degree = degree_of(|scene| &scene.templates);
        let background = Gaussians { sh_degree: degree_of(|scene| &scene.background), ..Gaussians::default() };
        let cloud = || Gaussians { sh_degree: degree, ..Gaussians::default() };
        Self {
            scene: InstancedScene {
                templates: cloud(),
                own: cloud(),
                background,
                pixel_filter: scenes[0].pixel_filter,
                near_plane: scenes[0].near_plane,
                ..InstancedScene::default()
            },
            kinds: OffsetKinds {
                position: has_offsets,
                // Adopted instances have no colour matrix: the offsets of their base colour carry what it did. What it did to the
                // coefficients above, little, is lost: offsets of those would double the file.
                sh_dc: has_offsets || has_colors,
                opacity: has_offsets,
                sh_degree: scenes.iter().map(|scene| scene.offsets.sh_degree()).max().unwrap_or(0),
                covariance: any(&|scene| !scene.offsets.quats.is_empty()),
            },
            has_own: any(&|scene| !scene.own.is_empty()),
            has_colors,
            adopter: None,
            moved: BTreeMap::new(),
            next_id: 1,
        }
    }

    fn begin_template(&mut self, template: Gaussians, name: Option<String>, instances: usize) {
        let scene = &mut self.scene;
        let range = SourceRange { first: scene.templates.len() as u32, count: template.len() as u32 };
        let ids = self.next_id..self.next_id + instances as u32;
        self.next_id = ids.end;
        let template_id = scene.template_ranges.len() as u32;
        scene.groups.push(Group { template_id, name, instance_ids: ids.collect() });
        scene.template_ranges.push(range);
        scene.templates.append(&template);
        self.adopter = None;
        self.moved.clear();
    }

    /// Adds instance `k` of a block's scene, one of the template `used`, to the current template.
    fn push_instance(&mut self, from: &InstancedScene, k: usize, used: &UsedTemplate, is_reference: bool) {
        let template = self.scene.template_ranges.len() as u32 - 1;
        let own_first = self.scene.own.len() as u32;
        let old = &from.instances[k];
        let mut color = SAME_COLOR;
        let instance = if is_reference {
            color = from.color_matrix(k).copied().unwrap_or(SAME_COLOR);
            from.own_range(k).indices().for_each(|i| self.scene.own.push_from(&from.own, i));
            let first_offset = old.first_offset.map(|first| self.copied_records(from, used, first));
            Instance { template, world_from_template: old.world_from_template, first_offset }
        } else {
            let world_from_template = old.world_from_template.after(&used.template_from_reference);
            self.adopted(from, k, Instance { template, world_from_template, first_offset: None })
        };
        let scene = &mut self.scene;
        scene.instances.push(instance);
        if self.has_own {
            scene.own_ranges.push(SourceRange { first: own_first, count: scene.own.len() as u32 - own_first });
        }
        if self.has_colors {
            scene.color_from_template.push(color);
        }
    }

    /// Copies an instance's records, once if several instances share them; returns the index of the first copy.
    fn copied_records(&mut self, from: &InstancedScene, used: &UsedTemplate, first: u32) -> u32 {
        if let Some(&there) = self.moved.get(&(used.block, first)) {
            return there;
        }
        let count = from.template_ranges[used.template].count;
        let there = self.scene.offsets.len() as u32;
        for m in first..first + count {
            push_record(&mut self.scene.offsets, &from.offsets, m as usize, self.kinds, self.scene.templates.sh_degree);
        }
        self.moved.insert((used.block, first), there);
        there
    }

    /// An instance of the current template that looks like instance `k` of a block's scene.
    fn adopted(&mut self, from: &InstancedScene, k: usize, mut instance: Instance) -> Instance {
        let range = self.scene.template_ranges[instance.template as usize];
        let adopter = self.adopter.get_or_insert_with(|| Adopter::new(self.scene.templates.range(range)));
        let unmatched = if self.has_own { Unmatched::Own } else { Unmatched::Drop };
        let adopted = adopter.adopt(&from.flatten_one(k), &instance.world_from_template, self.kinds, unmatched);
        if !adopted.offsets.is_empty() {
            instance.first_offset = Some(self.scene.offsets.len() as u32);
            (0..adopted.offsets.len()).for_each(|m| {
                push_record(&mut self.scene.offsets, &adopted.offsets, m, self.kinds, self.scene.templates.sh_degree);
            });
        }
        self.scene.own.append(&adopted.own);
        instance
    }
}

/// Appends a record, with zeros for kinds that its scene has not.
fn push_record(out: &mut Offsets, from: &Offsets, m: usize, kinds: OffsetKinds, of_templates: u32) {
    out.means.push(from.means[m]);
    out.sh_dc.push(from.sh_dc[m]);
    out.opacity_logits.push(from.opacity_logits[m]);
    let rest = kinds.rest_coefficients(of_templates);
    let end = out.sh_rest.len() + rest;
    out.sh_rest.extend(from.rest_of(m).iter().take(rest));
    out.sh_rest.resize(end, [0.0; 3]);
    if kinds.covariance {
        out.log_scales.push(from.log_scales.get(m).copied().unwrap_or_default());
        out.quats.push(from.quats.get(m).copied().unwrap_or_default());
    }
}
