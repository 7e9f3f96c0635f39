//! Bytes of each group of instances in the file, next to their lower bound and to those of its copies in a .ply.

use std::collections::BTreeSet;
use std::ops::Range;

use super::inspect_file::{FilePart, Purpose};
use instgs_console::table::{Table, grouped};
use instgs_io::ply;
use instgs_io::scene_pack::segments;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{InstancedScene, SourceRange};

/// First Gaussian and count of a template.
pub(super) const RANGE_BYTES: u64 = 8;

#[derive(serde::Serialize)]
pub(super) struct GroupReport {
    template: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    gaussians: u64,
    instances: u64,
    instances_with_offsets: u64,
    expanded: u64,
    /// Gaussians that its instances have of their own.
    own: u64,
    /// Bytes of template, offsets, instances and their own Gaussians in this file; `None` for formats whose bytes are not told apart
    /// by group, such as `.glb`.
    stored_bytes: Option<u64>,
    flattened_ply_bytes: u64,
    /// The ratio flattened_ply_bytes / stored_bytes.
    shrink: Option<f64>,
    /// Least bytes of this number of instances with offsets, own Gaussians included, for each way to pack the file.
    bound_bytes: ByPack<u64>,
    /// The ratio flattened_ply_bytes / bound_bytes: how much smaller the group can become.
    bound: ByPack<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
struct ByPack<T> {
    f32: T,
    f16: T,
    q8: T,
}

pub(super) fn ratio(a: u64, b: u64) -> f64 {
    if b == 0 { 0.0 } else { a as f64 / b as f64 }
}

/// What the least bytes of a group follow from.
struct GroupSize {
    /// Gaussians of the template.
    gaussians: u64,
    /// Offset records of its instances: one per Gaussian and instance where none are shared.
    records: u64,
    /// Numbers of a record besides position, base colour and opacity: of shape, and of SH above band 0.
    more_values: u64,
    /// Gaussians that instances have of their own.
    own: u64,
    /// SH degree of template and own Gaussians.
    sh_degree: u32,
}

impl GroupSize {
    /// A Gaussian is position, rotation, log scales, opacity and C coefficients of SH in 3 colours: V = 11 + 3 C numbers of 4 bytes.
    /// Half floats take 2 bytes each, but positions keep 4: 2 V + 6. An offset record is 7 numbers of 4, 2 or 1 bytes, and
    /// `more_values` of 4 or 2. For SH 3, N Gaussians and K instances with offsets of these 7 the bounds are 236 N + 28 K N, 124 N + 14
    /// K N, and 124 N + 7 K N, compared with 4 (V + 3) K N = 248 K N with the normals of a .ply.
    fn bound_bytes(&self) -> ByPack<u64> {
        let values = 11 + 3 * sh_coefficients(self.sh_degree) as u64;
        let of = |row: u64, record: u64| (self.gaussians + self.own) * row + self.records * record;
        let more = self.more_values;
        ByPack {
            f32: of(4 * values, 28 + 4 * more),
            f16: of(2 * values + 6, 14 + 2 * more),
            q8: of(2 * values + 6, 7 + 2 * more),
        }
    }
}

/// One report for each template of the scene; `parts` are those of its file.
pub(super) fn groups(scene: &InstancedScene, parts: &[FilePart]) -> Vec<GroupReport> {
    let segments = segments(&scene.instances, &scene.template_ranges, scene.offsets.len());
    let report = |(template, range)| group(scene, parts, &segments, template, range);
    scene.template_ranges.iter().enumerate().map(report).collect()
}

fn group(
    scene: &InstancedScene,
    parts: &[FilePart],
    segments: &[Range<usize>],
    template: usize,
    range: &SourceRange,
) -> GroupReport {
    let members = (0..scene.instances.len()).filter(|&k| scene.instances[k].template as usize == template);
    let instances = members.clone().count() as u64;
    let firsts: Vec<usize> =
        members.clone().filter_map(|k| scene.instances[k].first_offset).map(|first| first as usize).collect();
    // Shared ones are counted once, like shared records.
    let own: BTreeSet<SourceRange> = members.clone().map(|k| scene.own_range(k)).collect();
    let own: u64 = own.iter().map(|range| u64::from(range.count)).sum();
    let hidden: u64 = members.clone().map(|k| scene.hidden_in(k)).sum();
    let expanded_own: u64 = members.map(|k| u64::from(scene.own_range(k).count)).sum();
    // The group's offset records consist of whole segments; shared records are counted once.
    let len = range.count as usize;
    let used = |s: &&Range<usize>| firsts.iter().any(|&first| first <= s.start && s.end <= first + len);
    let of_group = segments.iter().filter(used);
    let records: u64 = of_group.clone().map(|s| s.len() as u64).sum();
    // Rows of a tensor have one size; of a coded table, each group has its share.
    let bytes_of = |rows: u64, purpose, is_range: bool| {
        let of = parts.iter().filter(|p| p.purpose == purpose && p.rows > 0 && (p.name == "offset.range") == is_range);
        of.map(|p| rows * p.bytes / p.rows).sum::<u64>()
    };
    let gaussians = u64::from(range.count);
    let stored_bytes = parts.iter().any(|part| part.purpose == Purpose::Templates).then(|| {
        bytes_of(gaussians, Purpose::Templates, false)
            + bytes_of(records, Purpose::Offsets, false)
            + bytes_of(of_group.count() as u64, Purpose::Offsets, true)
            + bytes_of(own, Purpose::Own, false)
            + scene.instance_bytes() * instances
            + RANGE_BYTES
    });
    let expanded = gaussians * instances + expanded_own;
    let flattened_ply_bytes = (expanded - hidden) * ply::row_bytes(scene.sh_degree());
    let offsets = &scene.offsets;
    let more_values = (offsets.tensor_bytes() / 4).checked_div(offsets.len() as u64).map_or(0, |values| values - 7);
    let bound_bytes =
        GroupSize { gaussians, records, more_values, own, sh_degree: scene.templates.sh_degree }.bound_bytes();
    let times = |bytes| ratio(flattened_ply_bytes, bytes);
    GroupReport {
        template,
        name: scene.groups.iter().find(|g| g.template_id as usize == template).and_then(|g| g.name.clone()),
        gaussians,
        instances,
        instances_with_offsets: firsts.len() as u64,
        expanded,
        own,
        stored_bytes,
        flattened_ply_bytes,
        shrink: stored_bytes.map(times),
        bound_bytes,
        bound: ByPack { f32: times(bound_bytes.f32), f16: times(bound_bytes.f16), q8: times(bound_bytes.q8) },
    }
}

/// One row per group: its size, its bytes, and the bounds as bytes and as reduction compared with the .ply.
pub(super) fn groups_table(groups: &[GroupReport]) -> Table {
    let mut table = Table::default();
    let header = [
        "group",
        "Gaussians",
        "instances",
        "with offsets",
        "own",
        ".ply of copies",
        "stored bytes",
        "bound f32",
        "bound f16",
        "bound q8",
    ];
    table.row(header.map(String::from));
    for group in groups {
        let cell = |bytes, times: f64| format!("{} ({times:.2}x)", grouped(bytes));
        table.row([
            group.name.clone().unwrap_or_else(|| format!("template {}", group.template)),
            grouped(group.gaussians),
            grouped(group.instances),
            grouped(group.instances_with_offsets),
            grouped(group.own),
            grouped(group.flattened_ply_bytes),
            group.stored_bytes.zip(group.shrink).map_or("-".into(), |(bytes, times)| cell(bytes, times)),
            cell(group.bound_bytes.f32, group.bound.f32),
            cell(group.bound_bytes.f16, group.bound.f16),
            cell(group.bound_bytes.q8, group.bound.q8),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::inspect_file::{FileSums, tensor_parts};
    use super::*;
    use instgs_console::CliError;
    use instgs_io::Pack;
    use instgs_io::scene_write::packed_scene_file_bytes;
    use instgs_samples::{sample_scene, with_ablations, with_own};

    /// For K = 8 instances the reduction is at most 8.4 and 11.0 (q8), for K = 64 15.6 (f16).
    #[test]
    fn bounds_are_those_of_the_design() {
        assert_eq!(ply::row_bytes(3), 248);
        let of = |gaussians, records, more_values| {
            GroupSize { gaussians, records, more_values, own: 0, sh_degree: 3 }.bound_bytes()
        };
        assert_eq!(of(10, 40, 0), ByPack { f32: 10 * (236 + 112), f16: 10 * (124 + 56), q8: 10 * (124 + 28) });
        assert_eq!(of(10, 40, 7), ByPack { f32: 10 * (236 + 224), f16: 10 * (124 + 112), q8: 10 * (124 + 84) });
        let shrink = |k: u64, bound: u64| ratio(248 * k, bound);
        let near = |a: f64, b: f64| (a - b).abs() < 0.05;
        assert!(near(shrink(8, of(1, 8, 0).f16), 8.4) && near(shrink(8, of(1, 8, 0).q8), 11.0));
        assert!(near(shrink(64, of(1, 64, 0).f16), 15.6));
    }

    #[test]
    fn groups_background_and_header_are_the_whole_file() -> Result<(), CliError> {
        let path = Path::new("x.instgs");
        for pack in [Pack::F32, Pack::F16, Pack::Q8] {
            for scene in [sample_scene(), with_ablations(), with_own()] {
                let bytes = packed_scene_file_bytes(&scene, pack, path)?;
                let parts = tensor_parts(&bytes, path)?;
                let sums = FileSums::of(&parts);
                // Poses, colour matrices and ranges come on top of the bound.
                let bound = |group: &GroupReport| {
                    let least = if pack == Pack::F32 { group.bound_bytes.f32 } else { group.bound_bytes.f16 };
                    least + scene.instance_bytes() * group.instances + RANGE_BYTES
                };
                if pack != Pack::Q8 {
                    assert!(groups(&scene, &parts).iter().all(|g| g.stored_bytes == Some(bound(g))), "{pack:?}");
                }
                let stored: u64 = groups(&scene, &parts).iter().filter_map(|g| g.stored_bytes).sum();
                assert_eq!(stored + sums.background + sums.header + sums.foreign, bytes.len() as u64, "{pack:?}");
            }
        }
        // Each group has its share of a coded table, rounded down.
        let scene = sample_scene();
        let parts = tensor_parts(&packed_scene_file_bytes(&scene, Pack::Small, path)?, path)?;
        let sums = FileSums::of(&parts);
        let stored: u64 = groups(&scene, &parts).iter().filter_map(|g| g.stored_bytes).sum();
        let all = sums.templates + sums.offsets + sums.instances + sums.template_ranges;
        assert!(stored <= all && all - stored <= 5 * scene.template_ranges.len() as u64, "{stored} {all}");
        assert!(sums.background > 0 && sums.templates > 0);
        // Other formats, such as .glb, do not say which bytes are whose.
        let whole = FilePart {
            name: "all".into(),
            layout: None,
            coded: None,
            bytes: 9_999,
            rows: 0,
            purpose: Purpose::Background,
        };
        assert!(groups(&scene, &[whole]).iter().all(|g| (g.stored_bytes, g.shrink) == (None, None)));
        Ok(())
    }

    #[test]
    fn shared_records_count_once() -> Result<(), CliError> {
        let path = Path::new("x.instgs");
        let mut scene = sample_scene();
        // Both instances of template 0 use records 0..3; no instance uses 3..6.
        scene.instances[2].first_offset = Some(0);
        let parts = tensor_parts(&packed_scene_file_bytes(&scene, Pack::F32, path)?, path)?;
        // SH 2 in f32: rows of 152 bytes; 3 records of 28, two instances and a range.
        let group = &groups(&scene, &parts)[0];
        assert_eq!(group.stored_bytes, Some(3 * 152 + 3 * 28 + 2 * 56 + 8));
        assert_eq!((group.instances_with_offsets, group.expanded), (2, 6));
        Ok(())
    }
}
