//! A block of the procedure 3964(R) as in the text of the manual, without the code under test.

/// The user data of a block as it came from the line, if it is valid. [S0 "Block check character (BCC-Byte)"], [S0
/// "Data Link Escape (DLE-character)"]
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

/// Characters since our last DLE; `None` in the place of an unreadable one.
#[derive(Default)]
pub(crate) struct Incoming {
    characters: Vec<Option<u8>>,
    /// We are sending.
    leaving: bool,
    /// The request was repeated before our DLE had been sent.
    asked_again: bool,
}

impl Incoming {
    pub(crate) fn push(&mut self, character: Option<u8>) {
        // Before our DLE has been sent no block can come; an STX is a repeated request.
        // [TIA help "Configuration for point-to-point links"]
        let request = self.characters.is_empty() && character == Some(0x02);
        if request && self.leaving {
            self.asked_again = true;
        } else {
            // Another repeated request, or data: it must not be taken for data.
            self.characters.push(character.filter(|_| !(request && self.asked_again)));
        }
    }

    /// Characters sent. A DLE ends or begins a block: returns everything before it.
    pub(crate) fn transmitted(&mut self, bytes: &[u8]) -> Option<Vec<Option<u8>>> {
        self.leaving = true;
        (bytes == [0x10]).then(|| {
            self.asked_again = false;
            std::mem::take(&mut self.characters)
        })
    }

    /// Everything has been sent.
    pub(crate) fn out(&mut self) {
        self.leaving = false;
    }
}
