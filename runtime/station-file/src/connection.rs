//! Connections of an Ethernet CP: `[[connection]]`.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs as _};

use ob1_access::settings::{ConnectionType, CpConnection};
use ob1_s7::iso::ISO_PORT;

use super::findings::{CONTRADICTION, Findings, MISSING, TWICE, VALUE};
use super::tables::{ConnectionTable, ModuleTable, Placed};
use super::types::{LinkKind, LinkSettings, ModuleConfig, ModuleKind, StationLink};
use super::values::{choice, number};

/// The kinds of connection.
const TYPES: [(&str, ConnectionType); 4] = [
    ("tcp", ConnectionType::Tcp),
    ("udp", ConnectionType::Udp),
    ("iso-on-tcp", ConnectionType::Iso),
    ("s7", ConnectionType::S7),
];
/// Connections of a CP, at most.
const CONNECTIONS: usize = 16;
/// Longest TSAP, in bytes.
const TSAP: usize = 16;

/// A CP 343: which link it is reached by. Without `link` it is the only one there is.
pub(super) fn module(f: &mut Findings<'_>, table: &ModuleTable) -> Option<ModuleKind> {
    for (key, at) in table.given() {
        if matches!(key, "line" | "params" | "raw" | "bytes" | "abd") {
            let remedy = "leave it out: the [[connection]] tables say what a CP 343 does";
            f.error(CONTRADICTION, at, format!("a CP 343 has no `{key}`"), remedy);
        }
    }
    Some(ModuleKind::Ethernet { link: table.link.as_ref().map(|link| link.get_ref().clone()) })
}

/// Gives each CP 343 its link, and each link the connections of its CP.
pub(super) fn connections(
    f: &mut Findings<'_>,
    tables: &[ConnectionTable],
    names: &[Placed<ModuleTable>],
    modules: &[ModuleConfig],
    links: &mut [StationLink],
) {
    for module in modules {
        let ModuleKind::Ethernet { link } = &module.kind else { continue };
        let table = names.iter().map(Placed::get_ref).find(|table| table.name.get_ref() == &module.name);
        let at = table.map_or(0..0, |table| table.link.as_ref().map_or_else(|| table.kind.span(), Placed::span));
        let mut s7 = links.iter().filter(|link| link.kind == LinkKind::S7);
        let only = s7.next().filter(|_| s7.next().is_none()).map(|link| link.name.clone());
        let wanted = link.clone().or(only);
        let Some(found) =
            links.iter_mut().find(|link| link.kind == LinkKind::S7 && wanted.as_ref() == Some(&link.name))
        else {
            let message = format!("the CP 343 \"{}\" has no link", module.name);
            let remedy = "add [[link]] type = \"s7\" with the address of the CP, and name it: link = \"NAME\"";
            f.error(MISSING, at, message, remedy);
            continue;
        };
        if let Some(other) = &found.cp {
            let message = format!("the link \"{}\" belongs to \"{other}\" already", found.name);
            f.error(TWICE, at, message, "give each CP 343 a link of its own");
            continue;
        }
        found.cp = Some(module.name.clone());
    }
    let mut ids: Vec<u16> = Vec::new();
    for table in tables {
        let Some(connection) = connection(f, table) else { continue };
        let module = table.module.get_ref();
        let Some(link) = links.iter_mut().find(|link| link.cp.as_ref() == Some(module)) else {
            let message = format!("there is no CP 343 with the name \"{module}\"");
            f.error(VALUE, table.module.span(), message, "name a [[module]] with type = \"cp343\"");
            continue;
        };
        if ids.contains(&connection.id) {
            let message = format!("there are two connections with the ID {}", connection.id);
            f.error(TWICE, table.id.span(), message, "an ID is used once in a station: give each its own");
        }
        ids.push(connection.id);
        let is_waiting = |other: &CpConnection| {
            !other.active
                && other.kind == connection.kind
                && other.local == connection.local
                && other.remote == connection.remote
        };
        if !connection.active && connection.kind.has_tsaps() && link.connections().iter().any(is_waiting) {
            let message = "two connections wait for the same TSAPs";
            f.error(TWICE, table.id.span(), message, "give each a `local_tsap` of its own");
        }
        if let LinkSettings::S7(own) = &mut link.settings {
            own.connections.push(connection);
        }
        if link.connections().len() > CONNECTIONS {
            let message = format!("\"{module}\" has more than {CONNECTIONS} connections");
            f.error(VALUE, table.id.span(), message, "add another CP 343, with a link of its own");
        }
    }
}

