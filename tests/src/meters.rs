//! Meters on an M-Bus, for simulations: takes the frames of a master and returns the answers of the bus. Written from
//! EN 13757 and the tables of the manual, without the code under test.
//!
//! [S0 "Overview of M-Bus telegrams"], [S0 "A field"], [S0 "FCB bit"]. If several meters send at the same time, a 0 bit
//! of one overwrites the 1 bits of the others.

const SINGLE: u8 = 0xE5;
/// Address of the selected meter, of any meter, of all meters.
const SELECTED: u8 = 253;
const ANY: u8 = 254;
const ALL: u8 = 255;

/// A fault of a meter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// The meter is off.
    Silent,
    /// The checksums of this many next answers are wrong.
    Check(u32),
    /// This many next answers are truncated.
    Cut(u32),
}

/// A meter.
#[derive(Clone, Debug)]
pub struct Meter {
    /// Primary address.
    pub address: u8,
    /// Secondary address for the selection: identification, manufacturer, version, medium.
    pub secondary: [u8; 8],
    /// Its answers to REQ_UD2, as transmitted; a toggled FCB requests the next one.
    pub answers: Vec<Vec<u8>>,
    /// Its fault.
    pub trouble: Option<Trouble>,
    /// User data received, with the CI field.
    pub told: Vec<Vec<u8>>,
    selected: bool,
    /// FCB of the last request, and the answer it got.
    last: Option<(bool, usize)>,
}

impl Meter {
    /// A meter with one answer. Its secondary address is taken from an answer with variable data.
    #[must_use]
    pub fn new(address: u8, answer: &[u8]) -> Self {
        let secondary = answer.get(7..15).and_then(|id| id.try_into().ok()).unwrap_or_default();
        let answers = vec![answer.to_vec()];
        Self { address, secondary, answers, trouble: None, told: Vec::new(), selected: false, last: None }
    }

    /// The same with this fault.
    #[must_use]
    pub fn with(mut self, trouble: Option<Trouble>) -> Self {
        self.trouble = trouble;
        self
    }

    /// The same with a further answer.
    #[must_use]
    pub fn then(mut self, answer: &[u8]) -> Self {
        self.answers.push(answer.to_vec());
        self
    }

    /// Whether a selection matches: Fh is any digit, FFh any byte after the identification.
    fn is_meant(&self, pattern: &[u8]) -> bool {
        let digit = |wanted: u8, own: u8| wanted == 0xF || wanted == own;
        pattern.len() >= 8
            && self.secondary.iter().zip(pattern).enumerate().all(|(at, (own, wanted))| match at {
                0..4 => digit(wanted >> 4, own >> 4) && digit(wanted & 0xF, own & 0xF),
                _ => *wanted == 0xFF || wanted == own,
            })
    }

    /// Handles a frame from the master; returns the answer, if any.
    fn frame(&mut self, fields: &[u8]) -> Option<Vec<u8>> {
        let (&c, &a) = (fields.first()?, fields.get(1)?);
        let selection = a == SELECTED && fields.get(2) == Some(&0x52);
        if selection && c & 0x4F == 0x43 {
            self.selected = self.is_meant(&fields[3..]);
            return self.selected.then(|| vec![SINGLE]);
        }
        let mine = match a {
            SELECTED => self.selected,
            ANY | ALL => true,
            address => address == self.address,
        };
        if !mine {
            return None;
        }
        let answer = match c & 0x4F {
            0x40 => {
                self.last = None;
                if a == SELECTED {
                    self.selected = false;
                }
                vec![SINGLE]
            }
            0x43 => {
                self.told.push(fields.get(2..)?.to_vec());
                vec![SINGLE]
            }
            0x4B => self.request(c & 0x20 != 0),
            // No class 1 data.
            0x4A => vec![SINGLE],
            _ => return None,
        };
        (a != ALL).then_some(answer)
    }

    /// Answers a request. The same FCB: the last answer again. [S0 "FCB bit"]
    fn request(&mut self, fcb: bool) -> Vec<u8> {
        let at = match self.last {
            Some((last, at)) if last == fcb => at,
            Some((_, at)) => (at + 1) % self.answers.len().max(1),
            None => 0,
        };
        self.last = Some((fcb, at));
        self.answers.get(at).cloned().unwrap_or_else(|| vec![SINGLE])
    }

