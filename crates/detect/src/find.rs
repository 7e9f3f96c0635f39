//! Finds the masks of one view after the other.

use std::path::Path;

use super::DetectError;
use super::assemble::MaskPainter;
use super::boxes::{DetectOptions, Detection, Detections};
use super::detector::Detector;
use super::from_prompt::PromptOptions;
use super::mask_logits::{MaskFrame, overlap_above_zero};
use super::models::ModelsFolder;
use super::nms::BoxPx;
use super::photo::Photo;
use super::prompt::Prompt;
use super::report::{Dropped, ViewMasks};
use super::segmenter::{BoxMask, Segmenter};
use instgs_io::View;
use instgs_vk::scene::ViewBox;

/// Both models and the prompt, ready for photos. Ids continue from one view to the next.
pub struct Finder {
    detector: Detector,
    segmenter: Segmenter,
    phrases: Vec<String>,
    options: DetectOptions,
    used_ids: usize,
}

/// The boxes of a photo with their masks.
struct Segmented {
    /// Placement of the masks in the photo; `None` if there is no box.
    frame: Option<MaskFrame>,
    /// Boxes and masks in order of falling score.
    found: Vec<(Detection, BoxMask)>,
    dropped: Dropped,
}

impl Finder {
    /// Opens the models of a folder for a prompt.
    ///
    /// # Errors
    /// Options out of range; models or a runtime library that are missing or wrong; a prompt that is too long.
    pub fn open(models: &Path, prompt: &Prompt, options: &PromptOptions) -> Result<Self, DetectError> {
        options.check()?;
        let models = ModelsFolder::open(models)?;
        let detector = Detector::open(&models, prompt, &options.runtime)?;
        let segmenter = Segmenter::open(&models, &options.runtime)?;
        Ok(Self { detector, segmenter, phrases: prompt.phrases().to_vec(), options: options.detect, used_ids: 0 })
    }

    /// Finds the masks in a view's photo.
    ///
    /// # Errors
    /// A photo that cannot be read, a model that fails, and more masks than ids; each names the view.
    pub fn find(&mut self, view: &View) -> Result<ViewMasks, DetectError> {
        let name = &view.camera.name;
        let photo = Photo::load(view).map_err(|e| DetectError::from(e).in_view(name))?;
        let Segmented { frame, found, mut dropped } = self.segmented(&photo).map_err(|e| e.in_view(name))?;
        let mut painter = MaskPainter::new(photo.width, photo.height);
        if let Some(frame) = frame {
            found.iter().for_each(|(_, mask)| painter.add(&frame.at_photo(&mask.logits)));
        }
        let Some(painted) = painter.finish(self.used_ids) else {
            return Err(DetectError::TooManyMasks { view: name.clone(), count: self.used_ids + found.len() });
        };
        (dropped.empty, dropped.covered) = (painted.empty, painted.covered);
        let shown = found.into_iter().zip(painted.ids).filter(|(_, id)| *id != 0);
        let boxes: Vec<ViewBox> = shown.map(|((detection, _), id)| self.view_box(detection, id)).collect();
        self.used_ids += boxes.len();
        Ok(ViewMasks { mask: painted.mask, boxes, dropped })
    }

    /// Finds boxes in a photo and makes their masks. The encoder takes most of the time and runs only if there is a
    /// box.
    fn segmented(&mut self, photo: &Photo) -> Result<Segmented, DetectError> {
        let Detections { mut found, unnamed, repeated } = self.detector.detect(photo, &self.options)?;
        let before = found.len();
        found.retain_mut(|detection| {
            detection.box_px = within_photo(&detection.box_px, photo);
            let [left, top, right, bottom] = detection.box_px;
            left < right && top < bottom
        });
        let mut dropped = Dropped { unnamed, repeated, outside: before - found.len(), ..Dropped::default() };
        if found.is_empty() {
            return Ok(Segmented { frame: None, found: vec![], dropped });
        }
        let embedding = self.segmenter.encode(photo)?;
        let boxes: Vec<BoxPx> = found.iter().map(|d| d.box_px).collect();
        let masks = self.segmenter.masks(&embedding, &boxes)?;
        let mut kept: Vec<(Detection, BoxMask)> = Vec::with_capacity(found.len());
        for (detection, mask) in found.into_iter().zip(masks) {
            let same = |k: &(Detection, BoxMask)| overlap_above_zero(&k.1.logits, &mask.logits) > self.options.overlap;
            if kept.iter().any(same) {
                dropped.same_mask += 1;
            } else {
                kept.push((detection, mask));
            }
        }
        Ok(Segmented { frame: Some(embedding.frame), found: kept, dropped })
    }

    fn view_box(&self, detection: Detection, id: u16) -> ViewBox {
        let category = self.phrases.get(detection.phrase).cloned();
        ViewBox { id: Some(id.into()), category, score: Some(detection.score), box_px: detection.box_px }
    }
}

/// The part of a box inside the photo.
fn within_photo([left, top, right, bottom]: &BoxPx, photo: &Photo) -> BoxPx {
    let (width, height) = (photo.width as f64, photo.height as f64);
    [left.clamp(0.0, width), top.clamp(0.0, height), right.clamp(0.0, width), bottom.clamp(0.0, height)]
}
