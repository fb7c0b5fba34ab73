//! The three-step element of CONT_S and TCONT_S: pulses that move an actuator which integrates.
//!
//! One integrator holds how far the actuator still has to go, in percent of its travel: the integral of the error
//! signal, less what the pulses have moved it. A pulse begins when that and the proportional part make up the travel of
//! a shortest pulse, and ends when less than the travel of half a cycle is left; this choice of thresholds is ours.

/// A remark for the documentation.
pub(super) const THRESHOLDS: &str =
    "thresholds of the three-step element are ours: the travel of a shortest pulse, and of half a cycle";

/// The times of an actuator and of its controller, in milliseconds.
pub(super) struct Travel {
    /// Between two calls, at least 1.
    pub(super) cycle: i32,
    /// MTR_TM: from one end to the other.
    pub(super) motor: i32,
    /// TI; 0 switches the integral action off.
    pub(super) integration: i32,
    /// PULSE_TM: the shortest pulse.
    pub(super) pulse: i32,
    /// BREAK_TM: the shortest break.
    pub(super) pause: i32,
}

impl Travel {
    /// Percent of the way in one cycle.
    fn of_cycle(&self) -> f32 {
        100.0 * self.cycle as f32 / self.motor.max(self.cycle) as f32
    }
}

/// The actuator as the controller sees it; its state between two calls.
pub(super) struct Actuator {
    /// What the last call gave: 1 up, -1 down, 0 nothing.
    pub(super) direction: i8,
    /// LMNR_HS, LMNR_LS: at its upper, at its lower end.
    pub(super) at_stop: [bool; 2],
    /// By hand: the direction wanted, and what is left for the controller to do afterwards.
    pub(super) by_hand: Option<(i8, f32)>,
    /// How far it still has to go, in percent, without the proportional part.
    pub(super) rest: f32,
    /// The error signal of the last call.
    pub(super) last: f32,
    /// Milliseconds the pulse under way lasts at least.
    pub(super) pulse_left: i32,
    /// Milliseconds the break under way lasts at least.
    pub(super) break_left: i32,
}

impl Actuator {
    /// One call with the error signal; `direction` is what the outputs give.
    pub(super) fn step(&mut self, signal: f32, travel: &Travel) {
        let wanted = if let Some((direction, rest)) = self.by_hand {
            self.rest = rest;
            (self.pulse_left, self.break_left) = (0, 0);
            direction
        } else {
            let (cycle, time) = (travel.cycle, travel.integration);
            let part = if time <= 0 { 0.0 } else { cycle as f32 / time.max(cycle / 2) as f32 };
            let integral = part * (signal + self.last) / 2.0;
            // The last output has moved the actuator for a cycle, unless it is at its end.
            let moved = f32::from(self.stopped(self.direction)) * travel.of_cycle();
            self.rest += integral - moved;
            self.automatic(self.rest + signal, travel)
        };
        self.direction = self.stopped(wanted);
    }

    /// No pulse against the limit stop that is reported.
    fn stopped(&self, direction: i8) -> i8 {
        let [high, low] = self.at_stop;
        if direction > 0 && high || direction < 0 && low { 0 } else { direction }
    }

    /// The pulse: at least `pulse` long, at least `pause` after the last.
    fn automatic(&mut self, open: f32, travel: &Travel) -> i8 {
        let cycle = travel.cycle;
        let pulse = travel.pulse.max(cycle);
        let wanted = if open > 0.0 { 1 } else { -1 };
        if self.direction != 0 {
            self.pulse_left = self.pulse_left.saturating_sub(cycle).max(0);
            if self.pulse_left > 0 || wanted == self.direction && open.abs() >= travel.of_cycle() / 2.0 {
                return self.direction;
            }
            self.break_left = travel.pause.max(0);
            if self.break_left > 0 {
                return 0;
            }
        } else {
            self.break_left = self.break_left.saturating_sub(cycle).max(0);
            if self.break_left > 0 {
                return 0;
            }
        }
        if open.abs() < travel.of_cycle() * pulse as f32 / cycle as f32 {
            return 0;
        }
        self.pulse_left = pulse;
        wanted
    }
}
