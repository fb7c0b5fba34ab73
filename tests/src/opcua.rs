//! A small OPC UA client over a channel without security: for measurements, and to send invalid data. The messages are
//! those of async-opcua-types; chunks, channel and session are implemented here, so that every byte of them can be
//! damaged.

use std::io::{self, Cursor, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use opcua_types::{
    ActivateSessionRequest, ActivateSessionResponse, AnonymousIdentityToken, ApplicationDescription, AttributeId,
    BinaryDecodable, BinaryEncodable, ByteString, ContextOwned, CreateMonitoredItemsRequest,
    CreateMonitoredItemsResponse, CreateSessionRequest, CreateSessionResponse, CreateSubscriptionRequest,
    CreateSubscriptionResponse, DataChangeNotification, DateTime, DecodingOptions, ExtensionObject, MessageInfo,
    MessageSecurityMode, MonitoredItemCreateRequest, MonitoredItemNotification, MonitoringMode, MonitoringParameters,
    NamespaceMap, NodeId, ObjectId, OpenSecureChannelRequest, OpenSecureChannelResponse, PublishRequest,
    PublishResponse, ReadValueId, RequestHeader, ResponseHeader, SecurityTokenRequestType, ServiceFault, StatusCode,
    SubscriptionAcknowledgement, TimestampsToReturn, UAString,
};

/// An error of the client.
#[derive(Debug, thiserror::Error)]
pub enum OpcUaError {
    /// An error of the connection.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// A status of the server.
    #[error("{0}")]
    Status(StatusCode),
    /// An unexpected message.
    #[error("{0}")]
    Odd(String),
}

type Done<T> = Result<T, OpcUaError>;

/// Maximum size of a message.
const MESSAGE: usize = 64 << 20;
/// Items in one request.
pub const AT_A_TIME: usize = 1000;
const POLICY: &str = "http://opcfoundation.org/UA/SecurityPolicy#None";

/// A connection with a channel, and a session after activation.
pub struct OpcUa {
    stream: TcpStream,
    context: ContextOwned,
    channel: u32,
    token: u32,
    /// Number of the next request, and its sequence number.
    request: u32,
    session: NodeId,
}

/// A received message: request, type, body.
struct Message {
    request: u32,
    kind: NodeId,
    body: Vec<u8>,
}

impl std::fmt::Debug for OpcUa {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OpcUa").field("channel", &self.channel).finish_non_exhaustive()
    }
}

