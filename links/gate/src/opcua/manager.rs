//! The services of namespace 2: browse, read, write, call, subscribe, using the space and the station.

use std::sync::Arc;

use crate::shared::{Catalog, Station, Trouble, Who};
use async_trait::async_trait;
use ob1_access::door::{Answer, Ask};
use ob1_access::{Allowed, Piece, Put, Right, Typed};
use opcua_nodes::DefaultTypeTree;
use opcua_server::CreateMonitoredItem;
use opcua_server::diagnostics::NamespaceMetadata;
use opcua_server::node_manager::{
    AddReferenceResult, BrowseNode, BrowsePathItem, ExternalReferenceRequest, MethodCall, MonitoredItemRef,
    MonitoredItemUpdateRef, NodeManager, NodeMetadata, ParsedReadValueId, ReadNode, RequestContext, ServerContext,
    WriteNode, impl_translate_browse_paths_using_browse,
};
use opcua_types::{
    AttributeId, DataValue, ExpandedNodeId, IdType, LocalizedText, MonitoringMode, NodeClass, NodeId, NumericRange,
    ObjectId, ObjectTypeId, QualifiedName, ReferenceDescription, ReferenceTypeId, StatusCode, TimestampsToReturn,
    VariableTypeId,
};
use tokio::sync::Semaphore;

use crate::opcua::attributes::Attributes;
use crate::opcua::auth::Auth;
use crate::opcua::client_places::Seats;
use crate::opcua::limits;
use crate::opcua::monitor::Monitor;
use crate::opcua::nodes::{NAMESPACE, NAMESPACE_URI, class, node_id, text};
use crate::opcua::range::watchable;
use crate::opcua::sample::{attribute_value, bad, in_part, refused, sample, stamped, status};
use crate::opcua::space::{METHODS, Node, ROOT, Sizes, Space};
use crate::opcua::value::{attempt, datum, unfit, weight};

/// See [the module](self).
pub(crate) struct Manager {
    station: Station,
    auth: Arc<Auth>,
    monitor: Arc<Monitor>,
    seats: Arc<Seats>,
    allowed: Allowed,
    sizes: Sizes,
    /// The maximum right of the link.
    ceiling: Right,
    /// Limits concurrent changing requests.
    turns: Semaphore,
}

/// A write to one node: its place in the request, its text for the audit log, and its entries.
struct Write {
    index: usize,
    told: String,
    puts: Vec<Put>,
}

/// The references of a node that did not fit an answer.
struct Rest(Vec<ReferenceDescription>);

impl Manager {
    pub(crate) fn new(
        station: Station,
        auth: Arc<Auth>,
        (monitor, seats): (Arc<Monitor>, Arc<Seats>),
        allowed: Allowed,
        context: &ServerContext,
    ) -> Self {
        let index = context.type_tree.write().namespaces_mut().add_namespace(NAMESPACE_URI);
        debug_assert_eq!(index, NAMESPACE);
        let welcome = station.welcome();
        let sizes = Sizes {
            inputs: welcome.inputs,
            outputs: welcome.outputs,
            memory: welcome.memory,
            timers: welcome.timers,
            counters: welcome.counters,
        };
        let ceiling = station.ceiling();
        Self { station, auth, monitor, seats, allowed, sizes, ceiling, turns: Semaphore::new(limits::CHANGES) }
    }

    fn space<'a>(&'a self, catalog: &'a Catalog) -> Space<'a> {
        Space { names: &catalog.names, sizes: self.sizes, allowed: &self.allowed }
    }

    async fn catalog(&self) -> Result<Arc<Catalog>, StatusCode> {
        self.station.catalog().await.map_err(|trouble| status(&trouble))
    }

    fn right(&self, context: &RequestContext) -> Right {
        self.auth.right(&context.token).min(self.ceiling)
    }

    fn who(&self, context: &RequestContext) -> Who {
        let address = context.session.read().application_description().application_uri.as_ref().to_owned();
        Who { user: self.auth.user(&context.token), address, right: self.right(context) }
    }

