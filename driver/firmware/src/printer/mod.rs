//! The printer driver of a CP 340 and a CP 341: makes the printer's input from format string, variables and message
//! texts. `docs/cp340-printer.md`
//!
//! Pure: a job and the state of the page in, characters and the new state out. The ASCII machine handles the line.

mod format;
mod page;
mod value;

use ob1_params::printer::Printer as Parameters;

use format::{Piece, Source};
use page::Page;

/// Maximum number of characters of a printout, without its layout. (0507h)
const CHARACTERS_MAX: usize = 250;

/// Variables of a job. [TIA help "PtP data link CP 341"]
const VARIABLES: usize = 4;

/// The fault of a job, as in STATUS and the diagnostic buffer. (docs/cp341-events.md)
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub(crate) enum Fault {
    /// No message texts at all.
    NoTexts = 0x0505,
    /// No message text of this number.
    NoText = 0x0506,
    /// More than 150 characters of text, or more than 250 with the variables.
    TooLong = 0x0507,
    /// A conversion statement without a variable.
    TooManyConversions = 0x0508,
    /// A variable without a conversion statement.
    TooManyVariables = 0x0509,
    /// An unknown conversion statement.
    Conversion = 0x050A,
    /// An unknown control statement.
    Control = 0x050B,
    /// The value cannot be shown that way.
    Value = 0x050C,
    /// The width is too small or too great.
    Width = 0x050D,
    /// The precision is impossible.
    Precision = 0x051B,
    /// The variable does not have the length of its display type.
    Variable = 0x051C,
    /// More line ends than a page has lines.
    Lines = 0x051E,
}

/// The result of a job.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Printout {
    /// Bytes for the printer.
    pub(crate) bytes: Vec<u8>,
    /// The first fault: the printout shows where it is.
    pub(crate) fault: Option<Fault>,
}

/// The driver: its parameters, and its position on the paper.
#[derive(Debug)]
pub(crate) struct Printer {
    parameters: Parameters,
    page: Page,
}

impl Printer {
    pub(crate) fn new(parameters: &Parameters) -> Self {
        Self { parameters: parameters.clone(), page: Page::new() }
    }

    /// Prints the job of P_PRINT: five words with the lengths of four variables (0: none) and the format string, then
    /// the bytes. `docs/cp341-channels.md`
    ///
    /// # Errors
    /// Nothing is printed: the job is not valid (0301h), or its result is too long.
    pub(crate) fn print(&mut self, job: &[u8]) -> Result<Printout, u16> {
        const WRONG: u16 = 0x0301;
        let (lengths, mut rest) = job.split_at_checked(2 * (VARIABLES + 1)).ok_or(WRONG)?;
        let mut parts: [&[u8]; VARIABLES + 1] = [&[]; VARIABLES + 1];
        for (part, length) in parts.iter_mut().zip(lengths.chunks_exact(2)) {
            let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
            (*part, rest) = rest.split_at_checked(length).ok_or(WRONG)?;
        }
        let [variables @ .., format] = &parts;
        let given: Vec<&[u8]> = variables.iter().copied().filter(|variable| !variable.is_empty()).collect();
        self.print_format(value::characters(format), &given).map_err(|fault| fault as u16)
    }

    fn print_format(&mut self, format: &[u8], variables: &[&[u8]]) -> Result<Printout, Fault> {
        if let Some(number) = format::page_number(format, variables) {
            // "In the P display type no other text may be in the format string." It prints nothing.
            self.page.number = number?;
            return Ok(Printout::default());
        }
        let mut source = Source::new(&self.parameters, variables);
        let pieces = source.expand(format)?;
        let fault = source.finish();
        let characters = pieces.iter().map(Piece::characters).sum::<usize>();
        if characters > CHARACTERS_MAX {
            return Err(Fault::TooLong);
        }
        let bytes = self.page.lay_out(&self.parameters, &pieces)?;
        Ok(Printout { bytes, fault })
    }
}

#[cfg(test)]
mod tests;
