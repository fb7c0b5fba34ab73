//! The program of the loadable driver's manual, chapter 8, in virtual time: its variable M 120.7 starts each job, our
//! own slave answers. Every function, errors with their STATUS, and the diagnostic buffer. [S4 "8 Application Example"]

use std::collections::VecDeque;
use std::path::Path;

use ob1_cpu::{Cell, Width};
use ob1_model::Area;
use ob1_protocols::MS;
use ob1_tests::modbus_slave::{LONG_FIRST, ModbusSlave};
use ob1_tests::sim::SECOND;
use ob1_tests::sim::device::{Bench, Device};
use ob1_time::{Instant, Span};

/// Delay before the slave answers.
const THINKS: Span = Span::from_millis(20);

/// The diagnostic entries of the CP at its start: the CPU is in RUN, the parameters are accepted.
/// (docs/cp341-events.md)
const STARTED: &[u16] = &[0x0008, 0x0003];

/// A change of an answer.
type Damage = fn(Vec<u8>) -> Vec<u8>;

/// The slave on its line, and its faults.
struct OnLine {
    slave: ModbusSlave,
    answers: VecDeque<(Instant, Vec<u8>)>,
    /// Applied to each answer.
    damage: Damage,
}

impl Device for OnLine {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        let answer = (self.damage)(self.slave.hear(bytes));
        if !answer.is_empty() {
            self.answers.push_back((now + THINKS, answer));
        }
        while let Some((_, answer)) = self.answers.pop_front_if(|(at, _)| *at <= now) {
            out.extend(answer);
        }
        self.answers.front().map(|(at, _)| *at)
    }
}

/// The station of the example.
struct Example {
    bench: Bench<OnLine>,
}

impl Example {
    fn new() -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/cp341-modbus-ascii/station.toml");
        let device = OnLine { slave: ModbusSlave::new(5), answers: VecDeque::new(), damage: |answer| answer };
        let bench = Bench::build(&path, device, 5).unwrap_or_else(|message| {
            panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
        });
        let mut example = Self { bench };
        example.bench.pass(SECOND);
        example
    }

    fn db(&self, number: u16) -> &[u8] {
        self.bench.station.cpu.data_block(number).expect("a data block of the program")
    }

    fn int(&self, db: u16, byte: usize) -> u16 {
        u16::from_be_bytes([self.db(db)[byte], self.db(db)[byte + 1]])
    }

    /// Counters of the manual's table: good and bad jobs of P_SND_RK, good and bad ones of P_RCV_RK.
    fn counters(&self) -> [u16; 4] {
        [(40, 6), (40, 8), (41, 6), (41, 8)].map(|(db, byte)| self.int(db, byte))
    }

    fn write(&mut self, cell: Cell, byte: u8) {
        self.bench.station.cpu.write(cell, Width::Byte, byte.into()).expect("a byte of the program");
    }

    /// Writes the source block (from byte 10 on, as in FC 21) and sets M 120.7; ends when the program has counted the
    /// job. Returns the data that P_RCV_RK has stored in DB 43, or the STATUS saved by the program.
    fn job(&mut self, source: &[u8]) -> Result<Vec<u8>, u16> {
        for (at, byte) in (10..).zip(source) {
            self.write(Cell::Db(42, 8 * at), *byte);
        }
        for at in 0..256 {
            self.write(Cell::Db(43, 8 * at), 0xEE);
        }
        let before = self.counters();
        let trigger = Cell::Area(Area::Memory, 8 * 120 + 7);
        self.bench.station.cpu.write(trigger, Width::Bit, 1).expect("M 120.7");
        let counted = |cpu: &ob1_cpu::Cpu| {
            let db = cpu.data_block(40).expect("DB 40");
            [u16::from_be_bytes([db[6], db[7]]), u16::from_be_bytes([db[8], db[9]])]
        };
        let done = self.bench.until(15 * SECOND, |s| counted(&s.cpu) != before[..2]);
        assert!(done, "{source:02X?} does not end\n{}", self.bench.log());
        let after = self.counters();
        // Data or an error of P_RCV_RK come before the end of the whole job.
        let received = after[2] - before[2];
        // FC 21 calls P_SND_RK before FC 23 calls P_RCV_RK: at DONE the data and their length are already there.
        // [S4 L1648], [S4 L1668]
        assert_eq!(self.db(41)[0] & 0x10, 0, "NDR was in an earlier cycle");
        self.bench.pass(50 * MS);
        assert_eq!(self.counters()[..3], after[..3], "nothing comes after the end");
        assert_eq!(self.bench.station.cpu.bit_memory()[120] & 0x80, 0, "M 120.7 is reset at once");
        if after[1] > before[1] {
            assert_eq!((after[0], received), (before[0], 0));
            return Err(self.int(40, 14));
        }
        let length = if received == 1 { usize::from(self.int(41, 4)) } else { 0 };
        assert!(self.db(43)[length..].iter().all(|byte| *byte == 0xEE), "nothing behind LEN");
        Ok(self.db(43)[..length].to_vec())
    }
}

