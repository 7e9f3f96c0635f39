//! Colours: from linear light to what a display is given, and back.

use glam::DVec3;

/// Linear rgb to display values with a soft shoulder: slope 1 at 0, 1 is never exceeded.
pub fn encoded(linear: DVec3) -> DVec3 {
    let encode = |v: f64| {
        let v = v / (1.0 + v.powi(4)).powf(0.25);
        if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
    };
    DVec3::new(encode(linear.x), encode(linear.y), encode(linear.z))
}

/// An sRGB colour 0xRRGGBB as linear albedo.
pub fn albedo(rgb: u32) -> DVec3 {
    let decode = |byte: u32| {
        let v = f64::from(byte & 255) / 255.0;
        if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    DVec3::new(decode(rgb >> 16), decode(rgb >> 8), decode(rgb))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_round_trip() {
        for rgb in [0x000000, 0x3060C0, 0x808080] {
            let (linear, want) = (albedo(rgb), f64::from(rgb & 255) / 255.0);
            // The shoulder takes up to 0.02 in this range.
            assert!((encoded(linear).z - want).abs() < 0.03, "{rgb:x}");
        }
    }
}
