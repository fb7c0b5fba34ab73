//! Parameters of a CPU: cycle monitoring, clock memory, cyclic interrupts.
//!
//! They are records one after the other: the length (itself included), the number, the content, words big-endian.

/// What a CPU is set to; `None` and empty where the project says nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CpuParameters {
    /// Cycle monitoring time, in milliseconds.
    pub monitoring_ms: Option<u16>,
    /// The byte of clock memory.
    pub clock_memory: Option<u8>,
    /// Interval and phase offset of OB 30 to OB 38, in milliseconds.
    pub cyclic: Vec<Cyclic>,
    /// Numbers of the records that are there and not used.
    pub other: Vec<u8>,
}

/// The timing of a cyclic interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cyclic {
    /// OB 30 to 38.
    pub ob: u8,
    /// Interval from call to call, in milliseconds.
    pub period_ms: u16,
    /// Phase offset, in milliseconds.
    pub phase_ms: u16,
}

/// Cycle behaviour: communication load in percent, reserved, monitoring time.
pub(crate) const CYCLE: u8 = 0x02;
/// Clock memory: 1 where it is used, in a word, and its byte in the low byte of the next.
pub(crate) const CLOCK: u8 = 0x07;
/// Cyclic interrupts OB 30 to 38: priority, reserved, interval, phase offset.
pub(crate) const CYCLIC: u8 = 0x0D;

/// Reads the records. What is cut off, or has impossible lengths, ends the list.
pub(crate) fn read(bytes: &[u8]) -> CpuParameters {
    let mut parameters = CpuParameters::default();
    let mut rest = bytes;
    while let [length, number, ..] = rest {
        let length = usize::from(*length);
        if length < 2 || length > rest.len() {
            break;
        }
        let content = &rest[2..length];
        let word = |at: usize| content.get(at..at + 2).and_then(|b| b.try_into().ok()).map(u16::from_be_bytes);
        match *number {
            CYCLE => parameters.monitoring_ms = word(2).filter(|ms| *ms > 0),
            CLOCK if word(0) == Some(1) => parameters.clock_memory = content.get(3).copied(),
            CYCLIC => {
                let entries = content.chunks_exact(6).zip(30u8..39);
                let entries = entries.map(|(entry, ob)| Cyclic {
                    ob,
                    period_ms: u16::from_be_bytes([entry[2], entry[3]]),
                    phase_ms: u16::from_be_bytes([entry[4], entry[5]]),
                });
                parameters.cyclic = entries.filter(|c| c.period_ms > 0).collect();
            }
            number => parameters.other.push(number),
        }
        rest = &rest[length..];
    }
    parameters
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_one_behind_the_other() {
        let mut bytes = vec![0x0A, 0x02, 0x14, 0x01, 0x00, 0x96, 0, 0, 0, 0];
        bytes.extend([0x08, 0x07, 0x00, 0x01, 0x00, 0x63, 0xFF, 0xFF]);
        bytes.extend([0x0E, 0x0D, 7, 0, 0x13, 0x88, 0, 0, 8, 0, 0x07, 0xD0, 0, 5]);
        bytes.extend([0x04, 0x55, 1, 2, 0x00]);
        let parameters = read(&bytes);
        assert_eq!((parameters.monitoring_ms, parameters.clock_memory), (Some(150), Some(99)));
        assert_eq!(parameters.cyclic[1], Cyclic { ob: 31, period_ms: 2000, phase_ms: 5 });
        assert_eq!(parameters.other, [0x55]);
        for cut in 0..bytes.len() {
            let _ = read(&bytes[..cut]);
        }
    }
}
