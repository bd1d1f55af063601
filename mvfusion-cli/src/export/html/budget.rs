//! What a page has of a scene, and what is left out of it until it is small enough.

use mvfusion_data::keyframes::Reduction;
use mvfusion_model::timeline::spread;

/// Most dynamic Gaussians times keyframes, which bounds the memory of the player: about 40 bytes of each.
const MOST_STATES: usize = 4_000_000;

/// Fewest keyframes before the degree of the colours is lowered.
const KEYFRAMES_BEFORE_COLOURS: usize = 12;
/// Fewest keyframes of all.
const LEAST_KEYFRAMES: usize = 2;
/// Share of the Gaussians that a step keeps.
const KEPT: f64 = 0.8;
/// Least share of the Gaussians.
const LEAST_SHARE: f64 = 0.01;

/// What a page leaves out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Of keyframes, colours and precision.
    pub reduction: Reduction,
    /// Share of the Gaussians that are kept: those that contribute most.
    pub share: f64,
}

/// Times of keyframes.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyframeTimes {
    /// The times, ascending.
    pub times: Vec<f64>,
    /// Every how many-th of them is a training time.
    pub trained: usize,
}

/// The times of the keyframes of this many dynamic Gaussians: the training times, or as many of them as the player can
/// hold; and the middle between each two of them, if it can hold these as well.
pub fn keyframe_times(training_times: &[f64], gaussians: usize) -> KeyframeTimes {
    let most = (MOST_STATES / gaussians.max(1)).max(2);
    let times: Vec<f64> = spread(training_times.len(), most).into_iter().map(|index| training_times[index]).collect();
    if times.len() < training_times.len() || times.len() < 2 || 2 * times.len() - 1 > most {
        return KeyframeTimes { times, trained: 1 };
    }
    let middles = times.windows(2).flat_map(|pair| [pair[0], 0.5 * (pair[0] + pair[1])]);
    KeyframeTimes { times: middles.chain(times.last().copied()).collect(), trained: 2 }
}

/// All cuts, from the one that leaves out nothing to the smallest page. What costs little PSNR for its bytes comes
/// first: steps of twice and of four times the size; keyframes between training times; a fifth of the Gaussians; the
/// highest degree of the colours; half of the keyframes, as long as twelve are left; then, in turn, a fifth of the
/// Gaussians and the highest degree, down to constant colours; then a fifth of the Gaussians and, at every third such
/// step, half of the keyframes.
pub fn cuts(keyframes: &KeyframeTimes, sh_degree: usize) -> Vec<Cut> {
    let left = |stride: usize| keyframes.times.len().saturating_sub(1) / stride + 1;
    let mut cut = Cut { reduction: Reduction { step_factor: 1, stride: 1, sh_degree }, share: 1.0 };
    let mut all = vec![cut];
    for step_factor in [2, 4] {
        cut.reduction.step_factor = step_factor;
        all.push(cut);
    }
    if keyframes.trained > 1 {
        cut.reduction.stride = keyframes.trained;
        all.push(cut);
    }
    cut.share *= KEPT;
    all.push(cut);
    if sh_degree > 0 {
        cut.reduction.sh_degree -= 1;
        all.push(cut);
    }
    while left(2 * cut.reduction.stride) >= KEYFRAMES_BEFORE_COLOURS {
        cut.reduction.stride *= 2;
        all.push(cut);
    }
    while cut.reduction.sh_degree > 0 {
        cut.share *= KEPT;
        all.push(cut);
        cut.reduction.sh_degree -= 1;
        all.push(cut);
    }
    for step in 1.. {
        cut.share *= KEPT;
        if cut.share < LEAST_SHARE {
            break;
        }
        if step % 3 == 0 && left(2 * cut.reduction.stride) >= LEAST_KEYFRAMES {
            cut.reduction.stride *= 2;
        }
        all.push(cut);
    }
    all
}

/// Most trials of [`first_that_fits`].
pub fn most_trials(count: usize) -> usize {
    count.checked_ilog2().map_or(0, |steps| steps as usize + 2)
}

