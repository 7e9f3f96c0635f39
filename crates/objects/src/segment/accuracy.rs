//! Accuracy of labels against known ones.

use std::collections::BTreeMap;

/// Counts of one object's Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InstanceAccuracy {
    /// Gaussians that belong to the object.
    pub own: usize,
    /// Gaussians that carry its label.
    pub labelled: usize,
    /// Gaussians that belong to it and carry its label.
    pub right: usize,
}

impl InstanceAccuracy {
    /// Recall: share of the object's Gaussians that carry its label, 0 to 1.
    pub fn accuracy(&self) -> f64 {
        self.right as f64 / self.own.max(1) as f64
    }

    /// Intersection over union of the object's Gaussians and those with its label, 0 to 1.
    pub fn overlap(&self) -> f64 {
        self.right as f64 / (self.own + self.labelled - self.right).max(1) as f64
    }
}

/// Counts for every object of `truth`, by object id. Both slices are indexed by Gaussian; 0, the background, is left
/// out.
pub fn instance_accuracies(truth: &[u32], labels: &[u32]) -> BTreeMap<u32, InstanceAccuracy> {
    let mut out: BTreeMap<u32, InstanceAccuracy> = BTreeMap::new();
    truth.iter().filter(|&&id| id != 0).for_each(|&id| out.entry(id).or_default().own += 1);
    for (known, label) in truth.iter().zip(labels) {
        if let Some(of_label) = out.get_mut(label) {
            of_label.labelled += 1;
            of_label.right += usize::from(known == label);
        }
    }
    out
}

/// Mean of [`InstanceAccuracy::accuracy`] over the objects of `truth` ("mAcc" in the literature); 1 if there are none.
pub fn mean_accuracy(truth: &[u32], labels: &[u32]) -> f64 {
    let instances = instance_accuracies(truth, labels);
    if instances.is_empty() {
        return 1.0;
    }
    instances.values().map(InstanceAccuracy::accuracy).sum::<f64>() / instances.len() as f64
}

/// `labels` renumbered to the ids of `truth`: labels and objects are matched one to one, the pair with most Gaussians
/// in common first. A label without an object gets an id that `truth` does not use; 0 stays 0.
pub fn in_ids_of(truth: &[u32], labels: &[u32]) -> Vec<u32> {
    let mut common: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for (&known, &label) in truth.iter().zip(labels) {
        if known != 0 && label != 0 {
            *common.entry((known, label)).or_default() += 1;
        }
    }
    let mut pairs: Vec<((u32, u32), usize)> = common.into_iter().collect();
    pairs.sort_by_key(|&(pair, count)| (std::cmp::Reverse(count), pair));
    let mut known_of_label = BTreeMap::from([(0, 0)]);
    let mut taken = std::collections::BTreeSet::new();
    for ((known, label), _) in pairs {
        if !known_of_label.contains_key(&label) && taken.insert(known) {
            known_of_label.insert(label, known);
        }
    }
    let mut free = truth.iter().max().copied().unwrap_or(0);
    for &label in labels {
        known_of_label.entry(label).or_insert_with(|| {
            free = free.saturating_add(1);
            free
        });
    }
    labels.iter().map(|label| known_of_label[label]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accuracies_by_hand() {
        let truth = [0, 0, 3, 3, 3, 3, 8, 8];
        let labels = [0, 3, 3, 3, 3, 0, 8, 3];
        let of = instance_accuracies(&truth, &labels);
        assert_eq!(of[&3], InstanceAccuracy { own: 4, labelled: 5, right: 3 });
        assert_eq!((of[&3].accuracy(), of[&3].overlap(), of[&8].accuracy()), (0.75, 0.5, 0.5));
        assert_eq!((of.len(), mean_accuracy(&truth, &labels)), (2, 0.625));
        assert_eq!(mean_accuracy(&[0; 3], &[1; 3]), 1.0);
    }

    #[test]
    fn labels_are_matched_one_to_one() {
        let truth = [0, 3, 3, 3, 8, 8, 8, 5];
        let labels = [7, 1, 1, 2, 1, 1, 1, 0];
        // Label 1 shares most with object 8, label 2 is left with object 3, and label 7 gets an unused id.
        assert_eq!(in_ids_of(&truth, &labels), [9, 8, 8, 3, 8, 8, 8, 0]);
        assert!(in_ids_of(&[], &[]).is_empty());
        assert_eq!(mean_accuracy(&truth, &in_ids_of(&truth, &labels)), (1.0 / 3.0 + 1.0 + 0.0) / 3.0);
    }
}
