//! Why a bit is on or off, or a block is not called.

use std::sync::Arc;

use hyper::StatusCode;
use ob1_access::why::{Inside, WhyStatus, WhyWanted, order, status};
use serde_json::{Map, Value};

use super::Page;
use super::api::{send, trouble};
use super::insight::Insight;
use super::program::hidden;
use crate::http::{Reply, plain, query};

/// How long a pass is waited for, in milliseconds.
const WAIT: u64 = 2000;
/// Blocks that are asked about one after the other: of others that write the bit nothing is known.
const BLOCKS: usize = 8;

impl Page {
    /// `?name=A 4.0`; of a name of a block (`FB 20 #run`) also `db`, the instance, and `from`, the caller.
    pub(super) async fn reason(&self, asked: &str) -> Reply {
        if !self.allowed.has_program() {
            return hidden();
        }
        let name = query(asked, "name").unwrap_or_default();
        let inside = Inside {
            ask: name.clone(),
            db: query(asked, "db").and_then(|db| db.parse().ok()),
            from: query(asked, "from"),
        };
        let inside = if inside.db.is_some() || inside.from.is_some() { inside } else { Inside::default() };
        let insight = match self.insight.get(&self.station).await {
            Ok(insight) => insight,
            Err(why) => return trouble(&why),
        };
        let client = self.nobody();
        let now = self.now(&insight, &name).await;
        let mut best: Option<WhyStatus> = None;
        for block in 0..BLOCKS {
            let wanted = WhyWanted { operand: name.clone(), now, inside: inside.clone(), block, wait_ms: WAIT };
            let asked = at_work(&insight, move |insight| insight.known(|known| order(known, &wanted))).await;
            let (question, order) = match asked {
                Ok(asked) => asked,
                Err(why) => return plain(StatusCode::NOT_FOUND, why),
            };
            let pass = match order {
                None => None,
                Some(order) => match self.pass(&client, order).await {
                    Ok(pass) => Some(pass),
                    Err(why) => return trouble(&why),
                },
            };
            let answer =
                at_work(&insight, move |insight| insight.known(|known| status(known, &question, pass.as_ref()))).await;
            let mut answer = match answer {
                Ok(answer) => answer,
                Err(why) => return plain(StatusCode::CONFLICT, why),
            };
            let is_last = block + 1 >= answer.blocks.len();
            answer.is_open |= answer.blocks.len() > BLOCKS;
            if best.as_ref().is_none_or(|best| answer.rank(now) >= best.rank(now)) {
                best = Some(answer);
            }
            if is_last {
                break;
            }
        }
        let mut told = best.and_then(|best| serde_json::to_value(best).ok()).unwrap_or_default();
        told["comments"] = comments(&insight, &told.to_string());
        send(&told)
    }

    /// The present value of a bit; false of what has none.
    async fn now(&self, insight: &Insight, name: &str) -> bool {
        let Ok(typed) = insight.names.typed(name) else { return false };
        let Some(piece) = typed.piece() else { return false };
        let Ok(reading) = self.station.read(vec![piece]).await else { return false };
        reading.piece(0).ok().and_then(|bytes| typed.value(bytes)).is_some_and(|value| value.json() == true)
    }
}

/// Does something that may take a while beside the tasks of this process, which must give signs of life.
async fn at_work<T: Send + 'static>(
    insight: &Arc<Insight>,
    work: impl FnOnce(&Insight) -> Result<T, String> + Send + 'static,
) -> Result<T, String> {
    let insight = Arc::clone(insight);
    tokio::task::spawn_blocking(move || work(&insight)).await.map_err(|error| error.to_string())?
}

/// What the table of symbols says of those that a text names.
fn comments(insight: &Insight, text: &str) -> Value {
    let symbols = insight.all.program().symbols.iter().filter(|symbol| !symbol.comment.is_empty());
    let named = symbols.filter(|symbol| text.contains(&format!("\\\"{}\\\"", symbol.name)));
    named.map(|symbol| (symbol.name.clone(), Value::String(symbol.comment.clone()))).collect::<Map<_, _>>().into()
}
