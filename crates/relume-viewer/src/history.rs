//! Undo and redo.

use relume::LightRig;

use crate::wording::change;

/// Steps that are kept.
const LONGEST: usize = 500;

/// What the rig was, step by step.
#[derive(Debug)]
pub(crate) struct History {
    /// The rig after the last step.
    now: LightRig,
    undo: Vec<Step>,
    redo: Vec<Step>,
}

/// A rig to go back, or forward, to.
#[derive(Debug)]
struct Step {
    /// What was done from here on: "move key".
    name: String,
    rig: LightRig,
}

impl History {
    pub(crate) fn new(rig: LightRig) -> Self {
        Self { now: rig, undo: Vec::new(), redo: Vec::new() }
    }

    /// Notes that the rig is another one now, as one step. Returns whether it is.
    pub(crate) fn note(&mut self, rig: &LightRig) -> bool {
        if *rig == self.now {
            return false;
        }
        let before = std::mem::replace(&mut self.now, rig.clone());
        self.undo.push(Step { name: change(&before, rig), rig: before });
        if self.undo.len() > LONGEST {
            self.undo.remove(0);
        }
        self.redo.clear();
        true
    }

    /// Changes the rig at every step.
    pub(crate) fn each(&mut self, change: impl Fn(&LightRig) -> LightRig) {
        let steps = self.undo.iter_mut().chain(&mut self.redo).map(|step| &mut step.rig);
        steps.chain([&mut self.now]).for_each(|rig| *rig = change(rig));
    }

    /// What would be undone.
    pub(crate) fn undoes(&self) -> Option<&str> {
        self.undo.last().map(|step| step.name.as_str())
    }

    /// What would be done again.
    pub(crate) fn redoes(&self) -> Option<&str> {
        self.redo.last().map(|step| step.name.as_str())
    }

    /// The rig before the last step.
    pub(crate) fn undo(&mut self) -> Option<LightRig> {
        let Step { name, rig } = self.undo.pop()?;
        let after = std::mem::replace(&mut self.now, rig.clone());
        self.redo.push(Step { name, rig: after });
        Some(rig)
    }

    /// The rig after the step that was undone last.
    pub(crate) fn redo(&mut self) -> Option<LightRig> {
        let Step { name, rig } = self.redo.pop()?;
        let before = std::mem::replace(&mut self.now, rig.clone());
        self.undo.push(Step { name, rig: before });
        Some(rig)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(exposure: f32) -> LightRig {
        LightRig { exposure, ..LightRig::default() }
    }

    #[test]
    fn steps_go_back_and_forth() {
        let mut history = History::new(rig(0.0));
        assert!(!history.note(&rig(0.0)));
        assert!(history.note(&rig(1.0)) && history.note(&rig(2.0)));
        assert_eq!(history.undoes(), Some("change exposure"));
        assert_eq!(history.undo(), Some(rig(1.0)));
        assert!(!history.note(&rig(1.0)), "undoing is no step of its own");
        assert_eq!(history.undo(), Some(rig(0.0)));
        assert_eq!(history.undo(), None);
        assert_eq!(history.redo(), Some(rig(1.0)));
        assert!(history.note(&rig(5.0)));
        assert_eq!(history.redo(), None, "another way was taken");
        assert_eq!(history.undo(), Some(rig(1.0)));
        assert_eq!(history.redoes(), Some("change exposure"));
    }

    #[test]
    fn the_oldest_steps_are_forgotten() {
        let mut history = History::new(rig(0.0));
        for step in 1..=LONGEST + 10 {
            history.note(&rig(step as f32));
        }
        let steps = std::iter::from_fn(|| history.undo()).count();
        assert_eq!(steps, LONGEST);
    }
}
