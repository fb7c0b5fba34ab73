//! Who somebody at the other end counts as.

use std::net::{IpAddr, Ipv6Addr};

/// The part of an address that its owner cannot choose: of IPv6 the network of 64 bits.
#[must_use]
pub fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() >> 64 << 64)),
        v4 @ IpAddr::V4(_) => v4,
    }
}
