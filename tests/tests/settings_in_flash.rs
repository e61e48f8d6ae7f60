//! Settings in flash: what is left when power is lost in the middle of
//! anything, when the flash holds something else, and how long it lasts.
#![allow(clippy::unwrap_used)]

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use nova_hal_sim::flash::{ENDURANCE, PAGE_BYTES, PowerCut, Torn};
use nova_hal_sim::{Flash, FlashError};
use nova_node::store::{IMAGE_VERSION, Store, StoreError};
use nova_wire::settings::{Addresses, MAX_ADDRESSES};
use nova_wire::{Change, Setting, Settings, SettingsSource, Value};
use proptest::prelude::*;

/// Pages that the board keeps for settings.
const PAGES: usize = 4;

fn store<F: NorFlash>(flash: F) -> Store<F> {
    Store::new(flash, 0..(PAGES * PAGE_BYTES) as u32).unwrap()
}

/// Settings that differ for each `k`, and in how long they are.
fn settings(k: u32) -> Settings {
    let mut settings = Settings::new();
    let number = |setting: Setting, value| Change {
        setting: setting.number(),
        value: Some(Value::Number(value)),
    };
    settings
        .change(&number(Setting::PeriodUs, 1_000 + k))
        .unwrap();
    if k.is_multiple_of(2) {
        settings
            .change(&number(Setting::TxAntennaDelay, k % 60_000))
            .unwrap();
    }
    if k.is_multiple_of(3) {
        let first = (k % 60_000 + 1) as u16;
        let peers: Vec<u16> = (first..).take(MAX_ADDRESSES).collect();
        let count = k as usize % MAX_ADDRESSES;
        let value = Some(Value::Addresses(Addresses::new(&peers[..count]).unwrap()));
        let setting = Setting::Peers.number();
        settings.change(&Change { setting, value }).unwrap();
    }
    settings
}

/// A flash with settings 0 to `last` saved one after the other.
fn used(last: u32) -> Flash {
    let flash = Flash::new(PAGES);
    for k in 0..=last {
        store(flash.clone()).save(&settings(k)).unwrap();
    }
    flash
}

#[test]
fn what_is_saved_is_loaded_and_an_empty_flash_holds_nothing() {
    let flash = Flash::new(PAGES);
    let empty = store(flash.clone()).load();
    assert_eq!(empty, (Settings::new(), SettingsSource::Defaults));
    for k in 0..200 {
        store(flash.clone()).save(&settings(k)).unwrap();
        let loaded = store(flash.clone()).load();
        assert_eq!(loaded, (settings(k), SettingsSource::Stored));
    }
}

/// Power is lost before and in each word written and page erased, at every
/// fill of the pages from empty until each has been erased twice over.
#[test]
fn power_lost_anywhere_leaves_the_old_settings_or_the_new_ones() {
    let torn = [
        Torn::Untouched,
        Torn::Some(1),
        Torn::Some(2),
        Torn::Some(3),
        Torn::Finished,
    ];
    let flash = Flash::new(PAGES);
    let mut old = 0;
    store(flash.clone()).save(&settings(old)).unwrap();
    let (mut cuts, mut kept_old, mut got_new) = (0, 0, 0);
    while flash.erases().iter().any(|&n| n < 2) {
        let new = old + 1;
        for torn in torn {
            for after in 0.. {
                let flash = flash.duplicate();
                flash.cut_power(PowerCut { after, torn });
                let saved = store(flash.clone()).save(&settings(new));
                let cut = flash.is_without_power();
                flash.restore_power();
                let (loaded, source) = store(flash.clone()).load();
                assert_eq!(
                    source,
                    SettingsSource::Stored,
                    "{old}: {torn:?} after {after}"
                );
                if saved.is_ok() {
                    assert_eq!(loaded, settings(new));
                } else {
                    assert!(loaded == settings(old) || loaded == settings(new));
                }
                if !cut {
                    break;
                }
                cuts += 1;
                kept_old += u32::from(loaded == settings(old));
                got_new += u32::from(loaded == settings(new));
                // And life goes on.
                let next = settings(new + 1);
                store(flash.clone()).save(&next).unwrap();
                assert_eq!(store(flash).load(), (next, SettingsSource::Stored));
            }
        }
        store(flash.clone()).save(&settings(new)).unwrap();
        old = new;
    }
    println!("{old} saves, power lost at {cuts} places: {kept_old} old, {got_new} new");
    assert!(kept_old > 0 && got_new > 0);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Power that goes again while the damage of the last time is repaired, and
    /// again, in any order with saves that get through.
    #[test]
    fn power_lost_over_and_over_never_leaves_anything_else(
        filled in 0_u32..400,
        // What happens: a save of settings k, with power lost after so many operations.
        events in prop::collection::vec((1000_u32..2000, prop::option::of((0_u64..40, any::<u64>()))), 1..30),
    ) {
        let flash = used(filled);
        let mut possible = vec![settings(filled)];
        for (k, cut) in events {
            if let Some((after, seed)) = cut {
                let torn = if seed % 4 == 0 { Torn::Untouched } else { Torn::Some(seed) };
                flash.cut_power(PowerCut { after, torn });
            }
            if store(flash.clone()).save(&settings(k)).is_ok() {
                possible = vec![settings(k)];
            } else {
                prop_assert!(flash.is_without_power());
                possible.push(settings(k));
            }
            flash.restore_power();
            // The next start may be cut short as well, in the middle of repairs.
            if let Some((after, seed)) = cut {
                flash.cut_power(PowerCut { after: after / 8, torn: Torn::Some(!seed) });
                store(flash.clone()).load();
                flash.restore_power();
            }
            let (loaded, source) = store(flash.clone()).load();
            prop_assert_eq!(source, SettingsSource::Stored);
            prop_assert!(possible.contains(&loaded));
            possible = vec![loaded];
        }
    }

    /// Whatever lies in the flash: a start ends, and settings can be saved.
    #[test]
    fn other_softwares_leavings_are_no_settings_and_do_no_harm(
        pieces in prop::collection::vec((0..PAGES * PAGE_BYTES, prop::collection::vec(any::<u8>(), 1..600)), 0..20),
        images in 0_u32..150,
    ) {
        let flash = if images > 0 { used(images) } else { Flash::new(PAGES) };
        for (offset, bytes) in &pieces {
            flash.preload(*offset, bytes);
        }
        let (_, source) = store(flash.clone()).load();
        prop_assert_ne!(source, SettingsSource::FlashFailed);
        // Garbage may look like pages that are full: what was never erased may refuse.
        if store(flash.clone()).save(&settings(7)).is_ok() {
            prop_assert_eq!(store(flash).load(), (settings(7), SettingsSource::Stored));
        }
    }
}

