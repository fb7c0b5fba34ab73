//! The loops: a look, what it shows, the keys in between.

use std::time::{Duration, Instant};

use ratatui::crossterm::event;

use super::data::Data;
use super::keys::{Act, Keys, Tab};
use super::source::Source;
use super::watch::Watched;
use super::{TopArgs, TopError, plain, screen};
use crate::live_text::pressed;
use ob1_station::access::client::AccessError;
use ob1_station::out;

/// Between two readings of the lines.
const LINES: Duration = Duration::from_millis(200);

fn watched(args: &TopArgs) -> Vec<Watched> {
    args.watch.iter().map(|text| Watched::parse(text)).collect()
}

/// Text, a look after the other.
pub(super) fn plain(args: &TopArgs) -> Result<(), TopError> {
    let mut source = Source::open(&args.station)?;
    let watch = watched(args);
    let mut data = Data::new(source.look(&watch)?);
    let mut looks = 0;
    loop {
        say!("{}", plain::text(&data));
        out::flush();
        looks += 1;
        if out::is_over() || args.count.is_some_and(|count| looks >= count) {
            return Ok(());
        }
        std::thread::sleep(args.every.into());
        match source.look(&watch) {
            Ok(look) => data.update(look),
            // The station has ended: so does this.
            Err(AccessError::Io(_)) => return Ok(()),
            Err(error) => return Err(error.into()),
        }
    }
}

/// The screen. The terminal is as it was before, however this ends.
pub(super) fn screen(args: &TopArgs) -> Result<(), TopError> {
    let mut source = Source::open(&args.station)?;
    let watch = watched(args);
    let mut data = Data::new(source.look(&watch)?);
    let mut terminal = ratatui::try_init()?;
    let done = watch_keys(args, &mut source, watch, &mut data, &mut terminal);
    ratatui::restore();
    done
}

fn watch_keys(
    args: &TopArgs,
    source: &mut Source,
    mut watch: Vec<Watched>,
    data: &mut Data,
    terminal: &mut ratatui::DefaultTerminal,
) -> Result<(), TopError> {
    let mut keys = Keys::default();
    let (mut note, mut block) = (String::new(), String::new());
    let (mut looked, mut looks) = (Instant::now(), 1);
    loop {
        data.heard(&source.telegrams());
        terminal.draw(|frame| screen::draw(frame, data, &keys, &note))?;
        let left = Duration::from(args.every).saturating_sub(looked.elapsed());
        if !left.is_zero() {
            if !event::poll(left.min(LINES))? {
                continue;
            }
            let Some(key) = pressed(&event::read()?) else { continue };
            note.clear();
            let cells: Vec<String> = watch.iter().map(|watched| watched.name.clone()).collect();
            match keys.press(key, &cells) {
                Act::Nothing => continue,
                Act::Quit => return Ok(()),
                Act::Block(text) => block = text,
                Act::Watch(text) => watch.push(Watched::parse(&text)),
                Act::Forget(line) => drop(watch.remove(line)),
                Act::Write { cell, value } => {
                    note = match source.write(&cell, &value) {
                        Ok(()) => format!("{cell} = {value}: written"),
                        Err(AccessError::Refused(why)) => format!("refused: {why}"),
                        Err(error) => return Err(error.into()),
                    };
                }
            }
        } else if args.count.is_some_and(|count| looks >= count) {
            return Ok(());
        }
        let shown = match keys.tab {
            Tab::Program if !block.is_empty() => source.program(&block),
            _ => Ok(String::new()),
        };
        match shown.and_then(|program| Ok((program, source.look(&watch)?))) {
            Ok((program, look)) => {
                data.program = program;
                data.update(look);
            }
            Err(AccessError::Io(_)) => return Ok(()),
            Err(error) => return Err(error.into()),
        }
        looked = Instant::now();
        looks += 1;
    }
}
