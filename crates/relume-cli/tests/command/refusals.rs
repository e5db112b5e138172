use crate::support::{RIG, SMALL, Workplace};

const RELIGHT: [&str; 6] = ["relight", "room.relume", "--rig", "rig.toml", "-o", "out.exr"];

/// The same with one argument replaced.
fn with<'a>(arguments: &[&'a str], old: &str, new: &'a str) -> Vec<&'a str> {
    assert!(arguments.contains(&old));
    arguments.iter().map(|&argument| if argument == old { new } else { argument }).collect()
}

#[test]
fn outputs_are_refused_before_any_work() {
    let work = Workplace::new();
    // None of these comes as far as to find that there is no cache and no such scene.
    work.refused(
        &with(&RELIGHT, "out.exr", "out.jpg"),
        2,
        "out.jpg: the name of an image must end in .exr or .png",
    );
    work.refused(&with(&RELIGHT, "out.exr", "no/out.exr"), 2, "the folder no does not exist; create it");
    work.refused(
        &["prepare", "none.glb", "-o", "out.zip"],
        2,
        "out.zip: the name of a cache must end in .relume",
    );
    work.refused(
        &["info", "none.glb", "--rig", "out.txt"],
        2,
        "out.txt: the name of a rig must end in .toml",
    );
    let reference = ["reference", "none.glb", "--rig", "none.toml", "--spp", "1", "-o", "no/out.exr"];
    work.refused(&reference, 2, "the folder no does not exist; create it");
    work.refused(&[&with(&RELIGHT, "out.exr", "out.png")[..], &["--per-light"]].concat(), 2, "write an .exr");
}

#[test]
fn an_emitter_of_no_material_is_told_with_its_line_in_the_rig() {
    let work = Workplace::prepared();
    let rig = format!("{RIG}\n[[emitter]]\nscale = [1, 1, 1]\nmaterial = \"neon\"\n");
    work.write("neon.toml", rig.as_bytes());
    let line = rig.lines().position(|line| line.contains("neon")).unwrap() + 1;
    let message = &format!("neon.toml: line {line}: emitter `neon`: no material has this name; ");
    work.refused(&with(&RELIGHT, "rig.toml", "neon.toml"), 2, message);
    work.refused(&["bench", "room.relume", "--rig", "neon.toml"], 2, message);
    let reference = ["reference", "room.gltf", "--rig", "neon.toml", "--spp", "1", "-o", "out.exr"];
    work.refused(&reference, 2, message);
}

/// A dome needs a map that can be read, a shot that has the sky, and a scene that is open.
#[test]
fn domes_that_cannot_shine_are_told() {
    let work = Workplace::prepared();
    let dome = |map: &str| format!("[[light]]\nname = \"sky\"\ntype = \"dome\"\nmap = \"{map}\"\n");
    work.write("cut.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n123");
    work.write("sky.png", b"");
    let missing = "line 4: `map`: none.hdr: cannot read";
    for (map, told) in
        [("none.hdr", missing), ("cut.hdr", "cut short or altered"), ("sky.png", "use an .hdr or an .exr")]
    {
        work.write("dome.toml", dome(map).as_bytes());
        work.refused(&with(&RELIGHT, "rig.toml", "dome.toml"), 2, told);
        work.refused(
            &["reference", "room.gltf", "--rig", "dome.toml", "--spp", "1", "-o", "out.exr"],
            2,
            told,
        );
    }
    work.write("dome.toml", b"[[light]]\nname = \"sky\"\ntype = \"dome\"\n");
    let relight = with(&RELIGHT, "rig.toml", "dome.toml");
    let nothing = "dome light `sky` adds nothing";
    assert!(!work.succeed(&relight).stderr.contains(nothing), "the room is open");
    let small = ["--size", "16x12", "--gather", "256", "--quality", "draft"];
    // closed by a ceiling and two more walls
    let mut closed: serde_json::Value = serde_json::from_slice(&work.read("room.gltf")).unwrap();
    for (mesh, moved) in [(0, [0, 3, 0]), (1, [0, 0, 4]), (2, [4, 0, 0])] {
        let nodes = closed["nodes"].as_array_mut().unwrap();
        nodes.push(serde_json::json!({"mesh": mesh, "translation": moved}));
        let number = nodes.len() - 1;
        closed["scenes"][0]["nodes"].as_array_mut().unwrap().push(number.into());
    }
    work.write("closed.gltf", closed.to_string().as_bytes());
    work.succeed(
        &[&["prepare", "closed.gltf", "-o", "closed.relume", "--camera", "close"], &small[..]].concat(),
    );
    let ran = work.succeed(&with(&relight, "room.relume", "closed.relume"));
    assert!(ran.stderr.contains(nothing), "{}", ran.stderr);
    let told = work.succeed(&["info", "closed.relume"]).stdout;
    assert!(told.contains("none of the sky, which does not show"), "{told}");
    work.succeed(&[&["prepare", "room.gltf", "-o", "blind.relume", "--no-sky"], &small[..]].concat());
    work.refused(&with(&relight, "room.relume", "blind.relume"), 2, "prepare it again without --no-sky");
    for (error, told) in [("0", "from 0.1 to 100"), ("nan", "from 0.1 to 100"), ("five", "such as 4")] {
        work.refused(&["prepare", "room.gltf", "--error", error], 2, told);
    }
    let haar = ["prepare", "room.gltf", "--error", "4", "--encoding", "haar-rows"];
    work.refused(&haar, 2, "is for low-rank");
}