/// Writes an image as if it were ours.
fn with_image(image: &[u8]) -> Flash {
    use embassy_embedded_hal::adapter::BlockingAsync;
    use sequential_storage::cache::Cache;
    use sequential_storage::map::{MapConfig, MapStorage};
    let flash = Flash::new(PAGES);
    let config = MapConfig::new(0..(PAGES * PAGE_BYTES) as u32);
    let mut map = MapStorage::<u8, _, _>::new(
        BlockingAsync::new(flash.clone()),
        config,
        Cache::new_uncached(),
    );
    let stored = embassy_futures::poll_once(map.store_item(&mut [0; 256], &0, &image));
    assert!(matches!(stored, std::task::Poll::Ready(Ok(()))));
    flash
}

fn image(version: u8, changes: &[Change]) -> Vec<u8> {
    postcard::to_stdvec(&(version, changes)).unwrap()
}

#[test]
fn an_image_of_another_version_or_with_nonsense_in_it_gives_defaults_and_says_so() {
    let good = Change {
        setting: Setting::Pan.number(),
        value: Some(Value::Number(7)),
    };
    let (_, source) = store(with_image(&image(IMAGE_VERSION, &[good]))).load();
    assert_eq!(source, SettingsSource::Stored);

    let unknown = Change {
        setting: 99,
        ..good
    };
    let too_large = Change {
        value: Some(Value::Number(0x1_0000)),
        ..good
    };
    let mut longer = image(IMAGE_VERSION, &[good]);
    longer.push(0);
    let mut shorter = image(IMAGE_VERSION, &[good]);
    shorter.pop();
    let cases = [
        (
            image(IMAGE_VERSION + 1, &[good]),
            SettingsSource::OtherVersion,
        ),
        (image(0, &[]), SettingsSource::OtherVersion),
        (
            image(IMAGE_VERSION, &[good, unknown]),
            SettingsSource::Damaged,
        ),
        (
            image(IMAGE_VERSION, &[good, too_large]),
            SettingsSource::Damaged,
        ),
        (longer, SettingsSource::Damaged),
        (shorter, SettingsSource::Damaged),
        (vec![], SettingsSource::Damaged),
    ];
    for (image, expected) in cases {
        let flash = with_image(&image);
        let loaded = store(flash.clone()).load();
        assert_eq!(loaded, (Settings::new(), expected), "{image:?}");
        store(flash.clone()).save(&settings(3)).unwrap();
        assert_eq!(store(flash).load(), (settings(3), SettingsSource::Stored));
    }
}

