//! The alarms that stand, on the topic `PREFIX/alarms` whenever they have changed.

use std::time::Duration;

use crate::shared::{Station, Trouble};
use serde_json::json;
use tokio::sync::watch;

use crate::mqtt::store::Record;

/// The topic after the prefix.
const TOPIC: &str = "alarms";
/// The scan makes each list: it is asked for no more often, however often the values of the link are read.
const SHORTEST: Duration = Duration::from_secs(1);
/// Alarms of one message at most, the most urgent ones; all of them are counted.
const MOST: usize = 100;

/// What stands now, as it is asked for in a task of its own. Until the link ends.
#[derive(Debug)]
pub(crate) struct Alarms(watch::Receiver<String>);

impl Alarms {
    /// Asks so often.
    pub(crate) fn watch(station: Station, every: Duration) -> Self {
        let (tell, told) = watch::channel(String::new());
        tokio::spawn(async move {
            while !tell.is_closed() {
                match station.alarms().await {
                    Ok(list) => {
                        let open = list.iter().filter(|alarm| !alarm.acknowledged).count();
                        let first = list.get(..MOST).unwrap_or(&list);
                        let now =
                            json!({ "standing": list.len(), "unacknowledged": open, "alarms": first }).to_string();
                        tell.send_if_modified(|before| {
                            let differs = *before != now;
                            *before = now;
                            differs
                        });
                    }
                    Err(Trouble::Gone) => return,
                    // Asked again.
                    Err(_) => {}
                }
                tokio::time::sleep(every.max(SHORTEST)).await;
            }
        });
        Self(told)
    }

    /// They have changed; never, if nobody asks.
    pub(crate) async fn next(alarms: Option<&mut Self>) -> Record {
        if let Some(Self(told)) = alarms
            && told.changed().await.is_ok()
        {
            return record(&told.borrow_and_update());
        }
        std::future::pending().await
    }

    /// As they were told last; nothing before the first time.
    pub(crate) fn last(&self) -> Option<Record> {
        let last = self.0.borrow();
        (!last.is_empty()).then(|| record(&last))
    }
}

fn record(text: &str) -> Record {
    Record { topic: TOPIC.to_owned(), payload: text.as_bytes().to_vec() }
}
