use std::process::Stdio;

use relume::glam::Vec3;
use relume_io::{Attribute, ExrImage, load_rig, read_exr, read_png};

use crate::examples::try_what_is_told;
use crate::support::{SMALL, Workplace, numbers, shared};

#[test]
fn prepare_tells_its_figures() {
    let work = Workplace::new();
    let keys = ["seconds", "peak_rss_bytes", "cache_bytes", "bytes_per_pixel", "rays_per_pixel"];
    let told = work.json(&[&["prepare", "room.gltf", "--camera", "close"][..], &SMALL].concat(), &keys);
    let [seconds, peak, cache, per_pixel, rays] = numbers(&told, &keys)[..] else { panic!() };
    assert!(seconds < 60.0 && peak > 1e6 && per_pixel > 1.0 && rays > 1.0, "{told}");
    // Named after the scene and beside it, and as large as told.
    assert_eq!(work.read("room.relume").len() as f64, cache);
    assert_eq!(told["triangles"], 6);
    assert_eq!(told["settings"]["camera"], 1);
    let parts = ["gather_bytes", "glossy_bytes", "bounce_bytes"];
    let pixels_bytes: f64 = parts.iter().map(|part| told[*part].as_f64().unwrap()).sum();
    assert!(parts.iter().all(|part| told[*part].as_f64().unwrap() > 0.0), "{told}");
    assert!((pixels_bytes / (32.0 * 24.0) - per_pixel).abs() < 1e-6);
}

#[test]
fn relit_agrees_with_path_traced_truth() {
    let work = Workplace::prepared();
    let relit = work
        .json(&["relight", "room.relume", "--rig", "rig.toml", "-o", "relit.exr"], &["frame_ms", "relit"]);
    assert_eq!(relit["relit"], 2);
    let truth = [
        "reference",
        "room.gltf",
        "--rig",
        "rig.toml",
        "-o",
        "truth.exr",
        "--spp",
        "256",
        "--size",
        "32x24",
        "--paths",
        "transfer",
    ];
    let told = work.json(&truth, &["noise", "noise_direct", "noise_indirect", "spp", "seconds"]);
    assert_eq!(told["spp"], 256);

    // A draft on a few pixels is coarse; what is held here is that the commands speak of one image.
    let keys = ["relative_l2", "relative_l2_no_edges", "psnr", "flip"];
    let figures = work.json(&["compare", "relit.exr", "truth.exr"], &keys);
    assert!(figures["relative_l2"].as_f64().unwrap() < 0.08, "{figures}");
    assert!(figures["relative_l2_no_edges"].is_number() && figures["flip"].is_number(), "{figures}");
    assert_eq!(figures["reference_noise"], told["noise"]);
    let indirect = work.json(&["compare", "relit.exr", "truth.exr", "--layer", "indirect"], &keys);
    assert!(indirect["relative_l2"].as_f64().unwrap() < 0.25, "{indirect}");
    assert_eq!(indirect["reference_noise"], told["noise_indirect"]);

    // Other lights are another image, and the figures say so.
    let other =
        std::fs::read_to_string(work.path("rig.toml")).unwrap().replace("[1.0, 1.0, 2.0]", "[4.0, 1.0, 0.5]");
    work.write("other.toml", other.as_bytes());
    work.succeed(&["relight", "room.relume", "--rig", "other.toml", "-o", "other.exr"]);
    let figures = work.json(&["compare", "other.exr", "truth.exr", "--diff", "diff.png"], &keys);
    assert!(figures["relative_l2"].as_f64().unwrap() > 0.2, "{figures}");
    assert_eq!(read_png(work.path("diff.png")).unwrap().width, 32);
    let same = work.json(&["compare", "truth.exr", "truth.exr"], &keys);
    assert_eq!((same["relative_l2"].as_f64(), same["psnr"].is_null()), (Some(0.0), true));
}

