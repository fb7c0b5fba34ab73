//! Actual parameters: every kind of actual for every kind of formal, from source text, by the values and side effects
//! that a program sees.

use crate::common::source::bench;
use crate::common::{Bench, on_each_engine};

/// An elementary type: how a callee changes it, and what it is before and after, as the hexadecimal constant of its
/// width.
struct Type {
    name: &'static str,
    /// The letter of its operands.
    width: char,
    /// Reads `{from}` and writes something else to `{to}`.
    change: &'static str,
    before: u32,
    after: u32,
}

const TYPES: [Type; 5] = [
    Type { name: "BOOL", width: 'X', change: "UN {from}; = {to};", before: 0, after: 1 },
    Type { name: "BYTE", width: 'B', change: "L {from}; INC 1; T {to};", before: 0x12, after: 0x13 },
    Type { name: "INT", width: 'W', change: "L {from}; + 1; T {to};", before: 0x12FF, after: 0x1300 },
    Type { name: "DINT", width: 'D', change: "L {from}; + L#1; T {to};", before: 0x1234_FFFF, after: 0x1235_0000 },
    Type { name: "REAL", width: 'D', change: "L {from}; NEGR; T {to};", before: 0x3FC0_0000, after: 0xBFC0_0000 },
];

impl Type {
    /// An absolute operand of the type at a byte of an area.
    fn at(&self, area: &str, byte: u32) -> String {
        match (self.width, area.starts_with("DB")) {
            ('X', true) => format!("{area}X {byte}.3"),
            ('X', false) => format!("{area} {byte}.3"),
            (width, _) => format!("{area}{width} {byte}"),
        }
    }

    /// Statements that move a value between places.
    fn copy(&self, from: &str, to: &str) -> String {
        if self.width == 'X' { format!("U {from}; = {to};") } else { format!("L {from}; T {to};") }
    }

    fn change(&self, from: &str, to: &str) -> String {
        self.change.replace("{from}", from).replace("{to}", to)
    }
}

/// Where an actual lies.
struct Actual {
    name: &'static str,
    /// The block that calls. `#f0` is its formal, `#s0` its static, `#t0` its temp.
    caller: Caller,
    /// The operand of a type, for the first, second or third parameter.
    place: fn(&Type, u32) -> String,
    /// Statements before all others.
    before: &'static str,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Caller {
    Fc,
    Fb,
}

const ACTUALS: [Actual; 11] = [
    Actual { name: "M", caller: Caller::Fc, place: |t, n| t.at("M", 100 + 4 * n), before: "" },
    Actual { name: "E", caller: Caller::Fc, place: |t, n| t.at("E", 100 + 4 * n), before: "" },
    Actual { name: "A", caller: Caller::Fb, place: |t, n| t.at("A", 100 + 4 * n), before: "" },
    Actual { name: "qualified", caller: Caller::Fc, place: |t, n| t.at("DB10.DB", 20 + 4 * n), before: "" },
    Actual { name: "qualified", caller: Caller::Fb, place: |t, n| t.at("DB10.DB", 20 + 4 * n), before: "" },
    Actual { name: "opened", caller: Caller::Fc, place: |t, n| t.at("DB", 20 + 4 * n), before: "AUF DB 10;" },
    Actual { name: "temp of an FC", caller: Caller::Fc, place: |_, n| format!("#t{n}"), before: "" },
    Actual { name: "temp of an FB", caller: Caller::Fb, place: |_, n| format!("#t{n}"), before: "" },
    Actual { name: "formal of an FC", caller: Caller::Fc, place: |_, n| format!("#f{n}"), before: "" },
    Actual { name: "formal of an FB", caller: Caller::Fb, place: |_, n| format!("#f{n}"), before: "" },
    Actual { name: "static", caller: Caller::Fb, place: |_, n| format!("#s{n}"), before: "" },
];

/// Who is called: text of the call.
const CALLEES: [(&str, &str); 3] =
    [("FC", "CALL FC 5 "), ("FB", "CALL FB 5 , DB 5 "), ("multi-instance", "CALL #sub ")];

