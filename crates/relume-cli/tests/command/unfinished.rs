//! Commands that cannot finish: interrupted, out of space, or not allowed to write. They end in one sentence and leave
//! nothing behind but what the same command goes on from.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::sequence::moving;
use crate::support::{Ran, SMALL, Workplace, shared};

/// Runs the command, sends `signal` once it says that the stage `stage` begins, and waits for its end.
fn interrupted(work: &Workplace, arguments: &[&str], stage: &str, signal: &str) -> Ran {
    let mut child = work.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut stderr = String::new();
    while !stderr.lines().any(|line| line == stage) {
        assert!(said.read_line(&mut stderr).unwrap() > 0, "no stage `{stage}`: {stderr}");
    }
    let sent = Command::new("sh").args(["-c", &format!("kill -{signal} {}", child.id())]).status().unwrap();
    assert!(sent.success());
    let asked = Instant::now();
    said.read_to_string(&mut stderr).unwrap();
    let status = child.wait().unwrap().code().unwrap_or(-1);
    println!("{arguments:?}, {signal}: ended after {:.2} s", asked.elapsed().as_secs_f64());
    assert!(asked.elapsed() < Duration::from_secs(60), "the whole job was done");
    let mut stdout = String::new();
    child.stdout.take().unwrap().read_to_string(&mut stdout).unwrap();
    Ran { status, stdout, stderr }
}