#[test]
fn layers_hold_what_was_asked_for() {
    let work = Workplace::prepared();
    let relight = |output: &str, more: &[&str]| {
        work.succeed(&[&["relight", "room.relume", "--rig", "rig.toml", "-o", output][..], more].concat());
        read_exr(work.path(output)).unwrap()
    };
    let all = relight("all.exr", &["--per-light"]);
    let names: Vec<&str> = all.per_light.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["fill", "key"]);
    assert!(all.edges.is_some());
    let is_black = |image: &Option<relume::image::Image>| {
        image.as_ref().unwrap().pixels.iter().all(|pixel| *pixel == Vec3::ZERO)
    };
    let indirect = relight("indirect.exr", &["--only", "indirect"]);
    assert!(is_black(&indirect.direct) && !is_black(&indirect.indirect));
    assert_eq!(indirect.image, indirect.indirect.unwrap());
    assert_eq!(Some(indirect.image), all.indirect);
    let none = relight("none.exr", &["--bounces", "0", "--aa", "1"]);
    assert!(is_black(&none.indirect) && !is_black(&none.direct));

    let reference = |output: &str, more: &[&str]| {
        let arguments =
            ["reference", "room.gltf", "--rig", "rig.toml", "-o", output, "--spp", "8", "--size", "16x12"];
        work.succeed(&[&arguments[..], more].concat());
        read_exr(work.path(output)).unwrap()
    };
    let truth = reference("truth-indirect.exr", &["--only", "indirect"]);
    assert!(is_black(&truth.direct) && !is_black(&truth.indirect));
    assert!(truth.noise.is_some() && truth.edges.is_some());
    assert!(truth.attributes.iter().any(|(name, _)| name == "relume:noise"));
    let truth = reference("truth-direct.exr", &["--only", "direct"]);
    assert!(is_black(&truth.indirect) && !is_black(&truth.direct));
}

#[test]
fn pictures_follow_exposure_and_curve() {
    let work = Workplace::prepared();
    let relight = |rig: &str, output: &str, more: &[&str]| {
        work.succeed(&[&["relight", "room.relume", "--rig", rig, "-o", output][..], more].concat());
        let picture = read_png(work.path(output)).unwrap();
        picture.pixels.iter().map(|pixel| pixel.element_sum()).sum::<f32>()
    };
    let plain = relight("rig.toml", "plain.png", &[]);
    let rig = format!("exposure = -2.0\n{}", crate::support::RIG);
    work.write("dark.toml", rig.as_bytes());
    assert!(relight("dark.toml", "dark.png", &[]) < 0.7 * plain);
    assert_ne!(relight("rig.toml", "agx.png", &["--tonemap", "agx"]), plain);
}

#[test]
fn a_cache_needs_nothing_of_the_scene() {
    let work = Workplace::prepared();
    let before = work.succeed(&["relight", "room.relume", "--rig", "rig.toml", "-o", "before.exr"]);
    assert!(before.stdout.contains("before.exr"));
    std::fs::remove_file(work.path("room.gltf")).unwrap();
    std::fs::remove_file(work.path("room.bin")).unwrap();
    std::fs::create_dir(work.path("elsewhere")).unwrap();
    std::fs::rename(work.path("room.relume"), work.path("elsewhere/moved.relume")).unwrap();
    work.succeed(&["relight", "elsewhere/moved.relume", "--rig", "rig.toml", "-o", "after.exr"]);
    assert_eq!(work.read("before.exr"), work.read("after.exr"));
}

