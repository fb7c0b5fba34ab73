//! HOLD: breakpoints and single step, on every engine.

use ob1_cpu::{
    Answer, Ask, Clock, Command, CpuConfig, CyclicInterrupt, DebugJob, Job, Module, ModuleSlot, OperatingState,
};
use ob1_model::moment::Moment;
use ob1_model::{Breakpoint, DebugAnswer, DebugEnd, DebugOrder, Event, Held, Resume};
use ob1_time::{Instant, Span};

use crate::common::rack::TestModule;
use crate::common::random::Random;
use crate::common::window::{Client, Looker};
use crate::common::{self, Bench, MS, fb, fc, ob, on_each_engine};

const SECOND: u64 = Span::from_secs(1).nanos();

/// A programming device: while the CPU holds, its clock looks at what has come back and asks on.
struct Device<'a> {
    bench_now: &'a mut Instant,
    looker: &'a mut Looker,
    /// What is asked at each hold.
    script: &'a mut Vec<DebugOrder>,
    seen: &'a mut Vec<DebugAnswer>,
    /// It has held in this cycle.
    begun: bool,
    /// Looks at the CPU in HOLD.
    ticks: &'a mut u32,
    /// Its outputs are safe at every look.
    module: Option<&'a TestModule>,
}

const PER_STATEMENT: Span = Span::from_nanos(100);

impl Device<'_> {
    fn serve(&mut self) {
        while let Some(Job::Debug(job)) = self.looker.link.take() {
            let answer = job.into_answer();
            // What was asked before the hold has its answers first.
            let goes_on = answer.end == DebugEnd::Held || self.begun && answer.end == DebugEnd::Done;
            self.begun |= goes_on;
            self.seen.push(answer);
            if goes_on && !self.script.is_empty() {
                self.looker.link.hand(DebugJob::new(9, self.script.remove(0))).expect("room");
            }
        }
    }
}

impl Clock for Device<'_> {
    fn now(&mut self) -> Instant {
        *self.bench_now
    }
    fn executed(&mut self, statements: u64) {
        *self.bench_now += statements * PER_STATEMENT;
    }
    fn statements_in(&self, time: Span) -> Option<u64> {
        Some(time.div_ceil(PER_STATEMENT))
    }
    fn wait(&mut self, deadline: Instant) {
        *self.bench_now = (*self.bench_now).max(deadline);
    }
    fn rest(&mut self, deadline: Instant) {
        self.wait(deadline);
        *self.ticks += 1;
        assert!(*self.ticks < 2000, "it holds for ever");
        if let Some(module) = self.module {
            module.look(|seen| assert_eq!(seen.disabled, [true], "safe at once, and told once"));
        }
        self.serve();
    }
}

struct Session {
    bench: Bench,
    client: Client,
    looker: Looker,
    seen: Vec<DebugAnswer>,
    ticks: u32,
    module: Option<TestModule>,
}

impl Session {
    fn of(source: &str, keys: &[&str]) -> Self {
        Self::with(common::source::bench(source, keys))
    }

    fn with(mut bench: Bench) -> Self {
        let looker = Looker::of(&mut bench.cpu).expect("the first");
        bench.run();
        let client = Client::of(&mut bench.cpu);
        Self { bench, client, looker, seen: Vec::new(), ticks: 0, module: None }
    }

    fn ask(&mut self, order: DebugOrder) {
        self.looker.link.hand(DebugJob::new(1, order)).expect("room");
    }

    /// A cycle; at each hold the next order of the script is asked.
    fn cycle(&mut self, script: Vec<DebugOrder>) -> OperatingState {
        let left = self.cycle_of(script);
        assert!(left.is_none(), "not asked: {left:?}; {:?}", self.seen);
        self.bench.cpu.state()
    }

    /// The same; what was not asked.
    fn cycle_of(&mut self, script: Vec<DebugOrder>) -> Option<Vec<DebugOrder>> {
        let mut script = script;
        let mut device = Device {
            bench_now: &mut self.bench.clock.now,
            looker: &mut self.looker,
            script: &mut script,
            seen: &mut self.seen,
            begun: false,
            ticks: &mut self.ticks,
            module: self.module.as_ref(),
        };
        let end = self.bench.cpu.cycle(&mut device);
        device.serve();
        self.bench.clock.now = self.bench.clock.now.max(end.next_deadline);
        (!script.is_empty()).then_some(script)
    }

    /// Where it held: block and statement of the innermost, and how deep.
    fn holds(&self) -> Vec<(String, u32, usize)> {
        let held = self.seen.iter().filter(|answer| answer.end == DebugEnd::Held);
        held.map(|answer| {
            let inner = answer.held.stack[0];
            (inner.block.to_string(), inner.statement, answer.held.stack.len())
        })
        .collect()
    }

