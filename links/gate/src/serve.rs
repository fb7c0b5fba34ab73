//! The runtime, and a task for each link.

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use crate::shared::{Link, Memory, Station};
use ob1_access::door::DoorError;
use ob1_access::settings::GateKind;
use tokio::task::JoinSet;
use tokio::time::{interval, timeout};
use tracing::{error, info};

use crate::prepare::Ready;
use crate::{metrics, web};

/// Threads for long tasks: a password, a large program.
const HELPERS: usize = 2;
/// Time between two checks for renewed files.
const RENEWED: Duration = Duration::from_secs(5);
/// Time that links have for their last work when the station ends; the runtime waits 2 s for this process.
const GOODBYE: Duration = Duration::from_millis(1500);

type Served = Pin<Box<dyn Future<Output = Result<(), String>>>>;

/// Serves all links until a door closes.
pub(crate) fn run(links: Vec<Ready>, memory: Memory) -> Result<(), String> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .max_blocking_threads(HELPERS)
        .thread_name("ob1-gate-helper")
        .build()
        .map_err(|error| error.to_string())?;
    tokio::task::LocalSet::new().block_on(&runtime, all(links, memory))
}

async fn all(links: Vec<Ready>, memory: Memory) -> Result<(), String> {
    let mut doors = JoinSet::new();
    let mut last = JoinSet::new();
    let mut held = Vec::new();
    for ready in links {
        let Ready { told, door, ceiling, listeners, inner, users, tls, audit, state } = ready;
        let (station, pump) = Station::new(door, ceiling, audit).map_err(|error| error.to_string())?;
        doors.spawn(pump);
        tokio::task::spawn_local(renew(users.clone(), tls.clone()));
        let name = station.welcome().link.clone();
        // A link that cannot be served keeps its door, and the others continue.
        held.push(station.clone());
        let Some(told) = told else { continue };
        let link = Link { station, listeners, inner, users, tls, state, memory: memory.clone() };
        // MQTT says goodbye to the broker, and keeps the values that have not been sent: the end of the station waits.
        let says_goodbye = matches!(told.own, GateKind::Mqtt(_));
        let (kind, served): (_, Served) = match told.own {
            GateKind::Web(own) => ("web", Box::pin(web::serve(link, own))),
            GateKind::Metrics(own) => ("metrics", Box::pin(metrics::serve(link, own))),
            GateKind::OpcUa(own) => ("opcua", Box::pin(crate::opcua::serve(link, own))),
            GateKind::Mqtt(own) => ("mqtt", Box::pin(crate::mqtt::serve(link, *own))),
        };
        info!(link = name, kind, "serving");
        let told = async move {
            if let Err(why) = served.await {
                error!("link \"{name}\": {why}");
            }
        };
        if says_goodbye {
            last.spawn_local(told);
        } else {
            tokio::task::spawn_local(told);
        }
    }
    let ended = match doors.join_next().await {
        None | Some(Ok(DoorError::Closed)) => Ok(()),
        Some(Ok(error)) => Err(error.to_string()),
        Some(Err(error)) => Err(error.to_string()),
    };
    doors.abort_all();
    let _ = timeout(GOODBYE, all_ended(&mut last)).await;
    ended
}

async fn all_ended(tasks: &mut JoinSet<()>) {
    while tasks.join_next().await.is_some() {}
}

/// Reloads changed users and renewed certificates without a restart.
async fn renew(users: Option<crate::shared::Users>, tls: Option<crate::shared::Tls>) {
    let mut look = interval(RENEWED);
    let mut told = String::new();
    loop {
        look.tick().await;
        let users = users.as_ref().map(|users| users.refresh().map_err(|error| error.to_string()));
        let tls = tls.as_ref().map(|tls| tls.refresh().map_err(|error| error.to_string()));
        for outcome in users.into_iter().chain(tls) {
            match outcome {
                Ok(true) => info!("users or certificate read again"),
                Ok(false) => {}
                Err(why) if why == told => {}
                Err(why) => {
                    error!("{why}; the values read before stay valid");
                    told = why;
                }
            }
        }
    }
}