fn connection(f: &mut Findings<'_>, table: &ConnectionTable) -> Option<CpConnection> {
    let kind = choice(f, "type", Some(&table.kind), &TYPES)?;
    let id = number::<u16>(f, "id", Some(&table.id), 1..=0x0FFF, 1);
    let active = table.active.unwrap_or(false);
    let needs_partner = active || kind == ConnectionType::Udp;
    let partner = match &table.partner {
        Some(text) => Some(partner(f, text, kind, needs_partner)?),
        None if needs_partner => {
            let remedy = "partner = \"192.168.0.2\", with its port for tcp and udp: \"192.168.0.2:2000\"";
            f.error(MISSING, table.id.span(), format!("connection {id} has no partner"), remedy);
            return None;
        }
        None => None,
    };
    let tsap = |f: &mut Findings<'_>, key: &str, given: Option<&Placed<String>>, needed: bool| match given {
        Some(text) if !kind.has_tsaps() => {
            f.error(CONTRADICTION, text.span(), format!("a connection of this type has no `{key}`"), "leave it out");
            None
        }
        Some(text) => {
            let bytes = tsap(text.get_ref());
            if bytes.is_none() {
                let message = format!("\"{}\" is not a TSAP", text.get_ref());
                f.error(
                    VALUE,
                    text.span(),
                    message,
                    "hexadecimal bytes like \"03.02\", or a text of 3 to 16 characters",
                );
            }
            bytes
        }
        None if needed && kind.has_tsaps() => {
            let message = format!("connection {id} has no `{key}`");
            f.error(MISSING, table.id.span(), message, format!("add `{key}`: \"10.01\", or as the partner has it"));
            None
        }
        None => Some(Vec::new()),
    };
    let local = tsap(f, "local_tsap", table.local_tsap.as_ref(), true).unwrap_or_default();
    let remote = tsap(f, "remote_tsap", table.remote_tsap.as_ref(), active).unwrap_or_default();
    let waits = kind == ConnectionType::Tcp && !active || kind == ConnectionType::Udp;
    let port = match &table.local_port {
        Some(port) if waits => Some(number::<u16>(f, "local_port", Some(port), 1..=65_535, 1)),
        Some(port) => {
            let message = "`local_port` is for udp, and for tcp that waits for its partner";
            f.error(CONTRADICTION, port.span(), message, "leave it out");
            None
        }
        None if waits => {
            let message = format!("connection {id} has no `local_port`");
            f.error(MISSING, table.id.span(), message, "add local_port = 2000: where the partner sends to");
            None
        }
        None => None,
    };
    Some(CpConnection { id, kind, active, partner, local, remote, port })
}

/// An address, with a port where the type has no usual one.
fn partner(f: &mut Findings<'_>, text: &Placed<String>, ty: ConnectionType, needs_port: bool) -> Option<SocketAddr> {
    let usual = (ty.has_tsaps() || !needs_port).then_some(ISO_PORT);
    let bare = text.get_ref().parse::<IpAddr>().ok().zip(usual).map(|(ip, port)| SocketAddr::new(ip, port));
    let found = bare.or_else(|| text.get_ref().to_socket_addrs().ok().and_then(|mut found| found.next()));
    if found.is_none() {
        let message = format!("\"{}\" is not a partner", text.get_ref());
        let remedy = "an address: \"192.168.0.2\"; with its port for tcp and udp: \"192.168.0.2:2000\"";
        f.error(VALUE, text.span(), message, remedy);
    }
    found
}

