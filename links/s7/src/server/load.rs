//! Uploads and downloads of blocks. In an upload the partner requests each part; in a download we request them from the
//! partner.

use super::{Ask, Connection, Loaded, Reply, Step, Then, is_loadable};
use crate::Rights;
use crate::codes::Code;
use crate::wire::{ANSWER_HEAD, BlockInfo, BlockName, BlockType, FileSystem, Kind, Pdu, function, write};

/// Uploads of a connection at the same time.
const UPLOADS: usize = 2;
/// Largest block: each of its parts has at most 65,535 bytes, and no CPU allows more in total.
const BLOCK: usize = 72 + 65_535 + 16_384;
/// Maximum bytes of blocks received and not linked yet.
const STAGED: usize = 1024 * 1024;
/// Bytes in front of a part: its length, and two constant bytes.
const PART_HEAD: usize = 4;
const PART_MARK: [u8; 2] = [0x00, 0xFB];
/// Digits of the length of an upload.
const DIGITS: usize = 7;
/// Offset of the name of a block, and of the number of an upload.
const NAME_AT: usize = 8;
const ID_AT: usize = 4;

#[derive(Debug)]
struct Upload {
    id: u32,
    bytes: Vec<u8>,
    sent: usize,
}

#[derive(Debug)]
struct Download {
    name: BlockName,
    bytes: Vec<u8>,
    /// Number of our job that waits for an answer.
    reference: u16,
    /// The whole block has come; the partner must confirm the end.
    ended: bool,
}

/// Blocks being transferred, in both directions.
#[derive(Debug, Default)]
pub(super) struct Loads {
    uploads: Vec<Upload>,
    next_upload: u32,
    download: Option<Download>,
    staged: Vec<Loaded>,
    next_reference: u16,
}

impl Loads {
    /// The received blocks of these names; all of them, or none.
    pub(super) fn take(&mut self, names: &[BlockName]) -> Result<Vec<Loaded>, Code> {
        let is_there = |name: &BlockName| self.staged.iter().any(|b| (b.ty, b.number) == (name.ty, name.number));
        if names.is_empty() || !names.iter().all(is_there) {
            return Err(Code::NO_BLOCK);
        }
        let wanted = |block: &mut Loaded| names.iter().any(|name| (name.ty, name.number) == (block.ty, block.number));
        Ok(self.staged.extract_if(.., wanted).collect())
    }

    fn staged_bytes(&self) -> usize {
        self.staged.iter().map(|block| block.bytes.len()).sum()
    }
}

/// The name of the block a job is about.
fn name(pdu: &Pdu<'_>) -> Option<BlockName> {
    let (&len, rest) = pdu.parameters.get(NAME_AT..)?.split_first()?;
    BlockName::read(rest.get(..usize::from(len))?)
}

fn upload_id(pdu: &Pdu<'_>) -> Option<u32> {
    pdu.parameters.get(ID_AT..)?.first_chunk::<4>().map(|id| u32::from_be_bytes(*id))
}

/// Whether a CPU can have this organization block.
const fn is_ob(number: u16) -> bool {
    matches!(number, 1 | 10..=17 | 20..=23 | 30..=38 | 40..=47 | 55..=57 | 60..=65 | 70..=73 | 80..=88 | 90)
        || matches!(number, 100..=102 | 121 | 122)
}

impl Connection {
    pub(super) fn start_upload(&mut self, pdu: &Pdu<'_>) -> Step {
        let refused = match name(pdu) {
            None => Code::BLOCK_NAME,
            // A block that is not linked yet is visible only to those who load it.
            Some(name) if name.place == FileSystem::Passive => Code::NO_BLOCK,
            Some(name) if name.ty == BlockType::Ob && !is_ob(name.number) => Code::NO_OB,
            Some(name) => return Step::Ask(Ask::Block { ty: name.ty, number: name.number }, Then::Upload),
        };
        self.refuse_job(pdu.reference, refused)
    }

    pub(super) fn upload_answer(&mut self, reference: u16, reply: Reply) -> Vec<u8> {
        let why = match reply {
            Reply::Block(bytes) if bytes.len() <= BLOCK => return self.begin_upload(reference, bytes),
            Reply::Refused(why) => why,
            _ => Code::SERVICE,
        };
        self.counts.errors += 1;
        write(Kind::Ack, reference, why, &[], &[])
    }

    fn begin_upload(&mut self, reference: u16, bytes: Vec<u8>) -> Vec<u8> {
        // The partner has forgotten the oldest one.
        if self.loads.uploads.len() >= UPLOADS {
            self.loads.uploads.remove(0);
        }
        // Clients evaluate only the last byte of the number.
        self.loads.next_upload = self.loads.next_upload % 0xFF + 1;
        let id = self.loads.next_upload;
        let mut parameters = vec![function::START_UPLOAD, 0, 1, 0];
        parameters.extend_from_slice(&id.to_be_bytes());
        parameters.push(DIGITS as u8);
        parameters.extend_from_slice(format!("{:0DIGITS$}", bytes.len()).as_bytes());
        self.loads.uploads.push(Upload { id, bytes, sent: 0 });
        write(Kind::Answer, reference, Code::DONE, &parameters, &[])
    }

