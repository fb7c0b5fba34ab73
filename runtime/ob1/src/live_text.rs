//! A text on the terminal that is made anew again and again: what does not fit is scrolled to.

use std::io;
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::style::{Color, Style};
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::Paragraph;

/// Shows `text`, and what `next` gives after each `every`, until `q` or until that gives nothing. The terminal is as it
/// was before, however this ends.
///
/// # Errors
/// Of the terminal, and those of `next`.
pub(crate) fn show<E: From<io::Error>>(
    every: Duration,
    text: String,
    next: impl FnMut() -> Result<Option<String>, E>,
) -> Result<(), E> {
    let mut terminal = ratatui::try_init()?;
    let done = paint(every, text, next, &mut terminal);
    ratatui::restore();
    done
}

fn paint<E: From<io::Error>>(
    every: Duration,
    mut text: String,
    mut next: impl FnMut() -> Result<Option<String>, E>,
    terminal: &mut DefaultTerminal,
) -> Result<(), E> {
    let mut top = 0u16;
    loop {
        let made = Instant::now();
        text.push_str("\nq quit   up, down");
        let lines = text.lines().count().min(usize::from(u16::MAX)) as u16;
        loop {
            let height = terminal.size()?.height;
            top = top.min(lines.saturating_sub(height));
            terminal.draw(|frame| frame.render_widget(Paragraph::new(styled(&text)).scroll((top, 0)), frame.area()))?;
            if !event::poll(every.saturating_sub(made.elapsed()))? {
                break;
            }
            let Some(key) = pressed(&event::read()?) else { continue };
            match key {
                KeyCode::Char('q') | KeyCode::Esc => return Ok(()),
                KeyCode::Up => top = top.saturating_sub(1),
                KeyCode::Down => top = top.saturating_add(1),
                KeyCode::PageUp => top = top.saturating_sub(height / 2),
                KeyCode::PageDown => top = top.saturating_add(height / 2),
                _ => {}
            }
        }
        match next()? {
            Some(made) => text = made,
            None => return Ok(()),
        }
    }
}

/// A key that is pressed. Control-C is the end, too.
pub(crate) fn pressed(event: &Event) -> Option<KeyCode> {
    let key = event.as_key_event().filter(|key| key.kind != KeyEventKind::Release)?;
    let is_end = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
    Some(if is_end { KeyCode::Char('q') } else { key.code })
}

/// The text with the colours that its escape sequences name: those of `show`.
fn styled(text: &str) -> Text<'_> {
    let line = |line: &'_ str| {
        let mut spans = Vec::new();
        for (at, part) in line.split("\u{1b}[").enumerate() {
            let (code, rest) = if at == 0 { ("", part) } else { part.split_once('m').unwrap_or(("", part)) };
            let style = match code {
                "32" => Style::new().fg(Color::Green),
                "34" => Style::new().fg(Color::Blue),
                "31" => Style::new().fg(Color::Red),
                _ => Style::new(),
            };
            spans.push(Span::styled(rest.to_owned(), style));
        }
        Line::from(spans)
    };
    Text::from(text.lines().map(line).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_styles() {
        let text = styled("a\u{1b}[32mb\u{1b}[34mc\u{1b}[0md\ne");
        let colours: Vec<_> = text.lines[0].spans.iter().map(|s| (s.content.to_string(), s.style.fg)).collect();
        let (green, blue) = (Some(Color::Green), Some(Color::Blue));
        let expected = [("a", None), ("b", green), ("c", blue), ("d", None)].map(|(t, c)| (t.to_owned(), c));
        assert_eq!(colours, expected);
        assert_eq!(text.lines[1].to_string(), "e");
    }
}
