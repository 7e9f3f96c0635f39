//! What a file that [`export_scene`](crate::export_scene) wrote could not hold of the scene, in words.

use std::path::Path;

use crate::page::too_large_note;
use crate::spz::Clamped;
use crate::{ExportFormat, ExportedScene, Pack, SpzLoss};
use instgs_vk::scene::{InstancedScene, NearPlane, PixelFilter};

impl ExportedScene {
    /// What the file `to` lacks of the scene and what other viewers draw differently, one line each for the user.
    pub fn notes(&self, to: &Path, scene: &InstancedScene, format: ExportFormat) -> Vec<String> {
        let (to, filter) = (to.display(), scene.pixel_filter);
        let mut notes: Vec<String> = spz_note(&self.spz_loss, self.gaussians).into_iter().collect();
        notes.extend(
            moved_note(&self.sog_moved, self.gaussians, ".sog")
                .map(|note| format!("{note}; use .spz, .ply or .instgs")),
        );
        if filter.antialias {
            notes.extend(antialias_note(format).map(String::from));
        }
        if !matches!(format, ExportFormat::Instgs(_) | ExportFormat::Page(_)) && !filter.has_usual_dilation() {
            let (dilation, usual) = (filter.dilation_px2, PixelFilter::default().dilation_px2);
            notes.push(format!(
                "other viewers widen splats by {usual} px^2 instead of this scene's {dilation}, which blurs what is finer than \
                 their pixels; here, .ply keeps it, and other formats are rendered with --dilation {dilation}"
            ));
        }
        if !matches!(format, ExportFormat::Instgs(_) | ExportFormat::Page(_))
            && scene.near_plane != NearPlane::default()
        {
            let (near, usual) = (scene.near_plane.0, NearPlane::default().0);
            notes.push(format!(
                "only .instgs and .html keep the scene's near plane, {near}: elsewhere pictures may begin at {usual}; here, --near \
                 {near} draws it"
            ));
        }
        let (levels, current) = (scene.fitted_levels.len(), scene.current_levels().len());
        match format {
            ExportFormat::Instgs(Pack::Small) if levels > 0 => notes.push(
                "optimised levels of detail are not part of small files; instgs-vk levels makes them again".into(),
            ),
            ExportFormat::Page(_) if levels > 0 => notes.push(
                "optimised levels of detail are not part of pages, which draw at full detail; the scene that Save scene gives \
                 back has none, and instgs-vk levels makes them again"
                    .into(),
            ),
            ExportFormat::Instgs(_) if current < levels => notes.push(format!(
                "{} of {levels} levels of detail were of templates that are changed now, and are left out; instgs-vk levels \
                 makes new ones",
                levels - current
            )),
            _ => {}
        }
        if let ExportFormat::Page(_) = format {
            notes.extend(too_large_note(scene));
        }
        let unused = (scene.source_len() as u64).saturating_sub(self.gaussians);
        if format == ExportFormat::Glb && unused > 0 {
            notes.push(format!(
                "{unused} Gaussians of templates that no instance uses are left out; .instgs keeps them"
            ));
        }
        let unlike = (0..scene.instances.len()).filter(|&k| !scene.looks_like_template(k)).count();
        if format == ExportFormat::SogFolder && unlike > 0 {
            notes.push(format!(
                "{unlike} of {} instances differ from their template by offsets, own Gaussians or colours, which a folder of .sog \
                 files has no place for; .glb and .sog keep them",
                scene.instances.len()
            ));
        }
        notes.into_iter().map(|note| format!("{to}: {note}")).collect()
    }
}

/// What becomes of a scene with opacity compensation in a format that cannot say that it has it; `None` if the format can.
fn antialias_note(format: ExportFormat) -> Option<&'static str> {
    match format {
        ExportFormat::Glb | ExportFormat::GlbOneMesh => {
            Some(".glb has no place for the scene's antialias flag; render it with --antialias")
        }
        ExportFormat::Usda | ExportFormat::Usdc => Some(
            "USD has no place for the scene's antialias flag, so viewers draw what is finer than their pixels too thick; .ply, \
             .spz, .sog and .instgs keep it",
        ),
        _ => None,
    }
}

/// How many of that many Gaussians the rounding of a format moved, and how far; `None` if it is none.
fn moved_note(moved: &Clamped, gaussians: u64, format: &str) -> Option<String> {
    (moved.gaussians > 0).then(|| {
        format!(
            "{} of {gaussians} Gaussians moved by more than their size, up to {:.2e} units, since {format} rounds positions",
            moved.gaussians, moved.farthest
        )
    })
}

