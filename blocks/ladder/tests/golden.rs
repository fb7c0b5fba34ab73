//! Networks by hand, and what is drawn of them: one for each element and each rule.

mod common;

use ob1_ladder::{Form, Options, draw, read, text};

#[test]
fn show() {
    for s in [
        "U E0.0; UN E0.1; U( ; O M1.0; O M1.1; ) ; = A4.0; S M2.0;",
        "O E0.0; O( ; U E0.1; FP M9.0; ) ; O; U E0.2; U E0.3; = A4.0;",
        "U E0.1; U E0.2; O E0.3; O; U E0.4; U E0.5; = A4.0;",
        "U( ; O E0.0; O A4.0; ) ; UN E0.1; S M5.0; U( ; U E0.2; U E0.7; O E 0.4; ); R M5.0; U M5.0; = A4.0;",
        "U E0.0; S M5.0; NOP 0; NOP 0;",
        "U E0.0; L S5T#5S; SE T1; U E0.1; R T1; L T1; T MW20; NOP 0; U T1; = A4.2;",
        "U E0.0; L S5T#5S; SE T1; ",
        "U E0.0; ZV Z1; BLD 101; NOP 0; NOP 0; U E0.1; R Z1; NOP 0; NOP 0; NOP 0;",
        "U E0.0; SPBNB _001; L MW10; L 5; +I; T MW12; _001: NOP 0;",
        "U( ; U E0.0; SPBNB _001; L MW10; T MW12; SET; SAVE; CLR; _001: U BIE; ) ; SPBNB _002; L MW12; L 5; +I; T MW14; _002: NOP 0;",
        "U E0.0; = L20.0; U L20.0; BLD 102; = A4.0; U L20.0; U E0.3; = A4.1;",
        "U E0.1; UN E0.2; = L20.0; BLD 103; U E0.0; SPBNB _001; CALL FC 7 (a := L20.0, b := M 1.0, c := MW 4, q := M 3.3, w := MW 8); _001: NOP 0;",
        "U E0.0; NOT; SAVE; BEB;",
        "X E0.0; X( ; U E0.1; UN E0.2; ); = A4.0;",
        "U E 0.0; U( ; L MW 4; L 7; >I; ) ; U( ; U E 0.1; UN M 0.0; O E 0.4; ); = M 1.0; U M 1.0; = A 4.0;",
        "CALL FB 20, DB 21 (start := E 0.0, runs := A 4.0); NOP 0;",
        "U E 0.0; = A 4.0; U E 0.1; S M 5.0; U E 0.2; R M 5.0;",
        "U E 0.0; U( ; U E 0.1; S M 5.0; U E 0.2; R M 5.0; U M 5.0; ) ; = A 4.0;",
    ] {
        let network = common::network(s);
        let tree = match read(&network) { Ok(t) => t, Err(e) => { println!("{s}\n  LEFT {e}"); continue } };
        println!("{s} {}", tree.as_step7);
        for form in [Form::Ladder, Form::Plan] {
            let drawing = draw(&network, &tree, &Options { form, ..Options::default() });
            println!("{}\n", text::lines(&drawing, false).join("\n"));
        }
    }
}
