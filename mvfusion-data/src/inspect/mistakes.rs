//! Common mistakes in poses, each with the warp that undoes it.

use glam::{DMat3, DVec3};

use super::sight::Warp;

/// A possible mistake in all poses.
pub(super) struct Mistake {
    pub(super) warp: Warp,
    /// How to undo it, such as `with the y and z axes of the cameras turned`.
    pub(super) undone: String,
    /// The cause of the mistake.
    pub(super) cause: &'static str,
}

/// From OpenGL axes to OpenCV axes, and back.
const TURNED: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

const OPENGL: &str = "the cameras look along -z with y up (OpenGL) where they should look along +z with y down (OpenCV), \
                      or the other way round";
const INVERSE: &str = "the poses lead from the camera to the world where they should lead from the world to the camera, or \
                       the other way round";
const INVERSE_OPENGL: &str = "the poses lead the other way (camera-to-world, world-to-camera), and their axes are OpenGL's \
                              where they should be OpenCV's, or the other way round";
const AXES: &str = "the columns or rows of the poses stand in another order";
const WORLD: &str = "the points were turned, and the cameras were not";
const MIRRORED: &str = "the images are mirrored, or an axis of the cameras has the wrong sign";
const UNIT: &str = "cameras and points are in different units";

/// All mistakes to try, the most likely first.
pub(super) fn all() -> Vec<Mistake> {
    let of = |warp, undone: &str, cause| Mistake { warp, undone: undone.into(), cause };
    let inverted = Warp { inverted: true, ..Warp::NONE };
    let mut all = vec![
        of(Warp { axes: TURNED, ..Warp::NONE }, "with the y and z axes of the cameras turned", OPENGL),
        of(inverted, "with the poses inverted", INVERSE),
        of(Warp { axes: TURNED, ..inverted }, "with the poses inverted and then y and z turned", INVERSE_OPENGL),
        of(Warp { world: TURNED, ..inverted }, "with y and z turned and then the poses inverted", INVERSE_OPENGL),
        of(
            Warp { axes: TURNED, world: TURNED, ..inverted },
            "with y and z turned before and after the poses are inverted",
            INVERSE_OPENGL,
        ),
    ];
    for (axes, name) in turns().into_iter().filter(|(axes, _)| *axes != TURNED) {
        let undone = format!("with the cameras' axes x, y, z taken as {name}");
        all.push(Mistake { warp: Warp { axes, ..Warp::NONE }, undone, cause: AXES });
    }
    for (world, name) in turns() {
        let undone = format!("with the points' axes x, y, z taken as {name}");
        all.push(Mistake { warp: Warp { world, ..Warp::NONE }, undone, cause: WORLD });
    }
    for (signs, sides) in
        [(DVec3::new(-1.0, 1.0, 1.0), "left and right"), (DVec3::new(1.0, -1.0, 1.0), "top and bottom")]
    {
        let axes = DMat3::from_diagonal(signs);
        let undone = format!("with {sides} of the images exchanged");
        all.push(Mistake { warp: Warp { axes, ..Warp::NONE }, undone, cause: MIRRORED });
    }
    for scale in [1e-3, 1e3, 1e-2, 1e2, 1e-1, 1e1] {
        let undone = format!("with the cameras' positions multiplied by {scale}");
        all.push(Mistake { warp: Warp { scale, ..Warp::NONE }, undone, cause: UNIT });
    }
    all
}

/// The 23 rotations that permute axes, with names like `y, x, -z`.
fn turns() -> Vec<(DMat3, String)> {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]];
    const NAMES: [&str; 3] = ["x", "y", "z"];
    let mut turns = Vec::new();
    for order in ORDERS {
        for signs in 0..8 {
            let sign = |axis: usize| if signs >> axis & 1 == 0 { 1.0 } else { -1.0 };
            let rows: [DVec3; 3] = std::array::from_fn(|i| sign(i) * DVec3::AXES[order[i]]);
            let turn = DMat3::from_cols_array_2d(&rows.map(|row| row.to_array())).transpose();
            if turn.determinant() > 0.0 && turn != DMat3::IDENTITY {
                let name = |i: usize| format!("{}{}", if sign(i) < 0.0 { "-" } else { "" }, NAMES[order[i]]);
                turns.push((turn, [name(0), name(1), name(2)].join(", ")));
            }
        }
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_23_turns_and_each_does_what_its_name_says() {
        let turns = turns();
        assert_eq!(turns.len(), 23);
        let (turn, _) = turns.iter().find(|(_, name)| name == "y, -x, z").expect("among them");
        assert_eq!(*turn * DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, -1.0, 3.0));
    }
}
