//! Networks by hand, and what is drawn of them: one for each element and each rule of the grammar. The drawings are in
//! `golden.txt`; `OB1_GOLDEN=write` writes them anew, to be read by a person.

#![allow(clippy::disallowed_methods, reason = "the test reads its drawings from the disk")]

mod common;

use std::fmt::Write as _;

use ob1_ladder::{Form, Network, Options, draw, line, read, text};

/// What it shows, its statements.
const NETWORKS: &[(&str, &str)] = &[
    ("contacts and a coil", "U E 0.0; UN E 0.1; = A 4.0;"),
    ("set and reset coils", "U E 0.0; S M 5.0; R M 5.1;"),
    ("parallel inside a series, two coils", "U E 0.0; UN E 0.1; U( ; O M 1.0; O M 1.1; ) ; = A 4.0; S M 2.0;"),
    ("rule 1: a leg of one contact is O, also the first", "O E 0.0; ON E 0.1; = A 4.0;"),
    ("rule 1: a first leg of several stands bare", "U E 0.1; U E 0.2; O E 0.3; O; U E 0.4; U E 0.5; = A 4.0;"),
    ("rule 1: an edge in a leg brackets it", "O E 0.0; O( ; U E 0.1; FP M 9.0; ) ; O; U E 0.2; U E 0.3; = A 4.0;"),
    ("rule 1: and the legs above it", "O E 0.0; O( ; U E 0.1; U E 0.2; ) ; O( ; U E 0.3; NOT; ) ; = A 4.0;"),
    ("rule 1: a compare in a leg", "O E 0.0; O( ; L MW 10; L 5; >I; ) ; = A 4.0;"),
    ("rule 2: a compare within a series", "U E 0.0; U( ; L MW 10; L MW 12; <>I; ) ; = A 4.0;"),
    ("rule 2: a lone compare before a coil", "L MD 10; L 1.5; >=R; = A 4.0;"),
    (
        "rule 2: a lone parallel is bracketed as input of a box",
        "U( ; O E 0.0; O E 0.1; ) ; S M 5.0; NOP 0; U M 5.0; = A 4.0;",
    ),
    ("rule 3: exclusive or", "X E 0.0; X( ; U E 0.1; UN E 0.2; ) ; = A 4.0;"),
    ("rule 4: parallel coils", "U E 0.0; = A 4.0; = A 4.1; S M 0.0;"),
    (
        "rule 5: a branch, one arm straight to its coil",
        "U E 0.0; = L 20.0; U L 20.0; BLD 102; = A 4.0; U L 20.0; U E 0.3; = A 4.1;",
    ),
    (
        "rule 5: an arm to a box",
        "U E 0.0; = L 20.0; U L 20.0; SPBNB _001; L 1; T MW 2; _001: NOP 0; U L 20.0; U E 0.1; = A 4.1;",
    ),
    (
        "rule 5: a branch within a branch",
        "U E 0.0; = L 20.0; U L 20.0; U E 0.1; = L 20.1; U L 20.1; BLD 102; = A 4.0; U L 20.1; UN E 0.2; = A 4.1; U L 20.0; U E 0.3; = A 4.2;",
    ),
    (
        "rule 6: a branch's bit in a parallel",
        "U E 0.0; = L 20.0; U L 20.0; BLD 102; = A 4.0; O L 20.0; O E 0.3; = A 4.1;",
    ),
    (
        "rule 7: logic at the inputs of a call",
        "U E 0.1; UN E 0.2; = L 20.0; BLD 103; U E 0.0; SPBNB _001; CALL FC 7 (a := L 20.0, b := M 1.0, c := MW 4, q := M 3.3, w := MW 8); _001: NOP 0;",
    ),
    (
        "rule 7: an input that begins at a local bit nobody has declared is no arm",
        "U L 20.5; = L 20.0; BLD 103; CALL FC 7 (a := L 20.0, b := M 1.0, c := MW 4, q := M 3.3, w := MW 8); NOP 0;",
    ),
    (
        "rule 8: ENO of a call",
        "U E 0.0; SPBNB _001; CALL FC 7 (a := M 1.0, b := M 1.1, c := 3, q := M 3.3, w := MW 8); _001: U BIE; = A 4.0;",
    ),
    ("rule 9: a box at the rail", "L MW 10; T MW 12; NOP 0;"),
    (
        "rule 10: a chain of boxes",
        "U( ; U E 0.0; SPBNB _001; L MW 10; T MW 12; SET; SAVE; CLR; _001: U BIE; ) ; SPBNB _002; L MW 12; L 5; +I; T MW 14; _002: NOP 0;",
    ),
    ("MOVE", "U E 0.0; SPBNB _001; L W#16#FF; T MW 12; _001: NOP 0;"),
    (
        "arithmetic, its ENO goes on",
        "U E 0.0; SPBNB _001; L MD 10; L L#5; *D; T MD 14; UN OV; SAVE; CLR; _001: U BIE; = A 4.0;",
    ),
    ("conversion", "U E 0.0; SPBNB _001; L MW 10; ITD; DTR; T MD 12; _001: NOP 0;"),
    (
        "word logic and shift",
        "U( ; U E 0.0; SPBNB _001; L MW 10; L W#16#F; UW; T MW 12; SET; SAVE; CLR; _001: U BIE; ) ; SPBNB _002; L 4; L MW 12; SLW; T MW 14; _002: NOP 0;",
    ),
    ("call of a function block", "CALL FB 20, DB 21 (start := E 0.0, speed := 7, runs := A 4.0); NOP 0;"),
    ("SR", "U( ; O E 0.0; O A 4.0; ) ; UN E 0.1; S M 5.0; U E 0.2; R M 5.0; U M 5.0; = A 4.0;"),
    ("SR, R and Q open", "U E 0.0; S M 5.0; NOP 0; NOP 0;"),
    ("RS", "U E 0.0; R M 5.0; U E 0.1; S M 5.0; U M 5.0; = A 4.0;"),
    ("S_ODT", "U E 0.0; L S5T#5S; SE T 1; U E 0.1; R T 1; L T 1; T MW 20; NOP 0; U T 1; = A 4.2;"),
    ("S_OFFDT, nothing else connected", "U E 0.0; L S5T#5S; SA T 1; NOP 0; NOP 0; NOP 0; NOP 0;"),
    (
        "S_PULSE and S_PEXT",
        "U( ; U E 0.0; L S5T#1S; SI T 1; NOP 0; NOP 0; NOP 0; U T 1; ) ; L S5T#2S; SV T 2; NOP 0; NOP 0; NOP 0; U T 2; = A 4.0;",
    ),
    ("timer coil", "U E 0.0; L S5T#5S; SS T 1;"),
    ("S_CU", "U E 0.0; ZV Z 1; BLD 101; NOP 0; NOP 0; U E 0.1; R Z 1; NOP 0; NOP 0; NOP 0;"),
    (
        "S_CUD",
        "U E 0.0; ZV Z 1; U E 0.1; ZR Z 1; U E 0.2; L C#10; S Z 1; U E 0.3; R Z 1; L Z 1; T MW 10; LC Z 1; T MW 12; U Z 1; = A 4.0;",
    ),
    ("counter coils", "U E 0.0; ZV Z 1; U E 0.1; L C#7; S Z 1;"),
    ("edges of the RLO, and POS", "U E 0.0; FN M 9.0; U( ; U E 0.1; BLD 100; FP M 9.1; ) ; = A 4.0;"),
    ("NOT and RET", "U E 0.0; NOT; SAVE; BEB;"),
    ("RET without logic", "SET; SAVE; BEA;"),
    ("connector", "U E 0.0; U E 0.1; = M 1.0; U M 1.0; U E 0.2; = A 4.0;"),
    ("jumps", "U E 0.0; SPBN m1;\nNETWORK\nU E 0.1; = A 4.0;\nNETWORK\nm1: NOP 0; U E 0.2; = A 4.1;"),
    ("call coil and OPN", "U E 0.0; CC FC 8;\nNETWORK\nUC FC 8;\nNETWORK\nAUF DB 5;"),
    ("operand of a data block", "U DB5.DBX 0.0; = DB5.DBX 0.1;"),
    ("an emptied network", "NOP 0;"),
    ("a box behind something else: no ladder", "U E 0.0; U( ; U E 0.1; S M 5.0; NOP 0; U M 5.0; ) ; = A 4.0;"),
    ("by hand: several rungs", "U E 0.0; = A 4.0; U E 0.1; S M 5.0; L MW 0; T MW 2;"),
    ("by hand: a parallel without brackets", "O E 0.0; O E 0.1; UN E 0.2; = A 4.0;"),
    ("left: indirect addressing", "U E [MD 20]; = A 4.0;"),
    ("left: a loop", "L 5; m1: T MW 2; U E 0.0; = A 4.0; L MW 2; LOOP m1;"),
    ("left: SPBN over loads", "U E 0.0; SPBN m1; L 5; T MW 2; m1: NOP 0;"),
];

