//! The image of a container: the programs and plugins of the package, the C library they need, and nothing else.
//!
//! buildah makes it from nothing, without a daemon and without another image. It is kept in two forms: by the OCI's
//! specification, which has no health check, and in Docker's form, which has one (and the number of the container that
//! has made it, so that only the other one is the same each time).

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::parts::Parts;
use super::stage::Stage;
use super::{Site, archive};
use crate::cargo;
use crate::failure::{Failure, Outcome, step};
use crate::shell;

/// The user of the image: that of the package where it is installed first.
const USER: &str = "990:990";
/// Where the station file is; a folder of the host or a volume, read only.
const STATION: &str = "/etc/ob1/station.toml";
/// The only volume: retentive files, downloaded blocks, what the gate keeps.
const STATE: &str = "/var/lib/ob1";
/// The name of [`probe`].
pub(super) const PROBE: &str = "localhost/ob1-probe:now";

/// The archives of the image.
pub(super) struct Image {
    pub(super) oci: PathBuf,
    pub(super) docker: PathBuf,
    /// Size of its files, in KiB.
    pub(super) kib: u64,
    /// The name in the archives.
    pub(super) name: String,
}

/// An image of a program of this machine that does nothing: what fails with it is no fault of ours.
pub(super) fn probe(site: &Site) -> Outcome<PathBuf> {
    let mut stage = Stage::new(site.dist.join("image"))?;
    let program = Path::new("/bin/true");
    stage.put("bin/true", &std::fs::read(program).map_err(|why| step(format!("/bin/true: {why}")))?, 0o755)?;
    libraries(&mut stage, std::iter::once(program.to_owned()))?;
    let archive = site.dist.join("probe.tar");
    let _ = std::fs::remove_file(&archive);
    let store = Store::new(site)?;
    let container = store.read(&["from", "scratch"])?;
    store.run(&["copy", "--quiet", &container, &format!("{}/", stage.root.display()), "/"])?;
    store.run(&["commit", "--quiet", "--format", "docker", &container, PROBE])?;
    store.run(&["push", "--quiet", PROBE, &format!("docker-archive:{}:{PROBE}", archive.display())])?;
    Ok(archive)
}

/// Makes the image in `target/dist`.
pub(super) fn build(site: &Site, parts: &Parts) -> Outcome<Image> {
    let stage = stage_of(site, parts)?;
    Stage::date(&stage.root, site.epoch)?;
    // What the user of the image may write where nothing is mounted.
    for folder in ["var/lib/ob1", "run", "tmp"] {
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o1777);
        std::fs::set_permissions(stage.root.join(folder), mode).map_err(|why| step(format!("{folder}: {why}")))?;
    }
    let name = format!("ob1:{}", parts.version);
    let named = |form: &str| site.dist.join(format!("ob1-{}-{}-{form}.tar", parts.version, std::env::consts::ARCH));
    let image = Image { oci: named("oci"), docker: named("docker"), kib: stage.kib()?, name };
    for file in [&image.oci, &image.docker] {
        let _ = std::fs::remove_file(file);
    }
    let store = Store::new(site)?;
    let container = store.read(&["from", "--name", "ob1-image", "scratch"])?;
    // As root of the image: who has built it does not matter.
    store.run(&["copy", "--quiet", "--chown", "0:0", &container, &format!("{}/", stage.root.display()), "/"])?;
    let health = format!("CMD /usr/bin/ob1 ctl {STATION} ready");
    store.run(&[
        "config",
        "--entrypoint",
        "[\"/usr/bin/ob1\"]",
        "--cmd",
        &format!("run {STATION}"),
        "--user",
        USER,
        "--workingdir",
        STATE,
        "--volume",
        STATE,
        "--env",
        "XDG_RUNTIME_DIR=/run",
        "--env",
        &format!("STATE_DIRECTORY={STATE}"),
        "--env",
        "PATH=/usr/bin",
        "--stop-signal",
        "SIGTERM",
        "--healthcheck",
        &health,
        "--healthcheck-interval",
        "10s",
        "--healthcheck-start-period",
        "10s",
        "--label",
        &format!("org.opencontainers.image.version={}", parts.version),
        &container,
    ])?;
    let epoch = site.epoch.to_string();
    store.run(&["commit", "--quiet", "--format", "docker", "--timestamp", &epoch, &container, &image.name])?;
    store.run(&[
        "push",
        "--quiet",
        &image.name,
        &format!("docker-archive:{}:{}", image.docker.display(), image.name),
    ])?;
    // A folder, packed by ourselves: buildah dates the archive by the clock.
    let layout = site.dist.join("layout");
    let _ = std::fs::remove_dir_all(&layout);
    store.run(&[
        "push",
        "--quiet",
        "--format",
        "oci",
        &image.name,
        &format!("oci:{}:{}", layout.display(), image.name),
    ])?;
    archive::sorted(&layout, &image.oci, site.epoch)?;
    let _ = std::fs::remove_dir_all(&layout);
    Ok(image)
}

