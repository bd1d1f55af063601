//! OpenEXR images: all layers of a frame as floats.

use std::io::Cursor;

use anyhow::Context;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer as Part, LayerAttributes, WritableImage,
};
use mvfusion_model::evaluation::Layer;

/// The values of a layer, channel by channel, row by row.
pub(super) struct LayerPixels {
    pub(super) layer: Layer,
    pub(super) values: Vec<f32>,
}

/// An image with several layers of `width` by `height` pixels.
///
/// An OpenEXR layer is a set of channels whose names start with the name of the layer and a dot. All channels are in
/// one part, which every reader opens. The first colour layer is also stored without a name, for readers without
/// support for layers.
pub(super) fn encode(width: usize, height: usize, layers: &[LayerPixels]) -> anyhow::Result<Vec<u8>> {
    let plane = width * height;
    let named = |prefix: String, pixels: &LayerPixels| -> Vec<AnyChannel<FlatSamples>> {
        let channels = pixels.layer.channels().iter().zip(pixels.values.chunks_exact(plane));
        channels
            .map(|(name, values)| AnyChannel::new(&*format!("{prefix}{name}"), FlatSamples::F32(values.to_vec())))
            .collect()
    };
    let plain = layers.iter().find(|pixels| pixels.layer.channels().len() == 3);
    let plain = plain.map(|pixels| named(String::new(), pixels)).unwrap_or_default();
    let layered = layers.iter().flat_map(|pixels| named(format!("{}.", pixels.layer), pixels));
    let attributes = LayerAttributes { software_name: Some("mvfusion".into()), ..LayerAttributes::default() };
    let channels = AnyChannels::sort(plain.into_iter().chain(layered).collect());
    let part = Part::new((width, height), attributes, Encoding::SMALL_LOSSLESS, channels);

    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(part).write().to_buffered(&mut bytes).context("cannot encode the image as OpenEXR")?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use exr::prelude::{ReadChannels, ReadLayers, read};

    use super::*;

    #[test]
    fn every_channel_is_found_again_by_its_name_bit_by_bit() {
        // Numbers that 16 bits do not hold.
        let values = |first: f32, count: usize| (0..count).map(|i| first + i as f32 * 1e-7).collect();
        let layers = [
            LayerPixels { layer: Layer::Depth, values: values(0.5, 6) },
            LayerPixels { layer: Layer::Static, values: values(-0.25, 18) },
            LayerPixels { layer: Layer::Motion, values: values(1e-9, 6) },
        ];
        let bytes = encode(3, 2, &layers).expect("coded");
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
            .expect("read");
        let channels = &image.layer_data.channel_data.list;
        let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
        assert_eq!(names, ["B", "G", "R", "depth.Z", "motion.Y", "static.B", "static.G", "static.R"]);
        let of = |name: &str| -> Vec<f32> {
            let place = names.iter().position(|other| other == name).expect("there");
            channels[place].sample_data.values_as_f32().collect()
        };
        assert_eq!(of("depth.Z"), layers[0].values);
        assert_eq!((of("static.R"), of("static.B")), (layers[1].values[..6].to_vec(), layers[1].values[12..].to_vec()));
        assert_eq!(of("G"), layers[1].values[6..12]);
        assert_eq!(of("motion.Y"), layers[2].values);
    }
}
