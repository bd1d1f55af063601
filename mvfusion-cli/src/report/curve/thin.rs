//! Reduction of the points of a curve.

/// A point of a curve. A value that is not finite is a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position along the curve, in increasing order.
    pub x: f64,
    /// The value.
    pub y: f64,
}

/// At most `most` of the points, and about as many gaps. Each of `most / 2` equal runs of points keeps its lowest and
/// its highest point, so that no peak is lost. A run with gaps keeps one gap, after its points.
pub(super) fn thin(points: &[Point], most: usize) -> Vec<Point> {
    if points.len() <= most {
        return points.to_vec();
    }
    let run = points.len().div_ceil((most / 2).max(1));
    points.chunks(run).flat_map(extremes).collect()
}

/// The lowest and the highest point of a run, in their order, then one gap if the run has any.
fn extremes(run: &[Point]) -> impl Iterator<Item = Point> {
    let finite = || run.iter().enumerate().filter(|(_, point)| point.y.is_finite());
    let lowest = finite().min_by(|a, b| a.1.y.total_cmp(&b.1.y)).map(|(index, _)| index);
    let highest = finite().max_by(|a, b| a.1.y.total_cmp(&b.1.y)).map(|(index, _)| index);
    let gap = run.iter().find(|point| !point.y.is_finite()).copied();
    let (first, second) = (lowest.min(highest), lowest.max(highest));
    let second = if first == second { None } else { second };
    [first, second].into_iter().flatten().map(|index| run[index]).chain(gap).collect::<Vec<_>>().into_iter()
}

/// The mean of each point and up to `window - 1` points before it. Gaps are ignored and stay gaps.
pub fn running_mean(points: &[Point], window: usize) -> Vec<Point> {
    let mean = |end: usize| {
        let values =
            || points[(end + 1).saturating_sub(window.max(1))..=end].iter().map(|p| p.y).filter(|y| y.is_finite());
        values().sum::<f64>() / values().count() as f64
    };
    let smooth =
        |(end, point): (usize, &Point)| if point.y.is_finite() { Point { y: mean(end), ..*point } } else { *point };
    points.iter().enumerate().map(smooth).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(values: impl IntoIterator<Item = f64>) -> Vec<Point> {
        values.into_iter().enumerate().map(|(x, y)| Point { x: x as f64, y }).collect()
    }

    #[test]
    fn peaks_survive_and_the_order_stays() {
        let mut values = vec![1.0; 100_000];
        (values[777], values[778], values[99_999]) = (50.0, -50.0, 9.0);
        let kept = thin(&points(values), 1000);
        assert!(kept.len() <= 1000, "{}", kept.len());
        assert!(kept.windows(2).all(|pair| pair[0].x < pair[1].x));
        for point in [Point { x: 777.0, y: 50.0 }, Point { x: 778.0, y: -50.0 }, Point { x: 99_999.0, y: 9.0 }] {
            assert!(kept.contains(&point), "{point:?} is lost");
        }
    }

    #[test]
    fn short_curves_stay_as_they_are() {
        let few = points([1.0, f64::NAN, 3.0]);
        assert_eq!(thin(&few, 4).len(), 3);
        assert!(thin(&[], 4).is_empty());
    }

    #[test]
    fn a_gap_stays_a_gap() {
        let mut values = vec![1.0; 1000];
        values[400..600].fill(f64::NAN);
        let kept = thin(&points(values), 100);
        assert!(kept.iter().any(|point| point.y.is_nan()));
        assert!(kept.iter().filter(|point| point.y.is_finite()).all(|point| point.y == 1.0));
        assert!(thin(&points(vec![f64::INFINITY; 1000]), 100).iter().all(|point| !point.y.is_finite()));
    }

    #[test]
    fn means_look_back_and_pass_over_gaps() {
        let means: Vec<f64> = running_mean(&points([1.0, 3.0, f64::NAN, 5.0]), 3).iter().map(|p| p.y).collect();
        assert_eq!((means[0], means[1], means[3]), (1.0, 2.0, 4.0));
        assert!(means[2].is_nan());
    }
}
