//! The edge node of Sparkplug B: its topics, its births and deaths, and the sequence of its data.

use std::fs;
use std::path::{Path, PathBuf};

use ob1_access::Datum;

use crate::items::Item;
use crate::sparkplug::{BD_SEQ, Metric, Payload, REBIRTH, Value, kind, kind_of};

/// See [the module](self).
#[derive(Debug)]
pub(crate) struct Node {
    group: String,
    name: String,
    /// Counts births; it links a death to its birth.
    bd_seq: u8,
    /// Sequence number of the next data message; a birth is 0.
    seq: u8,
    path: PathBuf,
}

impl Node {
    /// The node of a group; the number of its last birth is in a file.
    pub(crate) fn open(group: &str, name: &str, state: &Path) -> Self {
        let path = state.join("bdseq");
        let before = fs::read_to_string(&path).ok().and_then(|text| text.trim().parse::<u8>().ok());
        let bd_seq = before.map_or(0, |before| before.wrapping_add(1));
        Self { group: group.to_owned(), name: name.to_owned(), bd_seq, seq: 0, path }
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
        Payload { timestamp: ob1_gate_core::unix_now(), metrics: vec![self.bd_seq()], seq: None }
    }

    fn bd_seq(&self) -> Metric {
        Metric {
            name: Some(BD_SEQ.into()),
            timestamp: ob1_gate_core::unix_now(),
            datatype: kind::UINT64,
            value: Some(Value::Long(self.bd_seq.into())),
            ..Metric::default()
        }
    }

    /// All metrics with their names, aliases and values.
    pub(crate) fn birth(&mut self, items: &[Item]) -> Payload {
        let now = ob1_gate_core::unix_now();
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
        self.seq = 1;
        Payload { timestamp: now, metrics, seq: Some(0) }
    }

    /// A message with these metrics.
    pub(crate) fn data(&mut self, metrics: Vec<Metric>) -> Payload {
        let seq = self.seq;
        self.seq = seq.wrapping_add(1);
        Payload { timestamp: ob1_gate_core::unix_now(), metrics, seq: Some(seq) }
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

/// An old value, published with its name, because the aliases of another birth may differ.
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
        let birth = node.birth(&[]);
        assert_eq!(death.metrics[0].value, birth.metrics[0].value);
        assert_eq!((death.seq, birth.seq), (None, Some(0)));
        assert_eq!(node.data(Vec::new()).seq, Some(1));
        let sequence: Vec<Option<u8>> = (0..256).map(|_| node.data(Vec::new()).seq).collect();
        assert_eq!((sequence[253], sequence[254], sequence[255]), (Some(255), Some(0), Some(1)));
        let again = node.next_death();
        assert_ne!(again.metrics[0].value, death.metrics[0].value);
        let later = Node::open("plant", "press", folder.path()).next_death();
        assert_ne!(later.metrics[0].value, again.metrics[0].value, "another run goes on counting");
    }
}
