//! The records of a link for `ob1 trace`: in front of the bytes of each record are the connection and the direction in
//! which the connection was made.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// Length of [`Tapped::bytes`], in front of each record.
pub const TAPPED_BYTES: usize = 11;

/// The connection of some bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tapped {
    /// Its number in the link, unique per connection.
    pub number: u32,
    /// The partner's address; for IPv6 only the port is given.
    pub partner: Ipv4Addr,
    /// Port of the partner.
    pub port: u16,
    /// We have made it: the partner is the server.
    pub is_ours: bool,
}

impl Tapped {
    /// A connection with a partner.
    #[must_use]
    pub fn of(number: u32, partner: SocketAddr, is_ours: bool) -> Self {
        let address = if let IpAddr::V4(address) = partner.ip() { address } else { Ipv4Addr::UNSPECIFIED };
        Self { number, partner: address, port: partner.port(), is_ours }
    }

    /// The bytes in front of the record's data.
    #[must_use]
    pub fn bytes(&self) -> [u8; TAPPED_BYTES] {
        let [a, b, c, d] = self.number.to_le_bytes();
        let [e, f, g, h] = self.partner.octets();
        let [i, j] = self.port.to_le_bytes();
        [a, b, c, d, e, f, g, h, i, j, u8::from(self.is_ours)]
    }

    /// Splits a record's data into the connection and the bytes.
    #[must_use]
    pub fn read(data: &[u8]) -> Option<(Self, &[u8])> {
        let (&[a, b, c, d, e, f, g, h, i, j, ours], bytes) = data.split_first_chunk::<TAPPED_BYTES>()?;
        let number = u32::from_le_bytes([a, b, c, d]);
        let tapped =
            Self { number, partner: Ipv4Addr::new(e, f, g, h), port: u16::from_le_bytes([i, j]), is_ours: ours != 0 };
        Some((tapped, bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways() {
        let tapped = Tapped::of(0x0102_0304, "10.1.2.3:50000".parse().expect("an address"), true);
        let data = [&tapped.bytes()[..], &[7, 8]].concat();
        assert_eq!(Tapped::read(&data), Some((tapped, &[7, 8][..])));
        assert_eq!(Tapped::read(&data[..TAPPED_BYTES - 1]), None);
        let six = Tapped::of(1, "[::1]:102".parse().expect("an address"), false);
        assert_eq!((six.partner, six.port), (Ipv4Addr::UNSPECIFIED, 102));
    }
}
