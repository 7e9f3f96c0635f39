//! A prompt as the numbers that the detector's text encoder reads.

use std::path::Path;

use tokenizers::Tokenizer;

use super::DetectError;
use super::models::DetectorModel;
use super::prompt::Prompt;
use crate::io::IoError;

/// The piece that fills up prompts of a fixed length, where the vocabulary has it; it is masked out.
const FILLER: &str = "[PAD]";

/// A prompt in pieces of words. All lists are as long as the detector reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PromptTokens {
    /// Numbers of the pieces in the vocabulary, with the start, the end, and the full stops.
    pub ids: Vec<i64>,
    /// 1 for each of these, 0 for what fills up.
    pub attention: Vec<i64>,
    /// The phrase of each piece; `None` for the start, the end, full stops and what fills up.
    pub phrase_of: Vec<Option<usize>>,
}

/// Takes a prompt to tokens with the tokenizer at `path`.
///
/// # Errors
/// A tokenizer that cannot be read; a prompt that is too long, and a phrase of which no piece is left.
pub fn tokens_of(prompt: &Prompt, model: &DetectorModel, path: &Path) -> Result<PromptTokens, DetectError> {
    let fail = |e: tokenizers::Error| IoError::new(path, format!("is no tokenizer that can be used: {e}"));
    let mut tokenizer = Tokenizer::from_file(path).map_err(fail)?;
    // A file may come with a length to cut at or to fill up to; that is decided here.
    tokenizer.with_truncation(None).map_err(fail)?.with_padding(None);
    let encoding = tokenizer.encode(prompt.text(), true).map_err(fail)?;
    let length = encoding.get_ids().len();
    let most = model.fixed_tokens.unwrap_or(model.max_tokens);
    let refuse = |what: String| DetectError::Prompt { prompt: prompt.text(), what };
    if length > most {
        let what = format!("makes {length} tokens, and the detector reads {most}; ask for fewer things at a time");
        return Err(refuse(what));
    }
    let ranges = prompt.ranges();
    let phrase_at = |&(start, end): &(usize, usize)| ranges.iter().position(|r| r.start <= start && end <= r.end);
    let pieces = encoding.get_offsets().iter().zip(encoding.get_special_tokens_mask());
    let mut phrase_of: Vec<Option<usize>> =
        pieces.map(|(place, special)| if *special == 0 { phrase_at(place) } else { None }).collect();
    if let Some(lost) = (0..ranges.len()).find(|phrase| !phrase_of.contains(&Some(*phrase))) {
        return Err(refuse(format!(
            "has the phrase {:?}, which the tokenizer leaves nothing of",
            prompt.phrases()[lost]
        )));
    }
    let mut ids: Vec<i64> = encoding.get_ids().iter().map(|id| i64::from(*id)).collect();
    let mut attention = vec![1; length];
    if let Some(fixed) = model.fixed_tokens {
        ids.resize(fixed, tokenizer.token_to_id(FILLER).map_or(0, i64::from));
        attention.resize(fixed, 0);
        phrase_of.resize(fixed, None);
    }
    Ok(PromptTokens { ids, attention, phrase_of })
}
