//! The paper's planner on its own: where to fly next, and how that depends on lambda.
//!
//! `cargo run -p nova-solver --example planner`

use nalgebra::Vector3;
use nova_solver::nova::{LambdaWeighs, Parameters, Planner};

fn main() {
    let tag_m = Vector3::new(20.0, 0.0, 0.0);
    // What an exploratory flight leaves behind: 1 m down, 5 m across.
    let explored_m = [
        Vector3::new(0.0, 0.0, 30.0),
        Vector3::new(0.0, 0.0, 29.0),
        Vector3::new(0.0, 5.0, 29.0),
    ];
    for lambda in [0.3, 0.7, 0.95] {
        let planner = Planner {
            candidates: Parameters::default().candidates,
            lambda,
            lambda_weighs: LambdaWeighs::Travel,
        };
        println!("lambda {lambda}");
        let mut history_m = explored_m.to_vec();
        let mut here_m = explored_m[2];
        let mut flown_m = 0.0;
        while (tag_m - here_m).xy().norm() > 1.0 && history_m.len() < 15 {
            let next = planner.next_waypoint(&history_m, here_m, tag_m);
            flown_m += (next.position_m - here_m).norm();
            here_m = next.position_m;
            history_m.push(here_m);
            println!(
                "  to {:6.2} {:6.2}  travel {:.2}  HDOP {:6.2}  left {:5.2} m",
                here_m.x,
                here_m.y,
                next.travel,
                next.hdop.unwrap_or(f64::INFINITY),
                (tag_m - here_m).xy().norm(),
            );
        }
        println!("  flown {flown_m:.1} m");
    }
}
