//! Stray Gaussians: small groups apart from their object, left by mask borders and errors of single views.

use std::collections::BTreeMap;

use super::components::{components, usual_reach};

/// A group with less than this part of the Gaussians of its object's largest group is stray. Legs of furniture that
/// look detached because the joint is hidden are larger.
const STRAY_PART: f64 = 0.05;

/// Sets the label of small groups of Gaussians apart from the rest of their object to 0; labels above 0 are objects.
/// Gaussians with means that are not finite are strays, too. Returns the number of strays.
pub fn drop_strays(means: &[[f32; 3]], labels: &mut [u16]) -> usize {
    let mut members_of_label: BTreeMap<u16, Vec<usize>> = BTreeMap::new();
    for (i, &label) in labels.iter().enumerate().filter(|(_, label)| **label != 0) {
        members_of_label.entry(label).or_default().push(i);
    }
    let mut dropped = 0;
    for members in members_of_label.values() {
        for i in strays(means, members) {
            labels[i] = 0;
            dropped += 1;
        }
    }
    dropped
}

fn strays(means: &[[f32; 3]], members: &[usize]) -> Vec<usize> {
    let (finite, mut out): (Vec<usize>, Vec<usize>) =
        members.iter().partition(|&&i| means[i].iter().all(|v| v.is_finite()));
    let positions: Vec<[f32; 3]> = finite.iter().map(|&i| means[i]).collect();
    let Some(reach) = usual_reach(&positions) else { return out };
    let groups = components(&positions, reach);
    // Compared with the largest group, not the whole object: foliage consists of many small groups.
    let largest = groups.iter().map(|group| group.len()).max().unwrap_or(0);
    for group in groups {
        if (group.len() as f64) < STRAY_PART * largest as f64 {
            out.extend(group.iter().map(|&member| finite[member as usize]));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_groups_apart_from_their_object_go() {
        // A line of forty, one point four units away, two far away, and a group of a tenth far away.
        let along = |start: f32, count: usize| (0..count).map(move |i| [start + i as f32, 0.0, 0.0]);
        let mut means: Vec<[f32; 3]> =
            along(0.0, 40).chain(along(43.0, 1)).chain(along(100.0, 2)).chain(along(200.0, 6)).collect();
        means.push([f32::NAN; 3]);
        let mut labels = vec![9; means.len()];
        labels.extend([0, 4, 4]);
        means.extend([[100.0; 3], [0.0; 3], [1e6; 3]]);
        assert_eq!(drop_strays(&means, &mut labels), 3);
        let zeros: Vec<usize> = (0..labels.len()).filter(|&i| labels[i] == 0).collect();
        assert_eq!(zeros, [41, 42, 49, 50], "two alone are no strays of each other");
        assert_eq!(drop_strays(&means, &mut labels), 0);
    }

    #[test]
    fn an_object_in_many_small_parts_stays() {
        let clump = |k: usize| (0..4).map(move |i| [100.0 * k as f32 + i as f32, 0.0, 0.0]);
        let means: Vec<[f32; 3]> = (0..30).flat_map(clump).collect();
        let mut labels = vec![3; means.len()];
        assert_eq!((drop_strays(&means, &mut labels), &labels[..]), (0, &[3; 120][..]));
    }
}
