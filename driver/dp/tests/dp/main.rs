//! A PROFIBUS DP master and its slaves on a simulated line, in virtual time.

mod faults_dp;
mod line;
mod wires;
