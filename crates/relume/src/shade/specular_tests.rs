//! Mirrors and panes against the laws of reflection and refraction.

use glam::Vec3;

use super::{Medium, SpecularEvent, ViewCone};
use crate::scene::Interior;
use crate::shade::Surface;

const GLASS: f32 = 1.5;

fn view(degrees: f32) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Vec3::new(sin, cos, 0.0)
}

fn glass(front: bool) -> Surface {
    Surface {
        specular_f0: Vec3::splat(0.04),
        specular_f90: 1.0,
        dielectric_specular: 1.0,
        dielectric_f0: 0.04,
        passing: 1.0,
        transmission: Vec3::ONE,
        interior: Interior::Solid { extinction: Vec3::new(0.0, 1.0, 2.0) },
        ior: GLASS,
        roughness: 0.03,
        front,
        lit: true,
        ..Surface::BLACK
    }
}

fn events(surface: &Surface, view: Vec3) -> Vec<SpecularEvent> {
    surface.specular_events(view).collect()
}

#[test]
fn light_is_bent_by_snells_law_and_comes_back_the_way_it_went() {
    for degrees in [0.0_f32, 20.0, 50.0, 80.0] {
        let [mirrored, passed] = events(&glass(true), view(degrees))[..] else { panic!("two ways on") };
        assert!((mirrored.direction - view(-degrees)).length() < 1e-6);
        let (sin, sin_within) = (degrees.to_radians().sin(), passed.direction.x);
        assert!((-sin_within * GLASS - sin).abs() < 1e-6, "{degrees}: {sin_within}");
        assert!((mirrored.weight + passed.weight - Vec3::ONE).length() < 1e-6, "nothing is lost");
        assert_eq!(passed.medium, Some(Medium { extinction: Vec3::new(0.0, 1.0, 2.0) }));
        // from within, seen against the direction just found; the normal is turned to the viewer
        let turned = |v: Vec3| Vec3::new(v.x, -v.y, v.z);
        let [back, out] = events(&glass(false), turned(passed.direction))[..] else { panic!("two ways out") };
        assert!((turned(out.direction) - view(degrees)).length() < 1e-5);
        assert!((back.weight - mirrored.weight).length() < 1e-5, "the same share from both sides");
        assert_eq!(out.medium, Some(Medium::default()));
    }
}

#[test]
fn beyond_the_critical_angle_all_light_is_reflected() {
    let critical = (1.0 / GLASS).asin().to_degrees();
    assert_eq!(events(&glass(false), view(critical - 1.0)).len(), 2);
    let [total] = events(&glass(false), view(critical + 1.0))[..] else { panic!("one way on") };
    assert_eq!((total.weight, total.medium), (Vec3::ONE, None));
    // frosted glass too keeps what cannot leave it
    let frosted = Surface { roughness: 0.4, ..glass(false) };
    assert_eq!(events(&frosted, view(critical + 1.0)), [total]);
}

#[test]
fn a_thin_pane_shows_what_is_straight_behind_it() {
    let pane = Surface { interior: Interior::Thin, transmission: Vec3::new(1.0, 0.5, 0.0), ..glass(true) };
    for front in [true, false] {
        let [mirrored, passed] = events(&Surface { front, ..pane }, view(60.0))[..] else { panic!("two") };
        let reflectance = 0.04 + 0.96 * 0.5_f32.powi(5);
        assert!((mirrored.weight - Vec3::splat(reflectance)).length() < 1e-6);
        assert_eq!((passed.direction, passed.medium, passed.bending), (-view(60.0), None, 0.0));
        assert!((passed.weight - pane.transmission * (1.0 - reflectance)).length() < 1e-6);
    }
    let frosted = Surface { roughness: 0.4, ..pane };
    assert_eq!(events(&frosted, view(60.0)).len(), 1, "its reflections are a lobe's");
}

#[test]
fn only_polished_surfaces_mirror() {
    let metal = Surface { transmission: Vec3::ZERO, specular_f0: Vec3::new(0.9, 0.7, 0.5), ..glass(true) };
    let [mirrored] = events(&metal, Vec3::Y)[..] else { panic!("one way on") };
    assert!((mirrored.weight - metal.specular_f0).length() < 1e-6);
    assert_eq!(events(&Surface { roughness: 0.1, ..metal }, Vec3::Y), []);
    assert_eq!(events(&Surface { specular_f90: 0.0, ..metal }, Vec3::Y), []);
    let between = Surface { roughness: 0.05, ..metal };
    let [part] = events(&between, Vec3::Y)[..] else { panic!("one way on") };
    let left = between.beside_events(Vec3::Y);
    assert!((part.weight + left.specular_f0 - metal.specular_f0).length() < 1e-5, "halves of the light");
    assert!((left.specular_f90 - 0.5).abs() < 1e-5, "{}", left.specular_f90);
    let varnished = Surface { diffuse_albedo: Vec3::ONE, transmission: Vec3::ZERO, ..glass(true) };
    let left = varnished.beside_events(Vec3::Y);
    assert_eq!((left.specular_f0, left.specular_f90), (Vec3::ZERO, 0.0));
    assert_eq!(left.diffuse(1.0), varnished.diffuse(1.0), "what is under the varnish stays");
}

