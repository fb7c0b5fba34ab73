//! A job: it converts the SEND source area of the program to the request. [S4 "6.1.1 Data Transfer from CPU to CP with
//! P_SND_RK"]
//!
//! Layout of the source area: slave address, function code, then words, as in the manual's tables. Bytes after the last
//! one needed are ignored: "the data length LEN may exceed the required amount". [S4 L1622]

use ob1_words::codes;

use super::{TELEGRAM_BYTES, number};

/// Set in the function code of the source area: the job is about registers of four bytes. [S4 L840]
pub const LONG_BIT: u8 = 0x40;

/// Address of all slaves. [S4 "Broadcast Message"]
pub const BROADCAST: u8 = 0;

/// Longest source area, bytes. [S4 L1742]
pub const SOURCE_MAX: usize = 4096;

codes! {
    /// The function codes. [S4 "Function Code"]
    Function {
        /// 01, Read Coils: bits of the output area.
        ReadCoils = 1,
        /// 02, Read Discrete Inputs.
        ReadInputs = 2,
        /// 03, Read Holding Registers.
        ReadHoldingRegisters = 3,
        /// 04, Read Input Registers.
        ReadInputRegisters = 4,
        /// 05, Write Single Coil.
        WriteCoil = 5,
        /// 06, Preset Single Register.
        WriteRegister = 6,
        /// 07, Read Exception Status.
        ReadExceptionStatus = 7,
        /// 08, Loop Back Diagnostic Test.
        LoopBack = 8,
        /// 11, Fetch Communications Event Counter.
        EventCounter = 11,
        /// 12, Fetch Communications Event Log.
        EventLog = 12,
        /// 15, Write Multiple Coils.
        WriteCoils = 15,
        /// 16, Write Multiple Registers.
        WriteRegisters = 16,
    }
}

impl Function {
    /// "Broadcast Messages are only permitted in conjunction with writing Function Codes 05, 06, 15, and 16."
    /// [S4 "Broadcast Message"]
    pub const fn writes(self) -> bool {
        matches!(self, Self::WriteCoil | Self::WriteRegister | Self::WriteCoils | Self::WriteRegisters)
    }

    /// Registers may have four bytes. [S4 "32-Bit Registers"]
    pub const fn has_long_registers(self) -> bool {
        matches!(self, Self::ReadHoldingRegisters | Self::WriteRegister | Self::WriteRegisters)
    }
}

/// A request, and the data for checking its reply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Job {
    function: Function,
    long: bool,
    request: [u8; TELEGRAM_BYTES],
    len: usize,
}

impl Job {
    /// Checks the source area and builds the request from it. `long_registers`: the parameter "32-bit mode".
    ///
    /// The length is checked first [S4 L1634], then the content of the area from front to back.
    ///
    /// # Errors
    /// The event number with which the job ends; nothing is sent.
    pub fn of(r_typ: u8, source: &[u8], long_registers: bool) -> Result<Self, u16> {
        // The manual's own example writes 'x'. [S4 L2030], [TIA help "PtP data link CP 341"]
        if !r_typ.eq_ignore_ascii_case(&b'X') {
            return Err(number::R_TYP);
        }
        if source.is_empty() || source.len() > SOURCE_MAX {
            return Err(number::LENGTH);
        }
        let &[address, code, ..] = source else { return Err(number::LEN_MINIMUM) };
        let (function, long) = function_of(code, long_registers)?;
        let mut job = Self { function, long, request: [0; TELEGRAM_BYTES], len: 0 };
        let least = job.least_len();
        let head = source.get(..least).ok_or(number::LEN_FUNCTION)?;
        if address == BROADCAST && !function.writes() {
            return Err(number::BROADCAST);
        }
        job.put(&[address, function as u8]);
        job.put(head.get(2..).unwrap_or(&[]));
        job.check_value()?;
        job.put_data(source)?;
        Ok(job)
    }

    /// The function code of the request.
    pub const fn function(&self) -> Function {
        self.function
    }

    /// Whether it is about registers of four bytes.
    pub const fn is_long(&self) -> bool {
        self.long
    }

    /// The request: address, function code, data; without LRC.
    pub fn request(&self) -> &[u8] {
        self.request.get(..self.len).unwrap_or(&[])
    }

    /// Whether no slave will answer.
    pub const fn is_broadcast(&self) -> bool {
        self.request[0] == BROADCAST
    }

    /// Bytes of a register.
    pub const fn register_bytes(&self) -> usize {
        if self.long { 4 } else { 2 }
    }

