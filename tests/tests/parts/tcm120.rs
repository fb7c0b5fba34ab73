//! Compares the TCM 120 simulator with the manual, telegram by telegram, in virtual time. [S1 "Command Telegrams and
//! Messages"]

use ob1_protocols::MS;
use ob1_protocols::esp2::frame::encode;
use ob1_protocols::esp2::{Command, Field, Message, Radio, Telegram, WAKE};
use ob1_tests::tcm120::{Eeprom, ID_BASE_CHANGES, Input, MODEM_TIME, Output, Tcm120, script};
use ob1_time::{Instant, Span};

const ID_BASE: u32 = 0xFF80_0080;

/// The module between a CP and the radio side.
struct Bench {
    module: Tcm120,
    now: Instant,
    due: Option<Instant>,
}

impl Bench {
    fn new() -> Self {
        Self { module: Tcm120::new(Eeprom::new(ID_BASE)), now: Instant::START, due: None }
    }

    fn step(&mut self, input: Input<'_>) -> Output {
        let mut out = Output::default();
        self.due = self.module.step(self.now, input, &mut out);
        out
    }

    /// Passes these characters one by one; returns the serial answers and the telegrams sent by radio.
    fn write(&mut self, bytes: &[u8]) -> (Vec<String>, Vec<Radio>) {
        let mut all = Output::default();
        for byte in bytes {
            let out = self.step(Input::Rx(std::slice::from_ref(byte)));
            all.serial.extend(out.serial);
            all.air.extend(out.air);
        }
        (said(&all.serial), all.air)
    }

    /// The answer to a command.
    fn tell(&mut self, command: Command) -> Vec<String> {
        let (answer, air) = self.write(&encode(&Telegram::Command(command).emit()));
        assert_eq!(air, []);
        answer
    }

    /// Passes a telegram to be sent.
    fn send(&mut self, radio: Radio) -> (Vec<String>, Vec<Radio>) {
        self.write(&encode(&Telegram::Transmit(radio).emit()))
    }

    /// Executes a line of the script on the radio side; returns the telegrams to the CP and those sent by radio.
    fn air(&mut self, line: &str) -> (Vec<String>, Vec<Radio>) {
        let input = script::line(line).expect("it is understood").expect("it says something");
        let out = self.step(input);
        (said(&out.serial), out.air)
    }

    fn hears(&mut self, line: &str) -> Vec<String> {
        let (said, air) = self.air(line);
        assert_eq!(air, []);
        said
    }

    fn pass(&mut self, time: Span) -> Vec<String> {
        let end = self.now + time;
        let mut serial = Vec::new();
        while let Some(due) = self.due.filter(|due| *due <= end) {
            self.now = due;
            serial.extend(self.step(Input::Tick).serial);
        }
        self.now = end;
        said(&serial)
    }
}

/// Frames as lines of text; each must be complete.
fn said(serial: &[u8]) -> Vec<String> {
    assert_eq!(serial.len() % 14, 0, "{serial:02X?}");
    let frames = serial.chunks(14).map(|frame| {
        let bytes = frame[2..13].try_into().expect("eleven bytes");
        assert_eq!(encode(&bytes), frame);
        Telegram::parse(&bytes).to_string()
    });
    frames.collect()
}

fn modem(address: u16) -> Radio {
    Radio::Modem { data: [1, 2, 3, 4, 5, 6], address, repeater: 0 }
}

const NOTHING: (Vec<String>, Vec<Radio>) = (Vec::new(), Vec::new());

#[test]
fn each_command_has_its_answer() {
    let mut bench = Bench::new();
    let table = [
        (Command::RdIdBase, "INF_IDBASE FF800080"),
        (Command::RdRxSensitivity, "INF_RX_SENSITIVITY high"),
        (Command::SetRxSensitivity(false), "OK"),
        (Command::RdRxSensitivity, "INF_RX_SENSITIVITY low"),
        (Command::RdModemStatus, "INF_MODEM_STATUS off, ID 0000"),
        // "If 0000h is provided the modem is activated with the ID stored": there is none yet.
        (Command::ModemOn(0), "ERR"),
        (Command::ModemOn(0x1234), "OK"),
        (Command::RdModemStatus, "INF_MODEM_STATUS on, ID 1234"),
        (Command::ModemOff, "OK"),
        // "The modem ID is not erased."
        (Command::RdModemStatus, "INF_MODEM_STATUS off, ID 1234"),
        (Command::ModemOn(0), "OK"),
        (Command::RdModemStatus, "INF_MODEM_STATUS on, ID 1234"),
        (Command::RdSwVer, "INF_SW_VER 1.0.1.16"),
    ];
    for (command, answer) in table {
        assert_eq!(bench.tell(command), [answer], "{command:?}");
    }
}

