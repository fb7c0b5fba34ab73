//! A TCM 120, the transceiver inside the CP 240 EnOcean: the serial side as in the manuals, the radio side supplied by
//! the caller. [S1 "Command Telegrams and Messages"]
//!
//! A sans-IO machine: virtual time in tests, a pty in `tcm120` (the binary). It has its own framing, so that an error
//! in that of `ob1_protocols::esp2` is not hidden by the same error here; the types of the telegrams are shared.

mod framing;
pub mod script;

use ob1_protocols::esp2::frame::{Bytes, encode};
use ob1_protocols::esp2::{Command, Field, Message, Radio, Telegram, WAKE};
use ob1_time::{Instant, Span};

use framing::{Framing, Step};

/// Time a modem waits for its acknowledgement. [S1 "ERR_MODEM_ NOTACK"]
pub const MODEM_TIME: Span = Span::from_millis(100);

/// Maximum number of changes of the ID base. [S1 "SET_IDBASE"]
pub const ID_BASE_CHANGES: u8 = 10;

/// The lowest possible ID base; the highest is the highest ID. [S1 "SET_IDBASE"]
const ID_BASE_MIN: u32 = 0xFF80_0000;

/// The 25 most significant bits are stored.
const ID_BASE_BITS: u32 = 0xFFFF_FF80;

/// The data that survive power off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Eeprom {
    /// The ID base, lower 7 bits 0.
    pub id_base: u32,
    /// Number of changes.
    pub changes: u8,
    /// The modem is on.
    pub modem_on: bool,
    /// The modem ID; 0: none was ever set.
    pub modem_id: u16,
}

impl Eeprom {
    /// The factory settings.
    #[must_use]
    pub const fn new(id_base: u32) -> Self {
        Self { id_base: id_base & ID_BASE_BITS, changes: 0, modem_on: false, modem_id: 0 }
    }
}

/// An input of the module.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// Time has passed.
    Tick,
    /// Power on, or the reset line.
    HardwareReset,
    /// Characters from the CP.
    Rx(&'a [u8]),
    /// A telegram received by radio.
    Radio {
        /// The telegram.
        radio: Radio,
        /// From a distance: not detected with low sensitivity.
        remote: bool,
    },
}

/// The output of the module.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Output {
    /// Characters for the CP.
    pub serial: Vec<u8>,
    /// Telegrams sent by radio.
    pub air: Vec<Radio>,
}

/// A modem telegram was sent and waits for its acknowledgement.
#[derive(Clone, Copy, Debug)]
struct Awaited {
    address: u16,
    until: Instant,
    acknowledged: bool,
}

/// The module.
#[derive(Clone, Debug)]
pub struct Tcm120 {
    eeprom: Eeprom,
    high_sensitivity: bool,
    asleep: bool,
    awaited: Option<Awaited>,
    /// A telegram to this modem was not acknowledged in time: a later acknowledgement is not wanted.
    late: Option<u16>,
    framing: Framing,
}

impl Tcm120 {
    /// Software version in INF_SW_VER: the manual's example.
    pub const VERSION: [u8; 4] = [1, 0, 1, 16];

    /// A module that has been on for a long time.
    #[must_use]
    pub const fn new(eeprom: Eeprom) -> Self {
        Self { eeprom, high_sensitivity: true, asleep: false, awaited: None, late: None, framing: Framing::new() }
    }

    /// Its stored data.
    #[must_use]
    pub const fn eeprom(&self) -> &Eeprom {
        &self.eeprom
    }

    /// Whether it sleeps.
    #[must_use]
    pub const fn is_asleep(&self) -> bool {
        self.asleep
    }

    /// Takes one input; returns when [`Input::Tick`] is due.
    pub fn step(&mut self, now: Instant, input: Input<'_>, out: &mut Output) -> Option<Instant> {
        self.expire(now, out);
        match input {
            Input::Tick => {}
            Input::HardwareReset => self.start(out),
            Input::Rx(bytes) => bytes.iter().for_each(|byte| self.character(now, *byte, out)),
            Input::Radio { radio, remote } => self.radio(radio, remote, out),
        }
        self.awaited.filter(|awaited| !awaited.acknowledged).map(|awaited| awaited.until)
    }

    /// "This error message is generated if no acknowledge was received before the timeout (100ms)."
    fn expire(&mut self, now: Instant, out: &mut Output) {
        let Some(awaited) = self.awaited.take_if(|awaited| now >= awaited.until) else { return };
        self.late = Some(awaited.address);
        if !awaited.acknowledged {
            say(Message::ErrModemNotAck, out);
        }
    }

    /// "After a power-on, a hardware reset or a RESET command": 15 telegrams. [S1 "INF_INIT"]
    fn start(&mut self, out: &mut Output) {
        *self = Self::new(self.eeprom);
        let [a, b, c, d] = Self::VERSION;
        let version = format!("{a}.{b}.{c}.{d}");
        let modem_id = format!("{:04X}", self.eeprom.modem_id);
        let modem = if self.eeprom.modem_on { "ON" } else { "OFF" };
        let lines = [
            " ", "EnOcean", "TCM120", "Version", &version, "Bdrate", "0x40", "Modem", modem, "RxID", &modem_id, "Mode",
            "Run", "PrgMem", "OK",
        ];
        for line in lines {
            let mut text = [0; 9];
            for (place, byte) in text.iter_mut().zip(line.bytes()) {
                *place = byte;
            }
            say(Message::InfInit(text), out);
        }
    }