    fn troubled(&mut self, mut answer: Vec<u8>) -> Option<Vec<u8>> {
        match &mut self.trouble {
            Some(Trouble::Silent) => return None,
            Some(Trouble::Check(times @ 1..)) => {
                *times -= 1;
                let at = answer.len().saturating_sub(2);
                answer[at] ^= 0x55;
            }
            Some(Trouble::Cut(times @ 1..)) => {
                *times -= 1;
                answer.truncate(answer.len().div_ceil(2));
            }
            _ => {}
        }
        Some(answer)
    }
}

/// The meters on one pair of wires.
#[derive(Clone, Debug, Default)]
pub struct Bus {
    /// The meters.
    pub meters: Vec<Meter>,
    /// Number of valid frames of the master.
    pub frames: u64,
    heard: Vec<u8>,
}

impl Bus {
    /// A bus of these meters.
    #[must_use]
    pub fn new(meters: Vec<Meter>) -> Self {
        Self { meters, ..Self::default() }
    }

    /// Takes characters of the master; returns the combined answer of all meters. Empty: no answer.
    pub fn hear(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut answer = Vec::new();
        for &byte in bytes {
            self.heard.push(byte);
            let Some(fields) = fields(&self.heard) else {
                // Characters that do not start a frame are discarded.
                if !matches!(self.heard[0], 0x10 | 0x68) || self.heard.len() > 261 {
                    self.heard.clear();
                }
                continue;
            };
            self.heard.clear();
            self.frames += 1;
            for meter in &mut self.meters {
                if let Some(own) = meter.frame(&fields).and_then(|own| meter.troubled(own)) {
                    pull(&mut answer, &own);
                }
            }
        }
        answer
    }

    /// A pause: discards an incomplete frame.
    pub fn pause(&mut self) {
        self.heard.clear();
    }
}

/// Combines two simultaneous senders: a 0 bit of one is a 0 bit on the line.
fn pull(line: &mut Vec<u8>, own: &[u8]) {
    for (at, byte) in own.iter().enumerate() {
        match line.get_mut(at) {
            Some(other) => *other &= byte,
            None => line.push(*byte),
        }
    }
}

/// The fields of a complete frame, from C field to user data.
#[must_use]
pub fn fields(bytes: &[u8]) -> Option<Vec<u8>> {
    let sum = |fields: &[u8]| fields.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    match *bytes {
        [SINGLE] => Some(vec![SINGLE]),
        [0x10, c, a, check, 0x16] if check == sum(&[c, a]) => Some(vec![c, a]),
        [0x68, l, again, 0x68, ref fields @ .., check, 0x16]
            if l == again && l >= 3 && fields.len() == usize::from(l) && check == sum(fields) =>
        {
            Some(fields.to_vec())
        }
        _ => None,
    }
}

/// A frame of the fixtures.
#[derive(Clone, Debug)]
pub struct Fixture {
    /// Folder and name.
    pub name: String,
    /// Its characters.
    pub bytes: Vec<u8>,
}

/// The answers of real meters in `tests/fixtures/mbus`, and invalid frames.
#[must_use]
pub fn fixtures() -> Vec<Fixture> {
    let text = include_str!("../fixtures/mbus/frames.txt");
    let lines = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    let frame = |line: &str| {
        let (name, digits) = line.split_once(' ')?;
        let bytes: Option<Vec<u8>> = (0..digits.len() / 2)
            .map(|n| digits.get(2 * n..2 * n + 2).and_then(|pair| u8::from_str_radix(pair, 16).ok()))
            .collect();
        Some(Fixture { name: name.to_owned(), bytes: bytes? })
    };
    lines.filter_map(frame).collect()
}

/// The published content of a frame of the fixtures.
#[derive(Clone, Debug)]
pub struct Said {
    /// Folder and name, as in [`Fixture`].
    pub name: String,
    /// Identification, manufacturer, version, medium.
    pub header: [String; 4],
    /// The records: function, storage number, quantity, unit, value.
    pub records: Vec<[String; 5]>,
}

/// The content of the frames that have one.
#[must_use]
pub fn values() -> Vec<Said> {
    let mut all: Vec<Said> = Vec::new();
    for line in include_str!("../fixtures/mbus/values.txt").lines() {
        let parts = |text: &str| text.split('|').map(str::to_owned).collect::<Vec<_>>();
        if let (Some(record), Some(last)) = (line.strip_prefix("  "), all.last_mut()) {
            last.records.extend(<[String; 5]>::try_from(parts(record)).ok());
        } else if let Some((name, header)) = line.split_once('|')
            && let Ok(header) = <[String; 4]>::try_from(parts(header))
        {
            all.push(Said { name: name.to_owned(), header, records: Vec::new() });
        }
    }
    all
}
