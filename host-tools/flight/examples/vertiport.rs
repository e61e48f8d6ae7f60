//! The paper's Tables 3 to 8 beside ours: `cargo run --release -p nova-flight --example vertiport -- 100`
//! with the number of seeds. Prints Markdown.

use nova_flight::vertiport::run_experiment;

fn main() {
    let seeds = std::env::args()
        .nth(1)
        .and_then(|n| n.parse().ok())
        .unwrap_or(20);
    let report = run_experiment(seeds, 2025);
    let mut table = 0;
    let list = |values: &[f64]| -> String {
        let texts: Vec<String> = values.iter().map(|v| format!("{v:.2}")).collect();
        texts.join(" / ")
    };
    for row in &report.rows {
        if row.table != table {
            table = row.table;
            println!(
                "\nTable {table}: {}\n\n| | paper | here |\n|---|---|---|",
                row.columns.join(" / ")
            );
        }
        println!(
            "| {} | {} | {} |",
            row.name,
            list(&row.theirs),
            list(&row.here)
        );
    }
    println!(
        "\n{seeds} seeds, {} left out; NIS of ranges {:.3} over {}",
        report.failed, report.nis.0, report.nis.1
    );
}
