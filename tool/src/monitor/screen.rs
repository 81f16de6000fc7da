//! Draws the monitor's view, on a terminal of any size or as text.

use ecmsk::link::keys::Scheme;
use ecmsk::sk::dump::SlotRole;
use ecmsk::sk::{FIFO_ENTRIES, MasterState};
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;
use ratatui::layout::{Alignment, Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Cell, Paragraph, Row as TableRow, Table};
use ratatui::{Frame, Terminal};

use super::rows::{Highlight, Row, rows};
use super::watched::View;
use crate::visible::visible;

/// The number of lines above the rows: name, board, FIFO, SDO, counters, an empty line, and the column names.
const HEAD: u16 = 7;
/// The width of the table as text, with all columns.
const WIDTH: u16 = 106;
/// The width of the FIFO level bar in characters.
const BAR: u16 = 32;

/// A column of the table: its name, its width in characters, whether its texts are right-aligned, and the text of a row.
struct Column {
    name: &'static str,
    width: u16,
    right: bool,
    text: fn(&Row) -> &str,
    /// The smallest terminal width at which the column is shown.
    from_width: u16,
}

const COLUMNS: [Column; 10] = [
    Column { name: "slave", width: 5, right: true, text: |row| &row.slave, from_width: 0 },
    Column { name: "kind", width: 6, right: false, text: |row| &row.kind, from_width: 60 },
    Column { name: "state", width: 22, right: false, text: |row| &row.state, from_width: 0 },
    Column { name: "status", width: 6, right: false, text: |row| &row.statusword, from_width: 100 },
    Column { name: "position", width: 11, right: true, text: |row| &row.position, from_width: 0 },
    Column { name: "counts/s", width: 10, right: true, text: |row| &row.velocity, from_width: 80 },
    Column { name: "torque", width: 8, right: true, text: |row| &row.torque, from_width: 70 },
    Column { name: "error", width: 6, right: false, text: |row| &row.error, from_width: 0 },
    Column { name: "in/out", width: 10, right: false, text: |row| &row.bits, from_width: 76 },
    Column { name: "answers", width: 13, right: false, text: |row| &row.answers, from_width: 106 },
];

/// Draws a view, with its rows from the row `scroll` on. Returns the largest useful value of `scroll`.
pub fn draw(frame: &mut Frame, view: &View, scroll: usize) -> usize {
    let foot = 1;
    let [head, table, keys] =
        Layout::vertical([Constraint::Length(HEAD - 1), Constraint::Min(1), Constraint::Length(foot)])
            .areas(frame.area());
    frame.render_widget(Paragraph::new(self::head(view)), head);
    let rows = rows(view);
    let room = usize::from(table.height.saturating_sub(1));
    let last = rows.len().saturating_sub(room);
    let from = scroll.min(last);
    draw_table(frame, table, &rows[from..]);
    let shown = match rows.len() {
        0 => "no slave says anything".to_owned(),
        all if last == 0 => format!("{all} rows"),
        all => format!("rows {} to {} of {all}", from + 1, (from + room).min(all)),
    };
    let text = format!("{shown}   q ends, arrows scroll");
    frame.render_widget(Paragraph::new(text).style(Style::new().add_modifier(Modifier::DIM)), keys);
    last
}

fn draw_table(frame: &mut Frame, area: Rect, rows: &[Row]) {
    let columns: Vec<&Column> = COLUMNS.iter().filter(|column| area.width >= column.from_width).collect();
    let cell = |column: &Column, text: String| {
        let side = if column.right { Alignment::Right } else { Alignment::Left };
        Cell::new(Line::from(text).alignment(side))
    };
    let header = columns.iter().map(|column| cell(column, column.name.to_owned()));
    let header = TableRow::new(header).style(Style::new().add_modifier(Modifier::BOLD));
    let body = rows.iter().map(|row| {
        let style = match row.highlight {
            Highlight::Plain => Style::new(),
            Highlight::On => Style::new().fg(Color::Green),
            Highlight::Alarm => Style::new().fg(Color::Red).add_modifier(Modifier::BOLD),
        };
        TableRow::new(columns.iter().map(|column| cell(column, (column.text)(row).to_owned()))).style(style)
    });
    let widths = columns.iter().map(|column| Constraint::Length(column.width));
    frame.render_widget(Table::new(body, widths).header(header), area);
}

