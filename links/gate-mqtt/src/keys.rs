//! The keys of a link of type `mqtt` in the station file (docs/station-file.md).

use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

use ob1_access::{Allowed, Right};
use serde::Deserialize;

/// Shortest period of reading the values.
const SHORTEST: Duration = Duration::from_millis(50);
/// Maximum bytes on disk, unless the link's key says otherwise.
const STORE: u64 = 16 << 20;

/// The keys of the table.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Keys {
    pub(crate) broker: String,
    pub(crate) client: Option<String>,
    pub(crate) prefix: Option<String>,
    #[serde(default)]
    pub(crate) publish: Vec<String>,
    /// Milliseconds.
    pub(crate) every: Option<u64>,
    pub(crate) retain: Option<bool>,
    pub(crate) sparkplug: Option<String>,
    pub(crate) node: Option<String>,
    #[serde(default)]
    pub(crate) alarms: bool,
    #[serde(default)]
    pub(crate) commands: Vec<String>,
    pub(crate) store: Option<u64>,
    pub(crate) ca: Option<PathBuf>,
    pub(crate) certificate: Option<PathBuf>,
    pub(crate) key: Option<PathBuf>,
    pub(crate) user: Option<String>,
    pub(crate) password_file: Option<PathBuf>,
    pub(crate) areas: Option<Vec<String>>,
    pub(crate) blocks: Option<Vec<String>>,
}

/// The final settings of a link.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    pub(crate) host: String,
    pub(crate) port: u16,
    pub(crate) client: String,
    pub(crate) prefix: String,
    pub(crate) publish: Vec<String>,
    pub(crate) every: Duration,
    pub(crate) retain: bool,
    /// The group and the node, if Sparkplug B is used.
    pub(crate) sparkplug: Option<(String, String)>,
    /// The alarms that stand are published.
    pub(crate) alarms: bool,
    pub(crate) commands: Vec<String>,
    pub(crate) store: u64,
    pub(crate) tls: Option<TlsFiles>,
    pub(crate) user: Option<(String, PathBuf)>,
    pub(crate) allowed: Allowed,
}

/// The trusted certificates, and our own.
#[derive(Clone, Debug)]
pub(crate) struct TlsFiles {
    pub(crate) ca: PathBuf,
    pub(crate) own: Option<(PathBuf, PathBuf)>,
}