/// The tree of the image.
fn stage_of(site: &Site, parts: &Parts) -> Outcome<Stage> {
    let mut stage = Stage::new(site.dist.join("image"))?;
    for program in &parts.programs {
        stage.object(&site.built.join(&program.name), &format!("usr/bin/{}", program.name), 0o755)?;
    }
    for plugin in &parts.plugins {
        stage.object(&site.built.join(plugin), &format!("usr/lib/ob1/{plugin}"), 0o644)?;
    }
    libraries(&mut stage, parts.programs.iter().map(|program| site.built.join(&program.name)))?;
    let root = cargo::root();
    for file in ["LICENSE-MIT", "LICENSE-APACHE"] {
        stage.copy(&root.join(file), &format!("usr/share/doc/ob1/{file}"))?;
    }
    for package in ["libc6", "libgcc-s1"] {
        let file = format!("/usr/share/doc/{package}/copyright");
        stage.copy(Path::new(&file), &format!("usr/share/doc/{package}/copyright"))?;
    }
    stage.put("etc/passwd", b"root:x:0:0::/:/nologin\nob1:x:990:990::/var/lib/ob1:/nologin\n", 0o644)?;
    stage.put("etc/group", b"root:x:0:\nob1:x:990:\ndialout:x:20:ob1\n", 0o644)?;
    // Mounts need a place; what is in them belongs to nobody here.
    for folder in ["etc/ob1", "var/lib/ob1", "run", "tmp", "proc", "sys", "dev"] {
        let path = stage.root.join(folder);
        std::fs::create_dir_all(&path).map_err(|why| step(format!("{}: {why}", path.display())))?;
    }
    Ok(stage)
}

/// Adds the libraries that these programs need.
fn libraries(stage: &mut Stage, programs: impl Iterator<Item = PathBuf>) -> Outcome {
    let mut libraries = BTreeSet::new();
    for program in programs {
        libraries.extend(needed(&shell::read(Command::new("ldd").arg(program))?));
    }
    for library in libraries {
        let path = Path::new(&library);
        let real = path.canonicalize().map_err(|why| step(format!("{library}: {why}")))?;
        // As the loader looks for them, wherever this machine has them; the loader itself stands in each program.
        stage.copy(&real, library.trim_start_matches('/'))?;
        executable(&stage.root.join(library.trim_start_matches('/')))?;
    }
    Ok(())
}

fn executable(path: &Path) -> Outcome {
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(path, mode).map_err(|why| step(format!("{}: {why}", path.display())))
}

/// The libraries in the output of `ldd`: `libc.so.6 => /lib/.../libc.so.6 (0x...)`, and the loader.
fn needed(text: &str) -> Vec<String> {
    let words = |line: &str| -> Vec<String> { line.split_whitespace().map(str::to_owned).collect() };
    let of = |line: &str| words(line).into_iter().find(|word| word.starts_with('/'));
    text.lines().filter_map(of).collect()
}

/// A storage of buildah's own: nothing of this machine's images is seen or touched.
struct Store {
    options: Vec<String>,
    folder: PathBuf,
}

impl Store {
    fn new(site: &Site) -> Outcome<Self> {
        let folder = site.dist.join("store");
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).map_err(|why| step(format!("{}: {why}", folder.display())))?;
        let options = ["--storage-driver", "vfs"].map(str::to_owned).into_iter();
        let own = |option: &str, name: &str| [option.to_owned(), folder.join(name).display().to_string()];
        Ok(Self { options: options.chain(own("--root", "root")).chain(own("--runroot", "run")).collect(), folder })
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new("buildah");
        command.args(&self.options).args(args);
        command
    }

    fn run(&self, args: &[&str]) -> Outcome {
        shell::read(&mut self.command(args)).map(drop)
    }

    fn read(&self, args: &[&str]) -> Outcome<String> {
        Ok(shell::read(&mut self.command(args))?.trim().to_owned())
    }
}

impl Drop for Store {
    fn drop(&mut self) {
        // Its files belong to other users where nobody is root: only buildah can remove them there.
        let _: Result<(), Failure> = self.run(&["rm", "--all"]).and_then(|()| self.run(&["rmi", "--all", "--force"]));
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

#[cfg(test)]
mod tests {
    use super::needed;

    #[test]
    fn libraries_and_the_loader() {
        let text = "\tlinux-vdso.so.1 (0x00007fff)\n\tlibm.so.6 => /lib/x86_64-linux-gnu/libm.so.6 (0x00007f)\n\
            \t/lib64/ld-linux-x86-64.so.2 (0x00007f)\n";
        assert_eq!(needed(text), ["/lib/x86_64-linux-gnu/libm.so.6", "/lib64/ld-linux-x86-64.so.2"]);
    }
}
