//! `hexplane` and `regularisers`: the planes, the look-up and the penalties.

use anyhow::Result;
use burn::module::Param;
use burn::tensor::{DType, Device, Gradients, Tensor};
use mvfusion_model::model::network::HexPlane;
use mvfusion_render::grid::regulariser::{GridPenalties, penalties};
use mvfusion_render::grid::{GridBounds, GridLayout, PlaneLayout};
use mvfusion_tests::{Array, Checklist, Tolerance, gradient, tensor};

use crate::archive::Archive;

/// From the README of the oracle, about ten times the error of a run in single precision.
const TOLERANCE: Tolerance = Tolerance::of_largest(5e-5).plus(1e-6);

/// From the README of the oracle.
const REGULARISERS: Tolerance = Tolerance::of_largest(2e-6).plus(1e-12);

/// The size of a file's grid.
pub fn layout(archive: &Archive) -> Result<GridLayout> {
    let resolution = archive.counts("in.resolution")?;
    Ok(GridLayout {
        features: archive.array("in.plane_s0_p0")?.shape[0],
        resolution: std::array::from_fn(|axis| resolution[axis]),
        multipliers: archive.counts("in.multires")?,
    })
}

/// The box of a file's grid.
fn bounds(archive: &Archive) -> Result<GridBounds> {
    let corners = &archive.array("in.aabb")?.values;
    Ok(GridBounds { min: std::array::from_fn(|i| corners[3 + i]), max: std::array::from_fn(|i| corners[i]) })
}

/// A file's field.
pub fn field(archive: &Archive, device: &Device) -> Result<HexPlane> {
    let layout = layout(archive)?;
    let planes = planes(archive, &layout)?;
    let planes = tensor(&planes, [layout.cells(), layout.features], device, DType::F32);
    Ok(HexPlane::from_planes(Param::from_tensor(planes), layout, bounds(archive)?))
}

/// The name of a plane in the files.
pub fn plane_name(plane: &PlaneLayout) -> String {
    format!("plane_s{}_p{}", plane.scale, plane.pair)
}

/// All planes in our order, `[cells, F]`; in the files each is `[F, height, width]`.
fn planes(archive: &Archive, layout: &GridLayout) -> Result<Vec<f64>> {
    let mut cells = vec![0.0; layout.cells() * layout.features];
    for plane in layout.planes() {
        let stored = &archive.array(&format!("in.{}", plane_name(&plane)))?;
        anyhow::ensure!(stored.shape == [layout.features, plane.height, plane.width], "{plane:?}: {:?}", stored.shape);
        for feature in 0..layout.features {
            for cell in 0..plane.cells() {
                cells[(plane.first_cell + cell) * layout.features + feature] =
                    stored.values[feature * plane.cells() + cell];
            }
        }
    }
    Ok(cells)
}

/// One plane of `[cells, F]` as the files store it.
fn as_stored(cells: &Array, plane: &PlaneLayout) -> Array {
    let features = cells.shape[1];
    let value = |i: usize| cells.values[(plane.first_cell + i % plane.cells()) * features + i / plane.cells()];
    let count = features * plane.cells();
    Array::new([features, plane.height, plane.width], (0..count).map(value).collect())
}

/// Compares the gradients of those planes that are stored under `prefix`.
pub fn compare_planes(
    checks: &mut Checklist,
    archive: &Archive,
    prefix: &str,
    found: &Array,
    layout: &GridLayout,
    tolerance: Tolerance,
) {
    for plane in layout.planes() {
        let name = format!("{prefix}{}", plane_name(&plane));
        if let Some(expected) = archive.find(&name) {
            checks.close(&name, expected, &as_stored(found, &plane), tolerance);
        }
    }
}

/// The field's features and gradients.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let device = device.clone().autodiff();
    let field = field(archive, &device)?;
    let points = archive.tensor::<2>("in.xyz", &device)?.require_grad();
    let times = archive.tensor::<2>("in.t", &device)?.require_grad();
    let features = field.forward(points.clone(), times.clone());
    let gradients = (features.clone() * archive.tensor("in.cot", &device)?).sum().backward();

    let mut checks = Checklist::default();
    checks.close("feat", archive.array("out.feat")?, &Array::of(features), TOLERANCE);
    checks.close("grad.xyz", archive.array("out.grad.xyz")?, &gradient(&points, &gradients), TOLERANCE);
    checks.close("grad.t", archive.array("out.grad.t")?, &gradient(&times, &gradients), TOLERANCE);
    let planes = gradient(&field.planes.val(), &gradients);
    compare_planes(&mut checks, archive, "out.grad.", &planes, field.layout(), TOLERANCE);
    checks.finish()
}

/// The penalties and their gradients.
pub fn check_regularisers(archive: &Archive, device: &Device) -> Result<()> {
    let device = device.clone().autodiff();
    let layout = layout(archive)?;
    let values = planes(archive, &layout)?;
    let shape = [layout.cells(), layout.features];
    let leaf = |values: &[f64]| tensor(values, shape, &device, DType::F32).require_grad();
    let weights = ["in.w_plane", "in.w_time", "in.w_l1"].map(|name| archive.number(name));
    let [w_plane, w_time, w_l1] = weights;
    let (w_plane, w_time, w_l1) = (w_plane?, w_time?, w_l1?);
    let total = |p: GridPenalties| p.plane_smooth * w_plane + p.time_smooth * w_time + p.l1_time * w_l1;

    let mut checks = Checklist::default();
    let terms: [(&str, &dyn Fn(GridPenalties) -> Tensor<1>); 4] = [
        ("plane_smooth", &|p| p.plane_smooth),
        ("time_smooth", &|p| p.time_smooth),
        ("l1_time", &|p| p.l1_time),
        ("total", &total),
    ];
    for (name, term) in terms {
        let planes = leaf(&values);
        let value = term(penalties(planes.clone(), &layout)?);
        let gradients: Gradients = value.backward();
        let expected = archive.number(&format!("out.{name}"))?;
        checks.close_number(name, expected, Array::of(value).values[0], REGULARISERS);
        let prefix = format!("out.grad.{name}.");
        compare_planes(&mut checks, archive, &prefix, &gradient(&planes, &gradients), &layout, REGULARISERS);
    }
    for plane in layout.planes() {
        // Alone among planes of zeros, a plane is all there is in its sum.
        let begin = plane.first_cell * layout.features;
        let own = begin..begin + plane.cells() * layout.features;
        let alone: Vec<f64> = values.iter().enumerate().map(|(i, &v)| if own.contains(&i) { v } else { 0.0 }).collect();
        let sums = penalties(leaf(&alone), &layout)?;
        let found = if plane.is_time() { sums.time_smooth } else { sums.plane_smooth };
        let name = format!("out.second_diff.{}", plane_name(&plane));
        checks.close_number(&name, archive.number(&name)?, Array::of(found).values[0], REGULARISERS);
    }
    checks.finish()
}
