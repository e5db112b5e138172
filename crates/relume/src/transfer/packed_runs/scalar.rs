//! The sums for every processor: the twin that the others are compared with.

use super::{LANES, Product, RUN, Runs, run_bytes};

/// The values of a run of at most 8 bits each.
#[inline(always)]
fn few<const WIDTH: usize>(bytes: &[u8]) -> [f32; RUN] {
    let bytes = &bytes[..WIDTH * RUN / 8];
    let mut words = [0_u32; LANES];
    for byte in 0..WIDTH / 2 {
        for lane in 0..LANES {
            words[lane] |= u32::from(bytes[byte * LANES + lane]) << (8 * byte);
        }
    }
    if WIDTH % 2 == 1 {
        let (high, up) = (&bytes[WIDTH / 2 * LANES..], 4 * (WIDTH - 1));
        for lane in 0..LANES / 2 {
            words[lane] |= u32::from(high[lane] & 15) << up;
            words[lane + LANES / 2] |= u32::from(high[lane] >> 4) << up;
        }
    }
    let mut values = [0.0; RUN];
    for (value, values) in values.chunks_exact_mut(LANES).enumerate() {
        let up = 32 - WIDTH * (value + 1);
        for lane in 0..LANES {
            values[lane] = ((words[lane] << up) as i32 >> (32 - WIDTH)) as f32;
        }
    }
    values
}

/// The values of a run of 16 bits each.
#[inline(always)]
fn wide(bytes: &[u8]) -> [f32; RUN] {
    let mut values = [0.0; RUN];
    for (value, bytes) in values.iter_mut().zip(bytes.chunks_exact(2)) {
        *value = f32::from(i16::from_le_bytes([bytes[0], bytes[1]]));
    }
    values
}

/// Calls `each` with the number and the values of every run but those of zeros.
#[inline(always)]
pub(super) fn for_runs(runs: Runs<'_>, mut each: impl FnMut(usize, &[f32; RUN])) {
    let mut rest = runs.bytes;
    for (run, &width) in runs.widths.iter().enumerate() {
        let (bytes, after) = rest.split_at(run_bytes(width));
        rest = after;
        let values = match width {
            1 => few::<1>(bytes),
            2 => few::<2>(bytes),
            3 => few::<3>(bytes),
            4 => few::<4>(bytes),
            5 => few::<5>(bytes),
            6 => few::<6>(bytes),
            7 => few::<7>(bytes),
            8 => few::<8>(bytes),
            16 => wide(bytes),
            _ => continue,
        };
        each(run, &values);
    }
}

/// See [`Product::add`].
pub(super) fn add(product: Product<'_>, light: [&[f32]; 3], bright: &[bool], mut sums: [&mut [f32]; 3]) {
    let Product { mut v, v_scales, mut u, u_scales } = product;
    let runs = sums[0].len() / RUN;
    for (&v_scale, &u_scale) in v_scales.iter().zip(u_scales) {
        let mut y = [0.0; 3];
        for_runs(v.take(bright.len()), |run, q| {
            if bright[run] {
                for (y, light) in y.iter_mut().zip(light) {
                    *y += dot(q, &light[run * RUN..][..RUN]);
                }
            }
        });
        let y = y.map(|y| y * v_scale * u_scale);
        for_runs(u.take(runs), |run, q| {
            for (sums, y) in sums.iter_mut().zip(y) {
                let sums = &mut sums[run * RUN..][..RUN];
                for place in 0..RUN {
                    sums[place] += q[place] * y;
                }
            }
        });
    }
}

#[inline(always)]
fn dot(q: &[f32; RUN], x: &[f32]) -> f32 {
    let mut sums = [0.0_f32; LANES];
    for (q, x) in q.chunks_exact(LANES).zip(x.chunks_exact(LANES)) {
        for lane in 0..LANES {
            sums[lane] += q[lane] * x[lane];
        }
    }
    sums.iter().sum()
}
