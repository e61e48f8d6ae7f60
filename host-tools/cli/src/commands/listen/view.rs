//! The table on the screen.

use super::model::{Board, Model, Peer, State, counted};
use crate::node_address::hex;
use nova_wire::{RangeFlags, ResetCause, Role, SettingsSource, Treatment};
use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Layout};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Cell, Paragraph, Row, Table};

/// What the screen shows beside what the boards said.
#[derive(Default)]
pub(super) struct Screen {
    /// Rows that were scrolled past.
    pub(super) scrolled: usize,
    /// The recording: where, and how many bytes so far.
    pub(super) recording: Option<(String, u64)>,
}

/// A range this old is no news.
const STALE_S: f64 = 1.0;

const COLUMNS: usize = 11;
const HEADINGS: [&str; COLUMNS] = [
    "node", "peer", "raw m ", "filtered", "sigma", "scatter", "rate Hz", "rx dBm", "1st dB",
    "NLOS", "age s",
];
const WIDTHS: [Constraint; COLUMNS] = [
    Constraint::Length(6),
    Constraint::Length(6),
    Constraint::Length(9),
    Constraint::Length(8),
    Constraint::Length(6),
    Constraint::Length(7),
    Constraint::Length(7),
    Constraint::Length(6),
    Constraint::Length(6),
    Constraint::Length(4),
    Constraint::Length(5),
];

/// Draws everything.
pub(super) fn draw(frame: &mut Frame<'_>, model: &Model, screen: &mut Screen) {
    let notes: Vec<Line<'_>> = (model.boards.iter())
        .flat_map(board_lines)
        .chain(screen.recording.as_ref().map(recording_line))
        .collect();
    let [title, table, footer] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(4),
        Constraint::Max(u16::try_from(notes.len() + 1).unwrap_or(u16::MAX)),
    ])
    .areas(frame.area());

    let help = " arrows scroll, q quits ";
    frame.render_widget(Paragraph::new(title_line(model)), title);
    frame.render_widget(
        Paragraph::new(help.dim()).alignment(Alignment::Right),
        title,
    );

    let rows: Vec<Row<'_>> = (model.boards.iter())
        .flat_map(|board| {
            (board.peers.iter()).map(|(address, peer)| peer_row(board, *address, peer))
        })
        .collect();
    // The heading takes a row; the last page stays full.
    let shown = usize::from(table.height.saturating_sub(1));
    screen.scrolled = screen.scrolled.min(rows.len().saturating_sub(shown));
    let heading = Row::new(HEADINGS.map(|heading| Cell::from(right(heading))))
        .style(Style::new().add_modifier(Modifier::BOLD));
    let visible: Vec<Row<'_>> = rows.into_iter().skip(screen.scrolled).collect();
    if visible.is_empty() {
        let areas = Layout::vertical([Constraint::Length(1), Constraint::Min(1)]).split(table);
        let nothing = Paragraph::new("no range yet").alignment(Alignment::Center);
        if let Some(below) = areas.get(1) {
            frame.render_widget(nothing, *below);
        }
    }
    frame.render_widget(Table::new(visible, WIDTHS).header(heading), table);
    frame.render_widget(
        Paragraph::new(notes).block(Block::new().borders(Borders::TOP)),
        footer,
    );
}

fn title_line(model: &Model) -> Line<'static> {
    let count = model.ranges();
    Line::from(vec![
        Span::from("nova listen").bold(),
        Span::from(format!(
            "  {count} range{}",
            if count == 1 { "" } else { "s" }
        )),
    ])
}

fn peer_row(board: &Board, address: u16, peer: &Peer) -> Row<'static> {
    let range = &peer.last;
    let filtered = range.filtered.as_ref();
    let quality = range.quality.as_ref();
    let rx_power_dbm = quality.map(|q| f64::from(q.rx_power_dbm));
    let first_path_db = quality.map(|q| f64::from(q.first_path_power_dbm - q.rx_power_dbm));
    let nlos = quality.and_then(|q| q.nlos_percent);
    let age_s = peer.age_s(board.now_s);
    let cells = [
        board.address.map_or_else(|| "?".to_owned(), hex),
        hex(address),
        format!("{:.3}{}", range.raw_m, mark(range.treatment)),
        number(filtered.map(|f| f.range_m.into()), 3),
        number(filtered.map(|f| f64::from(f.variance_m2).sqrt()), 3),
        number(peer.scatter_m(), 3),
        number(peer.rate_hz(board.now_s), 1),
        number(rx_power_dbm, 1),
        number(first_path_db, 1),
        nlos.map_or_else(|| "-".to_owned(), |percent| format!("{percent}%")),
        format!("{age_s:.1}"),
    ];
    let style = if age_s > STALE_S {
        Style::new().add_modifier(Modifier::DIM)
    } else if range.flags.contains(RangeFlags::NLOS) {
        Style::new().fg(Color::Yellow)
    } else {
        Style::new()
    };
    Row::new(cells.map(|text| Cell::from(right(text)))).style(style)
}

