//! The cache file: what is read is what was written, and what is not whole is refused.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use relume::glam::Vec3;
use relume::image::Layers;
use relume::relight::RelightSettings;
use relume::sample::{GatherCloud, Receivers, SkyCells};
use relume::scene::{AlphaMode, ColorSpace, Material, Texture, TextureRef, Wrap};
use relume::transfer::haar_blocks::{ATLAS, HaarBlocks};
use relume::transfer::{Encoding, FORMAT_VERSION, Matrix, Quality, Settings};
use relume::{Error, Transfer};
use relume_tests::prepared::{prepare, relight_afresh};
use relume_tests::scenes::{SceneBuilder, TestScene, court, emissive, lambertian, omni, rig};

/// A room with a lamp, a masked sheet and a metal one: something in every part of the file.
fn everything() -> TestScene {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::new(0.7, 0.6, 0.5)));
    let lamp = builder.material(emissive(Vec3::ZERO, Vec3::new(9.0, 8.0, 7.0)));
    let metal = builder.material(Material { metallic: 1.0, roughness: 0.3, ..lambertian(Vec3::splat(0.8)) });
    let texels = (0..16).map(|i| [200, 100, 50, if i % 3 == 0 { 0 } else { 255 }]).collect();
    let texture = builder.texture(Texture {
        name: "leaf".into(),
        width: 4,
        height: 4,
        texels,
        color_space: ColorSpace::Srgb,
        wrap: [Wrap::Repeat, Wrap::Mirror],
    });
    let leaf = builder.material(Material {
        base_color_texture: Some(TextureRef::new(texture)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        double_sided: true,
        ..lambertian(Vec3::ONE)
    });
    builder
        .room(Vec3::ZERO, Vec3::new(2.0, 2.0, 3.0), wall)
        .quad(Vec3::new(0.4, 0.4, 1.0), Vec3::X, Vec3::Y, leaf)
        .quad(Vec3::new(0.2, 0.01, 0.2), 2.0 * Vec3::Z, 1.6 * Vec3::X, metal)
        .disc(Vec3::new(1.0, 1.9, 1.2), Vec3::NEG_Y, 0.3, 24, lamp)
        .camera(Vec3::new(1.0, 1.0, 2.9), Vec3::new(1.0, 1.0, 0.0), 70.0);
    builder.build()
}

fn small(encoding: Encoding) -> Transfer {
    let settings =
        Settings { size: (16, 12), gather: 256, quality: Quality::Draft, encoding, ..Settings::default() };
    prepare(&everything(), settings)
}

fn relit(transfer: Transfer) -> Layers {
    let lights =
        rig([omni(Vec3::new(1.5, 1.0, 2.0), Vec3::new(2.0, 1.0, 0.5), 0.0), omni(Vec3::ONE, Vec3::ONE, 0.1)]);
    let settings = RelightSettings { per_light: true, ..RelightSettings::default() };
    relight_afresh(&Arc::new(transfer), &lights, &settings)
}

/// A folder with one cache in it, and that cache's bytes.
struct Saved {
    folder: tempfile::TempDir,
    bytes: Vec<u8>,
}

impl Saved {
    fn new(transfer: &Transfer) -> Self {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let path = folder.path().join("shot.relume");
        transfer.save(&path).expect("a folder that can be written");
        let bytes = std::fs::read(&path).expect("the file just written");
        Self { folder, bytes }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("shot.relume")
    }

    /// What loading `bytes` gives.
    fn load(&self, bytes: &[u8]) -> relume::Result<Transfer> {
        let path = self.folder.path().join("other.relume");
        std::fs::write(&path, bytes).expect("a folder that can be written");
        Transfer::load(&path)
    }

