//! The chunks of a connection, as far as the front ([`super::front`]) must understand them: who opens a channel without
//! security, creates a session over it, and what the server answers. Whole chunks come in; nothing here reads or waits.
//!
//! Chunks from a client may be made to deceive. What the library would take for a request is taken for it here too,
//! however it is split or numbered; what it would not is of no interest.

use opcua_types::{BinaryDecodable as _, Context, ContextOwned, NodeId, ObjectId, ResponseHeader, StatusCode};

/// The longest chunk: that of the library's buffers.
pub(crate) const LONGEST: usize = 65_535;
/// Sessions of a connection without security.
pub(crate) const SESSIONS: usize = 4;
/// Shortest life of a channel without security, in milliseconds. When it ends, answers can be lost.
const LIFE_MS: u32 = 10_000;
/// What is kept of the beginning of a message: enough for the token of a new session.
const KEPT: usize = 160;
pub(crate) const NO_SECURITY: &[u8] = b"http://opcfoundation.org/UA/SecurityPolicy#None";

/// The length of the first chunk; `None` while too little of it is there.
///
/// # Errors
/// No chunk has this length.
pub(crate) fn length(bytes: &[u8]) -> Result<Option<usize>, StatusCode> {
    match bytes.get(4..).and_then(<[u8]>::first_chunk).map(|size| u32::from_le_bytes(*size) as usize) {
        Some(0..8) => Err(StatusCode::BadTcpMessageTypeInvalid),
        Some(size) if size > LONGEST => Err(StatusCode::BadTcpMessageTooLarge),
        size => Ok(size),
    }
}

/// The bytes of an error message; it ends a connection.
pub(crate) fn error(status: StatusCode) -> Vec<u8> {
    let reason = status.to_string();
    let mut bytes = b"ERRF".to_vec();
    for word in [16 + reason.len() as u32, status.bits(), reason.len() as u32] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(reason.as_bytes());
    bytes
}

fn is_final(chunk: &[u8]) -> bool {
    chunk.get(3) == Some(&b'F')
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|word| u32::from_le_bytes(*word))
}

/// The text, certificate or thumbprint at this place, and what follows it.
fn text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = usize::try_from(word(bytes, 0)?.cast_signed().max(0)).ok()?;
    bytes.get(4..)?.split_at_checked(length)
}

/// The security policy that a chunk opening a channel names, and what follows all of its header.
fn opening(chunk: &[u8]) -> Option<(&[u8], &[u8])> {
    let (policy, rest) = text(chunk.get(12..)?)?;
    let (_certificate, rest) = text(rest)?;
    let (_thumbprint, rest) = text(rest)?;
    Some((policy, rest))
}

/// The part of a chunk that belongs to the message, if the chunk is not encrypted.
fn body(chunk: &[u8]) -> Option<&[u8]> {
    match chunk.get(..3)? {
        b"OPN" => opening(chunk)?.1.get(8..),
        b"MSG" | b"CLO" => chunk.get(24..),
        _ => None,
    }
}

/// The type of a message, whatever way its number is written, and what follows.
fn kind(start: &[u8]) -> Option<(u32, &[u8])> {
    match *start {
        [0, number, ref rest @ ..] => Some((number.into(), rest)),
        [1, _, low, high, ref rest @ ..] => Some((u16::from_le_bytes([low, high]).into(), rest)),
        [2, _, _, a, b, c, d, ref rest @ ..] => Some((u32::from_le_bytes([a, b, c, d]), rest)),
        _ => None,
    }
}

/// The token of a new session: after the header of the answer and the session's number.
fn token(mut rest: &[u8], context: &Context<'_>) -> Option<NodeId> {
    ResponseHeader::decode(&mut rest, context).ok()?;
    NodeId::decode(&mut rest, context).ok()?;
    NodeId::decode(&mut rest, context).ok()
}

/// The beginnings of the messages of one direction.
#[derive(Default)]
struct Messages {
    start: Vec<u8>,
    /// The last chunk was not the last of its message.
    partial: bool,
}

impl Messages {
    /// A chunk; returns the beginning of the message that it completes.
    fn next(&mut self, chunk: &[u8]) -> Option<Vec<u8>> {
        self.partial = chunk.get(3) == Some(&b'C');
        if !self.partial && !is_final(chunk) {
            self.start.clear();
            return None;
        }
        let body = body(chunk).unwrap_or_default();
        self.start.extend(body.iter().take(KEPT - self.start.len().min(KEPT)));
        is_final(chunk).then(|| std::mem::take(&mut self.start))
    }
}

