//! The window in which a shot is lit.
//!
//! [`run`] opens it. It holds no lighting of its own: a shot is prepared by [`relume::transfer::Preparing`] and relit by a [`relume::Relighter`], each on
//! threads of their own, and what comes of it is shown. The window waits for none of them: workers read their orders from mailboxes in which the newest
//! order takes the place of those before it.
//!
//! | module | what |
//! |---|---|
//! | `app` | the window: who is told what, and when; its layout |
//! | `shot` | opening and preparing a scene, or a cache |
//! | `worker`, `mailbox` | threads that do the newest order and give up older ones |
//! | `lighting`, `develop`, `truth`, `through` | the workers: relit frames, display pixels, path tracing, what a light sees |
//! | `document`, `history`, `autosave` | the rig that is edited, undo and redo, what is kept of unsaved edits |
//! | `picture` | zoom, wipe, handles of lights, tools that place them |
//! | `panels` | the list of lights, their fields, surfaces, histogram, status |
//! | `view`, `command`, `dialog`, `preferences`, `messages`, `wording` | what is shown, keys, files, what is remembered, what is said |

mod app;
mod autosave;
mod command;
mod develop;
mod dialog;
mod document;
mod export;
mod history;
mod lighting;
mod mailbox;
mod messages;
mod panels;
mod picture;
mod preferences;
mod shot;
mod through;
mod truth;
mod view;
mod wording;
mod worker;

pub use app::{Options, Pane, Viewer};
pub use dialog::Dialogs;
pub use shot::Source;

use eframe::egui;
use relume::{Error, Result};

/// Name under which the desktop knows the program, and its settings are kept.
const APP: &str = "relume";

/// The folder in which settings and unsaved edits are kept, where the system has one.
pub fn state_folder() -> Option<std::path::PathBuf> {
    eframe::storage_dir(APP)
}

/// Opens the window, and returns once it is closed. Must be called on the main thread.
///
/// # Errors
/// What is wrong with the rig; [`Error::Io`] where no window can be opened.
pub fn run(options: Options) -> Result<()> {
    let viewport = egui::ViewportBuilder::default()
        .with_title("Relume")
        .with_app_id(APP)
        .with_inner_size([1280.0, 800.0])
        .with_min_inner_size([640.0, 400.0])
        .with_drag_and_drop(true);
    // without dithering the screen shows the very values that the picture was developed to
    let native = eframe::NativeOptions {
        viewport,
        dithering: false,
        persistence_path: options.state.as_ref().map(|state| state.join("window.ron")),
        ..eframe::NativeOptions::default()
    };
    // told here, and not once there is a window
    let document = options.rig.as_deref().map(document::Document::open).transpose()?;
    let mut refused = None;
    let create =
        |context: &eframe::CreationContext<'_>| match Viewer::with_document(context, options, document) {
            Ok(viewer) => Ok(Box::new(viewer) as Box<dyn eframe::App>),
            Err(error) => {
                let text = error.to_string();
                refused = Some(error);
                Err(text.into())
            }
        };
    let closed = eframe::run_native("Relume", native, Box::new(create));
    match (closed, refused) {
        (_, Some(error)) => Err(error),
        (Err(error), None) => Err(Error::io("a window", "open", std::io::Error::other(why(&error)))),
        (Ok(()), None) => Ok(()),
    }
}

/// Why there is no window, and the mend.
fn why(error: &eframe::Error) -> String {
    match error {
        // its own words name a file of the sources
        eframe::Error::WinitEventLoop(_) => {
            "there is no desktop to open it on; run it where DISPLAY or WAYLAND_DISPLAY names one".to_owned()
        }
        eframe::Error::Wgpu(error) => {
            format!(
                "nothing can draw it ({error}); install a Vulkan driver, such as Mesa's mesa-vulkan-drivers"
            )
        }
        other => other.to_string(),
    }
}
