//! Text prompts: phrases, each ended by a full stop.

use std::ops::Range;

use super::DetectError;

/// Characters that end a phrase for the detector's text encoder.
const ENDS: [char; 2] = ['.', '?'];

/// The phrases of a prompt such as "car. office chair.".
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Prompt {
    phrases: Vec<String>,
}

impl Prompt {
    /// Splits a prompt at "." and "?", where the detector ends a phrase, too. Phrases are lowercased, as in the
    /// detector's training, white space is collapsed, and repeated phrases count once.
    ///
    /// # Errors
    /// A prompt in which no phrase has a letter or digit.
    pub fn parse(text: &str) -> Result<Self, DetectError> {
        let mut phrases: Vec<String> = Vec::new();
        for part in text.split(ENDS) {
            let phrase = part.split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase();
            if phrase.contains(char::is_alphanumeric) && !phrases.contains(&phrase) {
                phrases.push(phrase);
            }
        }
        if phrases.is_empty() {
            let what = "names nothing; give one or more phrases, for instance \"car. office chair.\"".into();
            return Err(DetectError::Prompt { prompt: text.into(), what });
        }
        Ok(Self { phrases })
    }

    /// The phrases in order; at least one.
    pub fn phrases(&self) -> &[String] {
        &self.phrases
    }

    /// The text that the detector reads, such as "car. office chair.".
    pub fn text(&self) -> String {
        self.phrases.join(". ") + "."
    }

    /// Byte range of each phrase in [`Self::text`].
    pub fn ranges(&self) -> Vec<Range<usize>> {
        let mut start = 0;
        let mut range = |phrase: &String| {
            let range = start..start + phrase.len();
            start = range.end + ". ".len();
            range
        };
        self.phrases.iter().map(&mut range).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phrases_end_at_full_stops() -> Result<(), DetectError> {
        let prompt = Prompt::parse(" Car.office \n Chair . car?2 Vasen Ä..")?;
        assert_eq!(prompt.phrases(), ["car", "office chair", "2 vasen ä"]);
        let text = prompt.text();
        assert_eq!(text, "car. office chair. 2 vasen ä.");
        let parts: Vec<&str> = prompt.ranges().into_iter().map(|r| &text[r]).collect();
        assert_eq!(parts, prompt.phrases());
        assert_eq!(Prompt::parse("vase")?.text(), "vase.");
        Ok(())
    }

    #[test]
    fn a_prompt_of_nothing_is_refused() {
        for text in ["", " . ", "...", "!?-."] {
            let error = Prompt::parse(text).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains("names nothing"), "{text:?}: {error}");
        }
    }
}
