//! Settings in flash.
//!
//! The settings that were made are one item, an image, that is written anew
//! whenever they change; `sequential-storage` puts images one behind the other
//! and erases a page only when all are full, which spreads the wear, and each
//! carries a CRC-32, so that one that power was lost in does not count: the one
//! before it does, if there is one. Nothing of the old image is touched until the new one is whole.
//!
//! ```text
//!   image:  version   changes that lead from nothing set to the settings
//!           1 byte    as in the command `set`: docs/wire-format.md
//! ```

use core::ops::Range;
use core::task::Poll;
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_futures::poll_once;
use embedded_storage::nor_flash::NorFlash;
use nova_wire::{Changes, Settings, SettingsSource};
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

/// Version of the image. Another one is not read: what it meant is not known.
pub const IMAGE_VERSION: u8 = 1;

/// The image's key.
const KEY: u8 = 0;

/// Longest image.
const IMAGE_LEN: usize = 192;

/// Space for an image and its key, in whole words.
const BUFFER_LEN: usize = IMAGE_LEN + 16;

type Map<F> = MapStorage<u8, BlockingAsync<F>, Cache<Uncached, Uncached, Uncached, u8>>;

/// The part of a flash that holds the settings.
pub struct Store<F: NorFlash> {
    map: Map<F>,
    /// Nothing had ever been written when the board started.
    blank: bool,
}

/// Why settings could not be stored. What was stored before is still there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError {
    /// The part of the flash is not made of whole pages, or of fewer than two.
    Range,
    /// The flash refused, or what it holds afterwards is not what was written:
    /// it is worn out, or the supply is too low to write.
    Flash,
}

impl core::fmt::Display for StoreError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Range => "settings need two whole pages of flash or more",
            Self::Flash => "the flash did not take the settings",
        })
    }
}

impl core::error::Error for StoreError {}

/// Why there are no settings to be had from an image.
enum Unreadable {
    OtherVersion,
    Damaged,
}

impl<F: NorFlash> Store<F> {
    /// Settings in this part of `flash`, which nobody else may use.
    ///
    /// # Errors
    /// [`StoreError::Range`].
    pub fn new(flash: F, range: Range<u32>) -> Result<Self, StoreError> {
        let mut flash = flash;
        let config = MapConfig::try_new(range.clone()).map_err(|_| StoreError::Range)?;
        let blank = is_blank(&mut flash, range);
        let flash = BlockingAsync::new(flash);
        Ok(Self {
            map: MapStorage::new(flash, config, Cache::new_uncached()),
            blank,
        })
    }

    /// What is stored; nothing set where that cannot be read.
    pub fn load(&mut self) -> (Settings, SettingsSource) {
        let mut buffer = [0; BUFFER_LEN];
        let (source, settings) = match self.fetch(&mut buffer) {
            Ok(Some(image)) => match read(image) {
                Ok(settings) => return (settings, SettingsSource::Stored),
                Err(Unreadable::OtherVersion) => (SettingsSource::OtherVersion, Settings::new()),
                Err(Unreadable::Damaged) => (SettingsSource::Damaged, Settings::new()),
            },
            Ok(None) if self.blank => (SettingsSource::Defaults, Settings::new()),
            // An image whose CRC is wrong, or was never finished.
            Ok(None) => (SettingsSource::Damaged, Settings::new()),
            Err(sequential_storage::Error::Storage { .. }) => {
                (SettingsSource::FlashFailed, Settings::new())
            }
            // Not the work of a lost supply, which is repaired: other
            // software's data, or bits that have changed by themselves.
            Err(_) => (SettingsSource::Damaged, Settings::new()),
        };
        (settings, source)
    }

