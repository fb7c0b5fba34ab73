//! Parts of the protocol that only the host side needs.

/// Number of fragments of a stream of this many bytes, without byte 0 of each.
///
/// For sending, the stream is 3 bytes and the user data: "ceil((length + 3) / (IO size - 1))".
pub const fn fragments(stream_bytes: usize, io_bytes: usize) -> usize {
    stream_bytes.div_ceil(io_bytes - 1)
}

/// Whether the CP does not answer: then the inputs are zero, and `0` is not an answer to a command other than `0`.
pub(crate) fn is_absent(inputs: &[u8], output0: u8) -> bool {
    inputs.first().is_none_or(|byte| *byte == 0) && output0 & 0x0F != 0
}
