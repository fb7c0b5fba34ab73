//! Bytes in words and back, in the byte order of the machine: byte 0 of the data is the lowest address.

/// The bytes as words; the last word is filled up with zeros.
pub(crate) fn words_of(bytes: &[u8]) -> impl Iterator<Item = u64> {
    bytes.chunks(8).map(|chunk| {
        let mut word = [0; 8];
        overlay_word(&mut word, chunk);
        u64::from_ne_bytes(word)
    })
}

/// Writes `bytes` over the beginning of `words`; what lies behind stays, and so does what does not fit.
pub(crate) fn overlay(words: &mut [u64], bytes: &[u8]) {
    for (word, chunk) in words.iter_mut().zip(bytes.chunks(8)) {
        let mut cell = word.to_ne_bytes();
        overlay_word(&mut cell, chunk);
        *word = u64::from_ne_bytes(cell);
    }
}

fn overlay_word(word: &mut [u8; 8], chunk: &[u8]) {
    for (to, from) in word.iter_mut().zip(chunk) {
        *to = *from;
    }
}

/// Copies the beginning of `words` into `bytes`; bytes without a word stay as they are.
pub(crate) fn copy_out(words: &[u64], bytes: &mut [u8]) {
    for (chunk, word) in bytes.chunks_mut(8).zip(words) {
        for (to, from) in chunk.iter_mut().zip(word.to_ne_bytes()) {
            *to = from;
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn bytes_keep_their_addresses() {
        let bytes: Vec<u8> = (1..=19).collect();
        let words: Vec<u64> = words_of(&bytes).collect();
        assert_eq!(words.len(), 3);
        assert_eq!(words[0].to_ne_bytes(), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(words[2].to_ne_bytes(), [17, 18, 19, 0, 0, 0, 0, 0]);
        let mut back = [0xff; 21];
        copy_out(&words, &mut back);
        assert_eq!(&back[..19], &bytes[..]);
        let mut short = [0; 10];
        copy_out(&words, &mut short);
        assert_eq!(short, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]);
    }

    #[test]
    fn an_overlay_leaves_the_rest() {
        let mut words = [u64::MAX; 2];
        overlay(&mut words, &[1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(words[0].to_ne_bytes(), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(words[1].to_ne_bytes(), [9, 255, 255, 255, 255, 255, 255, 255]);
        overlay(&mut words, &[7; 40]);
        assert_eq!(words, [u64::from_ne_bytes([7; 8]); 2]);
    }
}
