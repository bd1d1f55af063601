//! Moving objects of the built-in scenes and their poses at each moment.

use std::f64::consts::TAU;

use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::solid::{Pose, Shape, Solid};
use super::stage::ROOM_HALF;
use super::texture::{Rgb, Texture};

/// Fraction of a circle that the tumbling block flies during the video. Per frame, it moves by a fifth of its size.
/// This is fast for 24 frames, but a few hundred training steps can learn it.
const LAPS: f64 = 0.4;
/// Turns of the block about its own axis during the video.
const TURNS: f64 = 0.6;
/// Hops of the block during the video.
const HOPS: f64 = 1.0;
/// Largest angle of the lamp from the vertical, radians. It moves the lamp by two centimetres, less than a pixel.
const LAMP_SWAY: f64 = 0.018;
/// Times at which the visitor of the video enters and leaves.
const VISIT: (f64, f64) = (0.30, 0.72);
/// Random streams. Each part of a scene has its own, so its draws do not depend on the others.
const STREAM_LINGERERS: u64 = 1;
const STREAM_PHOTOS: u64 = 16;

/// Jerseys of the people.
const JERSEYS: [[Rgb; 2]; 5] = [
    [[0.85, 0.15, 0.20], [0.95, 0.85, 0.80]],
    [[0.10, 0.25, 0.60], [0.60, 0.80, 0.95]],
    [[0.95, 0.75, 0.10], [0.30, 0.25, 0.20]],
    [[0.15, 0.50, 0.25], [0.85, 0.95, 0.75]],
    [[0.50, 0.15, 0.55], [0.95, 0.65, 0.80]],
];
const TROUSERS: [Rgb; 3] = [[0.12, 0.13, 0.22], [0.35, 0.28, 0.18], [0.20, 0.20, 0.20]];
const SKIN: [Rgb; 3] = [[0.93, 0.74, 0.60], [0.62, 0.42, 0.30], [0.36, 0.23, 0.16]];

/// Places on the floor without furniture.
const SPOTS: [DVec2; 6] = [
    DVec2::new(-1.3, -0.3),
    DVec2::new(-0.6, 0.9),
    DVec2::new(0.2, -0.9),
    DVec2::new(0.9, 0.5),
    DVec2::new(1.4, -0.7),
    DVec2::new(-0.2, 0.2),
];

/// An object that moves, at one moment.
#[derive(Clone, Debug)]
pub struct MovingObject {
    /// Name within the scene: `block`, `lamp`, `visitor`, `person 2`, `toy`, …
    pub name: String,
    /// Its position and orientation.
    pub pose: Pose,
    /// Radius of a sphere around the pose's position that contains the object, metres.
    pub reach: f64,
    pub(super) solids: Vec<Solid>,
}

impl MovingObject {
    /// An object made of parts. Their poses are given in the object's own coordinates.
    pub(super) fn new(name: impl Into<String>, pose: Pose, parts: Vec<Solid>) -> Self {
        let reach = parts.iter().map(|p| p.pose.position.length() + p.reach()).fold(0.0, f64::max);
        let solids = parts.into_iter().map(|p| Solid::new(p.shape, p.texture, pose.of_part(&p.pose))).collect();
        Self { name: name.into(), pose, reach, solids }
    }
}

/// The moving objects of the video at a time in `[0, 1]`. A block flies in an arc and tumbles, and a lamp barely sways.
/// A visitor walks in from the right, stands and leaves.
pub(super) fn in_video(time: f64) -> Vec<MovingObject> {
    let mut objects = vec![block(time), lamp(time)];
    if (VISIT.0..=VISIT.1).contains(&time) {
        objects.push(visitor((time - VISIT.0) / (VISIT.1 - VISIT.0)));
    }
    objects
}

fn block(time: f64) -> MovingObject {
    let angle = TAU * LAPS * time - 0.6;
    let position = DVec3::new(1.1 * angle.cos(), -0.25 + 0.85 * angle.sin(), 1.15 + 0.35 * (TAU * HOPS * time).sin());
    let rotation = DQuat::from_axis_angle(DVec3::new(0.35, 0.25, 0.9).normalize(), TAU * TURNS * time);
    let size = 0.31;
    let texture = Texture::Faces {
        colours: [[0.90, 0.25, 0.18], [0.16, 0.60, 0.30], [0.20, 0.32, 0.78]],
        ring: [0.97, 0.95, 0.85],
        size,
    };
    let part = Solid::new(Shape::Block { half: DVec3::splat(size) }, texture, Pose::at(0.0, 0.0, 0.0));
    MovingObject::new("block", Pose { position, rotation }, vec![part])
}

/// A lamp; its origin is its hook in the ceiling.
fn lamp(time: f64) -> MovingObject {
    let rotation = DQuat::from_rotation_y(LAMP_SWAY * (TAU * 1.5 * time).sin());
    let cord = Solid::new(
        Shape::Cylinder { radius: 0.035, half_height: 0.35 },
        Texture::Plain([0.15, 0.13, 0.12]),
        Pose::at(0.0, 0.0, -0.35),
    );
    let globe = Texture::Bands { colours: [[0.95, 0.55, 0.20], [0.98, 0.88, 0.55]], period: 0.36, seed: 3 };
    let globe = Solid::new(Shape::Sphere { radius: 0.40 }, globe, Pose::at(0.0, 0.0, -1.05));
    MovingObject::new("lamp", Pose { position: DVec3::new(1.0, 1.0, 2.0 * ROOM_HALF.z), rotation }, vec![cord, globe])
}

