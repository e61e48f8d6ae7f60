//! Short texts in records.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Most bytes of a [`Text`].
pub const MAX_TEXT_LEN: usize = 40;

/// A short text in ASCII; what is too long loses its beginning, since the end of a file's name says more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Text {
    len: u8,
    // Zero behind `len`, so that equal texts are equal.
    bytes: [u8; MAX_TEXT_LEN],
}

impl Text {
    /// The end of `text`; what is not printable ASCII becomes a question mark.
    pub fn new(text: &str) -> Self {
        let mut new = Self {
            len: 0,
            bytes: [0; MAX_TEXT_LEN],
        };
        let skipped = text.len().saturating_sub(MAX_TEXT_LEN);
        for (place, byte) in new.bytes.iter_mut().zip(text.bytes().skip(skipped)) {
            let printable = byte == b' ' || byte.is_ascii_graphic();
            *place = if printable { byte } else { b'?' };
            new.len += 1;
        }
        new
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..usize::from(self.len)).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or_default()
    }
}

impl Serialize for Text {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.as_str().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = heapless::String::<MAX_TEXT_LEN>::deserialize(deserializer)?;
        Ok(Self::new(&text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::String;

    #[test]
    fn the_end_of_a_long_text_is_kept() {
        let long: String = (0..30).map(|n| std::format!("{n:02}")).collect();
        assert_eq!(Text::new(&long).as_str(), &long[20..]);
        assert_eq!(Text::new("src/app.rs").as_str(), "src/app.rs");
        assert_eq!(Text::new("gr\u{FC}n\n").as_str(), "gr??n?");
    }
}
