use super::*;
use instgs_vk::math::sh::eval_sh;

const INRIA: InitialShape = InitialShape { opacity: 0.1, scale: 1.0 };

fn cloud(positions: Vec<[f32; 3]>) -> PointCloud {
    PointCloud { colors: (0..positions.len()).map(|i| [i as u8, 128, 255]).collect(), positions }
}

/// Mean squared distances by brute force: all distances, sorted.
fn slow(positions: &[[f32; 3]]) -> Vec<f64> {
    let squared = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (f64::from(a[k]) - f64::from(b[k])).powi(2)).sum::<f64>();
    let mean = |i: usize| {
        let others = positions.iter().enumerate().filter(|(j, _)| *j != i);
        let mut all: Vec<f64> = others.map(|(_, b)| squared(&positions[i], b)).collect();
        all.sort_by(f64::total_cmp);
        all.truncate(3);
        all.iter().sum::<f64>() / all.len().max(1) as f64
    };
    (0..positions.len()).map(mean).collect()
}

#[test]
fn a_point_becomes_a_gaussian_of_its_colour_and_spacing() {
    // Neighbours of the first point at distances 1, 2 and 3: mean square 14/3. The far point is not counted.
    let points = cloud(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, 50.0]]);
    let out = from_points(&points, 2, INRIA);
    assert_eq!((out.len(), out.sh.len(), out.sh_degree), (5, 45, 2));
    assert_eq!((out.means[3], out.quats[3]), ([0.0, 0.0, -3.0], [1.0, 0.0, 0.0, 0.0]));
    assert_eq!(out.log_scales[0], [(14.0f64 / 3.0).sqrt().ln() as f32; 3]);
    assert!((1.0 / (1.0 + f64::from(-out.opacity_logits[1]).exp()) - 0.1).abs() < 1e-7);
    // The renderer's colour, SH + 0.5, is the point's, from every side.
    let rgb = eval_sh(2, out.sh_of(4), DVec3::new(0.6, 0.0, 0.8)) + 0.5;
    assert!((rgb - DVec3::new(4.0 / 255.0, 128.0 / 255.0, 1.0)).length() < 1e-7, "{rgb}");
    assert_eq!(from_points(&PointCloud::default(), 3, INRIA), Gaussians { sh_degree: 3, ..Gaussians::default() });
    assert_eq!(from_points(&cloud(vec![[1.0; 3]]), 0, INRIA).log_scales, [[(0.5 * 1e-7f64.ln()) as f32; 3]]);
}

#[test]
fn opacity_and_scale_are_those_asked_for() {
    let points = cloud(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -3.0]]);
    let mcmc = InitialShape { opacity: 0.5, scale: 0.1 };
    assert_eq!(InitialShape::new(&TrainConfig::default()), INRIA);
    let cameras = ring(3, false);
    let random = |shape| random_in_view(&cameras, 50, 1, 0, shape);
    for (small, usual) in
        [(from_points(&points, 1, mcmc), from_points(&points, 1, INRIA)), (random(mcmc), random(INRIA))]
    {
        assert!(small.opacity_logits.iter().all(|&logit| logit == 0.0));
        for (a, b) in small.log_scales.iter().flatten().zip(usual.log_scales.iter().flatten()) {
            assert!((a - b - 0.1f32.ln()).abs() < 2e-6, "{a} {b}");
        }
        assert_eq!((small.means, small.sh, small.quats), (usual.means, usual.sh, usual.quats));
    }
}

#[test]
fn neighbours_are_those_of_the_slow_search() {
    let mut rng = Rng::new(3);
    let mut random = |n: usize, axis: &dyn Fn(&mut Rng, usize) -> f32| -> Vec<[f32; 3]> {
        (0..n).map(|_| std::array::from_fn(|k| axis(&mut rng, k))).collect()
    };
    for (name, positions) in [
        ("cube", random(700, &|r, _| r.range(-1.0, 1.0) as f32)),
        ("plane", random(700, &|r, k| if k == 1 { 2.5 } else { r.range(-1.0, 1.0) as f32 })),
        ("line", random(700, &|r, k| if k == 2 { r.range(-1.0, 1.0) as f32 } else { -1.0 })),
        ("lattice", random(700, &|r, _| r.index(6) as f32)),
        ("two places", random(700, &|r, k| if k == 0 { r.index(2) as f32 } else { 0.0 })),
        ("large numbers", random(700, &|r, _| (1e30 * r.range(-1.0, 1.0)) as f32)),
        ("pairs and triples", {
            let some = random(300, &|r, _| r.range(-1.0, 1.0) as f32);
            [&some[..], &some[..200], &some[..100], &[[0.0; 3], [-0.0; 3], [0.0, -0.0, 0.0]]].concat()
        }),
        ("three points", random(3, &|r, _| r.range(-1.0, 1.0) as f32)),
    ] {
        for (got, want) in mean_squared_distances(&positions).into_iter().zip(slow(&positions)) {
            assert!((got - want).abs() <= 1e-12 * want, "{name}: {got} {want}");
        }
    }
}

