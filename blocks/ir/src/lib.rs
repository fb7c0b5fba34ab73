//! The typed instruction set the engines run
