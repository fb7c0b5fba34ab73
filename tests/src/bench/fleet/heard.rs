//! What a subscriber at the broker has heard: every message of every station, in its order.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use rumqttc::{Client, Event, MqttOptions, Packet, Publish, QoS};
use serde_json::Value;

use super::super::peer::Failure;

/// Topics begin with it, before hall and rack.
pub(super) const PREFIX: &str = "plant";
/// The values that are compared with those of the CPU.
pub(super) const COMPARED: [&str; 2] = ["DB10.parts", "DB10.level"];

/// One kind of telegrams, of all stations.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Kind {
    pub(super) messages: u64,
    pub(super) payload: u64,
    /// With the heads of MQTT.
    pub(super) bytes: u64,
    /// Births, or words that the link is up; deaths, or words that it is not.
    pub(super) came: u64,
    pub(super) went: u64,
    /// Gaps in what a station counts.
    pub(super) lost: u64,
    /// Counted twice.
    pub(super) again: u64,
}

/// What one station has said last, by one kind of telegrams.
#[derive(Debug, Default)]
struct Said {
    /// The number of its last value, or what its next message should be numbered.
    number: u64,
    /// Sparkplug: which of the compared values an alias is.
    aliases: BTreeMap<u64, usize>,
    values: [Option<i64>; COMPARED.len()],
}

/// See [the module](self).
#[derive(Debug, Default)]
pub(super) struct Heard {
    pub(super) plain: Kind,
    pub(super) sparkplug: Kind,
    /// The broker's own figures, by the end of their topic.
    pub(super) broker: BTreeMap<String, u64>,
    /// Of each station by its plain topics, and by Sparkplug.
    stations: BTreeMap<String, [Said; 2]>,
}

impl Heard {
    /// Whether these were the last values of a station, by both kinds of telegrams.
    pub(super) fn is_last(&self, station: &str, values: [i64; COMPARED.len()]) -> bool {
        let wanted = values.map(Some);
        self.stations.get(station).is_some_and(|said| said.iter().all(|said| said.values == wanted))
    }

    fn take(&mut self, message: &Publish) {
        if let Some(name) = message.topic.strip_prefix("$SYS/broker/") {
            if let Some(number) = std::str::from_utf8(&message.payload).ok().and_then(|text| text.parse().ok()) {
                self.broker.insert(name.to_owned(), number);
            }
            return;
        }
        let words: Vec<&str> = message.topic.split('/').collect();
        match words[..] {
            [PREFIX, hall, rack, name] => {
                self.plain.count(message);
                let [said, _] = self.stations.entry(format!("{hall}-{rack}")).or_default();
                said.plain(name, &message.payload, &mut self.plain);
            }
            ["spBv1.0", hall, kind, rack] => {
                self.sparkplug.count(message);
                let [_, said] = self.stations.entry(format!("{hall}-{rack}")).or_default();
                said.sparkplug(kind, &message.payload, &mut self.sparkplug);
            }
            _ => {}
        }
    }
}

impl Kind {
    fn count(&mut self, message: &Publish) {
        self.messages += 1;
        self.payload += message.payload.len() as u64;
        let numbered = if message.qos == QoS::AtMostOnce { 0 } else { 2 };
        let length = 2 + message.topic.len() + numbered + message.payload.len();
        // The length takes a byte for each seven bits.
        let head = 1 + (usize::BITS - length.leading_zeros()).div_ceil(7).max(1) as usize;
        self.bytes += (head + length) as u64;
    }
}

impl Said {
    fn plain(&mut self, name: &str, payload: &[u8], kind: &mut Kind) {
        let said = serde_json::from_slice(payload).unwrap_or_default();
        match said {
            Value::Bool(true) => kind.came += 1,
            Value::Bool(false) => kind.went += 1,
            said => {
                let Some(number) = said["number"].as_u64() else { return };
                kind.again += u64::from(number <= self.number);
                kind.lost += number.saturating_sub(self.number + 1);
                self.number = self.number.max(number);
                if let Some(index) = COMPARED.iter().position(|compared| *compared == name) {
                    self.values[index] = said["value"].as_i64();
                }
            }
        }
    }

    fn sparkplug(&mut self, what: &str, payload: &[u8], kind: &mut Kind) {
        match what {
            "NBIRTH" => (kind.came, self.number) = (kind.came + 1, 0),
            "NDATA" => {}
            _ => {
                kind.went += u64::from(what == "NDEATH");
                return;
            }
        }
        for field in fields(payload) {
            match field {
                (2, Field::Bytes(metric)) => self.metric(metric),
                (3, Field::Number(number)) => {
                    kind.lost += u64::from((number as u8).wrapping_sub(self.number as u8));
                    self.number = number + 1;
                }
                _ => {}
            }
        }
    }

    /// A metric: name 1, alias 2, value of up to 32 bits 10.
    fn metric(&mut self, metric: &[u8]) {
        let (mut named, mut alias, mut value) = (None, None, None);
        for field in fields(metric) {
            match field {
                (1, Field::Bytes(name)) => named = COMPARED.iter().position(|compared| compared.as_bytes() == name),
                (2, Field::Number(number)) => alias = Some(number),
                (10, Field::Number(number)) => value = Some(number as i64),
                _ => {}
            }
        }
        if let (Some(index), Some(alias)) = (named, alias) {
            self.aliases.insert(alias, index);
        }
        if let Some(index) = alias.and_then(|alias| self.aliases.get(&alias)) {
            self.values[*index] = value;
        }
    }
}

