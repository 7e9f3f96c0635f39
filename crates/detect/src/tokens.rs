//! Tokenises a prompt for the detector's text encoder.

use std::path::Path;

use tokenizers::{Encoding, Tokenizer};

use super::DetectError;
use super::models::DetectorModel;
use super::prompt::Prompt;
use instgs_io::IoError;

/// Padding token of prompts with a fixed length, if the vocabulary has it; it is masked out.
const FILLER: &str = "[PAD]";

/// Tokens of a prompt. All lists have one entry per token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PromptTokens {
    /// Vocabulary ids of the tokens, including the start, the end, and full stops.
    pub ids: Vec<i64>,
    /// Attention mask: 1 for tokens, 0 for padding.
    pub attention: Vec<i64>,
    /// Phrase of each token; `None` for the start, the end, full stops and padding.
    pub phrase_of: Vec<Option<usize>>,
}

/// The detector's tokenizer.
pub struct PromptTokenizer(Tokenizer);

impl PromptTokenizer {
    /// Reads a `tokenizer.json`.
    ///
    /// # Errors
    /// A file that is missing or is no tokenizer.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        let fail = |e: tokenizers::Error| IoError::new(path, format!("is no valid tokenizer: {e}"));
        let mut tokenizer = Tokenizer::from_file(path).map_err(fail)?;
        // The file may prescribe truncation or padding, but [`Self::tokens`] decides on both.
        tokenizer.with_truncation(None).map_err(fail)?.with_padding(None);
        Ok(Self(tokenizer))
    }

    /// Vocabulary ids of a text, with the start and the end.
    ///
    /// # Errors
    /// A text that the tokenizer rejects.
    pub fn ids(&self, text: &str) -> Result<Vec<i64>, DetectError> {
        Ok(self.encoding(text)?.get_ids().iter().map(|id| i64::from(*id)).collect())
    }

    /// Tokens of a prompt, padded if the model needs it.
    ///
    /// # Errors
    /// A prompt that is too long for the model; a phrase without tokens.
    pub fn tokens(&self, prompt: &Prompt, model: &DetectorModel) -> Result<PromptTokens, DetectError> {
        let text = prompt.text();
        let mut ids = self.ids(&text)?;
        let most = model.fixed_tokens.unwrap_or(model.max_tokens);
        if ids.len() > most {
            let what =
                format!("has {} tokens, but the detector reads {most}; ask for fewer things at a time", ids.len());
            return Err(DetectError::Prompt { prompt: text, what });
        }
        let mut phrase_of = self.phrases_of_pieces(prompt, &text)?;
        let mut attention = vec![1; ids.len()];
        if let Some(fixed) = model.fixed_tokens {
            ids.resize(fixed, self.0.token_to_id(FILLER).map_or(0, i64::from));
            attention.resize(fixed, 0);
            phrase_of.resize(fixed, None);
        }
        Ok(PromptTokens { ids, attention, phrase_of })
    }

    /// The phrase of each token of the prompt's text.
    fn phrases_of_pieces(&self, prompt: &Prompt, text: &str) -> Result<Vec<Option<usize>>, DetectError> {
        let encoding = self.encoding(text)?;
        let ranges = prompt.ranges();
        let phrase_at = |&(start, end): &(usize, usize)| ranges.iter().position(|r| r.start <= start && end <= r.end);
        // The start and the end are not part of the text; their offsets are 0.
        let pieces = encoding.get_offsets().iter().zip(encoding.get_special_tokens_mask());
        let phrases: Vec<_> = pieces.map(|(at, special)| if *special == 0 { phrase_at(at) } else { None }).collect();
        match (0..ranges.len()).find(|phrase| !phrases.contains(&Some(*phrase))) {
            None => Ok(phrases),
            Some(lost) => {
                let what =
                    format!("has the phrase {:?}, for which the tokenizer has no tokens", prompt.phrases()[lost]);
                Err(DetectError::Prompt { prompt: text.into(), what })
            }
        }
    }

    fn encoding(&self, text: &str) -> Result<Encoding, DetectError> {
        let fail = |e: tokenizers::Error| format!("cannot be tokenised for the detector: {e}");
        self.0.encode(text, true).map_err(|e| DetectError::Prompt { prompt: text.into(), what: fail(e) })
    }
}
