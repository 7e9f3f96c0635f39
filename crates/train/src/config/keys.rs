//! The keys of a configuration: the values each accepts, and the key that a misspelt name probably means.

use toml::Value;

/// A key and the values that it accepts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Dotted name, for instance `rates.means`.
    pub name: &'static str,
    /// Type and range of its values.
    pub takes: Takes,
}

/// The type and range of a key's values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Takes {
    /// A whole number from the first to the second.
    Whole(u64, u64),
    /// A number from the first to the second.
    Real(f64, f64),
    /// A number above the first, at most the second.
    RealAbove(f64, f64),
    /// A number from the first, below the second.
    RealBelow(f64, f64),
    /// A number above the first, below the second.
    RealBetween(f64, f64),
    /// A Boolean, true or false.
    Flag,
    /// One of the listed words.
    Word(&'static [&'static str]),
    /// Any string, even an empty one.
    Text,
}

use Takes::{Flag, Real, RealAbove, RealBelow, RealBetween, Text, Whole, Word};

/// Largest number of steps: more than any run has, and its product with any value here fits 64 bits.
const STEPS_MAX: u64 = 100_000_000;
/// A learning rate or weight above this is taken for a typing error.
const RATE_MAX: f64 = 1e3;
/// Indices of Gaussians and of their SH coefficients must fit 32 bits.
const GAUSSIANS_MAX: u64 = 80_000_000;

/// Makes a key from its name and the values that it accepts.
pub const fn key(name: &'static str, takes: Takes) -> Key {
    Key { name, takes }
}

