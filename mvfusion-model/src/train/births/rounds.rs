//! Rounds of births in training views: once for photos, repeatedly for videos.

use burn::tensor::{Tensor, TensorData};
use glam::{Affine3A, DVec2, DVec3, Mat3, Vec3};
use image::GrayImage;
use mvfusion_data::{GaussianCloud, Lifetime};

use super::{BirthRule, ComparedView, Ellipse, IN_FRONT};
use crate::initial::{Masking, gaussians_of};
use crate::model::DeformationLevel;
use crate::model::exposure::Exposure;
use crate::model::motion::MotionCache;
use crate::random::Stream;
use crate::train::rendered::{RenderedViews, shown_depths};
use crate::train::{Position, Stage, Trainer, TrainingView};
use crate::{ModelError, tensors};

/// Alpha of a branch below which its depth is unknown.
const LEAST_ALPHA: f32 = 0.5;

/// First random stream of the views, in photos and in videos. They follow the streams of
/// [`Streams`](crate::random::Streams).
const PHOTO_STREAM: u64 = 1 << 20;
const FILM_STREAM: u64 = 1 << 48;

/// Maximum number of moments of a video in a round of births, which bounds its cost.
const MOST_MOMENTS: usize = 32;

/// Iterations to find a canonical centre. Offsets vary little over the length of an offset.
const UNDEFORMING_ROUNDS: usize = 2;

/// A round of births.
struct Round<'a> {
    /// The views to compare.
    views: &'a [usize],
    /// Maximum number of births.
    most: usize,
    rule: BirthRule,
    /// Duration of the new Gaussians, in times between frames.
    duration: f64,
    /// Stream of the first training view.
    stream: u64,
}

impl Trainer {
    /// Whether Gaussians are born in photos after this step: at the end of the first stage.
    pub(in crate::train) fn photo_births_due(&self, position: &Position) -> bool {
        position.stage == Stage::Geometry && position.ends_stage() && self.has_births
    }

    /// Whether Gaussians are born in a video after this step.
    pub(in crate::train) fn film_births_due(&self, position: &Position) -> bool {
        let model = &self.state.model;
        let is_due = position.stage != Stage::Geometry && self.config.densify.births_due(position.step);
        is_due && self.is_video && model.static_.is_some() && model.dynamic.time_centres.is_some()
    }

    /// Births where the photos differ from the static branch.
    pub(in crate::train) fn give_birth_in_photos(&mut self) -> Result<(), ModelError> {
        let views: Vec<usize> = (0..self.photos.len()).collect();
        let (most, duration) = (self.config.init.photo_points, self.config.init.photo_duration);
        let round = Round { views: &views, most, rule: BirthRule::PHOTO, duration, stream: PHOTO_STREAM };
        self.give_birth(&round, Self::beside_static_branch)
    }

    /// Births where a view of each moment, or of some moments, differs from the whole model.
    pub(in crate::train) fn give_birth_in_film(&mut self, position: &Position) -> Result<(), ModelError> {
        let views = self.one_view_a_moment();
        let (most, duration) = (self.config.densify.births, self.config.init.motion_duration);
        let stream = FILM_STREAM + ((position.run_step as u64) << 24);
        let round = Round { views: &views, most, rule: BirthRule::FILM, duration, stream };
        self.give_birth(&round, Self::beside_whole_model)
    }

    /// One random view of each of at most [`MOST_MOMENTS`] moments.
    fn one_view_a_moment(&mut self) -> Vec<usize> {
        let times = self.context.timeline.times();
        let stream = &mut self.state.streams.densify;
        let mut moments = stream.permutation(times.len());
        moments.truncate(MOST_MOMENTS);
        let view_of = |moment: usize| {
            let views = (0..self.photos.len()).filter(|&view| self.photos.get(view).time == times[moment]);
            let views: Vec<usize> = views.collect();
            views[stream.index(views.len())]
        };
        moments.into_iter().map(view_of).collect()
    }