#[test]
fn a_preview_is_told_and_is_coarser() {
    let work = Workplace::prepared();
    let relit = |output: &str, options: &[&str]| {
        let command = ["relight", "room.relume", "--rig", "rig.toml", "-o", output];
        let told = work.json(&[&command[..], options].concat(), &["shadow_rays"]);
        (told["preview"].as_bool().unwrap(), told["shadow_rays"].as_u64().unwrap())
    };
    let (whole, preview) = (relit("whole.exr", &[]), relit("preview.exr", &["--preview"]));
    assert_eq!([whole.0, preview.0], [false, true]);
    // measured 0.66: in so small a picture most are from the cloud, where less is left out
    assert!(4 * preview.1 < 3 * whole.1, "{} shadow rays for {}", preview.1, whole.1);
    let [whole, preview] = ["whole.exr", "preview.exr"].map(|name| read_exr(work.path(name)).unwrap());
    let quality = |image: &ExrImage| {
        let of = |(name, value): &(String, Attribute)| (name == "relume:quality").then(|| value.clone());
        image.attributes.iter().find_map(of)
    };
    assert_eq!(quality(&whole), Some(Attribute::Text("full".to_owned())));
    assert_eq!(quality(&preview), Some(Attribute::Text("preview".to_owned())));
    assert!(work.read("whole.exr") != work.read("preview.exr"));
    let frames = ["bench", "room.relume", "--rig", "rig.toml", "--frames", "2", "--preview"];
    assert!(work.succeed(&frames).stdout.contains(", preview"));
}

#[test]
fn bench_tells_medians_and_what_moves() {
    let work = Workplace::prepared();
    let keys = ["frame_ms", "direct_ms", "bounces_ms", "gather_ms", "upsample_ms", "color_change_ms"];
    let told = work.json(&["bench", "room.relume", "--rig", "rig.toml", "--frames", "5"], &keys);
    let [frame, direct, bounces, gather, upsample, color] = numbers(&told, &keys)[..] else { panic!() };
    assert!(direct > 0.0 && bounces > 0.0 && gather > 0.0 && upsample > 0.0, "{told}");
    assert!(color < frame, "a changed colour relights nothing: {told}");
    let stages = told["stages"].as_array().unwrap();
    let loads = stages.iter().map(|stage| stage["rays"].as_u64().or(stage["bytes"].as_u64()).unwrap());
    assert!(stages.len() == 6 && loads.min() > Some(0), "every stage traces or moves something: {told}");
    assert!(told["ceiling"]["read_gb_per_s"].as_f64() > Some(0.0));
    assert!(told["ceiling"]["mrays_per_s"].as_f64() > Some(0.0));
    assert_eq!(told["light"], "key");
    assert!(
        told["shadow_rays"].as_u64().unwrap() > 0 && told["transfer_bytes_per_frame"].as_u64().unwrap() > 0
    );
    let table =
        work.succeed(&["bench", "room.relume", "--rig", "rig.toml", "--frames", "1", "--light", "fill"]);
    assert!(table.stdout.contains("light `fill` of 2 moving, 1 frame,"), "{}", table.stdout);
}

#[test]
fn info_tells_what_is_in_scene_and_cache() {
    let work = Workplace::prepared();
    let scene = work.json(&["info", "room.gltf", "--rig", "stored.toml"], &["meshes", "bounds", "warnings"]);
    assert_eq!((&scene["triangles"], &scene["instances"]), (&6.into(), &3.into()));
    assert_eq!(scene["cameras"][1]["name"], "close");
    assert_eq!(scene["bounds"][1], serde_json::json!([2.0, 3.0, 2.0]));
    let rig = load_rig(work.path("stored.toml")).unwrap();
    assert_eq!((rig.lights[0].name.as_str(), rig.lights[0].color()), ("lamp", Vec3::new(8.0, 4.0, 2.0)));
    // What was written out is what the other commands take in.
    work.succeed(&["relight", "room.relume", "--rig", "stored.toml", "-o", "stored.png"]);

    let cache =
        work.json(&["info", "room.relume"], &["bytes_per_pixel", "cache_bytes", "parts", "gather_error"]);
    assert_eq!(cache["cache_bytes"].as_u64(), Some(work.read("room.relume").len() as u64));
    assert_eq!(cache["scene"], "room.gltf");
    assert_eq!(cache["gather_samples"], 1024);
    assert!(work.succeed(&["info", "room.relume"]).stdout.contains("encoding low-rank"));
}

