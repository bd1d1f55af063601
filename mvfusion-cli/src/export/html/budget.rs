//! What is left out of a page until it is small enough.

/// Fewest keyframes before colours and Gaussians are left out.
const KEYFRAMES_BEFORE_COLOURS: usize = 12;
/// Fewest keyframes of all.
const LEAST_KEYFRAMES: usize = 2;
/// Share of the Gaussians that a step keeps.
const KEPT: f64 = 0.8;
/// Least share of the Gaussians.
const LEAST_SHARE: f64 = 0.01;

/// What a page leaves out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduction {
    /// Every how many-th keyframe is kept.
    pub stride: usize,
    /// Degree of the spherical harmonics.
    pub sh_degree: usize,
    /// Share of the Gaussians that are kept: those that contribute most.
    pub share: f64,
}

/// All reductions, from the one that leaves out nothing to the smallest page. In this order: half of the keyframes, as
/// long as twelve are left; the highest degree of the colours, down to none; then a fifth of the remaining Gaussians and,
/// at every third such step, half of the keyframes.
pub fn reductions(keyframes: usize, sh_degree: usize) -> Vec<Reduction> {
    let left = |stride: usize| keyframes.saturating_sub(1) / stride + 1;
    let mut current = Reduction { stride: 1, sh_degree, share: 1.0 };
    let mut all = vec![current];
    while left(2 * current.stride) >= KEYFRAMES_BEFORE_COLOURS {
        current.stride *= 2;
        all.push(current);
    }
    while current.sh_degree > 0 {
        current.sh_degree -= 1;
        all.push(current);
    }
    for step in 1.. {
        current.share *= KEPT;
        if current.share < LEAST_SHARE {
            break;
        }
        if step % 3 == 0 && left(2 * current.stride) >= LEAST_KEYFRAMES {
            current.stride *= 2;
        }
        all.push(current);
    }
    all
}

/// The rows that are kept: `share` of them, those with the largest `contributions`, in ascending order. At least one,
/// because no op takes an empty tensor.
pub fn strongest(rows: &[usize], contributions: &[f32], share: f64) -> Vec<usize> {
    let mut kept = rows.to_vec();
    kept.sort_by(|&a, &b| contributions[b].total_cmp(&contributions[a]).then(a.cmp(&b)));
    kept.truncate(((rows.len() as f64 * share).round() as usize).max(1));
    kept.sort_unstable();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keyframes_go_first_then_colours_then_gaussians() {
        let all = reductions(100, 3);
        let strides: Vec<usize> = all.iter().map(|step| step.stride).take(5).collect();
        assert_eq!(strides, [1, 2, 4, 8, 8]);
        let degrees: Vec<usize> = all.iter().map(|step| step.sh_degree).skip(3).take(5).collect();
        assert_eq!(degrees, [3, 2, 1, 0, 0]);
        assert!(all.iter().take(7).all(|step| step.share == 1.0));
        assert!(all.iter().skip(6).is_sorted_by(|a, b| a.share > b.share));
        assert!(all.iter().all(|step| step.share >= LEAST_SHARE));
        assert!(all.windows(2).all(|pair| {
            let [a, b] = pair else { return false };
            b.stride >= a.stride && b.sh_degree <= a.sh_degree && b.share <= a.share && a != b
        }));
    }

    #[test]
    fn a_still_scene_has_its_one_keyframe() {
        assert!(reductions(1, 0).iter().all(|step| step.stride == 1));
    }

    #[test]
    fn the_gaussians_that_contribute_most_are_kept_in_their_order() {
        let contributions = [0.5, 3.0, 0.0, 3.0, 2.0, f32::NAN];
        assert_eq!(strongest(&[0, 1, 2, 3, 4], &contributions, 0.6), [1, 3, 4]);
        assert_eq!(strongest(&[0, 1, 3], &contributions, 0.34), [1]);
        assert_eq!(strongest(&[2], &contributions, 0.01), [2]);
    }
}