    /// What the CPU's calendar shows.
    fn date(&mut self) -> Moment {
        self.client.ask(1, [Ask::Clock]);
        self.cycle(vec![]);
        match self.client.answer().expect("answered") {
            Answer::Clock(bytes) => Moment::from_bytes(bytes).expect("a date"),
            other => panic!("{other:?}"),
        }
    }

    fn events(&self) -> Vec<Event> {
        let mut events: Vec<Event> = self.bench.cpu.diagnostics().map(|entry| entry.event).collect();
        events.reverse();
        events
    }
}

fn at(block: ob1_model::BlockId, statement: u32) -> DebugOrder {
    DebugOrder::Breakpoints(vec![Breakpoint { block, statement }])
}

fn wait() -> DebugOrder {
    DebugOrder::Hold { resume: None, wait: SECOND }
}

fn go(resume: Resume) -> DebugOrder {
    DebugOrder::Hold { resume: Some(resume), wait: SECOND }
}

const PROGRAM: &str = "FUNCTION FC 5 : VOID\nBEGIN\nL 3;\nL 4;\n+I;\nT MW 2;\nEND_FUNCTION\n\
    FUNCTION_BLOCK FB 6\nVAR_INPUT\n a : INT;\nEND_VAR\nBEGIN\nL #a;\nCALL FC 5;\nL 9;\nT MW 4;\nEND_FUNCTION_BLOCK\n\
    DATA_BLOCK DB 6\nFB 6\nBEGIN\nEND_DATA_BLOCK\n\
    ORGANIZATION_BLOCK OB 1\nBEGIN\nL MW 0;\n+ 1;\nT MW 0;\nCALL FB 6, DB 6 (a := 7);\nU M 8.0;\nL S5T#1S;\nSE T 1;\n\
    END_ORGANIZATION_BLOCK\n";

#[test]
fn it_holds_before_the_statement_and_shows_registers_and_the_way_there() {
    on_each_engine(|| {
        let mut s = Session::of(PROGRAM, &[]);
        s.ask(at(fc(5), 2));
        s.ask(wait());
        s.bench.set_m(4, 0, false);
        assert_eq!(s.cycle(vec![DebugOrder::Breakpoints(vec![]), go(Resume::Run)]), OperatingState::Run);
        assert_eq!(s.holds(), [("FC 5".to_owned(), 2, 3)]);
        let Held { stack, accus, .. } = &s.seen.iter().find(|answer| answer.end == DebugEnd::Held).expect("one").held;
        assert_eq!(accus[..2], [4, 3]);
        let way: Vec<_> = stack.iter().map(|block| (block.block, block.statement, block.ob)).collect();
        assert_eq!(way, [(fc(5), 2, 1), (fb(6), 1, 1), (ob(1), 3, 1)]);
        assert_eq!(stack[1].blocks[1], 6, "the instance");
        assert_eq!((s.bench.mw(2), s.bench.mw(4)), (7, 9), "and went on");
        assert_eq!(s.events()[2..], [Event::HOLD, Event::HOLD_LEFT]);
        // Without breakpoints it never holds again.
        let ticks = s.ticks;
        s.cycle(vec![]);
        assert_eq!(s.ticks, ticks);
    });
}

#[test]
fn it_goes_into_over_and_out_of_calls() {
    on_each_engine(|| {
        let mut s = Session::of(PROGRAM, &[]);
        s.ask(at(ob(1), 3));
        s.ask(wait());
        let script = [Resume::Into, Resume::Into, Resume::Into, Resume::Out, Resume::Out, Resume::Over, Resume::Over];
        let script = script.map(go).into_iter().chain([DebugOrder::Breakpoints(vec![]), go(Resume::Run)]);
        s.cycle(script.collect());
        let places: Vec<_> =
            s.holds().into_iter().map(|(block, statement, _)| format!("{block} {statement}")).collect();
        assert_eq!(places, ["OB 1 3", "FB 6 0", "FB 6 1", "FC 5 0", "FB 6 2", "OB 1 4", "OB 1 5", "OB 1 6"]);
        s.cycle(vec![]);
        s.ask(at(ob(1), 3));
        s.ask(wait());
        s.cycle(vec![go(Resume::Over), DebugOrder::End]);
        let last = s.holds().pop().expect("held");
        assert_eq!((last.0.as_str(), last.1), ("OB 1", 4), "over the call");
    });
}

