//! Colours of surfaces as smooth functions of position. No feature is finer than [`FINEST`].

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3};

/// Smallest feature in metres: about two pixels at five metres for the built-in cameras.
const FINEST: f64 = 0.08;

/// A colour, RGB in `[0, 1]`.
pub(super) type Rgb = [f32; 3];

/// The colour pattern of a surface, in the solid's own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Texture {
    /// One colour.
    Plain(Rgb),
    /// Clouds of two colours; `scale` is the size of a cloud.
    Clouds { colours: [Rgb; 2], scale: f64, seed: u32 },
    /// Bands across z of the given period.
    Bands { colours: [Rgb; 2], period: f64, seed: u32 },
    /// Squares on each face.
    Checks { colours: [Rgb; 2], period: f64 },
    /// Gores around z, as on a beach ball.
    Gores { colours: [Rgb; 3] },
    /// Three pairs of faces in three colours, each with a ring in a fourth.
    Faces { colours: [Rgb; 3], ring: Rgb, size: f64 },
    /// Rings around z.
    Rings { colours: [Rgb; 2], period: f64, seed: u32 },
    /// Trousers, a striped jersey and a head, by height from the middle.
    Clothes { jersey: [Rgb; 2], trousers: Rgb, waist: f64 },
    /// Planks below, panelled walls around, a light ceiling; `half` is half the room's size.
    Interior { half: DVec3, seed: u32 },
    /// A sun over hills, on the face that looks along -y.
    Painting { half: DVec2, seed: u32 },
}

impl Texture {
    /// The colour at a point of the surface with the given normal.
    pub(super) fn at(&self, point: DVec3, normal: DVec3) -> Vec3 {
        match *self {
            Texture::Plain(colour) => colour.into(),
            Texture::Clouds { colours: [a, b], scale, seed } => mix(a, b, clouds(point / scale, seed)),
            Texture::Bands { colours: [a, b], period, seed } => {
                let colour = mix(a, b, wave(point.z, period));
                colour * grain(point, seed)
            }
            Texture::Checks { colours: [a, b], period } => {
                let uv = on_face(point, normal);
                let (u, v) = (2.0 * wave(uv.x, period) - 1.0, 2.0 * wave(uv.y, period) - 1.0);
                mix(a, b, 0.5 + 0.5 * u * v)
            }
            Texture::Gores { colours } => gores(point, colours),
            Texture::Faces { colours, ring, size } => {
                let axis = (0..3).find(|&i| normal[i].abs() > 0.5).unwrap_or(0);
                let radius = on_face(point, normal).length();
                let on_ring = bump(radius, 0.55 * size, 0.22 * size);
                Vec3::from(colours[axis]).lerp(ring.into(), on_ring)
            }
            Texture::Rings { colours: [a, b], period, seed } => {
                mix(a, b, wave(point.truncate().length(), period)) * grain(point, seed)
            }
            Texture::Clothes { jersey: [a, b], trousers, waist } => {
                let colour = mix(a, b, wave(point.z, 0.22));
                let torso = step(point.z, waist);
                Vec3::from(trousers).lerp(colour, torso) * (0.9 + 0.1 * (3.0 * point.x.atan2(point.y)).sin() as f32)
            }
            Texture::Interior { half, seed } => interior(point, normal, half, seed),
            Texture::Painting { half, seed } => painting(DVec2::new(point.x, point.z) / half, seed),
        }
    }
}

