//! Solids with a pose, and their intersections with rays.

use glam::{DMat3, DQuat, DVec3};

use super::texture::Texture;

/// Smallest distance of a hit, in lengths of the ray's direction. A ray that starts on a surface does not hit it again.
const NEAREST: f64 = 1e-6;

/// A shape around the origin of its own coordinates. Its axis, if any, is z. Sizes are in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    Sphere {
        radius: f64,
    },
    Block {
        half: DVec3,
    },
    Cylinder {
        radius: f64,
        half_height: f64,
    },
    /// A cylinder with a half sphere at each end. The half spheres are beyond `half_height`.
    Capsule {
        radius: f64,
        half_height: f64,
    },
    /// A block seen from inside.
    Room {
        half: DVec3,
    },
}

/// Position and orientation of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position of the object's own origin in the world, metres.
    pub position: DVec3,
    /// Rotation from the object's own axes to the world's.
    pub rotation: DQuat,
}

/// A shape with a texture and a pose.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    pub(super) shape: Shape,
    pub(super) texture: Texture,
    pub(super) pose: Pose,
    /// Whether it belongs to a mover ([`Movers`](super::movers::Movers)).
    pub(super) is_mover: bool,
    to_local: DMat3,
}

/// A ray in the world. Distances are in lengths of its direction, which need not be 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
}

/// The point where a ray meets a shape, in the shape's own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    pub(super) distance: f64,
    pub(super) point: DVec3,
    pub(super) normal: DVec3,
}

impl Pose {
    /// At `position`, unturned.
    pub(super) fn at(x: f64, y: f64, z: f64) -> Self {
        Self { position: DVec3::new(x, y, z), rotation: DQuat::IDENTITY }
    }

    /// At `position`, turned by `angle` radians about the vertical axis.
    pub(super) fn turned(x: f64, y: f64, z: f64, angle: f64) -> Self {
        Self { position: DVec3::new(x, y, z), rotation: DQuat::from_rotation_z(angle) }
    }

    /// World coordinates of a point in the object's own coordinates.
    pub fn place(&self, local: DVec3) -> DVec3 {
        self.rotation * local + self.position
    }

    /// Upper bound of the distance between a point's positions at this pose and at `other`. The point is within `reach`
    /// of the object's origin.
    pub(super) fn travel(&self, other: &Pose, reach: f64) -> f64 {
        let half_angle = 0.5 * self.rotation.angle_between(other.rotation);
        self.position.distance(other.position) + 2.0 * reach * half_angle.sin()
    }

    /// The world pose of a part, given the part's pose within the whole.
    pub(super) fn of_part(&self, part: &Pose) -> Pose {
        Pose { position: self.place(part.position), rotation: self.rotation * part.rotation }
    }
}

impl Solid {
    pub(super) fn new(shape: Shape, texture: Texture, pose: Pose) -> Self {
        Self { shape, texture, pose, is_mover: false, to_local: DMat3::from_quat(pose.rotation.inverse()) }
    }

    /// The nearest point in front of the ray's origin.
    pub(super) fn hit(&self, ray: &Ray) -> Option<Hit> {
        let origin = self.to_local * (ray.origin - self.pose.position);
        let direction = self.to_local * ray.direction;
        match self.shape {
            Shape::Sphere { radius } => sphere(origin, direction, radius),
            Shape::Block { half } => block(origin, direction, half),
            Shape::Room { half } => room(origin, direction, half),
            Shape::Cylinder { radius, half_height } => nearer(
                side(origin, direction, radius, half_height),
                nearer(cap(origin, direction, radius, half_height), cap(origin, direction, radius, -half_height)),
            ),
            Shape::Capsule { radius, half_height } => {
                let end = |z: f64| {
                    let centre = DVec3::new(0.0, 0.0, z);
                    sphere(origin - centre, direction, radius).map(|hit| Hit { point: hit.point + centre, ..hit })
                };
                nearer(side(origin, direction, radius, half_height), nearer(end(half_height), end(-half_height)))
            }
        }
    }

    /// Radius of a sphere around the pose's position that contains the solid; infinite for a room.
    pub(super) fn reach(&self) -> f64 {
        match self.shape {
            Shape::Sphere { radius } => radius,
            Shape::Block { half } => half.length(),
            Shape::Cylinder { radius, half_height } => radius.hypot(half_height),
            Shape::Capsule { radius, half_height } => radius + half_height,
            Shape::Room { .. } => f64::INFINITY,
        }
    }

    /// World direction of a direction in the solid's own coordinates.
    pub(super) fn to_world(&self, local: DVec3) -> DVec3 {
        self.pose.rotation * local
    }
}

fn nearer(a: Option<Hit>, b: Option<Hit>) -> Option<Hit> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a.distance <= b.distance { a } else { b }),
        (a, b) => a.or(b),
    }
}

fn sphere(origin: DVec3, direction: DVec3, radius: f64) -> Option<Hit> {
    let (a, b) = (direction.length_squared(), origin.dot(direction));
    let discriminant = b * b - a * (origin.length_squared() - radius * radius);
    if discriminant < 0.0 {
        return None;
    }
    let distance = (-b - discriminant.sqrt()) / a;
    let point = origin + distance * direction;
    (distance > NEAREST).then(|| Hit { distance, point, normal: point / radius })
}

