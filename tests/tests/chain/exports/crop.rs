//! Exports of the Gaussians in a box.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;

use burn::tensor::{Int, Tensor, TensorData};
use glam::DVec3;
use mvfusion_cli::args::{CropArgs, ExportArgs};
use mvfusion_cli::failure::{USAGE, exit_code};
use mvfusion_model::model::gaussians::RawGaussians;
use mvfusion_tests::numbers;

use super::{Run, assert_holds, assert_opacities, assert_shapes, parse};
use crate::training::config;

/// Whether a point lies in a box along the axes.
fn is_inside(point: &DVec3, centre: DVec3, size: DVec3) -> bool {
    (0..3).all(|axis| (point[axis] - centre[axis]).abs() <= size[axis] / 2.0)
}

fn centres(gaussians: &RawGaussians) -> Vec<DVec3> {
    numbers(gaussians.means.clone()).chunks_exact(3).map(DVec3::from_slice).collect()
}

/// Some rows, in their order.
fn rows_of(gaussians: RawGaussians, rows: &BTreeSet<usize>) -> RawGaussians {
    let index: Vec<i32> = rows.iter().map(|&row| row as i32).collect();
    let index = Tensor::<1, Int>::from_data(TensorData::new(index, [rows.len()]), &gaussians.means.device());
    gaussians.select(&index)
}

/// Cuts an export down to a box.
fn cut(args: &mut ExportArgs, centre: DVec3, size: DVec3) {
    args.crop = CropArgs { crop_centre: Some(centre), crop_size: Some(size), crop_rotation: None };
}

#[test]
fn a_crop_has_what_is_in_the_box_at_some_time_as_it_is_in_the_whole() {
    let run = Run::new(config());
    let (model, static_) = (run.model(), run.static_());
    let times = run.trainer.render_context().timeline.times();
    let at_times: Vec<Vec<DVec3>> = times.iter().map(|&time| centres(&run.moved(&model, time))).collect();
    // The edges lie where a dynamic Gaussian passes during the video, so that it is inside for a part of it.
    let travel = |row: usize| (at_times[0][row].x - at_times[times.len() - 1][row].x).abs();
    let mover = (0..at_times[0].len()).max_by(|&a, &b| travel(a).total_cmp(&travel(b))).expect("a Gaussian");
    let edge = (at_times[0][mover].x + at_times[times.len() - 1][mover].x) / 2.0;
    let (centre, size) = (DVec3::new(edge + 1.0, 0.0, 0.0), DVec3::new(2.0, 40.0, 40.0));
    let inside = |centres: &[DVec3]| -> BTreeSet<usize> {
        (0..centres.len()).filter(|&row| is_inside(&centres[row], centre, size)).collect()
    };
    let fixed = inside(&centres(&static_));
    let (first, last) = (inside(&at_times[0]), inside(&at_times[times.len() - 1]));
    let moving: BTreeSet<usize> = at_times.iter().flat_map(|centres| inside(centres)).collect();
    assert!(!fixed.is_empty() && fixed.len() < centres(&static_).len(), "the box cuts the static branch");
    assert!(first != last && moving.len() > first.len().min(last.len()), "the box is entered or left");

    let out = run.export("crop", |args| {
        cut(args, centre, size);
        (args.frames, args.shared_static) = (NonZeroUsize::new(2), true);
    });
    let found = parse(&out.join("static.ply"));
    assert_holds(&found, 0..fixed.len(), &rows_of(static_.clone(), &fixed));
    assert_opacities(&found, 0..found.rows.len(), &rows_of(static_, &fixed));
    let found = parse(&out.join("dynamic.ply"));
    assert_eq!(found.rows.len(), moving.len());
    assert_holds(&found, 0..moving.len(), &rows_of(model.dynamic.canonical(), &moving));
    // The refinement of what is kept does not change.
    for (file, time) in [("frame0001.ply", times[0]), ("frame0002.ply", times[times.len() - 1])] {
        let found = parse(&out.join("frames").join(file));
        assert_shapes(&found, &(0..moving.len()), &rows_of(run.moved(&model, time), &moving));
    }
}

#[test]
fn a_branch_outside_the_box_leaves_one_gaussian_that_nobody_sees() {
    let run = Run::new(config());
    let static_ = centres(&run.static_());
    let times = run.trainer.render_context().timeline.times();
    let moving: Vec<DVec3> = times.iter().flat_map(|&time| centres(&run.moved(&run.model(), time))).collect();
    // The static Gaussian that is farthest from all dynamic ones.
    let distance = |point: &DVec3| moving.iter().map(|other| point.distance(*other)).fold(f64::INFINITY, f64::min);
    let centre = static_.iter().max_by(|a, b| distance(a).total_cmp(&distance(b))).expect("a Gaussian");
    let size = DVec3::splat(distance(centre));
    let out = run.export("still", |args| cut(args, *centre, size));
    assert!(!parse(&out.join("static.ply")).rows.is_empty());
    let opacities = parse(&out.join("dynamic.ply")).column("opacity");
    assert!(matches!(opacities.as_slice(), [opacity] if *opacity < -80.0), "{opacities:?}");
}

#[test]
fn an_empty_box_is_refused_and_tells_where_the_gaussians_are() {
    let run = Run::new(config());
    let error =
        run.try_export("nothing", |args| cut(args, DVec3::splat(1e4), DVec3::ONE)).expect_err("there is nothing");
    assert_eq!(exit_code(&error), USAGE);
    let said = format!("{error:#}");
    assert!(said.contains("no Gaussian lies in the box") && said.contains("--crop-centre"), "{said}");
    assert!(!run.place.path().join("nothing").exists());
}
