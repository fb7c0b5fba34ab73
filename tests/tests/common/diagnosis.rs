//! A program that reads the diagnosis of the module at address 256: OB 82 counts, OB 1 reads diagnostic data and
//! buffer.

/// Cells of DB 90, 91 and 92, with the layout of [`PROGRAM`].
pub(crate) mod cell {
    /// OB 82: number of incoming and outgoing interrupts; the four bytes of the last one; the module's address (high
    /// word).
    pub(crate) const COMES: (u16, usize) = (90, 0);
    pub(crate) const GOES: (u16, usize) = (90, 4);
    pub(crate) const BYTES: (u16, usize) = (90, 8);
    pub(crate) const ADDRESS: (u16, usize) = (90, 12);
    /// SFC 59: RET_VAL of record 0 (high word) and record 1; the records.
    pub(crate) const RETURNS: (u16, usize) = (91, 0);
    pub(crate) const RECORD_0: (u16, usize) = (91, 4);
    pub(crate) const RECORD_1: (u16, usize) = (91, 8);
    /// SFC 51, list C0A0h: RET_VAL, number of records; event and STATUS of the newest entry.
    pub(crate) const LIST: (u16, usize) = (92, 0);
    pub(crate) const NEWEST: (u16, usize) = (92, 8);
    pub(crate) const NEWEST_STATUS: (u16, usize) = (92, 12);
}

/// OB 1, without OB 82.
pub(crate) const OB_1: &str = r"
DATA_BLOCK DB 91
STRUCT
  RET : ARRAY [0..1] OF WORD;
  RECORD_0 : ARRAY [0..3] OF BYTE;
  RECORD_1 : ARRAY [0..15] OF BYTE;
END_STRUCT;
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 92
STRUCT
  RET : WORD;
  HEAD : STRUCT
    LENTHDR : WORD;
    N_DR : WORD;
  END_STRUCT;
  GAP : WORD;
  LIST : ARRAY [0..399] OF BYTE;
END_STRUCT;
BEGIN
END_DATA_BLOCK

ORGANIZATION_BLOCK OB 1
BEGIN
      CALL  SFC 59 (
        REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#0,
        RET_VAL := DB91.DBW 0, BUSY := M 0.0, RECORD := P#DB91.DBX 4.0 BYTE 4);
      CALL  SFC 59 (
        REQ := TRUE, IOID := B#16#54, LADDR := W#16#100, RECNUM := B#16#1,
        RET_VAL := DB91.DBW 2, BUSY := M 0.0, RECORD := P#DB91.DBX 8.0 BYTE 16);
      CALL  SFC 51 (
        REQ := TRUE, SZL_ID := W#16#C0A0, INDEX := W#16#100,
        RET_VAL := DB92.DBW 0, BUSY := M 0.0, SZL_HEADER := DB92.HEAD, DR := P#DB92.DBX 8.0 BYTE 400);
END_ORGANIZATION_BLOCK
";

pub(crate) const OB_82: &str = r"
DATA_BLOCK DB 90
STRUCT
  COMES : DINT;
  GOES : DINT;
  BYTES : DWORD;
  MDL_ADDR : WORD;
  GAP : WORD;
END_STRUCT;
BEGIN
END_DATA_BLOCK

ORGANIZATION_BLOCK OB 82
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      L     LW 6;
      T     DB90.DBW 12;
      L     LD 8;
      T     DB90.DBD 8;
      L     LB 0;
      L     B#16#39;
      ==I;
      SPBN  goes;
      L     DB90.DBD 0;
      +     L#1;
      T     DB90.DBD 0;
      BEA;
goes: L     DB90.DBD 4;
      +     L#1;
      T     DB90.DBD 4;
END_ORGANIZATION_BLOCK
";

/// A station with this module, in two or one source. The module's lines begin after `address`.
pub(crate) fn station(name: &str, sources: &str, module: &str) -> String {
    format!(
        "[station]\nname = \"{name}\"\n\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"500ms\"\n\n[program]\nsources = [{sources}]\nmnemonics = \"de\"\n\n\
         [[module]]\nname = \"cp\"\naddress = 256\n{module}\n"
    )
}
