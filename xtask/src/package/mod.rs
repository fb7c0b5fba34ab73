//! `cargo xtask package [--oci] [--check [--short]] [--debug]`: creates the packages that a user installs.
//!
//! One tree (`stage`) contains everything: the programs and plugins of the workspace (`parts`), manual pages,
//! completions, the book, examples, the C header, the crates a plugin in Rust needs, and the files of `xtask/package`.
//! It becomes a `.deb` (`debian`) and a plain archive (`archive`) in `target/dist`. `--check` checks both, and installs
//! the package in a minimal Debian (`check`, `bare`).
//!
//! `--oci` makes an image for containers of the same parts instead (`oci`), and runs it without rights (`oci_check`).

mod archive;
mod bare;
mod check;
mod crates;
mod debian;
mod elf;
mod oci;
mod oci_check;
mod pages;
mod parts;
mod podman;
mod stage;

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::cargo::{self, Profile, cargo};
use crate::failure::{Failure, Outcome, step};
use crate::{book, needs, shell};
use parts::Parts;
use stage::Stage;

/// The folders and settings of a run.
struct Site {
    /// Where the packages go: `target/dist`.
    dist: PathBuf,
    /// The folder of the built programs and plugins.
    built: PathBuf,
    profile: Profile,
    /// The date of all files, in seconds since 1970.
    epoch: u64,
}

/// Paths of the created packages.
struct Made {
    debian: PathBuf,
    archive: PathBuf,
}

/// # Errors
/// If anything cannot be built, or the check finds an error.
pub(crate) fn run(args: &[String]) -> Outcome {
    let (mut wants_check, mut wants_image, mut is_short, mut profile) = (false, false, false, Profile::Release);
    for arg in args {
        match arg.as_str() {
            "--check" => wants_check = true,
            "--oci" => wants_image = true,
            "--short" => is_short = true,
            "--debug" => profile = Profile::Debug,
            other => return Err(Failure::Usage(format!("package knows no `{other}`"))),
        }
    }
    if is_short && !(wants_image && wants_check) {
        return Err(Failure::Usage("--short is for package --oci --check".into()));
    }
    let parts = Parts::of_workspace()?;
    shell::run(cargo(&["build"]).args(parts.flags()).args(profile.flags()))?;
    if is_short {
        println!("{}", image_of(profile)?);
        return Ok(());
    }
    let site = Site::new(profile)?;
    if wants_image {
        needs::satisfy(&[needs::BUILDAH])?;
        let image = oci::build(&site, &parts)?;
        for file in [&image.oci, &image.docker] {
            println!("{}  {}", digest(file)?, file.display());
        }
        return if wants_check { oci_check::run(&site, &parts, &image) } else { Ok(()) };
    }
    let book = match profile {
        Profile::Release => book::build()?,
        Profile::Debug | Profile::Demo => cargo::root().join("docs"),
    };
    let made = make(&site, &parts, &book)?;
    for file in [&made.debian, &made.archive] {
        println!("{}  {}", digest(file)?, file.display());
    }
    if wants_check { check::run(&site, &parts, &book, &made) } else { Ok(()) }
}

/// The image of what is built already, in the short form of its check.
///
/// # Errors
/// If it cannot be made of these programs, or fails; not where the machine cannot run containers: the text says it.
pub(crate) fn image_of(profile: Profile) -> Outcome<String> {
    oci_check::short(&Site::new(profile)?, &Parts::of_workspace()?)
}

impl Site {
    fn new(profile: Profile) -> Outcome<Self> {
        let dist = cargo::target_dir()?.join("dist");
        std::fs::create_dir_all(&dist).map_err(|why| step(format!("{}: {why}", dist.display())))?;
        Ok(Self { dist, built: profile.folder()?, profile, epoch: epoch()? })
    }
}

/// Creates the tree and both packages.
fn make(site: &Site, parts: &Parts, book: &Path) -> Outcome<Made> {
    let stage = stage_of(site, parts, book)?;
    Ok(Made { debian: debian::build(site, parts, &stage)?, archive: archive::build(site, &parts.version, &stage)? })
}

fn stage_of(site: &Site, parts: &Parts, book: &Path) -> Outcome<Stage> {
    let root = cargo::root();
    let own = root.join("xtask/package");
    let mut stage = Stage::new(site.dist.join("root"))?;
    for program in &parts.programs {
        stage.object(&site.built.join(&program.name), &format!("usr/bin/{}", program.name), 0o755)?;
    }
    for plugin in &parts.plugins {
        stage.object(&site.built.join(plugin), &format!("usr/lib/ob1/{plugin}"), 0o644)?;
    }
    for (file, to) in [
        ("ob1@.service", "usr/lib/systemd/system/ob1@.service"),
        ("sysusers.conf", "usr/lib/sysusers.d/ob1.conf"),
        ("tmpfiles.conf", "usr/lib/tmpfiles.d/ob1.conf"),
        ("udev.rules", "usr/lib/udev/rules.d/60-ob1.rules"),
    ] {
        stage.copy(&own.join(file), to)?;
    }
    stage.copy(&root.join("include/ob1.h"), "usr/include/ob1.h")?;
    pages::manuals(site, parts, &mut stage)?;
    stage.folder(book, "usr/share/doc/ob1/html")?;
    stage.tracked("examples", "usr/share/doc/ob1/examples")?;
    for (file, to) in [("README.md", "README.md"), ("LICENSE-MIT", "LICENSE-MIT"), ("LICENSE-APACHE", "LICENSE-APACHE")]
    {
        stage.copy(&root.join(file), &format!("usr/share/doc/ob1/{to}"))?;
    }
    crates::into(&mut stage, &parts.version)?;
    Ok(stage)
}

/// `SOURCE_DATE_EPOCH`, or the date of the last commit: two runs on one commit give the same files.
fn epoch() -> Outcome<u64> {
    let text = match std::env::var("SOURCE_DATE_EPOCH") {
        Ok(text) => text,
        Err(_) => shell::read(Command::new("git").args(["log", "-1", "--format=%ct"]).current_dir(cargo::root()))?,
    };
    text.trim().parse().map_err(|_| step(format!("SOURCE_DATE_EPOCH: `{}` is no number of seconds", text.trim())))
}

/// The SHA-256 of a file, calculated by coreutils.
fn digest(file: &Path) -> Outcome<String> {
    let text = shell::read(Command::new("sha256sum").arg(file))?;
    Ok(text.split(' ').next().unwrap_or_default().to_owned())
}
