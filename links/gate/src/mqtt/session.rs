//! The work of a link: it reads its values, publishes changes, and keeps them until they have arrived.

use std::future::pending;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::shared::{Station, Trouble, unix_now};
use ob1_access::door::Reading;
use ob1_access::settings::MqttSettings;
use ob1_access::{Datum, Names};
use rumqttc::{Event, LastWill, Outgoing, Packet, Publish, QoS};
use serde_json::{Value, json};
use tokio::time::{Instant, sleep_until};

use crate::mqtt::alarms::Alarms;
use crate::mqtt::commands::Commands;
use crate::mqtt::connection::Connection;
use crate::mqtt::flow::Flow;
use crate::mqtt::items::{Items, topic};
use crate::mqtt::node::{self, Node};
use crate::mqtt::sparkplug::{Metric, Payload, REBIRTH};
use crate::mqtt::store::{Record, Store};
use crate::mqtt::tls::Tls;
use crate::mqtt::topics::{self, ONLINE};

/// Time to the next connection attempt, at first and at most.
const FIRST_TRY: Duration = Duration::from_millis(250);
const LAST_TRY: Duration = Duration::from_secs(30);
/// Maximum of metrics per Sparkplug message.
const METRICS: usize = 200;
/// Messages of old values sent before other work gets its turn.
const AT_ONCE: usize = 20;
/// Time limit for the last message when the station ends.
const FAREWELL: Duration = Duration::from_secs(1);

/// See [the module](self).
pub(crate) struct Session {
    station: Station,
    settings: MqttSettings,
    tls: Option<Tls>,
    items: Items,
    store: Store,
    node: Option<Node>,
    commands: Option<Commands>,
    alarms: Option<Alarms>,
    /// False until the first reading: before it there is nothing for a birth.
    looked: bool,
    /// Scan number of the newest reading.
    scan: u64,
    /// Values published since the start of the link.
    number: u64,
    connection: Option<Connection>,
    /// The broker has accepted us.
    online: bool,
    /// The broker is to get all values again, once everything older has been sent.
    again: bool,
    try_at: Instant,
    wait: Duration,
    flow: Flow,
    /// For Sparkplug, which has no acknowledgement: records sent, and how many of them before the pending ping. Records
    /// sent before an answered ping have arrived, because the broker works in order.
    sent: usize,
    sent_before_ping: usize,
}

impl Session {
    pub(crate) fn new(
        station: Station,
        settings: MqttSettings,
        tls: Option<Tls>,
        names: &Names,
        items: Items,
        store: Store,
        state: &Path,
    ) -> Result<Self, String> {
        let node = settings.sparkplug.as_ref().map(|(group, node)| Node::open(group, node, state));
        let address = format!("{}:{}", settings.host, settings.port);
        let commands = match settings.commands.as_slice() {
            [] => None,
            wanted => Some(Commands::of(wanted, names, &settings.allowed, &station, &address)?),
        };
        let alarms = settings.alarms.then(|| Alarms::watch(station.clone(), settings.every));
        Ok(Self {
            alarms,
            looked: items.list.is_empty(),
            scan: 0,
            number: 0,
            station,
            settings,
            tls,
            items,
            store,
            node,
            commands,
            connection: None,
            online: false,
            again: false,
            try_at: Instant::now(),
            wait: FIRST_TRY,
            flow: Flow::default(),
            sent: 0,
            sent_before_ping: 0,
        })
    }

    /// Runs until the station is gone.
    pub(crate) async fn run(mut self) -> Trouble {
        let mut watch = self.station.watch(self.items.pieces.clone(), self.settings.every);
        let trouble = loop {
            let connecting = self.connection.is_some();
            tokio::select! {
                newest = watch.next() => match newest {
                    Ok(reading) => self.look(&reading),
                    Err(trouble @ Trouble::Gone) => break trouble,
                    // The check of the settings has reported this once; here another part of the gate has used up the
                    // room.
                    Err(trouble) => tracing::warn!(link = %self.name(), "{trouble}"),
                },
                alarms = Alarms::next(self.alarms.as_mut()) => self.keep(alarms),
                event = happened(self.connection.as_mut()) => match event {
                    Ok(event) => self.happened(event),
                    Err(why) => self.broken(&why),
                },
                () = sleep_until(self.try_at), if !connecting && self.looked => self.begin(),
            }
            self.send();
        };
        self.end().await;
        trouble
    }