/// "15 telegrams"; the modem's state is that of the EEPROM, the sensitivity is not kept. [S1 "INF_INIT"]
#[test]
fn a_start_is_told_in_fifteen_lines() {
    let mut bench = Bench::new();
    bench.tell(Command::ModemOn(0xBEEF));
    bench.tell(Command::SetRxSensitivity(false));
    let line = |text: &str| format!("INF_INIT \"{text}\"");
    let lines = [
        " ", "EnOcean", "TCM120", "Version", "1.0.1.16", "Bdrate", "0x40", "Modem", "ON", "RxID", "BEEF", "Mode",
        "Run", "PrgMem", "OK",
    ];
    assert_eq!(bench.tell(Command::Reset), lines.map(line));
    assert_eq!(bench.tell(Command::RdRxSensitivity), ["INF_RX_SENSITIVITY high"]);
    assert_eq!(bench.hears("reset"), lines.map(line));
}

/// "This command can only be used a maximum number of 10 times." The EEPROM keeps the count; 7 bits are not stored.
/// [S1 "SET_IDBASE"]
#[test]
fn the_id_base_can_be_changed_ten_times() {
    let mut bench = Bench::new();
    assert_eq!(bench.tell(Command::SetIdBase(0xFF7F_FFFF)), ["ERR_IDRANGE"]);
    assert_eq!(bench.module.eeprom().changes, 0, "what is refused does not count");
    for n in 1..=u32::from(ID_BASE_CHANGES) {
        let base = 0xFF80_0000 + (n << 7);
        assert_eq!(bench.tell(Command::SetIdBase(base | 0x55)), ["OK"]);
        assert_eq!(bench.tell(Command::RdIdBase), [format!("INF_IDBASE {base:08X}")]);
        bench.module = Tcm120::new(*bench.module.eeprom());
    }
    assert_eq!(bench.tell(Command::SetIdBase(0xFFFF_FF80)), ["ERR"]);
    assert_eq!(bench.tell(Command::SetIdBase(0)), ["ERR_IDRANGE"], "the range counts first");
    assert_eq!(bench.tell(Command::RdIdBase), ["INF_IDBASE FF800500"], "the old one stays");
}

#[test]
fn an_id_outside_the_range_is_not_sent() {
    let mut bench = Bench::new();
    let sensor = |id| Radio::Bs1 { data: 8, id, repeater: 0 };
    assert_eq!(bench.send(sensor(ID_BASE | 0x7F)), (vec![], vec![sensor(ID_BASE | 0x7F)]));
    for id in [ID_BASE + 0x80, ID_BASE - 1, 0x67] {
        assert_eq!(bench.send(sensor(id)), (vec!["ERR_TX_IDRANGE".to_owned()], vec![]), "{id:08X}");
    }
}

/// "In transmission the TCM 120 always sets T21=1." [S1 "Description of STATUS field"]
#[test]
fn switches_are_sent_as_type_2() {
    let mut bench = Bench::new();
    let Some(Input::Radio { radio: Radio::Rps { switch, .. }, .. }) = script::line("press 0 BO").expect("understood")
    else {
        panic!("a switch")
    };
    let rps = |type_2| Radio::Rps { switch, type_2, id: ID_BASE, repeater: 0 };
    assert_eq!(bench.send(rps(false)).1, [rps(true)]);
}

#[test]
fn a_modem_telegram_wants_its_acknowledgement_within_100_ms() {
    let not = |text: &str| vec![text.to_owned()];
    let mut bench = Bench::new();
    assert_eq!(bench.send(modem(7)).1, [modem(7)]);
    assert_eq!(bench.pass(MODEM_TIME - Span::from_nanos(1)), [""; 0]);
    assert_eq!(bench.hears("mda 8"), [""; 0], "another modem's");
    assert_eq!(bench.hears("mda 7"), ["received MDA of modem 0007"]);
    assert_eq!(bench.hears("mda 7"), not("ERR_MODEM_NOTWANTEDACK"), "a second one");
    assert_eq!(bench.pass(MODEM_TIME), [""; 0]);

    bench.send(modem(9));
    assert_eq!(bench.pass(MODEM_TIME - Span::from_nanos(1)), [""; 0]);
    assert_eq!(bench.pass(Span::from_nanos(1)), ["ERR_MODEM_NOTACK"]);
    assert_eq!(bench.hears("mda 9"), not("ERR_MODEM_NOTWANTEDACK"), "late");
    assert_eq!(bench.pass(1000 * MS), [""; 0], "told once");
    bench.send(modem(10));
    assert_eq!(bench.hears("mda 9"), [""; 0], "a new telegram is awaited, the old one forgotten");
}