    /// The sentence by which `bytes` are refused.
    fn refusal(&self, bytes: &[u8], what: &str) -> String {
        let error = match self.load(bytes) {
            Err(error) => error,
            Ok(_) => panic!("{what} was accepted"),
        };
        assert!(matches!(error, Error::File { .. }) && error.is_bad_input(), "{what}: {error}");
        let sentence = error.to_string();
        assert!(sentence.contains("other.relume") && sentence.contains("prepare"), "{what}: {sentence}");
        assert!(!sentence.contains('\n') && sentence.len() < 500, "{what}: {sentence}");
        sentence
    }

    fn header_length(&self) -> usize {
        let length: [u8; 8] = self.bytes[..8].try_into().expect("eight bytes");
        u64::from_le_bytes(length) as usize
    }
}

#[test]
fn what_is_loaded_relights_as_what_was_saved() {
    for encoding in [Encoding::LowRank, Encoding::HaarRows, Encoding::HaarBlocks] {
        let transfer = small(encoding);
        let saved = Saved::new(&transfer);
        let loaded = Transfer::load(saved.path()).unwrap();
        assert_eq!(
            (&loaded.report, &loaded.view, &loaded.cloud),
            (&transfer.report, &transfer.view, &transfer.cloud)
        );
        assert_eq!(loaded.occluders.masks, transfer.occluders.masks);
        assert!(!loaded.occluders.masks.masks.is_empty() && !loaded.view.center_emission.is_empty());
        assert_eq!(loaded.bytes_per_pixel(), transfer.bytes_per_pixel());
        let again = Saved::new(&loaded);
        assert!(again.bytes == saved.bytes, "{encoding:?}: saved again it differs");
        let (before, after) = (relit(transfer), relit(loaded));
        assert!(before.direct == after.direct && before.indirect == after.indirect, "{encoding:?}");
        assert_eq!(before.edges, after.edges);
    }
}

#[test]
fn a_loaded_file_may_be_replaced_while_it_is_used() {
    let transfer = small(Encoding::LowRank);
    let saved = Saved::new(&transfer);
    let loaded = Transfer::load(saved.path()).unwrap();
    small(Encoding::HaarRows).save(saved.path()).unwrap();
    assert!(relit(loaded).indirect == relit(transfer).indirect);
}

#[test]
fn every_truncation_is_refused() {
    let saved = Saved::new(&small(Encoding::LowRank));
    let (all, header) = (saved.bytes.len(), saved.header_length());
    let mut lengths = vec![0, 1, 7, 8, 9, 8 + header / 2, 7 + header, 8 + header, 9 + header, all - 1];
    lengths.extend((1..32).map(|part| all * part / 32));
    for length in lengths {
        saved.refusal(&saved.bytes[..length], &format!("the first {length} of {all} bytes"));
    }
    let longer = [&saved.bytes[..], &[0]].concat();
    saved.refusal(&longer, "a byte too many");
    saved.load(&saved.bytes).unwrap();
}

#[test]
fn flipped_bytes_are_refused() {
    for encoding in [Encoding::LowRank, Encoding::HaarBlocks] {
        flipped_bytes_of(encoding);
    }
}

fn flipped_bytes_of(encoding: Encoding) {
    let saved = Saved::new(&small(encoding));
    let (all, header) = (saved.bytes.len(), saved.header_length());
    // the header's every seventh byte, and two hundred spread over the arrays
    let places = (0..8)
        .chain((8..8 + header).step_by(7))
        .chain((0..200).map(|i| header + 8 + i * (all - header - 8) / 200));
    for place in places {
        for mask in [0xff, 0x01, 0x10] {
            let mut bytes = saved.bytes.clone();
            bytes[place] ^= mask;
            saved.refusal(&bytes, &format!("byte {place} of {all} changed by {mask:#x}"));
        }
    }
}

#[test]
fn exchanged_arrays_are_refused() {
    // two files of one kind, the arrays of one under the header of the other
    let saved = Saved::new(&small(Encoding::LowRank));
    let settings =
        Settings { size: (16, 12), gather: 256, quality: Quality::Draft, seed: 1, ..Settings::default() };
    let other = Saved::new(&prepare(&everything(), settings));
    let cut = 8 + saved.header_length();
    let mut bytes = saved.bytes[..cut].to_vec();
    let arrays = &other.bytes[8 + other.header_length()..];
    bytes.extend(arrays.iter().copied().chain(std::iter::repeat(0)).take(saved.bytes.len() - cut));
    saved.refusal(&bytes, "another file's arrays");
}