#[test]
fn time_stands_still_and_the_date_goes_on() {
    let cyclic = "ORGANIZATION_BLOCK OB 35\nBEGIN\nL MW 20;\n+ 1;\nT MW 20;\nEND_ORGANIZATION_BLOCK\n\
        ORGANIZATION_BLOCK OB 1\nBEGIN\nSET;\nL S5T#5S;\nU M 1.0;\nSE T 1;\nL T 1;\nT MW 30;\nL 0;\nT MW 40;\n\
        END_ORGANIZATION_BLOCK\n";
    on_each_engine(|| {
        let mut s = Session::of(cyclic, &[]);
        s.bench.set_m(1, 0, true);
        for _ in 0..20 {
            s.cycle(vec![]);
        }
        let (left, calls) = (s.bench.mw(30), s.bench.mw(20));
        let (now, date) = (s.bench.clock.now, s.date());
        s.ask(at(ob(1), 6));
        s.ask(wait());
        // A minute in HOLD: the device looks every second.
        let script: Vec<_> =
            std::iter::repeat_n(wait(), 1000).chain([DebugOrder::Breakpoints(vec![]), go(Resume::Run)]).collect();
        assert_eq!(s.cycle(script), OperatingState::Run, "no cycle monitoring");
        let passed = s.bench.clock.now.since(now);
        assert!(passed >= Span::from_secs(4), "{passed}");
        assert!(left - s.bench.mw(30) < 10, "the timer has stood still: {left} {}", s.bench.mw(30));
        assert_eq!(s.bench.mw(20) - calls, 0, "and OB 35");
        let gone = s.date().ms() - date.ms();
        assert!(gone.abs_diff(passed.millis()) < 10, "the date goes on: {gone} of {passed}");
        // From here on all goes at its pace.
        let (left, now) = (s.bench.mw(30), s.bench.clock.now);
        while s.bench.clock.now.since(now) < Span::from_secs(1) {
            s.cycle(vec![]);
            s.bench.clock.now += MS;
        }
        assert!(s.bench.mw(20) - calls >= 9, "{}", s.bench.mw(20));
        assert!(left > s.bench.mw(30));
    });
}

#[test]
fn stop_in_hold_is_obeyed() {
    on_each_engine(|| {
        let mut s = Session::of(PROGRAM, &[]);
        s.ask(at(fc(5), 1));
        s.ask(wait());
        assert_eq!(s.cycle(vec![DebugOrder::End]), OperatingState::Stop);
        assert_eq!(s.events()[2..], [Event::HOLD, Event::HOLD_STOPPED]);
        s.ask(go(Resume::Run));
        s.cycle(vec![]);
        assert_eq!(s.seen.last().map(|answer| answer.end), Some(DebugEnd::Stopped));
        s.bench.cpu.request(Command::Run);
        assert_eq!(s.cycle(vec![]), OperatingState::Run, "and no breakpoint is left");
    });
}

#[test]
fn what_is_not_there_is_refused_and_a_wait_ends() {
    on_each_engine(|| {
        let mut s = Session::of(PROGRAM, &[]);
        s.ask(DebugOrder::Breakpoints(vec![
            Breakpoint { block: fc(5), statement: 0 },
            Breakpoint { block: fc(5), statement: 5 },
        ]));
        s.ask(at(fc(77), 0));
        s.ask(DebugOrder::Hold { resume: Some(Resume::Into), wait: Span::from_millis(20).nanos() });
        for _ in 0..30 {
            s.cycle(vec![]);
            s.bench.clock.now += MS;
        }
        let ends: Vec<_> = s.seen.iter().map(|answer| answer.end).collect();
        assert_eq!(ends, [DebugEnd::NoStatement(1), DebugEnd::NoStatement(0), DebugEnd::Runs]);
    });
}

#[test]
fn outputs_are_safe_while_it_holds_and_come_back() {
    on_each_engine(|| {
        let source =
            "ORGANIZATION_BLOCK OB 1\nBEGIN\nSET;\n= A 4.0;\nL 77;\nT PAB 5;\nNOP 0;\nEND_ORGANIZATION_BLOCK\n";
        let module = TestModule::new(2);
        let slot = ModuleSlot::new("do", 4);
        let bench =
            common::source::bench_with(source, &[], CpuConfig::default(), vec![(slot, Box::new(module.clone()))]);
        let mut s = Session::with(bench);
        s.cycle(vec![]);
        module.look(|seen| assert_eq!(seen.outputs, [1, 77]));
        s.ask(at(ob(1), 4));
        s.ask(wait());
        s.cycle(vec![DebugOrder::Breakpoints(vec![]), go(Resume::Run)]);
        module.look(|seen| {
            assert_eq!((seen.disabled.as_slice(), seen.outputs.as_slice()), (&[true, false][..], &[1, 77][..]));
        });
        s.ask(at(ob(1), 4));
        s.ask(wait());
        s.cycle(vec![DebugOrder::End]);
        module.look(|seen| {
            assert_eq!(seen.disabled, [true, false, true]);
            assert_eq!((seen.states.last(), seen.outputs.as_slice()), (Some(&false), &[0, 0][..]));
        });
    });
}