/// Every key of the trainer, in the order of `configs/default.toml`.
pub const KEYS: [Key; 108] = [
    key("steps", Whole(1, STEPS_MAX)),
    key("seed", Whole(0, i64::MAX as u64)),
    key("width", Whole(0, 65_536)),
    key("skip_missing", Flag),
    key("pixel_masks", Text),
    key("method", Word(&["3dgs", "instgs"])),
    key("init", Word(&["points", "random"])),
    key("init_scene", Text),
    key("init_count", Whole(1, GAUSSIANS_MAX)),
    key("init_opacity", RealBetween(0.0, 1.0)),
    key("init_scale", RealAbove(0.0, RATE_MAX)),
    key("sh_degree", Whole(0, 3)),
    key("sh_every", Whole(0, STEPS_MAX)),
    key("lambda_dssim", Real(0.0, 1.0)),
    key("background", Word(&["black", "white", "random"])),
    key("antialias", Flag),
    key("dilation", Real(1e-6, 1e6)),
    key("near", RealAbove(0.0, 1e6)),
    key("max_gaussians", Whole(1, GAUSSIANS_MAX)),
    key("strategy", Word(&["densify", "mcmc", "none"])),
    key("eval_every", Whole(0, STEPS_MAX)),
    key("checkpoint_every", Whole(0, STEPS_MAX)),
    key("device_memory_mb", Whole(0, 1 << 24)),
    key("rates.means", Real(0.0, RATE_MAX)),
    key("rates.means_final", RealAbove(0.0, RATE_MAX)),
    key("rates.means_steps", Whole(0, STEPS_MAX)),
    key("rates.sh_dc", Real(0.0, RATE_MAX)),
    key("rates.sh_rest", Real(0.0, RATE_MAX)),
    key("rates.opacity", Real(0.0, RATE_MAX)),
    key("rates.log_scales", Real(0.0, RATE_MAX)),
    key("rates.quats", Real(0.0, RATE_MAX)),
    key("rates.final_factor", RealAbove(0.0, RATE_MAX)),
    key("rates.decay_steps", Whole(0, STEPS_MAX)),
    key("rates.decay_start", RealBelow(0.0, 1.0)),
    key("rates.beta1", RealBelow(0.0, 1.0)),
    key("rates.beta2", RealBelow(0.0, 1.0)),
    // Below the smallest normal f32 it would count as 0 on the device.
    key("rates.eps", Real(1.2e-38, 1.0)),
    key("densify.start", Whole(0, STEPS_MAX)),
    key("densify.stop", Whole(0, STEPS_MAX)),
    key("densify.stop_fraction", RealAbove(0.0, 1.0)),
    key("densify.every", Whole(1, STEPS_MAX)),
    key("densify.gradient_threshold", RealAbove(0.0, RATE_MAX)),
    key("densify.growth", Word(&["clone_or_split", "halves"])),
    key("densify.split_fraction", RealAbove(0.0, RATE_MAX)),
    key("densify.split_count", Whole(2, 16)),
    key("densify.split_shrink", Real(1.0, 100.0)),
    key("densify.half_opacity", Real(0.01, 1.0)),
    key("densify.opacity_min", RealBelow(0.0, 1.0)),
    key("densify.opacity_reset_every", Whole(0, STEPS_MAX)),
    key("densify.opacity_reset_to", RealBelow(0.0, 1.0)),
    key("densify.opacity_decay", RealBelow(0.0, 1.0)),
    key("densify.recycle", RealBelow(0.0, 1.0)),
    key("densify.recycle_every", Whole(1, STEPS_MAX)),
    key("densify.screen_size_max_px", Real(0.0, 1e6)),
    key("densify.world_size_max", Real(0.0, RATE_MAX)),
    key("mcmc.start", Whole(0, STEPS_MAX)),
    key("mcmc.stop", Whole(0, STEPS_MAX)),
    key("mcmc.stop_fraction", RealAbove(0.0, 1.0)),
    key("mcmc.every", Whole(1, STEPS_MAX)),
    key("mcmc.growth", Real(1.0, 10.0)),
    key("mcmc.opacity_min", RealBelow(0.0, 1.0)),
    key("mcmc.noise", Real(0.0, 1e9)),
    key("mcmc.opacity_regularisation", Real(0.0, RATE_MAX)),
    key("mcmc.scale_regularisation", Real(0.0, RATE_MAX)),
    key("exposure.rate", Real(0.0, 1.0)),
    key("exposure.rate_final", RealAbove(0.0, 1.0)),
    key("offsets.position", Flag),
    key("offsets.sh_dc", Flag),
    key("offsets.opacity", Flag),
    key("offsets.sh_degree", Whole(0, 3)),
    key("offsets.sh_every", Whole(1, 1000)),
    key("offsets.covariance", Flag),
    key("joint.steps", Whole(1, STEPS_MAX)),
    key("joint.refine_poses", Flag),
    key("joint.refine_scales", Flag),
    key("joint.instances_every", Whole(1, 1000)),
    key("joint.final_factor", RealAbove(0.0, RATE_MAX)),
    key("joint.decay_start", RealBelow(0.0, 1.0)),
    key("joint.decay_steps", Whole(0, STEPS_MAX)),
    key("joint.prune_opacity", RealBelow(0.0, 1.0)),
    key("joint.grow_fraction", Real(0.0, 1.0)),
    key("joint.max_expanded", Real(0.0, 1e3)),
    key("joint.own_share", Real(0.0, 1.0)),
    key("joint.color_matrix_rate", Real(0.0, RATE_MAX)),
    key("template_rates.means", Real(0.0, RATE_MAX)),
    key("template_rates.means_final", RealAbove(0.0, RATE_MAX)),
    key("template_rates.sh_dc", Real(0.0, RATE_MAX)),
    key("template_rates.sh_rest", Real(0.0, RATE_MAX)),
    key("template_rates.opacity", Real(0.0, RATE_MAX)),
    key("template_rates.log_scales", Real(0.0, RATE_MAX)),
    key("template_rates.quats", Real(0.0, RATE_MAX)),
    key("background_rates.means", Real(0.0, RATE_MAX)),
    key("background_rates.means_final", RealAbove(0.0, RATE_MAX)),
    key("background_rates.sh_dc", Real(0.0, RATE_MAX)),
    key("background_rates.sh_rest", Real(0.0, RATE_MAX)),
    key("background_rates.opacity", Real(0.0, RATE_MAX)),
    key("background_rates.log_scales", Real(0.0, RATE_MAX)),
    key("background_rates.quats", Real(0.0, RATE_MAX)),
    key("offset_rates.means", Real(0.0, RATE_MAX)),
    key("offset_rates.means_final", RealAbove(0.0, RATE_MAX)),
    key("offset_rates.sh_dc", Real(0.0, RATE_MAX)),
    key("offset_rates.sh_rest", Real(0.0, RATE_MAX)),
    key("offset_rates.opacity", Real(0.0, RATE_MAX)),
    key("offset_rates.log_scales", Real(0.0, RATE_MAX)),
    key("offset_rates.quats", Real(0.0, RATE_MAX)),
    key("pose_rates.translation", Real(0.0, RATE_MAX)),
    key("pose_rates.rotation", Real(0.0, RATE_MAX)),
    key("pose_rates.log_scale", Real(0.0, RATE_MAX)),
];

impl std::fmt::Display for Takes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Whole(low, high) => write!(f, "a whole number from {low} to {high}"),
            Real(low, high) => write!(f, "a number from {low:?} to {high:?}"),
            RealAbove(low, high) => write!(f, "a number above {low:?}, at most {high:?}"),
            RealBelow(low, high) => write!(f, "a number from {low:?}, below {high:?}"),
            RealBetween(low, high) => write!(f, "a number above {low:?}, below {high:?}"),
            Flag => f.write_str("true or false"),
            Text => f.write_str("a text"),
            Word(words) => {
                f.write_str(if words.len() > 1 { "one of " } else { "" })?;
                words.iter().enumerate().try_for_each(|(i, w)| write!(f, "{}\"{w}\"", if i > 0 { ", " } else { "" }))
            }
        }
    }
}

