//! Tests on a tiny video (see `tests-data/README.md`), by both decoders.

use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};

use image::{Rgb, RgbImage};
use tempfile::TempDir;

use super::*;

const FIXTURE: &[u8] = include_bytes!("../../tests-data/bframes.mp4");
const SIZE: (u32, u32) = (60, 44);
const FRAMES: usize = 12;
/// PSNR threshold of matching frames. Encoding and chroma subsampling result in 40 dB, a wrong frame in 22 dB.
const LIKE: f64 = 35.0;
/// The decoders differ in rounding and in the filter for the chroma.
const ALIKE: f64 = 45.0;

/// The decoders that can be tested here.
fn decoders() -> Vec<VideoDecoder> {
    let built_in = cfg!(feature = "h264").then_some(VideoDecoder::BuiltIn);
    let ffmpeg = ffmpeg::is_installed().then_some(VideoDecoder::Ffmpeg);
    if ffmpeg.is_none() {
        eprintln!("NOT TESTED: decoding with ffmpeg, because the program is not installed");
    }
    built_in.into_iter().chain(ffmpeg).collect()
}

fn saved(bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("cam 00.mp4");
    fs::write(&path, bytes).expect("written");
    (folder, path)
}

fn opened(path: &Path, store: &FrameStore, decoder: VideoDecoder) -> Video {
    Video::with_decoder(path, usize::MAX, store, decoder).unwrap_or_else(|flaw| panic!("{decoder:?}: {flaw:?}"))
}

fn rgb(video: &Video, index: usize) -> RgbImage {
    video.frame(index, video.size()).expect("decoded").into_rgb8()
}

/// The frames that were encoded.
fn original(index: usize) -> RgbImage {
    RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| Rgb([20 * index as u8, 4 * x as u8, 5 * y as u8]))
}

fn psnr(a: &RgbImage, b: &RgbImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let squares = a.as_raw().iter().zip(b.as_raw()).map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2));
    let mean = squares.sum::<f64>() / a.as_raw().len() as f64;
    10.0 * (255.0f64.powi(2) / mean).log10()
}

/// The fixture with other bytes after the name of a box.
fn patched(kind: &[u8; 4], offset: usize, bytes: &[u8]) -> Vec<u8> {
    let mut file = FIXTURE.to_vec();
    let start = file.windows(4).position(|w| w == kind).expect("the box is there") + 4 + offset;
    file[start..start + bytes.len()].copy_from_slice(bytes);
    file
}

#[test]
fn frames_come_in_the_order_in_which_they_are_shown() {
    for decoder in decoders() {
        let (_folder, path) = saved(FIXTURE);
        let video = opened(&path, &FrameStore::new(None), decoder);
        assert_eq!((video.len(), video.size(), video.path()), (FRAMES, SIZE, &*path));
        for index in (0..FRAMES).map(|i| 7 * i % FRAMES) {
            let psnr = psnr(&rgb(&video, index), &original(index));
            assert!(psnr > LIKE, "{decoder:?}, frame {index}: {psnr} dB");
        }
        assert!(video.frame(FRAMES, SIZE).is_err());
    }
}

#[test]
fn the_decoders_agree() {
    let [built_in, ffmpeg] = decoders()[..] else { return };
    let (_folder, path) = saved(FIXTURE);
    let videos = [built_in, ffmpeg].map(|decoder| opened(&path, &FrameStore::new(None), decoder));
    for index in 0..FRAMES {
        let psnr = psnr(&rgb(&videos[0], index), &rgb(&videos[1], index));
        assert!(psnr > ALIKE, "frame {index}: {psnr} dB");
    }
}

#[test]
fn a_limit_leaves_the_first_frames_and_another_size_is_resized() {
    for decoder in decoders() {
        let (_folder, path) = saved(FIXTURE);
        let video = Video::with_decoder(&path, 3, &FrameStore::new(None), decoder).expect("opened");
        assert_eq!(video.len(), 3);
        let small = video.frame(2, (30, 22)).expect("decoded").into_rgb8();
        let wanted = image::imageops::resize(&original(2), 30, 22, image::imageops::FilterType::Lanczos3);
        assert!(psnr(&small, &wanted) > LIKE);
        assert!(psnr(&rgb(&video, 2), &original(2)) > LIKE);
        assert!(video.frame(3, SIZE).is_err());
    }
}

