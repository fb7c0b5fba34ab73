//! An answer: its header, and an iterator over its records.

use super::record::{Fault, Header, Record};
use super::{fixed, variable};

/// CI field: variable data structure, least significant byte first. [S0 "CI field"]
const VARIABLE: u8 = 0x72;
/// CI field: fixed data structure. [S0 "CI field"]
const FIXED: u8 = 0x73;
/// CI field: the meter reports an error of its application. [S0 "CI field"]
const APPLICATION_ERROR: u8 = 0x70;

/// Bytes of C, A and CI field.
const FIELDS: usize = 3;
/// Bytes of the header of a variable data structure: identification, manufacturer, version, medium, access number,
/// state, signature.
const VARIABLE_HEADER: usize = 12;
/// Bytes of a fixed data structure: identification, access number, state, medium and units, two counters.
const FIXED_BYTES: usize = 16;

/// An answer of a meter to REQ_UD2, whose header was valid.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// The meter that has answered.
    pub header: Header,
    /// C, A, CI field, data.
    fields: &'a [u8],
    /// Position of the first record.
    at: usize,
}

impl<'a> Answer<'a> {
    /// Reads C, A, CI field and the header after them: the bytes that the CP returns after the response byte.
    ///
    /// # Errors
    /// [`Fault`]; then the answer has no records.
    pub fn parse(fields: &'a [u8]) -> Result<Self, Fault> {
        let [_c, address, ci, data @ ..] = fields else { return Err(Fault::NoData) };
        let header = Header { address: *address, ci: *ci, ..Header::default() };
        match *ci {
            VARIABLE => {
                let Some(&[i0, i1, i2, i3, m0, m1, version, medium, access, state, s0, s1]) =
                    data.first_chunk::<VARIABLE_HEADER>()
                else {
                    return Err(Fault::Malformed);
                };
                let header = Header {
                    identification: u32::from_le_bytes([i0, i1, i2, i3]),
                    manufacturer: u16::from_le_bytes([m0, m1]),
                    version,
                    medium,
                    access,
                    state,
                    signature: u16::from_le_bytes([s0, s1]),
                    ..header
                };
                if is_encrypted(s0, s1, data.len() - VARIABLE_HEADER) {
                    return Err(Fault::Encrypted);
                }
                Ok(Self { header, fields, at: FIELDS + VARIABLE_HEADER })
            }
            FIXED => {
                let Some(&[i0, i1, i2, i3, access, state, u0, u1, ..]) = data.first_chunk::<FIXED_BYTES>() else {
                    return Err(Fault::Malformed);
                };
                let identification = u32::from_le_bytes([i0, i1, i2, i3]);
                let header = Header { identification, medium: fixed::medium(u0, u1), access, state, ..header };
                Ok(Self { header, fields, at: FIELDS })
            }
            APPLICATION_ERROR => Err(Fault::Application(data.first().copied().unwrap_or(0xFF))),
            other => Err(Fault::UnknownCi(other)),
        }
    }

    /// The records in their order; a malformed record is the last.
    pub fn records(&self) -> Records<'a> {
        Records { fixed: (self.header.ci == FIXED).then_some(0), fields: self.fields, at: self.at, more: false }
    }
}

/// Whether the signature is a configuration of encryption (AES, modes 5 and 7) that matches the length of the data:
/// blocks of sixteen bytes. Older meters use the signature for other purposes.
fn is_encrypted(low: u8, high: u8, data: usize) -> bool {
    let blocks = usize::from(low >> 4);
    matches!(high & 0x1F, 5 | 7) && blocks > 0 && blocks * 16 <= data
}

/// The records of an answer.
#[derive(Clone, Debug)]
pub struct Records<'a> {
    /// The next counter of a fixed data structure.
    fixed: Option<usize>,
    fields: &'a [u8],
    at: usize,
    more: bool,
}

impl Records<'_> {
    /// Whether the meter has more records than fit into one answer (DIF 1Fh); valid after the last record.
    pub fn more_follow(&self) -> bool {
        self.more
    }
}

impl<'a> Iterator for Records<'a> {
    type Item = Result<Record<'a>, Fault>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(counter) = &mut self.fixed {
            let record = fixed::counter(self.fields, *counter)?;
            *counter += 1;
            return Some(Ok(record));
        }
        while let Some(&dif) = self.fields.get(self.at) {
            match dif {
                // Filler.
                0x2F => self.at += 1,
                0x0F | 0x1F => {
                    self.more = dif == 0x1F;
                    let at = self.at + 1;
                    self.at = self.fields.len();
                    return Some(Ok(variable::manufacturer_specific(self.fields, at)));
                }
                _ => {
                    let found = variable::record(self.fields, self.at);
                    self.at = found.map_or(self.fields.len(), |record| record.at + record.len);
                    return Some(found);
                }
            }
        }
        None
    }
}
