//! Links into the CPU: `[[link]]`.

use std::io;
use std::net::{SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use ob1_access::{Allowed, Right};
use ob1_time::Span;
use serde_json::{Map, Value, json};

use super::findings::{CONTRADICTION, Findings, MISSING, TWICE, UNPROTECTED, UNREADABLE, VALUE};
use super::tables::{LinkTable, Placed};
use super::types::{LinkKind, StationLink};
use super::values::{choice, name, number, time};
use crate::finding::{Finding, Level, Text};
use LinkKind::{Metrics, Mqtt, OpcUa, S7, Web};

/// The words for rights, from the least to the most.
const RIGHTS: [(&str, Right); 3] = [("read", Right::Read), ("write", Right::Write), ("operate", Right::Operate)];
/// The kinds of link.
const KINDS: [(&str, LinkKind); 5] =
    [(S7.word(), S7), (Web.word(), Web), (Metrics.word(), Metrics), (OpcUa.word(), OpcUa), (Mqtt.word(), Mqtt)];
/// Kinds that others connect to.
const SERVERS: &[LinkKind] = &[LinkKind::S7, Web, Metrics, OpcUa];
/// Kinds whose clients log in as users.
const WITH_USERS: &[LinkKind] = &[Web, Metrics, OpcUa];
/// Kinds with an audit log.
const WITH_AUDIT: &[LinkKind] = &[LinkKind::S7, Web, Metrics, OpcUa, Mqtt];
/// Kinds that show statements.
const WITH_PROGRAM: &[LinkKind] = &[LinkKind::S7, Web];
/// Kinds whose connections TLS protects; OPC UA brings its own.
const WITH_TLS: &[LinkKind] = &[Web, Metrics];
/// Kinds with a certificate in a file: a server's, or a client's own.
const WITH_CERTIFICATE: &[LinkKind] = &[Web, Metrics, Mqtt];
/// Characters of a password: what S7 communication carries.
const PASSWORD: usize = 8;

/// A key that the process of a link reads itself.
enum Key<'t> {
    Number(&'t Option<Placed<i64>>, RangeInclusive<i64>),
    Flag(&'t Option<Placed<bool>>),
    /// A time, of which its process gets the milliseconds.
    Time(&'t Option<Placed<String>>, RangeInclusive<i64>),
    Text(&'t Option<Placed<String>>),
    Texts(&'t Option<Placed<Vec<String>>>),
    /// A file; its process gets the whole path.
    Path(&'t Option<Placed<String>>),
    /// The same, of a file that nobody else may read.
    Secret(&'t Option<Placed<String>>),
}

/// The keys that processes read themselves, and the kinds of link that have them.
fn keys(table: &LinkTable) -> Vec<(&'static str, &'static [LinkKind], Key<'_>)> {
    vec![
        ("clients", SERVERS, Key::Number(&table.clients, 1..=128)),
        ("rack", &[S7], Key::Number(&table.rack, 0..=7)),
        ("slot", &[S7], Key::Number(&table.slot, 0..=31)),
        ("program", WITH_PROGRAM, Key::Flag(&table.program)),
        ("pdu", &[S7], Key::Number(&table.pdu, 64..=1024)),
        ("idle", &[S7], Key::Number(&table.idle, 0..=86_400)),
        ("password_rights", &[S7], Key::Text(&table.password_rights)),
        ("users", WITH_USERS, Key::Secret(&table.users)),
        ("certificate", WITH_CERTIFICATE, Key::Path(&table.certificate)),
        ("key", WITH_CERTIFICATE, Key::Secret(&table.key)),
        ("audit", WITH_AUDIT, Key::Path(&table.audit)),
        ("hosts", &[Web, Metrics], Key::Texts(&table.hosts)),
        ("origins", &[Web], Key::Texts(&table.origins)),
        ("reports", &[Web], Key::Path(&table.reports)),
        ("anonymous", &[OpcUa], Key::Flag(&table.anonymous)),
        ("trust", &[OpcUa], Key::Text(&table.trust)),
        ("items", &[OpcUa], Key::Number(&table.items, 1..=100_000)),
        ("broker", &[Mqtt], Key::Text(&table.broker)),
        ("client", &[Mqtt], Key::Text(&table.client)),
        ("prefix", &[Mqtt], Key::Text(&table.prefix)),
        ("publish", &[Mqtt], Key::Texts(&table.publish)),
        ("every", &[Mqtt], Key::Time(&table.every, 50..=3_600_000)),
        ("retain", &[Mqtt], Key::Flag(&table.retain)),
        ("sparkplug", &[Mqtt], Key::Text(&table.sparkplug)),
        ("node", &[Mqtt], Key::Text(&table.node)),
        ("commands", &[Mqtt], Key::Texts(&table.commands)),
        ("alarms", &[Mqtt], Key::Flag(&table.alarms)),
        ("store", &[Mqtt], Key::Number(&table.store, 256 << 10..=16 << 30)),
        ("ca", &[Mqtt], Key::Path(&table.ca)),
        ("user", &[Mqtt], Key::Text(&table.user)),
        ("password_file", &[Mqtt], Key::Secret(&table.password_file)),
    ]
}

/// `state` is the folder of what the links keep: a service may not write beside its station file.
pub(super) fn links(
    f: &mut Findings<'_>,
    tables: &[LinkTable],
    station: &str,
    folder: &Path,
    state: &Path,
) -> Vec<StationLink> {
    let mut links: Vec<StationLink> = Vec::with_capacity(tables.len());
    for table in tables {
        let Some(link) = link(f, table, station, folder, state) else { continue };
        if links.iter().any(|other| other.name == link.name) {
            let message = format!("there are two links with the name \"{}\"", link.name);
            f.error(TWICE, table.name.span(), message, "give each link a name of its own");
        }
        if let (Some(text), Some(listen)) = (&table.listen, link.listen)
            && links.iter().any(|other| other.listen == link.listen)
        {
            f.error(TWICE, text.span(), format!("two links listen on {listen}"), "give each link a port of its own");
        }
        links.push(link);
    }
    links
}

/// A warning for each file of a link that is not there.
pub(super) fn absent(tables: &[LinkTable], source: Text<'_>, folder: &Path) -> Vec<Finding> {
    let files = tables.iter().flat_map(|t| [&t.users, &t.certificate, &t.key, &t.ca, &t.password_file]).flatten();
    files
        .filter(|file| folder.join(file.get_ref()).try_exists().is_ok_and(|there| !there))
        .map(|file| {
            let message = format!("there is no file {} now, and the link needs it", file.get_ref());
            let remedy = "make it (docs/web.md, docs/mqtt.md), or correct its name: it counts from the station file";
            source.finding(Level::Warning, UNREADABLE, file.span(), message, remedy.to_owned())
        })
        .collect()
}

/// A warning for each link whose address this machine does not have: no error, because it may come with the network.
pub(super) fn away(tables: &[LinkTable], source: Text<'_>, is_here: impl Fn(SocketAddr) -> bool) -> Vec<Finding> {
    let told = |text: &Placed<String>| {
        let ip = address(text).filter(|at| !is_here(*at))?.ip();
        let message = format!("{ip} is no address of this machine now; nobody reaches the link before it is");
        let remedy = "start the network, or correct the address; 0.0.0.0 stands for all of this machine".to_owned();
        Some(source.finding(Level::Warning, VALUE, text.span(), message, remedy))
    };
    tables.iter().filter_map(|table| told(table.listen.as_ref()?)).collect()
}

/// Whether this machine has the address now.
pub(super) fn is_here(mut address: SocketAddr) -> bool {
    address.set_port(0);
    !UdpSocket::bind(address).is_err_and(|error| error.kind() == io::ErrorKind::AddrNotAvailable)
}

fn link(f: &mut Findings<'_>, table: &LinkTable, station: &str, folder: &Path, state: &Path) -> Option<StationLink> {
    let kind = choice(f, "type", Some(&table.kind), &KINDS);
    let rights = choice(f, "rights", table.rights.as_ref(), &RIGHTS).unwrap_or_default();
    let unlocked = choice(f, "password_rights", table.password_rights.as_ref(), &RIGHTS);
    password(f, table, kind);
    let allowed = Allowed::of(table.areas.as_ref().map(inner), table.blocks.as_ref().map(inner));
    let program = table.program.as_ref().map(|program| *program.get_ref());
    let allowed = allowed.map(|allowed| allowed.with_program(program)).map_err(|why| {
        let at = table.areas.as_ref().or(table.blocks.as_ref()).map_or(0..0, Placed::span);
        f.error(VALUE, at, why, "areas = [\"M\", \"DB\"], blocks = [\"DB10\", \"DB20-29\"]");
    });
    let kind = kind?;
    let (mut config, secrets) = own_keys(f, table, kind, folder);
    let listen = listening(f, table, kind);
    protected(f, table, kind, rights, listen);
    brokered(f, table, kind, rights);
    proxied(f, table);
    // What clients with more than the right to read do is recorded: by the process of the link, of S7 by the runtime.
    let named = table.audit.as_ref().map(|path| absolute(folder, path.get_ref()));
    let audit = named.unwrap_or_else(|| absolute(state, &format!("{station}.audit")));
    if kind.shares_its_process() {
        config.insert("type".into(), json!(table.kind.get_ref()));
        // The broker holds them; the process shows nothing else.
        for (key, list) in [("areas", &table.areas), ("blocks", &table.blocks)] {
            if let Some(list) = list {
                config.insert(key.into(), json!(list.get_ref()));
            }
        }
        if let Ok(allowed) = &allowed {
            config.insert("program".into(), json!(allowed.has_program()));
        }
        config.entry("audit").or_insert_with(|| json!(audit));
        if matches!(kind, OpcUa | Mqtt | Web) {
            config.insert("state".into(), json!(absolute(state, &format!("{station}.gate"))));
        }
    }
    Some(StationLink {
        name: name(f, "link", &table.name),
        listen,
        kind,
        rights,
        allowed: allowed.ok()?,
        password: table.password.as_ref().map(|password| password.get_ref().clone()),
        password_rights: unlocked.unwrap_or(rights),
        config: Value::Object(config).to_string(),
        secrets,
        audit: (kind == S7).then_some(audit),
        cp: None,
        connections: Vec::new(),
    })
}

fn password(f: &mut Findings<'_>, table: &LinkTable, kind: Option<LinkKind>) {
    match (&table.password, &table.password_rights) {
        (Some(password), _) if kind.is_some_and(|kind| kind != S7) => {
            let message = "only a link of type \"s7\" has one password for all";
            f.error(CONTRADICTION, password.span(), message, "users = \"press.users\": a name and a password each");
        }
        (Some(password), _) if !fits(password.get_ref()) => {
            let message = "this cannot be a password of S7 communication";
            f.error(VALUE, password.span(), message, "1 to 8 ASCII characters");
        }
        (None, Some(rights)) => {
            let message = "there are rights for a password, but no password";
            f.error(CONTRADICTION, rights.span(), message, "add `password`, or remove `password_rights`");
        }
        (Some(password), None) => {
            let message = "`password_rights` is missing: the password gives no rights";
            f.error(CONTRADICTION, password.span(), message, "add password_rights = \"write\" or \"operate\"");
        }
        _ => {}
    }
}

/// What the process needs beyond the keys of all links, and the files nobody else may read.
fn own_keys(
    f: &mut Findings<'_>,
    table: &LinkTable,
    kind: LinkKind,
    folder: &Path,
) -> (Map<String, Value>, Vec<PathBuf>) {
    let (mut config, mut secrets) = (Map::new(), Vec::new());
    for (key, kinds, value) in keys(table) {
        let (span, value) = match value {
            Key::Number(Some(value), range) => (value.span(), json!(number::<i64>(f, key, Some(value), range, 0))),
            Key::Flag(Some(flag)) => (flag.span(), json!(flag.get_ref())),
            Key::Time(Some(text), range) => (text.span(), json!(milliseconds(f, key, text, &range))),
            Key::Text(Some(text)) => (text.span(), json!(text.get_ref())),
            Key::Texts(Some(texts)) => (texts.span(), json!(texts.get_ref())),
            Key::Path(Some(path)) => (path.span(), json!(absolute(folder, path.get_ref()))),
            Key::Secret(Some(path)) => {
                let whole = absolute(folder, path.get_ref());
                secrets.push(whole.clone());
                (path.span(), json!(whole))
            }
            Key::Number(None, _) | Key::Time(None, _) | Key::Flag(None) | Key::Text(None) => continue,
            Key::Texts(None) | Key::Path(None) | Key::Secret(None) => continue,
        };
        if kinds.contains(&kind) {
            config.insert(key.to_owned(), value);
        } else {
            let of = table.kind.get_ref();
            f.error(CONTRADICTION, span, format!("a link of type \"{of}\" has no `{key}`"), "take it away");
        }
    }
    (config, secrets)
}

fn milliseconds(f: &mut Findings<'_>, key: &str, text: &Placed<String>, range: &RangeInclusive<i64>) -> i64 {
    let time = time(f, Some(text), Span::ZERO).millis() as i64;
    // A malformed time has been reported already.
    if time != 0 && !range.contains(&time) {
        let message = format!("`{key}` is {}; it can be {}ms to {}ms", text.get_ref(), range.start(), range.end());
        f.error(VALUE, text.span(), message, "a time within that range: \"500ms\"");
    }
    time
}

fn absolute(folder: &Path, path: &str) -> PathBuf {
    let whole = folder.join(path);
    std::path::absolute(&whole).unwrap_or(whole)
}

fn listening(f: &mut Findings<'_>, table: &LinkTable, kind: LinkKind) -> Option<SocketAddr> {
    let key = if kind == Mqtt { ("broker", &table.broker) } else { ("listen", &table.listen) };
    if let (name, None) = key {
        let remedy = if kind == Mqtt { "broker = \"mqtt://127.0.0.1\"" } else { "listen = \"127.0.0.1:8080\"" };
        f.error(MISSING, table.kind.span(), format!("the key `{name}` is missing"), format!("add {remedy}"));
    }
    let text = table.listen.as_ref()?;
    if kind == Mqtt {
        let message = "an MQTT client does not listen";
        f.error(CONTRADICTION, text.span(), message, "remove `listen`; `broker` is the address it connects to");
        return None;
    }
    listen(f, text)
}

/// Which clients may connect from where, and with what rights: the rules of the gate (docs/web.md).
fn protected(f: &mut Findings<'_>, table: &LinkTable, kind: LinkKind, rights: Right, listen: Option<SocketAddr>) {
    if !WITH_USERS.contains(&kind) {
        return;
    }
    if let (Metrics, true, Some(at)) = (kind, rights > Right::Read, &table.rights) {
        f.error(CONTRADICTION, at.span(), "figures are only read", "take `rights` away");
    }
    if let (Some(one), None) | (None, Some(one)) = (&table.certificate, &table.key) {
        f.error(CONTRADICTION, one.span(), "TLS takes a certificate and its key", "add the other one");
    }
    let wants_users = "users = \"press.users\", made by `ob1-gate user add press.users NAME --rights write`";
    // On this machine, too: any local user can reach it, and so can a web page whose host name changes its address.
    if let (true, None, Some(at)) = (rights > Right::Read, &table.users, &table.rights) {
        let message = format!("rights = \"{}\" for everybody who reaches it", at.get_ref());
        f.error(UNPROTECTED, at.span(), message, wants_users);
    }
    let (Some(listen), Some(at)) = (listen, &table.listen) else { return };
    if listen.ip().to_canonical().is_loopback() {
        return;
    }
    if table.users.is_none() {
        let message = format!("{listen} can be reached from outside this machine, and nobody has to log in");
        f.error(UNPROTECTED, at.span(), message, wants_users);
    }
    if WITH_TLS.contains(&kind) && table.certificate.is_none() {
        let message =
            format!("{listen} can be reached from outside this machine, and passwords would not be encrypted");
        let remedy =
            "certificate = \"press.crt\" and key = \"press.key\", or listen on 127.0.0.1 behind a proxy with TLS";
        f.error(UNPROTECTED, at.span(), message, remedy);
    }
}

/// A connection to a broker on another machine must be encrypted, and the broker must know who we are (docs/mqtt.md).
fn brokered(f: &mut Findings<'_>, table: &LinkTable, kind: LinkKind, rights: Right) {
    let (Mqtt, Some(broker)) = (kind, &table.broker) else { return };
    if let (Some(commands), Right::Read) = (&table.commands, rights) {
        let message = "commands write, and this link only reads";
        f.error(CONTRADICTION, commands.span(), message, "rights = \"write\", or remove `commands`");
    }
    if let (Some(one), None) | (None, Some(one)) = (&table.user, &table.password_file) {
        let message = "a user of a broker has a password in a file";
        f.error(CONTRADICTION, one.span(), message, "give it both `user` and `password_file`");
    }
    let text = broker.get_ref();
    let (tls, rest) = match (text.strip_prefix("mqtts://"), text.strip_prefix("mqtt://")) {
        (Some(rest), _) => (true, rest),
        (None, Some(rest)) => (false, rest),
        (None, None) => {
            let message = format!("\"{text}\" is not a URL of a broker");
            f.error(VALUE, broker.span(), message, "\"mqtts://broker.plant:8883\", or \"mqtt://localhost\" here");
            return;
        }
    };
    let here = ["localhost", "127.", "[::1]"].iter().any(|start| rest.starts_with(start));
    if !tls && !here {
        let message = "the connection to a broker on another machine would not be encrypted";
        f.error(UNPROTECTED, broker.span(), message, "mqtts://, with `ca`");
    }
    if tls && table.ca.is_none() {
        let message = "the broker's certificate cannot be checked: the key `ca` is missing";
        f.error(MISSING, broker.span(), message, "ca = \"plant-ca.pem\"");
    }
    if tls && !here && table.user.is_none() && table.certificate.is_none() {
        let message = "this link would not identify itself to the broker";
        f.error(UNPROTECTED, broker.span(), message, "`user` and `password_file`, or `certificate` and `key`");
    }
}

/// The addresses under which a proxy shows a page, written as browsers send them (docs/web.md).
fn proxied(f: &mut Findings<'_>, table: &LinkTable) {
    let Some(origins) = &table.origins else { return };
    for origin in origins.get_ref() {
        let host = origin.strip_prefix("https://").or_else(|| origin.strip_prefix("http://"));
        if host.is_none_or(|host| host.is_empty() || host.contains(['/', '?', '#', '@', ' '])) {
            let message = format!("\"{origin}\" is not the address of a host");
            f.error(VALUE, origins.span(), message, "origins = [\"https://press.plant.example\"], without a path");
        }
    }
}

fn inner(list: &Placed<Vec<String>>) -> &[String] {
    list.get_ref()
}

fn fits(password: &str) -> bool {
    !password.is_empty() && password.len() <= PASSWORD && password.is_ascii()
}

fn listen(f: &mut Findings<'_>, text: &Placed<String>) -> Option<SocketAddr> {
    let address = address(text);
    if address.is_none() {
        let message = format!("\"{}\" is not an address to listen on", text.get_ref());
        let remedy = "an address and a port: \"127.0.0.1:102\"; \"0.0.0.0:102\" is everybody";
        f.error(VALUE, text.span(), message, remedy);
    }
    address
}

fn address(text: &Placed<String>) -> Option<SocketAddr> {
    text.get_ref().to_socket_addrs().ok()?.next()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::parse;
    use crate::tables::StationFile;

    fn station(keys: &str) -> String {
        format!(
            "[station]\nname = \"x\"\n[[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:102\"\n{keys}\n"
        )
    }

    #[test]
    fn a_link_reads_unless_it_says_more() {
        let parsed = parse(&station(""), "x.toml", Path::new("")).expect("right");
        let [link] = &parsed.links[..] else { panic!("{:?}", parsed.links) };
        assert_eq!((link.rights, link.password_rights, link.config.as_str()), (Right::Read, Right::Read, "{}"));
        let listen = link.listen.expect("it listens").to_string();
        assert_eq!((listen.as_str(), link.kind.program()), ("127.0.0.1:102", "ob1-s7"));
        let keys = "rights = \"write\"\npassword = \"secret\"\npassword_rights = \"operate\"\nareas = [\"M\"]\nslot = 3\npdu = 240";
        let parsed = parse(&station(keys), "x.toml", Path::new("")).expect("right");
        let link = &parsed.links[0];
        assert_eq!((link.rights, link.password_rights), (Right::Write, Right::Operate));
        assert_eq!(link.config, r#"{"password_rights":"operate","pdu":240,"slot":3}"#);
        assert!(!link.config.contains("secret"));
        assert!(!link.allowed.has_program(), "limited to bit memory");
        assert_eq!(link.audit.as_deref(), Some(&*std::path::absolute("x.audit").expect("a path")));
        let keys = "areas = [\"M\"]\nprogram = true\naudit = \"/var/log/a\"";
        let parsed = parse(&station(keys), "x.toml", Path::new("")).expect("right");
        assert!(parsed.links[0].allowed.has_program());
        assert_eq!(parsed.links[0].audit.as_deref(), Some(Path::new("/var/log/a")));
    }

    #[test]
    fn an_address_that_this_machine_does_not_have_now_is_a_warning() {
        let text = station("[[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"192.0.2.7:8080\"");
        let file: StationFile = toml::from_str(&text).expect("a station file");
        let source = Text { file: "x.toml", text: &text };
        let found = away(&file.link, source, |at| at.ip().is_loopback());
        let [away_now] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!((away_now.level, away_now.code.as_str(), away_now.line), (Level::Warning, "C005", 10));
        assert!(away_now.message.starts_with("192.0.2.7 is no address of this machine now"), "{found:?}");
        // Set aside for documentation (RFC 5737): no machine has it.
        for (at, here) in [("127.0.0.1:102", true), ("0.0.0.0:102", true), ("192.0.2.7:102", false)] {
            assert_eq!(is_here(at.parse().expect("an address")), here, "{at}");
        }
    }

    #[test]
    fn what_cannot_be_is_told_at_its_place() {
        for (keys, line, what) in [
            ("rights = \"all\"", 7, "rights cannot be"),
            ("slot = 32", 7, "slot = 32 is out of range"),
            ("pdu = 20", 7, "pdu = 20 is out of range"),
            ("clients = 0", 7, "clients = 0 is out of range"),
            ("areas = [\"X\"]", 7, "\"X\" is not an area"),
            ("blocks = [\"10\"]", 7, "names no data blocks"),
            ("password = \"123456789\"\npassword_rights = \"write\"", 7, "cannot be a password"),
            ("password = \"secret\"", 7, "gives no rights"),
            ("password_rights = \"write\"", 7, "no password"),
            ("colour = 1", 7, "unknown key"),
            ("[[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:103\"", 9, "two links with the name"),
            ("[[link]]\ntype = \"s7\"\nname = \"other\"\nlisten = \"127.0.0.1:102\"", 10, "two links listen"),
            ("[[link]]\ntype = \"s8\"\nname = \"other\"\nlisten = \"127.0.0.1:103\"", 8, "type cannot be"),
            ("[[link]]\ntype = \"s7\"\nname = \"other\"\nlisten = \"102\"", 10, "not an address to listen on"),
        ] {
            let findings = parse(&station(keys), "x.toml", Path::new("")).expect_err(keys);
            let found = findings.iter().any(|found| found.line == line && found.to_string().contains(what));
            assert!(found, "{keys}: {findings:#?}");
        }
    }

    /// What strangers could use is refused before anything starts, with what helps.
    #[test]
    fn the_rules_of_the_gate() {
        let tls = "certificate = \"a.crt\"\nkey = \"a.key\"\n";
        let users = "users = \"a.users\"\n";
        let (here, there) = ("listen = \"127.0.0.1:8080\"\n", "listen = \"0.0.0.0:8080\"\n");
        let write = "rights = \"write\"\n";
        for (keys, wrong) in [
            (format!("type = \"web\"\n{here}"), &[][..]),
            ("type = \"web\"\nlisten = \"[::1]:8080\"\n".to_owned(), &[]),
            (format!("type = \"web\"\n{here}{write}"), &["C017"]),
            (format!("type = \"web\"\n{here}{write}{users}"), &[]),
            (format!("type = \"web\"\n{there}"), &["C017", "C017"]),
            (format!("type = \"web\"\nlisten = \"[::]:8080\"\n{users}"), &["C017"]),
            (format!("type = \"web\"\n{there}{users}"), &["C017"]),
            (format!("type = \"web\"\n{there}{tls}"), &["C017"]),
            (format!("type = \"web\"\n{there}{tls}{users}"), &[]),
            (format!("type = \"metrics\"\n{there}{tls}{users}"), &[]),
            (format!("type = \"metrics\"\n{there}"), &["C017", "C017"]),
            (format!("type = \"metrics\"\n{here}{write}{users}"), &["C010"]),
            (format!("type = \"opcua\"\n{there}"), &["C017"]),
            (format!("type = \"opcua\"\n{there}{users}"), &[]),
            (format!("type = \"web\"\n{here}certificate = \"a\"\n"), &["C010"]),
            (format!("type = \"web\"\n{here}password = \"secret\"\n"), &["C010"]),
            (format!("type = \"web\"\n{here}slot = 2\n"), &["C010"]),
            (format!("type = \"s7\"\n{here}{users}"), &["C010"]),
            ("type = \"mqtt\"\nbroker = \"mqtt://localhost\"\n".to_owned(), &[]),
            ("type = \"mqtt\"\nbroker = \"mqtt://10.0.0.1\"\n".to_owned(), &["C017"]),
            ("type = \"mqtt\"\nbroker = \"10.0.0.1\"\n".to_owned(), &["C005"]),
            ("type = \"mqtt\"\nbroker = \"mqtts://b\"\nca = \"c\"\n".to_owned(), &["C017"]),
            (format!("type = \"mqtt\"\nbroker = \"mqtts://b\"\nca = \"c\"\n{tls}"), &[]),
            ("type = \"mqtt\"\nbroker = \"mqtt://[::1]\"\nuser = \"u\"\n".to_owned(), &["C010"]),
            ("type = \"mqtt\"\nbroker = \"mqtt://[::1]\"\nevery = \"10ms\"\n".to_owned(), &["C005"]),
            ("type = \"mqtt\"\nbroker = \"mqtt://[::1]\"\ncommands = [\"M1.0\"]\n".to_owned(), &["C010"]),
            (format!("type = \"web\"\n{here}anonymous = true\n"), &["C010"]),
            (format!("type = \"web\"\n{here}origins = [\"https://a.b:8443\"]\n"), &[]),
            (format!("type = \"web\"\n{here}origins = [\"a.b\"]\n"), &["C005"]),
            (format!("type = \"web\"\n{here}origins = [\"https://\", \"https://a.b/press\"]\n"), &["C005", "C005"]),
            (format!("type = \"metrics\"\n{here}origins = [\"https://a.b\"]\n"), &["C010"]),
            (format!("type = \"mqtt\"\n{here}broker = \"mqtt://127.0.0.1\"\n"), &["C010"]),
            ("type = \"mqtt\"\n".to_owned(), &["C004"]),
            ("type = \"web\"\n".to_owned(), &["C004"]),
        ] {
            let text = format!("[station]\nname = \"x\"\n[[link]]\nname = \"panel\"\n{keys}");
            let codes = match parse(&text, "x.toml", Path::new("/etc/ob1")) {
                Ok(_) => Vec::new(),
                Err(findings) => findings.iter().map(|finding| finding.code.clone()).collect(),
            };
            assert_eq!(codes, wrong, "{keys}");
        }
    }

    #[test]
    fn the_process_gets_whole_paths_and_what_others_must_not_read_is_known() {
        let text = "[station]\nname = \"x\"\n[[link]]\ntype = \"web\"\nname = \"page\"\nlisten = \"127.0.0.1:0\"\n\
                    users = \"a.users\"\ncertificate = \"/c/a.crt\"\nkey = \"tls/a.key\"\nhosts = [\"press.plant\"]";
        let parsed = parse(text, "x.toml", Path::new("/etc/ob1")).expect("right");
        let link = &parsed.links[0];
        let config: serde_json::Value = serde_json::from_str(&link.config).expect("JSON");
        let wanted = json!({
            "type": "web", "users": "/etc/ob1/a.users", "certificate": "/c/a.crt", "key": "/etc/ob1/tls/a.key",
            "hosts": ["press.plant"], "audit": "/etc/ob1/x.audit", "program": true,
            "state": "/etc/ob1/x.gate",
        });
        assert_eq!(config, wanted);
        assert_eq!(link.secrets, [Path::new("/etc/ob1/a.users"), Path::new("/etc/ob1/tls/a.key")]);
    }
}
