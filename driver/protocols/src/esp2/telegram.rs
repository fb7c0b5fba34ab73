//! Every telegram of the manuals as a typed value: radio telegrams, commands to the TCM 120 and its answers. [S1
//! "Command Telegrams and Messages"]

use core::fmt;

use super::frame::Bytes;
use super::radio::{Button, Radio, Switch};

/// H_SEQ 0, LENGTH 11: received by radio (RX_TELEGRAM, RRT).
const RECEIVED: u8 = 0x0B;
/// H_SEQ 3: to be sent by radio (TX_TELEGRAM, TRT). "0x06" in both manuals is a misprint. [S1 L1704]
pub(super) const TRANSMIT: u8 = 0x6B;
/// H_SEQ 4: a message of the module (RMT).
const MESSAGE: u8 = 0x8B;
/// H_SEQ 5: a command to the module (TCT).
const COMMAND: u8 = 0xAB;

/// A telegram of eleven bytes. What is not in the manuals is [`Telegram::Unknown`] and keeps its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Telegram {
    /// 0Bh: received by radio.
    Received(Radio),
    /// 6Bh: to be sent by radio.
    Transmit(Radio),
    /// ABh: a command to the TCM 120.
    Command(Command),
    /// 8Bh: a message of the TCM 120.
    Message(Message),
    /// Anything else; its bytes are kept.
    Unknown(Bytes),
}

/// A command to the TCM 120. WAKE is not a telegram but a single byte, [`super::WAKE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// 58h: answer with INF_IDBASE.
    RdIdBase,
    /// 18h: a new ID base, FF800000h to FFFFFFFFh; the lower 7 bits do not count. At most ten times.
    SetIdBase(u32),
    /// 08h: sensitivity high (01h) or low (00h).
    SetRxSensitivity(bool),
    /// 48h: answer with INF_RX_SENSITIVITY.
    RdRxSensitivity,
    /// 09h: sleep until WAKE.
    Sleep,
    /// 0Ah: restart the module.
    Reset,
    /// 28h: modem on, with this ID; 0: with the one stored.
    ModemOn(u16),
    /// 2Ah: switch the modem off.
    ModemOff,
    /// 68h: answer with INF_MODEM_STATUS.
    RdModemStatus,
    /// 4Bh: answer with INF_SW_VER.
    RdSwVer,
}

/// A message of the TCM 120.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// 89h: one of the 15 lines after a start, ASCII padded with zeros.
    InfInit([u8; 9]),
    /// 58h: the command was carried out.
    Ok,
    /// 19h: could not be done.
    Err,
    /// 98h: the ID base.
    InfIdBase(u32),
    /// 88h: sensitivity high (01h) or low (00h).
    InfRxSensitivity(bool),
    /// A8h: the modem's state and ID.
    InfModemStatus {
        /// 01h: the modem is on.
        on: bool,
        /// ID of the modem.
        id: u16,
    },
    /// 8Ch: version, position 1 first.
    InfSwVer([u8; 4]),
    /// 28h: ERR_MODEM_NOTWANTEDACK, an acknowledgement after the time or a second one.
    ErrModemNotWantedAck,
    /// 29h: ERR_MODEM_NOTACK, no acknowledgement within 100 ms.
    ErrModemNotAck,
    /// 0Ch: ERR_MODEM_DUP_ID, another module has this modem ID. Only in S1. [S1 "ERR_MODEM_ DUP_ID"]
    ErrModemDupId,
    /// 08h to 0Bh: ERR_SYNTAX, the code of the field is in the place of ORG. Only in S1. [S1 "ERR_SYNTAX"]
    ErrSyntax(Field),
    /// 22h: ERR_TX_IDRANGE, the ID of a radio telegram is not in the module's range; it is not sent.
    ErrTxIdRange,
    /// 1Ah: ERR_IDRANGE, the ID base is not in the allowed range.
    ErrIdRange,
}

/// The wrong field of a telegram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// 08h: H_SEQ is wrong.
    HSeq,
    /// 09h: LENGTH is wrong.
    Length,
    /// 0Ah: CHK_SUM is wrong.
    ChkSum,
    /// 0Bh: ORG is wrong.
    Org,
}

impl Telegram {
    /// Reads eleven bytes; never fails.
    pub fn parse(bytes: &Bytes) -> Self {
        let known = match bytes[0] {
            RECEIVED => Radio::read(bytes).map(Self::Received),
            TRANSMIT => Radio::read(bytes).map(Self::Transmit),
            COMMAND => Command::read(bytes).map(Self::Command),
            MESSAGE => Message::read(bytes).map(Self::Message),
            _ => None,
        };
        known.unwrap_or(Self::Unknown(*bytes))
    }

    /// Writes eleven bytes. `parse` of them is the same value, as long as its fields are in their ranges.
    pub fn emit(&self) -> Bytes {
        match self {
            Self::Received(radio) => radio.write(RECEIVED),
            Self::Transmit(radio) => radio.write(TRANSMIT),
            Self::Command(command) => command.write(),
            Self::Message(message) => message.write(),
            Self::Unknown(bytes) => *bytes,
        }
    }
}

