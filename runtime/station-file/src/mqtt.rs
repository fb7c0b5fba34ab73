//! A link of type `mqtt`: a client of a broker.

use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

use ob1_access::Right;
use ob1_access::settings::{MqttSettings, TlsFiles};

use super::findings::{CONTRADICTION, MISSING, UNPROTECTED, VALUE};
use super::keys::Keys;
use super::types::StationLink;

/// Time from one look at the values to the next, unless the link says otherwise.
const EVERY: Duration = Duration::from_secs(1);
/// Bytes on disk at most, unless the link says otherwise.
const STORE: u64 = 16 << 20;

/// A client of a broker, with its `own` certificate and key. A connection to a broker on another machine must be
/// encrypted, and the broker must know who we are (docs/mqtt.md).
pub(super) fn mqtt(
    keys: &mut Keys<'_, '_>,
    link: &StationLink,
    station: &str,
    own: Option<(PathBuf, PathBuf)>,
) -> Option<MqttSettings> {
    let url = keys.needed::<String>("broker", "add broker = \"mqtt://127.0.0.1\"");
    let (ca, user, password) = (keys.path("ca"), keys.plain::<String>("user"), keys.secret("password_file"));
    let sparkplug = sparkplug(keys, station);
    let (prefix, client) = (topic(keys, "prefix", true), keys.plain("client"));
    let (publish, every, retain) = (keys.plain("publish"), keys.time("every", 50..=3_600_000), keys.plain("retain"));
    let (commands, alarms) = (keys.plain::<Vec<String>>("commands"), keys.plain("alarms").unwrap_or(false));
    let store = keys.number("store", 256 << 10..=16 << 30);
    if let (Some(at), Right::Read) = (keys.at("commands"), link.rights) {
        let message = "commands write, and this link only reads";
        keys.f.error(CONTRADICTION, at, message, "rights = \"write\", or remove `commands`");
    }
    if let (Some(at), true, true) = (keys.at("alarms"), alarms, sparkplug.is_some()) {
        keys.f.error(
            CONTRADICTION,
            at,
            "Sparkplug B has no alarms",
            "give them a link of their own, with plain topics",
        );
    }
    if let (Some(one), None) | (None, Some(one)) = (keys.at("user"), keys.at("password_file")) {
        let message = "a user of a broker has a password in a file";
        keys.f.error(CONTRADICTION, one, message, "give it both `user` and `password_file`");
    }
    let url = url?;
    let (encrypted, host, port) = broker(url.get_ref())
        .map_err(|why| {
            let message = format!("\"{}\" is not a URL of a broker: {why}", url.get_ref());
            keys.f.error(VALUE, url.span(), message, "\"mqtts://broker.plant:8883\", or \"mqtt://localhost\" here");
        })
        .ok()?;
    let here = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback());
    if !encrypted && !here {
        let message = "the connection to a broker on another machine would not be encrypted";
        keys.f.error(UNPROTECTED, url.span(), message, "mqtts://, with `ca`");
    }
    if encrypted && ca.is_none() {
        let message = "the broker's certificate cannot be checked: the key `ca` is missing";
        keys.f.error(MISSING, url.span(), message, "ca = \"plant-ca.pem\"");
    }
    if encrypted && !here && user.is_none() && own.is_none() {
        let message = "this link would not identify itself to the broker";
        keys.f.error(UNPROTECTED, url.span(), message, "`user` and `password_file`, or `certificate` and `key`");
    }
    Some(MqttSettings {
        host,
        port,
        tls: ca.filter(|_| encrypted).map(|ca| TlsFiles { ca, own }),
        user: user.zip(password),
        client: client.unwrap_or_else(|| format!("ob1-{station}-{}", link.name)),
        prefix: prefix.unwrap_or_else(|| format!("ob1/{station}")),
        allowed: link.allowed.clone(),
        publish: publish.unwrap_or_default(),
        every: every.unwrap_or(EVERY),
        retain: retain.unwrap_or(true),
        sparkplug,
        commands: commands.unwrap_or_default(),
        alarms,
        store: store.unwrap_or(STORE),
    })
}

/// Whether a broker's connection is encrypted, its host and its port.
fn broker(url: &str) -> Result<(bool, String, u16), String> {
    let (encrypted, address) = match (url.strip_prefix("mqtts://"), url.strip_prefix("mqtt://")) {
        (Some(address), _) => (true, address),
        (None, Some(address)) => (false, address),
        (None, None) => return Err("it begins with mqtts:// or mqtt://".to_owned()),
    };
    let address = address.trim_end_matches('/');
    // The colons of `[::1]` do not begin a port.
    let (host, port) = match address.rsplit_once(':').filter(|(_, port)| !port.ends_with(']')) {
        Some((host, port)) => (host, port.parse().map_err(|_| format!("\"{port}\" is not a port"))?),
        None => (address, if encrypted { 8883 } else { 1883 }),
    };
    let host = host.trim_start_matches('[').trim_end_matches(']').to_owned();
    if host.is_empty() || host.contains(['/', '@', '?']) {
        return Err("it names no host".to_owned());
    }
    Ok((encrypted, host, port))
}