    fn name(&self) -> String {
        self.station.welcome().link.clone()
    }

    fn topic(&self, rest: &str) -> String {
        format!("{}/{rest}", self.settings.prefix)
    }

    fn begin(&mut self) {
        let will = match &mut self.node {
            Some(node) => {
                let death = node.next_death().encode();
                LastWill::new(node.topic("NDEATH"), death, QoS::AtLeastOnce, false)
            }
            None => LastWill::new(self.topic(ONLINE), "false", QoS::AtLeastOnce, true),
        };
        let (transport, trouble) = self.tls.as_mut().map(Tls::again).unzip();
        if let Some(why) = trouble.flatten() {
            tracing::warn!(link = %self.name(), "{why}; the files read before stay valid");
        }
        match Connection::begin(&self.settings, transport, will) {
            Ok(connection) => self.connection = Some(connection),
            Err(why) => self.broken(&why),
        }
    }

    /// The connection is lost: records that have not arrived are sent again over the next one.
    fn broken(&mut self, why: &str) {
        let waits = self.wait;
        tracing::warn!(link = %self.name(), "broker {}: {why}; next try in {waits:?}", self.settings.host);
        (self.connection, self.online) = (None, false);
        self.flow = Flow::default();
        (self.sent, self.sent_before_ping) = (0, 0);
        self.try_at = Instant::now() + self.wait;
        self.wait = (self.wait * 2).min(LAST_TRY);
    }

    fn happened(&mut self, event: Event) {
        match event {
            Event::Incoming(Packet::ConnAck(_)) => self.welcomed(),
            Event::Incoming(Packet::PubAck(ack)) => {
                let arrived = self.flow.acknowledged(ack.pkid);
                self.store.arrived(arrived);
                if arrived > 0 {
                    self.wait = FIRST_TRY;
                }
            }
            // Packet 0: QoS 0, which is never acknowledged.
            Event::Outgoing(Outgoing::Publish(packet)) if packet != 0 => self.flow.sent(packet),
            Event::Outgoing(Outgoing::PingReq) => self.sent_before_ping = self.sent,
            Event::Incoming(Packet::PingResp) => {
                self.wait = FIRST_TRY;
                if self.node.is_some() {
                    let arrived = std::mem::take(&mut self.sent_before_ping);
                    self.store.arrived(arrived);
                    self.sent -= arrived.min(self.sent);
                }
            }
            Event::Incoming(Packet::Publish(publish)) => self.command(&publish),
            _ => {}
        }
    }

    /// The broker has accepted us.
    fn welcomed(&mut self) {
        tracing::info!(link = %self.name(), "connected to broker {}", self.settings.host);
        // The wait before the next try stays long until a value has arrived or a ping was answered: a broker may accept
        // us and drop us at the first value.
        self.online = true;
        let Some(connection) = &self.connection else { return };
        let client = connection.client.clone();
        if let Some(node) = &self.node {
            // A host may ask for a new birth, whether there are commands or not.
            let _ = client.try_subscribe(node.topic("NCMD"), QoS::AtLeastOnce);
            self.birth();
            return;
        }
        for name in self.commands.iter().flat_map(Commands::names) {
            let _ = client.try_subscribe(self.topic(&format!("{name}/set")), QoS::AtLeastOnce);
        }
        self.flow.asked(false);
        let _ = client.try_publish(self.topic(ONLINE), QoS::AtLeastOnce, true, "true");
        // A broker that has lost its retained messages gets them again.
        self.again = self.settings.retain;
    }

    /// All values once more. Only when everything older has been sent: a connection that breaks again and again must
    /// not fill the store with copies.
    fn tell_again(&mut self) {
        let now = unix_now();
        for index in 0..self.items.list.len() {
            let value = self.items.list[index].value();
            self.told(index, value.as_ref(), now, self.scan);
        }
        if let Some(alarms) = self.alarms.as_ref().and_then(Alarms::last) {
            self.keep(alarms);
        }
    }

