//! Places at one moment where cameras see motion in one colour.

use glam::{DVec2, DVec3, Vec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::eye::Eye;
use super::moving_pixels::MotionMap;
use super::options::MotionHullOptions;
use super::reach::least_seeing;

/// A place with motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// World units.
    pub position: DVec3,
    /// Mean of the agreeing colours, 8-bit levels.
    pub colour: Vec3,
    /// Mean difference from the still scene over the cameras that see it, 8-bit levels.
    pub motion: f64,
    /// Standard deviation of the agreeing colours, 8-bit levels.
    spread: f32,
}

/// A ray through a moving pixel.
#[derive(Clone, Copy, Debug)]
struct Ray {
    origin: DVec3,
    /// Of depth 1.
    direction: DVec3,
    colour: Vec3,
    /// Range of depths to search.
    reach: [f64; 2],
}

impl Ray {
    /// The ray in a direction of depth 1, with the colour of a block.
    fn of(eye: &Eye, direction: DVec3, block: usize) -> Self {
        Self { origin: eye.centre, direction, colour: eye.colour(block), reach: eye.reach }
    }
}

/// The search for places at one moment.
#[derive(Debug)]
pub(super) struct Search<'a> {
    eyes: Vec<Eye<'a>>,
    options: &'a MotionHullOptions,
    /// Number of cameras that must see a place.
    needed: usize,
    cos_side: f64,
}

impl<'a> Search<'a> {
    pub fn new(mut eyes: Vec<Eye<'a>>, options: &'a MotionHullOptions) -> Self {
        let needed = least_seeing(eyes.len(), options);
        // The camera with the least motion comes first, because it rejects most places.
        eyes.sort_by_key(|eye| eye.map.blocks().iter().filter(|block| block.moves()).count());
        Self { eyes, options, needed, cos_side: options.side_degrees.to_radians().cos() }
    }

    /// The best place on each of about `rays` rays, equally many per camera. Most rays through noise have none.
    pub fn places(&self, rays: usize, rng: &mut ChaCha8Rng) -> Vec<Place> {
        let each = rays.div_ceil(self.eyes.len().max(1));
        let mut places = Vec::new();
        for eye in &self.eyes {
            let moving = MovingBlocks::of(eye.map);
            // If nothing moves, nothing can be drawn.
            for _ in 0..if moving.is_empty() { 0 } else { each } {
                let block = moving.draw(rng);
                let [first, end] = eye.map.corners(block);
                let within = DVec2::new(rng.random(), rng.random());
                let direction = eye.direction(first + within * (end - first));
                places.extend(self.best_on(&Ray::of(eye, direction, block), rng));
            }
        }
        places
    }

    /// The best place on an eye's ray through a pixel position.
    pub fn place_through(&self, eye: &Eye, position: DVec2, rng: &mut ChaCha8Rng) -> Option<Place> {
        let block = eye.map.index(position)?;
        self.best_on(&Ray::of(eye, eye.direction(position), block), rng)
    }

    /// The place on a ray where the colours agree best.
    fn best_on(&self, ray: &Ray, rng: &mut ChaCha8Rng) -> Option<Place> {
        let [near, far] = ray.reach.map(f64::recip);
        let mut best: Option<Place> = None;
        let mut blocks = Vec::with_capacity(self.eyes.len());
        for step in 0..self.options.depths {
            let share = (step as f64 + rng.random::<f64>()) / self.options.depths as f64;
            let position = ray.origin + ray.direction / (near + share * (far - near));
            if !self.sees_motion(position, &mut blocks) {
                continue;
            }
            let place = self.coloured(position, ray, &blocks);
            best = [best, place].into_iter().flatten().min_by(|a, b| a.spread.total_cmp(&b.spread));
        }
        best
    }

    /// Whether enough cameras see a place, and nearly all of them see motion there. Fills `blocks` with these cameras
    /// and the blocks at the place's projections.
    fn sees_motion(&self, place: DVec3, blocks: &mut Vec<(usize, usize)>) -> bool {
        blocks.clear();
        let all = self.eyes.len();
        let still_share = 1.0 - self.options.moving_share;
        let (mut blind, mut still) = (0, 0);
        for (index, eye) in self.eyes.iter().enumerate() {
            match eye.block(place) {
                None => blind += 1,
                Some(block) => {
                    still += usize::from(!eye.map.blocks()[block].moves());
                    blocks.push((index, block));
                }
            }
            // Stops as soon as the remaining cameras cannot change the answer.
            if blind + self.needed > all || still as f64 > still_share * all as f64 + ROUNDING {
                return false;
            }
        }
        still as f64 <= still_share * blocks.len() as f64 + ROUNDING
    }

    /// The place with its colour, if the cameras on the ray's side agree in one.
    fn coloured(&self, position: DVec3, ray: &Ray, blocks: &[(usize, usize)]) -> Option<Place> {
        let forward = ray.direction.normalize_or_zero();
        let beside = |eye: &Eye| (position - eye.centre).normalize_or_zero().dot(forward) > self.cos_side;
        let beside = blocks.iter().filter(|&&(eye, _)| beside(&self.eyes[eye]));
        let mut colours: Vec<Vec3> = beside.map(|&(eye, block)| self.eyes[eye].colour(block)).collect();
        let agreeing = (self.options.agreeing_share * colours.len() as f64 - ROUNDING).ceil() as usize;
        if agreeing < self.options.least_cameras {
            return None;
        }
        colours.sort_by(|a, b| a.distance_squared(ray.colour).total_cmp(&b.distance_squared(ray.colour)));
        colours.truncate(agreeing);
        let colour = colours.iter().sum::<Vec3>() / agreeing as f32;
        // Mean over the three channels.
        let variance = colours.iter().map(|c| c.distance_squared(colour) / 3.0).sum::<f32>() / agreeing as f32;
        let spread = variance.sqrt();
        let difference = |&(eye, block): &(usize, usize)| f64::from(self.eyes[eye].map.blocks()[block].difference());
        let motion = blocks.iter().map(difference).sum::<f64>() / blocks.len() as f64;
        (f64::from(spread) <= self.options.colour_levels).then_some(Place { position, colour, motion, spread })
    }
}

/// Tolerance, so that a tenth of ten cameras is one camera.
const ROUNDING: f64 = 1e-9;

/// The moving blocks of an image, drawn in proportion to their difference plus one.
#[derive(Debug)]
struct MovingBlocks {
    blocks: Vec<usize>,
    /// Cumulative weights, each including its own block.
    sums: Vec<u64>,
}

impl MovingBlocks {
    fn of(map: &MotionMap) -> Self {
        let moving = map.blocks().iter().enumerate().filter(|(_, block)| block.moves());
        let mut sum = 0;
        let (blocks, sums) = moving
            .map(|(index, block)| {
                sum += u64::from(block.difference()) + 1;
                (index, sum)
            })
            .unzip();
        Self { blocks, sums }
    }

    fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Draws a block. There is at least one.
    fn draw(&self, rng: &mut ChaCha8Rng) -> usize {
        let total = self.sums[self.sums.len() - 1];
        let number = rng.random_range(0..total);
        self.blocks[self.sums.partition_point(|&sum| sum <= number)]
    }
}
