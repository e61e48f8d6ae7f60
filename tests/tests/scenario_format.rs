//! What a scenario file says is what is checked.
#![allow(clippy::unwrap_used)]

use nova_tests::Scenario;

const PAIR: &str = r#"
about = "A pair."
seed = 1
duration_s = 0.5
[[board]]
name = "anchor"
address = 10
role = "anchor"
position_m = [0.0, 0.0, 0.0]
peers = [1]
[[board]]
name = "tag"
address = 1
role = "tag"
position_m = [3.0, 0.0, 0.0]
[[expect]]
board = "anchor"
to = "tag"
"#;

fn outcome(expectation: &str) -> Result<(), String> {
    Scenario::parse(&format!("{PAIR}{expectation}"))
        .unwrap()
        .run()
}

#[test]
fn an_expectation_that_is_not_met_is_named() {
    outcome("ranges = [40, 60]\nworst_error_below_m = 0.01").unwrap();
    for (expectation, mention) in [
        ("ranges = [0, 10]", "ranges, not 0 to 10"),
        (
            "ranges = [40, 60]\nmean_error_below_m = 0.01\noffset_m = 0.455",
            "mean error -0.45",
        ),
        (
            "ranges = [40, 60]\nworst_error_below_m = 0.01\noffset_m = 0.455",
            "worst error 0.45",
        ),
        (
            "ranges = [40, 60]\ncounters = { no_response = [5, 9] }",
            "no_response is 0, not 5 to 9",
        ),
        ("ranges = [40, 60]\nflags = 1", "flags 0b10 instead of 0b1"),
        ("ranges = [40, 60]\nasleep_at_least = 0.1", "slept 0.00 %"),
        ("ranges = [40, 60]\ncurrent_below_ua = 1000.0", " uA"),
        (
            "ranges = [40, 60]\ncounters = { luck = [0, 0] }",
            "no counter called luck",
        ),
    ] {
        let unmet = outcome(expectation).unwrap_err();
        assert!(unmet.contains(mention), "no '{mention}' in: {unmet}");
    }
}

#[test]
fn a_word_that_no_scenario_knows_is_an_error_with_its_line() {
    let error = Scenario::parse("about = \"x\"\nsead = 1\n").unwrap_err();
    assert!(
        error.contains("line 2") && error.contains("sead"),
        "{error}"
    );
}

#[test]
fn a_scenario_that_tests_nothing_is_refused() {
    let refused = |from: &str, to: &str| {
        let toml = format!("{PAIR}ranges = [0, 99]\n").replace(from, to);
        Scenario::parse(&toml).unwrap_err()
    };
    for (from, to, mention) in [
        ("duration_s = 0.5", "duration_s = -1.0", "not a time"),
        (
            "seed = 1",
            "seed = 1\nloss_probability = 1.5",
            "between 0 and 1",
        ),
        (
            "name = \"tag\"",
            "name = \"anchor\"",
            "two boards are called anchor",
        ),
        (
            "role = \"tag\"",
            "role = \"tag\"\nrx_noise_ps = -1.0",
            "rx_noise_ps",
        ),
        (
            "[[expect]]",
            "[[fault]]\nfrom = \"tag\"\nframes = [30, 20]\naction = \"drop\"\n[[expect]]",
            "no frames",
        ),
    ] {
        let error = refused(from, to);
        assert!(error.contains(mention), "no '{mention}' in: {error}");
    }
}

#[test]
fn a_board_that_is_not_there_is_named() {
    let unmet = Scenario::parse(&PAIR.replace("to = \"tag\"", "to = \"tog\"\nranges = [0, 99]"))
        .unwrap()
        .run()
        .unwrap_err();
    assert!(unmet.contains("no board called tog"), "{unmet}");
}
