//! What the process of a link is told of its `[[link]]` table: checked, with whole paths and final words. The station
//! file makes it, the station writes it as JSON into the first message of the door, and the process reads it there.
//! What is `None` has the usual value of its process.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::{Allowed, Right};

/// An S7 link, served by `ob1-s7`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct S7Settings {
    /// Rack of the CPU.
    pub rack: Option<u8>,
    /// Slot of the CPU.
    pub slot: Option<u8>,
    /// Longest PDU, in bytes.
    pub pdu: Option<u16>,
    /// Connections at the same time, at most.
    pub clients: Option<u16>,
    /// Seconds after which a silent connection is closed; 0: never.
    pub idle: Option<u32>,
    /// The rights of a client with the password, if there is one.
    pub password_rights: Option<Right>,
    /// The connections of the CP 343 that the process is.
    pub connections: Vec<CpConnection>,
    /// The last socket handed over is that of the tap.
    pub tap: bool,
}

/// A connection of a CP 343.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CpConnection {
    /// ID of the handling blocks, one in the station.
    pub id: u16,
    /// Its kind, which decides between TSAPs and ports.
    pub kind: ConnectionType,
    /// We make the connection.
    pub active: bool,
    /// The partner, and the only one who may call.
    pub partner: Option<SocketAddr>,
    /// Our TSAP; empty without one.
    pub local: Vec<u8>,
    /// The partner's TSAP; empty without one.
    pub remote: Vec<u8>,
    /// Our port, for UDP and for TCP that waits for its partner. Such a connection has a socket, in the order of the
    /// connections, bound to the address of the link.
    pub port: Option<u16>,
}

/// The kinds of connection of a CP 343.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ConnectionType {
    /// Plain TCP: a stream without telegrams.
    Tcp,
    /// UDP: telegrams without acknowledgement.
    Udp,
    /// ISO on TCP: telegrams of any length.
    Iso,
    /// S7 connection, for the FB/SFB of S7 communication.
    S7,
}

impl ConnectionType {
    /// Connections of this kind are named by TSAPs, the others by ports.
    #[must_use]
    pub const fn has_tsaps(self) -> bool {
        matches!(self, Self::Iso | Self::S7)
    }
}

/// A link served by `ob1-gate`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GateSettings {
    /// The file of its users.
    pub users: Option<PathBuf>,
    /// The files of a certificate and its key: a server's, or a client's own.
    pub tls: Option<(PathBuf, PathBuf)>,
    /// The audit log.
    pub audit: PathBuf,
    /// The folder of what it keeps, for a link that keeps something.
    pub state: Option<PathBuf>,
    /// What only links of its kind have.
    pub own: GateKind,
}

/// The kinds of link of the gate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum GateKind {
    /// The web page.
    Web(WebSettings),
    /// Figures for Prometheus.
    Metrics(HttpSettings),
    /// An OPC UA server.
    OpcUa(OpcUaSettings),
    /// A client of an MQTT broker.
    Mqtt(Box<MqttSettings>),
}

/// What a link with HTTP has.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HttpSettings {
    /// Connections at the same time, at most.
    pub clients: Option<usize>,
    /// Further names of the station.
    pub hosts: Vec<String>,
    /// The addresses under which a proxy shows the page.
    pub origins: Vec<String>,
}

/// The web page.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WebSettings {
    /// Names and limits of its connections.
    pub http: HttpSettings,
    /// The cells it shows, and whether it shows statements.
    pub allowed: Allowed,
    /// The folder of test reports.
    pub reports: Option<PathBuf>,
    /// The folder of the drivers' taps, for a page that may show everything.
    pub taps: Option<PathBuf>,
}

/// An OPC UA server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpcUaSettings {
    /// The cells it shows.
    pub allowed: Allowed,
    /// Whether clients without a user may read; `None`: only on loopback.
    pub anonymous: Option<bool>,
    /// Which certificates of clients are accepted.
    pub trust: Trust,
    /// Sessions at the same time that ask for something, at most.
    pub clients: Option<usize>,
    /// Monitored items of all clients together, at most.
    pub items: Option<usize>,
}

/// Which certificates of client programs are accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trust {
    /// Those in the folder `trusted`; others are put into `rejected`, for inspection.
    #[default]
    Listed,
    /// All that are valid.
    Any,
}

/// A client of an MQTT broker.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MqttSettings {
    /// Name or address of the broker.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// The files for TLS, if the connection has it.
    pub tls: Option<TlsFiles>,
    /// A user of the broker, and the file of its password.
    pub user: Option<(String, PathBuf)>,
    /// Name of the client.
    pub client: String,
    /// What the topics begin with.
    pub prefix: String,
    /// The cells it can name.
    pub allowed: Allowed,
    /// The items whose values are published.
    pub publish: Vec<String>,
    /// Time from one look at the values to the next.
    pub every: Duration,
    /// Whether the broker keeps the last value of each topic.
    pub retain: bool,
    /// The group and the node, if Sparkplug B is used.
    pub sparkplug: Option<(String, String)>,
    /// The items that can be written.
    pub commands: Vec<String>,
    /// The alarms that stand are published.
    pub alarms: bool,
    /// Bytes on disk, at most.
    pub store: u64,
}

/// The trusted certificates, and our own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TlsFiles {
    /// The certificate of the authority that signed the broker's.
    pub ca: PathBuf,
    /// Our certificate and its key.
    pub own: Option<(PathBuf, PathBuf)>,
}

impl GateSettings {
    /// The files that its process must be able to read again.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let mqtt = match &self.own {
            GateKind::Mqtt(own) => (own.tls.as_ref().map(|tls| &tls.ca), own.user.as_ref().map(|(_, file)| file)),
            _ => (None, None),
        };
        let tls = self.tls.iter().flat_map(|(certificate, key)| [certificate, key]);
        self.users.iter().chain(tls).chain(mqtt.0).chain(mqtt.1)
    }
}
