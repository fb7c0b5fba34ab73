//! A connection of S7 communication to a CPU on the network.

use std::io::{Read as _, Write as _};
use std::net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs as _};
use std::time::Duration;

use clap::Args;
use ob1_s7::client::jobs::{Device, Wire};
use ob1_s7::client::{Client, Failure, Observer};
use ob1_s7::iso::{ISO_PORT, Place};

/// A CPU that says nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(5);

/// Which CPU.
#[derive(Clone, Debug, Args)]
pub(crate) struct CpuArgs {
    /// The CPU: its name or address, HOST or HOST:PORT
    pub(crate) host: String,
    #[command(flatten)]
    pub(crate) unit: Unit,
}

/// Where it is in its station, and what it asks for.
#[derive(Clone, Debug, Args)]
pub(crate) struct Unit {
    /// The rack of the CPU
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=7))]
    pub(crate) rack: u8,
    /// The slot of the CPU: 2 in an S7-300, 3 or another in an S7-400
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=31))]
    pub(crate) slot: u8,
    /// The password of the CPU, where one is needed
    #[arg(long)]
    pub(crate) password: Option<String>,
}

/// A TCP connection to the CPU.
#[derive(Debug)]
pub(crate) struct Socket {
    stream: TcpStream,
    name: String,
}

impl Wire for Socket {
    type Error = WireError;

    fn exchange(&mut self, client: &mut Client) -> Result<(), WireError> {
        let gone = |what: &str| WireError(format!("{}: {what}", self.name));
        self.stream.write_all(client.output()).map_err(|error| gone(&error.to_string()))?;
        client.sent(client.output().len());
        let mut buffer = [0; 8192];
        let room = client.room().min(buffer.len());
        let len = match self.stream.read(&mut buffer[..room]) {
            Ok(0) => return Err(gone("the CPU has closed the connection")),
            Ok(len) => len,
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {
                return Err(gone("the CPU does not answer"));
            }
            Err(error) => return Err(gone(&error.to_string())),
        };
        client.receive(&buffer[..len]).map_err(|failure| gone(&failure.to_string()))
    }
}

/// Why the connection is of no use, in one sentence.
#[derive(Debug)]
pub(crate) struct WireError(pub(crate) String);

impl From<Failure> for WireError {
    fn from(failure: Failure) -> Self {
        Self(failure.to_string())
    }
}

/// Connects, and gives the password.
pub(super) fn connect(cpu: &CpuArgs) -> Result<Device<Socket>, String> {
    let with_port = with_port(&cpu.host);
    let addresses = with_port.to_socket_addrs().map_err(|error| format!("{with_port}: {error}"))?;
    let mut stream = Err(format!("{with_port} has no address"));
    // A name may have several addresses, and the CPU not all of them.
    for address in addresses {
        stream = TcpStream::connect_timeout(&address, PATIENCE).map_err(|error| {
            format!("{with_port}: {error}; S7 communication usually uses port {ISO_PORT}; write another as HOST:PORT")
        });
        if stream.is_ok() {
            break;
        }
    }
    let stream = stream?;
    let timeouts = stream.set_read_timeout(Some(PATIENCE)).and_then(|()| stream.set_write_timeout(Some(PATIENCE)));
    timeouts.and_then(|()| stream.set_nodelay(true)).map_err(|error| format!("{with_port}: {error}"))?;
    let client = Client::call(Place { rack: cpu.unit.rack, slot: cpu.unit.slot });
    let mut device = Device::connect(client, Socket { stream, name: with_port }).map_err(|error| error.0)?;
    if let Some(password) = &cpu.unit.password {
        let given = device.login(password).map_err(|error| error.0)?;
        given.map_err(|why| format!("the password: {why}"))?;
    }
    Ok(device)
}

/// Connects with what cannot change anything.
pub(crate) fn observe(cpu: &CpuArgs) -> Result<Observer<Socket>, String> {
    connect(cpu).map(Observer::new)
}

/// The host with a port: HOST, HOST:PORT, an IPv6 address, or one in brackets with a port.
fn with_port(host: &str) -> String {
    let address = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    match address.parse::<IpAddr>() {
        Ok(address) => SocketAddr::new(address, ISO_PORT).to_string(),
        Err(_) if host.contains(':') => host.to_owned(),
        Err(_) => format!("{host}:{ISO_PORT}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_with_and_without_a_port() {
        for (host, wanted) in [
            ("192.0.2.7", "192.0.2.7:102"),
            ("192.0.2.7:1102", "192.0.2.7:1102"),
            ("press", "press:102"),
            ("press:1102", "press:1102"),
            ("2001:db8::7", "[2001:db8::7]:102"),
            ("[2001:db8::7]", "[2001:db8::7]:102"),
            ("[2001:db8::7]:1102", "[2001:db8::7]:1102"),
        ] {
            assert_eq!(with_port(host), wanted);
        }
    }
}
