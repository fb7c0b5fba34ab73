//! A bus without its process: what the modules show and report, at which cycle control point.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};

use ob1_backplane::{BusProcessSide, CpSide, Segment};
use ob1_coupler::{Refusal, State, Table};
use ob1_model::Event;
use ob1_time::{Instant, Span};

use super::*;
use crate::module::Life;
use crate::supervisor::{Exit, Report};

const MS: Span = Span::MILLISECOND;

/// A process as tests have it.
#[derive(Default)]
struct Process {
    running: AtomicBool,
    reports: Mutex<VecDeque<Report>>,
}

struct Link(Arc<Process>);

impl DriverLink for Link {
    fn ring(&mut self) {}
    fn is_running(&self) -> bool {
        self.0.running.load(Ordering::Relaxed)
    }
    fn next_report(&mut self) -> Option<Report> {
        self.0.reports.lock().ok()?.pop_front()
    }
    fn life(&self) -> Life {
        Life { attempts: 1, incidents: 0 }
    }
}

struct Bench {
    process: Arc<Process>,
    cp: CpSide,
    side: BusProcessSide,
    modules: Vec<Box<dyn Module>>,
    now: Instant,
}

/// Two stations of two bytes each way; the second holds its inputs.
fn bench() -> Bench {
    bench_with(false)
}

fn bench_with(interrupts: bool) -> Bench {
    let (segment, memory) = (Segment::heap(), BusMemory::heap());
    let cpu = CpuSide::create(&segment, 8).expect("a segment");
    let size = BusSize::new(2, 4, 4).expect("it fits");
    let process = Arc::new(Process::default());
    let station =
        |number| Station { diagnostic: 2046 - u16::from(number), number, lost_after: 300 * MS, interrupts, dp: None };
    let rules = StationRules { diagnostic: 2047, number: 1 };
    let link = Box::new(Link(Arc::clone(&process)));
    let bus = Bus::new(cpu, link, &memory, size, 4, vec![station(1), station(2)], rules);
    let module = |station: usize, on_loss| {
        let place = (2 * station, 2);
        bus.module(BusModuleConfig {
            station,
            slot: 1,
            inputs: place,
            input_range: Some(0),
            outputs: place,
            on_loss,
            speaks: true,
        })
    };
    let modules = vec![module(0, OnLoss::Substitute(vec![0xAA, 0xBB])), module(1, OnLoss::Hold)];
    process.running.store(true, Ordering::Relaxed);
    let mut cp = CpSide::attach(&segment).expect("attached");
    cp.set_state(DriverState::Ready);
    let mut bench = Bench { process, cp, side: BusProcessSide::new(&memory, size), modules, now: Instant::START };
    bench.modules.iter_mut().for_each(|module| module.cpu_state(true));
    bench
}

impl Bench {
    fn publish(&mut self, states: [State; 2], inputs: [u8; 4]) {
        self.publish_all(states.map(|state| Status { state, ..Status::default() }), inputs);
    }

    fn publish_all(&mut self, status: [Status; 2], inputs: [u8; 4]) {
        self.side.publish(status.map(Status::to_words).into_iter(), &inputs);
    }

    /// A scan: the image of both, and the numbers of all events.
    fn scan(&mut self) -> ([u8; 4], Vec<u16>) {
        self.now += 10 * MS;
        let now = self.now;
        self.modules.iter_mut().for_each(|module| module.begin_scan(now));
        let mut events = Vec::new();
        for module in &mut self.modules {
            while let Some(event) = module.poll_event() {
                events.push(event.event.0);
            }
        }
        let mut image = [0x55; 4];
        let (first, second) = image.split_at_mut(2);
        let _ = (self.modules[0].read_image(first), self.modules[1].read_image(second));
        self.modules.iter_mut().for_each(|module| module.end_scan(now));
        (image, events)
    }

    fn report(&self, report: Report) {
        self.process.reports.lock().expect("not poisoned").push_back(report);
    }
}

