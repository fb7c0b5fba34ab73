//! The commands of `ob1` that need no running station, and the documents.

mod as_they_come;
mod book;
mod difference;
mod documents;
mod exec_command;
mod first_day;
mod inspection;
mod manual_examples;
mod test_command;
mod trace_files;