/// What the board's filter did with the raw range, beside it.
fn mark(treatment: Treatment) -> char {
    match treatment {
        Treatment::NotFiltered | Treatment::Accepted => ' ',
        Treatment::DownWeighted => '~',
        Treatment::Started | Treatment::Reacquired => '*',
        Treatment::RejectedOutlier | Treatment::RejectedNlos | Treatment::RejectedInvalid => 'x',
    }
}

/// What is to be said about a board: who it is, what failed, how its line is.
fn board_lines(board: &Board) -> Vec<Line<'static>> {
    let mut who = match board.address {
        Some(address) => format!("{} is {}", board.name, hex(address)),
        None => board.name.clone(),
    };
    if let Some(boot) = &board.boot {
        let [major, minor, patch] = boot.firmware;
        let role = match boot.role {
            Role::Tag => "tag",
            Role::Anchor => "anchor",
        };
        who += &format!(", {role}, firmware {major}.{minor}.{patch}");
        if let Some(cause) = unasked(boot.reset_cause) {
            who += &format!(", started by {cause}");
        }
        if let Some(why) = defaults(boot.settings) {
            who += &format!(", on default settings: {why}");
        }
    }
    who += &format!(", up {:.0} s", board.now_s);
    let mut lines = vec![match &board.state {
        State::Open => Line::from(who),
        State::Ended => Line::from(format!("{who}: ended")),
        State::Lost(why) => Line::from(format!("{who}: lost, trying again: {why}")).red(),
    }];
    let mut counts: Vec<String> = Vec::new();
    if let Some(loss) = board.loss {
        counts.push(format!("{:.1} % lost", 100.0 * loss));
    }
    if let Some(counters) = &board.counters {
        let all = counted(counters).into_iter();
        counts.extend(all.map(|(what, count)| format!("{count} {what}")));
    }
    let wire = &board.wire;
    counts.push(format!(
        "line: {} records, {} lost, {} corrupt, {} unknown",
        wire.records, wire.lost, wire.corrupt, wire.unknown
    ));
    lines.push(Line::from(format!("  {}", counts.join(", "))));
    lines
}

/// Starts that nobody asked for.
fn unasked(cause: ResetCause) -> Option<&'static str> {
    match cause {
        ResetCause::PowerOn | ResetCause::Pin => None,
        ResetCause::Watchdog => Some("its watchdog"),
        ResetCause::Software => Some("itself"),
        ResetCause::Lockup => Some("a lock-up"),
        ResetCause::BrownOut => Some("a supply that broke down"),
    }
}

/// Why a board that has stored settings does not use them.
fn defaults(settings: SettingsSource) -> Option<&'static str> {
    match settings {
        SettingsSource::Defaults | SettingsSource::Stored => None,
        SettingsSource::Damaged => Some("the stored ones are damaged"),
        SettingsSource::OtherVersion => Some("the stored ones are of another version"),
        SettingsSource::FlashFailed => Some("its flash fails"),
    }
}

fn recording_line((file, bytes): &(String, u64)) -> Line<'static> {
    Line::from(format!("recording: {bytes} bytes in {file}")).green()
}

fn right(text: impl Into<String>) -> ratatui::text::Text<'static> {
    ratatui::text::Text::from(text.into()).alignment(Alignment::Right)
}