fn interior(point: DVec3, normal: DVec3, half: DVec3, seed: u32) -> Vec3 {
    let up = point.z + half.z;
    if normal.z > 0.5 {
        let plank = (point.x / 0.5).floor();
        let tone = 0.85 + 0.3 * scramble(spread(plank as i32, 0) ^ seed);
        let seam = 1.0 - 0.35 * bump(point.x - 0.5 * (point.x / 0.5).round(), 0.0, FINEST / 2.0);
        let wood = clouds(DVec3::new(point.x / 0.25, point.y / 1.0, plank), seed);
        return mix([0.44, 0.29, 0.18], [0.60, 0.42, 0.27], wood) * tone * seam;
    }
    if normal.z < -0.5 {
        return mix([0.82, 0.80, 0.74], [0.92, 0.90, 0.86], clouds(point, seed));
    }
    let (along, wall): (f64, [Rgb; 2]) = if normal.y.abs() > 0.5 {
        (point.x, [[0.54, 0.66, 0.69], [0.76, 0.78, 0.71]])
    } else if normal.x > 0.0 {
        (point.y, [[0.80, 0.62, 0.34], [0.88, 0.76, 0.52]])
    } else {
        (point.y, [[0.42, 0.56, 0.40], [0.64, 0.74, 0.54]])
    };
    let above = step(up, 0.85);
    let paper = || mix(wall[0], wall[1], wave(along, 0.8)) * (0.9 + 0.2 * clouds(point / 0.45, seed ^ 1));
    let panel = || mix([0.22, 0.26, 0.35], [0.32, 0.38, 0.48], clouds(point / 0.3, seed ^ 2));
    let wall = match above {
        0.0 => panel(),
        1.0 => paper(),
        _ => panel().lerp(paper(), above),
    };
    wall.lerp(BOARD, bump(up, 0.85, 0.07)).lerp(BOARD * 0.3, 1.0 - step(up, 0.12))
}

/// Colour of the rail along the walls.
const BOARD: Vec3 = Vec3::splat(0.86);

fn painting(at: DVec2, seed: u32) -> Vec3 {
    let sky = mix([0.98, 0.72, 0.42], [0.25, 0.42, 0.78], (0.5 + 0.5 * at.y) as f32);
    let sun = bump((at - DVec2::new(0.35, 0.25)).length(), 0.0, 0.32);
    let hills = step(-0.15 + 0.25 * (3.0 * at.x + f64::from(seed % 7)).sin() - at.y, 0.0);
    let land = mix([0.10, 0.30, 0.16], [0.35, 0.50, 0.20], clouds(DVec3::new(at.x * 3.0, at.y * 3.0, 0.0), seed));
    let frame = step(at.x.abs().max(at.y.abs()), 0.86);
    sky.lerp(Vec3::new(1.0, 0.95, 0.7), sun).lerp(land, hills).lerp(Vec3::new(0.22, 0.12, 0.06), frame)
}

fn gores(point: DVec3, colours: [Rgb; 3]) -> Vec3 {
    let angle = point.y.atan2(point.x) / TAU * 6.0;
    let radius = point.length();
    // Half the width of a blurred edge, in gores: FINEST on the equator, wider towards the poles.
    let blur = (FINEST / 2.0 * 6.0 / (TAU * point.truncate().length().max(0.05 * radius))).min(0.5);
    let (index, within) = (angle.floor(), angle - angle.floor());
    let colour = |i: f64| Vec3::from(colours[(i as i64).rem_euclid(3) as usize]);
    let here = colour(index);
    let before = colour(index - 1.0).lerp(here, smooth((within / blur) as f32 * 0.5 + 0.5));
    let edge = if within < blur { before } else { here };
    let after = smooth(((within - 1.0) / blur) as f32 * 0.5 + 0.5);
    let body = if within > 1.0 - blur { here.lerp(colour(index + 1.0), after) } else { edge };
    body.lerp(Vec3::splat(0.95), bump(radius - point.z.abs(), 0.0, 0.12 * radius))
}

fn mix(a: Rgb, b: Rgb, share: f32) -> Vec3 {
    Vec3::from(a).lerp(b.into(), share)
}

fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// 0 below `edge`, 1 above it, blurred over [`FINEST`].
fn step(x: f64, edge: f64) -> f32 {
    smooth(((x - edge) / FINEST) as f32 + 0.5)
}

/// 1 at `middle`, decreasing to 0 at a distance of `width`.
fn bump(x: f64, middle: f64, width: f64) -> f32 {
    smooth((1.5 - 1.5 * (x - middle).abs() / width.max(FINEST)) as f32)
}