/// The program of a type, an actual and a callee. Results: `M 10` what the input gave, `M 20` the in/out, `M 30` DB and
/// DI register and AR2 before and after the call.
fn elementary(ty: &Type, actual: &Actual, call: &str) -> String {
    let name = ty.name;
    let place = |n| (actual.place)(ty, n);
    let three = |prefix: &str| (0..3).map(|n| format!("{prefix}{n} : {name};")).collect::<String>();
    let registers = |byte: u32| format!("L DBNO; T MW {byte}; L DINO; T MW {}; TAR2; T MD {};", byte + 2, byte + 4);
    let body = format!(
        "{before} {in0} {in2} {regs} {call}(i := {p0}, o := {p1}, x := {p2}); {regs2} {before} {out1} {out2}",
        in0 = ty.copy(&ty.at("M", 0), &place(0)),
        in2 = ty.copy(&ty.at("M", 0), &place(2)),
        before = actual.before,
        regs = registers(30),
        regs2 = registers(38),
        p0 = place(0),
        p1 = place(1),
        p2 = place(2),
        out1 = ty.copy(&place(1), &ty.at("M", 10)),
        out2 = ty.copy(&place(2), &ty.at("M", 20)),
    );
    let callee = |head: &str, end: &str| {
        format!(
            "{head} VAR_INPUT i : {name}; END_VAR VAR_OUTPUT o : {name}; END_VAR VAR_IN_OUT x : {name}; END_VAR
             BEGIN {} {} {end} ",
            ty.change("#i", "#o"),
            ty.change("#x", "#x"),
        )
    };
    let formals = format!("VAR_IN_OUT {} END_VAR VAR_TEMP {} END_VAR", three("f"), three("t"));
    let statics = format!(
        "VAR_IN_OUT {} END_VAR VAR sub : FB 5; {} END_VAR VAR_TEMP {} END_VAR",
        three("f"),
        three("s"),
        three("t")
    );
    let supply = format!("(f0 := {}, f1 := {}, f2 := {})", ty.at("M", 140), ty.at("M", 144), ty.at("M", 148));
    let (caller, run) = match actual.caller {
        Caller::Fc => {
            (format!("FUNCTION FC 6 : VOID {formals} BEGIN {body} END_FUNCTION"), format!("CALL FC 6 {supply};"))
        }
        Caller::Fb => (
            format!(
                "FUNCTION_BLOCK FB 6 {statics} BEGIN {body} END_FUNCTION_BLOCK
                 DATA_BLOCK DB 6 FB 6 BEGIN END_DATA_BLOCK"
            ),
            format!("CALL FB 6 , DB 6 {supply};"),
        ),
    };
    format!(
        "{fc} {fb} DATA_BLOCK DB 5 FB 5 BEGIN END_DATA_BLOCK
         DATA_BLOCK DB 10 STRUCT a : ARRAY[0..63] OF BYTE; END_STRUCT BEGIN END_DATA_BLOCK
         {caller}
         ORGANIZATION_BLOCK OB 1 BEGIN {run} END_ORGANIZATION_BLOCK",
        fc = callee("FUNCTION FC 5 : VOID", "END_FUNCTION"),
        fb = callee("FUNCTION_BLOCK FB 5", "END_FUNCTION_BLOCK"),
    )
}

/// The value of a type at a byte of bit memory.
fn value(bench: &mut Bench, ty: &Type, byte: u32) -> u32 {
    match ty.width {
        'X' => u32::from(bench.m(byte, 3)),
        'B' => bench.mb(byte),
        'W' => bench.mw(byte),
        _ => bench.md(byte),
    }
}

#[test]
fn elementary_actuals_of_every_kind_for_every_kind_of_block() {
    on_each_engine(|| {
        for ty in &TYPES {
            for actual in &ACTUALS {
                for (callee, call) in CALLEES {
                    if callee == "multi-instance" && actual.caller == Caller::Fc {
                        continue;
                    }
                    let name = format!("{} {} {callee}", ty.name, actual.name);
                    let mut bench = bench(&elementary(ty, actual, call), &[]);
                    bench.run();
                    match ty.width {
                        'X' => bench.set_m(0, 3, ty.before == 1),
                        'B' => bench.set(0, ob1_cpu::Width::Byte, ty.before),
                        'W' => bench.set(0, ob1_cpu::Width::Word, ty.before),
                        _ => bench.set(0, ob1_cpu::Width::DWord, ty.before),
                    }
                    bench.run();
                    let got = (value(&mut bench, ty, 10), value(&mut bench, ty, 20));
                    assert_eq!(got, (ty.after, ty.after), "{name}");
                    // A call leaves the data block registers and AR2 as they were. Behind that of a function block the
                    // DB register holds its instance.
                    let before = (bench.mw(30), bench.mw(32), bench.md(34));
                    let opened = match callee {
                        "FC" => before.0,
                        "FB" => 5,
                        _ => before.1,
                    };
                    let behind = (bench.mw(38), bench.mw(40), bench.md(42));
                    assert_eq!(behind, (opened, before.1, before.2), "{name}: registers");
                }
            }
        }
    });
}