#[test]
fn a_modem_hears_what_is_for_it_and_acknowledges() {
    let mut bench = Bench::new();
    assert_eq!(bench.air("6dt 1234 a1 a2"), NOTHING, "the modem is off");
    bench.tell(Command::ModemOn(0x1234));
    assert_eq!(bench.air("6dt 1235 a1 a2"), NOTHING, "another modem's");
    let acknowledgement = Radio::ModemAck { address: 0x1234, repeater: 0 };
    let (said, air) = bench.air("6dt 1234 a1 a2");
    assert_eq!((said.as_slice(), air), (&["received 6DT to modem 1234".to_owned()][..], vec![acknowledgement]));
    assert_eq!(bench.hears("mda 1234"), ["ERR_MODEM_DUP_ID"], "somebody else has this ID");
    assert_eq!(bench.hears("mda 1234 repeat 1"), [""; 0], "our own, repeated");
}

/// RP_COUNTER is passed on as set by a repeater; the program must filter. [S1 "IMPORTANT NOTE"]
#[test]
fn the_repeater_counter_comes_through() {
    let mut bench = Bench::new();
    assert_eq!(bench.hears("press 121c7a AI"), ["received RPS 00121C7A AI pressed"]);
    assert_eq!(bench.hears("press 121c7a AI repeat 1"), ["received RPS 00121C7A AI pressed, repeated 1"]);
    assert_eq!(bench.hears("4bs 5 3 2 1 8 repeat f"), ["received 4BS 00000005 1 2 3, inputs 08, repeated 15"]);
}

#[test]
fn low_sensitivity_does_not_hear_what_is_far() {
    let mut bench = Bench::new();
    assert_eq!(bench.hears("1bs 5 9 remote"), ["received 1BS 00000005 09"]);
    bench.tell(Command::SetRxSensitivity(false));
    assert_eq!(bench.hears("1bs 5 9 remote"), [""; 0]);
    assert_eq!(bench.hears("1bs 5 9"), ["received 1BS 00000005 09"]);
}

/// "The TCM will not wake up before a hardware reset is made or a WAKE telegram is sent." [S1 "SLEEP"]
#[test]
fn asleep_it_hears_nothing_but_wake() {
    let mut bench = Bench::new();
    assert_eq!(bench.tell(Command::Sleep), [""; 0]);
    assert!(bench.module.is_asleep());
    assert_eq!(bench.tell(Command::RdIdBase), [""; 0]);
    assert_eq!(bench.hears("release 5"), [""; 0]);
    assert_eq!(bench.write(&[WAKE]), NOTHING);
    assert_eq!(bench.tell(Command::RdIdBase), ["INF_IDBASE FF800080"]);
    bench.tell(Command::Sleep);
    assert_eq!(bench.hears("reset").len(), 15);
    assert_eq!(bench.tell(Command::RdIdBase), ["INF_IDBASE FF800080"]);
}

/// [S1 "ERR_SYNTAX"]
#[test]
fn what_is_wrong_in_a_telegram_is_named() {
    let good = encode(&Telegram::Command(Command::RdIdBase).emit());
    let bent = |at: usize, byte: u8| {
        let mut telegram: [u8; 11] = good[2..13].try_into().expect("eleven bytes");
        telegram[at] = byte;
        encode(&telegram).to_vec()
    };
    let mut sum = good;
    sum[13] ^= 1;
    let table = [
        (bent(0, 0xAC), Field::Length),
        (sum.to_vec(), Field::ChkSum),
        (bent(0, 0x2B), Field::HSeq),
        (bent(0, 0x8B), Field::HSeq),
        (bent(1, 0x59), Field::Org),
    ];
    let mut bench = Bench::new();
    for (bytes, field) in table {
        let answer = Telegram::Message(Message::ErrSyntax(field)).to_string();
        assert_eq!(bench.write(&bytes).0, [answer], "{bytes:02X?}");
        assert_eq!(bench.write(&[&[0x00, 0xA5, 0xA5][..], &good[1..]].concat()).0, ["INF_IDBASE FF800080"], "after it");
    }
}

#[test]
fn the_script_tells_what_it_does_not_understand() {
    let table = [
        ("press 5", "`press` with 1 more words is not understood"),
        ("press 5 EI", "`EI` is no button: AI AO BI BO CI CO DI DO"),
        ("1bs g 1", "`g` is no hexadecimal ID"),
        ("mda 12345", "`12345` is no hexadecimal address"),
        ("1bs 5 100", "`100` is no hexadecimal byte"),
        ("mda 1 repeat", "`repeat` stands before one number"),
        ("mda 1 repeat 10", "`10` is no repeater level"),
        ("remote", "`remote` stands behind a telegram"),
    ];
    for (line, why) in table {
        assert_eq!(script::line(line).expect_err("refused"), why, "{line}");
    }
    assert!(matches!(script::line("  # nothing "), Ok(None)));
}
