//! The printer's position on the paper: margin, lines, headers and footers. [CP 341 manual 09/2008, p. 94]
//!
//! What the manual's public text leaves open is ours, `docs/cp340-printer.md`: a full page ends at once, with its
//! footers and a form feed.

use ob1_params::printer::Printer as Parameters;

use super::Fault;
use super::format::Piece;

const FORM_FEED: u8 = 0x0C;

/// Where the printer stands on the paper.
#[derive(Debug, Clone)]
pub(crate) struct Page {
    /// Number of this page; the first is 1. [CP 340 manual 04/2011, p. 85]
    pub(crate) number: u16,
    /// Lines of text on this page so far.
    line: usize,
    /// Nothing is on this page yet.
    is_empty: bool,
    /// The next character is the first of its line.
    at_line_start: bool,
}

/// A page under construction.
struct Sheet<'a> {
    page: Page,
    parameters: &'a Parameters,
    bytes: Vec<u8>,
}

impl Page {
    pub(crate) const fn new() -> Self {
        Self { number: 1, line: 0, is_empty: true, at_line_start: true }
    }

    /// Characters for the printer; on an error the position stays as it was.
    pub(crate) fn lay_out(&mut self, parameters: &Parameters, pieces: &[Piece]) -> Result<Vec<u8>, Fault> {
        /// Maximum length of one telegram for the line.
        const BYTES_MAX: usize = 4096;
        let ends = |text: &[u8]| text.iter().filter(|byte| **byte == parameters.line_end.counted()).count();
        let lines: usize = pieces.iter().map(|piece| if let Piece::Text(text) = piece { ends(text) } else { 0 }).sum();
        if parameters.lines_per_page > 0 && lines > parameters.body_lines() {
            return Err(Fault::Lines);
        }
        let mut sheet = Sheet { page: self.clone(), parameters, bytes: Vec::new() };
        for piece in pieces {
            sheet.put(piece);
        }
        if sheet.bytes.len() > BYTES_MAX {
            return Err(Fault::TooLong);
        }
        *self = sheet.page;
        Ok(sheet.bytes)
    }
}

impl Sheet<'_> {
    fn put(&mut self, piece: &Piece) {
        match piece {
            Piece::Text(text) => {
                for byte in text {
                    self.character(*byte);
                }
            }
            Piece::Control(bytes) => {
                self.begin();
                self.bytes.extend(bytes);
            }
            Piece::LineEnd => {
                self.begin();
                self.bytes.extend(self.parameters.line_end.bytes());
                self.line_ended();
            }
            Piece::NewPage => self.end_page(),
        }
    }

    fn character(&mut self, byte: u8) {
        self.begin();
        if self.page.at_line_start && !matches!(byte, b'\r' | b'\n') {
            self.margin();
            self.page.at_line_start = false;
        }
        self.bytes.push(self.parameters.character_set.byte(byte));
        if byte == self.parameters.line_end.counted() {
            self.line_ended();
        }
    }

    fn margin(&mut self) {
        self.bytes.extend(vec![b' '; usize::from(self.parameters.left_margin)]);
    }

    /// Headers come before the first thing on a page.
    fn begin(&mut self) {
        if std::mem::take(&mut self.page.is_empty) {
            self.lines(&self.parameters.headers);
        }
    }

    fn line_ended(&mut self) {
        self.page.line += 1;
        self.page.at_line_start = true;
        if self.parameters.lines_per_page > 0 && self.page.line >= self.parameters.body_lines() {
            self.end_page();
        }
    }

    /// Footers go to the foot of the page. An empty page is not ended.
    fn end_page(&mut self) {
        if self.page.is_empty {
            return;
        }
        let end = self.parameters.line_end.bytes();
        if !self.page.at_line_start {
            self.bytes.extend(end);
            self.page.line += 1;
        }
        if !self.parameters.footers.is_empty() {
            let missing = self.parameters.body_lines().saturating_sub(self.page.line);
            self.bytes.extend(end.repeat(missing));
            self.lines(&self.parameters.footers);
        }
        self.bytes.push(FORM_FEED);
        let number = self.page.number.checked_add(1).unwrap_or(1);
        self.page = Page { number, ..Page::new() };
    }

    /// Headers or footers: `%P` is the page number, other conversion statements go to the printer as they are.
    /// [CP 341 manual 09/2008, p. 103]
    fn lines(&mut self, lines: &[Vec<u8>]) {
        for line in lines {
            self.margin();
            let mut rest = line.as_slice();
            while let Some((&byte, behind)) = rest.split_first() {
                let next = behind.first();
                match (byte, next) {
                    (b'%', Some(b'P' | b'p')) => {
                        self.bytes.extend(self.page.number.to_string().into_bytes());
                        rest = &behind[1..];
                    }
                    (b'\\', Some(statement)) if self.parameters.controls.contains_key(statement) => {
                        self.bytes.extend(&self.parameters.controls[statement]);
                        rest = &behind[1..];
                    }
                    _ => {
                        self.bytes.push(self.parameters.character_set.byte(byte));
                        rest = behind;
                    }
                }
            }
            self.bytes.extend(self.parameters.line_end.bytes());
        }
    }
}