#[test]
fn an_only_image_that_has_lost_bits_gives_defaults_and_says_so() {
    let whole = used(0);
    let written = (0..PAGE_BYTES)
        .filter(|&offset| {
            let mut byte = [0];
            whole.clone().read(offset as u32, &mut byte).unwrap();
            byte != [0xFF]
        })
        .collect::<Vec<_>>();
    let mut told = 0;
    for &offset in &written {
        for bit in 0..8 {
            let flash = whole.duplicate();
            flash.damage(offset, 1 << bit);
            match store(flash).load() {
                // The crate's own marks have bits to spare.
                (settings_, SettingsSource::Stored) => assert_eq!(settings_, settings(0)),
                (nothing, source) => {
                    assert_eq!(source, SettingsSource::Damaged, "bit {bit} of {offset}");
                    assert_eq!(nothing, Settings::new());
                    told += 1;
                }
            }
        }
    }
    assert!(told > 8 * 8, "{told} of {} bytes", written.len());
}

/// Takes writes and forgets them, as the nRF52832 does below its supply threshold.
struct Deaf(Flash);

impl ErrorType for Deaf {
    type Error = FlashError;
}

impl ReadNorFlash for Deaf {
    const READ_SIZE: usize = 1;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.0.read(offset, bytes)
    }
    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Deaf {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE_BYTES;
    fn erase(&mut self, _: u32, _: u32) -> Result<(), FlashError> {
        Ok(())
    }
    fn write(&mut self, _: u32, _: &[u8]) -> Result<(), FlashError> {
        Ok(())
    }
}

#[test]
fn a_flash_that_ignores_writes_is_noticed() {
    for last in [0, 1, 50, 100] {
        let flash = used(last);
        let mut deaf = store(Deaf(flash.clone()));
        assert_eq!(deaf.save(&settings(last + 1)), Err(StoreError::Flash));
        assert_eq!(deaf.load(), (settings(last), SettingsSource::Stored));
    }
    let mut new = store(Deaf(Flash::new(PAGES)));
    assert_eq!(new.save(&settings(1)), Err(StoreError::Flash));
}

#[test]
fn a_flash_without_power_is_a_failed_one() {
    let flash = used(3);
    flash.cut_power(PowerCut {
        after: 0,
        torn: Torn::Untouched,
    });
    assert_eq!(
        store(flash.clone()).save(&settings(9)),
        Err(StoreError::Flash)
    );
    let (_, source) = store(flash).load();
    assert_eq!(source, SettingsSource::FlashFailed);
}

#[test]
fn saving_what_is_stored_costs_nothing() {
    let flash = used(12);
    let before = flash.operations();
    store(flash.clone()).save(&settings(12)).unwrap();
    assert_eq!(flash.operations(), before);
}

#[test]
fn two_pages_are_the_least() {
    let flash = Flash::new(PAGES);
    for range in [0..4096, 0..0, 100..8192, 0..6000] {
        let store = Store::new(flash.clone(), range);
        assert_eq!(store.err(), Some(StoreError::Range));
    }
}

/// The wear of settings that all are set, the longest image there is.
#[test]
fn the_flash_lasts_for_a_million_changes() {
    const SAVES: u32 = 20_000;
    let longest = |k: u32| {
        let mut all = settings(6);
        for (setting, value) in [
            (Setting::Address, 0xFFFD),
            (Setting::Pan, 0xFFFE),
            (Setting::Part, 1),
            (Setting::PeriodUs, 59_000_000 + k),
            (Setting::TxAntennaDelay, 0xFFFF),
            (Setting::RxAntennaDelay, 0xFFFF),
            (Setting::ReplyUs, 30_000),
        ] {
            let value = Some(Value::Number(value));
            let setting = setting.number();
            all.change(&Change { setting, value }).unwrap();
        }
        let peers: Vec<u16> = (1..=0xFFFD).rev().take(MAX_ADDRESSES).collect();
        let peers = Addresses::new(&peers).unwrap();
        let value = Some(Value::Addresses(peers));
        let setting = Setting::Peers.number();
        all.change(&Change { setting, value }).unwrap();
        all
    };
    let flash = Flash::new(PAGES);
    let mut store = store(flash.clone());
    for k in 0..SAVES {
        store.save(&longest(k)).unwrap();
    }
    let erases = flash.erases();
    let (least, most) = (*erases.iter().min().unwrap(), *erases.iter().max().unwrap());
    let lifetime = u64::from(SAVES) * u64::from(ENDURANCE) / u64::from(most);
    println!(
        "{SAVES} saves: {:.1} operations and {:.4} erases each, {least} to {most} erases a page: \
         {lifetime} saves until a page has had {ENDURANCE}",
        flash.operations() as f64 / f64::from(SAVES),
        f64::from(erases.iter().sum::<u32>()) / f64::from(SAVES),
    );
    assert!(most - least <= 1, "wear is spread");
    assert!(lifetime >= 1_000_000, "{lifetime}");
}