    fn metadata(&self, space: &Space<'_>, id: &str, node: &Node) -> NodeMetadata {
        let name = match node {
            Node::Root => self.station.welcome().station.clone(),
            _ => space.browse_name(id, node),
        };
        NodeMetadata {
            node_id: ExpandedNodeId::new(node_id(id)),
            type_definition: type_definition(node).map_or_else(ExpandedNodeId::null, |(id, _)| ExpandedNodeId::new(id)),
            browse_name: QualifiedName::new(NAMESPACE, name.clone()),
            display_name: LocalizedText::new("", &name),
            node_class: class(node),
        }
    }

    /// The references of one of our nodes, in a fixed order.
    fn references(&self, space: &Space<'_>, id: &str, node: &Node) -> Vec<ReferenceDescription> {
        let mut all = Vec::new();
        for child in space.children(id, node) {
            if let Some(found) = space.find(&child) {
                all.push(self.metadata(space, &child, &found).into_ref_desc(true, kind(&found)));
            }
        }
        if let Some((type_id, name)) = type_definition(node) {
            let class =
                if class(node) == NodeClass::Variable { NodeClass::VariableType } else { NodeClass::ObjectType };
            all.push(core_node(type_id, name, class, ReferenceTypeId::HasTypeDefinition, true));
        }
        match space.parent(id, node) {
            Some(parent) => {
                if let Some(found) = space.find(&parent) {
                    all.push(self.metadata(space, &parent, &found).into_ref_desc(false, kind(node)));
                }
            }
            None => {
                let objects = ObjectId::ObjectsFolder.into();
                all.push(core_node(objects, "Objects", NodeClass::Object, ReferenceTypeId::Organizes, false));
            }
        }
        all
    }

    fn browse_one(&self, space: &Space<'_>, type_tree: &DefaultTypeTree, browse: &mut BrowseNode) {
        let waiting = match browse.take_continuation_point::<Rest>() {
            Some(rest) => {
                browse.set_status(StatusCode::Good);
                rest.0
            }
            None if *browse.node_id() == ObjectId::ObjectsFolder => {
                vec![self.metadata(space, ROOT, &Node::Root).into_ref_desc(true, ReferenceTypeId::Organizes)]
            }
            None => {
                let found = text(browse.node_id()).and_then(|id| Some((id.to_owned(), space.find(id)?)));
                let Some((id, node)) = found else {
                    // A manager before this one calls every node good.
                    if browse.node_id().namespace == NAMESPACE {
                        browse.set_status(StatusCode::BadNodeIdUnknown);
                    }
                    return;
                };
                browse.set_status(StatusCode::Good);
                self.references(space, &id, &node)
            }
        };
        let mut waiting = waiting.into_iter();
        while let Some(reference) = waiting.next() {
            let wanted = if reference.is_forward { browse.allows_forward() } else { browse.allows_inverse() };
            if !wanted {
                continue;
            }
            if let AddReferenceResult::Full(reference) = browse.add(type_tree, reference) {
                let rest = std::iter::once(reference).chain(waiting).collect();
                browse.set_next_continuation_point(Box::new(Rest(rest)));
                return;
            }
        }
    }

    /// The attributes of a node, except its value; `None` for a node that is not ours.
    fn attributes<'a>(&self, space: &'a Space<'a>, id: &'a str, node: &'a Node, right: Right) -> Attributes<'a> {
        let writable = match node {
            Node::Value(typed) => space.writable(typed) && self.ceiling >= Right::Write,
            _ => false,
        };
        let name = match node {
            Node::Root => self.station.welcome().station.clone(),
            _ => space.browse_name(id, node),
        };
        Attributes { id, node, name, description: space.description(node), writable, right }
    }

