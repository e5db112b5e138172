//! The window on a real desktop: an X server in memory, software Vulkan, and a pointer that nobody holds.
//!
//! Skipped, by name, where there is no Xvfb; `RELUME_REQUIRE_GPU=1` makes that a failure. Its screenshots stay in `target/tmp`.
#![cfg(target_os = "linux")]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use relume_io::{load_rig, write_png};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConfigureWindowAux, ConnectionExt as _, ImageFormat, InputFocus};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

/// What the desktop refuses ends the test.
type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// Longest that anything may take: far more than it does.
const PATIENCE: Duration = Duration::from_secs(180);

/// Kinds of synthetic input, as the core protocol numbers events.
const KEY_PRESS: u8 = 2;
const KEY_RELEASE: u8 = 3;
const BUTTON_PRESS: u8 = 4;
const BUTTON_RELEASE: u8 = 5;
const MOTION: u8 = 6;
/// The symbol of the left Control key.
const CONTROL: u32 = 0xffe3;

/// An X server that draws into memory.
struct Desktop {
    server: Child,
    name: String,
    connection: RustConnection,
    root: u32,
    size: (u16, u16),
}

impl Drop for Desktop {
    fn drop(&mut self) {
        self.server.kill().and_then(|()| self.server.wait()).expect("the X server ends");
    }
}

impl Desktop {
    /// `None` where there is no Xvfb.
    fn start(size: (u16, u16)) -> Option<Self> {
        let screen = format!("{}x{}x24", size.0, size.1);
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", &screen, "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut number = String::new();
        BufReader::new(server.stdout.take()?).read_line(&mut number).expect("the number of the display");
        let name = format!(":{}", number.trim());
        let (connection, screen) = x11rb::connect(Some(&name)).expect("a connection");
        let root = connection.setup().roots[screen].root;
        Some(Self { server, name, connection, root, size })
    }

    fn input(&self, kind: u8, detail: u8, (x, y): (i16, i16)) -> Fallible<()> {
        self.connection.xtest_fake_input(kind, detail, 0, self.root, x, y, 0)?.check()?;
        // events at once would be one to the window
        std::thread::sleep(Duration::from_millis(25));
        Ok(())
    }

    fn drag(&self, from: (i16, i16), to: (i16, i16)) -> Fallible<()> {
        self.input(MOTION, 0, from)?;
        self.input(BUTTON_PRESS, 1, (0, 0))?;
        for step in 1..=12 {
            let at = |from: i16, to: i16| from + (to - from) * step / 12;
            self.input(MOTION, 0, (at(from.0, to.0), at(from.1, to.1)))?;
        }
        self.input(BUTTON_RELEASE, 1, (0, 0))
    }

    /// Presses a key by its symbol.
    fn key(&self, symbol: u32) -> Fallible<()> {
        let code = self.code(symbol)?;
        self.input(KEY_PRESS, code, (0, 0))?;
        self.input(KEY_RELEASE, code, (0, 0))
    }

    /// The same with Control held.
    fn control(&self, symbol: u32) -> Fallible<()> {
        let control = self.code(CONTROL)?;
        self.input(KEY_PRESS, control, (0, 0))?;
        self.key(symbol)?;
        self.input(KEY_RELEASE, control, (0, 0))
    }

    fn code(&self, symbol: u32) -> Fallible<u8> {
        let setup = self.connection.setup();
        let (first, last) = (setup.min_keycode, setup.max_keycode);
        let map = self.connection.get_keyboard_mapping(first, last - first + 1)?.reply()?;
        let a_key = usize::from(map.keysyms_per_keycode);
        let found = map.keysyms.chunks(a_key).position(|symbols| symbols.contains(&symbol));
        Ok(first + found.ok_or(format!("no key for the symbol {symbol:#x}"))? as u8)
    }

    /// Gives the keyboard and the whole screen to the largest window, as a window manager would.
    fn focus(&self) -> Fallible<()> {
        let mut largest = (0, 0);
        for window in self.connection.query_tree(self.root)?.reply()?.children {
            let size = self.connection.get_geometry(window)?.reply()?;
            largest = largest.max((u32::from(size.width) * u32::from(size.height), window));
        }
        let (_, window) = largest;
        self.connection.set_input_focus(InputFocus::POINTER_ROOT, window, x11rb::CURRENT_TIME)?.check()?;
        let whole = ConfigureWindowAux::new().width(u32::from(self.size.0)).height(u32::from(self.size.1));
        Ok(self.connection.configure_window(window, &whole)?.check()?)
    }

    /// What is on the screen.
    fn screenshot(&self) -> Fallible<Vec<[u8; 3]>> {
        let (width, height) = self.size;
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.root, 0, 0, width, height, !0)?;
        Ok(image.reply()?.data.chunks_exact(4).map(|bgrx| [bgrx[2], bgrx[1], bgrx[0]]).collect())
    }

    fn keep(&self, name: &str) -> Fallible<Vec<[u8; 3]>> {
        let pixels = self.screenshot()?;
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        write_png(path, self.size.0.into(), self.size.1.into(), &pixels)?;
        Ok(pixels)
    }
}

/// `relume view` at work, and the lines it says.
struct Window {
    child: Child,
    lines: Receiver<String>,
}

