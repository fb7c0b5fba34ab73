//! The count words and what stands in them [S0 L1829-L1880], `docs/cp240-registers.md`.

use ob1_sdk::{Abort, Cx, ModuleInfo, Refused, Reply};
use ob1_words::cp240;
pub(crate) use ob1_words::cp240::{
    AREA, BROKEN_OFF, COUNT_BITS, FAILED, LINE, LINE_ANSWER, LINE_DTR, LINE_RTS, LINE_SET_DTR, LINE_SET_RTS, MORE,
    NO_PARAMETERS, OUTSIDE, REGISTER_BYTES, RESET, STARTUP, SYSTEM,
};

use crate::settings::{self, Service};
use crate::state::CpState;

/// Offset of the TX words; RX lies at 0.
pub(crate) const TX: u32 = 2;
/// Bytes of a telegram in one block.
pub(crate) const BLOCK_BYTES: u16 = cp240::BLOCK_BYTES as u16;
/// Longest telegram: the CP's buffer.
pub(crate) const TELEGRAM_MAX: u16 = cp240::BUFFER_BYTES as u16;
/// Bytes of the offset that a changed area begins with.
pub(crate) const OFFSET_BYTES: u16 = cp240::OFFSET_BYTES as u16;

/// All that marks an answer to a line command: everything but STATUS and DELTA_STATUS.
const LINE_ANSWER_MASK: u16 = 0xFC00;

/// The two words the CP writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Words {
    /// Bytes of the received telegram still to be fetched.
    pub(crate) rx: u16,
    /// Echo of the count last sent.
    pub(crate) tx_echo: u16,
}

/// A count word, sorted.
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
    /// Outside the rules: treated as absent.
    Nonsense,
}

impl Count {
    fn bytes(word: u16) -> Self {
        if word <= TELEGRAM_MAX { Count::Bytes(word) } else { Count::Nonsense }
    }
}

/// Sorts `RX`; the bit of a changed area aside.
pub(crate) fn rx_count(word: u16) -> Count {
    if word & SYSTEM != 0 { Count::System } else { Count::bytes(word & !AREA) }
}

/// Sorts `TX echo`. A CP that echoes the output-area bit with the count means the count.
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

    /// The number of the start-up the CP shows, 1 to 255.
    pub(crate) fn start_up(self) -> Option<u8> {
        let number = self.tx_echo as u8;
        (self.rx == STARTUP && self.tx_echo & 0xFF00 == SYSTEM && number != 0).then_some(number)
    }

    /// True while the CP takes no order: start-up not acknowledged, or no valid parameters.
    pub(crate) fn not_ready(self) -> bool {
        self.start_up().is_some() || self.rx == NO_PARAMETERS
    }
}

/// The module a block is called for, with the plugin's memory of it.
pub(crate) struct Module<'a> {
    pub(crate) address: u32,
    pub(crate) info: ModuleInfo,
    pub(crate) state: &'a CpState,
}

/// A block's access to the CP. Where there is no module, or a driver is down and the station says `absent = "fault"`,
/// an access does what `L PEW` and `T PAW` do: event 2942h or 2943h, OB 122 or STOP; `None` when OB 122 has dealt with
/// it.
impl<'a> Module<'a> {
    /// Registers first, then what is known of the driver: what a driver that has died no longer shows (0 is also what
    /// an acknowledged telegram looks like) is never taken for the word of one that lives.
    ///
    /// `None` also at a Modbus slave "short": what stands there are the master's data, no block may take them for
    /// words or write there.
    pub(crate) fn read<const N: usize>(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, [u8; N])>, Abort> {
        let Some((module, registers)) = Self::reach(cx, adr)? else { return Ok(None) };
        if settings::service(cx, &module)? == Service::Nothing {
            let text = "a handling block was called, but the registers of a Modbus slave \"short\" are its data";
            return settings::tell_no_use(cx, &module, text).map(|()| None);
        }
        Ok(Some((module, registers)))
    }

    /// The same, whatever the registers mean.
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

    /// The same for the two count words alone.
    pub(crate) fn words(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, Words)>, Abort> {
        Ok(Self::read(cx, adr)?.map(|(module, bytes)| (module, Words::from_bytes(bytes))))
    }

    /// Writes bytes from an offset on, together. False when the access failed and OB 122 has dealt with it.
    pub(crate) fn write(&self, cx: &mut Cx<'_, CpState>, offset: u32, bytes: &[u8]) -> Result<bool, Abort> {
        match cx.io_write(self.address + offset, bytes)? {
            Ok(()) => Ok(true),
            Err(_) => cx.raise_fault(0x2943, self.address).map(|()| false),
        }
    }
}

/// The logical address: the manual declares it as INT, addresses count without a sign.
pub(crate) fn address(adr: i16) -> u32 {
    u32::from(adr as u16)
}

/// Reads registers; false when the access failed and OB 122 has dealt with it.
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

/// PAFE: what is wrong with the data block [S0 "Standard handling blocks for CPU 21x"].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Pafe {
    /// All is well.
    Ok = 0,
    /// Data block not present.
    Missing = 1,
    /// Data block too short.
    Short = 2,
    /// Data block number outside the valid range.
    Number = 3,
}

impl Pafe {
    /// What the host's refusal means; `None` for a write-protected data block, which is no matter of PAFE.
    pub(crate) fn of(refused: Refused) -> Option<Self> {
        Some(match refused {
            Refused::NoDb => Pafe::Missing,
            Refused::DbNumber => Pafe::Number,
            Refused::ReadOnly => return None,
            _ => Pafe::Short,
        })
    }

    /// Holds an area of a telegram against the length of its data block.
    pub(crate) fn check(db_len: Reply<u32>, from: impl Into<u32>, bytes: u16) -> Result<Pafe, Abort> {
        Ok(match db_len? {
            Ok(len) if len >= from.into() + u32::from(bytes) => Pafe::Ok,
            Ok(_) => Pafe::Short,
            Err(refused) => Pafe::of(refused).unwrap_or(Pafe::Ok),
        })
    }
}
