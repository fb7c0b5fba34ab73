//! Bytes in words and back, in the byte order of the machine: byte 0 of the data is the lowest address.

/// The bytes as words; the last word is padded with zeros.
pub(crate) fn words_of(bytes: &[u8]) -> impl Iterator<Item = u64> {
    bytes.chunks(8).map(|chunk| merged(0, 0, chunk))
}

/// Writes `bytes` over the beginning of `words`; the words after them stay as they are, and bytes that do not fit are
/// dropped.
#[inline]
pub(crate) fn overlay(words: &mut [u64], bytes: &[u8]) {
    for (word, chunk) in words.iter_mut().zip(bytes.chunks(8)) {
        *word = merged(*word, 0, chunk);
    }
}

/// Copies the beginning of `words` into `bytes`; bytes without a word stay as they are.
#[inline]
pub(crate) fn copy_out(words: &[u64], bytes: &mut [u8]) {
    let (whole, rest) = bytes.as_chunks_mut::<8>();
    for (chunk, word) in whole.iter_mut().zip(words) {
        *chunk = word.to_ne_bytes();
    }
    if let Some(word) = words.get(whole.len()) {
        extract(*word, 0, rest);
    }
}

/// The same, from byte `at` of `words` on.
#[inline]
pub(crate) fn copy_out_from(words: &[u64], at: usize, bytes: &mut [u8]) {
    let words = words.get(at / 8..).unwrap_or_default();
    match (at % 8, words) {
        (0, _) => copy_out(words, bytes),
        (inside, [first, rest @ ..]) => {
            let (head, tail) = bytes.split_at_mut(bytes.len().min(8 - inside));
            extract(*first, inside, head);
            copy_out(rest, tail);
        }
        (_, []) => {}
    }
}

/// `word` with its bytes from `first` on replaced by `chunk`.
#[inline]
pub(crate) fn merged(word: u64, first: usize, chunk: &[u8]) -> u64 {
    // Most chunks are whole words; the loop handles the ends.
    if let (0, Ok(whole)) = (first, <[u8; 8]>::try_from(chunk)) {
        return u64::from_ne_bytes(whole);
    }
    let mut bytes = word.to_ne_bytes();
    for (to, from) in bytes.iter_mut().skip(first).zip(chunk) {
        *to = *from;
    }
    u64::from_ne_bytes(bytes)
}

/// Copies the bytes of `word` from `first` on into `chunk`, which is no longer than they are.
#[inline]
pub(crate) fn extract(word: u64, first: usize, chunk: &mut [u8]) {
    // The byte with the lowest address goes first.
    let mut rest = word.to_le() >> (8 * first);
    for to in chunk {
        *to = rest as u8;
        rest >>= 8;
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
        for at in 0..=25 {
            let mut part = [0xff; 11];
            copy_out_from(&words, at, &mut part);
            let behind = [&bytes[..], &[0; 5]].concat();
            let there: Vec<u8> = behind.iter().skip(at).copied().chain([0xff; 11]).take(11).collect();
            assert_eq!(part[..], there, "from {at}");
        }
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
