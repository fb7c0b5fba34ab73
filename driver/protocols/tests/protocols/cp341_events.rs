//! The table of event numbers: in order, complete for the machines' events, and the same as the page in docs.

use ob1_protocols::modbus_master_32::number;
use ob1_protocols::rk512::Refusal;
use ob1_words::cp341_events::{Origin, class, row, rows};

use crate::cp341_events_page;

#[test]
fn in_order_and_without_gaps_in_a_row() {
    let numbers: Vec<u16> = rows().map(|row| row.number).collect();
    assert!(numbers.is_sorted_by(|a, b| a < b), "out of order or twice");
    for row in rows() {
        assert!(class(row.number).is_some(), "{:04X} has no class", row.number);
        assert!(!row.text.is_empty() && !row.text.ends_with('.'), "{:04X}", row.number);
        assert!(row.remedy.is_empty() || row.remedy.ends_with(['.', '?']), "{:04X}", row.number);
        assert!(!row.text.contains('|') && !row.remedy.contains('|'), "{:04X} breaks the page", row.number);
        // Information needs no remedy; errors that occur here do.
        let is_information = row.number >> 8 == 0 || matches!(row.number, 0x0701 | 0x0801);
        let wants_remedy = row.origin == Origin::Here && !is_information;
        assert_eq!(!row.remedy.is_empty(), wants_remedy, "{:04X}", row.number);
    }
}

/// Every event of a machine has a row with origin [`Origin::Here`].
#[test]
fn every_number_of_the_machines_has_a_row() {
    let driver = [
        number::PARAMETERS..=number::PARAMETERS,
        number::ABORTED..=number::NOT_READY,
        number::LENGTH..=number::LENGTH,
        number::BUSY..=number::BUSY,
        number::NO_REPLY..=number::NO_REPLY,
        number::OVERFLOW..=number::RESTART,
        number::DATA_BITS..=number::RESPONSE_TIMEOUT_RANGE,
        number::UNEXPECTED_TAKEN..=number::TRANSFER_FAILED,
        number::LEN_MINIMUM..=number::LONG_REGISTERS,
        number::R_TYP..=number::CHARACTER,
        number::EXCEPTION + 1..=number::EXCEPTION + 7,
    ];
    for number in driver.into_iter().flatten().chain(Refusal::ALL.map(Refusal::number)) {
        assert_eq!(row(number).map(|row| row.origin), Some(Origin::Here), "{number:04X}");
    }
    assert_eq!((row(0x0000), class(0x0B01)), (None, None));
}

#[test]
fn the_page_is_the_table() {
    let page = include_str!("../../../../docs/cp341-events.md");
    let expected = cp341_events_page::page();
    let differs = page.lines().zip(expected.lines()).find(|(is, should)| is != should);
    assert_eq!(differs, None, "print the page anew, see its head");
    assert_eq!(page.len(), expected.len(), "print the page anew, see its head");
}
