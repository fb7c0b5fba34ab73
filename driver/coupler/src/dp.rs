//! The configuration of a PROFIBUS DP line, and the places of its slaves' diagnoses.

use std::collections::BTreeMap;

use ob1_protocols::Span;
pub use ob1_protocols::profibus::diagnosis::{DIAGNOSIS_BYTES, Refused, SHORT};
pub use ob1_protocols::profibus::{Block, Diagnosis};
use serde::{Deserialize, Serialize};

use crate::nanos;

/// A line with one master: us.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DpConfig {
    /// Bits per second; one of [`BAUD_RATES`].
    pub baud: u32,
    /// Address of the master: our own.
    pub address: u8,
    /// HSA: the highest address at which to look for another master.
    pub hsa: u8,
    /// TSL: the longest wait for an answer, in bits.
    pub slot_bits: u16,
    /// Number of repetitions of a telegram without an answer.
    pub retries: u8,
    /// The watchdog of the slaves.
    #[serde(with = "nanos")]
    pub watchdog: Span,
    /// The slaves that the master parametrises and exchanges data with.
    pub slaves: Vec<DpSlave>,
}

/// A DP slave as its GSD file and the station file have it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DpSlave {
    /// Name of the slave in the station file, and in messages.
    pub name: String,
    /// Address of the slave on the line.
    pub station: u8,
    /// Its expected ident number, from its GSD file.
    pub ident: u16,
    /// The longest time to its answer according to its GSD file, in bits.
    pub answer_bits: u16,
    /// Its configuration: the identifiers of its modules.
    pub config: Vec<u8>,
    /// User parameters, the part of Set_Prm after its first seven bytes.
    pub parameters: Vec<u8>,
    /// A slave that has been silent for this long is lost.
    #[serde(with = "nanos")]
    pub lost_after: Span,
    /// Its inputs: first byte in the inputs of the bus, and number of bytes.
    pub inputs: (usize, usize),
    /// The same for its outputs.
    pub outputs: (usize, usize),
    /// The place of its diagnosis in the inputs of the bus: a byte for its length, then the maximum number of bytes.
    pub diagnosis: (usize, usize),
    /// The meanings of the bits of its device diagnosis, from its GSD file.
    #[serde(default)]
    pub texts: BTreeMap<u32, String>,
    /// The fields of its device diagnosis whose values have a meaning.
    #[serde(default)]
    pub fields: Vec<DiagnosisField>,
}

/// A field of bits in the device diagnosis of a slave, whose value has a meaning.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiagnosisField {
    /// Lowest bit of the field, from 0.
    pub first: u16,
    /// Highest bit of the field, included.
    pub last: u16,
    /// The meanings of its values.
    pub texts: BTreeMap<u16, String>,
}

impl DiagnosisField {
    /// The meaning of its value in a device diagnosis; a value of 0 is no fault.
    fn text(&self, data: &[u8]) -> Option<&str> {
        let bit = |n: u16| data.get(usize::from(n / 8)).is_some_and(|byte| byte >> (n % 8) & 1 == 1);
        let value = (self.first..=self.last).rev().fold(0_u16, |value, n| value << 1 | u16::from(bit(n)));
        self.texts.get(&value).filter(|_| value != 0).map(String::as_str)
    }
}

/// The baud rates of PROFIBUS DP that a serial line supports.
pub const BAUD_RATES: [u32; 8] = [9600, 19_200, 31_250, 45_450, 93_750, 187_500, 500_000, 1_500_000];

impl DpSlave {
    /// Bytes of the inputs of a bus for a diagnosis of `bytes` bytes.
    pub const fn diagnosis_area(bytes: usize) -> usize {
        bytes + 1
    }

    /// Writes a diagnosis to its place in the inputs of the bus; the part that does not fit is cut off.
    pub fn keep_diagnosis(&self, bytes: &[u8], inputs: &mut [u8]) {
        let (at, room) = self.diagnosis;
        let len = bytes.len().min(room);
        if let Some([first, place @ ..]) = inputs.get_mut(at..at + Self::diagnosis_area(room)) {
            *first = len as u8;
            place.fill(0);
            place[..len].copy_from_slice(&bytes[..len]);
        }
    }
}

