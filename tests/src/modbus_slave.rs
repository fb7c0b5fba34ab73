//! A Modbus slave in ASCII with 16-bit and 32-bit registers, for simulations. Written from the manual of the master and
//! the Modbus specification; it shares neither codec nor checks with the code under test.
//!
//! The address determines the width of a register. If the master uses the wrong width, the slave behaves as in the
//! manual: it reads its own number of bytes, and refuses to write another number. [S4 "32-Bit Registers"]

/// Number of bits and registers of each kind.
pub const SIZE: u16 = 4000;

/// Address of the first 32-bit register; there are [`LONGS`] of them.
pub const LONG_FIRST: u16 = 5000;

/// Number of 32-bit registers.
pub const LONGS: u16 = 200;

/// Exceptions. [S4 "4.2 Exception Responses"]
const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;

/// The slave with its memory.
#[derive(Clone, Debug)]
pub struct ModbusSlave {
    /// Its address.
    pub address: u8,
    /// Functions 01, 05, 15.
    pub coils: Vec<bool>,
    /// Function 02.
    pub inputs: Vec<bool>,
    /// Functions 03, 06, 16.
    pub registers: Vec<u16>,
    /// The same functions, from [`LONG_FIRST`] on.
    pub longs: Vec<u32>,
    /// Function 04.
    pub input_registers: Vec<u16>,
    /// Function 07.
    pub exception_status: u8,
    /// Answers each request to it with this exception, if any.
    pub refuses: Option<u8>,
    /// Function 11: executed requests.
    pub events: u16,
    /// Function 12: received requests.
    pub messages: u16,
    /// Function 12: newest first.
    pub log: [u8; 64],
    /// Characters since the last colon.
    line: Option<Vec<u8>>,
}

impl ModbusSlave {
    /// A slave with all values 0.
    #[must_use]
    pub fn new(address: u8) -> Self {
        let size = usize::from(SIZE);
        Self {
            address,
            coils: vec![false; size],
            inputs: vec![false; size],
            registers: vec![0; size],
            longs: vec![0; usize::from(LONGS)],
            input_registers: vec![0; size],
            exception_status: 0,
            refuses: None,
            events: 0,
            messages: 0,
            log: [0; 64],
            line: None,
        }
    }

    /// Takes characters; returns the answer.
    pub fn hear(&mut self, characters: &[u8]) -> Vec<u8> {
        let mut answers = Vec::new();
        for character in characters {
            match (character, &mut self.line) {
                (b':', line) => *line = Some(Vec::new()),
                (b'\n', line) => {
                    let text = line.take().unwrap_or_default();
                    if let Some(answer) = unframed(&text).and_then(|telegram| self.telegram(&telegram)) {
                        answers.extend(framed(&answer));
                    }
                }
                (character, Some(text)) => text.push(*character),
                (_, None) => {}
            }
        }
        answers
    }

    /// Handles a telegram without LRC; returns the answer, if any.
    fn telegram(&mut self, telegram: &[u8]) -> Option<Vec<u8>> {
        let &[address, function, ref data @ ..] = telegram else { return None };
        let is_for_all = address == 0;
        if !is_for_all && address != self.address {
            return None;
        }
        self.messages = self.messages.wrapping_add(1);
        // Event bytes of the specification: 1xxxxxxx received (bit 6: broadcast), 01xxxxxx sent (bit 0 to 3:
        // exception).
        self.note(if is_for_all { 0xC0 } else { 0x80 });
        let done = self.refuses.map_or_else(|| self.carry_out(function, data), Err);
        // Function 11 does not count itself.
        if done.is_ok() && function != 11 {
            self.events = self.events.wrapping_add(1);
        }
        if is_for_all {
            return None;
        }
        self.note(match done {
            Ok(_) => 0x40,
            Err(1..=3) => 0x41,
            Err(4) => 0x42,
            Err(5 | 6) => 0x44,
            Err(_) => 0x48,
        });
        let mut answer = vec![self.address];
        match done {
            Ok(data) => {
                answer.push(function);
                answer.extend(data);
            }
            Err(exception) => answer.extend([function | 0x80, exception]),
        }
        Some(answer)
    }

