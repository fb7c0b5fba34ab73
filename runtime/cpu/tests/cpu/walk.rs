//! A walk through the instruction list: every mnemonic of the STL reference, in both sets, compiled from source text
//! and run; result in both accumulators and status word as its page of the reference has them. More values per
//! instruction: `instructions.rs`.
//!
//! ["Statement List (STL) for S7-300 and S7-400", the table "Status word" of each instruction]

use std::collections::{BTreeMap, BTreeSet};

use ob1_cpu::{Cpu, CpuConfig, Width};
use ob1_stl::{Library, Mnemonics, Options, Source, compile};
use ob1_time::Span;

use crate::common;
use crate::common::source::blocks;
use crate::common::{Bench, on_each_engine};

/// Appendix A of the reference: German mnemonic, and the international one where it differs.
const MNEMONICS: &str = "+ = ) +AR1 +AR2 +D -D *D /D ==D <>D >D <D >=D <=D +I -I *I /I ==I <>I >I <I >=I <=I \
    +R -R *R /R ==R <>R >R <R >=R <=R ABS ACOS ASIN ATAN AUF:OPN BE BEA:BEU BEB:BEC BLD BTD BTI CALL CC CLR COS \
    DEC DTB DTR ENT EXP FN FP FR INC INVD INVI ITB ITD L LAR1 LAR2 LC LEAVE LN LOOP MCR( )MCR MCRA MCRD MOD \
    NEGD NEGI NEGR NOP NOT O O( OD ON ON( OW POP PUSH R RLD RLDA RND RND- RND+ RRD RRDA S SA:SF SAVE SE:SD SET \
    SI:SP SIN SLD SLW SPA:JU SPB:JC SPBB:JCB SPBI:JBI SPBIN:JNBI SPBN:JCN SPBNB:JNB SPL:JL SPM:JM SPMZ:JMZ \
    SPN:JN SPO:JO SPP:JP SPPZ:JPZ SPS:JOS SPU:JUO SPZ:JZ SQR SQRT SRD SRW SS SSD SSI SV:SE T TAD:CAD TAK TAN \
    TAR:CAR TAR1 TAR2 TAW:CAW TDB:CDB TRUNC U:A U(:A( UC UD:AD UN:AN UN(:AN( UW:AW X X( XN XN( XOD XOW ZR:CD ZV:CU";
/// Operand identifiers that differ.
const IDENTIFIERS: &str = "E:I EB:IB EW:IW ED:ID A:Q AB:QB AW:QW AD:QD PEB:PIB PEW:PIW PED:PID PAB:PQB PAW:PQW PAD:PQD \
    Z:C BIE:BR";

const FC: u32 = 1;
const RLO: u32 = 2;
const STA: u32 = 4;
const OR: u32 = 8;
const OS: u32 = 16;
const OV: u32 = 32;
const CC0: u32 = 64;
const CC1: u32 = 128;
const BR: u32 = 256;
/// What arithmetic leaves alone.
const REST: u32 = BR | OR | STA | RLO | FC;
const ALL: u32 = 0x1FF;
const CC: u32 = CC1 | CC0 | OV;

