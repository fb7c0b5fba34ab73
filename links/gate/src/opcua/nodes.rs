//! The nodes of a station as OPC UA names them.

use opcua_types::{Identifier, NodeClass, NodeId};

use crate::opcua::space::Node;

/// The namespace of a station, index 2 of its server.
pub(crate) const NAMESPACE_URI: &str = "urn:ob1:station";

/// Its index: after OPC UA's own and the server's.
pub(crate) const NAMESPACE: u16 = 2;

/// An identifier of namespace 2 as text.
pub(crate) fn text(id: &NodeId) -> Option<&str> {
    match &id.identifier {
        Identifier::String(text) if id.namespace == NAMESPACE => Some(text.as_ref()),
        _ => None,
    }
}

pub(crate) fn node_id(id: &str) -> NodeId {
    NodeId::new(NAMESPACE, id)
}

pub(crate) const fn class(node: &Node) -> NodeClass {
    match node {
        Node::Root | Node::Folder(_) | Node::Block(_) | Node::Composed(_) => NodeClass::Object,
        Node::Method(_) => NodeClass::Method,
        Node::Fact(_) | Node::Value(_) => NodeClass::Variable,
    }
}
