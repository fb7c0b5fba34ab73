//! What keys do: a machine of its own, without a terminal.

use ratatui::crossterm::event::KeyCode as Key;

/// Which page is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Tab {
    #[default]
    Scan,
    Cps,
    Diagnostics,
    Variables,
    Buses,
    Connections,
    Program,
}

impl Tab {
    /// In their order, with their names.
    pub(super) const ALL: [(Self, &'static str); 7] = [
        (Self::Scan, "1 Scan"),
        (Self::Cps, "2 CPs"),
        (Self::Diagnostics, "3 Diagnostics"),
        (Self::Variables, "4 Variables"),
        (Self::Buses, "5 Buses"),
        (Self::Connections, "6 Connections"),
        (Self::Program, "7 Program"),
    ];

    fn next(self) -> Self {
        Self::ALL[(self as usize + 1) % Self::ALL.len()].0
    }
}

/// What is being typed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) enum Entry {
    /// Nothing: keys are commands.
    #[default]
    None,
    /// The name of a cell to watch.
    Name(String),
    /// The block whose statements are shown.
    Block(String),
    /// A new value for a cell.
    Value {
        /// The name of the cell.
        cell: String,
        text: String,
    },
    /// A question whether to write the value.
    Confirm { cell: String, value: String },
}

/// What has to be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Act {
    Nothing,
    Quit,
    /// One more line in the variable table.
    Watch(String),
    /// The statements of this block are shown.
    Block(String),
    /// The line of the variable table is removed.
    Forget(usize),
    /// A cell gets a value: confirmed.
    Write {
        cell: String,
        value: String,
    },
}

/// The state of the keys.
#[derive(Debug, Default)]
pub(super) struct Keys {
    pub(super) tab: Tab,
    pub(super) entry: Entry,
    /// The chosen line of the variable table.
    pub(super) line: usize,
    /// Whether the keys are explained.
    pub(super) help: bool,
}

/// What the keys do.
pub(super) const HELP: &str = "\
1 to 7, Tab   another page
4             the variable table: Up, Down choose; a adds, d drops, m modifies
              NAME, NAME:hex, NAME:bin, NAME:anzw, NAME:status
7             b names the block whose statements are shown
q, Escape     end
?             this; any key closes it

Nothing is written before a question has been answered with y.";

impl Keys {
    /// A key; `cells` are the names in the variable table.
    pub(super) fn press(&mut self, key: Key, cells: &[String]) -> Act {
        if std::mem::take(&mut self.help) {
            return Act::Nothing;
        }
        match std::mem::take(&mut self.entry) {
            Entry::None => self.command(key, cells),
            Entry::Name(text) => self.named(typed(text, key), Entry::Name, Act::Watch),
            Entry::Block(text) => self.named(typed(text, key), Entry::Block, Act::Block),
            Entry::Value { cell, text } => {
                match typed(text, key) {
                    Typed::More(text) => self.entry = Entry::Value { cell, text },
                    Typed::Done(text) if !text.trim().is_empty() => {
                        self.entry = Entry::Confirm { cell, value: text.trim().to_owned() };
                    }
                    Typed::Done(_) | Typed::Dropped => {}
                }
                Act::Nothing
            }
            // Only a `y` writes to a running plant.
            Entry::Confirm { cell, value } if key == Key::Char('y') => Act::Write { cell, value },
            Entry::Confirm { .. } => Act::Nothing,
        }
    }

    /// A name, once it has been typed.
    fn named(&mut self, typed: Typed, entry: fn(String) -> Entry, act: fn(String) -> Act) -> Act {
        match typed {
            Typed::More(text) => self.entry = entry(text),
            Typed::Done(text) if !text.trim().is_empty() => return act(text.trim().to_owned()),
            Typed::Done(_) | Typed::Dropped => {}
        }
        Act::Nothing
    }

    fn command(&mut self, key: Key, cells: &[String]) -> Act {
        let last = cells.len().saturating_sub(1);
        match key {
            Key::Char('q') | Key::Esc => return Act::Quit,
            Key::Tab => self.tab = self.tab.next(),
            Key::Char('?') => self.help = true,
            Key::Char(digit @ '1'..='7') => {
                self.tab = Tab::ALL.get(digit as usize - '1' as usize).map_or(self.tab, |(tab, _)| *tab);
            }
            Key::Char('b') if self.tab == Tab::Program => self.entry = Entry::Block(String::new()),
            _ if self.tab != Tab::Variables => {}
            Key::Up => self.line = self.line.saturating_sub(1),
            Key::Down => self.line = (self.line + 1).min(last),
            Key::Char('a') => self.entry = Entry::Name(String::new()),
            Key::Char('d') if !cells.is_empty() => {
                let line = self.line.min(last);
                self.line = line.min(last.saturating_sub(1));
                return Act::Forget(line);
            }
            Key::Char('m') | Key::Enter => {
                if let Some(cell) = cells.get(self.line.min(last)) {
                    self.entry = Entry::Value { cell: cell.clone(), text: String::new() };
                }
            }
            _ => {}
        }
        Act::Nothing
    }

