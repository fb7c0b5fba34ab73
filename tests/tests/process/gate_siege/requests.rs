//! Requests of OPC UA for the sieges: some whose bytes claim too much, and one of each service that matters.

use std::net::SocketAddr;

use ob1_tests::opcua::{OpcUa, value_of};
use opcua_types::{
    BrowseDescription, BrowseRequest, CallMethodRequest, CallRequest, CreateMonitoredItemsRequest,
    CreateSubscriptionRequest, DataValue, DeleteSubscriptionsRequest, MonitoredItemCreateRequest, NodeId,
    PublishRequest, ReadRequest, TimestampsToReturn, TransferSubscriptionsRequest, Variant, WriteRequest, WriteValue,
};

/// Each claim with its name, its body, and whether it is sent to open a channel.
pub(super) fn claims(client: &OpcUa) -> Vec<(String, Vec<u8>, bool)> {
    // A write request that ends with a value: the name of the claim, and the encoded value.
    let write = |what: &str, value: &[u8]| {
        let nodes = vec![WriteValue {
            node_id: NodeId::new(2, "DB10.ramp"),
            attribute_id: 13,
            value: DataValue::value_only(Variant::Boolean(true)),
            ..WriteValue::default()
        }];
        let write = WriteRequest { request_header: client.header(), nodes_to_write: Some(nodes) };
        let mut body = client.body(&write).expect("a request");
        // Replaces the Boolean: its type and its value.
        body.truncate(body.len() - 2);
        body.extend(value);
        (format!("write: {what}"), body, false)
    };
    // A request with a structure as additional header.
    let header = |what: &str, structure: &[u8], opening: bool| {
        let request = ReadRequest { request_header: client.header(), ..ReadRequest::default() };
        let mut body = client.body(&request).expect("a request");
        // After the header: max age, timestamps, no nodes; the header ends without a structure.
        body.truncate(body.len() - 8 - 4 - 4 - 3);
        if opening {
            // The type of OpenSecureChannelRequest instead of ReadRequest.
            body[2..4].copy_from_slice(&446_u16.to_le_bytes());
        }
        body.extend(structure);
        (format!("header{}: {what}", if opening { " of a channel" } else { "" }), body, opening)
    };
    let structure = |id: u16, encoding: u8, length: i32, bytes: &[u8]| {
        [&[1, 0], &id.to_le_bytes()[..], &[encoding], &length.to_le_bytes(), bytes].concat()
    };
    let two_gb = i32::MAX;
    let long = two_gb.to_le_bytes();
    let fault = [&[0; 16][..], &[0x40; 60_000]].concat();
    let mut all = Vec::new();
    for opening in [false, true] {
        all.push(header("2 GB in XML", &structure(9, 2, two_gb, b"<a>"), opening));
        all.push(header("2 GB of a type nobody knows", &structure(9, 1, two_gb, &[7; 3]), opening));
        all.push(header("2 GB of a type that is known", &structure(597, 1, two_gb, &[7; 3]), opening));
        all.push(header("a fault nested 60,000 times", &structure(397, 1, fault.len() as i32, &fault), opening));
    }
    all.push(write("2 GB in XML", &[&[22][..], &structure(9, 2, two_gb, b"<a>")].concat()));
    all.push(write("2 GB of bytes", &[&[15][..], &long, &[7; 3]].concat()));
    all.push(write("2 GB of text", &[&[12][..], &long, b"abc"].concat()));
    all.push(write("2 GB of an XML element", &[&[16][..], &long, b"<a>"].concat()));
    for kind in [1_u8, 3, 12, 15, 17, 22, 23, 24, 25] {
        all.push(write(&format!("an array of 2 G of type {kind}"), &[&[0x80 | kind][..], &long, &[0; 8]].concat()));
    }
    // Sixteen elements with dimensions of 2^32 + 16, and with a dimension of 0.
    let dimensions = |dims: &[u32]| {
        let dims: Vec<u8> = dims.iter().flat_map(|dim| dim.to_le_bytes()).collect();
        [&[0xC3][..], &16_i32.to_le_bytes(), &[7; 16], &(dims.len() as i32 / 4).to_le_bytes(), &dims].concat()
    };
    all.push(write("dimensions that overflow", &dimensions(&[65_536, 65_536, 16])));
    all.push(write("dimensions of nothing", &dimensions(&[0, 16])));
    all.push(write("2 G dimensions", &[&[0xC3][..], &16_i32.to_le_bytes(), &[7; 16], &long].concat()));
    // Nested arrays, each with the maximum length.
    let nested: Vec<u8> = (0..90).flat_map(|_| [&[0x98][..], &65_536_i32.to_le_bytes()].concat()).collect();
    all.push(write("arrays in arrays", &nested));
    // Ten thousand arrays side by side, each with room for the longest.
    let beside: Vec<u8> = (0..10_000).flat_map(|_| [&[0x98][..], &1_i32.to_le_bytes(), &[0]].concat()).collect();
    all.push(write("arrays beside arrays", &[&[0x98][..], &10_000_i32.to_le_bytes(), &beside].concat()));
    all.push(write("values in values", &[0x17, 1].repeat(30_000)));
    all.push(write("diagnostics in diagnostics", &[&[0x19][..], &[0x40; 60_000]].concat()));
    all
}

