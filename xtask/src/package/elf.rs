//! The requirements of programs and libraries, read by objdump: the packages of the libraries, the minimum version of
//! the C library.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use super::stage::Stage;
use crate::failure::{Outcome, step};
use crate::shell;

/// Libraries, and the Debian packages that provide them.
const PACKAGES: [(&str, &str); 4] =
    [("libc.so.6", "libc6"), ("libm.so.6", "libc6"), ("ld-linux", "libc6"), ("libgcc_s.so.1", "libgcc-s1")];

/// `Depends` for the programs and libraries in the tree.
pub(super) fn depends(stage: &Stage) -> Outcome<String> {
    let mut found = Needs::default();
    for name in stage.files.keys().filter(|name| name.starts_with("usr/bin/") || name.ends_with(".so")) {
        found.read(&shell::read(Command::new("objdump").arg("-p").arg(stage.root.join(name)))?);
    }
    found.depends()
}

/// The requirements of all files that were read.
#[derive(Debug, Default)]
struct Needs {
    libraries: BTreeSet<String>,
    /// The newest version of each library's symbols.
    newest: BTreeMap<String, Vec<u32>>,
}

impl Needs {
    /// The output of `objdump -p`: `NEEDED` lines, and symbol versions below each library's name.
    fn read(&mut self, text: &str) {
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["NEEDED", library] => _ = self.libraries.insert((*library).to_owned()),
                [_, _, _, symbol] => {
                    if let Some(version) = symbol.strip_prefix("GLIBC_") {
                        let parts: Option<Vec<u32>> = version.split('.').map(|part| part.parse().ok()).collect();
                        let newest = self.newest.entry("libc6".to_owned()).or_default();
                        *newest = parts.unwrap_or_default().max(std::mem::take(newest));
                    }
                }
                _ => {}
            }
        }
    }

    fn depends(&self) -> Outcome<String> {
        let mut packages = BTreeSet::new();
        for library in &self.libraries {
            let Some((_, package)) = PACKAGES.iter().find(|(name, _)| library.starts_with(name)) else {
                return Err(step(format!("{library} is needed; name its package in xtask/src/package/elf.rs")));
            };
            let version = self.newest.get(*package).map(|parts| {
                let parts: Vec<String> = parts.iter().map(u32::to_string).collect();
                format!(" (>= {})", parts.join("."))
            });
            packages.insert(format!("{package}{}", version.unwrap_or_default()));
        }
        Ok(packages.into_iter().collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
Dynamic Section:
  NEEDED               libgcc_s.so.1
  NEEDED               libc.so.6
  NEEDED               ld-linux-x86-64.so.2
  INIT                 0x0000000000001000

Version References:
  required from libc.so.6:
    0x09691a75 0x00 05 GLIBC_2.2.5
    0x069691b4 0x00 04 GLIBC_2.34
    0x06969194 0x00 03 GLIBC_2.4
  required from libgcc_s.so.1:
    0x09276060 0x00 02 GCC_4.2.0
";

    #[test]
    fn the_newest_symbol_says_which_c_library() {
        let mut needs = Needs::default();
        needs.read(TEXT);
        assert_eq!(needs.depends().expect("all known"), "libc6 (>= 2.34), libgcc-s1");
        needs.read("  NEEDED  libudev.so.1\n");
        assert!(needs.depends().is_err(), "a library without a package");
    }
}
