//! `--dump M:FROM:LEN:FILE`: bytes of memory at the end of a run, raw.

use std::path::PathBuf;

use ob1_cpu::Cpu;

/// What a dump is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DumpArea {
    /// Bit memory, from M 0.0 on.
    Memory,
    /// The data block with this number.
    Db(u16),
}

/// A dump that the command line asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dump {
    /// Which memory is written.
    pub area: DumpArea,
    /// Its first byte, from 0.
    pub from: usize,
    /// How many bytes are written.
    pub len: usize,
    /// The file that gets the bytes.
    pub file: PathBuf,
}

impl Dump {
    /// Reads `M:FROM:LEN:FILE` or `DB5:FROM:LEN:FILE`; the file's name may contain colons.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn parse(text: &str) -> Result<Self, String> {
        let parts: Vec<&str> = text.splitn(4, ':').collect();
        let [area, from, len, file] = parts[..] else {
            return Err("write AREA:FROM:LEN:FILE, such as M:0:256:memory.bin or DB5:0:20:db5.bin".into());
        };
        let area = match area.to_ascii_uppercase().as_str() {
            "M" => DumpArea::Memory,
            other => match other.strip_prefix("DB").and_then(|number| number.parse().ok()) {
                Some(number) => DumpArea::Db(number),
                None => return Err(format!("\"{area}\" cannot be dumped; M and data blocks (DB5) can")),
            },
        };
        let number = |text: &str| text.parse().map_err(|_| format!("\"{text}\" is not a number of bytes"));
        if file.is_empty() {
            return Err("the name of the file is missing".into());
        }
        Ok(Self { area, from: number(from)?, len: number(len)?, file: PathBuf::from(file) })
    }

    /// The bytes as the CPU has them now; an error if they are not all there.
    pub(super) fn bytes<'c>(&self, cpu: &'c Cpu) -> Result<&'c [u8], String> {
        let (whole, name) = match self.area {
            DumpArea::Memory => (cpu.bit_memory(), "M".to_owned()),
            DumpArea::Db(number) => {
                let db = cpu.data_block(number).ok_or_else(|| format!("DB{number}: the data block is not loaded"))?;
                (db, format!("DB{number}"))
            }
        };
        let bytes = self.from.checked_add(self.len).and_then(|end| whole.get(self.from..end));
        bytes.ok_or_else(|| format!("{name}:{}:{}: {name} has {} bytes", self.from, self.len, whole.len()))
    }

    /// Writes the file. A data block the program has deleted gives an error.
    pub(super) fn write(&self, cpu: &Cpu) -> Result<(), String> {
        let bytes = self.bytes(cpu).map_err(|text| format!("--dump {text}"))?;
        ob1_process::files::write(&self.file, bytes).map_err(|error| format!("{}: {error}", self.file.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dumps_are_understood() {
        let dump = Dump::parse("M:10:20:a:b.bin");
        let expected = Dump { area: DumpArea::Memory, from: 10, len: 20, file: "a:b.bin".into() };
        assert_eq!(dump, Ok(expected));
        assert_eq!(Dump::parse("db7:0:1:x").map(|d| d.area), Ok(DumpArea::Db(7)));
        for wrong in ["", "M", "M:0:1", "M:0:1:", "X:0:1:f", "DB:0:1:f", "M:-1:1:f", "M:0:x:f"] {
            assert!(Dump::parse(wrong).is_err(), "{wrong}");
        }
    }
}