#[test]
fn constants_for_inputs_of_functions_and_function_blocks() {
    on_each_engine(|| {
        for (ty, constant, value) in [
            ("BOOL", "TRUE", 1),
            ("BYTE", "B#16#A5", 0xA5),
            ("CHAR", "'x'", 0x78),
            ("INT", "-2", 0xFFFE),
            ("WORD", "W#16#1234", 0x1234),
            ("S5TIME", "S5T#3S", 0x0300),
            ("DATE", "D#1990-1-3", 2),
            ("DINT", "L#-3", 0xFFFF_FFFD),
            ("DWORD", "DW#16#12345678", 0x1234_5678),
            ("REAL", "1.5", 0x3FC0_0000),
            ("TIME", "T#1S500MS", 1500),
            ("TIME_OF_DAY", "TOD#0:0:2.5", 2500),
        ] {
            let move_it = if ty == "BOOL" { "U #i; = M 3.0; L MB 3; T MD 0;" } else { "L #i; T MD 0;" };
            for (head, end, call, data) in [
                ("FUNCTION FC 5 : VOID", "END_FUNCTION", "CALL FC 5", ""),
                (
                    "FUNCTION_BLOCK FB 5",
                    "END_FUNCTION_BLOCK",
                    "CALL FB 5 , DB 5",
                    "DATA_BLOCK DB 5 FB 5 BEGIN END_DATA_BLOCK",
                ),
            ] {
                let source = format!(
                    "{head} VAR_INPUT i : {ty}; END_VAR BEGIN {move_it} {end} {data}
                     ORGANIZATION_BLOCK OB 1 BEGIN {call} (i := {constant}); END_ORGANIZATION_BLOCK"
                );
                let mut bench = bench(&source, &[]);
                bench.run();
                let sign = if ty == "INT" { 0xFFFF } else { u32::MAX };
                assert_eq!(bench.md(0) & sign, value, "{call} {ty} {constant}");
            }
        }
    });
}

/// Complex types, distinguished by their first word; some no longer than an elementary one.
const COMPOSED: [(&str, &str, &str); 7] = [
    ("STRUCT a : INT; END_STRUCT", "#i.a", "#x.a"),
    ("STRUCT a : INT; b : BYTE; END_STRUCT", "#i.a", "#x.a"),
    ("ARRAY [5..6] OF WORD", "#i[5]", "#x[5]"),
    ("STRUCT a : INT; b : REAL; c : INT; END_STRUCT", "#i.a", "#x.a"),
    ("ARRAY [1..4] OF INT", "#i[1]", "#x[1]"),
    ("ARRAY [0..1, 2..3] OF INT", "#i[0,2]", "#x[0,2]"),
    ("UDT 7", "#i.in.a", "#x.in.a"),
];

