//! `nova solve`: positions of unknown nodes from ranges taken at known places.

use crate::error::bad_input;
use crate::peer::Peer;
use crate::table::{Column, ColumnNames, Row, Table, file_name};
use anyhow::Result;
use nova_solver::multilateration::{Height, Noise, RangeBias};
use nova_solver::{
    Localisation, MultilaterationOptions, Observability, RangeMeasurement, SolveError,
    multilaterate,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

/// Position of each unknown node from ranges taken at known places.
///
/// The file is CSV with the columns t_s, peer, x_m, y_m, z_m, range_m and
/// optionally sigma_m: at time t_s the place (x, y, z) was range_m away from
/// the node called peer. Gross outliers are set aside. A geometry that cannot
/// tell where the node is gives observable: false, a large covariance and,
/// where there is one, the mirror image as the alternative.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova solve flight.csv
  nova solve flight.csv --range-bias 0.24 --json
  nova solve flight.csv --estimate-bias 0.5
  grep -v ',7,' flight.csv | nova solve -
  nova solve flight.csv --height 0                    the nodes stand on the ground
  nova solve log.csv --columns peer=anchor,range_m=distance")]
pub(crate) struct Solve {
    /// The CSV file; `-` for standard input.
    #[arg(value_name = "FILE|-")]
    file: PathBuf,
    /// One JSON object a node instead of a table.
    #[arg(long)]
    json: bool,
    /// Take this known constant, in metres, off every range.
    #[arg(
        long,
        value_name = "M",
        allow_negative_numbers = true,
        default_value_t = 0.0
    )]
    range_bias: f64,
    /// Estimate a constant common to all ranges of a node, expected to be
    /// --range-bias give or take this many metres (one sigma).
    #[arg(long, value_name = "SIGMA_M", allow_negative_numbers = true)]
    estimate_bias: Option<f64>,
    /// The nodes' height in metres, where it is known.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    height: Option<f64>,
    /// Standard deviation of a range, in metres, where the file has no sigma_m.
    #[arg(
        long,
        value_name = "M",
        allow_negative_numbers = true,
        default_value_t = 0.1
    )]
    sigma: f64,
    /// Standard deviation of errors that do not average out, in metres: antenna
    /// delays, receive power, the places themselves.
    #[arg(
        long,
        value_name = "M",
        allow_negative_numbers = true,
        default_value_t = 0.05
    )]
    systematic_sigma: f64,
    /// Believe the standard deviations given; otherwise the ranges' scatter
    /// about the solution decides.
    #[arg(long)]
    trust_sigma: bool,
    /// Pass over lines that cannot be used (a field missing, not a number, a
    /// negative range) and nodes with too few ranges, instead of stopping at the
    /// first; says how many, and which.
    #[arg(long)]
    skip_bad: bool,
    /// What columns are called in the file, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...")]
    columns: Option<ColumnNames>,
}

/// The columns that a file has, or may have.
const COLUMNS: [&str; 7] = ["t_s", "peer", "x_m", "y_m", "z_m", "range_m", "sigma_m"];

/// The columns of the file.
struct Columns<'a> {
    time: Column<'a>,
    peer: Column<'a>,
    place: [Column<'a>; 3],
    range: Column<'a>,
    sigma: Option<Column<'a>>,
}

/// What is said about one node in JSON.
#[derive(Serialize)]
struct Answer<'a> {
    peer: &'a Peer,
    position_m: [f64; 3],
    covariance_m2: [[f64; 3]; 3],
    sigma_m: [f64; 3],
    range_bias_m: f64,
    range_bias_sigma_m: f64,
    residual_rms_m: f64,
    used: usize,
    rejected: usize,
    alternative: Option<Alternative>,
    observable: bool,
    verdict: &'static str,
    condition: f64,
}

#[derive(Serialize)]
struct Alternative {
    position_m: [f64; 3],
    sigma_m: [f64; 3],
    probability: f64,
}