/// Distances at which the ray enters and leaves the block, with the axes of those faces.
fn slabs(origin: DVec3, direction: DVec3, half: DVec3) -> ((f64, usize), (f64, usize)) {
    let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
    for axis in 0..3 {
        let inverse = 1.0 / direction[axis];
        let (a, b) = ((-half[axis] - origin[axis]) * inverse, (half[axis] - origin[axis]) * inverse);
        if a.min(b) > enter.0 {
            enter = (a.min(b), axis);
        }
        if a.max(b) < leave.0 {
            leave = (a.max(b), axis);
        }
    }
    (enter, leave)
}

fn face(axis: usize, direction: DVec3) -> DVec3 {
    -DVec3::AXES[axis] * direction[axis].signum()
}

fn block(origin: DVec3, direction: DVec3, half: DVec3) -> Option<Hit> {
    let ((distance, axis), (leave, _)) = slabs(origin, direction, half);
    (distance > NEAREST && distance < leave).then(|| Hit {
        distance,
        point: origin + distance * direction,
        normal: face(axis, direction),
    })
}

fn room(origin: DVec3, direction: DVec3, half: DVec3) -> Option<Hit> {
    let (_, (distance, axis)) = slabs(origin, direction, half);
    (distance > NEAREST).then(|| Hit { distance, point: origin + distance * direction, normal: face(axis, direction) })
}

/// The mantle of a cylinder.
fn side(origin: DVec3, direction: DVec3, radius: f64, half_height: f64) -> Option<Hit> {
    let (o, d) = (origin.truncate(), direction.truncate());
    let (a, b) = (d.length_squared(), o.dot(d));
    let discriminant = b * b - a * (o.length_squared() - radius * radius);
    if discriminant < 0.0 || a == 0.0 {
        return None;
    }
    let distance = (-b - discriminant.sqrt()) / a;
    let point = origin + distance * direction;
    (distance > NEAREST && point.z.abs() <= half_height).then(|| Hit {
        distance,
        point,
        normal: (point.truncate() / radius).extend(0.0),
    })
}

/// The disc that closes a cylinder at height `z`.
fn cap(origin: DVec3, direction: DVec3, radius: f64, z: f64) -> Option<Hit> {
    let distance = (z - origin.z) / direction.z;
    let point = origin + distance * direction;
    // Written so that a ray within the disc's plane, whose distance is NaN, misses.
    let inside = distance > NEAREST && distance.is_finite() && point.truncate().length_squared() <= radius * radius;
    inside.then(|| Hit { distance, point, normal: DVec3::new(0.0, 0.0, z.signum()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding tolerance for the roots of a quadratic of numbers near one.
    const ROUNDING: f64 = 1e-9;

    fn solids() -> Vec<Solid> {
        let pose = Pose { position: DVec3::new(0.1, 0.4, -0.2), rotation: DQuat::from_rotation_x(0.7) };
        [
            Shape::Sphere { radius: 0.5 },
            Shape::Block { half: DVec3::new(0.3, 0.4, 0.5) },
            Shape::Cylinder { radius: 0.3, half_height: 0.4 },
            Shape::Capsule { radius: 0.3, half_height: 0.4 },
        ]
        .map(|shape| Solid::new(shape, Texture::Plain([0.5; 3]), pose))
        .into()
    }

    #[test]
    fn a_ray_at_the_middle_meets_the_near_side_whose_normal_faces_it() {
        for solid in solids() {
            for origin in [DVec3::new(3.0, 1.0, 0.5), DVec3::new(-2.0, 0.3, 2.0), DVec3::new(0.2, 0.5, -3.0)] {
                let ray = Ray { origin, direction: 2.0 * (solid.pose.position - origin) };
                let hit = solid.hit(&ray).expect("hit");
                let world = ray.origin + hit.distance * ray.direction;
                assert!((solid.pose.place(hit.point) - world).length() < ROUNDING);
                assert!(hit.distance < 0.5 && solid.to_world(hit.normal).dot(ray.direction) < 0.0);
                assert!((hit.normal.length() - 1.0).abs() < ROUNDING);
                assert!(hit.point.length() <= solid.reach() + ROUNDING);
            }
        }
    }

    #[test]
    fn a_ray_that_points_away_or_passes_by_meets_nothing() {
        for solid in solids() {
            let origin = DVec3::new(3.0, 1.0, 0.5);
            assert_eq!(solid.hit(&Ray { origin, direction: origin - solid.pose.position }), None);
            assert_eq!(solid.hit(&Ray { origin, direction: DVec3::new(0.0, 0.0, 1.0) }), None);
        }
    }

    #[test]
    fn a_room_is_met_from_inside() {
        let room =
            Solid::new(Shape::Room { half: DVec3::splat(2.0) }, Texture::Plain([0.5; 3]), Pose::at(0.0, 0.0, 0.0));
        let hit = room.hit(&Ray { origin: DVec3::new(1.0, 0.0, 0.0), direction: DVec3::X }).expect("hit");
        assert_eq!((hit.distance, hit.normal), (1.0, DVec3::NEG_X));
    }
}