/// A field of a protocol buffer.
enum Field<'b> {
    Number(u64),
    Bytes(&'b [u8]),
}

/// The fields of a message with their numbers, as far as it can be read.
fn fields(mut bytes: &[u8]) -> impl Iterator<Item = (u64, Field<'_>)> {
    std::iter::from_fn(move || {
        let key = varint(&mut bytes)?;
        let len = match key & 7 {
            0 => return Some((key >> 3, Field::Number(varint(&mut bytes)?))),
            1 => 8,
            2 => varint(&mut bytes)? as usize,
            _ => 4,
        };
        let (field, rest) = bytes.split_at_checked(len)?;
        bytes = rest;
        Some((key >> 3, Field::Bytes(field)))
    })
}

fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

/// A client of the broker that subscribes to everything.
pub(super) struct Subscriber {
    client: Client,
    heard: Arc<Mutex<Heard>>,
}

impl Subscriber {
    /// Subscribes; a station that comes later is heard from its first message on.
    pub(super) fn start(port: u16) -> Result<Self, Failure> {
        let mut options = MqttOptions::new("ob1-bench-fleet", "127.0.0.1", port);
        options.set_keep_alive(Duration::from_secs(30)).set_max_packet_size(8 << 20, 8 << 20);
        let (client, mut connection) = Client::new(options, 16);
        for topic in [&format!("{PREFIX}/#"), "spBv1.0/#", "$SYS/broker/#"] {
            client.subscribe(topic, QoS::AtLeastOnce)?;
        }
        let heard = Arc::<Mutex<Heard>>::default();
        let (to, subscribed) = std::sync::mpsc::channel();
        let all = Arc::clone(&heard);
        std::thread::spawn(move || {
            for event in connection.iter() {
                match event {
                    Ok(Event::Incoming(Packet::Publish(message))) => {
                        all.lock().unwrap_or_else(PoisonError::into_inner).take(&message);
                    }
                    Ok(Event::Incoming(Packet::SubAck(_))) => drop(to.send(())),
                    Ok(_) => {}
                    // It would hear less than all after another connection.
                    Err(_) => return,
                }
            }
        });
        for _ in 0..3 {
            subscribed.recv_timeout(Duration::from_secs(10)).map_err(|_| "mosquitto takes no subscription")?;
        }
        Ok(Self { client, heard })
    }

    /// Looks at what has been heard.
    pub(super) fn heard<T>(&self, look: impl FnOnce(&Heard) -> T) -> T {
        look(&self.heard.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Subscriber {
    fn drop(&mut self) {
        let _ = self.client.disconnect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(messages: &[(&str, &[u8])]) -> Heard {
        let mut heard = Heard::default();
        for (topic, payload) in messages {
            heard.take(&Publish::new(*topic, QoS::AtMostOnce, payload.to_vec()));
        }
        heard
    }

    #[test]
    fn a_gap_is_a_loss_and_the_last_values_are_known() {
        let topic = "plant/hall1/rack7/DB10.parts";
        let all = [
            ("plant/hall1/rack7/online", &b"true"[..]),
            (topic, br#"{"value": 5, "number": 1}"#),
            ("plant/hall1/rack7/DB10.level", br#"{"value": -3, "number": 2}"#),
            (topic, br#"{"value": 6, "number": 2}"#),
            (topic, br#"{"value": 8, "number": 5}"#),
        ];
        let said = heard(&all).plain;
        assert_eq!((said.messages, said.came, said.lost, said.again), (5, 1, 2, 1));
        // The head has two bytes, the topic 2 and its own, the payload follows.
        assert_eq!(heard(&all[..1]).plain.bytes, 2 + 2 + 24 + 4);
        assert!(!heard(&all).is_last("hall1-rack7", [8, -3]), "nothing came by Sparkplug");
    }

    #[test]
    fn sparkplug_is_followed_by_its_sequence_and_aliases() {
        // Metrics `DB10.parts` with alias 1 and value 5, and alias 2; sequence 0; then alias 1 with value 6.
        let birth = b"\x12\x10\x0A\x0ADB10.parts\x10\x01\x50\x05\x12\x10\x0A\x0ADB10.level\x10\x02\x50\x07\x18\x00";
        let data = |seq: u8| [0x12, 4, 0x10, 1, 0x50, 6, 0x18, seq];
        let (born, told) = ("spBv1.0/hall1/NBIRTH/rack7", "spBv1.0/hall1/NDATA/rack7");
        let mut all = vec![(born, birth.to_vec()), (told, data(1).to_vec()), (told, data(2).to_vec())];
        let told =
            |all: &[(&str, Vec<u8>)]| heard(&all.iter().map(|(topic, bytes)| (*topic, &bytes[..])).collect::<Vec<_>>());
        assert_eq!((told(&all).sparkplug.came, told(&all).sparkplug.lost), (1, 0));
        let [_, said] = &told(&all).stations["hall1-rack7"];
        assert_eq!(said.values, [Some(6), Some(7)]);
        all.remove(1);
        assert_eq!(told(&all).sparkplug.lost, 1);
    }
}