impl Solve {
    pub(crate) fn run(self) -> Result<()> {
        let options = self.options()?;
        let mut solved = Vec::new();
        let mut unsolved = Vec::new();
        for (peer, measurements) in self.read()? {
            match multilaterate(&measurements, &options) {
                Ok(found) => solved.push((peer, found)),
                Err(error) if self.skip_bad => unsolved.push(self.explain(&peer, &error)),
                Err(error) => return Err(self.explain(&peer, &error)),
            }
        }
        match unsolved.pop() {
            Some(last) if solved.is_empty() => return Err(last),
            last => unsolved.extend(last),
        }
        for reason in &unsolved {
            eprintln!("skipped: {reason}");
        }
        let mut out = BufWriter::new(std::io::stdout().lock());
        if self.json {
            for (peer, found) in &solved {
                serde_json::to_writer(&mut out, &answer(peer, found))?;
                out.write_all(b"\n")?;
            }
        } else {
            print_table(&mut out, &solved)?;
        }
        Ok(out.flush()?)
    }

    fn options(&self) -> Result<MultilaterationOptions> {
        for (name, value) in [
            ("--range-bias", Some(self.range_bias)),
            ("--height", self.height),
        ] {
            if value.is_some_and(|v| !v.is_finite()) {
                return Err(bad_input!("{name} must be a finite number of metres"));
            }
        }
        for (name, value) in [
            ("--sigma", Some(self.sigma)),
            ("--estimate-bias", self.estimate_bias),
        ] {
            if value.is_some_and(|v| !(v.is_finite() && v > 0.0)) {
                return Err(bad_input!("{name} must be more than 0 metres"));
            }
        }
        if !(self.systematic_sigma.is_finite() && self.systematic_sigma >= 0.0) {
            return Err(bad_input!("--systematic-sigma must be 0 metres or more"));
        }
        Ok(MultilaterationOptions {
            systematic_sigma_m: self.systematic_sigma,
            bias: match self.estimate_bias {
                Some(prior_sigma_m) => RangeBias::Estimate {
                    prior_m: self.range_bias,
                    prior_sigma_m,
                },
                None => RangeBias::Known(self.range_bias),
            },
            height: self.height.map_or(Height::Unknown, Height::Known),
            noise: if self.trust_sigma {
                Noise::Given
            } else {
                Noise::Estimated
            },
            ..MultilaterationOptions::default()
        })
    }

    fn read(&self) -> Result<BTreeMap<Peer, Vec<RangeMeasurement>>> {
        let names = self.columns.clone().unwrap_or_default();
        let table = Table::open(&self.file, &names, "--columns", &COLUMNS)?;
        let columns = Columns {
            time: table.require("t_s")?,
            peer: table.require("peer")?,
            place: [
                table.require("x_m")?,
                table.require("y_m")?,
                table.require("z_m")?,
            ],
            range: table.require("range_m")?,
            sigma: table.find("sigma_m")?,
        };
        let mut peers: BTreeMap<Peer, Vec<RangeMeasurement>> = BTreeMap::new();
        let mut skipped: u64 = 0;
        let lines = table.for_each(|row| {
            match self.measurement(row, &columns) {
                Ok((peer, measurement)) => peers.entry(peer).or_default().push(measurement),
                Err(_) if self.skip_bad => skipped += 1,
                Err(error) => return Err(error),
            }
            Ok(())
        })?;
        if peers.is_empty() {
            return Err(bad_input!(
                "{}: none of {lines} lines can be used",
                file_name(&self.file)
            ));
        }
        if skipped > 0 {
            eprintln!("{skipped} of {lines} lines skipped");
        }
        Ok(peers)
    }

