//! A text on the terminal that is made anew again and again: what does not fit is scrolled to.

use std::io;
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
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
            terminal.draw(|frame| frame.render_widget(Paragraph::new(text.as_str()).scroll((top, 0)), frame.area()))?;
            if !event::poll(every.saturating_sub(made.elapsed()))? {
                break;
            }
            let Event::Key(key) = event::read()? else { continue };
            match key.code {
                _ if key.kind == KeyEventKind::Release => {}
                KeyCode::Char('q') | KeyCode::Esc => return Ok(()),
                KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return Ok(()),
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
