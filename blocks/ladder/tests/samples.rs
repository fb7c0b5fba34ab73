//! Real projects below `OB1_STEP7_PROJECTS`: which networks of blocks made in LAD or FBD are drawn. Without the
//! variable there is nothing to do: projects belong to their owners, and none is kept here.

#![allow(clippy::disallowed_methods, reason = "the test reads projects from the disk")]

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use common::drawn::check_drawing;

use ob1_ladder::{Form, Network, View, is_ladder, read, read_step7};
use ob1_mc7::{CompiledInterface, MachineBlock, Segments, decode};
use ob1_model::{BlockId, BlockKind, Interface, Section};
use ob1_project::{Block, CodePage, Files, Folder, Language, Tree};
use ob1_stl::Mnemonics;
use ob1_stl::print::Listing;

/// Counts of networks that are not empty.
#[derive(Debug, Default)]
struct Figures {
    /// Without records of lines in the comments: drawn by somebody.
    graphical: usize,
    graphical_as_step7: usize,
    graphical_drawn: usize,
    /// With such records.
    lined: usize,
    lined_as_step7: usize,
    lined_drawn: usize,
    /// Of blocks made in STL.
    stl: usize,
    stl_as_step7: usize,
    stl_drawn: usize,
    /// Of blocks made in LAD: drawn, but as a function plan.
    plans: usize,
}

/// The files of block folders below a folder of the disk.
fn files(at: &Path, name: &str, out: &mut Files) {
    for entry in std::fs::read_dir(at).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), format!("{name}{}", entry.file_name().to_string_lossy()));
        let wanted = ["SUBBLK.DBF", "SUBBLK.DBT", "BAUSTEIN.DBF", "BAUSTEIN.DBT"];
        if path.is_dir() {
            files(&path, &format!("{name}/"), out);
        } else if wanted.iter().any(|w| name.to_ascii_uppercase().ends_with(w)) {
            out.put(&name, std::fs::read(&path).unwrap_or_default());
        }
    }
}

/// The declarations in the order of our compiler.
fn interface(block: &Block, compiled: &CompiledInterface) -> Interface {
    let order = [Section::Input, Section::Output, Section::InOut, Section::Return, Section::Static, Section::Temp];
    let mut interface = compiled.interface(block.id.kind.has_instance());
    if !block.id.kind.has_instance() {
        interface.params.sort_by_key(|p| order.iter().position(|s| *s == p.section));
    }
    interface
}

fn networks(block: &Block, interfaces: &BTreeMap<BlockId, Interface>) -> Option<Vec<Network>> {
    let callees = |id: BlockId| interfaces.get(&id);
    let segments = Segments::read(&block.segments).ok()?;
    let machine = MachineBlock {
        id: block.id,
        name: None,
        interface: interfaces.get(&block.id)?,
        code: &block.code,
        segments: &segments,
        multi_instance: !block.code_version1,
        local_bytes: 0,
    };
    let decoded = decode(&machine, &callees).ok()?;
    let listing = Listing {
        labels: decoded.labels(&segments, &block.comments.labels),
        notations: decoded.notations.clone(),
        ..Listing::default()
    };
    let none = BTreeMap::new();
    let view = View { mnemonics: Mnemonics::German, callees: &callees, symbols: &none, listing: &listing };
    Some(view.networks(&decoded.block))
}

#[test]
fn networks_of_real_projects_are_drawn() {
    let Some(root) = std::env::var_os("OB1_STEP7_PROJECTS") else {
        println!("skipped: OB1_STEP7_PROJECTS names no folder of projects");
        return;
    };
    let mut all = Files::default();
    files(Path::new(&root), "", &mut all);
    let tree = Tree::new(&all);
    let mut folders: Vec<&str> =
        all.0.keys().filter_map(|path| path.rsplit_once('/').map(|(folder, _)| folder)).collect();
    folders.dedup();
    let (mut figures, mut seen, mut reasons) = (Figures::default(), std::collections::BTreeSet::new(), Vec::new());
    for path in folders {
        let Ok(folder) = Folder::read(&tree, &format!("{path}/"), CodePage::default()) else { continue };
        let compiled = |block: &Block| CompiledInterface::read(&block.interface).ok().map(|c| interface(block, &c));
        let interfaces: BTreeMap<BlockId, Interface> =
            folder.blocks.iter().filter_map(|(id, block)| Some((*id, compiled(block)?))).collect();
        use BlockKind::{Fb, Fc, Ob};
        for (id, block) in folder.blocks.iter().filter(|(id, _)| matches!(id.kind, Ob | Fb | Fc)) {
            // Copies of a block count once.
            if !seen.insert((path.split('/').next(), *id, block.code.clone())) {
                continue;
            }
            let Some(networks) = networks(block, &interfaces) else { continue };
            for network in networks.iter().filter(|network| !network.is_empty()) {
                let heading = block.comments.networks.get(usize::from(network.number) - 1);
                let lined = heading.is_some_and(|heading| !heading.lines.is_empty());
                let (strict, drawn) = (read_step7(network), read(network));
                if let Ok(tree) = &drawn {
                    let name = format!("{path} {id}, network {}", network.number);
                    [Form::Ladder, Form::Plan].into_iter().for_each(|form| check_drawing(&name, network, tree, form));
                    figures.plans += usize::from(block.language == Language::Lad && !is_ladder(tree));
                }
                let (all, as_step7, any) = match block.language {
                    Language::Lad | Language::Fbd if lined => {
                        (&mut figures.lined, &mut figures.lined_as_step7, &mut figures.lined_drawn)
                    }
                    Language::Lad | Language::Fbd => {
                        if let Err(reason) = strict {
                            reasons.push(format!(
                                "{path} {id}, network {}: {reason} {}",
                                network.number,
                                if drawn.is_ok() { "(drawn)" } else { "" }
                            ));
                        }
                        (&mut figures.graphical, &mut figures.graphical_as_step7, &mut figures.graphical_drawn)
                    }
                    Language::Stl => (&mut figures.stl, &mut figures.stl_as_step7, &mut figures.stl_drawn),
                    _ => continue,
                };
                *all += 1;
                *as_step7 += usize::from(strict.is_ok());
                *any += usize::from(drawn.is_ok());
            }
        }
    }
    reasons.iter().for_each(|reason| println!("{reason}"));
    println!("{figures:#?}");
    assert!(figures.graphical > 0, "no block in LAD or FBD below {}", Path::new(&root).display());
    // Those that are left were read one by one: all are STL.
    let all = figures.graphical + figures.lined;
    assert!(figures.graphical_as_step7 * 1000 >= figures.graphical * 989, "{figures:?}");
    assert!((figures.graphical_as_step7 + figures.lined_as_step7) * 100 >= all * 84, "{figures:?}");
    assert!(figures.graphical_drawn * 100 >= figures.graphical * 99, "{figures:?}");
}
