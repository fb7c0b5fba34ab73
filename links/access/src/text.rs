//! A value as STL writes it, both ways, for every tool: `S5T#1S500MS`, `1.5`, `'ABC'`, `D#2026-1-31`.

use ob1_model::{DataType, Put, S5Time};
use ob1_stl::{constant_bytes, duration_text};
use serde_json::Value;

use crate::datum::{read, write};
use crate::{Datum, Item, Typed, value};

impl Typed {
    /// The value in the bytes of [`Typed::piece`] as text; what does not fit its type in hexadecimal.
    #[must_use]
    pub fn text(&self, bytes: &[u8]) -> String {
        match self.value(bytes) {
            Some(datum) => text(&self.ty, &datum),
            None => format!("16#{}", self.hex(bytes)),
        }
    }

    /// The bits in the bytes of [`Typed::piece`]; none: it is more than a single value of up to 32 bits.
    #[must_use]
    pub fn bits(&self, bytes: &[u8]) -> Option<u32> {
        Item::of(self).map(|item| item.bits(bytes))
    }

    /// The same bytes in hexadecimal, as wide as the place is.
    #[must_use]
    pub fn hex(&self, bytes: &[u8]) -> String {
        match (Item::of(self), self.bits(bytes)) {
            (Some(item), Some(bits)) => value::to_hex(&item, bits),
            _ => bytes.iter().map(|byte| format!("{byte:02X}")).collect(),
        }
    }

    /// The writes for a value given as JSON: a text in the notation of STL, or a number, boolean or array.
    ///
    /// # Errors
    /// What is wrong with it, in one sentence.
    pub fn puts_of(&self, value: &Value) -> Result<Vec<Put>, String> {
        if let Some(item) = Item::of(self) {
            return Ok(vec![Put::Value(item.cell, item.width, value::from_json(&item, value)?)]);
        }
        self.puts(&self.datum_of(value)?).map_err(|why| format!("{}: {why}", self.name))
    }

    /// The value given as JSON.
    ///
    /// # Errors
    /// What is wrong with it, in one sentence, with the form to write.
    pub fn datum_of(&self, value: &Value) -> Result<Datum, String> {
        let unfit = |why: String| {
            let form = form(&self.ty).map_or_else(String::new, |form| format!("; write {form}"));
            format!("{value} is not a value for {}, which is {}{form}: {why}", self.name, self.ty.name())
        };
        match value {
            // A STRING is also taken as it is, without quotes.
            Value::String(text) if matches!(self.ty, DataType::String(_)) && !text.starts_with('\'') => {
                Ok(Datum::Text(text.clone()))
            }
            Value::String(text) if !matches!(self.ty, DataType::Array(..)) => match constant_bytes(text, &self.ty) {
                Ok(bytes) => read(&self.ty, &bytes, 0).ok_or_else(|| unfit("it does not fit".into())),
                Err(why) => Datum::of_json(value, &self.ty).map_err(|_| unfit(why)),
            },
            value => Datum::of_json(value, &self.ty).map_err(|why| unfit(why.to_string())),
        }
    }
}

/// What a person writes for a type that has a notation of its own.
#[must_use]
pub const fn form(ty: &DataType) -> Option<&'static str> {
    Some(match ty {
        DataType::S5Time => "S5T#1S500MS",
        DataType::Time => "T#1S500MS",
        DataType::TimeOfDay => "TOD#6:30:0",
        DataType::Date => "D#2026-1-31",
        DataType::DateAndTime => "DT#2026-1-31-6:30:0",
        DataType::Char => "'A'",
        DataType::String(_) => "'ABC'",
        DataType::Counter => "C#5",
        DataType::Real => "1.5, -5 or 1e3",
        DataType::Bool => "0, 1, true or false",
        _ => return None,
    })
}

/// A value of a type as text.
#[must_use]
pub fn text(ty: &DataType, datum: &Datum) -> String {
    match (ty, datum) {
        (_, Datum::Bool(bit)) => u8::from(*bit).to_string(),
        (DataType::Char, Datum::Byte(byte)) => quoted(std::iter::once(char::from(*byte))),
        (_, Datum::Byte(value)) => value.to_string(),
        (DataType::Counter, Datum::Word(value)) => format!("C#{value}"),
        (_, Datum::Word(value)) => value.to_string(),
        (_, Datum::DWord(value)) => value.to_string(),
        (_, Datum::Int(value)) => value.to_string(),
        (_, Datum::DInt(value)) => value.to_string(),
        // The fewest digits that give the same number again, with a point or an exponent.
        (_, Datum::Real(value)) => format!("{value:?}"),
        (DataType::S5Time, Datum::Duration(ms)) => format!("S5T#{}", duration_text(*ms)),
        (DataType::Time, Datum::Duration(ms)) => format!("T#{}", duration_text(*ms)),
        (_, Datum::Text(text)) => quoted(text.chars()),
        (_, Datum::Bytes(bytes)) => bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" "),
        (DataType::Array(_, element), Datum::List(list)) => {
            list.iter().map(|one| text(element, one)).collect::<Vec<_>>().join(", ")
        }
        (ty, datum) => {
            let written = write(ty, datum).ok().and_then(|bytes| ob1_stl::print::constant(ty, &bytes));
            written.unwrap_or_else(|| datum.to_string())
        }
    }
}

