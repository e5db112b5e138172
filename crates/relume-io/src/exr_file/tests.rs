use std::path::PathBuf;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Layer, LayerAttributes, Vec2, WritableImage,
};
use relume::glam::Vec3;
use relume::image::Layers;

use super::*;

const SIZE: (usize, usize) = (37, 21);

fn image(color: impl Fn(f32, f32) -> Vec3) -> Image {
    let (width, height) = SIZE;
    let pixels = (0..width * height).map(|i| color((i % width) as f32, (i / width) as f32)).collect();
    Image { width, height, pixels }
}

fn layers() -> Layers {
    let direct = image(|x, y| Vec3::new(x * 0.01, y * 0.03, 0.2));
    let indirect = image(|x, y| Vec3::new(y, 1.0, x) * 0.007);
    let light = |name: &str, factor: f32| LightLayers {
        name: name.to_owned(),
        direct: image(|x, _| Vec3::splat(x * factor)),
        indirect: image(|_, y| Vec3::splat(y * factor)),
    };
    Layers {
        direct,
        indirect,
        per_light: vec![light("key", 0.5), light("key.left", 0.25)],
        edges: (0..SIZE.0 * SIZE.1).map(|i| i % 5 == 0).collect(),
        noise: Some(image(|x, y| Vec3::splat(x * y * 1e-4))),
    }
}

fn meta(precision: Precision) -> ExrMeta {
    let attributes = vec![
        ("spp".to_owned(), Attribute::Number(256.0)),
        ("relume:rig".to_owned(), Attribute::Text("abendröte.toml".to_owned())),
        ("bounces".to_owned(), Attribute::Number(4.0)),
    ];
    ExrMeta { precision, attributes }
}

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("frame.exr")
    }

    /// What `layers` come back as.
    fn round_trip(&self, layers: &Layers, precision: Precision) -> ExrImage {
        write_exr(self.path(), layers, &meta(precision)).unwrap();
        read_exr(self.path()).unwrap()
    }
}

fn largest_difference(a: &Image, b: &Image) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    a.pixels.iter().zip(&b.pixels).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max)
}

#[test]
fn floats_come_back_bit_for_bit() {
    let (layers, place) = (layers(), Place::new());
    let read = place.round_trip(&layers, Precision::Float);
    assert_eq!(read.image, layers.full());
    assert_eq!(read.direct.as_ref(), Some(&layers.direct));
    assert_eq!(read.indirect.as_ref(), Some(&layers.indirect));
    assert_ne!(read.direct, read.indirect);
    assert_eq!(read.noise, layers.noise);
    assert_eq!(read.edges, Some(layers.edges));
    let names: Vec<_> = read.per_light.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["key", "key_left"]);
    for (read, written) in read.per_light.iter().zip(&layers.per_light) {
        assert_eq!(read.direct, written.direct);
        assert_eq!(read.indirect, written.indirect);
    }
}

#[test]
fn halves_come_back_within_half_a_step() {
    let (layers, place) = (layers(), Place::new());
    let read = place.round_trip(&layers, Precision::Half);
    // Values are below 2, where a step of a half is 2^-10.
    let difference = largest_difference(&read.image, &layers.full());
    assert!(difference > 0.0 && difference <= 0.5 / 1024.0, "{difference}");
    assert_eq!(read.edges, Some(layers.edges));
}

#[test]
fn attributes_come_back_with_the_software() {
    let read = Place::new().round_trip(&layers(), Precision::Half);
    let mut expected = meta(Precision::Half).attributes;
    let software = concat!("Relume ", env!("CARGO_PKG_VERSION")).to_owned();
    expected.push(("software".to_owned(), Attribute::Text(software)));
    expected.sort_by(|a, b| a.0.cmp(&b.0));
    assert_eq!(read.attributes, expected);
}

#[test]
fn layers_that_are_not_there_are_not_written() {
    let (place, mut layers) = (Place::new(), layers());
    layers.per_light.clear();
    layers.edges.clear();
    layers.noise = None;
    let read = place.round_trip(&layers, Precision::Half);
    assert!(read.per_light.is_empty() && read.edges.is_none() && read.noise.is_none());
    write_exr_image(place.path(), &layers.direct, &ExrMeta::default()).unwrap();
    let read = read_exr(place.path()).unwrap();
    assert!(read.direct.is_none() && read.indirect.is_none());
    assert!(largest_difference(&read.image, &layers.direct) < 1e-3);
}

#[test]
fn the_same_frame_gives_the_same_bytes() {
    let (place, layers) = (Place::new(), layers());
    let mut bytes = (0..8).map(|_| {
        write_exr(place.path(), &layers, &meta(Precision::Half)).unwrap();
        std::fs::read(place.path()).unwrap()
    });
    let first = bytes.next().unwrap();
    assert!(bytes.all(|again| again == first));
    let mut other = layers.clone();
    other.direct.pixels[100].x += 0.5;
    write_exr(place.path(), &other, &meta(Precision::Half)).unwrap();
    assert_ne!(std::fs::read(place.path()).unwrap(), first);
}

#[test]
fn values_beyond_a_half_are_clamped_and_those_that_are_none_refused() {
    let (place, mut layers) = (Place::new(), layers());
    layers.direct.pixels[3] = Vec3::new(1e9, -1e9, 65_510.0);
    let read = place.round_trip(&layers, Precision::Half);
    assert_eq!(read.direct.unwrap().pixels[3], Vec3::new(65_504.0, -65_504.0, 65_504.0));
    let before = std::fs::read(place.path()).unwrap();
    for bad in [f32::NAN, f32::INFINITY] {
        layers.indirect.pixels[2 * SIZE.0 + 5].y = bad;
        let error = write_exr(place.path(), &layers, &meta(Precision::Half)).unwrap_err().to_string();
        assert!(error.starts_with("layer `indirect` has the value ["), "{error}");
        assert!(error.ends_with("at column 5, row 2; it was not written"), "{error}");
    }
    assert_eq!(std::fs::read(place.path()).unwrap(), before);
}

