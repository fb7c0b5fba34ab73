//! Code pages: texts of a project are in the ANSI code page of the machine it was made on, never in UTF-8.

use encoding_rs::Encoding;

/// The code page of a project's texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodePage {
    number: u16,
    encoding: &'static Encoding,
}

/// ANSI code pages of Windows and the encodings that stand for them.
const PAGES: &[(u16, &Encoding)] = &[
    (874, encoding_rs::WINDOWS_874),
    (932, encoding_rs::SHIFT_JIS),
    (936, encoding_rs::GBK),
    (949, encoding_rs::EUC_KR),
    (950, encoding_rs::BIG5),
    (1250, encoding_rs::WINDOWS_1250),
    (1251, encoding_rs::WINDOWS_1251),
    (1252, encoding_rs::WINDOWS_1252),
    (1253, encoding_rs::WINDOWS_1253),
    (1254, encoding_rs::WINDOWS_1254),
    (1255, encoding_rs::WINDOWS_1255),
    (1256, encoding_rs::WINDOWS_1256),
    (1257, encoding_rs::WINDOWS_1257),
    (1258, encoding_rs::WINDOWS_1258),
];

impl Default for CodePage {
    fn default() -> Self {
        Self { number: 1252, encoding: encoding_rs::WINDOWS_1252 }
    }
}

impl CodePage {
    /// A Windows code page; `None` for one that is not an ANSI code page.
    pub fn of_number(number: u16) -> Option<Self> {
        let (number, encoding) = PAGES.iter().find(|(page, _)| *page == number)?;
        Some(Self { number: *number, encoding })
    }

    /// From the text of `Global/Language`, whose fourth line is the number. `None` when it says nothing usable.
    pub fn of_language(bytes: &[u8]) -> Option<Self> {
        let line = bytes.split(|b| *b == b'\n').nth(3)?;
        Self::of_number(std::str::from_utf8(line.trim_ascii()).ok()?.parse().ok()?)
    }

    /// The numbers of all there are.
    pub fn numbers() -> impl Iterator<Item = u16> {
        PAGES.iter().map(|(number, _)| *number)
    }

    /// Its number in Windows: 1252.
    pub const fn number(self) -> u16 {
        self.number
    }

    /// The text of some bytes. What does not decode becomes U+FFFD.
    pub fn text(self, bytes: &[u8]) -> String {
        self.encoding.decode_without_bom_handling(bytes).0.into_owned()
    }

    /// The bytes of a text; what the code page does not have becomes `?`.
    pub fn bytes(self, text: &str) -> Vec<u8> {
        let mut out = Vec::with_capacity(text.len());
        let mut buffer = [0u8; 4];
        for c in text.chars() {
            match self.encoding.encode(c.encode_utf8(&mut buffer)) {
                (bytes, _, false) => out.extend_from_slice(&bytes),
                _ => out.push(b'?'),
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fourth_line_is_the_code_page() {
        let page = CodePage::of_language(b"0\r\n1049\r\n204\r\n1251\r\n866\r\nx").expect("1251");
        assert_eq!((page.number(), page.text(&[0xCF, 0xF3, 0xF1, 0xEA])), (1251, "Пуск".to_owned()));
        assert_eq!(page.bytes("Пуск€漢"), [0xCF, 0xF3, 0xF1, 0xEA, 0x88, b'?']);
        assert_eq!(CodePage::of_language(b"0\n1\n2\nx\n"), None);
        assert_eq!(CodePage::of_language(b""), None);
        assert_eq!(CodePage::of_number(936).map(|p| p.text(&[0xD3, 0xB2, 0xFF])), Some("硬\u{fffd}".to_owned()));
    }
}
