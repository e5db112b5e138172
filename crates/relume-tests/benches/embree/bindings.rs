//! The few functions of Embree 3 that the comparison calls, and a safe face for them.
//!
//! Layouts and constants are those of Embree's `rtcore_ray.h` and `rtcore_common.h`, version 3.13, as distributions build it: one
//! level of instances, no `minWidthDistanceFactor`.
#![allow(unsafe_code, reason = "Embree is a C library")]

use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::ptr;

use relume::glam::Vec3;
use relume::trace::Ray;

/// Rays of a packet.
pub(crate) const PACKET: usize = 16;
/// What a geometry or primitive is called that there is not.
const NONE: u32 = u32::MAX;

/// `RTCRay`.
#[repr(C, align(16))]
#[derive(Clone, Copy)]
pub(crate) struct SingleRay {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    /// Minus infinity where something was found to lie on the ray.
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
}

/// `RTCHit`.
#[repr(C, align(16))]
#[derive(Clone, Copy)]
struct SingleHit {
    normal: [f32; 3],
    u: f32,
    v: f32,
    primitive: u32,
    geometry: u32,
    instance: u32,
}

/// `RTCRayHit`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct RayHit {
    ray: SingleRay,
    hit: SingleHit,
}

/// `RTCRay16`, with the lanes that are in use before it.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(crate) struct Packet {
    /// -1 for lanes in use.
    valid: [c_int; PACKET],
    rays: PacketRays,
}

#[repr(C, align(64))]
#[derive(Clone, Copy)]
struct PacketRays {
    origin: [[f32; PACKET]; 3],
    near: [f32; PACKET],
    direction: [[f32; PACKET]; 3],
    time: [f32; PACKET],
    far: [f32; PACKET],
    mask: [u32; PACKET],
    id: [u32; PACKET],
    flags: [u32; PACKET],
}

/// `RTCHit16`.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
struct PacketHits {
    normal: [[f32; PACKET]; 3],
    u: [f32; PACKET],
    v: [f32; PACKET],
    primitive: [u32; PACKET],
    geometry: [u32; PACKET],
    instance: [u32; PACKET],
}

/// `RTCRayHit16`, with the lanes that are in use before it.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(crate) struct PacketHit {
    valid: [c_int; PACKET],
    ray_hit: PacketRayHits,
}

#[repr(C, align(64))]
#[derive(Clone, Copy)]
struct PacketRayHits {
    rays: PacketRays,
    hits: PacketHits,
}

/// `RTCIntersectContext`.
#[repr(C)]
struct Context {
    /// 0 for incoherent rays, 1 for coherent ones.
    flags: c_int,
    filter: *const c_void,
    instance: c_uint,
}

impl Context {
    fn new(coherent: bool) -> Self {
        Self { flags: c_int::from(coherent), filter: ptr::null(), instance: NONE }
    }
}

type Handle = *mut c_void;

#[link(name = "embree3")]
unsafe extern "C" {
    fn rtcNewDevice(config: *const c_char) -> Handle;
    fn rtcReleaseDevice(device: Handle);
    fn rtcGetDeviceError(device: Handle) -> c_int;
    fn rtcGetDeviceProperty(device: Handle, property: c_int) -> isize;
    fn rtcNewScene(device: Handle) -> Handle;
    fn rtcReleaseScene(scene: Handle);
    fn rtcSetSceneBuildQuality(scene: Handle, quality: c_int);
    fn rtcSetSceneFlags(scene: Handle, flags: c_int);
    fn rtcCommitScene(scene: Handle);
    fn rtcNewGeometry(device: Handle, kind: c_int) -> Handle;
    fn rtcReleaseGeometry(geometry: Handle);
    fn rtcCommitGeometry(geometry: Handle);
    fn rtcAttachGeometry(scene: Handle, geometry: Handle) -> c_uint;
    fn rtcSetNewGeometryBuffer(
        geometry: Handle,
        kind: c_int,
        slot: c_uint,
        format: c_int,
        stride: usize,
        count: usize,
    ) -> *mut c_void;
    fn rtcIntersect1(scene: Handle, context: *mut Context, ray: *mut RayHit);
    fn rtcIntersect16(valid: *const c_int, scene: Handle, context: *mut Context, rays: *mut PacketRayHits);
    fn rtcOccluded1(scene: Handle, context: *mut Context, ray: *mut SingleRay);
    fn rtcOccluded16(valid: *const c_int, scene: Handle, context: *mut Context, rays: *mut PacketRays);
    fn rtcOccluded1M(
        scene: Handle,
        context: *mut Context,
        rays: *mut SingleRay,
        count: c_uint,
        stride: usize,
    );
}

impl SingleRay {
    fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.to_array(),
            near: ray.t_min,
            direction: ray.direction.to_array(),
            time: 0.0,
            far: ray.t_max,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
    }

    /// As Embree wants them.
    pub(crate) fn all(rays: &[Ray]) -> Vec<Self> {
        rays.iter().map(Self::new).collect()
    }

    /// Whether something lies on it, once it has been asked.
    pub(crate) fn is_blocked(&self) -> bool {
        self.far < 0.0
    }
}