    /// Values of these places, as far as possible of one scan.
    async fn values(&self, places: &[&Typed]) -> Vec<DataValue> {
        let pieces: Vec<Piece> = places.iter().filter_map(|typed| typed.piece()).collect();
        debug_assert_eq!(pieces.len(), places.len(), "only nodes with a value come here");
        match self.station.read(pieces.clone()).await {
            Ok(reading) => {
                self.monitor.seen(&reading);
                places.iter().enumerate().map(|(index, typed)| sample(typed, reading.piece(index))).collect()
            }
            // Too much for one scan: piece by piece, and each is still whole.
            Err(Trouble::TooMuch) if places.len() > 1 => {
                let mut values = Vec::with_capacity(places.len());
                for (typed, piece) in places.iter().zip(pieces) {
                    values.push(match self.station.read(vec![piece]).await {
                        Ok(reading) => sample(typed, reading.piece(0)),
                        Err(trouble) => bad(status(&trouble)),
                    });
                }
                values
            }
            Err(trouble) => places.iter().map(|_| bad(status(&trouble))).collect(),
        }
    }

    /// Writes values of different nodes: all in one scan where they fit one group and none is refused.
    async fn write_all(&self, who: Who, wanted: Vec<Write>) -> Vec<(usize, StatusCode)> {
        let _turn = self.turns.acquire().await;
        let client = self.station.client(who);
        let mut results = Vec::with_capacity(wanted.len());
        let mut rest = wanted.into_iter().peekable();
        while let Some(first) = rest.next() {
            let mut group = vec![first];
            let (mut entries, mut bytes) = size(&group[0].puts);
            while let Some(next) = rest.peek() {
                let (more, longer) = size(&next.puts);
                if entries + more > ob1_model::GROUP_ENTRIES || bytes + longer > ob1_model::WRITE_BYTES {
                    break;
                }
                (entries, bytes) = (entries + more, bytes + longer);
                group.extend(rest.next());
            }
            let puts = group.iter().flat_map(|write| write.puts.clone()).collect();
            let told: Vec<&str> = group.iter().map(|write| write.told.as_str()).collect();
            match client.write(&told.join(", "), puts).await {
                Ok(_) => results.extend(group.iter().map(|write| (write.index, StatusCode::Good))),
                Err(trouble) if group.len() == 1 => results.push((group[0].index, status(&trouble))),
                // One of them was refused, and therefore all: write each separately, so that the others are written.
                Err(_) => {
                    for Write { index, told, puts } in group {
                        let outcome = client.write(&told, puts).await;
                        results.push((index, outcome.map_or_else(|trouble| status(&trouble), |_| StatusCode::Good)));
                    }
                }
            }
        }
        results
    }
}

fn size(puts: &[Put]) -> (usize, usize) {
    (puts.len(), puts.iter().map(Put::bytes).sum())
}

/// How a parent refers to a node.
fn kind(node: &Node) -> ReferenceTypeId {
    match node {
        Node::Root | Node::Folder(_) => ReferenceTypeId::Organizes,
        _ => ReferenceTypeId::HasComponent,
    }
}

fn type_definition(node: &Node) -> Option<(NodeId, &'static str)> {
    Some(match node {
        Node::Folder(_) => (ObjectTypeId::FolderType.into(), "FolderType"),
        Node::Root | Node::Block(_) | Node::Composed(_) => (ObjectTypeId::BaseObjectType.into(), "BaseObjectType"),
        Node::Fact(_) | Node::Value(_) => (VariableTypeId::BaseDataVariableType.into(), "BaseDataVariableType"),
        Node::Method(_) => return None,
    })
}

fn core_node(
    id: NodeId,
    name: &str,
    node_class: NodeClass,
    reference: ReferenceTypeId,
    is_forward: bool,
) -> ReferenceDescription {
    ReferenceDescription {
        reference_type_id: reference.into(),
        is_forward,
        node_id: ExpandedNodeId::new(id),
        browse_name: QualifiedName::new(0, name),
        display_name: LocalizedText::new("", name),
        node_class,
        type_definition: ExpandedNodeId::null(),
    }
}