#[test]
fn foreign_files_are_refused() {
    let saved = Saved::new(&small(Encoding::LowRank));
    let header = br#"{"weight":{"dtype":"U8","shape":[4],"data_offsets":[0,4]}}"#;
    let foreign = [&(header.len() as u64).to_le_bytes()[..], header, &[1, 2, 3, 4]].concat();
    assert!(saved.refusal(&foreign, "another safetensors file").contains("not one that Relume wrote"));
    let huge = [&u64::MAX.to_le_bytes()[..], &[b'{'; 64]].concat();
    saved.refusal(&huge, "a header longer than memory");
    saved.refusal(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "an OBJ file");
    let missing = Transfer::load(saved.folder.path().join("none.relume")).unwrap_err();
    assert!(missing.is_bad_input() && missing.to_string().contains("none.relume"), "{missing}");
    let folder = Transfer::load(saved.folder.path()).unwrap_err();
    assert!(folder.is_bad_input() && folder.to_string().contains("is no file"), "{folder}");
}

/// Whole files, whose checksums are right, that name rows which are not there.
#[test]
fn rows_that_are_not_there_are_refused() {
    let transfer = small(Encoding::LowRank);
    let outside = vec![transfer.gather.rows as u32; transfer.view.quads.len()];
    let few = vec![Receivers::NONE; transfer.view.quads.len() - 1];
    let none = vec![Receivers::NONE; transfer.view.quads.len()];
    let saved =
        |rows: Vec<u32>| Saved::new(&Transfer { receivers_of_quads: rows.into(), ..transfer.clone() });
    for rows in [outside, few] {
        let saved = saved(rows);
        let sentence = saved.refusal(&saved.bytes, "rows that are not there");
        assert!(sentence.contains("view.receivers_of_quads"), "{sentence}");
    }
    let saved = saved(none);
    assert!(saved.load(&saved.bytes).is_ok(), "nothing that is lit is no mistake");
}

/// The same, with blocks that reach past their atlas, or rows that lie at one place.
#[test]
fn blocks_that_cannot_be_are_refused() {
    let transfer = small(Encoding::HaarBlocks);
    let altered = |change: &dyn Fn(&mut HaarBlocks)| {
        let mut altered = transfer.clone();
        match &mut altered.bounce.matrix {
            Matrix::HaarBlocks(matrix) => change(matrix),
            other => panic!("{other:?}"),
        }
        Saved::new(&altered)
    };
    let changes: [&dyn Fn(&mut HaarBlocks); 3] = [
        &|matrix| matrix.texels = matrix.texels[..matrix.texels.len() - ATLAS].to_vec().into(),
        &|matrix| {
            let mut blocks = matrix.blocks.to_vec();
            blocks[0].coefficient = 256;
            matrix.blocks = blocks.into();
        },
        &|matrix| matrix.layout.places = vec![0; matrix.layout.places.len()].into(),
    ];
    for change in changes {
        let saved = altered(change);
        let sentence = saved.refusal(&saved.bytes, "impossible blocks");
        assert!(sentence.contains("bounce"), "{sentence}");
    }
    let saved = altered(&|_| {});
    assert!(saved.load(&saved.bytes).is_ok());
}

