//! FB 7 and FB 8 in all kinds of call: with instance data blocks and as multi-instances of a calling FB (and of the FB
//! that calls that one), absolute and symbolic, two of each for two CPs in one program. STL through the compiler, two
//! whole stations over two cables in virtual time. [CP 341 manual 09/2008, p. 178]

use std::fs;

use ob1_cpu::{Cell, Width};
use ob1_tests::sim::station::SimStation;
use ob1_tests::sim::{self, SECOND, Scenario};

use crate::common::cp341::{INSTANCES, data_block};

/// Telegrams that each CP sends.
const ROUNDS: usize = 6;

/// Station A: FB 21 has FB 20 as a static, FB 20 has two FB 7 and two FB 8, by number and by symbol.
const A: &str = r#"
FUNCTION_BLOCK FB 20
VAR
  rcv1 : FB 7;
  snd1 : FB 8;
  rcv2 : "P_RCV_RK";
  snd2 : "P_SND_RK";
END_VAR
BEGIN
CALL #rcv1 (EN_R := TRUE, R := FALSE, LADDR := 256, DB_NO := 41, DBB_NO := 0,
  NDR := DB30.DBX 4.0, ERROR := DB30.DBX 4.1, LEN := DB30.DBW 6, STATUS := DB30.DBW 8);
CALL #snd1 (REQ := DB30.DBX 0.0, R := FALSE, LADDR := DB30.DBW 12, DB_NO := 11, DBB_NO := 0, LEN := DB30.DBW 14,
  DONE := DB30.DBX 1.0, ERROR := DB30.DBX 1.1, STATUS := DB30.DBW 2);
CALL #rcv2
  EN_R := TRUE
  R := FALSE
  LADDR := 272
  DB_NO := 42
  DBB_NO := 0
  NDR := DB30.DBX 24.0
  ERROR := DB30.DBX 24.1
  LEN := DB30.DBW 26
  STATUS := DB30.DBW 28
CALL #snd2
  REQ := DB30.DBX 20.0
  R := FALSE
  LADDR := DB30.DBW 32
  DB_NO := 12
  DBB_NO := 0
  LEN := DB30.DBW 34
  DONE := DB30.DBX 21.0
  ERROR := DB30.DBX 21.1
  STATUS := DB30.DBW 22
      L     #snd1.SFCERR;
      T     DB30.DBW 10;
      L     #snd2.SFCERR;
      T     DB30.DBW 30;
END_FUNCTION_BLOCK

FUNCTION_BLOCK FB 21
VAR
  before : INT;
  both : FB 20;
END_VAR
BEGIN
CALL #both;
END_FUNCTION_BLOCK

DATA_BLOCK DB 21
FB 21
BEGIN
END_DATA_BLOCK

ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
CALL FB 21, DB 21;
END_ORGANIZATION_BLOCK
"#;

/// Station B: instance data blocks, for the first CP by number, for the second by symbol.
const B: &str = r#"
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
CALL FB 7, DB 7 (EN_R := TRUE, R := FALSE, LADDR := 256, DB_NO := 41, DBB_NO := 0,
  NDR := DB30.DBX 4.0, ERROR := DB30.DBX 4.1, LEN := DB30.DBW 6, STATUS := DB30.DBW 8);
CALL FB 8, DB 8 (REQ := DB30.DBX 0.0, R := FALSE, LADDR := DB30.DBW 12, DB_NO := 11, DBB_NO := 0, LEN := DB30.DBW 14,
  DONE := DB30.DBX 1.0, ERROR := DB30.DBX 1.1, STATUS := DB30.DBW 2);
CALL "P_RCV_RK", "I_RCV_2"
  EN_R := TRUE
  R := FALSE
  LADDR := 272
  DB_NO := 42
  DBB_NO := 0
  NDR := DB30.DBX 24.0
  ERROR := DB30.DBX 24.1
  LEN := DB30.DBW 26
  STATUS := DB30.DBW 28
CALL "P_SND_RK", "I_SND_2"
  REQ := DB30.DBX 20.0
  R := FALSE
  LADDR := DB30.DBW 32
  DB_NO := 12
  DBB_NO := 0
  LEN := DB30.DBW 34
  DONE := DB30.DBX 21.0
  ERROR := DB30.DBX 21.1
  STATUS := DB30.DBW 22
      L     DB8.SFCERR;
      T     DB30.DBW 10;
      L     "I_SND_2".SFCERR;
      T     DB30.DBW 30;
END_ORGANIZATION_BLOCK

DATA_BLOCK "I_RCV_2"
"P_RCV_RK"
BEGIN
END_DATA_BLOCK

DATA_BLOCK "I_SND_2"
"P_SND_RK"
BEGIN
END_DATA_BLOCK
"#;

const SYMBOLS: &str = "\"P_RCV_RK\",\"FB      7\",\"FB      7\",\"\"\n\"P_SND_RK\",\"FB      8\",\"FB      8\",\"\"\n\
                       \"I_RCV_2\",\"DB     17\",\"FB      7\",\"\"\n\"I_SND_2\",\"DB     18\",\"FB      8\",\"\"\n";

/// Start of the operands of each CP in DB 30.
const CPS: [usize; 2] = [0, 20];

/// The telegram of a round, sent by a station over a CP.
fn telegram(round: usize, station: usize, cp: usize) -> Vec<u8> {
    let len = [1, 31, 32, 33, 100, 240][(round + 2 * cp + 3 * station) % 6];
    (0..len).map(|at| (at + 16 * round + 64 * station + 128 * cp) as u8).collect()
}

