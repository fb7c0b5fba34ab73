//! A whole CP 341 with its program, and a 3964R partner with configurable, also wrong behaviour.

use std::collections::VecDeque;
use std::fs;

use ob1_cpu::{Cell, Width};
use ob1_model::Area;
use ob1_tests::sim::device::{Bench, Device};
use ob1_tests::sim::{MS, SECOND};
use ob1_time::{Instant, Span};

use crate::common::cp341::{INSTANCES, data_block};

pub(crate) const STX: u8 = 0x02;
pub(crate) const ETX: u8 = 0x03;
pub(crate) const DLE: u8 = 0x10;
pub(crate) const NAK: u8 = 0x15;

/// The diagnostic entries of the CP at its start. (docs/cp341-events.md)
pub(crate) const STARTED: &[u16] = &[0x0008, 0x0003];

/// A block on the line after STX and DLE: 3964R. [TIA help "Configuration for point-to-point links"]
pub(crate) fn block(telegram: &[u8]) -> Vec<u8> {
    let mut line = Vec::new();
    for byte in telegram {
        line.push(*byte);
        if *byte == DLE {
            line.push(DLE);
        }
    }
    line.extend([DLE, ETX]);
    line.push(line.iter().fold(0, |check, byte| check ^ byte));
    line
}

/// The same with a wrong check character.
pub(crate) fn spoilt(telegram: &[u8]) -> Vec<u8> {
    let mut line = block(telegram);
    *line.last_mut().expect("the check character") ^= 0x40;
    line
}

