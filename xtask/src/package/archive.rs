//! The plain archive: the tree below `usr` in one folder; it can be unpacked anywhere.

use std::path::PathBuf;
use std::process::Command;

use super::Site;
use super::stage::Stage;
use crate::failure::{Outcome, step};
use crate::shell;

/// Written sorted, without an owner, with one time: two runs give the same bytes.
pub(super) fn build(site: &Site, version: &str, stage: &Stage) -> Outcome<PathBuf> {
    let name = format!("ob1-{version}-{}-linux", std::env::consts::ARCH);
    let archive = site.dist.join(format!("{name}.tar.gz"));
    Stage::date(&stage.root, site.epoch)?;
    let mut tar = Command::new("tar");
    tar.args(["--create", "--sort=name", "--owner=0", "--group=0", "--numeric-owner", "--format=gnu"]);
    tar.arg(format!("--mtime=@{}", site.epoch)).arg(format!("--transform=s,^usr,{name},")).arg("--directory");
    tar.arg(&stage.root).arg("--use-compress-program=gzip --no-name -9").arg("--file").arg(&archive).arg("usr");
    shell::run(&mut tar)?;
    if archive.is_file() { Ok(archive) } else { Err(step(format!("tar has not written {}", archive.display()))) }
}
