//! The keys of a link of type `opcua` in the station file (docs/station-file.md).

use ob1_access::{Allowed, Right};
use serde::Deserialize;

use crate::limits;

/// The keys of the table.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Keys {
    /// Whether clients without a user may read; default: only on loopback.
    pub(crate) anonymous: Option<bool>,
    /// Which certificates of clients are accepted: `listed` or `any`.
    #[serde(default)]
    pub(crate) trust: Trust,
    /// Maximum of concurrent sessions that ask for something.
    pub(crate) clients: Option<usize>,
    /// Monitored items of all clients together.
    pub(crate) items: Option<usize>,
    pub(crate) areas: Option<Vec<String>>,
    pub(crate) blocks: Option<Vec<String>>,
}

/// Which certificates of client programs are accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Trust {
    /// Those in the folder `trusted`; others are put into `rejected`, for inspection.
    #[default]
    Listed,
    /// All that are valid.
    Any,
}

/// The final settings of a link.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    pub(crate) anonymous: bool,
    pub(crate) trust: Trust,
    pub(crate) clients: usize,
    pub(crate) items: usize,
    pub(crate) allowed: Allowed,
    /// Whether a channel without security is offered: only on loopback.
    pub(crate) open: bool,
}

impl Keys {
    /// Derives the settings from the keys, the link's address and its rights.
    ///
    /// # Errors
    /// The contradiction, in one sentence.
    pub(crate) fn settle(self, loopback: bool, ceiling: Right, users: bool) -> Result<Settings, String> {
        let anonymous = self.anonymous.unwrap_or(loopback);
        if !users && !anonymous {
            return Err("nobody could log in: give it `users`, or `anonymous = true`".into());
        }
        if !users && ceiling > Right::Read {
            return Err("above `rights = \"read\"` it needs `users`: anonymous clients only read".into());
        }
        let within = |name: &str, value: Option<usize>, unless: usize, most: usize| match value.unwrap_or(unless) {
            value if (1..=most).contains(&value) => Ok(value),
            value => Err(format!("`{name}` is {value}; it can be 1 to {most}")),
        };
        Ok(Settings {
            anonymous,
            trust: self.trust,
            clients: within("clients", self.clients, limits::CLIENTS, 128)?,
            items: within("items", self.items, limits::ITEMS, 100_000)?,
            allowed: Allowed::of(self.areas.as_deref(), self.blocks.as_deref())?,
            open: loopback,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settle(keys: &str, loopback: bool, ceiling: Right, users: bool) -> Result<Settings, String> {
        let keys: Keys = serde_json::from_str(keys).expect("keys");
        keys.settle(loopback, ceiling, users)
    }

    #[test]
    fn anonymous_clients_read_on_loopback_unless_said_otherwise() {
        let here = settle("{}", true, Right::Read, false).expect("right");
        assert!(here.anonymous && here.open);
        let users = settle("{}", false, Right::Operate, true).expect("right");
        assert!(!users.anonymous && !users.open);
        assert!(settle(r#"{"anonymous": true}"#, false, Right::Read, false).expect("right").anonymous);
        assert!(!settle(r#"{"anonymous": false}"#, true, Right::Write, true).expect("right").anonymous);
    }

    #[test]
    fn what_does_not_go_together_is_refused() {
        for (keys, loopback, ceiling, users, why) in [
            ("{}", false, Right::Read, false, "nobody"),
            ("{}", true, Right::Write, false, "users"),
            (r#"{"clients": 0}"#, true, Right::Read, false, "clients"),
            (r#"{"items": 200000}"#, true, Right::Read, false, "items"),
            (r#"{"areas": ["X"]}"#, true, Right::Read, false, "not an area"),
        ] {
            let told = settle(keys, loopback, ceiling, users).expect_err(keys);
            assert!(told.contains(why), "{keys}: {told}");
        }
    }
}
