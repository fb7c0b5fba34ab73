//! Limits for clients. Each number is in docs/opcua.md, "Limits".

use std::time::Duration;

use opcua_server::{Limits, OperationalLimits, SubscriptionLimits};

/// Shortest sampling interval, in milliseconds.
pub(crate) const SAMPLING_MS: f64 = 50.0;
/// Longest sampling interval, in milliseconds.
pub(crate) const SLOWEST_MS: f64 = 3_600_000.0;
/// Reads of the CPU within the shortest requested sampling interval.
pub(crate) const LOOKS: u32 = 4;
/// The server checks at beats (`publish_times.rs`) whether something is to be published, never more often than this.
pub(crate) const POLL_MS: u64 = 1;
/// New items that come within this time start together.
pub(crate) const SETTLE: Duration = Duration::from_millis(20);
/// Maximum of sessions that ask for something, unless the link's key says otherwise.
pub(crate) const CLIENTS: usize = 20;
/// Maximum of sessions besides that were only created. Without security there are four on each of [`IDLE`] connections
/// and on those in use, and those that are about to end ([`super::leave`]): the rest is for sessions over secured
/// channels, which the library keeps for [`SESSION_MS`]. Each request looks through them.
pub(crate) const WAITING: usize = 2_000;
/// Maximum of connections that nobody uses: without a session of a user or of a client that has a place. They have
/// [`super::chunks::SESSIONS`] sessions each at most, if they have no security.
pub(crate) const IDLE: usize = 250;
/// Maximum of monitored items of all clients together, unless the link's key says otherwise.
pub(crate) const ITEMS: usize = 20_000;
/// Maximum of single values in an answer, mostly elements of arrays. More than this fits no message.
pub(crate) const ANSWER: usize = 1 << 20;
/// Maximum of single values kept for the items of all clients: the newest of each, and its queue.
pub(crate) const KEPT: usize = 1 << 20;
/// Maximum of concurrent changing requests of all clients.
pub(crate) const CHANGES: usize = 32;
/// A session without a request for this long is closed.
pub(crate) const SESSION_MS: u64 = 60_000;
/// Deleted items leave a little memory in the server: after this many it is restarted when nobody is connected,
pub(crate) const RENEW_IDLE: usize = 10_000;
/// and after this many in any case; clients connect again.
pub(crate) const RENEW_ANYWAY: usize = 1_000_000;

/// All limits of a server.
pub(crate) fn limits(clients: usize, items: usize) -> Limits {
    Limits {
        // An array of a data block has 65536 elements at most; a message holds one.
        max_array_length: 65_536,
        max_string_length: 65_536,
        max_byte_string_length: 65_536,
        max_message_size: 4 << 20,
        // The longest message in chunks a little below 64 KiB.
        max_chunk_count: 65,
        max_browse_continuation_points: 50,
        max_history_continuation_points: 1,
        max_query_continuation_points: 1,
        max_sessions: clients + WAITING,
        subscriptions: SubscriptionLimits {
            max_subscriptions_per_session: 10,
            // node-opcua keeps five for each subscription, and takes a refusal of one for an error.
            max_pending_publish_requests: 100,
            max_publish_requests_per_subscription: 10,
            min_sampling_interval_ms: SAMPLING_MS,
            min_publishing_interval_ms: SAMPLING_MS,
            // A subscription whose client is dead lives 300 publishing intervals at most.
            max_keep_alive_count: 100,
            default_keep_alive_count: 10,
            max_lifetime_count: 300,
            max_monitored_items_per_sub: items,
            max_monitored_item_queue_size: 100,
            max_notifications_per_publish: 10_000,
            max_queued_notifications: 20,
        },
        operational: OperationalLimits {
            max_nodes_per_read: 1_000,
            max_nodes_per_write: 1_000,
            max_nodes_per_method_call: 10,
            max_nodes_per_browse: 1_000,
            max_nodes_per_register_nodes: 1_000,
            max_monitored_items_per_call: 1_000,
            max_nodes_per_translate_browse_paths_to_node_ids: 100,
            max_references_per_browse_node: 1_000,
            max_subscriptions_per_call: 10,
            ..OperationalLimits::default()
        },
        ..Limits::default()
    }
}
