//! Checks of the split: enough training views, and some held-out views.

use std::collections::BTreeSet;

use super::problem::{Problem, Subject, few};
use crate::scene::{Scene, by_camera};

pub(super) fn problems(scene: &Scene) -> Vec<Problem> {
    let mut problems: Vec<Problem> = obstacle(scene).into_iter().collect();
    if scene.test.is_empty() {
        problems.push(Problem::warning(
            Subject::Split,
            "no view is held out: there will be no scores on views that were not trained on",
            "Hold some out, for example every 8th with `--set scene.test_every=8`, or a camera with scene.test_cameras.",
        ));
    }
    problems.extend(shared(scene));
    problems
}

/// Too few training views, or views of one still camera. Losses and learning rates scale with the distance between
/// cameras (METHOD §3), which is 0 then.
pub(super) fn obstacle(scene: &Scene) -> Option<Problem> {
    const ADD: &str = "Hold out fewer views, or add images with cameras.";
    let (what, remedy) = match scene.train.len() {
        0 => ("there is no view to train on".to_owned(), ADD),
        1 => ("there is one view to train on: shapes cannot be learned from it".to_owned(), ADD),
        many if by_camera(scene.train.iter()).len() == 1 => (
            format!(
                "all {many} training views are from one camera that stands still: depths cannot be learned from it"
            ),
            "Train on several cameras, or on one that moves; hold out fewer.",
        ),
        _ => return None,
    };
    Some(Problem::error(Subject::Split, what, remedy))
}

/// Held-out views that are also training views.
fn shared(scene: &Scene) -> Option<Problem> {
    let trained: BTreeSet<&str> = scene.train.iter().map(|view| view.name.as_str()).collect();
    let names: Vec<&str> =
        scene.test.iter().map(|view| view.name.as_str()).filter(|name| trained.contains(name)).collect();
    (!names.is_empty()).then(|| {
        let what = format!(
            "{} of {} held-out views are trained on as well, so their scores say nothing about other places ({})",
            names.len(),
            scene.test.len(),
            few(&names)
        );
        let camera = scene.test.iter().find_map(|view| view.name.rsplit_once('/'));
        let remedy = camera.map_or("Hold other views out.".to_owned(), |(camera, _)| {
            format!("Hold whole cameras out, for example with `--set 'scene.test_cameras=[{camera:?}]'`.")
        });
        Problem::warning(Subject::Split, what, remedy)
    })
}