/// The partner's reaction to a telegram of the CP.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Manner {
    /// Correct.
    Good,
    /// These characters after STX.
    ToStx(&'static [u8]),
    /// These characters after the first character of the block.
    Within(&'static [u8]),
    /// These characters after the whole block.
    AtEnd(&'static [u8]),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Hears {
    Nothing,
    Data,
    Dle,
    Check,
}

/// A partner on the line: 3964R as a receiver and as a sender with given repetitions.
pub(crate) struct Partner {
    pub(crate) manner: Manner,
    pub(crate) hears: Hears,
    /// The telegram being received.
    pub(crate) telegram: Vec<u8>,
    /// The received telegrams.
    pub(crate) telegrams: Vec<Vec<u8>>,
    /// Answers to the next telegrams: also telegrams.
    pub(crate) reactions: VecDeque<Vec<u8>>,
    /// Blocks to send, one for each connection.
    pub(crate) blocks: VecDeque<Vec<u8>>,
    /// It waits for DLE: after its STX (true) or after its block.
    pub(crate) connects: Option<bool>,
    /// The answers of the CP to its blocks.
    pub(crate) acknowledged: Vec<u8>,
}

impl Partner {
    pub(crate) fn new() -> Self {
        Self {
            manner: Manner::Good,
            hears: Hears::Nothing,
            telegram: Vec::new(),
            telegrams: Vec::new(),
            reactions: VecDeque::new(),
            blocks: VecDeque::new(),
            connects: None,
            acknowledged: Vec::new(),
        }
    }

    /// Sends the contents of `blocks`, one after the other.
    pub(crate) fn begin(&mut self, out: &mut Vec<u8>) {
        if self.connects.is_none() && !self.blocks.is_empty() {
            self.connects = Some(true);
            out.push(STX);
        }
    }

    pub(crate) fn character(&mut self, byte: u8, out: &mut Vec<u8>) {
        match (self.connects, byte) {
            (Some(true), DLE) => {
                out.extend(self.blocks.pop_front().unwrap_or_default());
                self.connects = Some(false);
            }
            (Some(false), DLE | NAK) => {
                self.acknowledged.push(byte);
                self.connects = None;
                self.begin(out);
            }
            _ => self.listen(byte, out),
        }
    }

    pub(crate) fn listen(&mut self, byte: u8, out: &mut Vec<u8>) {
        match (self.hears, byte) {
            (Hears::Nothing, STX) => {
                if let Manner::ToStx(answer) = self.manner {
                    return out.extend(answer);
                }
                self.telegram.clear();
                self.hears = Hears::Data;
                out.push(DLE);
            }
            (Hears::Nothing, _) => {}
            (Hears::Data, _) if matches!(self.manner, Manner::Within(_)) => {
                if let Manner::Within(answer) = self.manner {
                    out.extend(answer);
                }
                self.hears = Hears::Nothing;
            }
            (Hears::Data, DLE) => self.hears = Hears::Dle,
            (Hears::Data, _) => self.telegram.push(byte),
            (Hears::Dle, ETX) => self.hears = Hears::Check,
            (Hears::Dle, _) => {
                self.telegram.push(byte);
                self.hears = Hears::Data;
            }
            (Hears::Check, _) => {
                self.hears = Hears::Nothing;
                if let Manner::AtEnd(answer) = self.manner {
                    return out.extend(answer);
                }
                out.push(DLE);
                assert_eq!(block(&self.telegram).last(), Some(&byte), "the CP's check character");
                self.telegrams.push(self.telegram.clone());
                self.blocks.extend(self.reactions.pop_front().map(|telegram| block(&telegram)));
                self.begin(out);
            }
        }
    }
}

impl Device for Partner {
    fn hear(&mut self, _now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        for byte in bytes {
            self.character(*byte, out);
        }
        None
    }
}

/// Calls of both blocks, with all parameters in bit memory.
pub(crate) const PROGRAM: &str = r"
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
CALL FB 7, DB 7
  EN_R := M84.0
  R := M84.1
  LADDR := 256
  DB_NO := MW120
  DBB_NO := 0
  NDR := M85.0
  ERROR := M85.1
  LEN := MW86
  STATUS := MW88
CALL FB 8, DB 8
  SF := MB100
  REQ := M80.0
  R := M80.1
  LADDR := 256
  DB_NO := 10
  DBB_NO := 0
  LEN := MW106
  R_CPU_NO := 1
  R_TYP := MB101
  R_NO := 31
  R_OFFSET := 0
  R_CF_BYT := 255
  R_CF_BIT := 0
  DONE := M81.1
  ERROR := M81.2
  STATUS := MW82
END_ORGANIZATION_BLOCK

ORGANIZATION_BLOCK OB 121
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
END_ORGANIZATION_BLOCK
";

/// What P_RCV_RK reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Report {
    Ndr(u16),
    Error(u16),
}

/// The station with its partner.
pub(crate) struct Site {
    pub(crate) bench: Bench<Partner>,
    /// The results of the jobs of P_SND_RK: STATUS, or 0 for DONE.
    pub(crate) ends: Vec<u16>,
    pub(crate) reports: Vec<Report>,
}

/// The content of DB 10, without control characters.
pub(crate) fn pattern(at: u32) -> u8 {
    0x20 + (at % 0xD0) as u8
}

/// This many bytes of it.
pub(crate) fn patterns(bytes: u32) -> Vec<u8> {
    (0..bytes).map(pattern).collect()
}

pub(crate) fn word(memory: &[u8], at: usize) -> u16 {
    u16::from_be_bytes([memory[at], memory[at + 1]])
}

impl Site {
    /// 9600 8E1; three attempts, QVZ 100 ms, ZVZ 50 ms.
    pub(crate) fn new(protocol: &str, more: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let blocks = [(10, 300), (31, 512), (40, 300)].map(|(db, bytes)| data_block(db, bytes)).concat();
        let program = [PROGRAM, INSTANCES, &blocks].concat();
        fs::write(folder.path().join("status.awl"), program).expect("the program");
        let times = "qvz_ms = 100, zvz_ms = 50, connect_attempts = 3, block_attempts = 3";
        let file = format!(
            "[station]\nname = \"status\"\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"500ms\"\n\
             [program]\nsources = [\"status.awl\"]\nmnemonics = \"de\"\n[[plugin]]\npath = \"ob1_cp341\"\n\
             [[module]]\ntype = \"cp341\"\nname = \"cp\"\naddress = 256\nline = \"pty:partner\"\n\
             params = {{ protocol = \"{protocol}\", baud = 9600, {times}{more} }}\n"
        );
        let path = folder.path().join("station.toml");
        fs::write(&path, file).expect("the station file");
        let bench = Bench::build(&path, Partner::new(), 1).unwrap_or_else(|message| {
            panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
        });
        let mut site = Self { bench, ends: Vec::new(), reports: Vec::new() };
        for at in 0..300 {
            site.write(Cell::Db(10, 8 * at), Width::Byte, pattern(at).into());
        }
        site.pass(SECOND);
        assert_eq!(site.bench.entries(), STARTED, "the CP works");
        site.set_bytes(&[(100, b'S'), (101, b'D'), (121, 40)]);
        site.bit(84, 0, true);
        site.pass(10 * MS);
        site
    }

    pub(crate) fn write(&mut self, cell: Cell, width: Width, value: u32) {
        self.bench.station.cpu.write(cell, width, value).expect("a cell of the program");
    }

    pub(crate) fn set_bytes(&mut self, bytes: &[(u32, u8)]) {
        for (at, value) in bytes {
            self.write(Cell::Area(Area::Memory, 8 * at), Width::Byte, u32::from(*value));
        }
    }

    pub(crate) fn bit(&mut self, byte: u32, bit: u32, on: bool) {
        self.write(Cell::Area(Area::Memory, 8 * byte + bit), Width::Bit, u32::from(on));
    }

    /// Runs until the condition is true, at most for `most`, and records the outputs of the blocks.
    pub(crate) fn run(&mut self, most: Span, until: impl Fn(&[u16], &[Report]) -> bool) -> bool {
        let Self { bench, ends, reports } = self;
        bench.until(most, |station| {
            let memory = station.cpu.bit_memory();
            match memory[81] & 0b110 {
                0 => assert_eq!(word(memory, 82), 0, "STATUS without ERROR"),
                0b010 => ends.push(0),
                _ => ends.push(word(memory, 82)),
            }
            match memory[85] & 0b11 {
                0 => {}
                0b01 => reports.push(Report::Ndr(word(memory, 86))),
                _ => reports.push(Report::Error(word(memory, 88))),
            }
            until(ends, reports)
        })
    }

    pub(crate) fn pass(&mut self, time: Span) {
        self.run(time, |_, _| false);
    }

    /// Runs until the condition is true.
    pub(crate) fn until(&mut self, what: impl Fn(&Self) -> bool) {
        for _ in 0..10_000 {
            if what(self) {
                return;
            }
            self.pass(MS);
        }
        panic!("it does not come\n{}", self.bench.log());
    }

    pub(crate) fn block(&self, db: u16) -> &[u8] {
        self.bench.station.cpu.data_block(db).expect("a data block of the program")
    }

    /// Gives an edge of REQ.
    pub(crate) fn begin(&mut self, len: u16) {
        let [high, low] = len.to_be_bytes();
        self.set_bytes(&[(106, high), (107, low)]);
        for on in [true, false] {
            self.bit(80, 0, on);
            self.pass(2 * MS);
        }
    }

    /// Runs a job to its end; returns STATUS, or 0.
    pub(crate) fn job(&mut self, len: u16) -> u16 {
        let before = self.ends.len();
        self.begin(len);
        assert!(self.run(60 * SECOND, |ends, _| ends.len() > before), "the job does not end\n{}", self.bench.log());
        self.ends[before]
    }

    /// The partner sends these blocks one after the other, with repetitions.
    pub(crate) fn partner_sends(&mut self, blocks: impl IntoIterator<Item = Vec<u8>>) {
        self.bench.device.blocks.extend(blocks);
        self.bench.meanwhile(|partner, _, out| {
            partner.begin(out);
            None
        });
    }

    /// Entries since the start.
    pub(crate) fn entries(&self) -> Vec<String> {
        hex(&self.bench.entries()[STARTED.len()..])
    }

    /// The partner behaves correctly from now on, without later effects of earlier errors.
    pub(crate) fn is_well(&mut self) {
        let (ends, reports) = (self.ends.len(), self.reports.len());
        self.bench.device.manner = Manner::Good;
        self.pass(5 * SECOND);
        assert_eq!((self.ends.len(), self.reports.len()), (ends, reports), "nothing comes later");
    }
}

pub(crate) fn hex(numbers: &[u16]) -> Vec<String> {
    numbers.iter().map(|number| format!("{number:04X}")).collect()
}
