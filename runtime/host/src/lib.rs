//! Loads plugins; starts and supervises driver processes
