use opcua_types::{
    BinaryEncodable, ChannelSecurityToken, CreateSessionRequest, CreateSessionResponse, MessageInfo,
    OpenSecureChannelRequest, OpenSecureChannelResponse, ReadRequest, ServiceFault,
};

use super::*;

const SECURED: &[u8] = b"http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256";
const LIVES: fn(&NodeId) -> bool = |_| true;

fn body<T: BinaryEncodable + MessageInfo>(message: &T) -> Vec<u8> {
    let context = ContextOwned::default();
    let mut body = Vec::new();
    let kind = NodeId::from(message.type_id());
    kind.encode(&mut body, &context.context())
        .and_then(|()| message.encode(&mut body, &context.context()))
        .expect("it");
    body
}

fn chunk(kind: &[u8; 4], rest: &[&[u8]]) -> Vec<u8> {
    let rest = rest.concat();
    [&kind[..], &(rest.len() as u32 + 8).to_le_bytes(), &rest].concat()
}

fn message(last: u8, body: &[u8]) -> Vec<u8> {
    chunk(&[b'M', b'S', b'G', last], &[&[7, 0, 0, 0], &[0; 12], body])
}

fn opens(last: u8, policy: &[u8], body: &[u8]) -> Vec<u8> {
    let certificate = [&3_u32.to_le_bytes()[..], b"abc"].concat();
    let policy = [&(policy.len() as u32).to_le_bytes(), policy].concat();
    chunk(&[b'O', b'P', b'N', last], &[&[7, 0, 0, 0], &policy, &certificate, &[0xFF; 4], &[0; 8], body])
}

fn opened(policy: &[u8], life: u32) -> Vec<u8> {
    let security_token = ChannelSecurityToken { revised_lifetime: life, ..ChannelSecurityToken::default() };
    opens(b'F', policy, &body(&OpenSecureChannelResponse { security_token, ..OpenSecureChannelResponse::default() }))
}

fn asks() -> Vec<u8> {
    body(&CreateSessionRequest::default())
}

fn token(number: u32) -> NodeId {
    NodeId::new(0, opcua_types::ByteString::from(number.to_le_bytes().repeat(8)))
}

fn created(number: u32) -> Vec<u8> {
    let (session_id, authentication_token) = (NodeId::new(1, number), token(number));
    let answer = CreateSessionResponse { session_id, authentication_token, ..CreateSessionResponse::default() };
    message(b'F', &body(&answer))
}

/// A connection with a channel of this policy.
fn connected(open: bool, policy: &[u8]) -> Talk {
    let mut talk = Talk::new(open);
    let asked = body(&OpenSecureChannelRequest::default());
    assert_eq!(talk.up(&opens(b'F', policy, &asked), LIVES), Ok(()));
    assert!(talk.is_held(), "the channel is not known");
    assert_eq!(talk.down(&opened(policy, LIFE_MS)), Ok(()));
    assert!(!talk.is_held());
    assert_eq!((talk.channel, talk.unanswered), (7, 0));
    talk
}

#[test]
fn the_length_of_a_chunk_is_known_after_eight_bytes_and_believed_only_if_there_are_such() {
    let whole = message(b'F', &asks());
    for cut in 0..whole.len() {
        assert_eq!(length(&whole[..cut]), Ok((cut >= 8).then_some(whole.len())), "{cut}");
    }
    for (size, found) in [
        (0, Err(StatusCode::BadTcpMessageTypeInvalid)),
        (7, Err(StatusCode::BadTcpMessageTypeInvalid)),
        (8, Ok(Some(8))),
        (LONGEST as u32, Ok(Some(LONGEST))),
        (LONGEST as u32 + 1, Err(StatusCode::BadTcpMessageTooLarge)),
        (u32::MAX, Err(StatusCode::BadTcpMessageTooLarge)),
    ] {
        assert_eq!(length(&[b"MSGF", &size.to_le_bytes()[..]].concat()), found, "{size}");
    }
}

#[test]
fn a_session_without_security_needs_an_endpoint_without_it() {
    assert_eq!(
        connected(false, NO_SECURITY).up(&message(b'F', &asks()), LIVES),
        Err(StatusCode::BadSecurityPolicyRejected)
    );
    assert_eq!(connected(true, NO_SECURITY).up(&message(b'F', &asks()), LIVES), Ok(()));
    // Over a secured channel nobody can see it; and everything else goes.
    assert_eq!(connected(false, SECURED).up(&message(b'F', &asks()), LIVES), Ok(()));
    assert_eq!(connected(false, NO_SECURITY).up(&message(b'F', &body(&ReadRequest::default())), LIVES), Ok(()));
    // Before there is a channel as well, and when one is opened again without security.
    assert!(Talk::new(false).up(&message(b'F', &asks()), LIVES).is_err());
    let mut talk = connected(false, SECURED);
    assert_eq!(talk.up(&opens(b'F', NO_SECURITY, &[]), LIVES), Ok(()));
    assert!(talk.up(&message(b'F', &asks()), LIVES).is_err());
    // The server says what it is then.
    assert_eq!(talk.down(&opened(SECURED, 0)), Ok(()));
    assert_eq!(talk.up(&message(b'F', &asks()), LIVES), Ok(()));
}

