//! What recording costs: 64 signals at every scan, the scan with and without it in turns, and the thread beside it. And
//! an hour of scans of a millisecond in virtual time: no row is lost, and no memory is gained.

use std::time::{Duration, Instant};

use ob1_access::Names;
use ob1_cpu::{Clock, Command, Cpu, CpuConfig, OperatingState, RecordingClient, Rows};
use ob1_native::{AtLoad, Tier};
use ob1_record::{Capture, Head, Order, Writer};
use ob1_rt::MonotonicClock;
use ob1_stl::{Library, Options, Source};
use ob1_time::{Instant as PlcInstant, Span};

use super::peer::Failure;
use super::{Figure, median};

const SIGNALS: usize = 64;
const SCANS: u32 = 10_000;
const ROUNDS: usize = 15;
/// The scan that the aim is about, and how much of it recording may take.
const SCAN_NS: f64 = 100_000.0;
const MOST: f64 = 0.02;
/// Scans of the hour, and after how many the rows are taken: as often as the thread looks.
const HOUR: u64 = 3_600_000;
const LOOK: u64 = 5;
/// What memory may grow by in the hour, in KiB.
const GROWTH: f64 = 1024.0;

/// OB 1 counts in what is recorded: flags, two data blocks, bits.
fn program() -> String {
    let db =
        |number| format!("DATA_BLOCK DB {number}\nSTRUCT a: ARRAY[0..99] OF INT; END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n");
    let code: String = (0..16)
        .map(|at| format!("L DB1.DBW {0}; + {1}; T DB1.DBW {0}; T MW {2};\n", 6 * at, at + 1, 20 + 2 * at))
        .collect();
    format!(
        "{}{}ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nUN M 0.0; = M 0.0;\n{code}END_ORGANIZATION_BLOCK\n",
        db(1),
        db(2)
    )
}

/// Bits, words and double words, scattered.
fn names() -> Vec<String> {
    (0..SIGNALS)
        .map(|at| match at % 4 {
            0 => format!("M{}.{}", at / 8, at % 8),
            1 => format!("DB1.DBW{}", 6 * (at / 4)),
            2 => format!("MW{}", 20 + at / 2),
            _ => format!("DB2.DBD{}", 4 * (at / 4)),
        })
        .collect()
}

/// Virtual time: a millisecond a scan.
struct Virtual(PlcInstant);

impl Clock for Virtual {
    fn now(&mut self) -> PlcInstant {
        self.0
    }

    fn executed(&mut self, _: u64) {}
}

struct Bench {
    cpu: Cpu,
    client: RecordingClient,
    clock: MonotonicClock,
    settings: ob1_record::Settings,
}

impl Bench {
    fn new() -> Result<Self, Failure> {
        let source = Source::new("bench.awl", program().into_bytes());
        let output = ob1_stl::compile(&[source], &Library::new(), &Options::default());
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let cpu = Cpu::new(config, &output.program, Vec::new(), Vec::new(), &AtLoad(Tier::Optimised));
        let mut cpu = cpu.map_err(|why| format!("{why:?}"))?;
        let order = Order { signals: names(), ..Order::default() };
        let settings = order.settle(&Names::new(&output.program), Span::MILLISECOND)?;
        let client = cpu.recording_client().ok_or("the recordings are taken already")?;
        cpu.request(Command::Warm);
        Ok(Self { cpu, client, clock: MonotonicClock::start(), settings })
    }

    fn start(&mut self) -> Result<(Capture, Rows, Vec<u8>), Failure> {
        let rows = self.settings.start(&mut self.client, Span::MILLISECOND)?;
        let head = Head { signals: self.settings.signals.clone(), ..Head::default() };
        Ok((Capture::new(self.settings.clone()), rows, Writer::begin(&head)))
    }

