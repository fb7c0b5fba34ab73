//! What the station tells the process, as the protocol machines take it.

use std::time::Duration;

use ob1_access::Right;
use ob1_access::door::Welcome;
use ob1_access::settings::{ConnectionType, CpConnection, S7Settings};
use ob1_s7::Rights;
use ob1_s7::coupling::{ConnectionKind, Spec};
use ob1_s7::iso::{Place, Tsap};
use ob1_s7::server::Settings;

/// Default limit of concurrent connections.
const CLIENTS: u16 = 16;
/// Default slot of the CPU: its position in an S7-300.
const SLOT: u8 = 2;

/// A connection of a CP 343 for the machine.
#[must_use]
pub fn spec(told: &CpConnection) -> Spec {
    let tsap = |bytes: &[u8]| Tsap::new(bytes).unwrap_or_default();
    let kind = match told.kind {
        ConnectionType::Tcp => ConnectionKind::Tcp,
        ConnectionType::Udp => ConnectionKind::Udp,
        ConnectionType::Iso => ConnectionKind::Iso,
        ConnectionType::S7 => ConnectionKind::S7,
    };
    Spec { id: told.id, kind, active: told.active, local: tsap(&told.local), remote: tsap(&told.remote) }
}

/// The configuration of the process.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// The position of the CPU.
    pub place: Place,
    /// Rights and limits of its connections.
    pub settings: Settings,
    /// The rights of a connection after its password.
    pub unlocked: Rights,
    /// Connections that may be served at the same time.
    pub clients: usize,
    /// A connection that is silent for this long, and waits for nothing, is closed.
    pub idle: Option<Duration>,
    /// The last socket handed over is that of the tap.
    pub tap: bool,
}

impl Config {
    /// From the broker's first message.
    ///
    /// # Errors
    /// The station is of another version.
    pub fn of(welcome: &Welcome) -> Result<(Self, Vec<CpConnection>), serde_json::Error> {
        let told: S7Settings = serde_json::from_str(&welcome.config)?;
        let (unlocked, clients, usual) = (told.password_rights, told.clients.unwrap_or(CLIENTS), Settings::default());
        let settings = Settings {
            pdu: told.pdu.unwrap_or(usual.pdu),
            rights: rights(welcome.rights),
            has_password: unlocked.is_some(),
            connections: clients,
            is_400: welcome.family == 400,
            ..usual
        };
        let config = Self {
            place: Place { rack: told.rack.unwrap_or(0), slot: told.slot.unwrap_or(SLOT) },
            settings,
            unlocked: unlocked.map_or(settings.rights, rights),
            clients: clients.into(),
            tap: told.tap,
            idle: told.idle.filter(|idle| *idle > 0).map(|idle| Duration::from_secs(idle.into())),
        };
        Ok((config, told.connections))
    }
}

fn rights(right: Right) -> Rights {
    match right {
        Right::Read => Rights::Read,
        Right::Write => Rights::Write,
        Right::Operate => Rights::Operate,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_told_has_its_usual_value() {
        let of = |told: &S7Settings| {
            let welcome = Welcome { config: serde_json::to_string(told).expect("JSON"), ..Welcome::default() };
            Config::of(&welcome).expect("settings").0
        };
        let usual = of(&S7Settings::default());
        let place = |config: &Config| (config.place.rack, config.place.slot);
        assert_eq!((place(&usual), usual.settings.pdu, usual.clients, usual.idle), ((0, 2), 960, 16, None));
        let (rack, slot, pdu, clients, idle) = (Some(1), Some(3), Some(240), Some(4), Some(60));
        let password_rights = Some(Right::Operate);
        let all = S7Settings { rack, slot, pdu, clients, idle, password_rights, ..S7Settings::default() };
        let all = of(&all);
        assert_eq!((place(&all), all.settings.pdu, all.clients), ((1, 3), 240, 4));
        assert_eq!((all.idle, all.unlocked), (Some(Duration::from_secs(60)), Rights::Operate));
    }
}
