//! What is left of a line.

/// The rest of a line. What cannot be read leaves it unchanged and says what was expected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cursor<'t>(pub(super) &'t str);

/// A part of a line, or what was expected there instead.
pub(super) type Expected<T> = Result<T, &'static str>;

impl<'t> Cursor<'t> {
    /// Blanks, then this text.
    pub(super) fn eat(&mut self, text: &str) -> bool {
        let rest = self.0.trim_start().strip_prefix(text);
        if let Some(rest) = rest {
            self.0 = rest;
        }
        rest.is_some()
    }

    pub(super) fn need(&mut self, text: &'static str) -> Expected<()> {
        if self.eat(text) { Ok(()) } else { Err(text) }
    }

    /// A word up to the next blank.
    pub(super) fn word(&mut self) -> &'t str {
        let text = self.0.trim_start();
        let (word, rest) = text.split_at(text.find(' ').unwrap_or(text.len()));
        self.0 = rest;
        word
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.trim().is_empty()
    }

    /// A number up to the first character that cannot belong to one.
    pub(super) fn number<T: std::str::FromStr>(&mut self) -> Expected<T> {
        let text = self.0.trim_start();
        let sign = usize::from(text.starts_with('-'));
        let end = text[sign..].find(|c: char| !c.is_ascii_digit()).map_or(text.len(), |at| at + sign);
        let number = text[..end].parse().map_err(|_| "a number")?;
        self.0 = &text[end..];
        Ok(number)
    }

    /// Hexadecimal digits, as many as follow, as a number.
    pub(super) fn hex(&mut self) -> Expected<u32> {
        let (digits, rest) = self.hex_digits();
        let number = u32::from_str_radix(digits, 16).map_err(|_| "hexadecimal digits")?;
        self.0 = rest;
        Ok(number)
    }

    /// Bytes of two hexadecimal digits.
    pub(super) fn bytes(&mut self) -> Expected<Vec<u8>> {
        let (digits, rest) = self.hex_digits();
        let byte = |at: usize| digits.get(at..at + 2).and_then(|pair| u8::from_str_radix(pair, 16).ok());
        let bytes = (0..digits.len()).step_by(2).map(byte).collect::<Option<Vec<u8>>>();
        self.0 = rest;
        bytes.ok_or("pairs of hexadecimal digits")
    }

    fn hex_digits(&self) -> (&'t str, &'t str) {
        let text = self.0.trim_start();
        text.split_at(text.find(|c: char| !c.is_ascii_hexdigit()).unwrap_or(text.len()))
    }

    /// A text in quotes, as `{:?}` writes it.
    pub(super) fn quoted(&mut self) -> Expected<String> {
        const WHAT: &str = "a text in quotes";
        let text = self.0.trim_start().strip_prefix('"').ok_or(WHAT)?;
        let (mut out, mut chars) = (String::new(), text.char_indices());
        while let Some((at, c)) = chars.next() {
            match c {
                '"' => {
                    self.0 = &text[at + 1..];
                    return Ok(out);
                }
                '\\' => match chars.next().ok_or(WHAT)?.1 {
                    'n' => out.push('\n'),
                    'r' => out.push('\r'),
                    't' => out.push('\t'),
                    '0' => out.push('\0'),
                    'u' => {
                        let code: String = chars.by_ref().map(|(_, c)| c).skip(1).take_while(|c| *c != '}').collect();
                        let code = u32::from_str_radix(&code, 16).map_err(|_| WHAT)?;
                        out.push(char::from_u32(code).ok_or(WHAT)?);
                    }
                    other => out.push(other),
                },
                c => out.push(c),
            }
        }
        Err(WHAT)
    }

    /// The choice whose text stands here; of several the longest.
    pub(super) fn choice<T: Copy, S: AsRef<str>>(
        &mut self,
        all: impl IntoIterator<Item = T>,
        text: impl Fn(T) -> S,
        what: &'static str,
    ) -> Expected<T> {
        let here = self.0.trim_start();
        let fits = all.into_iter().filter(|one| here.starts_with(text(*one).as_ref()));
        let found = fits.max_by_key(|one| text(*one).as_ref().len()).ok_or(what)?;
        self.0 = &here[text(found).as_ref().len()..];
        Ok(found)
    }
}
