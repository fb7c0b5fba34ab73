//! The process of a bus of GPIO lines in virtual time: the CPU, the modules and image of the bus, the pump and the
//! master of the lines are real; the chip and the life cycle of the process are simulated. (Only the calls of the
//! kernel are missing, because a test has no chip.)

use std::cell::RefCell;
use std::rc::Rc;

use ob1_cpu::{BusPlace, Command, Cpu, Module, ModuleSlot};
use ob1_model::Event;
use ob1_station::{assembly, program};
use ob1_station_file::{self, ModuleKind};
use ob1_tests::sim::MS;
use ob1_tests::sim::clock::VirtualClock;
use ob1_time::{Instant, Span};

use crate::plant::bus::{Chip, SharedChip, SimulatedBus};

const PROGRAM: &str = "
DATA_BLOCK DB 1
STRUCT
  events : ARRAY [0..9] OF WORD;
END_STRUCT
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
  L EB 0;
  T MB 1;
  L MB 0;
  T AB 0;
END_ORGANIZATION_BLOCK
ORGANIZATION_BLOCK OB 86
VAR_TEMP
  info : ARRAY [0..19] OF BYTE;
END_VAR
BEGIN
  L MW 10;
  + 1;
  T MW 10;
  L LW 0;
  T MW 12;
END_ORGANIZATION_BLOCK
";

