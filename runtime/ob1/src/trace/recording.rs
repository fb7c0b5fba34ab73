//! Recordings: records of CPs one after the other in a file. The format is `ob1_serial::tap_record`'s, with the
//! number of the CP (1 byte) between the length of a record and the record.

use std::io::{self, Write};

use ob1_serial::tap_record::{MAGIC, Record, VERSION};

/// Why a file is no recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordingError {
    /// Its first bytes are other ones.
    #[error("this is not a recording of ob1 trace")]
    Magic,
    /// It was written by another version.
    #[error("the recording has version {0}, this ob1 reads {VERSION}")]
    Version(u16),
    /// It is cut off or damaged.
    #[error("the recording is damaged at byte {0}")]
    Damaged(usize),
}

/// Writes the records of a trace into a file.
#[derive(Debug)]
pub struct Recorder<W> {
    file: W,
}

impl<W: Write> Recorder<W> {
    /// Begins a recording: magic and version.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn new(mut file: W) -> io::Result<Self> {
        file.write_all(&MAGIC)?;
        file.write_all(&VERSION.to_le_bytes())?;
        Ok(Self { file })
    }

    /// Adds a record: at once, so that Ctrl-C leaves whole ones only.
    ///
    /// # Errors
    /// The file cannot be written; `InvalidInput` for a record of more than 65535 bytes.
    pub fn write(&mut self, cp: u8, record: &Record<'_>) -> io::Result<()> {
        let head = Record::head(record.time, record.kind);
        // A message never holds so much.
        let length = u16::try_from(head.len() + record.data.len()).map_err(|_| io::ErrorKind::InvalidInput)?;
        let mut bytes = length.to_le_bytes().to_vec();
        bytes.push(cp);
        bytes.extend(head);
        bytes.extend(record.data);
        self.file.write_all(&bytes)
    }
}

/// The records of a recording. One that was cut off, as by a full disk, ends with an error after all that is whole.
///
/// # Errors
/// [`RecordingError::Magic`]: it is no recording; [`RecordingError::Version`]: of another version.
pub fn read(bytes: &[u8]) -> Result<impl Iterator<Item = Result<(u8, Record<'_>), RecordingError>>, RecordingError> {
    let rest = bytes.strip_prefix(&MAGIC).ok_or(RecordingError::Magic)?;
    let (version, mut rest) = rest.split_first_chunk::<2>().ok_or(RecordingError::Magic)?;
    let version = u16::from_le_bytes(*version);
    if version != VERSION {
        return Err(RecordingError::Version(version));
    }
    Ok(std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let at = bytes.len() - rest.len();
        let Some(entry) = take(&mut rest) else {
            rest = &[];
            return Some(Err(RecordingError::Damaged(at)));
        };
        Some(Ok(entry))
    }))
}

fn take<'a>(rest: &mut &'a [u8]) -> Option<(u8, Record<'a>)> {
    let (length, behind) = rest.split_first_chunk::<2>()?;
    let (cp, behind) = behind.split_first()?;
    let (record, behind) = behind.split_at_checked(usize::from(u16::from_le_bytes(*length)))?;
    let record = Record::read(record)?;
    *rest = behind;
    Some((*cp, record))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_protocols::Instant;
    use ob1_serial::tap_record::Kind;

    #[test]
    fn a_recording_is_read_back_and_damage_is_told() {
        let mut file = Vec::new();
        let mut recorder = Recorder::new(&mut file).expect("memory");
        let records =
            [(0, Instant::from_nanos(1), Kind::Out, &b"abc"[..]), (1, Instant::from_nanos(2), Kind::Done, b"")];
        for (cp, time, kind, data) in records {
            recorder.write(cp, &Record { time, kind, data }).expect("memory");
        }
        let all: Vec<_> = read(&file).expect("ours").collect();
        let expected = records.map(|(cp, time, kind, data)| Ok((cp, Record { time, kind, data })));
        assert_eq!(all, expected);
        let cut: Vec<_> = read(&file[..file.len() - 1]).expect("ours").collect();
        assert_eq!(cut, [expected[0], Err(RecordingError::Damaged(25))]);
        file[8] = 9;
        assert_eq!(read(&file).err(), Some(RecordingError::Version(9)));
        assert_eq!(read(b"OB1").err(), Some(RecordingError::Magic));
    }
}