    /// Third word of the request: a number of elements, a state, a test value.
    pub const fn value(&self) -> u16 {
        u16::from_be_bytes([self.request[4], self.request[5]])
    }

    /// Bytes that this number of bits takes.
    pub const fn bit_bytes(&self) -> usize {
        (self.value() as usize).div_ceil(8)
    }

    /// The fixed part of the source area. [S4 L1604-L1618]
    const fn least_len(&self) -> usize {
        match self.function {
            Function::ReadExceptionStatus | Function::EventCounter | Function::EventLog => 2,
            Function::WriteRegister => 4 + self.register_bytes(),
            _ => 6,
        }
    }

    fn put(&mut self, bytes: &[u8]) {
        // Every caller has checked a number that the manual limits so that the telegram holds it.
        if let Some(place) = self.request.get_mut(self.len..self.len + bytes.len()) {
            place.copy_from_slice(bytes);
            self.len += bytes.len();
        }
    }

    /// Checks the third word.
    fn check_value(&self) -> Result<(), u16> {
        let value = self.value();
        let (allowed, number) = match self.function {
            // [S4 "5.1 Function Code 01 – Read Coils"], [S4 "5.2 Function Code 02 – Read Discrete Input"]
            Function::ReadCoils | Function::ReadInputs => ((1..=2008).contains(&value), number::READ_BITS),
            // [S4 "5.4 Function Code 03 – Read 32-Bit Holding Registers"]
            Function::ReadHoldingRegisters if self.long => ((1..=62).contains(&value), number::READ_REGISTERS),
            Function::ReadHoldingRegisters | Function::ReadInputRegisters => {
                ((1..=125).contains(&value), number::READ_REGISTERS)
            }
            // [S4 L1106-L1107]
            Function::WriteCoil => (matches!(value, 0xFF00 | 0), number::BIT_STATE),
            // [S4 "Diagnostic Code"]: the second word.
            Function::LoopBack => (self.request[2..4] == [0, 0], number::DIAGNOSTIC_CODE),
            // [S4 L1424]
            Function::WriteCoils => ((1..=1976).contains(&value), number::WRITE_COUNT),
            // [S4 "5.15 Function Code 16 – Write Multiple 32-Bit Registers"]
            Function::WriteRegisters if self.long => ((1..=61).contains(&value), number::WRITE_COUNT),
            Function::WriteRegisters => ((1..=123).contains(&value), number::WRITE_COUNT),
            _ => (true, 0),
        };
        if allowed { Ok(()) } else { Err(number) }
    }

    /// Functions 15 and 16: byte counter and data. "The parameter byte counter in the request message is generated by
    /// the driver." [S4 L1425]
    fn put_data(&mut self, source: &[u8]) -> Result<(), u16> {
        let bytes = match self.function {
            Function::WriteCoils => self.bit_bytes(),
            Function::WriteRegisters => self.register_bytes() * usize::from(self.value()),
            _ => return Ok(()),
        };
        // The area holds whole words: at least 8 bytes of it. [S4 L1616]
        let data = source.get(6..6 + bytes.next_multiple_of(2)).ok_or(number::LEN_COUNT)?;
        // At most 247, limited by the number of elements.
        self.put(&[bytes as u8]);
        if self.function == Function::WriteRegisters {
            self.put(data);
            return Ok(());
        }
        // "coil_state[1] EFCD: Status Coil 5FH..58H/57H..50H": the low byte of each word is sent first, unchanged. [S4
        // L1434]
        for (at, word) in data.chunks_exact(2).enumerate() {
            let both = [word[1], word[0]];
            self.put(both.get(..(bytes - 2 * at).min(2)).unwrap_or(&[]));
        }
        Ok(())
    }
}

/// Function and register width of a code in the source area.
fn function_of(code: u8, long_registers: bool) -> Result<(Function, bool), u16> {
    // Without the parameter the bit does not exist, and the code is not in the list (ours).
    let is_long = long_registers && code & LONG_BIT != 0;
    let base = if is_long { code & !LONG_BIT } else { code };
    match Function::of(base) {
        Some(function) if is_long && function.has_long_registers() => Ok((function, true)),
        // "Access to 32-bit registers is only allowed with function code 03, 06, 16." [S4 L1802]
        _ if is_long => Err(number::LONG_REGISTERS),
        Some(function) => Ok((function, false)),
        None => Err(number::FUNCTION),
    }
}