/// A wave between 0 and 1 with flat tops: stripes with soft edges.
fn wave(x: f64, period: f64) -> f32 {
    smooth((0.5 + 0.9 * (TAU * x / period).sin()) as f32)
}

/// The two coordinates along the face with this normal.
fn on_face(point: DVec3, normal: DVec3) -> DVec2 {
    let n = normal.abs();
    if n.x > n.y && n.x > n.z {
        DVec2::new(point.y, point.z)
    } else if n.y > n.z {
        DVec2::new(point.x, point.z)
    } else {
        DVec2::new(point.x, point.y)
    }
}

/// Small variations around one. Without them some surfaces look printed.
fn grain(point: DVec3, seed: u32) -> f32 {
    0.85 + 0.3 * clouds(point / 0.25, seed)
}

/// Two octaves of smooth noise, between 0 and 1.
fn clouds(p: DVec3, seed: u32) -> f32 {
    let sum = 0.7 * noise(p, seed) + 0.3 * noise(2.1 * p + DVec3::splat(PI), seed ^ 0x9e37);
    smooth(sum * 1.4 - 0.2)
}

/// Value noise on the integer lattice, between 0 and 1. Rendering spends most of its time here.
fn noise(p: DVec3, seed: u32) -> f32 {
    let cell = [floor(p.x), floor(p.y), floor(p.z)];
    let f = Vec3::from_array([0, 1, 2].map(|i| (p[i] - f64::from(cell[i])) as f32));
    let f = f * f * (Vec3::splat(3.0) - 2.0 * f);
    // Each coordinate is spread over 32 bits once, for both of its lattice points.
    let [x, y, z] = [0, 1, 2].map(|i| [0, 1].map(|d: i32| spread(cell[i].wrapping_add(d), i)));
    let at = |i: usize, j: usize, k: usize| scramble(x[i] ^ y[j] ^ z[k] ^ seed.wrapping_mul(SPREAD[3]));
    let line = |j, k| at(0, j, k) + (at(1, j, k) - at(0, j, k)) * f.x;
    let plane = |k| line(0, k) + (line(1, k) - line(0, k)) * f.y;
    plane(0) + (plane(1) - plane(0)) * f.z
}

/// Odd numbers with well-mixed bits, for the three coordinates and the seed.
const SPREAD: [u32; 4] = [0x9e37_79b1, 0x85eb_ca77, 0xc2b2_ae3d, 0x27d4_eb2f];

fn spread(coordinate: i32, axis: usize) -> u32 {
    (coordinate as u32).wrapping_mul(SPREAD[axis])
}

/// A pseudo-random number between 0 and 1 for this argument.
fn scramble(mut h: u32) -> f32 {
    h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
    h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
    (h >> 8) as f32 / (1u32 << 24) as f32
}

/// The largest integer below `x`. `f64::floor` is a slow call unless the processor's own instruction may be used.
fn floor(x: f64) -> i32 {
    let whole = x as i32;
    whole - i32::from(f64::from(whole) > x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_and_stays_between_zero_and_one() {
        let mut last = noise(DVec3::new(-2.0, 0.3, 0.7), 5);
        for i in 1..4000 {
            let value = noise(DVec3::new(-2.0 + 0.001 * f64::from(i), 0.3, 0.7), 5);
            // The steepest slope of the interpolation is 1.5 per cell.
            assert!((0.0..=1.0).contains(&value) && (value - last).abs() < 0.002, "{value} after {last}");
            last = value;
        }
    }

    #[test]
    fn gores_meet_without_a_jump() {
        let gore = Texture::Gores { colours: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };
        let at = |angle: f64| gore.at(0.4 * DVec3::new(angle.cos(), angle.sin(), 0.0), DVec3::X);
        let mut last = at(0.0);
        for i in 1..=2000 {
            let colour = at(TAU * f64::from(i) / 2000.0);
            assert!((colour - last).abs().max_element() < 0.05, "{i}: {colour} after {last}");
            last = colour;
        }
    }
}
