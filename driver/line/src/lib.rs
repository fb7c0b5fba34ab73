//! Serial lines: device, pty, TCP, and the simulated line
