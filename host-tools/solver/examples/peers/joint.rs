//! The paper's joint optimisation after each leg of a flight but the first: `guess x y z`, `seconds
//! s`, `leg k start(3) goal(3)`, `sample k t x y z range`.

use std::error::Error;
use std::time::Instant;

use nalgebra::Vector3;
use nova_solver::navigation::{InsSample, RangeSample};
use nova_solver::nova::{JointOptimiser, Parameters, Segment, SegmentRecorder};

use crate::{Outcome, Problem};

pub(crate) fn run(problem: &Problem) -> Result<Vec<Outcome>, Box<dyn Error>> {
    let guess_m = problem.place("guess")?;
    let [seconds] = problem.one("seconds")?;
    let parameters = Parameters::default();
    let segments = segments(problem, &parameters)?;
    let fly = || {
        let mut joint = JointOptimiser::new(&parameters, 0);
        let mut tag_m = guess_m;
        let mut times = Vec::new();
        for n in 2..=segments.len() {
            let begin = Instant::now();
            tag_m = joint.optimise(&segments[..n], tag_m).tag_m;
            times.push(begin.elapsed());
        }
        Ok((times, tag_m.as_slice().to_vec()))
    };
    Ok(vec![Outcome::of("nova", seconds, fly)?])
}

fn segments(problem: &Problem, parameters: &Parameters) -> Result<Vec<Segment>, Box<dyn Error>> {
    let samples: Vec<[f64; 6]> = problem.all("sample")?;
    let mut segments = Vec::new();
    for [leg, ax, ay, az, bx, by, bz] in problem.all("leg")? {
        let mut on_leg =
            samples
                .iter()
                .filter(|sample| sample[0] == leg)
                .map(|&[_, t_s, x, y, z, range_m]| {
                    let position_m = Vector3::new(x, y, z);
                    (InsSample { t_s, position_m }, RangeSample { t_s, range_m })
                });
        let (ins, range) = on_leg.next().ok_or("a leg without samples")?;
        let (start_m, goal_m) = (Vector3::new(ax, ay, az), Vector3::new(bx, by, bz));
        let mut recorder = SegmentRecorder::new(start_m, goal_m, ins, parameters);
        recorder.push_range(range);
        for (ins, range) in on_leg {
            recorder.push_ins(ins);
            recorder.push_range(range);
        }
        segments.push(recorder.finish());
    }
    Ok(segments)
}