    /// Births in the views of a round, in proportion to each view's error. Only one view is kept at a time, so each is
    /// rendered twice.
    fn give_birth(
        &mut self,
        round: &Round<'_>,
        look: fn(&Self, usize) -> Result<Compared, ModelError>,
    ) -> Result<(), ModelError> {
        let room = self.config.densify.dynamic.max_gaussians.saturating_sub(self.state.model.dynamic.count());
        let wanted = round.most.min(room);
        if wanted == 0 {
            return Ok(());
        }
        let wrongness = round.views.iter().map(|&view| Ok(look(self, view)?.view(round.rule).wrongness()));
        let wrongness = wrongness.collect::<Result<Vec<f64>, ModelError>>()?;
        let all = wrongness.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mut born = GaussianCloud { lifetimes: Some(Vec::new()), ..GaussianCloud::default() };
        let (mut sum, mut given) = (0.0, 0);
        for (&index, wrongness) in round.views.iter().zip(wrongness) {
            // Differences of rounded prefix sums, so that rounding loses none.
            sum += wanted as f64 * wrongness / all;
            let count = sum.round() as usize - given;
            given += count;
            if count == 0 {
                continue;
            }
            let number = round.stream + index as u64;
            let compared = look(self, index)?;
            let view = compared.view(round.rule);
            let ellipses = view.ellipses(count, &mut Stream::new(self.config.seed, number));
            let places = self.places(index, &view, &ellipses, self.config.seed.wrapping_add(number));
            let lifetime = self.lifetime(compared.photo.time, round.duration);
            for (ellipse, place) in ellipses.iter().zip(places) {
                if let Some(place) = place {
                    view.add_to(&mut born, ellipse, place, lifetime);
                }
            }
        }
        if born.is_empty() {
            return Ok(());
        }
        self.add(&born)
    }

    /// The positions of ellipses in a view: where fixed cameras of the moment agree. If too few film it, at the fallback
    /// depths.
    fn places(&self, index: usize, view: &ComparedView<'_>, ellipses: &[Ellipse], seed: u64) -> Vec<Option<DVec3>> {
        match self.finder.as_ref().filter(|finder| finder.films(index)) {
            Some(finder) => {
                let centres: Vec<DVec2> = ellipses.iter().map(|ellipse| ellipse.centre).collect();
                finder.locate(index, &centres, seed)
            }
            None => ellipses.iter().map(|ellipse| view.place(ellipse)).collect(),
        }
    }

    /// Adds Gaussians to the dynamic branch. Their means are positions at their moments. From then on, they have the
    /// descriptors by which they were placed: otherwise, the next measurement would move them.
    fn add(&mut self, born: &GaussianCloud) -> Result<(), ModelError> {
        let masking = Masking::Blended { dynamic_logit: self.config.init.motion_logit };
        let (born, descriptors) = self.undeformed(born)?;
        let dtype = self.state.model.dynamic.means.val().dtype();
        let further = gaussians_of(&born, masking, self.config.model.sh_degree, &self.device, dtype);
        self.state.dynamic_branch().append(&further);
        if let (Some(motion), Some(descriptors)) = (&mut self.state.model.motion, descriptors) {
            motion.replace_last(descriptors);
        }
        Ok(())
    }

    /// The cloud with canonical means, which the model deforms to the given means at their moments, and the descriptors
    /// by which it refines them.
    fn undeformed(&self, born: &GaussianCloud) -> Result<(GaussianCloud, Option<MotionCache>), ModelError> {
        let (level, Some(lifetimes)) = (self.level(), &born.lifetimes) else { return Ok((born.clone(), None)) };
        if level == DeformationLevel::Still {
            return Ok((born.clone(), None));
        }
        let plain = self.state.model.plain();
        let places = TensorData::new(born.means.as_flattened().to_vec(), [born.len(), 3]);
        let places: Tensor<2> = tensors::from_data_like(places, &plain.dynamic.means.val());
        let moments = lifetimes.chunk_by(|one, other| one.centre == other.centre);
        let moments: Vec<(usize, f64)> = moments.map(|rows| (rows.len(), f64::from(rows[0].centre))).collect();
        let (mut means, mut descriptors) = (places.clone(), None);
        for _ in 0..UNDEFORMING_ROUNDS {
            // Motion is also known at the end of the deformation stage, which does not refine yet.
            descriptors = self.descriptors_of_further(&plain, &means, lifetimes)?;
            let refining = descriptors.as_ref().filter(|_| level == DeformationLevel::Refined);
            means = places.clone() - plain.offsets_of_further(means, &moments, refining, &self.context);
        }
        let means: Vec<f32> = tensors::read(means)?;
        let means = means.chunks_exact(3).map(|mean| std::array::from_fn(|axis| mean[axis])).collect();
        Ok((GaussianCloud { means, ..born.clone() }, descriptors))
    }