fn names(work: &Workplace) -> Vec<String> {
    let entries = std::fs::read_dir(work.path(".")).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn errors(ran: &Ran) -> Vec<&str> {
    ran.stderr.lines().filter(|line| line.starts_with("error: ")).collect()
}

/// Long enough that no machine is done before it is asked to stop.
#[test]
fn an_interrupted_job_says_so_and_leaves_nothing() {
    let work = Workplace::new();
    let (before, arcade) = (names(&work), shared("arcade.glb").canonicalize().unwrap());
    let arcade = arcade.to_str().unwrap();
    let prepare = ["prepare", arcade, "-o", "shot.relume", "--gather", "1024", "--quality", "final"];
    let alone = [&prepare[..], &["--no-checkpoint"]].concat();
    let reference = ["reference", arcade, "--rig", "rig.toml", "-o", "shot.exr", "--spp", "65536"];
    let jobs = [
        (&prepare[..], "view samples", "INT"),
        (&alone, "final gather", "TERM"),
        (&reference, "path tracing", "INT"),
    ];
    for (arguments, stage, signal) in jobs {
        let ran = interrupted(&work, arguments, stage, signal);
        assert_eq!((ran.status, ran.stdout.as_str()), (130, ""), "{arguments:?}: {}", ran.stderr);
        assert_eq!(errors(&ran), ["error: interrupted; no file is left half written"], "{}", ran.stderr);
        assert_eq!(names(&work), before, "{arguments:?}");
    }
}

/// Frames that were written stay, and all of them are whole, also where nobody took the unfinished one away.
#[test]
fn an_interrupted_sequence_leaves_whole_frames() {
    let work = Workplace::prepared();
    work.write("moving.toml", moving().as_bytes());
    let before = names(&work);
    let animate = ["relight", "room.relume", "--animate", "moving.toml", "--frames", "1..100000"];
    for (signal, status) in [("INT", 130), ("TERM", 130), ("KILL", -1)] {
        let to_files = [&animate[..], &["-o", "shot.######.png"]].concat();
        let ran = interrupted(&work, &to_files, "relighting frames", signal);
        assert_eq!((ran.status, ran.stdout.as_str()), (status, ""), "{}", ran.stderr);
        let told = ["error: interrupted; no file is left half written"];
        assert_eq!(errors(&ran), told[..usize::from(status == 130)], "{}", ran.stderr);
        let is_hidden = |name: &String| name.starts_with(".relume-");
        let mut left: Vec<String> = names(&work).into_iter().filter(|name| !before.contains(name)).collect();
        assert!(left.len() < 10_000 && (status == -1 || !left.iter().any(is_hidden)), "{left:?}");
        left.retain(|name| std::fs::metadata(work.path(name)).is_ok() && !is_hidden(name));
        for (place, name) in left.iter().enumerate() {
            assert_eq!(*name, format!("shot.{:06}.png", place + 1), "none is left out");
            assert_eq!(relume_io::read_png(work.path(name)).unwrap().width, 32, "{signal}: {name}");
        }
        let left = names(&work).into_iter().filter(|name| !before.contains(name));
        left.for_each(|name| std::fs::remove_file(work.path(&name)).unwrap());
    }
    // whoever reads raw frames gets whole ones
    let ran = work
        .command(&[&animate[..], &["-o", "-"]].concat())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    let mut child = ran.unwrap();
    let mut reader = child.stdout.take().unwrap();
    let mut read = vec![0; 32 * 24 * 3];
    reader.read_exact(&mut read).unwrap();
    let sent = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(sent.success());
    reader.read_to_end(&mut read).unwrap();
    assert_eq!((child.wait().unwrap().code(), read.len() % (32 * 24 * 3)), (Some(130), 0));
}

/// Asked to stop or killed, the same command goes on from the blocks that are done, to the same bytes.
#[test]
fn an_interrupted_preparation_goes_on() {
    let work = Workplace::new();
    let (before, arcade) = (names(&work), shared("arcade.glb").canonicalize().unwrap());
    let arcade = arcade.to_str().unwrap();
    let prepare = |cache| {
        let size = ["--size", "160x120", "--gather", "1024", "--quality", "draft"];
        [&["prepare", arcade, "-o", cache][..], &size].concat()
    };
    for (signal, status) in [("TERM", 130), ("KILL", -1)] {
        let ran = interrupted(&work, &prepare("shot.relume"), "final gather", signal);
        assert_eq!(ran.status, status, "{}", ran.stderr);
        let told = "shot.relume-blocks holds what is done: the same command goes on from there";
        assert_eq!(ran.stderr.contains(told), signal == "TERM", "{}", ran.stderr);
        let left: Vec<String> = names(&work).into_iter().filter(|name| !before.contains(name)).collect();
        assert_eq!(left, ["shot.relume-blocks"]);
    }
    let ran = work.succeed(&prepare("shot.relume"));
    assert!(ran.stderr.contains("finished blocks are there"), "{}", ran.stderr);
    assert!(!work.path("shot.relume-blocks").exists(), "done: nothing to go on from");
    work.succeed(&prepare("other.relume"));
    assert!(work.read("shot.relume") == work.read("other.relume"), "other bytes after an interruption");
}

/// Two shards by two commands, at the same time, and the cache that is made of them.
#[test]
fn shards_are_merged() {
    let work = Workplace::new();
    let prepare =
        |more: &[&'static str]| [&["prepare", "room.gltf", "-o", "shot.relume"][..], &SMALL, more].concat();
    let at_once = ["1/2", "2/2"].map(|part| {
        let mut command = work.command(&prepare(&["--shard", part, "--bounces-only"]));
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    });
    for mut shard in at_once {
        assert!(shard.wait().unwrap().success());
    }
    let merge = |files: &[&'static str]| [&["merge", "room.gltf", "-o", "shot.relume"][..], files].concat();
    let parts = ["shot.1-of-2.relume-blocks", "shot.2-of-2.relume-blocks"];
    work.refused(&merge(&parts), 2, "give those of all shards");
    for part in ["1/2", "2/2"] {
        let told = work.succeed(&prepare(&["--shard", part, "--json"]));
        assert!(told.stdout.contains(r#""number": "#), "{}", told.stdout);
    }
    assert!(!work.path("shot.relume").exists());
    work.refused(&merge(&parts[..1]), 2, "of which number 2 is missing; give those of all shards");
    work.succeed(&merge(&parts));
    let merged = work.read("shot.relume");
    work.succeed(&prepare(&[]));
    assert!(merged == work.read("shot.relume"));
    work.refused(&merge(&["room.gltf"]), 2, "a file of blocks ends in .relume-blocks");
    work.write("none.relume-blocks", b"nothing");
    work.refused(&merge(&["none.relume-blocks"]), 2, "holds no blocks");
    for part in ["0/2", "3/2", "2", "a/b", "1/5000"] {
        let mut arguments = prepare(&["--shard"]);
        arguments.push(part);
        work.refused(&arguments, 2, "must be I/N");
    }
}

/// A first cache that can be relit is there before the last one is.
#[test]
fn a_cache_is_written_in_steps() {
    let work = Workplace::new();
    let prepare = ["prepare", "room.gltf", "-o", "shot.relume", "--size", "64x48", "--gather", "1024"];
    let ran = work.succeed(&[&prepare[..], &["--in-steps"]].concat());
    assert_eq!(ran.stderr.matches("shot.relume can be relit after").count(), 2, "{}", ran.stderr);
    let steps = work.read("shot.relume");
    work.succeed(&prepare);
    assert!(steps == work.read("shot.relume"));
    work.succeed(&[
        "prepare",
        "room.gltf",
        "-o",
        "few.relume",
        "--size",
        "64x48",
        "--gather",
        "1024",
        "--spacing",
        "0.9",
    ]);
    assert!(work.read("few.relume").len() < steps.len());
    assert!(work.succeed(&["info", "few.relume"]).stdout.contains("spaced by 0.9 of the distance"));
}

/// Asked to stop by nobody, the same kind of job ends well and leaves its file.
#[test]
fn a_job_that_is_left_alone_leaves_its_file() {
    let work = Workplace::new();
    let before = names(&work).len();
    let ran = work.succeed(&[&["prepare", "room.gltf"][..], &SMALL].concat());
    assert!(errors(&ran).is_empty() && names(&work).len() == before + 1);
}

/// Runs the command where no file may grow past `blocks` of 512 or 1024 bytes. Ignoring the signal makes the system
/// refuse the write instead, as it does on a full disk.
fn short_of_space(work: &Workplace, blocks: u32, arguments: &[&str]) -> Ran {
    let limited = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.current_dir(work.path(".")).args(["-c", &limited, env!("CARGO_BIN_EXE_relume")]).args(arguments);
    let output = command.output().unwrap();
    Ran {
        status: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

#[test]
fn without_space_the_job_fails_and_leaves_nothing() {
    let work = Workplace::prepared();
    work.write("moving.toml", moving().as_bytes());
    let before = names(&work);
    let relight = |output| ["relight", "room.relume", "--rig", "rig.toml", "-o", output];
    let sequence = ["relight", "room.relume", "--animate", "moving.toml", "-o", "more.#.exr"];
    let prepare = [&["prepare", "room.gltf", "-o", "more.relume"][..], &SMALL].concat();
    let reference =
        ["reference", "room.gltf", "--rig", "rig.toml", "-o", "truth.exr", "--spp", "8", "--size", "64x48"];
    let jobs = [&prepare[..], &relight("more.exr"), &relight("more.png"), &sequence, &reference];
    for arguments in jobs {
        let ran = short_of_space(&work, 1, arguments);
        assert_eq!((ran.status, ran.stdout.as_str()), (1, ""), "{arguments:?}: {}", ran.stderr);
        assert_eq!(errors(&ran).len(), 1, "{}", ran.stderr);
        assert!(errors(&ran)[0].contains(": cannot write: "), "{}", ran.stderr);
        assert_eq!(names(&work), before, "{arguments:?}");
        // the same with space
        assert_eq!(short_of_space(&work, 1 << 20, arguments).status, 0, "{arguments:?}");
        let more: Vec<String> = names(&work).into_iter().filter(|name| !before.contains(name)).collect();
        more.iter().for_each(|name| std::fs::remove_file(work.path(name)).unwrap());
    }
}

#[test]
fn an_older_image_survives_a_failed_one() {
    let work = Workplace::prepared();
    work.write("kept.exr", b"an older image");
    let relight = ["relight", "room.relume", "--rig", "rig.toml", "-o", "kept.exr"];
    assert_eq!(short_of_space(&work, 1, &relight).status, 1);
    assert_eq!(work.read("kept.exr"), b"an older image");
    assert_eq!(short_of_space(&work, 1 << 20, &relight).status, 0);
    assert_ne!(work.read("kept.exr"), b"an older image");
}

#[cfg(target_os = "linux")]
#[test]
fn results_that_cannot_be_told_fail_the_job() {
    let work = Workplace::new();
    let full = File::options().write(true).open("/dev/full").unwrap();
    let output = work.command(&["info", "room.gltf"]).stdout(full).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert_eq!(stderr.lines().filter(|line| line.starts_with("error: stdout: cannot write: ")).count(), 1);
    work.succeed(&["info", "room.gltf"]);
}

#[test]
fn a_folder_that_may_not_be_written_is_told_before_any_work() {
    use std::os::unix::fs::PermissionsExt;
    let work = Workplace::prepared();
    std::fs::create_dir(work.path("shut")).unwrap();
    let with_mode = |mode| {
        std::fs::set_permissions(work.path("shut"), std::fs::Permissions::from_mode(mode)).unwrap();
    };
    with_mode(0o555);
    if File::create(work.path("shut/probe")).is_ok() {
        println!("skipped: this user may write anywhere");
        return;
    }
    work.refused(&["prepare", "none.glb", "-o", "shut/a.relume"], 1, "shut/a.relume: cannot write");
    let relight = |output| ["relight", "room.relume", "--rig", "rig.toml", "-o", output];
    work.refused(&relight("shut/a.exr"), 1, "shut/a.exr: cannot write");
    assert_eq!(std::fs::read_dir(work.path("shut")).unwrap().count(), 0);
    with_mode(0o755);
    work.succeed(&relight("shut/a.exr"));
}
