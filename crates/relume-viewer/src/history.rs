//! Undo and redo.

use relume_io::AnimatedRig;

/// Steps that are kept.
const LONGEST: usize = 500;
/// Characters of rigs that are kept: a rig in memory is some ten times its text.
const LARGEST: usize = 16 << 20;

/// What the rig was, step by step.
#[derive(Debug)]
pub(crate) struct History {
    /// The rig after the last step.
    now: AnimatedRig,
    undo: Vec<Step>,
    redo: Vec<Step>,
    /// How often the rig has become another one.
    revision: u64,
}

/// A rig to go back, or forward, to.
#[derive(Debug)]
struct Step {
    /// What was done from here on: "move key".
    name: String,
    rig: AnimatedRig,
}

impl History {
    pub(crate) fn new(rig: AnimatedRig) -> Self {
        Self { now: rig, undo: Vec::new(), redo: Vec::new(), revision: 0 }
    }

    pub(crate) fn now(&self) -> &AnimatedRig {
        &self.now
    }

    /// Notes that the rig is another one now, as one step of that name. Returns whether it is.
    pub(crate) fn note(&mut self, rig: AnimatedRig, name: String) -> bool {
        if rig == self.now {
            return false;
        }
        let before = std::mem::replace(&mut self.now, rig);
        self.undo.push(Step { name, rig: before });
        self.redo.clear();
        self.revision += 1;
        let mut size = 0;
        let kept = self.undo.iter().rev().take(LONGEST).take_while(|step| {
            size += step.rig.to_toml().len();
            size <= LARGEST
        });
        let forgotten = self.undo.len() - kept.count().max(1);
        self.undo.drain(..forgotten);
        true
    }

    /// A number that is another one whenever the rig is.
    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    /// Changes the rig at every step.
    pub(crate) fn each(&mut self, change: impl Fn(&AnimatedRig) -> AnimatedRig) {
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

    /// Goes to the rig before the last step, if there was one.
    pub(crate) fn undo(&mut self) -> bool {
        let goes = swap(&mut self.now, &mut self.undo, &mut self.redo);
        self.revision += u64::from(goes);
        goes
    }

    /// Goes to the rig after the step that was undone last, if there was one.
    pub(crate) fn redo(&mut self) -> bool {
        let goes = swap(&mut self.now, &mut self.redo, &mut self.undo);
        self.revision += u64::from(goes);
        goes
    }
}

/// Takes a step `from` one side, and puts what leads back on the other. Whether there was one.
fn swap(now: &mut AnimatedRig, from: &mut Vec<Step>, to: &mut Vec<Step>) -> bool {
    let Some(Step { name, rig }) = from.pop() else { return false };
    to.push(Step { name, rig: std::mem::replace(now, rig) });
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::glam::Vec3;
    use relume::{Light, LightRig};

    fn rig(exposure: f32) -> AnimatedRig {
        AnimatedRig::still(&LightRig { exposure, ..LightRig::default() }, "rig.toml").unwrap()
    }

    fn note(history: &mut History, exposure: f32) -> bool {
        history.note(rig(exposure), format!("to {exposure}"))
    }

    #[test]
    fn steps_go_back_and_forth() {
        let mut history = History::new(rig(0.0));
        assert!(!note(&mut history, 0.0));
        assert!(note(&mut history, 1.0) && note(&mut history, 2.0));
        assert_eq!(history.undoes(), Some("to 2"));
        assert!(history.undo() && *history.now() == rig(1.0));
        assert!(!note(&mut history, 1.0), "undoing is no step of its own");
        assert!(history.undo() && *history.now() == rig(0.0));
        assert!(!history.undo());
        assert!(history.redo() && *history.now() == rig(1.0));
        assert!(note(&mut history, 5.0));
        assert!(!history.redo(), "another way was taken");
        assert!(history.undo() && *history.now() == rig(1.0));
        assert_eq!(history.redoes(), Some("to 5"));
    }

    #[test]
    fn the_oldest_steps_are_forgotten() {
        let mut history = History::new(rig(0.0));
        for step in 1..=LONGEST + 10 {
            note(&mut history, step as f32);
        }
        let steps = |history: &mut History| std::iter::from_fn(|| history.undo().then_some(())).count();
        assert_eq!(steps(&mut history), LONGEST);
        // and of large ones, all but those that memory is there for
        let kind = relume::LightKind::Omni { position: Vec3::ONE, intensity: Vec3::ONE, radius: 0.0 };
        let light = |number| Light { name: format!("light {number}"), enabled: true, kind: kind.clone() };
        let large = LightRig { lights: (0..10_000).map(light).collect(), ..LightRig::default() };
        let large =
            |exposure| AnimatedRig::still(&LightRig { exposure, ..large.clone() }, "rig.toml").unwrap();
        let size = large(0.0).to_toml().len();
        assert!(size > LARGEST / 20, "{size}");
        for step in 0..25 {
            history.note(large(step as f32), "more light".to_owned());
        }
        assert!((5..20).contains(&steps(&mut history)));
    }
}
