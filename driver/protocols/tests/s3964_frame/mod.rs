//! A block of the procedure 3964(R) as the text of the manual has it, without the code under test.

/// The user data of a block as it came off the line, if everything is right with it.
/// [S0 "Block check character (BCC-Byte)"], [S0 "Data Link Escape (DLE-character)"]
pub(crate) fn checked(raw: &[Option<u8>], bcc: bool) -> Option<Vec<u8>> {
    let mut raw: Vec<u8> = raw.iter().copied().collect::<Option<_>>()?;
    if bcc && raw.pop()? != raw.iter().fold(0, |a, b| a ^ b) {
        return None;
    }
    let data = raw.strip_suffix(&[0x10, 0x03])?;
    let mut plain = Vec::new();
    let mut bytes = data.iter();
    while let Some(byte) = bytes.next() {
        if *byte == 0x10 && bytes.next() != Some(&0x10) {
            return None;
        }
        plain.push(*byte);
    }
    Some(plain)
}