/// The examples of chapter 5, each through the program, the blocks, the CP, the line and the slave.
#[test]
fn every_function_through_the_manuals_program() {
    let mut example = Example::new();
    let slave = &mut example.bench.device.slave;
    for n in [0x40, 0x48, 0x49, 0x4A, 0x4C, 0x4D, 0x4E] {
        slave.coils[n] = true;
    }
    for n in 0x120..0x138 {
        slave.inputs[n] = 0x00C8_2604 >> (n - 0x120) & 1 != 0;
    }
    (slave.registers[0x40], slave.registers[0x41]) = (0x2123, 0x2527);
    (slave.longs[0], slave.longs[1]) = (0x2122_2324, 0x2526_2728);
    (slave.input_registers[0x50], slave.input_registers[0x51], slave.input_registers[0x52]) = (0x3132, 0x3334, 0x3536);
    slave.exception_status = 0x3E;
    let [high, low] = LONG_FIRST.to_be_bytes();
    assert_eq!(example.job(&[5, 1, 0, 0x40, 0, 15]), Ok(vec![0x77, 0x01]));
    assert_eq!(example.job(&[5, 2, 1, 0x20, 0, 24]), Ok(vec![0x26, 0x04, 0x00, 0xC8]));
    assert_eq!(example.job(&[5, 3, 0, 0x40, 0, 2]), Ok(vec![0x21, 0x23, 0x25, 0x27]));
    let long = vec![0x21, 0x22, 0x23, 0x24, 0x25, 0x26, 0x27, 0x28];
    assert_eq!(example.job(&[5, 0x43, high, low, 0, 2]), Ok(long));
    assert_eq!(example.job(&[5, 4, 0, 0x50, 0, 3]), Ok(vec![0x31, 0x32, 0x33, 0x34, 0x35, 0x36]));
    assert_eq!(example.job(&[5, 5, 0, 0x19, 0xFF, 0]), Ok(vec![]));
    assert_eq!(example.job(&[5, 6, 1, 0x80, 0x3E, 0x7F]), Ok(vec![]));
    assert_eq!(example.job(&[5, 0x46, high, low, 0x11, 0x22, 0x33, 0x44]), Ok(vec![]));
    assert_eq!(example.job(&[5, 7]), Ok(vec![0x3E]), "one byte, the high one; LEN is 1");
    assert_eq!(example.job(&[5, 8, 0, 0, 0xA5, 0xC3]), Ok(vec![]));
    assert_eq!(example.job(&[5, 11]), Ok(vec![0, 0, 0, 10]));
    let log = example.job(&[5, 12]).expect("the log");
    assert_eq!((log.len(), &log[..6]), (70, &[0, 0, 0, 10, 0, 12][..]));
    assert_eq!(example.job(&[5, 15, 0, 0x50, 0, 10, 0xEF, 0xCD]), Ok(vec![]));
    assert_eq!(example.job(&[5, 16, 0, 0x60, 0, 3, 0x41, 0xA1, 0x42, 0xA2, 0x43, 0xA3]), Ok(vec![]));
    let two = [5, 0x50, high, low + 1, 0, 2, 0x51, 0xA1, 0x52, 0xA2, 0x53, 0xA3, 0x54, 0xA4];
    assert_eq!(example.job(&two), Ok(vec![]));
    // Broadcast.
    assert_eq!(example.job(&[0, 6, 0, 7, 0x12, 0x34]), Ok(vec![]));
    let slave = &example.bench.device.slave;
    assert!(slave.coils[0x19] && slave.registers[0x180] == 0x3E7F && slave.registers[7] == 0x1234);
    assert_eq!(slave.longs[..3], [0x1122_3344, 0x51A1_52A2, 0x53A3_54A4]);
    assert_eq!(slave.registers[0x60..0x63], [0x41A1, 0x42A2, 0x43A3]);
    let coils: Vec<usize> = (0x50..0x60).filter(|n| slave.coils[*n]).collect();
    assert_eq!(coils, [0x50, 0x52, 0x53, 0x56, 0x57, 0x58, 0x59], "CDh, and two bits of EFh");
    assert_eq!(example.counters(), [16, 0, 8, 0]);
}

