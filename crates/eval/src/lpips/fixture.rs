//! LPIPS against the official package (lpips 0.1.4 on torch, f64): networks and pictures made by the formulas of
//! `tools/models/make_lpips_fixture.py`, expected distances in `tests/fixtures/lpips.json`.

use std::convert::Infallible;

use serde::Deserialize;

use super::network::Layer;
use super::*;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Largest relative difference allowed per block and in total. Measured: alex 3e-6, vgg 5e-6, squeeze 7e-6; the
/// planted errors below 0.05 to 0.8.
const TOLERANCE: f64 = 1e-4;

#[derive(Deserialize)]
struct Fixture {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    net: String,
    width: u32,
    height: u32,
    range: String,
    layers: Vec<f64>,
    total: f64,
}

fn cases() -> Result<Vec<Case>, serde_json::Error> {
    Ok(serde_json::from_str::<Fixture>(include_str!("../../../../tests/fixtures/lpips.json"))?.cases)
}

/// `count` pseudo-random words derived from a name: FNV-1a of the name seeds SplitMix64.
fn words(name: &str, count: usize) -> impl Iterator<Item = u64> + use<> {
    let seed = name
        .bytes()
        .fold(0xCBF2_9CE4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3));
    (1..=count as u64).map(move |i| {
        let mut z = seed.wrapping_add(i.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    })
}

fn tensor(net: Net, name: &str, shape: &[usize]) -> Vec<f32> {
    let fan_in: usize = shape[1..].iter().product();
    let value = |top24: f64| match name {
        _ if name.starts_with("lin") => top24 / f64::from(1 << 24) * 0.1,
        _ if name.ends_with("bias") => (top24 / f64::from(1 << 23) - 1.0) * 0.1,
        _ => (top24 / f64::from(1 << 23) - 1.0) * (6.0 / fan_in as f64).sqrt(),
    };
    let count = shape.iter().product();
    words(&format!("{}.{name}", net.name()), count).map(|word| value((word >> 40) as f64) as f32).collect()
}

fn network(net: Net, range: InputRange) -> Lpips {
    let blocks = match weights::build(net, |name, shape| Ok::<_, Infallible>(tensor(net, name, shape))) {
        Ok(blocks) => blocks,
        Err(never) => match never {},
    };
    Lpips::new(net, range, blocks)
}

/// Render and target pictures of the given size.
fn pictures(width: u32, height: u32) -> [Vec<[f32; 3]>; 2] {
    let pixels = (width * height) as usize;
    let noise: Vec<u64> = words("render", 3 * pixels).collect();
    let target = |i: usize, c: usize| (3 * (i % width as usize) + 5 * (i / width as usize) + 40 * c) % 256;
    let render = |i: usize, c: usize| (target(i, c) as i64 + (noise[3 * i + c] >> 59) as i64 - 16).clamp(0, 255);
    let picture = |value: &dyn Fn(usize, usize) -> f32| {
        (0..pixels).map(|i| std::array::from_fn(|c| value(i, c) / 255.0)).collect()
    };
    [picture(&|i, c| render(i, c) as f32), picture(&|i, c| target(i, c) as f32)]
}

fn pair(width: u32, height: u32) -> Result<PicturePair, crate::PairError> {
    let [render, target] = pictures(width, height);
    PicturePair::new((width, height), &render, &target, None)
}

/// The largest relative difference of a network's results from the official ones.
fn worst(lpips: &Lpips, case: &Case) -> Result<f64, Box<dyn std::error::Error>> {
    let got = lpips.stage_distances(&pair(case.width, case.height)?)?;
    assert_eq!(got.len(), case.layers.len());
    let total = (got.iter().sum::<f64>(), case.total);
    let pairs = got.into_iter().zip(case.layers.iter().copied()).chain([total]);
    Ok(pairs.map(|(got, want)| (got / want - 1.0).abs()).fold(0.0, f64::max))
}

fn range_of(case: &Case) -> InputRange {
    if case.range == "11" { InputRange::MinusOneToOne } else { InputRange::ZeroToOne }
}

#[test]
fn agrees_with_the_official_package() -> Outcome {
    for net in Net::ALL {
        let mut lpips = network(net, InputRange::default());
        let of_net: Vec<Case> = cases()?.into_iter().filter(|case| case.net == net.name()).collect();
        assert_eq!(of_net.len(), 4);
        for case in of_net {
            lpips.range = range_of(&case);
            let worst = worst(&lpips, &case)?;
            assert!(worst < TOLERANCE, "{} {}x{} {}: {worst:e}", case.net, case.width, case.height, case.range);
        }
    }
    Ok(())
}

