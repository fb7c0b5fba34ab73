//! A call that a program makes once, with data blocks and a module beside it.

use ob1_cpu::{Module, ModuleSlot};

use super::rack::TestModule;

pub const DATA: &str = "
    DATA_BLOCK DB 10
    STRUCT
      at : DATE_AND_TIME := DT#2001-2-3-4:5:0.0;
      none : DATE_AND_TIME;
      now : DATE_AND_TIME;
      four : ARRAY[1..4] OF BYTE := B#16#5, B#16#6, B#16#7, B#16#8;
      two : ARRAY[1..2] OF BYTE := B#16#5, B#16#6;
      gap : WORD;
      top : STRUCT EV_CLASS : BYTE; EV_NUM : BYTE; PRIORITY : BYTE; NUM : BYTE; TYP2_3 : BYTE; TYP1 : BYTE; ZI1 : WORD;
        ZI2_3 : DWORD; END_STRUCT;
      up : STRUCT EV_CLASS : BYTE; EV_NUM : BYTE; PRIORITY : BYTE; NUM : BYTE; TYP2_3 : BYTE; TYP1 : BYTE; ZI1 : WORD;
        ZI2_3 : DWORD; END_STRUCT;
      to : DWORD;
      head : STRUCT LENTHDR : WORD; N_DR : WORD; END_STRUCT;
    END_STRUCT
    BEGIN
    END_DATA_BLOCK
    DATA_BLOCK DB 11 READ_ONLY STRUCT a : WORD; END_STRUCT BEGIN END_DATA_BLOCK
    ORGANIZATION_BLOCK OB 10 BEGIN END_ORGANIZATION_BLOCK
    ORGANIZATION_BLOCK OB 20 BEGIN END_ORGANIZATION_BLOCK
    ORGANIZATION_BLOCK OB 35 BEGIN END_ORGANIZATION_BLOCK";

/// OB 1 makes the call once, in its second cycle.
pub fn on_demand(call: &str) -> String {
    format!(
        "{DATA} ORGANIZATION_BLOCK OB 1 BEGIN
         UN M 0.0; BEB; CLR; = M 0.0; SET; SAVE; {call}; U BIE; = M 0.1; L 7; T MB 1; END_ORGANIZATION_BLOCK"
    )
}

pub type Modules = Vec<(ModuleSlot, Box<dyn Module>)>;

pub fn module() -> (TestModule, Modules) {
    let module = TestModule::new(4);
    module.look(|seen| seen.inputs = vec![1, 2, 3, 4]);
    (module.clone(), vec![(ModuleSlot::new("io", 0x100), Box::new(module))])
}
