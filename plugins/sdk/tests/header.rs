//! `include/ob1.h` matches `plugins/sdk/src/abi`.
//!
//! After a change of the interface: `OB1_UPDATE=1 cargo test -p ob1-sdk --test header`, and review the diff.

use std::path::Path;

/// C names of the types; constants get the prefix `OB1_`, those of data types `OB1_TY_`.
const TYPES: [(&str, &str); 16] = [
    ("BlockDesc", "Ob1BlockDesc"),
    ("BlockEntry", "Ob1BlockEntry"),
    ("CallArg", "Ob1CallArg"),
    ("CallContext", "Ob1CallContext"),
    ("HostTable", "Ob1HostTable"),
    ("InstanceInfo", "Ob1InstanceInfo"),
    ("ModuleInfo", "Ob1ModuleInfo"),
    ("ObInfo", "Ob1ObInfo"),
    ("ParamDesc", "Ob1ParamDesc"),
    ("PluginEntry", "Ob1PluginEntry"),
    ("PluginTable", "Ob1PluginTable"),
    ("Registers", "Ob1Registers"),
    ("SettingsTable", "Ob1SettingsTable"),
    ("Status", "Ob1Status"),
    ("Text", "Ob1Text"),
    ("TimerInfo", "Ob1TimerInfo"),
];

/// The constants of `ob1_sdk::abi::ty`.
const DATA_TYPES: [&str; 23] = [
    "BOOL",
    "BYTE",
    "CHAR",
    "WORD",
    "INT",
    "DWORD",
    "DINT",
    "REAL",
    "S5TIME",
    "TIME",
    "DATE",
    "TIME_OF_DAY",
    "DATE_AND_TIME",
    "STRING",
    "BYTES",
    "POINTER",
    "ANY",
    "BLOCK_DB",
    "BLOCK_FB",
    "BLOCK_FC",
    "TIMER",
    "COUNTER",
    "TIMER_OR_WORD",
];

const HEAD: &str = "/* Blocks for ob1 in C: what plugin and host agree on. docs/plugins.md tells how to use it.
 *
 * Generated from plugins/sdk/src/abi; see plugins/sdk/tests/header.rs. */
";

const ENTRY: &str = "struct Ob1PluginTable;

#ifdef __cplusplus
extern \"C\"
#endif
// The one function a plugin exports. What it returns is constant and lives as long as the plugin.
const struct Ob1PluginTable *ob1_plugin(void);
";

fn generate() -> String {
    let abi = |file| Path::new(env!("CARGO_MANIFEST_DIR")).join("src/abi").join(file);
    let mut config = cbindgen::Config {
        language: cbindgen::Language::C,
        header: Some(HEAD.to_owned()),
        after_includes: Some(ENTRY.to_owned()),
        include_guard: Some("OB1_H".to_owned()),
        no_includes: true,
        sys_includes: vec!["stddef.h".to_owned(), "stdint.h".to_owned()],
        cpp_compat: true,
        usize_is_size_t: true,
        style: cbindgen::Style::Tag,
        documentation_style: cbindgen::DocumentationStyle::C99,
        line_length: 120,
        ..cbindgen::Config::default()
    };
    config.export.prefix = Some("OB1_".to_owned());
    config.export.renaming_overrides_prefixing = true;
    for name in DATA_TYPES {
        config.export.rename.insert(name.to_owned(), format!("OB1_TY_{name}"));
    }
    for (rust, c) in TYPES {
        config.export.include.push(rust.to_owned());
        config.export.rename.insert(rust.to_owned(), c.to_owned());
    }
    let mut header = Vec::new();
    cbindgen::Builder::new()
        .with_src(abi("codes.rs"))
        .with_src(abi("host.rs"))
        .with_src(abi("plugin.rs"))
        .with_src(abi("settings.rs"))
        .with_config(config)
        .generate()
        .expect("the interface is C through and through")
        .write(&mut header);
    // C has no rustdoc links.
    let header = String::from_utf8(header).expect("C is ASCII");
    let header = header.replace("[`crate::abi::", "`").replace("[`", "`").replace("`]", "`");
    // C can only declare a type without members.
    let (opaque, declared) = ("struct Ob1CallContext {\n  uint8_t _opaque[0];\n};", "struct Ob1CallContext;");
    assert!(header.contains(opaque), "the call context is opaque");
    header.replace(opaque, declared)
}

#[test]
#[expect(clippy::disallowed_methods, reason = "a test of a file reads it, and writes it when asked to")]
fn the_header_is_current() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../include/ob1.h");
    let wanted = generate();
    if std::env::var_os("OB1_UPDATE").is_some() {
        std::fs::write(&path, &wanted).expect("include/ob1.h can be written");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == wanted, "include/ob1.h is not what plugins/sdk/src/abi says; OB1_UPDATE=1 writes it anew");
}
