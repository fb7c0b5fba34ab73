//! Messages as bytes: whole numbers in network byte order, texts and lists preceded by their length.
//!
//! Received bytes are not trusted: whatever they are, the result is a value or nothing.

/// A value that is sent over the socket.
pub(crate) trait Wire: Sized {
    /// Appends its bytes to `out`.
    fn put(&self, out: &mut Vec<u8>);
    /// Takes it from the front; `None`: the bytes are not such a value.
    fn get(bytes: &mut &[u8]) -> Option<Self>;
}

/// A whole message with nothing after it.
pub(crate) fn decode<T: Wire>(mut bytes: &[u8]) -> Option<T> {
    let value = T::get(&mut bytes)?;
    bytes.is_empty().then_some(value)
}

/// A value as the bytes of a whole message.
pub(crate) fn encode<T: Wire>(value: &T) -> Vec<u8> {
    let mut out = Vec::new();
    value.put(&mut out);
    out
}

macro_rules! numbers {
    ($($ty:ty),*) => {$(
        impl Wire for $ty {
            fn put(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_be_bytes());
            }
            fn get(bytes: &mut &[u8]) -> Option<Self> {
                let (number, rest) = bytes.split_first_chunk()?;
                *bytes = rest;
                Some(Self::from_be_bytes(*number))
            }
        }
    )*};
}

numbers!(u8, u16, u32, u64);

impl Wire for bool {
    fn put(&self, out: &mut Vec<u8>) {
        out.push(u8::from(*self));
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        match u8::get(bytes)? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

/// A length, and that many bytes.
fn block<'a>(bytes: &mut &'a [u8]) -> Option<&'a [u8]> {
    let len = u32::get(bytes)? as usize;
    let (block, rest) = bytes.split_at_checked(len)?;
    *bytes = rest;
    Some(block)
}

fn put_block(block: &[u8], out: &mut Vec<u8>) {
    (block.len() as u32).put(out);
    out.extend_from_slice(block);
}

impl Wire for String {
    fn put(&self, out: &mut Vec<u8>) {
        put_block(self.as_bytes(), out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        Some(std::str::from_utf8(block(bytes)?).ok()?.to_owned())
    }
}

impl Wire for Box<[u8]> {
    fn put(&self, out: &mut Vec<u8>) {
        put_block(self, out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        Some(block(bytes)?.into())
    }
}

impl<T: Wire, const N: usize> Wire for [T; N] {
    fn put(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|item| item.put(out));
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        let items: Option<Vec<T>> = (0..N).map(|_| T::get(bytes)).collect();
        items?.try_into().ok()
    }
}

impl<A: Wire, B: Wire> Wire for (A, B) {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
        self.1.put(out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        Some((A::get(bytes)?, B::get(bytes)?))
    }
}

impl<T: Wire> Wire for Vec<T> {
    fn put(&self, out: &mut Vec<u8>) {
        (self.len() as u32).put(out);
        self.iter().for_each(|item| item.put(out));
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        let len = u32::get(bytes)? as usize;
        // Each element takes at least a byte, so a false length reserves no memory.
        let mut list = Vec::with_capacity(len.min(bytes.len()));
        for _ in 0..len {
            list.push(T::get(bytes)?);
        }
        Some(list)
    }
}

impl<T: Wire> Wire for Option<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.is_some().put(out);
        if let Some(value) = self {
            value.put(out);
        }
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        if bool::get(bytes)? { T::get(bytes).map(Some) } else { Some(None) }
    }
}

impl<T: Wire, E: Wire> Wire for Result<T, E> {
    fn put(&self, out: &mut Vec<u8>) {
        self.is_ok().put(out);
        match self {
            Ok(value) => value.put(out),
            Err(error) => error.put(out),
        }
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        if bool::get(bytes)? { T::get(bytes).map(Ok) } else { E::get(bytes).map(Err) }
    }
}

/// A structure is sent by its fields, an enumeration by the number of the variant.
macro_rules! wire {
    (struct $name:ident { $($field:ident),* $(,)? }) => {
        impl Wire for $name {
            fn put(&self, out: &mut Vec<u8>) {
                $(self.$field.put(out);)*
            }
            fn get(bytes: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: Wire::get(bytes)?),* })
            }
        }
    };
    (enum $name:ident {
        $($tag:literal => $variant:ident $(($($item:ident),*))? $({$($field:ident),*})?),* $(,)?
    }) => {
        impl Wire for $name {
            fn put(&self, out: &mut Vec<u8>) {
                match self {
                    $(Self::$variant $(($($item),*))? $({$($field),*})? => {
                        out.push($tag);
                        $($($item.put(out);)*)?
                        $($($field.put(out);)*)?
                    })*
                }
            }
            fn get(bytes: &mut &[u8]) -> Option<Self> {
                match u8::get(bytes)? {
                    $($tag => {
                        $($(let $item = Wire::get(bytes)?;)*)?
                        $($(let $field = Wire::get(bytes)?;)*)?
                        Some(Self::$variant $(($($item),*))? $({$($field),*})?)
                    })*
                    _ => None,
                }
            }
        }
    };
}

pub(crate) use wire;
