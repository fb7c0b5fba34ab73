//! Rust source with blanked comments, strings and characters, so that a search finds only code.

/// `source` with the same length and lines, but with blanks in comments and in string and character literals.
pub(super) fn mask(source: &str) -> String {
    let bytes = source.as_bytes();
    let mut code = bytes.to_vec();
    let mut at = 0;
    while at < bytes.len() {
        let end = match bytes[at] {
            b'/' if bytes.get(at + 1) == Some(&b'/') => find(bytes, at, b"\n").unwrap_or(bytes.len()),
            b'/' if bytes.get(at + 1) == Some(&b'*') => block_comment(bytes, at),
            b'"' => string(bytes, at),
            b'r' if !continues_a_word(bytes, at) => match raw_string(bytes, at) {
                Some(end) => end,
                None => {
                    at += 1;
                    continue;
                }
            },
            b'\'' => match character(bytes, at) {
                Some(end) => end,
                None => {
                    at += 1;
                    continue;
                }
            },
            _ => {
                at += 1;
                continue;
            }
        };
        for byte in &mut code[at..end] {
            if *byte != b'\n' {
                *byte = b' ';
            }
        }
        at = end;
    }
    // Only whole literals and comments were blanked byte by byte, so the rest is valid text; anything else becomes a
    // blank.
    String::from_utf8(code).unwrap_or_else(|_| source.chars().map(|c| if c == '\n' { c } else { ' ' }).collect())
}

fn find(bytes: &[u8], from: usize, what: &[u8]) -> Option<usize> {
    bytes[from..].windows(what.len()).position(|window| window == what).map(|offset| from + offset)
}

/// The end of a block comment, which may contain others.
fn block_comment(bytes: &[u8], from: usize) -> usize {
    let (mut depth, mut at) = (0usize, from);
    while at + 1 < bytes.len() {
        match &bytes[at..at + 2] {
            b"/*" => {
                depth += 1;
                at += 2;
            }
            b"*/" => {
                depth -= 1;
                at += 2;
                if depth == 0 {
                    return at;
                }
            }
            _ => at += 1,
        }
    }
    bytes.len()
}

fn string(bytes: &[u8], from: usize) -> usize {
    let mut at = from + 1;
    while at < bytes.len() {
        match bytes[at] {
            b'\\' => at += 2,
            b'"' => return at + 1,
            _ => at += 1,
        }
    }
    bytes.len()
}

/// `r"..."`, `r#"..."#` and so on; `None` for a raw identifier.
fn raw_string(bytes: &[u8], from: usize) -> Option<usize> {
    let hashes = bytes[from + 1..].iter().take_while(|byte| **byte == b'#').count();
    let open = from + 1 + hashes;
    if bytes.get(open) != Some(&b'"') {
        return None;
    }
    let mut close = vec![b'"'];
    close.resize(hashes + 1, b'#');
    Some(find(bytes, open + 1, &close).map_or(bytes.len(), |end| end + close.len()))
}

/// `'x'`, `'\n'`, `'\u{..}'`; `None` for a lifetime.
fn character(bytes: &[u8], from: usize) -> Option<usize> {
    if bytes.get(from + 1) == Some(&b'\\') {
        return find(bytes, from + 3, b"'").map(|end| end + 1);
    }
    let text = std::str::from_utf8(&bytes[from + 1..bytes.len().min(from + 6)]);
    let width = match text {
        Ok(text) => text.chars().next()?.len_utf8(),
        // Five bytes may end inside a later character; the valid part before it is sufficient.
        Err(cut) => {
            std::str::from_utf8(&bytes[from + 1..from + 1 + cut.valid_up_to()]).ok()?.chars().next()?.len_utf8()
        }
    };
    (bytes.get(from + 1 + width) == Some(&b'\'')).then_some(from + 2 + width)
}

fn continues_a_word(bytes: &[u8], at: usize) -> bool {
    // `br"..."` is also a raw string.
    let mut before = bytes[..at].iter().rev();
    match before.next() {
        Some(b'b') => before.next().is_some_and(|byte| is_word(*byte)),
        Some(byte) => is_word(*byte),
        None => false,
    }
}

fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// Whether `line` has `word` as a whole word.
pub(super) fn has_word(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(at, _)| {
        let bytes = line.as_bytes();
        let before = at.checked_sub(1).and_then(|at| bytes.get(at));
        let after = bytes.get(at + word.len());
        !before.is_some_and(|byte| is_word(*byte)) && !after.is_some_and(|byte| is_word(*byte))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn code(source: &str, expected: &str) {
        let masked = mask(source);
        assert_eq!(masked.len(), source.len());
        assert_eq!(masked.split_whitespace().collect::<Vec<_>>().join(" "), expected);
    }

    #[test]
    fn comments_go() {
        code("a // unsafe\nb", "a b");
        code("a /* x /* unsafe */ y */ b", "a b");
        code("/// Doc: \"quote\nfn f() {}", "fn f() {}");
    }

    #[test]
    fn literals_go() {
        code(r#"a("uns\"afe // no"); b"#, "a( ); b");
        code(r##"a(r#"un"safe"#, br"x\"); b"##, "a( , b ); b");
        code("a('\"', '\\'', '\\u{41}', 'ß', 'ä'); b", "a( , , , , ); b");
    }

    #[test]
    fn lifetimes_and_raw_identifiers_stay() {
        code("fn f<'a>(x: &'a str, r#type: u8) {}", "fn f<'a>(x: &'a str, r#type: u8) {}");
    }

    #[test]
    fn words_are_whole() {
        assert!(has_word("unsafe {", "unsafe"));
        assert!(!has_word("deny(unsafe_code)", "unsafe"));
        assert!(!has_word("not_unsafe", "unsafe"));
    }
}
