//! The page's sections with pictures of the stages from masks to templates.

use super::format::{count, escape, fixed};
use super::pictures::address;
use super::run_report::RunReport;
use super::stage_pictures::data::{GroupOverlay, ObjectColor, OverlayTile, StagePictures, StageView, TemplatePictures};
use super::{PictureError, Rgb8};
use instgs_objects::register::{InstanceRegistration, Verdict};

/// Upper bound of the objects in the legend: more do not help a reader.
const MOST_LISTED: usize = 36;

/// HTML text, or the picture that could not be encoded.
type Html = Result<String, PictureError>;

/// The section on masks, objects and labels of some views.
pub(super) fn segmentation(pictures: &StagePictures) -> Html {
    if pictures.views.is_empty() {
        return Ok(String::new());
    }
    let notes: String = pictures.notes.iter().map(|note| format!("<p class=\"soft\">{}</p>\n", escape(note))).collect();
    let views = pictures.views.iter().map(view).collect::<Html>()?;
    Ok([notes, legend(&pictures.objects), views].concat())
}

pub(super) fn legend(objects: &[ObjectColor]) -> String {
    let entry = |object: &ObjectColor| {
        let name = object.name.as_deref().map(|name| format!("{} ", escape(name))).unwrap_or_default();
        format!("<span>{}{name}{}</span>\n", swatch(object.color), object.id)
    };
    let shown: String = objects.iter().take(MOST_LISTED).map(entry).collect();
    let more = match objects.len().saturating_sub(MOST_LISTED) {
        0 => String::new(),
        left => format!("<span>and {} more</span>\n", count(left as u64)),
    };
    format!("<p class=\"legend\">{shown}{more}</p>\n")
}

fn swatch([r, g, b]: [u8; 3]) -> String {
    format!("<i class=\"swatch\" style=\"background:#{r:02x}{g:02x}{b:02x}\"></i>")
}

fn view(view: &StageView) -> Html {
    let name = &view.name;
    let columns = [
        ("photograph", Some(&view.photo)),
        ("masks as given", view.given.as_ref()),
        ("objects of the masks", view.objects.as_ref()),
        ("labelled Gaussians", Some(&view.labels)),
    ];
    let mut out = format!("<div class=\"view\"><h3>{}</h3>\n<div class=\"quad\">\n", escape(name));
    for (caption, picture) in columns {
        out += &match picture {
            Some(picture) => figure(picture, name, caption)?,
            None => format!("<figure><figcaption>{caption}: the view has none</figcaption></figure>\n"),
        };
    }
    Ok(out + "</div></div>\n")
}

fn figure(picture: &Rgb8, of: &str, caption: &str) -> Html {
    let address = address(picture).map_err(|e| PictureError::OnPage(format!("{of}, {caption}"), Box::new(e)))?;
    let of = escape(of);
    Ok(format!("<figure><img src=\"{address}\" alt=\"{of}: {caption}\"/><figcaption>{caption}</figcaption></figure>\n"))
}

/// The section on the poses of every group.
pub(super) fn poses(pictures: &StagePictures, report: &RunReport) -> Html {
    if pictures.overlays.is_empty() {
        return Ok(String::new());
    }
    let how = "Every object is brought to the place of its group's reference by its pose: alone in its own colours, \
               then in its colour over the reference, from the camera that shows the reference best and from a quarter \
               turn beside it. The line is the reference's outline: a right pose fills it; grey in it is not covered, \
               and colour outside of it is too much.";
    let groups = pictures.overlays.iter().map(|group| poses_of(group, report)).collect::<Html>()?;
    Ok(format!("<p class=\"soft\">{how}</p>\n{groups}{}", not_shown(pictures.groups_left_out, "smaller groups")))
}

fn poses_of(group: &GroupOverlay, report: &RunReport) -> Html {
    // Without poses it is not known which objects fit worst.
    let which = if group.tiles.iter().any(|tile| tile.overlap.is_some()) { "; these fit worst" } else { "" };
    let left_out = match group.left_out {
        0 => String::new(),
        left => format!("<span>{} more are not shown{which}</span>", count(left as u64)),
    };
    let tiles = group.tiles.iter().map(|tile| pose(tile, report)).collect::<Html>()?;
    let name = escape(&group.name);
    Ok(format!("<div class=\"view\"><h3>{name}{left_out}</h3>\n<div class=\"poses\">\n{tiles}</div></div>\n"))
}

