//! A scene in words.

use mvfusion_data::Scene;

/// A scene in one line, for people.
pub fn describe(scene: &Scene) -> String {
    let size = scene.train.first().map_or(String::new(), |view| {
        let (width, height) = view.image.size();
        format!(" at {width}x{height}")
    });
    let (train, test) = (scene.train.len(), scene.test.len());
    let points = scene.points.len();
    format!("{}: {train} training and {test} held-out views{size}, {points} initial points", scene.name)
}
