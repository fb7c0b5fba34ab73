//! Fenced operating-system calls: scheduling, locking memory, sleeping to a deadline