    /// The deformation level of the current step.
    fn level(&self) -> DeformationLevel {
        let stage = self.position().map_or(Stage::Geometry, |position| position.stage);
        stage.level(self.config.model.deformation)
    }

    /// The lifetime of a Gaussian at this moment, with a duration of `duration` times the distance to the nearest other
    /// moment.
    fn lifetime(&self, time: f64, duration: f64) -> Lifetime {
        let times = self.context.timeline.times();
        let nearest = times.iter().map(|&other| (other - time).abs()).filter(|&away| away > 0.0).fold(1.0, f64::min);
        Lifetime { centre: time as f32, log_duration: (duration * nearest).ln() as f32, velocity: [0.0; 3] }
    }

    /// A training view and the render of the static branch.
    fn beside_static_branch(&self, index: usize) -> Result<Compared, ModelError> {
        let camera = &self.photos.get(index).camera;
        let picture = self.state.model.plain().static_picture(camera, &self.context)?;
        // Proof: `Config::has_births` requires a static branch.
        let layers = picture.expect("the model has a static branch").main();
        let depths = in_front(&known_depths(layers.depth, layers.alpha)?);
        let exposure = self.exposure(&[index]).map(Exposure::inner);
        let colours = layers.colour.unsqueeze_dim(0);
        let colours = exposure.as_ref().map_or(colours.clone(), |exposure| exposure.of_colours(colours));
        self.compared(index, tensors::read(colours)?, exposure.as_ref(), depths)
    }

    /// A training view and the render of both branches, with the depth of the dynamic branch, or in front of the static
    /// branch.
    fn beside_whole_model(&self, index: usize) -> Result<Compared, ModelError> {
        let photo = self.photos.get(index);
        let seen = self.state.model.plain().render(&photo.camera, photo.time, self.level(), None, &self.context)?;
        let [moving, still] = shown_depths(&seen).map(|[depth, alpha]| known_depths(depth, alpha));
        let depths = moving?.into_iter().zip(in_front(&still?));
        let depths = depths.map(|(moving, still)| if moving > 0.0 { moving } else { still }).collect();
        let exposure = self.exposure(&[index]).map(Exposure::inner);
        let seen = RenderedViews { rendered: vec![seen], exposure: exposure.clone() };
        let colours = tensors::read(seen.composed())?;
        let moving = self.photos.moving_mask(index).map(|mask| set_pixels(&mask));
        Ok(Compared { moving, ..self.compared(index, colours, exposure.as_ref(), depths)? })
    }

    fn compared(
        &self,
        index: usize,
        colours: Vec<f32>,
        exposure: Option<&Exposure>,
        depths: Vec<f32>,
    ) -> Result<Compared, ModelError> {
        let decoded = self.photos.pictures().get(index)?;
        Ok(Compared {
            photo: *self.photos.get(index),
            valid: decoded.valid.as_ref().map(|mask| set_pixels(mask)),
            moving: None,
            rgb: decoded.rgb.as_ref().clone(),
            colours,
            exposure: exposure.map(colour_map).transpose()?,
            depths,
        })
    }
}

/// Whether each pixel of a mask is set.
fn set_pixels(mask: &GrayImage) -> Vec<bool> {
    mask.pixels().map(|pixel| pixel.0[0] > 0).collect()
}

