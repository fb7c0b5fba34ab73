//! The table of diagnostics of SCL statements; `docs/scl-errors.md` is made from it. What concerns declarations,
//! constants and names has the numbers of STL.

use ob1_stl::Severity;
use ob1_stl::front::Code;

macro_rules! codes {
    ($($name:ident = $number:literal, $severity:ident, $title:literal, $remedy:literal;)*) => {
        $(pub(crate) static $name: Code =
            Code { number: $number, severity: Severity::$severity, title: $title, remedy: $remedy };)*
        /// Every row, by number.
        pub static ALL: &[&Code] = &[$(&$name),*];
    };
}

codes! {
    // Syntax
    EXPECTED = "S2001", Error, "A word or sign is missing.", "Write what the message names.";
    STATEMENT = "S2002", Error, "A statement cannot begin like this.",
        "Write an assignment x := y; a call f(a := 1); or IF, CASE, FOR, WHILE, REPEAT, EXIT, CONTINUE, RETURN, GOTO.";
    EXPRESSION = "S2003", Error, "A value is missing or not well formed.",
        "Write a constant, a variable, a call, or an expression of them.";
    DEPTH = "S2004", Error, "Statements or brackets are nested too deep.", "Divide the expression or the block.";
    MISSING_SEMICOLON = "S2005", Error, "A semicolon is missing after a statement.", "End each statement with a semicolon.";
    // Names
    UNKNOWN_NAME = "S2101", Error, "A name is neither declared nor in a symbol table, and no function is called so.",
        "Declare it in a VAR section, add the symbol table that has it, or load the block.";
    NOT_A_VALUE = "S2102", Error, "A name has no value here.",
        "Blocks and instances are called; their parameters follow a point: inst.Q.";
    NOT_WRITABLE = "S2103", Error, "What stands before := cannot be written.",
        "Assign to a variable, an output, or the function's own name.";
    COMPONENT = "S2104", Error, "A component does not exist.", "Use the names of the declaration.";
    INDEX = "S2105", Error, "An index does not fit the array.", "Write one index for each dimension, within its bounds.";
    ADDRESS = "S2106", Error, "An absolute address is not well formed.",
        "Write I0.0, QB4, MW20, DB11.DW4, MW[i], DB11.DX[i, b].";
    LOOKS_LIKE_ADDRESS = "S2107", Warning, "A name declared with # is read without it, and is an absolute address.",
        "Write #name for the variable: without the sign it is the timer, counter or address.";
    // Types
    TYPES = "S2201", Error, "A value has the wrong type.", "Convert it with the function that the message names.";
    OPERANDS = "S2202", Error, "An operator does not take these types.", "Convert an operand.";
    CONSTANT_RANGE = "S2203", Error, "A constant does not fit its type.", "Write a constant within the range of the type.";
    DIVISION_BY_ZERO = "S2204", Error, "A division by the constant 0.", "Divide by something else.";
    REAL_EQUAL = "S2205", Lint, "Real numbers are compared for equality.",
        "Compare the distance: ABS(a - b) < limit.";
    LONG_TEXT = "S2206", Warning, "A text is longer than the STRING that takes it.", "It is cut off: make the STRING longer.";
    // Statements
    LABEL_TWICE = "S2301", Error, "A value of a CASE occurs twice.", "The first one counts: remove or correct the other.";
    LABEL_COVERED = "S2302", Warning, "A value of a CASE lies in a range before it.", "It is never reached.";
    LOOP_VARIABLE = "S2303", Error, "The variable of a FOR is not an INT or DINT.", "Declare an INT or DINT for it.";
    ENDLESS_LOOP = "S2304", Warning, "A FOR loop ends at the largest value of its variable's type.",
        "It never ends, since the variable wraps: take a DINT, or end one earlier.";
    NO_LOOP = "S2305", Error, "EXIT or CONTINUE stands outside any loop.", "Leave the block with RETURN.";
    GOTO_TARGET = "S2306", Error, "GOTO leads to no label of this block, or into a loop or branch.",
        "Put the label on the way out of the statement, not into another one.";
    STEP_ZERO = "S2307", Error, "The step of a FOR is 0.", "Write BY 1 or BY -1.";
    // Calls
    NOT_CALLABLE = "S2401", Error, "Something is called that is no function, function block or instance.",
        "Call a function by its name, a function block by its instance.";
    UNKNOWN_PARAMETER = "S2402", Error, "The called block has no such parameter.", "Use the names of its declaration.";
    MISSING_PARAMETER = "S2403", Error, "A function is called without one of its parameters.",
        "Supply every input and in/out of a function.";
    PARAMETER_SIDE = "S2404", Error, "An input is supplied with => or an output with an expression.",
        "Inputs take :=, outputs => or := and a variable.";
    ACTUAL = "S2405", Error, "An actual parameter does not fit its formal.", "Supply a variable of the parameter's type.";
    NO_RESULT = "S2406", Error, "A block without function value stands in an expression.", "Call it as a statement.";
    NO_INSTANCE = "S2407", Error, "A function block is called without an instance.",
        "Declare an instance in VAR and call that, or write FB.DB(...).";
    FUNCTION_ARGUMENTS = "S2408", Error, "A standard function has other parameters.", "Write the parameters that the message names.";
    // Checks
    RESULT_UNASSIGNED = "S2501", Warning, "The result of a function is never assigned.",
        "Assign to the function's name: as it is, the caller gets what lay there before.";
    TEMP_UNASSIGNED = "S2502", Warning, "A temporary is read, and nothing assigns it.",
        "Temporaries and VAR of a function have no start value: assign it first.";
    // Limits
    NOT_SUPPORTED = "S2901", Error, "SCL that this compiler does not know yet.", "Write it in another way.";
    LOST = "S2902", Error, "A statement is left out, and no message says why: a fault of this compiler.",
        "Write it in another way, and report the statement.";
}
