//! Strong lenses against numbers of OpenCV 5.0.0 (`opencv-python-headless` 5.0.0).
//!
//! For a picture of 1008 by 756 pixels, a matrix `K` and coefficients `d`, with `P` the matrix of `PINHOLE`:
//! * sources: `cv2.initUndistortRectifyMap(K, d, None, P, (1008, 756), cv2.CV_32FC1)` at `TARGETS`;
//! * points: `cv2.undistortPoints(BORDER, K, d, None, None, None, (COUNT | EPS, 10000, 1e-15))`;
//! * optimal: `cv2.getOptimalNewCameraMatrix(K, d, (1008, 756), 0)`;
//! * for the fisheye, the functions of the same names in `cv2.fisheye`, with the identity as rotation;
//! * inner: focal lengths and principal point of the largest pinhole within the lens, from `undistortPoints` to
//!   convergence at eight points per pixel of the outer edges of the picture. Its pixels start at 0 at the edge.
//!
//! OpenCV counts pixels from 0 at the middle of the first one.

use super::*;

const WIDTH: u32 = 1008;
const HEIGHT: u32 = 756;

/// Pixels of the undistorted picture.
const TARGETS: [[f64; 2]; 6] =
    [[0.0, 0.0], [1007.0, 0.0], [503.0, 377.0], [130.0, 700.0], [1007.0, 755.0], [900.0, 20.0]];

/// Pixels at the border of the distorted picture.
const BORDER: [[f64; 2]; 8] = [
    [0.0, 0.0],
    [504.0, 0.0],
    [1007.0, 0.0],
    [1007.0, 378.0],
    [1007.0, 755.0],
    [504.0, 755.0],
    [0.0, 755.0],
    [0.0, 378.0],
];

/// Pixels. OpenCV's maps are in single precision.
const MAP: f64 = 1e-4;

/// On the plane at distance one; of the largest coordinate.
const POINT: f64 = 1e-9;

/// Pixels. The edges are sampled once per pixel.
const INNER: f64 = 2e-3;

struct Reference {
    name: &'static str,
    /// fx, fy, cx, cy of the lens.
    lens: [f64; 4],
    distortion: Distortion,
    /// The same of the pinhole of `sources`.
    pinhole: [f64; 4],
    sources: [[f64; 2]; 6],
    points: [[f64; 2]; 8],
    /// What `getOptimalNewCameraMatrix` returns, and the pinhole within the lens.
    optimal_and_inner: Option<[[f64; 4]; 2]>,
}

const fn opencv(coefficients: [f64; 8]) -> Distortion {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = coefficients;
    Distortion::opencv([k1, k2, k3, k4, k5, k6], [p1, p2])
}

