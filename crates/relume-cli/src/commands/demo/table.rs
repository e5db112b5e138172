use relume::Transfer;
use relume::glam::DVec3;
use relume::image::{Image, Layers};
use relume::reference::Reference;

use crate::report::{Table, bytes, count, duration, percent};

/// What the demo measured.
pub(super) struct Figures {
    prepared: String,
    pub(super) spp: u32,
    pub(super) frames: Vec<Frame>,
}

/// What one frame took and how far it is from its truth.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Frame {
    relit_ms: f64,
    pub(super) traced_seconds: f64,
    full_error: f64,
    indirect_error: f64,
    full_noise: f64,
    indirect_noise: f64,
}

impl Figures {
    pub(super) fn new(transfer: &Transfer, seconds: f64) -> Self {
        let (width, height) = transfer.report.settings.size;
        let prepared = format!(
            "Prepared in {}: {width}x{height}, {} triangles, {} gather samples, {:.1} bytes a pixel ({})",
            duration(seconds),
            count(transfer.report.triangles),
            count(transfer.cloud.len() as u64),
            transfer.bytes_per_pixel(),
            bytes((transfer.gather.bytes() + transfer.bounce.bytes()) as u64),
        );
        Self { prepared, spp: 0, frames: Vec::new() }
    }
}

impl Frame {
    /// A frame that is yet to be traced and judged.
    pub(super) fn relit_in(relit_ms: f64) -> Self {
        Self { relit_ms, ..Self::default() }
    }

    /// Notes the errors of `relit` and the noise of its `truth`.
    pub(super) fn judge(&mut self, relit: &Layers, truth: &Reference) {
        let [a, b] = &truth.halves;
        self.full_error = error_without_noise(&relit.full(), &a.full(), &b.full());
        self.indirect_error = error_without_noise(&relit.indirect, &a.indirect, &b.indirect);
        self.full_noise = truth.noise.full;
        self.indirect_noise = truth.noise.indirect;
    }
}

/// Relative L2 against the mean of two images with independent noise, whose noise adds nothing to it: the product of
/// the differences to the one and to the other has the true squared difference as its mean.
fn error_without_noise(image: &Image, a: &Image, b: &Image) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for (color, (a, b)) in image.pixels.iter().zip(a.pixels.iter().zip(&b.pixels)) {
        let [color, a, b]: [DVec3; 3] = [color, a, b].map(|rgb| rgb.as_dvec3());
        error += (color - a).dot(color - b);
        norm += a.dot(b);
    }
    if error <= 0.0 { 0.0 } else { (error / norm).sqrt() }
}

impl std::fmt::Display for Figures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}\n", self.prepared)?;
        let mut table = Table::of_numbers(&[
            "frame",
            "relit in",
            "traced in",
            "error",
            "of indirect",
            "noise of truth",
            "of indirect",
        ]);
        for (number, frame) in (1..).zip(&self.frames) {
            table.row([
                number.to_string(),
                format!("{:.0} ms", frame.relit_ms),
                duration(frame.traced_seconds),
                percent(frame.full_error),
                percent(frame.indirect_error),
                percent(frame.full_noise),
                percent(frame.indirect_noise),
            ]);
        }
        write!(
            f,
            "{table}\n\nErrors are relative L2 against path tracing with {} paths a pixel, all bounces and reflections, \
             with the noise\nof the truth taken out by its two independent halves. Frame 1 relights every light, the \
             others the one that moved.",
            self.spp
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::glam::Vec3;

    #[test]
    fn noise_of_the_truth_is_no_error() {
        let of = |values: [f32; 4]| Image { width: 4, height: 1, pixels: values.map(Vec3::splat).to_vec() };
        // Noise of the two halves that is not correlated, around a truth of 1.
        let (a, b) = (of([1.2, 0.8, 1.2, 0.8]), of([1.2, 1.2, 0.8, 0.8]));
        assert!(error_without_noise(&of([1.0; 4]), &a, &b) < 1e-3);
        let off = error_without_noise(&of([1.1; 4]), &a, &b);
        assert!((off - 0.1).abs() < 1e-3, "{off}");
    }
}