/// One body for each service that could change something or is expensive.
pub(super) fn seeds(client: &OpcUa, address: SocketAddr) -> Vec<Vec<u8>> {
    let header = || client.header();
    let write = |id: &str, value: Variant| WriteRequest {
        request_header: header(),
        nodes_to_write: Some(vec![WriteValue {
            node_id: NodeId::new(2, id),
            attribute_id: 13,
            value: DataValue::value_only(value),
            ..WriteValue::default()
        }]),
    };
    let call = CallRequest {
        request_header: header(),
        methods_to_call: Some(vec![CallMethodRequest {
            object_id: NodeId::new(2, "/"),
            method_id: NodeId::new(2, "/Stop"),
            input_arguments: None,
        }]),
    };
    let browse = BrowseRequest {
        request_header: header(),
        nodes_to_browse: Some(vec![BrowseDescription {
            node_id: NodeId::new(2, "DB10"),
            result_mask: 63,
            ..BrowseDescription::default()
        }]),
        ..BrowseRequest::default()
    };
    let read = ReadRequest {
        request_header: header(),
        nodes_to_read: Some(["MW20", "DB10.text", "DB10.ramp[2]", "/State"].map(value_of).into()),
        ..ReadRequest::default()
    };
    let subscribe = CreateSubscriptionRequest {
        request_header: header(),
        requested_publishing_interval: 100.0,
        requested_lifetime_count: 10,
        requested_max_keep_alive_count: 3,
        publishing_enabled: true,
        ..CreateSubscriptionRequest::default()
    };
    let monitor = CreateMonitoredItemsRequest {
        request_header: header(),
        subscription_id: 1,
        timestamps_to_return: TimestampsToReturn::Both,
        items_to_create: Some(vec![MonitoredItemCreateRequest {
            item_to_monitor: value_of("MW20"),
            ..MonitoredItemCreateRequest::default()
        }]),
    };
    let transfer = TransferSubscriptionsRequest {
        request_header: header(),
        subscription_ids: Some(vec![1, 2, 3]),
        send_initial_values: true,
    };
    let delete = DeleteSubscriptionsRequest { request_header: header(), subscription_ids: Some(vec![1]) };
    let publish = PublishRequest { request_header: header(), subscription_acknowledgements: None };
    [
        client.body(&write("MW20", Variant::UInt16(1))),
        client.body(&write("DB10.text", Variant::from("changed"))),
        client.body(&write("DB10.ramp", Variant::from(vec![9i16, 9, 9]))),
        client.body(&call),
        client.body(&browse),
        client.body(&read),
        client.body(&subscribe),
        client.body(&monitor),
        client.body(&transfer),
        client.body(&delete),
        client.body(&publish),
        client.body(&client.create_session(address)),
        client.body(&client.activate()),
    ]
    .into_iter()
    .map(|body| body.expect("a request"))
    .collect()
}