#[test]
fn a_scene_without_camera_gets_one_and_says_so() {
    let work = Workplace::new();
    work.write("quad.obj", b"v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nf 1 2 3 4\n");
    let ran = work.succeed(&[&["prepare", "quad.obj", "--quiet"][..], &SMALL].concat());
    assert!(ran.stderr.starts_with("warning: quad.obj: no camera in the file"), "{}", ran.stderr);
    work.succeed(&["relight", "quad.relume", "--rig", "rig.toml", "-o", "quad.png"]);
}

#[test]
fn the_papers_encoding_and_rows_stay_available() {
    let work = Workplace::new();
    let paper = ["--encoding", "haar-rows", "--coefficients", "32", "--rows", "paper", "-o", "paper.relume"];
    let told = work.json(&[&["prepare", "room.gltf"][..], &SMALL, &paper].concat(), &[]);
    assert_eq!(told["settings"]["encoding"], "haar-rows");
    assert_eq!(told["settings"]["coefficients"], 32);
    work.succeed(&["relight", "paper.relume", "--rig", "rig.toml", "-o", "paper.exr"]);
}

#[test]
fn wavelet_lights_are_packed_and_culled() {
    let work = Workplace::new();
    let blocks = ["--encoding", "haar-blocks", "--selection", "prior", "-o", "blocks.relume"];
    let told = work.json(&[&["prepare", "room.gltf"][..], &SMALL, &blocks].concat(), &[]);
    assert_eq!(
        (&told["settings"]["encoding"], &told["settings"]["selection"]),
        (&"haar-blocks".into(), &"prior".into())
    );
    let shown = work.succeed(&["info", "blocks.relume"]).stdout;
    assert!(
        shown.contains("encoding haar-blocks, selection prior") && shown.contains("in 1 atlas"),
        "{shown}"
    );
    let relit = |epsilon: &str| {
        let arguments =
            ["relight", "blocks.relume", "--rig", "rig.toml", "-o", "blocks.exr", "--cull", epsilon];
        let told = work.json(&arguments, &["multiply_adds", "culled"]);
        let figure = |name: &str| told[name].as_u64().expect("a count");
        (figure("multiply_adds"), figure("culled"))
    };
    let ((all, none), (again, some)) = (relit("0"), relit("0.5"));
    assert!(none == 0 && all > 0 && some > 0 && some <= again, "{all} {none} {again} {some}");
    let bench = ["bench", "blocks.relume", "--rig", "rig.toml", "--frames", "2", "--cull", "0.5"];
    assert!(work.json(&bench, &["multiply_adds", "culled"])["culled"].as_u64() > Some(0));
    // by its own way, where none is named
    let rows = ["--encoding", "haar-rows", "-o", "rows.relume"];
    work.json(&[&["prepare", "room.gltf"][..], &SMALL, &rows].concat(), &[]);
    assert!(work.succeed(&["info", "rows.relume"]).stdout.contains("selection area"));
}

#[test]
fn reflections_can_be_left_out_and_traced_without() {
    let work = Workplace::new();
    let prepare = |output: &str, more: &[&str]| {
        let arguments = [&["prepare", "room.gltf", "-o", output][..], &SMALL, more].concat();
        work.json(&arguments, &["glossy_bytes", "gather_bytes"])
    };
    let (with, without) = (prepare("with.relume", &[]), prepare("without.relume", &["--no-glossy"]));
    assert_eq!(without["settings"]["glossy"], false);
    assert_eq!(without["glossy_bytes"], 0);
    assert!(without["glossy_encoding_error"].is_null());
    assert!(
        with["glossy_bytes"].as_u64().unwrap() > 0 && with["glossy_encoding_error"]["expected"].is_number()
    );
    let error = |cache: &str, paths: &str| {
        work.succeed(&["relight", cache, "--rig", "rig.toml", "-o", "relit.exr"]);
        let truth = ["reference", "room.gltf", "--rig", "rig.toml", "-o", "truth.exr", "--spp", "256"];
        work.succeed(&[&truth[..], &["--size", "32x24", "--paths", paths]].concat());
        let key = "relative_l2_less_noise";
        work.json(&["compare", "relit.exr", "truth.exr", "--layer", "indirect"], &[key])[key]
            .as_f64()
            .unwrap()
    };
    let [own, other] = ["diffuse", "transfer"].map(|paths| error("without.relume", paths));
    let reflected = error("with.relume", "transfer");
    println!("without reflections {own}, {other}; with {reflected}");
    assert!(own < other && reflected < other, "{own} {other} {reflected}");
}

