//! A whole CP as one sans-IO machine
