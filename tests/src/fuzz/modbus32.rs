//! The loadable driver of the CP 341 with any source area and any reply: the decoders are total, what they accept has
//! the length of its function, each job ends exactly once, and delivered data have passed all checks.

use ob1_protocols::modbus_master_32::job::{Function, Job};
use ob1_protocols::modbus_master_32::reply::evaluate;
use ob1_protocols::modbus_master_32::{
    DESTINATION_BYTES, Driver, FRAME_CHARACTERS, Input, Order, Owner, Parameters, Signals, TELEGRAM_BYTES, Wiring,
};
use ob1_protocols::{LineFault, LineInput, MS, ModemLines, SECOND, Wire};
use ob1_time::{Instant, Span};
use ob1_words::cp341_events;

#[derive(Default)]
struct Cpu {
    asked: usize,
    delivered: usize,
    ended: usize,
}

impl Wire for Cpu {
    fn transmit(&mut self, bytes: &[u8]) {
        assert!(bytes.len() <= FRAME_CHARACTERS && bytes.starts_with(b":") && bytes.ends_with(b"\r\n"));
        self.asked += 1;
    }
}

impl Owner for Cpu {
    fn deliver(&mut self, destination: &[u8]) {
        assert!(!destination.is_empty() && destination.len() <= DESTINATION_BYTES);
        self.delivered += 1;
    }

    fn ended(&mut self, outcome: Result<(), u16>) {
        assert_ne!(outcome, Err(0x0834), "it ends no job");
        self.ended += 1;
    }

    fn event(&mut self, number: u16) {
        let row = cp341_events::row(number).unwrap_or_else(|| panic!("{number:04X} is in no table"));
        assert_eq!(row.origin, cp341_events::Origin::Here, "{number:04X}");
    }
}

/// Decodes source area and reply.
fn decode(source: &[u8], reply: &[u8], long_registers: bool) {
    let Ok(job) = Job::of(b'X', source, long_registers) else { return };
    assert!((2..=TELEGRAM_BYTES).contains(&job.request().len()));
    assert!(!job.is_long() || long_registers);
    let Ok(area) = evaluate(&job, reply) else { return };
    assert_eq!((reply[0], reply[1]), (job.request()[0], job.request()[1]));
    let count = usize::from(job.value());
    let expected = match job.function() {
        Function::ReadCoils | Function::ReadInputs => count.div_ceil(16) * 2,
        Function::ReadHoldingRegisters | Function::ReadInputRegisters => count * job.register_bytes(),
        Function::ReadExceptionStatus => 1,
        Function::EventCounter => 4,
        Function::EventLog => reply.len() - 3,
        _ => 0,
    };
    assert_eq!(area.bytes().len(), expected);
}

/// Low bits: mode and wiring; the next byte is the length of the source area, which follows; the rest is received from
/// the line. FFh is a character error, FEh a silence, FDh a break, FCh the end of our output, FBh a change of DSR and
/// CTS.
pub fn run(data: &[u8]) {
    let [setup, length, data @ ..] = data else { return };
    let (source, line) = data.split_at(data.len().min(usize::from(*length)));
    let long_registers = setup & 1 != 0;
    decode(source, line, long_registers);
    let parameters = Parameters {
        long_registers,
        operating_mode: setup >> 1 & 1,
        wiring: if setup & 4 == 0 { Wiring::FOUR_WIRE } else { Wiring::TWO_WIRE },
        signals: (setup & 8 != 0).then_some(Signals { rts_off_ms: 10, output_wait_ms: 0 }),
        ..Parameters::default()
    };
    let [whole, single] = [usize::MAX, 1].map(|piece| talk(parameters.clone(), source, line, piece));
    assert_eq!(whole, single, "pieces make a difference");
}