#[test]
fn a_video_opens_without_a_choice_of_decoder() {
    if decoders().is_empty() {
        return;
    }
    let (_folder, path) = saved(FIXTURE);
    let video = Video::open(&path, 1, &FrameStore::new(None)).expect("opened");
    assert!(!video.is_empty() && psnr(&rgb(&video, 0), &original(0)) > LIKE);
}

#[test]
fn a_kept_set_serves_the_next_run_and_is_made_again_if_it_lacks_a_frame_or_the_video_changed() {
    for decoder in decoders() {
        let (_folder, path) = saved(FIXTURE);
        let kept = tempfile::tempdir().expect("folder");
        let store = || FrameStore::new(Some(&kept.path().join("new")));
        let sets = || fs::read_dir(kept.path().join("new")).expect("made").map(|e| e.expect("entry").path());
        rgb(&opened(&path, &store(), decoder), 0);
        let set = sets().next().expect("a set");
        assert_eq!((sets().count(), fs::read_dir(&set).expect("set").count()), (1, FRAMES), "{set:?}");

        let mark = RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([1, 2, 3]));
        mark.save(set.join("000004.png")).expect("written");
        assert_eq!(rgb(&opened(&path, &store(), decoder), 4), mark);
        fs::remove_file(set.join("000007.png")).expect("removed");
        assert!(psnr(&rgb(&opened(&path, &store(), decoder), 4), &original(4)) > LIKE);
        assert_eq!(sets().count(), 1);

        fs::write(&path, [FIXTURE, b"\0\0\0\x08free"].concat()).expect("written");
        rgb(&opened(&path, &store(), decoder), 0);
        assert_eq!(sets().count(), 2);
    }
}

#[test]
fn a_temporary_set_goes_with_the_last_video() {
    for decoder in decoders() {
        let (_folder, path) = saved(FIXTURE);
        let store = FrameStore::new(None);
        let video = opened(&path, &store, decoder);
        rgb(&video, 0);
        let folder = store.folder().expect("made");
        drop(store);
        rgb(&video, 5);
        drop(video);
        assert!(!folder.exists());
    }
}

#[test]
fn callers_from_several_threads_wait_for_one_decoding() {
    for decoder in decoders() {
        let (_folder, path) = saved(FIXTURE);
        let store = FrameStore::new(None);
        let video = opened(&path, &store, decoder);
        let right = AtomicUsize::new(0);
        rayon::scope(|scope| {
            for index in 0..FRAMES {
                let (video, right) = (&video, &right);
                scope.spawn(move |_| {
                    right.fetch_add((psnr(&rgb(video, index), &original(index)) > LIKE).into(), Ordering::Relaxed);
                });
            }
        });
        assert_eq!(right.into_inner(), FRAMES);
        let entries = fs::read_dir(store.folder().expect("made")).expect("store");
        assert_eq!(entries.filter(|entry| entry.as_ref().is_ok_and(|entry| entry.path().is_dir())).count(), 1);
    }
}

#[test]
fn frames_are_turned_upright() {
    let one = 0x1_0000i32;
    for (turn, [a, b, c, d]) in [
        (mp4::Turn::Quarter, [0, one, -one, 0]),
        (mp4::Turn::Half, [-one, 0, 0, -one]),
        (mp4::Turn::ThreeQuarters, [0, -one, one, 0]),
    ] {
        let matrix: Vec<u8> = [a, b, 0, c, d].iter().flat_map(|v| v.to_be_bytes()).collect();
        let (_folder, path) = saved(&patched(b"tkhd", 40, &matrix));
        let wanted = match turn {
            mp4::Turn::Quarter => image::imageops::rotate90(&original(3)),
            mp4::Turn::Half => image::imageops::rotate180(&original(3)),
            _ => image::imageops::rotate270(&original(3)),
        };
        for decoder in decoders() {
            let video = opened(&path, &FrameStore::new(None), decoder);
            assert_eq!(video.size(), wanted.dimensions());
            assert!(psnr(&rgb(&video, 3), &wanted) > LIKE, "{decoder:?}, {turn:?}");
        }
    }
}

