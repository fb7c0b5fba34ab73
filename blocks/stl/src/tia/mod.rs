//! What TIA Portal's dialect has besides that of STEP 7 V5: its types, and its instances of IEC timers and counters.

use ob1_model::{BlockId, BlockKind, DataType, Field};

/// Types that STL moves as bytes, words and double words, with the type of the same size they become.
const SAME_SIZE: [(&str, DataType); 13] = [
    ("USINT", DataType::Byte),
    ("SINT", DataType::Byte),
    ("UINT", DataType::Word),
    ("UDINT", DataType::DWord),
    ("WCHAR", DataType::Word),
    (DB_ANY, DataType::Word),
    ("HW_ANY", DataType::Word),
    ("HW_IO", DataType::Word),
    ("HW_SUBMODULE", DataType::Word),
    ("HW_DEVICE", DataType::Word),
    ("CONN_ANY", DataType::Word),
    ("PIP", DataType::Word),
    ("RTM", DataType::Word),
];

/// The type of an input that takes a data block as its number.
pub(crate) const DB_ANY: &str = "DB_ANY";

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

/// Instructions of TIA Portal for open communication.
const OPEN_COMMUNICATION: [&str; 9] =
    ["TSEND_C", "TRCV_C", "TSEND", "TRCV", "TCON", "TDISCON", "TUSEND", "TURCV", "T_RESET"];

/// What to write instead of an instruction of TIA Portal.
pub(crate) fn instead(instruction: &str) -> &'static str {
    if OPEN_COMMUNICATION.iter().any(|name| name.eq_ignore_ascii_case(instruction)) {
        return "Send and receive with AG_SEND and AG_RECV of a CP 343 (--library CP300, plugin ob1_cp343); the connection \
                stands in the station file (docs/cp343.md).";
    }
    "Write an instruction of TIA Portal as statements (MOVE: L and T) or as a block, or add the symbol table that has the \
     name."
}

/// The IEC timers and counters by the words that declare an instance: those of an S7-300 are SFB 0 to 5, those of an
/// S7-1500, which have another layout, lie [`OF_1500`] beyond.
const INSTANCES: [(&str, u16); 16] = [
    ("CTU", 0),
    ("CTU_INT", OF_1500),
    ("CTD", 1),
    ("CTD_INT", OF_1500 + 1),
    ("CTUD", 2),
    ("CTUD_INT", OF_1500 + 2),
    ("IEC_COUNTER", OF_1500 + 2),
    ("TP", 3),
    ("TP_TIME", OF_1500 + 3),
    ("TON", 4),
    ("TON_TIME", OF_1500 + 4),
    ("IEC_TIMER", OF_1500 + 4),
    ("TOF", 5),
    ("TOF_TIME", OF_1500 + 5),
    ("R_TRIG", OF_1500 + 6),
    ("F_TRIG", OF_1500 + 7),
];

/// Distance between the numbers of IEC timers and counters with instances of an S7-300 and of an S7-1500.
const OF_1500: u16 = 1000;

/// What an instance of the IEC timers and counters is made for.
#[derive(Clone, Copy, PartialEq)]
enum Family {
    Counter,
    Timer,
}

/// The family of one with an instance of an S7-1500, or of an S7-300.
fn family(id: BlockId, of_1500: bool) -> Option<Family> {
    let number = if of_1500 { id.number.checked_sub(OF_1500)? } else { id.number };
    match (id.kind, number) {
        (BlockKind::Sfb, 0..=2) => Some(Family::Counter),
        (BlockKind::Sfb, 3..=5) => Some(Family::Timer),
        _ => None,
    }
}

/// The block that is meant by a call of an IEC timer or counter with an instance: `CALL TON` with an IEC_TIMER.
pub fn called_with(called: BlockId, instance: BlockId) -> BlockId {
    match family(called, false) {
        Some(one) if family(instance, true) == Some(one) => BlockId::new(called.kind, called.number + OF_1500),
        _ => called,
    }
}

/// True for an instance that is a system data type of TIA Portal: it may lie in structures and data blocks.
pub(crate) fn is_data_type(fb: BlockId) -> bool {
    family(fb, true).is_some()
}

/// The blocks of these system data types.
pub fn data_types() -> impl Iterator<Item = BlockId> {
    (OF_1500..OF_1500 + 6).map(|number| BlockId::new(BlockKind::Sfb, number))
}

/// True for blocks that can run with each other's instance: IEC_TIMER and IEC_COUNTER are one type each.
pub fn same_instance(one: BlockId, other: BlockId) -> bool {
    family(one, true).is_some_and(|family_of_one| family(other, true) == Some(family_of_one))
}

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
        || word.rsplit_once('_').is_some_and(|(one, of)| {
            ["CTU", "CTD", "CTUD", "TON", "TOF", "TP"].contains(&one)
                && ["SINT", "USINT", "UINT", "DINT", "UDINT", "LINT", "ULINT", "LTIME"].contains(&of)
        })
        || ["IEC_SCOUNTER", "IEC_DCOUNTER", "IEC_UCOUNTER", "IEC_UDCOUNTER", "IEC_USCOUNTER"].contains(&word)
}

/// The block that an instance type in capitals belongs to.
pub(crate) fn instance(word: &str) -> Option<BlockId> {
    let number = INSTANCES.iter().find(|(name, _)| *name == word)?.1;
    Some(BlockId::new(BlockKind::Sfb, number))
}

/// DTL: 12 bytes. Without a start value it is DTL#1970-01-01-00:00:00, a Thursday.
pub fn dtl() -> DataType {
    let field = |name: &str, ty, initial: &[u8]| Field {
        name: name.to_owned(),
        ty,
        initial: initial.iter().any(|byte| *byte != 0).then(|| initial.to_vec()),
    };
    let bytes = [("MONTH", 1), ("DAY", 1), ("WEEKDAY", 5), ("HOUR", 0), ("MINUTE", 0), ("SECOND", 0)];
    let mut fields = vec![field("YEAR", DataType::Word, &1970u16.to_be_bytes())];
    fields.extend(bytes.map(|(name, first)| field(name, DataType::Byte, &[first])));
    fields.push(field("NANOSECOND", DataType::DWord, &[]));
    DataType::Struct(fields)
}

/// True for an attribute list that says optimised access.
pub(crate) fn is_optimized(attributes: &str) -> bool {
    let compact: String = attributes.chars().filter(|c| !c.is_whitespace()).collect();
    compact.to_ascii_uppercase().contains("S7_OPTIMIZED_ACCESS:='TRUE'")
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

    #[test]
    fn blocks_and_instances() {
        let sfb = |n| BlockId::new(BlockKind::Sfb, n);
        assert_eq!(called_with(sfb(4), sfb(1003)), sfb(1004));
        assert_eq!(called_with(sfb(4), sfb(4)), sfb(4));
        assert_eq!(called_with(sfb(4), sfb(1000)), sfb(4));
        assert!(same_instance(sfb(1003), sfb(1005)) && same_instance(sfb(1000), sfb(1002)));
        assert!(!same_instance(sfb(1000), sfb(1003)) && !same_instance(sfb(4), sfb(1004)));
        assert!(instead("tsend").contains("AG_SEND") && !instead("MOVE").contains("AG_SEND"));
        assert!(data_types().all(is_data_type) && !is_data_type(sfb(1006)));
    }
}