/// The bits of a single value as text.
#[must_use]
pub fn of_bits(item: &Item, bits: u32) -> String {
    if item.width == ob1_model::Width::Bit {
        return (bits & 1).to_string();
    }
    let bytes = bits.to_be_bytes();
    let own = bytes.get(4 - item.width.bytes() as usize..).unwrap_or_default();
    // Of a date or time that does not exist the bits are told.
    read(&item.ty, own, 0).map_or_else(|| format!("16#{}", value::to_hex(item, bits)), |datum| text(&item.ty, &datum))
}

/// Characters in quotes, as a constant has them; what a terminal would not show by its code.
fn quoted(chars: impl Iterator<Item = char>) -> String {
    let mut out = String::from("'");
    for c in chars {
        match c {
            '\'' | '$' => out.extend(['$', c]),
            c if c.is_control() => out += &format!("${:02X}", u32::from(c)),
            c => out.push(c),
        }
    }
    out.push('\'');
    out
}

/// The S5TIME nearest below a duration; none beyond its range.
#[must_use]
pub fn s5time(ms: u64) -> Option<u32> {
    u32::try_from(ms).ok().and_then(S5Time::from_ms).map(|time| u32::from(time.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::Cell;
    use serde_json::json;

    fn typed(ty: DataType) -> Typed {
        Typed { name: "X".into(), cell: Cell::Db(1, 0), ty }
    }

    /// Each value as it is shown, which gives the same value again.
    #[test]
    fn what_is_shown_can_be_written() {
        for (ty, bytes, shown) in [
            (DataType::S5Time, &[0x04, 0x98][..], "S5T#4S980MS"),
            (DataType::S5Time, &[0x20, 0x05], "S5T#5S"),
            (DataType::Time, &[0, 0, 5, 0xDC], "T#1S500MS"),
            (DataType::Time, &[0xFF, 0xFF, 0xFF, 0xEC], "T#-20MS"),
            (DataType::TimeOfDay, &[0x01, 0x64, 0xD4, 0xC0], "TOD#6:29:45.280"),
            (DataType::Date, &[0, 0], "D#1990-1-1"),
            (DataType::Real, &[0x41, 0x49, 0x0A, 0x3D], "12.565"),
            (DataType::Real, &[0x41, 0x20, 0, 0], "10.0"),
            (DataType::Real, &[0x7F, 0x80, 0, 0], "inf"),
            (DataType::Char, b"A", "'A'"),
            (DataType::String(4), &[4, 2, b'$', 0xD6, 0, 0], "'$$Ö'"),
            (DataType::DateAndTime, &[0x26, 0x01, 0x31, 0x06, 0x30, 0, 0, 0x07], "DT#2026-1-31-6:30:0.000"),
            (DataType::Word, &[1, 2], "258"),
            (DataType::Int, &[0xFF, 0xFF], "-1"),
            (DataType::Counter, &[0, 5], "C#5"),
        ] {
            let cell = if ty == DataType::Counter { Cell::Counter(1) } else { Cell::Db(1, 0) };
            let typed = Typed { cell, ..typed(ty) };
            assert_eq!(typed.text(bytes), shown);
            let puts = typed.puts_of(&json!(shown)).unwrap_or_else(|why| panic!("{shown}: {why}"));
            let written: Vec<u8> = match &puts[..] {
                [Put::Value(_, width, value)] => value.to_be_bytes()[4 - width.bytes() as usize..].to_vec(),
                [Put::Bytes(_, bytes)] => bytes.to_vec(),
                other => panic!("{other:?}"),
            };
            // The rest of a STRING stays as it is. An S5TIME may have another base for the same time.
            assert_eq!(typed.text(&[&written[..], &bytes[written.len()..]].concat()), shown);
        }
        assert_eq!(typed(DataType::S5Time).text(&[0x0A, 0]), "16#0A00", "no digits");
    }

    #[test]
    fn a_refusal_shows_the_form() {
        let why = typed(DataType::DateAndTime).puts_of(&json!("noon")).expect_err("no date");
        assert!(why.contains("which is DATE_AND_TIME; write DT#2026-1-31-6:30:0"), "{why}");
        assert!(typed(DataType::Struct(Vec::new())).puts_of(&json!(1)).is_err());
        assert_eq!(
            typed(DataType::String(3)).puts_of(&json!("abc")),
            typed(DataType::String(3)).puts_of(&json!("'abc'"))
        );
    }
}
