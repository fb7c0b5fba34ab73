//! Files as TIA Portal exports them: `.scl`, `.db` and `.udt` beside each other, UTF-8 with a byte order mark.

use ob1_cpu::{Command, Cpu, CpuConfig, OperatingState, engine, system_blocks};
use ob1_stl::{Options, Source};

use crate::common::{Still, library, result};

const TYPE: &str = "\u{feff}TYPE \"Motor\"\r\nVERSION : 0.1\r\n   STRUCT\r\n      drehzahl_in_1_min : Int := 7;\r\n      läuft : Bool;\r\n   \
                    END_STRUCT;\r\nEND_TYPE\r\n";
const DATA: &str = "\u{feff}DATA_BLOCK \"Anlage\"\r\n{ S7_Optimized_Access := 'TRUE' }\r\nVERSION : 0.1\r\nNON_RETAIN\r\n   STRUCT\r\n      \
                    \"Motor 1\" : \"Motor\";\r\n      alle : Array[0..3] of \"Motor\";\r\n   END_STRUCT;\r\n\r\nBEGIN\r\n   \
                    \"Motor 1\".drehzahl_in_1_min := 40;\r\n   alle[2].drehzahl_in_1_min := 2;\r\nEND_DATA_BLOCK\r\n";
const INSTANCE: &str = "\u{feff}DATA_BLOCK \"Regler_DB\"\r\n{ S7_Optimized_Access := 'TRUE' }\r\nVERSION : 0.1\r\nNON_RETAIN\r\n\"Regler\"\r\n\r\n\
                        BEGIN\r\n   Faktor := 5;\r\nEND_DATA_BLOCK\r\n";
const CODE: &str = "\u{feff}FUNCTION_BLOCK \"Regler\"\r\nTITLE = Regler\r\n{ S7_Optimized_Access := 'TRUE' }\r\nVERSION : 0.1\r\n   VAR_INPUT\r\n      \
                    Soll { ExternalWritable := 'False'} : Int;   // Sollwert\r\n   END_VAR\r\n   VAR_OUTPUT\r\n      Ist : Int;\r\n   END_VAR\r\n   \
                    VAR\r\n      Faktor { S7_SetPoint := 'True'} : Int := 1;\r\n   END_VAR\r\n   VAR CONSTANT\r\n      GRÖßE : Int := 100;\r\n   \
                    END_VAR\r\nBEGIN\r\n\tREGION Rechnen\r\n\t    #Ist := #Soll * #Faktor + #GRÖßE;\r\n\tEND_REGION\r\nEND_FUNCTION_BLOCK\r\n\r\n\
                    ORGANIZATION_BLOCK \"Main\"\r\n{ S7_Optimized_Access := 'TRUE' }\r\nVERSION : 0.1\r\n   VAR_TEMP\r\n      m : \"Motor\";\r\n   END_VAR\r\n\
                    BEGIN\r\n\t#m := \"Anlage\".alle[2];\r\n\t\"Regler_DB\"(Soll := \"Anlage\".\"Motor 1\".drehzahl_in_1_min + #m.drehzahl_in_1_min,\r\n\t            \
                    Ist => \"Anlage\".\"Motor 1\".drehzahl_in_1_min);\r\n\t\"Anlage\".\"Motor 1\".läuft := TRUE;\r\n\t\
                    MD100 := INT_TO_DINT(\"Anlage\".\"Motor 1\".drehzahl_in_1_min + \"Anlage\".alle[0].drehzahl_in_1_min);\r\nEND_ORGANIZATION_BLOCK\r\n";

#[test]
fn sources_data_and_types_are_files_of_their_own() {
    let files = [("Main.scl", CODE), ("Anlage.db", DATA), ("Regler_DB.db", INSTANCE), ("Motor.udt", TYPE)];
    let sources = files.map(|(name, text)| Source::new(name, text.as_bytes()));
    let fixed =
        vec![ob1_stl::Numbered { name: "Main".into(), id: ob1_model::BlockId::new(ob1_model::BlockKind::Ob, 1) }];
    let options = Options { fixed, ..Options::default() };
    let output = ob1_scl::compile(&sources, &library(), &options);
    assert!(output.is_good(), "{}", ob1_stl::render_all(&output.diagnostics, &sources));
    let cpu = Cpu::new(CpuConfig::default(), &output.program, system_blocks(), Vec::new(), engine::REFERENCE);
    let mut cpu = cpu.expect("it loads");
    cpu.request(Command::Run);
    assert_eq!(cpu.cycle(&mut Still).state, OperatingState::Run);
    assert_eq!(result(&mut cpu), (40 + 2) * 5 + 100 + 7);
}
