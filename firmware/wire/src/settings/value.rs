//! Values of settings.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Most addresses in one value.
pub const MAX_ADDRESSES: usize = 8;

/// The value of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum Value {
    /// A number, in the setting's unit; a word by its place among the setting's words.
    Number(u32),
    /// Short addresses of nodes.
    Addresses(Addresses),
}

/// Some short addresses, at most [`MAX_ADDRESSES`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Addresses {
    len: u8,
    // Zero behind `len`, so that equal lists are equal.
    list: [u16; MAX_ADDRESSES],
}

impl Addresses {
    /// None.
    pub const NONE: Self = Self {
        len: 0,
        list: [0; MAX_ADDRESSES],
    };

    /// These; `None` if they are too many.
    pub fn new(addresses: &[u16]) -> Option<Self> {
        let mut list = [0; MAX_ADDRESSES];
        list.get_mut(..addresses.len())?.copy_from_slice(addresses);
        Some(Self {
            len: u8::try_from(addresses.len()).ok()?,
            list,
        })
    }

    /// The addresses.
    pub fn as_slice(&self) -> &[u16] {
        self.list.get(..usize::from(self.len)).unwrap_or_default()
    }
}

impl Serialize for Addresses {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.as_slice().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Addresses {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let list = heapless::Vec::<u16, MAX_ADDRESSES>::deserialize(deserializer)?;
        Ok(Self::new(&list).unwrap_or_default())
    }
}
