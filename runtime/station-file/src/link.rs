//! Links into the CPU: `[[link]]`.

use std::io;
use std::net::{SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::path::{Path, PathBuf};

use ob1_access::settings::{GateKind, GateSettings, HttpSettings, OpcUaSettings, S7Settings, Trust, WebSettings};
use ob1_access::{Allowed, Right};

use super::findings::{CONTRADICTION, Findings, TWICE, UNKNOWN_KEY, UNPROTECTED, UNREADABLE, VALUE, unknown};
use super::keys::{Keys, absolute};
use super::mqtt::mqtt;
use super::tables::{Placed, Table};
use super::types::{LinkKind, LinkSettings, StationLink};
use super::values::{choice, name};
use crate::finding::{Finding, Level, Text};
use crate::misplaced_keys;
use LinkKind::{Metrics, Mqtt, OpcUa, S7, Web};

/// The words for rights, from the least to the most.
const RIGHTS: [(&str, Right); 3] = [("read", Right::Read), ("write", Right::Write), ("operate", Right::Operate)];
/// The kinds of link.
const KINDS: [(&str, LinkKind); 5] =
    [(S7.word(), S7), (Web.word(), Web), (Metrics.word(), Metrics), (OpcUa.word(), OpcUa), (Mqtt.word(), Mqtt)];
/// Which certificates of OPC UA clients are accepted.
const TRUST: [(&str, Trust); 2] = [("listed", Trust::Listed), ("any", Trust::Any)];
/// Keys that name files which must be there.
const FILES: [&str; 5] = ["users", "certificate", "key", "ca", "password_file"];
/// Characters of a password: what S7 communication carries.
const PASSWORD: usize = 8;

/// `state` is the folder of what the links keep: a service may not write beside its station file.
pub(super) fn links(
    f: &mut Findings<'_>,
    tables: &[Placed<Table>],
    station: &str,
    folder: &Path,
    state: &Path,
) -> Vec<StationLink> {
    let mut links: Vec<StationLink> = Vec::with_capacity(tables.len());
    for table in tables {
        let mut keys = Keys::new(f, table, folder);
        let Some(link) = link(&mut keys, station, state) else { continue };
        let [name, listen] = ["name", "listen"].map(|key| keys.at(key));
        if let (Some(at), true) = (name, links.iter().any(|other| other.name == link.name)) {
            let message = format!("there are two links with the name \"{}\"", link.name);
            f.error(TWICE, at, message, "give each link a name of its own");
        }
        if let (Some(at), Some(listen)) = (listen, link.listen)
            && links.iter().any(|other| other.listen == link.listen)
        {
            f.error(TWICE, at, format!("two links listen on {listen}"), "give each link a port of its own");
        }
        links.push(link);
    }
    links
}

/// A warning for each file of a link that is not there.
pub(super) fn absent(tables: &[Placed<Table>], source: Text<'_>, folder: &Path) -> Vec<Finding> {
    let files = tables.iter().flat_map(|table| FILES.iter().filter_map(|key| text(table, key)));
    files
        .filter(|(file, _)| folder.join(file).try_exists().is_ok_and(|there| !there))
        .map(|(file, at)| {
            let message = format!("there is no file {file} now, and the link needs it");
            let remedy = "make it (docs/web.md, docs/mqtt.md), or correct its name: it counts from the station file";
            source.finding(Level::Warning, UNREADABLE, at, message, remedy.to_owned())
        })
        .collect()
}

/// A warning for each link whose address this machine does not have: no error, because it may come with the network.
pub(super) fn away(tables: &[Placed<Table>], source: Text<'_>, is_here: impl Fn(SocketAddr) -> bool) -> Vec<Finding> {
    let told = |(text, at)| {
        let ip = address(text).filter(|at| !is_here(*at))?.ip();
        let message = format!("{ip} is no address of this machine now; nobody reaches the link before it is");
        let remedy = "start the network, or correct the address; 0.0.0.0 stands for all of this machine".to_owned();
        Some(source.finding(Level::Warning, VALUE, at, message, remedy))
    };
    tables.iter().filter_map(|table| told(text(table, "listen")?)).collect()
}

/// A text of a table, and its place.
fn text<'t>(table: &'t Placed<Table>, key: &str) -> Option<(&'t str, std::ops::Range<usize>)> {
    let value = table.get_ref().get(key)?;
    Some((value.get_ref().as_str()?, value.span()))
}

/// Whether this machine has the address now.
pub(super) fn is_here(mut address: SocketAddr) -> bool {
    address.set_port(0);
    !UdpSocket::bind(address).is_err_and(|error| error.kind() == io::ErrorKind::AddrNotAvailable)
}

