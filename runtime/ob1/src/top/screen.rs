//! The screen: a head, a page, a line for the keys.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Text};
use ratatui::widgets::{Bar, BarChart, BarGroup, Block, Borders, Clear, Paragraph, Tabs, Wrap};

use super::data::{Data, bins};
use super::keys::{HELP, Keys, Tab};
use super::plain;
use crate::units::time;
use ob1_timing::Timing;
use ob1_timing::snapshot::Spread;

/// Columns of a bar of a histogram, and between two.
const BAR: u16 = 7;

/// Draws the head, the page in view and the line for the keys.
pub(super) fn draw(frame: &mut Frame<'_>, data: &Data, keys: &Keys, note: &str) {
    let rows =
        Layout::vertical([Constraint::Length(2), Constraint::Length(1), Constraint::Min(4), Constraint::Length(1)]);
    let [head, tabs, page, prompt] = rows.areas(frame.area());
    let state = match data.now.status.state.as_str() {
        "RUN" => Color::Green,
        "STOP" => Color::Red,
        _ => Color::Yellow,
    };
    let style = Style::new().fg(state).add_modifier(Modifier::BOLD);
    frame.render_widget(Paragraph::new(plain::head(data)).style(style).wrap(Default::default()), head);
    let chosen = Tab::ALL.iter().position(|(tab, _)| *tab == keys.tab);
    frame.render_widget(Tabs::new(Tab::ALL.map(|(_, name)| name)).select(chosen), tabs);
    match keys.tab {
        Tab::Scan => scan(frame, page, data),
        Tab::Cps => cps(frame, page, data),
        Tab::Diagnostics => diagnostics(frame, page, data),
        Tab::Variables => variables(frame, page, data, keys.line),
        Tab::Buses => buses(frame, page, data),
        Tab::Connections => connections(frame, page, data),
        Tab::Program => program(frame, page, data),
    }
    if keys.help {
        let help = Paragraph::new(HELP).block(Block::new().borders(Borders::ALL).title("keys"));
        frame.render_widget(Clear, page);
        frame.render_widget(help, page);
    }
    let last = if note.is_empty() { keys.prompt() } else { note.to_owned() };
    frame.render_widget(Paragraph::new(last).style(Style::new().add_modifier(Modifier::REVERSED)), prompt);
}

fn titled(title: &str) -> Block<'_> {
    Block::new().borders(Borders::TOP).title(title)
}

fn scan(frame: &mut Frame<'_>, area: Rect, data: &Data) {
    let times = plain::times(data);
    let late = ob1_timing::text::late(&data.now.timing.late);
    let height = |text: &str| text.lines().count() as u16 + 1;
    let first = plain::first(data);
    let room = first.lines().map(|line| line.chars().count() as u16 / area.width.max(1) + 1).sum();
    let rows = [
        Constraint::Length(room),
        Constraint::Length(height(&times)),
        Constraint::Min(8),
        Constraint::Max(height(&late)),
    ];
    let [asked, table, histograms, classes] = Layout::vertical(rows).areas(area);
    frame.render_widget(Paragraph::new(first).wrap(Wrap { trim: false }), asked);
    let title = "times since the last reset, and since the reading before";
    frame.render_widget(Paragraph::new(times).block(titled(title)), table);
    let [left, right] = Layout::horizontal([Constraint::Fill(1), Constraint::Fill(1)]).areas(histograms);
    histogram(frame, left, "wake-up, newest look", data, |t| &t.wake);
    histogram(frame, right, "execution, newest look", data, |t| &t.execution);
    frame.render_widget(Paragraph::new(late).block(titled("late scans")), classes);
}

fn histogram(frame: &mut Frame<'_>, area: Rect, title: &str, data: &Data, of: impl Fn(&Timing) -> &Spread) {
    let columns = usize::from((area.width / (BAR + 1)).max(1));
    // A logarithmic height: one scan among a thousand has to be seen.
    let height = |count: u64| if count == 0 { 0 } else { ((count as f64).log10() * 100.0) as u64 + 30 };
    let bar = |(upper, count): (u64, u64)| {
        Bar::default().value(height(count)).text_value(count.to_string()).label(Line::from(time(upper as f64)))
    };
    let bars: Vec<Bar<'_>> = bins(&data.newest(of), columns).into_iter().map(bar).collect();
    let chart = BarChart::default().data(BarGroup::default().bars(&bars)).bar_width(BAR).bar_gap(1);
    frame.render_widget(chart.bar_style(Style::new().fg(Color::Blue)).block(titled(title)), area);
}

fn cps(frame: &mut Frame<'_>, area: Rect, data: &Data) {
    let modules = &data.now.status.modules;
    let lines: Vec<Line<'_>> =
        modules.iter().enumerate().map(|(number, m)| Line::from(plain::module(data, number, m))).collect();
    // Long lines are folded.
    let height =
        (lines.iter().map(|line| line.width() as u16 / area.width.max(1) + 1).sum::<u16>() + 1).min(area.height / 2);
    let [top, bottom] = Layout::vertical([Constraint::Length(height), Constraint::Min(3)]).areas(area);
    frame.render_widget(Paragraph::new(lines).wrap(Default::default()).block(titled("modules")), top);
    let room = usize::from(bottom.height.saturating_sub(1));
    let from = data.telegrams.len().saturating_sub(room);
    let newest: Vec<Line<'_>> = data.telegrams.iter().skip(from).map(|line| Line::from(line.as_str())).collect();
    frame.render_widget(Paragraph::new(newest).block(titled("telegrams, newest last")), bottom);
}

