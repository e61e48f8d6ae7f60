//! `nova survey`: anchors that nobody measured in, found from a tag's known track.

mod input;
mod page;
mod report;

use crate::anchors::{AnchorEntry, AnchorsFile, CommonEntry, NodeName};
use crate::error::bad_input;
use crate::place::Triple;
use crate::table::{ColumnNames, file_name};
use anyhow::Result;
use input::{GivenHeight, Input, Kept, Origin};
use nova_solver::multilateration::{Height, Noise};
use nova_solver::survey::{
    AnchorRanges, SurveyError, SurveyOptions, advise, as_measured, inverted_uwb, survey,
};
use report::Report;
use std::io::Write as _;
use std::path::PathBuf;

/// Where anchors are, from ranges of a tag whose track is known.
///
/// FILE is CSV with the columns t_s, peer, range_m and optionally sigma_m: at time t_s the tag was
/// range_m away from the anchor called peer. Where the tag was comes from the columns x_m, y_m, z_m (or
/// lat_deg, lon_deg, alt_m) of the same file, or of another file with its own times given by --track.
/// All anchors are found at once, with what they share: how far the ranges' clock is behind the
/// track's, and how much a range grows with distance. Beside it stands what the paper's method (one
/// anchor at a time, plain least squares) makes of the same ranges.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova survey flight.csv
  nova survey flight.csv --json --out anchors.toml --plot survey.html
  nova survey ranges.csv --columns peer=anchor --track rtk.csv --tag-offset 0,0,1
  nova survey ranges.csv --track fixes.csv --keep status=2 --max-gap 0.3
  nova survey ranges.csv --track rtk.csv --height 2 --height 7=1.5      heights known")]
pub(crate) struct Survey {
    /// The ranges; `-` for standard input.
    #[arg(value_name = "FILE|-")]
    file: PathBuf,
    /// Where the tracked point was: t_s and x_m, y_m, z_m or lat_deg, lon_deg, alt_m.
    #[arg(long, value_name = "FILE")]
    track: Option<PathBuf>,
    /// Use only the track's lines where this column has this value.
    #[arg(long, value_name = "COLUMN=VALUE", requires = "track")]
    keep: Option<Kept>,
    /// Where the tag's antenna is from the tracked point: east, north, up in metres.
    #[arg(long, value_name = "E,N,U", allow_hyphen_values = true)]
    tag_offset: Option<Triple>,
    /// Origin of the ENU frame where the track is geodetic; its first point by default.
    #[arg(long, value_name = "LAT,LON,H", allow_hyphen_values = true)]
    origin: Option<Origin>,
    /// Height of all anchors, or of one, in metres; may be given several times.
    #[arg(long, value_name = "[NODE=]M", allow_hyphen_values = true)]
    height: Vec<GivenHeight>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Write the anchors for `nova fuse`.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a page: map, convergence over the number of ranges, figures.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Standard deviation of a range, in metres, where the file has no sigma_m.
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    sigma: f64,
    /// Believe the standard deviations; otherwise the ranges' scatter decides.
    #[arg(long)]
    trust_sigma: bool,
    /// Standard deviation of the track, in metres.
    #[arg(long, value_name = "M", default_value_t = 0.02)]
    track_sigma: f64,
    /// How far the two clocks may be apart, in seconds (one sigma); 0 where they are one.
    #[arg(long, value_name = "S", default_value_t = 0.5)]
    lag_sigma: f64,
    /// How much ranges may grow with distance (one sigma); 0 for not at all.
    #[arg(long, value_name = "M_PER_M", default_value_t = 0.005)]
    slope_sigma: f64,
    /// Expected bias of ranges, in metres.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    bias: f64,
    /// How far an anchor's bias may be from that (one sigma); 0 where it is known.
    #[arg(long, value_name = "M", default_value_t = 0.3)]
    bias_sigma: f64,
    /// Standard deviation of errors that do not average out, in metres.
    #[arg(long, value_name = "M", default_value_t = 0.05)]
    systematic_sigma: f64,
    /// Leave out ranges in gaps of the track longer than this, in seconds.
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    max_gap: f64,
    /// Pass over lines that cannot be used instead of stopping at the first; says how many.
    #[arg(long)]
    skip_bad: bool,
    /// What columns are called in FILE, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...")]
    columns: Option<ColumnNames>,
    /// The same for the track.
    #[arg(long, value_name = "WANTED=GIVEN,...", requires = "track")]
    track_columns: Option<ColumnNames>,
}

