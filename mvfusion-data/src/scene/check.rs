//! The check of a scene that no reader has made.

use std::collections::BTreeSet;

use super::Scene;
use super::camera::Camera;
use super::limits::{LARGEST_COORDINATE, check_place};
use super::picture::Picture;
use super::points::PointCloud;
use super::view::{Truth, View};
use crate::error::DataError;
use crate::files::rotation_of;

/// What is wrong, and what to do.
struct Fault {
    reason: String,
    advice: &'static str,
}

impl Scene {
    /// Checks a scene that your own program built, before it is trained or evaluated. Nothing is decoded. Scenes of the
    /// readers and built-in scenes pass. [`obstacle`](crate::inspect::obstacle) tells whether there are enough views.
    ///
    /// # Errors
    /// [`DataError::Scene`], which names the first view or point with one of these problems:
    /// * Two training views, or two held-out views, have the same name.
    /// * A time is not in `[0, 1]`.
    /// * A camera has no pixel, its `rotation` is no rotation matrix, or its numbers are not finite or out of range
    ///   ([`Camera::is_computable`]).
    /// * The image, the mask or the ground truth of a view has another size than its camera.
    /// * Training images differ in size. Batches need one size; held-out images may have their own.
    /// * The points have not as many colours as positions, or contain a number that is not finite or too large.
    pub fn check(&self) -> Result<(), DataError> {
        check_views("training", &self.train)
            .and_then(|()| check_views("held-out", &self.test))
            .and_then(|()| check_common_size(&self.train))
            .and_then(|()| check_points(&self.points))
            .map_err(|Fault { reason, advice }| DataError::Scene { scene: self.name.clone(), reason, advice })
    }
}

/// Checks the training views or the held-out views, as `kind` says.
fn check_views(kind: &str, views: &[View]) -> Result<(), Fault> {
    let mut names = BTreeSet::new();
    for view in views {
        if !names.insert(&view.name) {
            return Err(Fault {
                reason: format!("two {kind} views have the name `{}`", view.name),
                advice: "Give every view a name of its own: views are found by their names",
            });
        }
        check_time(view.time)
            .and_then(|()| check_camera(&view.camera))
            .and_then(|()| check_sizes(view))
            .map_err(|fault| Fault { reason: format!("the {kind} view `{}` {}", view.name, fault.reason), ..fault })?;
    }
    Ok(())
}

fn check_time(time: f64) -> Result<(), Fault> {
    if (0.0..=1.0).contains(&time) {
        return Ok(());
    }
    Err(Fault {
        reason: format!("has the time {time:?}, and times lie in [0, 1]"),
        advice: "Times are fractions of the capture: divide the index of each moment by the number of moments",
    })
}

fn check_camera(camera: &Camera) -> Result<(), Fault> {
    let &Camera { width, height, fx, fy, cx, cy, rotation, translation } = camera;
    if width == 0 || height == 0 {
        let reason = format!("has a camera of {width} x {height} pixels");
        return Err(Fault { reason, advice: "Set width and height of the camera to those of its image" });
    }
    let lens = [("fx", fx), ("fy", fy), ("cx", cx), ("cy", cy)];
    let rotations = rotation.to_cols_array().map(|value| ("rotation", value));
    let translations = translation.to_array().map(|value| ("translation", value));
    let mut numbers = lens.into_iter().chain(rotations).chain(translations);
    if let Some((name, value)) = numbers.find(|(_, value)| !value.is_finite()) {
        return Err(Fault {
            reason: format!("has a camera with {value} in its {name}"),
            advice: "Correct the camera, or leave the view out if its pose is not known",
        });
    }
    if rotation_of(rotation).is_none() {
        return Err(Fault {
            reason: format!("has a camera whose matrix is no rotation; by columns: {:?}", rotation.to_cols_array()),
            advice: "Its rows must be unit vectors in the world: right, down and forward of the camera, which are at \
                     right angles and not mirrored",
        });
    }
    if !camera.is_computable() {
        return Err(Fault {
            reason: format!(
                "has a camera with focal lengths {fx:?}, {fy:?}, principal point {cx:?}, {cy:?} and translation {:?}, \
                 which are too large or too small to compute with; coordinates go up to {LARGEST_COORDINATE:e}",
                translation.to_array()
            ),
            advice: "Give focal lengths and principal points in pixels of the image, and positions near the origin",
        });
    }
    Ok(())
}

/// Checks that everything of a view has the size of its camera.
fn check_sizes(view: &View) -> Result<(), Fault> {
    let Camera { width, height, .. } = view.camera;
    let Truth { background, dynamic_mask, movers_mask, depth, .. } = &view.truth;
    let pictures = [
        ("an image", Some(&view.image)),
        ("a mask", view.mask.as_ref().map(|mask| &mask.picture)),
        ("a true background", background.as_ref()),
        ("a true mask of what moves", dynamic_mask.as_ref()),
        ("a true mask of movers", movers_mask.as_ref()),
    ];
    for (what, picture) in pictures {
        let Some((w, h)) = picture.map(Picture::size) else { continue };
        if (w as usize, h as usize) != (width, height) {
            return Err(Fault {
                reason: format!("has {what} of {w} x {h} pixels, but its camera is for {width} x {height}"),
                advice: "Make them equal: `Camera::resized` is the same camera for another size",
            });
        }
    }
    match depth {
        Some(depth) if depth.len() != width * height => Err(Fault {
            reason: format!("has {} true depths, but its camera is for {width} x {height} pixels", depth.len()),
            advice: "Give one depth for each pixel, or none at all",
        }),
        _ => Ok(()),
    }
}

/// Checks that all training images have one size.
fn check_common_size(views: &[View]) -> Result<(), Fault> {
    let size = |view: &View| view.image.size();
    let Some(first) = views.first() else { return Ok(()) };
    let Some(other) = views.iter().find(|view| size(view) != size(first)) else { return Ok(()) };
    let ((w, h), (width, height)) = (size(other), size(first));
    Err(Fault {
        reason: format!(
            "the training view `{}` has {w} x {h} pixels, but `{}` has {width} x {height}",
            other.name, first.name
        ),
        advice: "All training images must have one size: scale them, and their cameras with `Camera::resized`",
    })
}

fn check_points(points: &PointCloud) -> Result<(), Fault> {
    let PointCloud { positions, colours } = points;
    if positions.len() != colours.len() {
        return Err(Fault {
            reason: format!("its points have {} positions and {} colours", positions.len(), colours.len()),
            advice: "Give one colour for each position: `PointCloud::push` takes both",
        });
    }
    for (index, (&position, colour)) in positions.iter().zip(colours).enumerate() {
        check_place(position).map_err(|reason| Fault {
            reason: format!("its point {index} (from 0) {reason}"),
            advice: "Leave the point out, or scale the scene and its cameras if they are that large",
        })?;
        if !colour.is_finite() {
            return Err(Fault {
                reason: format!("its point {index} (from 0) has the colour {:?}", colour.to_array()),
                advice: "Colours are three numbers in [0, 1]",
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
