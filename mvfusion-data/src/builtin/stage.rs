//! The still part of the built-in scenes: a furnished room with z up, of which five metres are in view.

use glam::{DVec2, DVec3};

use super::solid::{Pose, Shape, Solid};
use super::texture::Texture;

/// Half the size of the room, metres.
pub(super) const ROOM_HALF: DVec3 = DVec3::new(4.0, 5.0, 1.7);
/// Middle of the room: the floor is at z = 0, the back wall at y = 3.
pub(super) const ROOM_MIDDLE: DVec3 = DVec3::new(0.0, -2.0, 1.7);
/// The scene's size in metres: the distance from the cameras to the back wall.
pub(super) const SCENE_SIZE: f64 = 7.0;

/// All solids that never move.
pub(super) fn still_solids(seed: u32) -> Vec<Solid> {
    let room = Solid::new(
        Shape::Room { half: ROOM_HALF },
        Texture::Interior { half: ROOM_HALF, seed },
        Pose { position: ROOM_MIDDLE, ..Pose::at(0.0, 0.0, 0.0) },
    );
    let mut solids = vec![room];
    solids.extend(left_side(seed));
    solids.extend(middle(seed));
    solids.extend(right_side(seed));
    solids
}

fn left_side(seed: u32) -> Vec<Solid> {
    let plinth = Texture::Clouds { colours: [[0.30, 0.16, 0.08], [0.62, 0.38, 0.20]], scale: 0.3, seed };
    let ball = Texture::Clouds { colours: [[0.05, 0.18, 0.42], [0.80, 0.90, 0.95]], scale: 0.22, seed: seed ^ 11 };
    let column = Texture::Bands { colours: [[0.80, 0.78, 0.72], [0.64, 0.58, 0.51]], period: 0.6, seed };
    vec![
        Solid::new(Shape::Block { half: DVec3::new(0.45, 0.45, 0.45) }, plinth, Pose::turned(-1.75, 1.3, 0.45, 0.3)),
        Solid::new(Shape::Sphere { radius: 0.42 }, ball, Pose::at(-1.75, 1.3, 1.32)),
        Solid::new(Shape::Cylinder { radius: 0.22, half_height: 1.7 }, column, Pose::at(-2.9, 2.3, 1.7)),
    ]
}

fn middle(seed: u32) -> Vec<Solid> {
    let rug = Texture::Rings { colours: [[0.62, 0.20, 0.18], [0.86, 0.72, 0.52]], period: 0.55, seed };
    let crate_low = Texture::Checks { colours: [[0.16, 0.46, 0.48], [0.72, 0.80, 0.70]], period: 0.56 };
    let crate_high = Texture::Checks { colours: [[0.86, 0.62, 0.14], [0.40, 0.14, 0.30]], period: 0.4 };
    let half = DVec3::new(0.85, 0.04, 0.5);
    let picture = Texture::Painting { half: DVec2::new(half.x, half.z), seed };
    vec![
        Solid::new(Shape::Cylinder { radius: 1.5, half_height: 0.01 }, rug, Pose::at(0.0, -0.2, 0.01)),
        Solid::new(Shape::Block { half: DVec3::splat(0.4) }, crate_low, Pose::turned(0.35, 2.15, 0.4, 0.5)),
        Solid::new(Shape::Block { half: DVec3::splat(0.26) }, crate_high, Pose::turned(0.35, 2.15, 1.06, -0.2)),
        Solid::new(Shape::Block { half }, picture, Pose::at(-0.7, 2.96, 2.0)),
    ]
}

fn right_side(seed: u32) -> Vec<Solid> {
    let drum = Texture::Bands { colours: [[0.70, 0.18, 0.18], [0.90, 0.86, 0.78]], period: 0.44, seed };
    let ball = Texture::Gores { colours: [[0.92, 0.76, 0.12], [0.10, 0.34, 0.62], [0.90, 0.34, 0.12]] };
    let bench = Texture::Clouds { colours: [[0.22, 0.26, 0.18], [0.46, 0.50, 0.32]], scale: 0.35, seed: seed ^ 23 };
    vec![
        Solid::new(Shape::Cylinder { radius: 0.48, half_height: 0.55 }, drum, Pose::at(1.75, 1.5, 0.55)),
        Solid::new(Shape::Sphere { radius: 0.32 }, ball, Pose::at(2.25, 0.2, 0.32)),
        Solid::new(Shape::Block { half: DVec3::new(0.35, 0.9, 0.28) }, bench, Pose::at(3.3, 1.4, 0.28)),
    ]
}
