//! Pixels as a PNG file.

use crate::results::FileResult;

/// A PNG file of `size` pixels of eight bits a channel.
///
/// # Errors
/// A sentence that says why it cannot be written.
pub fn png_file(
    size: [u32; 2],
    pixels: &[u8],
    configure: impl FnOnce(&mut png::Encoder<'_, &mut Vec<u8>>),
) -> FileResult<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_depth(png::BitDepth::Eight);
    configure(&mut encoder);
    let write = |encoder: png::Encoder<'_, _>| {
        let mut writer = encoder.write_header()?;
        writer.write_image_data(pixels)?;
        writer.finish()
    };
    write(encoder).map_err(|e: png::EncodingError| e.to_string())?;
    Ok(bytes)
}
