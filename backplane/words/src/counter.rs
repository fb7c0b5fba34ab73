//! What is counted of a CP, and its name.

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident = $text:literal,)*) => {
        /// What a CP counts. The position in the segment is the number of the variant.
        ///
        /// At every moment: orders accepted = sent + failed + aborted + lost + the running one; telegrams received =
        /// delivered + aborted + lost + those in the buffer.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(usize)]
        pub enum Counter {
            $($(#[$doc])* $name,)*
        }

        impl Counter {
            /// All counters, in their order in the segment.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// Name of the counter, as reports print it.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

counters! {
    /// Send orders taken over completely from the CPU.
    OrdersAccepted = "orders_accepted",
    /// Orders finished: the protocol's last acknowledgement has arrived.
    TelegramsSent = "telegrams_sent",
    /// Orders finished with an error.
    SendErrors = "send_errors",
    /// Orders dropped by a reset of the CP.
    OrdersAborted = "orders_aborted",
    /// Orders that were in the buffers of a driver when it died.
    OrdersLost = "orders_lost",
    /// Telegrams of the partner received completely and free of errors.
    TelegramsReceived = "telegrams_received",
    /// Received telegrams handed over completely to the CPU.
    TelegramsDelivered = "telegrams_delivered",
    /// Received telegrams dropped by a reset of the CP.
    ReceiveAborted = "receive_aborted",
    /// Received telegrams that were in the buffers of a driver when it died.
    ReceiveLost = "receive_lost",
    /// Attempts of the partner that failed: parity, frame, check sum, time.
    ReceiveErrors = "receive_errors",
    /// Attempts of the partner that were rejected because a buffer was full. A warning: a partner that repeats at once
    /// uses up its attempts before the program has made room, and gives up the telegram.
    RejectedFull = "rejected_full",
    /// Bytes sent on the line.
    BytesTx = "bytes_tx",
    /// Bytes received from the line.
    BytesRx = "bytes_rx",
    /// Times the line failed: device gone, connection broken.
    LineFaults = "line_faults",
    /// Times the line was opened again.
    LineRestarts = "line_restarts",
    /// Times a driver has attached.
    DriverStarts = "driver_starts",
    /// Log lines of the driver that were dropped.
    LogLost = "log_lost",
}