impl RayHit {
    /// As Embree wants them.
    pub(crate) fn all(rays: &[Ray]) -> Vec<Self> {
        let hit =
            SingleHit { normal: [0.0; 3], u: 0.0, v: 0.0, primitive: NONE, geometry: NONE, instance: NONE };
        rays.iter().map(|ray| Self { ray: SingleRay::new(ray), hit }).collect()
    }

    /// How far away the hit is; infinite for a miss.
    pub(crate) fn distance(&self) -> f32 {
        if self.hit.geometry == NONE { f32::INFINITY } else { self.ray.far }
    }
}

impl PacketRays {
    fn new(rays: &[Ray]) -> ([c_int; PACKET], Self) {
        let zero = [0.0; PACKET];
        let mut packet = Self {
            origin: [zero; 3],
            near: zero,
            direction: [zero; 3],
            time: zero,
            far: zero,
            mask: [u32::MAX; PACKET],
            id: [0; PACKET],
            flags: [0; PACKET],
        };
        let mut valid = [0; PACKET];
        for (lane, ray) in rays.iter().enumerate().take(PACKET) {
            for axis in 0..3 {
                packet.origin[axis][lane] = ray.origin[axis];
                packet.direction[axis][lane] = ray.direction[axis];
            }
            (packet.near[lane], packet.far[lane]) = (ray.t_min, ray.t_max);
            valid[lane] = -1;
        }
        (valid, packet)
    }
}

/// What lanes that are in use say.
fn lanes<T>(valid: &[c_int; PACKET], says: impl Fn(usize) -> T) -> impl Iterator<Item = T> {
    (0..PACKET).filter(|&lane| valid[lane] != 0).map(says)
}

impl Packet {
    /// Each sixteen in a row together.
    pub(crate) fn all(rays: &[Ray]) -> Vec<Self> {
        let packet = |rays: &[Ray]| {
            let (valid, rays) = PacketRays::new(rays);
            Self { valid, rays }
        };
        rays.chunks(PACKET).map(packet).collect()
    }

    /// Whether something lies on each of its rays, once they have been asked.
    pub(crate) fn are_blocked(&self) -> impl Iterator<Item = bool> {
        lanes(&self.valid, |lane| self.rays.far[lane] < 0.0)
    }
}

impl PacketHit {
    /// Each sixteen in a row together.
    pub(crate) fn all(rays: &[Ray]) -> Vec<Self> {
        let zero = [0.0; PACKET];
        let none = [NONE; PACKET];
        let hits = PacketHits {
            normal: [zero; 3],
            u: zero,
            v: zero,
            primitive: none,
            geometry: none,
            instance: none,
        };
        let packet = |rays: &[Ray]| {
            let (valid, rays) = PacketRays::new(rays);
            Self { valid, ray_hit: PacketRayHits { rays, hits } }
        };
        rays.chunks(PACKET).map(packet).collect()
    }

    /// How far away the hit of each of its rays is; infinite for a miss.
    pub(crate) fn distances(&self) -> impl Iterator<Item = f32> {
        let PacketRayHits { rays, hits } = &self.ray_hit;
        lanes(&self.valid, |lane| if hits.geometry[lane] == NONE { f32::INFINITY } else { rays.far[lane] })
    }
}

/// Denormal numbers count as zero on this thread while it lives, as Embree's manual recommends. Nothing but Embree may run meanwhile.
struct FlushToZero {
    before: u32,
}

#[cfg(target_arch = "x86_64")]
impl FlushToZero {
    fn new() -> Self {
        let mut before = 0_u32;
        // SAFETY: stores the control register to a place that is there.
        unsafe { std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut before, options(nostack)) };
        Self::set(before | 0x8040);
        Self { before }
    }

    fn set(control: u32) {
        // SAFETY: the value is what was stored, but for two bits about denormal numbers; only Embree computes until it is set back.
        unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const control, options(nostack, readonly)) };
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl FlushToZero {
    fn new() -> Self {
        Self { before: 0 }
    }

    fn set(_: u32) {}
}

impl Drop for FlushToZero {
    fn drop(&mut self) {
        Self::set(self.before);
    }
}

/// Triangles as Embree has them.
pub(crate) struct EmbreeScene {
    device: Handle,
    scene: Handle,
}

// SAFETY: "the ray query functions are thread-safe" on a committed scene (Embree's manual), and no other function is called on it.
unsafe impl Sync for EmbreeScene {}

