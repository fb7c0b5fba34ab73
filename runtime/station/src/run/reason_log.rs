//! The reasons of the CPs in the log: once for each change that lasts, and no module more than once in 10 s.

use crate::view::StationView;

/// Looks between two lines about one module.
const GAP: u64 = 10;

/// What a module's reason is about; count and age do not make another one.
type Key = (String, u32);

/// What the log was told of a module.
#[derive(Debug, Default)]
struct Told {
    /// Found at the look before.
    before: Option<Key>,
    /// The reason that the log names now.
    told: Option<Key>,
    /// No line before this look.
    from: u64,
}

/// What is due for the log.
#[derive(Debug, PartialEq, Eq)]
enum Due {
    Nothing,
    /// The reason that was found.
    Reason,
    /// There is none any more.
    Over,
}

impl Told {
    /// A look; what was there at the look before too, is told.
    fn look(&mut self, look: u64, found: Option<Key>) -> Due {
        let lasts = self.before == found;
        self.before.clone_from(&found);
        if !lasts || found == self.told || look < self.from {
            return Due::Nothing;
        }
        self.from = look + GAP;
        self.told = found;
        if self.told.is_some() { Due::Reason } else { Due::Over }
    }
}

/// All modules of a station.
#[derive(Debug, Default)]
pub(super) struct ReasonLog {
    modules: Vec<Told>,
    looks: u64,
}

impl ReasonLog {
    /// Looks at all CPs: about once a second. What their drivers log themselves is left to them: the line, parameters,
    /// their end.
    pub(super) fn look(&mut self, view: &StationView) {
        self.looks += 1;
        self.modules.resize_with(view.modules.len(), Told::default);
        let now = view.clock.time();
        for (told, module) in self.modules.iter_mut().zip(&view.modules) {
            let reason = module.reason(now).filter(|reason| reason.age_s.is_some());
            let name = &module.name;
            match (told.look(self.looks, reason.as_ref().map(|reason| (reason.why.clone(), reason.number))), reason) {
                (Due::Reason, Some(reason)) => tracing::warn!("{name}: {}", reason.text),
                (Due::Over, _) => tracing::info!("{name}: nothing is in the way any more"),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_told_once_when_it_lasts_and_not_too_often() {
        let mut told = Told::default();
        let [a, b] = ["a", "b"].map(|why| Some((why.to_owned(), 7)));
        let mut look = 0;
        let mut run = |found: &Option<Key>, times: u64| {
            (0..times)
                .filter_map(|_| {
                    look += 1;
                    let due = told.look(look, found.clone());
                    (due != Due::Nothing).then_some((look, due))
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(run(&None, 5), []);
        assert_eq!(run(&a, 1), [], "a moment at the start");
        assert_eq!(run(&None, 1), []);
        assert_eq!(run(&a, 20), [(9, Due::Reason)]);
        assert_eq!(run(&b, 3), [(29, Due::Reason)]);
        assert_eq!(run(&None, 12), [(39, Due::Over)], "10 looks after the line before");
    }
}
