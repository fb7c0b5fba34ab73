//! Compiler options that change what a block does: `{SCL_SetOKFlag := 'y'}` before a block or behind its head.

use ob1_stl::front::{Block, File, Kind};

/// The options of one block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Options {
    /// Calculations and conversions clear OK.
    pub(crate) set_ok: bool,
    /// An index outside its array clears OK.
    pub(crate) monitor_limits: bool,
    /// The length of each STRING that a function gives back and that is kept in between.
    pub(crate) longest_text: u8,
    /// A block of TIA Portal: it is optimised, or its name stands in quotes.
    pub(crate) tia: bool,
}

/// The options up to a token of a source. They hold for what follows, too.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Read {
    file: usize,
    token: usize,
    options: Options,
}

impl Read {
    /// Those up to the statements of a block.
    pub(crate) fn until(self, block: &Block, file: &File<'_>) -> Self {
        let body = block.scl.as_ref().map_or(0, |range| range.start);
        let goes_on = self.file == block.file && self.token <= body;
        let mut read = if goes_on { self } else { Self { file: block.file, ..Self::default() } };
        let tokens = file.tokens.get(read.token..body).unwrap_or_default();
        for token in tokens.iter().filter(|t| t.kind == Kind::Attributes) {
            read.options.read(file.of(*token));
        }
        Self { token: body, ..read }
    }

    /// Those of a block that they are read for.
    pub(crate) fn of(self, block: &Block, file: &File<'_>) -> Options {
        let tia = block.optimized || file.slice(block.span).starts_with('"');
        Options { tia, ..self.options }
    }
}

impl Options {
    fn read(&mut self, attributes: &str) {
        let inner = attributes.trim_matches(['{', '}']);
        for pair in inner.split([';', ',']) {
            let Some((name, value)) = pair.split_once(":=") else { continue };
            let (name, value) = (name.trim().to_ascii_uppercase(), value.trim().trim_matches('\''));
            let yes = value.eq_ignore_ascii_case("y");
            match name.as_str() {
                "SCL_SETOKFLAG" => self.set_ok = yes,
                "SCL_MONITORARRAYLIMITS" => self.monitor_limits = yes,
                "SCL_SETMAXIMUMSTRINGLENGTH" => {
                    self.longest_text = value.parse().ok().filter(|n| (1..=254).contains(n)).unwrap_or(254);
                }
                "SCL_RESETOPTIONS" if yes => *self = Self::default(),
                _ => {}
            }
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self { set_ok: false, monitor_limits: false, longest_text: 254, tia: false }
    }
}
