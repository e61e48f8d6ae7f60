//! What was surveyed: where nodes stood, or how far apart, while which streams were taken.

use crate::error::bad_input;
use crate::node_address::{hex, parse};
use anyhow::Result;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

/// Two different nodes, the lower address first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Link(u16, u16);

impl Link {
    pub(super) fn new(a: u16, b: u16) -> Self {
        Self(a.min(b), a.max(b))
    }

    pub(super) fn nodes(self) -> [u16; 2] {
        [self.0, self.1]
    }
}

impl std::fmt::Display for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} and {}", hex(self.0), hex(self.1))
    }
}

/// `A-B=M`: two nodes and their distance.
#[derive(Clone, Copy, Debug)]
pub(super) struct GivenDistance {
    link: Link,
    distance_m: f64,
}

impl FromStr for GivenDistance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (nodes, distance) = text
            .split_once('=')
            .ok_or("not of the form NODE-NODE=METRES")?;
        Ok(Self {
            link: link(nodes)?,
            distance_m: metres(distance)
                .filter(|m| *m > 0.0)
                .ok_or_else(|| format!("'{distance}' is not a distance in metres"))?,
        })
    }
}

/// `NODE=X,Y,Z`: a node and where it stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct GivenPosition {
    node: u16,
    position_m: [f64; 3],
}

impl FromStr for GivenPosition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "not of the form NODE=X,Y,Z";
        let (node, place) = text.split_once('=').ok_or(form)?;
        let numbers: Option<Vec<f64>> = place.split(',').map(metres).collect();
        let position_m = (numbers.ok_or(form)?).try_into().map_err(|_| form)?;
        Ok(Self {
            node: parse(node)?,
            position_m,
        })
    }
}

fn link(text: &str) -> Result<Link, String> {
    let (a, b) = (text.split_once('-')).ok_or("two nodes are written NODE-NODE")?;
    match (parse(a)?, parse(b)?) {
        (a, b) if a == b => Err(format!("{} is one node, not two", hex(a))),
        (a, b) => Ok(Link::new(a, b)),
    }
}

fn metres(text: &str) -> Option<f64> {
    let metres: f64 = text.trim().parse().ok()?;
    (metres.abs() <= 1e5).then_some(metres)
}

/// Nodes that stood still while some streams were taken.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    /// Where the streams come from.
    pub(super) sources: Vec<String>,
    distances_m: BTreeMap<Link, f64>,
    positions_m: BTreeMap<u16, [f64; 3]>,
}

impl Placement {
    /// From what was given as options.
    pub(super) fn given(
        sources: Vec<String>,
        distances: &[GivenDistance],
        positions: &[GivenPosition],
    ) -> Result<Self> {
        let mut placement = Self {
            sources,
            distances_m: BTreeMap::new(),
            positions_m: BTreeMap::new(),
        };
        for given in distances {
            if (placement.distances_m)
                .insert(given.link, given.distance_m)
                .is_some()
            {
                return Err(bad_input!("--distance: {} twice", given.link));
            }
        }
        for given in positions {
            if (placement.positions_m)
                .insert(given.node, given.position_m)
                .is_some()
            {
                return Err(bad_input!("--at: {} twice", hex(given.node)));
            }
        }
        placement.check("--distance, --at")?;
        Ok(placement)
    }

    fn check(&self, what: &str) -> Result<()> {
        if self.distances_m.is_empty() && self.positions_m.len() < 2 {
            return Err(bad_input!(
                "{what}: the distance between two nodes, or the places of two, must be known"
            ));
        }
        Ok(())
    }

    /// How far apart two nodes stood, if that is known; a distance given is preferred to positions.
    pub(super) fn distance_m(&self, link: Link) -> Option<f64> {
        if let Some(&distance_m) = self.distances_m.get(&link) {
            return Some(distance_m);
        }
        let [a, b] = link.nodes().map(|node| self.positions_m.get(&node));
        let squares = a?.iter().zip(b?).map(|(a, b)| (a - b) * (a - b));
        let distance_m = squares.sum::<f64>().sqrt();
        (distance_m > 0.0).then_some(distance_m)
    }

