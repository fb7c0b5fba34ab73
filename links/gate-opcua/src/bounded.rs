//! Structures that the server does not know: one that says it is longer than any message is refused.
//!
//! The length of such a structure is the sender's word, and the library makes room for it before it reads: 2 GB for a
//! message of 100 bytes, which is more than this process may have, and would end it.

use std::io::Read;

use opcua_types::{Context, DynEncodable, EncodingResult, Error, NodeId, TypeLoader, TypeLoaderPriority};

/// Stands before the library's own loader for what is unknown.
pub(crate) struct Bounded;

impl TypeLoader for Bounded {
    fn load_from_binary(
        &self,
        _node_id: &NodeId,
        _stream: &mut dyn Read,
        ctx: &Context<'_>,
        length: Option<usize>,
    ) -> Option<EncodingResult<Box<dyn DynEncodable>>> {
        let most = ctx.options().max_message_size;
        length
            .filter(|length| *length > most)
            .map(|length| Err(Error::decoding(format!("a structure of {length} bytes in a message of at most {most}"))))
    }

    fn priority(&self) -> TypeLoaderPriority {
        TypeLoaderPriority::Dynamic(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use opcua_types::{BinaryDecodable as _, ContextOwned, ExtensionObject};

    #[test]
    fn a_length_that_no_message_has_is_refused_before_there_is_room_for_it() {
        let mut context = ContextOwned::default();
        context.loaders_mut().add_type_loader(Bounded);
        let most = context.options().max_message_size as i32;
        // ns=2;i=9, binary, its length, three bytes.
        let structure = |length: i32| [&[1, 2, 9, 0, 1][..], &length.to_le_bytes(), &[7, 7, 7]].concat();
        let read = |length| ExtensionObject::decode(&mut structure(length).as_slice(), &context.context());
        assert!(read(3).is_ok());
        let why = read(most + 1).expect_err("too long").to_string();
        assert!(why.contains("a structure of"), "{why}");
        assert!(read(i32::MAX).is_err());
    }
}