fn drawings(network: &Network) -> String {
    let mut out = String::new();
    let tree = match read(network) {
        Ok(tree) => tree,
        Err(why) => return format!("as statements: {why}\n"),
    };
    if !tree.as_step7 {
        out.push_str("STEP 7 would show statements\n");
    }
    for form in [Form::Ladder, Form::Plan] {
        let drawing = draw(network, &tree, &Options { form, ..Options::default() });
        let _ = writeln!(out, "{}", text::lines(&drawing, false).join("\n"));
        if drawing.is_plan {
            break;
        }
    }
    let _ = writeln!(out, "{}", line(network, &tree, &Options::default()));
    out
}

#[test]
fn drawings_by_hand() {
    let mut all = String::new();
    for (name, statements) in NETWORKS {
        let (block, interfaces) = common::compiled(&format!("NETWORK\n{statements}"));
        for network in common::networks(&block, &interfaces, &[]) {
            let _ = writeln!(all, "=== {name}\n{statements}\n{}", drawings(&network));
        }
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden.txt");
    if std::env::var_os("OB1_GOLDEN").is_some_and(|what| what == "write") {
        std::fs::write(path, &all).expect("written");
    }
    let expected = std::fs::read_to_string(path).expect("golden.txt");
    for (ours, theirs) in all.split("=== ").zip(expected.split("=== ")) {
        assert_eq!(ours, theirs);
    }
    assert_eq!(all, expected);
}

#[test]
fn symbols_stand_above_addresses_and_long_names_are_cut() {
    let (block, interfaces) = common::compiled("NETWORK\nU E 0.0; = A 4.0;");
    let named = [("E 0.0", "a very long name of a push button"), ("A 4.0", "Motor")];
    let network = common::networks(&block, &interfaces, &named).remove(0);
    let tree = read(&network).expect("it is drawn");
    let shown = |options: &Options| text::lines(&draw(&network, &tree, options), true).join("\n");
    let both = "\
| a very long .. push button   Motor
|           E 0.0              A 4.0
+------------| |---------------(   )";
    assert_eq!(shown(&Options::default()), both);
    let address = "\
| E 0.0   A 4.0
+--| |----(   )";
    assert_eq!(shown(&Options { names: ob1_ladder::NamesShown::Address, ..Options::default() }), address);
    let symbol = Options { names: ob1_ladder::NamesShown::Symbol, longest_name: 8, ..Options::default() };
    assert!(shown(&symbol).starts_with("| a v..ton   Motor\n"), "{}", shown(&symbol));
    let english = line(&network, &tree, &Options::default());
    assert_eq!(english, "\"a very long name of a push button\" -> \"Motor\"");
}

#[test]
fn a_wide_rung_goes_on_below() {
    let contacts: String = (0..8).map(|bit| format!("U E 0.{bit}; ")).collect();
    let network = common::network(&format!("{contacts} = A 4.0;"));
    let tree = read(&network).expect("it is drawn");
    let options = Options { wrap: Some(40), ..Options::default() };
    let drawing = draw(&network, &tree, &options);
    let expected = "\
│ E 0.0  E 0.1  E 0.2  E 0.3
├──┤ ├────┤ ├────┤ ├────┤ ├───>1
│    E 0.4  E 0.5  E 0.6  E 0.7
│1>───┤ ├────┤ ├────┤ ├────┤ ├───>2
│     A 4.0
│2>───(   )";
    assert_eq!(text::lines(&drawing, false).join("\n"), expected);
    assert!(drawing.width <= 40);
}

#[test]
fn two_versions_are_one_picture() {
    let versions = [
        "U E 0.0; UN E 0.1; U( ; O M 1.0; O M 1.1; ) ; = A 4.0; S M 2.0;",
        "U E 0.0; U( ; O M 1.0; O M 1.1; O M 1.2; ) ; UN E 0.2; = A 4.0;",
    ];
    let networks = versions.map(common::network);
    let trees = [read(&networks[0]).expect("drawn"), read(&networks[1]).expect("drawn")];
    let merged = ob1_ladder::merge((&networks[0], &trees[0]), (&networks[1], &trees[1])).expect("they differ");
    let drawing = draw(&merged.network, &merged.tree, &Options::default());
    let expected = "\
│ E 0.0  -E 0.1   M 1.0    +E 0.2    A 4.0
├──┤ ├────┤/├───┬──┤ ├───┬──┤/├───┬──(   )
│               │ M 1.1  │        │ -M 2.0
│               ├──┤ ├───┤        └──( S )
│               │ +M 1.2 │
│               └──┤ ├───┘";
    assert_eq!(text::lines(&drawing, false).join("\n"), expected);
    let count = |mark| merged.marks.iter().filter(|m| **m == mark).count();
    assert_eq!((count(ob1_ladder::Mark::Gone), count(ob1_ladder::Mark::Added)), (2, 2));
    assert!(ob1_ladder::merge((&networks[0], &trees[0]), (&networks[0], &trees[0])).is_none());
}