#[test]
fn a_station_that_was_lost_and_came_back_between_two_scans_is_told_both() {
    let mut bench = bench();
    let with = |losses| Status { state: State::Running, losses, ..Status::default() };
    bench.publish_all([with(0), with(7)], [1, 2, 3, 4]);
    assert_eq!(bench.scan(), ([1, 2, 3, 4], vec![]), "what was lost before it came is nobody's affair");
    bench.publish_all([with(1), with(7)], [5, 6, 7, 8]);
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 7, 8], vec![Event::STATION_FAILED.0]));
    bench.publish_all([with(1), with(9)], [5, 6, 7, 9]);
    let events = vec![Event::STATION_BACK.0, Event::STATION_FAILED.0];
    assert_eq!(bench.scan(), ([5, 6, 7, 8], events), "two losses are one to who did not look");
    assert_eq!(bench.scan(), ([5, 6, 7, 9], vec![Event::STATION_BACK.0]), "also without another image");
}

#[test]
fn a_station_comes_goes_and_returns_each_at_one_cycle_control_point() {
    use State::{Lost, Running, Starting};
    let mut bench = bench();
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 0, 0], vec![]), "starting: nobody is missed");
    let mut byte = [0];
    assert_eq!(bench.modules[0].read(0, &mut byte), Ok(()));
    bench.publish([Running, Starting], [1, 2, 3, 4]);
    assert_eq!(bench.scan(), ([1, 2, 0, 0], vec![]), "the first time is no return");
    bench.publish([Running, Running], [5, 6, 7, 8]);
    assert_eq!(bench.scan(), ([5, 6, 7, 8], vec![]));
    bench.publish([Lost, Lost], [9, 9, 9, 9]);
    let (image, events) = bench.scan();
    assert_eq!((image, events), ([0xAA, 0xBB, 7, 8], vec![0x39C4, 0x39C4]));
    assert_eq!(bench.modules[0].read(0, &mut byte), Err(ModuleError::Absent));
    assert_eq!(bench.modules[0].write(0, &[1]), Err(ModuleError::Absent));
    bench.publish([Lost, Lost], [9, 9, 9, 9]);
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 7, 8], vec![]), "told once");
    bench.publish([Lost, Running], [1, 2, 3, 4]);
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 3, 4], vec![0x38C4]));
}

#[test]
fn the_end_of_the_process_is_one_failure_of_the_bus_and_each_station_returns_by_itself() {
    use State::{Running, Starting};
    let mut bench = bench();
    bench.publish([Running, Running], [1, 2, 3, 4]);
    bench.scan();
    // The scan sees it before the supervisor has reported it.
    bench.process.running.store(false, Ordering::Relaxed);
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 3, 4], vec![0x39C3]));
    bench.report(Report::Lost(Exit::Signal(9)));
    assert_eq!(bench.scan().1, vec![]);
    bench.process.running.store(true, Ordering::Relaxed);
    bench.cp.set_state(DriverState::Starting);
    bench.report(Report::Up(2));
    assert_eq!(bench.scan().1, vec![Event::DRIVER_UP.0]);
    // What the dead process has left is not trusted, nor is one that has not exchanged anything.
    bench.publish([Starting, Starting], [0; 4]);
    bench.cp.set_state(DriverState::Ready);
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 3, 4], vec![]));
    bench.publish([Running, Starting], [5, 6, 0, 0]);
    assert_eq!(bench.scan(), ([5, 6, 3, 4], vec![0x38C4]));
    bench.publish([Running, Running], [5, 6, 7, 8]);
    assert_eq!(bench.scan(), ([5, 6, 7, 8], vec![0x38C4]));
}

#[test]
fn a_process_that_is_back_before_the_scan_has_looked_is_a_failure_and_a_return() {
    let mut bench = bench();
    bench.publish([State::Running; 2], [1, 2, 3, 4]);
    bench.scan();
    bench.report(Report::Lost(Exit::Signal(9)));
    bench.publish([State::Running; 2], [5, 6, 7, 8]);
    assert_eq!(bench.scan(), ([5, 6, 7, 8], vec![0x39C3, 0x38C4, 0x38C4]));
    assert_eq!(bench.scan().1, vec![]);
}

#[test]
fn a_process_that_publishes_nothing_has_lost_its_stations() {
    let mut bench = bench();
    bench.publish([State::Running; 2], [1, 2, 3, 4]);
    let events: Vec<u16> = (0..30).flat_map(|_| bench.scan().1).collect();
    assert_eq!(events, [], "300 ms are not over");
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 3, 4], vec![0x39C4, 0x39C4]));
    bench.publish([State::Running; 2], [1, 2, 3, 4]);
    assert_eq!(bench.scan().1, [0x38C4, 0x38C4]);
    // The scan stood still: that is not the process's silence.
    bench.now += 5000 * MS;
    assert_eq!(bench.scan().1, []);
}

