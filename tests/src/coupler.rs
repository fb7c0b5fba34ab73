//! A Modbus coupler with a watchdog, for simulations and benchmarks: input words, output words, and the watchdog of a
//! WAGO 750. Written from the manufacturers' manuals and the Modbus specification; it shares neither codec nor checks
//! with the code under test.

use ob1_time::{Instant, Span};

/// Watchdog time in 100 ms.
const TIME: u16 = 0x1000;
/// 1: the watchdog runs; 2: it has expired.
const RUNNING: u16 = 0x1006;
/// 55AAh or AA55h stops the watchdog and clears its fault.
const STOP: u16 = 0x1008;
/// 1: every telegram triggers the watchdog, the next one starts it.
const ALTERNATIVE: u16 = 0x100A;
const UNIT: Span = Span::from_millis(100);

const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;
const DEVICE_FAILURE: u8 = 4;

/// A coupler. To simulate power off, create a new one.
#[derive(Clone, Debug)]
pub struct Coupler {
    /// Its address; 255 accepts any address.
    pub unit: u8,
    /// Input registers, from 0 on.
    pub sensed: Vec<u16>,
    /// Holding registers, from 0 on.
    pub driven: Vec<u16>,
    /// Values written to its holding registers, one entry for each telegram.
    pub writes: Vec<Vec<u16>>,
    /// Telegrams that read input registers.
    pub reads: u64,
    /// Time of the last valid telegram.
    pub heard: Instant,
    time: u16,
    armed: bool,
    expired: bool,
    /// Time at which its outputs are switched off.
    until: Option<Instant>,
}

impl Coupler {
    /// A coupler with this many words in each direction, all 0.
    #[must_use]
    pub fn new(unit: u8, words: usize) -> Self {
        Self {
            unit,
            sensed: vec![0; words],
            driven: vec![0; words],
            writes: Vec::new(),
            reads: 0,
            heard: Instant::START,
            time: 0,
            armed: false,
            expired: false,
            until: None,
        }
    }

    /// The next time at which [`Self::look`] has something to do.
    #[must_use]
    pub fn deadline(&self) -> Instant {
        self.until.unwrap_or(Instant::NEVER)
    }

    /// Checks its watchdog.
    pub fn look(&mut self, now: Instant) {
        if self.until.is_some_and(|until| now >= until) {
            (self.until, self.expired, self.armed) = (None, true, false);
            self.driven.fill(0);
        }
    }

    /// Answers a request: unit, function, data. `None` if it is for another coupler or not valid.
    pub fn hear(&mut self, now: Instant, request: &[u8]) -> Option<Vec<u8>> {
        self.look(now);
        let &[unit, function, a, b, c, d, ref rest @ ..] = request else { return None };
        if self.unit != 255 && unit != self.unit {
            return None;
        }
        let (first, value) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        self.heard = now;
        let clears = function == 6 && first == STOP && matches!(value, 0x55AA | 0xAA55);
        let answer = if self.expired && !clears {
            Err(DEVICE_FAILURE)
        } else {
            if self.armed {
                self.until = Some(now + u64::from(self.time) * UNIT);
            }
            self.obey(function, first, value, rest)
        };
        let mut telegram = vec![unit];
        match answer {
            Ok(data) => telegram.extend([function].into_iter().chain(data)),
            Err(exception) => telegram.extend([function | 0x80, exception]),
        }
        Some(telegram)
    }

    fn obey(&mut self, function: u8, first: u16, value: u16, rest: &[u8]) -> Result<Vec<u8>, u8> {
        let echo = || [first.to_be_bytes(), value.to_be_bytes()].concat();
        match function {
            3 if first >= TIME => {
                let registers: Vec<u16> = (TIME..=RUNNING).map(|at| self.register(at)).collect();
                read(&registers, first - TIME, value)
            }
            3 => read(&self.driven, first, value),
            4 => {
                self.reads += 1;
                read(&self.sensed, first, value)
            }
            6 if first >= TIME => self.set(first, value).map(|()| echo()),
            6 => self.write(first, &[value]).map(|()| echo()),
            0x10 => {
                let [count, data @ ..] = rest else { return Err(ILLEGAL_VALUE) };
                let words = words(data);
                if usize::from(*count) != data.len() || words.len() != usize::from(value) {
                    return Err(ILLEGAL_VALUE);
                }
                self.write(first, &words).map(|()| echo())
            }
            0x17 => {
                let &[a, b, c, d, count, ref data @ ..] = rest else { return Err(ILLEGAL_VALUE) };
                let words = words(data);
                let wanted = usize::from(u16::from_be_bytes([c, d]));
                if usize::from(count) != data.len() || words.len() != wanted {
                    return Err(ILLEGAL_VALUE);
                }
                self.write(u16::from_be_bytes([a, b]), &words)?;
                read(&self.driven, first, value)
            }
            _ => Err(ILLEGAL_FUNCTION),
        }
    }

    fn register(&self, at: u16) -> u16 {
        match at {
            TIME => self.time,
            RUNNING => u16::from(self.until.is_some()) | u16::from(self.expired) << 1,
            _ => 0,
        }
    }

    fn write(&mut self, first: u16, words: &[u16]) -> Result<(), u8> {
        let first = usize::from(first);
        let place = self.driven.get_mut(first..first + words.len()).ok_or(ILLEGAL_ADDRESS)?;
        place.copy_from_slice(words);
        self.writes.push(self.driven.clone());
        Ok(())
    }