const REFERENCES: [Reference; 5] = [
    Reference {
        name: "barrel",
        lens: [700.0, 705.0, 510.0, 370.0],
        distortion: opencv([-0.35, 0.15, 1e-3, -5e-4, 0.0, 0.0, 0.0, 0.0]),
        pinhole: [573.4, 629.8, 511.3, 369.6],
        sources: [
            [12.9577579498, 41.6131210327],
            [990.48840332, 42.0033836365],
            [499.86819458, 378.28314209],
            [124.409141541, 676.676147461],
            [991.601806641, 714.412841797],
            [897.853881836, 50.451385498],
        ],
        points: [
            [-0.913318860632, -0.660071635878],
            [-0.00937110730611, -0.585897112784],
            [0.894543242603, -0.662217667697],
            [0.865006285924, 0.0129062982995],
            [0.89093250493, 0.683076421863],
            [-0.00940913802942, 0.612464039492],
            [-0.909451765471, 0.68066979896],
            [-0.890553441879, 0.012907804006],
        ],
        optimal_and_inner: Some([
            [573.677286674, 630.042491397, 510.836432277, 369.131775485],
            [573.445208638, 629.836878579, 511.320381948, 369.629618876],
        ]),
    },
    Reference {
        name: "moustache",
        lens: [640.0, 640.0, 500.0, 380.0],
        distortion: opencv([-0.42, 0.22, 2e-3, 1e-3, 0.0, 0.0, 0.0, 0.0]),
        pinhole: [537.2, 542.6, 502.7, 383.7],
        sources: [
            [1.47447955608, 4.36878490448],
            [1004.7578125, 2.20780467987],
            [500.357452393, 372.098388672],
            [143.353118896, 681.156555176],
            [1004.62750244, 748.941345215],
            [878.69744873, 38.632522583],
        ],
        points: [
            [-0.936382897218, -0.713707547891],
            [0.00682672354816, -0.705915919117],
            [0.941138045307, -0.709937036707],
            [0.987066411623, -0.00632959572814],
            [0.940134028963, 0.693320885227],
            [0.00676808811259, 0.684902283729],
            [-0.935308312761, 0.697009460829],
            [-0.980743219319, -0.00633021711001],
        ],
        optimal_and_inner: Some([
            [533.629062165, 542.911046278, 501.902604283, 383.191648216],
            [537.161581503, 542.624369088, 502.706797873, 383.712580594],
        ]),
    },
    Reference {
        name: "pincushion",
        lens: [800.0, 805.0, 495.0, 385.0],
        distortion: opencv([0.3, 0.1, -1e-3, 2e-3, 0.0, 0.0, 0.0, 0.0]),
        pinhole: [929.3, 936.6, 498.1, 384.3],
        sources: [
            [-0.0158204138279, 2.75951385498],
            [1006.30670166, -0.314490944147],
            [499.21862793, 378.725250244],
            [151.229385376, 679.517211914],
            [1003.5690918, 753.970092773],
            [881.466308594, 35.4653244019],
        ],
        points: [
            [-0.535642750965, -0.413016576612],
            [0.0101810121211, -0.448702185988],
            [0.54828291745, -0.409921142233],
            [0.574762528947, -0.00752030960415],
            [0.550605446449, 0.396393228053],
            [0.0102643950254, 0.434080645766],
            [-0.53794600212, 0.399414253647],
            [-0.561824591383, -0.00760123007025],
        ],
        optimal_and_inner: Some([
            [929.529276348, 936.899916331, 497.679137734, 383.811540957],
            [929.275692087, 936.605783624, 498.131598942, 384.331501967],
        ]),
    },
    Reference {
        name: "rational",
        lens: [520.0, 522.0, 505.0, 379.0],
        distortion: opencv([0.35, 0.06, 1e-3, -1e-3, 0.004, 0.75, 0.2, 0.02]),
        pinhole: [148.0, 370.3, 463.9, 385.1],
        sources: [
            [18.224029541, 224.455734253],
            [991.960876465, 245.905593872],
            [638.507507324, 367.937072754],
            [67.1625137329, 546.560852051],
            [1000.53356934, 524.015930176],
            [951.252380371, 232.460388184],
        ],
        points: [
            [-3.91537257079, -3.10793027553],
            [-0.00120939993847, -1.03675614232],
            [4.72598035282, -3.59563947118],
            [3.67688822279, -0.0579890628047],
            [4.21588118488, 2.94914622477],
            [-0.00128535732992, 0.998607124366],
            [-3.63219862004, 2.67393531783],
            [-3.13058886058, -0.0381582081667],
        ],
        optimal_and_inner: Some([
            [206.917046505, 375.640701869, 491.929370445, 383.585422526],
            [148.049403793, 370.317055452, 463.897898311, 385.131486462],
        ]),
    },
    Reference {
        name: "fisheye",
        lens: [330.0, 331.0, 505.0, 377.0],
        distortion: Distortion::Fisheye {
            radial: [0.05, -0.02, 0.004, -0.0008, 0.0, 0.0],
            tangential: [0.0; 2],
            prism: [0.0; 4],
            shifted_last: false,
        },
        pinhole: [191.9, 192.5, 535.0, 374.75],
        sources: [
            [143.450454712, 123.770690918],
            [844.636901855, 107.367141724],
            [450.401489258, 380.838592529],
            [179.287719727, 638.549987793],
            [843.161682129, 649.401794434],
            [802.956848145, 87.4382705688],
        ],
        points: [
            [-18.0941690068, -13.4671147506],
            [-0.0052119979838, -1.95898691591],
            [17.9866788939, -13.4671147506],
            [9.49971720385, 0.0188665680316],
            [17.9866788939, 13.5028365404],
            [-0.00523468166018, 1.97273169272],
            [-18.0941690068, 13.5028365404],
            [-10.4254553879, 0.0205820961264],
        ],
        optimal_and_inner: None,
    },
];

/// A lens from OpenCV's numbers, whose first pixel has its middle at 0.
fn lens([fx, fy, cx, cy]: [f64; 4], distortion: Distortion) -> Lens {
    Lens { focal: DVec2::new(fx, fy), principal: DVec2::new(cx + 0.5, cy + 0.5), distortion }
}

