//! The scene itself on the page: the page that `instgs-vk export --to X.html` writes, as a frame.

use std::path::Path;

use super::format::{bytes, escape};
use instgs_io::{IoError, Pack, PageOptions, RunFolder, Split, load_scene, page_text, read_views};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::camera::Camera;

/// The largest scene on the page, bytes of its tensors in f32: packed and as text it takes about a sixth, 5 MB.
const LARGEST_SCENE: u64 = 32 << 20;

/// What the page shows of the result of its run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneView {
    /// The page that draws the scene, as HTML.
    Page(String),
    /// The scene is not shown; a sentence says why.
    LeftOut(String),
}

impl SceneView {
    /// The view of a finished run: its trained scene, from the first of the views it was trained on. A report is worth more
    /// than this view of it: where it cannot be made, its place says why.
    pub fn of_run(run: &RunFolder, data: &Path) -> Self {
        Self::of_file(&run.scene(), data)
            .unwrap_or_else(|error| Self::LeftOut(format!("The scene cannot be shown: {error}.")))
    }

    fn of_file(file: &Path, data: &Path) -> Result<Self, IoError> {
        let scene = load_scene(file)?.scene;
        let size = scene.tensor_bytes();
        if size > LARGEST_SCENE {
            let file = file.display();
            return Ok(Self::LeftOut(format!(
                "The scene ({} as f32) is too large for this page. \"instgs-vk export --scene {file} --to scene.html\" makes \
                 one of its own.",
                bytes(size)
            )));
        }
        let title = data.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned());
        Self::of_scene(&scene, &title, &training_cameras(data), file)
    }

    /// The view of a scene; `file` is for messages.
    fn of_scene(scene: &InstancedScene, title: &str, cameras: &[Camera], file: &Path) -> Result<Self, IoError> {
        let options = PageOptions::of_views(scene, Pack::Small, cameras);
        page_text(title, scene, &options, file).map(Self::Page)
    }

    /// The section of the page.
    pub(super) fn html(&self) -> String {
        let page = match self {
            Self::Page(page) => page,
            Self::LeftOut(why) => return format!("<p class=\"soft\">{}</p>\n", escape(why)),
        };
        let how =
            "Drag to turn it, click it and use the wheel to come closer, click an object or its name to select it.";
        format!(
            "<iframe class=\"scene\" title=\"The trained scene, to be turned and looked at\" loading=\"lazy\" \
             allow=\"fullscreen *\" srcdoc=\"{}\"></iframe>\n<p class=\"soft\">{how} The scene and the program that draws it are \
             {} of this file.</p>\n",
            escape(page),
            bytes(page.len() as u64)
        )
    }
}

/// The cameras that a data set has for training; none if it is no longer there.
fn training_cameras(data: &Path) -> Vec<Camera> {
    let views = read_views(data).map(|dataset| dataset.views).unwrap_or_default();
    views.into_iter().filter(|view| view.split == Split::Train).map(|view| view.camera).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_io::write_scene_file;
    use instgs_vk::scene::Gaussians;

    fn cloud(count: usize) -> InstancedScene {
        InstancedScene::from_cloud(Gaussians {
            means: (0..count).map(|i| [i as f32, 0.0, 5.0]).collect(),
            quats: vec![[1.0, 0.0, 0.0, 0.0]; count],
            log_scales: vec![[-2.0; 3]; count],
            opacity_logits: vec![2.0; count],
            sh_degree: 3,
            sh: vec![[0.1; 3]; 16 * count],
        })
    }

    fn view_of(scene: &InstancedScene) -> Result<SceneView, Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let run = RunFolder::new(folder.path());
        write_scene_file(&run.scene(), scene)?;
        Ok(SceneView::of_run(&run, &folder.path().join("cars & co")))
    }

    #[test]
    fn a_scene_is_shown_as_its_page() -> Result<(), Box<dyn std::error::Error>> {
        let view = view_of(&cloud(3))?;
        let SceneView::Page(page) = &view else { return Err(format!("{view:?}").into()) };
        assert!(page.contains("<title>cars &amp; co</title>"), "the data set's name, and no camera is needed");
        let html = view.html();
        let (_, rest) = html.split_once(" srcdoc=\"").ok_or("a frame")?;
        let (held, rest) = rest.split_once('"').ok_or("its end")?;
        assert!(!held.contains(['<', '>']) && rest.starts_with("></iframe>"));
        let plain = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&#39;", "'"), ("&amp;", "&")];
        let back = plain.iter().fold(held.to_owned(), |text, (from, to)| text.replace(from, to));
        assert_eq!(&back, page);
        Ok(())
    }

    #[test]
    fn what_cannot_be_shown_says_why() -> Result<(), Box<dyn std::error::Error>> {
        let count = usize::try_from(LARGEST_SCENE)? / 236 + 1;
        let view = view_of(&cloud(count))?;
        assert!(matches!(&view, SceneView::LeftOut(why) if why.contains("(32.0 MiB as f32) is too large")), "{view:?}");
        assert!(!view.html().contains("iframe"));
        let none = SceneView::of_run(&RunFolder::new("no/such/run"), Path::new("no/such/data"));
        assert!(matches!(&none, SceneView::LeftOut(why) if why.contains("no/such/run/scene.instgs")), "{none:?}");
        Ok(())
    }
}