impl OpcUa {
    /// Opens a connection and a channel.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn open(address: SocketAddr, patience: Duration) -> Done<Self> {
        let stream = TcpStream::connect(address)?;
        stream.set_read_timeout(Some(patience))?;
        stream.set_write_timeout(Some(patience))?;
        stream.set_nodelay(true)?;
        let options = DecodingOptions {
            max_message_size: MESSAGE,
            max_array_length: 1 << 20,
            max_byte_string_length: 1 << 20,
            ..DecodingOptions::default()
        };
        let context = ContextOwned::new_default(NamespaceMap::new(), options);
        let mut client = Self { stream, context, channel: 0, token: 0, request: 0, session: NodeId::null() };
        client.stream.write_all(&hello(address))?;
        let (kind, _) = client.chunk()?;
        if &kind != b"ACKF" {
            return Err(OpcUaError::Odd(format!("{} for a HEL", String::from_utf8_lossy(&kind))));
        }
        let opened: OpenSecureChannelResponse = client.call(&OpenSecureChannelRequest {
            request_header: client.header(),
            client_protocol_version: 0,
            request_type: SecurityTokenRequestType::Issue,
            security_mode: MessageSecurityMode::None,
            client_nonce: ByteString::null(),
            requested_lifetime: 3_600_000,
        })?;
        (client.channel, client.token) = (opened.security_token.channel_id, opened.security_token.token_id);
        Ok(client)
    }

    /// Opens them with an anonymous session.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn connect(address: SocketAddr, patience: Duration) -> Done<Self> {
        let mut client = Self::open(address, patience)?;
        let created: CreateSessionResponse = client.call(&client.create_session(address))?;
        client.session = created.authentication_token;
        let _: ActivateSessionResponse = client.call(&client.activate())?;
        Ok(client)
    }

    /// The request to create a session.
    #[must_use]
    pub fn create_session(&self, address: SocketAddr) -> CreateSessionRequest {
        CreateSessionRequest {
            request_header: self.header(),
            client_description: ApplicationDescription {
                application_uri: UAString::from("urn:ob1:tests"),
                ..ApplicationDescription::default()
            },
            endpoint_url: UAString::from(format!("opc.tcp://{address}/")),
            session_name: UAString::from("tests"),
            requested_session_timeout: 60_000.0,
            ..CreateSessionRequest::default()
        }
    }

    /// The request to activate it.
    #[must_use]
    pub fn activate(&self) -> ActivateSessionRequest {
        ActivateSessionRequest {
            request_header: self.header(),
            user_identity_token: ExtensionObject::from_message(AnonymousIdentityToken {
                policy_id: UAString::from("anonymous"),
            }),
            ..ActivateSessionRequest::default()
        }
    }

    /// The header of a request of this session.
    #[must_use]
    pub fn header(&self) -> RequestHeader {
        RequestHeader {
            authentication_token: self.session.clone(),
            timestamp: DateTime::now(),
            request_handle: self.request,
            ..RequestHeader::default()
        }
    }

    /// The type and body of a request, without the header of its chunk.
    ///
    /// # Errors
    /// [`OpcUaError`] if it cannot be encoded.
    pub fn body<Q: BinaryEncodable + MessageInfo>(&self, request: &Q) -> Done<Vec<u8>> {
        let context = self.context.context();
        let mut body = Vec::new();
        let odd = |error: opcua_types::Error| OpcUaError::Odd(error.to_string());
        NodeId::from(request.type_id()).encode(&mut body, &context).map_err(odd)?;
        request.encode(&mut body, &context).map_err(odd)?;
        Ok(body)
    }

    /// A chunk with this body: the whole message.
    pub fn framed(&mut self, opening: bool, body: &[u8]) -> Vec<u8> {
        self.request += 1;
        let mut rest = self.channel.to_le_bytes().to_vec();
        if opening {
            rest.extend((POLICY.len() as u32).to_le_bytes());
            rest.extend(POLICY.as_bytes());
            rest.extend([0xFF; 8]);
        } else {
            rest.extend(self.token.to_le_bytes());
        }
        rest.extend(self.request.to_le_bytes());
        rest.extend(self.request.to_le_bytes());
        rest.extend(body);
        let mut chunk = if opening { b"OPNF".to_vec() } else { b"MSGF".to_vec() };
        chunk.extend((rest.len() as u32 + 8).to_le_bytes());
        chunk.extend(rest);
        chunk
    }

    /// Sends bytes unchanged.
    ///
    /// # Errors
    /// An error of the connection.
    pub fn raw(&mut self, bytes: &[u8]) -> Done<()> {
        Ok(self.stream.write_all(bytes)?)
    }

    /// Sends a request without waiting for the answer; returns its number.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn send<Q: BinaryEncodable + MessageInfo>(&mut self, request: &Q) -> Done<u32> {
        let body = self.body(request)?;
        let opening = request.type_id() == ObjectId::OpenSecureChannelRequest_Encoding_DefaultBinary;
        let chunk = self.framed(opening, &body);
        self.raw(&chunk)?;
        Ok(self.request)
    }

    /// Sends a request and waits for the answer.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn call<Q: BinaryEncodable + MessageInfo, A: BinaryDecodable>(&mut self, request: &Q) -> Done<A> {
        let number = self.send(request)?;
        loop {
            let message = self.message()?;
            if message.request == number {
                return self.answer(&message);
            }
        }
    }

    fn answer<A: BinaryDecodable>(&self, message: &Message) -> Done<A> {
        let context = self.context.context();
        let odd = |error: opcua_types::Error| OpcUaError::Odd(error.to_string());
        let mut body = Cursor::new(&message.body);
        if message.kind == ObjectId::ServiceFault_Encoding_DefaultBinary {
            let fault = ServiceFault::decode(&mut body, &context).map_err(odd)?;
            return Err(OpcUaError::Status(fault.response_header.service_result));
        }
        let header = ResponseHeader::decode(&mut Cursor::new(&message.body), &context).map_err(odd)?;
        if header.service_result.is_bad() {
            return Err(OpcUaError::Status(header.service_result));
        }
        A::decode(&mut body, &context).map_err(odd)
    }

    /// The next message with all its chunks.
    fn message(&mut self) -> Done<Message> {
        let mut all = Vec::new();
        loop {
            let (kind, chunk) = self.chunk()?;
            let opening = kind.starts_with(b"OPN");
            // Channel, then the token or policy and certificates, then sequence and request.
            let skip = if opening { 4 + text_len(&chunk, 4)? + 8 } else { 8 };
            let numbers = chunk.get(skip..skip + 8).ok_or_else(|| OpcUaError::Odd("a short chunk".into()))?;
            let request = u32::from_le_bytes([numbers[4], numbers[5], numbers[6], numbers[7]]);
            all.extend(&chunk[skip + 8..]);
            if all.len() > MESSAGE {
                return Err(OpcUaError::Odd("a message without end".into()));
            }
            match kind[3] {
                b'C' => {}
                b'F' => {
                    let mut body = Cursor::new(&all);
                    let kind = NodeId::decode(&mut body, &self.context.context());
                    let kind = kind.map_err(|error| OpcUaError::Odd(error.to_string()))?;
                    let from = body.position() as usize;
                    return Ok(Message { request, kind, body: all.split_off(from) });
                }
                _ => return Err(OpcUaError::Odd("a message was broken off".into())),
            }
        }
    }

    fn chunk(&mut self) -> Done<([u8; 4], Vec<u8>)> {
        let mut head = [0; 8];
        self.stream.read_exact(&mut head)?;
        let length = u32::from_le_bytes([head[4], head[5], head[6], head[7]]) as usize;
        let length = length.checked_sub(8).filter(|length| *length <= MESSAGE);
        let mut chunk = vec![0; length.ok_or_else(|| OpcUaError::Odd("a chunk without a length".into()))?];
        self.stream.read_exact(&mut chunk)?;
        let kind = [head[0], head[1], head[2], head[3]];
        if &kind == b"ERRF" {
            let code = chunk.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
            return Err(OpcUaError::Status(StatusCode::from(code)));
        }
        Ok((kind, chunk))
    }

    /// Creates a subscription; returns its number.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn subscribe(&mut self, every_ms: f64) -> Done<u32> {
        let created: CreateSubscriptionResponse = self.call(&CreateSubscriptionRequest {
            request_header: self.header(),
            requested_publishing_interval: every_ms,
            requested_lifetime_count: 3000,
            requested_max_keep_alive_count: 10,
            max_notifications_per_publish: 0,
            publishing_enabled: true,
            priority: 0,
        })?;
        Ok(created.subscription_id)
    }

    /// Monitors these values; the handle of each is its index. Returns the number of accepted items, and the status of
    /// the first refused one.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn monitor(&mut self, subscription: u32, ids: &[String], every_ms: f64) -> Done<(usize, Option<StatusCode>)> {
        let (mut taken, mut refused) = (0, None);
        for (part, first) in ids.chunks(AT_A_TIME).zip((0..).step_by(AT_A_TIME)) {
            let item = |(id, handle): (&String, u32)| MonitoredItemCreateRequest {
                item_to_monitor: value_of(id),
                monitoring_mode: MonitoringMode::Reporting,
                requested_parameters: MonitoringParameters {
                    client_handle: handle,
                    sampling_interval: every_ms,
                    queue_size: 10,
                    discard_oldest: true,
                    ..MonitoringParameters::default()
                },
            };
            let answer: CreateMonitoredItemsResponse = self.call(&CreateMonitoredItemsRequest {
                request_header: self.header(),
                subscription_id: subscription,
                timestamps_to_return: TimestampsToReturn::Both,
                items_to_create: Some(part.iter().zip(first..).map(item).collect()),
            })?;
            for result in answer.results.unwrap_or_default() {
                if result.status_code.is_good() {
                    taken += 1;
                } else {
                    refused.get_or_insert(result.status_code);
                }
            }
        }
        Ok((taken, refused))
    }

    /// Sends a publish request; `seen` acknowledges the last notification.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn ask_to_be_told(&mut self, seen: Option<SubscriptionAcknowledgement>) -> Done<()> {
        let header = self.header();
        self.send(&PublishRequest {
            request_header: header,
            subscription_acknowledgements: seen.map(|seen| vec![seen]),
        })
        .map(drop)
    }

    /// The values of the next notification, and its acknowledgement.
    ///
    /// # Errors
    /// [`OpcUaError`].
    pub fn told(&mut self) -> Done<(Vec<MonitoredItemNotification>, SubscriptionAcknowledgement)> {
        let message = self.message()?;
        let answer: PublishResponse = self.answer(&message)?;
        let seen = SubscriptionAcknowledgement {
            subscription_id: answer.subscription_id,
            sequence_number: answer.notification_message.sequence_number,
        };
        let mut values = Vec::new();
        for part in answer.notification_message.notification_data.unwrap_or_default() {
            if let Some(change) = part.into_inner_as::<DataChangeNotification>() {
                values.extend(change.monitored_items.unwrap_or_default());
            }
        }
        Ok((values, seen))
    }
}

/// The value of a node of a station.
#[must_use]
pub fn value_of(id: &str) -> ReadValueId {
    ReadValueId { node_id: NodeId::new(2, id), attribute_id: AttributeId::Value as u32, ..ReadValueId::default() }
}

/// The first message of a connection.
#[must_use]
pub fn hello(address: SocketAddr) -> Vec<u8> {
    let url = format!("opc.tcp://{address}/");
    let mut bytes = b"HELF".to_vec();
    let length = 32 + url.len() as u32;
    for word in [length, 0, 1 << 16, 1 << 16, MESSAGE as u32, 0, url.len() as u32] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(url.as_bytes());
    bytes
}

/// The length of the text at this position including its length field; also for an empty certificate before its
/// thumbprint.
fn text_len(chunk: &[u8], at: usize) -> Done<usize> {
    let length = chunk.get(at..).and_then(|rest| rest.first_chunk::<4>()).map(|bytes| i32::from_le_bytes(*bytes));
    length.map(|length| 4 + length.max(0) as usize).ok_or_else(|| OpcUaError::Odd("a short chunk".into()))
}