/// The request that must be answered before the client is heard again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Held {
    /// Only the answer tells which security the channel has.
    Channel,
    /// The answer has the token of the session. What comes after the request could make the library drop the answer.
    Session,
}

/// A connection of a client, and what it has done.
pub(crate) struct Talk {
    /// Whether sessions may be created without security.
    open: bool,
    /// The channel has no security, or none is open yet.
    clear: bool,
    held: Option<Held>,
    up: Messages,
    down: Messages,
    context: ContextOwned,
    /// The channel's number.
    pub(crate) channel: u32,
    /// Requests without an answer.
    pub(crate) unanswered: i32,
    /// The tokens of the sessions created without security.
    pub(crate) sessions: Vec<NodeId>,
}

impl Talk {
    pub(crate) fn new(open: bool) -> Self {
        Self {
            open,
            clear: true,
            held: None,
            up: Messages::default(),
            down: Messages::default(),
            context: ContextOwned::default(),
            channel: 0,
            unanswered: 0,
            sessions: Vec::new(),
        }
    }

    /// Nothing more of the client may pass until the server has answered.
    pub(crate) fn is_held(&self) -> bool {
        self.held.is_some()
    }

    /// A chunk of the client; `lives` tells whether there still is a session.
    ///
    /// # Errors
    /// It must not pass, and the connection ends.
    pub(crate) fn up(&mut self, chunk: &[u8], lives: impl Fn(&NodeId) -> bool) -> Result<(), StatusCode> {
        self.unanswered += i32::from(is_final(chunk));
        if chunk.starts_with(b"OPN") {
            // Not one of several chunks: its policy would be that of the whole message.
            if self.up.partial || !is_final(chunk) {
                return Err(StatusCode::BadTcpMessageTypeInvalid);
            }
            self.clear |= opening(chunk).is_none_or(|(policy, _)| policy == NO_SECURITY);
            self.held = Some(Held::Channel);
        }
        let start = self.up.next(chunk);
        if !self.clear {
            return Ok(());
        }
        match start.as_deref().and_then(kind) {
            Some((number, _)) if number == ObjectId::CreateSessionRequest_Encoding_DefaultBinary as u32 => {
                self.sessions.retain(lives);
                if !self.open {
                    return Err(StatusCode::BadSecurityPolicyRejected);
                }
                if self.sessions.len() >= SESSIONS {
                    return Err(StatusCode::BadTooManySessions);
                }
                self.held = Some(Held::Session);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// A chunk of the server.
    ///
    /// # Errors
    /// The client has got what it must not have, and the connection ends.
    pub(crate) fn down(&mut self, chunk: &[u8]) -> Result<(), StatusCode> {
        self.unanswered -= i32::from(is_final(chunk));
        let opened = chunk.starts_with(b"OPN");
        if opened {
            self.channel = word(chunk, 8).unwrap_or(0);
            self.clear = opening(chunk).is_none_or(|(policy, _)| policy == NO_SECURITY);
        }
        if self.held == Some(Held::Channel) && (opened || self.unanswered <= 0) {
            self.held = None;
        }
        let Some(start) = self.down.next(chunk).filter(|_| self.clear) else { return Ok(()) };
        let Some((number, rest)) = kind(&start) else { return Ok(()) };
        if number == ObjectId::OpenSecureChannelResponse_Encoding_DefaultBinary as u32 {
            // After the header: version, channel, token, time.
            let life = word(rest, 24 + 4 + 4 + 4 + 8).unwrap_or(0);
            return if life < LIFE_MS { Err(StatusCode::BadSecureChannelTokenUnknown) } else { Ok(()) };
        }
        let fault = number == ObjectId::ServiceFault_Encoding_DefaultBinary as u32;
        let created = number == ObjectId::CreateSessionResponse_Encoding_DefaultBinary as u32;
        if created {
            self.sessions.extend(token(rest, &self.context.context()));
        }
        if (created || fault) && self.held == Some(Held::Session) {
            self.held = None;
        }
        if created && (!self.open || self.sessions.len() > SESSIONS) {
            return Err(StatusCode::BadTooManySessions);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
