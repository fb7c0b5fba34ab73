//! Common parts of the programs of stations with a CP 341.

/// Instances of P_RCV_RK and P_SND_RK.
pub(crate) const INSTANCES: &str = "
DATA_BLOCK DB 7
FB 7
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 8
FB 8
BEGIN
END_DATA_BLOCK
";

/// A data block of this many bytes.
pub(crate) fn data_block(number: u16, bytes: usize) -> String {
    let array = format!("DATA : ARRAY [0..{}] OF BYTE;", bytes - 1);
    format!("\nDATA_BLOCK DB {number}\nSTRUCT\n  {array}\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n")
}
