//! Links into the CPU: `[[link]]`.

use std::net::{SocketAddr, ToSocketAddrs as _};

use ob1_access::{Allowed, Right};
use serde_json::json;

use super::check::{choice, name, number};
use super::findings::{CONTRADICTION, Findings, TWICE, VALUE};
use super::tables::{LinkTable, Placed};
use super::types::{LinkKind, StationLink};

/// Words for rights.
const RIGHTS: [(&str, Right); 3] = [("read", Right::Read), ("write", Right::Write), ("operate", Right::Operate)];
/// The kinds of link.
const KINDS: [(&str, LinkKind); 1] = [("s7", LinkKind::S7)];
/// Characters of a password: what S7 communication carries.
const PASSWORD: usize = 8;

pub(super) fn links(f: &mut Findings<'_>, tables: &[LinkTable]) -> Vec<StationLink> {
    let mut links: Vec<StationLink> = Vec::with_capacity(tables.len());
    for table in tables {
        let Some(link) = link(f, table) else { continue };
        if links.iter().any(|other| other.name == link.name) {
            let message = format!("there are two links with the name \"{}\"", link.name);
            f.error(TWICE, table.name.span(), message, "give each link a name of its own");
        }
        if links.iter().any(|other| other.listen == link.listen) {
            let message = format!("two links listen on {}", link.listen);
            f.error(TWICE, table.listen.span(), message, "give each link a port of its own");
        }
        links.push(link);
    }
    links
}

fn link(f: &mut Findings<'_>, table: &LinkTable) -> Option<StationLink> {
    let kind = choice(f, "type", Some(&table.kind), &KINDS);
    let rights = choice(f, "rights", table.rights.as_ref(), &RIGHTS).unwrap_or_default();
    let unlocked = choice(f, "password_rights", table.password_rights.as_ref(), &RIGHTS);
    match (&table.password, &table.password_rights) {
        (Some(password), _) if !fits(password.get_ref()) => {
            let message = "this cannot be a password of S7 communication";
            f.error(VALUE, password.span(), message, "1 to 8 ASCII characters");
        }
        (None, Some(rights)) => {
            let message = "there are rights for a password, but no password";
            f.error(CONTRADICTION, rights.span(), message, "add `password`, or take `password_rights` away");
        }
        (Some(password), None) => {
            let message = "a password that gives no rights";
            f.error(CONTRADICTION, password.span(), message, "add password_rights = \"write\" or \"operate\"");
        }
        _ => {}
    }
    let allowed = Allowed::of(table.areas.as_ref().map(inner), table.blocks.as_ref().map(inner));
    let allowed = allowed.map_err(|why| {
        let at = table.areas.as_ref().or(table.blocks.as_ref()).map_or(0..0, Placed::span);
        f.error(VALUE, at, why, "areas = [\"M\", \"DB\"], blocks = [\"DB10\", \"DB20-29\"]");
    });
    let mut keys = serde_json::Map::new();
    for (key, value, range) in [
        ("clients", &table.clients, 1..=128),
        ("rack", &table.rack, 0..=7),
        ("slot", &table.slot, 0..=31),
        ("pdu", &table.pdu, 64..=1024),
        ("idle", &table.idle, 0..=86_400),
    ] {
        if let Some(value) = value {
            keys.insert(key.to_owned(), json!(number::<i64>(f, key, Some(value), range, 0)));
        }
    }
    if let Some(rights) = &table.password_rights {
        keys.insert("password_rights".to_owned(), json!(rights.get_ref()));
    }
    Some(StationLink {
        name: name(f, "link", &table.name),
        listen: listen(f, &table.listen)?,
        kind: kind?,
        rights,
        allowed: allowed.ok()?,
        password: table.password.as_ref().map(|password| password.get_ref().clone()),
        password_rights: unlocked.unwrap_or(rights),
        config: serde_json::Value::Object(keys).to_string(),
    })
}

fn inner(list: &Placed<Vec<String>>) -> &[String] {
    list.get_ref()
}

fn fits(password: &str) -> bool {
    !password.is_empty() && password.len() <= PASSWORD && password.is_ascii()
}

fn listen(f: &mut Findings<'_>, text: &Placed<String>) -> Option<SocketAddr> {
    let address = text.get_ref().to_socket_addrs().ok().and_then(|mut addresses| addresses.next());
    if address.is_none() {
        let message = format!("\"{}\" is no address to listen on", text.get_ref());
        let remedy = "an address and a port: \"127.0.0.1:102\"; \"0.0.0.0:102\" is everybody";
        f.error(VALUE, text.span(), message, remedy);
    }
    address
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::station_file::parse;

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
        assert_eq!((link.listen.to_string().as_str(), link.kind.program()), ("127.0.0.1:102", "ob1-s7"));
        let keys = "rights = \"write\"\npassword = \"secret\"\npassword_rights = \"operate\"\nareas = [\"M\"]\nslot = 3\npdu = 240";
        let parsed = parse(&station(keys), "x.toml", Path::new("")).expect("right");
        let link = &parsed.links[0];
        assert_eq!((link.rights, link.password_rights), (Right::Write, Right::Operate));
        assert_eq!(link.config, r#"{"password_rights":"operate","pdu":240,"slot":3}"#);
        assert!(!link.config.contains("secret"));
    }

    #[test]
    fn what_cannot_be_is_told_at_its_place() {
        for (keys, line, what) in [
            ("rights = \"all\"", 7, "rights cannot be"),
            ("slot = 32", 7, "slot = 32 is out of range"),
            ("pdu = 20", 7, "pdu = 20 is out of range"),
            ("clients = 0", 7, "clients = 0 is out of range"),
            ("areas = [\"X\"]", 7, "\"X\" is no area"),
            ("blocks = [\"10\"]", 7, "names no data blocks"),
            ("password = \"123456789\"\npassword_rights = \"write\"", 7, "cannot be a password"),
            ("password = \"secret\"", 7, "gives no rights"),
            ("password_rights = \"write\"", 7, "no password"),
            ("colour = 1", 7, "unknown key"),
            ("[[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:103\"", 9, "two links with the name"),
            ("[[link]]\ntype = \"s7\"\nname = \"other\"\nlisten = \"127.0.0.1:102\"", 10, "two links listen"),
            ("[[link]]\ntype = \"s8\"\nname = \"other\"\nlisten = \"127.0.0.1:103\"", 8, "type cannot be"),
            ("[[link]]\ntype = \"s7\"\nname = \"other\"\nlisten = \"102\"", 10, "no address to listen on"),
        ] {
            let findings = parse(&station(keys), "x.toml", Path::new("")).expect_err(keys);
            let found = findings.iter().any(|found| found.line == line && found.to_string().contains(what));
            assert!(found, "{keys}: {findings:#?}");
        }
    }
}
