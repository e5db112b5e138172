//! The kernels against brute force.

use glam::{Vec2, Vec3};
use obvhs::triangle::Triangle;

use super::{WideBvh, intersect};
use crate::scene::Wrap;
use crate::trace::sampling::{hash, sobol_2d, uniform_sphere, unit};
use crate::trace::{Accel, AlphaMask, AlphaMasks, Hit, Ray};

/// Brute force over all triangles in `f64`: the twin of the kernels.
fn closest_brute_force(corners: &[[Vec3; 3]], masks: &AlphaMasks, ray: &Ray) -> Hit {
    let mut nearest = Hit { t: ray.t_max, ..Hit::MISS };
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    for (triangle, corner) in corners.iter().enumerate() {
        let [a, b, c] = corner.map(|p| p.as_dvec3());
        let (edge1, edge2) = (b - a, c - a);
        let p = direction.cross(edge2);
        let inverse = 1.0 / edge1.dot(p);
        let s = origin - a;
        let u = s.dot(p) * inverse;
        let q = s.cross(edge1);
        let v = direction.dot(q) * inverse;
        let t = edge2.dot(q) * inverse;
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > f64::from(ray.t_min);
        if inside && t < f64::from(nearest.t) && masks.is_solid(triangle as u32, u as f32, v as f32) {
            nearest = Hit { t: t as f32, u: u as f32, v: v as f32, triangle: triangle as u32 };
        }
    }
    if nearest.is_hit() { nearest } else { Hit::MISS }
}

fn random_point(index: u32, seed: u32) -> Vec3 {
    Vec3::new(unit(hash(3 * index, seed)), unit(hash(3 * index + 1, seed)), unit(hash(3 * index + 2, seed)))
}

/// A soup of triangles in the unit cube, half of them masked by a checkerboard.
fn soup(count: u32) -> (Vec<Vec3>, Vec<[u32; 3]>, AlphaMasks) {
    let mut positions = Vec::new();
    for triangle in 0..count {
        let centre = random_point(triangle, 1);
        for corner in 0..3 {
            positions.push(centre + 0.2 * (random_point(3 * triangle + corner, 2) - 0.5));
        }
    }
    let triangles: Vec<_> = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let masked: Vec<u32> = (0..count).filter(|i| i % 2 == 0).collect();
    let mask = AlphaMask {
        width: 2,
        height: 2,
        alpha: vec![0, 255, 255, 0],
        wrap: [Wrap::Repeat; 2],
        cutoff: 127.5,
    };
    let masks = AlphaMasks {
        masks: vec![mask],
        mask_ids: vec![0; masked.len()],
        uvs: vec![[Vec2::ZERO, Vec2::new(2.0, 0.0), Vec2::new(0.0, 2.0)]; masked.len()],
        triangles: masked,
    };
    (positions, triangles, masks)
}

fn soup_rays(count: u32) -> Vec<Ray> {
    (0..count).map(|i| Ray::new(random_point(i, 3) * 1.4 - 0.2, uniform_sphere(sobol_2d(i, 0, 4)))).collect()
}

#[test]
fn closest_hits_equal_brute_force() {
    let (positions, triangles, masks) = soup(6000);
    let accel = Accel::from_triangles(&positions, &triangles, masks.clone());
    let corners: Vec<_> = triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
    let rays = soup_rays(2000);
    let mut hits = vec![Hit::MISS; rays.len()];
    accel.closest_batch(&rays, &mut hits);
    let (mut found, mut unlike) = (0, 0);
    for (ray, hit) in rays.iter().zip(&hits) {
        let expected = closest_brute_force(&corners, &masks, ray);
        found += usize::from(expected.is_hit());
        let same = hit.triangle == expected.triangle
            && (!hit.is_hit() || (hit.t - expected.t).abs() < 1e-4 * expected.t.max(0.1));
        unlike += usize::from(!same);
    }
    assert!(found > 1000, "the soup must be dense enough to test anything: {found} hits");
    assert!(unlike <= 2, "{unlike} of {} rays differ; f32 may lose a ray or two along an edge", rays.len());
    // the same comparison must notice masks that are left out
    let solid = Accel::from_triangles(&positions, &triangles, AlphaMasks::default());
    solid.closest_batch(&rays, &mut hits);
    let unmasked = rays
        .iter()
        .zip(&hits)
        .filter(|(ray, hit)| hit.triangle != closest_brute_force(&corners, &masks, ray).triangle)
        .count();
    assert!(unmasked > 100, "only {unmasked} rays see the difference");
}

#[test]
fn occlusion_equals_closest_hit_within_the_segment() {
    let (positions, triangles, masks) = soup(6000);
    let accel = Accel::from_triangles(&positions, &triangles, masks);
    let end = |i| random_point(i, 8).lerp(random_point(i, 9), 0.25);
    let rays: Vec<Ray> = (0..4000).map(|i| Ray::between(random_point(i, 8), end(i))).collect();
    let mut blocked = vec![false; rays.len()];
    accel.occluded_batch(&rays, &mut blocked);
    let count = blocked.iter().filter(|&&b| b).count();
    assert!((1000..3900).contains(&count), "{count} blocked: too few or too many to test anything");
    for (ray, &blocked) in rays.iter().zip(&blocked) {
        assert_eq!(accel.closest(ray).is_hit(), blocked, "{ray:?}");
        assert_eq!(accel.occluded(ray), blocked, "{ray:?}");
    }
}

