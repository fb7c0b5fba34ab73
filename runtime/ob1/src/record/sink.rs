//! The file that is written, in the form its ending says.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use ob1_record::{Entry, Head, Writer};

use super::RecordError;
use super::csv::Csv;
use super::perfetto::Perfetto;

/// Bytes of rows in a block.
const BLOCK: usize = 64 * 1024;

enum Form {
    /// The recording itself: a file that is whole up to its last block.
    Own(File, Writer, Vec<u8>),
    Csv(Csv<BufWriter<File>>),
    Perfetto(Box<Perfetto<BufWriter<File>>>),
}

/// Where entries go.
pub(super) struct Sink {
    path: PathBuf,
    form: Form,
}

impl Sink {
    pub(super) fn open(path: &Path, head: &Head) -> Result<Self, RecordError> {
        let file = |error| RecordError::File { path: path.to_owned(), error };
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
        if !["ob1trace", "csv", "pftrace"].contains(&ending.as_str()) {
            return Err(RecordError::Ending(path.to_owned()));
        }
        let mut out = File::create(path).map_err(file)?;
        let form = match ending.as_str() {
            "csv" => Form::Csv(Csv::new(BufWriter::new(out), head).map_err(file)?),
            "pftrace" => Form::Perfetto(Box::new(Perfetto::new(BufWriter::new(out), head).map_err(file)?)),
            _ => {
                out.write_all(&Writer::begin(head)).map_err(file)?;
                Form::Own(out, Writer::default(), Vec::new())
            }
        };
        Ok(Self { path: path.to_owned(), form })
    }

    /// Writes an entry, as far as the form has a place for it.
    pub(super) fn take(&mut self, entry: &Entry) -> Result<(), RecordError> {
        let taken = match &mut self.form {
            Form::Csv(csv) => match entry {
                Entry::Row(row) => csv.row(row),
                _ => Ok(()),
            },
            Form::Perfetto(perfetto) => perfetto.take(entry),
            Form::Own(file, writer, bytes) => {
                match entry {
                    Entry::Row(row) => writer.row(row),
                    Entry::Run(run) => writer.run(run),
                    Entry::Event(event) => writer.event(event.clone(), bytes),
                    Entry::Line(number, record) => {
                        writer.take(bytes);
                        Writer::line(*number, record, bytes);
                    }
                }
                if writer.waiting() >= BLOCK {
                    writer.take(bytes);
                }
                let written = file.write_all(bytes);
                bytes.clear();
                written
            }
        };
        taken.map_err(|error| RecordError::File { path: self.path.clone(), error })
    }

    /// What was taken so far is in the file, where its form allows that.
    pub(super) fn flush(&mut self) -> Result<(), RecordError> {
        if let Form::Own(file, writer, bytes) = &mut self.form {
            writer.take(bytes);
            let written = file.write_all(bytes);
            bytes.clear();
            written.map_err(|error| RecordError::File { path: self.path.clone(), error })?;
        }
        Ok(())
    }

    /// The file is complete.
    pub(super) fn finish(&mut self) -> Result<(), RecordError> {
        self.flush()?;
        let finished = match &mut self.form {
            Form::Own(file, ..) => file.sync_all().or(Ok(())),
            Form::Csv(csv) => csv.finish(),
            Form::Perfetto(perfetto) => perfetto.finish(),
        };
        finished.map_err(|error| RecordError::File { path: self.path.clone(), error })
    }
}
