//! Writes that come from the broker: only to names listed in the station file.

use std::collections::BTreeMap;

use crate::shared::{Client, Station, Who};
use ob1_access::{Allowed, Datum, Names, Right, Typed};
use ob1_model::DataType;
use serde_json::Value;

use crate::mqtt::items::{plain, topic};
use crate::mqtt::sparkplug::kind_of;

/// Maximum of concurrent commands; more are refused.
const AT_ONCE: usize = 16;

/// See [the module](self).
#[derive(Clone)]
pub(crate) struct Commands {
    /// By topic part.
    places: BTreeMap<String, Typed>,
    client: Client,
    turns: std::sync::Arc<tokio::sync::Semaphore>,
}

impl Commands {
    /// Builds the commands from the names of the station file.
    ///
    /// # Errors
    /// Which name is wrong, in one sentence.
    pub(crate) fn of(
        wanted: &[String],
        names: &Names,
        allowed: &Allowed,
        station: &Station,
        address: &str,
    ) -> Result<Self, String> {
        let mut places = BTreeMap::new();
        for name in wanted {
            let typed = names.typed(name).map_err(|why| format!("`commands`: {why}"))?;
            if !typed.has_value() || matches!(typed.ty, DataType::Pointer | DataType::Any) {
                return Err(format!("`commands`: {name} is a {}, which cannot be written", typed.ty.name()));
            }
            if !allowed.has(typed.cell) {
                return Err(format!("`commands`: {name} is not among the `areas` and `blocks` of this link"));
            }
            places.insert(topic(&plain(name)), typed);
        }
        let who = Who { user: "-".into(), address: address.to_owned(), right: Right::Write };
        let turns = std::sync::Arc::new(tokio::sync::Semaphore::new(AT_ONCE));
        Ok(Self { places, client: station.client(who), turns })
    }

    /// The names, as parts of topics.
    pub(crate) fn names(&self) -> impl Iterator<Item = &String> {
        self.places.keys()
    }

    /// The data type of a name in Sparkplug; 0 if there is no such command.
    pub(crate) fn kind(&self, name: &str) -> u32 {
        self.places.get(name).map_or(0, |typed| kind_of(&typed.ty))
    }

    /// Writes a value; returns the outcome.
    pub(crate) async fn write(&self, name: &str, value: &Value) -> Result<u64, String> {
        let typed = self.places.get(name).ok_or("there is no such command")?;
        let _turn = self.turns.try_acquire().map_err(|_| "too many commands at a time")?;
        let datum = Datum::of_json(value, &typed.ty).map_err(|why| why.to_string())?;
        let puts = typed.puts(&datum).map_err(|why| why.to_string())?;
        self.client.write(&format!("{name} = {datum}"), puts).await.map_err(|trouble| trouble.to_string())
    }
}
