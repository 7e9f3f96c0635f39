//! The contact sheet of masks: every view with its masks painted over it, so that a person sees at a glance whether the
//! masks are good enough to continue. `stage_pictures::review` draws the pictures.

use std::path::Path;

use super::format::{count, escape, fixed};
use super::page::{head_of, section};
use super::stage_pictures::data::ObjectColor;
use super::stages::legend;
use super::table::table;
use instgs_io::{IoError, atomic_write};
use instgs_objects::segment::ObjectReport;

/// The contents of the contact sheet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReviewSheet {
    /// Heading of the page: the folder of the masks or the run.
    pub title: String,
    /// Remarks for the reader, one sentence each.
    pub notes: Vec<String>,
    /// Warnings to look into, one sentence each.
    pub warnings: Vec<String>,
    /// The categories of objects in the masks.
    pub kinds: Vec<KindOfMasks>,
    /// After consensus: the objects found.
    pub objects: Vec<ObjectReport>,
    /// After consensus: the colours of the objects.
    pub colors: Vec<ObjectColor>,
    /// The views in the order of the data set.
    pub views: Vec<ReviewView>,
}

/// All masks of one category.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KindOfMasks {
    /// The category; `None` for masks without one.
    pub name: Option<String>,
    /// Number of masks in all views.
    pub masks: usize,
    /// Number of views with at least one such mask.
    pub views: usize,
    /// Median fraction of the picture that such a mask covers, 0..=1.
    pub median_part: f64,
}

/// One view of the contact sheet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReviewView {
    /// Name of the training view.
    pub name: String,
    /// Number of its masks; `None` without a mask file.
    pub masks: Option<usize>,
    /// Pictures as `data:` addresses with their captions: the masks as given, then the objects.
    pub pictures: Vec<(&'static str, String)>,
}

/// Writes the contact sheet: one page without scripts or external resources.
///
/// # Errors
/// A file that cannot be written.
pub fn write_review(path: &Path, sheet: &ReviewSheet) -> Result<(), IoError> {
    let text = page(sheet);
    atomic_write(path, |out| out.write_all(text.as_bytes()))
}

fn page(sheet: &ReviewSheet) -> String {
    let line = |class: &str, text: &String| format!("<p class=\"{class}\">{}</p>\n", escape(text));
    let mut out = head_of(&sheet.title);
    out += &format!("<h1>{}</h1>\n", escape(&sheet.title));
    out += &sheet.notes.iter().map(|text| line("soft", text)).collect::<String>();
    out += &sheet.warnings.iter().map(|text| line("warn", text)).collect::<String>();
    out += &section("Kinds", &kinds(&sheet.kinds));
    out += &section("Objects", &objects(sheet));
    let views: String = sheet.views.iter().map(view).collect();
    let views = if views.is_empty() { views } else { format!("<div class=\"sheet\">\n{views}</div>\n") };
    out += &section("Views", &views);
    out + "</body>\n</html>\n"
}

fn kinds(kinds: &[KindOfMasks]) -> String {
    let row = |kind: &KindOfMasks| {
        let name = kind.name.as_deref().map_or("without a name".into(), escape);
        let part = format!("{} %", fixed(100.0 * kind.median_part, 2));
        vec![name, count(kind.masks as u64), count(kind.views as u64), part]
    };
    let rows: Vec<_> = kinds.iter().map(row).collect();
    table(&["category", "masks", "views", "a mask's part of its picture, median"], &rows, None)
}

fn objects(sheet: &ReviewSheet) -> String {
    if sheet.objects.is_empty() {
        return String::new();
    }
    let row = |object: &ObjectReport| {
        let category = object.category.as_deref().map_or("–".into(), escape);
        let counts = [object.views, object.masks, object.gaussians].map(|n| count(n as u64));
        [vec![object.id.to_string(), category], counts.into()].concat()
    };
    let rows: Vec<_> = sheet.objects.iter().map(row).collect();
    legend(&sheet.colors) + &table(&["object", "category", "views", "masks", "Gaussians"], &rows, None)
}

fn view(view: &ReviewView) -> String {
    let name = escape(&view.name);
    let masks = match view.masks {
        None => "<span class=\"warn\">no file of masks</span>".to_owned(),
        Some(0) => "<span class=\"warn\">no object</span>".to_owned(),
        Some(1) => "<span>1 mask</span>".to_owned(),
        Some(n) => format!("<span>{} masks</span>", count(n as u64)),
    };
    let is_alone = view.pictures.len() == 1;
    let figure = |(caption, address): &(&str, String)| {
        let below = if is_alone { String::new() } else { format!("<figcaption>{caption}</figcaption>") };
        format!("<figure><img src=\"{address}\" alt=\"{name}: {caption}\"/>{below}</figure>\n")
    };
    let pictures: String = view.pictures.iter().map(figure).collect();
    let class = if is_alone { "solo" } else { "duo" };
    format!("<div class=\"view\"><h3>{name}{masks}</h3>\n<div class=\"{class}\">\n{pictures}</div></div>\n")
}

#[cfg(test)]
mod tests {
    use super::super::tests::tags;
    use super::*;

    fn sheet() -> ReviewSheet {
        let view = |name: &str, masks: Option<usize>| ReviewView {
            name: name.into(),
            masks,
            pictures: vec![("masks as given", "data:image/jpeg;base64,AA==".into())],
        };
        let object = ObjectReport { id: 3, category: Some("c<r".into()), views: 2, masks: 1234, gaussians: 9 };
        ReviewSheet {
            title: "masks of a & b".into(),
            notes: vec!["2 views".into()],
            warnings: vec!["1 view has no <mask>".into()],
            kinds: vec![
                KindOfMasks { name: Some("car".into()), masks: 7, views: 2, median_part: 0.0123 },
                KindOfMasks::default(),
            ],
            objects: vec![object],
            colors: vec![ObjectColor { id: 3, name: None, color: [1, 2, 3] }],
            views: vec![view("a", Some(2)), view("b", None), view("c", Some(0))],
        }
    }

    #[test]
    fn the_sheet_is_well_formed_and_whole() {
        let html = page(&sheet());
        tags(&html);
        let counted = count(1234);
        let parts =
            ["masks of a &amp; b", "no &lt;mask&gt;", "1.23 %", "c&lt;r", &counted, "2 masks", "no file of masks"];
        parts.iter().for_each(|part| assert!(html.contains(part), "lacks {part}"));
        assert_eq!(html.matches("<img").count(), 3);
        assert!(!html.contains("http"), "nothing from elsewhere");
    }

    #[test]
    fn an_empty_sheet_is_a_page_too() {
        let html = page(&ReviewSheet::default());
        tags(&html);
        assert!(!html.contains("<h2>"));
    }
}