#[test]
fn what_cannot_be_written_is_told() {
    let place = Place::new();
    let told = |change: &dyn Fn(&mut Layers, &mut ExrMeta)| {
        let (mut layers, mut meta) = (layers(), meta(Precision::Half));
        change(&mut layers, &mut meta);
        write_exr(place.path(), &layers, &meta).unwrap_err().to_string()
    };
    assert!(
        told(&|layers, _| layers.indirect = Image::new(2, 2))
            .contains("`indirect` is 2x2 with 4 pixels in a frame of 37x21")
    );
    assert!(told(&|layers, _| layers.edges.truncate(3)).contains("3 edge marks"));
    let name = |name: &str, meta: &mut ExrMeta| meta.attributes[0].0 = name.to_owned();
    assert!(told(&|_, meta| name("bounces", meta)).contains("`bounces` is given twice"));
    assert!(told(&|_, meta| name("software", meta)).contains("cannot name an EXR attribute"));
    assert!(told(&|_, meta| name("", meta)).contains("cannot name an EXR attribute"));
    assert!(told(&|_, meta| name("dataWindow", meta)).contains("reserved"));
    let empty = write_exr(place.path(), &Layers::default(), &ExrMeta::default()).unwrap_err();
    assert!(empty.to_string().contains("0x0"), "{empty}");
    assert!(!place.path().exists());
    let missing = place.0.path().join("no/frame.exr");
    let error = write_exr(missing, &layers(), &ExrMeta::default()).unwrap_err().to_string();
    assert!(error.contains("does not exist; create it"), "{error}");
}

#[test]
fn a_file_cut_short_anywhere_is_refused() {
    let place = Place::new();
    write_exr(place.path(), &layers(), &meta(Precision::Half)).unwrap();
    let whole = std::fs::read(place.path()).unwrap();
    for length in (0..whole.len()).step_by(7).chain(whole.len() - 20..whole.len()) {
        std::fs::write(place.path(), &whole[..length]).unwrap();
        let error = read_exr(place.path()).map(|_| ()).expect_err(&format!("{length} of {}", whole.len()));
        let told = error.to_string();
        assert!(
            error.is_bad_input() && told.contains("frame.exr: is ") && !told.contains('\n'),
            "{length}: {told}"
        );
    }
}

#[test]
fn an_altered_header_neither_panics_nor_fills_the_memory() {
    let place = Place::new();
    write_exr(place.path(), &layers(), &meta(Precision::Half)).unwrap();
    let whole = std::fs::read(place.path()).unwrap();
    let window = whole.windows(10).position(|name| name == b"dataWindow").unwrap() + 10 + 1 + 6 + 4;
    let mut huge = whole.clone();
    huge[window + 8..window + 16].copy_from_slice(&[0xff, 0xff, 0x0f, 0, 0xff, 0xff, 0x0f, 0]);
    std::fs::write(place.path(), &huge).unwrap();
    let error = read_exr(place.path()).map(|_| ()).unwrap_err();
    assert!(error.is_bad_input(), "{error}");
    // Every byte of the header in turn: an error or an image, but an end.
    for at in 0..whole.len().min(1500) {
        let mut altered = whole.clone();
        altered[at] ^= 0x41;
        std::fs::write(place.path(), &altered).unwrap();
        let _ = read_exr(place.path());
    }
}

/// An EXR as other programs write them: two named parts, three sample types.
#[test]
fn reads_other_programs_files() {
    let place = Place::new();
    let channel = |name: &str, samples| AnyChannel::new(name, samples);
    let part = |name: &str, list: Vec<AnyChannel<FlatSamples>>| {
        let attributes = LayerAttributes::named(name);
        Layer::new((2, 1), attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(list.into()))
    };
    let beauty = vec![
        channel("R", FlatSamples::F32(vec![0.25, 2.0])),
        channel("G", FlatSamples::U32(vec![3, 4])),
        channel("B", FlatSamples::F16(vec![half::f16::ONE, half::f16::ZERO])),
    ];
    let direct = ["R", "G", "B"].map(|name| channel(name, FlatSamples::F32(vec![0.5, 1.5]))).to_vec();
    let attributes = exr::prelude::ImageAttributes::with_size((2, 1));
    let parts = vec![part("beauty", beauty), part("direct", direct)];
    exr::prelude::Image::from_layers(attributes, parts).write().to_file(place.path()).unwrap();
    let read = read_exr(place.path()).unwrap();
    assert_eq!(read.image.pixels, [Vec3::new(0.25, 3.0, 1.0), Vec3::new(2.0, 4.0, 0.0)]);
    assert_eq!(read.direct.unwrap().pixels, [Vec3::splat(0.5), Vec3::splat(1.5)]);
    assert!(read.indirect.is_none());

    let grey = AnyChannels::sort(vec![channel("Y", FlatSamples::F32(vec![1.0, 2.0]))].into());
    exr::prelude::Image::from_channels(Vec2(2, 1), grey).write().to_file(place.path()).unwrap();
    let error = read_exr(place.path()).map(|_| ()).unwrap_err().to_string();
    assert!(error.ends_with("has no channels R, G and B in one part (it has Y); save it as RGB"), "{error}");
}
