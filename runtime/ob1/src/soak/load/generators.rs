//! The generators at work: threads that compute, write memory, write files.

use fastrand::Rng;
use std::fs::{self, File, OpenOptions};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use super::{Load, LoadReport};

/// Bytes written and flushed at once.
const BLOCK: usize = 256 * 1024;
/// A file of the I/O load starts again after this many blocks.
const BLOCKS: u64 = 64;

#[derive(Debug, Default)]
struct Counts {
    cpu: AtomicU64,
    memory: AtomicU64,
    io: AtomicU64,
    io_errors: AtomicU64,
}

/// The generators at work. Dropping them ends them.
#[derive(Debug)]
pub(in super::super) struct Generators {
    stop: Arc<AtomicBool>,
    counts: Arc<Counts>,
    threads: Vec<JoinHandle<()>>,
    load: Load,
    seed: u64,
    pub(in super::super) kills: u64,
}

impl Generators {
    /// Starts them; files of the I/O load lie in `folder`, without a name.
    pub(in super::super) fn start(load: &Load, seed: u64, folder: &Path) -> std::io::Result<Self> {
        let (stop, counts) = (Arc::new(AtomicBool::new(false)), Arc::new(Counts::default()));
        let mut all = Self { stop, counts, threads: Vec::new(), load: load.clone(), seed, kills: 0 };
        let mut seeds = Rng::with_seed(seed);
        for _ in 0..load.cpu {
            let mut random = Rng::with_seed(seeds.u64(..));
            all.thread("ob1-load-cpu", move |counts| {
                for _ in 0..100_000 {
                    std::hint::black_box(random.u64(..));
                }
                counts.cpu.fetch_add(1, Ordering::Relaxed);
            })?;
        }
        if load.memory > 0 {
            let mut random = Rng::with_seed(seeds.u64(..));
            let mut memory = vec![0u8; load.memory as usize];
            all.thread("ob1-load-memory", move |counts| {
                for _ in 0..1000 {
                    let at = random.u64(..memory.len() as u64) as usize;
                    if let Some(byte) = memory.get_mut(at) {
                        *byte = byte.wrapping_add(1);
                    }
                }
                counts.memory.fetch_add(1000, Ordering::Relaxed);
            })?;
        }
        for number in 0..load.io {
            let mut random = Rng::with_seed(seeds.u64(..));
            let mut file = nameless(folder, number)?;
            let mut block = vec![0u8; BLOCK];
            let mut blocks = 0;
            all.thread("ob1-load-io", move |counts| {
                for bytes in block.chunks_exact_mut(8) {
                    bytes.copy_from_slice(&random.u64(..).to_le_bytes());
                }
                let rewound = if blocks % BLOCKS == 0 { file.seek(SeekFrom::Start(0)).map(drop) } else { Ok(()) };
                blocks += 1;
                match rewound.and_then(|()| file.write_all(&block)).and_then(|()| file.sync_data()) {
                    Ok(()) => counts.io.fetch_add(1, Ordering::Relaxed),
                    Err(_) => counts.io_errors.fetch_add(1, Ordering::Relaxed),
                };
            })?;
        }
        Ok(all)
    }

    fn thread(&mut self, name: &str, mut turn: impl FnMut(&Counts) + Send + 'static) -> std::io::Result<()> {
        let (stop, counts) = (Arc::clone(&self.stop), Arc::clone(&self.counts));
        self.threads.push(ob1_rt::spawn(name, move || {
            while !stop.load(Ordering::Relaxed) {
                turn(&counts);
            }
        })?);
        Ok(())
    }

    pub(in super::super) fn report(&self) -> LoadReport {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        LoadReport {
            spec: self.load.text.clone(),
            seed: self.seed,
            cpu_slices: read(&self.counts.cpu),
            memory_pages: read(&self.counts.memory),
            io_blocks: read(&self.counts.io),
            io_errors: read(&self.counts.io_errors),
            driver_kills: self.kills,
            line_faults: self.load.line_faults,
        }
    }
}

impl Drop for Generators {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// A file that disappears with its last descriptor, however this process ends.
fn nameless(folder: &Path, number: u64) -> std::io::Result<File> {
    let path: PathBuf = folder.join(format!(".ob1-load-{}-{number}", std::process::id()));
    let file = OpenOptions::new().create_new(true).write(true).open(&path)?;
    fs::remove_file(&path)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generators_work_and_end() {
        let folder = std::env::temp_dir();
        let load: Load = "cpu=1,memory=1MiB,io=1".parse().expect("right");
        let generators = Generators::start(&load, 7, &folder).expect("room");
        let worked = |r: &LoadReport| r.cpu_slices > 0 && r.memory_pages > 0 && r.io_blocks > 0;
        while !worked(&generators.report()) {
            assert_eq!(generators.report().io_errors, 0);
            std::thread::yield_now();
        }
        drop(generators);
        let left = fs::read_dir(&folder).expect("a folder").flatten();
        let ours = format!(".ob1-load-{}-", std::process::id());
        assert_eq!(left.filter(|f| f.file_name().to_string_lossy().starts_with(&ours)).count(), 0);
    }
}
