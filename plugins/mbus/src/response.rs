//! Interprets the response of the CP.

use crate::status;

/// Longest response: response byte, C, A, CI field, 252 bytes of user data.
pub(crate) const RESPONSE_MAX: usize = 256;
/// The single character E5h, by which a meter acknowledges.
const SINGLE: u8 = 0xE5;

/// The meaning of the CP's response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Response<'a> {
    /// The single character: acknowledged.
    Acknowledged,
    /// A frame: C, A and the following bytes.
    Fields(&'a [u8]),
    /// The CP or the bus reports an error, with this STATUS.
    Error(u16),
}

/// Decodes a response. [S0 "Response byte"]
pub(crate) fn read(response: &[u8]) -> Response<'_> {
    match *response {
        [0, SINGLE] => Response::Acknowledged,
        [0, _, _, ..] => Response::Fields(&response[1..]),
        // Bit 1 has priority: on a short-circuited bus there is no answer either.
        [byte] if byte & 2 != 0 => Response::Error(status::SHORT_CIRCUIT),
        [1] => Response::Error(status::NO_ANSWER),
        _ => Response::Error(status::UNDEFINED),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses() {
        assert_eq!(read(&[0, 0xE5]), Response::Acknowledged);
        assert_eq!(read(&[0, 8, 1, 0x72]), Response::Fields(&[8, 1, 0x72]));
        for (bytes, expected) in
            [(&[1_u8][..], 0x8001), (&[3], 0x8003), (&[2], 0x8003), (&[4], 0x80FF), (&[0], 0x80FF), (&[], 0x80FF)]
        {
            assert_eq!(read(bytes), Response::Error(expected), "{bytes:02X?}");
        }
    }
}