#[expect(elided_lifetimes_in_paths, reason = "a lifetime that is written down is another than that of the trait")]
#[async_trait]
impl NodeManager for Manager {
    fn owns_node(&self, id: &NodeId) -> bool {
        id.namespace == NAMESPACE
    }

    fn name(&self) -> &'static str {
        "station"
    }

    /// The library asks when a session is activated, before it answers.
    fn namespaces_for_user(&self, context: &RequestContext) -> Vec<NamespaceMetadata> {
        self.seats.activated(context);
        vec![NamespaceMetadata {
            namespace_uri: NAMESPACE_URI.to_owned(),
            is_namespace_subset: Some(false),
            static_node_id_types: Some(vec![IdType::String]),
            namespace_index: NAMESPACE,
            ..NamespaceMetadata::default()
        }]
    }

    async fn init(&self, _type_tree: &mut DefaultTypeTree, context: ServerContext) {
        self.monitor.start(&self.station, &context.subscriptions);
    }

    async fn resolve_external_references(
        &self,
        _context: &RequestContext,
        items: &mut [&mut ExternalReferenceRequest],
    ) {
        let Ok(catalog) = self.catalog().await else { return };
        let space = self.space(&catalog);
        for item in items {
            let Some(id) = text(item.node_id()).map(str::to_owned) else { continue };
            if let Some(node) = space.find(&id) {
                let metadata = self.metadata(&space, &id, &node);
                item.set(metadata);
            }
        }
    }

    async fn browse(&self, context: &RequestContext, nodes: &mut [BrowseNode]) -> Result<(), StatusCode> {
        self.seats.sit(context)?;
        let catalog = self.catalog().await?;
        let space = self.space(&catalog);
        let type_tree = context.type_tree.read();
        for node in nodes {
            self.browse_one(&space, &type_tree, node);
        }
        Ok(())
    }

    async fn translate_browse_paths_to_node_ids(
        &self,
        context: &RequestContext,
        nodes: &mut [&mut BrowsePathItem],
    ) -> Result<(), StatusCode> {
        // One at a time: where several paths meet, the library follows only one of them.
        for node in nodes.iter_mut() {
            impl_translate_browse_paths_using_browse(self, context, std::slice::from_mut(node)).await?;
        }
        Ok(())
    }

    async fn read(
        &self,
        context: &RequestContext,
        _max_age: f64,
        timestamps: TimestampsToReturn,
        nodes: &mut [&mut ReadNode],
    ) -> Result<(), StatusCode> {
        self.seats.sit(context)?;
        let catalog = self.catalog().await?;
        let wanted: Vec<(usize, ParsedReadValueId)> =
            nodes.iter().enumerate().map(|(index, node)| (index, node.node().clone())).collect();
        for (index, value) in self.read_parsed(&catalog, self.right(context), wanted).await {
            nodes[index].set_result(stamped(value, timestamps));
        }
        Ok(())
    }

    async fn write(&self, context: &RequestContext, nodes: &mut [&mut WriteNode]) -> Result<(), StatusCode> {
        self.seats.sit(context)?;
        let catalog = self.catalog().await?;
        let space = self.space(&catalog);
        let right = self.right(context);
        let mut wanted = Vec::new();
        let mut refused = Vec::new();
        for (index, node) in nodes.iter_mut().enumerate() {
            match self.prepare(&space, node, right) {
                Ok((told, puts)) => wanted.push(Write { index, told, puts }),
                Err(status) => {
                    if right < Right::Write {
                        refused.push(attempt(text(&node.value().node_id), node.value().value.value.as_ref()));
                    }
                    node.set_status(status);
                }
            }
        }
        if !refused.is_empty() {
            self.station.refused(&self.who(context), &format!("write {}", refused.join(", ")));
        }
        if wanted.is_empty() {
            return Ok(());
        }
        for (index, status) in self.write_all(self.who(context), wanted).await {
            nodes[index].set_status(status);
        }
        Ok(())
    }

    async fn call(&self, context: &RequestContext, calls: &mut [&mut MethodCall]) -> Result<(), StatusCode> {
        self.seats.sit(context)?;
        for call in calls {
            let row = text(call.method_id()).and_then(|id| METHODS.iter().position(|(name, ..)| *name == id));
            let Some((_, command, _)) = row.and_then(|row| METHODS.get(row)) else {
                call.set_status(StatusCode::BadMethodInvalid);
                continue;
            };
            let status = if text(call.object_id()) != Some(ROOT) {
                StatusCode::BadNodeIdInvalid
            } else if !call.arguments().is_empty() {
                StatusCode::BadTooManyArguments
            } else if self.right(context) < Right::Operate {
                self.station.refused(&self.who(context), &format!("command {}", command.name()));
                StatusCode::BadUserAccessDenied
            } else {
                let _turn = self.turns.acquire().await;
                let client = self.station.client(self.who(context));
                match client.ask(Ask::Command(*command)).await {
                    Ok(Answer::Done) => StatusCode::Good,
                    Ok(Answer::Refused(refusal)) => refused(refusal),
                    Ok(_) => StatusCode::BadInternalError,
                    Err(trouble) => status(&trouble),
                }
            };
            call.set_status(status);
        }
        Ok(())
    }

    async fn create_monitored_items(
        &self,
        context: &RequestContext,
        items: &mut [&mut CreateMonitoredItem],
    ) -> Result<(), StatusCode> {
        self.seats.sit(context)?;
        let catalog = self.catalog().await?;
        let space = self.space(&catalog);
        let mut reads = Vec::new();
        let mut added = Vec::new();
        for (index, item) in items.iter_mut().enumerate() {
            let wanted = item.item_to_monitor();
            let node = text(&wanted.node_id).and_then(|id| Some((id.to_owned(), space.find(id)?)));
            let status = match (&node, wanted.attribute_id) {
                (None, _) => StatusCode::BadNodeIdUnknown,
                (Some((_, Node::Root)), AttributeId::EventNotifier) => StatusCode::Good,
                (Some(_), AttributeId::EventNotifier) => StatusCode::BadAttributeIdInvalid,
                (Some((id, Node::Value(typed))), AttributeId::Value) => {
                    let part = watchable(&typed.ty, &wanted.index_range);
                    if part.is_good() {
                        added.push((index, id.clone(), item.handle()));
                        self.monitor.add(id, typed, item, context.session_id())
                    } else {
                        part
                    }
                }
                (Some((id, Node::Fact(_))), AttributeId::Value) => {
                    self.monitor.add_fact(id, item, context.session_id())
                }
                (Some(_), _) => StatusCode::Good,
            };
            let mut wanted = item.item_to_monitor().clone();
            // The server itself cuts out the requested part of an array, also for the first value.
            wanted.index_range = NumericRange::None;
            if status.is_good() && wanted.attribute_id != AttributeId::EventNotifier {
                reads.push((index, wanted));
            }
            item.set_status(status);
        }
        // More than a link may watch: none of the new items is accepted, and the old ones continue.
        if !added.is_empty() && !self.monitor.fits() {
            for (index, id, handle) in added {
                self.monitor.remove(&id, handle);
                items[index].set_status(StatusCode::BadTooManyMonitoredItems);
            }
            reads.retain(|(index, _)| items[*index].status_code().is_good());
        }
        for (index, value) in self.read_parsed(&catalog, self.right(context), reads).await {
            // An item for an attribute that the node does not have is refused; a value that is bad now may become good.
            match value.status() {
                StatusCode::BadAttributeIdInvalid => items[index].set_status(StatusCode::BadAttributeIdInvalid),
                _ => items[index].set_initial_value(value),
            }
        }
        Ok(())
    }

    async fn modify_monitored_items(&self, _context: &RequestContext, items: &[&MonitoredItemUpdateRef]) {
        for item in items {
            if let Some(id) = text(item.node_id()) {
                self.monitor.interval(id, item.handle(), item.update().revised_sampling_interval);
            }
        }
    }

    async fn set_monitoring_mode(&self, _context: &RequestContext, mode: MonitoringMode, items: &[&MonitoredItemRef]) {
        for item in items {
            if let Some(id) = text(item.node_id()) {
                self.monitor.mode(id, item.handle(), mode);
            }
        }
    }

    async fn delete_monitored_items(&self, _context: &RequestContext, items: &[&MonitoredItemRef]) {
        for item in items {
            if let Some(id) = text(item.node_id()) {
                self.monitor.remove(id, item.handle());
            }
        }
    }
}

