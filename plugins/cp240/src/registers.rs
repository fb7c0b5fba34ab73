//! The count words and their content [S0 L1829-L1880], `docs/cp240-registers.md`.

use ob1_sdk::{Abort, Cx, ModuleInfo, Refused, Reply};
use ob1_words::cp240;
pub(crate) use ob1_words::cp240::{
    AREA, BROKEN_OFF, COUNT_BITS, FAILED, LINE, LINE_ANSWER, LINE_DTR, LINE_RTS, LINE_SET_DTR, LINE_SET_RTS, MORE,
    NO_PARAMETERS, OUTSIDE, REGISTER_BYTES, RESET, STARTUP, SYSTEM,
};

use crate::settings::{self, Service};
use crate::state::CpState;

/// Offset of the TX words; RX is at 0.
pub(crate) const TX: u32 = 2;
/// Bytes of a telegram in one block.
pub(crate) const BLOCK_BYTES: u16 = cp240::BLOCK_BYTES as u16;
/// Longest telegram: the CP's buffer.
pub(crate) const TELEGRAM_MAX: u16 = cp240::BUFFER_BYTES as u16;
/// Bytes of the offset at the beginning of a changed area.
pub(crate) const OFFSET_BYTES: u16 = cp240::OFFSET_BYTES as u16;

/// The bits that identify an answer to a line command: all except STATUS and DELTA_STATUS.
const LINE_ANSWER_MASK: u16 = 0xFC00;

/// The two words the CP writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Words {
    /// Bytes of the received telegram still to be fetched.
    pub(crate) rx: u16,
    /// Echo of the count last sent.
    pub(crate) tx_echo: u16,
}

/// A decoded count word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Count {
    /// 0 to 1024.
    Bytes(u16),
    /// The order failed, with the CP's error code.
    Failed(u8),
    /// The answer to a line command: STATUS and DELTA_STATUS of FC 8.
    Line {
        /// RTS, DTR, CD, RI, DSR, CTS in bits 5 to 0.
        status: u8,
        /// CD, RI, DSR, CTS in bits 3 to 0.
        delta: u8,
    },
    /// A system word.
    System,
    /// Not valid: treated as absent.
    Nonsense,
}

impl Count {
    fn bytes(word: u16) -> Self {
        if word <= TELEGRAM_MAX { Count::Bytes(word) } else { Count::Nonsense }
    }
}

/// Decodes `RX`, ignoring the bit of a changed area.
pub(crate) fn rx_count(word: u16) -> Count {
    if word & SYSTEM != 0 { Count::System } else { Count::bytes(word & !AREA) }
}

/// Decodes `TX echo`. The bit of the output area is ignored.
pub(crate) fn tx_count(word: u16) -> Count {
    match word & !AREA {
        word if word & SYSTEM != 0 => Count::System,
        word if word & 0xFF00 == FAILED => Count::Failed(word as u8),
        word if word & LINE_ANSWER_MASK == LINE_ANSWER => {
            Count::Line { status: word as u8 & 0x3F, delta: (word >> cp240::LINE_DELTA_SHIFT) as u8 & 0x0F }
        }
        word => Count::bytes(word),
    }
}

impl Words {
    pub(crate) fn from_bytes(bytes: [u8; 4]) -> Self {
        let [a, b, c, d] = bytes;
        Self { rx: u16::from_be_bytes([a, b]), tx_echo: u16::from_be_bytes([c, d]) }
    }

    /// The number of the start-up that the CP shows, 1 to 255.
    pub(crate) fn start_up(self) -> Option<u8> {
        let number = self.tx_echo as u8;
        (self.rx == STARTUP && self.tx_echo & 0xFF00 == SYSTEM && number != 0).then_some(number)
    }

    /// True while the CP accepts no job: start-up not acknowledged, or no valid parameters.
    pub(crate) fn not_ready(self) -> bool {
        self.start_up().is_some() || self.rx == NO_PARAMETERS
    }
}

/// The module a block is called for, with the plugin's memory for it.
pub(crate) struct Module<'a> {
    pub(crate) address: u32,
    pub(crate) info: ModuleInfo,
    pub(crate) state: &'a CpState,
}

