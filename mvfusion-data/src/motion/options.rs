//! What counts as motion, and what as a place of the hull.

/// How moving pixels are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingPixelsOptions {
    /// Bytes that all that is kept may take. Pictures are reduced by the smallest whole factor that fits. Default 512
    /// MiB.
    pub memory: u64,
    /// A pixel moves at a moment if it is further than this from its camera's median over time, in 8-bit levels.
    /// Default 12: shadows and the noise of compression stay below on the rigs looked at.
    pub fast_levels: f64,
    /// A pixel moves at all times if it is further than this from the median in more than half of the frames, in 8-bit
    /// levels: it shows something slow, of which the median tells nothing. Default 1.5: the lamp of the built-in video, which
    /// sways by less than a pixel, differs by 2 levels.
    pub slow_levels: f64,
    /// Both thresholds are at least so many standard deviations of the camera's noise. Default 5.
    pub noise_deviations: f64,
}

impl Default for MovingPixelsOptions {
    fn default() -> Self {
        Self { memory: 512 << 20, fast_levels: 12.0, slow_levels: 1.5, noise_deviations: 5.0 }
    }
}

/// How places of the motion hull are found and chosen. The defaults were tried on the built-in video and on 15 cameras
/// of the CMU Panoptic studio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionHullOptions {
    /// Seeds that are wanted; fewer come where fewer places are found. Default 2500.
    pub points: usize,
    /// Rays that are tried for each seed wanted. Default 20: twice as many change neither precision nor recall.
    pub rays_per_point: usize,
    /// Places that are tried along each ray. Default 64.
    pub depths: usize,
    /// At least so many cameras must see a place, and as many must agree in its colour. Default 3.
    pub least_cameras: usize,
    /// At least this share of the cameras of the moment must see a place. Default 0.5.
    pub seeing_share: f64,
    /// At least this share of the cameras that see a place must see motion there. Default 0.9: a mask has holes.
    pub moving_share: f64,
    /// Cameras within so many degrees of a ray should see the colour that it sees. Default 60: others see another side.
    pub side_degrees: f64,
    /// This share of those cameras must agree in the colour. Default 0.9: the rest may see something before the place.
    pub agreeing_share: f64,
    /// Largest standard deviation of colours that agree, in 8-bit levels. Default 20.
    pub colour_levels: f64,
    /// Share of the seeds that all moments have in equal parts; the rest goes where much moves. Default 0.5.
    pub even_over_moments: f64,
    /// Share of a moment's seeds that is drawn so that small things have more of them than their size gives. Default
    /// 0.25.
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