/// The colour map of the only view.
fn colour_map(exposure: &Exposure) -> Result<Affine3A, ModelError> {
    let rows: Vec<f32> = tensors::read(exposure.of_view(0))?;
    let column = |k: usize| Vec3::new(rows[k], rows[4 + k], rows[8 + k]);
    Ok(Affine3A::from_mat3_translation(Mat3::from_cols(column(0), column(1), column(2)), column(3)))
}

/// Depth per pixel, 0 where a branch is transparent.
fn known_depths(depth: Tensor<3>, alpha: Tensor<3>) -> Result<Vec<f32>, ModelError> {
    let alphas: Vec<f32> = tensors::read(alpha)?;
    let depths: Vec<f32> = tensors::read(depth)?;
    let known = |(&depth, &alpha): (&f32, &f32)| if alpha < LEAST_ALPHA { 0.0 } else { depth / alpha };
    Ok(depths.iter().zip(&alphas).map(known).collect())
}

/// Depths in front of the static scene.
fn in_front(depths: &[f32]) -> Vec<f32> {
    depths.iter().map(|depth| IN_FRONT * depth).collect()
}

/// A training view and the model's render of it, on the host.
struct Compared {
    photo: TrainingView,
    rgb: image::RgbImage,
    valid: Option<Vec<bool>>,
    moving: Option<Vec<bool>>,
    colours: Vec<f32>,
    exposure: Option<Affine3A>,
    depths: Vec<f32>,
}