impl Manager {
    async fn read_parsed(
        &self,
        catalog: &Catalog,
        right: Right,
        wanted: Vec<(usize, ParsedReadValueId)>,
    ) -> Vec<(usize, DataValue)> {
        let space = self.space(catalog);
        let mut results = Vec::with_capacity(wanted.len());
        let mut places = Vec::new();
        let is_fact = |wanted: &ParsedReadValueId| {
            text(&wanted.node_id).is_some_and(|id| matches!(space.find(id), Some(Node::Fact(_))))
        };
        if let Some(piece) = self.monitor.heartbeat()
            && wanted.iter().any(|(_, wanted)| is_fact(wanted))
            && let Ok(reading) = self.station.read(vec![piece]).await
        {
            self.monitor.seen(&reading);
        }
        let mut room = limits::ANSWER;
        for (index, wanted) in wanted {
            let found = text(&wanted.node_id).and_then(|id| Some((id, space.find(id)?)));
            let Some((id, node)) = found else {
                results.push((index, bad(StatusCode::BadNodeIdUnknown)));
                continue;
            };
            match (wanted.attribute_id, &node) {
                (AttributeId::Value, Node::Value(typed)) => match room.checked_sub(weight(&typed.ty)) {
                    Some(rest) => {
                        room = rest;
                        places.push((index, typed.clone(), wanted.index_range));
                    }
                    None => results.push((index, bad(StatusCode::BadEncodingLimitsExceeded))),
                },
                (AttributeId::Value, Node::Fact(fact)) => {
                    results.push((index, in_part(DataValue::new_now(self.monitor.fact(*fact)), &wanted.index_range)));
                }
                (attribute, node) => {
                    let value = self.attributes(&space, id, node, right).read(attribute);
                    let value = value.map_or_else(bad, attribute_value);
                    results.push((index, in_part(value, &wanted.index_range)));
                }
            }
        }
        if !places.is_empty() {
            let typed: Vec<&Typed> = places.iter().map(|(_, typed, _)| typed).collect();
            let values = self.values(&typed).await;
            let parts = places.into_iter().zip(values);
            results.extend(parts.map(|((index, _, range), value)| (index, in_part(value, &range))));
        }
        results
    }