/// `header`, ORG, up to nine bytes, zeros.
fn compose(header: u8, org: u8, bytes: &[u8]) -> Bytes {
    let mut out = [0; 11];
    (out[0], out[1]) = (header, org);
    for (place, byte) in out[2..].iter_mut().zip(bytes) {
        *place = *byte;
    }
    out
}

/// A byte that is 00h or 01h.
const fn switch(byte: u8) -> Option<bool> {
    match byte {
        0 => Some(false),
        1 => Some(true),
        _ => None,
    }
}

impl Command {
    fn read(bytes: &Bytes) -> Option<Self> {
        let [_, org, b3, b2, b1, b0, ..] = *bytes;
        Some(match org {
            0x58 => Self::RdIdBase,
            0x18 => Self::SetIdBase(u32::from_be_bytes([b3, b2, b1, b0])),
            0x08 => Self::SetRxSensitivity(switch(b3)?),
            0x48 => Self::RdRxSensitivity,
            0x09 => Self::Sleep,
            0x0A => Self::Reset,
            0x28 => Self::ModemOn(u16::from_be_bytes([b3, b2])),
            0x2A => Self::ModemOff,
            0x68 => Self::RdModemStatus,
            0x4B => Self::RdSwVer,
            _ => return None,
        })
    }

    fn write(&self) -> Bytes {
        let (org, _) = self.row();
        match *self {
            Self::SetIdBase(base) => compose(COMMAND, org, &base.to_be_bytes()),
            Self::SetRxSensitivity(high) => compose(COMMAND, org, &[high.into()]),
            Self::ModemOn(id) => compose(COMMAND, org, &id.to_be_bytes()),
            _ => compose(COMMAND, org, &[]),
        }
    }

    /// ORG, and the manual's name of the command.
    const fn row(&self) -> (u8, &'static str) {
        match self {
            Self::RdIdBase => (0x58, "RD_IDBASE"),
            Self::SetIdBase(_) => (0x18, "SET_IDBASE"),
            Self::SetRxSensitivity(_) => (0x08, "SET_RX_SENSITIVITY"),
            Self::RdRxSensitivity => (0x48, "RD_RX_SENSITIVITY"),
            Self::Sleep => (0x09, "SLEEP"),
            Self::Reset => (0x0A, "RESET"),
            Self::ModemOn(_) => (0x28, "MODEM_ON"),
            Self::ModemOff => (0x2A, "MODEM_OFF"),
            Self::RdModemStatus => (0x68, "RD_MODEM_STATUS"),
            Self::RdSwVer => (0x4B, "RD_SW_VER"),
        }
    }

    /// The manual's name of the command.
    pub const fn name(&self) -> &'static str {
        self.row().1
    }
}

impl Message {
    fn read(bytes: &Bytes) -> Option<Self> {
        let [_, org, b3, b2, b1, b0, ..] = *bytes;
        Some(match org {
            0x89 => Self::InfInit(*bytes.last_chunk()?),
            0x58 => Self::Ok,
            0x19 => Self::Err,
            0x98 => Self::InfIdBase(u32::from_be_bytes([b3, b2, b1, b0])),
            0x88 => Self::InfRxSensitivity(switch(b3)?),
            0xA8 => Self::InfModemStatus { on: switch(b3)?, id: u16::from_be_bytes([b2, b1]) },
            0x8C => Self::InfSwVer([b3, b2, b1, b0]),
            0x28 => Self::ErrModemNotWantedAck,
            0x29 => Self::ErrModemNotAck,
            0x0C => Self::ErrModemDupId,
            0x08 => Self::ErrSyntax(Field::HSeq),
            0x09 => Self::ErrSyntax(Field::Length),
            0x0A => Self::ErrSyntax(Field::ChkSum),
            0x0B => Self::ErrSyntax(Field::Org),
            0x22 => Self::ErrTxIdRange,
            0x1A => Self::ErrIdRange,
            _ => return None,
        })
    }

    fn write(&self) -> Bytes {
        let (org, _) = self.row();
        match *self {
            Self::InfInit(text) => compose(MESSAGE, org, &text),
            Self::InfIdBase(base) => compose(MESSAGE, org, &base.to_be_bytes()),
            Self::InfRxSensitivity(high) => compose(MESSAGE, org, &[high.into()]),
            Self::InfModemStatus { on, id } => {
                let [msb, lsb] = id.to_be_bytes();
                compose(MESSAGE, org, &[on.into(), msb, lsb])
            }
            Self::InfSwVer(version) => compose(MESSAGE, org, &version),
            _ => compose(MESSAGE, org, &[]),
        }
    }

