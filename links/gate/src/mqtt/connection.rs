//! One connection to the broker: a task that owns rumqttc's event loop, because that loop must not be interrupted while
//! it connects.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::Duration;

use ob1_access::settings::MqttSettings;
use rumqttc::{AsyncClient, Event, LastWill, MqttOptions, Transport};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;

use crate::mqtt::flow::WINDOW;

/// The broker notices within one and a half times this that we are gone, and we notice a lost broker likewise.
const KEEP_ALIVE: Duration = Duration::from_secs(5);
/// Maximum of our requests waiting for the socket.
const REQUESTS: usize = 4 * WINDOW;
/// Longest packet that is accepted: commands are short.
const INCOMING: usize = 64 << 10;
/// Longest packet that is sent.
const OUTGOING: usize = 8 << 20;
/// Longest password.
const PASSWORD: u64 = 4096;
/// Maximum of unprocessed events.
const EVENTS: usize = 256;

/// See [the module](self). Dropping it ends the connection.
pub(crate) struct Connection {
    pub(crate) client: AsyncClient,
    events: mpsc::Receiver<Result<Event, String>>,
    task: AbortHandle,
}

impl Connection {
    /// Begins to connect; `will` is what the broker publishes when we are gone.
    ///
    /// # Errors
    /// Why the password cannot be read.
    pub(crate) fn begin(settings: &MqttSettings, transport: Option<Transport>, will: LastWill) -> Result<Self, String> {
        let mut options = MqttOptions::new(&settings.client, &settings.host, settings.port);
        options
            .set_keep_alive(KEEP_ALIVE)
            .set_clean_session(true)
            .set_inflight(WINDOW as u16)
            .set_max_packet_size(INCOMING, OUTGOING)
            .set_last_will(will);
        if let Some((user, file)) = &settings.user {
            options.set_credentials(user, password(file)?);
        }
        if let Some(transport) = transport {
            options.set_transport(transport);
        }
        let (client, mut events) = AsyncClient::new(options, REQUESTS);
        let (to, happened) = mpsc::channel(EVENTS);
        let task = tokio::spawn(async move {
            loop {
                let event = events.poll().await.map_err(|error| error.to_string());
                let ends = event.is_err();
                if to.send(event).await.is_err() || ends {
                    return;
                }
            }
        });
        Ok(Self { client, events: happened, task: task.abort_handle() })
    }

    /// The next event; an error is the last one.
    pub(crate) async fn next(&mut self) -> Result<Event, String> {
        self.events.recv().await.unwrap_or_else(|| Err("the connection has ended".into()))
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// The first line of a file that nobody else can read. It is read for each connection, so that a new password needs no
/// restart.
fn password(path: &Path) -> Result<String, String> {
    let told = |why: &dyn std::fmt::Display| format!("{}: {why}", path.display());
    let about = fs::metadata(path).map_err(|error| told(&error))?;
    if about.mode() & 0o077 != 0 {
        return Err(told(&"others can read it: chmod 600"));
    }
    if about.len() > PASSWORD {
        return Err(told(&"longer than a password"));
    }
    let text = fs::read_to_string(path).map_err(|error| told(&error))?;
    Ok(text.lines().next().unwrap_or_default().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn a_password_is_nobody_elses() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("password");
        fs::write(&path, "secret\n").expect("a file");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).expect("a mode");
        assert!(password(&path).expect_err("others can read it").contains("chmod 600"));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("a mode");
        assert_eq!(password(&path), Ok("secret".into()));
        assert!(password(&folder.path().join("none")).is_err());
    }
}
