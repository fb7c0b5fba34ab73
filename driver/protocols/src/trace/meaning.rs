//! The meaning of a telegram or control character, in words.

use core::fmt;

use super::{mbus, profibus};
use crate::esp2;
use crate::machine::LineFault;
use crate::mbus::frame::Frame;
use crate::modbus::pdu::Direction;
use crate::profibus::Telegram as Profibus;
use crate::rk512::codec::{Command, Malformed, Telegram, parse};
use crate::words::Bytes;

/// The meaning of a [`Unit`](super::Unit); its text is one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning<'a> {
    /// A control character: its name and what it does here.
    Control(&'static str, &'static str),
    /// A block of 3964(R), complete.
    Block {
        /// User data, DLEs single.
        payload: &'a [u8],
        /// 3964R: computed and received check character.
        check: Option<(u8, u8)>,
        /// The user data are a telegram of RK 512.
        rk512: bool,
    },
    /// A telegram of ASCII or STX/ETX.
    Telegram(&'a [u8]),
    /// A frame of Modbus.
    Modbus(Modbus<'a>),
    /// A frame of the M-Bus.
    MBus(Frame<'a>),
    /// A telegram of EnOcean.
    EnOcean(&'a esp2::frame::Bytes),
    /// A telegram of PROFIBUS.
    Profibus(Profibus<'a>),
    /// Characters that do not form a telegram, and why.
    Broken(&'static str),
    /// A character that the line could not read.
    Fault(LineFault),
}

/// A frame of Modbus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Modbus<'a> {
    /// Address, function code and so on, without the check.
    pub telegram: &'a [u8],
    /// Whether it is a request or an answer.
    pub direction: Direction,
    /// How its function is called.
    pub names: Names,
}

/// Names of the functions of Modbus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Names {
    /// VIPA's, of CP 240 and CP 040. [S0 "Modbus - Function codes"]
    Vipa,
    /// Siemens', of the CP 341. [S4 "5 Function Codes"]
    Siemens {
        /// The registers have 32 bits. A request to read does not show it.
        long: bool,
    },
}

impl<'a> Meaning<'a> {
    /// User data, where there are any.
    pub const fn payload(&self) -> Option<&'a [u8]> {
        match *self {
            Self::Block { payload, .. } | Self::Telegram(payload) => Some(payload),
            Self::Modbus(modbus) => Some(modbus.telegram),
            Self::MBus(Frame::Long { data, .. }) => Some(data),
            Self::EnOcean(telegram) => Some(telegram.as_slice()),
            Self::MBus(Frame::Single | Frame::Short { .. }) => None,
            Self::Profibus(Profibus::Data(frame)) if !frame.data.is_empty() => Some(frame.data),
            Self::Profibus(_) | Self::Control(..) | Self::Broken(_) | Self::Fault(_) => None,
        }
    }
}

impl fmt::Display for Meaning<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Control(name, text) => write!(f, "{name}: {text}"),
            Self::Block { payload, check, rk512 } => {
                write!(f, "block, {}", Bytes(payload.len()))?;
                match check {
                    Some((computed, received)) if computed == received => write!(f, ", BCC {received:02X}")?,
                    Some((computed, received)) => {
                        return write!(f, ", BCC {received:02X} WRONG, computed {computed:02X}");
                    }
                    None => {}
                }
                if rk512 { write!(f, "; RK512 {}", Rk512(payload)) } else { Ok(()) }
            }
            Self::Telegram(payload) => write!(f, "telegram, {}", Bytes(payload.len())),
            Self::Modbus(modbus) => modbus.fmt(f),
            Self::MBus(frame) => mbus::Words(frame).fmt(f),
            Self::EnOcean(telegram) => esp2::Telegram::parse(telegram).fmt(f),
            Self::Profibus(telegram) => profibus::Words(telegram).fmt(f),
            Self::Broken(why) => f.write_str(why),
            Self::Fault(fault) => f.write_str(match fault {
                LineFault::Parity => "parity error",
                LineFault::Framing => "framing error",
                LineFault::Overrun => "characters lost in the receiver",
                LineFault::Break => "break",
                LineFault::Gone => "the line is gone",
                LineFault::Back => "the line is back",
            }),
        }
    }
}

/// A telegram of RK 512 in words.
struct Rk512<'a>(&'a [u8]);

impl fmt::Display for Rk512<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let command = |command| if command == Command::Send { "SEND" } else { "FETCH" };
        match parse(self.0) {
            Ok(Telegram::Order(request, data)) => {
                let letter = char::from(request.area.letter());
                write!(f, "{} {letter}", command(request.command))?;
                if request.area.unit() == 2 && matches!(letter, 'D' | 'X') {
                    write!(f, "B{} from word {}", request.db, request.start)?;
                } else {
                    write!(f, " from {}", request.start)?;
                }
                write!(f, ", {}", Bytes(request.bytes()))?;
                match request.coordination.flag(u8::MAX) {
                    Ok(Some(flag)) => write!(f, ", flag M {}.{}", flag.byte, flag.bit)?,
                    Ok(None) => {}
                    Err(_) => f.write_str(", invalid coordination flag")?,
                }
                if let Some(cpu) = request.coordination.cpu() {
                    write!(f, ", CPU {cpu}")?;
                }
                if data.is_empty() { Ok(()) } else { write!(f, ", {} with it", Bytes(data.len())) }
            }
            Ok(Telegram::Follow { command: what, data, .. }) => {
                write!(f, "follow-on telegram of {}", command(what))?;
                if data.is_empty() { Ok(()) } else { write!(f, ", {}", Bytes(data.len())) }
            }
            Ok(Telegram::Reaction { follow, code, data }) => {
                write!(f, "reaction{}", if follow { " to a follow-on telegram" } else { "" })?;
                if code == 0 {
                    f.write_str(", good")?;
                } else {
                    write!(f, ", error {code:02X}h")?;
                }
                if data.is_empty() { Ok(()) } else { write!(f, ", {}", Bytes(data.len())) }
            }
            Err(why) => f.write_str(match why {
                Malformed::Short => "telegram that is too short",
                Malformed::FirstBytes | Malformed::ReactionBytes => "telegram with wrong first bytes",
                Malformed::CommandLetter => "telegram with a wrong command letter",
                Malformed::AreaLetter => "telegram with a wrong area letter",
            }),
        }
    }
}
