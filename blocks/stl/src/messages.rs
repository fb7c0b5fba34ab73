//! The table of diagnostics: every number with its text and remedy. `docs/stl-errors.md` is made from it.

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// Legal, but a known trap.
    Lint,
    /// Accepted, though STEP 7 would not, or likely not meant.
    Warning,
    /// The program cannot be used.
    Error,
}

impl Severity {
    /// The word printed before the number.
    pub const fn name(self) -> &'static str {
        match self {
            Severity::Lint => "lint",
            Severity::Warning => "warning",
            Severity::Error => "error",
        }
    }
}

/// A row of the table.
#[derive(Debug)]
pub struct Code {
    /// The number, `S0123`; it never gets another meaning.
    pub number: &'static str,
    /// Error, warning or lint.
    pub severity: Severity,
    /// What is wrong, in general.
    pub title: &'static str,
    /// What to do, in general.
    pub remedy: &'static str,
}

macro_rules! codes {
    ($($(#[$group:meta])* $name:ident = $number:literal, $severity:ident, $title:literal, $remedy:literal;)*) => {
        $(pub(crate) static $name: Code =
            Code { number: $number, severity: Severity::$severity, title: $title, remedy: $remedy };)*
        /// Every row, by number.
        pub static ALL: &[&Code] = &[$(&$name),*];
    };
}

codes! {
    // Text
    NOT_CLOSED = "S0001", Error, "A text, symbol, attribute list or parameter list is not closed.",
        "Close it with the sign that belongs to the opening one.";
    STRAY_CHARACTER = "S0002", Error, "A character that means nothing in STL.",
        "Remove it. Comments begin with //, local names with #.";
    SOURCE_TOO_LONG = "S0003", Error, "The source is longer than the compiler reads (64 MiB).",
        "Split the source into several files.";
    // Frames
    OUTSIDE_BLOCK = "S0101", Error, "There is text outside any block.",
        "Begin a block first: ORGANIZATION_BLOCK OB 1, FUNCTION FC 1 : VOID, FUNCTION_BLOCK FB 1, DATA_BLOCK DB 1, TYPE UDT 1.";
    BLOCK_NAME = "S0102", Error, "The name of a block is missing or does not fit its kind.",
        "Write kind and number, as in FUNCTION FC 9 : VOID, or a symbol of the symbol table. Data blocks count from 1.";
    DUPLICATE_BLOCK = "S0103", Error, "Two blocks have the same kind and number.",
        "Give one of them another number, or remove it.";
    ALSO_IN_LIBRARY = "S0104", Error, "A block of the program has the number of a library block.",
        "Give one of them another number: the station file numbers library and plugin blocks.";
    MISSING_END = "S0105", Error, "The end of a block, structure or section is missing.",
        "Write the END_ word that belongs to it.";
    WRONG_END = "S0106", Error, "A block is closed with the word of another kind.",
        "Close each block with its own END_ word.";
    RETURN_TYPE = "S0107", Error, "A function has no return type.",
        "Write the type of the function value after the name, VOID when there is none.";
    SECTION = "S0108", Error, "This kind of block does not have such a declaration section.",
        "Organization blocks have VAR_TEMP only, functions no VAR, data blocks a STRUCT.";
    MISPLACED = "S0109", Error, "A word or statement is in the wrong place.",
        "Remove it or move it.";
    HEAD = "S0110", Error, "A word or line that does not belong in a block header.",
        "Between the block's name and its declarations there may only be TITLE, VERSION, AUTHOR, FAMILY, NAME, KNOW_HOW_PROTECT and similar words.";
    OTHER_LANGUAGE = "S0111", Error, "A file that is not STL.",
        "Translate the file into STL, or export it as such.";
    OB_NAME = "S0112", Error, "No number is known for the name of an organization block.",
        "Write [program] numbers = { \"name\" = \"OB 35\" } in the station file.";
    // Declarations
    DECLARATION = "S0201", Error, "A declaration is not well formed.",
        "Write name : TYPE; or name : TYPE := start value;";
    MISSING_SEMICOLON = "S0202", Error, "A semicolon is missing after a declaration.",
        "End each declaration with a semicolon.";
    UNKNOWN_TYPE = "S0203", Error, "A word that is not a data type.",
        "Use an elementary type, STRING[n], ARRAY [..] OF, STRUCT, UDT n, FB n, or a parameter type.";
    TYPE_DEPTH = "S0204", Error, "Types are nested too deep.",
        "Flatten the structure.";
    STRING_LENGTH = "S0205", Error, "The length of a STRING is not from 1 to 254.",
        "Write STRING[n] with n from 1 to 254, or STRING alone for 254.";
    ARRAY_BOUNDS = "S0206", Error, "The bounds of an ARRAY are not well formed.",
        "Write ARRAY [low .. high] OF TYPE, at most six dimensions.";
    TOO_LONG = "S0207", Error, "A type, data block, instance or the local data is longer than 65534 bytes.",
        "Divide it among several data blocks.";
    EMPTY_STRUCT = "S0208", Error, "A structure has no components.",
        "Declare at least one component.";
    TYPE_NOT_HERE = "S0209", Error, "A type cannot be declared here.",
        "Parameter types (TIMER, BLOCK_DB, ...) are for inputs, POINTER for parameters, ANY also for temps, function blocks for VAR.";
    DECLARED_TWICE = "S0210", Error, "A name is declared twice.",
        "Rename one of them. Upper and lower case are the same.";
    UNUSABLE_TYPE = "S0211", Error, "A UDT or FB used as a type is missing, wrong, or contains itself.",
        "Correct the type named first.";
    NO_STRUCTURE = "S0212", Error, "A data block or TYPE has no structure.",
        "Write STRUCT .. END_STRUCT;, or for a data block UDT n or FB n.";
    TOO_MUCH_DATA = "S0213", Error, "All declarations together take more memory than any CPU has.",
        "Make arrays smaller.";
    TOO_MANY_PARAMETERS = "S0214", Error, "A block has too many parameters.",
        "Pass a structure or a data block instead.";
    INITIAL_VALUE = "S0215", Error, "A start value is not well formed or not allowed here.",
        "Write a constant, for arrays a list: 1, 2, 3(0). Outputs and in/outs of functions, in/out parameters of complex types and temps have no start value.";
    ASSIGNMENT = "S0216", Error, "An assignment in a data block is not well formed.",
        "Write name := constant;";
    TYPE_WITHOUT_STL = "S0217", Error, "A data type of TIA Portal for which STL has no statements.",
        "STL has no statement for types of 64 bits, WSTRING, VARIANT, and counters other than those of INT.";
    // Statements and operands
    UNKNOWN_MNEMONIC = "S0301", Error, "A word that is not a mnemonic.",
        "See the list of mnemonics; a call's parameters follow CALL directly.";
    UNKNOWN_OPERAND = "S0302", Error, "A word that is not an operand.",
        "Write an address (M 1.0, DB10.DBW 20), #name for a declared name, \"name\" for a symbol.";
    FOREIGN_MNEMONIC = "S0303", Error, "A word of the other set of mnemonics.",
        "Write each source in one set of mnemonics. --mnemonics de, en or auto names the set (in the station file: mnemonics = ...).";
    OPERAND_MISSING = "S0304", Error, "An operand is missing.",
        "Write the operand of the statement.";
    WRONG_OPERAND = "S0305", Error, "An operand does not fit its mnemonic.",
        "Bits: M 1.0; bytes, words, double words: MB 1, MW 2, MD 4.";
    TOO_MUCH = "S0306", Error, "Text is left over after a complete statement.",
        "End the statement with ; or the end of the line; comments begin with //.";
    ADDRESS = "S0307", Error, "An address is not well formed.",
        "Bits are written byte.bit (M 3.0), everything else by its first byte (MW 10).";
    NUMBER = "S0308", Error, "The number of a timer, counter or block is missing or too large.",
        "Write it after the identifier: T 2, Z 5, DB 10.";
    INDIRECT = "S0309", Error, "An indirect address is not well formed.",
        "Write DBW [MD 184], AUF DB [MW 50], W [AR1,P#2.0].";
    POINTER = "S0310", Error, "A pointer constant is not well formed.",
        "Write P#12.0, P#M 3.0, P#DB10.DBX0.0 BYTE 12.";
    UNKNOWN_LOCAL = "S0311", Error, "A name is not declared in the block.",
        "Declare it in a VAR section of the block.";
    UNKNOWN_SYMBOL = "S0312", Error, "A symbol is in no symbol table, or names something else.",
        "Add the symbol table that has it, or write the address.";
    COMPONENT = "S0313", Error, "A component does not exist.",
        "Use the names of the structure's declaration.";
    ARRAY_INDEX = "S0314", Error, "The index of an array is not well formed or outside its bounds.",
        "Write one number for each dimension: a[1,2].";
    NO_DATA_BLOCK = "S0315", Error, "A data block whose components are named is not in the program.",
        "Add the data block's source, or write DB10.DBW 20.";
    NOT_SUPPORTED = "S0316", Error, "Legal STL that this compiler does not know yet.",
        "Copy the value into a temp or the instance and use that.";
    AMBIGUOUS_SET = "S0317", Error, "A word means different things in the two sets of mnemonics, and no other word tells which set is meant.",
        "Name the set: --mnemonics de or --mnemonics en (in the station file: mnemonics = ...). SE is on-delay in German, extended pulse in international mnemonics.";
    OPTIMIZED = "S0318", Error, "An address into an optimised block.",
        "Use the names of its components, or clear the block's attribute S7_Optimized_Access.";
    NO_NUMBER = "S0319", Error, "More blocks of a kind have a name and no number than there are numbers.",
        "A program has at most 65,535 blocks of a kind: divide it, or leave out what nothing calls.";
    // Constants
    CONSTANT = "S0401", Error, "A constant is not well formed or out of range.",
        "Constants: 5, L#5, W#16#FF, 2#0101, 1.5, S5T#2S, T#2S, C#7, 'A', D#1994-3-15, TOD#12:30:0, P#M 3.0.";
    CONSTANT_TYPE = "S0402", Error, "A constant does not fit the type it is for.",
        "Write a constant of that type, within its range.";
    // Jumps and brackets
    UNKNOWN_LABEL = "S0501", Error, "A label is not in the block.",
        "Write the label, followed by a colon, before the statement to jump to. Upper and lower case differ.";
    LABEL_ELSEWHERE = "S0502", Error, "A jump leaves its block.",
        "Jumps stay within a block: call the other block, or put the label into this one.";
    DUPLICATE_LABEL = "S0503", Error, "A label occurs twice in a block.",
        "Rename one of them.";
    JUMP_LIST = "S0504", Error, "The list after SPL is empty or too long.",
        "Write 1 to 255 SPA statements directly after SPL.";
    BRACKETS = "S0505", Error, "Brackets do not match or are nested too deep.",
        "Close each bracket in its block; at most 7 may be open, and 8 MCR(.";
    // Calls
    CALL_TARGET = "S0601", Error, "CALL names something that is not a block.",
        "Call FC, FB, SFC, SFB by number or symbol, or a multi-instance by #name.";
    NO_BLOCK = "S0602", Error, "A block that is used is neither in the program nor in the library.",
        "Load its source, or import the project.";
    INSTANCE = "S0603", Error, "The instance data block of a call is missing or wrong.",
        "Write CALL FB 8, DB 50, where DB 50 is an instance of FB 8.";
    ACTUAL_SYNTAX = "S0604", Error, "An actual parameter is not well formed or not allowed here.",
        "Write NAME := operand.";
    STRAY_ACTUAL = "S0605", Error, "An actual parameter does not follow a CALL.",
        "Parameters follow the line of the CALL directly, or are in its brackets.";
    UNKNOWN_PARAMETER = "S0606", Error, "The called block has no such parameter.",
        "Use the names of its declaration.";
    SUPPLIED_TWICE = "S0607", Error, "A parameter is supplied twice.",
        "Remove one of them.";
    MISSING_PARAMETER = "S0608", Error, "A function is called without one of its parameters.",
        "Supply every parameter of a function, RET_VAL too; only those of function blocks may be left out.";
    PARAMETER_TYPE = "S0609", Error, "An actual parameter does not fit its formal.",
        "Supply an operand of the same width: a bit for BOOL, a word for INT and WORD.";
    // Symbol tables
    TABLE_FORM = "S0701", Error, "A file is not a symbol table, or has another form than its name says.",
        "Export it from the symbol editor as .SDF, .ASC, .SEQ or .DIF, and keep the extension.";
    TABLE_ROW = "S0702", Warning, "A row of a symbol table is not well formed.",
        "Correct the row, or export the table once more; the others are read.";
    TABLE_ADDRESS = "S0703", Warning, "A symbol table gives something that is not an address.",
        "Write an address of either set of mnemonics: M 1.0, E 0.0 or I 0.0, Z 5 or C 5, DB 10, FC 9.";
    SYMBOL_TWICE = "S0704", Warning, "The symbol tables have a name twice.",
        "Rename one of them. Upper and lower case are the same.";
    TABLE_TYPE = "S0705", Warning, "The type of a symbol does not fit its address.",
        "Correct the type: BOOL for bits, WORD or INT for words; the address counts.";
    // Warnings
    LONG_LABEL = "S0801", Warning, "A label is longer than the four characters STEP 7 allows.",
        "Shorten it if STEP 7 must compile the source again.";
    BEYOND_DATA_BLOCK = "S0802", Warning, "An address lies beyond the end of its data block.",
        "Correct the address or lengthen the data block; as it is, the access ends in OB 121 or STOP.";
    MISREAD = "S0803", Warning, "A variable of another type is supplied, whose bits mean another number.",
        "Convert it into a variable of the parameter's type (DTR, RND, FC 33, FC 40) and supply that; STEP 7 refuses the call.";
    OB_INPUT = "S0804", Warning, "An input of an organization block that is not supplied.",
        "It is 0. What the CPU says of the call is in #OB_START_INFO, the first 20 bytes of the local data.";
    NEVER_SUPPLIED = "S0805", Warning, "No call supplies a parameter of a function block that needs an actual.",
        "Supply it: without an actual a complex in/out leads to no area (OB 121 or STOP), TIMER, COUNTER and BLOCK are number 0.";
    NEVER_CALLED = "S0806", Warning, "An organization block has a number that the CPU never calls.",
        "Give it the number of its event (docs/cpu.md), or make it a function that OB 1 calls; do the same with OB 123 and above of TIA Portal.";
    START_OF_INPUT = "S0807", Warning, "An input of a function has a start value.",
        "It has no effect, since each call supplies the input; SCL keeps such values in the declarations.";
    // Lints
    CONSTANT_FOR_OUTPUT = "S0901", Lint, "A constant is supplied to a parameter that the block writes.",
        "The value that the block writes is lost; supply an operand.";
    INSTANCE_MADE = "S0902", Lint, "An instance data block is in no source and is created with start values.",
        "Nothing has to be done; or declare it: DATA_BLOCK DB 50 FB 8 BEGIN END_DATA_BLOCK.";
    OUTPUT_UNASSIGNED = "S0903", Lint, "An output of a function is not assigned on every path.",
        "Assign it at the beginning of the function: outputs of an FC have no memory; a path without an assignment leaves the old value.";
    MEMORY_OVERLAP = "S0904", Lint, "Bit memory is used under widths that overlap.",
        "If this is not intended, move one of them: MW 10 is MB 10 and MB 11, MD 10 reaches to MB 13.";
    ACCU_LOST = "S0905", Lint, "An accumulator is used after a call that has changed it.",
        "Save the value in a temp before the call, or pass the result as a parameter.";
    BR_MISUSED = "S0906", Lint, "BR (BIE) is overwritten before it is read, or read although nothing has set it.",
        "Write SAVE directly before the end of the block. A block whose ENO is read must set BR on every path: SET, SAVE.";
    INPUT_WRITTEN = "S0907", Lint, "An input parameter is written to.",
        "Copy the input into a temp and change that, or declare an in/out.";
    UNUSED_LABEL = "S0908", Lint, "Nothing jumps to a label.",
        "Remove the label, or look for the jump that is missing.";
    LOCAL_IS_SHARED = "S0909", Lint, "A name with # is not declared in the block and is taken as the shared symbol.",
        "Write the symbol in quotes, or declare the name.";
    DB_NOT_THERE = "S0910", Lint, "A data block that is in no source is opened.",
        "Load its source, unless the program creates the data block itself (SFC 22).";
    TIME_FOR_TIMER = "S0911", Lint, "A timer is started with a TIME, where it takes an S5TIME.",
        "Write S5T# in place of T#: at run time the bits of a TIME are a BCD error (2521h) or another time.";
    LONG_CONSTANT = "S0912", Lint, "A number of 32 bits is loaded without L#.",
        "Write L# in front of it, as STEP 7 wants it; an INT ends at 32767.";
}

/// The text of the page `docs/stl-errors.md`.
pub fn page() -> String {
    let mut out = String::from(
        "# Diagnostics of the STL compiler\n\n\
         Made from the table in `blocks/stl/src/messages.rs`; a test holds the two together (`UPDATE=1 cargo test -p ob1-stl`\n\
         writes this page anew).\n\n\
         S0001 to S0609: sources. S0701 to S0705: symbol tables. S0801 up: warnings. S0901 up: lints, legal but known traps;\n\
         those from S0903 on are looked for on request.\n\n\
         | Number | Kind | What | Remedy |\n|---|---|---|---|\n",
    );
    for code in ALL {
        out.push_str(&format!("| {} | {} | {} | {} |\n", code.number, code.severity.name(), code.title, code.remedy));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_rise_and_say_something() {
        assert!(ALL.windows(2).all(|w| w[0].number < w[1].number));
        assert!(ALL.iter().all(|c| c.title.ends_with('.') && !c.remedy.is_empty() && !c.title.contains('|')));
    }
}
