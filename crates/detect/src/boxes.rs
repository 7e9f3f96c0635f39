//! Decodes the detector's output to boxes in the photo, each with a phrase.

use super::nms::{BoxPx, drop_repeated};

/// Why the detector's output could not be decoded; the text continues a sentence that begins with the model's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The sizes of the tables do not match: numbers of logits, of their columns, of box values and of tokens.
    #[error("gave tables of the sizes ({0}, {1}, {2}, {3}) (logits, their columns, boxes, tokens), which do not match")]
    Sizes(usize, usize, usize, usize),
    /// A logit is NaN, or a box is not finite.
    #[error("gave NaN or infinite values; its file may be damaged")]
    NotFinite,
}

/// Thresholds of the detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectOptions {
    /// Least score of a box's best token. 0.25, the default of the detector's own program; its README recommends 0.35
    /// for clean pictures, but here false boxes are cheap, since the consensus of views drops what few of them show.
    pub box_threshold: f64,
    /// Least score of a token for the box to get its phrase. 0.25, as above.
    pub text_threshold: f64,
    /// Largest overlap (intersection over union) of two boxes with one phrase, and of two masks with any phrases;
    /// beyond it the one with the lower score is dropped. 0.8, as in the paper: lower values lose objects that stand
    /// close together.
    pub overlap: f64,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self { box_threshold: 0.25, text_threshold: 0.25, overlap: 0.8 }
    }
}

/// A box found by the detector.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Index of its phrase in the prompt.
    pub phrase: usize,
    /// Best score of any token, 0..=1.
    pub score: f64,
    /// Left, top, right, bottom in pixels of the photo; may extend beyond it.
    pub box_px: BoxPx,
}

/// The detector's output for one photo, with `queries` rows.
#[derive(Clone, Copy, Debug)]
pub struct RawDetections<'a> {
    /// `[queries, columns]` before the sigmoid; one column per token position, minus infinity where there is no token.
    pub logits: &'a [f32],
    /// Number of columns of `logits`.
    pub columns: usize,
    /// `[queries, 4]`: centre x, centre y, width and height as parts of the photo's size.
    pub boxes: &'a [f32],
}

/// The boxes of one photo, decoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Detections {
    /// Boxes in order of falling score; equal ones in the detector's order.
    pub found: Vec<Detection>,
    /// Number of boxes above the box threshold without a phrase above the text threshold.
    pub unnamed: usize,
    /// Number of boxes dropped because a better one with the same phrase overlaps them.
    pub repeated: usize,
}

/// Boxes above the thresholds. A box gets the phrase of its best token: phrases of many words have no advantage, and a
/// box never has two phrases.
///
/// `phrase_of[t]` is the phrase of the token at position `t`; columns beyond its end have no phrase.
///
/// # Errors
/// NaN or infinite values, or tables whose sizes do not match.
pub fn decode(
    raw: RawDetections<'_>,
    phrase_of: &[Option<usize>],
    (width, height): (usize, usize),
    options: &DetectOptions,
) -> Result<Detections, DecodeError> {
    if raw.columns == 0 || raw.logits.len() / raw.columns * 4 != raw.boxes.len() || phrase_of.len() > raw.columns {
        return Err(DecodeError::Sizes(raw.logits.len(), raw.columns, raw.boxes.len(), phrase_of.len()));
    }
    let mut out = Detections::default();
    for (row, shape) in raw.logits.chunks_exact(raw.columns).zip(raw.boxes.as_chunks::<4>().0) {
        if row.iter().any(|v| v.is_nan()) || !shape.iter().all(|v| v.is_finite()) {
            return Err(DecodeError::NotFinite);
        }
        let score = sigmoid(row.iter().copied().fold(f32::NEG_INFINITY, f32::max));
        if score <= options.box_threshold {
            continue;
        }
        match best_phrase(row, phrase_of).filter(|(_, best)| *best > options.text_threshold) {
            Some((phrase, _)) => out.found.push(Detection { phrase, score, box_px: corners(*shape, width, height) }),
            None => out.unnamed += 1,
        }
    }
    out.found.sort_by(|a, b| b.score.total_cmp(&a.score));
    out.repeated = drop_repeated(&mut out.found, options.overlap);
    Ok(out)
}

/// The phrase of the best token, and its score; the first in a tie.
fn best_phrase(row: &[f32], phrase_of: &[Option<usize>]) -> Option<(usize, f64)> {
    let mut best: Option<(usize, f32)> = None;
    for (&logit, phrase) in row.iter().zip(phrase_of) {
        if let Some(phrase) = phrase
            && best.is_none_or(|(_, highest)| logit > highest)
        {
            best = Some((*phrase, logit));
        }
    }
    best.map(|(phrase, logit)| (phrase, sigmoid(logit)))
}