#[test]
fn equal_points_and_planes_are_no_trouble() {
    for count in [2, 33, 1000, 300_000] {
        let out = from_points(&cloud(vec![[0.25, -3.0, 7.0]; count]), 0, INRIA);
        assert!(out.log_scales.iter().all(|s| *s == [(0.5 * 1e-7f64.ln()) as f32; 3]), "{count}");
        assert_eq!(out, from_points(&cloud(vec![[0.25, -3.0, 7.0]; count]), 0, INRIA));
    }
    // A regular grid on a plane: inner points have neighbours at distance 1.
    let grid = cloud((0..40_000).map(|i| [(i % 200) as f32, 5.0, (i / 200) as f32]).collect());
    let out = from_points(&grid, 0, INRIA);
    assert!(out.log_scales.iter().filter(|s| **s == [0.0; 3]).count() >= 198 * 198);
}

fn ring(count: usize, outwards: bool) -> Vec<Camera> {
    let at = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / count as f64;
        let eye = DVec3::new(10.0 + 4.0 * angle.cos(), 1.0, -20.0 + 4.0 * angle.sin());
        let middle = DVec3::new(10.0, 0.0, -20.0);
        let target = if outwards { 2.0 * eye - middle } else { middle };
        Camera::look_at("c", eye, target, DVec3::NEG_Y, 1.0, (64, 48))
    };
    (0..count).map(at).collect()
}

#[test]
fn random_points_are_where_cameras_look() {
    let inwards = ring(12, false);
    let (centre, half) = region_in_view(&inwards);
    assert!(centre.distance(DVec3::new(10.0, 0.0, -20.0)) < 1e-9 && (half - 4.0).abs() < 1e-9, "{centre} {half}");
    let outwards = ring(12, true);
    let (centre, half) = region_in_view(&outwards);
    assert!(centre.distance(DVec3::new(10.0, 1.0, -20.0)) < 1e-9 && (half - 12.0).abs() < 1e-9, "{centre} {half}");
    // Two cameras 4 cm apart that look at a point 3 m away: the cube has the size of what they see there.
    let eye =
        |x: f64| Camera::look_at("c", DVec3::new(x, 0.0, 0.0), DVec3::new(0.0, 0.0, 3.0), DVec3::NEG_Y, 1.0, (64, 48));
    let (centre, half) = region_in_view(&[eye(-0.2), eye(0.2)]);
    assert!(centre.distance(DVec3::new(0.0, 0.0, 3.0)) < 1e-9 && (half - 1.5).abs() < 0.01, "{centre} {half}");
    for cameras in [inwards, outwards, vec![eye(0.0)], vec![eye(0.0); 3]] {
        let out = random_in_view(&cameras, 500, 9, 1, INRIA);
        assert_eq!((out.len(), out.sh.len()), (500, 2000));
        let seen = |m: &[f32; 3]| cameras.iter().any(|c| sees(c, DVec3::from(m.map(f64::from)), 1e-3));
        let count = out.means.iter().filter(|m| seen(m)).count();
        // A single camera sees 1/15 of the cube: 64 draws miss that with a probability of 1.2 %, 6 of 500, +-2.4.
        assert!(count >= if cameras.len() > 3 { 500 } else { 482 }, "{count}");
        assert!((0..500).all(|i| out.is_finite(i)));
        assert_eq!(out, random_in_view(&cameras, 500, 9, 1, INRIA));
        assert_ne!(out.means, random_in_view(&cameras, 500, 10, 1, INRIA).means);
    }
}

#[test]
fn the_extent_is_that_of_the_cameras_or_of_the_points() {
    let points = cloud(vec![[10.0, 1.0, -13.0], [10.0, 1.0, -13.0], [900.0; 3]]);
    assert!((scene_extent(&ring(8, false), &points) - 4.4).abs() < 1e-9);
    let one = vec![Camera::look_at("c", DVec3::new(10.0, 1.0, -20.0), DVec3::ZERO, DVec3::Y, 1.0, (64, 48)); 4];
    assert!((scene_extent(&one, &points) - 7.0).abs() < 1e-6);
    assert_eq!(scene_extent(&one, &PointCloud::default()), 1.0);
    assert_eq!(scene_extent(&[], &PointCloud::default()), 1.0);
}