/// A visitor, who walks in during the first quarter of the visit and out during the last.
fn visitor(share: f64) -> MovingObject {
    let away = 1.0 - (4.0 * share).min(4.0 * (1.0 - share)).clamp(0.0, 1.0);
    let pose = Pose::turned(0.75 + 1.85 * away * away, 0.74, 0.0, 0.4 * (TAU * share).sin());
    MovingObject::new("visitor", pose, person(JERSEYS[1], TROUSERS[1], SKIN[0]))
}

/// A person who stands on the floor at their own origin and looks along -y.
fn person(jersey: [Rgb; 2], trousers: Rgb, skin: Rgb) -> Vec<Solid> {
    let clothes = Texture::Clothes { jersey, trousers, waist: -0.05 };
    let hair =
        Texture::Clouds { colours: [skin, [skin[0] * 0.8, skin[1] * 0.75, skin[2] * 0.7]], scale: 0.15, seed: 9 };
    vec![
        Solid::new(Shape::Capsule { radius: 0.24, half_height: 0.48 }, clothes, Pose::at(0.0, 0.0, 0.72)),
        Solid::new(Shape::Sphere { radius: 0.19 }, hair, Pose::at(0.0, -0.03, 1.58)),
    ]
}

/// The distractors of photo `index` of `count`. People linger for a few photos, toys are moved for each photo, and some
/// things appear only once.
pub(super) fn in_photo(index: usize, count: usize, seed: u64) -> Vec<MovingObject> {
    let mut objects = lingerers(index as f64 / count.max(1) as f64, seed);
    let mut rng = stream(seed, STREAM_PHOTOS + index as u64);
    objects.extend(toys(&mut rng));
    objects.extend(once(&mut rng));
    objects
}

/// People who stand nearly still, each for a tenth of the photos.
fn lingerers(share: f64, seed: u64) -> Vec<MovingObject> {
    let mut rng = stream(seed, STREAM_LINGERERS);
    let mut objects = Vec::new();
    for person_number in 0..4 {
        let start = 0.04 + 0.25 * f64::from(person_number) + 0.1 * rng.random::<f64>();
        let place = SPOTS[rng.random_range(0..SPOTS.len())];
        let looks = looks(&mut rng);
        let within = (share - start) / 0.1;
        if (0.0..1.0).contains(&within) {
            let sway = 0.03 * DVec2::new((9.0 * within).sin(), (7.0 * within).cos());
            let pose = Pose::turned(place.x + sway.x, place.y + sway.y, 0.0, 0.3 * within);
            objects.push(MovingObject::new(format!("lingerer {person_number}"), pose, looks));
        }
    }
    objects
}

/// A block and a ball, at a different place in every photo.
fn toys(rng: &mut ChaCha8Rng) -> [MovingObject; 2] {
    let first = rng.random_range(0..SPOTS.len());
    let second = (first + rng.random_range(1..SPOTS.len())) % SPOTS.len();
    let mut pose = |spot: usize, height: f64| {
        let shift = DVec2::new(rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2));
        Pose::turned(SPOTS[spot].x + shift.x, SPOTS[spot].y + shift.y, height, rng.random_range(0.0..TAU))
    };
    let checks = Texture::Checks { colours: [[0.95, 0.45, 0.60], [0.25, 0.10, 0.30]], period: 0.4 };
    let block = Solid::new(Shape::Block { half: DVec3::splat(0.24) }, checks, Pose::at(0.0, 0.0, 0.0));
    let gores = Texture::Gores { colours: [[0.95, 0.95, 0.90], [0.15, 0.65, 0.45], [0.10, 0.20, 0.45]] };
    let ball = Solid::new(Shape::Sphere { radius: 0.25 }, gores, Pose::turned(0.0, 0.0, 0.0, 0.8));
    [
        MovingObject::new("toy block", pose(first, 0.24), vec![block]),
        MovingObject::new("toy ball", pose(second, 0.25), vec![ball]),
    ]
}

/// A passer-by in most photos, and sometimes a parcel in the air.
fn once(rng: &mut ChaCha8Rng) -> Vec<MovingObject> {
    let mut objects = Vec::new();
    let place = DVec2::new(rng.random_range(-1.9..1.9), rng.random_range(-1.4..0.6));
    if rng.random_bool(0.7) {
        let pose = Pose::turned(place.x, place.y, 0.0, rng.random_range(0.0..TAU));
        let looks = looks(rng);
        objects.push(MovingObject::new("passer-by", pose, looks));
    }
    if rng.random_bool(0.5) {
        let pose = Pose {
            position: DVec3::new(-0.6 * place.x, place.y + 0.2, rng.random_range(1.0..2.0)),
            rotation: DQuat::from_axis_angle(DVec3::new(0.5, 0.3, 0.8).normalize(), rng.random_range(0.0..TAU)),
        };
        let texture = Texture::Clouds { colours: [[0.75, 0.58, 0.36], [0.55, 0.38, 0.20]], scale: 0.2, seed: 31 };
        let half = DVec3::new(rng.random_range(0.2..0.35), 0.22, 0.16);
        let parcel = Solid::new(Shape::Block { half }, texture, Pose::at(0.0, 0.0, 0.0));
        objects.push(MovingObject::new("parcel", pose, vec![parcel]));
    }
    objects
}

fn looks(rng: &mut ChaCha8Rng) -> Vec<Solid> {
    person(
        JERSEYS[rng.random_range(0..JERSEYS.len())],
        TROUSERS[rng.random_range(0..TROUSERS.len())],
        SKIN[rng.random_range(0..SKIN.len())],
    )
}

/// The random numbers for one purpose.
pub(super) fn stream(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}