impl EmbreeScene {
    /// Built at Embree's highest quality. `robust` asks for tests that miss no edge, as ours do; without it Embree is at its fastest. The
    /// environment variable `EMBREE_CONFIG` holds what Embree's manual calls the configuration of a device, as `max_isa=avx2`.
    ///
    /// # Errors
    /// Embree's error number.
    pub(crate) fn new(positions: &[Vec3], triangles: &[[u32; 3]], robust: bool) -> Result<Self, String> {
        const TRIANGLES: c_int = 0;
        const INDICES: (c_int, c_int) = (0, 0x5003);
        const VERTICES: (c_int, c_int) = (1, 0x9003);
        const HIGH: c_int = 2;
        const ROBUST: c_int = 1 << 2;
        let config = std::env::var("EMBREE_CONFIG").unwrap_or_default();
        let config = CString::new(config).map_err(|error| format!("EMBREE_CONFIG: {error}"))?;
        // SAFETY: handles are used as they were made, the configuration ends in a zero, and the buffers are as long as was asked for: three numbers of four bytes an item.
        unsafe {
            let device = rtcNewDevice(config.as_ptr());
            if device.is_null() {
                return Err(format!("Embree gives no device: error {}", rtcGetDeviceError(ptr::null_mut())));
            }
            let scene = rtcNewScene(device);
            let built = Self { device, scene };
            rtcSetSceneBuildQuality(scene, HIGH);
            rtcSetSceneFlags(scene, if robust { ROBUST } else { 0 });
            let geometry = rtcNewGeometry(device, TRIANGLES);
            let buffer = |(kind, format): (c_int, c_int), count: usize| {
                rtcSetNewGeometryBuffer(geometry, kind, 0, format, 12, count)
            };
            let vertices = buffer(VERTICES, positions.len()).cast::<[f32; 3]>();
            let indices = buffer(INDICES, triangles.len()).cast::<[u32; 3]>();
            if vertices.is_null() || indices.is_null() {
                return Err(format!("Embree gives no memory: error {}", rtcGetDeviceError(device)));
            }
            for (index, position) in positions.iter().enumerate() {
                vertices.add(index).write(position.to_array());
            }
            ptr::copy_nonoverlapping(triangles.as_ptr(), indices, triangles.len());
            rtcCommitGeometry(geometry);
            rtcAttachGeometry(scene, geometry);
            rtcReleaseGeometry(geometry);
            rtcCommitScene(scene);
            match rtcGetDeviceError(device) {
                0 => Ok(built),
                error => Err(format!("Embree cannot build: error {error}")),
            }
        }
    }

    /// As `3.13.5`, and how many rays of a packet it takes natively at most.
    pub(crate) fn version(&self) -> (String, usize) {
        // SAFETY: asks a device that is there.
        let property = |number| unsafe { rtcGetDeviceProperty(self.device, number) };
        let natively = [(34, 16), (33, 8), (32, 4)].into_iter().find(|&(number, _)| property(number) != 0);
        let version = [1, 2, 3].map(|number| property(number).to_string()).join(".");
        (version, natively.map_or(1, |(_, rays)| rays))
    }

    /// First hits, ray by ray.
    pub(crate) fn closest(&self, rays: &mut [RayHit], coherent: bool) {
        let (_flush, mut context) = (FlushToZero::new(), Context::new(coherent));
        for ray in rays {
            // SAFETY: the scene is committed, and the ray is Embree's own layout, aligned.
            unsafe { rtcIntersect1(self.scene, &raw mut context, ray) };
        }
    }

    /// First hits, packet by packet.
    pub(crate) fn closest_packets(&self, packets: &mut [PacketHit]) {
        let (_flush, mut context) = (FlushToZero::new(), Context::new(true));
        for packet in packets {
            // SAFETY: as above; lanes that are not in use are marked.
            unsafe {
                rtcIntersect16(packet.valid.as_ptr(), self.scene, &raw mut context, &raw mut packet.ray_hit);
            }
        }
    }

    /// Whether anything lies on each ray, ray by ray.
    pub(crate) fn occluded(&self, rays: &mut [SingleRay], coherent: bool) {
        let (_flush, mut context) = (FlushToZero::new(), Context::new(coherent));
        for ray in rays {
            // SAFETY: as above.
            unsafe { rtcOccluded1(self.scene, &raw mut context, ray) };
        }
    }

    /// The same of a stream.
    pub(crate) fn occluded_stream(&self, rays: &mut [SingleRay]) {
        let (_flush, mut context) = (FlushToZero::new(), Context::new(true));
        let count = c_uint::try_from(rays.len()).unwrap_or(c_uint::MAX);
        // SAFETY: as above; there are at least so many rays, one after the other.
        unsafe {
            rtcOccluded1M(self.scene, &raw mut context, rays.as_mut_ptr(), count, size_of::<SingleRay>());
        }
    }

    /// The same packet by packet.
    pub(crate) fn occluded_packets(&self, packets: &mut [Packet]) {
        let (_flush, mut context) = (FlushToZero::new(), Context::new(true));
        for packet in packets {
            // SAFETY: as above; lanes that are not in use are marked.
            unsafe {
                rtcOccluded16(packet.valid.as_ptr(), self.scene, &raw mut context, &raw mut packet.rays);
            }
        }
    }
}

impl Drop for EmbreeScene {
    fn drop(&mut self) {
        // SAFETY: both are ours, and nothing uses them any more.
        unsafe {
            rtcReleaseScene(self.scene);
            rtcReleaseDevice(self.device);
        }
    }
}