/// A block's access to the CP. If there is no module, or a driver is down and the station file says `absent = "fault"`,
/// an access has the same effect as `L PEW` and `T PAW`: event 2942h or 2943h, OB 122 or STOP; `None` if OB 122 has
/// handled it.
impl<'a> Module<'a> {
    /// The registers are read before the state of the driver: so the 0 of a dead driver is never taken for the 0 of an
    /// acknowledged telegram.
    ///
    /// `None` also for a Modbus slave "short": its registers hold the data of the master and not count words.
    pub(crate) fn read<const N: usize>(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, [u8; N])>, Abort> {
        let Some((module, registers)) = Self::reach(cx, adr)? else { return Ok(None) };
        if settings::service(cx, &module)? == Service::Nothing {
            let text = "a handling block was called, but the registers of a Modbus slave \"short\" are its data";
            return settings::tell_no_use(cx, &module, text).map(|()| None);
        }
        Ok(Some((module, registers)))
    }

    /// The same, also for a Modbus slave "short".
    pub(crate) fn reach<const N: usize>(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, [u8; N])>, Abort> {
        let address = address(adr);
        let mut registers = [0; N];
        if !read(cx, address, &mut registers)? {
            return Ok(None);
        }
        let info = cx.module_info(address)?;
        let Some(info) = read_access(cx, info, address)? else { return Ok(None) };
        let state = cx.module_state(address)?;
        Ok(read_access(cx, state, address)?.map(|state| (Self { address, info, state }, registers)))
    }

    /// The same as [`Module::read`], but only the two count words.
    pub(crate) fn words(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, Words)>, Abort> {
        Ok(Self::read(cx, adr)?.map(|(module, bytes)| (module, Words::from_bytes(bytes))))
    }

    /// Writes bytes from an offset on, in one access. False if the access failed and OB 122 has handled it.
    pub(crate) fn write(&self, cx: &mut Cx<'_, CpState>, offset: u32, bytes: &[u8]) -> Result<bool, Abort> {
        match cx.io_write(self.address + offset, bytes)? {
            Ok(()) => Ok(true),
            Err(_) => cx.raise_fault(0x2943, self.address).map(|()| false),
        }
    }
}

/// The logical address: the manual declares it as INT, but addresses are unsigned.
pub(crate) fn address(adr: i16) -> u32 {
    u32::from(adr as u16)
}

/// Reads registers; false if the access failed and OB 122 has handled it.
pub(crate) fn read(cx: &mut Cx<'_, CpState>, address: u32, into: &mut [u8]) -> Result<bool, Abort> {
    let done = cx.io_read(address, into)?;
    Ok(read_access(cx, done, address)?.is_some())
}

fn read_access<T>(cx: &mut Cx<'_, CpState>, done: Result<T, Refused>, address: u32) -> Result<Option<T>, Abort> {
    match done {
        Ok(value) => Ok(Some(value)),
        Err(_) => cx.raise_fault(0x2942, address).map(|()| None),
    }
}

/// PAFE: the error of the data block [S0 "Standard handling blocks for CPU 21x"].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Pafe {
    /// No error.
    Ok = 0,
    /// Data block not present.
    Missing = 1,
    /// Data block too short.
    Short = 2,
    /// Data block number outside the valid range.
    Number = 3,
}

impl Pafe {
    /// PAFE for a refusal of the host; `None` for a write-protected data block, which PAFE does not report.
    pub(crate) fn of(refused: Refused) -> Option<Self> {
        Some(match refused {
            Refused::NoDb => Pafe::Missing,
            Refused::DbNumber => Pafe::Number,
            Refused::ReadOnly => return None,
            _ => Pafe::Short,
        })
    }

    /// Checks whether an area is inside its data block.
    pub(crate) fn check(db_len: Reply<u32>, from: impl Into<u32>, bytes: u16) -> Result<Pafe, Abort> {
        Ok(match db_len? {
            Ok(len) if len >= from.into() + u32::from(bytes) => Pafe::Ok,
            Ok(_) => Pafe::Short,
            Err(refused) => Pafe::of(refused).unwrap_or(Pafe::Ok),
        })
    }
}