    /// Writes a register of the watchdog. A running watchdog can only be stopped.
    fn set(&mut self, at: u16, value: u16) -> Result<(), u8> {
        match (at, value) {
            (STOP, 0x55AA | 0xAA55) => (self.until, self.expired, self.armed) = (None, false, false),
            (TIME, _) if self.until.is_none() => self.time = value,
            (ALTERNATIVE, 0) if self.until.is_none() => self.armed = false,
            (ALTERNATIVE, 1) if self.until.is_none() => self.armed = self.time > 0,
            (TIME | STOP | ALTERNATIVE, _) => return Err(ILLEGAL_VALUE),
            _ => return Err(ILLEGAL_ADDRESS),
        }
        Ok(())
    }
}

fn words(bytes: &[u8]) -> Vec<u16> {
    bytes.chunks_exact(2).map(|pair| u16::from(pair[0]) << 8 | u16::from(pair[1])).collect()
}

fn read(words: &[u16], first: u16, count: u16) -> Result<Vec<u8>, u8> {
    let (first, count) = (usize::from(first), usize::from(count));
    if !(1..=125).contains(&count) {
        return Err(ILLEGAL_VALUE);
    }
    let words = words.get(first..first + count).ok_or(ILLEGAL_ADDRESS)?;
    Ok([(2 * count) as u8].into_iter().chain(words.iter().flat_map(|word| word.to_be_bytes())).collect())
}

/// The byte stream of a Modbus TCP connection.
#[derive(Clone, Debug, Default)]
pub struct Stream(Vec<u8>);

impl Stream {
    /// Takes received bytes, and calls `each` for every complete telegram with its transaction: unit, function, data.
    /// `false`: it is not Modbus.
    pub fn take(&mut self, bytes: &[u8], mut each: impl FnMut(u16, &[u8])) -> bool {
        self.0.extend_from_slice(bytes);
        while let &[t0, t1, p0, p1, l0, l1, ref rest @ ..] = self.0.as_slice() {
            let len = usize::from(u16::from_be_bytes([l0, l1]));
            if (p0, p1) != (0, 0) || !(2..=254).contains(&len) {
                return false;
            }
            let Some(telegram) = rest.get(..len) else { break };
            each(u16::from_be_bytes([t0, t1]), telegram);
            self.0.drain(..6 + len);
        }
        true
    }
}

/// A telegram with its header for a connection.
#[must_use]
pub fn framed(transaction: u16, telegram: &[u8]) -> Vec<u8> {
    let len = telegram.len() as u16;
    [&transaction.to_be_bytes()[..], &[0, 0], &len.to_be_bytes(), telegram].concat()
}

/// The check sum of Modbus RTU: CRC 16, A001h, low byte first.
#[must_use]
pub fn crc(bytes: &[u8]) -> [u8; 2] {
    let fold = |crc: u16, byte: &u8| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 })
    };
    bytes.iter().fold(0xFFFF, fold).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_watchdog_that_is_set_switches_off_and_is_cleared() {
        let mut coupler = Coupler::new(1, 2);
        let drive = [1, 0x10, 0, 0, 0, 2, 4, 0, 7, 0, 8];
        let done = Some(vec![1, 0x10, 0, 0, 0, 2]);
        assert_eq!(coupler.hear(Instant::START, &drive), done);
        coupler.look(Instant::NEVER);
        assert_eq!(coupler.driven, [7, 8], "nobody has set it");
        for (at, value) in [(0x10, 0), (0, 2), (0x0A, 1)] {
            assert!(coupler.hear(Instant::START, &[1, 6, 0x10, at, 0, value]).is_some());
        }
        coupler.look(Instant::from_millis(5));
        assert_eq!(coupler.deadline(), Instant::NEVER, "the next telegram starts it");
        assert_eq!(coupler.hear(Instant::from_millis(10), &drive), done);
        assert_eq!(
            coupler.hear(Instant::from_millis(20), &[1, 6, 0x10, 0x00, 0, 9]),
            Some(vec![1, 0x86, ILLEGAL_VALUE]),
            "it runs"
        );
        assert_eq!(coupler.hear(Instant::from_millis(20), &[1, 3, 0x10, 6, 0, 1]), Some(vec![1, 3, 2, 0, 1]));
        coupler.look(Instant::from_millis(219));
        assert_eq!(coupler.driven, [7, 8]);
        coupler.look(Instant::from_millis(220));
        assert_eq!(coupler.driven, [0, 0]);
        assert_eq!(coupler.hear(Instant::from_millis(230), &[1, 4, 0, 0, 0, 1]), Some(vec![1, 0x84, DEVICE_FAILURE]));
        assert!(coupler.hear(Instant::from_millis(230), &[1, 6, 0x10, 8, 0x55, 0xAA]).is_some());
        assert_eq!(coupler.hear(Instant::from_millis(240), &[1, 4, 0, 0, 0, 1]), Some(vec![1, 4, 2, 0, 0]));
        assert_eq!(coupler.hear(Instant::from_millis(240), &[2, 4, 0, 0, 0, 1]), None, "another's");
    }

    #[test]
    fn frames() {
        // The example of the Modbus specification's appendix on the CRC: 02 07 has 41 12.
        assert_eq!(crc(&[2, 7]), [0x41, 0x12]);
        let mut stream = Stream::default();
        let mut all = Vec::new();
        let bytes = [framed(1, &[9, 3, 0]), framed(0xABCD, &[9, 4])].concat();
        for byte in bytes {
            assert!(stream.take(&[byte], |transaction, telegram| all.push((transaction, telegram.to_vec()))));
        }
        assert_eq!(all, [(1, vec![9, 3, 0]), (0xABCD, vec![9, 4])]);
        assert!(!stream.take(&[0, 1, 0, 1, 0, 4], |_, _| {}));
    }
}
