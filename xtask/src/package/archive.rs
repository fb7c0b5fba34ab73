//! The plain archive: the tree below `usr` in one folder; it can be unpacked anywhere.

use std::path::{Path, PathBuf};
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
    let mut tar = tar(site.epoch);
    tar.arg(format!("--transform=s,^usr,{name},")).arg("--directory");
    tar.arg(&stage.root).arg("--use-compress-program=gzip --no-name -9").arg("--file").arg(&archive).arg("usr");
    shell::run(&mut tar)?;
    if archive.is_file() { Ok(archive) } else { Err(step(format!("tar has not written {}", archive.display()))) }
}

/// Everything in a folder, not compressed.
pub(super) fn sorted(folder: &Path, archive: &Path, epoch: u64) -> Outcome {
    let mut tar = tar(epoch);
    tar.arg("--directory").arg(folder).arg("--mode=u=rwX,go=rX").arg("--file").arg(archive).arg(".");
    shell::run(&mut tar)
}

/// tar without a trace of this machine.
fn tar(epoch: u64) -> Command {
    let mut tar = Command::new("tar");
    tar.args(["--create", "--sort=name", "--owner=0", "--group=0", "--numeric-owner", "--format=gnu"]);
    tar.arg(format!("--mtime=@{epoch}"));
    tar
}