impl Survey {
    pub(crate) fn run(self) -> Result<()> {
        let options = self.options()?;
        let input = Input::read(&self)?;
        let peers: Vec<_> = input.ranges.keys().cloned().collect();
        let anchors: Vec<AnchorRanges<'_>> = (input.ranges.iter())
            .map(|(peer, ranges)| AnchorRanges {
                ranges,
                height: self.height_of(peer),
            })
            .collect();
        let found = survey(&input.track, &anchors, &options)
            .map_err(|error| self.explain(&peers, &error))?;
        let one_by_one: Vec<_> = (anchors.iter())
            .map(|anchor| {
                inverted_uwb(&as_measured(&input.track, anchor.ranges, options.max_gap_s)).ok()
            })
            .collect();
        let advice = advise(&found, &input.track, &options);
        if let Some(path) = &self.out {
            anchors_file(&peers, &found, &input).write(path)?;
        }
        if let Some(path) = &self.plot {
            page::write(
                path,
                &peers,
                &anchors,
                &found,
                &one_by_one,
                &input,
                &options,
            )?;
        }
        let report = Report::new(&peers, &found, &one_by_one, &advice, &input);
        let said = if self.json {
            serde_json::to_string(&report)? + "\n"
        } else {
            report.text()
        };
        Ok(std::io::stdout().write_all(said.as_bytes())?)
    }

    fn options(&self) -> Result<SurveyOptions> {
        if !(self.sigma > 0.0 && self.sigma.is_finite()) {
            return Err(bad_input!("--sigma must be more than 0 metres"));
        }
        for (name, value) in [
            ("--track-sigma", self.track_sigma),
            ("--lag-sigma", self.lag_sigma),
            ("--slope-sigma", self.slope_sigma),
            ("--bias-sigma", self.bias_sigma),
            ("--systematic-sigma", self.systematic_sigma),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(bad_input!("{name} must be 0 or more"));
            }
        }
        if self.max_gap.is_nan() || self.max_gap <= 0.0 {
            return Err(bad_input!("--max-gap must be more than 0 seconds"));
        }
        if !self.bias.is_finite() {
            return Err(bad_input!("--bias must be a finite number of metres"));
        }
        Ok(SurveyOptions {
            lag_sigma_s: self.lag_sigma,
            slope_sigma: self.slope_sigma,
            bias_m: self.bias,
            bias_sigma_m: self.bias_sigma,
            track_sigma_m: self.track_sigma,
            max_gap_s: self.max_gap,
            noise: if self.trust_sigma {
                Noise::Given
            } else {
                Noise::Estimated
            },
            systematic_sigma_m: self.systematic_sigma,
            ..SurveyOptions::default()
        })
    }

    fn height_of(&self, peer: &crate::peer::Peer) -> Height {
        let own = self
            .height
            .iter()
            .rev()
            .find(|h| h.node.as_ref() == Some(peer));
        let given = own.or_else(|| self.height.iter().rev().find(|h| h.node.is_none()));
        given.map_or(Height::Unknown, |given| Height::Known(given.height_m))
    }

    fn explain(&self, peers: &[crate::peer::Peer], error: &SurveyError) -> anyhow::Error {
        let file = file_name(&self.file);
        let name = |anchor: usize| {
            peers
                .get(anchor)
                .map_or_else(String::new, ToString::to_string)
        };
        match error {
            SurveyError::TooFewRanges {
                anchor,
                got,
                given,
                unknowns,
            } => bad_input!(
                "{file}: anchor {}: {got} of its {given} ranges were taken while the track was known; \
                 more than {unknowns} are needed, from places apart (clocks that differ by more than \
                 --lag-sigma, or a track with gaps longer than --max-gap, leave few)",
                name(*anchor)
            ),
            SurveyError::Anchor { anchor, error } => {
                bad_input!("{file}: anchor {}: {error}", name(*anchor))
            }
            other => bad_input!("{file}: {other}"),
        }
    }
}

fn anchors_file(
    peers: &[crate::peer::Peer],
    found: &nova_solver::survey::Survey,
    input: &Input,
) -> AnchorsFile {
    let common = found.common;
    AnchorsFile {
        common: Some(CommonEntry {
            lag_s: common.lag_s,
            lag_sigma_s: common.lag_sigma_s,
            slope: common.slope,
            slope_sigma: common.slope_sigma,
        }),
        origin: input.frame.map(|frame| frame.origin().into()),
        anchors: (peers.iter().zip(&found.anchors))
            .map(|(peer, anchor)| AnchorEntry::new(NodeName::from(peer), &anchor.found))
            .collect(),
    }
}