impl Takes {
    /// The value converted to the key's type; `None` if not allowed. An integer may be written as `3e4`, a number as
    /// `1`.
    pub fn accept(&self, value: &Value) -> Option<Value> {
        match (*self, value) {
            (Whole(low, high), _) => {
                let whole = whole(value).filter(|n| (low..=high).contains(n))?;
                i64::try_from(whole).ok().map(Value::Integer)
            }
            (Real(low, high), _) => real(value, |x| x >= low && x <= high),
            (RealAbove(low, high), _) => real(value, |x| x > low && x <= high),
            (RealBelow(low, high), _) => real(value, |x| x >= low && x < high),
            (RealBetween(low, high), _) => real(value, |x| x > low && x < high),
            (Flag, Value::Boolean(_)) | (Text, Value::String(_)) => Some(value.clone()),
            (Word(words), Value::String(word)) => words.contains(&word.as_str()).then(|| value.clone()),
            (Flag | Word(_) | Text, _) => None,
        }
    }
}

fn whole(value: &Value) -> Option<u64> {
    /// f64 holds every whole number up to here.
    const EXACT: f64 = (1u64 << 53) as f64;
    match *value {
        Value::Integer(n) => u64::try_from(n).ok(),
        Value::Float(x) => (x.fract() == 0.0 && (0.0..=EXACT).contains(&x)).then_some(x as u64),
        _ => None,
    }
}

fn real(value: &Value, fits: impl Fn(f64) -> bool) -> Option<Value> {
    let x = match *value {
        Value::Integer(n) => n as f64,
        Value::Float(x) => x,
        _ => return None,
    };
    // NaN lies in no range.
    fits(x).then_some(Value::Float(x))
}

/// The key of `keys` nearest to `name` by edit distance: `rates.means` for `means`, its first key for a section.
pub fn nearest(keys: &[Key], name: &str) -> &'static str {
    if let Some(key) = keys.iter().find(|key| key.name.split_once('.').is_some_and(|(section, _)| section == name)) {
        return key.name;
    }
    let last = |s: &str| s.rsplit('.').next().unwrap_or_default().to_lowercase();
    let distance = |key: &Key| {
        let whole = edit_distance(&name.to_lowercase(), key.name);
        // The right key in the wrong section counts as about one wrong letter.
        whole.min(1 + edit_distance(&last(name), &last(key.name)))
    };
    keys.iter().min_by_key(|key| distance(key)).map_or("steps", |key| key.name)
}

/// Number of letters to insert, remove or replace to turn `a` into `b` (Levenshtein distance).
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edit_distances_by_hand() {
        let cases = [("", "abc", 3), ("abc", "", 3), ("kitten", "sitting", 3), ("steps", "steps", 0), ("ab", "ba", 2)];
        for (a, b, want) in cases {
            assert_eq!(edit_distance(a, b), want, "{a} {b}");
        }
    }

    #[test]
    fn nearest_keys() {
        for (written, meant) in [
            ("step", "steps"),
            ("means", "rates.means"),
            ("rates.meens", "rates.means"),
            ("densify.stops", "densify.stop"),
            ("densify", "densify.start"),
            ("Width", "width"),
            ("max_gausians", "max_gaussians"),
            ("rates.noise", "mcmc.noise"),
        ] {
            assert_eq!(nearest(&KEYS, written), meant);
        }
    }

    #[test]
    fn ranges_at_their_ends() {
        let ok = |takes: Takes, text: &str| text.parse().ok().and_then(|v: Value| takes.accept(&v)).is_some();
        for (takes, yes, no) in [
            (Whole(1, 5), &["1", "5", "5.0", "1e0"][..], &["0", "6", "-1", "1.5", "\"3\"", "true", "nan", "1e300"][..]),
            (Real(0.0, 1.0), &["0", "1", "0.5", "1.0"], &["-0.1", "1.1", "nan", "inf", "\"0\"", "false"]),
            (RealAbove(0.0, 1.0), &["1e-300", "1"], &["0", "0.0", "1.0001"]),
            (RealBelow(0.0, 1.0), &["0", "0.999"], &["1", "-1e-9"]),
            (RealBetween(0.0, 1.0), &["1e-300", "0.999"], &["0", "1", "nan", "\"0.5\""]),
            (Flag, &["true", "false"], &["0", "\"true\""]),
            (Text, &["\"\"", "\"a/b c\""], &["0", "true", "[]"]),
            (Word(&["a", "b"]), &["\"a\"", "\"b\""], &["\"c\"", "\"\"", "1"]),
        ] {
            yes.iter().for_each(|text| assert!(ok(takes, text), "{takes} refuses {text}"));
            no.iter().for_each(|text| assert!(!ok(takes, text), "{takes} accepts {text}"));
        }
        assert_eq!(Whole(0, 9).accept(&Value::Float(3.0)), Some(Value::Integer(3)));
        assert_eq!(Real(0.0, 9.0).accept(&Value::Integer(3)), Some(Value::Float(3.0)));
    }
}
