//! Fits the NLOS rule to a recording and prints how good it is, as Markdown.
//!
//! `NOVA_DATA=folder cargo run -p nova-ranging --example nlos_fit`
#![allow(clippy::unwrap_used)]

#[path = "../tests/nlos/mod.rs"]
mod nlos;

use nlos::{FITTED_TO, Reception, fit, found_at, found_by_scores, left_out, share};

fn main() -> Result<(), String> {
    let all = nlos::recording().map_err(|path| format!("no recording at {}", path.display()))?;
    let (train, test): (Vec<Reception>, Vec<Reception>) =
        all.iter().partition(|r| FITTED_TO.contains(&r.place));

    println!(
        "Fitted to places {FITTED_TO:?}, {} receptions:",
        train.len()
    );
    let [bias, spread, missing] = fit(&train);
    println!("BIAS {bias:.3}, SPREAD {spread:.3}, MISSING {missing:.3}\n");

    let six_db = |r: &Reception| r.spread_db() > 6.0;
    for (name, of) in [("all", &all), ("fitted to", &train), ("held out", &test)] {
        let likely = |r: &Reception| r.probability() >= 0.5;
        println!(
            "{name}: {} receptions; 6 dB: {:.3} found at {:.3} false positives; rule as built: {:.3} at {:.3}",
            of.len(),
            share(of, true, six_db),
            share(of, false, six_db),
            share(of, true, likely),
            share(of, false, likely)
        );
    }
    println!("\nShare of NLOS found, by the share of free receptions taken for it:\n");
    println!(
        "| false positives | power difference, all | rule, fitted to | rule, held out | rule, all | each place left out | each anchor left out |"
    );
    println!("|---|---|---|---|---|---|---|");
    let place = left_out(&all, |r| r.place);
    let anchor = left_out(&all, |r| r.anchor);
    for rate in [0.01, 0.02, 0.05, 0.10, 0.15, 0.20, 0.30] {
        let rule = |of: &[Reception]| found_at(of, rate, Reception::probability);
        println!(
            "| {rate:.2} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} |",
            found_at(&all, rate, Reception::spread_db),
            rule(&train),
            rule(&test),
            rule(&all),
            found_by_scores(&place, rate),
            found_by_scores(&anchor, rate),
        );
    }
    println!("\nHow far the probability can be believed (held out, both labels weighed alike):\n");
    println!("| said | receptions | were NLOS | mean error of those, m |");
    println!("|---|---|---|---|");
    let free = share_weight(&test, false);
    let blocked = share_weight(&test, true);
    for (from, to) in [
        (0.0, 0.1),
        (0.1, 0.3),
        (0.3, 0.5),
        (0.5, 0.7),
        (0.7, 0.9),
        (0.9, 1.01),
    ] {
        let of: Vec<_> = test
            .iter()
            .filter(|r| (from..to).contains(&r.probability()))
            .collect();
        let nlos: Vec<_> = of.iter().filter(|r| r.nlos).collect();
        let (yes, no) = (
            nlos.len() as f64 * blocked,
            (of.len() - nlos.len()) as f64 * free,
        );
        let error = match nlos.len() {
            0 => "-".to_owned(),
            n => format!(
                "{:+.2}",
                nlos.iter().map(|r| r.error_m).sum::<f64>() / n as f64
            ),
        };
        println!(
            "| {from:.1}-{:.1} | {} | {:.2} | {error} |",
            f64::min(to, 1.0),
            of.len(),
            yes / (yes + no)
        );
    }
    Ok(())
}

fn share_weight(of: &[Reception], nlos: bool) -> f64 {
    1.0 / of.iter().filter(|r| r.nlos == nlos).count() as f64
}
