//! Anchors, differences in files, and arguments.

use super::Locate;
use crate::anchors::{AnchorsFile, NodeName};
use crate::error::bad_input;
use crate::node_address;
use crate::peer::Peer;
use crate::place::Place;
use crate::table::{ColumnNames, Table, file_name};
use anyhow::Result;
use nalgebra::Vector3;
use nova_solver::positioning::{
    ListenedAnchor, ListenedDifference, ListenedRound, RangeDifference,
};
use nova_solver::survey::{Track, TrackPoint};
use std::path::Path;
use std::str::FromStr;

/// `LOW,HIGH`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Heights(pub(super) [f64; 2]);

impl FromStr for Heights {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = (text.split(','))
            .filter_map(|part| part.trim().parse().ok())
            .collect();
        match numbers[..] {
            [low, high] if low < high && text.split(',').count() == 2 => Ok(Self([low, high])),
            _ => Err("not two heights in metres, the lower first, with a comma between".to_owned()),
        }
    }
}

/// The anchors with an address each.
pub(super) struct Anchors {
    named: Vec<(Peer, ListenedAnchor)>,
    listened: Vec<ListenedAnchor>,
}

impl Anchors {
    /// Of the file. Whoever has no address as a name gets one that is free: differences name them too.
    pub(super) fn of(site: &AnchorsFile, path: &Path) -> Result<Self> {
        let name = path.display();
        if site.anchors.len() < 4 {
            return Err(bad_input!(
                "{name}: {} anchors; differences of distances need four or more",
                site.anchors.len()
            ));
        }
        let address_of = |node: &NodeName| match node {
            NodeName::Number(number) => u16::try_from(*number).ok(),
            NodeName::Word(word) => node_address::parse(word).ok(),
        };
        let taken: Vec<u16> = (site.anchors.iter())
            .filter_map(|a| address_of(&a.node))
            .collect();
        let mut free = (0..=u16::MAX)
            .rev()
            .filter(|address| !taken.contains(address));
        let mut named = Vec::new();
        for anchor in &site.anchors {
            let address = address_of(&anchor.node).or_else(|| free.next());
            let address =
                address.ok_or_else(|| bad_input!("{name}: more anchors than addresses"))?;
            let position_m = Vector3::from(anchor.position_m);
            named.push((
                anchor.node.peer(),
                ListenedAnchor {
                    address,
                    position_m,
                },
            ));
        }
        let listened: Vec<ListenedAnchor> = named.iter().map(|(_, anchor)| *anchor).collect();
        for (index, anchor) in listened.iter().enumerate() {
            let before = listened.iter().take(index);
            if before.clone().any(|other| other.address == anchor.address) {
                return Err(bad_input!(
                    "{name}: two anchors have the address {}",
                    node_address::hex(anchor.address)
                ));
            }
            if before
                .clone()
                .any(|other| other.position_m == anchor.position_m)
            {
                return Err(bad_input!(
                    "{name}: two anchors stand at one place, {:?}",
                    anchor.position_m.as_slice()
                ));
            }
        }
        Ok(Self { named, listened })
    }

    pub(super) fn listened(&self) -> &[ListenedAnchor] {
        &self.listened
    }

    /// What the anchor at this place is called.
    pub(super) fn name_at(&self, place: &Vector3<f64>) -> Option<&Peer> {
        (self.named.iter()).find_map(|(peer, anchor)| (anchor.position_m == *place).then_some(peer))
    }

    fn find(&self, peer: &Peer) -> Option<ListenedAnchor> {
        self.named
            .iter()
            .find_map(|(named, anchor)| (named == peer).then_some(*anchor))
    }
}

const COLUMNS: [&str; 5] = ["t_s", "anchor_a", "anchor_b", "difference_m", "sigma_m"];

/// Hands the differences of a CSV file on, each a round, in order of time.
pub(super) fn differences(
    of: &Locate,
    path: &Path,
    anchors: &Anchors,
    notes: &mut Vec<String>,
    mut take: impl FnMut(ListenedRound),
) -> Result<()> {
    let names = of.columns.clone().unwrap_or_default();
    let table = Table::open(path, &names, "--columns", &COLUMNS)?;
    let (time, a, b, difference) = (
        table.require("t_s")?,
        table.require("anchor_a")?,
        table.require("anchor_b")?,
        table.require("difference_m")?,
    );
    let sigma = table.find("sigma_m")?;
    let (mut skipped, mut unknown) = (0u64, 0u64);
    let mut read: Vec<ListenedDifference> = Vec::new();
    let lines = table.for_each(|row| {
        let mut one = || -> Result<()> {
            row.check_length()?;
            let ends = [a, b].map(|column| anchors.find(&Peer::from(row.text(column))));
            let t_s = row.number(time)?;
            let difference_m = row.number(difference)?;
            let sigma_m = match sigma {
                None => of.sigma,
                Some(column) => match row.number(column)? {
                    sigma_m if sigma_m > 0.0 => sigma_m,
                    other => {
                        return Err(row.complain(column, &format!("is not positive ({other})")));
                    }
                },
            };
            let [Some(a), Some(b)] = ends else {
                unknown += 1;
                return Ok(());
            };
            read.push(ListenedDifference {
                t_s,
                addresses: [a.address, b.address],
                difference: RangeDifference {
                    anchors_m: [a.position_m, b.position_m],
                    difference_m,
                    sigma_m,
                },
                shared_m: [0.0; 2],
            });
            Ok(())
        };
        match one() {
            Err(_) if of.skip_bad => skipped += 1,
            other => other?,
        }
        Ok(())
    })?;
    if read.is_empty() {
        let file = file_name(path);
        return Err(bad_input!(
            "{file}: none of {lines} lines is a difference between two of the anchors"
        ));
    }
    let late = read
        .windows(2)
        .filter(|w| matches!(w, [a, b] if b.t_s < a.t_s))
        .count() as u64;
    read.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    for (count, what) in [
        (skipped, "lines skipped"),
        (
            unknown,
            "lines of anchors that are not in the file of anchors",
        ),
        (late, "lines out of order, sorted"),
    ] {
        if count > 0 {
            notes.push(format!("{count} of {lines} {what}"));
        }
    }
    for one in read {
        take(ListenedRound {
            differences: vec![one],
        });
    }
    Ok(())
}

/// A track to compare with.
pub(super) fn truth(path: &Path) -> Result<Track> {
    let table = Table::open(path, &ColumnNames::default(), "a header line of", &[])?;
    let time = table.require("t_s")?;
    let place = Place::of(&table)?;
    let mut points = Vec::new();
    table.for_each(|row| {
        row.check_length()?;
        points.push(TrackPoint {
            t_s: row.number(time)?,
            position_m: place.read(row, &mut None)?,
        });
        Ok(())
    })?;
    Track::new(&points).map_err(|error| bad_input!("{}: {error}", file_name(path)))
}
