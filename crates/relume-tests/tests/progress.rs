//! Long work tells every step it announced, and stops where it is asked to.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::sync::Mutex;

use relume::transfer::{Multibounce, Quality, Settings};
use relume::{Error, Preparation, Progress, Result, Transfer};
use relume_tests::scenes::{box_room, court};

/// Notes each stage with the steps it announced and the steps it told; asks to stop once all stages together have told
/// `most`.
struct Listener {
    most: u64,
    stages: Mutex<Vec<(String, u64, u64)>>,
}

impl Progress for Listener {
    fn stage(&self, name: &str, steps: u64) {
        self.stages.lock().unwrap().push((name.to_owned(), steps, 0));
    }

    fn advance(&self, steps: u64) {
        self.stages.lock().unwrap().last_mut().unwrap().2 += steps;
    }

    fn cancelled(&self) -> bool {
        self.stages.lock().unwrap().iter().map(|stage| stage.2).sum::<u64>() >= self.most
    }
}

/// In a closed room with photons, or in a court under the sky within an error budget.
fn prepare(multibounce: Multibounce, most: u64) -> (Result<Transfer>, Vec<(String, u64, u64)>) {
    let open = multibounce == Multibounce::Iterated;
    let listener = Listener { most, stages: Mutex::default() };
    let settings = Settings {
        size: (40, 30),
        gather: 1024,
        quality: Quality::Draft,
        multibounce,
        error: open.then_some(0.1),
        ..Settings::default()
    };
    let built = if open { court() } else { box_room() };
    let outcome = Preparation::new(&built.scene).settings(settings).run(&listener);
    (outcome, listener.stages.into_inner().unwrap())
}

#[test]
fn a_preparation_tells_every_step_it_announced() {
    for multibounce in [Multibounce::Iterated, Multibounce::Photon] {
        let (outcome, stages) = prepare(multibounce, u64::MAX);
        assert!(outcome.is_ok());
        for (name, announced, told) in &stages {
            // one call of a library, which tells nothing until it is done
            if name != "acceleration structure" {
                assert_eq!(announced, told, "{name}");
                assert!(*announced > 1, "{name} has no steps to tell the time left by");
            }
        }
        assert!(stages.len() > 6, "{stages:?}");
        assert_eq!(stages.iter().any(|stage| stage.0 == "photons"), multibounce == Multibounce::Photon);
        assert_eq!(
            stages.iter().any(|stage| stage.0 == "error budget"),
            multibounce == Multibounce::Iterated
        );
    }
}

#[test]
fn a_preparation_stops_where_it_is_asked_to() {
    let (_, stages) = prepare(Multibounce::Photon, u64::MAX);
    let mut before = 0;
    for (number, (name, steps, told)) in stages.iter().enumerate() {
        for share in [1, told / 4].into_iter().filter(|_| *steps > 1) {
            let (outcome, begun) = prepare(Multibounce::Photon, before + share);
            assert!(matches!(outcome, Err(Error::Cancelled)), "{name}, {share} of {steps}");
            // so small a stage may tell all of its steps at once; then the next one stops
            assert!(begun.len() <= number + 2, "{name}, {share} of {steps}: went on to {:?}", begun.last());
        }
        before += told;
    }
}