impl Keys {
    /// Derives the settings from the keys.
    ///
    /// # Errors
    /// The contradiction, in one sentence.
    pub(crate) fn settle(self, station: &str, link: &str, ceiling: Right) -> Result<Settings, String> {
        let (tls, address) = match (self.broker.strip_prefix("mqtts://"), self.broker.strip_prefix("mqtt://")) {
            (Some(address), _) => (true, address),
            (None, Some(address)) => (false, address),
            (None, None) => return Err("`broker` is a URL: \"mqtts://broker.plant:8883\"; \"mqtt://localhost\"".into()),
        };
        let address = address.trim_end_matches('/');
        // The colons of `[::1]` do not begin a port.
        let (host, port) = match address.rsplit_once(':').filter(|(_, port)| !port.ends_with(']')) {
            Some((host, port)) => {
                (host, Some(port.parse().map_err(|_| format!("`broker`: \"{port}\" is not a port"))?))
            }
            None => (address, None),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']').to_owned();
        if host.is_empty() || host.contains(['/', '@', '?']) {
            return Err("`broker` names no host; write \"mqtts://broker.plant:8883\"".into());
        }
        let here = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback());
        let tls = match (tls, self.ca, self.certificate.zip(self.key)) {
            (false, ..) if !here => return Err("a broker on another machine needs TLS: mqtts://".into()),
            (false, ..) => None,
            (true, None, _) => {
                return Err("mqtts:// needs `ca`: the certificate of the authority that signed the broker's".into());
            }
            (true, Some(ca), own) => Some(TlsFiles { ca, own }),
        };
        let user = match (self.user, self.password_file) {
            (None, None) => None,
            (Some(user), Some(file)) => Some((user, file)),
            _ => return Err("`user` and `password_file` go together".into()),
        };
        if !here && user.is_none() && tls.as_ref().is_none_or(|tls| tls.own.is_none()) {
            return Err(
                "a broker on another machine needs `user` and `password_file`, or `certificate` and `key`".into()
            );
        }
        if !self.commands.is_empty() && ceiling < Right::Write {
            return Err("`commands` need `rights = \"write\"`".into());
        }
        if self.publish.is_empty() && self.commands.is_empty() && !self.alarms {
            return Err("it has nothing to do: give it `publish`, `alarms` or `commands`".into());
        }
        if self.alarms && self.sparkplug.is_some() {
            return Err("Sparkplug B has no alarms: give them a link of their own, with plain topics".into());
        }
        let part = |name: &str, text: &String| {
            let legal = !text.is_empty() && !text.contains(['+', '#', '\0']);
            if legal { Ok(()) } else { Err(format!("`{name}` is \"{text}\"; + and # have a meaning of their own")) }
        };
        let prefix = self.prefix.unwrap_or_else(|| format!("ob1/{station}"));
        part("prefix", &prefix)?;
        if self.node.is_some() && self.sparkplug.is_none() {
            return Err("`node` is a name for Sparkplug B: give it `sparkplug`, too".into());
        }
        let sparkplug = self.sparkplug.map(|group| (group, self.node.unwrap_or_else(|| station.to_owned())));
        for (key, what, name) in
            sparkplug.iter().flat_map(|(group, node)| [("sparkplug", "group", group), ("node", "node", node)])
        {
            part(key, name)?;
            if name.contains('/') {
                return Err(format!("`{key}` is the name of a {what}, without a slash"));
            }
        }
        Ok(Settings {
            host,
            port: port.unwrap_or(if tls.is_some() { 8883 } else { 1883 }),
            client: self.client.unwrap_or_else(|| format!("ob1-{station}-{link}")),
            prefix,
            publish: self.publish,
            every: self.every.map_or(Duration::from_secs(1), Duration::from_millis).max(SHORTEST),
            retain: self.retain.unwrap_or(true),
            sparkplug,
            alarms: self.alarms,
            commands: self.commands,
            store: self.store.unwrap_or(STORE),
            tls,
            user,
            allowed: Allowed::of(self.areas.as_deref(), self.blocks.as_deref())?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settle(keys: &str, ceiling: Right) -> Result<Settings, String> {
        serde_json::from_str::<Keys>(keys).expect("keys").settle("press", "cloud", ceiling)
    }

    #[test]
    fn here_it_needs_a_broker_and_something_to_tell() {
        let keys = settle(r#"{"broker": "mqtt://localhost", "publish": ["MW10"]}"#, Right::Read).expect("right");
        assert_eq!((keys.port, keys.prefix.as_str(), keys.client.as_str()), (1883, "ob1/press", "ob1-press-cloud"));
        assert!(keys.tls.is_none() && keys.retain && keys.every == Duration::from_secs(1));
        for (broker, host, port) in [
            ("mqtt://[::1]:1884", "::1", 1884),
            ("mqtt://[::1]/", "::1", 1883),
            ("mqtt://127.0.0.1", "127.0.0.1", 1883),
        ] {
            let keys = format!(r#"{{"broker": "{broker}", "publish": ["MW10"], "every": 500}}"#);
            let keys = settle(&keys, Right::Read).expect("right");
            assert_eq!((keys.host.as_str(), keys.port, keys.every), (host, port, Duration::from_millis(500)));
        }
    }

    #[test]
    fn a_node_has_a_name_of_its_own_or_the_stations() {
        for (node, name) in [("", "press"), (r#", "node": "7""#, "7")] {
            let keys = format!(r#"{{"broker": "mqtt://localhost", "publish": ["MW10"], "sparkplug": "hall"{node}}}"#);
            let found = settle(&keys, Right::Read).expect("right").sparkplug;
            assert_eq!(found, Some(("hall".into(), name.into())));
        }
    }

    #[test]
    fn elsewhere_it_needs_tls_and_credentials() {
        let whole = r#"{"broker": "mqtts://b", "publish": ["M1.0"], "ca": "/ca", "user": "u", "password_file": "/p"}"#;
        let keys = settle(whole, Right::Read).expect("right");
        assert!(keys.tls.is_some() && keys.port == 8883);
        for (keys, why) in [
            (r#"{"broker": "mqtts://b", "publish": ["M1.0"], "ca": "/ca"}"#, "password_file"),
            (r#"{"broker": "mqtts://b", "publish": ["M1.0"]}"#, "ca"),
            (r#"{"broker": "mqtt://192.0.2.1", "publish": ["M1.0"]}"#, "TLS"),
            (r#"{"broker": "b", "publish": ["M1.0"]}"#, "URL"),
            (r#"{"broker": "mqtt://localhost", "commands": ["M1.0"]}"#, "rights"),
            (r#"{"broker": "mqtt://localhost"}"#, "nothing to do"),
            (r#"{"broker": "mqtt://localhost:x", "publish": ["M1.0"]}"#, "not a port"),
            (r#"{"broker": "mqtt://", "publish": ["M1.0"]}"#, "no host"),
            (r#"{"broker": "mqtt://localhost", "publish": ["M1.0"], "prefix": "a/#"}"#, "prefix"),
            (r#"{"broker": "mqtt://localhost", "publish": ["M1.0"], "sparkplug": "a/b"}"#, "slash"),
            (r#"{"broker": "mqtt://localhost", "publish": ["M1.0"], "sparkplug": "a", "node": "a/b"}"#, "slash"),
            (r#"{"broker": "mqtt://localhost", "publish": ["M1.0"], "node": "a"}"#, "`sparkplug`, too"),
            (r#"{"broker": "mqtt://localhost", "publish": ["M1.0"], "user": "u"}"#, "together"),
        ] {
            let told = settle(keys, Right::Read).expect_err(keys);
            assert!(told.contains(why), "{keys}: {told}");
        }
    }
}
