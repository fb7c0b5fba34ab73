//! TSAPs: the called module and the kind of connection.

/// The kinds of connection a CPU keeps resources for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resource {
    /// A programming device (01h).
    Pg,
    /// An operator panel (02h).
    Op,
    /// Everything else: other CPUs, SCADA (03h).
    Basic,
}

impl Resource {
    /// The first byte of a TSAP of two bytes.
    #[must_use]
    pub const fn byte(self) -> u8 {
        match self {
            Self::Pg => 1,
            Self::Op => 2,
            Self::Basic => 3,
        }
    }
}

/// The position of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Rack, 0 to 7.
    pub rack: u8,
    /// Slot, 0 to 31.
    pub slot: u8,
}

/// A transport service access point: 0 to 32 bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tsap(Vec<u8>);

impl Tsap {
    /// Maximum length in bytes.
    pub const MAX: usize = 32;

    /// A TSAP of these bytes; `None` when there are too many.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Option<Self> {
        (bytes.len() <= Self::MAX).then(|| Self(bytes.to_vec()))
    }

    /// The TSAP of a module in a rack, for a kind of connection.
    #[must_use]
    pub fn of(resource: Resource, place: Place) -> Self {
        Self(vec![resource.byte(), (place.rack & 7) << 5 | place.slot & 0x1F])
    }

    /// The bytes as a call has them.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// Rack and slot of a TSAP of two bytes; a text names no place.
    #[must_use]
    pub fn place(&self) -> Option<Place> {
        match *self.0 {
            [_, place] => Some(Place { rack: place >> 5, slot: place & 0x1F }),
            _ => None,
        }
    }

    /// Whether it names a CPU in another network, to which the called one would have to route: the lengths of the
    /// network's ID, of the address and of the place, then these.
    #[must_use]
    pub fn is_routed(&self) -> bool {
        matches!(*self.0, [1, network, _, 2, ..] if network > 0)
    }

    /// The kind of connection. Texts are those of newer programming devices and panels: `SIMATIC-ROOT-ES`,
    /// `SIMATIC-ROOT-HMI`.
    #[must_use]
    pub fn resource(&self) -> Resource {
        match *self.0 {
            [1, _] => Resource::Pg,
            [2, _] => Resource::Op,
            [_, _] => Resource::Basic,
            _ if self.0.ends_with(b"-ES") => Resource::Pg,
            _ if self.0.ends_with(b"-HMI") => Resource::Op,
            _ => Resource::Basic,
        }
    }
}

/// In the usual notation: `01.02`, or the text.
impl std::fmt::Display for Tsap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let text = self.0.len() > 2 && self.0.iter().all(|byte| byte.is_ascii_graphic());
        if text {
            return f.write_str(&String::from_utf8_lossy(&self.0));
        }
        for (index, byte) in self.0.iter().enumerate() {
            write!(f, "{}{byte:02X}", if index == 0 { "" } else { "." })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tsaps_of_known_clients() {
        for (bytes, resource, place, shown) in [
            (&[1, 0x02][..], Resource::Pg, Some((0, 2)), "01.02"),
            (&[2, 0x23], Resource::Op, Some((1, 3)), "02.23"),
            (&[3, 0x00], Resource::Basic, Some((0, 0)), "03.00"),
            (&[0x10, 0x02], Resource::Basic, Some((0, 2)), "10.02"),
            (b"SIMATIC-ROOT-HMI", Resource::Op, None, "SIMATIC-ROOT-HMI"),
            (b"SIMATIC-ROOT-ES", Resource::Pg, None, "SIMATIC-ROOT-ES"),
            (b"", Resource::Basic, None, ""),
        ] {
            let tsap = Tsap::new(bytes).expect("short");
            let at = place.map(|(rack, slot)| Place { rack, slot });
            assert_eq!((tsap.resource(), tsap.place(), tsap.to_string().as_str()), (resource, at, shown));
        }
        // Network 0152-0013, address 3, slot 2; the long form without a network; a text of this length.
        for (from, routed) in [(&[1, 6, 1, 2, 1, 0x52, 0, 0, 0, 0x13, 3][..], true), (&[1, 0, 0, 2], false)] {
            let tsap = [from, &[0; 26][from.len()..], &[1, 2]].concat();
            assert_eq!(Tsap::new(&tsap).expect("short").is_routed(), routed);
        }
        assert!(!Tsap::new(b"SIMATIC-ROOT-HMI").expect("short").is_routed());
        let place = Place { rack: 1, slot: 3 };
        assert_eq!(Tsap::of(Resource::Op, place), Tsap::new(&[2, 0x23]).expect("short"));
        assert_eq!(Tsap::new(&[0; 33]), None);
    }
}