/// Statements in German, separated by semicolons; ACCU1, ACCU2 and status word before and after. Memory: M 100.0 is 1,
/// M 100.1 is 0; DB 10 holds 10 bytes, the first word 1234h; FC 1 loads 7, FC 2 is empty. T 1 and Z 1 are untouched.
type Row = (&'static str, [u32; 3], [u32; 3]);

const fn r(value: f32) -> u32 {
    value.to_bits()
}

#[rustfmt::skip]
const BIT_LOGIC: &[Row] = &[
    // /FC = 0: the first scan of a chain.
    ("U M 100.0", [1, 2, 0], [1, 2, RLO | STA | FC]),
    ("U M 100.1", [1, 2, RLO], [1, 2, FC]),
    ("UN M 100.1", [1, 2, 0], [1, 2, RLO | FC]),
    ("UN M 100.0", [1, 2, 0], [1, 2, STA | FC]),
    ("O M 100.0", [1, 2, OR], [1, 2, RLO | STA | FC]),
    ("ON M 100.0", [1, 2, RLO], [1, 2, STA | FC]),
    ("X M 100.0", [1, 2, RLO], [1, 2, RLO | STA | FC]),
    ("XN M 100.0", [1, 2, RLO], [1, 2, STA | FC]),
    // /FC = 1: combined with the RLO; BR, CC1, CC0, OV and OS stay.
    ("U M 100.0", [1, 2, FC | BR | CC | OS], [1, 2, STA | FC | BR | CC | OS]),
    ("UN M 100.1", [1, 2, FC | RLO], [1, 2, RLO | FC]),
    ("O M 100.1", [1, 2, FC | RLO], [1, 2, RLO | FC]),
    ("ON M 100.1", [1, 2, FC], [1, 2, RLO | FC]),
    ("X M 100.0", [1, 2, FC | RLO], [1, 2, STA | FC]),
    ("XN M 100.1", [1, 2, FC], [1, 2, RLO | FC]),
    ("U M 100.1", [1, 2, FC | OR], [1, 2, RLO | OR | FC]),
    ("O", [1, 2, FC | RLO], [1, 2, OR | STA | RLO | FC]),
    ("U( ; U M 100.0; )", [1, 2, FC | RLO], [1, 2, RLO | STA | FC]),
    ("UN( ; U M 100.0; )", [1, 2, FC | RLO], [1, 2, STA | FC]),
    ("O( ; U M 100.0; )", [1, 2, FC], [1, 2, RLO | STA | FC]),
    ("ON( ; U M 100.0; )", [1, 2, FC], [1, 2, STA | FC]),
    ("X( ; U M 100.0; )", [1, 2, FC | RLO], [1, 2, STA | FC]),
    ("XN( ; U M 100.0; )", [1, 2, FC | RLO], [1, 2, RLO | STA | FC]),
    ("= M 101.0", [1, 2, RLO | FC | OR], [1, 2, RLO | STA]),
    ("= M 101.0", [1, 2, FC | STA], [1, 2, 0]),
    ("S M 101.0; L MB 101", [1, 2, RLO | FC | OR], [1, 1, RLO | STA]),
    ("R M 100.0; L MB 100", [1, 2, RLO | FC | OR], [0, 1, RLO | STA]),
    ("FP M 101.0", [1, 2, RLO], [1, 2, RLO | STA | FC]),
    ("FP M 100.0", [1, 2, RLO | OR | STA], [1, 2, FC | STA]),
    ("FN M 100.0", [1, 2, OR], [1, 2, RLO | FC]),
    ("FN M 101.0", [1, 2, STA], [1, 2, FC]),
    ("SET", [1, 2, OR | FC], [1, 2, RLO | STA]),
    ("CLR", [1, 2, ALL], [1, 2, BR | CC | OS]),
    ("NOT", [1, 2, FC | OR], [1, 2, RLO | STA | FC | OR]),
    ("SAVE", [1, 2, RLO], [1, 2, RLO | BR]),
    ("SAVE", [1, 2, BR], [1, 2, 0]),
    ("U ==0", [1, 2, 0], [1, 2, RLO | STA | FC]),
    ("U <>0", [1, 2, CC1], [1, 2, RLO | STA | FC | CC1]),
    ("U >0", [1, 2, CC1], [1, 2, RLO | STA | FC | CC1]),
    ("U <0", [1, 2, CC0], [1, 2, RLO | STA | FC | CC0]),
    ("U >=0", [1, 2, CC0], [1, 2, FC | CC0]),
    ("U <=0", [1, 2, CC1], [1, 2, FC | CC1]),
    ("U UO", [1, 2, CC1 | CC0], [1, 2, RLO | STA | FC | CC1 | CC0]),
    ("U OV", [1, 2, OV], [1, 2, RLO | STA | FC | OV]),
    ("U OS", [1, 2, OS], [1, 2, RLO | STA | FC | OS]),
    ("U BIE", [1, 2, BR], [1, 2, RLO | STA | FC | BR]),
];

#[rustfmt::skip]
const LOADS: &[Row] = &[
    ("L MB 100", [5, 6, ALL], [1, 5, ALL]),
    ("L B#16#A5", [5, 6, ALL], [0xA5, 5, ALL]),
    ("L -2", [5, 6, 0], [0xFFFE, 5, 0]),
    ("L L#-2", [5, 6, 0], [0xFFFF_FFFE, 5, 0]),
    ("L P#DBX 2.3", [5, 6, 0], [0x8400_0013, 5, 0]),
    ("L STW", [5, 6, ALL], [ALL, 5, ALL]),
    ("T STW", [0x155, 6, 0], [0x155, 6, 0x155]),
    // What an S7-300 keeps of /FC, STA and OR is in `what_t_stw_writes`.
    ("T STW", [OS | OV | CC1, 6, BR | CC0 | RLO], [OS | OV | CC1, 6, OS | OV | CC1]),
    ("T MW 102; L 0; L MD 100", [0xABCD_1234, 6, ALL], [0x0100_1234, 0, ALL]),
    ("L T 1", [5, 6, ALL], [0, 5, ALL]),
    ("LC T 1", [5, 6, ALL], [0, 5, ALL]),
    ("L C#17; S Z 1; LC Z 1", [0, 0, RLO | FC], [0x17, 0x17, RLO]),
    ("L C#17; S Z 1; L Z 1", [0, 0, RLO | FC], [17, 0x17, RLO]),
    ("AUF DB 10; L DBW 0", [5, 6, ALL], [0x1234, 5, ALL]),
    ("AUF DI 10; L DIW 0", [5, 6, ALL], [0x1234, 5, ALL]),
    ("AUF DB 10; L DBLG", [5, 6, ALL], [10, 5, ALL]),
    ("AUF DI 10; TDB; L DBNO", [5, 6, ALL], [10, 5, ALL]),
    ("AUF DI 10; L DINO", [5, 6, ALL], [10, 5, ALL]),
    ("AUF DI 10; L DILG", [5, 6, ALL], [10, 5, ALL]),
    ("L DB10.DBW 0; L DBNO", [5, 6, ALL], [10, 0x1234, ALL]),
    ("TAK", [1, 2, ALL], [2, 1, ALL]),
    ("PUSH", [1, 2, ALL], [1, 1, ALL]),
    ("POP", [1, 2, ALL], [2, 2, ALL]),
    ("INC 2", [0x1234_56FF, 2, ALL], [0x1234_5601, 2, ALL]),
    ("DEC 2", [0x1234_5601, 2, ALL], [0x1234_56FF, 2, ALL]),
    ("+ 5", [0xFFFF_FFFE, 2, ALL], [0xFFFF_0003, 2, ALL]),
    ("+ L#5", [0xFFFF_FFFE, 2, ALL], [3, 2, ALL]),
    ("LAR1; L 0; TAR1", [0x8300_0010, 2, ALL], [0x8300_0010, 0, ALL]),
    ("LAR2; L 0; TAR2", [0x8300_0010, 2, ALL], [0x8300_0010, 0, ALL]),
    ("LAR1 P#M 12.0; TAR1", [1, 2, ALL], [0x8300_0060, 1, ALL]),
    ("LAR1 P#M 12.0; LAR2 P#3.0; TAR; TAR1", [1, 2, ALL], [0x18, 1, ALL]),
    ("LAR1 P#M 12.0; +AR1 P#1.1; TAR1", [1, 2, ALL], [0x8300_0069, 1, ALL]),
    ("LAR1 P#M 12.0; +AR1 P#8190.0; TAR1", [1, 2, ALL], [0x8300_0050, 1, ALL]),
    ("LAR2 P#M 12.0; +AR2; TAR2", [0xFFF8, 2, ALL], [0x8300_0058, 0xFFF8, ALL]),
    ("LAR1 P#M 100.0; L B [AR1,P#0.0]", [5, 6, ALL], [1, 5, ALL]),
    ("L P#100.0; T MD 104; L MB [MD 104]", [5, 6, ALL], [1, 0x320, ALL]),
    ("NOP 0; NOP 1; BLD 130", [1, 2, ALL], [1, 2, ALL]),
];

#[rustfmt::skip]
const ACCUMULATORS: &[Row] = &[
    ("+I", [1, 2, REST | CC], [3, 2, REST | CC1]),
    ("-I", [3, 2, REST], [0xFFFF, 2, REST | CC0]),
    ("*I", [0x4000, 4, REST], [0x1_0000, 4, REST | CC1 | OV | OS]),
    ("/I", [5, 17, REST], [0x0002_0003, 17, REST | CC1]),
    ("+D", [1, 0x7FFF_FFFF, REST], [0x8000_0000, 0x7FFF_FFFF, REST | CC0 | OV | OS]),
    ("-D", [2, 2, REST | OS], [0, 2, REST | OS]),
    ("*D", [3, 4, REST], [12, 4, REST | CC1]),
    ("/D", [0, 4, REST], [0, 4, REST | CC | OS]),
    ("MOD", [5, 17, REST], [2, 17, REST | CC1]),
    ("+R", [r(1.5), r(2.0), REST], [r(3.5), r(2.0), REST | CC1]),
    ("-R", [r(1.5), r(1.0), REST], [r(-0.5), r(1.0), REST | CC0]),
    ("*R", [r(3e38), r(10.0), REST], [r(f32::INFINITY), r(10.0), REST | CC1 | OV | OS]),
    ("/R", [r(2.0), r(0.0), REST], [0, 0, REST]),
    ("==I", [5, 5, 0], [5, 5, RLO | STA | FC]),
    ("<>I", [5, 6, OV | OR], [5, 6, RLO | STA | FC | CC1]),
    (">I", [5, 6, OS], [5, 6, RLO | STA | FC | CC1 | OS]),
    ("<I", [5, 6, 0], [5, 6, FC | CC1]),
    (">=I", [5, 0xFFFF, 0], [5, 0xFFFF, FC | CC0]),
    ("<=I", [5, 0xFFFF, 0], [5, 0xFFFF, RLO | STA | FC | CC0]),
    ("==D", [5, 0x1_0005, 0], [5, 0x1_0005, FC | CC1]),
    ("<>D", [5, 5, 0], [5, 5, FC]),
    (">D", [5, 6, 0], [5, 6, RLO | STA | FC | CC1]),
    ("<D", [5, 0x8000_0000, 0], [5, 0x8000_0000, RLO | STA | FC | CC0]),
    (">=D", [5, 5, 0], [5, 5, RLO | STA | FC]),
    ("<=D", [5, 6, 0], [5, 6, FC | CC1]),
    ("==R", [r(1.0), r(1.0), 0], [r(1.0), r(1.0), RLO | STA | FC]),
    ("<>R", [r(1.0), r(2.0), 0], [r(1.0), r(2.0), RLO | STA | FC | CC1]),
    (">R", [r(1.0), r(2.0), 0], [r(1.0), r(2.0), RLO | STA | FC | CC1]),
    ("<R", [r(1.0), r(-2.0), 0], [r(1.0), r(-2.0), RLO | STA | FC | CC0]),
    (">=R", [0x7FC0_0000, r(1.0), 0], [0x7FC0_0000, r(1.0), FC | CC | OS]),
    ("<=R", [r(1.0), r(1.0), 0], [r(1.0), r(1.0), RLO | STA | FC]),
    ("UW", [0xFFFF_0FF0, 0x00FF, REST | CC], [0xFFFF_00F0, 0x00FF, REST | CC1]),
    ("UW W#16#F", [0xFFFF_0FF0, 2, REST | CC], [0xFFFF_0000, 2, REST]),
    ("OW", [0xF0, 0x0F, REST], [0xFF, 0x0F, REST | CC1]),
    ("XOW", [0xFF, 0x0F, REST], [0xF0, 0x0F, REST | CC1]),
    ("UD", [0xF0F0_F0F0, 0xFF00_FF00, REST], [0xF000_F000, 0xFF00_FF00, REST | CC1]),
    ("OD DW#16#80000000", [1, 2, REST], [0x8000_0001, 2, REST | CC1]),
    ("XOD", [5, 5, REST | CC], [0, 5, REST]),
    ("SLW 4", [0xAAAA_1234, 2, REST | CC0 | OV], [0xAAAA_2340, 2, REST | CC1]),
    ("SRW 4", [0xAAAA_1234, 2, REST], [0xAAAA_0123, 2, REST]),
    ("SSI 4", [0xAAAA_8238, 2, REST], [0xAAAA_F823, 2, REST | CC1]),
    ("SLD 4", [0x1234_5678, 2, REST], [0x2345_6780, 2, REST | CC1]),
    ("SRD", [0x1234_5678, 8, REST], [0x0012_3456, 8, REST]),
    ("SSD 4", [0x8234_5678, 2, REST], [0xF823_4567, 2, REST | CC1]),
    ("RLD 4", [0xF234_5678, 2, REST], [0x2345_678F, 2, REST | CC1]),
    ("RRD 4", [0x1234_567F, 2, REST], [0xF123_4567, 2, REST | CC1]),
    ("RLDA", [0x8000_0000, 2, REST | CC1], [1, 2, REST | CC1]),
    ("RRDA", [2, 2, REST | CC1], [0x8000_0001, 2, REST]),
    ("BTI", [0xAAAA_8123, 2, ALL], [0xAAAA_FF85, 2, ALL]),
    ("ITB", [0xAAAA_FF85, 2, REST | CC0], [0xAAAA_F123, 2, REST | CC0]),
    ("ITB", [1000, 2, REST], [1000, 2, REST | OV | OS]),
    ("BTD", [0x8000_0123, 2, ALL], [0xFFFF_FF85, 2, ALL]),
    ("DTB", [0xFFFF_FF85, 2, REST], [0xF000_0123, 2, REST]),
    ("ITD", [0x1234_FFFE, 2, ALL], [0xFFFF_FFFE, 2, ALL]),
    ("DTR", [0xFFFF_FFFE, 2, ALL], [r(-2.0), 2, ALL]),
    ("RND", [r(2.5), 2, REST], [2, 2, REST]),
    ("RND+", [r(2.1), 2, REST], [3, 2, REST]),
    ("RND-", [r(-2.1), 2, REST], [0xFFFF_FFFD, 2, REST]),
    ("TRUNC", [r(-2.9), 2, REST], [0xFFFF_FFFE, 2, REST]),
    ("RND", [r(1e20), 2, REST], [r(1e20), 2, REST | OV | OS]),
    ("INVI", [0xAAAA_00FF, 2, ALL], [0xAAAA_FF00, 2, ALL]),
    ("INVD", [0x00FF_00FF, 2, ALL], [0xFF00_FF00, 2, ALL]),
    ("NEGI", [0xAAAA_0005, 2, REST], [0xAAAA_FFFB, 2, REST | CC0]),
    ("NEGI", [0x8000, 2, REST], [0x8000, 2, REST | CC0 | OV | OS]),
    ("NEGD", [5, 2, REST], [0xFFFF_FFFB, 2, REST | CC0]),
    ("NEGR", [r(5.0), 2, ALL], [r(-5.0), 2, ALL]),
    ("ABS", [r(-5.0), 2, ALL], [r(5.0), 2, ALL]),
    ("TAW", [0x1122_3344, 2, ALL], [0x1122_4433, 2, ALL]),
    ("TAD", [0x1122_3344, 2, ALL], [0x4433_2211, 2, ALL]),
    ("SQR", [r(-3.0), 2, REST], [r(9.0), 2, REST | CC1]),
    ("SQRT", [r(9.0), 2, REST], [r(3.0), 2, REST | CC1]),
    ("SQRT", [r(-9.0), 2, REST], [0x7FFF_FFFF, 2, REST | CC | OS]),
    ("LN", [r(1.0), 2, REST | CC], [0, 2, REST]),
    ("EXP", [0, 2, REST], [r(1.0), 2, REST | CC1]),
    ("SIN", [0, 2, REST | CC], [0, 2, REST]),
    ("COS", [0, 2, REST], [r(1.0), 2, REST | CC1]),
    ("TAN", [0, 2, REST], [0, 2, REST]),
    ("ASIN", [0, 2, REST], [0, 2, REST]),
    ("ACOS", [r(1.0), 2, REST], [0, 2, REST]),
    ("ATAN", [0, 2, REST], [0, 2, REST]),
];

#[rustfmt::skip]
const TIMERS: &[Row] = &[
    // A start needs an edge of the RLO: what is left shows the timer; /FC and OR become 0, STA and RLO stay.
    ("CLR; SI T 1; L S5T#2S; SET; SI T 1; L T 1", [0, 0, ALL], [200, 0x0200, BR | CC | OS | RLO | STA]),
    ("CLR; SV T 1; L S5T#2S; SET; SV T 1; LC T 1", [0, 0, 0], [0x0200, 0x0200, RLO | STA]),
    ("CLR; SE T 1; L S5T#2S; SET; SE T 1; L T 1", [0, 0, 0], [200, 0x0200, RLO | STA]),
    ("CLR; SS T 1; L S5T#2S; SET; SS T 1; L T 1", [0, 0, 0], [200, 0x0200, RLO | STA]),
    ("L S5T#2S; SET; SA T 1; CLR; SA T 1; L T 1", [0, 0, 0], [200, 0x0200, 0]),
    ("CLR; SI T 1; L S5T#2S; SET; SI T 1; R T 1; L T 1", [0, 0, 0], [0, 0x0200, RLO | STA]),
    ("CLR; SI T 1; L S5T#2S; SET; SI T 1; U T 1", [0, 0, 0], [0x0200, 0, RLO | STA | FC]),
    ("SI T 2", [0x0200, 2, OR | STA | FC], [0x0200, 2, STA]),
    ("FR T 1", [1, 2, ALL], [1, 2, BR | CC | OS | STA | RLO]),
    ("FR Z 1", [1, 2, OR | STA | FC], [1, 2, STA]),
    ("CLR; ZV Z 1; SET; ZV Z 1; L Z 1", [0, 2, 0], [1, 0, RLO | STA]),
    ("L C#5; SET; S Z 1; CLR; ZR Z 1; SET; ZR Z 1; L Z 1", [0, 2, 0], [4, 5, RLO | STA]),
    ("L C#5; SET; S Z 1; R Z 1; L Z 1", [0, 2, 0], [0, 5, RLO | STA]),
    ("L C#5; SET; S Z 1; U Z 1", [0, 2, 0], [5, 0, RLO | STA | FC]),
    ("ZV Z 2", [1, 2, OR | FC | STA], [1, 2, STA]),
];

#[rustfmt::skip]
const JUMPS: &[Row] = &[
    ("SPA go; L 9; go: NOP 0", [1, 2, ALL], [1, 2, ALL]),
    ("SPB go; L 9; go: NOP 0", [1, 2, RLO | FC | OR], [1, 2, RLO | STA]),
    ("SPB go; L 9; go: NOP 0", [1, 2, FC | OR], [9, 1, RLO | STA]),
    ("SPBN go; L 9; go: NOP 0", [1, 2, FC | OR], [1, 2, RLO | STA]),
    ("SPBN go; L 9; go: NOP 0", [1, 2, FC | OR | RLO], [9, 1, RLO | STA]),
    ("SPBB go; L 9; go: NOP 0", [1, 2, RLO], [1, 2, RLO | STA | BR]),
    ("SPBB go; L 9; go: NOP 0", [1, 2, BR], [9, 1, RLO | STA]),
    ("SPBNB go; L 9; go: NOP 0", [1, 2, BR], [1, 2, RLO | STA]),
    ("SPBNB go; L 9; go: NOP 0", [1, 2, RLO], [9, 1, RLO | STA | BR]),
    ("SPBI go; L 9; go: NOP 0", [1, 2, BR | OR | FC], [1, 2, BR | STA]),
    ("SPBI go; L 9; go: NOP 0", [1, 2, RLO], [9, 1, RLO | STA]),
    ("SPBIN go; L 9; go: NOP 0", [1, 2, 0], [1, 2, STA]),
    ("SPBIN go; L 9; go: NOP 0", [1, 2, BR], [9, 1, BR | STA]),
    ("SPO go; L 9; go: NOP 0", [1, 2, ALL], [1, 2, ALL]),
    ("SPO go; L 9; go: NOP 0", [1, 2, ALL & !OV], [9, 1, ALL & !OV]),
    ("SPS go; L 9; go: NOP 0", [1, 2, ALL], [1, 2, ALL & !OS]),
    ("SPS go; L 9; go: NOP 0", [1, 2, OV], [9, 1, OV]),
    ("SPZ go; L 9; go: NOP 0", [1, 2, REST], [1, 2, REST]),
    ("SPZ go; L 9; go: NOP 0", [1, 2, CC1], [9, 1, CC1]),
    ("SPN go; L 9; go: NOP 0", [1, 2, CC0], [1, 2, CC0]),
    ("SPN go; L 9; go: NOP 0", [1, 2, CC1 | CC0], [9, 1, CC1 | CC0]),
    ("SPP go; L 9; go: NOP 0", [1, 2, CC1], [1, 2, CC1]),
    ("SPP go; L 9; go: NOP 0", [1, 2, CC0], [9, 1, CC0]),
    ("SPM go; L 9; go: NOP 0", [1, 2, CC0], [1, 2, CC0]),
    ("SPM go; L 9; go: NOP 0", [1, 2, 0], [9, 1, 0]),
    ("SPPZ go; L 9; go: NOP 0", [1, 2, 0], [1, 2, 0]),
    ("SPPZ go; L 9; go: NOP 0", [1, 2, CC0], [9, 1, CC0]),
    ("SPMZ go; L 9; go: NOP 0", [1, 2, CC0], [1, 2, CC0]),
    ("SPMZ go; L 9; go: NOP 0", [1, 2, CC1], [9, 1, CC1]),
    ("SPU go; L 9; go: NOP 0", [1, 2, CC1 | CC0], [1, 2, CC1 | CC0]),
    ("SPU go; L 9; go: NOP 0", [1, 2, CC1], [9, 1, CC1]),
    ("SPL no; SPA a0; SPA a1; no: L 8; SPA go; a0: L 9; SPA go; a1: L 10; go: NOP 0", [1, 2, ALL], [10, 1, ALL]),
    ("SPL no; SPA a0; SPA a1; no: L 8; SPA go; a0: L 9; SPA go; a1: L 10; go: NOP 0", [2, 2, ALL], [8, 2, ALL]),
    ("go: T MW 102; L MB 101; INC 1; T MB 101; L MW 102; LOOP go; L MB 101", [3, 2, ALL], [3, 0, ALL]),
];

#[rustfmt::skip]
const BLOCKS: &[Row] = &[
    // The called block and the return: OS and OR and /FC 0, STA 1; RLO as the block leaves it.
    ("CALL FC 2", [1, 2, ALL], [1, 2, ALL & !(OS | OR | FC)]),
    ("UC FC 1", [1, 2, RLO | OS], [7, 1, RLO | STA]),
    ("CC FC 1", [1, 2, RLO | FC], [7, 1, RLO | STA]),
    ("CC FC 1", [1, 2, FC], [1, 2, RLO | STA]),
    ("UC FC 3", [1, 2, RLO], [3, 1, RLO | STA]),
    ("UC FC 3", [1, 2, 0], [4, 3, RLO | STA]),
    ("UC FC 4", [1, 2, 0], [5, 1, STA]),
    ("MCRA; CLR; MCR( ; SET; = M 100.0; L 7; T MW 102; )MCR; MCRD; L MD 100", [0, 0, BR], [0, 7, BR | RLO | STA]),
    ("MCRA; SET; MCR( ; CLR; )MCR; MCRD", [1, 2, OR | FC], [1, 2, STA]),
];

const PROGRAM: &str = "
    FUNCTION FC 1 : VOID BEGIN L 7; BE; END_FUNCTION
    FUNCTION FC 2 : VOID BEGIN END_FUNCTION
    FUNCTION FC 3 : VOID BEGIN L 3; BEB; L 4; END_FUNCTION
    FUNCTION FC 4 : VOID BEGIN L 5; BEA; L 6; END_FUNCTION
    DATA_BLOCK DB 10 STRUCT a : ARRAY[1..5] OF WORD := W#16#1234; END_STRUCT BEGIN END_DATA_BLOCK";

/// The statements in the other set, word by word.
fn international(text: &str, words: &BTreeMap<&str, &str>, identifiers: &BTreeMap<&str, &str>) -> String {
    let statement = |statement: &str| {
        let mut first = true;
        let mut out = Vec::new();
        for word in statement.split_whitespace() {
            let label = word.ends_with(':');
            let table = if first && !label { words } else { identifiers };
            first &= label;
            out.push(*table.get(word).unwrap_or(&word));
        }
        out.join(" ")
    };
    text.split(';').map(statement).collect::<Vec<_>>().join("; ")
}

fn pairs(text: &'static str) -> BTreeMap<&'static str, &'static str> {
    text.split_whitespace().map(|word| word.split_once(':').unwrap_or((word, word))).collect()
}

/// Runs statements of a set; ACCU1, ACCU2 and status word afterwards.
fn run(text: &str, set: Mnemonics, before: [u32; 3], accumulators: u8) -> [u32; 3] {
    // T STW of an S7-300 leaves /FC, STA and OR alone: statements bring them about. OR without /FC is impossible.
    let (fc, sta, or) = (before[2] & FC != 0, before[2] & STA != 0, before[2] & (OR | FC) == OR | FC);
    let bits = match (accumulators, fc, sta, or) {
        (4, ..) => "",
        (_, true, true, true) => "U M 0.0; O;",
        (_, true, false, true) => "U M 0.0; O; U M 0.1;",
        (_, true, true, false) => "U M 0.0;",
        (_, true, false, false) => "U M 0.1;",
        (_, false, true, _) => "SET;",
        (_, false, false, _) => "CLR;",
    };
    let source = format!(
        "{PROGRAM} ORGANIZATION_BLOCK OB 1 BEGIN
         UN M 0.0; BEB; L 1; T MW 99; {bits} L MW 2; T STW; L MD 4; L MD 8;
         {text};
         T MD 12; TAK; T MD 16; L STW; T MW 20; END_ORGANIZATION_BLOCK"
    );
    // The frame, too, is written in the set.
    let source = match set {
        Mnemonics::International => source
            .replace("BEB;", "BEC;")
            .replace("BEA;", "BEU;")
            .replace("UN M 0.0", "AN M 0.0")
            .replace(" U M 0.", " A M 0."),
        _ => source,
    };
    let mut library = Library::new();
    let natives = blocks(&[]);
    for block in &natives {
        library.insert(block.id(), block.name(), block.interface().clone());
    }
    let bytes = source.into_bytes();
    let options = Options { mnemonics: set, ..Options::default() };
    let output = compile(&[Source { name: "walk.awl".into(), bytes }], &library, &options);
    assert!(output.is_good(), "{text}: {:#?}", output.diagnostics);
    let config = CpuConfig { accumulators, ..CpuConfig::default() };
    let mut bench =
        Bench::with(Cpu::new(config, &output.program, natives, vec![], common::engine()).expect("the program loads"));
    bench.clock.per_statement = Span::ZERO;
    // The start-up clears memory: the first cycle does nothing, the second has the values.
    bench.run();
    bench.set_m(0, 0, true);
    bench.set(2, Width::Word, before[2]);
    bench.set(4, Width::DWord, before[1]);
    bench.set(8, Width::DWord, before[0]);
    bench.run();
    [bench.md(12), bench.md(16), bench.mw(20)]
}

#[test]
fn every_instruction_in_both_sets() {
    on_each_engine(|| {
        let (words, identifiers) = (pairs(MNEMONICS), pairs(IDENTIFIERS));
        let mut seen = BTreeSet::new();
        let mut wrong = Vec::new();
        for (german, before, after) in [BIT_LOGIC, LOADS, ACCUMULATORS, TIMERS, JUMPS, BLOCKS].into_iter().flatten() {
            let english = international(german, &words, &identifiers);
            for (text, set) in [(*german, Mnemonics::German), (english.as_str(), Mnemonics::International)] {
                for accumulators in [2, 4] {
                    let [a1, a2, stw] = run(text, set, *before, accumulators);
                    // An S7-300 does not show /FC, STA and OR in L STW. Four accumulators move up after arithmetic.
                    let mask = if accumulators == 4 { ALL } else { BR | CC | OS | RLO };
                    let a1_out = if *german == "L STW" { after[0] & mask } else { after[0] };
                    let good = a1 == a1_out && stw == after[2] & mask && (accumulators == 4 || a2 == after[1]);
                    if !good {
                        wrong.push(format!(
                            "{text} ({accumulators}): {a1:08X} {a2:08X} {stw:03X} instead of {:08X} {:08X} {:03X}",
                            after[0],
                            after[1],
                            after[2] & mask
                        ));
                    }
                }
            }
            for statement in german.split(';') {
                let word = statement.split_whitespace().find(|word| !word.ends_with(':'));
                seen.extend(word.and_then(|word| words.get_key_value(word)).map(|(german, _)| *german));
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
        // In the called blocks, and on four accumulators only.
        seen.extend(["BE", "BEB", "BEA", "ENT", "LEAVE"]);
        let missing: Vec<_> = words.keys().filter(|word| !seen.contains(*word)).collect();
        assert!(missing.is_empty(), "not walked: {missing:?}");
    });
}

/// `T STW` on an S7-300 leaves /FC, STA and OR as they are: the scan after it begins or continues as if it were not
/// there ["Statement List (STL) for S7-300 and S7-400 Programming", "T STW", note]. M 100.0 is 1, M 100.1 is 0.
#[test]
fn what_t_stw_writes() {
    on_each_engine(|| {
        for (text, rlo_300, rlo_400) in [
            // All bits 1. /FC = 0 on the 300: the scan is the first one. On the 400 it continues, and OR takes part.
            ("CLR; L W#16#1FF; T STW; U M 100.1", 0, RLO),
            // /FC = 1 stays on the 300, and the RLO written is combined.
            ("U M 100.0; L W#16#0; T STW; U M 100.0", 0, RLO),
            ("U M 100.1; L W#16#2; T STW; UN M 100.0", 0, 0),
            ("U M 100.1; L W#16#2; T STW; U M 100.0", RLO, RLO),
            // OR stays on the 300.
            ("U M 100.0; O; L W#16#1; T STW; U M 100.1", RLO, 0),
        ] {
            for (accumulators, rlo) in [(2, rlo_300), (4, rlo_400)] {
                assert_eq!(run(text, Mnemonics::German, [0; 3], accumulators)[2] & RLO, rlo, "{text} {accumulators}");
            }
        }
    });
}

/// How values move between four accumulators. ACCU1 to ACCU4 are 1, 2, 3, 4 before.
#[test]
fn four_accumulators() {
    on_each_engine(|| {
        for (text, after) in [
            ("TAK", [2, 1, 3, 4]),
            ("PUSH", [1, 1, 2, 3]),
            ("POP", [2, 3, 4, 4]),
            ("ENT", [1, 2, 2, 3]),
            ("LEAVE", [1, 3, 4, 4]),
            ("+I", [3, 3, 4, 4]),
            ("-D", [1, 3, 4, 4]),
            ("*D", [2, 3, 4, 4]),
            ("/I", [2, 3, 4, 4]),
            ("MOD", [0, 3, 4, 4]),
            ("+R", [3, 3, 4, 4]),
            ("L 9", [9, 1, 3, 4]),
            ("+ 5", [6, 2, 3, 4]),
            ("==I", [1, 2, 3, 4]),
            ("UW", [0, 2, 3, 4]),
            ("SLW", [4, 2, 3, 4]),
            ("TAR1", [0, 1, 3, 4]),
        ] {
            let source = format!(
                "ORGANIZATION_BLOCK OB 1 BEGIN L 4; PUSH; PUSH; PUSH; L 3; L 2; ENT; L 1; {text};
                 T MD 0; POP; T MD 4; POP; T MD 8; POP; T MD 12; END_ORGANIZATION_BLOCK"
            );
            let mut bench =
                common::source::bench_with(&source, &[], CpuConfig { accumulators: 4, ..CpuConfig::default() }, vec![]);
            bench.run();
            let got = [0, 4, 8, 12].map(|byte| bench.md(byte));
            assert_eq!(got, after, "{text}");
        }
    });
}