/// The same, with a picture of no pixels.
#[test]
fn a_view_of_nothing_is_refused() {
    let transfer = small(Encoding::LowRank);
    for (width, height) in [(0, transfer.view.height), (transfer.view.width, 0)] {
        let mut altered = transfer.clone();
        (altered.view.width, altered.view.height) = (width, height);
        altered.view.centers.clear();
        altered.view.quads.clear();
        (altered.view.center_emission, altered.view.quad_emission) = (Vec::new(), Vec::new());
        (altered.view.center_chains, altered.view.quad_chains) = Default::default();
        for receivers in [
            &mut altered.receivers_of_centers,
            &mut altered.receivers_of_quads,
            &mut altered.receivers_of_center_branches,
            &mut altered.receivers_of_quad_branches,
        ] {
            *receivers = Vec::new().into();
        }
        let saved = Saved::new(&altered);
        let sentence = saved.refusal(&saved.bytes, "a view of nothing");
        assert!(sentence.contains("view"), "{sentence}");
    }
}

/// The same, with weights of light that are too few or no numbers.
#[test]
fn weights_that_cannot_be_are_refused() {
    let transfer = small(Encoding::LowRank);
    let count = transfer.cloud.len();
    let mut none = vec![1.0; count];
    none[100] = f32::NAN;
    for (which, changed) in (0..4).flat_map(|which| [(which, vec![1.0; count - 1]), (which, none.clone())]) {
        let mut altered = transfer.clone();
        let Transfer { bounce, gather, .. } = &mut altered;
        let weights = [
            &mut bounce.sample_weights,
            &mut bounce.weights,
            &mut gather.sample_weights,
            &mut gather.weights,
        ];
        let all = weights.into_iter().nth(which).expect("four of them");
        assert_eq!(all.len(), count);
        *all = changed.into();
        let saved = Saved::new(&altered);
        let sentence = saved.refusal(&saved.bytes, "weights that cannot be");
        assert!(sentence.contains(["bounce", "gather"][which / 2]), "{sentence}");
    }
}

/// The same, with a sky that is no division of the sphere, or larger than the cloud.
#[test]
fn skies_that_cannot_be_are_refused() {
    let settings = Settings { size: (16, 12), gather: 256, quality: Quality::Draft, ..Settings::default() };
    let [open, finer] = [256, 4096].map(|gather| prepare(&court(), Settings { gather, ..settings.clone() }));
    assert_eq!((open.cloud.sky.len(), finer.cloud.sky.len()), (16, 256));
    let saved = Saved::new(&open);
    assert!(saved.load(&saved.bytes).is_ok());
    let other = |sky: &SkyCells| {
        let cloud = GatherCloud { sky: sky.clone(), ..open.cloud.clone() };
        Saved::new(&Transfer { cloud, ..open.clone() })
    };
    // none, as many as all samples, and some that are not even sorted
    for sky in [SkyCells::default(), finer.cloud.sky.clone()] {
        let saved = other(&sky);
        let sentence = saved.refusal(&saved.bytes, "a sky of another size");
        assert!(sentence.contains("cloud"), "{sentence}");
    }
}

/// The same, with emission of samples or materials that are not there, or that is no light.
#[test]
fn emission_that_cannot_be_is_refused() {
    let transfer = small(Encoding::LowRank);
    let first = transfer.cloud.emitted[0];
    let changes: [&dyn Fn(&mut Transfer); 6] = [
        &|t| t.cloud.emitted[0].sample = t.cloud.len() as u32,
        &|t| t.cloud.emitted[0].material = t.report.materials.len() as u32,
        &|t| t.cloud.emitted[0].radiance.x = f32::NAN,
        &|t| t.cloud.emitted[0].radiance.x = -1.0,
        &|t| t.cloud.emitted.insert(0, first),
        &|t| {
            t.report.materials.truncate(1);
            t.report.base_colors.truncate(1);
        },
    ];
    for change in changes {
        let mut altered = transfer.clone();
        change(&mut altered);
        let saved = Saved::new(&altered);
        let sentence = saved.refusal(&saved.bytes, "impossible emission");
        assert!(sentence.contains("cloud") || sentence.contains("view"), "{sentence}");
    }
    assert!(Saved::new(&transfer).load(&Saved::new(&transfer).bytes).is_ok());
}

