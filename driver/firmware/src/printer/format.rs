//! Format string and message texts: text, conversion statements, control statements.
//! [CP 341 manual 09/2008, p. 76, 100 to 103]

use ob1_params::printer::Printer as Parameters;

use super::Fault;
use super::value::{self, STARS, Shown};

/// Widest display. [CP 341 manual 09/2008, p. 100]
const WIDTH_MAX: usize = 255;

/// Most decimal places. [CP 341 manual 09/2008, p. 100]
const PRECISION_MAX: usize = 99;

/// A part of a printout.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Piece {
    /// Text in ANSI, not converted yet.
    Text(Vec<u8>),
    /// Control characters for the printer.
    Control(Vec<u8>),
    /// Begin a new page.
    NewPage,
    /// The end of the line.
    LineEnd,
}

impl Piece {
    /// Number of characters that take room on the line.
    pub(crate) fn characters(&self) -> usize {
        if let Self::Text(text) = self { text.len() } else { 0 }
    }
}

/// A conversion statement of the format string: `%` and what follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Conversion {
    left: bool,
    width: Option<usize>,
    precision: Option<usize>,
    display: u8,
}

/// Reads the conversion statement after a `%`; returns it and its length in bytes. For an invalid one the error
/// contains the fault and where the text continues.
fn conversion(text: &[u8]) -> Result<(Conversion, usize), (Fault, usize)> {
    let mut at = 0;
    let left = text.first() == Some(&b'-');
    at += usize::from(left);
    let digits = |from: usize| text[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let number = |from: usize, count: usize| {
        text[from..from + count].iter().fold(0_usize, |value, digit| 10 * value.min(1000) + usize::from(digit - b'0'))
    };
    let count = digits(at);
    let width = (count > 0).then(|| number(at, count));
    at += count;
    // "A width of 0 is not permissible." [CP 341 manual 09/2008, p. 103]
    if width.is_some_and(|width| width == 0 || width > WIDTH_MAX) {
        return Err((Fault::Width, at));
    }
    let mut precision = None;
    if text.get(at) == Some(&b'.') {
        at += 1;
        let count = digits(at);
        precision = (count > 0).then(|| number(at, count));
        at += count;
        if precision.is_some_and(|precision| precision > PRECISION_MAX) {
            return Err((Fault::Precision, at));
        }
        if precision.is_none() {
            return Err((Fault::Conversion, (at + 1).min(text.len())));
        }
    }
    let display = text.get(at).map(u8::to_ascii_uppercase).filter(|display| value::TYPES.contains(display));
    match display {
        Some(display) => Ok((Conversion { left, width, precision, display }, at + 1)),
        None => Err((Fault::Conversion, (at + 1).min(text.len()))),
    }
}

/// The page number set by a format string that consists only of `%P`.
pub(crate) fn page_number(format: &[u8], variables: &[&[u8]]) -> Option<Result<u16, Fault>> {
    let is_it = matches!(format, [b'%', b'P' | b'p']);
    is_it.then(|| match variables {
        [number] if number.len() == 2 => match i16::from_be_bytes([number[0], number[1]]) {
            number @ 0.. => Ok(number as u16),
            _ => Err(Fault::Value),
        },
        [] => Err(Fault::TooManyConversions),
        _ => Err(Fault::Variable),
    })
}

/// The source of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    FormatString,
    MessageText,
}

/// A message text in a printout, to be expanded after the format string.
enum Part {
    Piece(Piece),
    Message(u16),
}

/// Expands format string and message texts with the variables of a job.
pub(crate) struct Source<'a> {
    parameters: &'a Parameters,
    variables: std::slice::Iter<'a, &'a [u8]>,
    /// The first fault found; the printout goes on with replacements.
    fault: Option<Fault>,
}