fn diagnostics(frame: &mut Frame<'_>, area: Rect, data: &Data) {
    let folded = |text: String, title| Paragraph::new(text).wrap(Wrap { trim: false }).block(titled(title));
    let buffer = folded(crate::diag::text(Some(&data.now.diagnostics), &[]), "diagnostic buffer, newest first");
    if data.now.cp_buffers.is_empty() {
        return frame.render_widget(buffer, area);
    }
    let [cpu, cps] = Layout::vertical([Constraint::Fill(1), Constraint::Fill(1)]).areas(area);
    frame.render_widget(buffer, cpu);
    let text = crate::diag::text(None, &data.now.cp_buffers);
    frame.render_widget(folded(text, "of the CPs, newest first"), cps);
}

fn buses(frame: &mut Frame<'_>, area: Rect, data: &Data) {
    let text = plain::buses(data);
    let text = if text.is_empty() { "the station has no bus".to_owned() } else { text };
    frame.render_widget(Paragraph::new(text).block(titled("buses, couplers and slaves")), area);
}

fn connections(frame: &mut Frame<'_>, area: Rect, data: &Data) {
    let text = plain::links(data);
    let text = if text.is_empty() { "this station has no links".to_owned() } else { text };
    frame.render_widget(Paragraph::new(text).block(titled("links and their connections")), area);
}

fn program(frame: &mut Frame<'_>, area: Rect, data: &Data) {
    let text = if data.program.is_empty() { "no block is watched: b names one" } else { &data.program };
    frame.render_widget(Paragraph::new(text).block(titled("statements of a block, as they ran")), area);
}

fn variables(frame: &mut Frame<'_>, area: Rect, data: &Data, chosen: usize) {
    let values = plain::values(data);
    let chosen = chosen.min(values.len().saturating_sub(1));
    let line = |(number, text): (usize, String)| {
        let style = if number == chosen { Style::new().add_modifier(Modifier::REVERSED) } else { Style::new() };
        Line::styled(text, style)
    };
    let lines: Vec<Line<'_>> = values.into_iter().enumerate().map(line).collect();
    let text = if lines.is_empty() { Text::from("nothing is watched: a adds a cell") } else { Text::from(lines) };
    frame.render_widget(Paragraph::new(text).block(titled("variables")), area);
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::super::data::tests::look;
    use super::super::keys::Entry;
    use super::*;
    use ratatui::crossterm::event::KeyCode as Key;

    fn shown(data: &Data, keys: &Keys, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a test terminal");
        terminal.draw(|frame| draw(frame, data, keys, "")).expect("a drawing");
        terminal.backend().to_string()
    }

    #[test]
    fn every_page_shows_what_it_is_for() {
        let mut data = Data::new(look(10, 10_000));
        data.update(look(12, 12_000));
        data.heard("  0.5  cp > telegram ABC\n");
        data.program = "FB 20 in OB 1, 0.5 s\n".to_owned();
        let mut keys = Keys::default();
        for (key, parts) in [
            ('1', &["press  RUN", "modules: ", "execution, newest look", "FC 0 SEND", "2000", "kernel"][..]),
            ('2', &["*PW .ER *TxD", "orders 121 open 1", "telegram ABC"]),
            ('3', &["4302h: RUN"]),
            ('6', &["panel", "10.0.0.7:50000", "PDU  480", "page             down"]),
            ('4', &["16#0102", "there is no DB 99", "m modify"]),
            ('7', &["FB 20 in OB 1", "b block"]),
            ('5', &["field  dp  process 77", "E 0: 1234", "configuration fault"]),
        ] {
            keys.press(Key::Char(key), &[]);
            let screen = shown(&data, &keys, 150, 50);
            for part in parts {
                assert!(screen.contains(part), "page {key}: {part}\n{screen}");
            }
        }
        keys.press(Key::Char('?'), &[]);
        assert!(shown(&data, &keys, 80, 24).contains("any key closes it"));
        keys.press(Key::Char('q'), &[]);
        assert!(!shown(&data, &keys, 80, 24).contains("any key closes it"));
        // All of the head is seen on the narrowest terminal that people use.
        let narrow = shown(&data, &keys, 80, 24);
        assert!(narrow.contains("engine native") && narrow.contains("watchdog 0"), "{narrow}");
        keys.entry = Entry::Confirm { cell: "MW10".into(), value: "7".into() };
        assert!(shown(&data, &keys, 100, 30).contains("write MW10 = 7 into the running CPU?"));
    }

    #[test]
    fn small_terminals_are_no_trouble() {
        let data = Data::new(look(10, 10_000));
        for tab in Tab::ALL.map(|(tab, _)| tab) {
            for (width, height) in [(1, 1), (20, 5), (80, 24), (400, 100)] {
                shown(&data, &Keys { tab, ..Keys::default() }, width, height);
            }
        }
    }
}
