//! Why a job fails.

/// The reason why a job failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// Host and CP are not synchronised: the CP was reset or restarted, or shows an invalid value (STATUS 0202h).
    NotSynchronised,
    /// The CP does not accept the length (`D`).
    Length,
    /// Error in the communication: the partner does not answer, or refuses (`E`).
    Communication,
}
