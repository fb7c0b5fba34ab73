//! Diagnostic events of the station as events of its object.

use std::sync::Arc;

use crate::shared::{Station, unix_now};
use ob1_access::door::{Event, What};
use opcua_nodes::BaseEventType;
use opcua_server::SubscriptionCache;
use opcua_types::{ByteString, DateTime, LocalizedText, ObjectTypeId};
use tokio::sync::broadcast::error::RecvError;

use crate::opcua::nodes::node_id;
use crate::opcua::space::ROOT;

/// Severities, 1 to 1000 [OPC 10000-5, 6.4.2].
const FAULT: u16 = 700;
const CHANGE: u16 = 300;
const TOLD: u16 = 100;

/// Publishes events as long as the station lives; earlier ones are not published.
pub(crate) async fn run(station: Station, subscriptions: Arc<SubscriptionCache>) {
    let (_, mut coming) = station.events(u64::MAX);
    let (begun, mut count) = (unix_now(), 0);
    loop {
        let told = match coming.recv().await {
            Ok(event) => words(&event),
            Err(RecvError::Lagged(lost)) => (format!("{lost} events were lost: too many at a time"), CHANGE),
            Err(RecvError::Closed) => return,
        };
        let (text, severity) = told;
        count += 1;
        let id = event_id(begun, count);
        let event =
            BaseEventType::new(ObjectTypeId::SystemEventType, id, LocalizedText::new("en", &text), DateTime::now())
                .set_source_node(node_id(ROOT))
                .set_source_name(station.welcome().station.as_str().into())
                .set_receive_time(DateTime::now())
                .set_severity(severity);
        let source = node_id(ROOT);
        subscriptions.notify_events(std::iter::once((&event as &dyn opcua_nodes::Event, &source)));
    }
}

/// An EventId is unique, also beside those of earlier runs [OPC 10000-5, 6.4.2].
fn event_id(begun: u64, count: u64) -> ByteString {
    ByteString::from([begun.to_be_bytes(), count.to_be_bytes()].concat())
}

/// An event in words, and its severity.
fn words(event: &Event) -> (String, u16) {
    match &event.what {
        What::Diagnosis(entry) => {
            // The text begins with the number of the event.
            let mut text = entry.text.clone();
            for (before, more) in [(", ", &entry.place), ("; ", &entry.remedy)] {
                if !more.is_empty() {
                    text += before;
                    text += more;
                }
            }
            (text, if entry.remedy.is_empty() { TOLD } else { FAULT })
        }
        What::State(state) => (format!("operating state {}", state.name()), CHANGE),
        What::Driver { name, up } => (format!("driver of {name} {}", if *up { "runs" } else { "is down" }), level(*up)),
        What::Link { name, up } => (format!("link {name} {}", if *up { "runs" } else { "is down" }), level(*up)),
        What::Lost(count) => (format!("{count} events were lost"), CHANGE),
    }
}

const fn level(up: bool) -> u16 {
    if up { TOLD } else { FAULT }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_access::door::Diagnosis;

    #[test]
    fn no_event_has_the_id_of_another() {
        let ids = [event_id(1, 1), event_id(1, 2), event_id(2, 1)];
        assert!(ids[0] != ids[1] && ids[0] != ids[2] && ids[1] != ids[2], "{ids:?}");
    }

    #[test]
    fn an_entry_is_told_as_the_diagnostic_buffer_has_it() {
        let of = |place: &str, remedy: &str| {
            let text = "2522h area length error when reading".to_owned();
            let (place, remedy) = (place.to_owned(), remedy.to_owned());
            let entry = Diagnosis { event: 0x2522, text, place, remedy, ..Diagnosis::default() };
            words(&Event { number: 1, time: 0, what: What::Diagnosis(entry) })
        };
        assert_eq!(of("", ""), ("2522h area length error when reading".to_owned(), TOLD));
        let whole = "2522h area length error when reading, FC 1, line 7; load the block".to_owned();
        assert_eq!(of("FC 1, line 7", "load the block"), (whole, FAULT));
    }
}
