//! `nova fuse`: GNSS, UWB and an inertial sensor together.

mod example;
mod input;
mod page;
mod report;

use crate::anchors::AnchorsFile;
use crate::error::bad_input;
use crate::files::write_whole;
use crate::place::Triple;
use anyhow::Result;
use input::{Events, Input, Reading};
use nova_solver::MultilaterationOptions;
use nova_solver::fusion::{
    Fate, FusionAnchor, LeverArms, Loose, LooseOptions, Navigation, Tight, TightOptions, UwbRange,
};
use nova_solver::geodesy::{Geodetic, LocalFrame};
use nova_solver::positioning::{AnchorRange, locate};
use page::Shown;
use report::{Counts, Report};
use std::io::Write as _;
use std::path::PathBuf;

/// Where a vehicle was, from GNSS, ranges to surveyed anchors and an inertial sensor.
///
/// tight: every range by itself, from any number of anchors, judged as it comes; anchors, their biases
/// and GNSS's slow error are among the unknowns. loose: the method of Osaka and Tsujii (2025), positions
/// from four ranges or more. Files may overlap in time in any way; lines out of order are sorted, and
/// said.
#[derive(clap::Args)]
#[command(after_help = "Files are CSV with the columns
  imu     t_s, fx_m_s2, fy_m_s2, fz_m_s2 (specific force, body frame: at rest 9.8 up),
          qw, qx, qy, qz (turns body vectors into ENU)
  gnss    t_s, lat_deg, lon_deg, alt_m or x_m, y_m, z_m; optionally pdop
  ranges  t_s, peer, range_m; optionally sigma_m, rx_power_dbm, fp_power_dbm
  truth   t_s, x_m, y_m, z_m
anchors.toml is what nova survey --out writes. The track written by --out has the columns
t_s, x_m, y_m, z_m, sigma_x_m, sigma_y_m, sigma_z_m, and lat_deg, lon_deg, alt_m where the origin is known.

Examples:
  nova fuse --example flight3        files of a simulated flight to try it with
  cd flight3; nova fuse --imu imu.csv --gnss gnss.csv --ranges ranges.csv --anchors anchors.toml \\
    --truth truth.csv --out track.csv --plot track.html")]
pub(crate) struct Fuse {
    /// The inertial sensor.
    #[arg(long, value_name = "FILE", required_unless_present = "example")]
    imu: Option<PathBuf>,
    /// GNSS positions.
    #[arg(long, value_name = "FILE", required_unless_present = "example")]
    gnss: Option<PathBuf>,
    /// Ranges to anchors.
    #[arg(long, value_name = "FILE", required_unless_present = "example")]
    ranges: Option<PathBuf>,
    /// The anchors.
    #[arg(long, value_name = "FILE", required_unless_present = "example")]
    anchors: Option<PathBuf>,
    /// How they are put together.
    #[arg(long, value_name = "loose|tight", default_value = "tight")]
    mode: Mode,
    /// GNSS antenna from the inertial sensor, body frame, metres.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    gnss_arm: Option<Triple>,
    /// UWB antenna from the inertial sensor, body frame, metres.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    uwb_arm: Option<Triple>,
    /// Standard deviation of a range, in metres, where neither the file has sigma_m nor the anchor
    /// range_sigma_m.
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    sigma: f64,
    /// Take every range as it is instead of judging it.
    #[arg(long)]
    no_judging: bool,
    /// Compare with this track.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Write the track, ten lines a second.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a page with the track from above, its height, errors, and what became of the ranges.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Write the files of a simulated flight into this folder instead.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["imu", "gnss", "ranges", "anchors"])]
    example: Option<PathBuf>,
    /// Everything random in the example follows from this number.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Mode {
    Loose,
    Tight,
}

/// Seconds between lines of the track.
const LINE_S: f64 = 0.1;
/// Standard deviation of the first GNSS position, metres.
const START_SIGMA_M: f64 = 15.0;

impl Fuse {
    pub(crate) fn run(self) -> Result<()> {
        if let Some(folder) = &self.example {
            return example::write(folder, self.seed);
        }
        let (Some(imu), Some(gnss), Some(ranges), Some(anchors)) =
            (&self.imu, &self.gnss, &self.ranges, &self.anchors)
        else {
            return Err(bad_input!(
                "--imu, --gnss, --ranges and --anchors are needed"
            ));
        };
        if !(self.sigma > 0.0 && self.sigma.is_finite()) {
            return Err(bad_input!("--sigma must be more than 0 metres"));
        }
        let site = AnchorsFile::read(anchors)?;
        let mut frame = site.frame(anchors)?;
        let input = Input::read([imu, gnss, ranges], &site, self.sigma, &mut frame)?;
        let Flown {
            track,
            counts,
            fates,
        } = self.navigate(&input.events, &site, frame)?;
        if let Some(path) = &self.out {
            write_whole(path, report::csv(&track, frame.as_ref()))?;
        }
        let truth = self.truth.as_deref().map(input::truth).transpose()?;
        let report = Report::new(&track, counts, truth.as_ref(), input.notes);
        if let Some(path) = &self.plot {
            let shown = Shown {
                track: &track,
                fates: &fates,
                site: &site,
                truth: truth.as_ref(),
                report: &report,
            };
            shown.write(path)?;
        }
        let said = if self.json {
            serde_json::to_string(&report)? + "\n"
        } else {
            report.text()
        };
        Ok(std::io::stdout().write_all(said.as_bytes())?)
    }

