//! The section that shows where the cameras stand: from above and from the side.

mod plot;
mod time_colours;

use glam::DVec3;
use maud::{Markup, html};

use super::files::RunFiles;
use super::snippet::notice;
use crate::level_axes::level_axes;
use crate::run::SceneFile;
use plot::{MOST_CAMERAS, Projection};
use time_colours::TimeColours;

/// The whole section.
pub(super) fn rig(files: &RunFiles) -> Markup {
    match &files.scene {
        Ok(scene) if !scene.cameras.is_empty() => drawn(scene),
        Ok(_) => html! { p.note { "The scene has no cameras." } },
        Err(missing) => notice(missing),
    }
}

fn drawn(scene: &SceneFile) -> Markup {
    let [right, up, forward] = axes(scene);
    let plots = [
        Projection { title: "From above", right, up: forward, names: ["right \u{2192}", "forward \u{2191}"] },
        Projection { title: "From the side", right: forward, up, names: ["forward \u{2192}", "up \u{2191}"] },
    ];
    let timed = TimeColours::of(scene);
    let count = |is_held_out: bool| scene.cameras.iter().filter(|camera| camera.is_held_out == is_held_out).count();
    let (training, held_out) = (count(false), count(true));
    html! {
        p.note {
            (training) " training and " (held_out) " held-out cameras, in units of the scene. Up is what the training \
            cameras call up on average, forward is where they look. The circle is the scene\u{2019}s extent"
            @if scene.points.is_some() { ", the dashed box holds 96 % of the initial points along each axis" }
            "."
            @if training.max(held_out) > MOST_CAMERAS { " Of each kind, " (MOST_CAMERAS) " are drawn." }
        }
        p.rig-key {
            @match &timed {
                // The colours tell the time, so the kinds differ in their areas alone.
                Some(timed) => { "outlined: training, filled: held out" (timed.legend()) },
                None => { span.key.c0 { "training" } span.key.c1 { "held out (filled)" } },
            }
        }
        div.charts.rig { @for plot in &plots { (plot.draw(scene, timed.as_ref())) } }
    }
}

/// Right, up and forward of the training cameras on average.
fn axes(scene: &SceneFile) -> [DVec3; 3] {
    let sum = |axis: usize| -> DVec3 {
        let training = scene.cameras.iter().filter(|camera| !camera.is_held_out);
        training.map(|camera| camera.views as f64 * DVec3::from_array(camera.axes[axis])).sum()
    };
    level_axes(sum(1), sum(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::SceneCamera;

    fn camera(name: &str, position: [f64; 3], times: [f64; 2], is_held_out: bool) -> SceneCamera {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        SceneCamera { name: name.into(), is_held_out, position, axes, half_size: [0.5, 0.4], times, views: 3 }
    }

    fn scene(times: [[f64; 2]; 2]) -> SceneFile {
        SceneFile {
            extent: 2.0,
            centre: [0.0; 3],
            points: Some([[-1.0, -1.0, 2.0], [1.0, 1.0, 4.0]]),
            cameras: vec![
                camera("a", [-1.0, 0.0, 0.0], times[0], false),
                camera("<b>", [1.0, 0.0, 0.0], times[1], true),
            ],
            held_out: Vec::new(),
        }
    }

    #[test]
    fn cameras_are_seen_from_above_and_from_the_side() {
        let page = drawn(&scene([[0.0, 1.0]; 2])).into_string();
        assert_eq!(page.matches("<svg").count(), 2);
        assert_eq!((page.matches("class=\"camera\"").count(), page.matches("class=\"camera held\"").count()), (2, 2));
        assert!(page.contains("1 training and 1 held-out cameras") && page.contains("&lt;b&gt;"), "{page}");
        assert!(!page.contains("NaN") && !page.contains("inf") && !page.contains("class=\"ramp\""), "{page}");
        assert_eq!(axes(&scene([[0.0, 1.0]; 2])), [DVec3::X, DVec3::NEG_Y, DVec3::Z]);
    }

    #[test]
    fn moments_have_colours_and_a_legend() {
        let page = drawn(&scene([[0.0, 0.0], [0.5, 0.5]])).into_string();
        assert!(page.contains("class=\"ramp\"") && page.contains("time 0.00"), "{page}");
        assert!(
            page.contains(&format!("--curve: {}", time_colours::colour(0.0)))
                && page.contains(&time_colours::colour(1.0)),
            "{page}"
        );
    }
}