    /// The last line of the screen: what is being typed, or which keys there are.
    pub(super) fn prompt(&self) -> String {
        match &self.entry {
            Entry::None if self.tab == Tab::Variables => {
                "q quit  ? help  1-7 or Tab another page  Up/Down choose  a add  d drop  m modify".into()
            }
            Entry::None if self.tab == Tab::Program => "q quit  ? help  1-7 or Tab another page  b block".into(),
            Entry::None => "q quit  ? help  1-7 or Tab another page".into(),
            Entry::Name(text) => format!("watch (NAME, NAME:hex, NAME:bin, NAME:anzw, NAME:status): {text}_"),
            Entry::Block(text) => format!("block (OB 1, FC 5, FB 20, or its name): {text}_"),
            Entry::Value { cell, text } => format!("new value of {cell}: {text}_"),
            Entry::Confirm { cell, value } => {
                format!("write {cell} = {value} into the running CPU?  y: yes, any other key: no")
            }
        }
    }
}

enum Typed {
    More(String),
    Done(String),
    Dropped,
}

fn typed(mut text: String, key: Key) -> Typed {
    match key {
        Key::Enter => return Typed::Done(text),
        Key::Esc => return Typed::Dropped,
        Key::Backspace => drop(text.pop()),
        Key::Char(c) => text.push(c),
        _ => {}
    }
    Typed::More(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(text: &str) -> Vec<Key> {
        text.chars().map(|c| if c == '\n' { Key::Enter } else { Key::Char(c) }).collect()
    }

    fn play(keys: &mut Keys, input: &[Key], cells: &[String]) -> Act {
        input.iter().fold(Act::Nothing, |act, key| {
            assert_eq!(act, Act::Nothing, "only the last key does something");
            keys.press(*key, cells)
        })
    }

    #[test]
    fn a_value_is_written_after_a_yes_and_never_else() {
        let cells = ["M1.0".to_owned(), "DB1.SOLL".to_owned()];
        let mut state = Keys::default();
        assert_eq!(play(&mut state, &keys("4"), &cells), Act::Nothing);
        state.press(Key::Down, &cells);
        state.press(Key::Down, &cells);
        let write = Act::Write { cell: "DB1.SOLL".into(), value: "16#1A".into() };
        assert_eq!(play(&mut state, &keys("m16#1A\ny"), &cells), write);
        for no in ["m1\nn", "m1\n\n", "m1\nY", "m\ny"] {
            assert_eq!(play(&mut state, &keys(no), &cells), Act::Nothing, "{no:?}");
            assert_eq!(state.entry, Entry::None);
        }
        assert_eq!(play(&mut state, &[Key::Char('m'), Key::Char('1'), Key::Esc, Key::Char('y')], &cells), Act::Nothing);
        // Without a table there is nothing to modify or to drop.
        assert_eq!(play(&mut Keys { tab: Tab::Variables, ..Keys::default() }, &keys("md1\ny"), &[]), Act::Nothing);
    }

    #[test]
    fn pages_and_the_table() {
        let cells = ["M1.0".to_owned(), "M1.1".to_owned()];
        let mut state = Keys::default();
        for (key, tab) in [
            (Key::Tab, Tab::Cps),
            (Key::Tab, Tab::Diagnostics),
            (Key::Tab, Tab::Variables),
            (Key::Tab, Tab::Buses),
            (Key::Tab, Tab::Connections),
            (Key::Tab, Tab::Program),
            (Key::Tab, Tab::Scan),
            (Key::Char('5'), Tab::Buses),
            (Key::Char('6'), Tab::Connections),
            (Key::Char('4'), Tab::Variables),
        ] {
            assert_eq!((state.press(key, &cells), state.tab), (Act::Nothing, tab));
        }
        assert_eq!(play(&mut state, &keys("aMW10:hex\n"), &cells), Act::Watch("MW10:hex".into()));
        assert_eq!(
            play(&mut state, &[Key::Char('a'), Key::Char('x'), Key::Backspace, Key::Enter], &cells),
            Act::Nothing
        );
        state.press(Key::Down, &cells);
        assert_eq!((state.press(Key::Char('d'), &cells), state.line), (Act::Forget(1), 0));
        assert_eq!(play(&mut state, &keys("7bFB 20\n"), &cells), Act::Block("FB 20".into()));
        state.press(Key::Char('4'), &cells);
        // What is typed are no commands.
        assert_eq!(play(&mut state, &keys("aq1"), &cells), Act::Nothing);
        assert_eq!(state.press(Key::Esc, &cells), Act::Nothing);
        assert_eq!(state.press(Key::Char('q'), &cells), Act::Quit);
    }
}
