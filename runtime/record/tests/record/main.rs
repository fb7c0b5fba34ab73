//! The file of a recording: what is written comes back, and what is cut off or changed hides nothing before it.

mod file;
