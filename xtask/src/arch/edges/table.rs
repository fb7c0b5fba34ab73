//! The table of edges, and the forbidden ways.

/// The allowed direct dependencies of a crate, and the invariant that requires this.
pub(super) struct Row {
    pub(super) name: &'static str,
    pub(super) may_need: &'static [&'static str],
    pub(super) rule: &'static str,
}

const fn row(name: &'static str, rule: &'static str, may_need: &'static [&'static str]) -> Row {
    Row { name, may_need, rule }
}

/// Every member of the workspace except `ob1-tests`, which may depend on everything.
pub(super) const TABLE: &[Row] = &[
    row("ob1-model", "invariant 2", &[]),
    row("ob1-ir", "invariant 3", &["ob1-model"]),
    row("ob1-stl", "invariant 3", &["ob1-model", "ob1-ir", "strsim"]),
    // The statements of SCL; what both languages share is the public face of STL.
    row("ob1-scl", "invariant 3", &["ob1-model", "ob1-ir", "ob1-stl"]),
    // Text and machine code share only the instruction set.
    row("ob1-mc7", "invariant 3", &["ob1-model", "ob1-ir"]),
    row("ob1-std", "invariant 2", &["ob1-model", "ob1-time", "ob1-words"]),
    // A view that must give back the same statements; the names come from the printer.
    row("ob1-ladder", "invariant 3", &["ob1-model", "ob1-ir", "ob1-stl"]),
    row("ob1-project", "invariant 3", &["ob1-model", "ob1-ir", "ob1-stl", "ob1-scl", "ob1-mc7", "encoding_rs", "zip"]),
    // The bytes of a memory, independent of their origin.
    row("ob1-arena", "invariant 2", &[]),
    // It runs the system blocks as native blocks: they are pure functions.
    row("ob1-cpu", "invariant 2", &["ob1-arena", "ob1-model", "ob1-ir", "ob1-std", "ob1-time", "rtrb"]),
    // The only crate that generates machine code.
    row(
        "ob1-native",
        "invariant 3",
        &["ob1-cpu", "ob1-ir", "ob1-model", "cranelift-codegen", "cranelift-frontend", "rustix", "target-lexicon"],
    ),
    // Common parts of all links; the texts of STATUS are in the words of the CPs.
    row(
        "ob1-access",
        "invariant 2",
        &[
            "ob1-backplane",
            "ob1-ir",
            "ob1-model",
            "ob1-socket",
            // Values as constants of STL.
            "ob1-stl",
            "ob1-words",
            "serde",
            "serde_json",
            "thiserror",
        ],
    ),
    // The interface of a CP 343, and ANY pointers.
    row("ob1-s7", "invariant 1", &["ob1-model", "ob1-words"]),
    // It owns the sockets and reaches the CPU through the broker.
    row(
        "ob1-s7-process",
        "invariant 2",
        &[
            "ob1-access",
            // The side of a CP 343 on the back plane.
            "ob1-backplane",
            "ob1-model",
            "ob1-process",
            "ob1-s7",
            // The records of a trace.
            "ob1-serial",
            "clap",
            "rustix",
            "serde_json",
            "tracing",
        ],
    ),
    // The only process with an async runtime; which of its folders may name which library: `ROOMS` in purity.rs.
    row(
        "ob1-gate",
        "invariant 2",
        &[
            "ob1-access",
            "ob1-ir",
            // Networks as drawings, with power flow.
            "ob1-ladder",
            "ob1-model",
            "ob1-process",
            // What the records of a driver's tap say.
            "ob1-protocols",
            "ob1-serial",
            "ob1-stl",
            "ob1-trace",
            "argon2",
            "async-opcua-crypto",
            "async-opcua-nodes",
            "async-opcua-server",
            "async-opcua-types",
            "async-trait",
            // Names and passwords of HTTP's basic authentication.
            "base64ct",
            "clap",
            "http-body-util",
            "hyper",
            "hyper-util",
            "parking_lot",
            "ring",
            "rumqttc",
            "rustix",
            "rustls",
            "serde",
            "serde_json",
            "signal-hook",
            "thiserror",
            "tokio",
            "tokio-rustls",
            "tracing",
        ],
    ),
    row(
        "ob1-broker",
        "invariant 2",
        &[
            "ob1-access",
            "ob1-backplane",
            "ob1-cpu",
            "ob1-process",
            "ob1-model",
            "ob1-rt",
            "ob1-socket",
            "ob1-time",
            "rtrb",
            "rustix",
            "tracing",
        ],
    ),
    row(
        "ob1-rt",
        "invariant 4",
        &["ob1-arena", "ob1-time", "libc", "rustix", "seccompiler", "signal-hook", "thiserror"],
    ),
    row(
        "ob1-host",
        "invariant 4",
        &[
            "ob1-model",
            "ob1-cpu",
            "ob1-sdk",
            "ob1-backplane",
            // The boxes of a CP 343.
            "ob1-words",
            // The state of the couplers of a bus.
            "ob1-coupler",
            // Information of the system about a driver's process.
            "ob1-rt",
            "ob1-socket",
            "ob1-time",
            "libloading",
            "rtrb",
            "rustix",
            "thiserror",
            "tracing",
        ],
    ),
    // What a station file says; it runs nothing.
    row(
        "ob1-station-file",
        "invariant 2",
        &[
            "ob1-process",
            "ob1-access",
            "ob1-backplane",
            // Couplers, and GSD files of slaves.
            "ob1-coupler",
            "ob1-cpu",
            "ob1-dp",
            "ob1-host",
            "ob1-model",
            "ob1-params",
            // The port of ISO on TCP.
            "ob1-s7",
            "ob1-serial",
            "ob1-std",
            "ob1-stl",
            "ob1-time",
            "rustix",
            "serde",
            "serde_json",
            "thiserror",
            "toml",
        ],
    ),
    // The observer beside the scan; it knows no station.
    row(
        "ob1-timing",
        "invariant 2",
        &["ob1-coupler", "ob1-cpu", "ob1-model", "ob1-rt", "ob1-time", "parking_lot", "rtrb", "serde"],
    ),
    // Recordings: what is kept of a CPU's rows, and their file.
    row(
        "ob1-record",
        "invariant 2",
        &[
            "ob1-access",
            "ob1-cpu",
            "ob1-process",
            "ob1-model",
            "ob1-time",
            "ob1-timing",
            "serde",
            "serde_json",
            "thiserror",
        ],
    ),
    // A running station; it depends on no tool.
    row(
        "ob1-station",
        "invariant 2",
        &[
            "ob1-model",
            "ob1-ir",
            "ob1-scl",
            "ob1-stl",
            "ob1-mc7",
            "ob1-project",
            "ob1-std",
            "ob1-arena",
            "ob1-cpu",
            "ob1-native",
            "ob1-process",
            "ob1-rt",
            "ob1-socket",
            "ob1-time",
            "ob1-access",
            "ob1-broker",
            "ob1-host",
            "ob1-backplane",
            // Buses: their processes get the settings of the station file.
            "ob1-coupler",
            "ob1-station-file",
            "ob1-timing",
            "ob1-record",
            "ob1-params",
            "ob1-serial",
            // The texts of the events in a CP's diagnostic buffer.
            "ob1-words",
            "bincode",
            "parking_lot",
            "rtrb",
            "rustix",
            "serde",
            "serde_json",
            "signal-hook",
            "thiserror",
            "toml",
            "tracing",
        ],
    ),
    row(
        "ob1",
        "invariant 2",
        &[
            "ob1-process",
            "ob1-station",
            "ob1-station-file",
            "ob1-timing",
            "ob1-record",
            "ob1-model",
            "ob1-ir",
            "ob1-stl",
            "ob1-ladder",
            "ob1-mc7",
            "ob1-project",
            "ob1-std",
            "ob1-cpu",
            // `ob1 import` reads the GSD files of DP slaves.
            "ob1-dp",
            "ob1-rt",
            "ob1-time",
            "ob1-access",
            "ob1-host",
            "ob1-backplane",
            "ob1-params",
            // `ob1 trace` reads the traffic on a line.
            "ob1-protocols",
            "ob1-serial",
            "ob1-trace",
            // `ob1 upload` is a client of S7 communication.
            "ob1-s7",
            // `ob1 driver test` plays the handling blocks.
            "ob1-words",
            "chrono",
            "clap",
            // Loads of a soak test.
            "fastrand",
            // `ob1 record` writes traces for Perfetto.
            "prost",
            // `ob1 top`.
            "ratatui",
            "rustix",
            "serde",
            "serde_json",
            "similar",
            "thiserror",
            "toml",
        ],
    ),
    // With the interface that two binaries agree on (`abi`).
    row("ob1-sdk", "invariant 9", &[]),
    // The interface between a handling block and its CP, defined once.
    row("ob1-words", "invariant 9", &[]),
    row("ob1-backplane", "invariant 7", &["ob1-words", "loom", "memmap2", "rustix", "thiserror"]),
    row("ob1-cp240", "invariant 9", &["ob1-sdk", "ob1-words"]),
    row("ob1-cp040", "invariant 9", &["ob1-sdk", "ob1-words"]),
    row("ob1-cp341", "invariant 9", &["ob1-sdk", "ob1-siemens", "ob1-words"]),
    row("ob1-cp342", "invariant 9", &["ob1-sdk", "ob1-siemens", "ob1-words"]),
    row("ob1-cp343", "invariant 9", &["ob1-sdk", "ob1-siemens", "ob1-words"]),
    row("ob1-cp340", "invariant 9", &["ob1-sdk", "ob1-siemens", "ob1-words"]),
    row("ob1-siemens", "invariant 9", &["ob1-sdk", "ob1-words"]),
    // The library has the tables of DIF and VIF.
    row("ob1-mbus", "invariant 9", &["ob1-sdk", "m-bus-application-layer"]),
    row("ob1-example-rust-blocks", "invariant 9", &["ob1-sdk"]),
    row("ob1-example-rust-ob1", "invariant 9", &["ob1-sdk"]),
    row("ob1-panicking-plugin", "invariant 9", &["ob1-sdk"]),
    row("ob1-params", "invariant 11", &["ob1-serial", "strsim"]),
    // The description of a serial line.
    row("ob1-serial", "invariant 1", &["ob1-time"]),
    // Instants and durations of the common clock.
    row("ob1-time", "invariant 1", &[]),
    // What the numbers of events mean is the interface's.
    row("ob1-protocols", "invariant 1", &["ob1-serial", "ob1-words"]),
    // The configuration of a bus is sent from the runtime to its process, so it needs serde; both ends choose JSON.
    row("ob1-coupler", "invariant 11", &["ob1-protocols", "serde"]),
    // Reads the records of a tap: for the tools and for the page.
    row("ob1-trace", "invariant 11", &["ob1-params", "ob1-protocols", "ob1-serial", "serde_json"]),
    // PROFIBUS: the stack, and the files that describe a slave.
    row("ob1-dp", "invariant 11", &["ob1-coupler", "ob1-protocols", "gsd-parser", "profirust"]),
    // The printer prints S7 values: needs the calendar of DATE.
    row("ob1-firmware", "invariant 1", &["ob1-model", "ob1-params", "ob1-protocols", "ob1-words"]),
    row("ob1-socket", "invariant 4", &["ob1-time", "rustix"]),
    row("ob1-line", "invariant 4", &["ob1-serial", "ob1-socket", "rustix", "serialport", "thiserror"]),
    row(
        "ob1-process",
        "invariant 4",
        &[
            "ob1-serial",
            "ob1-socket",
            "landlock",
            "libc",
            "rustix",
            "seccompiler",
            "serde",
            "serde_json",
            "signal-hook",
            "tracing",
            "tracing-subscriber",
        ],
    ),
    row(
        "ob1-cp",
        "invariant 4",
        &[
            "ob1-params",
            "ob1-process",
            "ob1-serial",
            "ob1-firmware",
            "ob1-line",
            "ob1-backplane",
            "ob1-words",
            "clap",
            "rustix",
            "serde",
            "serde_json",
            "thiserror",
            "tracing",
        ],
    ),
    row(
        "ob1-io",
        "invariant 4",
        &[
            "ob1-process",
            "ob1-coupler",
            "ob1-dp",
            "ob1-line",
            "ob1-backplane",
            "ob1-serial",
            "clap",
            // The lines of a GPIO chip: the character device of the kernel.
            "gpiocdev",
            "rustix",
            "serde_json",
            "tracing",
        ],
    ),
    // Stand-ins for tests: no product needs it.
    row("ob1-fakes", "tools", &["ob1-coupler", "ob1-firmware", "ob1-line", "ob1-protocols"]),
    row("xtask", "tools", &["pulldown-cmark", "serde_json"]),
];

