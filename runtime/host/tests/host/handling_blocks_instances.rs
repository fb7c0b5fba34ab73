//! Two instances of P_SND_RK or P_RCV_RK at one CP 341, which its manual forbids: "At a given time, only one FB
//! P_SND_RK and one FB P_RCV_RK can be called for each CP 341". [S4 L1584]

use ob1_time::Span;

use crate::handling_blocks_cp341::{Bench, END, NOTHING};

#[test]
fn a_second_p_snd_rk_gets_0522_and_the_first_goes_on() {
    for second_comes_first in [false, true] {
        let mut bench = Bench::new();
        bench.start_up();
        bench.cp.holds = true;
        assert_eq!(bench.req(true), NOTHING);
        let mut seen = Vec::new();
        for call in 0..20 {
            bench.cp.holds = call < 10;
            let mut both = [NOTHING; 2];
            for second in [second_comes_first, !second_comes_first] {
                both[usize::from(second)] = if second {
                    let end = bench.other().req(call % 4 == 0);
                    bench.other();
                    end
                } else {
                    bench.req(false)
                };
            }
            seen.push(both);
        }
        let first = seen.iter().filter(|both| both[0] != NOTHING).collect::<Vec<_>>();
        assert_eq!((first.len(), first[0][0]), (1, END), "undisturbed");
        let refused = seen.iter().position(|both| both[0] == END).expect("the end");
        for (call, both) in seen.iter().enumerate().take(refused) {
            assert_eq!(both[1], if call % 4 == 0 { (false, true, 0x0522) } else { NOTHING }, "call {call}");
        }
        let second = seen[refused..].iter().filter(|both| both[1] == END).count();
        assert!(second >= 1, "when the first has ended the second has its turn: {seen:?}");
        assert_eq!(bench.cp.jobs.len(), 1 + second, "one request for each DONE");
    }
}

#[test]
fn instances_that_are_called_by_turns_have_their_jobs_one_after_the_other() {
    let mut bench = Bench::new();
    for job in 1..=6 {
        assert_eq!(bench.until_end().1, END, "job {job}");
        assert_eq!(bench.cp.jobs.len(), job);
        bench.other();
    }
}

/// A job whose block is no longer called keeps the channel for 10 s. (ours)
#[test]
fn a_job_whose_block_is_no_longer_called_gives_way_after_10_s() {
    let mut bench = Bench::new();
    bench.start_up();
    bench.cp.holds = true;
    bench.req(true);
    bench.req(false);
    bench.other();
    bench.cpu.now += Span::from_millis(9_999);
    assert_eq!((bench.req(true), bench.req(false)), ((false, true, 0x0522), NOTHING));
    bench.cpu.now += Span::MILLISECOND;
    bench.cp.holds = false;
    assert_eq!(bench.until_end().1, END);
    bench.other();
    assert_eq!((bench.req(false), bench.req(false)), ((false, true, 0x1E0D), NOTHING), "it lost its job");
    assert_eq!(bench.until_end().1, END);
}

#[test]
fn a_second_p_rcv_rk_gets_its_error_once_and_the_first_all_telegrams() {
    let mut bench = Bench::new();
    let mut ends = [Vec::new(), Vec::new()];
    for call in 0..60 {
        if call % 20 == 5 {
            bench.cp.telegrams.push(vec![7; 100]);
        }
        for second in [0, 1] {
            ends[second].extend(Some(bench.receive()).filter(|end| *end != (false, 0, 0)));
            bench.other();
        }
    }
    assert_eq!(ends[0], [(true, 0, 100); 3]);
    assert_eq!(ends[1], [(false, 0x1E0E, 0)]);
    assert_eq!(bench.others[1][24..26], [0x80, 0xC3], "resources busy");
    // A program that goes over from one to the other is legal.
    bench.other();
    bench.cp.telegrams.push(vec![7; 10]);
    bench.cpu.now += Span::from_secs(1);
    assert_eq!((0..9).map(|_| bench.receive()).find(|end| *end != (false, 0, 0)), Some((true, 0, 10)));
    // And at once, if the first has EN_R = 0.
    bench.receive[0] = 0;
    bench.receive();
    bench.receive[0] = 1;
    bench.cp.telegrams.push(vec![7; 11]);
    bench.other();
    assert_eq!((0..9).map(|_| bench.receive()).find(|end| *end != (false, 0, 0)), Some((true, 0, 11)));
}

#[test]
fn a_cp_that_does_not_come_is_told_by_p_rcv_rk_after_10_s() {
    let mut bench = Bench::new();
    bench.cpu.module.status.present = false;
    assert_eq!(bench.receive(), (false, 0, 0));
    bench.cpu.now += Span::from_millis(9_999);
    assert_eq!(bench.receive(), (false, 0, 0), "it may be starting");
    bench.cpu.now += Span::MILLISECOND;
    assert_eq!((bench.receive(), bench.receive()), ((false, 0x1E0E, 0), (false, 0, 0)));
    assert_eq!(bench.instances[1][24..26], [0x80, 0xA0]);
}
