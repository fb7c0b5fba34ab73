//! Plain topics: `PREFIX/NAME` has each value, `PREFIX/online` tells whether the link is up.

use crate::shared::iso;
use ob1_access::Datum;
use serde_json::json;

use crate::mqtt::items::{Item, topic};
use crate::mqtt::store::Record;

/// The topic after the prefix that tells whether the link is up.
pub(crate) const ONLINE: &str = "online";

/// A value that has changed; `number` counts all values of the link, so that a gap shows a loss.
pub(crate) fn record(item: &Item, value: Option<&Datum>, unix_ms: u64, scan: u64, number: u64) -> Record {
    let value = value.map_or(serde_json::Value::Null, Datum::json);
    let payload = json!({ "value": value, "time": iso(unix_ms), "scan": scan, "number": number }).to_string();
    Record { topic: topic(&item.name), payload: payload.into_bytes() }
}