    fn navigate(
        &self,
        events: &Events,
        site: &AnchorsFile,
        frame: Option<LocalFrame>,
    ) -> Result<Flown> {
        let anchors: Vec<FusionAnchor> = (site.anchors.iter())
            .map(|anchor| anchor.for_fusion(self.sigma))
            .collect();
        let (lag_s, slope) = site.common.map_or((0.0, 0.0), |c| (c.lag_s, c.slope));
        let zero = nalgebra::Vector3::zeros();
        let arms = LeverArms {
            gnss_m: self.gnss_arm.map_or(zero, |Triple(arm)| arm),
            uwb_m: self.uwb_arm.map_or(zero, |Triple(arm)| arm),
        };
        let (t0, start) = (events.first_s(), events.first_fix()?);
        let mut tight = Tight::new(
            TightOptions {
                arms,
                slope,
                judge_ranges: !self.no_judging,
                ..TightOptions::default()
            },
            &anchors,
            t0,
            start,
            START_SIGMA_M,
        );
        let anywhere = Geodetic {
            lat_deg: 0.0,
            lon_deg: 0.0,
            height_m: 0.0,
        };
        let options = LooseOptions {
            arms,
            ..LooseOptions::default()
        };
        let frame = frame.unwrap_or_else(|| LocalFrame::at(anywhere));
        let mut loose = Loose::new(options, frame, t0, start, START_SIGMA_M);
        let mut rounds = Rounds::default();
        let is_tight = self.mode == Mode::Tight;
        let mut counts = Counts::default();
        let mut track: Vec<Navigation> = Vec::new();
        let mut fates = Vec::new();
        for (_, event) in &events.0 {
            match event {
                Reading::Imu(sample) if is_tight => {
                    tight.on_imu(sample);
                }
                Reading::Imu(sample) => {
                    loose.on_imu(sample);
                }
                Reading::Gnss(fix) => {
                    let nis = if is_tight {
                        tight.on_gnss(fix)
                    } else {
                        loose.on_gnss(fix)
                    };
                    counts.gnss(nis);
                }
                Reading::Range(range) if is_tight => {
                    let t_s = range.t_s - lag_s;
                    let fate = tight.on_range(&UwbRange { t_s, ..*range });
                    counts.range(fate);
                    fates.push((t_s, fate));
                }
                Reading::Range(range) => {
                    let Some(anchor) = anchors.get(range.anchor) else {
                        continue;
                    };
                    let known = AnchorRange {
                        anchor_m: anchor.position_m,
                        range_m: (range.range_m - anchor.bias_m) / (1.0 + slope),
                        sigma_m: range.sigma_m,
                    };
                    let done = rounds.add(range.t_s, known);
                    counts.range(Fate::Used(f64::NAN));
                    if let Some((t_s, position_m)) = done {
                        loose.on_uwb(t_s - lag_s, position_m);
                    }
                }
            }
            let now = if is_tight {
                tight.navigation()
            } else {
                loose.navigation()
            };
            if track.last().is_none_or(|last| now.t_s - last.t_s >= LINE_S) {
                track.push(now);
            }
        }
        counts.refused = if is_tight {
            tight.refused()
        } else {
            loose.refused()
        };
        Ok(Flown {
            track,
            counts,
            fates,
        })
    }
}

/// What navigation over the files gave.
struct Flown {
    track: Vec<Navigation>,
    counts: Counts,
    /// Of each range in the tight mode: when it was measured and what became of it.
    fates: Vec<(f64, Fate)>,
}

/// Ranges of one tenth of a second, for a position from them together.
#[derive(Default)]
struct Rounds {
    open: Vec<(f64, AnchorRange)>,
}

impl Rounds {
    /// The position of a round that this range shows to be complete, where four anchors were heard.
    fn add(&mut self, t_s: f64, range: AnchorRange) -> Option<(f64, nalgebra::Vector3<f64>)> {
        const ROUND_S: f64 = 0.09;
        let complete = (self.open.first()).is_some_and(|(first, _)| t_s - first > ROUND_S);
        let mut done = None;
        if complete {
            let ranges: Vec<AnchorRange> = self.open.iter().map(|(_, range)| *range).collect();
            let sum: f64 = self.open.iter().map(|(t, _)| t).sum();
            let middle = sum / self.open.len() as f64;
            done = locate(&ranges, &MultilaterationOptions::default())
                .ok()
                .filter(|fix| fix.found.observable())
                .map(|fix| (middle, fix.found.position_m));
            self.open.clear();
        }
        self.open.push((t_s, range));
        done
    }
}