/// [S4 "7.3 Table of Errors / Events"]: the number is STATUS of P_SND_RK and is in the diagnostic buffer.
#[test]
fn what_goes_wrong_has_its_status() {
    let mut example = Example::new();
    let [high, low] = LONG_FIRST.to_be_bytes();
    for (source, status) in [
        (&[5, 9][..], 0x0E42),
        (&[0, 3, 0, 0, 0, 1], 0x0E43),
        (&[5, 1, 0, 0, 0, 0], 0x0E44),
        (&[5, 3, 0, 0, 0, 126], 0x0E45),
        (&[5, 16, 0, 0, 0, 124], 0x0E46),
        // The program's LEN is 32.
        (&[5, 16, 0, 0, 0, 14], 0x0E47),
        (&[5, 5, 0, 0, 0, 1], 0x0E48),
        (&[5, 8, 0, 1, 0, 0], 0x0E49),
        (&[5, 0x41, 0, 0, 0, 1], 0x0E4A),
        (&[5, 0x43, 0, 0, 0, 2], 0x0E52),
        (&[5, 3, high, low, 0, 2], 0x0E53),
        (&[5, 3, 0xF0, 0, 0, 1], 0x0E62),
        (&[5, 0x46, 0, 0, 1, 2, 3, 4], 0x0E63),
        (&[6, 3, 0, 0, 0, 1], 0x0830),
    ] {
        assert_eq!(example.job(source), Err(status), "{source:02X?}");
    }
    let damaged: [(Damage, u16); 4] = [
        (|answer| answer.into_iter().map(|c| if c == b':' { b';' } else { c }).collect(), 0x0833),
        (
            |mut answer| {
                answer.truncate(6);
                answer
            },
            0x0806,
        ),
        (|answer| answer.into_iter().map(|c| if c == b'5' { b'6' } else { c }).collect(), 0x0E57),
        (|answer| answer.into_iter().map(|c| if c == b'3' { b'g' } else { c }).collect(), 0x0E58),
    ];
    for (damage, status) in damaged {
        example.bench.device.damage = damage;
        assert_eq!(example.job(&[5, 3, 0, 0, 0, 1]), Err(status), "{status:04X}");
    }
    example.bench.device.damage = |answer| answer;
    assert_eq!(example.job(&[5, 3, 0, 0, 0, 1]), Ok(vec![0, 0]), "and it works again");
    assert_eq!(example.counters(), [1, 18, 1, 0]);
    let statuses = [
        0x0E42, 0x0E43, 0x0E44, 0x0E45, 0x0E46, 0x0E47, 0x0E48, 0x0E49, 0x0E4A, 0x0E52, 0x0E53, 0x0E62, 0x0E63, 0x0830,
        0x0833, 0x0806, 0x0E57, 0x0E58,
    ];
    assert_eq!(example.bench.entries(), [STARTED, &statuses].concat(), "\"all errors are also entered\" [S4 L1687]");
}

/// "This does not in itself fail the send job. The error only appears in the CP diagnostic buffer." [S4 L1757]
#[test]
fn a_colon_within_a_reply_only_stands_in_the_diagnostic_buffer() {
    let mut example = Example::new();
    example.bench.device.slave.registers[0] = 0xABCD;
    example.bench.device.damage = |answer| if answer.is_empty() { answer } else { [b":0503", &answer[..]].concat() };
    assert_eq!(example.job(&[5, 3, 0, 0, 0, 1]), Ok(vec![0xAB, 0xCD]));
    assert_eq!((example.counters(), example.int(40, 14)), ([1, 0, 1, 0], 0));
    assert_eq!(example.bench.entries(), [STARTED, &[0x0834]].concat());
}

/// EN_R = 0: the reply is not accepted. The job ends with 0E31h, and the reply is not passed to the next one. [S4
/// L1652], [S4 L1785]
#[test]
fn a_reply_that_nobody_takes() {
    let mut example = Example::new();
    // The manual's FC 23 sets EN_R in each call; R = 1 at P_RCV_RK has the same effect: DB 70 is its instance, R its
    // second bit.
    example.bench.device.slave.registers[0] = 0xABCD;
    example.write(Cell::Db(70, 0), 0x02);
    // The reset itself is answered with NDR.
    example.bench.pass(50 * MS);
    assert_eq!((example.counters()[2], example.int(41, 4)), (1, 0));
    assert_eq!(example.job(&[5, 3, 0, 0, 0, 1]), Err(0x0E31));
    example.write(Cell::Db(70, 0), 0x00);
    example.bench.device.slave.registers[0] = 0x1234;
    assert_eq!(example.job(&[5, 3, 0, 0, 0, 1]), Ok(vec![0x12, 0x34]));
}