impl Compared {
    fn view(&self, rule: BirthRule) -> ComparedView<'_> {
        ComparedView {
            camera: &self.photo.camera,
            photo: &self.rgb,
            valid: self.valid.as_deref(),
            moving: self.moving.as_deref(),
            colours: &self.colours,
            exposure: self.exposure,
            depths: &self.depths,
            rule,
        }
    }
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use mvfusion_data::BuiltinOptions;
    use mvfusion_data::builtin::builtin;

    use super::*;
    use crate::config::{
        Config, Decay, Descriptor, ModelConfig, MotionConfig, OptimConfig, Refinement, StageConfig, Temporal,
        TrainConfig, Trajectory,
    };
    use crate::device;
    use crate::test_support::values;

    /// A trainer in its last stage.
    fn refined(motion: MotionConfig) -> Trainer {
        begun(motion, [1, 1, 9], 8)
    }

    /// A trainer after some steps of its stages. The high rate gives the modules something to say.
    fn begun(motion: MotionConfig, stages: [usize; 3], steps: usize) -> Trainer {
        let scene = builtin(&BuiltinOptions { width: 24, height: 18, frames: 5, ..BuiltinOptions::default() });
        let config = Config {
            model: ModelConfig { lifetime: true, ..ModelConfig::default() },
            motion: MotionConfig { window: 1, knot_stride: 1, ..motion },
            optim: OptimConfig { motion: Decay { start: 2e-3, end: 2e-3 }, ..OptimConfig::default() },
            train: TrainConfig { stages: StageConfig::of(stages), ..TrainConfig::default() },
            ..Config::default()
        };
        let mut trainer = Trainer::new(config, &scene, &device::flex()).expect("the run can start");
        (0..steps).for_each(|_| assert!(trainer.step().expect("a step succeeds").is_some()));
        trainer
    }

    /// Three Gaussians, of which two are born at the same time.
    fn newborns() -> GaussianCloud {
        let lifetime = |centre| Lifetime { centre, log_duration: -3.0, velocity: [0.5; 3] };
        GaussianCloud {
            means: vec![[0.1, 0.2, 0.3], [-0.4, 0.1, 0.2], [0.3, -0.2, 0.5]],
            sh_dc: vec![[0.0; 3]; 3],
            opacity_logits: vec![0.0; 3],
            log_scales: vec![[-3.0; 3]; 3],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            lifetimes: Some(vec![lifetime(0.25), lifetime(0.25), lifetime(0.75)]),
            ..GaussianCloud::default()
        }
    }

    /// The largest distance between where the last Gaussians should be and where they are rendered, how far the
    /// refinement moves them, and how far the whole deformation does.
    fn misplaced(trainer: &Trainer, born: &GaussianCloud) -> [f64; 3] {
        let (model, context) = (trainer.state.model.plain(), &trainer.context);
        let known = model.dynamic.count() - born.len();
        let shown = |time, level| values(model.dynamic_at(time, level, context).means.narrow(0, known, 3));
        let canonical = values(model.dynamic.means.val().narrow(0, known, 3));
        let mut largest = [0.0f64; 3];
        for (row, time) in [(0, 0.25), (1, 0.25), (2, 0.75)] {
            let [refined, base] = [DeformationLevel::Refined, DeformationLevel::Base].map(|level| shown(time, level));
            for axis in 0..3 {
                let at = 3 * row + axis;
                largest[0] = largest[0].max((refined[at] - f64::from(born.means[row][axis])).abs());
                largest[1] = largest[1].max((refined[at] - base[at]).abs());
                largest[2] = largest[2].max((refined[at] - canonical[at]).abs());
            }
        }
        largest
    }

    #[test]
    fn gaussians_are_born_where_the_refined_model_shows_them() {
        for (mvg, mfta) in [(true, true), (false, true), (true, false)] {
            let mut trainer = refined(MotionConfig { mvg, mfta, ..MotionConfig::default() });
            trainer.add(&newborns()).expect("the device answers");
            let [off, moved, _] = misplaced(&trainer, &newborns());
            assert!(off < 0.1 * moved, "MVG {mvg}, MFTA {mfta}: off by {off}, moved by {moved}");
        }
    }

    #[test]
    fn those_of_the_last_step_before_the_refinement_are_measured() {
        let mut trainer = begun(MotionConfig::default(), [1, 5, 5], 5);
        let intensities = |trainer: &Trainer| {
            let all = values(trainer.state.model.motion.as_ref().expect("measured").intensity.clone());
            all[all.len() - 3..].to_vec()
        };
        assert_eq!(trainer.level(), DeformationLevel::Base);
        trainer.refresh_motion().expect("the device answers");
        trainer.add(&newborns()).expect("the device answers");
        let at_birth = intensities(&trainer);
        trainer.refresh_motion().expect("the device answers");
        for (at_birth, then) in at_birth.into_iter().zip(intensities(&trainer)) {
            // They are placed once more after they were measured.
            assert!(at_birth > 0.3 * then && then > 0.3 * at_birth, "{at_birth} at birth, then {then}");
        }
    }

    #[test]
    fn the_next_measurement_leaves_them_there() {
        let all = MotionConfig::default();
        for (motion, most) in [
            (MotionConfig { mvg: false, ..all.clone() }, 0.1),
            (MotionConfig { mfta: false, ..all.clone() }, 0.1),
            (MotionConfig { trajectory: Trajectory::Lifetime, ..all.clone() }, 0.1),
            // Two rounds leave more where both modules, velocities or neighbours change with the place.
            (all.clone(), 0.25),
            (MotionConfig { descriptor: Descriptor::Momentary, ..all.clone() }, 0.4),
            (MotionConfig { temporal: Temporal::Spatial, ..all }, 0.4),
        ] {
            let mut trainer = refined(motion.clone());
            trainer.add(&newborns()).expect("the device answers");
            trainer.refresh_motion().expect("the device answers");
            let [off, moved, _] = misplaced(&trainer, &newborns());
            assert!(off < most * moved, "{motion:?}: off by {off}, moved by {moved}");
        }
    }

    #[test]
    fn without_modules_they_are_born_there_too() {
        for refinement in [Refinement::Replace, Refinement::Sum] {
            let motion = MotionConfig { mvg: false, mfta: false, refinement, ..MotionConfig::default() };
            let mut trainer = refined(motion);
            trainer.add(&newborns()).expect("the device answers");
            let [off, by_refinement, moved] = misplaced(&trainer, &newborns());
            assert_eq!(by_refinement == 0.0, refinement == Refinement::Replace, "a sum has the base offsets twice");
            // Two rounds leave what the offsets vary over the length of an offset.
            assert!(off < 0.2 * moved, "{refinement:?}: off by {off}, moved by {moved}");
        }
    }
}