    fn measurement(
        &self,
        row: &Row<'_>,
        columns: &Columns<'_>,
    ) -> Result<(Peer, RangeMeasurement)> {
        row.check_length()?;
        let name = row.text(columns.peer);
        if name.is_empty() {
            return Err(row.complain(columns.peer, "is empty"));
        }
        let range_m = row.number(columns.range)?;
        if range_m < 0.0 {
            return Err(row.complain(columns.range, &format!("is negative ({range_m})")));
        }
        let sigma_m = match columns.sigma {
            None => self.sigma,
            Some(column) => match row.number(column)? {
                sigma_m if sigma_m > 0.0 => sigma_m,
                other => {
                    return Err(row.complain(column, &format!("is not positive ({other})")));
                }
            },
        };
        let [x, y, z] = columns.place;
        let measurement = RangeMeasurement {
            t_s: row.number(columns.time)?,
            position_m: [row.number(x)?, row.number(y)?, row.number(z)?].into(),
            range_m,
            sigma_m,
        };
        measurement
            .validate()
            .map_err(|fault| row.complain(columns.range, &format!("cannot be used: {fault}")))?;
        Ok((name.into(), measurement))
    }

    fn explain(&self, peer: &Peer, error: &SolveError) -> anyhow::Error {
        let file = file_name(&self.file);
        match error {
            SolveError::TooFewMeasurements { got, unknowns } => bad_input!(
                "{file}: node {peer} has {got} range{}, fewer than the {unknowns} unknowns; \
                 {} or more from places apart are needed",
                if *got == 1 { "" } else { "s" },
                unknowns + 1
            ),
            other => bad_input!("{file}: node {peer}: {other}"),
        }
    }
}

fn answer<'a>(peer: &'a Peer, found: &Localisation) -> Answer<'a> {
    Answer {
        peer,
        position_m: found.position_m.into(),
        // Symmetric: columns are rows.
        covariance_m2: found.covariance_m2.into(),
        sigma_m: found.sigma_m.into(),
        range_bias_m: found.range_bias_m,
        range_bias_sigma_m: found.range_bias_sigma_m,
        residual_rms_m: found.residual_rms_m,
        used: found.used,
        rejected: found.rejected,
        alternative: found.alternative.as_ref().map(|other| Alternative {
            position_m: other.position_m.into(),
            sigma_m: other.covariance_m2.diagonal().map(f64::sqrt).into(),
            probability: other.probability,
        }),
        observable: found.observable(),
        verdict: found.observability.name(),
        condition: found.condition,
    }
}

fn print_table(out: &mut impl Write, solved: &[(Peer, Localisation)]) -> Result<()> {
    writeln!(
        out,
        "{:>8}  {:^27}  {:^21}  {:>7}  {:>7}  {:>5}  {:>8}",
        "node", "position (m)", "sigma (m)", "bias", "rms", "used", "rejected"
    )?;
    for (peer, found) in solved {
        let (p, s) = (found.position_m, found.sigma_m);
        writeln!(
            out,
            "{:>8}  {:>8.3} {:>8.3} {:>8.3}   {:>6.3} {:>6.3} {:>6.3}  {:>7.3}  {:>7.3}  {:>5}  {:>8}",
            peer.to_string(),
            p.x,
            p.y,
            p.z,
            s.x,
            s.y,
            s.z,
            found.range_bias_m,
            found.residual_rms_m,
            found.used,
            found.rejected
        )?;
        if let Some(warning) = warning(found) {
            writeln!(out, "{:>8}  ! {warning}", "")?;
        }
    }
    Ok(())
}

/// What a reader must know before using the position.
fn warning(found: &Localisation) -> Option<String> {
    match &found.observability {
        Observability::Unique => None,
        Observability::Mirror => found.alternative.as_ref().map(|other| {
            format!(
                "may as well be at ({:.3}, {:.3}, {:.3}), probability {:.1} %: the ranges cannot tell for certain",
                other.position_m.x,
                other.position_m.y,
                other.position_m.z,
                other.probability * 100.0
            )
        }),
        Observability::Ring { radius_m, .. } => Some(format!(
            "not observable: anywhere on a ring of radius {radius_m:.2} m, since the path is too straight for its length"
        )),
        Observability::Sphere { radius_m, .. } => Some(format!(
            "not observable: anywhere {radius_m:.2} m away, since the ranges come from places too close together"
        )),
        Observability::Weak { sigma_m, .. } => Some(format!(
            "weakly observable: the sigma along one direction is {sigma_m:.2} m"
        )),
    }
}