fn link(keys: &mut Keys<'_, '_>, station: &str, state: &Path) -> Option<StationLink> {
    let kind = keys.needed("type", "add `type`; docs/station-file.md says what it means");
    let name = keys.needed("name", "add `name`; docs/station-file.md says what it means");
    let name = name.map(|name| self::name(keys.f, "link", &name));
    let kind = choice(keys.f, "type", kind.as_ref(), &KINDS)?;
    let link = of_kind(keys, kind, name.as_deref().unwrap_or_default(), station, state);
    for (key, at) in keys.left() {
        let has = |(_, other): &&(&str, LinkKind)| keys_of(*other).contains(&key);
        let (code, message, remedy) = match (KINDS.iter().find(has), key) {
            (None, _) => {
                (UNKNOWN_KEY, format!("unknown key `{key}`"), unknown(key, keys.known(), misplaced_keys::remedy))
            }
            (Some(_), key) => {
                let remedy = match key {
                    "password" => "users = \"press.users\": a name and a password each",
                    "listen" => "remove `listen`; `broker` is the address it connects to",
                    _ => "take it away",
                };
                (CONTRADICTION, format!("a link of type \"{}\" has no `{key}`", kind.word()), remedy.to_owned())
            }
        };
        keys.f.error(code, at, message, remedy);
    }
    name.and(link)
}

/// The keys of links of all kinds.
pub(super) fn all_keys() -> Vec<&'static str> {
    KINDS.iter().flat_map(|(_, kind)| keys_of(*kind)).collect()
}

/// The keys of a link of this kind.
fn keys_of(kind: LinkKind) -> Vec<&'static str> {
    let (mut nothing, table) = (Findings::new(Text { file: "", text: "" }), Placed::new(0..0, Table::new()));
    let mut keys = Keys::new(&mut nothing, &table, Path::new(""));
    of_kind(&mut keys, kind, "", "", Path::new(""));
    [&["type", "name"], keys.known()].concat()
}

fn of_kind(keys: &mut Keys<'_, '_>, kind: LinkKind, name: &str, station: &str, state: &Path) -> Option<StationLink> {
    let rights = keys.choice("rights", &RIGHTS).unwrap_or_default();
    let listen = if kind == Mqtt { None } else { listen(keys) };
    let allowed = allowed(keys, matches!(kind, S7 | Web));
    // What clients with more than the right to read do is recorded: by the process of the link, of S7 by the runtime.
    let audit = keys.path("audit").unwrap_or_else(|| absolute(state, &format!("{station}.audit")));
    let mut link = StationLink {
        name: name.to_owned(),
        listen,
        kind,
        rights,
        allowed: allowed.clone().unwrap_or_default(),
        password: None,
        password_rights: rights,
        settings: LinkSettings::S7(S7Settings::default()),
        secrets: Vec::new(),
        audit: (kind == S7).then(|| audit.clone()),
        cp: None,
    };
    if kind == S7 {
        let own = s7(keys);
        link.password = password(keys);
        link.password_rights = own.password_rights.unwrap_or(rights);
        link.settings = LinkSettings::S7(own);
    } else {
        let state = (kind != Metrics).then(|| absolute(state, &format!("{station}.gate")));
        link.settings = LinkSettings::Gate(Box::new(gate(keys, &link, station, (audit, state))?));
    }
    link.secrets = std::mem::take(&mut keys.secrets);
    allowed.map(|_| link)
}

fn s7(keys: &mut Keys<'_, '_>) -> S7Settings {
    S7Settings {
        rack: keys.number("rack", 0..=7),
        slot: keys.number("slot", 0..=31),
        pdu: keys.number("pdu", 64..=1024),
        clients: keys.number("clients", 1..=128),
        idle: keys.number("idle", 0..=86_400),
        password_rights: keys.choice("password_rights", &RIGHTS),
        ..S7Settings::default()
    }
}

fn password(keys: &mut Keys<'_, '_>) -> Option<String> {
    let password = keys.value::<String>("password");
    match (&password, keys.at("password_rights")) {
        (Some(password), _) if !fits(password.get_ref()) => {
            let message = "this cannot be a password of S7 communication";
            keys.f.error(VALUE, password.span(), message, "1 to 8 ASCII characters");
        }
        (None, Some(rights)) => {
            let message = "there are rights for a password, but no password";
            keys.f.error(CONTRADICTION, rights, message, "add `password`, or remove `password_rights`");
        }
        (Some(password), None) => {
            let message = "`password_rights` is missing: the password gives no rights";
            keys.f.error(CONTRADICTION, password.span(), message, "add password_rights = \"write\" or \"operate\"");
        }
        _ => {}
    }
    password.map(Placed::into_inner)
}

