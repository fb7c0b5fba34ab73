//! Killing a writer of retentive files at random moments: what it has said to be written is there, whole.
//!
//! Without a harness, because the test is its own child: `process_retentive child FOLDER SEED` writes until it is
//! killed.
#![allow(clippy::print_stdout, reason = "its output is what the parent reads")]

use fastrand::Rng;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use ob1_station::retentive::store::Store;

const STATION: &str = "killed";
/// `cargo xtask siege writer` asks for more.
const KILLS: u64 = 300;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let asks = |word: &str| args.iter().any(|arg| arg == word);
    match args.as_slice() {
        [_, word, folder, seed] if word == "child" => {
            write_for_ever(Path::new(folder), seed.parse().expect("a number"));
        }
        // What test runners ask of any test.
        _ if asks("--list") && asks("--ignored") => {}
        _ if asks("--list") => println!("killed_at_random: test"),
        _ => {
            killed_at_random();
            println!(
                "test killed_at_random ... ok\n\ntest result: ok. 1 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out"
            );
        }
    }
}

/// The image with this number: its number, then bytes that follow from it, of a length that follows from it.
fn image(number: u64) -> Vec<u8> {
    let mut random = Rng::with_seed(number);
    let len = 100 + random.u64(..20_000);
    let mut bytes = number.to_le_bytes().to_vec();
    bytes.extend((0..len).map(|_| random.u64(..) as u8));
    bytes
}

fn write_for_ever(folder: &Path, mut number: u64) {
    let (mut store, _) = Store::open(folder, STATION).expect("writable");
    let mut stdout = std::io::stdout();
    loop {
        number += 1;
        store.write(&image(number)).expect("writable");
        writeln!(stdout, "{number}").and_then(|()| stdout.flush()).expect("the parent reads");
    }
}

fn killed_at_random() {
    let kills = std::env::var("OB1_SIEGE_ROUNDS").map_or(KILLS, |text| text.parse().expect("a number"));
    let folder = tempfile::tempdir().expect("a directory");
    let mut random = Rng::with_seed(0x0B1);
    let mut last = 0;
    for kill in 0..kills {
        let mut child = start(folder.path(), last);
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        // So many writings are waited for; the kill comes somewhere in the next one, or in the opening.
        let mut said = last;
        for _ in 0..random.u64(..3) {
            said = lines.next().expect("it lives").expect("text").parse().expect("a number");
        }
        for _ in 0..random.u64(..200_000) {
            std::hint::spin_loop();
        }
        child.kill().expect("it lives");
        child.wait().expect("it is a child");
        for line in lines.map_while(Result::ok) {
            said = line.parse().unwrap_or(said);
        }
        let (_, found) = Store::open(folder.path(), STATION).expect("readable");
        assert!(found.refused.is_empty(), "kill {kill}: {:?}", found.refused);
        let Some(newest) = found.generations.first() else {
            assert_eq!(said, 0, "kill {kill}: nothing is left");
            continue;
        };
        let (number, _) = newest.image.split_first_chunk().expect("an image");
        let number = u64::from_le_bytes(*number);
        assert!(number == said || number == said + 1, "kill {kill}: {number} is there, {said} was said");
        assert!(newest.image == image(number), "kill {kill}: image {number} is not whole");
        last = number;
    }
    assert!(last >= kills / 2, "only {last} images were written: the kills came too early to prove anything");
}

fn start(folder: &Path, number: u64) -> Child {
    let mut command = Command::new(std::env::current_exe().expect("this test"));
    command.arg("child").arg(folder).arg(number.to_string());
    command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().expect("it starts")
}
