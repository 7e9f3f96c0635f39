//! Which templates of the blocks are of one kind, and how they stand to each other: registration, with one object per
//! template.

use std::collections::BTreeMap;

use instgs_objects::register::{
    InstanceRegistration, PoseCheck, RegisterInput, RegisterOptions, Registered, RenderCheck, Verdict, register,
};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::{Gaussians, InstancedScene};

use super::JoinInput;
use super::objects::{BlockObject, KeptObject};
use crate::error::BlocksError;
use crate::plan::Plan;

/// The kinds of objects in the joined scene.
pub(super) struct Kinds {
    /// The blocks' templates that have kept objects, by block and template.
    pub used: Vec<UsedTemplate>,
    /// By kind, the index into `used` of the template that stands for it.
    pub reference: Vec<usize>,
    /// Why templates of one name were not taken for one kind, and which poses are in doubt; one line each.
    pub warnings: Vec<String>,
}

/// A template of a block, some of whose instances are kept.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct UsedTemplate {
    pub block: usize,
    pub template: usize,
    /// Index into the block's scene of the instance that stands for it: the one deepest in the cell.
    example: usize,
    depth: f64,
    /// Number of kept instances.
    pub instances: usize,
    /// Name of the kind of object.
    pub name: Option<String>,
    /// Index of its kind.
    pub kind: usize,
    /// From the frame of the kind's reference template to that of this one.
    pub template_from_reference: Similarity,
}

impl Kinds {
    /// The used template of a block's instance.
    pub(super) fn of(&self, scenes: &[InstancedScene], object: &BlockObject) -> Option<&UsedTemplate> {
        let template = scenes[object.block].instances[object.instance].template as usize;
        self.used.iter().find(|used| (used.block, used.template) == (object.block, template))
    }
}

/// Registers the used templates to each other. Each is seen at the place of one of its instances, without that one's offsets.
pub(super) fn match_kinds(
    input: &JoinInput<'_>,
    found: &[BlockObject],
    kept: &[KeptObject],
) -> Result<Kinds, BlocksError> {
    let mut used = used_templates(input.scenes, found, kept);
    let placed: Vec<Gaussians> = used.iter().map(|one| one.placed(&input.scenes[one.block])).collect();
    let registered = if used.len() < 2 { Registered::default() } else { register_all(input, &used, &placed)? };
    let mut kind = 0;
    let mut reference = Vec::new();
    let mut is_matched = vec![false; used.len()];
    for group in &registered.groups {
        let members: Vec<(usize, Similarity)> =
            group.instances.iter().map(|i| (i.id as usize - 1, i.world_from_template)).collect();
        let Some(&(chief, world_from_group)) =
            members.iter().min_by_key(|(u, _)| (usize::MAX - used[*u].instances, *u))
        else {
            continue;
        };
        let example = |one: &UsedTemplate| input.scenes[one.block].instances[one.example].world_from_template;
        let group_from_reference = world_from_group.inverse().after(&example(&used[chief]));
        for (u, world_from_group) in members {
            let template_from_group = example(&used[u]).inverse().after(&world_from_group);
            let is_chief = u == chief;
            used[u].kind = kind;
            used[u].template_from_reference =
                if is_chief { Similarity::IDENTITY } else { template_from_group.after(&group_from_reference) };
            is_matched[u] = true;
        }
        reference.push(chief);
        kind += 1;
    }
    for u in 0..used.len() {
        if !is_matched[u] {
            used[u].kind = kind;
            reference.push(u);
            kind += 1;
        }
    }
    let (used, reference) = in_order(used, reference);
    let mut warnings = apart(input, &used, &reference, &registered);
    warnings.extend(doubts(input.plan, &used, &registered));
    Ok(Kinds { used, reference, warnings })
}

/// Numbers the kinds by the first template that is of them.
fn in_order(mut used: Vec<UsedTemplate>, reference: Vec<usize>) -> (Vec<UsedTemplate>, Vec<usize>) {
    let mut order: Vec<usize> = Vec::new();
    for one in &used {
        if !order.contains(&one.kind) {
            order.push(one.kind);
        }
    }
    for one in &mut used {
        one.kind = order.iter().position(|&kind| kind == one.kind).unwrap_or(0);
    }
    let reference = order.into_iter().map(|kind| reference[kind]).collect();
    (used, reference)
}

fn used_templates(scenes: &[InstancedScene], found: &[BlockObject], kept: &[KeptObject]) -> Vec<UsedTemplate> {
    let mut used: BTreeMap<(usize, usize), UsedTemplate> = BTreeMap::new();
    for one in kept {
        let object = &found[one.object];
        let scene = &scenes[object.block];
        let template = scene.instances[object.instance].template as usize;
        let group = scene.groups.iter().find(|group| group.template_id as usize == template);
        let entry = used.entry((object.block, template)).or_insert_with(|| UsedTemplate {
            block: object.block,
            template,
            example: object.instance,
            depth: object.depth,
            instances: 0,
            name: group.and_then(|group| group.name.clone()),
            kind: 0,
            template_from_reference: Similarity::IDENTITY,
        });
        entry.instances += 1;
        if object.depth > entry.depth {
            (entry.example, entry.depth) = (object.instance, object.depth);
        }
    }
    used.into_values().collect()
}

