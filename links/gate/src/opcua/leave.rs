//! Ends sessions whose connection has ended ([`super::front`]).
//!
//! This is a client of the library too. It closes those of anonymous clients, with their subscriptions. One that was
//! never activated can only be closed over the channel it was created on, which is gone, and the library has no other
//! call for it; it only removes, by itself, sessions whose time is over. So such a session changes its content with one
//! whose time is over, and the library removes it. The latter come from here, and last some milliseconds.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use opcua_server::ServerHandle;
use opcua_types::{
    BinaryEncodable, ByteString, CloseSessionRequest, ContextOwned, CreateSessionRequest, MessageInfo,
    MessageSecurityMode, NodeId, OpenSecureChannelRequest, RequestHeader, SecurityTokenRequestType, UAString,
};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};

use crate::opcua::auth::is_anonymous;
use crate::opcua::chunks::{LONGEST, NO_SECURITY, Talk, length};

/// Sessions that are ended together.
const TOGETHER: usize = 256;
/// How long a session lasts that is created here.
const LIFE_MS: f64 = 20.0;
/// Time between two looks whether the library has removed the sessions.
const LOOK: Duration = Duration::from_millis(5);
/// Within this time the library has removed a session whose time is over.
const REMOVED: Duration = Duration::from_secs(1);
/// Time for an answer of the library, and to the next try when there was none.
const PATIENCE: Duration = Duration::from_secs(5);

/// Ends the sessions with these tokens that have no user, as long as there is a front.
pub(crate) async fn see_off(handle: ServerHandle, inner: SocketAddr, url: String, mut ended: mpsc::Receiver<NodeId>) {
    let find = |token: &NodeId| handle.session_manager().read().find_by_token(token);
    // Sessions whose time is over and that the library no longer has, and those that it will remove.
    // (Looked for, because their type has no name; there is none yet.)
    let (mut over, mut soon) = (Vec::from_iter(find(&NodeId::null())), Vec::new());
    let (mut tokens, mut client) = (Vec::new(), None);
    while ended.recv_many(&mut tokens, TOGETHER).await > 0 {
        let mut leaving = Vec::new();
        for token in tokens.drain(..) {
            let Some(session) = find(&token) else { continue };
            let user = session.read().user_token().cloned();
            match user {
                None => leaving.push(session),
                Some(user) if is_anonymous(&user) => {
                    let closed = timeout(PATIENCE, close(&mut client, inner, &url, token)).await;
                    if !matches!(closed, Ok(Ok(()))) {
                        client = None;
                    }
                }
                Some(_) => {}
            }
        }
        while !leaving.is_empty() {
            over.extend(
                soon.extract_if(.., |(_, session)| Arc::strong_count(session) == 1).map(|(_, session)| session),
            );
            // Something else may still hold it.
            soon.retain(|(since, _): &(Instant, _)| since.elapsed() < REMOVED);
            // Its password may have been right in the meantime.
            leaving.retain(|session| session.read().user_token().is_none());
            let mut changed = false;
            while let Some(gone) = leaving.pop_if(|_| !over.is_empty())
                && let Some(other) = over.pop()
            {
                std::mem::swap(&mut *gone.write(), &mut *other.write());
                soon.push((Instant::now(), gone));
                changed = true;
            }
            // The library looks whose time is over when a session is created.
            let missing = leaving.len().saturating_sub(soon.len()).max(usize::from(changed));
            let made = timeout(PATIENCE, create(&mut client, inner, &url, missing)).await;
            match made.unwrap_or(Err(io::ErrorKind::TimedOut.into())) {
                Ok(made) => soon.extend(made.iter().filter_map(find).map(|session| (Instant::now(), session))),
                Err(why) => {
                    client = None;
                    tracing::warn!("sessions without a user last a minute: {why}");
                    sleep(PATIENCE).await;
                    // The library will remove them by itself.
                    leaving.clear();
                }
            }
            if !leaving.is_empty() {
                sleep(LOOK).await;
            }
        }
        over.truncate(TOGETHER);
    }
}

/// A connection to the library, with a channel.
struct Client {
    stream: TcpStream,
    talk: Talk,
    read: Vec<u8>,
    context: ContextOwned,
    /// Number of the last request.
    number: u32,
}

