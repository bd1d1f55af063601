//! The cameras of a video and their synchronised frames.

use std::collections::BTreeMap;

use super::depths::Depths;
use super::error::Misfit;
use crate::scene::{Camera, Scene, View};

/// Largest difference between the times of synchronised frames.
const SAME_MOMENT: f64 = 1e-9;

/// Synchronised cameras, sorted by number.
pub(super) struct Rig<'a> {
    pub(super) cameras: Vec<RigCamera<'a>>,
}

/// A camera of a rig.
pub(super) struct RigCamera<'a> {
    /// `7` for `cam07`. Cameras with other names are numbered, held-out ones first.
    pub(super) number: usize,
    /// Its name in the scene.
    pub(super) name: &'a str,
    pub(super) held_out: bool,
    /// Its frames, sorted by time.
    pub(super) views: Vec<&'a View>,
}

/// The camera in the name of a view: `cam00` in `cam00/0003`.
pub(super) fn camera_name(view: &View) -> Option<&str> {
    view.name.rsplit_once('/').map(|(camera, _)| camera)
}

impl<'a> Rig<'a> {
    /// The rig that filmed a scene.
    ///
    /// # Errors
    /// If views are not named `camera/frame`, cameras are not synchronised, or a camera is only partly held out.
    pub(super) fn of(scene: &'a Scene) -> Result<Self, Misfit> {
        let mut cameras: BTreeMap<&str, RigCamera<'a>> = BTreeMap::new();
        for (part, held_out) in [(&scene.train, false), (&scene.test, true)] {
            for view in part {
                let name = camera_name(view)
                    .ok_or_else(|| format!("the name of its view `{}` is not of the form camera/frame", view.name))?;
                let fresh = || RigCamera { number: 0, name, held_out, views: Vec::new() };
                let camera = cameras.entry(name).or_insert_with(fresh);
                if camera.held_out != held_out {
                    return Err(format!("some frames of {name} are held out and others are not"));
                }
                camera.views.push(view);
            }
        }
        let mut cameras: Vec<RigCamera> = cameras.into_values().collect();
        for camera in &mut cameras {
            camera.views.sort_by(|a, b| a.time.total_cmp(&b.time));
        }
        check_moments(&cameras)?;
        number(&mut cameras);
        Ok(Self { cameras })
    }

    /// Frames per camera.
    pub(super) fn frames(&self) -> usize {
        self.cameras.first().map_or(0, |camera| camera.views.len())
    }

    /// The training cameras, or the held-out ones.
    pub(super) fn part(&self, held_out: bool) -> impl Iterator<Item = &RigCamera<'a>> {
        self.cameras.iter().filter(move |camera| camera.held_out == held_out)
    }
}

impl RigCamera<'_> {
    /// The camera, which must be the same in all frames.
    pub(super) fn still(&self) -> Result<&Camera, Misfit> {
        let first = &self.views[0].camera;
        match self.views.iter().find(|view| view.camera != *first) {
            None => Ok(first),
            Some(other) => Err(format!("its camera {} moves ({})", self.name, other.name)),
        }
    }

    /// Its depth bounds.
    pub(super) fn depths(&self, scene: &Scene) -> Depths {
        Depths::of(scene, &self.views)
    }
}

/// Checks that all cameras film the same moments, each moment once.
fn check_moments(cameras: &[RigCamera]) -> Result<(), Misfit> {
    let Some(first) = cameras.first() else { return Ok(()) };
    if let Some(pair) = first.views.windows(2).find(|pair| pair[1].time - pair[0].time <= SAME_MOMENT) {
        return Err(format!("its views {} and {} are of one camera at one moment", pair[0].name, pair[1].name));
    }
    for other in cameras {
        let (count, others) = (first.views.len(), other.views.len());
        if count != others {
            return Err(format!("{} has {count} frames and {} has {others}", first.name, other.name));
        }
        let apart = |(a, b): &(&&View, &&View)| (a.time - b.time).abs() > SAME_MOMENT;
        if let Some((a, b)) = first.views.iter().zip(&other.views).find(apart) {
            let (at, other_at) = (a.time, b.time);
            return Err(format!("its cameras are not synchronised ({} is at {at}, {} at {other_at})", a.name, b.name));
        }
    }
    Ok(())
}

/// Numbers the cameras and sorts them by number.
///
/// Numbers in names like `cam07` are kept if the held-out cameras come first, because readers hold out the first.
fn number(cameras: &mut [RigCamera]) {
    let own = |camera: &RigCamera| -> Option<usize> { camera.name.strip_prefix("cam")?.parse().ok() };
    let mut numbers: Vec<Option<(usize, bool)>> = cameras.iter().map(|c| Some((own(c)?, c.held_out))).collect();
    numbers.sort();
    let usable = numbers.iter().all(Option::is_some)
        && numbers.windows(2).all(|pair| pair[0].map(|n| n.0) != pair[1].map(|n| n.0))
        && numbers.is_sorted_by_key(|n| n.map(|(_, held_out)| !held_out));
    cameras.sort_by_key(|camera| (!camera.held_out, own(camera)));
    for (place, camera) in cameras.iter_mut().enumerate() {
        camera.number = if usable { own(camera).unwrap_or(place) } else { place };
    }
}