#[test]
fn a_mirrored_video_is_refused_without_ffmpeg() {
    let (_folder, path) = saved(&patched(b"tkhd", 40, &(-0x1_0000i32).to_be_bytes()));
    let flaw = Video::with_decoder(&path, 9, &FrameStore::new(None), VideoDecoder::BuiltIn).expect_err("mirrored");
    assert!(flaw.reason.contains("mirrored"), "{flaw:?}");
}

#[test]
fn what_the_edit_list_cuts_off_is_not_counted() {
    // The first frame is shown at 1024, each lasts 512.
    let (_folder, path) = saved(&patched(b"elst", 12, &(1024u32 + 2 * 512).to_be_bytes()));
    for decoder in decoders() {
        let video = opened(&path, &FrameStore::new(None), decoder);
        assert_eq!(video.len(), FRAMES - 2);
        assert!(psnr(&rgb(&video, 0), &original(2)) > LIKE, "{decoder:?}");
        assert!(psnr(&rgb(&video, 9), &original(11)) > LIKE, "{decoder:?}");
    }
}

#[test]
fn a_file_that_is_cut_short_is_an_error_wherever_the_cut_is() {
    for bytes in 0..FIXTURE.len() {
        let (_folder, path) = saved(&FIXTURE[..bytes]);
        let opened = Video::with_decoder(&path, FRAMES, &FrameStore::new(None), VideoDecoder::BuiltIn);
        let flaw = opened.err().unwrap_or_else(|| panic!("{bytes} of {} bytes", FIXTURE.len()));
        assert!(DataError::from(flaw).to_string().contains("cam 00.mp4"));
    }
}

#[test]
fn headers_that_lie_do_no_harm() {
    let moov = FIXTURE.windows(4).position(|w| w == b"moov").expect("a header");
    let mut decoded = 0;
    for (at, value) in (moov - 4..FIXTURE.len()).flat_map(|at| [(at, 0), (at, 0xff)]) {
        let mut file = FIXTURE.to_vec();
        file[at] = value;
        let (_folder, path) = saved(&file);
        let opened = Video::with_decoder(&path, 2, &FrameStore::new(None), VideoDecoder::BuiltIn);
        // The coded frames are intact, so that a video that opens is decoded, or rejected later.
        decoded += opened.is_ok_and(|video| video.frame(0, (16, 16)).is_ok()) as usize;
    }
    assert!(decoded > 100 || cfg!(not(feature = "h264")), "{decoded} files are harmless");
}

#[test]
fn a_broken_video_is_decoded_once_and_leaves_nothing_behind() {
    for decoder in decoders() {
        let mut file = FIXTURE.to_vec();
        let mdat = file.windows(4).position(|w| w == b"mdat").expect("frames") + 4;
        file[mdat..mdat + 1500].fill(0xff);
        let (_folder, path) = saved(&file);
        let kept = tempfile::tempdir().expect("folder");
        let video = opened(&path, &FrameStore::new(Some(kept.path())), decoder);
        let error = video.frame(3, SIZE).expect_err("broken").to_string();
        assert!(error.contains("cam 00.mp4"), "{error}");
        assert_eq!(fs::read_dir(kept.path()).expect("store").count(), 0, "{decoder:?}");
        assert_eq!(video.frame(0, SIZE).expect_err("remembered").to_string(), error);
    }
}

#[test]
fn a_video_with_fewer_frames_than_its_header_tells_is_an_error_that_says_how_many() {
    let (_folder, path) = saved(FIXTURE);
    let last = *mp4::read(&path).expect("headers").samples.last().expect("frames");
    let (start, bytes) = (last.start as usize, last.bytes as usize);
    let mut file = FIXTURE.to_vec();
    // A unit of filler instead of the last frame.
    file[start..start + 4].copy_from_slice(&(last.bytes - 4).to_be_bytes());
    file[start + 4..start + bytes].fill(0xff);
    file[start + 4] = 12;
    for decoder in decoders() {
        let (_folder, path) = saved(&file);
        let video = opened(&path, &FrameStore::new(None), decoder);
        let error = video.frame(0, SIZE).expect_err("11 frames").to_string();
        assert!(
            error.contains("only 11 of 12 frames") && error.contains("--set scene.frames=N"),
            "{decoder:?}: {error}"
        );
        // This is for `prepare`, which has no such key.
        let error = video.each_frame(&mut |_, _| Ok::<(), DataError>(())).expect_err("11 frames").to_string();
        assert!(error.contains("only 11 of 12 frames") && error.contains("copy it again"), "{decoder:?}: {error}");
        assert!(!error.contains("scene.frames"), "{decoder:?}: {error}");
    }
}

