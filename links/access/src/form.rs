//! The forms in which people read a value: according to its type, hexadecimal, binary, and the words of handling
//! blocks.

use ob1_words::cp341_events;

/// How a value is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// According to its type.
    #[default]
    Plain,
    /// Hexadecimal, as wide as the value: `16#1A2B`.
    Hex,
    /// Binary, in groups of four bits: `2#0001_1010`.
    Bin,
    /// The indicator word of a handling block, in words.
    Anzw,
    /// STATUS of P_SND_RK or P_RCV_RK, in words.
    Status,
}

/// The endings of a name that choose a form.
const ENDINGS: [(&str, Form); 4] =
    [(":hex", Form::Hex), (":bin", Form::Bin), (":anzw", Form::Anzw), (":status", Form::Status)];

impl Form {
    /// `NAME`, `NAME:hex`, `NAME:bin`, `NAME:anzw`, `NAME:status`: the name, and the form.
    #[must_use]
    pub fn split(text: &str) -> (&str, Self) {
        let text = text.trim();
        let of = |(ending, form): &(&str, Form)| {
            let name = text.len().checked_sub(ending.len()).filter(|at| text.is_char_boundary(*at))?;
            text[name..].eq_ignore_ascii_case(ending).then_some((&text[..name], *form))
        };
        ENDINGS.iter().find_map(of).unwrap_or((text, Form::Plain))
    }

    /// A value in this form: `text` is it according to its type, `hex` its bits in hexadecimal, as wide as the cell.
    #[must_use]
    pub fn show(self, text: &str, hex: &str) -> String {
        let bits = u32::from_str_radix(hex, 16).unwrap_or(0);
        match self {
            Form::Hex => format!("16#{hex}"),
            Form::Bin => binary(bits, hex.len() * 4),
            Form::Anzw => anzw(bits as u16),
            Form::Status => status(bits as u16),
            Form::Plain => text.to_owned(),
        }
    }
}

fn binary(bits: u32, width: usize) -> String {
    let digits = format!("{bits:0width$b}");
    let groups: Vec<&str> =
        (0..digits.len()).step_by(4).filter_map(|at| digits.get(at..(at + 4).min(digits.len()))).collect();
    format!("2#{}", groups.join("_"))
}

/// The indicator word of the RK 512 blocks: byte 0 the CP's error, byte 1 the state. [S0 L1268]
fn anzw(word: u16) -> String {
    let bits = [(0x0002, "running"), (0x0004, "done"), (0x0008, "done with error")];
    let mut told: Vec<String> =
        bits.iter().filter(|(bit, _)| word & bit != 0).map(|(_, text)| (*text).to_owned()).collect();
    if word >> 8 != 0 {
        told.push(format!("error {:02X}h", word >> 8));
    }
    let words = if told.is_empty() { "idle".to_owned() } else { told.join(", ") };
    format!("16#{word:04X} {words}")
}

/// Event class and number of a CP 341. (docs/cp341-events.md)
fn status(word: u16) -> String {
    let text = match (word, cp341_events::row(word)) {
        (0, _) => "no error",
        (_, Some(row)) => row.text,
        (_, None) => "no event of a CP 341 or CP 340",
    };
    format!("16#{word:04X} {text}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms() {
        for (text, value, hex, shown) in [
            ("MW10", "258", "0102", "258"),
            ("M1.0", "1", "1", "1"),
            ("MW10:hex", "258", "0102", "16#0102"),
            ("MB10:BIN", "26", "1A", "2#0001_1010"),
            ("DB10.DBW20:anzw", "4", "0004", "16#0004 done"),
            ("DB10.DBW20:anzw", "5128", "1408", "16#1408 done with error, error 14h"),
            ("DB10.DBW20:anzw", "0", "0000", "16#0000 idle"),
            ("DB20.DBW4:status", "0", "0000", "16#0000 no error"),
            (
                "DB20.DBW4:status",
                "0x0706",
                "0706",
                "16#0706 At the end of the telegram came NAK, another character than DLE, or DLE too early",
            ),
            ("DB20.DBW4:Status", "0xFFFF", "FFFF", "16#FFFF no event of a CP 341 or CP 340"),
        ] {
            assert_eq!(Form::split(text).1.show(value, hex), shown, "{text}");
        }
        assert_eq!(Form::split(" DB1.A "), ("DB1.A", Form::Plain));
        assert_eq!(Form::split(":hex"), ("", Form::Hex));
    }
}