    fn note(&mut self, event: u8) {
        self.log.rotate_right(1);
        self.log[0] = event;
    }

    /// Executes a request; returns the data after the function code in the answer, or the exception.
    fn carry_out(&mut self, function: u8, data: &[u8]) -> Result<Vec<u8>, u8> {
        let word = |at: usize| Some(u16::from_be_bytes(data.get(at..at + 2)?.try_into().ok()?));
        let pair = || word(0).zip(word(2)).filter(|_| data.len() == 4).ok_or(ILLEGAL_VALUE);
        match function {
            1 | 2 => {
                let (first, count) = pair()?;
                let bits = if function == 1 { &self.coils } else { &self.inputs };
                let bits = bits.get(range(first, count, 2008, SIZE)?).ok_or(ILLEGAL_ADDRESS)?;
                // The first bit is the lowest of the first byte. [S4 L876-L878]
                let bytes =
                    bits.chunks(8).map(|eight| eight.iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(*bit)));
                Ok(counted(bytes.collect()))
            }
            3 if word(0).is_some_and(|first| first >= LONG_FIRST) => {
                let (first, count) = pair()?;
                let longs = self.longs.get(range(first - LONG_FIRST, count, 62, LONGS)?).ok_or(ILLEGAL_ADDRESS)?;
                Ok(counted(longs.iter().flat_map(|long| long.to_be_bytes()).collect()))
            }
            3 | 4 => {
                let (first, count) = pair()?;
                let words = if function == 3 { &self.registers } else { &self.input_registers };
                let words = words.get(range(first, count, 125, SIZE)?).ok_or(ILLEGAL_ADDRESS)?;
                Ok(counted(words.iter().flat_map(|word| word.to_be_bytes()).collect()))
            }
            5 => {
                let (at, state) = pair()?;
                let coil = self.coils.get_mut(usize::from(at)).ok_or(ILLEGAL_ADDRESS)?;
                *coil = match state {
                    0xFF00 => true,
                    0x0000 => false,
                    _ => return Err(ILLEGAL_VALUE),
                };
                Ok(data.to_vec())
            }
            6 => {
                let at = word(0).ok_or(ILLEGAL_VALUE)?;
                self.store(at, &data[2..])?;
                Ok(data.to_vec())
            }
            7 if data.is_empty() => Ok(vec![self.exception_status]),
            8 => match pair()? {
                (0, _) => Ok(data.to_vec()),
                _ => Err(ILLEGAL_FUNCTION),
            },
            11 if data.is_empty() => Ok([[0; 2], self.events.to_be_bytes()].concat()),
            12 if data.is_empty() => {
                let words = [[0; 2], self.events.to_be_bytes(), self.messages.to_be_bytes()].concat();
                Ok(counted([&words[..], &self.log[..]].concat()))
            }
            15 => {
                let (first, count) = word(0).zip(word(2)).ok_or(ILLEGAL_VALUE)?;
                let [bytes, values @ ..] = data.get(4..).unwrap_or(&[]) else { return Err(ILLEGAL_VALUE) };
                let range = range(first, count, 1976, SIZE)?;
                if usize::from(*bytes) != values.len() || values.len() != range.len().div_ceil(8) {
                    return Err(ILLEGAL_VALUE);
                }
                for (n, at) in range.enumerate() {
                    self.coils[at] = values[n / 8] >> (n % 8) & 1 != 0;
                }
                Ok(data[..4].to_vec())
            }
            16 => {
                let (first, count) = word(0).zip(word(2)).ok_or(ILLEGAL_VALUE)?;
                let [bytes, values @ ..] = data.get(4..).unwrap_or(&[]) else { return Err(ILLEGAL_VALUE) };
                let is_long = first >= LONG_FIRST;
                let width = if is_long { 4 } else { 2 };
                if usize::from(*bytes) != values.len() || values.len() != width * usize::from(count) {
                    // "... the slave should return an exception response to the master." [S4 L846]
                    return Err(ILLEGAL_VALUE);
                }
                let end = if is_long { LONG_FIRST + LONGS } else { SIZE };
                range(first, count, if is_long { 61 } else { 123 }, end)?;
                for (at, value) in (first..).zip(values.chunks(width)) {
                    self.store(at, value)?;
                }
                Ok(data[..4].to_vec())
            }
            7 | 11 | 12 => Err(ILLEGAL_VALUE),
            _ => Err(ILLEGAL_FUNCTION),
        }
    }

    /// Writes one register; the number of bytes must be correct.
    fn store(&mut self, at: u16, value: &[u8]) -> Result<(), u8> {
        if let Some(n) = at.checked_sub(LONG_FIRST) {
            let long = self.longs.get_mut(usize::from(n)).ok_or(ILLEGAL_ADDRESS)?;
            *long = u32::from_be_bytes(value.try_into().map_err(|_| ILLEGAL_VALUE)?);
        } else {
            let word = self.registers.get_mut(usize::from(at)).ok_or(ILLEGAL_ADDRESS)?;
            *word = u16::from_be_bytes(value.try_into().map_err(|_| ILLEGAL_VALUE)?);
        }
        Ok(())
    }
}