#[test]
fn a_material_that_is_not_there_is_told_with_its_line_in_the_rig() {
    let work = Workplace::prepared();
    for (material, part) in [
        (
            "base_color = [1, 1, 1]\nname = \"curtain\"\n",
            "material `curtain`: no material of the scene has this name; there are `material 0`, `material 1`",
        ),
        ("base_color = [1, 1, 1]\nname = \"\"\n", "`name` must not be empty"),
        (
            "name = \"material 1\"\nbase_color = [1, 1, 1.5]\n",
            "`base_color` must be within 0 to 1, but has 1.5",
        ),
    ] {
        let rig = format!("{RIG}\n[[material]]\n{material}");
        work.write("wrong.toml", rig.as_bytes());
        let message = &format!("wrong.toml: line {}: {part}", rig.lines().count());
        work.refused(&with(&RELIGHT, "rig.toml", "wrong.toml"), 2, message);
        work.refused(&["bench", "room.relume", "--rig", "wrong.toml"], 2, message);
        let reference = ["reference", "room.gltf", "--rig", "wrong.toml", "--spp", "1", "-o", "out.exr"];
        work.refused(&reference, 2, message);
    }
    let right = format!("{RIG}\n[[material]]\nname = \"material 1\"\nbase_color = [0, 1, 0.25]\n");
    work.write("right.toml", right.as_bytes());
    work.succeed(&with(&RELIGHT, "rig.toml", "right.toml"));
}

