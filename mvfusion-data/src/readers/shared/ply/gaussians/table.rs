//! The rows of a PLY file, converted to Gaussians.

use serde_ply::{ElementDef, ScalarType};

use crate::readers::shared::ply::element::scalar;
use crate::scene::{
    GaussianCloud, LARGEST_COEFFICIENT, LARGEST_COORDINATE, LIFETIME_FIELDS, LOG_SIZES, Lifetime, MASK_FIELDS,
    rest_width,
};

/// Prefix of the names of the higher colour coefficients.
const REST: &str = "f_rest_";

/// Highest degree of spherical harmonics in 3DGS.
const HIGHEST_DEGREE: usize = 3;

/// The columns of a Gaussian's numbers.
pub(super) struct Columns {
    means: [usize; 3],
    sh_dc: [usize; 3],
    /// Channel by channel, as in the file.
    sh_rest: Vec<usize>,
    sh_degree: usize,
    opacity: [usize; 1],
    scales: [usize; 3],
    rotation: [usize; 4],
    masks: Option<[usize; 3]>,
    lifetimes: Option<[usize; 5]>,
}

impl Columns {
    pub(super) fn of(vertex: &ElementDef) -> Result<Self, String> {
        if vertex.has_property("packed_position") {
            return Err("its Gaussians are compressed (`packed_position`)".to_owned());
        }
        let rest = vertex.properties.iter().filter(|property| property.name.starts_with(REST)).count();
        let sh_degree = (0..=HIGHEST_DEGREE).find(|&degree| rest_width(degree) == rest).ok_or_else(|| {
            let allowed = (0..=HIGHEST_DEGREE).map(|degree| rest_width(degree).to_string()).collect::<Vec<_>>();
            format!("its vertices have {rest} fields `{REST}*`; there can be {}", allowed.join(", "))
        })?;
        let masks = MASK_FIELDS.iter().any(|name| vertex.has_property(name));
        let lifetimes = LIFETIME_FIELDS.iter().any(|name| vertex.has_property(name));
        Ok(Self {
            means: places(vertex, ["x", "y", "z"])?,
            sh_dc: places(vertex, ["f_dc_0", "f_dc_1", "f_dc_2"])?,
            sh_rest: (0..rest).map(|index| place(vertex, &format!("{REST}{index}"))).collect::<Result<_, _>>()?,
            sh_degree,
            opacity: places(vertex, ["opacity"])?,
            scales: places(vertex, ["scale_0", "scale_1", "scale_2"])?,
            rotation: places(vertex, ["rot_0", "rot_1", "rot_2", "rot_3"])?,
            masks: masks.then(|| places(vertex, MASK_FIELDS)).transpose()?,
            lifetimes: lifetimes.then(|| places(vertex, LIFETIME_FIELDS)).transpose()?,
        })
    }
}

fn places<const N: usize>(vertex: &ElementDef, names: [&str; N]) -> Result<[usize; N], String> {
    let mut found = [0; N];
    for (found, name) in found.iter_mut().zip(names) {
        *found = place(vertex, name)?;
    }
    Ok(found)
}

/// The index of the property with this name.
fn place(vertex: &ElementDef, name: &str) -> Result<usize, String> {
    let found = vertex.properties.iter().position(|property| property.name == name);
    let found = found.ok_or_else(|| format!("its vertices have no field `{name}`"))?;
    match scalar(vertex, name) {
        Some(ScalarType::F32 | ScalarType::F64) => Ok(found),
        _ => Err(format!("the field `{name}` of its vertices is not a floating-point number")),
    }
}

/// The Gaussians that were read so far.
pub(super) struct Table {
    columns: Columns,
    /// The current row: a number for every property.
    pub(super) row: Vec<f32>,
    pub(super) cloud: GaussianCloud,
}

impl Table {
    pub(super) fn new(columns: Columns) -> Self {
        let mask_logits = columns.masks.map(|_| Vec::new());
        let lifetimes = columns.lifetimes.map(|_| Vec::new());
        let cloud = GaussianCloud { sh_degree: columns.sh_degree, mask_logits, lifetimes, ..GaussianCloud::default() };
        Self { columns, row: Vec::new(), cloud }
    }

    /// Adds the current row to the cloud.
    pub(super) fn finish_row(&mut self) -> Result<(), String> {
        let Self { columns, row, cloud } = self;
        let [opacity] = within(LARGEST_COEFFICIENT, row, columns.opacity, "opacity")?;
        let means = within(LARGEST_COORDINATE, row, columns.means, "x, y, z")?;
        let sh_dc = within(LARGEST_COEFFICIENT, row, columns.sh_dc, "f_dc_*")?;
        let scales = within(LARGEST_COEFFICIENT, row, columns.scales, "scale_*")?;
        check_logarithms("scale_*", &scales)?;
        let rotation = within(LARGEST_COEFFICIENT, row, columns.rotation, "rot_*")?;
        let masks = columns.masks.map(|places| within(LARGEST_COEFFICIENT, row, places, "mask_*")).transpose()?;
        let lifetime = columns
            .lifetimes
            .map(|places| within(LARGEST_COEFFICIENT, row, places, "time_centre, log_duration, velocity_*"));
        let lifetime = lifetime.transpose()?.map(Lifetime::from_array);
        if let Some(lifetime) = &lifetime {
            check_logarithms("log_duration", &[lifetime.log_duration])?;
        }
        // The file goes channel by channel, the cloud coefficient by coefficient.
        let coefficients = columns.sh_rest.len() / 3;
        for (coefficient, channel) in (0..coefficients).flat_map(|k| (0..3).map(move |channel| (k, channel))) {
            let [value] =
                within(LARGEST_COEFFICIENT, row, [columns.sh_rest[channel * coefficients + coefficient]], "f_rest_*")?;
            cloud.sh_rest.push(value);
        }
        cloud.means.push(means);
        cloud.sh_dc.push(sh_dc);
        cloud.opacity_logits.push(opacity);
        cloud.log_scales.push(scales);
        cloud.quaternions.push(rotation);
        if let (Some(logits), Some(masks)) = (&mut cloud.mask_logits, masks) {
            logits.push(masks);
        }
        if let (Some(lifetimes), Some(lifetime)) = (&mut cloud.lifetimes, lifetime) {
            lifetimes.push(lifetime);
        }
        Ok(())
    }
}

/// The values at some places, which must be numbers of at most `most`.
fn within<const N: usize>(most: f64, row: &[f32], places: [usize; N], name: &str) -> Result<[f32; N], String> {
    let values = places.map(|place| row[place]);
    match values.iter().find(|value| value.is_nan() || f64::from(value.abs()) > most) {
        None => Ok(values),
        Some(value) if !value.is_finite() => Err(format!("`{name}` is not finite")),
        Some(value) => Err(format!("`{name}` is {value:e}, and the largest number is {most:e}")),
    }
}

/// Rejects logarithms of sizes, or of durations, that single precision cannot represent.
fn check_logarithms(name: &str, logarithms: &[f32]) -> Result<(), String> {
    let [least, most] = LOG_SIZES;
    match logarithms.iter().find(|value| !(least..=most).contains(*value)) {
        Some(value) => Err(format!("`{name}` is a logarithm from {least} to {most}, and not {value:e}")),
        None => Ok(()),
    }
}
