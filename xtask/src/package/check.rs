//! `cargo xtask package --check`: checks the created packages.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::parts::Parts;
use super::{Made, Site, bare, digest, make};
use crate::cargo::cargo;
use crate::failure::{Outcome, step};
use crate::{needs, shell};

/// Limit for `systemd-analyze security` in tenths: the scan and its processes need this much.
const EXPOSURE: u32 = 22;

pub(super) fn run(site: &Site, parts: &Parts, book: &Path, made: &Made) -> Outcome {
    needs::satisfy(&[needs::LINTIAN, needs::DEBOOTSTRAP, needs::NSPAWN])?;
    let mut done = Vec::new();
    let mut passed = |what: &str| {
        println!("ok  {what}");
        done.push(what.to_owned());
    };
    twice(site, parts, book, made)?;
    passed("made twice, the same to the byte");
    lintian(&made.debian)?;
    passed("lintian finds no error");
    unit(site)?;
    passed("the unit is sound, and exposed to no more than 2.2");
    anywhere(made)?;
    passed("the archive, unpacked anywhere: a new station and new plugins in C and Rust run");
    let how = bare::run(site, made)?;
    passed(&format!("a bare Debian ({how}): installed, a station with a CP ran, purged, nothing left"));
    println!("package: {} checks passed", done.len());
    Ok(())
}

/// The same commit gives the same files.
fn twice(site: &Site, parts: &Parts, book: &Path, made: &Made) -> Outcome {
    let before = (digest(&made.debian)?, digest(&made.archive)?);
    let again = make(site, parts, book)?;
    let after = (digest(&again.debian)?, digest(&again.archive)?);
    if before == after { Ok(()) } else { Err(step(format!("made twice, not the same: {before:?}, then {after:?}"))) }
}

fn lintian(package: &Path) -> Outcome {
    shell::run(Command::new("lintian").args(["--fail-on", "error", "--no-tag-display-limit"]).arg(package))
}

/// Checks the unit in the tree of the package with systemd.
fn unit(site: &Site) -> Outcome {
    let unit = site.dist.join("root/usr/lib/systemd/system/ob1@.service");
    let text = std::fs::read_to_string(&unit).map_err(|why| step(format!("{}: {why}", unit.display())))?;
    // The tree has no /bin/sh, and its ob1 is at another path: this is not an error of the unit.
    let here = site.dist.join("ob1@.service");
    let ob1 = site.dist.join("root/usr/bin/ob1");
    std::fs::write(&here, text.replace("/usr/bin/ob1", &ob1.display().to_string()))
        .map_err(|why| step(format!("{}: {why}", here.display())))?;
    let output = Command::new("systemd-analyze")
        .args(["verify", "--man=no", "--recursive-errors=no"])
        .arg(site.dist.join("ob1@.service"))
        .output()
        .map_err(|why| step(format!("systemd-analyze: {why}")))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() || said.lines().any(|line| line.contains("ob1@")) {
        return Err(step(format!("systemd-analyze verify: {said}")));
    }
    let threshold = format!("--threshold={EXPOSURE}");
    shell::run(
        Command::new("systemd-analyze").args(["security", "--no-pager", "--offline=true", &threshold]).arg(&unit),
    )
}

/// A temporary folder outside the checkout, removed at the end.
struct Away(PathBuf);

impl Away {
    fn new() -> Outcome<Self> {
        let path = std::env::temp_dir().join(format!("ob1-package-{}", std::process::id()));
        std::fs::create_dir_all(&path).map_err(|why| step(format!("{}: {why}", path.display())))?;
        Ok(Self(path))
    }
}

impl Drop for Away {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Tests the plain archive without access to the checkout.
fn anywhere(made: &Made) -> Outcome {
    let away = Away::new()?;
    let away = away.0.as_path();
    shell::run(Command::new("tar").arg("-C").arg(away).arg("-xf").arg(&made.archive))?;
    let folder = std::fs::read_dir(away).ok().and_then(|mut entries| Some(entries.next()?.ok()?.path()));
    let ob1 = folder.ok_or_else(|| step("the archive is empty"))?.join("bin/ob1");
    let at = |folder: &Path, args: &[&str]| {
        let mut command = Command::new(&ob1);
        command.args(args).current_dir(folder).env("XDG_RUNTIME_DIR", away).env_remove("OB1_PLUGIN_DIR");
        shell::run(&mut command)
    };
    let runs = |folder: &Path| {
        at(folder, &["check", "station.toml"])?;
        at(folder, &["test"])?;
        at(folder, &["run", "station.toml", "--scans", "10", "--quiet"])
    };
    at(away, &["new", "station", "press"])?;
    runs(&away.join("press"))?;
    at(away, &["new", "plugin", "in-c"])?;
    shell::run(Command::new("make").current_dir(away.join("in-c")))?;
    runs(&away.join("in-c"))?;
    at(away, &["new", "plugin", "in-rust", "--language", "rust"])?;
    let plugin = away.join("in-rust");
    let mut build = cargo(&["build", "--release", "--offline"]);
    shell::run(build.current_dir(&plugin).env("CARGO_TARGET_DIR", plugin.join("target")))?;
    runs(&plugin)?;
    // The handling blocks of the package, installed with its ob1.
    at(away, &["check", "--plugin", "ob1_cp240"])
}