/// The lines above the table: name, state, FIFO, SDO and counters of the board.
fn head(view: &View) -> Vec<Line<'static>> {
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let mut name = visible(&view.name);
    let scheme = view.name.split_once(':').and_then(|(scheme, _)| Scheme::from_name(scheme));
    if scheme.is_some_and(Scheme::is_model) {
        name += "   a board of this process alone; to see another program's serve it: ecmsk serve tcp";
    }
    let name = Line::styled(name, bold);
    let Some(board) = &view.board else {
        let trouble = view.trouble.as_deref().map_or_else(|| "no report yet".to_owned(), visible);
        return vec![name, Line::styled(trouble, Style::new().fg(Color::Red))];
    };
    let state = if board.state.is_failed() { bold.fg(Color::Red) } else { bold };
    let seconds = view.at_ns as f64 / 1e9;
    let rate = view.rate.map_or_else(String::new, |rate| format!(", {rate:.0} a second"));
    let counts = view.counts;
    let first = Line::from(vec![
        Span::raw("state "),
        Span::styled(board.state.to_string(), state),
        Span::raw(format!(
            "   time {seconds:.3} s   reports {}{rate}, lost {}, wrong CRC {}",
            counts.reports, counts.lost, counts.bad_crc
        )),
    ]);
    let in_op = board.state.state() == Some(MasterState::Op);
    let waiting = FIFO_ENTRIES.saturating_sub(board.fifo_free);
    let fifo = if in_op {
        let full = (u32::from(waiting) * u32::from(BAR)).div_ceil(u32::from(FIFO_ENTRIES)) as usize;
        let bar = format!("{}{}", "#".repeat(full), ".".repeat(usize::from(BAR) - full));
        format!("FIFO  [{bar}] {waiting} of {FIFO_ENTRIES} wait   full count {}", board.full_count)
    } else {
        "FIFO  (in OP only)".to_owned()
    };
    let fifo = format!("{fifo}   CRC errors {}", board.error);
    let counters = view.counters.map_or_else(String::new, |counters| {
        let mut line = format!(
            "board frames {}, executed {}, lost to a full FIFO {}, rejected {}, cycles without an entry {}",
            counters.frames,
            counters.executed,
            counters.full,
            counters.rejected_total(),
            counters.idle_cycles
        );
        // These counters are above 0 only for a board that uses a chip or a network card, so they are shown only then.
        for (what, count) in [
            ("sets of outputs lost", counters.outputs_lost),
            ("answers lost", counters.answers_lost),
            ("cycles left out", counters.cycles_left_out),
            ("cycles with a broken ring", counters.ring_broken),
            ("cycles with a wrong working counter", counters.inputs_held),
            ("slaves with stale inputs", counters.inputs_stale),
        ] {
            if count > 0 {
                line += &format!(", {what} {count}");
            }
        }
        line
    });
    let last = match &view.trouble {
        Some(trouble) => Line::styled(visible(trouble), Style::new().fg(Color::Red).add_modifier(Modifier::BOLD)),
        None => Line::raw(counters),
    };
    let sdo = view.lines.iter().find(|(_, line)| line.role == SlotRole::Sdo);
    let sdo = sdo.map_or_else(|| "none yet".to_owned(), |(_, line)| line.to_string());
    let sdo = format!("SDO   {}", sdo.strip_prefix("SDO").unwrap_or(&sdo).trim_start());
    vec![name, first, Line::raw(fifo), Line::raw(sdo), last]
}

/// The whole view as text.
pub fn text(view: &View) -> String {
    let rows = u16::try_from(rows(view).len()).unwrap_or(u16::MAX);
    let mut terminal = Terminal::new(TestBackend::new(WIDTH, HEAD + rows + 1)).unwrap_or_else(|never| match never {});
    let drawn = terminal.draw(|frame| {
        draw(frame, view, 0);
    });
    match drawn {
        Ok(drawn) => lines(drawn.buffer, 1),
        Err(never) => match never {},
    }
}

