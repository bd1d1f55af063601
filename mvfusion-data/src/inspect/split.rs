//! Whether there is enough to learn from, and something to score on.

use super::problem::{Problem, Subject};
use super::rig::by_camera;
use crate::Scene;

pub(super) fn problems(scene: &Scene) -> Vec<Problem> {
    let mut problems = Vec::new();
    match scene.train.len() {
        0 => problems.push(Problem::error(
            Subject::Split,
            "there is no view to train on",
            "Hold out fewer views, or add pictures with cameras.",
        )),
        1 => problems.push(Problem::warning(
            Subject::Split,
            "there is one view to train on: shapes cannot be learned from it",
            "Hold out fewer views, or add pictures with cameras.",
        )),
        many if by_camera(scene.train.iter()).len() == 1 => problems.push(Problem::warning(
            Subject::Split,
            format!(
                "all {many} training views are from one camera that stands still: depths cannot be learned from it"
            ),
            "Train on several cameras, or on one that moves; hold out fewer.",
        )),
        _ => {}
    }
    if scene.test.is_empty() {
        problems.push(Problem::warning(
            Subject::Split,
            "no view is held out: there will be no scores on views that were not trained on",
            "Hold some out, for example every 8th with `--set scene.test_every=8`, or a camera with scene.test_cameras.",
        ));
    }
    problems
}