/// A number that may be missing, or not be one.
fn number(value: Option<f64>, digits: usize) -> String {
    match value {
        Some(value) if value.is_finite() => {
            let text = format!("{value:.digits$}");
            // What rounds to nothing has no sign.
            match text.strip_prefix('-') {
                Some(size) if size.bytes().all(|b| b"0.".contains(&b)) => size.to_owned(),
                _ => text,
            }
        }
        _ => "-".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nova_wire::{Boot, Counters, Event, Filtered, Quality, Range, Record, Status};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn drawn(model: &Model, screen: &mut Screen, size: (u16, u16)) -> String {
        let mut terminal = Terminal::new(TestBackend::new(size.0, size.1)).unwrap();
        terminal.draw(|frame| draw(frame, model, screen)).unwrap();
        let buffer = terminal.backend().buffer();
        let lines: Vec<String> = (0..size.1)
            .map(|y| {
                (0..size.0)
                    .map(|x| buffer[(x, y)].symbol())
                    .collect::<String>()
            })
            .map(|line| line.trim_end().to_owned())
            .collect();
        lines.join("\n")
    }

    fn range(k: u16, peer: u16) -> Record {
        Record::Range(Range {
            t_us: u64::from(k) * 20_000,
            peer,
            raw_m: 12.5 + if k.is_multiple_of(2) { 0.02 } else { -0.02 },
            treatment: if peer == 1 {
                Treatment::DownWeighted
            } else {
                Treatment::NotFiltered
            },
            filtered: (peer == 1).then_some(Filtered {
                range_m: 12.503,
                rate_m_per_s: 0.1,
                variance_m2: 1e-4,
            }),
            quality: (peer == 1).then_some(Quality {
                rx_power_dbm: -81.5,
                first_path_power_dbm: -83.25,
                nlos_percent: Some(37),
                ..Quality::default()
            }),
            ..Range::default()
        })
    }

    fn model(peers: u16) -> Model {
        let mut model = Model::new(["/dev/ttyACM0".to_owned()]);
        let boot = Record::Boot(Boot {
            address: 0x0A1B,
            pan: 0xDECA,
            role: Role::Anchor,
            firmware: [0, 1, 0],
            reset_cause: ResetCause::Watchdog,
            settings: SettingsSource::Stored,
        });
        let status = |t_us, ranges, no_response| {
            Record::Status(Status {
                t_us,
                address: 0x0A1B,
                counters: Counters {
                    ranges,
                    no_response,
                    ..Counters::default()
                },
            })
        };
        let mut records = vec![boot, status(1_000_000, 50, 1)];
        for peer in 1..=peers {
            records.extend((0..150).map(|k| range(k, peer)));
        }
        records.push(status(3_000_000, 148, 3));
        model.boards[0].wire.records = records.len() as u64;
        for record in records {
            let event = Event::Record {
                sequence: 0,
                lost: 0,
                record,
            };
            model.boards[0].take(&event);
        }
        model
    }

    #[test]
    fn the_table_shows_each_peer_and_what_failed() {
        let mut screen = Screen {
            recording: Some(("anchor.bin".into(), 4711)),
            ..Screen::default()
        };
        let shown = drawn(&model(2), &mut screen, (80, 10));
        println!("{shown}");
        assert_eq!(
            shown,
            "\
nova listen  300 ranges                                  arrows scroll, q quits
  node   peer    raw m  filtered  sigma scatter rate Hz rx dBm 1st dB NLOS age s
0x0A1B 0x0001   12.480~   12.503  0.010   0.042    49.5  -81.5   -1.8  37%   0.0
0x0A1B 0x0002   12.480         -      -   0.042    49.5      -      -    -   0.0


────────────────────────────────────────────────────────────────────────────────
/dev/ttyACM0 is 0x0A1B, anchor, firmware 0.1.0, started by its watchdog, up 3 s
  2.0 % lost, 3 no response, line: 303 records, 0 lost, 0 corrupt, 0 unknown
recording: 4711 bytes in anchor.bin"
        );
    }

    #[test]
    fn a_long_table_scrolls_and_stops_at_its_end() {
        let model = model(30);
        let mut screen = Screen::default();
        let first = drawn(&model, &mut screen, (80, 12));
        assert!(first.contains("0x0A1B 0x0001") && !first.contains("0x001E"));
        screen.scrolled = 1_000;
        let last = drawn(&model, &mut screen, (80, 12));
        assert!(last.contains("0x0A1B 0x001E") && !last.contains("0x0001"));
        assert_eq!(screen.scrolled, 30 - 7);
    }

    #[test]
    fn a_source_that_is_lost_or_silent_says_so() {
        let mut model = Model::new(["tcp://10.0.0.1:7000".to_owned()]);
        model.boards[0].state = State::Lost("connection reset".into());
        let shown = drawn(&model, &mut Screen::default(), (80, 10));
        assert!(shown.contains("no range yet"), "{shown}");
        assert!(
            shown.contains("lost, trying again: connection reset"),
            "{shown}"
        );
    }

    #[test]
    fn no_window_is_too_small() {
        let model = model(3);
        for size in [(1, 1), (5, 3), (20, 4), (80, 1), (300, 100)] {
            drawn(&model, &mut Screen::default(), size);
        }
    }
}
