//! The attributes of a node, except the value of a cell.

use ob1_access::Right;
use opcua_types::{AttributeId, LocalizedText, NodeClass, NodeId, QualifiedName, StatusCode, Variant};

use crate::opcua::nodes::{NAMESPACE, class, node_id};
use crate::opcua::space::{Fact, Node};
use crate::opcua::value::{Shape, type_node};

/// Bits of AccessLevel [OPC 10000-3, 8.57].
const CAN_READ: u8 = 1;
const CAN_WRITE: u8 = 2;
/// Bit of EventNotifier [OPC 10000-3, 8.59].
const SUBSCRIBE_TO_EVENTS: u8 = 1;

/// A node, and the right of the reader.
pub(crate) struct Attributes<'a> {
    pub(crate) id: &'a str,
    pub(crate) node: &'a Node,
    pub(crate) name: String,
    pub(crate) description: String,
    /// Whether the link and the program allow writing the value.
    pub(crate) writable: bool,
    /// The user's right.
    pub(crate) right: Right,
}

impl Attributes<'_> {
    /// One of them.
    pub(crate) fn read(&self, attribute: AttributeId) -> Result<Variant, StatusCode> {
        let class = class(self.node);
        Ok(match attribute {
            AttributeId::NodeId => Variant::from(node_id(self.id)),
            AttributeId::NodeClass => Variant::Int32(class as i32),
            AttributeId::BrowseName => Variant::from(QualifiedName::new(NAMESPACE, self.name.clone())),
            AttributeId::DisplayName => Variant::from(LocalizedText::new("", &self.name)),
            AttributeId::Description => Variant::from(LocalizedText::new("", &self.description)),
            AttributeId::WriteMask | AttributeId::UserWriteMask => Variant::UInt32(0),
            AttributeId::EventNotifier if class == NodeClass::Object => {
                Variant::Byte(if *self.node == Node::Root { SUBSCRIBE_TO_EVENTS } else { 0 })
            }
            AttributeId::Executable if class == NodeClass::Method => Variant::Boolean(true),
            AttributeId::UserExecutable if class == NodeClass::Method => Variant::Boolean(self.right >= Right::Operate),
            _ if class == NodeClass::Variable => return self.variable(attribute),
            _ => return Err(StatusCode::BadAttributeIdInvalid),
        })
    }

    fn variable(&self, attribute: AttributeId) -> Result<Variant, StatusCode> {
        let (data_type, rank, dimensions): (NodeId, i32, Vec<u32>) = match self.node {
            Node::Value(typed) => {
                let shape = Shape::of(&typed.ty).ok_or(StatusCode::BadAttributeIdInvalid)?;
                (type_node(&shape), shape.rank(), shape.dimensions)
            }
            Node::Fact(Fact::State) => (opcua_types::DataTypeId::String.into(), -1, Vec::new()),
            _ => (opcua_types::DataTypeId::UInt64.into(), -1, Vec::new()),
        };
        let level = |writable| if writable { CAN_READ | CAN_WRITE } else { CAN_READ };
        Ok(match attribute {
            AttributeId::DataType => Variant::from(data_type),
            AttributeId::ValueRank => Variant::Int32(rank),
            AttributeId::ArrayDimensions if dimensions.is_empty() => Variant::Empty,
            AttributeId::ArrayDimensions => Variant::from(dimensions),
            AttributeId::AccessLevel => Variant::Byte(level(self.writable)),
            AttributeId::UserAccessLevel => Variant::Byte(level(self.writable && self.right >= Right::Write)),
            AttributeId::AccessLevelEx => Variant::UInt32(u32::from(level(self.writable))),
            AttributeId::MinimumSamplingInterval => Variant::Double(crate::opcua::limits::SAMPLING_MS),
            AttributeId::Historizing => Variant::Boolean(false),
            _ => return Err(StatusCode::BadAttributeIdInvalid),
        })
    }
}
