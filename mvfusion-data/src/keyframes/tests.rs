//! Tests of quantised Gaussians.

use super::*;
use crate::{GaussianCloud, rest_width};

/// Step of the centres in these tests.
const STEP: f64 = 1e-3;

/// A number in `[-1, 1)` from a counter.
fn noise(counter: usize) -> f32 {
    let mixed = (counter as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    mixed as f32 / (1 << 23) as f32 - 1.0
}

/// Gaussians that move along x with time.
fn cloud(count: usize, sh_degree: usize, time: f32) -> GaussianCloud {
    let row = |index: usize, seed: usize| noise(100 * index + seed);
    GaussianCloud {
        sh_degree,
        means: (0..count).map(|i| [3.0 * row(i, 0) + time, 3.0 * row(i, 1), 3.0 * row(i, 2)]).collect(),
        sh_dc: (0..count).map(|i| [row(i, 3), row(i, 4), row(i, 5) + time]).collect(),
        sh_rest: (0..count * rest_width(sh_degree)).map(|i| 0.2 * noise(i)).collect(),
        opacity_logits: (0..count).map(|i| 4.0 * row(i, 6)).collect(),
        log_scales: (0..count).map(|i| [row(i, 7) - 3.0, row(i, 8) - 3.0, row(i, 9) - 3.0 + time]).collect(),
        // The sign flips with time, which is the same rotation.
        quaternions: (0..count)
            .map(|i| [2.0, row(i, 10), row(i, 11), time].map(|part| if time > 0.4 { -part } else { part }))
            .collect(),
        mask_logits: Some((0..count).map(|i| [row(i, 12), row(i, 13), 3.0 * row(i, 14)]).collect()),
        lifetimes: None,
    }
}

fn keyframes(count: usize, sh_degree: usize, times: &[f64]) -> Keyframes {
    let mut builder = KeyframesBuilder::new(&cloud(count, sh_degree, 0.0), STEP);
    times.iter().for_each(|&time| builder.push(time, &cloud(count, sh_degree, time as f32)));
    builder.finish()
}

fn to(stride: usize, sh_degree: usize) -> Reduction {
    Reduction { step_factor: 1, stride, sh_degree }
}

fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

fn assert_close(found: impl IntoIterator<Item = f32>, wanted: impl IntoIterator<Item = f32>, bound: f32, what: &str) {
    for (index, (found, wanted)) in found.into_iter().zip(wanted).enumerate() {
        assert!((found - wanted).abs() <= bound, "{what} {index}: {found}, not {wanted}");
    }
}

/// Asserts that Gaussians are those of [`cloud`] up to half a step and rounding.
fn assert_is_cloud(found: &GaussianCloud, wanted: &GaussianCloud) {
    let half = |quantity| (0.5 * UniformQuantizer::of(quantity, STEP).step) as f32 + 1e-5;
    let flat = |rows: &[[f32; 3]]| rows.as_flattened().to_vec();
    assert_close(flat(&found.means), flat(&wanted.means), half(Quantity::Mean), "centre");
    assert_close(flat(&found.log_scales), flat(&wanted.log_scales), half(Quantity::LogScale), "size");
    assert_close(flat(&found.sh_dc), flat(&wanted.sh_dc), half(Quantity::ShDc), "colour");
    assert_close(found.sh_rest.clone(), wanted.sh_rest.clone(), half(Quantity::ShRest), "coefficient");
    let opacities = |cloud: &GaussianCloud| cloud.opacity_logits.iter().map(|&o| sigmoid(o)).collect::<Vec<_>>();
    assert_close(opacities(found), opacities(wanted), half(Quantity::Opacity), "opacity");
    let masks = |cloud: &GaussianCloud| {
        let masks = cloud.mask_logits.as_ref().expect("masks");
        masks.as_flattened().iter().map(|&m| sigmoid(m)).collect::<Vec<_>>()
    };
    assert_close(masks(found), masks(wanted), half(Quantity::Mask), "mask");
    for (found, wanted) in found.quaternions.iter().zip(&wanted.quaternions) {
        let unit = |q: &[f32; 4]| q.map(|part| part / q.iter().map(|p| p * p).sum::<f32>().sqrt());
        let product: f32 = unit(found).iter().zip(unit(wanted)).map(|(a, b)| a * b).sum();
        // Half a step in each of four parts.
        assert!(1.0 - product.abs() < 4.0 * half(Quantity::Rotation).powi(2), "{found:?}, not {wanted:?}");
    }
}

#[test]
fn a_keyframe_is_what_was_put_in_up_to_half_a_step() {
    let frames = keyframes(50, 2, &[0.0, 0.25, 0.5, 1.0]);
    for time in [0.0, 0.25, 0.5, 1.0] {
        assert_is_cloud(&frames.at(time), &cloud(50, 2, time as f32));
    }
}

#[test]
fn a_linear_motion_is_met_between_keyframes_and_stands_still_outside() {
    let frames = keyframes(20, 0, &[0.25, 0.75]);
    let wanted = cloud(20, 0, 0.5);
    // The mean of two roundings, and the quaternion is no linear function of time.
    assert_close(frames.at(0.5).means.concat(), wanted.means.concat(), STEP as f32, "centre");
    assert_close(frames.at(0.5).log_scales.concat(), wanted.log_scales.concat(), 1.0 / 64.0, "size");
    assert_eq!((frames.at(0.0), frames.at(1.0)), (frames.at(0.25), frames.at(0.75)));
}

#[test]
fn a_flipped_quaternion_does_not_turn_on_the_way() {
    let frames = keyframes(20, 0, &[0.0, 0.5]);
    for (middle, start) in frames.at(0.25).quaternions.iter().zip(&frames.at(0.0).quaternions) {
        let product: f32 = middle.iter().zip(start).map(|(a, b)| a * b).sum();
        assert!(product > 0.9, "{middle:?} after {start:?}");
    }
}

#[test]
fn bytes_bring_back_every_number() {
    let moving = keyframes(300, 1, &[0.0, 0.5, 0.75]);
    let rows: Vec<usize> = (0..40).collect();
    let still = keyframes(40, 3, &[0.0]).reduced(&rows, to(1, 3));
    let (layouts, bytes) = encode(&[&still, &moving]).expect("packed");
    assert_eq!(decode(&layouts, &bytes).expect("unpacked"), [still, moving]);
    let text = serde_json::to_string(&layouts).expect("JSON");
    assert_eq!(serde_json::from_str::<Vec<BranchLayout>>(&text).expect("JSON"), layouts);
    assert!(matches!(decode(&layouts[..1], &bytes), Err(DecodeError::Length { .. })));
    assert!(matches!(decode(&layouts, &bytes[..bytes.len() / 2]), Err(DecodeError::Stream(_))));
}

#[test]
fn a_description_that_contradicts_itself_is_refused() {
    let (layouts, bytes) = encode(&[&keyframes(4, 1, &[0.0, 0.5, 0.75])]).expect("packed");
    let refused = |what: &str, change: &dyn Fn(&mut BranchLayout)| {
        let mut layout = layouts[0].clone();
        change(&mut layout);
        assert!(matches!(decode(&[layout], &bytes), Err(DecodeError::Layout(_))), "{what}");
    };
    refused("five bytes", &|layout| layout.tracks[0].bytes = 5);
    refused("no bytes", &|layout| layout.tracks[0].bytes = 0);
    refused("a column is missing", &|layout| layout.tracks[0].columns = 2);
    refused("keyframes are missing", &|layout| layout.tracks[0].keyframes = 1);
    refused("a track is missing", &|layout| layout.tracks.truncate(3));
    refused("half a mask", &|layout| layout.tracks.retain(|track| track.name != Quantity::Brightness));
    refused("a track twice", &|layout| layout.tracks.push(layout.tracks[0].clone()));
    refused("degree 4", &|layout| layout.sh_degree = 4);
    refused("no time", &|layout| layout.times.clear());
    refused("times that fall", &|layout| layout.times.reverse());
    refused("a time that is none", &|layout| layout.times[2] = f64::NAN);
    refused("a step of zero", &|layout| layout.tracks[0].step = 0.0);
    refused("too many Gaussians", &|layout| layout.count = usize::MAX / 2);
}

#[test]
fn no_more_is_unpacked_than_the_description_needs() {
    let (layouts, bytes) = encode(&[&keyframes(4, 0, &[0.0])]).expect("packed");
    let mut bomb = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    // The end is damaged, which only a reader of all of it would notice.
    std::io::Write::write_all(&mut bomb, &vec![0; 1 << 24]).expect("packed");
    let mut bomb = bomb.finish().expect("packed");
    assert!(bomb.len() < 1 << 16 && bytes.len() < 1 << 16);
    bomb.truncate(bomb.len() / 2);
    assert!(matches!(decode(&layouts, &bomb), Err(DecodeError::Length { .. })));
}

#[test]
fn no_gaussians_have_few_bytes() {
    let nothing = keyframes(4, 1, &[0.0, 1.0]).reduced(&[], to(1, 1));
    let (layouts, bytes) = encode(&[&nothing]).expect("packed");
    assert_eq!((decode(&layouts, &bytes).expect("unpacked"), nothing.at(0.5).len()), (vec![nothing], 0));
}

#[test]
fn fewer_keyframes_keep_the_first_and_the_last() {
    let times: Vec<f64> = (0..8).map(|k| f64::from(k) / 8.0).collect();
    let frames = keyframes(30, 3, &times);
    let all: Vec<usize> = (0..30).collect();
    let fewer = frames.reduced(&all, to(3, 1));
    assert_eq!((fewer.times(), fewer.sh_degree(), fewer.count()), (&[0.0, 0.375, 0.75, 0.875][..], 1, 30));
    let mut xs =
        [fewer.at(0.375), frames.at(0.375)].map(|cloud| cloud.means.iter().map(|mean| mean[0]).collect::<Vec<_>>());
    xs.iter_mut().for_each(|xs| xs.sort_by(f32::total_cmp));
    assert_eq!(xs[0], xs[1], "the same Gaussians in another order");
    assert_eq!(fewer.at(0.0).sh_rest.len(), 30 * rest_width(1));
}

#[test]
fn what_cannot_be_seen_keeps_still_and_what_never_can_is_told() {
    let opacity = [-20.0, -20.0, 2.0, -20.0, -20.0, -20.0];
    let mut builder = KeyframesBuilder::new(&cloud(2, 0, 0.0), STEP);
    for (k, logit) in opacity.into_iter().enumerate() {
        let time = k as f32 / 8.0;
        builder.push(f64::from(time), &GaussianCloud { opacity_logits: vec![logit, -20.0], ..cloud(2, 0, time) });
    }
    let frames = builder.finish();
    assert_eq!(frames.visible_rows(), [0]);
    let held = frames.reduced(&[0], to(1, 0));
    let x: Vec<f32> = (0..6).map(|k| held.at(f64::from(k) / 8.0).means[0][0]).collect();
    // Seen at the keyframe 2, and on the way from 1 and to 3.
    assert!(x[0] == x[1] && x[1] < x[2] && x[2] < x[3] && x[3] == x[4] && x[4] == x[5], "{x:?}");
}

#[test]
fn larger_steps_make_larger_errors_and_fewer_bytes() {
    let frames = keyframes(200, 1, &[0.0, 0.5, 1.0]);
    let all: Vec<usize> = (0..200).collect();
    let fine = frames.reduced(&all, to(1, 1));
    let coarse = frames.reduced(&all, Reduction { step_factor: 4, ..to(1, 1) });
    let means = [&fine, &coarse].map(|frames| frames.at(0.5).means.concat());
    assert_close(means[1].clone(), means[0].clone(), 2.0 * STEP as f32 + 1e-5, "centre");
    let sizes = [&fine, &coarse].map(|frames| encode(&[frames]).expect("packed").1.len());
    assert!(10 * sizes[1] < 9 * sizes[0], "{sizes:?} bytes");
    assert_eq!(coarse.at(0.5).opacity_logits, fine.at(0.5).opacity_logits, "opacities keep their steps");
}

#[test]
fn a_brightness_above_the_knee_has_finer_steps() {
    // The brightness factor has a slope of 37 there: one level of 255 in the static colour.
    const LEVEL: f32 = 1.0 / 255.0 / 37.0;
    let (fine, below_knee) = (LEVEL * 1.25, 0.54 / 255.0);
    // Coarser steps are no larger than those below the knee.
    for (logit, step_factor, bound) in
        [(2.2, 1, fine), (2.2, 4, 5.0 * fine), (0.5, 1, below_knee), (0.5, 4, below_knee)]
    {
        let mut builder = KeyframesBuilder::new(&cloud(50, 0, 0.0), STEP);
        let with_logits = |time: f32| {
            let mut cloud = cloud(50, 0, time);
            let masks = cloud.mask_logits.as_mut().expect("masks");
            masks.iter_mut().enumerate().for_each(|(row, mask)| mask[1] = logit + 0.01 * noise(row) - 0.1 * time);
            cloud
        };
        [0.0, 1.0].into_iter().for_each(|time| builder.push(time.into(), &with_logits(time)));
        let rows: Vec<usize> = (0..50).collect();
        let frames = builder.finish().reduced(&rows, Reduction { step_factor, ..to(1, 0) });
        let (layouts, bytes) = encode(&[&frames]).expect("packed");
        let brightness = layouts[0].tracks.iter().find(|track| track.name == Quantity::Brightness).expect("a track");
        assert!(0.5 * brightness.step <= f64::from(bound) && brightness.step >= f64::from(bound), "{brightness:?}");
        let sorted = |cloud: &GaussianCloud| {
            let mut shares: Vec<f32> = cloud.mask_logits.iter().flatten().map(|mask| sigmoid(mask[1])).collect();
            shares.sort_by(f32::total_cmp);
            shares
        };
        let unpacked = decode(&layouts, &bytes).expect("unpacked");
        assert_close(sorted(&unpacked[0].at(1.0)), sorted(&with_logits(1.0)), bound, "brightness");
    }
}

#[test]
fn constant_colours_are_shifted_at_one_keyframe() {
    let mut frames = keyframes(3, 0, &[0.0, 1.0]);
    let before = [0.0, 1.0].map(|time| frames.at(time).sh_dc);
    let shifts = [[0.5, 0.0, -0.25], [0.0; 3], [1.0, 1.0, 1.0]];
    frames.shift_sh_dc(1, &shifts);
    assert_eq!(frames.at(0.0).sh_dc, before[0]);
    for ((after, before), shift) in frames.at(1.0).sh_dc.iter().zip(&before[1]).zip(shifts) {
        assert_close(*after, [0, 1, 2].map(|channel| before[channel] + shift[channel]), 1e-5, "colour");
    }
}