    fn birth(&mut self) {
        if let (Some(node), Some(connection)) = (&mut self.node, &self.connection) {
            let payload = node.birth(&self.items.list).encode();
            let _ = connection.client.try_publish(node.topic("NBIRTH"), QoS::AtMostOnce, false, payload);
        }
    }

    /// A snapshot has come.
    fn look(&mut self, reading: &Arc<Reading>) {
        let first = !std::mem::replace(&mut self.looked, true);
        let (now, scan) = (unix_now(), reading.scan);
        self.scan = scan;
        let changes = self.items.changes(reading);
        if self.node.is_none() {
            for (index, value) in changes {
                self.told(index, value.as_ref(), now, scan);
            }
            return;
        }
        // The first values are those of the birth.
        if first {
            return;
        }
        // If nothing older waits they are published at once; in any case they are kept until they are known to have
        // arrived.
        let live = self.online && self.store.in_memory() && self.waiting() == self.sent;
        for (index, value) in &changes {
            let metric = node::historical(&self.items.list[*index], value.as_ref(), now);
            self.keep(Record { topic: String::new(), payload: metric.encode() });
        }
        if live && self.tell(&changes, now) {
            self.sent = self.waiting();
        }
    }

    /// Publishes current values; false when there is no room in the queue.
    fn tell(&mut self, changes: &[(usize, Option<Datum>)], now: u64) -> bool {
        let (Some(node), Some(connection)) = (&mut self.node, &self.connection) else { return false };
        for changes in changes.chunks(METRICS) {
            let metrics = changes
                .iter()
                .map(|(index, value)| node::live(*index, &self.items.list[*index], value.as_ref(), now))
                .collect();
            let payload = node.data(metrics).encode();
            if connection.client.try_publish(node.topic("NDATA"), QoS::AtMostOnce, false, payload).is_err() {
                node.not_sent();
                return false;
            }
        }
        true
    }

    /// A value on a plain topic.
    fn told(&mut self, index: usize, value: Option<&Datum>, now: u64, scan: u64) {
        self.number += 1;
        let record = topics::record(&self.items.list[index], value, now, scan, self.number);
        self.keep(record);
    }

    fn waiting(&mut self) -> usize {
        self.store.ready().map_or(0, std::collections::VecDeque::len)
    }

    fn keep(&mut self, record: Record) {
        if let Err(error) = self.store.push(record) {
            tracing::error!(link = %self.name(), "the store cannot be written: {error}; a value is lost");
        }
        match self.store.take_lost() {
            0 => {}
            lost => tracing::warn!(link = %self.name(), "the store is full: {lost} values are lost"),
        }
    }

    /// Sends waiting records, as far as there is room.
    fn send(&mut self) {
        if !self.online {
            return;
        }
        let Some(connection) = &self.connection else { return };
        let ready = match self.store.ready() {
            Ok(ready) => ready,
            Err(error) => {
                tracing::error!("the store cannot be read: {error}");
                return;
            }
        };
        if let Some(node) = &mut self.node {
            for _ in 0..AT_ONCE {
                let (mut old, mut unknown) = (Vec::new(), 0);
                for record in ready.range(self.sent.min(ready.len())..).take(METRICS) {
                    match Metric::decode(&record.payload).and_then(|metric| node.known(metric)) {
                        Some(metric) => old.push(metric),
                        None => unknown += 1,
                    }
                }
                let count = old.len() + unknown;
                if count == 0 {
                    return;
                }
                if !old.is_empty() {
                    let payload = node.data(old).encode();
                    if connection.client.try_publish(node.topic("NDATA"), QoS::AtMostOnce, false, payload).is_err() {
                        node.not_sent();
                        return;
                    }
                }
                if unknown > 0 {
                    let link = &self.station.welcome().link;
                    tracing::warn!(%link, "{unknown} old values are dropped: their names or types have changed");
                }
                self.sent += count;
            }
            return;
        }
        while self.flow.has_room() {
            let Some(record) = ready.get(self.flow.stored()) else {
                if std::mem::take(&mut self.again) {
                    self.tell_again();
                    self.send();
                }
                return;
            };
            let topic = format!("{}/{}", self.settings.prefix, record.topic);
            let asked =
                connection.client.try_publish(topic, QoS::AtLeastOnce, self.settings.retain, record.payload.clone());
            if asked.is_err() {
                return;
            }
            self.flow.asked(true);
        }
    }