    /// ORG, and the manual's name of the message.
    const fn row(&self) -> (u8, &'static str) {
        match self {
            Self::InfInit(_) => (0x89, "INF_INIT"),
            Self::Ok => (0x58, "OK"),
            Self::Err => (0x19, "ERR"),
            Self::InfIdBase(_) => (0x98, "INF_IDBASE"),
            Self::InfRxSensitivity(_) => (0x88, "INF_RX_SENSITIVITY"),
            Self::InfModemStatus { .. } => (0xA8, "INF_MODEM_STATUS"),
            Self::InfSwVer(_) => (0x8C, "INF_SW_VER"),
            Self::ErrModemNotWantedAck => (0x28, "ERR_MODEM_NOTWANTEDACK"),
            Self::ErrModemNotAck => (0x29, "ERR_MODEM_NOTACK"),
            Self::ErrModemDupId => (0x0C, "ERR_MODEM_DUP_ID"),
            Self::ErrSyntax(Field::HSeq) => (0x08, "ERR_SYNTAX"),
            Self::ErrSyntax(Field::Length) => (0x09, "ERR_SYNTAX"),
            Self::ErrSyntax(Field::ChkSum) => (0x0A, "ERR_SYNTAX"),
            Self::ErrSyntax(Field::Org) => (0x0B, "ERR_SYNTAX"),
            Self::ErrTxIdRange => (0x22, "ERR_TX_IDRANGE"),
            Self::ErrIdRange => (0x1A, "ERR_IDRANGE"),
        }
    }

    /// The manual's name of the message.
    pub const fn name(&self) -> &'static str {
        self.row().1
    }
}

impl fmt::Display for Telegram {
    /// One line, as in a trace.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Received(radio) => write!(f, "received {radio}"),
            Self::Transmit(radio) => write!(f, "send {radio}"),
            Self::Command(command) => {
                f.write_str(command.name())?;
                match *command {
                    Command::SetIdBase(base) => write!(f, " {base:08X}"),
                    Command::SetRxSensitivity(high) => f.write_str(if high { " high" } else { " low" }),
                    Command::ModemOn(id) => write!(f, " {id:04X}"),
                    _ => Ok(()),
                }
            }
            Self::Message(message) => {
                f.write_str(message.name())?;
                match *message {
                    Message::InfInit(text) => write!(f, " \"{}\"", Ascii(&text)),
                    Message::InfIdBase(base) => write!(f, " {base:08X}"),
                    Message::InfRxSensitivity(high) => f.write_str(if high { " high" } else { " low" }),
                    Message::InfModemStatus { on, id } => {
                        write!(f, " {}, ID {id:04X}", if on { "on" } else { "off" })
                    }
                    Message::InfSwVer([a, b, c, d]) => write!(f, " {a}.{b}.{c}.{d}"),
                    Message::ErrSyntax(field) => f.write_str(match field {
                        Field::HSeq => " in H_SEQ",
                        Field::Length => " in LENGTH",
                        Field::ChkSum => " in CHKSUM",
                        Field::Org => " in ORG",
                    }),
                    _ => Ok(()),
                }
            }
            Self::Unknown(bytes) => write!(f, "unknown, H_SEQ {:02X} ORG {:02X}", bytes[0], bytes[1]),
        }
    }
}

impl fmt::Display for Radio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        if let Some(id) = self.id() {
            write!(f, " {id:08X}")?;
        }
        let bow = |pressed| if pressed { "pressed" } else { "released" };
        match *self {
            Self::Rps { switch: Switch::N { button, pressed, second, second_action }, .. } => {
                write!(f, " {button}")?;
                if second_action {
                    write!(f, " and {second}")?;
                }
                write!(f, " {}", bow(pressed))?;
            }
            Self::Rps { switch: Switch::U { buttons, pressed }, .. } => {
                write!(f, " buttons {buttons} {}", bow(pressed))?;
            }
            Self::Bs1 { data, .. } => write!(f, " {data:02X}")?,
            Self::Bs4 { analog: [first, second, third], digital, .. } => {
                write!(f, " {first} {second} {third}, inputs {digital:02X}")?;
            }
            Self::Hrc { button, pressed, store, .. } => {
                write!(f, " {button} {}{}", bow(pressed), if store { ", store" } else { "" })?;
            }
            Self::Modem { address, .. } => write!(f, " to modem {address:04X}")?,
            Self::ModemAck { address, .. } => write!(f, " of modem {address:04X}")?,
        }
        if self.repeater() == 0 { Ok(()) } else { write!(f, ", repeated {}", self.repeater()) }
    }
}

impl fmt::Display for Button {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rocker = char::from(b'A' + (self.rocker & 3));
        write!(f, "{rocker}{}", if self.o { 'O' } else { 'I' })
    }
}

/// Text up to its first zero; unprintable characters are shown as dots.
struct Ascii<'a>(&'a [u8]);

impl fmt::Display for Ascii<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for byte in self.0.iter().take_while(|byte| **byte != 0) {
            write!(f, "{}", if matches!(byte, 0x20..=0x7E) { char::from(*byte) } else { '.' })?;
        }
        Ok(())
    }
}