/// Each plausible implementation error is far outside the tolerance.
#[test]
fn planted_errors_are_seen() -> Outcome {
    let all = cases()?;
    let case = |net: &str| all.iter().find(|c| c.net == net && c.range == "11").ok_or("no such case");
    let seen = |lpips: &Lpips, net: &str| -> Result<bool, Box<dyn std::error::Error>> {
        Ok(worst(lpips, case(net)?)? > 10.0 * TOLERANCE)
    };
    let mut floor = network(Net::Squeeze, InputRange::MinusOneToOne);
    for layer in floor.blocks.iter_mut().flat_map(|block| &mut block.layers) {
        if let Layer::Pool(window) = layer {
            window.ceil = false;
        }
    }
    assert!(seen(&floor, "squeeze")?, "max pools without ceil mode");
    let mut swapped = network(Net::Squeeze, InputRange::MinusOneToOne);
    if let Some(Layer::Fire { expand, .. }) = swapped.blocks[1].layers.get_mut(1) {
        expand.swap(0, 1);
    }
    assert!(seen(&swapped, "squeeze")?, "expand 3x3 before 1x1");
    let other_range = network(Net::Alex, InputRange::ZeroToOne);
    assert!(seen(&other_range, "alex")?, "the other input range");
    let mut heads = network(Net::Alex, InputRange::MinusOneToOne);
    heads.blocks[2].head.reverse();
    assert!(seen(&heads, "alex")?, "a head for other channels");
    let mut padding = network(Net::Alex, InputRange::MinusOneToOne);
    if let Some(Layer::Conv(convolution)) = padding.blocks[0].layers.first_mut() {
        convolution.window.padding = 1;
    }
    assert!(seen(&padding, "alex")?, "another padding");
    Ok(())
}

#[test]
fn smallest_pictures_and_equal_ones() -> Outcome {
    for (net, smallest) in [(Net::Alex, 31), (Net::Vgg, 16), (Net::Squeeze, 17)] {
        let lpips = network(net, InputRange::default());
        assert_eq!(lpips.smallest_side, smallest, "{net:?}");
        assert!(lpips.distance(&pair(smallest, 40)?)? > 0.0);
        let error = lpips.distance(&pair(40, smallest - 1)?).err().map(|e| e.to_string());
        assert!(error.is_some_and(|e| e.contains(net.name()) && e.contains(&format!("{smallest}x{smallest}"))));
        let [target, _] = pictures(40, 40);
        assert_eq!(lpips.distance(&PicturePair::new((40, 40), &target, &target, None)?)?, 0.0);
    }
    Ok(())
}

/// Shape and values of a tensor.
type Content = (Vec<usize>, Vec<f32>);

/// A weight file of the network `net_name` with the squeeze network's tensors; `edit` changes a tensor or drops it.
fn file_of(net_name: &str, edit: impl Fn(&str, Vec<usize>, Vec<f32>) -> Option<Content>) -> Vec<u8> {
    let mut tensors = Vec::new();
    let read = |name: &str, shape: &[usize]| {
        let values = tensor(Net::Squeeze, name, shape);
        tensors
            .extend(edit(name, shape.to_vec(), values.clone()).map(|(shape, values)| (name.to_owned(), shape, values)));
        Ok::<_, Infallible>(values)
    };
    let Ok(_) = weights::build(Net::Squeeze, read);
    let bytes: Vec<_> = tensors.iter().map(|(n, s, v)| (n, s, bytemuck::cast_slice::<f32, u8>(v))).collect();
    let views = bytes.iter().filter_map(|(n, s, b)| {
        Some((n.as_str(), safetensors::tensor::TensorView::new(safetensors::Dtype::F32, s.to_vec(), b).ok()?))
    });
    let metadata = std::collections::HashMap::from([("net".to_owned(), net_name.to_owned())]);
    safetensors::serialize(views, Some(metadata)).unwrap_or_default()
}

#[test]
fn weight_files_are_read_and_errors_name_the_tensor() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("squeeze.safetensors");
    let load = |bytes: &[u8]| -> Result<Lpips, String> {
        std::fs::write(&path, bytes).map_err(|e| e.to_string())?;
        Lpips::load(Net::Squeeze, InputRange::default(), &path).map_err(|e| e.to_string())
    };
    let pair = pair(40, 33)?;
    let whole = file_of("squeeze", |_, shape, values| Some((shape, values)));
    let same = network(Net::Squeeze, InputRange::default()).distance(&pair)?;
    assert_eq!(load(&whole)?.distance(&pair)?, same);

    const PART: &str = "features.6.expand3x3.weight";
    let error = |edit: &dyn Fn(Vec<usize>, Vec<f32>) -> Option<Content>, wanted: &[&str]| {
        let file = file_of("squeeze", |name, s, v| if name == PART { edit(s, v) } else { Some((s, v)) });
        let text = load(&file).err().unwrap_or_default();
        assert!(wanted.iter().all(|w| text.contains(w)) && !text.contains('\n'), "{text:?}");
    };
    error(&|_, _| None, &["squeeze.safetensors", PART, "is missing"]);
    error(&|s, v| Some((vec![s[1], s[0], 3, 3], v)), &[PART, "[32, 128, 3, 3]", "[128, 32, 3, 3]"]);
    error(&|s, v| Some((s, [&[f32::NAN], &v[1..]].concat())), &[PART, "not finite"]);
    let other = load(&file_of("alex", |_, s, v| Some((s, v)))).err().unwrap_or_default();
    assert!(other.contains("weights of alex, not of squeeze"), "{other}");
    let cut = load(&whole[..whole.len() / 2]).err().unwrap_or_default();
    assert!(cut.contains("not a whole safetensors file"), "{cut}");
    let missing = Lpips::load(Net::Vgg, InputRange::default(), &folder.path().join("x")).err();
    let command =
        format!("python3 tools/models/convert_lpips.py --net vgg --out {}", folder.path().join("x").display());
    assert!(missing.is_some_and(|e| e.to_string().contains(&command)));
    Ok(())
}
