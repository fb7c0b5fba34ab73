//! The bytes of a retentive file. The only place that knows bincode.
//!
//! Magic, version of this format and length of the content in little-endian, a checksum over version and content, then
//! the content as bincode writes it. The image in it is the CPU's own and has its own version.

use bincode::config::{Config, standard};

const MAGIC: [u8; 8] = *b"ob1 file";
const VERSION: u32 = 1;
const HEAD: usize = 8 + 4 + 8 + 8;
/// Twice the memory of the largest CPU, in bytes: a longer file is not read.
pub(super) const LONGEST: u64 = 1 << 29;

/// What a file holds.
#[derive(Clone, Debug, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct Content {
    /// The station it belongs to.
    pub station: String,
    /// Counts the files written: the higher one is newer.
    pub sequence: u64,
    /// The image, as the CPU has made it.
    pub image: Vec<u8>,
}

/// Why bytes are not a retentive file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FormatError {
    /// Something else: it does not begin as a retentive file.
    #[error("this is not a retentive file of ob1")]
    Foreign,
    /// A file of another version of ob1.
    #[error("its format has version {0}, this ob1 knows version {VERSION}")]
    Version(u32),
    /// Torn or changed: its checksum or its length is wrong.
    #[error("it is torn or damaged")]
    Damaged,
    /// A file of another station.
    #[error("it belongs to the station \"{0}\"")]
    OtherStation(String),
}

/// With a limit: nothing is made room for because a file says how long it is.
const fn config() -> impl Config {
    standard().with_limit::<{ LONGEST as usize }>()
}

/// The bytes of a file.
///
/// # Errors
/// What bincode says; memory is the only thing that can be missing.
pub fn encode(content: &Content) -> Result<Vec<u8>, String> {
    bincode::encode_to_vec(content, config()).map(|body| sealed(&body)).map_err(|error| error.to_string())
}

/// A content with its head.
fn sealed(body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD + body.len());
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&(body.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&checksum(body).to_le_bytes());
    bytes.extend_from_slice(body);
    bytes
}

/// Reads the content of a file of this station.
///
/// # Errors
/// Which [`FormatError`] it is: not one of ours, another version, damaged, or of another station.
pub fn decode(bytes: &[u8], station: &str) -> Result<Content, FormatError> {
    let (magic, rest) = bytes.split_first_chunk().ok_or(FormatError::Foreign)?;
    if *magic != MAGIC {
        return Err(FormatError::Foreign);
    }
    let (version, rest) = rest.split_first_chunk().ok_or(FormatError::Damaged)?;
    let version = u32::from_le_bytes(*version);
    if version != VERSION {
        return Err(FormatError::Version(version));
    }
    let (len, rest) = rest.split_first_chunk().ok_or(FormatError::Damaged)?;
    let (sum, body) = rest.split_first_chunk().ok_or(FormatError::Damaged)?;
    let len = u64::from_le_bytes(*len);
    if len != body.len() as u64 || len > LONGEST || checksum(body) != u64::from_le_bytes(*sum) {
        return Err(FormatError::Damaged);
    }
    let (content, read): (Content, usize) =
        bincode::decode_from_slice(body, config()).map_err(|_| FormatError::Damaged)?;
    // No station writes so many files that none can come after.
    if read != body.len() || content.sequence == u64::MAX {
        return Err(FormatError::Damaged);
    }
    if content.station != station {
        return Err(FormatError::OtherStation(content.station));
    }
    Ok(content)
}

/// Over the version and the content.
fn checksum(body: &[u8]) -> u64 {
    ob1_process::files::checksum(VERSION.to_le_bytes().into_iter().chain(body.iter().copied()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content() -> Content {
        Content { station: "press".into(), sequence: 7, image: (0..200).collect() }
    }

    #[test]
    fn content_comes_back() {
        let bytes = encode(&content()).expect("memory");
        assert_eq!(decode(&bytes, "press"), Ok(content()));
        assert_eq!(decode(&bytes, "saw"), Err(FormatError::OtherStation("press".into())));
    }

    #[test]
    fn every_cut_and_every_changed_bit_is_noticed() {
        let bytes = encode(&content()).expect("memory");
        for len in 0..bytes.len() {
            assert!(decode(&bytes[..len], "press").is_err(), "cut at {len}");
        }
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&changed, "press").is_err(), "bit {bit}");
        }
        let mut longer = bytes;
        longer.push(0);
        assert_eq!(decode(&longer, "press"), Err(FormatError::Damaged));
    }

    #[test]
    fn a_right_checksum_over_a_lie_is_no_reason_to_believe_it() {
        let file = |sequence: u64, length: u64| {
            let body = bincode::encode_to_vec(("press".to_owned(), sequence, length), standard());
            decode(&sealed(&body.expect("memory")), "press")
        };
        assert_eq!(file(7, 0).map(|content| content.sequence), Ok(7));
        for length in [1, LONGEST, 1 << 40, u64::MAX] {
            assert_eq!(file(7, length), Err(FormatError::Damaged), "an image of {length} bytes");
        }
        assert_eq!(file(u64::MAX, 0), Err(FormatError::Damaged));
    }
}
