//! The attempts to place the cameras of a rig, and the best of them.

use super::super::colmap::{Effort, MadeModel};
use super::super::error::PrepareError;
use super::super::event::{Listener, Tell};

/// The models with COLMAP's defaults and, if these leave one of `total` cameras out, with more effort: those that place
/// more cameras.
///
/// # Errors
/// If the first attempt fails, or the second one and the first has placed no camera, or the listener ends one.
pub(super) fn best_models(
    total: usize,
    mut attempt: impl FnMut(Effort, &mut Listener<'_>) -> Result<Vec<MadeModel>, PrepareError>,
    listen: &mut Listener<'_>,
) -> Result<Vec<MadeModel>, PrepareError> {
    let first = attempt(Effort::Usual, listen)?;
    let (placed, points) = size(&first);
    if placed == total {
        return Ok(first);
    }
    listen.note(format!(
        "COLMAP's defaults place {placed} of {total} cameras: it is tried again with features for wide baselines"
    ))?;
    match attempt(Effort::Wide, listen) {
        Ok(second) if size(&second) > (placed, points) => Ok(second),
        Ok(_) => Ok(first),
        Err(PrepareError::Interrupted) => Err(PrepareError::Interrupted),
        Err(error) if placed == 0 => Err(error),
        Err(error) => {
            let reason = error.in_short();
            listen.note(format!("with features for wide baselines, {reason}; what the defaults place is kept"))?;
            Ok(first)
        }
    }
}

/// Images and points of the largest model.
fn size(models: &[MadeModel]) -> (usize, usize) {
    models.iter().map(|model| (model.images.len(), model.points)).max().unwrap_or((0, 0))
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::super::super::event::Event;
    use super::*;

    fn failed() -> PrepareError {
        let (status, said) = ("exit code 1".into(), ": bad allocation".into());
        PrepareError::Step { step: "mapper", status, said, log: "colmap.log".into(), advice: "" }
    }

    /// The number of cameras that the best of two attempts at five cameras places, and the notes.
    fn best(
        first: Result<usize, PrepareError>,
        second: Result<usize, PrepareError>,
    ) -> (Result<usize, PrepareError>, Vec<String>) {
        let mut attempts = [Some(first), Some(second)];
        let attempt = |effort: Effort, _: &mut Listener<'_>| {
            let images = attempts[(effort == Effort::Wide) as usize].take().expect("tried once")?;
            Ok(vec![MadeModel::example(0, images, 10)])
        };
        let mut notes = Vec::new();
        let found = best_models(5, attempt, &mut |event| {
            if let Event::Note(note) = event {
                notes.push(note);
            }
            ControlFlow::Continue(())
        });
        (found.map(|models| models[0].images.len()), notes)
    }

    #[test]
    fn the_attempt_that_places_more_cameras_counts() {
        for (first, second, wanted, count) in [(5, 0, 5, 0), (3, 4, 4, 1), (3, 2, 3, 1), (0, 2, 2, 1)] {
            let (found, notes) = best(Ok(first), Ok(second));
            assert_eq!((found.expect("placed"), notes.len()), (wanted, count));
        }
    }

    #[test]
    fn a_second_attempt_that_fails_leaves_what_the_first_has_placed() {
        let (found, notes) = best(Ok(3), Err(failed()));
        assert_eq!(found.expect("kept"), 3);
        assert!(notes[1].contains("mapper failed (exit code 1): bad allocation; what the defaults"), "{notes:?}");
        assert!(matches!(best(Ok(0), Err(failed())).0, Err(PrepareError::Step { .. })));
        assert!(matches!(best(Err(failed()), Ok(5)).0, Err(PrepareError::Step { .. })));
        assert!(matches!(best(Ok(3), Err(PrepareError::Interrupted)).0, Err(PrepareError::Interrupted)));
    }
}