#[test]
fn frames_of_vp8_that_are_never_shown_do_not_count() {
    // 25 frames in 26 packets.
    let file = include_bytes!("../../tests-data/invisible.webm");
    if !decoders().contains(&VideoDecoder::Ffmpeg) {
        return;
    }
    let (_folder, path) = saved(file);
    let video = opened(&path, &FrameStore::new(None), VideoDecoder::Ffmpeg);
    let mut frames = 0;
    video
        .each_frame(&mut |_, _| -> Result<(), DataError> {
            frames += 1;
            Ok(())
        })
        .expect("intact");
    assert_eq!((video.len(), frames), (25, 25));
}

#[test]
fn other_files_and_codecs_are_refused_with_a_remedy() {
    for (bytes, reason) in [
        (&b"no video at all"[..], "it is no mp4 file"),
        (b"", "it is no mp4 file"),
        (&patched(b"stsd", 12, b"mp4v"), "its codec is unknown here (mp4v)"),
    ] {
        let (_folder, path) = saved(bytes);
        let opened = Video::with_decoder(&path, 9, &FrameStore::new(None), VideoDecoder::BuiltIn);
        let error = DataError::from(opened.expect_err("refused")).to_string();
        assert!(error.contains(reason) && error.contains("Install the program ffmpeg"), "{error}");
    }
}

#[cfg(not(feature = "h264"))]
#[test]
fn without_any_decoder_the_error_names_the_program_and_the_feature() {
    let (_folder, path) = saved(FIXTURE);
    let opened = Video::with_decoder(&path, 9, &FrameStore::new(None), VideoDecoder::BuiltIn);
    let error = DataError::from(opened.expect_err("refused")).to_string();
    assert!(error.contains("Install the program ffmpeg") && error.contains("--features h264"), "{error}");
}

#[test]
fn a_store_that_cannot_be_written_is_named() {
    for decoder in decoders() {
        let (folder, path) = saved(FIXTURE);
        let store = FrameStore::new(Some(&path.join("frames")));
        let error = opened(&path, &store, decoder).frame(0, SIZE).expect_err("a file is no folder").to_string();
        assert!(error.contains("frames") && error.contains("frame_store"), "{error}");
        drop(folder);
    }
}

/// Compares real videos of the test data, which is outside the project, with their original images.
#[test]
fn real_videos_look_like_the_pictures_they_were_made_of() {
    let Some(folder) = std::env::var_os("MVFUSION_ORACLES") else {
        eprintln!("NOT TESTED: MVFUSION_ORACLES does not name the folder with the test data");
        return;
    };
    let scene = Path::new(&folder).join("panoptic_neu3d");
    for camera in ["cam00", "cam04", "cam13", "cam28"] {
        let mut sets = Vec::new();
        for decoder in decoders() {
            let start = Instant::now();
            let video = opened(&scene.join(format!("{camera}.mp4")), &FrameStore::new(None), decoder);
            let frames: Vec<_> = (0..video.len()).map(|index| rgb(&video, index)).collect();
            let seconds = start.elapsed().as_secs_f64();
            let like: Vec<f64> = (0..)
                .zip(&frames)
                .map(|(index, frame)| {
                    let picture = scene.join(camera).join(format!("images/{index:04}.jpg"));
                    psnr(frame, &image::open(picture).expect("picture").into_rgb8())
                })
                .collect();
            let (worst, mean) = (like.iter().copied().fold(f64::MAX, f64::min), like.iter().sum::<f64>() / 24.0);
            eprintln!("{camera}, {decoder:?}: mean {mean:.2} dB, worst {worst:.2} dB, {seconds:.2} s");
            assert!(like.len() == 24 && worst > 30.0);
            sets.push(frames);
        }
        if let [a, b] = &sets[..] {
            let worst = a.iter().zip(b).map(|(a, b)| psnr(a, b)).fold(f64::MAX, f64::min);
            eprintln!("{camera}: the decoders agree to {worst:.2} dB at worst");
            assert!(worst > ALIKE);
        }
    }
}