#[test]
fn the_page_about_the_file_is_of_this_version() {
    let page = include_str!("../../../docs/CACHE.md");
    assert!(page.contains(&format!("This page describes format version {FORMAT_VERSION}.")));
}

#[test]
fn other_versions_are_named() {
    let saved = Saved::new(&small(Encoding::LowRank));
    let ours = format!(r#"version\":{FORMAT_VERSION}"#).into_bytes();
    let place = saved.bytes.windows(ours.len()).position(|part| part == ours).unwrap();
    for version in [FORMAT_VERSION - 1, FORMAT_VERSION + 1] {
        let theirs = format!(r#"version\":{version}"#).into_bytes();
        let mut bytes = saved.bytes.clone();
        // the file begins with the length of its header, which may have a digit more then
        let header = u64::from_le_bytes(bytes[..8].try_into().unwrap());
        let header = header + theirs.len() as u64 - ours.len() as u64;
        bytes[..8].copy_from_slice(&header.to_le_bytes());
        bytes.splice(place..place + ours.len(), theirs);
        let sentence = saved.refusal(&bytes, "another version");
        assert!(sentence.contains(&format!("format {version}")), "{sentence}");
        assert!(sentence.contains(&format!("format {FORMAT_VERSION}")), "{sentence}");
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the folder");
    entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
}

#[test]
fn a_save_that_cannot_be_names_the_file_and_leaves_nothing() {
    let transfer = small(Encoding::LowRank);
    let folder = tempfile::tempdir().unwrap();
    for path in [folder.path().join("missing/shot.relume"), folder.path().to_owned()] {
        let error = transfer.save(&path).unwrap_err();
        assert!(error.to_string().contains(&*path.to_string_lossy()), "{error}");
    }
    assert!(names(folder.path()).is_empty());
}

#[cfg(unix)]
#[test]
fn a_folder_that_cannot_be_written_keeps_the_old_file() {
    use std::os::unix::fs::PermissionsExt;
    let saved = Saved::new(&small(Encoding::LowRank));
    let with_mode = |mode| {
        let permissions = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(saved.folder.path(), permissions).unwrap();
    };
    with_mode(0o555);
    let refused = std::fs::write(saved.folder.path().join("probe"), b"x").is_err();
    let outcome = small(Encoding::HaarRows).save(saved.path());
    with_mode(0o755);
    if !refused {
        println!("skipped: this user may write anywhere");
        return;
    }
    let error = outcome.unwrap_err();
    assert!(error.to_string().contains("shot.relume: cannot write"), "{error}");
    assert!(std::fs::read(saved.path()).unwrap() == saved.bytes);
    assert_eq!(names(saved.folder.path()), ["shot.relume"]);
}

/// Where the process that is killed while it saves finds what to do.
const CHILD: &str = "RELUME_TEST_SAVES_OVER";

/// Not a test of its own: what [`a_killed_save_leaves_the_old_file`] runs in another process.
#[test]
fn child_that_saves() {
    if let Some(path) = std::env::var_os(CHILD) {
        Transfer::load(&path).unwrap().save(&path).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_killed_save_leaves_the_old_file() {
    let saved = Saved::new(&small(Encoding::LowRank));
    let saves = |limit: &str| {
        // the system kills a process that writes past the limit, which is in blocks of 512 or 1024 bytes
        let mut command = std::process::Command::new("sh");
        command.args(["-c", &format!("ulimit -c 0; {limit} exec \"$0\" --exact child_that_saves")]);
        command.arg(std::env::current_exe().unwrap()).env(CHILD, saved.path());
        command.output().unwrap().status
    };
    assert!(saved.bytes.len() > 64 * 1024);
    let killed = saves("ulimit -f 32;");
    assert!(!killed.success(), "{killed}");
    assert!(std::fs::read(saved.path()).unwrap() == saved.bytes, "the old file is whole");
    Transfer::load(saved.path()).unwrap();
    assert!(saves("").success(), "without the limit it saves");
}
