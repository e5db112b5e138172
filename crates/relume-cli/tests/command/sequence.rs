//! Sequences: `relume relight --animate`.

use std::io::Read;
use std::process::{Output, Stdio};

use relume::image::{Tonemap, display};
use relume_io::{read_exr, read_png};

use crate::support::{RIG, SMALL, Workplace, numbers};

/// The rig of the room; its first light moves, the second one fades and is switched off, and it is exposed for longer.
pub(crate) fn moving() -> String {
    format!(
        "{RIG}
[[animate]]
light = \"key\"
field = \"position\"
frames = [1, 2, 4]
values = [[1.0, 2.5, 1.0], [0.5, 2.0, 1.0], [-1.0, 2.5, 0.5]]

[[animate]]
light = \"fill\"
field = \"intensity\"
interpolation = \"linear\"
frames = [1, 5]
values = [[1.0, 1.0, 2.0], [3.0, 1.0, 0.0]]

[[animate]]
light = \"fill\"
field = \"enabled\"
frames = [1, 4]
values = [true, false]

[[animate]]
field = \"exposure\"
frames = [1, 2]
values = [0.0, 0.5]
"
    )
}

/// The same at frame 2, as an artist would write it.
fn second() -> String {
    let rig = RIG.replace("[1.0, 2.5, 1.0]", "[0.5, 2.0, 1.0]").replace("[1.0, 1.0, 2.0]", "[1.5, 1.0, 1.5]");
    format!("exposure = 0.5\n{rig}")
}

fn workplace() -> Workplace {
    let work = Workplace::prepared();
    work.write("moving.toml", moving().as_bytes());
    work.write("second.toml", second().as_bytes());
    work
}

const ANIMATE: [&str; 4] = ["relight", "room.relume", "--animate", "moving.toml"];

