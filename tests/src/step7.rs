//! Generated STEP 7 projects: the example of `examples/step7-project`, and one of the size of a plant.

use ob1_model::{BlockId, BlockKind};
use ob1_project::{
    Area, Block, CodePage, Comments, Cpu, CpuParameters, Cyclic, Head, Line, Module, Network, NewProject, SymbolRow,
    Udt,
};

/// The parts of a block that differ from block to block.
struct Made<'m> {
    kind: BlockKind,
    number: u16,
    name: &'m str,
    declarations: &'m str,
    /// The compiled interface.
    interface: &'m [u8],
    code: &'m [u8],
    title: &'m str,
}

fn block(made: &Made<'_>) -> Block {
    let length = made.code.len().saturating_sub(2) as u16;
    let mut segments = vec![1, 0];
    segments.extend(length.to_le_bytes());
    segments.extend([0, 0]);
    Block {
        id: BlockId::new(made.kind, made.number),
        head: Head { author: "ob1".into(), family: "example".into(), name: made.name.into(), version: 0x10 },
        declarations: Some(made.declarations.replace('\n', "\r\n")),
        interface: made.interface.to_vec(),
        code: made.code.to_vec(),
        segments: if made.kind == BlockKind::Db { Vec::new() } else { segments },
        comments: Comments { title: made.title.into(), ..Comments::default() },
        local_bytes: if made.kind == BlockKind::Ob { 24 } else { 0 },
        ..Block::default()
    }
}

/// `IN Start, Stop : BOOL; OUT Motor : BOOL`.
const LATCH: &[u8] = &[1, 1, 0, 6, 0, 0, 0, 0x01, 0x01, 0x01, 0x01, 0x01, 0x02, 0];
/// `U( U #Start O #Motor ) UN #Stop = #Motor BE`.
const LATCH_CODE: &[u8] = &[
    0xBA, 0x00, 0xFB, 0x80, 0x00, 0x02, 0xFB, 0x82, 0x00, 0x06, 0xBF, 0x00, 0xFB, 0x81, 0x00, 0x04, 0xFB, 0x92, 0x00,
    0x06, 0x65, 0x00,
];
/// `CALL FC 1 (Start := I 0.0, Stop := I 0.1, Motor := Q 4.0)` as the compiler expands it; then a counter of starts,
/// and a lamp that a timer switches on with a delay.
const MAIN_CODE: &[u8] = &[
    0x10, 0x01, 0x41, 0x60, 0x00, 0x16, 0x3D, 0x01, 0x70, 0x0B, 0x00, 0x08, 0x81, 0x00, 0x00, 0x00, 0x81, 0x00, 0x00,
    0x01, 0x82, 0x00, 0x00, 0x20, 0x10, 0x02, // U Q 4.0; FP M 10.0; JCN M001
    0xC0, 0x84, 0x49, 0x30, 0x00, 0x0A, 0xFF, 0xB8, 0x00, 0x09, // L DB1.DBW 0; + 1; T DB1.DBW 0
    0x20, 0x01, 0x7E, 0x42, 0x00, 0x00, 0x58, 0x00, 0x00, 0x01, 0x7E, 0x46, 0x00,
    0x00, // M001: U Q 4.0; L S5T#2S; SD T 1
    0xC0, 0x84, 0x30, 0x0C, 0x02, 0x00, 0x24, 0x01, // U T 1; = Q 4.1
    0xF8, 0x01, 0xD9, 0x84, 0x65, 0x00,
];
const OB_DECLARATIONS: &str =
    "\nVAR_TEMP\n  Start_information : ARRAY  [0 .. 19 ] OF BYTE ;\t//of the system\n  Spare : WORD ;\t\nEND_VAR\n";
const OB_INTERFACE: &[u8] = &[1, 1, 0, 11, 0, 0, 0, 0x10, 0x05, 1, 0, 0, 19, 0, 0x02, 0x05, 0x04, 0x05, 0];
const DB_DECLARATIONS: &str = "\nSTRUCT\n  Starts : INT ;\t//how often it started\n  Limit : REAL  := 1.000000e+001;\t\n  Place : UDT 1;\t\n END_STRUCT ;\t\n";
const DB_INTERFACE: &[u8] =
    &[5, 1, 0, 11, 0, 4, 0, 0x05, 0x04, 0x08, 0x0C, 0x11, 0x04, 2, 0x03, 0x04, 0x04, 0x04, 0x00, 0x00, 0x20, 0x41, 0];

