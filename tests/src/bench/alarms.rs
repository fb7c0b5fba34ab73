//! What alarms cost the process of the scan: a program that makes five messages with a value in each scan, and four
//! displays that get them. The time of the scan and that of the broker are taken, with and without messages, in turns.

use std::time::{Duration, Instant};

use ob1_access::Right;
use ob1_access::door::{Ask, Door, News};
use ob1_broker::{Broker, LinkConfig, feed};
use ob1_cpu::{Cell, Command, Cpu, CpuConfig, OperatingState, Width, system_blocks};
use ob1_model::{Area, Displays};
use ob1_native::{AtLoad, Tier};
use ob1_rt::MonotonicClock;
use ob1_socket::handover;
use ob1_stl::{Library, Options, Source};
use ob1_time::Span;

use super::peer::Failure;
use super::{Figure, median};
use crate::sim::facts::Bare;

/// Messages of a scan.
const MESSAGES: u32 = 5;
const DISPLAYS: u32 = 4;
const SCANS: u32 = 4_000;
const ROUNDS: usize = 9;
/// Messages a second that the figure is for, and what they may cost of a core.
const RATE: f64 = 1_000.0;
const MOST: f64 = 0.02;

/// The signal is inverted in each scan, as SFC 108 wants it, if M 1.0 is set; otherwise it stays.
fn program() -> String {
    let call = |id| {
        format!(
            "CALL SFC 108 (SIG := M 0.0, ID := W#16#EEEE, EV_ID := DW#16#{id}, CMP_ID := DW#16#1, SD := MD 4,\n\
             RET_VAL := MW 8);\n"
        )
    };
    let calls: String = (1..=MESSAGES).map(call).collect();
    format!(
        "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL MD 4; + 1; T MD 4;\nUN M 1.0; SPB end;\nUN M 0.0; = M 0.0;\n{calls}\
         end: NOP 0;\nEND_ORGANIZATION_BLOCK\n"
    )
}

struct Bench {
    cpu: Cpu,
    broker: Broker,
    door: Door,
    clock: MonotonicClock,
}

/// Nanoseconds of a scan and of the broker, and the messages that all displays have got together.
#[derive(Clone, Copy, Default)]
struct Taken {
    scan: f64,
    broker: f64,
    got: u64,
}

impl Bench {
    fn new() -> Result<Self, Failure> {
        let natives = system_blocks();
        let mut library = Library::new();
        for block in &natives {
            library.insert(block.id(), block.name(), block.interface().clone());
        }
        let source = Source::new("bench.awl", program().into_bytes());
        let output = ob1_stl::compile(&[source], &library, &Options::default());
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let cpu = Cpu::new(config, &output.program, natives, Vec::new(), &AtLoad(Tier::Optimised));
        let mut cpu = cpu.map_err(|why| format!("{why:?}"))?;
        let link = LinkConfig { name: "bench".into(), rights: Right::Read, ..LinkConfig::default() };
        let mut broker = Broker::new(&mut cpu, vec![link], feed().1, Box::new(Bare))?;
        let (ours, theirs) = handover::pair()?;
        let clock = MonotonicClock::start();
        broker.connect(0, ours, clock.time());
        let mut door = Door::new(theirs)?;
        for client in 1..=DISPLAYS {
            door.ask(client, Ask::LogOn { displays: Displays(Displays::ALARMS), name: format!("display {client}") });
        }
        cpu.request(Command::Warm);
        let mut bench = Self { cpu, broker, door, clock };
        bench.round(false)?;
        Ok(bench)
    }

    fn round(&mut self, with: bool) -> Result<Taken, Failure> {
        self.cpu.write(Cell::Area(Area::Memory, 8), Width::Bit, u32::from(with)).map_err(|why| format!("{why:?}"))?;
        let (mut scan, mut broker, mut got) = (Duration::ZERO, Duration::ZERO, 0);
        for _ in 0..SCANS {
            let from = Instant::now();
            if self.cpu.cycle(&mut self.clock).state != OperatingState::Run {
                return Err("the CPU is in STOP".into());
            }
            let between = Instant::now();
            self.broker.step(self.clock.time());
            broker += between.elapsed();
            scan += between - from;
            // The displays are in other processes.
            self.door.pump()?;
            while let Some(news) = self.door.take_news() {
                if let News::Alarm { client, event } = news {
                    self.door.handed(client, event.number);
                    got += 1;
                }
            }
            self.door.pump()?;
        }
        let each = |time: Duration| time.as_nanos() as f64 / f64::from(SCANS);
        Ok(Taken { scan: each(scan), broker: each(broker), got })
    }
}

/// # Errors
/// The program cannot be made or run.
pub fn measure() -> Result<Vec<Figure>, Failure> {
    let mut bench = Bench::new()?;
    let (mut scans, mut brokers) = ([const { Vec::new() }; 3], [const { Vec::new() }; 3]);
    let mut got = 0;
    for _ in 0..ROUNDS {
        for (kind, with) in [false, true, false].into_iter().enumerate() {
            let taken = bench.round(with)?;
            scans[kind].push(taken.scan);
            brokers[kind].push(taken.broker);
            got += taken.got;
        }
    }
    let [idle, with, again] = scans.each_mut().map(|all| median(all));
    let [broker_idle, broker_with, _] = brokers.each_mut().map(|all| median(all));
    let each = (with - idle.max(again) + broker_with - broker_idle).max(0.0) / f64::from(MESSAGES);
    let share = each * RATE / 1e9;
    let expected = u64::from(MESSAGES) * u64::from(SCANS) * u64::from(DISPLAYS) * ROUNDS as u64;
    let figure = |what: &'static str, value, floor, aim| Figure { what: what.into(), value, unit: "ns", floor, aim };
    Ok(vec![
        figure("a scan without messages", again, Some(("the same", idle)), ("", true)),
        figure("a scan with 5 messages", with, Some(("without", idle)), ("", true)),
        figure("the broker, 5 messages to 4 displays", broker_with, Some(("without", broker_idle)), ("", true)),
        figure("a message, scan and broker", each, None, ("", true)),
        Figure {
            what: "1,000 messages a second, of a core".into(),
            value: share * 100.0,
            unit: "%",
            floor: None,
            aim: ("<= 2 %", share <= MOST),
        },
        Figure {
            what: "messages that came, of those that were made".into(),
            value: got as f64 / expected as f64 * 100.0,
            unit: "%",
            floor: None,
            aim: ("> 99 %", got as f64 >= 0.99 * expected as f64),
        },
    ])
}
