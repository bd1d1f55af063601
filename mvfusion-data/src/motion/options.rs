//! Options for moving pixels and for the motion hull.

/// Options for moving pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingPixelsOptions {
    /// Memory budget of the kept data, in bytes. Images are reduced by the smallest integer factor that fits. Default
    /// 512 MiB.
    pub memory: u64,
    /// A pixel moves at a moment if it is more than this from its camera's median over time, in 8-bit levels. Default
    /// 12. Shadows and compression noise stay below it on the rigs that we tested.
    pub fast_levels: f64,
    /// A pixel moves at all times if it is more than this from the median in over half of the frames, in 8-bit levels.
    /// It then shows slow motion, which the median does not represent. Default 1.5. The lamp of the built-in video
    /// sways by less than a pixel and differs by 2 levels.
    pub slow_levels: f64,
    /// Both thresholds are at least this many standard deviations of the camera's noise. Default 5.
    pub noise_deviations: f64,
}

impl Default for MovingPixelsOptions {
    fn default() -> Self {
        Self { memory: 512 << 20, fast_levels: 12.0, slow_levels: 1.5, noise_deviations: 5.0 }
    }
}

/// Options for the motion hull. The defaults were tuned on the built-in video and on 15 cameras of the CMU Panoptic
/// Studio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionHullOptions {
    /// Number of seeds. There are fewer if fewer places are found. Default 2500.
    pub points: usize,
    /// Rays for each seed. Default 20. Twice as many change neither precision nor recall.
    pub rays_per_point: usize,
    /// Candidate places on each ray. Default 64.
    pub depths: usize,
    /// Minimum number of cameras that must see a place, and that must agree in its colour. Default 3.
    pub least_cameras: usize,
    /// Minimum fraction of the moment's cameras that must see a place. Default 0.5.
    pub seeing_share: f64,
    /// Minimum fraction of the cameras seeing a place that must see motion there. Default 0.9, because masks have
    /// holes.
    pub moving_share: f64,
    /// Cameras within this many degrees of a ray should see the ray's colour. Default 60. Others see another side.
    pub side_degrees: f64,
    /// Minimum fraction of those cameras that must agree in the colour. Default 0.9. Others may be occluded.
    pub agreeing_share: f64,
    /// Largest standard deviation of agreeing colours, in 8-bit levels. Default 20.
    pub colour_levels: f64,
    /// Fraction of the seeds that is divided equally among all moments. The rest follows the amount of motion. Default
    /// 0.5.
    pub even_over_moments: f64,
    /// Fraction of a moment's seeds that is drawn in favour of small objects. Default 0.25.
    pub even_over_things: f64,
}

impl Default for MotionHullOptions {
    fn default() -> Self {
        Self {
            points: 2500,
            rays_per_point: 20,
            depths: 64,
            least_cameras: 3,
            seeing_share: 0.5,
            moving_share: 0.9,
            side_degrees: 60.0,
            agreeing_share: 0.9,
            colour_levels: 20.0,
            even_over_moments: 0.5,
            even_over_things: 0.25,
        }
    }
}
