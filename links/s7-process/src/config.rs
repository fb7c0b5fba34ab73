//! The keys of the station file's `[[link]]` table that the process needs.

use std::net::SocketAddr;
use std::time::Duration;

use ob1_access::Right;
use ob1_access::door::Welcome;
use ob1_s7::Rights;
use ob1_s7::coupling::{ConnectionKind, Spec};
use ob1_s7::iso::{Place, Tsap};
use ob1_s7::server::Settings;
use serde::Deserialize;

/// Default limit of concurrent connections.
const CLIENTS: usize = 16;
/// Absolute limit of concurrent connections.
const MOST_CLIENTS: usize = 128;

/// The keys as the runtime passes them.
#[derive(Debug, Deserialize)]
#[serde(default)]
struct Keys {
    rack: u8,
    slot: u8,
    pdu: u16,
    clients: usize,
    idle: u64,
    password_rights: Option<String>,
    connections: Vec<ConnectionKeys>,
    /// The last socket is that of the tap.
    tap: bool,
}

/// A connection of a CP 343, as passed by the runtime.
#[derive(Clone, Debug, Deserialize)]
pub struct ConnectionKeys {
    id: u16,
    #[serde(rename = "type")]
    kind: String,
    active: bool,
    /// Address and port of the partner, if the station file gives one.
    partner: Option<String>,
    /// Our TSAP, and below it the partner's.
    #[serde(default)]
    local: Vec<u8>,
    #[serde(default)]
    remote: Vec<u8>,
    /// Index of its socket among those bound for the CP, from 0.
    pub socket: Option<usize>,
}

impl ConnectionKeys {
    /// The kind; an unknown word counts as ISO on TCP.
    #[must_use]
    pub fn kind(&self) -> ConnectionKind {
        match self.kind.as_str() {
            "tcp" => ConnectionKind::Tcp,
            "udp" => ConnectionKind::Udp,
            "s7" => ConnectionKind::S7,
            _ => ConnectionKind::Iso,
        }
    }

    /// The partner's address and port.
    #[must_use]
    pub fn partner(&self) -> Option<SocketAddr> {
        self.partner.as_deref().and_then(|text| text.parse().ok())
    }

    /// The connection for the machine.
    #[must_use]
    pub fn spec(&self) -> Spec {
        let tsap = |bytes: &[u8]| Tsap::new(bytes).unwrap_or_default();
        Spec {
            id: self.id,
            kind: self.kind(),
            active: self.active,
            local: tsap(&self.local),
            remote: tsap(&self.remote),
        }
    }
}

impl Default for Keys {
    fn default() -> Self {
        let pdu = Settings::default().pdu;
        // The position of the CPU in an S7-300.
        Self {
            rack: 0,
            slot: 2,
            pdu,
            clients: CLIENTS,
            idle: 0,
            password_rights: None,
            connections: Vec::new(),
            tap: false,
        }
    }
}

/// The configuration of the process.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// The position of the CPU.
    pub place: Place,
    /// Rights and limits of its connections.
    pub settings: Settings,
    /// The rights of a connection after its password.
    pub unlocked: Rights,
    /// Connections that may be served at the same time.
    pub clients: usize,
    /// A connection that is silent for this long, and waits for nothing, is closed.
    pub idle: Option<Duration>,
    /// The last socket handed over is that of the tap.
    pub tap: bool,
}

impl Config {
    /// From the broker's first message.
    ///
    /// # Errors
    /// The keys are not those of this version.
    pub fn of(welcome: &Welcome) -> Result<(Self, Vec<ConnectionKeys>), serde_json::Error> {
        let keys: Keys = serde_json::from_str(&welcome.config)?;
        let unlocked = keys.password_rights.as_deref().and_then(Right::named);
        let clients = keys.clients.clamp(1, MOST_CLIENTS);
        let settings = Settings {
            pdu: keys.pdu,
            rights: rights(welcome.rights),
            has_password: unlocked.is_some(),
            connections: clients as u16,
            is_400: welcome.family == 400,
            ..Settings::default()
        };
        let config = Self {
            place: Place { rack: keys.rack, slot: keys.slot },
            settings,
            unlocked: unlocked.map_or(settings.rights, rights),
            clients,
            tap: keys.tap,
            idle: (keys.idle > 0).then(|| Duration::from_secs(keys.idle)),
        };
        Ok((config, keys.connections))
    }
}

fn rights(right: Right) -> Rights {
    match right {
        Right::Read => Rights::Read,
        Right::Write => Rights::Write,
        Right::Operate => Rights::Operate,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_that_are_not_there_have_their_usual_values() {
        let keys = |text| serde_json::from_str::<Keys>(text).expect("keys");
        let plain = keys(r#"{"type":"s7","name":"panel","listen":"127.0.0.1:102"}"#);
        assert_eq!((plain.rack, plain.slot, plain.pdu, plain.clients, plain.idle), (0, 2, 960, 16, 0));
        let all = keys(r#"{"rack":1,"slot":3,"pdu":240,"clients":4,"idle":60,"password_rights":"operate"}"#);
        assert_eq!((all.rack, all.slot, all.pdu, all.clients, all.idle), (1, 3, 240, 4, 60));
        assert_eq!(all.password_rights.as_deref().and_then(Right::named), Some(Right::Operate));
    }
}