/// Rays in company must be answered as alone, to the last bit: towards a light among the triangles, near and far, and along an axis,
/// from origins as near to each other as samples of a pixel and so far apart that no packet holds them.
#[test]
fn shadow_rays_in_packets_are_answered_as_alone() {
    let (positions, triangles, masks) = soup(300);
    let accel = Accel::from_triangles(&positions, &triangles, masks);
    let lights = [Vec3::splat(0.5), Vec3::new(0.3, 2.0, 0.4), Vec3::new(40.0, 90.0, -20.0)];
    for spread in [0.001, 0.03, 0.3, 3.0] {
        let origin = |i| random_point(i / 64, 11) + spread * (random_point(i, 12) - 0.5);
        let towards = lights.iter().flat_map(|light| (0..1024).map(|i| Ray::between(origin(i), *light)));
        let down = (0..1024).map(|i| Ray::new(origin(i), Vec3::new(0.0, -1.0, -0.0)));
        let rays: Vec<Ray> = towards.chain(down).collect();
        let mut blocked = vec![false; rays.len()];
        accel.occluded_batch(&rays, &mut blocked);
        let alone: Vec<bool> = rays.iter().map(|ray| accel.occluded(ray)).collect();
        assert_eq!(blocked, alone, "spread {spread}");
        let count = alone.iter().filter(|&&blocked| blocked).count();
        assert!((200..3800).contains(&count), "{count} blocked: too few or too many to test anything");
    }
}

/// What blocked a packet is asked first by the next one: no wider than it would be found by a ray alone, which passes its box before. This ray passes
/// beside a large triangle, so close that the triangle's own test lets it in and its box does not.
#[test]
fn what_blocked_others_blocks_no_ray_that_it_would_not_block_alone() {
    let positions = [[-10.0, -10.0], [10.0, -10.0], [-10.0, 10.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let accel = Accel::from_triangles(&positions, &[[0, 1, 2]], AlphaMasks::default());
    let down = |x: f32| Ray::new(Vec3::new(x, 1.0, -3.0), Vec3::NEG_Y);
    let beside = -10.0 - 1.5e-5;
    for x in [-10.01, -10.00003, beside, -10.00001, -10.0] {
        let rays: Vec<Ray> = (0..16).map(|_| down(-5.0)).chain((0..16).map(|_| down(x))).collect();
        let mut blocked = vec![false; 32];
        accel.occluded_batch(&rays, &mut blocked);
        assert_eq!(blocked[..16], [true; 16]);
        assert_eq!(blocked[16..], [accel.occluded(&down(x)); 16], "{x}");
    }
    assert!(!accel.occluded(&down(beside)) && accel.occluded(&down(-10.0)));
    let [v0, v1, v2] = positions.map(Into::into);
    let bvh = WideBvh::new(&[Triangle { v0, v1, v2 }], &AlphaMasks::default());
    let (_, _, _, by_itself) = intersect(&bvh.blocks[0], &down(beside), f32::INFINITY);
    assert_eq!(by_itself, 1, "the triangle lets it in");
}

/// Rays along the axes, with zeros of both signs, from points whose coordinates lie on box faces.
#[test]
fn axis_aligned_rays_hit_the_floor() {
    let positions: Vec<Vec3> =
        (0..=8).flat_map(|z| (0..=8).map(move |x| Vec3::new(x as f32, 0.0, z as f32))).collect();
    let mut triangles = Vec::new();
    for z in 0..8_u32 {
        for x in 0..8 {
            let a = z * 9 + x;
            triangles.push([a, a + 9, a + 1]);
            triangles.push([a + 1, a + 9, a + 10]);
        }
    }
    let accel = Accel::from_triangles(&positions, &triangles, AlphaMasks::default());
    for z in 0..=16 {
        for x in 0..=16 {
            for (zero_x, zero_z) in [(0.0, 0.0), (-0.0, 0.0), (0.0, -0.0), (-0.0, -0.0)] {
                let origin = Vec3::new(0.5 * x as f32, 3.0, 0.5 * z as f32);
                let hit = accel.closest(&Ray::new(origin, Vec3::new(zero_x, -1.0, zero_z)));
                assert!((hit.t - 3.0).abs() < 1e-5, "missed the floor at {origin}: {hit:?}");
            }
        }
    }
}

#[test]
fn empty_and_degenerate_geometry_is_missed() {
    let accel = Accel::from_triangles(&[], &[], AlphaMasks::default());
    let ray = Ray::new(Vec3::ZERO, Vec3::X);
    assert!(!accel.closest(&ray).is_hit() && !accel.occluded(&ray));
    let point = [Vec3::new(1.0, 0.0, 0.0)];
    let accel = Accel::from_triangles(&point, &[[0, 0, 0]; 9], AlphaMasks::default());
    assert!(!accel.closest(&ray).is_hit() && !accel.occluded(&ray));
}
