//! Moving objects of the scene `motion`: fast, crossing and bending ones.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};

use super::choreography::MovingObject;
use super::solid::{Pose, Shape, Solid};
use super::texture::Texture;

/// Crossings of the stage by the ball during the video. Of 24 frames, a crossing takes eight.
const CROSSINGS: f64 = 3.0;
/// Half the width of the stage that ball and block cross, metres.
const REACH: f64 = 1.7;
/// Links of the tentacle.
const LINKS: usize = 8;
/// Radii of its lowest and highest link, metres.
const LINK_RADII: (f64, f64) = (0.26, 0.12);
/// Largest angle between one link and the next, radians.
const BEND: f64 = 0.30;
/// Waves that run up the tentacle during the video.
const WAVES: f64 = 1.5;

/// The moving objects at a time in `[0, 1]`. A ball flies to and fro, a block slides the other way behind it, a tentacle
/// bends, and a blob hops and changes its size. Each has its own lane.
pub(super) fn in_motion(time: f64) -> Vec<MovingObject> {
    let mut objects = vec![ball(time), block(time), blob(time)];
    objects.extend(tentacle(time));
    objects
}

/// A ball that flies to and fro and spins.
fn ball(time: f64) -> MovingObject {
    let phase = PI * CROSSINGS * time;
    let position = DVec3::new(-REACH * phase.cos(), -1.2, 0.75 + 0.75 * (phase.sin() * phase.sin()));
    let rotation = DQuat::from_axis_angle(DVec3::new(0.2, 1.0, 0.3).normalize(), 2.0 * phase);
    let gores = Texture::Gores { colours: [[0.95, 0.90, 0.25], [0.75, 0.15, 0.35], [0.15, 0.20, 0.55]] };
    let part = Solid::new(Shape::Sphere { radius: 0.26 }, gores, Pose::at(0.0, 0.0, 0.0));
    MovingObject::new("ball", Pose { position, rotation }, vec![part])
}

/// A block that slides the other way, once.
fn block(time: f64) -> MovingObject {
    let half = 0.3;
    let pose = Pose::turned(REACH * (PI * time).cos(), -0.35, half, TAU * 0.5 * time);
    let checks = Texture::Checks { colours: [[0.10, 0.55, 0.50], [0.95, 0.92, 0.80]], period: 0.3 };
    let part = Solid::new(Shape::Block { half: DVec3::splat(half) }, checks, Pose::at(0.0, 0.0, 0.0));
    MovingObject::new("block", pose, vec![part])
}

/// A ball that hops and whose size changes.
fn blob(time: f64) -> MovingObject {
    let phase = TAU * 2.0 * time;
    let radius = 0.30 + 0.10 * phase.cos();
    let pose = Pose::at(1.15, 0.75, radius + 0.55 * phase.sin().abs());
    let clouds = Texture::Clouds { colours: [[0.85, 0.40, 0.75], [0.35, 0.10, 0.45]], scale: 0.15, seed: 17 };
    let part = Solid::new(Shape::Sphere { radius }, clouds, Pose::at(0.0, 0.0, 0.0));
    MovingObject::new("blob", pose, vec![part])
}

/// A chain of balls that stands on the floor and bends. Each link is an object, because each moves differently.
fn tentacle(time: f64) -> Vec<MovingObject> {
    let mut foot = DVec3::new(-0.75, 0.55, 0.0);
    let mut angle = 0.0;
    let mut links = Vec::with_capacity(LINKS);
    for link in 0..LINKS {
        let along = link as f64 / (LINKS - 1) as f64;
        let radius = LINK_RADII.0 + (LINK_RADII.1 - LINK_RADII.0) * along;
        angle += BEND * (TAU * (WAVES * time - 0.5 * along)).sin();
        let direction = DVec3::new(angle.sin(), 0.35 * angle.sin(), angle.cos()).normalize();
        let position = foot + radius * direction;
        foot = position + 0.55 * radius * direction;
        let bands = Texture::Bands { colours: [[0.90, 0.45, 0.10], [0.20, 0.12, 0.10]], period: 0.16, seed: 5 };
        let part = Solid::new(Shape::Sphere { radius }, bands, Pose::at(0.0, 0.0, 0.0));
        let pose = Pose { position, rotation: DQuat::from_rotation_y(angle) };
        links.push(MovingObject::new(format!("link {link}"), pose, vec![part]));
    }
    links
}

#[cfg(test)]
mod tests {
    use super::super::stage::still_solids;
    use super::*;

    /// Distance of a point from the surface of a solid, negative inside; infinite for a room.
    fn distance(solid: &Solid, point: DVec3) -> f64 {
        let local = solid.pose.rotation.inverse() * (point - solid.pose.position);
        let of_box = |beyond: DVec3| beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0);
        match solid.shape {
            Shape::Sphere { radius } => local.length() - radius,
            Shape::Block { half } => of_box(local.abs() - half),
            Shape::Cylinder { radius, half_height } => {
                of_box(DVec3::new(local.truncate().length() - radius, f64::NEG_INFINITY, local.z.abs() - half_height))
            }
            Shape::Capsule { .. } | Shape::Room { .. } => f64::INFINITY,
        }
    }

    #[test]
    fn nothing_moves_through_anything() {
        let still = still_solids(0);
        for frame in 0..24 {
            let objects = in_motion(f64::from(frame) / 24.0);
            let group = |name: &str| name.split(' ').next().map(str::to_owned);
            for (index, object) in objects.iter().enumerate() {
                let others = objects.iter().enumerate().filter(|(_, other)| group(&other.name) != group(&object.name));
                let others = others.filter(|(other, _)| *other != index).flat_map(|(_, other)| &other.solids);
                for solid in &object.solids {
                    // A block is as thick as its half-size everywhere.
                    let radius = match solid.shape {
                        Shape::Sphere { radius } => radius,
                        Shape::Block { half } => half.min_element(),
                        _ => unreachable!("balls and a block move"),
                    };
                    for other in others.clone().chain(&still[1..]) {
                        let room = distance(other, solid.pose.position) - radius;
                        let stands_on = solid.pose.position.z - radius < 0.03;
                        let is_rug = matches!(other.shape, Shape::Cylinder { half_height, .. } if half_height < 0.02);
                        assert!(room > 0.0 || (is_rug && stands_on), "{} in frame {frame}: {room} m", object.name);
                    }
                }
            }
        }
    }
}