/// The rooms of the house, from the lowest floor up: a crate needs only crates of its own floor and of those below.
pub(super) const FLOORS: &[&str] = &["base", "backplane", "blocks", "plugins", "driver", "links", "runtime"];

/// No crate of the first list may depend on a crate of the second list, not even indirectly through external crates.
pub(super) const NO_WAY: &[(&str, &[&str], &[&str])] = &[
    // The CPU, the language and the system blocks depend on no plugin, no driver and no operating system.
    (
        "invariant 2",
        &["ob1-arena", "ob1-cpu", "ob1-ir", "ob1-mc7", "ob1-model", "ob1-std", "ob1-stl"],
        &[
            "libc",
            "rustix",
            "libloading",
            "memmap2",
            "serialport",
            "serde",
            "tracing",
            "getrandom",
            "ob1-sdk",
            "ob1-backplane",
            "ob1-host",
            "ob1-rt",
            "ob1-line",
            "ob1-protocols",
            "ob1-firmware",
        ],
    ),
    ("invariant 3", &["ob1-stl", "ob1-scl", "ob1-mc7", "ob1-ladder"], &["ob1-cpu", "ob1-host", "ob1-rt"]),
    ("invariant 3", &["ob1-cpu", "ob1-host", "ob1-rt", "ob1-cp"], &["ob1-native", "cranelift-codegen"]),
    ("invariant 3", &["ob1-native"], &["ob1-stl", "ob1-scl", "ob1-mc7", "ob1-host", "ob1-rt"]),
    ("invariant 3", &["ob1-cpu", "ob1-host", "ob1-rt", "ob1-ir"], &["ob1-stl", "ob1-scl", "ob1-mc7"]),
    // A protocol machine, and the firmware around it, use only bytes and times.
    (
        "invariant 1",
        &["ob1-protocols", "ob1-firmware", "ob1-params", "ob1-coupler"],
        &[
            "libc",
            "rustix",
            "memmap2",
            "serialport",
            "tracing",
            "ob1-sdk",
            "ob1-backplane",
            "ob1-line",
            "ob1-cpu",
            "ob1-rt",
        ],
    ),
    // The same for PROFIBUS, except that its GSD parser needs libc to protect its stack.
    (
        "invariant 1",
        &["ob1-dp"],
        &["rustix", "memmap2", "serialport", "tracing", "ob1-sdk", "ob1-backplane", "ob1-line", "ob1-cpu", "ob1-rt"],
    ),
    // The CPU is in the runtime's process and in no other: links use the broker, drivers the back plane.
    (
        "invariant 17",
        &["ob1-cp", "ob1-io", "ob1-gate", "ob1-s7-process"],
        &["ob1-cpu", "ob1-std", "ob1-host", "ob1-native", "ob1-station"],
    ),
    // A link knows no block and no protocol of a line. Of the language `ob1-access` has the constants: values are
    // written as STL writes them.
    ("invariant 2", &["ob1-access", "ob1-s7"], &["ob1-cpu", "ob1-host", "ob1-rt", "ob1-std", "ob1-protocols"]),
    ("invariant 2", &["ob1-s7"], &["ob1-stl"]),
    // Only the gate has an async runtime.
    ("invariant 2", &["ob1", "ob1-station", "ob1-cp", "ob1-io", "ob1-s7-process", "ob1-access"], &["tokio", "hyper"]),
    // One library for TLS.
    ("invariant 2", &["ob1-gate"], &["openssl", "aws-lc-rs"]),
    // Shared memory does not use a serialisation format.
    ("invariant 7", &["ob1-backplane"], &["serde", "bincode", "parking_lot"]),
    // A plugin may only use the functions of the host.
    (
        "invariant 9",
        &[
            "ob1-cp240",
            "ob1-cp340",
            "ob1-cp341",
            "ob1-siemens",
            "ob1-mbus",
            "ob1-cp342",
            "ob1-cp343",
            "ob1-example-rust-blocks",
            "ob1-example-rust-ob1",
            "ob1-panicking-plugin",
            "ob1-sdk",
        ],
        &["libc", "rustix", "ob1-backplane", "ob1-cpu", "ob1-model", "parking_lot", "tracing"],
    ),
    // Only `line` opens a device, only `host` loads a plugin.
    ("invariant 4", &["ob1", "ob1-station", "ob1-host", "ob1-rt", "ob1-backplane"], &["serialport", "ob1-line"]),
    ("invariant 4", &["ob1-cp", "ob1-io", "ob1-line", "ob1-backplane", "ob1-rt"], &["libloading"]),
    ("invariant 2", &["ob1-cp", "ob1-io"], &["ob1-stl", "ob1-sdk"]),
    // A station does not depend on the tools that inspect it.
    ("invariant 2", &["ob1-station"], &["ob1", "clap", "ratatui"]),
];