#[test]
fn a_bent_normal_sends_no_view_into_the_surface() {
    let bent = Surface { shading_normal: Vec3::new(0.6, 0.8, 0.0), ..glass(true) };
    for degrees in [-30.0_f32, 0.0, 40.0, 85.0] {
        for event in bent.specular_events(view(degrees)) {
            let above = event.direction.y > 0.0;
            assert_eq!(above, event.medium.is_none(), "{degrees}: {event:?}");
        }
    }
}

#[test]
fn coloured_glass_is_darker_where_it_is_thicker() {
    let medium = Medium { extinction: Vec3::new(0.0, 1.0, 2.0) };
    let expected = Vec3::new(1.0, (-0.5_f32).exp(), (-1.0_f32).exp());
    assert!((medium.transmittance(0.5) - expected).length() < 1e-6);
    assert_eq!(Medium::default().transmittance(3.0), Vec3::ONE);
}

#[test]
fn a_curved_mirror_widens_the_view_and_a_pane_does_not() {
    let mirror = Surface { transmission: Vec3::ZERO, specular_f0: Vec3::ONE, ..glass(true) };
    let cone = ViewCone::new(1e-3, Vec3::NEG_Y);
    let after =
        |surface: &Surface, event: usize| cone.after(2.0, surface, Vec3::Y, &events(surface, Vec3::Y)[event]);
    let lobe = 2.0 * 0.03_f32.powi(2);
    let flat = after(&mirror, 0);
    assert!(flat.turned && (flat.width - 2e-3).abs() < 1e-9);
    assert!((flat.spread - 1e-3_f32.hypot(lobe)).abs() < 1e-7, "as wide as its lobe: {}", flat.spread);
    // a ball of 10 cm: 2 mm of it turn by 0.02, the view by 0.04
    let ball = after(&Surface { curvature: 10.0, ..mirror }, 0);
    assert!((ball.spread - 0.041).abs() < 1e-4, "{}", ball.spread);
    let pane = Surface { interior: Interior::Thin, curvature: 10.0, ..glass(true) };
    assert_eq!(after(&pane, 1), ViewCone { width: 2e-3, ..cone });
    let lens = after(&Surface { curvature: 10.0, ..glass(true) }, 1);
    assert!((lens.spread - 1e-3 - 0.02 / 3.0).abs() < 1e-4, "{}", lens.spread);
}

/// Through parallel faces the view goes on as it came: lights and sky show no more than they do straight.
#[test]
fn a_slab_does_not_turn_the_view_and_a_prism_does() {
    let enters = view(40.0);
    let cone = ViewCone::new(1e-3, -enters);
    let [_, within] = events(&glass(true), enters)[..] else { panic!("two ways on") };
    let inside = cone.after(1.0, &glass(true), enters, &within);
    assert!(inside.turned, "bent");
    let leaves = |tilt: f32| {
        let (sin, cos) = tilt.sin_cos();
        let back = Surface {
            geometric_normal: Vec3::new(sin, cos, 0.0),
            shading_normal: Vec3::new(sin, cos, 0.0),
            ..glass(false)
        };
        let out = events(&back, -within.direction)[1];
        inside.after(0.1, &back, -within.direction, &out).turned
    };
    assert!(!leaves(0.0) && leaves(0.1));
    let [mirrored, _] = events(&glass(true), Vec3::Y)[..] else { panic!("two ways on") };
    assert!(
        ViewCone::new(1e-3, Vec3::Y).after(1.0, &glass(true), Vec3::Y, &mirrored).turned,
        "a mirror always does"
    );
}

/// Whatever the surface, its side and the angle: no more light leaves towards the viewer than may arrive.
#[test]
fn no_light_is_made() {
    for (front, interior) in [(true, Interior::Thin), (false, Interior::Thin)]
        .into_iter()
        .chain([true, false].map(|front| (front, glass(true).interior)))
    {
        for roughness in [0.03, 0.05, 0.3, 1.0] {
            for passing in [0.0, 0.5, 1.0] {
                let surface = Surface {
                    front,
                    interior,
                    roughness,
                    passing,
                    transmission: Vec3::splat(passing),
                    diffuse_albedo: Vec3::splat(1.0 - passing),
                    ..glass(true)
                };
                for degrees in [0.0, 30.0, 45.0, 70.0, 85.0] {
                    let view = view(degrees);
                    let left = surface.beside_events(view);
                    let seen: Vec3 = surface.specular_events(view).map(|event| event.weight).sum();
                    let all = seen + left.diffuse(view.y) + left.specular_albedo(view.y);
                    assert!(
                        all.max_element() < 1.01,
                        "{front} {interior:?} {roughness} {passing} {degrees}: {all}"
                    );
                }
            }
        }
    }
}