fn pixel(at: [f64; 2]) -> DVec2 {
    DVec2::from(at) + 0.5
}

#[test]
fn the_undistorted_picture_takes_its_pixels_from_where_opencv_takes_them() {
    for reference in REFERENCES {
        let (distorted, pinhole) =
            (lens(reference.lens, reference.distortion), lens(reference.pinhole, Distortion::NONE));
        for (target, source) in TARGETS.into_iter().zip(reference.sources) {
            let found = distorted.pixel_of(pinhole.direction_of(pixel(target)).expect("a pinhole sees everything"));
            let off = (found - pixel(source)).abs().max_element();
            assert!(off < MAP, "{} at {target:?}: {found} is {off} off", reference.name);
        }
    }
}

#[test]
fn the_border_of_a_strong_lens_lies_where_opencv_converges_to() {
    for reference in REFERENCES {
        for (border, point) in BORDER.into_iter().zip(reference.points) {
            let found = lens(reference.lens, reference.distortion).direction_of(pixel(border));
            let is_corner = border[0] != 504.0 && border[1] != 378.0;
            if reference.name == "fisheye" && is_corner {
                assert_eq!(found, None, "beyond 90 degrees, where OpenCV limits the angle");
                continue;
            }
            let found = found.expect("within the lens");
            let off = (found - DVec2::from(point)).abs().max_element();
            assert!(off < POINT * found.abs().max_element(), "{} at {border:?}: {found} is {off} off", reference.name);
        }
    }
}

#[test]
fn the_pinhole_is_the_largest_within_a_strong_lens() {
    for reference in REFERENCES {
        let Some([_, inner]) = reference.optimal_and_inner else { continue };
        let distorted = lens(reference.lens, reference.distortion);
        let found = pinhole_within(&distorted, WIDTH, HEIGHT).expect("seen");
        let found = [found.focal.x, found.focal.y, found.principal.x, found.principal.y];
        let off = found.iter().zip(inner).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < INNER, "{}: {found:?} instead of {inner:?}", reference.name);
    }
}

/// Five steps of OpenCV's fixed-point iteration (METHOD §5.2).
fn five_steps(distortion: Distortion, seen: DVec2) -> DVec2 {
    let Distortion::Perspective { numerator: [k1, k2, k3, _], denominator: [k4, k5, k6], tangential: [p1, p2] } =
        distortion
    else {
        return seen;
    };
    (0..5).fold(seen, |DVec2 { x, y }, _| {
        let r2 = x * x + y * y;
        let shrink = (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))) / (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)));
        let shift = DVec2::new(2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
        (seen - shift) * shrink
    })
}

/// METHOD §5.2 on 9 by 9 points between the middles of the outermost pixels.
#[test]
fn the_rule_of_the_method_is_that_of_opencv_and_five_steps_are_too_few_for_strong_lenses() {
    for reference in REFERENCES {
        let Some([optimal, inner]) = reference.optimal_and_inner else { continue };
        let [fx, fy, cx, cy] = reference.lens;
        let (last_x, last_y) = (f64::from(WIDTH - 1), f64::from(HEIGHT - 1));
        let along = |last: f64| (0..9).map(move |i| f64::from(i) / 8.0 * last);
        let seen = |x: f64, y: f64| five_steps(reference.distortion, DVec2::new((x - cx) / fx, (y - cy) / fy));
        let left = along(last_y).map(|y| seen(0.0, y).x).fold(f64::MIN, f64::max);
        let right = along(last_y).map(|y| seen(last_x, y).x).fold(f64::MAX, f64::min);
        let top = along(last_x).map(|x| seen(x, 0.0).y).fold(f64::MIN, f64::max);
        let bottom = along(last_x).map(|x| seen(x, last_y).y).fold(f64::MAX, f64::min);
        let focal = [last_x / (right - left), last_y / (bottom - top)];
        let found = [focal[0], focal[1], -focal[0] * left, -focal[1] * top];
        assert!(found.iter().zip(optimal).all(|(a, b)| (a - b).abs() < 1e-6), "{}: {found:?}", reference.name);
        let apart = (0..2).map(|axis| (optimal[axis] - inner[axis]).abs()).fold(0.0, f64::max);
        assert!(apart > 0.2, "{}: OpenCV's focal length is {apart} px from the exact one", reference.name);
    }
}