const FILE: &str = "
[station]
name = \"board\"
[cpu]
min_cycle = \"10ms\"
[program]
sources = [\"board.awl\"]
[[bus]]
name = \"board\"
type = \"gpio\"
chip = \"gpiochip0\"
[[module]]
type = \"coupler\"
bus = \"board\"
name = \"panel\"
on_loss = \"substitute\"
inputs = [{ at = \"EB 0\", lines = [17, 27], substitute = [238] }]
outputs = [{ at = \"AB 0\", lines = [22, 23] }]
";
const SUBSTITUTE: u8 = 238;

struct Board {
    now: Instant,
    due: Instant,
    cpu: Cpu,
    bus: SimulatedBus,
    chip: SharedChip,
}

impl Board {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("board.awl"), PROGRAM).expect("room for a file");
        let station = ob1_station_file::parse(FILE, "board.toml", folder.path());
        let station = station.unwrap_or_else(|findings| panic!("{findings:#?}"));
        let loaded = program::load(&station).unwrap_or_else(|failure| panic!("{failure:?}"));
        let of = &station.buses[0];
        let (mut bus, host) = SimulatedBus::new(of, Vec::new(), Instant::from_millis(5));
        let chip = Rc::new(RefCell::new(Chip { inputs: vec![true, false], ..Chip::default() }));
        bus.chips = vec![Rc::clone(&chip)];
        let modules: Vec<(ModuleSlot, Box<dyn Module>)> = station
            .modules
            .iter()
            .map(|config| {
                let ModuleKind::Remote { module, .. } = &config.kind else { panic!("it is on the bus") };
                let number = of.stations[module.station].number;
                let place = BusPlace { master: of.rules.number, station: number, slot: module.slot };
                (ModuleSlot { bus: Some(place), ..assembly::slot(config) }, host.module(module.clone()))
            })
            .collect();
        let natives = loaded.native_blocks(&[]).unwrap_or_else(|failure| panic!("{failure:?}"));
        let mut cpu = Cpu::new(
            station.cpu.clone(),
            &loaded.program,
            natives,
            modules,
            ob1_station::engine::factory(station.engine),
        )
        .expect("a CPU");
        cpu.request(Command::Run);
        Self { now: Instant::START, due: Instant::START, cpu, bus, chip }
    }

    /// `scans`: the CPU is alive.
    fn run_with(&mut self, time: Span, scans: bool) {
        let until = self.now + time;
        loop {
            let due = if scans { self.due.max(self.now) } else { Instant::NEVER };
            let next = self.bus.next().min(due).max(self.now);
            if next > until {
                self.now = until;
                return;
            }
            self.now = next;
            self.bus.advance(self.now);
            if self.now >= due {
                let end = self.cpu.cycle(&mut VirtualClock(self.now));
                self.due = end.next_deadline.max(self.now + Span::from_nanos(1));
                self.bus.ring(self.now);
            }
        }
    }

    fn run(&mut self, time: Span) {
        self.run_with(time, true);
    }

    fn memory(&self, at: usize) -> u8 {
        self.cpu.bit_memory()[at]
    }

    /// Number of calls of OB 86, and its last data.
    fn ob_86(&self) -> (u16, u16) {
        let word = |at| u16::from_be_bytes([self.memory(at), self.memory(at + 1)]);
        (word(10), word(12))
    }

    /// Sets the output of OB 1.
    fn drive(&mut self, value: u8) {
        self.cpu
            .write(ob1_cpu::Cell::Area(ob1_model::Area::Memory, 0), ob1_cpu::Width::Byte, value.into())
            .expect("MB 0");
    }

    fn outputs(&self) -> Vec<bool> {
        self.chip.borrow().outputs.clone()
    }

    /// A running station with both outputs on.
    fn at_work() -> Self {
        let mut board = Self::new();
        // A start-up clears the bit memory.
        board.run(100 * MS);
        board.drive(0b11);
        board.run(100 * MS);
        assert_eq!((board.memory(1), board.outputs(), board.ob_86()), (0b01, vec![true; 2], (0, 0)));
        board
    }
}

#[test]
fn lines_go_through_ob_1_and_stop_switches_them_off() {
    let mut board = Board::at_work();
    board.chip.borrow_mut().inputs = vec![true, true];
    board.drive(0b10);
    board.run(50 * MS);
    assert_eq!((board.memory(1), board.outputs()), (0b11, vec![false, true]));
    board.cpu.request(Command::Stop);
    board.run(50 * MS);
    assert_eq!(board.outputs(), [false; 2]);
    board.cpu.request(Command::Run);
    board.run(50 * MS);
    board.drive(0b10);
    board.run(50 * MS);
    assert_eq!(board.outputs(), [false, true]);
}

#[test]
fn a_killed_process_is_39c3h_and_the_next_one_begins_with_the_outputs_off() {
    let mut board = Board::at_work();
    for round in 1..=5 {
        board.bus.kill(board.now, board.now + 100 * MS);
        board.run(20 * MS);
        let told = (2 * round - 1, Event::BUS_FAILED.0);
        assert_eq!((board.memory(1), board.ob_86()), (SUBSTITUTE, told), "round {round}");
        assert_eq!(
            (board.outputs(), board.chip.borrow().taken),
            (vec![true; 2], false),
            "the kernel has let them stay"
        );
        board.run(200 * MS);
        let told = (2 * round, Event::STATION_BACK.0);
        assert_eq!((board.memory(1), board.ob_86(), board.outputs()), (0b01, told, vec![true; 2]), "round {round}");
        assert_eq!(board.chip.borrow().opened, 1 + u32::from(round), "each process opens it, which is off");
    }
}

#[test]
fn a_chip_that_is_gone_is_39c4h_and_is_opened_again_when_it_is_back() {
    let mut board = Board::at_work();
    board.chip.borrow_mut().gone = true;
    board.run(50 * MS);
    assert_eq!((board.memory(1), board.ob_86()), (SUBSTITUTE, (1, Event::STATION_FAILED.0)));
    board.run(3000 * MS);
    assert_eq!(board.ob_86().0, 1, "told once");
    board.chip.borrow_mut().gone = false;
    board.run(1100 * MS);
    let told = (2, Event::STATION_BACK.0);
    assert_eq!((board.memory(1), board.ob_86(), board.outputs()), (0b01, told, vec![true; 2]));
}

#[test]
fn lines_that_somebody_else_has_are_missed_and_come_when_they_are_free() {
    let mut board = Board::new();
    board.chip.borrow_mut().taken = true;
    board.run(2000 * MS);
    board.drive(0b11);
    assert_eq!((board.memory(1), board.ob_86()), (SUBSTITUTE, (1, Event::STATION_FAILED.0)));
    assert!(board.outputs().is_empty(), "they are the other's");
    board.chip.borrow_mut().taken = false;
    board.run(1100 * MS);
    assert_eq!((board.memory(1), board.ob_86()), (0b01, (2, Event::STATION_BACK.0)));
    assert_eq!(board.outputs(), [true; 2]);
}

#[test]
fn a_scan_that_hangs_drives_nothing() {
    let mut board = Board::at_work();
    board.run_with(5000 * MS, false);
    assert_eq!(board.outputs(), [false; 2]);
    board.run(100 * MS);
    assert_eq!(board.outputs(), [true; 2], "it lives again");
}