    /// Nanoseconds of a scan, and of the thread beside it for each row.
    fn round(&mut self, with: bool) -> Result<(f64, f64), Failure> {
        let mut clock = self.clock;
        let mut recording = if with { Some(self.start()?) } else { None };
        let (mut scan, mut thread) = (Duration::ZERO, Duration::ZERO);
        for _ in 0..SCANS / 100 {
            let from = Instant::now();
            for _ in 0..100 {
                if self.cpu.cycle(&mut clock).state != OperatingState::Run {
                    return Err("the CPU is in STOP".into());
                }
            }
            scan += from.elapsed();
            if let Some((capture, rows, file)) = &mut recording {
                let from = Instant::now();
                let _ = capture.take(rows, file, &|_| true);
                thread += from.elapsed();
                file.clear();
            }
        }
        if let Some((capture, ..)) = &recording
            && capture.count() != (u64::from(SCANS), 0)
        {
            return Err(format!("rows and losses: {:?}", capture.count()).into());
        }
        drop(recording);
        // It gives the memory back.
        self.cpu.cycle(&mut clock);
        let each = |time: Duration| time.as_nanos() as f64 / f64::from(SCANS);
        Ok((each(scan), each(thread)))
    }

    /// Rows lost, growth of the memory in KiB, bytes of the file and seconds it took.
    fn hour(&mut self) -> Result<(u64, f64, u64, f64), Failure> {
        let (from, mut clock) = (Instant::now(), Virtual(self.cpu.now()));
        let (mut capture, mut rows, mut file) = self.start()?;
        let (mut bytes, mut before) = (0, None);
        for scan in 1..=HOUR {
            clock.0 += Span::MILLISECOND;
            self.cpu.cycle(&mut clock);
            if scan % LOOK == 0 {
                let _ = capture.take(&mut rows, &mut file, &|_| true);
                bytes += file.len() as u64;
                file.clear();
            }
            if scan == HOUR / 60 {
                before = Some(ob1_rt::memory().resident_kib);
            }
        }
        let growth = ob1_rt::memory().resident_kib as f64 - before.unwrap_or_default() as f64;
        let (written, lost) = capture.count();
        Ok((lost + HOUR.saturating_sub(written), growth, bytes, from.elapsed().as_secs_f64()))
    }
}

/// # Errors
/// The program cannot be made or run, or a row is lost.
pub fn measure() -> Result<Vec<Figure>, Failure> {
    let mut bench = Bench::new()?;
    bench.round(true)?;
    let (mut scans, mut threads) = ([const { Vec::new() }; 3], Vec::new());
    for _ in 0..ROUNDS {
        for (kind, with) in [false, true, false].into_iter().enumerate() {
            let (scan, thread) = bench.round(with)?;
            scans[kind].push(scan);
            if with {
                threads.push(thread);
            }
        }
    }
    let [idle, with, again] = scans.each_mut().map(|all| median(all));
    let thread = median(&mut threads);
    let cost = (with - idle.min(again)).max(0.0);
    let (lost, growth, bytes, seconds) = bench.hour()?;
    let figure = |what: &'static str, value, unit: &'static str, aim| Figure {
        what: what.into(),
        value,
        unit,
        floor: None,
        aim,
    };
    Ok(vec![
        Figure { floor: Some(("the same", idle)), ..figure("a scan without a recording", again, "ns", ("", true)) },
        Figure { floor: Some(("without", idle)), ..figure("a scan with 64 signals recorded", with, "ns", ("", true)) },
        figure("64 signals, of a scan of 100 us", cost / SCAN_NS * 100.0, "%", ("<= 2 %", cost <= MOST * SCAN_NS)),
        figure("the thread beside it, for each row", thread, "ns", ("", true)),
        figure("an hour at 1 ms: rows lost", lost as f64, "", ("0", lost == 0)),
        figure("an hour at 1 ms: growth of memory", growth, "KiB", ("<= 1024", growth <= GROWTH)),
        figure("an hour at 1 ms: size of the file", bytes as f64 / 1048576.0, "MiB", ("", true)),
        figure("an hour at 1 ms: took", seconds, "s", ("", true)),
    ])
}
