//! Structures in requests: only those that a request to this server can need are decoded, and one that claims to be
//! longer than any message is refused.
//!
//! The sender states the length of a structure, and the library allocates memory for it before it reads: 2 GB for a
//! message of 100 bytes, which is more than this process may have, and would end it. A structure that no request here
//! needs stays a string of bytes: whatever is nested in it costs nothing. A structure in XML is refused; without the
//! library's XML feature its stated length would be trusted.

use std::io::Read;

use opcua_types::xml::XmlStreamReader;
use opcua_types::{
    ByteString, ByteStringBody, Context, DynEncodable, EncodingResult, Error, GeneratedTypeLoader, Identifier, NodeId,
    ObjectId, TypeLoader, TypeLoaderCollection, TypeLoaderPriority,
};

/// Decides before the library's own loader, and uses that for the structures it needs.
struct Bounded;

/// The only loaders for structures of requests.
pub(crate) fn loaders() -> TypeLoaderCollection {
    let mut loaders = TypeLoaderCollection::new_empty();
    loaders.add_type_loader(Bounded);
    loaders
}

/// Structures a request can contain: identity tokens, filters of monitored items, operands of filters of events. What
/// asks for a history is needed for the answer that there is none.
const NEEDED: [ObjectId; 15] = [
    ObjectId::AnonymousIdentityToken_Encoding_DefaultBinary,
    ObjectId::UserNameIdentityToken_Encoding_DefaultBinary,
    ObjectId::X509IdentityToken_Encoding_DefaultBinary,
    ObjectId::IssuedIdentityToken_Encoding_DefaultBinary,
    ObjectId::DataChangeFilter_Encoding_DefaultBinary,
    ObjectId::EventFilter_Encoding_DefaultBinary,
    ObjectId::AggregateFilter_Encoding_DefaultBinary,
    ObjectId::ElementOperand_Encoding_DefaultBinary,
    ObjectId::LiteralOperand_Encoding_DefaultBinary,
    ObjectId::AttributeOperand_Encoding_DefaultBinary,
    ObjectId::SimpleAttributeOperand_Encoding_DefaultBinary,
    ObjectId::ReadRawModifiedDetails_Encoding_DefaultBinary,
    ObjectId::ReadAtTimeDetails_Encoding_DefaultBinary,
    ObjectId::ReadProcessedDetails_Encoding_DefaultBinary,
    ObjectId::ReadEventDetails_Encoding_DefaultBinary,
];

fn needed(id: &NodeId) -> bool {
    let Identifier::Numeric(number) = id.identifier else { return false };
    id.namespace == 0 && NEEDED.iter().any(|needed| *needed as u32 == number)
}

/// The raw bytes of a structure.
fn opaque(id: &NodeId, stream: &mut dyn Read, length: usize) -> EncodingResult<Box<dyn DynEncodable>> {
    let mut bytes = vec![0; length];
    stream.read_exact(&mut bytes)?;
    Ok(Box::new(ByteStringBody::new(ByteString::from(bytes), id.clone())))
}

impl TypeLoader for Bounded {
    fn load_from_binary(
        &self,
        node_id: &NodeId,
        stream: &mut dyn Read,
        ctx: &Context<'_>,
        length: Option<usize>,
    ) -> Option<EncodingResult<Box<dyn DynEncodable>>> {
        let most = ctx.options().max_message_size;
        match length {
            Some(length) if length > most => {
                Some(Err(Error::decoding(format!("a structure of {length} bytes in a message of at most {most}"))))
            }
            Some(length) if !needed(node_id) => Some(opaque(node_id, stream, length)),
            _ => GeneratedTypeLoader.load_from_binary(node_id, stream, ctx, length),
        }
    }

    fn load_from_xml(
        &self,
        node_id: &NodeId,
        _stream: &mut XmlStreamReader<&mut dyn Read>,
        _ctx: &Context<'_>,
        _name: &str,
    ) -> Option<EncodingResult<Box<dyn DynEncodable>>> {
        Some(Err(Error::decoding(format!("a structure {node_id} in XML, which is not accepted here"))))
    }

    fn priority(&self) -> TypeLoaderPriority {
        TypeLoaderPriority::Core
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use opcua_types::{
        AnonymousIdentityToken, BinaryDecodable as _, BinaryEncodable as _, ContextOwned, ExtensionObject,
        ReadRawModifiedDetails, UAString,
    };

    fn read(bytes: &[u8]) -> EncodingResult<ExtensionObject> {
        let mut context = ContextOwned::default();
        *context.loaders_mut() = loaders();
        ExtensionObject::decode(&mut &*bytes, &context.context())
    }

    /// A structure: its type as `i=` of a namespace, how it is encoded (1: binary, 2: XML), its length, its bytes.
    fn structure(namespace: u8, id: u16, encoding: u8, length: i32, bytes: &[u8]) -> Vec<u8> {
        [&[1, namespace], &id.to_le_bytes()[..], &[encoding], &length.to_le_bytes(), bytes].concat()
    }

    #[test]
    fn a_length_that_no_message_has_is_refused_before_there_is_room_for_it() {
        let most = ContextOwned::default().options().max_message_size as i32;
        let known = ObjectId::LiteralOperand_Encoding_DefaultBinary as u16;
        for (namespace, id) in [(2, 9), (0, 9), (0, known)] {
            for length in [most + 1, i32::MAX] {
                let why = read(&structure(namespace, id, 1, length, &[7; 3])).expect_err("too long").to_string();
                assert!(why.contains("a structure of"), "{why}");
                // In XML, with and without the beginning of a tag.
                assert!(read(&structure(namespace, id, 2, length, &[7; 3])).is_err());
                assert!(read(&structure(namespace, id, 2, length, b"<a>")).is_err());
            }
        }
        assert!(read(&structure(2, 9, 1, 3, &[7; 3])).is_ok());
        assert!(read(&structure(2, 9, 1, 4, &[7; 3])).is_err(), "a byte more than there is");
        let why = read(&structure(2, 9, 2, 7, b"<a></a>")).expect_err("XML").to_string();
        assert!(why.contains("in XML"), "{why}");
    }

    #[test]
    fn what_no_request_needs_is_not_looked_into() {
        // A ServiceFault whose diagnostics are nested 300,000 times: the library would recurse into each.
        let nested = [&[0; 8][..], &[0; 4], &[0; 4], &[0x40; 300_000]].concat();
        let fault = ObjectId::ServiceFault_Encoding_DefaultBinary as u16;
        let found = read(&structure(0, fault, 1, nested.len() as i32, &nested)).expect("bytes");
        assert!(found.inner_as::<ByteStringBody>().is_some());
    }

    #[test]
    fn what_a_request_needs_is_decoded() {
        let context = ContextOwned::default();
        let token = AnonymousIdentityToken { policy_id: UAString::from("anonymous") };
        let bytes = ExtensionObject::from_message(token.clone()).encode_to_vec(&context.context());
        assert_eq!(read(&bytes).expect("a token").inner_as::<AnonymousIdentityToken>(), Some(&token));
        let history = ExtensionObject::from_message(ReadRawModifiedDetails::default());
        let bytes = history.encode_to_vec(&context.context());
        assert!(read(&bytes).expect("details").inner_as::<ReadRawModifiedDetails>().is_some());
    }
}
