//! What a connection may ask for: jobs at once, bytes of a PDU.

/// Maximum of outstanding jobs per connection.
pub const MAX_JOBS: u16 = 8;
/// Largest PDU we agree to. An S7-300 has 240, an S7-400 480; clients request up to 1024.
pub const MAX_PDU: u16 = 1024;
/// Smallest useful PDU: a header, an upload's answer.
pub const MIN_PDU: u16 = 64;
