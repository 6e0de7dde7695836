//! Depth images and masks in files: greyscale PNG.

pub use crate::dataset::pixels::{Image, MAX_PIXELS, largest_integer};

use super::DepthError;
use crate::files;
use png::{BitDepth, ColorType, Decoder, Encoder, Limits, Transformations};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Of depths in 16 bits the number by which sensors and programs mark what was not measured, besides 0: the largest.
pub const NOT_MEASURED: u16 = u16::MAX;

/// Reads a depth image: greyscale of 16 bits.
///
/// # Errors
/// No file, no PNG, an image of another kind, one that ends early or is too large.
pub fn read_depth(path: &Path) -> Result<Image<u16>, DepthError> {
    let expected = "a greyscale PNG of 16 bits with depths in whole units, such as millimetres";
    read(path, expected, |bits| bits == BitDepth::Sixteen)
}

/// Reads a mask: greyscale, where anything but 0 belongs to the object.
///
/// # Errors
/// As [`read_depth`].
pub fn read_mask(path: &Path) -> Result<Image<u16>, DepthError> {
    let expected = "a greyscale PNG, one number a pixel, 0 where the object is not seen";
    read(path, expected, |_| true)
}

fn read(
    path: &Path,
    expected: &'static str,
    allowed: fn(BitDepth) -> bool,
) -> Result<Image<u16>, DepthError> {
    let file = File::open(path).map_err(|source| DepthError::Io {
        path: path.into(),
        source,
    })?;
    let malformed = |reason: String| DepthError::Malformed {
        path: path.into(),
        reason,
        expected,
    };
    let limits = Limits {
        bytes: 4 * MAX_PIXELS,
    };
    let mut decoder = Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_transformations(Transformations::EXPAND);
    let header = decoder
        .read_header_info()
        .map_err(|e| malformed(e.to_string()))?;
    let (width, height) = (header.width as usize, header.height as usize);
    if width.checked_mul(height).is_none_or(|n| n > MAX_PIXELS) {
        return Err(DepthError::TooLarge {
            path: path.into(),
            width,
            height,
            limit: MAX_PIXELS,
        });
    }
    if header.color_type != ColorType::Grayscale || !allowed(header.bit_depth) {
        return Err(malformed(kind(header.color_type, header.bit_depth)));
    }
    let wide = header.bit_depth == BitDepth::Sixteen;
    let mut reader = decoder.read_info().map_err(|e| malformed(e.to_string()))?;
    let bytes = width * height * (1 + usize::from(wide));
    if reader.output_buffer_size() != Some(bytes) {
        return Err(malformed(
            "it has a transparency that no depth image has".into(),
        ));
    }
    let mut buffer = vec![0u8; bytes];
    reader
        .next_frame(&mut buffer)
        .map_err(|e| malformed(e.to_string()))?;
    let values = if wide {
        let (pairs, _) = buffer.as_chunks::<2>();
        pairs.iter().copied().map(u16::from_be_bytes).collect()
    } else {
        buffer.into_iter().map(u16::from).collect()
    };
    Ok(Image {
        size: [width, height],
        values,
    })
}

/// What an image of another kind is.
fn kind(colours: ColorType, bits: BitDepth) -> String {
    let bits = bits as u8;
    match colours {
        ColorType::Grayscale => format!("it is greyscale of {bits} bits"),
        ColorType::GrayscaleAlpha => {
            format!("it is greyscale with a transparency, {bits} bits each")
        }
        ColorType::Rgb | ColorType::Rgba => format!("it has colours, {bits} bits each"),
        ColorType::Indexed => format!("it has a palette of colours, {bits} bits a pixel"),
    }
}

/// Writes a depth image, greyscale of 16 bits.
///
/// # Errors
/// The system's, or an image whose size is not that of its values.
pub fn write_depth(path: &Path, image: &Image<u16>) -> Result<(), DepthError> {
    let bytes: Vec<u8> = image.values.iter().flat_map(|v| v.to_be_bytes()).collect();
    write(path, image.size, BitDepth::Sixteen, &bytes)
}

