//! The control law, as a pure function.

/// A two-point controller with hysteresis.
pub(crate) struct Controller {
    pub(crate) set_point: f32,
    pub(crate) hysteresis: f32,
}

impl Controller {
    /// The new output. `rested` tells whether it may switch on. A process value that is no number switches off.
    pub(crate) fn output(&self, was_on: bool, process_value: f32, rested: bool) -> bool {
        let half = self.hysteresis.max(0.0) / 2.0;
        if process_value < self.set_point - half {
            was_on || rested
        } else {
            was_on && process_value <= self.set_point + half
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_switches_at_the_edges_of_the_band() {
        let controller = Controller { set_point: 20.0, hysteresis: 2.0 };
        let mut on = false;
        let course =
            [(20.0, false), (19.0, false), (18.9, true), (20.5, true), (21.0, true), (21.1, false), (19.5, false)];
        for (process_value, expected) in course {
            on = controller.output(on, process_value, true);
            assert_eq!(on, expected, "at {process_value}");
        }
    }

    #[test]
    fn it_waits_for_its_rest_and_switches_off_without_a_value() {
        let controller = Controller { set_point: 20.0, hysteresis: -3.0 };
        assert!(!controller.output(false, 5.0, false));
        assert!(controller.output(false, 5.0, true));
        assert!(controller.output(true, 5.0, false), "the pause keeps nothing on");
        assert!(!controller.output(true, f32::NAN, true));
        assert!(!controller.output(false, f32::NAN, true));
    }
}
