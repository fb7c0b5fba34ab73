//! Compares the handling blocks declared in `blocks/std/src/handling.rs` with those of the plugins: a program compiled
//! with the declaration must have the same meaning with the plugin.
//!
//! Checks all plugins in `plugins/`: fails for a plugin whose library is not declared or was not built.

use std::collections::BTreeMap;
use std::path::Path;

use ob1_host::plugin::{BlockInfo, PluginInfo, describe};
use ob1_model::{BlockId, Interface, Param};
use ob1_std::{StandardBlock, standard_blocks};

/// Plugins in `plugins/` whose blocks are not declared in a library, with the reason.
const NOT_DECLARED: &[(&str, &str)] = &[("mbus", "blocks of our own: a program that calls them comes with the plugin")];

fn checkout() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// The folders below `plugins/` that are built as plugins.
fn plugins() -> Vec<String> {
    let entries = std::fs::read_dir(checkout().join("plugins")).expect("the checkout has plugins");
    let mut names: Vec<String> = entries
        .map(|entry| entry.expect("readable").path())
        .filter(|path| {
            let manifest = std::fs::read_to_string(path.join("Cargo.toml"));
            manifest.is_ok_and(|text| text.contains("\"cdylib\""))
        })
        .map(|path| path.file_name().expect("a folder").to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// The declarations of the blocks of a plugin: `CP240` for `plugins/cp240`.
fn library(plugin: &str) -> BTreeMap<BlockId, StandardBlock> {
    let is_served =
        |block: &StandardBlock| block.origin.plugin().is_some_and(|name| name.strip_prefix("ob1_") == Some(plugin));
    standard_blocks().into_iter().filter(is_served).map(|block| (block.id, block)).collect()
}

/// A parameter as seen by a program. An initial value of zeros is ignored.
fn seen(param: &Param) -> String {
    let mut aliases = param.aliases.clone();
    aliases.sort();
    let initial = param.initial.as_ref().filter(|bytes| bytes.iter().any(|byte| *byte != 0));
    format!("{:?} {}|{} : {:?} at {} := {initial:?}", param.section, param.name, aliases.join("|"), param.ty, param.at)
}

fn seen_all(interface: &Interface) -> Vec<String> {
    interface.formals().map(seen).collect()
}

/// Differences between declared and exported blocks, one line each.
fn differences(declared: &BTreeMap<BlockId, StandardBlock>, exported: &[BlockInfo]) -> Vec<String> {
    let mut found = Vec::new();
    for block in exported {
        let Some(known) = declared.get(&block.id) else {
            found.push(format!("{} {} is not declared", block.id, block.name));
            continue;
        };
        if known.name != block.name {
            found.push(format!("{} is called {}, the declaration says {}", block.id, block.name, known.name));
        }
        let (ours, theirs) = (seen_all(&known.interface), seen_all(&block.interface));
        for index in 0..ours.len().max(theirs.len()) {
            let (ours, theirs) = (ours.get(index), theirs.get(index));
            if ours != theirs {
                found.push(format!("{} parameter {index}: declared {ours:?}, exported {theirs:?}", block.id));
            }
        }
    }
    let served = |id: &BlockId| exported.iter().any(|block| block.id == *id);
    let missing = declared.values().filter(|block| !served(&block.id));
    found.extend(
        missing.map(|block| format!("{} {} is declared, but the plugin does not bring it", block.id, block.name)),
    );
    found
}

fn exports(plugin: &str) -> PluginInfo {
    let folder = std::env::var_os("OB1_PLUGIN_DIR").expect("OB1_PLUGIN_DIR is not set; run: cargo xtask test");
    let path = Path::new(&folder).join(format!("libob1_{plugin}.so"));
    describe(&path).unwrap_or_else(|error| panic!("{}: {error}; run: cargo xtask test", path.display()))
}

#[test]
fn every_plugin_brings_what_is_declared() {
    let plugins = plugins();
    assert!(plugins.iter().any(|name| name == "cp240"), "{plugins:?}");
    let mut found = Vec::new();
    for plugin in &plugins {
        if NOT_DECLARED.iter().any(|(name, _)| name == plugin) {
            continue;
        }
        let declared = library(plugin);
        if declared.is_empty() {
            found.push(format!(
                "plugins/{plugin} serves no library declared in blocks/std/src/handling.rs: declare its blocks there, \
                 or give the reason in NOT_DECLARED"
            ));
            continue;
        }
        let told = differences(&declared, &exports(plugin).blocks);
        found.extend(told.into_iter().map(|line| format!("{plugin}: {line}")));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// The reverse: no library is declared without a plugin that implements it.
#[test]
fn every_library_has_its_plugin() {
    let plugins = plugins();
    for block in standard_blocks() {
        let Some(plugin) = block.origin.plugin() else { continue };
        assert!(
            plugins.iter().any(|name| plugin.strip_prefix("ob1_") == Some(name)),
            "{block:?} is declared, and plugins/ has no {plugin}"
        );
    }
}

#[test]
fn a_difference_is_told() {
    let declared = library("cp341");
    let exported = |change: &dyn Fn(&mut BlockInfo)| -> Vec<BlockInfo> {
        let copy = |block: &StandardBlock| BlockInfo {
            id: block.id,
            name: block.name.to_owned(),
            interface: block.interface.clone(),
        };
        let mut blocks: Vec<BlockInfo> = declared.values().map(copy).collect();
        blocks.iter_mut().for_each(change);
        blocks
    };
    let told = |change: &dyn Fn(&mut BlockInfo)| differences(&declared, &exported(change)).len();
    let blocks = declared.len();
    assert_eq!(told(&|_| ()), 0);
    assert_eq!(told(&|block| block.name.push('X')), blocks);
    assert_eq!(told(&|block| block.interface.params[0].name.push('X')), blocks);
    assert_eq!(told(&|block| block.interface.params[1].aliases.push("X".into())), blocks);
    assert_eq!(told(&|block| block.interface.params[0].initial = Some(vec![1])), blocks);
    assert_eq!(told(&|block| block.interface.params[0].initial = Some(vec![0])), 1, "SF of FB 8 has one");
    assert_eq!(told(&|block| _ = block.interface.params.pop()), blocks);
    // A block with another number is not declared, and the declared one is missing.
    assert_eq!(told(&|block| block.id.number += 100), 2 * blocks);
}
