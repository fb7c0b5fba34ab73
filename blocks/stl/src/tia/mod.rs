//! What TIA Portal's dialect has beside that of STEP 7 V5: its types, and its instances of IEC timers and counters.

use ob1_model::{BlockId, BlockKind, DataType, Field};

/// Types that STL moves as bytes, words and double words, with the type of the same size they become.
const SAME_SIZE: [(&str, DataType); 13] = [
    ("USINT", DataType::Byte),
    ("SINT", DataType::Byte),
    ("UINT", DataType::Word),
    ("UDINT", DataType::DWord),
    ("WCHAR", DataType::Word),
    ("DB_ANY", DataType::Word),
    ("HW_ANY", DataType::Word),
    ("HW_IO", DataType::Word),
    ("HW_SUBMODULE", DataType::Word),
    ("HW_DEVICE", DataType::Word),
    ("CONN_ANY", DataType::Word),
    ("PIP", DataType::Word),
    ("RTM", DataType::Word),
];

/// Types that STL has no statement for.
const WITHOUT_STL: [&str; 15] = [
    "LREAL",
    "LINT",
    "ULINT",
    "LWORD",
    "LTIME",
    "LTOD",
    "LTIME_OF_DAY",
    "LDT",
    "WSTRING",
    "VARIANT",
    "REMOTE",
    "TONR",
    "TONR_TIME",
    "IEC_LTIMER",
    "ERROR_STRUCT",
];

/// The IEC timers and counters by the words that declare an instance.
const INSTANCES: [(&str, u16); 13] = [
    ("CTU", 0),
    ("CTU_INT", 0),
    ("CTD", 1),
    ("CTD_INT", 1),
    ("CTUD", 2),
    ("CTUD_INT", 2),
    ("IEC_COUNTER", 2),
    ("TP", 3),
    ("TP_TIME", 3),
    ("TON", 4),
    ("TON_TIME", 4),
    ("IEC_TIMER", 4),
    ("TOF", 5),
];

/// The type of one word in capitals.
pub(crate) fn simple(word: &str) -> Option<DataType> {
    if word == "DTL" {
        return Some(dtl());
    }
    if word.starts_with("OB_") || word.starts_with("EVENT_") {
        return Some(if word.starts_with("OB_") { DataType::Int } else { DataType::DWord });
    }
    SAME_SIZE.iter().find(|(name, _)| *name == word).map(|(_, ty)| ty.clone())
}

/// True for a type of TIA Portal that STL cannot work on.
pub(crate) fn without_stl(word: &str) -> bool {
    WITHOUT_STL.contains(&word)
        || ["CTU_", "CTD_", "CTUD_", "TON_", "TOF_", "TP_"].iter().any(|counter| word.starts_with(counter))
        || ["IEC_SCOUNTER", "IEC_DCOUNTER", "IEC_UCOUNTER", "IEC_UDCOUNTER", "IEC_USCOUNTER"].contains(&word)
}

/// The block that an instance type in capitals belongs to.
pub(crate) fn instance(word: &str) -> Option<BlockId> {
    let word = if word == "TOF_TIME" { "TOF" } else { word };
    let number = INSTANCES.iter().find(|(name, _)| *name == word)?.1;
    Some(BlockId::new(BlockKind::Sfb, number))
}

/// DTL: 12 bytes.
pub(crate) fn dtl() -> DataType {
    let field = |name: &str, ty| Field { name: name.to_owned(), ty, initial: None };
    let bytes = ["MONTH", "DAY", "WEEKDAY", "HOUR", "MINUTE", "SECOND"].map(|name| field(name, DataType::Byte));
    let mut fields = vec![field("YEAR", DataType::Word)];
    fields.extend(bytes);
    fields.push(field("NANOSECOND", DataType::DWord));
    DataType::Struct(fields)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_those_of_tia() {
        let bits = |word| simple(word).map(|ty| ob1_model::Layout::bits(&ty));
        assert_eq!([bits("USINT"), bits("UINT"), bits("UDINT"), bits("DTL")], [Some(8), Some(16), Some(32), Some(96)]);
        assert!(without_stl("LREAL") && without_stl("CTU_DINT") && instance("CTU_INT").is_some());
    }
}