/// Group and node of Sparkplug B; a node without a name has that of the station.
fn sparkplug(keys: &mut Keys<'_, '_>, station: &str) -> Option<(String, String)> {
    let (group, node) = (topic(keys, "sparkplug", false), topic(keys, "node", false));
    if let (Some(at), None) = (keys.at("node"), &group) {
        keys.f.error(CONTRADICTION, at, "`node` is a name for Sparkplug B", "give it `sparkplug`, too");
    }
    group.map(|group| (group, node.unwrap_or_else(|| station.to_owned())))
}

/// A part of a topic, which may have slashes or not.
fn topic(keys: &mut Keys<'_, '_>, key: &'static str, slashes: bool) -> Option<String> {
    let text = keys.value::<String>(key)?;
    if text.get_ref().is_empty() || text.get_ref().contains(['+', '#', '\0']) {
        let message = format!("{key} = \"{}\" cannot be in a topic", text.get_ref());
        keys.f.error(VALUE, text.span(), message, "a text without + and #, which have a meaning of their own");
    } else if !slashes && text.get_ref().contains('/') {
        let message = format!("{key} = \"{}\" has a slash", text.get_ref());
        keys.f.error(VALUE, text.span(), message, "a name without a slash");
    }
    Some(text.into_inner())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use ob1_access::settings::GateKind;

    use super::*;
    use crate::finding::Finding;
    use crate::{LinkSettings, parse};

    fn settings(keys: &str) -> Result<MqttSettings, Vec<Finding>> {
        let text = format!("[station]\nname = \"press\"\n[[link]]\ntype = \"mqtt\"\nname = \"cloud\"\n{keys}\n");
        let link = parse(&text, "x.toml", Path::new("/etc"))?.links.remove(0);
        let LinkSettings::Gate(told) = link.settings else { panic!("{link:?}") };
        let GateKind::Mqtt(settings) = told.own else { panic!("{told:?}") };
        Ok(*settings)
    }

    #[test]
    fn here_it_needs_a_broker_only() {
        let usual = settings("broker = \"mqtt://localhost\"").expect("right");
        assert_eq!((usual.port, usual.prefix.as_str(), usual.client.as_str()), (1883, "ob1/press", "ob1-press-cloud"));
        assert!(usual.tls.is_none() && usual.retain && usual.every == EVERY && usual.store == STORE);
        for (broker, host, port) in [
            ("mqtt://[::1]:1884", "::1", 1884),
            ("mqtt://[::1]/", "::1", 1883),
            ("mqtt://127.0.0.1", "127.0.0.1", 1883),
        ] {
            let found = settings(&format!("broker = \"{broker}\"\nevery = \"500ms\"")).expect("right");
            assert_eq!((found.host.as_str(), found.port, found.every), (host, port, Duration::from_millis(500)));
        }
    }

    #[test]
    fn a_node_has_a_name_of_its_own_or_the_stations() {
        for (node, name) in [("", "press"), ("node = \"7\"", "7")] {
            let found = settings(&format!("broker = \"mqtt://localhost\"\nsparkplug = \"hall\"\n{node}"));
            assert_eq!(found.expect("right").sparkplug, Some(("hall".into(), name.into())));
        }
    }

    #[test]
    fn elsewhere_it_needs_tls_and_credentials() {
        let whole = "broker = \"mqtts://b\"\nca = \"ca\"\nuser = \"u\"\npassword_file = \"/p\"";
        let found = settings(whole).expect("right");
        assert_eq!((found.port, found.user), (8883, Some(("u".into(), "/p".into()))));
        assert_eq!(found.tls, Some(TlsFiles { ca: "/etc/ca".into(), own: None }));
        let here = "broker = \"mqtt://localhost\"\n";
        for (keys, line, why) in [
            ("broker = \"mqtts://b\"\nca = \"ca\"".to_owned(), 6, "would not identify itself"),
            ("broker = \"mqtts://localhost\"".to_owned(), 6, "the key `ca` is missing"),
            ("broker = \"mqtt://192.0.2.1\"".to_owned(), 6, "would not be encrypted"),
            ("broker = \"mqtt://127.evil.example\"".to_owned(), 6, "would not be encrypted"),
            ("broker = \"b\"".to_owned(), 6, "is not a URL of a broker"),
            ("broker = \"mqtt://localhost:x\"".to_owned(), 6, "\"x\" is not a port"),
            ("broker = \"mqtt://\"".to_owned(), 6, "it names no host"),
            (format!("{here}commands = [\"M1.0\"]"), 7, "this link only reads"),
            (format!("{here}prefix = \"a/#\""), 7, "cannot be in a topic"),
            (format!("{here}sparkplug = \"a/b\""), 7, "has a slash"),
            (format!("{here}sparkplug = \"a\"\nnode = \"a/b\""), 8, "has a slash"),
            (format!("{here}node = \"a\""), 7, "a name for Sparkplug B"),
            (format!("{here}sparkplug = \"a\"\nalarms = true"), 8, "Sparkplug B has no alarms"),
            (format!("{here}user = \"u\""), 7, "has a password in a file"),
        ] {
            let found = settings(&keys).expect_err(&keys);
            assert!(matches!(&found[..], [one] if one.line == line && one.message.contains(why)), "{keys}: {found:?}");
        }
    }
}
