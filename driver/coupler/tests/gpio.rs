//! The lines of a simulated GPIO chip: when they are read and driven, and a chip that vanishes and returns, in virtual
//! time.

use std::cell::RefCell;
use std::rc::Rc;

use ob1_coupler::config::{Instant, Span};
use ob1_coupler::gpio::{GpioConfig, GpioLine, GpioMaster, Pins};
use ob1_coupler::{BusConfig, Image, LineConfig, State};

const MS: Span = Span::MILLISECOND;

/// The state of the chip.
#[derive(Default)]
struct Chip {
    inputs: Vec<bool>,
    outputs: Vec<bool>,
    gone: bool,
    opened: u32,
    writes: u32,
    reads: u32,
}

struct Lent(Rc<RefCell<Chip>>);

impl Pins for Lent {
    fn read(&mut self, inputs: &mut [bool]) -> Result<(), String> {
        let mut chip = self.0.borrow_mut();
        chip.reads += 1;
        inputs.copy_from_slice(&chip.inputs);
        if chip.gone { Err("gone".into()) } else { Ok(()) }
    }

    fn write(&mut self, outputs: &[bool]) -> Result<(), String> {
        let mut chip = self.0.borrow_mut();
        chip.writes += 1;
        if chip.gone {
            return Err("gone".into());
        }
        chip.outputs = outputs.to_vec();
        Ok(())
    }
}

struct Bench {
    chip: Rc<RefCell<Chip>>,
    master: GpioMaster,
    image: Image,
    now: Instant,
}

/// Inputs E 0.0 and E 1.7, outputs A 0.3 and A 0.0.
fn bench() -> Bench {
    let line = |line, at, bit| GpioLine { line, at, bit, ..GpioLine::default() };
    let gpio = GpioConfig {
        name: "panel".into(),
        chip: "/dev/gpiochip0".into(),
        period: 5 * MS,
        inputs: vec![line(17, 0, 0), line(4, 1, 7)],
        outputs: vec![line(22, 0, 3), line(23, 0, 0)],
    };
    let of_line = LineConfig {
        line: String::new(),
        serial: None,
        timeout: Span::ZERO,
        couplers: Vec::new(),
        dp: None,
        gpio: Some(gpio.clone()),
    };
    let bus = BusConfig { input_bytes: 2, output_bytes: 1, lines: vec![of_line], ..BusConfig::default() };
    assert_eq!((bus.stations().collect::<Vec<_>>(), bus.lines[0].protocol()), (vec!["panel"], "gpio"));
    let chip = Chip { inputs: vec![false; 2], ..Chip::default() };
    Bench {
        chip: Rc::new(RefCell::new(chip)),
        master: GpioMaster::new(&gpio, 0),
        image: Image::new(&bus),
        now: Instant::START,
    }
}

impl Bench {
    fn step(&mut self, after: Span) -> Span {
        self.now += after;
        let chip = Rc::clone(&self.chip);
        let mut open = |_: &GpioConfig| -> Result<Box<dyn Pins>, String> {
            let mut own = chip.borrow_mut();
            own.opened += 1;
            if own.gone {
                return Err("no such device".into());
            }
            own.outputs = vec![false; 2];
            Ok(Box::new(Lent(Rc::clone(&chip))))
        };
        self.master.step(self.now, &mut self.image, &mut open) - self.now
    }

    fn state(&self) -> State {
        self.image.status[0].state
    }
}

#[test]
fn inputs_are_read_each_period_and_outputs_driven_when_they_change() {
    let mut bench = bench();
    bench.image.outputs = vec![0b1000];
    assert_eq!(bench.step(Span::ZERO), 5 * MS);
    assert_eq!((bench.state(), bench.chip.borrow().writes), (State::Running, 0), "nobody says that they are driven");
    bench.chip.borrow_mut().inputs = vec![true, true];
    assert_eq!(bench.step(MS), 4 * MS, "not due");
    assert_eq!(bench.image.inputs, [0, 0]);
    bench.step(4 * MS);
    assert_eq!(bench.image.inputs, [0x01, 0x80]);
    bench.image.driven = true;
    bench.step(MS);
    assert_eq!(bench.chip.borrow().outputs, [true, false]);
    bench.step(MS);
    assert_eq!(bench.chip.borrow().writes, 1, "nothing has changed");
    bench.image.outputs = vec![0b0001];
    bench.step(MS);
    assert_eq!((bench.chip.borrow().outputs.clone(), bench.master.is_off()), (vec![false, true], false));
    bench.image.driven = false;
    bench.step(MS);
    assert_eq!((bench.chip.borrow().outputs.clone(), bench.master.is_off()), (vec![false, false], true));
    bench.chip.borrow_mut().inputs = vec![false, true];
    bench.step(5 * MS);
    assert_eq!(bench.image.inputs, [0, 0x80]);
}

#[test]
fn a_chip_that_goes_is_lost_once_and_driven_again_when_it_returns() {
    let mut bench = bench();
    (bench.image.driven, bench.image.outputs) = (true, vec![0b1001]);
    bench.step(Span::ZERO);
    bench.chip.borrow_mut().gone = true;
    assert_eq!(bench.step(5 * MS), 1000 * MS);
    assert_eq!((bench.state(), bench.master.take_why().as_deref()), (State::Lost, Some("gone")));
    assert_eq!(bench.master.take_why(), None, "told once");
    assert!(bench.master.is_off(), "nobody can be waited for");
    let opened = bench.chip.borrow().opened;
    // The scan rings, which is no reason to try again.
    assert_eq!((bench.step(10 * MS), bench.chip.borrow().opened), (990 * MS, opened));
    bench.step(990 * MS);
    let status = bench.image.status[0];
    assert_eq!((status.losses, status.failures, status.state), (1, 2, State::Lost));
    bench.chip.borrow_mut().gone = false;
    bench.step(1000 * MS);
    assert_eq!((bench.state(), bench.chip.borrow().outputs.clone()), (State::Running, vec![true, true]));
}

#[test]
fn a_chip_that_was_never_there_is_lost() {
    let mut bench = bench();
    bench.chip.borrow_mut().gone = true;
    bench.step(Span::ZERO);
    assert_eq!((bench.state(), bench.master.take_why().as_deref()), (State::Lost, Some("no such device")));
}

/// Places beyond the image are an error in the configuration; they are skipped.
#[test]
fn places_outside_the_image_are_passed_over() {
    let mut bench = bench();
    (bench.image.inputs, bench.image.outputs, bench.image.driven) = (Vec::new(), Vec::new(), true);
    bench.step(Span::ZERO);
    assert_eq!(bench.state(), State::Running);
}
