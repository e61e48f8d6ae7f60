//! What the end of the run has to say.

use super::counts::{Quantiles, Sent};
use crate::commands::guide::lines::Summary;
use crate::mavlink::stream::FrameCounts;
use crate::mavlink::vehicle::{Identity, VehicleCounts};
use anyhow::Result;
use serde::Serialize;
use std::io::Write;

/// The last line.
#[derive(Serialize)]
pub(super) struct End<'a> {
    pub(super) end: Ended<'a>,
}

#[derive(Serialize)]
pub(super) struct Ended<'a> {
    pub(super) autopilot: Option<Identity>,
    /// How far its clock may be off from ours.
    pub(super) clock_doubt_s: Option<f64>,
    pub(super) received: FrameCounts,
    pub(super) vehicle: VehicleCounts,
    pub(super) sent: Sent,
    /// From a range's bytes in this program to its DISTANCE_SENSOR out of it.
    pub(super) latency: Option<Quantiles>,
    /// Lines that nobody took in time.
    pub(super) lines_dropped: u64,
    pub(super) nodes: &'a [Summary],
}

pub(super) fn summarise(out: &mut impl Write, ended: &Ended<'_>) -> Result<()> {
    match ended.autopilot {
        Some(id) => writeln!(
            out,
            "autopilot  system {}, component {}, {:?}",
            id.system, id.component, id.kind
        )?,
        None => writeln!(
            out,
            "autopilot  none was heard: is it sending to this address?"
        )?,
    }
    if let Some(doubt_s) = ended.clock_doubt_s {
        writeln!(out, "its clock  known to {:.1} ms", doubt_s * 1e3)?;
    }
    let FrameCounts {
        frames,
        lost,
        repeated,
        unusable,
    } = ended.received;
    writeln!(
        out,
        "received   {frames} frames; {lost} lost, {repeated} repeated, {unusable} unusable"
    )?;
    let VehicleCounts {
        places,
        late,
        restarts,
        ..
    } = ended.vehicle;
    writeln!(
        out,
        "           {places} places; {late} too late, {restarts} restarts"
    )?;
    let sent = &ended.sent;
    writeln!(
        out,
        "sent       {} DISTANCE_SENSOR; {} ranges refused",
        sent.distance_sensor.sent, sent.ranges_refused
    )?;
    writeln!(
        out,
        "           {} LANDING_TARGET; {} withheld",
        sent.landing_target.sent, sent.landing_target_withheld
    )?;
    if let Some(Quantiles {
        p50_ms,
        p99_ms,
        max_ms,
    }) = ended.latency
    {
        writeln!(
            out,
            "latency    {p50_ms:.3} ms half, {p99_ms:.3} ms 99 %, {max_ms:.3} ms at most"
        )?;
    }
    for node in ended.nodes {
        let place = node.estimate.as_ref().map_or_else(
            || "nothing known".to_owned(),
            |e| format!("{:.3} {:.3} {:.3} m", e.tag_m[0], e.tag_m[1], e.tag_m[2]),
        );
        writeln!(
            out,
            "node {:<6} {place}; {} ranges, {} unpaired",
            node.peer.to_string(),
            node.ranges,
            node.unpaired
        )?;
    }
    Ok(())
}
