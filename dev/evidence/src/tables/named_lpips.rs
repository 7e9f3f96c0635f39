//! A network of LPIPS with a name for what its values depend on.

use std::path::Path;

use instgs_console::CliError;
use instgs_eval::{EvalError, Lpips, PicturePair};

/// Side of the pictures of [`probe`], pixels: no network needs more.
const SIDE: u32 = 64;

/// A network of LPIPS with its name.
pub(super) struct NamedLpips {
    pub(super) network: Lpips,
    /// Network, path of the weights, and what the network makes of one pair of pictures.
    pub(super) name: String,
}

impl NamedLpips {
    /// Names a network with the weights of the file at `weights`.
    ///
    /// # Errors
    /// The network cannot compare pictures.
    pub(super) fn new(network: Lpips, weights: &Path) -> Result<Self, CliError> {
        let probed = probe(&network)?;
        Ok(Self { name: format!("{}, {}, {probed}", network.net().name(), weights.display()), network })
    }
}

/// The distance of two fixed pictures: another one with other weights, and with another range of the input, which a network
/// does not tell.
fn probe(network: &Lpips) -> Result<f64, EvalError> {
    let colour =
        |factor: u32| move |i: u32| [i * factor % 251, i * 7 % 241, i * factor % 13 * 17].map(|v| v as f32 / 255.0);
    let picture = |factor: u32| (0..SIDE * SIDE).map(colour(factor)).collect::<Vec<_>>();
    let fail = |error| EvalError::Pair { view: "LPIPS of two patterns".into(), error };
    let pair = PicturePair::new((SIDE, SIDE), &picture(3), &picture(5), None).map_err(fail)?;
    Ok(network.distance(&pair)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_eval::{InputRange, Net};

    type Test<T = ()> = Result<T, Box<dyn std::error::Error>>;

    /// Names and shapes of AlexNet's tensors.
    const TENSORS: [(&str, [usize; 4]); 10] = [
        ("features.0", [64, 3, 11, 11]),
        ("features.3", [192, 64, 5, 5]),
        ("features.6", [384, 192, 3, 3]),
        ("features.8", [256, 384, 3, 3]),
        ("features.10", [256, 256, 3, 3]),
        ("lin0.model.1", [1, 64, 1, 1]),
        ("lin1.model.1", [1, 192, 1, 1]),
        ("lin2.model.1", [1, 384, 1, 1]),
        ("lin3.model.1", [1, 256, 1, 1]),
        ("lin4.model.1", [1, 256, 1, 1]),
    ];

    /// Writes a file of weights from -1 to `largest` over their number.
    fn write_weights(path: &Path, largest: f32) -> Test {
        let (mut entries, mut data) = (Vec::new(), Vec::new());
        let mut push = |name: String, shape: &[usize]| {
            let (begin, count) = (data.len(), shape.iter().product::<usize>());
            let fan_in = shape.iter().skip(1).product::<usize>() as f32;
            let value = |i: usize| ((i * 7919 % 1009) as f32 / 1009.0 * (1.0 + largest) - 1.0) / fan_in;
            let positive = |i: usize| if name.starts_with("lin") { value(i).abs() } else { value(i) };
            data.extend((0..count).flat_map(|i| positive(i).to_le_bytes()));
            entries.push(format!(
                r#""{name}":{{"dtype":"F32","shape":{shape:?},"data_offsets":[{begin},{}]}}"#,
                data.len()
            ));
        };
        for (name, shape) in TENSORS {
            push(format!("{name}.weight"), &shape);
            if name.starts_with("features") {
                push(format!("{name}.bias"), &shape[..1]);
            }
        }
        let header = format!("{{{}}}", entries.join(","));
        let header = format!("{header:<width$}", width = header.len().next_multiple_of(8));
        Ok(std::fs::write(path, [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &data].concat())?)
    }

    /// Another range of the input, other weights and another path give another name; the same network gives the same.
    #[test]
    fn the_name_tells_networks_apart_by_all_that_their_values_depend_on() -> Test {
        let folder = tempfile::tempdir()?;
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        write_weights(&a, 1.0)?;
        std::fs::copy(&a, &b)?;
        let name = |path: &Path, range| Test::Ok(NamedLpips::new(Lpips::load(Net::Alex, range, path)?, path)?.name);
        let usual = name(&a, InputRange::MinusOneToOne)?;
        assert!(usual.starts_with(&format!("alex, {}, 0.", a.display())), "{usual}");
        assert_eq!(name(&a, InputRange::MinusOneToOne)?, usual);
        assert_ne!(name(&a, InputRange::ZeroToOne)?, usual);
        assert_ne!(name(&b, InputRange::MinusOneToOne)?, usual);
        write_weights(&a, 0.9)?;
        assert_ne!(name(&a, InputRange::MinusOneToOne)?, usual);
        Ok(())
    }
}