#[test]
fn inputs_are_never_overwritten() {
    let work = Workplace::new();
    work.write("a.exr", b"");
    work.refused(
        &["relight", "a.exr", "--rig", "rig.toml", "-o", "./a.exr"],
        2,
        "is an input of this command",
    );
    work.write("b.png", b"");
    work.refused(&["compare", "a.exr", "b.png", "--diff", "b.png"], 2, "is an input of this command");
    work.write("scene.relume", b"");
    work.refused(&["prepare", "scene.relume"], 2, "is an input of this command");
    assert!(work.read("a.exr").is_empty());
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_cannot_be_written_fails_the_job() {
    let work = Workplace::new();
    work.refused(&with(&RELIGHT, "out.exr", "/proc/out.exr"), 1, "/proc/out.exr: cannot write");
    work.refused(&["demo", "--out", "/proc/relume-demo"], 1, "/proc/relume-demo: cannot write");
    work.refused(&["demo", "--out", "rig.toml"], 2, "is no folder");
}

#[test]
fn missing_files_are_named() {
    let work = Workplace::prepared();
    work.refused(&["prepare", "none.glb"], 2, "none.glb: cannot read");
    work.refused(&["info", "none.glb"], 2, "none.glb: cannot read");
    work.refused(&["info", "none.relume"], 2, "none.relume: cannot read");
    work.refused(&["compare", "none.exr", "none.exr"], 2, "none.exr: cannot read");
    work.refused(&with(&RELIGHT, "room.relume", "none.relume"), 2, "none.relume: cannot read");
    work.refused(&with(&RELIGHT, "rig.toml", "none.toml"), 2, "none.toml: cannot read");
    work.refused(&["prepare", "rig.toml", "-o", "a.relume"], 2, "rig.toml: `.toml` files cannot be imported");
}

#[test]
fn damaged_and_foreign_caches_are_refused() {
    let work = Workplace::prepared();
    let whole = work.read("room.relume");
    work.succeed(&RELIGHT);
    std::fs::remove_file(work.path("out.exr")).unwrap();
    let refused = |bytes: &[u8], what: &str| {
        work.write("damaged.relume", bytes);
        let arguments = with(&RELIGHT, "room.relume", "damaged.relume");
        let ran = work.run(&arguments);
        assert_eq!(ran.status, 2, "{what}: {}", ran.stderr);
        let told: Vec<&str> =
            ran.stderr.lines().filter(|line| line.starts_with("error: damaged.relume: ")).collect();
        assert_eq!(told.len(), 1, "{what}: {}", ran.stderr);
        assert!(!work.path("out.exr").exists(), "{what}");
    };
    for length in [0, 7, 100, whole.len() / 2, whole.len() - 1] {
        refused(&whole[..length], &format!("cut to {length} bytes"));
    }
    // From the header's length over its text into the arrays.
    for place in [0, 4, 9, 300, whole.len() / 3, whole.len() / 2, whole.len() - 1] {
        let mut altered = whole.clone();
        altered[place] ^= 4;
        refused(&altered, &format!("byte {place} altered"));
    }
    refused(b"not a cache at all, but a text that is long enough to be one", "a text");
    refused(&work.read("room.gltf"), "a scene");
    work.refused(&["info", "damaged.relume"], 2, "damaged.relume: ");
    work.refused(&["bench", "damaged.relume", "--rig", "rig.toml"], 2, "damaged.relume: ");
}

#[test]
fn rigs_are_refused_with_the_line() {
    let work = Workplace::prepared();
    let refused = |old: &str, new: &str, part: &str| {
        assert!(RIG.contains(old));
        work.write("wrong.toml", RIG.replacen(old, new, 1).as_bytes());
        work.refused(&with(&RELIGHT, "rig.toml", "wrong.toml"), 2, part);
        let reference = ["reference", "room.gltf", "--rig", "wrong.toml", "--spp", "1", "-o", "out.exr"];
        work.refused(&reference, 2, part);
    };
    refused("[20.0, 18.0, 15.0]", "[20.0, nan, 15.0]", "wrong.toml: line 7: ");
    refused("inner_angle", "inner_angel", "wrong.toml: line 8: ");
    refused("target = [-1.0, 0.5, -1.0]\n", "", "wrong.toml: line 2: ");
    refused("[1.0, 1.0, 2.0]", "[1.0, -1.0, 2.0]", "wrong.toml: line 15: ");
}

#[test]
fn usage_is_refused_with_status_2() {
    let work = Workplace::new();
    for wrong in [
        &["prepare", "room.gltf", "--size", "640"][..],
        &["prepare", "room.gltf", "--size", "0x480"],
        &["prepare", "room.gltf", "--gather", "1000"],
        &["prepare", "room.gltf", "--quality", "best"],
        &["prepare", "room.gltf", "--threads", "0"],
        &["prepare", "room.gltf", "--threads", "-1"],
        &["prepare", "room.gltf", "--coefficients", "0"],
        &["prepare", "room.gltf", "--multibounce", "photons"],
        &["prepare", "room.gltf", "--multibounce", "photon", "--photons", "0"],
        &["prepare", "room.gltf", "--multibounce", "photon", "--photon-path", "0"],
        &["prepare"],
        &["relight", "room.relume"],
        &["prepare", "room.gltf", "--selection", "best"],
        &["relight", "room.relume", "--rig", "rig.toml", "-o", "a.exr", "--aa", "3"],
        &["relight", "room.relume", "--rig", "rig.toml", "-o", "a.exr", "--cull", "2"],
        &["relight", "room.relume", "--rig", "rig.toml", "-o", "a.exr", "--cull", "NaN"],
        &["reference", "room.gltf", "--rig", "rig.toml", "-o", "a.exr"],
        &["reference", "room.gltf", "--rig", "rig.toml", "-o", "a.exr", "--spp", "0"],
        &["bench", "room.relume", "--rig", "rig.toml", "--frames", "0"],
        &["polish"],
        &[],
    ] {
        let ran = work.run(wrong);
        assert_eq!((ran.status, ran.stdout.as_str()), (2, ""), "{wrong:?}: {}", ran.stderr);
    }
    let size = work.run(&["prepare", "room.gltf", "--size", "640"]).stderr;
    assert!(size.contains("write WIDTHxHEIGHT in pixels"), "{size}");
}

#[test]
fn bounces_of_photons_are_not_told_apart() {
    let work = Workplace::new();
    let prepare =
        ["prepare", "room.gltf", "-o", "photons.relume", "--photons", "20000", "--photon-path", "3"];
    work.refused(&prepare, 2, "--photons needs photons; add --multibounce photon");
    work.succeed(&[&prepare[..], &["--multibounce", "photon"], &SMALL].concat());
    let told = work.succeed(&["info", "photons.relume"]).stdout;
    assert!(told.contains("photon: 20,000 photons of up to 3 hits, 2,000 a row"), "{told}");
    let relight =
        |bounces| [&with(&RELIGHT, "room.relume", "photons.relume")[..], &["--bounces", bounces]].concat();
    work.refused(&relight("2"), 2, "2 bounces: the shot was prepared with photons");
    assert!(!work.path("out.exr").exists());
    work.succeed(&relight("1"));
}

#[test]
fn what_is_asked_for_must_be_there() {
    let work = Workplace::prepared();
    work.refused(
        &["prepare", "room.gltf", "--camera", "top"],
        2,
        "has no camera `top`; it has 0 `front`, 1 `close`",
    );
    work.refused(&["bench", "room.relume", "--rig", "rig.toml", "--light", "sun"], 2, "`key`, `fill`");
    work.refused(&["info", "room.relume", "--rig", "a.toml"], 2, "is a cache, which holds no lights");
    work.write("quad.obj", b"v -1 0 1\nv 1 0 1\nv 1 0 -1\nf 1 2 3\n");
    work.refused(&["info", "quad.obj", "--rig", "a.toml"], 2, "holds no lights");
    work.succeed(&[&RELIGHT[..], &["--only", "direct"]].concat());
    work.succeed(&with(&RELIGHT, "out.exr", "out.png"));
    work.refused(
        &["compare", "out.png", "out.png", "--layer", "direct"],
        2,
        "out.png: has no layer `direct`",
    );
    work.refused(&["compare", "out.exr", "rig.toml"], 2, "rig.toml: is of a kind Relume does not read");
    let small =
        ["reference", "room.gltf", "--rig", "rig.toml", "-o", "small.exr", "--spp", "1", "--size", "8x8"];
    work.succeed(&small);
    work.refused(&["compare", "out.exr", "small.exr"], 2, "compare images of one size");
}

/// What is wrong is told before a window is opened; and where none can be, that is told.
#[cfg(feature = "viewer")]
#[test]
fn a_window_is_not_opened_for_nothing() {
    let work = Workplace::new();
    work.write("rig.toml", RIG.as_bytes());
    work.write("bad.toml", b"[[light]]\nname = \"key\"\ntype = \"lamp\"\n");
    work.refused(&["view", "none.glb"], 2, "none.glb: cannot read");
    work.refused(&["view", "--rig", "bad.toml"], 2, "bad.toml: line 3");
    work.refused(&["view", "--rig", "none.toml"], 2, "none.toml: cannot read");
    work.refused(&["view", "rig.toml", "--cache", "rig.toml"], 2, "must end in .relume");
    work.refused(&["view", "--gather", "1000"], 2, "must be a power of four");
    #[cfg(target_os = "linux")]
    {
        let ran = work
            .command(&["view", "--rig", "rig.toml"])
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert_eq!(ran.status.code(), Some(1), "{told}");
        assert!(told.contains("error: a window: cannot open: there is no desktop"), "{told}");
        assert_eq!(told.lines().count(), 1, "{told}");
    }
}

/// Without its feature the command says how to get it.
#[cfg(not(feature = "viewer"))]
#[test]
fn a_window_that_was_left_out_is_missed_with_its_mend() {
    Workplace::new().refused(&["view"], 2, "--features viewer");
}