/// The characters of a buffer as text, except its last `without` lines.
fn lines(buffer: &Buffer, without: u16) -> String {
    let area = buffer.area();
    let mut text = String::new();
    for y in area.top()..area.bottom().saturating_sub(without) {
        let line: String = (area.left()..area.right()).map(|x| buffer[(x, y)].symbol()).collect();
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use ecmsk::cia402::Statusword;
    use ecmsk::sk::{DriveResponse, MasterResponse, SlaveKind, SlaveResponse, SlotSize, StateByte};

    use super::*;
    use crate::monitor::watched::Watched;

    const SIZE: SlotSize = SlotSize::Bytes12;

    /// A view of a board in OP with 40 drives. The position of each drive is 1000 times its number, and drive 7 has an
    /// alarm.
    fn forty() -> View {
        let mut watched = Watched::new("board".to_owned(), Some(&[SlaveKind::Drive; 40]));
        let mut report = ecmsk::sk::Frame::new();
        let state = StateByte::reached(MasterState::Op);
        let board = MasterResponse { id: 0xBF, state, fifo_free: 120, ..MasterResponse::default() };
        report.put(SIZE, 0, &board.encode());
        for n in 1..=40 {
            let (statusword, error_code) = if n == 7 { (0x0218, 0x7500) } else { (0x1637, 0) };
            let drive = DriveResponse {
                head: SlaveResponse { id: 0x15, index: n as u8 },
                statusword: Statusword(statusword),
                position: 1000 * n,
                torque: -5,
                error_code,
            };
            report.put(SIZE, n as usize, &drive.encode());
        }
        watched.report(1_500_000_000, &report, SIZE);
        watched.view()
    }

    fn screen(view: &View, size: (u16, u16), scroll: usize) -> (Buffer, usize) {
        let mut terminal = Terminal::new(TestBackend::new(size.0, size.1)).expect("no terminal can fail");
        let mut last = 0;
        terminal.draw(|frame| last = draw(frame, view, scroll)).expect("no terminal can fail");
        (terminal.backend().buffer().clone(), last)
    }

    /// A small terminal shows only some of 40 slaves. The table can be scrolled up to the last slave, but not further.
    #[test]
    fn forty_slaves_scroll() {
        let view = forty();
        let (top, last) = screen(&view, (80, 18), 0);
        // There are 7 lines above the rows of the table and one line below.
        assert_eq!(last, 30);
        let text = lines(&top, 0);
        let rows: Vec<&str> = text.lines().collect();
        assert_eq!(
            rows[2],
            "FIFO  [########........................] 40 of 160 wait   full count 0   CRC errors 0"
                .get(..80)
                .expect("letters")
                .trim_end()
        );
        assert!(rows[7].starts_with("    1 drive  Operation enabled") && rows[7].contains(" 1000 "), "{text}");
        assert!(rows[16].starts_with("   10 drive"), "{text}");
        assert_eq!(rows[17], "rows 1 to 10 of 40   q ends, arrows scroll");
        for far in [30, 31, 1000] {
            let text = lines(&screen(&view, (80, 18), far).0, 0);
            assert!(text.lines().nth(16).expect("a row").starts_with("   40 drive"), "{far}: {text}");
        }
    }

    /// An alarm and an enabled axis are highlighted. Narrow terminals still show the most important columns.
    #[test]
    fn an_alarm_and_an_axis_that_is_on_are_highlighted() {
        let view = forty();
        let (buffer, _) = screen(&view, (106, 48), 0);
        let colour = |slave: u16| buffer[(8, HEAD + slave - 1)].fg;
        assert_eq!((colour(6), colour(7), colour(8)), (Color::Green, Color::Red, Color::Green));
        let narrow = lines(&screen(&view, (50, 20), 0).0, 0);
        let alarm = narrow.lines().nth(usize::from(HEAD) + 6).expect("a row");
        for word in ["7", "Fault", "7000", "0x7500"] {
            assert!(alarm.contains(word), "`{word}` is missing in {alarm}");
        }
        assert!(!narrow.contains("torque") && !narrow.contains("counts/s"), "{narrow}");
    }

    /// The screen can be drawn on a terminal of any size.
    #[test]
    fn the_screen_is_drawn_on_terminals_of_any_size() {
        for (width, height) in [(1, 1), (10, 3), (20, 7), (300, 8)] {
            screen(&forty(), (width, height), 3);
        }
    }
}