/// The whole content of a diagnosis, with the texts of the slave's GSD file.
pub fn diagnosis_words(bytes: &[u8], slave: &DpSlave) -> String {
    let Some(diagnosis) = Diagnosis::new(bytes) else { return "it has sent no diagnosis".into() };
    let mut text = diagnosis.to_string();
    for block in diagnosis.blocks() {
        if let Block::Device(data) = block {
            let bits = (0_u32..).zip(data.iter().flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1 == 1)));
            let of_bits = bits.filter_map(|(n, on)| slave.texts.get(&n).filter(|_| on)).map(String::as_str);
            for what in of_bits.chain(slave.fields.iter().filter_map(|field| field.text(data))) {
                text.push_str(", ");
                text.push_str(what);
            }
        }
    }
    text
}

/// Why a slave refuses the master at address `ours`, the remedy, and the rest of its diagnosis.
pub fn refusal_words(bytes: &[u8], slave: &DpSlave, ours: u8) -> String {
    let said = diagnosis_words(bytes, slave);
    let Some(why) = Diagnosis::new(bytes).and_then(|diagnosis| diagnosis.refusal(ours, slave.ident)) else {
        return said;
    };
    let (what, helps) = why.words();
    let wanted = match why {
        Refused::Ident(_) => format!(" ({:04X}h)", slave.ident),
        _ => String::new(),
    };
    format!("{what}{wanted}: {said}; {helps}")
}

/// The diagnosis in an area filled by [`DpSlave::keep_diagnosis`]; its content is not trusted.
pub fn kept_diagnosis(area: &[u8]) -> &[u8] {
    match area {
        [len, bytes @ ..] => bytes.get(..usize::from(*len)).unwrap_or_default(),
        [] => &[],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_and_fields_of_a_device_diagnosis_have_texts() {
        let texts = BTreeMap::from([(1, "module error".to_owned()), (2, "wrong module".to_owned())]);
        let fields = vec![
            DiagnosisField { first: 8, last: 9, texts: texts.clone() },
            DiagnosisField { first: 10, last: 11, texts },
        ];
        let slave = DpSlave { texts: BTreeMap::from([(0, "fuse blown".to_owned())]), fields, ..DpSlave::default() };
        let diagnosis = [0x08, 0x0C, 0, 2, 0x80, 0x1D, 0x03, 0x01, 0b1000];
        let words = diagnosis_words(&diagnosis, &slave);
        assert!(words.ends_with(", device [01, 08], fuse blown, wrong module"), "{words}");
    }

    #[test]
    fn a_slave_that_refuses_says_why_and_what_helps() {
        let slave = DpSlave { ident: 0x801D, ..DpSlave::default() };
        let others = "not ready, wants parameters";
        for (diagnosis, words) in [
            (
                [0x02, 0x05, 0, 0xFF, 0x80, 0x6A],
                format!(
                    "it is another device than its GSD file says (801Dh): ident 806Ah, {others}; take the GSD file of \
                     the device that is there, or check its address switches"
                ),
            ),
            (
                [0x02, 0x05, 0, 0x03, 0x80, 0x1D],
                format!(
                    "another master has it: ident 801Dh, master 3, {others}; remove it from the configuration of that \
                     master, or switch that master off"
                ),
            ),
            (
                [0x42, 0x05, 0, 0xFF, 0x80, 0x1D],
                "it refuses its parameters: ident 801Dh, not ready, parameter fault, wants parameters; compare \
                 `params` with its manual, and the revision of its GSD file with that of the device"
                    .to_owned(),
            ),
            (
                [0x06, 0x05, 0, 0xFF, 0x80, 0x1D],
                "its modules are not those of the station file: ident 801Dh, not ready, configuration fault, wants \
                 parameters; compare `slots` with the plugged modules, in their order"
                    .to_owned(),
            ),
            ([0x02, 0x05, 0, 0xFF, 0x80, 0x1D], format!("ident 801Dh, {others}")),
        ] {
            assert_eq!(refusal_words(&diagnosis, &slave, 2), words);
        }
        assert_eq!(refusal_words(&[0; 3], &slave, 2), "it has sent no diagnosis");
    }
}