/// Timers, an IEC timer, OB 35, OB 1 with branches and a loop, cycle monitoring of two cycles.
const TIMED: &str = "ORGANIZATION_BLOCK OB 35\nBEGIN\nL MW 20;\n+ 1;\nT MW 20;\nL T 1;\nT MW 22;\nEND_ORGANIZATION_BLOCK\n\
    DATA_BLOCK DB 4\nSFB 4\nBEGIN\nEND_DATA_BLOCK\n\
    FUNCTION FC 5 : VOID\nBEGIN\nL MB 10;\nL 3;\nUW;\nSPZ even;\nL MW 24;\n+ 5;\nT MW 24;\neven: NOP 0;\nEND_FUNCTION\n\
    ORGANIZATION_BLOCK OB 1\nBEGIN\nL MB 10;\n+ 1;\nT MB 10;\nU M 10.5;\nL S5T#30MS;\nSI T 1;\nL T 1;\nT MW 30;\n\
    U M 10.6;\nL S5T#2S;\nSE T 2;\nLC T 2;\nT MW 32;\nU T 2;\n= A 4.0;\nU M 10.4;\n= M 40.0;\n\
    CALL SFB 4, DB 4 (IN := M 40.0, PT := T#150MS, Q := A 4.1, ET := MD 44);\n\
    CALL FC 5;\nL 3;\nturn: T MW 50;\nL MW 52;\n+ 1;\nT MW 52;\nL MW 50;\nLOOP turn;\nEND_ORGANIZATION_BLOCK\n";

/// 1,000 HOLDs anywhere, short and long: beside a CPU that never held, not a tick is gained or lost.
#[test]
fn a_thousand_holds_leave_the_station_as_without_them() {
    on_each_engine(|| {
        let module = || TestModule::new(2);
        let of = |module: &TestModule| {
            let config = CpuConfig {
                cyclic: vec![CyclicInterrupt::new(35, MS * 7)],
                min_cycle: MS * 5,
                watchdog: MS * 10,
                ..CpuConfig::default()
            };
            let modules: Vec<(ModuleSlot, Box<dyn Module>)> =
                vec![(ModuleSlot::new("do", 4), Box::new(module.clone()))];
            Session::with(common::source::bench_with(TIMED, &[], config, modules))
        };
        let (safe, plain) = (module(), module());
        let (mut held, mut other) = (of(&safe), of(&plain));
        held.module = Some(safe.clone());
        let mut random = Random::new(34);
        let mut holds = 0;
        while holds < 1000 {
            safe.look(|seen| seen.disabled.clear());
            let block = random.of(&[ob(1), ob(1), fc(5), ob(35)]);
            held.ask(at(block, random.next(if block == ob(1) { 38 } else { 4 })));
            held.ask(wait());
            let looks = random.of(&[0, 1, 3, 30, 300]);
            held.ticks = 0;
            let before = held.seen.len();
            let script = std::iter::repeat_n(wait(), looks).chain([DebugOrder::Breakpoints(vec![]), go(Resume::Run)]);
            let script = script.collect();
            let mut left = Some(script);
            // Not every statement comes in every cycle.
            for _ in 0..20 {
                let Some(script) = left else { break };
                left = held.cycle_of(script);
                other.cycle(vec![]);
            }
            if left.is_some() {
                held.ask(DebugOrder::Breakpoints(vec![]));
                held.cycle(vec![]);
                other.cycle(vec![]);
            }
            holds += usize::from(held.seen[before..].iter().any(|answer| answer.end == DebugEnd::Held));
            let all = |s: &mut Session| {
                let memory: Vec<u32> = (0..30).map(|word| s.bench.mw(2 * word)).collect();
                (memory, s.bench.cpu.state(), s.bench.clock.now)
            };
            let (mine, theirs) = (all(&mut held), all(&mut other));
            assert_eq!((&mine.0, mine.1), (&theirs.0, theirs.1), "hold {holds}, {block}, {looks} looks");
            assert!(mine.2 >= theirs.2);
            safe.look(|seen| assert_eq!(seen.outputs, plain.look(|seen| seen.outputs.clone())));
        }
        let events = held.events();
        assert!(events.iter().all(|event| [Event::HOLD, Event::HOLD_LEFT].contains(event)), "{events:?}");
    });
}