/// Returns the numbers of requests, deliveries and ends.
fn talk(parameters: Parameters, source: &[u8], line: &[u8], piece: usize) -> (usize, usize) {
    let (mut driver, mut cpu) = (Driver::new(parameters), Cpu::default());
    let mut now: Instant = Instant::from_secs(1);
    let mut on = true;
    driver.step(now, Input::Tick, &mut cpu);
    let mut due = driver.step(now, Input::Order(Order::Job { r_typ: b'X', source }), &mut cpu);
    if leaves_at_once(line) {
        due = driver.step(now, Input::Line(LineInput::TxDone), &mut cpu);
    }
    for part in line.chunk_by(|a, b| *a < 0xFB && *b < 0xFB) {
        due = match part {
            [0xFF] => driver.step(now, Input::Line(LineInput::Fault(LineFault::Parity)), &mut cpu),
            [0xFE] => {
                pass(&mut driver, &mut cpu, &mut now, due, SECOND);
                driver.step(now, Input::Tick, &mut cpu)
            }
            [0xFD] => driver.step(now, Input::Line(LineInput::Fault(LineFault::Break)), &mut cpu),
            [0xFC] => driver.step(now, Input::Line(LineInput::TxDone), &mut cpu),
            [0xFB] => {
                on = !on;
                driver.step(
                    now,
                    Input::Line(LineInput::Modem(ModemLines { cts: on, dsr: on, ..ModemLines::default() })),
                    &mut cpu,
                )
            }
            characters => {
                let mut next = due;
                for some in characters.chunks(piece) {
                    next = driver.step(now, Input::Line(LineInput::Rx(some)), &mut cpu);
                }
                next
            }
        };
        now += MS;
    }
    let before = cpu.delivered;
    pass(&mut driver, &mut cpu, &mut now, due, 20 * SECOND);
    assert_eq!(cpu.delivered, before, "silence delivers nothing");
    if driver.busy() {
        // The end of its output was never reported.
        driver.step(now, Input::Order(Order::Abort), &mut cpu);
    }
    assert_eq!((cpu.ended, driver.busy()), (1, false));
    (cpu.asked, cpu.delivered)
}

/// Whether the line sends the request at once.
fn leaves_at_once(line: &[u8]) -> bool {
    line.first().is_some_and(|first| *first < 0xFB)
}

/// Advances the time, with a tick at each deadline.
fn pass(driver: &mut Driver, cpu: &mut Cpu, now: &mut Instant, mut due: Option<Instant>, time: Span) {
    let end = *now + time;
    while let Some(at) = due.filter(|at| *at <= end) {
        *now = at.max(*now);
        due = driver.step(*now, Input::Tick, cpu);
        assert!(due.is_none_or(|next| next > *now), "the driver does not get past {now}");
    }
    *now = end;
}

#[cfg(test)]
mod tests {
    use ob1_line::sim::SplitMix64;

    use crate::modbus_slave::{LONG_FIRST, ModbusSlave};

    /// Requests of every function with the reply of the slave, in which one character is replaced.
    pub(super) fn seeds() -> Vec<(String, Vec<u8>)> {
        let long = LONG_FIRST.to_be_bytes();
        let sources: [&[u8]; 15] = [
            &[5, 1, 0, 64, 0, 15],
            &[5, 2, 1, 32, 0, 24],
            &[5, 3, 0, 64, 0, 2],
            &[5, 0x43, long[0], long[1], 0, 2],
            &[5, 4, 0, 80, 0, 3],
            &[5, 5, 0, 25, 0xFF, 0],
            &[5, 6, 1, 128, 0x3E, 0x7F],
            &[5, 0x46, long[0], long[1], 0x11, 0x22, 0x33, 0x44],
            &[5, 7],
            &[5, 8, 0, 0, 0xA5, 0xC3],
            &[5, 11],
            &[5, 12],
            &[5, 15, 0, 80, 0, 10, 0xEF, 0xCD],
            &[5, 16, 0, 96, 0, 3, 0x41, 0xA1, 0x42, 0xA2, 0x43, 0xA3],
            &[5, 0x50, long[0], long[1], 0, 1, 0x51, 0xA1, 0x52, 0xA2],
        ];
        sources.iter().map(|source| (format!("function-{:02x}", source[1]), seed(source))).collect()
    }

    fn seed(source: &[u8]) -> Vec<u8> {
        let job = ob1_protocols::modbus_master_32::job::Job::of(b'X', source, true).expect("a job");
        let mut frame = [0; super::FRAME_CHARACTERS];
        let length = ob1_protocols::modbus::ascii::encode(job.request(), &mut frame).expect("a frame");
        let reply = ModbusSlave::new(5).hear(&frame[..length]);
        assert!(!reply.is_empty() && reply[3] != b'8', "{source:02X?} is answered");
        [&[1, source.len() as u8], source, &reply].concat()
    }

    #[test]
    fn replies_with_a_wrong_character() {
        let mut rng = SplitMix64::new(9);
        for (_, mut seed) in seeds() {
            super::run(&seed);
            for _ in 0..500 {
                let at = rng.below(seed.len() as u64) as usize;
                let kept = std::mem::replace(&mut seed[at], rng.next_u64() as u8);
                super::run(&seed);
                seed[at] = kept;
            }
        }
    }

    /// The committed corpus contains these inputs.
    #[test]
    fn the_corpus_has_every_function() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/corpus/modbus32");
        for (name, seed) in seeds() {
            assert_eq!(
                std::fs::read(format!("{folder}/{name}")).ok(),
                Some(seed),
                "{name} is not what this test makes"
            );
        }
    }
}