impl Window {
    fn open(desktop: &Desktop, folder: &Path) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_relume"))
            .args(["view", "arcade.glb", "--rig", "rig.toml", "--state", "state", "--times"])
            .args(["--size", "320x240", "--gather", "1024", "--quality", "draft"])
            .current_dir(folder)
            .env("DISPLAY", &desktop.name)
            .env_remove("WAYLAND_DISPLAY")
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts");
        let (sender, lines) = channel();
        let stderr = child.stderr.take().expect("stderr");
        std::thread::spawn(move || {
            BufReader::new(stderr).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        Self { child, lines }
    }

    /// Waits until it has said lines with all these beginnings, in any order: what is prepared already is so before it is seen.
    fn wait_for(&self, beginnings: &[&str]) {
        let end = Instant::now() + PATIENCE;
        let mut said: Vec<String> = Vec::new();
        while !beginnings.iter().all(|beginning| said.iter().any(|line| line.starts_with(beginning))) {
            let left = end.saturating_duration_since(Instant::now());
            let line = self.lines.recv_timeout(left);
            said.push(
                line.unwrap_or_else(|_| {
                    panic!("the window never said all of {beginnings:?}, but: {said:#?}")
                }),
            );
        }
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // where a check has failed before it was closed; else it has ended, and there is nothing to kill
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Share of pixels of the left half that differ clearly: a share of the picture, for the panels are on the right.
fn changed(before: &[[u8; 3]], after: &[[u8; 3]], width: usize) -> f64 {
    let differs = |(a, b): (&[u8; 3], &[u8; 3])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 12);
    let left = |pixels: &[[u8; 3]]| -> Vec<[u8; 3]> {
        pixels.chunks(width).flat_map(|row| &row[..width / 2]).copied().collect()
    };
    let (before, after) = (left(before), left(after));
    before.iter().zip(&after).filter(|&pair| differs(pair)).count() as f64 / before.len() as f64
}

fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets")
}

/// Waits until what is on the screen rests.
fn at_rest(desktop: &Desktop) -> Fallible<()> {
    let end = Instant::now() + PATIENCE;
    let (mut before, mut same) = (desktop.screenshot()?, 0);
    while same < 6 {
        assert!(Instant::now() < end, "the picture never rests");
        std::thread::sleep(Duration::from_millis(100));
        let now = desktop.screenshot()?;
        same = if now == before { same + 1 } else { 0 };
        before = now;
    }
    Ok(())
}

fn light_the_shot(folder: &Path, size: (u16, u16)) -> Fallible<()> {
    let name = format!("{}x{}", size.0, size.1);
    let Some(desktop) = Desktop::start(size) else {
        let required = std::env::var_os("RELUME_REQUIRE_GPU").is_some_and(|value| value == "1");
        assert!(!required, "no Xvfb, and RELUME_REQUIRE_GPU=1: install xvfb and mesa-vulkan-drivers");
        println!("skipped: no Xvfb");
        return Ok(());
    };
    for (from, to) in [("arcade.glb", "arcade.glb"), ("rigs/arcade.toml", "rig.toml")] {
        std::fs::copy(assets().join(from), folder.join(to))?;
    }
    let rig = load_rig(folder.join("rig.toml"))?;
    let mut window = Window::open(&desktop, folder);
    window.wait_for(&["first picture", "prepared"]);
    desktop.focus()?;
    at_rest(&desktop)?;
    let before = desktop.keep(&format!("window-{name}-opened.png"))?;
    assert!(changed(&before, &vec![[0; 3]; before.len()], size.0.into()) > 0.3, "the picture is black");

    // H: the sun, which is selected, goes to where its highlight is seen under the pointer
    desktop.input(MOTION, 0, (400, 400))?;
    desktop.key(0x68)?;
    desktop.drag((300, 420), (420, 520))?;
    desktop.key(0xff1b)?;
    desktop.input(MOTION, 0, (4, 4))?;
    at_rest(&desktop)?;
    let after = desktop.keep(&format!("window-{name}-dragged.png"))?;
    let share = changed(&before, &after, size.0.into());
    assert!(share > 0.02, "dragging the light changed {share} of the picture");

    desktop.control(0x73)?; // Ctrl+S
    let end = Instant::now() + PATIENCE;
    let saved = loop {
        let saved = load_rig(folder.join("rig.toml"))?;
        if saved != rig {
            break saved;
        }
        assert!(Instant::now() < end, "nothing was saved");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert_ne!(saved.lights[0], rig.lights[0]);
    assert_eq!(saved.lights[1..], rig.lights[1..]);

    desktop.control(0x71)?; // Ctrl+Q
    let end = Instant::now() + PATIENCE;
    let status = loop {
        if let Some(status) = window.child.try_wait()? {
            break status;
        }
        assert!(Instant::now() < end, "the window does not close");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(status.success(), "{status}");
    Ok(())
}

#[test]
fn a_light_is_dragged_on_a_desktop() -> Fallible<()> {
    let folder = tempfile::tempdir()?;
    light_the_shot(folder.path(), (1280, 720))?;
    // the second time it is prepared already
    light_the_shot(folder.path(), (1920, 1080))
}