/// Which cells the clients may touch; `None` if that is not to be understood.
fn allowed(keys: &mut Keys<'_, '_>, has_program: bool) -> Option<Allowed> {
    let [areas, blocks] = ["areas", "blocks"].map(|key| keys.plain::<Vec<String>>(key));
    let program = if has_program { keys.plain("program") } else { None };
    let allowed = Allowed::of(areas.as_deref(), blocks.as_deref()).map(|allowed| allowed.with_program(program));
    allowed
        .map_err(|why| {
            let at = keys.at("areas").or(keys.at("blocks")).unwrap_or(0..0);
            keys.f.error(VALUE, at, why, "areas = [\"M\", \"DB\"], blocks = [\"DB10\", \"DB20-29\"]");
        })
        .ok()
}

/// A link of the gate, with the audit log and the folder of what it keeps.
fn gate(
    keys: &mut Keys<'_, '_>,
    link: &StationLink,
    station: &str,
    (audit, state): (PathBuf, Option<PathBuf>),
) -> Option<GateSettings> {
    let users = if link.kind == Mqtt { None } else { keys.secret("users") };
    let tls = if link.kind == OpcUa { None } else { keys.path("certificate").zip(keys.secret("key")) };
    let allowed = link.allowed.clone();
    let own = match link.kind {
        Mqtt => GateKind::Mqtt(Box::new(mqtt(keys, link, station, tls.clone())?)),
        Web => GateKind::Web(WebSettings {
            http: HttpSettings { origins: origins(keys), ..http(keys) },
            allowed,
            reports: keys.path("reports"),
            taps: None,
        }),
        OpcUa => GateKind::OpcUa(OpcUaSettings {
            allowed,
            anonymous: keys.plain("anonymous"),
            trust: keys.choice("trust", &TRUST).unwrap_or_default(),
            clients: keys.number("clients", 1..=128),
            items: keys.number("items", 1..=100_000),
        }),
        Metrics | S7 => GateKind::Metrics(http(keys)),
    };
    if link.kind != Mqtt {
        protected(keys, link, users.is_some());
    }
    if let (GateKind::OpcUa(OpcUaSettings { anonymous: Some(false), .. }), None, Some(at)) =
        (&own, &users, keys.at("anonymous"))
    {
        keys.f.error(CONTRADICTION, at, "nobody could log in", "give it `users`, or `anonymous = true`");
    }
    Some(GateSettings { users, tls, audit, state, own })
}

fn http(keys: &mut Keys<'_, '_>) -> HttpSettings {
    let hosts = keys.plain("hosts").unwrap_or_default();
    HttpSettings { clients: keys.number("clients", 1..=128), hosts, origins: Vec::new() }
}

/// The addresses under which a proxy shows a page, written as browsers send them (docs/web.md).
fn origins(keys: &mut Keys<'_, '_>) -> Vec<String> {
    let Some(origins) = keys.value::<Vec<String>>("origins") else { return Vec::new() };
    for origin in origins.get_ref() {
        let host = origin.strip_prefix("https://").or_else(|| origin.strip_prefix("http://"));
        if host.is_none_or(|host| host.is_empty() || host.contains(['/', '?', '#', '@', ' '])) {
            let message = format!("\"{origin}\" is not the address of a host");
            keys.f.error(VALUE, origins.span(), message, "origins = [\"https://press.plant.example\"], without a path");
        }
    }
    origins.into_inner()
}

/// Which clients may connect from where, and with what rights: the rules of the gate (docs/web.md).
fn protected(keys: &mut Keys<'_, '_>, link: &StationLink, has_users: bool) {
    let (rights, above) = (keys.at("rights"), link.rights > Right::Read);
    if let (Metrics, true, Some(at)) = (link.kind, above, rights.clone()) {
        keys.f.error(CONTRADICTION, at, "figures are only read", "take `rights` away");
    }
    if link.kind != OpcUa
        && let (Some(one), None) | (None, Some(one)) = (keys.at("certificate"), keys.at("key"))
    {
        keys.f.error(CONTRADICTION, one, "TLS takes a certificate and its key", "add the other one");
    }
    let wants_users = "users = \"press.users\", made by `ob1-gate user add press.users NAME --rights write`";
    // On this machine, too: any local user can reach it, and so can a web page whose host name changes its address.
    if let (true, false, Some(at)) = (above, has_users, rights) {
        let word = RIGHTS.iter().find(|(_, right)| *right == link.rights).map_or("", |(word, _)| word);
        keys.f.error(UNPROTECTED, at, format!("rights = \"{word}\" for everybody who reaches it"), wants_users);
    }
    let (Some(listen), Some(at)) = (link.listen, keys.at("listen")) else { return };
    if listen.ip().to_canonical().is_loopback() {
        return;
    }
    if !has_users {
        let message = format!("{listen} can be reached from outside this machine, and nobody has to log in");
        keys.f.error(UNPROTECTED, at.clone(), message, wants_users);
    }
    // OPC UA brings its own encryption.
    if link.kind != OpcUa && keys.at("certificate").is_none() {
        let message =
            format!("{listen} can be reached from outside this machine, and passwords would not be encrypted");
        let remedy =
            "certificate = \"press.crt\" and key = \"press.key\", or listen on 127.0.0.1 behind a proxy with TLS";
        keys.f.error(UNPROTECTED, at, message, remedy);
    }
}