fn pose(tile: &OverlayTile, report: &RunReport) -> Html {
    let registered = report.registration.iter().find(|r| r.instance == tile.id);
    let of = format!("object {}", tile.id);
    let captions = ["alone", if tile.overlap.is_some() { "over the reference" } else { "in grey" }, "from the side"];
    let pictures = tile.own.iter().chain(&tile.over).zip(captions);
    let pictures = pictures.map(|(picture, caption)| figure(picture, &of, caption)).collect::<Html>()?;
    let shown = if pictures.is_empty() { "<p>It has no Gaussians.</p>\n".to_owned() } else { pictures };
    Ok(format!(
        "<div class=\"pose\"><p>{}<b>{of}</b> {}</p>\n<div class=\"trio\">\n{shown}</div>\n{}</div>\n",
        swatch(tile.color),
        registered.map(verdict).unwrap_or_default(),
        figures(tile, registered)
    ))
}

fn verdict(registered: &InstanceRegistration) -> String {
    let text = match registered.verdict {
        Verdict::Reference => "the reference",
        Verdict::Accepted => "accepted",
        Verdict::Symmetric => "accepted, symmetric",
        Verdict::Ambiguous if registered.slight => "accepted, in slight doubt",
        Verdict::Ambiguous => "<span class=\"warn\">in doubt</span>",
        Verdict::Rejected => "<span class=\"warn\">rejected</span>",
    };
    text.into()
}

/// How well the object fits, and the reason of its verdict.
fn figures(tile: &OverlayTile, registered: Option<&InstanceRegistration>) -> String {
    let mut parts: Vec<String> =
        tile.overlap.iter().map(|part| format!("outline {} %", fixed(100.0 * part, 0))).collect();
    let posed = registered.filter(|r| !matches!(r.verdict, Verdict::Reference | Verdict::Rejected));
    if let Some(found) = posed {
        let (rmse, part) = (fixed(found.rmse, 4), fixed(100.0 * found.relative_rmse, 1));
        parts.push(format!("surface {} %", fixed(100.0 * found.inliers, 0)));
        parts.push(format!("RMSE {rmse} ({part} % of its size)"));
        parts.extend(found.photometric.map(|error| format!("colours {}", fixed(error, 3))));
    }
    let note = registered.map(|r| escape(&r.note)).filter(|note| !note.is_empty());
    let line = |text: String| format!("<p class=\"soft\">{text}</p>\n");
    [parts.join(" · "), note.unwrap_or_default()].into_iter().filter(|text| !text.is_empty()).map(line).collect()
}

/// The section on every template alone.
pub(super) fn templates(pictures: &StagePictures) -> Html {
    let shown = pictures.templates.iter().filter(|t| !(t.merged.is_empty() && t.trained.is_empty()));
    let templates = shown.map(template).collect::<Html>()?;
    Ok(templates + &not_shown(pictures.templates_left_out, "more templates"))
}

fn not_shown(left_out: usize, what: &str) -> String {
    match left_out {
        0 => String::new(),
        left => format!("<p class=\"soft\">{} {what} are not shown.</p>\n", count(left as u64)),
    }
}

fn template(template: &TemplatePictures) -> Html {
    let name = escape(&template.name);
    let (gaussians, instances) = (count(template.gaussians), count(template.instances));
    let mut out = format!(
        "<div class=\"view\"><h3>{name}<span>{gaussians} Gaussians, {instances} instances</span></h3>\n\
         <div class=\"quad\">\n"
    );
    let states = [
        (&template.merged, ["as merged", "as merged, from behind"]),
        (&template.trained, ["after the joint phase", "after the joint phase, from behind"]),
    ];
    for (sides, captions) in states {
        for (picture, caption) in sides.iter().zip(captions) {
            out += &figure(picture, &template.name, caption)?;
        }
    }
    Ok(out + "</div></div>\n")
}