    /// All pairs whose distance is known.
    pub(super) fn links(&self) -> Vec<Link> {
        let placed: Vec<u16> = self.positions_m.keys().copied().collect();
        let between = (placed.iter().enumerate())
            .flat_map(|(k, &a)| placed.iter().skip(k + 1).map(move |&b| Link::new(a, b)));
        let mut links: Vec<Link> = (self.distances_m.keys().copied())
            .chain(between)
            .filter(|&link| self.distance_m(link).is_some())
            .collect();
        links.sort_unstable();
        links.dedup();
        links
    }
}

/// A file that lists placements.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SurveyFile {
    placement: Vec<GivenPlacement>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GivenPlacement {
    sources: Vec<String>,
    #[serde(default)]
    distances: BTreeMap<String, f64>,
    #[serde(default)]
    positions: BTreeMap<String, [f64; 3]>,
}

/// Reads a survey; its files are named from where it lies.
pub(super) fn read(path: &Path) -> Result<Vec<Placement>> {
    let shown = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| bad_input!("{shown}: cannot be read: {error}"))?;
    let survey: SurveyFile = toml::from_str(&text)
        .map_err(|error| bad_input!("{shown}: {}", error.to_string().trim().replace('\n', " ")))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut placements = Vec::new();
    for (number, given) in (1..).zip(survey.placement) {
        let what = format!("{shown}: placement {number}");
        let complain = |why: String| bad_input!("{what}: {why}");
        let mut placement = Placement {
            sources: Vec::new(),
            distances_m: BTreeMap::new(),
            positions_m: BTreeMap::new(),
        };
        for source in given.sources {
            let beside = folder.join(&source);
            placement.sources.push(if beside.is_file() {
                beside.display().to_string()
            } else {
                source
            });
        }
        if placement.sources.is_empty() {
            return Err(complain("there are no sources".to_owned()));
        }
        for (nodes, distance_m) in given.distances {
            if !(distance_m > 0.0 && distance_m <= 1e5) {
                return Err(complain(format!(
                    "{distance_m} is not a distance in metres"
                )));
            }
            let link = link(&nodes).map_err(complain)?;
            if placement.distances_m.insert(link, distance_m).is_some() {
                return Err(complain(format!("the distance of {link} twice")));
            }
        }
        for (node, position_m) in given.positions {
            if !position_m.iter().all(|m| m.abs() <= 1e5) {
                return Err(complain(format!("{position_m:?} is not a place in metres")));
            }
            let node = parse(&node).map_err(complain)?;
            if placement.positions_m.insert(node, position_m).is_some() {
                return Err(complain(format!("the place of {} twice", hex(node))));
            }
        }
        placement.check(&what)?;
        placements.push(placement);
    }
    if placements.is_empty() {
        return Err(bad_input!("{shown}: there is no placement in it"));
    }
    Ok(placements)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distance_given_is_preferred_to_one_from_positions() {
        let placement = Placement::given(
            vec![],
            &["0x0002-1=4.9".parse().unwrap()],
            &[
                "1=0,0,0".parse().unwrap(),
                "2=3,4,0".parse().unwrap(),
                "3=0,0,2".parse().unwrap(),
            ],
        )
        .unwrap();
        assert_eq!(placement.distance_m(Link::new(1, 2)), Some(4.9));
        assert_eq!(placement.distance_m(Link::new(3, 1)), Some(2.0));
        assert_eq!(placement.distance_m(Link::new(3, 4)), None);
        assert_eq!(placement.links().len(), 3);
    }

    #[test]
    fn what_is_no_distance_or_position_is_refused() {
        for text in [
            "1-2", "1-2=0", "1-2=-1", "1-2=far", "1=2", "1-1=2", "0A1B-1=2", "1-2=NaN",
        ] {
            assert!(text.parse::<GivenDistance>().is_err(), "{text}");
        }
        for text in ["1", "1=1,2", "1=1,2,x", "1=1,2,3,4", "x=1,2,3", "1=inf,0,0"] {
            assert!(text.parse::<GivenPosition>().is_err(), "{text}");
        }
        let positions = ["1=0,0,0".parse().unwrap()];
        assert!(Placement::given(vec![], &[], &positions).is_err());
    }
}