fn fits(password: &str) -> bool {
    !password.is_empty() && password.len() <= PASSWORD && password.is_ascii()
}

fn listen(keys: &mut Keys<'_, '_>) -> Option<SocketAddr> {
    let text = keys.needed::<String>("listen", "add listen = \"127.0.0.1:8080\"")?;
    let address = address(text.get_ref());
    if address.is_none() {
        let message = format!("\"{}\" is not an address to listen on", text.get_ref());
        let remedy = "an address and a port: \"127.0.0.1:102\"; \"0.0.0.0:102\" is everybody";
        keys.f.error(VALUE, text.span(), message, remedy);
    }
    address
}

fn address(text: &str) -> Option<SocketAddr> {
    text.to_socket_addrs().ok()?.next()
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
        assert_eq!((link.rights, link.password_rights), (Right::Read, Right::Read));
        assert_eq!(link.settings, LinkSettings::S7(S7Settings::default()));
        let listen = link.listen.expect("it listens").to_string();
        assert_eq!((listen.as_str(), link.kind.program()), ("127.0.0.1:102", "ob1-s7"));
        let keys = "rights = \"write\"\npassword = \"secret\"\npassword_rights = \"operate\"\nareas = [\"M\"]\nslot = 3\npdu = 240";
        let parsed = parse(&station(keys), "x.toml", Path::new("")).expect("right");
        let link = &parsed.links[0];
        assert_eq!((link.rights, link.password_rights), (Right::Write, Right::Operate));
        let (slot, pdu, password_rights) = (Some(3), Some(240), Some(Right::Operate));
        assert_eq!(link.settings, LinkSettings::S7(S7Settings { slot, pdu, password_rights, ..S7Settings::default() }));
        assert!(!link.settings.json().contains("secret"));
        assert!(!link.allowed.has_program(), "limited to bit memory");
        assert_eq!(link.audit.as_deref(), Some(&*std::path::absolute("x.audit").expect("a path")));
        let keys = "areas = [\"M\"]\nprogram = true\naudit = \"/var/log/a\"";
        let parsed = parse(&station(keys), "x.toml", Path::new("")).expect("right");
        assert!(parsed.links[0].allowed.has_program());
        assert_eq!(parsed.links[0].audit.as_deref(), Some(Path::new("/var/log/a")));
    }

    /// One run tells all that is wrong with a link, and with the next one.
    #[test]
    fn what_is_missing_or_wrong_is_told_together() {
        let text =
            "[station]\nname = \"x\"\n[[link]]\ntype = \"s7\"\nslot = 40\ncolour = 1\n\n[[link]]\nname = \"b\"\n";
        let found = parse(text, "x.toml", Path::new("")).expect_err("wrong");
        let told: Vec<(u32, &str)> = found.iter().map(|one| (one.line, one.code.as_str())).collect();
        assert_eq!(told, [(4, "C004"), (4, "C004"), (5, "C005"), (6, "C003"), (8, "C004")], "{found:#?}");
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
            ("colour = 1", 7, "unknown key `colour`"),
            ("clyents = 1", 7, "did you mean `clients`?"),
            ("min_cycle = \"1ms\"", 7, "it belongs in [cpu]"),
            ("users = \"a\"", 7, "a link of type \"s7\" has no `users`"),
            ("slot = \"2\"", 7, "expected a whole number"),
            ("areas = \"M\"", 7, "expected a list in brackets"),
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
        let LinkSettings::Gate(told) = &link.settings else { panic!("{link:?}") };
        let wanted = GateSettings {
            users: Some("/etc/ob1/a.users".into()),
            tls: Some(("/c/a.crt".into(), "/etc/ob1/tls/a.key".into())),
            audit: "/etc/ob1/x.audit".into(),
            state: Some("/etc/ob1/x.gate".into()),
            own: GateKind::Web(WebSettings {
                http: HttpSettings { clients: None, hosts: vec!["press.plant".into()], origins: Vec::new() },
                allowed: Allowed::default(),
                reports: None,
                taps: None,
            }),
        };
        assert_eq!(**told, wanted);
        assert_eq!(serde_json::from_str::<GateSettings>(&link.settings.json()).expect("what was written"), wanted);
        assert_eq!(link.secrets, [Path::new("/etc/ob1/a.users"), Path::new("/etc/ob1/tls/a.key")]);
    }
}