    pub(super) fn upload(&mut self, pdu: &Pdu<'_>) -> Step {
        let most = self.pdu_bytes() - ANSWER_HEAD - 2 - PART_HEAD;
        let id = upload_id(pdu);
        let Some(upload) = self.loads.uploads.iter_mut().find(|upload| Some(upload.id) == id) else {
            return Step::Answer(self.refuse_function(pdu.reference, function::UPLOAD, Code::NO_BLOCK));
        };
        let rest = upload.bytes.get(upload.sent..).unwrap_or_default();
        let part = rest.get(..most).unwrap_or(rest);
        upload.sent += part.len();
        let more = u8::from(upload.sent < upload.bytes.len());
        let mut data = (part.len() as u16).to_be_bytes().to_vec();
        data.extend_from_slice(&PART_MARK);
        data.extend_from_slice(part);
        Step::Answer(write(Kind::Answer, pdu.reference, Code::DONE, &[function::UPLOAD, more], &data))
    }

    pub(super) fn end_upload(&mut self, pdu: &Pdu<'_>) -> Step {
        let id = upload_id(pdu);
        self.loads.uploads.retain(|upload| Some(upload.id) != id);
        Step::Answer(write(Kind::Answer, pdu.reference, Code::DONE, &[function::END_UPLOAD], &[]))
    }

    pub(super) fn request_download(&mut self, pdu: &Pdu<'_>) -> Step {
        let refused = match name(pdu) {
            _ if !self.may(Rights::Operate) => Code::PROTECTED,
            None => Code::BLOCK_NAME,
            Some(name) if !is_loadable(name.ty) => Code::BLOCK_NUMBER,
            Some(name) => {
                let answer = write(Kind::Answer, pdu.reference, Code::DONE, &[function::REQUEST_DOWNLOAD], &[]);
                // A download that the partner has given up is dropped.
                self.loads.download = Some(Download { name, bytes: Vec::new(), reference: 0, ended: false });
                let job = self.download_job(function::DOWNLOAD);
                // Our first job follows the answer, whatever else is running.
                self.enqueue(pdu.reference, Step::Answer(answer));
                match self.queue.back_mut() {
                    Some(last) => last.answer.extend(job),
                    None => job.iter().for_each(|job| self.transport.send(job)),
                }
                return Step::Silence;
            }
        };
        Step::Answer(self.refuse_function(pdu.reference, function::REQUEST_DOWNLOAD, refused))
    }

    /// Our job for the partner: the next part, or the end.
    fn download_job(&mut self, function: u8) -> Option<Vec<u8>> {
        let download = self.loads.download.as_mut()?;
        self.loads.next_reference = self.loads.next_reference.wrapping_add(1);
        download.reference = self.loads.next_reference;
        let mut parameters = vec![function, 0, 0, 0, 0, 0, 0, 0];
        let name = download.name.text();
        parameters.push(1 + name.len() as u8);
        parameters.push(b'_');
        parameters.extend_from_slice(&name);
        Some(write(Kind::Job, download.reference, Code::DONE, &parameters, &[]))
    }

    /// An answer to a job of ours.
    pub(super) fn download_answer(&mut self, pdu: &Pdu<'_>) {
        let Some(download) = self.loads.download.as_mut().filter(|download| download.reference == pdu.reference) else {
            return;
        };
        if pdu.error != Code::DONE {
            self.loads.download = None;
            return;
        }
        if download.ended {
            let Some(Download { name, bytes, .. }) = self.loads.download.take() else { return };
            let fits = self.loads.staged_bytes() + bytes.len() <= STAGED;
            // A block that does not match its name never gets into the program.
            let is_it = BlockInfo::of(&bytes).is_some_and(|info| info.ty == name.ty);
            if fits && is_it {
                self.loads.staged.retain(|block| (block.ty, block.number) != (name.ty, name.number));
                self.loads.staged.push(Loaded { ty: name.ty, number: name.number, bytes });
            }
            return;
        }
        let part = pdu
            .data
            .split_first_chunk::<PART_HEAD>()
            .and_then(|(&[high, low, ..], rest)| rest.get(..usize::from(u16::from_be_bytes([high, low]))));
        let (Some(part), Some(&more)) = (part, pdu.parameters.get(1)) else {
            self.loads.download = None;
            return;
        };
        if download.bytes.len() + part.len() > BLOCK {
            self.loads.download = None;
            return;
        }
        download.bytes.extend_from_slice(part);
        download.ended = more == 0;
        let next = if download.ended { function::DOWNLOAD_ENDED } else { function::DOWNLOAD };
        if let Some(job) = self.download_job(next) {
            self.transport.send(&job);
        }
    }
}
