//! Answers that must be there: without them the CPU goes to STOP.

use crate::cx::Cx;
use crate::reply::{Abort, Refused};

/// For requests that are only refused when the program and the CPU do not fit together.
pub trait OrStop<T> {
    /// Returns the value, or asks for STOP; the diagnostic buffer then says `what` was asked for and why it was
    /// refused.
    ///
    /// ```
    /// # use ob1_sdk::{Abort, Area, Cx, OrStop};
    /// fn start_button(cx: &mut Cx<'_>) -> Result<bool, Abort> {
    ///     cx.bit(Area::Input, 0, 0)?.or_stop(cx, "E 0.0")
    /// }
    /// ```
    ///
    /// # Errors
    /// [`Abort`] after a refusal.
    fn or_stop<M>(self, cx: &mut Cx<'_, M>, what: &str) -> Result<T, Abort>;
}

impl<T> OrStop<T> for Result<T, Refused> {
    #[inline]
    fn or_stop<M>(self, cx: &mut Cx<'_, M>, what: &str) -> Result<T, Abort> {
        self.map_err(|refused| cx.stop(format_args!("{what}: {refused}")))
    }
}