fn sigmoid(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

fn corners(shape: [f32; 4], width: usize, height: usize) -> BoxPx {
    let [cx, cy, w, h] = shape.map(f64::from);
    let (width, height) = (width as f64, height as f64);
    [(cx - 0.5 * w) * width, (cy - 0.5 * h) * height, (cx + 0.5 * w) * width, (cy + 0.5 * h) * height]
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: f32 = f32::NEG_INFINITY;
    /// Start, "office", "chair", full stop, "car", full stop, end.
    const PHRASES: [Option<usize>; 7] = [None, Some(0), Some(0), None, Some(1), None, None];

    fn logit(score: f64) -> f32 {
        (score / (1.0 - score)).ln() as f32
    }

    fn row(scores: [f64; 7]) -> Vec<f32> {
        scores.map(logit).into_iter().chain([NONE]).collect()
    }

    fn decoded(rows: &[[f64; 7]], options: &DetectOptions) -> Result<Detections, DecodeError> {
        let logits: Vec<f32> = rows.iter().flat_map(|r| row(*r)).collect();
        let boxes: Vec<f32> = (0..rows.len()).flat_map(|i| [0.1 + 0.2 * i as f32, 0.5, 0.1, 0.5]).collect();
        decode(RawDetections { logits: &logits, columns: 8, boxes: &boxes }, &PHRASES, (100, 20), options)
    }

    #[test]
    fn boxes_are_of_the_phrase_with_the_best_token() -> Result<(), DecodeError> {
        let rows = [
            [0.1, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1],
            // Two good tokens of one phrase lose against a better one of another.
            [0.1, 0.6, 0.6, 0.1, 0.7, 0.1, 0.1],
            // One box below the box threshold; one above it without a phrase.
            [0.1, 0.2, 0.2, 0.1, 0.24, 0.1, 0.1],
            [0.9, 0.2, 0.2, 0.1, 0.24, 0.1, 0.1],
        ];
        let out = decoded(&rows, &DetectOptions::default())?;
        let summary: Vec<_> = out.found.iter().map(|d| (d.phrase, (d.score * 1e4).round())).collect();
        assert_eq!((summary, out.unnamed), (vec![(1, 7000.0), (0, 3000.0)], 1));
        let want = [25.0, 5.0, 35.0, 15.0];
        assert!(out.found[0].box_px.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-4), "{:?}", out.found[0]);
        let strict = decoded(&rows, &DetectOptions { box_threshold: 0.5, ..DetectOptions::default() })?;
        assert_eq!((strict.found.len(), strict.unnamed), (1, 1));
        let loose = decoded(&rows, &DetectOptions { text_threshold: 0.1, ..DetectOptions::default() })?;
        assert_eq!((loose.found.len(), loose.found[0].phrase, loose.unnamed), (3, 1, 0));
        Ok(())
    }

    #[test]
    fn boxes_of_one_phrase_that_cover_each_other_are_one() -> Result<(), DecodeError> {
        let logits = [row([0.1, 0.5, 0.1, 0.1, 0.1, 0.1, 0.1]), row([0.1, 0.1, 0.6, 0.1, 0.1, 0.1, 0.1])].concat();
        let boxes = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.45];
        let raw = RawDetections { logits: &logits, columns: 8, boxes: &boxes };
        let out = decode(raw, &PHRASES, (10, 10), &DetectOptions::default())?;
        assert_eq!((out.found.len(), out.repeated), (1, 1));
        assert!((out.found[0].score - 0.6).abs() < 1e-6);
        // Now the second token belongs to another phrase.
        let phrases = [None, Some(0), Some(1)];
        let out = decode(raw, &phrases, (10, 10), &DetectOptions::default())?;
        assert_eq!((out.found.len(), out.repeated), (2, 0));
        Ok(())
    }

    #[test]
    fn nonsense_is_refused() {
        let options = DetectOptions::default();
        let of = |logits: &[f32], columns, boxes: &[f32]| {
            decode(RawDetections { logits, columns, boxes }, &[None, Some(0)], (1, 1), &options)
        };
        assert!(of(&[0.0; 3], 3, &[0.0; 8]).is_err() && of(&[0.0; 3], 0, &[0.0; 4]).is_err());
        assert!(of(&[0.0], 1, &[0.0; 4]).is_err(), "fewer columns than tokens");
        assert_eq!(of(&[0.0, f32::NAN], 2, &[0.0; 4]), Err(DecodeError::NotFinite));
        assert!(of(&[0.0, 0.0], 2, &[0.0, 0.0, 0.0, f32::INFINITY]).is_err());
        assert_eq!(of(&[], 2, &[]), Ok(Detections::default()));
        assert_eq!(of(&[NONE, NONE], 2, &[0.5; 4]), Ok(Detections::default()));
    }
}