/// What `trial` has made of the first of `count` cuts that fits. The sizes fall along the cuts, so most of them need no
/// trial. Most scenes fit without a cut, which is tried first.
///
/// # Errors
/// If a trial fails.
pub fn first_that_fits<T>(
    count: usize,
    mut trial: impl FnMut(usize) -> anyhow::Result<Option<T>>,
) -> anyhow::Result<Option<T>> {
    let (mut low, mut high, mut next, mut best) = (0, count, 0, None);
    while low < high {
        match trial(next)? {
            Some(fitting) => (high, best) = (next, Some(fitting)),
            None => low = next + 1,
        }
        next = low + (high - low) / 2;
    }
    Ok(best)
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
    fn precision_goes_first_then_faint_gaussians_colours_and_keyframes() {
        let all = cuts(&KeyframeTimes { times: vec![0.0; 100], trained: 1 }, 3);
        assert_eq!(all[0], Cut { reduction: Reduction { step_factor: 1, stride: 1, sh_degree: 3 }, share: 1.0 });
        let first = |number: usize, of: fn(&Cut) -> usize| all.iter().take(number).map(of).collect::<Vec<_>>();
        assert_eq!(first(4, |cut| cut.reduction.step_factor as usize), [1, 2, 4, 4]);
        assert_eq!(first(4, |cut| (100.0 * cut.share).round() as usize), [100, 100, 100, 80]);
        assert_eq!(first(9, |cut| cut.reduction.stride), [1, 1, 1, 1, 1, 2, 4, 8, 8]);
        assert_eq!(first(12, |cut| cut.reduction.sh_degree), [3, 3, 3, 3, 2, 2, 2, 2, 2, 1, 1, 0]);
        assert!(all.iter().all(|cut| cut.share >= LEAST_SHARE));
        assert!(all.windows(2).all(|pair| {
            let [a, b] = [pair[0], pair[1]];
            let less = b.reduction.stride >= a.reduction.stride && b.reduction.sh_degree <= a.reduction.sh_degree;
            less && b.share <= a.share && a != b
        }));
    }

    #[test]
    fn the_first_cut_that_fits_is_found_in_few_trials() {
        for count in [0, 1, 2, 7, 32, 33] {
            for first in 0..=count {
                let mut trials = 0;
                let found = first_that_fits(count, |index| {
                    trials += 1;
                    Ok((index >= first).then_some(index))
                });
                assert_eq!(found.expect("no error"), (first < count).then_some(first));
                assert!(trials <= most_trials(count), "{trials} trials of {count} cuts");
                assert!(first > 0 || trials <= 1);
            }
        }
    }

    #[test]
    fn a_still_scene_keeps_its_one_keyframe() {
        assert!(cuts(&keyframe_times(&[0.5], 10), 0).iter().all(|cut| cut.reduction.stride == 1));
    }

    #[test]
    fn keyframes_between_training_times_are_there_if_there_is_room_and_go_first_of_all_keyframes() {
        let refined = keyframe_times(&[0.0, 0.5, 0.75], 1000);
        assert_eq!(refined, KeyframeTimes { times: vec![0.0, 0.25, 0.5, 0.625, 0.75], trained: 2 });
        assert_eq!(cuts(&refined, 3)[3].reduction, Reduction { step_factor: 4, stride: 2, sh_degree: 3 });
        let full = keyframe_times(&[0.0, 0.5, 0.75], MOST_STATES / 4);
        assert_eq!(full, KeyframeTimes { times: vec![0.0, 0.5, 0.75], trained: 1 });
        assert_eq!(keyframe_times(&[0.0, 0.5, 0.75], MOST_STATES).times, [0.0, 0.75]);
        assert_eq!(keyframe_times(&[0.25], 7), KeyframeTimes { times: vec![0.25], trained: 1 });
    }

    #[test]
    fn the_gaussians_that_contribute_most_are_kept_in_their_order() {
        let contributions = [0.5, 3.0, 0.0, 3.0, 2.0, f32::NAN];
        assert_eq!(strongest(&[0, 1, 2, 3, 4], &contributions, 0.6), [1, 3, 4]);
        assert_eq!(strongest(&[0, 1, 3], &contributions, 0.34), [1]);
        assert_eq!(strongest(&[2], &contributions, 0.01), [2]);
    }
}