#[test]
fn a_station_that_was_missing_at_the_start_up_is_told_again_and_so_marked() {
    let mut bench = bench();
    bench.publish([State::Lost, State::Running], [0; 4]);
    bench.now += MS;
    bench.modules[0].begin_scan(bench.now);
    let event = bench.modules[0].poll_event().expect("lost");
    assert_eq!((event.event, &event.data[..7]), (Event::STATION_FAILED, &[7, 0xFD, 7, 0xFF, 1, 1, 1][..]));
    assert_eq!(bench.scan().1, []);
    bench.modules.iter_mut().for_each(|module| module.cpu_state(false));
    bench.modules.iter_mut().for_each(|module| module.cpu_state(true));
    assert_eq!(bench.scan().1, [0x39C4]);
}

#[test]
fn a_refusal_is_told_in_words_and_spoils_its_range_alone() {
    let mut bench = bench();
    let refusal = Some(Refusal { function: 3, exception: 2, table: Table::Holding, first: 100 });
    let status = Status { state: State::Running, refusal, bad: 1, ..Status::default() };
    bench
        .side
        .publish([status.to_words(), Status { refusal: None, bad: 2, ..status }.to_words()].into_iter(), &[1, 2, 3, 4]);
    bench.now += MS;
    bench.modules[0].begin_scan(bench.now);
    let event = bench.modules[0].poll_event().expect("told");
    assert_eq!(event.event, Event::STATION_REFUSES);
    assert_eq!(std::str::from_utf8(&event.data[..usize::from(event.len)]), Ok("03h 100: 02h"));
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 3, 4], vec![]), "the second refuses another range");
    bench.publish([State::Running; 2], [1, 2, 3, 4]);
    assert_eq!(bench.scan(), ([1, 2, 3, 4], vec![Event::STATION_ACCEPTS.0]));
}

/// A coupler that refuses and accepts in turn, at each exchange: it does not push everything else out of the diagnostic
/// buffer, and its last word is told.
#[test]
fn a_station_that_flaps_has_its_limit() {
    for (interrupts, most) in [(false, 16..=18), (true, 64..=175)] {
        let mut bench = bench_with(interrupts);
        let refusal = Some(Refusal { function: 3, exception: 2, table: Table::Holding, first: 100 });
        let of = |refusal| Status { state: State::Running, refusal, ..Status::default() };
        let mut told = Vec::new();
        // More than ten seconds; it accepts in the end.
        for round in 0..1100 {
            bench.publish_all([of(refusal.filter(|_| round % 2 == 0)), of(None)], [0; 4]);
            told.extend(bench.scan().1);
        }
        assert!(most.contains(&told.len()), "{interrupts}: {}", told.len());
        for _ in 0..1100 {
            bench.publish_all([of(None); 2], [0; 4]);
            told.extend(bench.scan().1);
        }
        assert_eq!(told.last(), Some(&Event::STATION_ACCEPTS.0), "{interrupts}");
    }
}

#[test]
fn a_refusal_that_interrupts_says_what_is_refused_too() {
    let mut bench = bench_with(true);
    let refusal = Some(Refusal { function: 0x17, exception: 11, table: Table::Holding, first: u16::MAX });
    let status = Status { state: State::Running, refusal, bad: 1, ..Status::default() };
    bench.publish_all([status; 2], [1, 2, 3, 4]);
    bench.modules[0].begin_scan(bench.now + MS);
    let event = bench.modules[0].poll_event().expect("told");
    assert!(event.diagnostic_interrupt);
    let data = &event.data[..usize::from(event.len)];
    assert_eq!((&data[..4], std::str::from_utf8(&data[4..])), (&[0x0D, 0x13, 0, 0][..], Ok("17h 65535:11")));
}

