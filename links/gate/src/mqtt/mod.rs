//! MQTT of a station: values on change, as plain topics at QoS 1 or as Sparkplug B, kept while the broker is away, and
//! commands where the link allows writing (docs/mqtt.md).
//!
//! rumqttc implements the protocol. Each connection starts empty: unacknowledged records are in the store, and are sent
//! again.

mod alarms;
mod commands;
mod connection;
mod flow;
mod items;
mod node;
mod session;
mod sparkplug;
mod store;
mod tls;
mod topics;

use crate::shared::{Link, Trouble};
use ob1_access::Right;
use ob1_access::settings::MqttSettings;

use crate::mqtt::items::Items;
use crate::mqtt::session::Session;
use crate::mqtt::store::Store;
use crate::mqtt::tls::Tls;

/// Serves a link until its station is gone.
///
/// # Errors
/// What it cannot do, or what is wrong with its files.
pub(crate) async fn serve(link: Link, told: MqttSettings) -> Result<(), String> {
    let Link { station, state, .. } = link;
    let welcome = station.welcome();
    if told.publish.is_empty() && told.commands.is_empty() && !told.alarms {
        return Err("it has nothing to do: give it `publish`, `alarms` or `commands`".into());
    }
    // A process that is not confined only reads.
    if !told.commands.is_empty() && station.ceiling() < Right::Write {
        return Err("`commands` need `rights = \"write\"`".into());
    }
    let tls = told.tls.as_ref().map(Tls::open).transpose()?;
    let state = state.ok_or("it has no folder for values that wait to be sent")?.join(&welcome.link);
    let catalog = station.catalog().await.map_err(|trouble| trouble.to_string())?;
    let flat = told.sparkplug.is_some();
    let items = Items::of(&told.publish, &catalog.names, &told.allowed, flat)?;
    let (folder, bound) = (state.join("store"), told.store);
    let opened = tokio::task::spawn_blocking(move || Store::open(&folder, bound)).await;
    let store = opened.map_err(|error| error.to_string())?.map_err(|error| format!("{}: {error}", state.display()))?;
    let session = Session::new(station, told, tls, &catalog.names, items, store, &state)?;
    match session.run().await {
        Trouble::Gone => Ok(()),
        trouble => Err(trouble.to_string()),
    }
}