/// `first` and `count` as a range, if the count is 1 to `most` and the range ends by `end`.
fn range(first: u16, count: u16, most: u16, end: u16) -> Result<std::ops::Range<usize>, u8> {
    if !(1..=most).contains(&count) {
        return Err(ILLEGAL_VALUE);
    }
    let (first, last) = (usize::from(first), usize::from(first) + usize::from(count));
    if last <= usize::from(end) { Ok(first..last) } else { Err(ILLEGAL_ADDRESS) }
}

fn counted(bytes: Vec<u8>) -> Vec<u8> {
    let count = u8::try_from(bytes.len()).expect("limited by the number of elements");
    std::iter::once(count).chain(bytes).collect()
}

/// "Add all bytes in the message. Build the two's-complement. Convert the LRC to ASCII." [S4 L670-L672]
fn framed(telegram: &[u8]) -> Vec<u8> {
    let sum = telegram.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    let digits: String = telegram.iter().chain([&sum.wrapping_neg()]).map(|byte| format!("{byte:02X}")).collect();
    format!(":{digits}\r\n").into_bytes()
}

/// The telegram between colon and LF, if it is valid.
fn unframed(text: &[u8]) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(text).ok()?.strip_suffix('\r')?;
    if text.len() % 2 != 0 || !text.bytes().all(|digit| matches!(digit, b'0'..=b'9' | b'A'..=b'F')) {
        return None;
    }
    let bytes: Option<Vec<u8>> =
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).ok()).collect();
    let mut bytes = bytes?;
    let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    bytes.pop()?;
    (sum == 0).then_some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answers printed in the manual. [S4 "5 Function Codes"]
    #[test]
    fn the_examples_of_the_manual() {
        let mut slave = ModbusSlave::new(5);
        for n in [0x40, 0x48, 0x49, 0x4A, 0x4C, 0x4D, 0x4E] {
            slave.coils[n] = true;
        }
        (slave.registers[0x40], slave.registers[0x41]) = (0x2123, 0x2527);
        (slave.longs[0], slave.longs[1]) = (0x2122_2324, 0x2526_2728);
        slave.exception_status = 0x3E;
        // LRC by hand: 05+08+A5+C3 = 175h, 100h - 75h = 8Bh; and so on.
        for (request, answer) in [
            (":05080000A5C38B\r\n", ":05080000A5C38B\r\n"),
            (":05010040000FAB\r\n", ":0501020177 80\r\n"),
            (":050300400002B6\r\n", ":0503042123252764\r\n"),
            // In two pieces, the first one twice: a colon starts a new telegram.
            (":0503138800", ""),
            (":0503138800025B\r\n", ":0503082122232425262728 CC\r\n"),
            // Function 07 has no data.
            (":050700F4\r\n", ":058703 71\r\n"),
            (":0507F4\r\n", ":05073EB6\r\n"),
            // For another slave; a wrong LRC; a lower-case letter.
            (":060300400002B5\r\n", ""),
            (":050300400002B7\r\n", ""),
            (":050300400002b6\r\n", ""),
        ] {
            let said = String::from_utf8(slave.hear(request.as_bytes())).expect("ASCII");
            let answer = answer.replace(' ', "");
            assert_eq!(said, answer, "{request}");
        }
    }
}
