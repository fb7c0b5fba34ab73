//! User data over the simulated line, beside what the protocol's own characters and pauses leave of the baud rate: at the protocol
//! machines with orders queued, and end to end through FC 0 and FC 1 at a scan of 1 ms. In virtual time; only the cost of a telegram is
//! the processor's.

use std::path::PathBuf;
use std::time::Instant;

use ob1_line::sim::{End, FaultRates, SimConfig, SimEvent, SimLine};
use ob1_protocols::{
    Ascii, Event, Input, MS, Machine, Nanos, Order, S3964, SECOND, SendError, Sink, StxEtx, ascii, s3964, stx_etx,
};

use super::Figure;
use super::peer::Failure;
use crate::sim::{self, Scenario};

/// Bytes of user data in a telegram.
const PAYLOAD: usize = 250;
const TELEGRAMS: u64 = 400;
const BAUDS: [(u32, [&str; 4], &str); 2] = [
    (
        9600,
        ["3964R, 9600 baud", "3964, 9600 baud", "STX/ETX, 9600 baud", "ASCII, ZNA 20 ms, 9600 baud"],
        "FC 0 -> FC 1, 3964R, 9600 baud",
    ),
    (
        115_200,
        ["3964R, 115200 baud", "3964, 115200 baud", "STX/ETX, 115200 baud", "ASCII, ZNA 20 ms, 115200 baud"],
        "FC 0 -> FC 1, 3964R, 115200 baud",
    ),
];
/// 8N1.
const HALF_BITS: u32 = 20;

/// One end of the line while its machine is at work.
struct Plug<'a> {
    line: &'a mut SimLine,
    end: End,
    now: Nanos,
    sent: Option<Result<(), SendError>>,
    delivered: &'a mut u64,
}

impl Sink for Plug<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.line.write(self.end, self.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.line.take_back(self.end, self.now)
    }

    fn room(&self) -> usize {
        1024
    }

    fn deliver(&mut self, telegram: &[u8]) {
        *self.delivered += telegram.len() as u64;
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.sent = Some(outcome);
    }

    fn report(&mut self, _event: Event) {}
}

/// What a run came to.
struct Run {
    /// Bytes of user data a second of the line's time.
    rate: f64,
    /// Processor time of a telegram, both machines and the line, in nanoseconds.
    cost: f64,
}

/// Two machines; the first always has another order.
fn run(mut machines: [Box<dyn Machine>; 2], baud: u32) -> Result<Run, Failure> {
    let mut line = SimLine::new(SimConfig::new(baud, HALF_BITS), 1);
    // No DLE among them, which would be doubled.
    let payload: Vec<u8> = (0..PAYLOAD).map(|i| 0x20 + (i % 0x60) as u8).collect();
    let (mut now, mut done, mut delivered) = (0, 0, 0);
    let mut due = [None, None];
    let begin = Instant::now();
    let mut step = |line: &mut SimLine, due: &mut [Option<Nanos>; 2], now, end: End, input: Input<'_>| {
        let mut plug = Plug { line, end, now, sent: None, delivered: &mut delivered };
        let machine = &mut machines[end as usize];
        due[end as usize] = machine.step(now, input, &mut plug);
        // The next order stands ready.
        while let Some(outcome) = plug.sent.take() {
            outcome.map_err(|error| format!("an order failed on a good line: {error:?}"))?;
            done += 1;
            if done < TELEGRAMS {
                due[end as usize] = machine.step(now, Input::Order(Order::Send(&payload)), &mut plug);
            }
        }
        Ok::<u64, Failure>(done)
    };
    for end in End::BOTH {
        step(&mut line, &mut due, 0, end, Input::Tick)?;
    }
    step(&mut line, &mut due, 0, End::A, Input::Order(Order::Send(&payload)))?;
    let mut buffer = [0; 64];
    let mut ended = 0;
    while ended < TELEGRAMS {
        let next = due.into_iter().flatten().chain(line.next_event()).min();
        now = next.ok_or("both machines wait for ever")?.max(now);
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            let input = match event {
                SimEvent::Rx(count) => Input::Rx(&buffer[..count]),
                SimEvent::TxDone => Input::TxDone,
                SimEvent::Fault(_) | SimEvent::Cts(_) => continue,
            };
            ended = step(&mut line, &mut due, now, end, input)?;
        }
        for end in End::BOTH {
            if due[end as usize].is_some_and(|at| at <= now) {
                ended = step(&mut line, &mut due, now, end, Input::Tick)?;
            }
        }
    }
    let cost = begin.elapsed().as_nanos() as f64 / TELEGRAMS as f64;
    if delivered < (TELEGRAMS - 1) * PAYLOAD as u64 {
        return Err(format!("{delivered} bytes arrived of {TELEGRAMS} telegrams").into());
    }
    Ok(Run { rate: (TELEGRAMS * PAYLOAD as u64) as f64 * SECOND as f64 / now as f64, cost })
}

/// The most a protocol leaves: user data by the time of its characters and pauses.
fn most(baud: u32, characters: usize, pause: Nanos) -> f64 {
    let time = (u64::from(HALF_BITS) * 500_000_000).div_ceil(u64::from(baud)) * characters as u64 + pause;
    PAYLOAD as f64 * SECOND as f64 / time as f64
}

