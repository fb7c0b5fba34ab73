//! Creates the `.deb` with dpkg-deb.

use std::path::PathBuf;
use std::process::Command;

use super::parts::Parts;
use super::stage::Stage;
use super::{Site, elf, pages};
use crate::cargo;
use crate::failure::{Outcome, step};
use crate::shell;

/// Default maintainer, as `Name <address>`; see `DEBEMAIL`.
const MAINTAINER: &str = "The ob1 developers <ob1@packages.invalid>";

/// The Debian revision after the version.
const REVISION: &str = "1";

/// Scripts that dpkg runs, from `xtask/package`.
const SCRIPTS: [&str; 3] = ["postinst", "prerm", "postrm"];

/// Debian's name for this machine.
fn architecture() -> Outcome<String> {
    Ok(shell::read(Command::new("dpkg").arg("--print-architecture"))?.trim().to_owned())
}

pub(super) fn build(site: &Site, parts: &Parts, stage: &Stage) -> Outcome<PathBuf> {
    let architecture = architecture()?;
    let version = format!("{}-{REVISION}", parts.version);
    let mut tree = Stage::new(site.dist.join("debian-root"))?;
    for (name, mode) in stage.files.iter().filter(|(name, _)| !is_replaced(name)) {
        tree.copy(&stage.root.join(name), name)?;
        if *mode != 0o644 {
            let bytes = std::fs::read(stage.root.join(name)).map_err(|why| step(format!("{name}: {why}")))?;
            tree.put(name, &bytes, *mode)?;
        }
    }
    let own = cargo::root().join("xtask/package");
    tree.copy(&own.join("copyright"), "usr/share/doc/ob1/copyright")?;
    let maintainer = std::env::var("DEBEMAIL").unwrap_or_else(|_| MAINTAINER.to_owned());
    let changes = changelog(&version, &maintainer, &date(site.epoch)?);
    tree.put("usr/share/doc/ob1/changelog.Debian.gz", &pages::gzip(changes.as_bytes())?, 0o644)?;
    let upstream = cargo::root().join("CHANGELOG.md");
    let upstream = std::fs::read(&upstream).map_err(|why| step(format!("{}: {why}", upstream.display())))?;
    tree.put("usr/share/doc/ob1/changelog.gz", &pages::gzip(&upstream)?, 0o644)?;

    let (size, sums) = (tree.kib()?, sums(&tree)?);
    let control = control(&version, &architecture, &maintainer, size, &elf::depends(&tree)?);
    tree.put("DEBIAN/control", control.as_bytes(), 0o644)?;
    tree.put("DEBIAN/md5sums", sums.as_bytes(), 0o644)?;
    for script in SCRIPTS {
        let path = own.join(script);
        let text = std::fs::read(&path).map_err(|why| step(format!("{}: {why}", path.display())))?;
        tree.put(&format!("DEBIAN/{script}"), &text, 0o755)?;
    }
    let stations = tree.root.join("etc/ob1");
    std::fs::create_dir_all(&stations).map_err(|why| step(format!("{}: {why}", stations.display())))?;
    Stage::date(&tree.root, site.epoch)?;
    let package = site.dist.join(format!("ob1_{version}_{architecture}.deb"));
    let mut command = Command::new("dpkg-deb");
    command.env("SOURCE_DATE_EPOCH", site.epoch.to_string());
    command.args(["--root-owner-group", "-Zxz", "--threads-max=1", "--build"]).arg(&tree.root).arg(&package);
    shell::run(&mut command)?;
    Ok(package)
}

/// Whether Debian has its own location for this file.
fn is_replaced(name: &str) -> bool {
    name.starts_with("usr/share/doc/ob1/LICENSE")
}

fn control(version: &str, architecture: &str, maintainer: &str, kib: u64, depends: &str) -> String {
    format!(
        "\
Package: ob1
Version: {version}
Architecture: {architecture}
Maintainer: {maintainer}
Installed-Size: {kib}
Depends: {depends}, systemd | systemd-standalone-sysusers, systemd | systemd-standalone-tmpfiles
Section: electronics
Priority: optional
Description: soft PLC that runs STEP 7 style programs
 A small cyclic runtime for programs in STL (AWL) and for blocks in Rust or C,
 with the handling blocks of serial communication processors (CP 240, CP 040,
 CP 340, CP 341) as plugins and each of these processors as a process of its
 own.
 .
 Stations lie in /etc/ob1 and run as services: systemctl start ob1@press.
"
    )
}

fn changelog(version: &str, maintainer: &str, date: &str) -> String {
    format!("ob1 ({version}) unstable; urgency=medium\n\n  * See changelog.gz.\n\n -- {maintainer}  {date}\n")
}

/// The date in the format of Debian, in UTC.
fn date(epoch: u64) -> Outcome<String> {
    let text = shell::read(
        Command::new("date").env("LC_ALL", "C").args(["--utc", "--rfc-email", "--date"]).arg(format!("@{epoch}")),
    )?;
    Ok(text.trim().to_owned())
}

/// The checksums of all files, sorted by name.
fn sums(tree: &Stage) -> Outcome<String> {
    shell::read(Command::new("md5sum").args(tree.files.keys()).current_dir(&tree.root))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_control_file_has_what_policy_asks_for() {
        let text = control("0.1.0-1", "amd64", MAINTAINER, 7, "libc6 (>= 2.34)");
        for key in ["Package", "Version", "Architecture", "Maintainer", "Installed-Size", "Depends", "Description"] {
            assert!(text.lines().any(|line| line.starts_with(&format!("{key}: "))), "{key}");
        }
        assert!(text.lines().all(|line| line.len() <= 80 || line.starts_with("Depends")), "{text}");
        assert!(text.ends_with('\n') && !text.contains("\n\n"), "one paragraph");
        let changes = changelog("0.1.0-1", "A <a@b.c>", "Thu, 01 Jan 1970 00:00:00 +0000");
        assert!(changes.ends_with(" -- A <a@b.c>  Thu, 01 Jan 1970 00:00:00 +0000\n"), "{changes}");
    }

    #[test]
    fn a_date_is_that_of_its_second() {
        assert_eq!(date(0).expect("date is there"), "Thu, 01 Jan 1970 00:00:00 +0000");
    }
}
