//! What a program that crashed leaves to the next one: a note in RAM that no start initialises.
//!
//! A reset leaves RAM as it is; a supply that was gone leaves noise in it, which the note's checksum tells from a
//! note. So an intact note after a start that gives no reason is a supply that only dipped: a brown-out.

/// Words of a note.
pub const NOTE_WORDS: usize = 14;

/// Bytes of a note's text.
const TEXT_WORDS: usize = 10;

/// Marks a note of this layout.
const MAGIC: u32 = 0x4E4F_5641;

/// What a program leaves behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Note {
    /// How it ended; 0: it has not.
    pub kind: u32,
    /// Where: a line, or an address.
    pub at: u32,
    /// Where or why, zero behind its end.
    pub text: [u8; 4 * TEXT_WORDS],
}

impl Note {
    /// Of a program that runs.
    pub const ALIVE: Self = Self {
        kind: 0,
        at: 0,
        text: [0; 4 * TEXT_WORDS],
    };

    /// With the end of `text`.
    pub fn new(kind: u32, at: u32, text: &str) -> Self {
        let mut note = Self {
            kind,
            at,
            ..Self::ALIVE
        };
        let skipped = text.len().saturating_sub(note.text.len());
        let places = note.text.iter_mut().zip(text.bytes().skip(skipped));
        places.for_each(|(place, byte)| *place = byte);
        note
    }

    /// The text, as far as it is one.
    pub fn text(&self) -> &str {
        let end = self.text.iter().position(|&b| b == 0);
        let bytes = self.text.get(..end.unwrap_or(self.text.len()));
        core::str::from_utf8(bytes.unwrap_or_default()).unwrap_or_default()
    }

    /// As it lies in RAM.
    pub fn to_words(&self) -> [u32; NOTE_WORDS] {
        let mut words = [0; NOTE_WORDS];
        let content = [MAGIC, self.kind, self.at]
            .into_iter()
            .chain(self.text.chunks_exact(4).map(|four| {
                four.iter()
                    .fold(0, |word, &byte| word << 8 | u32::from(byte))
            }));
        let sum = words.iter_mut().zip(content).fold(0, |sum, (place, word)| {
            *place = word;
            mixed(sum, word)
        });
        if let Some(last) = words.last_mut() {
            *last = sum;
        }
        words
    }

    /// What lies in RAM, if it is a note.
    pub fn from_words(words: &[u32; NOTE_WORDS]) -> Option<Self> {
        let [magic, kind, at, text @ .., sum] = words;
        let content = [magic, kind, at].into_iter().chain(text);
        if *magic != MAGIC || content.fold(0, |sum, &word| mixed(sum, word)) != *sum {
            return None;
        }
        let mut note = Self {
            kind: *kind,
            at: *at,
            ..Self::ALIVE
        };
        for (four, word) in note.text.chunks_exact_mut(4).zip(text) {
            four.copy_from_slice(&word.to_be_bytes());
        }
        Some(note)
    }
}

/// A step of FNV-1a over words (Fowler, Noll, Vo): each word and its place count.
fn mixed(sum: u32, word: u32) -> u32 {
    (sum ^ word).wrapping_mul(0x0100_0193).rotate_left(5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_comes_back_as_it_was_left() {
        for text in [
            "",
            "src/app.rs",
            "firmware/node/src/a/very/long/name/of/a/file/indeed.rs",
        ] {
            let note = Note::new(2, 77, text);
            assert_eq!(Note::from_words(&note.to_words()), Some(note));
            assert!(text.ends_with(note.text()));
            assert_eq!(note.text().len(), text.len().min(40));
        }
    }

    #[test]
    fn noise_is_no_note() {
        assert_eq!(Note::from_words(&[0; NOTE_WORDS]), None);
        assert_eq!(Note::from_words(&[u32::MAX; NOTE_WORDS]), None);
        let words = Note::new(1, 5, "src/uart.rs").to_words();
        for word in 0..NOTE_WORDS {
            for bit in 0..32 {
                let mut faded = words;
                faded[word] ^= 1 << bit;
                assert_eq!(Note::from_words(&faded), None, "bit {bit} of word {word}");
            }
        }
    }
}