/// The results of a station.
#[derive(Debug, Default)]
struct Seen {
    round: usize,
    is_waiting: bool,
    /// For each CP: the results of the jobs.
    ends: [Vec<u16>; 2],
    /// For each CP: the received telegrams.
    telegrams: [Vec<Vec<u8>>; 2],
    errors: Vec<u16>,
}

fn block(station: &SimStation, number: u16) -> &[u8] {
    station.cpu.data_block(number).expect("a data block of the program")
}

fn word(station: &SimStation, at: usize) -> u16 {
    u16::from_be_bytes([block(station, 30)[at], block(station, 30)[at + 1]])
}

fn write(station: &mut SimStation, db: u16, at: usize, width: Width, value: u32) {
    station.cpu.write(Cell::Db(db, 8 * at as u32), width, value).expect("a cell of the program");
}

impl Seen {
    fn look(&mut self, place: usize, station: &mut SimStation) {
        for (cp, base) in CPS.into_iter().enumerate() {
            write(station, 30, base, Width::Byte, 0);
            match block(station, 30)[base + 1] {
                0 => assert_eq!(word(station, base + 2), 0),
                1 => self.ends[cp].push(0),
                _ => self.ends[cp].push(word(station, base + 2)),
            }
            match block(station, 30)[base + 4] {
                0 => {}
                1 => {
                    let len = usize::from(word(station, base + 6));
                    self.telegrams[cp].push(block(station, 41 + cp as u16)[..len].to_vec());
                }
                _ => self.errors.push(word(station, base + 8)),
            }
        }
        if self.is_waiting && self.ends.iter().all(|ends| ends.len() > self.round) {
            (self.is_waiting, self.round) = (false, self.round + 1);
        }
        if !self.is_waiting && self.round < ROUNDS {
            self.is_waiting = true;
            for (cp, base) in CPS.into_iter().enumerate() {
                let data = telegram(self.round, place, cp);
                for (at, byte) in data.iter().enumerate() {
                    write(station, 11 + cp as u16, at, Width::Byte, u32::from(*byte));
                }
                // In the last two rounds the second CP has wrong parameters: no module at this address, invalid length.
                let (laddr, len) = match (cp, ROUNDS - self.round) {
                    (1, 1) => (999, data.len()),
                    (1, 2) => (272, 0),
                    _ => (256 + 16 * cp, data.len()),
                };
                write(station, 30, base + 12, Width::Word, laddr as u32);
                write(station, 30, base + 14, Width::Word, len as u32);
                write(station, 30, base, Width::Byte, 1);
            }
        }
    }

    fn is_done(&self, other: &Self) -> bool {
        self.round == ROUNDS
            && self
                .telegrams
                .iter()
                .zip(&other.ends)
                .all(|(telegrams, ends)| telegrams.len() == ends.iter().filter(|status| **status == 0).count())
    }
}

#[test]
fn instances_multi_instances_numbers_and_symbols() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("symbols.sdf"), SYMBOLS).expect("the symbols");
    let blocks =
        [(11, 240), (12, 240), (30, 40), (41, 240), (42, 240)].map(|(db, bytes)| data_block(db, bytes)).concat();
    for (name, text, end, priority) in
        [("a", A.to_owned(), "pty", "high"), ("b", [B, INSTANCES].concat(), "serial", "low")]
    {
        fs::write(folder.path().join(format!("{name}.awl")), text + &blocks).expect("the program");
        let module = |n: u32, address: u32| {
            format!(
                "[[module]]\ntype = \"cp341\"\nname = \"cp-{n}\"\naddress = {address}\nline = \"{end}:cable-{n}\"\n\
                 params = {{ protocol = \"3964r\", baud = 38400, priority = \"{priority}\" }}\n"
            )
        };
        let file = format!(
            "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"500ms\"\n\
             [program]\nsources = [\"{name}.awl\"]\nsymbols = [\"symbols.sdf\"]\nmnemonics = \"de\"\n\
             [[plugin]]\npath = \"ob1_cp341\"\n{}{}",
            module(1, 256),
            module(2, 272)
        );
        fs::write(folder.path().join(format!("station-{name}.toml")), file).expect("a station file");
    }
    let scenario = Scenario::demo(folder.path(), 1).undisturbed(30 * SECOND);
    let mut seen = [Seen::default(), Seen::default()];
    let outcome = sim::run_with(&scenario, |place, station| {
        seen[place].look(place, station);
        !(seen[0].is_done(&seen[1]) && seen[1].is_done(&seen[0]))
    })
    .unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"));
    for (place, (here, there)) in [(&seen[0], &seen[1]), (&seen[1], &seen[0])].into_iter().enumerate() {
        assert_eq!(here.ends[0], [0; ROUNDS], "station {place}, first CP\n{}", outcome.log);
        assert_eq!(here.ends[1], [0, 0, 0, 0, 0x1E41, 0x1E0F], "station {place}, second CP\n{}", outcome.log);
        assert!(here.errors.is_empty(), "station {place}: {:04X?}", here.errors);
        let station = &outcome.stations[place];
        assert_eq!((word(station, 10), word(station, 30)), (0, 0x8090), "SFCERR");
        for cp in [0, 1] {
            let sent: Vec<_> = (0..there.telegrams[cp].len()).map(|round| telegram(round, place, cp)).collect();
            assert_eq!(there.telegrams[cp], sent, "from station {place} over CP {cp}");
            assert_eq!(sent.len(), if cp == 0 { ROUNDS } else { ROUNDS - 2 });
        }
    }
}
