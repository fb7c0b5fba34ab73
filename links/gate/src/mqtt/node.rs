//! The edge node of Sparkplug B: its topics, its births and deaths, and the sequence of its data.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use ob1_access::Datum;

use crate::mqtt::items::Item;
use crate::mqtt::sparkplug::{BD_SEQ, Metric, Payload, REBIRTH, Value, kind, kind_of};

/// See [the module](self).
#[derive(Debug)]
pub(crate) struct Node {
    group: String,
    name: String,
    /// Counts connections; it links a death to its birth.
    bd_seq: u8,
    /// Sequence number of the next data message; a birth is 0.
    seq: u8,
    /// Alias and data type of each metric of the last birth.
    born: BTreeMap<String, (u64, u32)>,
    path: PathBuf,
}

impl Node {
    /// The node of a group; the number of its last connection is in a file. The first one is 0 [Sparkplug 3.0,
    /// tck-id-topics-nbirth-bdseq-increment].
    pub(crate) fn open(group: &str, name: &str, state: &Path) -> Self {
        let path = state.join("bdseq");
        let before = fs::read_to_string(&path).ok().and_then(|text| text.trim().parse::<u8>().ok());
        let (group, name, born) = (group.to_owned(), name.to_owned(), BTreeMap::new());
        Self { group, name, bd_seq: before.unwrap_or(u8::MAX), seq: 0, born, path }
    }

    /// The topic of a kind of message.
    pub(crate) fn topic(&self, kind: &str) -> String {
        format!("spBv1.0/{}/{kind}/{}", self.group, self.name)
    }

    /// Before each connection: its death, which the broker is to publish.
    pub(crate) fn next_death(&mut self) -> Payload {
        self.bd_seq = self.bd_seq.wrapping_add(1);
        // Without a disk the number restarts with the next start; then a death may match the wrong birth.
        if let Err(error) = fs::write(&self.path, self.bd_seq.to_string()) {
            tracing::warn!("{}: {error}", self.path.display());
        }
        self.death()
    }

    /// The death that belongs to the last birth.
    pub(crate) fn death(&self) -> Payload {
        Payload { timestamp: crate::shared::unix_now(), metrics: vec![self.bd_seq()], seq: None }
    }

    fn bd_seq(&self) -> Metric {
        Metric {
            name: Some(BD_SEQ.into()),
            timestamp: crate::shared::unix_now(),
            datatype: kind::UINT64,
            value: Some(Value::Long(self.bd_seq.into())),
            ..Metric::default()
        }
    }

    /// All metrics with their names, aliases and values.
    pub(crate) fn birth(&mut self, items: &[Item]) -> Payload {
        let now = crate::shared::unix_now();
        let rebirth = Metric {
            name: Some(REBIRTH.into()),
            timestamp: now,
            datatype: kind::BOOLEAN,
            value: Some(Value::Boolean(false)),
            ..Metric::default()
        };
        let mut metrics = vec![self.bd_seq(), rebirth];
        metrics.extend(items.iter().enumerate().map(|(index, item)| Metric {
            name: Some(item.name.clone()),
            alias: Some(alias(index)),
            ..metric(item, item.value().as_ref(), now)
        }));
        let born = |(index, item): (usize, &Item)| (item.name.clone(), (alias(index), kind_of(&item.typed.ty)));
        self.born = items.iter().enumerate().map(born).collect();
        self.seq = 1;
        Payload { timestamp: now, metrics, seq: Some(0) }
    }

    /// A message with these metrics.
    pub(crate) fn data(&mut self, metrics: Vec<Metric>) -> Payload {
        let seq = self.seq;
        self.seq = seq.wrapping_add(1);
        Payload { timestamp: crate::shared::unix_now(), metrics, seq: Some(seq) }
    }

    /// The last message was not sent: the next one has its number.
    pub(crate) fn not_sent(&mut self) {
        self.seq = self.seq.wrapping_sub(1);
    }

    /// An old value for the last birth, by its alias: names stand in births alone [Sparkplug 3.0,
    /// tck-id-payloads-alias-data-cmd-requirement]. `None`: the birth has no such metric, or one of another type.
    pub(crate) fn known(&self, old: Metric) -> Option<Metric> {
        let (alias, datatype) = *self.born.get(old.name.as_deref()?)?;
        (datatype == old.datatype).then_some(Metric { name: None, alias: Some(alias), ..old })
    }
}

/// The alias of the value at this place; 0 is unused.
pub(crate) const fn alias(index: usize) -> u64 {
    index as u64 + 1
}

/// A current value, published with its alias.
pub(crate) fn live(index: usize, item: &Item, value: Option<&Datum>, unix_ms: u64) -> Metric {
    Metric { alias: Some(alias(index)), ..metric(item, value, unix_ms) }
}

/// An old value as it is kept: with its name, because the aliases of another birth may differ.
pub(crate) fn historical(item: &Item, value: Option<&Datum>, unix_ms: u64) -> Metric {
    Metric { name: Some(item.name.clone()), historical: true, ..metric(item, value, unix_ms) }
}

fn metric(item: &Item, value: Option<&Datum>, unix_ms: u64) -> Metric {
    Metric { timestamp: unix_ms, datatype: kind_of(&item.typed.ty), value: value.map(Value::of), ..Metric::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_birth_begins_the_sequence_and_its_death_has_its_number() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut node = Node::open("plant", "press", folder.path());
        assert_eq!(node.topic("NBIRTH"), "spBv1.0/plant/NBIRTH/press");
        let death = node.next_death();
        assert_eq!(death.metrics[0].value, Some(Value::Long(0)), "the first connection");
        let birth = node.birth(&[]);
        assert_eq!(death.metrics[0].value, birth.metrics[0].value);
        assert_eq!((death.seq, birth.seq), (None, Some(0)));
        assert_eq!(node.data(Vec::new()).seq, Some(1));
        let sequence: Vec<Option<u8>> = (0..256).map(|_| node.data(Vec::new()).seq).collect();
        assert_eq!((sequence[253], sequence[254], sequence[255]), (Some(255), Some(0), Some(1)));
        node.not_sent();
        assert_eq!(node.data(Vec::new()).seq, Some(1), "a number that was not sent");
        assert_eq!(node.next_death().metrics[0].value, Some(Value::Long(1)));
        let later = Node::open("plant", "press", folder.path()).next_death();
        assert_eq!(later.metrics[0].value, Some(Value::Long(2)), "another run goes on counting");
    }

    #[test]
    fn an_old_value_has_the_alias_of_the_birth() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut node = Node::open("plant", "press", folder.path());
        node.born = BTreeMap::from([("MW10".to_owned(), (7, kind::UINT16))]);
        let old = |name: &str, datatype| {
            let (name, value) = (Some(name.to_owned()), Some(Value::Int(5)));
            Metric { name, datatype, value, historical: true, timestamp: 9, ..Metric::default() }
        };
        let known = Metric { name: None, alias: Some(7), ..old("MW10", kind::UINT16) };
        assert_eq!(node.known(old("MW10", kind::UINT16)), Some(known));
        assert_eq!(node.known(old("MW12", kind::UINT16)), None, "another name");
        assert_eq!(node.known(old("MW10", kind::INT16)), None, "another type");
        assert_eq!(node.known(Metric::default()), None);
    }
}