impl UsedTemplate {
    /// The template's Gaussians at the place of its example, world frame.
    fn placed(&self, scene: &InstancedScene) -> Gaussians {
        let template = scene.templates.range(scene.template_ranges[self.template]);
        template.placed(scene.instances[self.example].world_from_template)
    }
}

/// Registers templates; the id of each is its index and 1.
fn register_all(input: &JoinInput<'_>, used: &[UsedTemplate], placed: &[Gaussians]) -> Result<Registered, BlocksError> {
    let mut cloud = Gaussians::with_capacity(placed[0].sh_degree, 0);
    let mut labels = Vec::new();
    for (one, id) in placed.iter().zip(1u32..) {
        cloud.append(one);
        labels.resize(cloud.len(), id);
    }
    let names = used.iter().zip(1u32..).filter_map(|(one, id)| Some((id, one.name.clone()?))).collect();
    let register_input =
        RegisterInput { cloud: &cloud, instance_of_gaussian: &labels, categories: &names, cameras: input.cameras };
    let scales =
        |scene: &InstancedScene| scene.instances.iter().any(|i| (i.world_from_template.scale() - 1.0).abs() > 0.01);
    let options = RegisterOptions {
        allow_scale: input.scenes.iter().any(scales),
        // There are few templates, and each stands for many objects: all of a name are compared.
        most_references: used.len(),
        ..RegisterOptions::default()
    };
    let render = RenderOptions::of(&input.scenes[0]);
    let mut check = match input.gpu.filter(|_| !input.cameras.is_empty()) {
        Some(gpu) => Some(RenderCheck::new(gpu, &cloud, &labels, input.cameras, render, None)?),
        None => None,
    };
    let check = check.as_mut().map(|check| -> &mut dyn PoseCheck { check });
    Ok(register(&register_input, check, &options)?)
}

/// Warnings about templates of one name that are of several kinds.
fn apart(input: &JoinInput<'_>, used: &[UsedTemplate], reference: &[usize], registered: &Registered) -> Vec<String> {
    let mut out = Vec::new();
    for (kind, &chief) in reference.iter().enumerate() {
        let Some(name) = &used[chief].name else { continue };
        let earlier = used.iter().any(|one| one.name.as_ref() == Some(name) && one.kind < kind);
        if earlier {
            let note = registered.instances.iter().find(|one| one.instance as usize == chief + 1);
            let why = note.map(|one| format!(": {}", one.note)).unwrap_or_default();
            let block = &input.plan.blocks[used[chief].block].name;
            out.push(format!("{name}: the template of {block} stays apart from the others{why}"));
        }
    }
    out
}

/// Warnings about templates whose poses are in more than slight doubt: all objects of a block stand as its template does.
fn doubts(plan: &Plan, used: &[UsedTemplate], registered: &Registered) -> Vec<String> {
    let is_in_doubt = |one: &&InstanceRegistration| one.verdict == Verdict::Ambiguous && !one.slight;
    let warning = |one: &InstanceRegistration| {
        let template = &used[one.instance as usize - 1];
        let (name, block) = (template.name.as_deref().unwrap_or("object"), &plan.blocks[template.block].name);
        format!(
            "{name}: the pose of the template of {block} relative to the others' is in doubt: {}; look at its objects",
            one.note
        )
    };
    registered.instances.iter().filter(is_in_doubt).map(warning).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::plan::on_level_ground;

    #[test]
    fn templates_whose_poses_are_in_doubt_are_named() {
        let plan = on_level_ground([Cell::default(); 3], [0.0; 2]);
        let template = |(block, name): (usize, Option<&str>)| UsedTemplate {
            block,
            template: 0,
            example: 0,
            depth: 1.0,
            instances: 2,
            name: name.map(String::from),
            kind: 0,
            template_from_reference: Similarity::IDENTITY,
        };
        let used: Vec<UsedTemplate> =
            [(0, Some("car")), (1, Some("car")), (2, None)].into_iter().map(template).collect();
        let of = |instance: u32, verdict: Verdict, slight: bool| InstanceRegistration {
            instance,
            group: Some(0),
            name: None,
            gaussians: 100,
            inliers: 0.9,
            rmse: 0.0,
            relative_rmse: 0.0,
            photometric: None,
            uncertainty: None,
            accepted: true,
            verdict,
            slight,
            note: "another pose is only 1.0 % less likely".into(),
        };
        let told = |instances: &[InstanceRegistration]| {
            doubts(&plan, &used, &Registered { groups: Vec::new(), instances: instances.to_vec() })
        };
        let [first, unnamed] = [of(2, Verdict::Ambiguous, false), of(3, Verdict::Ambiguous, false)];
        let warnings = told(&[of(1, Verdict::Reference, false), first, unnamed]);
        assert_eq!(warnings.len(), 2);
        assert!(warnings[0].starts_with("car: the pose of the template of block_01"), "{warnings:?}");
        assert!(
            warnings[0].contains("1.0 % less likely") && warnings[1].starts_with("object: the pose"),
            "{warnings:?}"
        );
        let others =
            [of(2, Verdict::Ambiguous, true), of(3, Verdict::Symmetric, false), of(1, Verdict::Accepted, false)];
        assert!(told(&others).is_empty());
    }
}
