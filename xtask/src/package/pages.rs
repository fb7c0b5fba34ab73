//! Manual pages and shell completions: those of `ob1` are generated from its command line
//! (`runtime/ob1/examples/manual.rs`), those of the processes it starts from their help texts.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use super::Site;
use super::parts::{Parts, Program};
use super::stage::Stage;
use crate::cargo::cargo;
use crate::failure::{Outcome, step};
use crate::shell;

const MANUALS: &str = "usr/share/man/man1";

/// The completion files, and where each shell looks for them.
const COMPLETIONS: [(&str, &str); 3] = [
    ("ob1.bash", "usr/share/bash-completion/completions/ob1"),
    ("_ob1", "usr/share/zsh/vendor-completions/_ob1"),
    ("ob1.fish", "usr/share/fish/vendor_completions.d/ob1.fish"),
];

pub(super) fn manuals(site: &Site, parts: &Parts, stage: &mut Stage) -> Outcome {
    let made = site.dist.join("manual");
    let _ = std::fs::remove_dir_all(&made);
    let mut command = cargo(&["run", "--quiet", "--example", "manual"]);
    shell::run(command.args(parts.command()).args(site.profile.flags()).arg("--").arg(&made))?;
    let folder = made.join("man");
    let pages = std::fs::read_dir(&folder).map_err(|why| step(format!("{}: {why}", folder.display())))?;
    for page in pages.flatten() {
        let name = page.file_name().to_string_lossy().into_owned();
        let bytes = read(&page.path())?;
        stage.put(&format!("{MANUALS}/{name}.gz"), &gzip(&bytes)?, 0o644)?;
    }
    for (file, to) in COMPLETIONS {
        stage.copy(&made.join("completions").join(file), to)?;
    }
    for program in parts.programs.iter().filter(|program| program.name != "ob1") {
        let help = shell::read(Command::new(site.built.join(&program.name)).arg("--help"))?;
        let page = of_help(program, &parts.version, &help);
        stage.put(&format!("{MANUALS}/{}.1.gz", program.name), &gzip(page.as_bytes())?, 0o644)?;
    }
    Ok(())
}

fn read(path: &Path) -> Outcome<Vec<u8>> {
    std::fs::read(path).map_err(|why| step(format!("{}: {why}", path.display())))
}

/// A page of a program that users rarely start: its help text, unchanged.
fn of_help(program: &Program, version: &str, help: &str) -> String {
    let name = &program.name;
    let mut page = format!(
        ".TH {name} 1 \"\" \"{name} {version}\"\n.SH NAME\n{name} \\- {}\n.SH DESCRIPTION\nStarted by\n.BR ob1 (1).\n.PP\n.nf\n",
        escaped(&program.about)
    );
    for line in help.lines() {
        page.push_str(&escaped(line));
        page.push('\n');
    }
    page.push_str(".fi\n.SH SEE ALSO\n.BR ob1 (1)\n");
    page
}

/// Escapes a line of text, so that it is not taken for a command.
fn escaped(line: &str) -> String {
    let text = line.replace('\\', "\\e").replace('-', "\\-");
    if text.starts_with(['.', '\'']) { format!("\\&{text}") } else { text }
}

/// Compresses without a name and a date.
pub(super) fn gzip(bytes: &[u8]) -> Outcome<Vec<u8>> {
    let failed = |why: std::io::Error| step(format!("gzip: {why}"));
    let mut child = Command::new("gzip")
        .args(["--no-name", "-9"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    let mut input = child.stdin.take().ok_or_else(|| step("gzip has no input"))?;
    let text = bytes.to_owned();
    // In a second thread, because a page may be larger than a pipe.
    let writer = std::thread::spawn(move || input.write_all(&text));
    let output = child.wait_with_output().map_err(failed)?;
    match (writer.join(), output.status.success()) {
        (Ok(Ok(())), true) => Ok(output.stdout),
        _ => Err(step("gzip failed")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_help_text_is_shown_as_it_is() {
        assert_eq!(escaped("  --name <NAME>  a\\b"), "  \\-\\-name <NAME>  a\\eb");
        assert_eq!(escaped(".TH"), "\\&.TH");
        assert_eq!(escaped("'x"), "\\&'x");
    }

    #[test]
    fn the_same_bytes_compress_to_the_same() {
        let text = vec![b'x'; 1 << 20];
        let once = gzip(&text).expect("gzip is there");
        assert!(once.len() < 10_000 && once == gzip(&text).expect("gzip is there"));
        // Bytes 4 to 7 are the date.
        assert_eq!(once[4..8], [0; 4]);
    }
}
