//! A few programs of `cargo xtask compare` on our engine and on awlsim, as a short check. The verb does the long run.

use ob1_tests::awlsim::{Awlsim, Scratch};
use ob1_tests::compare::{Verdict, compare};

#[test]
fn random_programs_leave_the_memory_that_awlsim_leaves() {
    let awlsim = Awlsim::find().expect("cargo xtask test installs it");
    let scratch = Scratch::new("process-compare").expect("room for a folder");
    for seed in 1000..1004 {
        match compare(seed, &awlsim, &scratch) {
            Ok(Verdict::Same) => {}
            Ok(Verdict::Differs(difference)) => panic!(
                "seed {seed}, snippet {}: differs; cargo xtask compare --seed {seed} --seeds 1 writes it to a file\n{}",
                difference.index,
                difference.text()
            ),
            Err(why) => panic!("seed {seed}: {why}"),
        }
    }
}