    /// Stores `settings` in the place of those before, unless they are the same.
    /// Up to 90 ms pass when a page is to be erased.
    ///
    /// # Errors
    /// [`StoreError::Flash`].
    pub fn save(&mut self, settings: &Settings) -> Result<(), StoreError> {
        let mut image = [0; IMAGE_LEN];
        let image = write(settings, &mut image).ok_or(StoreError::Flash)?;
        if self.holds(image)? {
            return Ok(());
        }
        // Whether that worked shows in a moment.
        let _ = self.append(image);
        // Read back, because below its supply threshold the hardware does not
        // say that it refuses to write.
        if self.holds(image)? {
            return Ok(());
        }
        let mut buffer = [0; BUFFER_LEN];
        if let Ok(Some(_)) = self.fetch(&mut buffer) {
            // The old settings are not given up for the chance to store new ones.
            return Err(StoreError::Flash);
        }
        // Nothing that could be read, and nothing that can be written behind it:
        // other software's leavings.
        if now(self.map.erase_all()).and_then(Result::ok).is_none() {
            return Err(StoreError::Flash);
        }
        self.append(image)?;
        self.holds(image)?.then_some(()).ok_or(StoreError::Flash)
    }

    /// Whether this image is the one that counts.
    fn holds(&mut self, image: &[u8]) -> Result<bool, StoreError> {
        let mut buffer = [0; BUFFER_LEN];
        match self.fetch(&mut buffer) {
            Ok(stored) => Ok(stored == Some(image)),
            Err(sequential_storage::Error::Storage { .. }) => Err(StoreError::Flash),
            Err(_) => Ok(false),
        }
    }

    fn append(&mut self, image: &[u8]) -> Result<(), StoreError> {
        let mut buffer = [0; BUFFER_LEN];
        now(self.map.store_item(&mut buffer, &KEY, &image))
            .and_then(Result::ok)
            .ok_or(StoreError::Flash)
    }

    fn fetch<'b>(
        &mut self,
        buffer: &'b mut [u8],
    ) -> Result<Option<&'b [u8]>, sequential_storage::Error<F::Error>> {
        now(self.map.fetch_item::<&[u8]>(buffer, &KEY))
            .unwrap_or(Err(sequential_storage::Error::Corrupted {}))
    }
}

/// The outcome of work on a flash that blocks: it never waits for anything.
fn now<T>(work: impl Future<Output = T>) -> Option<T> {
    match poll_once(work) {
        Poll::Ready(outcome) => Some(outcome),
        Poll::Pending => None,
    }
}

/// Whether nothing has been written there since the last erase.
fn is_blank<F: NorFlash>(flash: &mut F, range: Range<u32>) -> bool {
    let mut bytes = [0; 64];
    range.step_by(bytes.len()).all(|offset| {
        flash.read(offset, &mut bytes).is_ok() && bytes.iter().all(|&byte| byte == 0xFF)
    })
}

/// The image of `settings`.
fn write<'b>(settings: &Settings, image: &'b mut [u8; IMAGE_LEN]) -> Option<&'b [u8]> {
    let changes: Changes = settings.changes().collect();
    postcard::to_slice(&(IMAGE_VERSION, changes), image)
        .ok()
        .map(|bytes| &*bytes)
}

/// The settings of an image; all of it is checked.
fn read(image: &[u8]) -> Result<Settings, Unreadable> {
    let (version, rest) = image.split_first().ok_or(Unreadable::Damaged)?;
    if *version != IMAGE_VERSION {
        return Err(Unreadable::OtherVersion);
    }
    let (changes, rest) =
        postcard::take_from_bytes::<Changes>(rest).map_err(|_| Unreadable::Damaged)?;
    let mut settings = Settings::new();
    for change in &changes {
        settings.change(change).map_err(|_| Unreadable::Damaged)?;
    }
    rest.is_empty()
        .then_some(settings)
        .ok_or(Unreadable::Damaged)
}

/// The settings in an image from anywhere, if it is a good one: for those who
/// try what an image can do to a node.
pub fn settings_of_image(image: &[u8]) -> Option<Settings> {
    read(image).ok()
}