    /// Prepares a write, if it is allowed.
    fn prepare(&self, space: &Space<'_>, node: &WriteNode, right: Right) -> Result<(String, Vec<Put>), StatusCode> {
        let wanted = node.value();
        let id = text(&wanted.node_id).ok_or(StatusCode::BadNodeIdUnknown)?;
        let found = space.find(id).ok_or(StatusCode::BadNodeIdUnknown)?;
        let (Node::Value(typed), AttributeId::Value) = (found, wanted.attribute_id) else {
            return Err(StatusCode::BadNotWritable);
        };
        if !space.writable(&typed) || self.ceiling < Right::Write {
            return Err(StatusCode::BadNotWritable);
        }
        if right < Right::Write {
            return Err(StatusCode::BadUserAccessDenied);
        }
        // Writing a part of an array would need a read first, in another scan: its elements are separate nodes.
        if wanted.index_range.has_range() || wanted.value.status.is_some_and(|status| !status.is_good()) {
            return Err(StatusCode::BadWriteNotSupported);
        }
        let value = wanted.value.value.as_ref().ok_or(StatusCode::BadTypeMismatch)?;
        let value = datum(value, &typed)?;
        let puts = typed.puts(&value).map_err(unfit)?;
        Ok((format!("{id} = {value}"), puts))
    }
}