#[test]
fn outputs_go_out_whole_at_the_end_of_a_scan_and_off_in_stop() {
    let mut bench = bench();
    bench.publish([State::Running; 2], [0; 4]);
    bench.scan();
    let mut bytes = [0; 4];
    while bench.side.take(&mut bytes).is_some() {}
    bench.modules[0].write(0, &[1, 2]).expect("present");
    assert_eq!(bench.side.take(&mut bytes), None, "not before the end");
    bench.modules[1].write(1, &[3]).expect("present");
    bench.scan();
    assert_eq!((bench.side.take(&mut bytes), bytes), (Some(true), [1, 2, 0, 3]));
    bench.modules.iter_mut().for_each(|module| module.cpu_state(false));
    assert_eq!((bench.side.take(&mut bytes), bytes), (Some(false), [0; 4]));
    assert_eq!(bench.modules[0].write(1, &[1, 2]), Err(ModuleError::Outside));
}

#[test]
fn noise_is_a_lost_station() {
    let mut bench = bench();
    bench.publish([State::Running; 2], [1, 2, 3, 4]);
    bench.scan();
    bench.side.publish([[u64::MAX; 8]; 2].into_iter(), &[9; 4]);
    assert_eq!(bench.scan(), ([0xAA, 0xBB, 3, 4], vec![0x39C4, 0x39C4]));
}

/// A DP slave of two bytes each way, at its diagnostic address 2046; after its inputs a diagnosis of up to 16 bytes.
fn slave_bench(interrupts: bool) -> Bench {
    let (segment, memory) = (Segment::heap(), BusMemory::heap());
    let cpu = CpuSide::create(&segment, 8).expect("a segment");
    let size = BusSize::new(1, 2 + 17, 2).expect("it fits");
    let process = Arc::new(Process::default());
    let dp = Some(DpStation { diagnosis: (2, 16), ident: 0x801D, master: 2 });
    let station = Station { diagnostic: 2046, number: 8, lost_after: 300 * MS, interrupts, dp };
    let link = Box::new(Link(Arc::clone(&process)));
    let bus = Bus::new(cpu, link, &memory, size, 2, vec![station], StationRules { diagnostic: 2047, number: 1 });
    let itself = bus.module(BusModuleConfig { speaks: true, ..BusModuleConfig::default() });
    let slot = bus.module(BusModuleConfig { inputs: (0, 2), outputs: (0, 2), ..BusModuleConfig::default() });
    let modules = vec![itself, slot];
    process.running.store(true, Ordering::Relaxed);
    let mut cp = CpSide::attach(&segment).expect("attached");
    cp.set_state(DriverState::Ready);
    let mut bench = Bench { process, cp, side: BusProcessSide::new(&memory, size), modules, now: Instant::START };
    bench.modules.iter_mut().for_each(|module| module.cpu_state(true));
    bench
}

impl Bench {
    /// What the slave is, and the number and bytes of its diagnosis; then the events of a scan.
    fn slave(&mut self, state: State, number: u64, diagnosis: &[u8]) -> Vec<ModuleEvent> {
        let mut inputs = [0; 19];
        inputs[2] = diagnosis.len() as u8;
        inputs[3..3 + diagnosis.len()].copy_from_slice(diagnosis);
        let status = Status { state, diagnosis: number, ..Status::default() };
        self.side.publish([status.to_words()].into_iter(), &inputs);
        self.now += 10 * MS;
        let now = self.now;
        self.modules.iter_mut().for_each(|module| module.begin_scan(now));
        self.modules
            .iter_mut()
            .flat_map(|module| std::iter::from_fn(|| module.poll_event()).collect::<Vec<_>>())
            .collect()
    }
}

#[test]
fn a_fault_that_a_slave_reports_is_told_when_it_comes_and_when_it_goes() {
    let good = [0, 0x0C, 0, 2, 0x80, 0x1D];
    let broken = [8, 0x0C, 0, 2, 0x80, 0x1D, 0x42, 0b1000, 0x83, 0x42, 0x26];
    for interrupts in [true, false] {
        let mut bench = slave_bench(interrupts);
        assert_eq!(bench.slave(State::Running, 1, &good), []);
        let told = bench.slave(State::Running, 2, &broken);
        let [event] = told[..] else { panic!("{told:?}") };
        assert_eq!((event.event, event.diagnostic_interrupt), (Event::STATION_FAULT, interrupts));
        let text = if interrupts { 4 } else { 0 };
        assert_eq!(&event.data[text..usize::from(event.len)], b"s4 c2 e6");
        if interrupts {
            assert_eq!(event.data[..4], [0x0D, 0x13, 0, 0]);
        }
        assert_eq!(bench.slave(State::Running, 2, &broken), [], "told once");
        let gone = bench.slave(State::Running, 3, &good);
        assert_eq!(gone.iter().map(|event| event.event).collect::<Vec<_>>(), [Event::STATION_FAULT_GONE]);
        assert!(gone[0].data[0] & 1 == 0);
    }
}

