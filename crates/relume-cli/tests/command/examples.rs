//! Every command line that the help and the front page show runs as it stands in a fresh checkout, only smaller.

use crate::support::Workplace;

/// How command lines on the front page begin: both run the command.
const ON_THE_FRONT_PAGE: [&str; 2] = ["    relume ", "    cargo run --release -- "];
const IN_THE_HELP: [&str; 1] = ["  relume "];
/// Divides the sides of images. All are divided alike, so that images of two sizes stay of two sizes.
const SMALLER: usize = 16;
/// The size of an image where none is asked for.
const USUAL_SIZE: &str = "640x480";

/// The arguments of each command line in `text`: lines that begin with one of `beginnings`, without comments, each joined
/// with the lines that a `\` at the end carries it over to.
fn command_lines(text: &str, beginnings: &[&str]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let Some(rest) = beginnings.iter().find_map(|beginning| line.strip_prefix(beginning)) else {
            continue;
        };
        let mut command = rest.to_owned();
        while let Some(begun) = command.trim_end().strip_suffix('\\') {
            command = format!("{begun} {}", lines.next().unwrap_or_default());
        }
        let command = command.split(" #").next().unwrap_or_default();
        found.push(command.split_whitespace().map(str::to_owned).collect());
    }
    found
}

/// Gives `option` the `value`, in place of its own where it has one.
fn set(arguments: &mut Vec<String>, option: &str, value: String) {
    match arguments.iter().position(|argument| argument == option) {
        Some(place) => arguments[place + 1] = value,
        None => arguments.extend([option.to_owned(), value]),
    }
}

/// The same job on fewer pixels, points, paths and frames.
fn smaller(mut arguments: Vec<String>) -> Vec<String> {
    let size = arguments.iter().position(|argument| argument == "--size");
    let size = size.map_or(USUAL_SIZE, |place| arguments[place + 1].as_str());
    let (width, height) = size.split_once('x').unwrap();
    let side = |side: &str| (side.parse::<usize>().unwrap() / SMALLER).max(1);
    let size = format!("{}x{}", side(width), side(height));
    let options: &[(&str, &str)] = match arguments.first().map(String::as_str) {
        Some("prepare") => &[("--size", &size), ("--gather", "256"), ("--quality", "draft")],
        Some("reference") => &[("--size", &size), ("--spp", "2")],
        Some("bench") => &[("--frames", "1")],
        Some("relight") if arguments.iter().any(|argument| argument == "--animate") => {
            &[("--frames", "1..2")]
        }
        Some("demo") => &[("--size", &size), ("--gather", "1024"), ("--spp", "2")],
        _ => &[],
    };
    for (option, value) in options {
        set(&mut arguments, option, (*value).to_owned());
    }
    arguments
}

/// Runs one command line, smaller. `SCENE.glb` stands for a scene of the reader's own; this one stores a light.
///
/// # Errors
/// The command line and what it said, where it did not end well.
fn try_out(work: &Workplace, arguments: Vec<String>) -> Result<(), String> {
    let arguments: Vec<String> = smaller(arguments)
        .into_iter()
        .map(|argument| if argument == "SCENE.glb" { "own/room.gltf".to_owned() } else { argument })
        .collect();
    let ran = work.run(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    if ran.status == 0 { Ok(()) } else { Err(format!("relume {}: {}", arguments.join(" "), ran.stderr)) }
}

/// Runs the command lines in `text` in order in a fresh checkout; what failed, and how many there were.
fn try_all(text: &str, beginnings: &[&str]) -> (Vec<String>, usize) {
    let work = Workplace::checkout();
    let lines = command_lines(text, beginnings);
    let count = lines.len();
    // a window stays open until somebody closes it: `tests/desktop.rs` does
    let lines = lines.into_iter().filter(|arguments| arguments[0] != "view").collect::<Vec<_>>();
    (lines.into_iter().filter_map(|arguments| try_out(&work, arguments).err()).collect(), count)
}

/// Tries what the demo says to try next in `told`, in the folder in which it ran.
pub(crate) fn try_what_is_told(work: &Workplace, told: &str) {
    let program = env!("CARGO_BIN_EXE_relume");
    let told = told.lines().flat_map(|line| line.split(program).skip(1));
    let lines: Vec<Vec<String>> = told
        .map(|rest| rest.split_whitespace().take_while(|word| *word != "&&").map(str::to_owned).collect())
        .collect();
    let commands: Vec<&str> = lines.iter().map(|line| line[0].as_str()).collect();
    assert_eq!(commands, ["relight", "bench", "prepare", "info"]);
    for line in lines {
        try_out(work, line).unwrap_or_else(|failed| panic!("{failed}"));
    }
}

#[test]
fn every_example_of_the_help_runs_in_a_fresh_checkout() {
    let work = Workplace::new();
    for command in ["", "prepare", "relight", "reference", "compare", "bench", "info", "demo"] {
        let asked: Vec<&str> = [command, "--help"].into_iter().filter(|word| !word.is_empty()).collect();
        let (failed, count) = try_all(&work.succeed(&asked).stdout, &IN_THE_HELP);
        assert!(count > 0, "no example of relume {command}");
        assert!(failed.is_empty(), "{}", failed.join("\n"));
    }
}

#[test]
fn every_command_of_the_front_page_runs_in_a_fresh_checkout() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../README.md");
    let (failed, count) = try_all(&std::fs::read_to_string(page).unwrap(), &ON_THE_FRONT_PAGE);
    assert!(count >= 11, "{count}");
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn examples_that_do_not_work_are_found() {
    let page = "
  relume info not-in-the-checkout.glb
  relume reference assets/arcade.glb --rig assets/rigs/arcade.toml -o large.exr --spp 1
  relume reference assets/arcade.glb --rig assets/rigs/arcade.toml -o small.exr --spp 1 --size 320x240
  relume compare large.exr small.exr
  relume info SCENE.glb --rig lights.toml
  relume info assets/arcade.glb --no-such-option";
    let (failed, count) = try_all(page, &IN_THE_HELP);
    assert_eq!((failed.len(), count), (3, 6), "{}", failed.join("\n"));
    for (failed, part) in
        failed.iter().zip(["cannot read", "40x30 and the reference 20x15", "--no-such-option"])
    {
        assert!(failed.contains(part), "{failed}");
    }
}

#[test]
fn command_lines_are_read_as_a_shell_reads_them() {
    let page =
        "Text, relume prepare\n  relume a b  # why\n  relume c \\\n      d \\\n  --e f\n\trelume g\nrelume h";
    assert_eq!(command_lines(page, &IN_THE_HELP), [vec!["a", "b"], vec!["c", "d", "--e", "f"]]);
    let page =
        "    relume a\n    cargo run --release -- b\n    cargo xtask test\n    cargo run --release -- \\\n c";
    assert_eq!(command_lines(page, &ON_THE_FRONT_PAGE), [["a"], ["b"], ["c"]]);
}