/// What a job leaves on stdout, which may be no text.
fn output(work: &Workplace, arguments: &[&str]) -> Output {
    let output = work.command(&[&ANIMATE, arguments].concat()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn frames_are_numbered_and_each_is_what_one_alone_is() {
    let work = workplace();
    let keys =
        ["frames", "seconds", "frames_per_minute", "frame_ms", "frame_p95_ms", "write_ms", "write_p95_ms"];
    let told = work.json(&[&ANIMATE[..], &["-o", "shot.###.png"]].concat(), &keys);
    numbers(&told, &keys);
    // from the first keyed frame of all to the last
    assert_eq!((&told["frames"], &told["first"], &told["last"]), (&5.into(), &1.into(), &5.into()), "{told}");
    assert_eq!((told["output"].as_str(), &told["lights"]), (Some("shot.###.png"), &2.into()));
    let frames: Vec<Vec<u8>> = (1..=5).map(|frame| work.read(&format!("shot.{frame:03}.png"))).collect();
    assert!(frames.windows(2).take(3).all(|pair| pair[0] != pair[1]));
    assert_eq!(frames[3], frames[4], "nothing moves any more, and the light that does is off");

    let single = |rig: &str, output: &str, more: &[&str]| {
        work.succeed(&[&["relight", "room.relume", "--rig", rig, "-o", output][..], more].concat());
        work.read(output)
    };
    assert_eq!(single("rig.toml", "single.png", &[]), frames[0]);
    assert_eq!(single("moving.toml", "single.png", &[]), frames[0], "other commands read the first frame");
    assert_eq!(single("second.toml", "single.png", &[]), frames[1]);
    // every option does to a frame what it does to one alone
    let options =
        ["--per-light", "--bounces", "1", "--aa", "1", "--only", "indirect", "--cull", "0.1", "--preview"];
    work.succeed(&[&ANIMATE[..], &["--frames", "2", "-o", "second_#.exr"], &options].concat());
    assert_eq!(single("second.toml", "single.exr", &options), work.read("second_2.exr"));
    let options = ["--tonemap", "agx"];
    work.succeed(&[&ANIMATE[..], &["--frames", "-1..0", "-o", "before.##.png"], &options].concat());
    assert_eq!(single("rig.toml", "single.png", &options), work.read("before.-01.png"));
    assert_eq!(work.read("before.00.png"), work.read("before.-01.png"));
    assert!(!work.path("before.01.png").exists());
}

#[test]
fn raw_frames_are_the_pixels_of_files() {
    let work = workplace();
    work.succeed(&[&ANIMATE[..], &["-o", "shot.#.png"]].concat());
    let raw = output(&work, &["-o", "-"]);
    let size = 32 * 24 * 3;
    assert_eq!(raw.stdout.len(), 5 * size);
    for (frame, bytes) in raw.stdout.chunks(size).enumerate() {
        let file = read_png(work.path(&format!("shot.{}.png", frame + 1))).unwrap();
        assert!(display(&file, 0.0, Tonemap::Srgb).as_flattened() == bytes, "frame {frame}");
    }
    let told = String::from_utf8(raw.stderr).unwrap();
    assert!(told.contains("5 frames, 1 to 5") && told.contains("frames a minute"), "{told}");
    assert!(output(&work, &["-o", "-", "--quiet"]).stderr.is_empty());

    // scene-linear, which half floats of a file round
    work.succeed(&[&ANIMATE[..], &["--frames", "2..2", "-o", "shot.#.exr"]].concat());
    let linear = output(&work, &["--frames", "2", "-o", "-", "--raw", "rgbf32le"]).stdout;
    assert_eq!(linear.len(), 4 * size);
    let linear: Vec<f32> = linear.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    let file = read_exr(work.path("shot.2.exr")).unwrap().image;
    let pairs = || linear.as_chunks::<3>().0.iter().zip(&file.pixels);
    let close = |exposure: f32| {
        pairs().all(|(raw, pixel)| {
            let difference = (glam(*raw) * exposure - *pixel).abs();
            difference.cmple(pixel.abs() * 2e-3 + 1e-5).all()
        })
    };
    assert!(close(1.0) && !close(1.01) && !close(0.5_f32.exp2()));
}

fn glam([r, g, b]: [f32; 3]) -> relume::glam::Vec3 {
    relume::glam::Vec3::new(r, g, b)
}

/// A film without its end is told from a whole one.
#[test]
fn a_reader_that_goes_away_fails_the_job() {
    let work = workplace();
    let mut command = work.command(&[&ANIMATE[..], &["--frames", "1..20000", "-o", "-"]].concat());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut reader = child.stdout.take().unwrap();
    reader.read_exact(&mut [0; 5000]).unwrap();
    drop(reader);
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let told: Vec<&str> = stderr.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(told.len(), 1, "{stderr}");
    assert!(told[0].starts_with("error: stdout: cannot write: its reader went away at frame "), "{stderr}");
}

#[test]
fn sequences_that_cannot_be_are_refused() {
    let work = workplace();
    let refused = |more: &[&str], part: &str| work.refused(&[&ANIMATE[..], more].concat(), 2, part);
    refused(
        &["-o", "shot.png"],
        "shot.png: has no # for the number of the frame; name it as in out.####.exr",
    );
    refused(&["-o", "#.#.png"], "has more than one group of # for the number of the frame");
    refused(&["-o", "shot.##.jpg"], "the name of an image must end in .exr or .png");
    refused(&["-o", "no/shot.##.png"], "the folder no does not exist; create it");
    refused(&["-o", "shot.##.png", "--per-light"], "--per-light needs layers, which a PNG has not");
    refused(&["-o", "-", "--per-light"], "--per-light needs layers, which a raw frame has not");
    refused(&["-o", "-", "--json"], "--json needs stdout, which -o - takes for pixels");
    refused(&["-o", "shot.##.png", "--raw", "rgb24"], "--raw is of pixels on stdout; add -o -");
    refused(&["-o", "-", "--raw", "bgr"], "invalid value 'bgr'");
    refused(&["-o", "shot.##.png", "--frames", "5..1"], "invalid value '5..1'");
    refused(&["-o", "shot.##.png", "--frames", "some"], "invalid value 'some'");
    refused(&["-o", "shot.##.png", "--rig", "rig.toml"], "cannot be used with");
    work.refused(&["relight", "room.relume", "-o", "a.png"], 2, "required arguments were not provided");
    work.refused(
        &["relight", "room.relume", "--rig", "rig.toml", "-o", "-"],
        2,
        "the name of an image must end in .exr or .png",
    );
    for more in [["--frames", "1"], ["--raw", "rgb24"]] {
        let still = ["relight", "room.relume", "--rig", "rig.toml", "-o", "a.png"];
        work.refused(
            &[&still[..], &more].concat(),
            2,
            "the argument '--rig <RIG.toml>' cannot be used with '--",
        );
    }

    let with_rig = |name: &'static str, more: &[&'static str]| {
        [&["relight", "room.relume", "--animate", name, "-o", "shot.##.png"][..], more].concat()
    };
    work.refused(
        &with_rig("rig.toml", &[]),
        2,
        "rig.toml: has no [[animate]] table; add one, or say by --frames",
    );
    work.succeed(&with_rig("rig.toml", &["--frames", "3"]));
    assert!(work.path("shot.03.png").exists());
    let line = moving().lines().position(|line| line.contains("[1, 5]")).unwrap() + 2;
    work.write("wrong.toml", moving().replace("[3.0, 1.0, 0.0]", "[3.0, -1.0, 0.0]").as_bytes());
    let told = format!("wrong.toml: line {line}: at frame 5: `intensity` must not be negative, but has -1; ");
    work.refused(&with_rig("wrong.toml", &[]), 2, &told);
    // right at its keys and not between them: told before any frame is made
    work.write("through.toml", moving().replace("[-1.0, 2.5, 0.5]", "[-2.5, -1.0, -3.0]").as_bytes());
    work.succeed(&with_rig("through.toml", &["--frames", "3"]));
    let through = moving().replace("[0.5, 2.0, 1.0], [-1.0, 2.5, 0.5]", "[0, 0, 0], [-2.0, 1.0, -2.0]");
    let through = through.replace("frames = [1, 2, 4]", "interpolation = \"linear\"\nframes = [1, 2, 4]");
    work.write("through.toml", through.as_bytes());
    work.refused(&with_rig("through.toml", &[]), 2, "at frame 3: `target` must differ from `position`");
    assert!(!work.path("shot.01.png").exists());
}

/// The rig is right, and the shot was prepared without the sky that it lights from its second frame on.
#[test]
fn frames_that_the_shot_cannot_show_are_told_before_any_is_made() {
    let work = workplace();
    work.succeed(&[&["prepare", "room.gltf", "-o", "blind.relume", "--no-sky"], &SMALL[..]].concat());
    let dome = "[[light]]\nname = \"sky\"\ntype = \"dome\"\n";
    let on = "[[animate]]\nlight = \"sky\"\nfield = \"enabled\"\nframes = [1, 2]\nvalues = [false, true]\n";
    work.write("sky.toml", format!("{dome}{on}").as_bytes());
    let animate = |cache| ["relight", cache, "--animate", "sky.toml", "-o", "shot.#.png"];
    work.refused(
        &animate("blind.relume"),
        2,
        "sky.toml: at frame 2: dome light `sky`: the shot was prepared",
    );
    assert!(!work.path("shot.1.png").exists());
    work.succeed(&animate("room.relume"));
    assert!(work.path("shot.2.png").exists());
}

#[test]
fn inputs_are_not_replaced_by_frames() {
    let work = workplace();
    work.succeed(&["relight", "room.relume", "--rig", "rig.toml", "-o", "sky.0003.exr"]);
    let sky = work.read("sky.0003.exr");
    let dome = "[[light]]\nname = \"sky\"\ntype = \"dome\"\nmap = \"sky.0003.exr\"\n";
    work.write("moving.toml", format!("{dome}{}", moving()).as_bytes());
    let animate = |frames| [&ANIMATE[..], &["--frames", frames, "-o", "sky.####.exr"]].concat();
    work.refused(&animate("1..4"), 2, "sky.0003.exr: is an input of this command");
    assert!(!work.path("sky.0001.exr").exists());
    std::fs::create_dir(work.path("sky.0005.exr")).unwrap();
    work.refused(&animate("4..5"), 2, "sky.0005.exr: is there already and is no regular file");
    work.write("sky.0001.exr", b"older");
    work.succeed(&animate("1..2"));
    assert_ne!(work.read("sky.0001.exr"), b"older");
    assert_eq!(work.read("sky.0003.exr"), sky);
}