#[test]
fn the_diagnosis_of_a_slave_is_a_record_at_its_diagnostic_address() {
    let mut bench = slave_bench(true);
    let mut into = [0; 240];
    assert_eq!(bench.modules[0].record_read(DP_DIAGNOSIS, &mut into), Err(ModuleError::Absent), "not yet");
    let good = [0, 0x0C, 0, 2, 0x80, 0x1D];
    bench.slave(State::Running, 1, &good);
    assert_eq!(bench.modules[0].record_read(DP_DIAGNOSIS, &mut into), Ok(6));
    assert_eq!(into[..6], good);
    assert_eq!(bench.modules[0].record_read(DP_DIAGNOSIS, &mut [0; 5]), Err(ModuleError::Outside));
    assert_eq!(bench.modules[0].record_read(0, &mut into), Err(ModuleError::NoRecord));
    assert_eq!(bench.modules[1].record_read(DP_DIAGNOSIS, &mut into), Err(ModuleError::NoRecord), "a slot");
    bench.slave(State::Lost, 1, &good);
    assert_eq!(bench.modules[0].record_read(DP_DIAGNOSIS, &mut into), Err(ModuleError::Absent), "lost");
    // The length that the process gives is not trusted.
    let mut inputs = [0; 19];
    inputs[2] = 200;
    let status = Status { state: State::Running, diagnosis: 9, ..Status::default() };
    bench.side.publish([status.to_words()].into_iter(), &inputs);
    bench.modules[0].begin_scan(bench.now + MS);
    assert_eq!(bench.modules[0].record_read(DP_DIAGNOSIS, &mut into), Err(ModuleError::Absent));
}

#[test]
fn a_slave_that_refuses_is_lost_and_says_why() {
    let mut bench = slave_bench(true);
    let refuses = [0x06, 0x05, 0, 0xFF, 0x80, 0x1D];
    let told = bench.slave(State::Refused, 1, &refuses);
    let numbers: Vec<u16> = told.iter().map(|event| event.event.0).collect();
    assert_eq!(numbers, [Event::STATION_FAILED.0, Event::STATION_REFUSES.0]);
    assert_eq!(&told[1].data[..usize::from(told[1].len)], b"config. fault");
    let mut into = [0; 240];
    assert_eq!(bench.modules[0].record_read(DP_DIAGNOSIS, &mut into), Ok(6), "it can be read all the same");
    assert_eq!(bench.slave(State::Refused, 2, &refuses), []);
    let told = bench.slave(State::Running, 3, &[0, 0x0C, 0, 2, 0x80, 0x1D]);
    assert_eq!(told.iter().map(|event| event.event).collect::<Vec<_>>(), [Event::STATION_BACK]);
}

/// It is up to 245 bytes a slave, and every slave is asked at every scan.
#[test]
fn a_diagnosis_is_read_when_there_is_something_new_in_it_and_not_otherwise() {
    let dp = Some(DpStation { diagnosis: (2, 16), ident: 0x801D, master: 2 });
    let station = Station { diagnostic: 2046, number: 8, lost_after: 300 * MS, interrupts: true, dp };
    let mut stations = Stations::new(vec![station], StationRules::default());
    let mut reads = |state, diagnosis| {
        let (mut reads, mut events) = (0, 0);
        for now in 0..20 {
            stations.look(Instant::START + now * MS, (true, true), true, |_| {
                Some(Status { state, diagnosis, ..Status::default() })
            });
            while let Some(_event) = stations.event(0, |_, _| reads += 1) {
                events += 1;
            }
        }
        (reads, events)
    };
    assert_eq!(reads(State::Starting, 1), (0, 0));
    assert_eq!(reads(State::Running, 1), (1, 0));
    assert_eq!(reads(State::Running, 2), (1, 0));
    assert_eq!(reads(State::Lost, 3), (0, 1));
    assert_eq!(reads(State::Refused, 4), (1, 1), "why it refuses");
    assert_eq!(reads(State::Running, 4), (1, 1), "back, and looked at");
}
