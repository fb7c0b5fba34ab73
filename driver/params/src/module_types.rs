//! The table of module types: one row for each communication processor, with their differences.

/// A communication processor: the type of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CpKind {
    /// VIPA CP 240, System 200V.
    Cp240,
    /// VIPA CP 040, System SLIO.
    Cp040,
    /// Siemens CP 341: serial, with RK 512.
    Cp341,
    /// Siemens CP 340: serial.
    Cp340,
    /// Siemens CP 343: Ethernet.
    Cp343,
}

/// The properties of a type.
#[derive(Clone, Copy, Debug)]
pub struct CpRow {
    /// The type that the row is about.
    pub kind: CpKind,
    /// Its name in the station file: `type = "cp240"`.
    pub name: &'static str,
    /// Its name for people.
    pub text: &'static str,
    /// Register bytes each way; `None`: the station file chooses them.
    pub io_bytes: Option<u16>,
    /// Names of the LEDs on its front, in the order power, error, transmit, receive; empty: it has none there.
    pub leds: [&'static str; 4],
    /// Its handling blocks use channels (`docs/cp341-channels.md`), its parameters are keys without another form, and
    /// it has its own diagnostic buffer.
    pub has_channels: bool,
    /// Its handling blocks have boxes (`docs/cp343.md`), and its driver is the process of a link.
    pub has_boxes: bool,
    /// It uses the diagnostic record itself, so there is no place for the text of a line error.
    pub has_record: bool,
    /// It needs the current outputs before its first parameters. A CP 341 needs them afterwards: its driver decides who
    /// controls RTS and DTR. [TIA help "PtP data link CP 341"]
    pub outputs_first: bool,
}

/// LEDs of a CP 240 and a CP 040.
const VIPA_LEDS: [&str; 4] = ["PW", "ER", "TxD", "RxD"];
/// What a CP 340 and a CP 341 have in common.
const SIEMENS: CpRow = CpRow {
    kind: CpKind::Cp341,
    name: "",
    text: "",
    io_bytes: Some(16),
    // They have no LED for their power. [S4 "Diagnostics via Display Elements (LEDs)"]
    leds: ["", "SF", "TXD", "RXD"],
    has_channels: true,
    has_boxes: false,
    has_record: true,
    outputs_first: false,
};

impl CpKind {
    /// All rows, each type once.
    pub const TABLE: [CpRow; 5] = [
        CpRow {
            kind: Self::Cp240,
            name: "cp240",
            text: "CP 240",
            io_bytes: Some(16),
            leds: VIPA_LEDS,
            has_channels: false,
            has_boxes: false,
            has_record: false,
            outputs_first: true,
        },
        CpRow { kind: Self::Cp341, name: "cp341", text: "CP 341", ..SIEMENS },
        CpRow { kind: Self::Cp340, name: "cp340", text: "CP 340", ..SIEMENS },
        CpRow {
            kind: Self::Cp040,
            name: "cp040",
            text: "CP 040",
            io_bytes: None,
            leds: VIPA_LEDS,
            has_channels: false,
            has_boxes: false,
            has_record: true,
            outputs_first: true,
        },
        CpRow {
            kind: Self::Cp343,
            name: "cp343",
            text: "CP 343",
            io_bytes: Some(16),
            leds: ["", "SF", "", ""],
            has_channels: false,
            has_boxes: true,
            has_record: true,
            outputs_first: true,
        },
    ];

    /// The properties of this type.
    pub fn row(self) -> &'static CpRow {
        const TABLE: &[CpRow] = &CpKind::TABLE;
        match TABLE.iter().find(|row| row.kind == self) {
            Some(row) => row,
            // A test checks that each type has a row.
            None => &TABLE[0],
        }
    }

    /// The type of this name in the station file.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::TABLE.iter().find(|row| row.name == name).map(|row| row.kind)
    }

    /// Its name in the station file.
    pub fn name(self) -> &'static str {
        self.row().name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_has_its_row() {
        for kind in [CpKind::Cp240, CpKind::Cp040, CpKind::Cp341, CpKind::Cp340, CpKind::Cp343] {
            assert_eq!((kind.row().kind, CpKind::of_name(kind.name())), (kind, Some(kind)));
        }
        assert_eq!(CpKind::of_name("cp999"), None);
    }
}