/// The example: a motor with a latch, a counter of its starts, a lamp; LAD for the latch, one protected function.
#[must_use]
pub fn example() -> NewProject {
    let mut main = block(&Made {
        kind: BlockKind::Ob,
        number: 1,
        name: "main",
        declarations: OB_DECLARATIONS,
        interface: OB_INTERFACE,
        code: MAIN_CODE,
        title: "Conveyor",
    });
    // The jump of network 1 with its word, and the name of its label.
    main.segments = vec![1, 0, (MAIN_CODE.len() - 2) as u8, 0, 1, 0, 16, 0];
    main.comments.networks = vec![Network {
        title: "Motor, starts, lamp".into(),
        comment: "The motor runs from start to stop.".into(),
        lines: vec![Line { statement: 3, behind: true, text: "it has started".into() }],
    }];
    main.comments.labels = vec!["run".into()];
    let mut latch = block(&Made {
        kind: BlockKind::Fc,
        number: 1,
        name: "LATCH",
        declarations: "\nVAR_INPUT\n  Start : BOOL ;\t\n  Stop : BOOL ;\t\nEND_VAR\nVAR_OUTPUT\n  Motor : BOOL ;\t\nEND_VAR\n",
        interface: LATCH,
        code: LATCH_CODE,
        title: "Start and stop",
    });
    latch.language = ob1_project::Language::Lad;
    let mut hidden = block(&Made {
        kind: BlockKind::Fc,
        number: 2,
        name: "HIDDEN",
        declarations: "\nVAR_INPUT\n  Value : INT ;\t\nEND_VAR\nVAR_OUTPUT\n  RET_VAL : INT ;\t\nEND_VAR\n",
        interface: &[1, 2, 0, 4, 0, 0, 0, 0x05, 0x01, 0x05, 0x06, 0],
        // L #Value; + 7; T #RET_VAL
        code: &[0xFB, 0xC2, 0x00, 0x02, 0x58, 0x00, 0x00, 0x07, 0xFB, 0xC6, 0x00, 0x04, 0x65, 0x00],
        title: "",
    });
    hidden.know_how = true;
    let data = Block {
        // 3 starts, limit 12.5, place "A", 7.
        code: vec![0, 3, 0x41, 0x48, 0, 0, b'A', 0, 0, 7],
        ..block(&Made {
            kind: BlockKind::Db,
            number: 1,
            name: "DATA",
            declarations: DB_DECLARATIONS,
            interface: DB_INTERFACE,
            code: &[],
            title: "",
        })
    };
    let place = Udt {
        declarations: "\r\nSTRUCT \r\n  Row : CHAR ;\t\r\n  Column : WORD ;\t\r\n END_STRUCT ;\t\r\n".into(),
        head: Head::default(),
    };
    let symbol = |name: &str, german: &str, international: &str, ty: &str| SymbolRow {
        name: name.into(),
        german: german.into(),
        international: international.into(),
        ty: ty.into(),
        comment: String::new(),
    };
    let module = |name: &str, order: &str, slot, inputs: &[Area], outputs: &[Area]| Module {
        name: name.into(),
        order: order.into(),
        station: "Conveyor".into(),
        place: (0, slot, 0),
        inputs: inputs.to_vec(),
        outputs: outputs.to_vec(),
    };
    NewProject {
        name: "conveyor".into(),
        page: CodePage::default(),
        program: "S7 Program(1)".into(),
        blocks: vec![main, latch, hidden, data],
        udts: vec![(1, place)],
        symbols: vec![
            symbol("Start button", "E     0.0", "I     0.0", "BOOL"),
            symbol("Stop button", "E     0.1", "I     0.1", "BOOL"),
            symbol("Motor", "A     4.0", "Q     4.0", "BOOL"),
            symbol("Lamp", "A     4.1", "Q     4.1", "BOOL"),
        ],
        sources: Vec::new(),
        cpu: Some(Cpu {
            name: "CPU 315-2 DP".into(),
            s7_400: false,
            station: "Conveyor".into(),
            program: Some(1),
            parameters: CpuParameters {
                monitoring_ms: Some(200),
                clock_memory: Some(100),
                cyclic: (30..39).map(|ob| Cyclic { ob, period_ms: 100, phase_ms: 0 }).collect(),
                other: Vec::new(),
            },
        }),
        dp: Vec::new(),
        modules: vec![
            module("DI16xDC24V", "6ES7 321-1BH02-0AA0", 4, &[Area { first: 0, bytes: 2 }], &[]),
            module("DO16xDC24V/0.5A", "6ES7 322-1BH01-0AA0", 5, &[], &[Area { first: 4, bytes: 2 }]),
            module("AI8x12Bit", "6ES7 331-7KF02-0AB0", 6, &[Area { first: 288, bytes: 16 }], &[]),
        ],
    }
}

/// A project of about this many blocks: functions that call each other, and a data block for each.
#[must_use]
pub fn large(blocks: u16) -> NewProject {
    let mut project = example();
    for number in 10..10 + blocks / 2 {
        let mut code = LATCH_CODE[..LATCH_CODE.len() - 2].to_vec();
        // U M 5.3; = M 100.1; L DBn.DBW 0; T MW 200, repeatedly.
        for _ in 0..20 {
            code.extend([0x83, 0x05, 0x99, 0x64, 0xFB, 0x78]);
            code.extend(number.to_be_bytes());
            code.extend([0x7E, 0x42, 0x00, 0x00, 0x13, 0xC8]);
        }
        code.extend([0x65, 0x00]);
        let declarations = project.blocks[1].declarations.clone().unwrap_or_default();
        project.blocks.push(block(&Made {
            kind: BlockKind::Fc,
            number,
            name: "",
            declarations: &declarations.replace("\r\n", "\n"),
            interface: LATCH,
            code: &code,
            title: "",
        }));
        let mut data = project.blocks[3].clone();
        data.id.number = number;
        data.interface[1..3].copy_from_slice(&number.to_le_bytes());
        project.blocks.push(data);
    }
    project
}
