//! Links in the language of the socket: which there are, and where others reach them.

use ob1_access::door::Connection;
use ob1_broker::LinkState;
use serde::{Deserialize, Serialize};

/// A link into the CPU.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct LinkStatus {
    /// Name of the link in the station file.
    pub name: String,
    /// Its process is up.
    pub up: bool,
    /// Its connections, where it reports them: an S7 link does.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub connections: Vec<Connection>,
}

impl From<&LinkState> for LinkStatus {
    fn from(link: &LinkState) -> Self {
        Self { name: link.name.clone(), up: link.up, connections: link.connections.clone() }
    }
}

/// A link that listens.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Listens {
    /// Its type, as in the station file.
    #[serde(rename = "type")]
    pub kind: String,
    /// Its address, as in the station file.
    pub address: std::net::SocketAddr,
    /// With TLS.
    pub tls: bool,
}
