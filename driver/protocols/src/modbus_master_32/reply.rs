//! A reply: compared with its request, and converted to the RCV destination area of the program. [S4 "5 Function
//! Codes"]

use super::{DESTINATION_BYTES, number};
use crate::modbus_master_32::job::{Function, Job};

/// Set in the function code of a reply that announces an error. [S4 "Exception Responses"]
const ERROR_BIT: u8 = 0x80;

/// Bytes of a full event log: three words and 64 events. [S4 L1394]
const EVENT_LOG_BYTES: usize = 70;

/// Bytes of an event log without an event: its three words.
const EVENT_LOG_HEAD: usize = 6;

/// The destination area, with the bytes in use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Destination {
    bytes: [u8; DESTINATION_BYTES],
    len: usize,
}

impl Destination {
    const EMPTY: Self = Self { bytes: [0; DESTINATION_BYTES], len: 0 };

    /// The bytes to enter from the area's first byte on; P_RCV_RK shows their number as LEN. Empty: nothing is entered.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }

    fn of(data: &[u8]) -> Self {
        let mut area = Self::EMPTY;
        if let Some(place) = area.bytes.get_mut(..data.len()) {
            place.copy_from_slice(data);
            area.len = data.len();
        }
        area
    }

    /// Bits, word by word: "The 1st received byte is entered as the Low Byte of the 1st word, the 2nd as the High
    /// Byte". An odd last byte has 00h as its high byte, and "any unaccessed bits in the last received byte are masked
    /// to zero". [S4 L896-L898]
    fn of_bits(data: &[u8], count: u16) -> Self {
        let mut area = Self::EMPTY;
        area.len = data.len().next_multiple_of(2);
        for (at, byte) in data.iter().enumerate() {
            let is_last = at + 1 == data.len();
            let used = if is_last && !count.is_multiple_of(8) { (1 << (count % 8)) - 1 } else { 0xFF };
            // The low byte of an S7 word is at the odd address.
            if let Some(place) = area.bytes.get_mut(at ^ 1) {
                *place = byte & used;
            }
        }
        area
    }
}

/// Checks a reply (address first, correct LRC already removed) against its job.
///
/// # Errors
/// The event number; then nothing is entered into the destination area. [S4 L757], [S4 "How to Handle an Error"]
pub fn evaluate(job: &Job, reply: &[u8]) -> Result<Destination, u16> {
    let request = job.request();
    let &[address, code, ref data @ ..] = reply else { return Err(number::REPLY_SHORT) };
    if address != request[0] {
        return Err(number::REPLY_ADDRESS);
    }
    if code == request[1] | ERROR_BIT {
        return Err(exception(data));
    }
    if code != request[1] {
        return Err(number::REPLY_FUNCTION);
    }
    match job.function() {
        Function::ReadCoils | Function::ReadInputs => {
            let data = counted(data, job.bit_bytes())?;
            Ok(Destination::of_bits(data, job.value()))
        }
        Function::ReadHoldingRegisters => registers(job, data),
        Function::ReadInputRegisters => {
            Ok(Destination::of(counted(data, job.register_bytes() * usize::from(job.value()))?))
        }
        // "The Low Byte of data[1] remains unchanged. Value 1 is displayed as the length in parameter LEN." [S4 L1274]
        Function::ReadExceptionStatus => Ok(Destination::of(exactly(data, 1)?)),
        Function::EventCounter => Ok(Destination::of(exactly(data, 4)?)),
        Function::EventLog => Ok(Destination::of(event_log(data)?)),
        // The request itself. [S4 "5.6 Function Code 05 – Write Single Coil"], [S4 L1326]
        Function::WriteCoil | Function::WriteRegister | Function::LoopBack => echo(request, reply),
        // Start address and number. [S4 L1455], [S4 L1506]
        Function::WriteCoils | Function::WriteRegisters => echo(request.get(..6).unwrap_or(request), reply),
    }
}

/// Exception codes 1 to 7 have a number each. [S4 L1819-L1825] Any other code counts as a wrong function code (ours).
fn exception(data: &[u8]) -> u16 {
    match data {
        [] => number::REPLY_SHORT,
        [code @ 1..=7] => number::EXCEPTION + u16::from(*code),
        [_] => number::REPLY_FUNCTION,
        _ => number::REPLY_LONG,
    }
}

/// "... less than is expected with this function code", "... more than ...". [S4 L1809], [S4 L1810]
fn exactly(data: &[u8], bytes: usize) -> Result<&[u8], u16> {
    match data.len() {
        len if len < bytes => Err(number::REPLY_SHORT),
        len if len > bytes => Err(number::REPLY_LONG),
        _ => Ok(data),
    }
}

/// The bytes after a byte counter, which must be as many as it says.
fn behind_counter(data: &[u8]) -> Result<&[u8], u16> {
    let (counter, data) = data.split_first().ok_or(number::REPLY_SHORT)?;
    exactly(data, usize::from(*counter))
}

/// The same, and as many as were requested.
fn counted(data: &[u8], bytes: usize) -> Result<&[u8], u16> {
    let data = behind_counter(data)?;
    match data.len() {
        len if len < bytes => Err(number::COUNTER_SMALL),
        len if len > bytes => Err(number::COUNTER_WRONG),
        _ => Ok(data),
    }
}

/// Function 03. A slave that answers with registers of the other width is distinguished from one that counts wrongly:
/// "check accessed address of the slave whether it belongs to the expected memory area (16/32-bit)". [S4 L844], [S4
/// L1809-L1810]
fn registers(job: &Job, data: &[u8]) -> Result<Destination, u16> {
    let count = usize::from(job.value());
    let other_width = 6 - job.register_bytes();
    match (counted(data, job.register_bytes() * count), data.len().saturating_sub(1) == other_width * count) {
        (Ok(data), _) => Ok(Destination::of(data)),
        (Err(number::COUNTER_SMALL), true) => Err(number::REPLY_SHORT),
        (Err(number::COUNTER_WRONG), true) => Err(number::REPLY_LONG),
        (Err(number), _) => Err(number),
    }
}

/// Function 12. The manual's slave has 64 event bytes; a slave that reports fewer is accepted (ours; the Modbus
/// specification has "0 to 64").
fn event_log(data: &[u8]) -> Result<&[u8], u16> {
    let data = behind_counter(data)?;
    match data.len() {
        0..EVENT_LOG_HEAD => Err(number::COUNTER_SMALL),
        EVENT_LOG_HEAD..=EVENT_LOG_BYTES => Ok(data),
        _ => Err(number::COUNTER_WRONG),
    }
}

/// "The data of the reply message echoed from the slave are different from the data sent." [S4 L1813]
fn echo(expected: &[u8], reply: &[u8]) -> Result<Destination, u16> {
    if exactly(reply, expected.len())? == expected { Ok(Destination::EMPTY) } else { Err(number::ECHO) }
}
