//! Preparations that are interrupted and go on, and that several machines share: the same bytes.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use relume::transfer::{Encoding, Multibounce, Quality, Settings, Shard};
use relume::{Error, Preparation, Progress, Scene, Transfer};
use relume_tests::scenes::{TestScene, court};

fn arcade() -> Scene {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/arcade.glb"));
    relume_io::load_scene(path).unwrap().scene
}

/// Fifteen blocks of bounces, and some dozens of the final gather.
fn settings() -> Settings {
    Settings { size: (80, 60), gather: 1024, quality: Quality::Draft, ..Settings::default() }
}

fn saved(transfer: &Transfer) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    transfer.save(folder.path().join("saved.relume")).unwrap();
    std::fs::read(folder.path().join("saved.relume")).unwrap()
}

/// Asks to stop once a stage has told so many steps; counts those of stages, and keeps what it is told.
#[derive(Default)]
struct Listener {
    stop_in: Option<(&'static str, u64)>,
    stage: Mutex<String>,
    steps: AtomicU64,
    notices: Mutex<Vec<String>>,
}

impl Progress for Listener {
    fn stage(&self, name: &str, _: u64) {
        name.clone_into(&mut self.stage.lock().unwrap());
        self.steps.store(0, Ordering::Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.steps.fetch_add(steps, Ordering::Relaxed);
    }

    fn notice(&self, text: &str) {
        self.notices.lock().unwrap().push(text.to_owned());
    }

    fn cancelled(&self) -> bool {
        let stage = self.stage.lock().unwrap();
        self.stop_in
            .is_some_and(|(name, steps)| *stage == name && self.steps.load(Ordering::Relaxed) >= steps)
    }
}

#[test]
fn an_interrupted_preparation_goes_on_to_the_same_bytes() {
    let scene = arcade();
    let folder = tempfile::tempdir().unwrap();
    let blocks = folder.path().join("blocks");
    let preparation = || Preparation::new(&scene).settings(settings()).checkpoint(&blocks);
    let expected = saved(&Preparation::new(&scene).settings(settings()).run(&()).unwrap());
    let mut before = 0;
    for stop_in in [("bounces", 200), ("final gather", 1000), ("final gather", 3000)] {
        let listener = Listener { stop_in: Some(stop_in), ..Listener::default() };
        assert!(matches!(preparation().run(&listener), Err(Error::Cancelled)), "{stop_in:?}");
        let size = blocks.metadata().unwrap().len();
        assert!(size > before, "{stop_in:?} left nothing");
        before = size;
        let notices = listener.notices.into_inner().unwrap();
        assert_eq!(notices.len(), usize::from(stop_in.0 != "bounces"), "{notices:?}");
    }
    // what a kill leaves of a last block
    let cut = std::fs::read(&blocks).unwrap();
    std::fs::write(&blocks, &cut[..cut.len() - 7]).unwrap();
    assert!(saved(&preparation().run(&()).unwrap()) == expected, "other bytes after an interruption");
    // nothing is left to compute: no ray is traced again, and the file does not grow
    let whole = blocks.metadata().unwrap().len();
    assert!(saved(&preparation().run(&()).unwrap()) == expected);
    assert_eq!(blocks.metadata().unwrap().len(), whole);
    // of other settings there is nothing
    let other = Settings { seed: 1, ..settings() };
    let other = || Preparation::new(&scene).settings(other.clone());
    assert!(saved(&other().checkpoint(&blocks).run(&()).unwrap()) == saved(&other().run(&()).unwrap()));
}

fn files(folder: &Path, of: u32) -> Vec<PathBuf> {
    (1..=of).map(|number| folder.join(format!("{number}"))).collect()
}

/// In all encodings, with photons, with an error budget, of scenes with and without a sky.
#[test]
fn shards_make_the_same_bytes_as_one_run() {
    let (arcade, TestScene { scene: court, .. }) = (arcade(), court());
    let small = Settings { size: (40, 30), ..settings() };
    let cases = [
        (&arcade, settings()),
        (&arcade, Settings { encoding: Encoding::HaarRows, ..small.clone() }),
        (&court, Settings { encoding: Encoding::HaarBlocks, ..small.clone() }),
        (&court, Settings { multibounce: Multibounce::Photon, ..small.clone() }),
        (&court, Settings { error: Some(0.1), ..small }),
    ];
    for (scene, settings) in cases {
        let folder = tempfile::tempdir().unwrap();
        let files = files(folder.path(), 3);
        let preparation = || Preparation::new(scene).settings(settings.clone());
        let run = |number: u32, bounces_only: bool| {
            let own = &files[number as usize - 1];
            let others = files.iter().filter(|&file| file != own && file.exists()).cloned();
            let preparation = preparation().checkpoint(own).finished_blocks(others);
            preparation.run_shard(Shard { number, of: 3 }, bounces_only, &()).unwrap()
        };
        // what blocks may lose is not asked again
        let no_budget = || Listener { stop_in: Some(("error budget", 0)), ..Listener::default() };
        let merged = || preparation().finished_blocks(files.iter().cloned()).merge(&no_budget());
        let bounces: usize = (1..=3).map(|number| run(number, true)).sum();
        assert!(bounces > 3);
        let missing = merged().unwrap_err();
        assert!(
            missing.is_bad_input() && missing.to_string().contains("is in none of the files"),
            "{missing}"
        );
        let sizes = || files.iter().map(|file| file.metadata().unwrap().len()).sum::<u64>();
        let before = sizes();
        let gather: usize = (1..=3).map(|number| run(number, false)).sum();
        let transfer = merged().unwrap();
        println!("{bounces} and {gather} blocks, {before} and {} bytes", sizes());
        assert!(saved(&transfer) == saved(&preparation().run(&()).unwrap()), "{settings:?}");
    }
}

#[test]
fn shards_that_are_none_and_blocks_of_others_are_refused() {
    let scene = arcade();
    let folder = tempfile::tempdir().unwrap();
    let (blocks, other) = (folder.path().join("blocks"), folder.path().join("other"));
    let preparation = || Preparation::new(&scene).settings(settings());
    let refused = |shard, preparation: Preparation<'_>| {
        let error = preparation.run_shard(shard, false, &()).unwrap_err();
        assert!(error.is_bad_input(), "{error}");
        error.to_string()
    };
    let first = Shard { number: 1, of: 2 };
    for shard in [Shard { number: 0, of: 2 }, Shard { number: 3, of: 2 }, Shard { number: 0, of: 0 }] {
        assert!(refused(shard, preparation().checkpoint(&blocks)).contains("numbered from 1"));
    }
    assert!(refused(first, preparation()).contains("needs a file"));
    let court = court().scene;
    let settings = Settings { size: (16, 12), ..settings() };
    Preparation::new(&court).settings(settings).checkpoint(&other).run(&()).unwrap();
    let merged = |file: &PathBuf| preparation().finished_blocks([file.clone()]).merge(&()).unwrap_err();
    assert!(merged(&other).to_string().contains("of another scene"));
    // what lies beside a shard and is of something else is left aside, and told
    let listener = Listener { stop_in: Some(("bounces", 0)), ..Listener::default() };
    let beside = preparation().checkpoint(&blocks).finished_blocks([other.clone()]);
    assert!(matches!(beside.run_shard(first, false, &listener), Err(Error::Cancelled)));
    let notices = listener.notices.into_inner().unwrap();
    assert!(notices.len() == 1 && notices[0].starts_with("left aside: "), "{notices:?}");
    std::fs::write(&other, b"not at all").unwrap();
    assert!(refused(first, preparation().checkpoint(&other)).contains("no file of blocks"));
    let gone = preparation().finished_blocks([folder.path().join("gone")]).merge(&()).unwrap_err();
    assert!(gone.to_string().contains("cannot read"), "{gone}");
}