/// What an .spz file of that many Gaussians could not hold, in one line; `None` if it holds everything.
fn spz_note(loss: &SpzLoss, gaussians: u64) -> Option<String> {
    let SpzLoss { positions, scales, colours, sh } = loss;
    let clamped = [
        (colours, "colours", format!("by {:.1}", colours.farthest)),
        (sh, "SH", format!("by {:.1}", sh.farthest)),
        (scales, "sizes", format!("by {:.1} in the logarithm", scales.farthest)),
    ];
    let lost = clamped.into_iter().filter(|(clamped, _, _)| clamped.gaussians > 0);
    let mut parts: Vec<String> = lost
        .map(|(clamped, what, farthest)| {
            let count = clamped.gaussians;
            format!("{count} of {gaussians} Gaussians have {what} beyond what .spz can hold (the farthest {farthest})")
        })
        .collect();
    if !parts.is_empty() {
        parts = vec![format!("{}: they were clamped", parts.join(", "))];
    }
    parts.extend(moved_note(positions, gaussians, ".spz"));
    (!parts.is_empty()).then(|| format!("{}; use .ply or .instgs", parts.join(", and ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pack;

    #[test]
    fn losses_of_spz_are_one_line() {
        let clamped = |gaussians, farthest| Clamped { gaussians, farthest };
        assert_eq!(spz_note(&SpzLoss::default(), 60), None);
        let mut loss = SpzLoss { colours: clamped(12, 1.7), ..SpzLoss::default() };
        let want = "12 of 60 Gaussians have colours beyond what .spz can hold (the farthest by 1.7): they were clamped; \
            use .ply or .instgs";
        assert_eq!(spz_note(&loss, 60).as_deref(), Some(want));
        (loss.scales, loss.positions) = (clamped(3, 2f64.ln()), clamped(5, 0.25));
        let text = spz_note(&loss, 60).unwrap_or_default();
        for part in
            ["3 of 60 Gaussians have sizes", "by 0.7 in the logarithm", "5 of 60 Gaussians moved", "2.50e-1 units"]
        {
            assert!(text.contains(part) && !text.contains('\n'), "{text}");
        }
    }

    #[test]
    fn what_sog_moves_and_its_folder_lacks_is_named() {
        let exported = ExportedScene {
            gaussians: 400,
            sog_moved: Clamped { gaussians: 143, farthest: 0.13 },
            ..ExportedScene::default()
        };
        let scene = InstancedScene::default();
        for format in [ExportFormat::Sog, ExportFormat::SogFolder] {
            let notes = exported.notes(Path::new("x.sog"), &scene, format);
            let want = "x.sog: 143 of 400 Gaussians moved by more than their size, up to 1.30e-1 units, since .sog rounds \
                positions; use .spz, .ply or .instgs";
            assert_eq!(notes, [want]);
        }
        let scene = instgs_samples::with_own();
        let notes = |format| ExportedScene::default().notes(Path::new("x"), &scene, format).concat();
        let unlike = (0..scene.instances.len()).filter(|&k| !scene.looks_like_template(k)).count();
        assert!(
            notes(ExportFormat::SogFolder).contains(&format!("{unlike} of 4 instances differ from their template"))
        );
        assert!(unlike > 2, "{unlike}");
        assert!(!notes(ExportFormat::Glb).contains("differ") && !notes(ExportFormat::Sog).contains("differ"));
        // The instances of a .glb may differ in shape.
        let shapes =
            ExportedScene::default().notes(Path::new("x"), &instgs_samples::with_ablations(), ExportFormat::Glb);
        assert!(!shapes.concat().contains("shape"), "{shapes:?}");
    }

    #[test]
    fn levels_that_a_file_lacks_are_named() {
        let mut scene = instgs_samples::with_levels();
        scene.pixel_filter = PixelFilter::default();
        let notes = |scene: &InstancedScene, pack| {
            ExportedScene::default().notes(Path::new("x"), scene, ExportFormat::Instgs(pack))
        };
        assert_eq!(notes(&scene, Pack::F16), [""; 0]);
        let small = notes(&scene, Pack::Small);
        assert!(small.len() == 1 && small[0].contains("not part of small files"), "{small:?}");
        for pack in [Pack::F32, Pack::F16, Pack::Q8, Pack::Small] {
            let page = ExportedScene::default().notes(Path::new("x"), &scene, ExportFormat::Page(pack));
            assert!(page.len() == 1 && page[0].contains("not part of pages"), "{page:?}");
        }
        scene.templates.means[0][0] += 1.0;
        let stale = notes(&scene, Pack::F32);
        assert!(stale.len() == 1 && stale[0].contains("2 of 3 levels of detail were"), "{stale:?}");
    }

    #[test]
    fn formats_without_the_pixel_filter_are_named() {
        let pixel_filter = PixelFilter { antialias: true, dilation_px2: 0.1 };
        let scene = InstancedScene { pixel_filter, ..InstancedScene::default() };
        let notes = |format| ExportedScene::default().notes(Path::new("x"), &scene, format);
        assert_eq!(notes(ExportFormat::Instgs(Pack::F32)), [""; 0]);
        assert!(notes(ExportFormat::SogFolder).iter().all(|note| !note.contains("instances differ")));
        let glb = notes(ExportFormat::Glb);
        assert!(glb.len() == 2 && glb[0].contains("antialias") && glb[1].contains("--dilation 0.1"), "{glb:?}");
        for format in [ExportFormat::Usda, ExportFormat::Usdc] {
            let usd = notes(format);
            assert!(usd.len() == 2 && usd[0].contains("USD has no place for the scene's antialias flag"), "{usd:?}");
        }
        for format in [ExportFormat::Ply, ExportFormat::Spz, ExportFormat::Sog] {
            assert!(notes(format).iter().all(|note| !note.contains("antialias")), "{format:?}");
        }
        assert!(notes(ExportFormat::Ply).len() == 1 && notes(ExportFormat::Ply)[0].starts_with("x: "));
    }
}
