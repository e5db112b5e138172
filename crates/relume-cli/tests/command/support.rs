use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};
use tempfile::TempDir;

/// Arguments that make a preparation short.
pub(crate) const SMALL: [&str; 6] = ["--size", "32x24", "--gather", "1024", "--quality", "draft"];

pub(crate) const RIG: &str = r#"
[[light]]
name = "key"
type = "spot"
position = [1.0, 2.5, 1.0]
target = [-1.0, 0.5, -1.0]
intensity = [20.0, 18.0, 15.0]
inner_angle = 20.0
outer_angle = 35.0

[[light]]
name = "fill"
type = "omni"
position = [1.5, 1.5, 1.5]
intensity = [1.0, 1.0, 2.0]
"#;

/// What a run of the command gave back.
pub(crate) struct Ran {
    pub(crate) status: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// A folder with a room, a rig, and nothing else.
pub(crate) struct Workplace(TempDir);

impl Workplace {
    pub(crate) fn new() -> Self {
        let workplace = Self(tempfile::tempdir().unwrap());
        workplace.write("room.gltf", room().to_string().as_bytes());
        workplace.write("room.bin", &room_buffer());
        workplace.write("rig.toml", RIG.as_bytes());
        workplace
    }

    /// The same with `room.relume` prepared.
    pub(crate) fn prepared() -> Self {
        let workplace = Self::new();
        workplace.succeed(&[&["prepare", "room.gltf"][..], &SMALL].concat());
        workplace
    }

    /// What a fresh checkout holds beside its sources, and in `own` the room, as a scene of the user's own.
    pub(crate) fn checkout() -> Self {
        let workplace = Self(tempfile::tempdir().unwrap());
        copy_folder(&shared(""), &workplace.path("assets"));
        std::fs::create_dir(workplace.path("own")).unwrap();
        workplace.write("own/room.gltf", room().to_string().as_bytes());
        workplace.write("own/room.bin", &room_buffer());
        workplace
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relume"));
        command.current_dir(self.0.path()).args(arguments);
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Ran {
        let output = self.command(arguments).output().unwrap();
        let ran = Ran {
            status: output.status.code().unwrap_or(-1),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        };
        assert!(!ran.stderr.contains("panicked"), "{arguments:?}: {}", ran.stderr);
        ran
    }

    pub(crate) fn succeed(&self, arguments: &[&str]) -> Ran {
        let ran = self.run(arguments);
        assert_eq!(ran.status, 0, "{arguments:?}: {}", ran.stderr);
        ran
    }

    /// Runs with `--json`; stdout must be one object and nothing else, and have all `keys`.
    pub(crate) fn json(&self, arguments: &[&str], keys: &[&str]) -> Value {
        let ran = self.succeed(&[arguments, &["--json"]].concat());
        let value: Value = serde_json::from_str(&ran.stdout).unwrap();
        let object = value.as_object().unwrap();
        for key in keys {
            assert!(object.contains_key(*key), "{arguments:?}: no `{key}` in {}", ran.stdout);
        }
        value
    }

    /// Runs what must be refused with `status` and one sentence that holds `part`.
    pub(crate) fn refused(&self, arguments: &[&str], status: i32, part: &str) {
        let ran = self.run(arguments);
        assert_eq!(ran.status, status, "{arguments:?}: {}", ran.stderr);
        assert_eq!(ran.stdout, "", "{arguments:?}");
        let told: Vec<&str> = ran.stderr.lines().filter(|line| line.starts_with("error: ")).collect();
        assert_eq!(told.len(), 1, "{arguments:?}: {}", ran.stderr);
        assert!(told[0].contains(part), "{arguments:?}: `{}` does not say `{part}`", told[0]);
        assert!(!self.has_temporary_files(), "{arguments:?} leaves a temporary file");
    }

    fn has_temporary_files(&self) -> bool {
        let mut entries = std::fs::read_dir(self.0.path()).unwrap();
        entries.any(|entry| entry.unwrap().file_name().to_string_lossy().starts_with(".relume-"))
    }
}

/// The numbers of `object` at each of `keys`, all finite and not negative.
pub(crate) fn numbers(object: &Value, keys: &[&str]) -> Vec<f64> {
    keys.iter()
        .map(|key| {
            let number = object[*key].as_f64().unwrap_or_else(|| panic!("`{key}` is no number: {object}"));
            assert!(number >= 0.0, "`{key}` is {number}");
            number
        })
        .collect()
}

/// Floor, back wall and a red wall to the left, 4 metres each way.
const CORNERS: [[[f32; 3]; 4]; 3] = [
    [[-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0], [-2.0, 0.0, -2.0]],
    [[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 3.0, -2.0], [-2.0, 3.0, -2.0]],
    [[-2.0, 0.0, 2.0], [-2.0, 0.0, -2.0], [-2.0, 3.0, -2.0], [-2.0, 3.0, 2.0]],
];

fn room_buffer() -> Vec<u8> {
    let positions = CORNERS.as_flattened().as_flattened().iter().flat_map(|value| value.to_le_bytes());
    let indices = [0_u16, 1, 2, 0, 2, 3].into_iter().flat_map(u16::to_le_bytes);
    positions.chain(indices).collect()
}

fn room() -> Value {
    let quad = |corners: &[[f32; 3]; 4], number: usize| {
        let along = |axis: usize| corners.iter().map(move |corner| corner[axis]);
        let low: Vec<f32> = (0..3).map(|axis| along(axis).fold(f32::INFINITY, f32::min)).collect();
        let high: Vec<f32> = (0..3).map(|axis| along(axis).fold(f32::NEG_INFINITY, f32::max)).collect();
        json!({"bufferView": 0, "byteOffset": 48 * number, "componentType": 5126, "count": 4, "type": "VEC3",
               "min": low, "max": high})
    };
    let mut accessors: Vec<Value> =
        CORNERS.iter().enumerate().map(|(number, corners)| quad(corners, number)).collect();
    accessors.push(json!({"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}));
    let mesh = |quad: usize, material: usize| json!({"primitives": [{"attributes": {"POSITION": quad}, "indices": 3, "material": material}]});
    let matte = |color: [f32; 4]| {
        json!({"pbrMetallicRoughness": {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 1.0},
               "doubleSided": true})
    };
    json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [
            {"name": "lamp", "type": "point", "color": [1.0, 0.5, 0.25], "intensity": 8.0}
        ]}},
        "buffers": [{"uri": "room.bin", "byteLength": 156}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 144},
            {"buffer": 0, "byteOffset": 144, "byteLength": 12}
        ],
        "accessors": accessors,
        "materials": [matte([0.7, 0.7, 0.7, 1.0]), matte([0.7, 0.1, 0.1, 1.0])],
        "meshes": [mesh(0, 0), mesh(1, 0), mesh(2, 1)],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
        "nodes": [
            {"mesh": 0}, {"mesh": 1}, {"mesh": 2},
            {"name": "front", "camera": 0, "translation": [0.3, 1.3, 4.5]},
            {"name": "close", "camera": 0, "translation": [0.0, 1.3, 1.0]},
            {"name": "lamp", "translation": [0.0, 2.0, 0.0], "extensions": {"KHR_lights_punctual": {"light": 0}}}
        ],
        "scenes": [{"nodes": [0, 1, 2, 3, 4, 5]}],
        "scene": 0
    })
}

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_folder(&entry.path(), &to);
        } else {
            std::fs::copy(entry.path(), to).unwrap();
        }
    }
}

/// A file as another program wrote it.
pub(crate) fn shared(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets").join(name)
}