/// Runs the measurement: throughput at the machines, their cost, and end to end.
///
/// # Errors
/// When an order fails, or the stations cannot be built.
pub fn measure() -> Result<Vec<Figure>, Failure> {
    let mut figures = Vec::new();
    let mut cost = None;
    for (baud, [r3964, s3964, stx_etx, ascii], through) in BAUDS {
        let char_time = (u64::from(HALF_BITS) * 500_000_000).div_ceil(u64::from(baud));
        let of_3964 = |bcc, priority| {
            let config = s3964::Config { priority, ..s3964::Config::cp240(bcc, char_time) };
            Box::new(<S3964>::new(config)) as Box<dyn Machine>
        };
        let pair = |bcc| [of_3964(bcc, s3964::Priority::High), of_3964(bcc, s3964::Priority::Low)];
        // STX, DLE, user data, DLE, ETX (, BCC), DLE; ZNA is 0.
        let run_r = run(pair(true), baud)?;
        let theory = most(baud, PAYLOAD + 6, 0);
        figures.push(figure(r3964, run_r.rate, theory, Some(0.95)));
        cost = Some(run_r.cost);
        figures.push(figure(s3964, run(pair(false), baud)?.rate, most(baud, PAYLOAD + 5, 0), Some(0.95)));
        let framed = || {
            let config = stx_etx::Config {
                start: stx_etx::Flags::new([2, 0], 1),
                end: stx_etx::Flags::new([3, 0], 1),
                ..stx_etx::Config::cp240(char_time)
            };
            Box::new(<StxEtx>::new(config)) as Box<dyn Machine>
        };
        let run_stx = run([framed(), framed()], baud)?;
        figures.push(figure(stx_etx, run_stx.rate, most(baud, PAYLOAD + 2, 0), Some(0.95)));
        // Telegrams are told apart by pauses: ZNA longer than the receiver's ZVZ.
        let bare = || {
            let config = ascii::Config { zna: 20 * MS, zvz: 0, ..ascii::Config::cp240(char_time) };
            Box::new(<Ascii>::new(config)) as Box<dyn Machine>
        };
        figures.push(figure(ascii, run([bare(), bare()], baud)?.rate, most(baud, PAYLOAD, 20 * MS), Some(0.95)));
        figures.push(figure(through, end_to_end(baud)?, theory, None));
    }
    let cost = cost.ok_or("nothing was measured")?;
    figures.push(Figure {
        what: "3964R telegram of 250 bytes, two machines",
        value: cost,
        unit: "ns",
        floor: None,
        aim: ("", true),
    });
    Ok(figures)
}

fn figure(what: &'static str, rate: f64, theory: f64, aim: Option<f64>) -> Figure {
    Figure {
        what,
        value: rate,
        unit: "B/s",
        floor: Some(("the protocol's own maximum", theory)),
        aim: match aim {
            Some(least) => (">= 0.95 x", rate >= least * theory),
            None => ("", true),
        },
    }
}

/// Both stations of `bench/line` in the whole-station simulation: telegrams of 250 bytes, one behind the other.
fn end_to_end(baud: u32) -> Result<f64, Failure> {
    let folder = std::env::temp_dir().join(format!("ob1-bench-line-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let done = |duration: Nanos| -> Result<u32, Failure> {
        let stations = write_stations(&folder, baud)?;
        let scenario =
            Scenario { stations, seed: 1, duration, faults: FaultRates::NONE, coalesce: 0, kill_every: 0, wire: false };
        let outcome = sim::run(&scenario)?;
        outcome.stations.iter().map(|station| station.ledger(20, 0)).max().ok_or_else(|| "no station".into())
    };
    // The start-up is not part of it.
    let (first, second) = (20 * SECOND, 120 * SECOND);
    let telegrams = done(second)?.saturating_sub(done(first)?);
    std::fs::remove_dir_all(&folder)?;
    Ok(f64::from(telegrams) * PAYLOAD as f64 * SECOND as f64 / (second - first) as f64)
}

fn write_stations(folder: &std::path::Path, baud: u32) -> Result<Vec<PathBuf>, Failure> {
    let mut stations = Vec::new();
    for (name, program, line, priority) in [
        ("bench-sender", include_str!("line/sender.awl"), "pty:bench.pty", "high"),
        ("bench-receiver", include_str!("line/receiver.awl"), "serial:bench.pty", "low"),
    ] {
        std::fs::write(folder.join(format!("{name}.awl")), program)?;
        let text = format!(
            "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"1ms\"\n[program]\nsources = [\"{name}.awl\"]\n[[plugin]]\npath = \
             \"ob1_cp240\"\n[[module]]\ntype = \"cp240\"\nname = \"cp\"\naddress = 0\nline = \"{line}\"\nparams = {{ protocol = \"3964r\", \
             baud = {baud}, priority = \"{priority}\" }}\n"
        );
        let path = folder.join(format!("{name}.toml"));
        std::fs::write(&path, text)?;
        stations.push(path);
    }
    Ok(stations)
}
