use glam::Vec3;
use relume::glam;
use relume::trace::sampling::*;
use relume::trace::*;
use std::time::Instant;
fn main() {
    let b = std::fs::read("/tmp/sponza.tri").unwrap();
    let f: Vec<f32> = b.chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect();
    let p: Vec<Vec3> = f.chunks_exact(3).map(|c| Vec3::new(c[0], c[1], c[2])).collect();
    let t: Vec<[u32; 3]> = (0..p.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let s = Instant::now();
    let a = Accel::from_triangles(&p, &t, AlphaMasks::default());
    println!("build {:?} {:?}", s.elapsed(), a.stats());
    let eye = Vec3::new(-9.5, 1.2, -0.3);
    let fwd = (Vec3::new(3., 3., 0.6) - eye).normalize();
    let right = fwd.cross(Vec3::Y).normalize();
    let up = right.cross(fwd);
    let mut rays = vec![];
    for ty in 0..60 {
        for tx in 0..80 {
            for y in 0..8 {
                for x in 0..8 {
                    let u = ((tx * 8 + x) as f32 - 320.) / 240. * 0.52;
                    let v = (240. - (ty * 8 + y) as f32) / 240. * 0.52;
                    rays.push(Ray::new(eye, (fwd + right * u + up * v).normalize()));
                }
            }
        }
    }
    let mut hits = vec![Hit::MISS; rays.len()];
    let s = Instant::now();
    for _ in 0..3 {
        a.closest_batch(&rays, &mut hits);
    }
    let e = s.elapsed().as_secs_f64();
    println!(
        "primary {:.2} M/s hit {}",
        3. * rays.len() as f64 / e / 1e6,
        hits.iter().filter(|h| h.is_hit()).count()
    );
    // incoherent anyhit: from hit points to random other hit points; hemisphere rays
    let pts: Vec<(Vec3, Vec3)> = rays
        .iter()
        .zip(&hits)
        .filter(|(_, h)| h.is_hit())
        .map(|(r, h)| {
            let [x, y, z] = t[h.triangle as usize].map(|i| p[i as usize]);
            let n = (y - x).cross(z - x).normalize_or(Vec3::Y);
            let n = if n.dot(r.direction) > 0. { -n } else { n };
            (r.origin + r.direction * h.t + n * 1e-3, n)
        })
        .collect();
    let mut r2 = vec![];
    for (i, (q, n)) in pts.iter().enumerate() {
        r2.push(Ray::new(*q, cosine_hemisphere(*n, sobol_2d(i as u32 % 4096, 0, hash(i as u32, 7)))));
    }
    let mut hh = vec![Hit::MISS; r2.len()];
    let s = Instant::now();
    for _ in 0..3 {
        a.closest_batch(&r2, &mut hh);
    }
    println!("hemisphere closest {:.2} M/s", 3. * r2.len() as f64 / s.elapsed().as_secs_f64() / 1e6);
    let r3: Vec<Ray> = (0..pts.len())
        .map(|i| {
            let j = (hash(i as u32, 3) as usize) % pts.len();
            Ray::between(pts[i].0, pts[j].0)
        })
        .collect();
    let mut b = vec![false; r3.len()];
    let s = Instant::now();
    for _ in 0..3 {
        a.occluded_batch(&r3, &mut b);
    }
    println!(
        "incoherent any {:.2} M/s blocked {}",
        3. * r3.len() as f64 / s.elapsed().as_secs_f64() / 1e6,
        b.iter().filter(|x| **x).count()
    );
    let l = Vec3::new(0., 6., 0.);
    let r4: Vec<Ray> = pts.iter().map(|q| Ray::between(q.0, l)).collect();
    let mut b = vec![false; r4.len()];
    let s = Instant::now();
    for _ in 0..3 {
        a.occluded_batch(&r4, &mut b);
    }
    println!(
        "shadow any {:.2} M/s blocked {}",
        3. * r4.len() as f64 / s.elapsed().as_secs_f64() / 1e6,
        b.iter().filter(|x| **x).count()
    );
    let r5: Vec<Ray> = (0..pts.len())
        .map(|i| {
            let l = pts[(hash(i as u32 / 16, 5) as usize) % pts.len()].0;
            Ray::between(pts[i].0, l)
        })
        .collect();
    let mut b = vec![false; r5.len()];
    let s = Instant::now();
    for _ in 0..3 {
        a.occluded_batch(&r5, &mut b);
    }
    println!(
        "coherent-16 any {:.2} M/s blocked {}",
        3. * r5.len() as f64 / s.elapsed().as_secs_f64() / 1e6,
        b.iter().filter(|x| **x).count()
    );
}