/// Composed actuals. The callee adds 1 to the first word of the input into that of the output, and 2 to that of the
/// in/out.
#[test]
fn composed_actuals_of_every_kind_for_every_kind_of_block() {
    on_each_engine(|| {
        // Name, caller's kind, actual of the nth parameter, first word of it for the caller.
        type Place = fn(u32) -> String;
        let actuals: [(&str, Caller, Place); 7] = [
            ("of a data block", Caller::Fc, |n| format!("DB10.v{n}")),
            ("of a data block", Caller::Fb, |n| format!("DB10.v{n}")),
            ("temp of an FC", Caller::Fc, |n| format!("#t{n}")),
            ("temp of an FB", Caller::Fb, |n| format!("#t{n}")),
            ("static", Caller::Fb, |n| format!("#s{n}")),
            ("formal of an FC", Caller::Fc, |n| format!("#f{n}")),
            ("input of an FB", Caller::Fb, |n| format!("#g{n}")),
        ];
        for (ty, input, in_out) in COMPOSED {
            let suffix = input.trim_start_matches("#i");
            let output = format!("#o{suffix}");
            for (name, caller, place) in actuals {
                for (callee, call) in CALLEES {
                    if callee == "multi-instance" && caller == Caller::Fc {
                        continue;
                    }
                    if name == "formal of an FC" && callee == "FB" {
                        // Where it lies is known at run time only: refused by the compiler.
                        continue;
                    }
                    let body = format!(
                        "L MW 0; T {p0}{suffix}; T {p2}{suffix}; AUF DB 11; {call} (i := {p0}, o := {p1}, x := {p2});
                         L {p1}{suffix}; T MW 10; L {p2}{suffix}; T MW 20; L {p0}{suffix}; T MW 30;",
                        p0 = place(0),
                        p1 = place(1),
                        p2 = place(2)
                    );
                    let block = |head: &str, end: &str| {
                        format!(
                            "{head} VAR_INPUT i : {ty}; END_VAR VAR_OUTPUT o : {ty}; END_VAR VAR_IN_OUT x : {ty}; END_VAR
                             BEGIN L {input}; + 1; T {output}; L {in_out}; + 2; T {in_out}; {end} "
                        )
                    };
                    let three = |prefix: &str| (0..3).map(|n| format!("{prefix}{n} : {ty};")).collect::<String>();
                    let caller = match caller {
                        Caller::Fc => format!(
                            "FUNCTION FC 6 : VOID VAR_IN_OUT {} END_VAR VAR_TEMP {} END_VAR BEGIN {body} END_FUNCTION
                             ORGANIZATION_BLOCK OB 1 BEGIN
                             CALL FC 6 (f0 := DB11.v0, f1 := DB11.v1, f2 := DB11.v2); END_ORGANIZATION_BLOCK",
                            three("f"),
                            three("t")
                        ),
                        Caller::Fb => format!(
                            "FUNCTION_BLOCK FB 6 VAR_INPUT {} END_VAR VAR {} sub : FB 5; END_VAR VAR_TEMP {} END_VAR
                             BEGIN {body} END_FUNCTION_BLOCK DATA_BLOCK DB 6 FB 6 BEGIN END_DATA_BLOCK
                             ORGANIZATION_BLOCK OB 1 BEGIN CALL FB 6 , DB 6; END_ORGANIZATION_BLOCK",
                            three("g"),
                            three("s"),
                            three("t")
                        ),
                    };
                    let data =
                        |n: u32| format!("DATA_BLOCK DB {n} STRUCT {} END_STRUCT BEGIN END_DATA_BLOCK ", three("v"));
                    let source = format!(
                        "TYPE UDT 7 STRUCT in : STRUCT a : INT; b : DINT; END_STRUCT; END_STRUCT END_TYPE
                         {} {} DATA_BLOCK DB 5 FB 5 BEGIN END_DATA_BLOCK {} {} {caller}",
                        block("FUNCTION FC 5 : VOID", "END_FUNCTION"),
                        block("FUNCTION_BLOCK FB 5", "END_FUNCTION_BLOCK"),
                        data(10),
                        data(11),
                    );
                    let mut bench = bench(&source, &[]);
                    bench.run();
                    bench.set(0, ob1_cpu::Width::Word, 0x1200);
                    bench.run();
                    let got = (bench.mw(10), bench.mw(20), bench.mw(30));
                    assert_eq!(got, (0x1201, 0x1202, 0x1200), "{ty} {name} {callee}");
                }
            }
        }
    });
}

/// STEP 7 copies an elementary parameter that an FC hands on to an FC, and the result back behind the call.
#[test]
fn a_parameter_that_is_handed_on_is_a_copy() {
    on_each_engine(|| {
        let source = "FUNCTION FC 1 : VOID VAR_INPUT i : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN
             L 9; T MW 30; L #i; T MW 32; L 1; T #q; L 2; T MW 124; END_FUNCTION
             FUNCTION FC 2 : VOID VAR_INPUT i : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN
             CALL FC 1 (i := #i, q := #q); END_FUNCTION
             ORGANIZATION_BLOCK OB 1 BEGIN L 5; T MW 30; CALL FC 2 (i := MW 30, q := MW 124); END_ORGANIZATION_BLOCK";
        let mut bench = bench(source, &[]);
        bench.run();
        assert_eq!((bench.mw(30), bench.mw(32), bench.mw(124)), (9, 5, 1));
    });
}