/// Writes a mask, greyscale of 8 bits: 255 where true.
///
/// # Errors
/// As [`write_depth`].
pub fn write_mask(path: &Path, size: [usize; 2], mask: &[bool]) -> Result<(), DepthError> {
    let bytes: Vec<u8> = mask.iter().map(|&inside| 255 * u8::from(inside)).collect();
    write(path, size, BitDepth::Eight, &bytes)
}

fn write(path: &Path, size: [usize; 2], bits: BitDepth, bytes: &[u8]) -> Result<(), DepthError> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, size[0] as u32, size[1] as u32);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(bits);
    encoder
        .write_header()
        .and_then(|mut writer| {
            writer.write_image_data(bytes)?;
            writer.finish()
        })
        .map_err(std::io::Error::other)
        .and_then(|()| files::write(path, &file))
        .map_err(|source| DepthError::Io {
            path: path.into(),
            source,
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_survive_a_round_trip() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("a.png");
        let image = Image {
            size: [5, 3],
            values: (0..15).map(|i| i * 4369).collect(),
        };
        write_depth(&path, &image).expect("written");
        assert_eq!(read_depth(&path).expect("read"), image);

        let mask: Vec<bool> = (0..15).map(|i| i % 4 == 0).collect();
        write_mask(&path, [5, 3], &mask).expect("written");
        let read = read_mask(&path).expect("read");
        assert!(read.values.iter().map(|&v| v != 0).eq(mask));
        let said = read_depth(&path).expect_err("8 bits").to_string();
        let words = "a.png: it is greyscale of 8 bits; expected a greyscale PNG of 16 bits";
        assert!(said.contains(words), "{said}");
    }

    #[cfg(unix)]
    #[test]
    fn on_a_full_disk_an_image_keeps_its_old_content() {
        let folder = tempfile::tempdir().expect("temporary directory");
        let Some(unmount) = crate::files::tests::small_disk(folder.path()) else {
            return;
        };
        let path = folder.path().join("a.png");
        let outcome = std::panic::catch_unwind(|| {
            let image = |side: usize| Image {
                size: [side, side],
                values: (0..side * side).map(|i| (i * i * 7919) as u16).collect(),
            };
            write_depth(&path, &image(8)).expect("written");
            write_depth(&path, &image(400)).expect_err("full");
            assert_eq!(read_depth(&path).expect("the old one"), image(8));
        });
        unmount();
        outcome.expect("nothing is lost");
    }

    /// 16 bits of them hold labels, of which all above 0 are the object's.
    #[test]
    fn masks_are_greyscale_of_any_depth_and_nothing_else() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("a.png");
        let labels = Image {
            size: [4, 1],
            values: vec![0, 1, 256, u16::MAX],
        };
        write_depth(&path, &labels).expect("written");
        assert_eq!(read_mask(&path).expect("a mask"), labels);
        for (colours, samples, words) in [
            (ColorType::Rgb, 3, "it has colours, 8 bits each"),
            (ColorType::GrayscaleAlpha, 2, "with a transparency, 8 bits"),
        ] {
            let mut encoder = Encoder::new(File::create(&path).expect("created"), 2, 2);
            encoder.set_color(colours);
            encoder.set_depth(BitDepth::Eight);
            let mut writer = encoder.write_header().expect("written");
            writer
                .write_image_data(&vec![9; 4 * samples])
                .expect("written");
            writer.finish().expect("written");
            let said = read_mask(&path).expect_err("colours").to_string();
            assert!(said.contains(words), "{said}");
            assert!(
                said.contains("a.png") && said.contains("one number a pixel"),
                "{said}"
            );
        }
    }

    /// The header alone says how many pixels; no such amount of memory is asked for.
    #[test]
    fn absurd_dimensions_are_refused_by_the_header() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("bomb.png");
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, 2_000_000_000, 2_000_000_000);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Sixteen);
        drop(encoder.write_header());
        std::fs::write(&path, bytes).expect("written");
        assert!(matches!(
            read_depth(&path),
            Err(DepthError::TooLarge {
                width: 2_000_000_000,
                ..
            })
        ));
    }
}