#[test]
fn progress_is_plain_lines_away_from_a_terminal_and_quiet_on_demand() {
    let work = Workplace::new();
    let ran = work.succeed(&[&["prepare", "room.gltf"][..], &SMALL].concat());
    assert!(ran.stderr.lines().any(|line| line == "final gather"), "{}", ran.stderr);
    assert!(!ran.stderr.contains('\u{1b}') && !ran.stderr.contains('\r'), "{:?}", ran.stderr);
    let quiet = work.succeed(&["relight", "room.relume", "--rig", "rig.toml", "-o", "a.exr", "--quiet"]);
    assert_eq!(quiet.stderr, "");
}

#[test]
fn comparing_and_looking_say_how_far_they_are() {
    let work = Workplace::prepared();
    for output in ["a.exr", "b.exr"] {
        work.succeed(&["relight", "room.relume", "--rig", "rig.toml", "-o", output]);
    }
    let compare = ["compare", "a.exr", "b.exr", "--diff", "diff.png"];
    for (arguments, stages) in [
        (&compare[..], &["reading the images", "comparing", "writing the difference"][..]),
        (&["info", "room.relume"], &["reading the cache"]),
        (&["info", "room.gltf"], &["reading the scene", "measuring the scene"]),
    ] {
        let ran = work.succeed(arguments);
        assert_eq!(ran.stderr.lines().collect::<Vec<_>>(), stages, "{arguments:?}");
        let quiet = work.succeed(&[arguments, &["--quiet"]].concat());
        assert_eq!((quiet.stderr.as_str(), quiet.stdout), ("", ran.stdout), "{arguments:?}");
    }
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let work = Workplace::new();
    let mut child =
        work.command(&["info", "room.gltf"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn every_command_helps_with_an_example() {
    let work = Workplace::new();
    for command in ["prepare", "relight", "reference", "compare", "bench", "info", "demo"] {
        let help = work.succeed(&[command, "--help"]).stdout;
        assert!(help.contains(&format!("  relume {command} ")), "{help}");
    }
}

#[test]
fn the_demo_does_the_whole_job() {
    let work = Workplace::checkout();
    let ran = work.succeed(&["demo", "--out", "shown", "--size", "40x30", "--gather", "1024", "--spp", "8"]);
    for frame in 1..=5 {
        for name in ["relit", "truth"] {
            for ending in ["png", "exr"] {
                assert!(work.path(&format!("shown/{name}-{frame}.{ending}")).is_file());
            }
        }
    }
    let sheet = read_png(work.path("shown/demo.png")).unwrap();
    assert_eq!((sheet.width, sheet.height), (5 * 40 + 4 * 4, 2 * 30 + 4));
    assert!(ran.stdout.contains("Prepared in") && ran.stdout.contains("What to try next"), "{}", ran.stdout);
    // What it says to try works.
    work.succeed(&["relight", "shown/arcade.relume", "--rig", "shown/rig-1.toml", "-o", "mine.png"]);
    try_what_is_told(&work, &ran.stdout);
    assert!(shared("arcade.glb").is_file());
    assert_eq!(work.read("shown/arcade.glb"), std::fs::read(shared("arcade.glb")).unwrap());
}