impl<'a> Source<'a> {
    pub(crate) fn new(parameters: &'a Parameters, variables: &'a [&'a [u8]]) -> Self {
        Self { parameters, variables: variables.iter(), fault: None }
    }

    /// All pieces. "If both the format string and the message text contain conversion statements, the format string is
    /// expanded first." [CP 341 manual 09/2008, p. 103]
    pub(crate) fn expand(&mut self, format: &[u8]) -> Result<Vec<Piece>, Fault> {
        let mut pieces = Vec::new();
        for part in self.parts(format, Level::FormatString) {
            match part {
                Part::Piece(piece) => pieces.push(piece),
                Part::Message(number) => self.message(number, &mut pieces)?,
            }
        }
        Ok(pieces)
    }

    /// The first fault; a variable without a conversion statement is not printed.
    pub(crate) fn finish(mut self) -> Option<Fault> {
        if self.variables.next().is_some() {
            self.note(Fault::TooManyVariables);
        }
        self.fault
    }

    fn note(&mut self, fault: Fault) {
        self.fault.get_or_insert(fault);
    }

    fn message(&mut self, number: u16, pieces: &mut Vec<Piece>) -> Result<(), Fault> {
        let Some(text) = self.parameters.texts.get(&number) else {
            self.note(if self.parameters.texts.is_empty() { Fault::NoTexts } else { Fault::NoText });
            pieces.push(stars(STARS));
            return Ok(());
        };
        for part in self.parts(text, Level::MessageText) {
            if let Part::Piece(piece) = part {
                pieces.push(piece);
            }
        }
        Ok(())
    }

    fn parts(&mut self, mut text: &[u8], level: Level) -> Vec<Part> {
        let mut parts = Vec::new();
        // "A line feed is carried out by default after each output." [CP 341 manual 09/2008, p. 76]
        let mut ends = level == Level::FormatString;
        while let Some((&byte, rest)) = text.split_first() {
            text = rest;
            match byte {
                // Two of them are the character itself. (ours)
                b'%' | b'\\' if text.first() == Some(&byte) => {
                    parts.push(Part::Piece(Piece::Text(vec![byte])));
                    text = &text[1..];
                }
                b'%' => {
                    let (part, length) = self.convert(text, level);
                    text = &text[length..];
                    parts.extend(part);
                }
                b'\\' => {
                    let statement = text.first().copied();
                    text = text.get(1..).unwrap_or_default();
                    match (statement, level) {
                        (Some(b'F'), Level::FormatString) => parts.push(Part::Piece(Piece::NewPage)),
                        (Some(b'x'), Level::FormatString) if text.is_empty() => ends = false,
                        (Some(statement), _) if self.parameters.controls.contains_key(&statement) => {
                            parts.push(Part::Piece(Piece::Control(self.parameters.controls[&statement].clone())));
                        }
                        // Not executed, and not printed either.
                        _ => self.note(Fault::Control),
                    }
                }
                byte => match parts.last_mut() {
                    Some(Part::Piece(Piece::Text(text))) => text.push(byte),
                    _ => parts.push(Part::Piece(Piece::Text(vec![byte]))),
                },
            }
        }
        // A new page alone is not a line.
        let is_a_line = !matches!(&parts[..], [Part::Piece(Piece::NewPage)]);
        if ends && is_a_line {
            parts.push(Part::Piece(Piece::LineEnd));
        }
        parts
    }

    /// The conversion statement at the beginning of this text, and its length.
    fn convert(&mut self, text: &[u8], level: Level) -> (Option<Part>, usize) {
        let (statement, length) = match conversion(text) {
            Ok(found) => found,
            Err((fault, length)) => {
                self.note(fault);
                // It uses up its variable nevertheless.
                self.variables.next();
                return (Some(Part::Piece(stars(STARS))), length);
            }
        };
        let is_number = statement.display == b'N' && level == Level::FormatString;
        if statement.display == b'P' || statement.display == b'N' && !is_number {
            self.note(Fault::Conversion);
            self.variables.next();
            return (Some(Part::Piece(stars(STARS))), length);
        }
        let Some(variable) = self.variables.next() else {
            self.note(Fault::TooManyConversions);
            return (None, length);
        };
        if is_number {
            let &[high, low] = *variable else {
                self.note(Fault::Variable);
                return (Some(Part::Piece(stars(STARS))), length);
            };
            return (Some(Part::Message(u16::from_be_bytes([high, low]))), length);
        }
        let piece = match value::show(statement.display, variable, statement.precision) {
            Ok(shown) => self.fit(shown, statement),
            Err(fault) => {
                self.note(fault);
                stars(statement.width.unwrap_or_else(|| value::default_width(statement.display, variable.len())))
            }
        };
        (Some(Part::Piece(piece)), length)
    }

    /// Fits it to its width. [CP 341 manual 09/2008, p. 100, 103]
    fn fit(&mut self, shown: Shown, statement: Conversion) -> Piece {
        let Shown { mut text, is_cut } = shown;
        let Some(width) = statement.width else { return Piece::Text(text) };
        if text.len() > width {
            self.note(Fault::Width);
            if !is_cut {
                return stars(width);
            }
            text.truncate(width);
        }
        let blanks = vec![b' '; width - text.len()];
        Piece::Text(if statement.left { [text, blanks].concat() } else { [blanks, text].concat() })
    }
}

fn stars(count: usize) -> Piece {
    Piece::Text(vec![b'*'; count])
}