    fn character(&mut self, now: Instant, byte: u8, out: &mut Output) {
        if self.asleep {
            // "The TCM will not wake up before a hardware reset is made or a WAKE telegram is sent." [S1 "SLEEP"]
            self.asleep = byte != WAKE;
            return;
        }
        match self.framing.feed(byte) {
            Step::More => {}
            Step::Syntax(field) => say(Message::ErrSyntax(field), out),
            Step::Telegram(telegram) => self.telegram(now, &telegram, out),
        }
    }

    fn telegram(&mut self, now: Instant, bytes: &Bytes, out: &mut Output) {
        match Telegram::parse(bytes) {
            Telegram::Transmit(radio) => self.transmit(now, radio, out),
            Telegram::Command(command) => self.command(command, out),
            _ => say(Message::ErrSyntax(Field::Org), out),
        }
    }

    fn transmit(&mut self, now: Instant, mut radio: Radio, out: &mut Output) {
        if radio.id().is_some_and(|id| id & ID_BASE_BITS != self.eeprom.id_base) {
            // "The radio telegram is not delivered." [S1 "ERR_TX_IDRANGE"]
            return say(Message::ErrTxIdRange, out);
        }
        match &mut radio {
            // "In transmission the TCM 120 always sets T21=1." [S1 "Description of STATUS field"]
            Radio::Rps { type_2, .. } => *type_2 = true,
            Radio::Modem { address, .. } => {
                self.late = None;
                self.awaited = Some(Awaited { address: *address, until: now + MODEM_TIME, acknowledged: false });
            }
            _ => {}
        }
        out.air.push(radio);
    }

    fn command(&mut self, command: Command, out: &mut Output) {
        let answer = match command {
            Command::RdIdBase => Message::InfIdBase(self.eeprom.id_base),
            Command::SetIdBase(base) if base < ID_BASE_MIN => Message::ErrIdRange,
            Command::SetIdBase(_) if self.eeprom.changes >= ID_BASE_CHANGES => Message::Err,
            Command::SetIdBase(base) => {
                self.eeprom.id_base = base & ID_BASE_BITS;
                self.eeprom.changes += 1;
                Message::Ok
            }
            Command::SetRxSensitivity(high) => {
                self.high_sensitivity = high;
                Message::Ok
            }
            Command::RdRxSensitivity => Message::InfRxSensitivity(self.high_sensitivity),
            Command::Sleep => {
                self.asleep = true;
                return;
            }
            Command::Reset => return self.start(out),
            // "If 0x0000 is provided ... the ID previously stored": without a previous one the modem cannot be switched
            // on (ours).
            Command::ModemOn(0) if self.eeprom.modem_id == 0 => Message::Err,
            Command::ModemOn(id) => {
                self.eeprom.modem_on = true;
                if id != 0 {
                    self.eeprom.modem_id = id;
                }
                Message::Ok
            }
            Command::ModemOff => {
                self.eeprom.modem_on = false;
                Message::Ok
            }
            Command::RdModemStatus => Message::InfModemStatus { on: self.eeprom.modem_on, id: self.eeprom.modem_id },
            Command::RdSwVer => Message::InfSwVer(Self::VERSION),
        };
        say(answer, out);
    }

    fn radio(&mut self, radio: Radio, remote: bool, out: &mut Output) {
        if self.asleep || remote && !self.high_sensitivity {
            return;
        }
        let own = |address| self.eeprom.modem_on && self.eeprom.modem_id == address;
        match radio {
            Radio::Modem { address, .. } if !own(address) => {}
            Radio::Modem { address, .. } => {
                out.serial.extend(encode(&Telegram::Received(radio).emit()));
                out.air.push(Radio::ModemAck { address, repeater: 0 });
            }
            // "An original (not repeated) MDA telegram with the same modem ID as its own." [S1 "ERR_MODEM_ DUP_ID"]
            Radio::ModemAck { address, repeater: 0 } if own(address) => say(Message::ErrModemDupId, out),
            Radio::ModemAck { address, .. } => self.acknowledge(radio, address, out),
            _ => out.serial.extend(encode(&Telegram::Received(radio).emit())),
        }
    }

    fn acknowledge(&mut self, radio: Radio, address: u16, out: &mut Output) {
        match &mut self.awaited {
            Some(awaited) if awaited.address == address && !awaited.acknowledged => {
                awaited.acknowledged = true;
                out.serial.extend(encode(&Telegram::Received(radio).emit()));
            }
            // "... after the timeout (100ms) or if there is more than one MDA received." [S1 "ERR_MODEM_NO TWANTEDACK"]
            Some(awaited) if awaited.address == address => say(Message::ErrModemNotWantedAck, out),
            None if self.late == Some(address) => say(Message::ErrModemNotWantedAck, out),
            _ => {}
        }
    }
}

fn say(message: Message, out: &mut Output) {
    out.serial.extend(encode(&Telegram::Message(message).emit()));
}