    /// A command has come: a value to write, or the request for a birth.
    fn command(&mut self, publish: &Publish) {
        // A command from before the connection is outdated.
        if publish.retain {
            tracing::warn!(link = %self.name(), "a retained command on {} is ignored", publish.topic);
            return;
        }
        let Some(node) = &self.node else {
            let name = publish.topic.strip_prefix(&self.settings.prefix).and_then(|rest| rest.strip_prefix('/'));
            let Some(name) = name.and_then(|rest| rest.strip_suffix("/set")) else { return };
            let value = serde_json::from_slice(&publish.payload);
            self.write(name.to_owned(), value.map_err(|error| format!("this is not JSON: {error}")));
            return;
        };
        if publish.topic != node.topic("NCMD") {
            return;
        }
        let Some(payload) = Payload::decode(&publish.payload) else {
            tracing::warn!(link = %self.name(), "a command is not a payload of Sparkplug B");
            return;
        };
        let mut born = false;
        for metric in payload.metrics {
            if metric.name.as_deref() == Some(REBIRTH) {
                // Once, however often a message asks for it.
                if metric.is_true() && !std::mem::replace(&mut born, true) {
                    self.birth();
                }
                continue;
            }
            let by_alias = metric.alias.and_then(|alias| self.items.list.get((alias as usize).checked_sub(1)?));
            let name = metric.name.clone().or_else(|| by_alias.map(|item| item.name.clone()));
            if let (Some(name), Some(value)) = (name, &metric.value) {
                let name = topic(&name);
                // A host need not send the data type: the birth has told it.
                let kind = match (metric.datatype, &self.commands) {
                    (0, Some(commands)) => commands.kind(&name),
                    (given, _) => given,
                };
                self.write(name, Ok(value.json(kind)));
            }
        }
    }

    /// Writes in a separate task, and publishes the outcome on a plain topic.
    fn write(&self, name: String, value: Result<Value, String>) {
        let (Some(commands), Some(connection)) = (self.commands.clone(), &self.connection) else { return };
        let client = connection.client.clone();
        let answer = self.node.is_none().then(|| self.topic(&format!("{name}/result")));
        let link = self.name();
        tokio::spawn(async move {
            let outcome = match value {
                Ok(value) => commands.write(&name, &value).await,
                Err(why) => Err(why),
            };
            let told = match &outcome {
                Ok(scan) => json!({ "ok": true, "scan": scan }),
                Err(why) => {
                    tracing::warn!(link, "command {name}: {why}");
                    json!({ "ok": false, "error": why })
                }
            };
            if let Some(topic) = answer {
                let _ = client.try_publish(topic, QoS::AtMostOnce, false, told.to_string());
            }
        });
    }

    /// Sends the last message, and stores waiting records on disk.
    async fn end(&mut self) {
        let last = match &self.node {
            Some(node) => (node.topic("NDEATH"), node.death().encode(), false),
            None => (self.topic(ONLINE), b"false".to_vec(), true),
        };
        if let Some(connection) = self.connection.as_mut().filter(|_| self.online) {
            let (topic, payload, retain) = last;
            let _ = connection.client.try_publish(topic, QoS::AtLeastOnce, retain, payload);
            let _ = connection.client.try_disconnect();
            let farewell = async {
                while let Ok(event) = connection.next().await {
                    match event {
                        Event::Outgoing(Outgoing::Publish(packet)) if packet != 0 => self.flow.sent(packet),
                        Event::Incoming(Packet::PubAck(ack)) => self.store.arrived(self.flow.acknowledged(ack.pkid)),
                        Event::Outgoing(Outgoing::Disconnect) => return,
                        _ => {}
                    }
                }
            };
            let _ = tokio::time::timeout(FAREWELL, farewell).await;
        }
        if let Err(error) = self.store.close() {
            tracing::error!(link = %self.name(), "waiting values cannot be kept: {error}");
        }
    }
}

/// The next event of a connection; without one it never returns.
async fn happened(connection: Option<&mut Connection>) -> Result<Event, String> {
    match connection {
        Some(connection) => connection.next().await,
        None => pending().await,
    }
}
