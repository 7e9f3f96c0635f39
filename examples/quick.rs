use instgs_vk::{gpu::*, io, kernels::*, render::*};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let gpu = Gpu::open(&GpuOptions { validation: std::env::var("VAL").is_ok(), ..Default::default() }).unwrap();
    let mut v = Variant::for_device(gpu.caps());
    if let Ok(t) = std::env::var("TILE") {
        v.tile_size = t.parse().unwrap();
    }
    if let Ok(t) = std::env::var("RADIX") {
        v.radix_workgroup_size = t.parse().unwrap();
    }
    if let Ok(t) = std::env::var("WG") {
        v.workgroup_size = t.parse().unwrap();
    }
    if let Ok(t) = std::env::var("BLEND") {
        v.blend_workgroup_size = t.parse().unwrap();
    }
    eprintln!("{v:?}");
    let mut r = Renderer::with_variant(&gpu, v, true).unwrap();
    let scene = io::load_scene(std::path::Path::new(&a[1])).unwrap().scene;
    let ds = r.upload(&scene).unwrap();
    let cams = io::camera_file::read_cameras(std::path::Path::new(&a[2])).unwrap();
    let n: usize = a[3].parse().unwrap();
    for (ci, cam) in cams.iter().enumerate() {
        let mut ts = vec![];
        let mut st = FrameStats::default();
        let t0 = std::time::Instant::now();
        r.render(&ds, cam, &RenderOptions::default()).unwrap();
        eprintln!("first {:?}", t0.elapsed());
        let mut passes: std::collections::BTreeMap<&str, Vec<f64>> = Default::default();
        for _ in 0..n {
            let t = std::time::Instant::now();
            st = r.render(&ds, cam, &RenderOptions::default()).unwrap();
            ts.push(t.elapsed().as_secs_f64() * 1e3);
            let mut m: std::collections::BTreeMap<&str, f64> = Default::default();
            for (k, ms) in &st.passes_ms {
                *m.entry(k).or_default() += ms;
            }
            for (k, v) in m {
                passes.entry(k).or_default().push(v);
            }
        }
        let med = |v: &mut Vec<f64>| {
            v.sort_by(f64::total_cmp);
            v[v.len() / 2]
        };
        println!(
            "cam {ci}: median {:.1} ms, visible {} isect {} slabs {} redone {}",
            med(&mut ts),
            st.visible,
            st.intersections,
            st.slabs,
            st.redone
        );
        for (k, v) in &mut passes {
            println!("   {k:30} {:8.2}", med(v));
        }
        let p = r.download().unwrap();
        image::save_buffer(format!("/tmp/q{ci}.png"), &p.rgb8(), p.width, p.height, image::ColorType::Rgb8).unwrap();
    }
    for m in gpu.validation_messages().take() {
        eprintln!("VALIDATION {m}");
    }
}
