//! A project in a `.zip`, as STEP 7's "Archive" and every file manager make it.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt;
use std::io::{Cursor, Read};

use crate::tree::FileSource;

/// The longest file read from an archive: a memo file of the largest plants has some tens of megabytes.
pub const LONGEST_FILE: u64 = 256 << 20;
/// Most files of an archive that are read.
const MOST_FILES: usize = 200_000;

/// The files of a `.zip`, unpacked one at a time on request.
pub struct Archive {
    zip: RefCell<zip::ZipArchive<Cursor<Vec<u8>>>>,
    /// Path to index; names of old archives are in the code page of the machine that packed them.
    index: BTreeMap<String, usize>,
}

impl fmt::Debug for Archive {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Archive").field("files", &self.index.len()).finish()
    }
}

impl Archive {
    /// Opens an archive, whose content is not trusted.
    ///
    /// # Errors
    /// Why it is not one, in one sentence.
    pub fn open(bytes: Vec<u8>) -> Result<Self, String> {
        let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).map_err(|e| format!("not a .zip archive: {e}"))?;
        if zip.len() > MOST_FILES {
            return Err(format!("the archive has {} files; at most {MOST_FILES} are read", zip.len()));
        }
        let mut index = BTreeMap::new();
        for i in 0..zip.len() {
            let Ok(file) = zip.by_index_raw(i) else { continue };
            let name = file.name().map(|name| name.replace('\\', "/"));
            if let (false, Ok(name)) = (file.is_dir(), name) {
                index.insert(name, i);
            }
        }
        Ok(Self { zip: RefCell::new(zip), index })
    }
}

impl FileSource for Archive {
    fn paths(&self) -> Vec<String> {
        self.index.keys().cloned().collect()
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        let index = *self.index.get(path).ok_or("there is no such file")?;
        let mut zip = self.zip.borrow_mut();
        let file = zip.by_index(index).map_err(|e| format!("{path} in the archive: {e}"))?;
        // The size in the directory may be wrong; the bytes that come out count.
        let mut bytes = Vec::new();
        let read = file.take(LONGEST_FILE + 1).read_to_end(&mut bytes).map_err(|e| format!("{path}: {e}"))?;
        if read as u64 > LONGEST_FILE {
            return Err(format!("{path} is longer than {LONGEST_FILE} bytes"));
        }
        Ok(bytes)
    }
}