#[test]
fn a_request_is_known_however_it_is_split_and_written() {
    let number = (ObjectId::CreateSessionRequest_Encoding_DefaultBinary as u16).to_le_bytes();
    let rest = &asks()[4..];
    let ways =
        [vec![1, 0, number[0], number[1]], vec![1, 9, number[0], number[1]], vec![2, 0, 0, number[0], number[1], 0, 0]];
    for whole in ways.map(|kind| [&kind[..], rest].concat()) {
        for cut in 0..12 {
            for (first, last) in [(0, cut), (cut, cut), (cut, whole.len() - 1)] {
                let mut talk = connected(false, NO_SECURITY);
                assert_eq!(talk.up(&message(b'C', &whole[..first]), LIVES), Ok(()));
                assert_eq!(talk.up(&message(b'C', &whole[first..last]), LIVES), Ok(()));
                assert!(talk.up(&message(b'F', &whole[last..]), LIVES).is_err(), "{first} {last}");
            }
        }
        // As a chunk that opens or closes a channel.
        assert!(connected(false, NO_SECURITY).up(&opens(b'F', NO_SECURITY, &whole), LIVES).is_err());
        let mut closes = message(b'F', &whole);
        closes[..3].copy_from_slice(b"CLO");
        assert!(connected(false, NO_SECURITY).up(&closes, LIVES).is_err());
    }
    // Broken off, it is none, and no part of the next.
    let mut talk = connected(false, NO_SECURITY);
    assert_eq!(talk.up(&message(b'C', &asks()[..3]), LIVES), Ok(()));
    assert_eq!(talk.up(&message(b'A', &[]), LIVES), Ok(()));
    assert!(talk.up(&message(b'F', &asks()), LIVES).is_err());
}

#[test]
fn a_channel_is_not_opened_within_a_message_nor_in_parts() {
    for policy in [NO_SECURITY, SECURED] {
        let mut talk = connected(true, policy);
        assert_eq!(talk.up(&opens(b'C', NO_SECURITY, &[]), LIVES), Err(StatusCode::BadTcpMessageTypeInvalid));
        let mut talk = connected(true, policy);
        assert_eq!(talk.up(&message(b'C', &[1]), LIVES), Ok(()));
        assert_eq!(talk.up(&opens(b'F', NO_SECURITY, &[]), LIVES), Err(StatusCode::BadTcpMessageTypeInvalid));
    }
}

#[test]
fn a_channel_without_security_lasts_long_enough_for_its_answers() {
    for (policy, life, lasts) in [(NO_SECURITY, LIFE_MS - 1, false), (NO_SECURITY, LIFE_MS, true), (SECURED, 0, true)] {
        assert_eq!(Talk::new(true).down(&opened(policy, life)).is_ok(), lasts, "{life}");
    }
}

#[test]
fn who_asks_for_a_session_is_heard_again_when_it_is_answered() {
    let mut talk = connected(true, NO_SECURITY);
    let other = message(b'F', &body(&ReadRequest::default()));
    let fault = message(b'F', &body(&ServiceFault::default()));
    for (answer, sessions) in [(created(1), 1), (fault, 1), (created(2), 2)] {
        assert_eq!(talk.up(&message(b'F', &asks()), LIVES), Ok(()));
        assert_eq!(talk.down(&other), Ok(()));
        assert!(talk.is_held());
        assert_eq!(talk.down(&answer), Ok(()));
        assert!(!talk.is_held());
        assert_eq!(talk.sessions.len(), sessions);
    }
    assert_eq!(talk.sessions, [token(1), token(2)]);
}

#[test]
fn a_connection_has_four_sessions_that_live() {
    let mut talk = connected(true, NO_SECURITY);
    for number in 1..=SESSIONS as u32 {
        assert_eq!(talk.up(&message(b'F', &asks()), LIVES), Ok(()));
        assert_eq!(talk.down(&created(number)), Ok(()));
    }
    assert_eq!(talk.up(&message(b'F', &asks()), |_| true), Err(StatusCode::BadTooManySessions));
    // The client has closed one.
    assert_eq!(talk.up(&message(b'F', &asks()), |session| *session != token(2)), Ok(()));
    assert_eq!(talk.down(&created(9)), Ok(()));
    assert_eq!(talk.sessions, [1, 3, 4, 9].map(token));
    // One that nobody has seen to be asked for.
    assert_eq!(talk.down(&created(10)), Err(StatusCode::BadTooManySessions));
    assert_eq!(talk.sessions.len(), 5, "it ends with the others");
}

#[test]
fn nothing_that_a_client_sends_is_read_beyond_its_end() {
    let whole = [opens(b'F', NO_SECURITY, &asks()), message(b'F', &asks()), created(1), opened(NO_SECURITY, 0)];
    for whole in whole {
        for cut in 8..whole.len() {
            for value in [0, 1, 0x7F, 0xFF] {
                let mut bytes = whole[..cut].to_vec();
                bytes[cut - 1] = value;
                let mut talk = Talk::new(true);
                let _ = talk.up(&bytes, LIVES);
                let _ = talk.down(&bytes);
            }
        }
    }
    assert_eq!(
        error(StatusCode::BadTooManySessions).len() as u32,
        word(&error(StatusCode::BadTooManySessions), 4).unwrap_or(0)
    );
}