/// Creates sessions that end at once; their tokens.
async fn create(client: &mut Option<Client>, inner: SocketAddr, url: &str, count: usize) -> io::Result<Vec<NodeId>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let client = Client::get(client, inner, url).await?;
    let request = CreateSessionRequest {
        endpoint_url: UAString::from(url),
        session_name: UAString::from("front"),
        requested_session_timeout: LIFE_MS,
        ..CreateSessionRequest::default()
    };
    for _ in 0..count {
        client.send(&request).await?;
        client.answer().await?;
    }
    Ok(std::mem::take(&mut client.talk.sessions))
}

/// Closes an activated session, with its subscriptions; that may be done over any channel.
async fn close(client: &mut Option<Client>, inner: SocketAddr, url: &str, token: NodeId) -> io::Result<()> {
    let client = Client::get(client, inner, url).await?;
    let request_header = RequestHeader { authentication_token: token, ..RequestHeader::default() };
    client.send(&CloseSessionRequest { request_header, delete_subscriptions: true }).await?;
    client.answer().await
}

impl Client {
    /// The client, connected.
    async fn get<'a>(client: &'a mut Option<Self>, inner: SocketAddr, url: &str) -> io::Result<&'a mut Self> {
        match client {
            Some(client) => Ok(client),
            None => Ok(client.insert(Self::open(inner, url).await?)),
        }
    }

    async fn open(inner: SocketAddr, url: &str) -> io::Result<Self> {
        let mut stream = TcpStream::connect(inner).await?;
        stream.set_nodelay(true)?;
        let mut hello = b"HELF".to_vec();
        let size = LONGEST as u32;
        for word in [32 + url.len() as u32, 0, size, size, 0, 0, url.len() as u32] {
            hello.extend(word.to_le_bytes());
        }
        hello.extend(url.as_bytes());
        stream.write_all(&hello).await?;
        let (talk, context) = (Talk::new(true), ContextOwned::default());
        let mut client = Self { stream, talk, read: Vec::new(), context, number: 0 };
        client.answer().await?;
        let request = OpenSecureChannelRequest {
            request_type: SecurityTokenRequestType::Issue,
            security_mode: MessageSecurityMode::None,
            client_nonce: ByteString::null(),
            requested_lifetime: u32::MAX,
            ..OpenSecureChannelRequest::default()
        };
        client.send(&request).await?;
        client.answer().await?;
        Ok(client)
    }

    async fn send<Q: BinaryEncodable + MessageInfo>(&mut self, request: &Q) -> io::Result<()> {
        let context = self.context.context();
        self.number += 1;
        let opening = self.talk.channel == 0;
        let mut chunk = if opening { b"OPNF\0\0\0\0".to_vec() } else { b"MSGF\0\0\0\0".to_vec() };
        chunk.extend(self.talk.channel.to_le_bytes());
        if opening {
            chunk.extend((NO_SECURITY.len() as u32).to_le_bytes());
            chunk.extend(NO_SECURITY);
            chunk.extend([0xFF; 8]);
        } else {
            // The first token of a channel.
            chunk.extend(1_u32.to_le_bytes());
        }
        chunk.extend(self.number.to_le_bytes());
        chunk.extend(self.number.to_le_bytes());
        let encoded = NodeId::from(request.type_id()).encode(&mut chunk, &context);
        encoded.and_then(|()| request.encode(&mut chunk, &context)).map_err(io::Error::other)?;
        let length = (chunk.len() as u32).to_le_bytes();
        chunk.splice(4..8, length);
        self.stream.write_all(&chunk).await
    }

    /// Waits for an answer.
    async fn answer(&mut self) -> io::Result<()> {
        loop {
            let length = length(&self.read).map_err(io::Error::other)?;
            let Some(length) = length.filter(|length| *length <= self.read.len()) else {
                if self.stream.read_buf(&mut self.read).await? == 0 {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
                continue;
            };
            let chunk: Vec<u8> = self.read.drain(..length).collect();
            if chunk.starts_with(b"ERR") {
                return Err(io::ErrorKind::ConnectionAborted.into());
            }
            // There are more sessions than one client may have, and that is no matter here.
            let _ = self.talk.down(&chunk);
            if chunk.get(3) == Some(&b'F') {
                return Ok(());
            }
        }
    }
}
