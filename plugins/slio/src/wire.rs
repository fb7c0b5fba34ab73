//! What of byte 0 only the host's side asks.

/// Fragments of a stream of so many bytes, byte 0 of each left out.
///
/// To send, the stream is the user data and 3 bytes in front: "ceil((length + 3) / (IO size - 1))".
pub const fn fragments(stream_bytes: usize, io_bytes: usize) -> usize {
    stream_bytes.div_ceil(io_bytes - 1)
}

/// Whether the inputs are those of a CP that is not there: it reads as zeros, and `0` answers no other command than
/// `0`.
pub(crate) fn is_absent(inputs: &[u8], output0: u8) -> bool {
    inputs.first().is_none_or(|byte| *byte == 0) && output0 & 0x0F != 0
}