/// `03.02` and `10.01.AB` are bytes; everything else is a text.
fn tsap(text: &str) -> Option<Vec<u8>> {
    let bytes: Option<Vec<u8>> =
        text.split('.').map(|part| (part.len() == 2).then(|| u8::from_str_radix(part, 16).ok()).flatten()).collect();
    let bytes = bytes.or_else(|| (text.len() > 2 && text.is_ascii()).then(|| text.as_bytes().to_vec()))?;
    (1..=TSAP).contains(&bytes.len()).then_some(bytes)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::parse;

    fn station(connection: &str) -> String {
        format!(
            "[station]\nname = \"x\"\n[[link]]\ntype = \"s7\"\nname = \"eth\"\nlisten = \"127.0.0.1:102\"\n\
             [[module]]\ntype = \"cp343\"\nname = \"cp\"\naddress = 256\n[[connection]]\nmodule = \"cp\"\nid = 1\n{connection}\n"
        )
    }

    #[test]
    fn a_connection_is_told_to_the_process_of_its_link() {
        let text = station(
            "type = \"s7\"\nactive = true\npartner = \"10.0.0.2\"\nlocal_tsap = \"10.01\"\nremote_tsap = \"03.02\"",
        );
        let parsed = parse(&text, "x.toml", Path::new("")).expect("right");
        let [link] = &parsed.links[..] else { panic!("{:?}", parsed.links) };
        assert_eq!(link.cp.as_deref(), Some("cp"));
        let partner = Some("10.0.0.2:102".parse().expect("an address"));
        let (kind, local, remote) = (ConnectionType::S7, vec![16, 1], vec![3, 2]);
        let wanted = CpConnection { id: 1, kind, active: true, partner, local, remote, port: None };
        assert_eq!(link.connections(), [wanted]);
        let text = station("type = \"tcp\"\nlocal_port = 2000");
        let link = &parse(&text, "x.toml", Path::new("")).expect("right").links[0];
        assert_eq!(link.connections()[0].port, Some(2000));
        assert_eq!((tsap("SIMATIC"), tsap("X"), tsap("1.2")), (Some(b"SIMATIC".to_vec()), None, Some(b"1.2".to_vec())));
    }

    #[test]
    fn what_cannot_be_is_told_at_its_place() {
        for (connection, line, what) in [
            ("type = \"s8\"", 14, "type cannot be"),
            ("type = \"s7\"\nactive = true\nlocal_tsap = \"10.01\"\nremote_tsap = \"03.02\"", 13, "no partner"),
            ("type = \"s7\"\nactive = true\npartner = \"10.0.0.2\"\nlocal_tsap = \"10.01\"", 13, "no `remote_tsap`"),
            ("type = \"s7\"", 13, "no `local_tsap`"),
            ("type = \"s7\"\nlocal_tsap = \"1\"", 15, "is not a TSAP"),
            ("type = \"tcp\"\nlocal_tsap = \"10.01\"\nlocal_port = 2000", 15, "has no `local_tsap`"),
            ("type = \"tcp\"", 13, "no `local_port`"),
            ("type = \"tcp\"\nactive = true\npartner = \"10.0.0.2:2000\"\nlocal_port = 7", 17, "`local_port` is for"),
            ("type = \"udp\"\nlocal_port = 2000", 13, "no partner"),
            ("type = \"udp\"\nlocal_port = 2000\npartner = \"10.0.0.2\"", 16, "is not a partner"),
            (
                "type = \"tcp\"\nlocal_port = 2000\n[[connection]]\nmodule = \"cp\"\nid = 1\ntype = \"tcp\"\nlocal_port = 2001",
                18,
                "two connections with the ID",
            ),
            (
                "type = \"tcp\"\nlocal_port = 2000\n[[connection]]\nmodule = \"no\"\nid = 2\ntype = \"tcp\"\nlocal_port = 2001",
                17,
                "no CP 343",
            ),
            (
                "type = \"tcp\"\nlocal_port = 2000\n[[module]]\ntype = \"cp343\"\nname = \"b\"\naddress = 272",
                17,
                "belongs to",
            ),
            (
                "type = \"tcp\"\nlocal_port = 2000\n[[module]]\ntype = \"cp343\"\nname = \"b\"\naddress = 272\nlink = \"x\"",
                20,
                "has no link",
            ),
        ] {
            let findings = parse(&station(connection), "x.toml", Path::new("")).expect_err(connection);
            let found = findings.iter().any(|found| found.line == line && found.to_string().contains(what));
            assert!(found, "{connection}: {findings:#?}");
        }
    }
}
