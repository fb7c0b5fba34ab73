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
mod keys;
mod node;
mod session;
mod sparkplug;
mod store;
mod tls;
mod topics;

use ob1_gate_core::{Link, Trouble};

use crate::items::Items;
use crate::keys::Keys;
use crate::session::Session;
use crate::store::Store;
use crate::tls::Tls;

/// Serves a link until its station is gone.
///
/// # Errors
/// The error in the link's keys or its files.
pub async fn serve(link: Link) -> Result<(), String> {
    let Link { station, state, .. } = link;
    let keys: Keys = serde_json::from_value(station.keys().clone()).map_err(|error| error.to_string())?;
    let welcome = station.welcome();
    let settings = keys.settle(&welcome.station, &welcome.link, station.ceiling())?;
    let tls = settings.tls.as_ref().map(Tls::open).transpose()?;
    let state = state.ok_or("it has no folder for values that wait to be sent")?.join(&welcome.link);
    let catalog = station.catalog().await.map_err(|trouble| trouble.to_string())?;
    let flat = settings.sparkplug.is_some();
    let items = Items::of(&settings.publish, &catalog.names, &settings.allowed, flat)?;
    let (folder, bound) = (state.join("store"), settings.store);
    let opened = tokio::task::spawn_blocking(move || Store::open(&folder, bound)).await;
    let store = opened.map_err(|error| error.to_string())?.map_err(|error| format!("{}: {error}", state.display()))?;
    let session = Session::new(station, settings, tls, &catalog.names, items, store, &state)?;
    match session.run().await {
        Trouble::Gone => Ok(()),
        trouble => Err(trouble.to_string()),
    }
}
