//! `ob1 bus watch STATION`: the couplers and slaves of a running station, live. A screen on a terminal, lines
//! elsewhere.

use std::io::{self, IsTerminal as _};
use std::time::Instant;

use clap::Args;
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::{BusStatus, Op};
use ob1_station::out;
use ob1_time::Span;

use super::text::text;
use crate::exit::Exit;
use crate::live_text;

#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 bus watch press.toml\n  ob1 bus watch press --bus field --every 200ms\n  ob1 bus watch press --count 1 --json"
)]
pub(super) struct WatchArgs {
    /// A running station: its name or its file
    station: String,
    /// Only this bus
    #[arg(long, value_name = "NAME")]
    bus: Option<String>,
    /// Time between two looks
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = ob1_station_file::parse_duration)]
    every: Span,
    /// End after so many looks
    #[arg(long, short = 'n', value_name = "N")]
    count: Option<u64>,
    /// Lines of text, also on a terminal
    #[arg(long)]
    plain: bool,
    /// Each look as a line of JSON
    #[arg(long)]
    json: bool,
}

/// What is shown: the newest look, and the one before.
struct Looks {
    now: Vec<BusStatus>,
    at: Instant,
    before: Option<(Vec<BusStatus>, f64)>,
}

impl Looks {
    fn update(&mut self, buses: Vec<BusStatus>) {
        let seconds = std::mem::replace(&mut self.at, Instant::now()).elapsed().as_secs_f64();
        self.before = Some((std::mem::replace(&mut self.now, buses), seconds));
    }

    fn text(&self) -> String {
        text(&self.now, self.before.as_ref().map(|(before, seconds)| (&before[..], *seconds)))
    }
}

fn look(client: &mut Client, only: Option<&str>) -> Result<Vec<BusStatus>, AccessError> {
    let mut buses = client.ask(Op::Buses)?.buses.unwrap_or_default();
    buses.retain(|bus| only.is_none_or(|only| bus.name == only));
    Ok(buses)
}

pub(super) fn watch(args: &WatchArgs) -> Result<Exit, AccessError> {
    let mut client = Client::to_station(&args.station)?;
    let only = args.bus.as_deref();
    let now = look(&mut client, only)?;
    if now.is_empty() {
        let names: Vec<String> =
            look(&mut client, None)?.into_iter().map(|bus| format!("--bus {}", bus.name)).collect();
        let remedy = if names.is_empty() { "the station has no bus".to_owned() } else { names.join(" | ") };
        err!("ob1: which bus?\n  = {remedy}");
        return Ok(Exit::Usage);
    }
    let mut looks = Looks { now, at: Instant::now(), before: None };
    let plain = args.plain || args.json || !io::stdout().is_terminal() || !io::stdin().is_terminal();
    if plain {
        return lines(args, &mut client, &mut looks);
    }
    screen(args, &mut client, &mut looks).map(|()| Exit::Ok)
}

/// Whether there is a next look; the end of the station is the end of this.
fn next(args: &WatchArgs, client: &mut Client, looks: &mut Looks) -> Result<bool, AccessError> {
    match look(client, args.bus.as_deref()) {
        Ok(buses) => {
            looks.update(buses);
            Ok(true)
        }
        Err(AccessError::Io(_)) => Ok(false),
        Err(error) => Err(error),
    }
}

fn lines(args: &WatchArgs, client: &mut Client, looks: &mut Looks) -> Result<Exit, AccessError> {
    let mut count = 0;
    loop {
        if args.json {
            says!("{}\n", serde_json::json!({ "buses": looks.now }));
        } else {
            says!("{}", looks.text());
        }
        out::flush();
        count += 1;
        if out::is_over() || args.count.is_some_and(|wanted| count >= wanted) {
            return Ok(Exit::Ok);
        }
        std::thread::sleep(args.every.into());
        if !next(args, client, looks)? {
            return Ok(Exit::Ok);
        }
    }
}

fn screen(args: &WatchArgs, client: &mut Client, looks: &mut Looks) -> Result<(), AccessError> {
    let (first, mut count) = (looks.text(), 1);
    live_text::show(args.every.into(), first, || {
        let goes_on = args.count.is_none_or(|wanted| count < wanted) && next(args, client, looks)?;
        count += 1;
        Ok(goes_on.then(|| looks.text()))
    })
}
