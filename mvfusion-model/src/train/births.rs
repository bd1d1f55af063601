//! Gaussians for what only one photo shows, born when the static branch knows what is still.

use mvfusion_data::{GaussianCloud, Lifetime};

use super::{Photo, Position, Stage, Trainer};
use crate::births::StillView;
use crate::initial::{Masking, gaussians_of};
use crate::random::Stream;
use crate::{ModelError, tensors};

/// Alpha of the static branch below which its depth says nothing.
const LEAST_ALPHA: f32 = 0.5;

/// The first stream of the views' own random numbers, behind those of [`Streams`](crate::random::Streams).
const STREAM: u64 = 1 << 20;

impl Trainer {
    /// Whether they are born after this step: at the end of the first stage.
    pub(super) fn births_due(&self, position: &Position) -> bool {
        position.stage == Stage::Geometry && position.ends_stage() && self.has_births
    }

    /// Lets Gaussians be born where the photos differ from the static branch: as many in each as its error's share of all.
    /// One photo is held at a time, so each is looked at twice.
    pub(super) fn give_birth(&mut self) -> Result<(), ModelError> {
        let room = self.config.densify.dynamic.max_gaussians.saturating_sub(self.state.model.dynamic.gaussians.count());
        let wanted = self.config.init.photo_points.min(room);
        let views = 0..self.photos.len();
        let wrongness = views.clone().map(|index| Ok(self.still(index)?.view().wrongness()));
        let wrongness = wrongness.collect::<Result<Vec<f64>, ModelError>>()?;
        let all = wrongness.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mut born = GaussianCloud { lifetimes: Some(Vec::new()), ..GaussianCloud::default() };
        let (mut sum, mut given) = (0.0, 0);
        for (index, wrongness) in views.zip(wrongness) {
            // Of the sums so far, so that rounding loses none.
            sum += wanted as f64 * wrongness / all;
            let count = sum.round() as usize - given;
            given += count;
            let mut stream = Stream::new(self.config.seed, STREAM + index as u64);
            let still = self.still(index)?;
            still.view().births(count, self.lifetime(still.photo.time), &mut stream, &mut born);
        }
        if born.is_empty() {
            return Ok(());
        }
        self.state.census[0].added += born.len();
        let masking = Masking::Blended { dynamic_logit: self.config.init.motion_logit };
        let branch = &mut self.state.model.dynamic;
        let dtype = branch.gaussians.means.val().dtype();
        branch.append(&gaussians_of(&born, masking, self.config.model.sh_degree, &self.device, dtype));
        Ok(())
    }

    /// A Gaussian that only the photo of this moment shows.
    fn lifetime(&self, time: f64) -> Lifetime {
        let times = self.surroundings.timeline.times();
        let nearest = times.iter().map(|&other| (other - time).abs()).filter(|&away| away > 0.0).fold(1.0, f64::min);
        let log_duration = (self.config.init.photo_duration * nearest).ln() as f32;
        Lifetime { centre: time as f32, log_duration, velocity: [0.0; 3] }
    }

    /// A training view and what the static branch shows there.
    fn still(&self, index: usize) -> Result<Still, ModelError> {
        let photo = *self.photos.get(index);
        let decoded = self.photos.pictures().get(index)?;
        let picture = self.state.model.plain().static_picture(&photo.camera, None, &self.surroundings)?;
        // Proof: `births_due` asks for a static branch.
        let layers = picture.expect("the model has a static branch").main();
        let alphas: Vec<f32> = tensors::read(layers.alpha)?;
        let depths: Vec<f32> = tensors::read(layers.depth)?;
        let depth = |(&depth, &alpha): (&f32, &f32)| if alpha < LEAST_ALPHA { 0.0 } else { depth / alpha };
        Ok(Still {
            photo,
            counted: decoded.counted.as_ref().map(|mask| mask.pixels().map(|pixel| pixel.0[0] > 0).collect()),
            rgb: decoded.rgb.as_ref().clone(),
            colours: tensors::read(layers.colour)?,
            depths: depths.iter().zip(&alphas).map(depth).collect(),
        })
    }
}

/// A training view on the host.
struct Still {
    photo: Photo,
    rgb: image::RgbImage,
    counted: Option<Vec<bool>>,
    colours: Vec<f32>,
    depths: Vec<f32>,
}

impl Still {
    fn view(&self) -> StillView<'_> {
        StillView {
            camera: &self.photo.camera,
            photo: &self.rgb,
            counted: self.counted.clone(),
            colours: &self.colours,
            depths: &self.depths,
        }
    }
}
