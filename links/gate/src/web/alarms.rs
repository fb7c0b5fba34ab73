//! Alarms: which stand, and their acknowledgement.

use crate::shared::Client;
use hyper::body::Bytes;
use ob1_access::alarms::acknowledging;
use ob1_access::door::{Answer, Ask};
use ob1_model::{ALARM_ORDERS, AlarmOrder};
use serde::Deserialize;
use serde_json::json;

use super::Page;
use super::api::{body, send, trouble, wrong};
use crate::http::Reply;

#[derive(Deserialize)]
struct Wanted {
    /// Message numbers.
    numbers: Vec<u32>,
}

impl Page {
    pub(super) async fn alarms(&self) -> Reply {
        match self.station.alarms().await {
            Ok(alarms) => send(&json!(alarms)),
            Err(why) => trouble(&why),
        }
    }

    pub(super) async fn acknowledge(&self, client: &Client, bytes: &Bytes) -> Reply {
        let Some(Wanted { numbers }) = body(None, bytes) else { return wrong() };
        if numbers.is_empty() || numbers.len() > ALARM_ORDERS {
            return wrong();
        }
        match client.ask(Ask::Alarms(AlarmOrder::Acknowledge(acknowledging(&numbers)))).await {
            Ok(Answer::Ordered(found)) => {
                send(&json!({ "acknowledged": found.iter().filter(|found| **found).count() }))
            }
            Ok(_) => wrong(),
            Err(why) => trouble(&why),
        }
    }
}
