//! Passwords on the wire: eight characters, padded with spaces, each mixed with the one two places before. This hides
//! nothing; the protocol has no secrets.

/// Maximum characters of a password, and bytes on the wire.
pub const PASSWORD_BYTES: usize = 8;
const MASK: u8 = 0x55;

/// The bytes of a password; `None` when it is too long or not ASCII.
#[must_use]
pub fn encode(password: &str) -> Option<[u8; PASSWORD_BYTES]> {
    if password.len() > PASSWORD_BYTES || !password.is_ascii() {
        return None;
    }
    let mut bytes = [b' '; PASSWORD_BYTES];
    bytes[..password.len()].copy_from_slice(password.as_bytes());
    for index in 0..PASSWORD_BYTES {
        let before = index.checked_sub(2).map_or(0, |before| bytes[before]);
        bytes[index] ^= MASK ^ before;
    }
    Some(bytes)
}

/// The password, without the spaces at its end.
#[must_use]
pub fn decode(bytes: [u8; PASSWORD_BYTES]) -> String {
    let plain = std::array::from_fn::<u8, PASSWORD_BYTES, _>(|index| {
        let before = index.checked_sub(2).map_or(0, |before| bytes[before]);
        bytes[index] ^ MASK ^ before
    });
    let text: String = plain.into_iter().map(char::from).collect();
    text.trim_end_matches([' ', '\0']).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways() {
        for password in ["", "a", "secret", "12345678"] {
            let bytes = encode(password).expect("short");
            assert_eq!(decode(bytes), password);
        }
        assert_eq!(encode("a").map(|bytes| bytes[..3].to_vec()), Some(vec![0x34, 0x75, 0x41]));
        assert_eq!((encode("123456789"), encode("ä")), (None, None));
    }
}
