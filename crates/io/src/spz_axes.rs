//! Axes of `.spz` files, and the extensions of which one names them.
//!
//! Extensions are records: type u32, length of the payload in bytes u32, payload. Version 4 has them between the header
//! and the table of contents, older versions behind the arrays. `SPZ_ADOBE_coordinate_system` (type 0xADBE0003) has a u32
//! that names the file's axes: 0 none (right-up-back, as without the extension); 1 to 8 n - 1 = bits of (x right, y up, z
//! front); 9 to 16 n - 9 = bits of (x right, z up, y back).

use glam::{DMat3, DVec3};

use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::Gaussians;

/// Type of the extension that names the axes.
const COORDINATE_SYSTEM: u32 = 0xADBE_0003;
/// Types of extensions that change no Gaussian: limits of orbits (Adobe), the place on Earth (Niantic).
const HARMLESS: [u32; 2] = [0xADBE_0002, 0x4E53_0001];

const X: u8 = 1;
const Y: u8 = 2;
const Z: u8 = 4;
/// The coordinates in which SH basis functions 1 to 15 are odd.
const ODD_IN: [u8; 15] = [Y, Z, X, X | Y, Y | Z, 0, X | Z, 0, Y, X | Y | Z, Y, Z, X, Z, X];

/// How the axes of a file become those of scenes, right-down-front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Axes {
    /// Factors of x, y and z, 1 or -1.
    signs: [f64; 3],
    /// Whether a quarter turn about x, which brings y to z, follows.
    quarter_turn: bool,
}

impl Axes {
    /// Right-up-back: the axes of files that name none.
    pub(crate) const USUAL: Self = Self { signs: [1.0, -1.0, -1.0], quarter_turn: false };

    /// The axes of a number of the extension, `None` if it is not known.
    fn numbered(number: u32) -> Option<Self> {
        let sign = |is_positive: bool| if is_positive { 1.0 } else { -1.0 };
        let bits = |n: u32| [n & 1 != 0, n & 2 != 0, n & 4 != 0];
        match number {
            0 => Some(Self::USUAL),
            1..=8 => {
                let [right, up, front] = bits(number - 1);
                Some(Self { signs: [sign(right), sign(!up), sign(front)], quarter_turn: false })
            }
            9..=16 => {
                let [right, up, back] = bits(number - 9);
                // Of right, front and up the turn makes right, down and front.
                Some(Self { signs: [sign(right), sign(!back), sign(up)], quarter_turn: true })
            }
            _ => None,
        }
    }

    /// Factors of positions.
    pub(crate) fn signs(&self) -> [f64; 3] {
        self.signs
    }

    /// Factors of x, y and z of rotations: their axis is turned, not mirrored, with the coordinates.
    pub(crate) fn quat_signs(&self) -> [f64; 3] {
        let [x, y, z] = self.signs;
        [y * z, x * z, x * y]
    }

    /// Factors of the SH coefficients 1 to 15.
    pub(crate) fn sh_signs(&self) -> [f32; 15] {
        let [x, y, z] = self.signs;
        let factor = |odd: u8, axis: u8, sign: f64| if odd & axis != 0 { sign } else { 1.0 };
        ODD_IN.map(|odd| (factor(odd, X, x) * factor(odd, Y, y) * factor(odd, Z, z)) as f32)
    }

    /// A cloud to which the factors are applied, after the quarter turn if there is one.
    pub(crate) fn turned(&self, cloud: Gaussians) -> Gaussians {
        if !self.quarter_turn {
            return cloud;
        }
        let turn = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
        cloud.placed(Similarity::from_parts(turn, 1.0, DVec3::ZERO))
    }
}

/// What the extensions of a file mean.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Extensions {
    /// The axes of the file.
    pub(crate) axes: Axes,
    /// Notes for the user, one line each.
    pub(crate) notes: Vec<String>,
}

impl Default for Extensions {
    fn default() -> Self {
        Self { axes: Axes::USUAL, notes: Vec::new() }
    }
}

impl Extensions {
    /// Parses the records of a block. What is unknown or damaged becomes a note.
    pub(crate) fn parse(block: &[u8]) -> Self {
        let mut out = Self::default();
        let mut rest = block;
        let mut ignored = false;
        while let Some((kind, length, tail)) = record_head(rest) {
            let Some((payload, next)) = tail.split_at_checked(length as usize) else { break };
            rest = next;
            match kind {
                COORDINATE_SYSTEM => out.set_axes(payload),
                kind => ignored |= !HARMLESS.contains(&kind),
            }
        }
        if ignored || !rest.is_empty() {
            let what =
                "has vendor extensions, which are ignored; if one declares other axes, the scene appears rotated";
            out.notes.push(what.into());
        }
        out
    }

    /// Takes the axes from the payload of their extension.
    fn set_axes(&mut self, payload: &[u8]) {
        let number = payload.first_chunk().map(|&bytes| u32::from_le_bytes(bytes));
        match number.and_then(Axes::numbered) {
            Some(axes) => self.axes = axes,
            None => {
                let number = number.map_or_else(|| "no number".to_owned(), |n| format!("number {n}"));
                self.notes.push(format!("names its axes by {number}, which is not known: the scene may appear turned"));
            }
        }
    }
}

/// Type and length of the payload of the first record, and the bytes behind them.
fn record_head(bytes: &[u8]) -> Option<(u32, u32, &[u8])> {
    let (kind, rest) = bytes.split_first_chunk()?;
    let (length, rest) = rest.split_first_chunk()?;
    Some((u32::from_le_bytes(*kind), u32::from_le_bytes(*length), rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample;
    use instgs_vk::math::covariance::rotation_from_quat;
    use instgs_vk::math::sh::{eval_sh, sh_basis};

    /// A block of one record.
    fn record(kind: u32, payload: &[u8]) -> Vec<u8> {
        [&kind.to_le_bytes()[..], &(payload.len() as u32).to_le_bytes(), payload].concat()
    }

    /// Directions of x, y and z of the file in right-down-front axes.
    fn directions(name: &str) -> [DVec3; 3] {
        let direction = |letter: char| match letter {
            'L' => DVec3::NEG_X,
            'R' => DVec3::X,
            'U' => DVec3::NEG_Y,
            'D' => DVec3::Y,
            'B' => DVec3::NEG_Z,
            _ => DVec3::Z,
        };
        let mut letters = name.chars().map(direction);
        std::array::from_fn(|_| letters.next().unwrap_or_default())
    }

    const NAMES: [&str; 16] = [
        "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF", "LFD", "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU",
    ];

    #[test]
    fn sh_signs_are_those_of_the_basis() {
        let direction = DVec3::new(0.3, -0.5, 0.8).normalize();
        for number in 1..=8 {
            let axes = Axes::numbered(number).unwrap();
            let [mirrored, straight] = [direction * DVec3::from_array(axes.signs()), direction].map(sh_basis);
            for (k, sign) in axes.sh_signs().into_iter().enumerate() {
                assert!((mirrored[k + 1] - f64::from(sign) * straight[k + 1]).abs() < 1e-15, "{number}: {k}");
            }
        }
        assert_eq!(Axes::numbered(4), Some(Axes::USUAL));
        assert_eq!(Axes::numbered(0), Some(Axes::USUAL));
        assert_eq!(Axes::numbered(17), None);
    }

    /// A cloud in every frame of the extension, compared by where its points are, what its ellipsoids cover and what
    /// colour it has from one side.
    #[test]
    fn every_frame_shows_the_same_cloud() {
        let cloud = sample(3, 20);
        for (number, name) in (1..).zip(NAMES) {
            let axes = Axes::numbered(number).unwrap();
            let to_scene = DMat3::from_cols_array_2d(&directions(name).map(|d| d.to_array()));
            let mut turned = cloud.clone();
            let ([sx, sy, sz], signs) = (axes.quat_signs(), axes.signs().map(|s| s as f32));
            turned.means.iter_mut().for_each(|m| *m = std::array::from_fn(|k| m[k] * signs[k]));
            turned.quats.iter_mut().for_each(|[_, x, y, z]| {
                (*x, *y, *z) = (*x * sx as f32, *y * sy as f32, *z * sz as f32);
            });
            let sh_signs = axes.sh_signs();
            for (k, sh) in turned.sh.iter_mut().enumerate().filter(|(k, _)| k % 16 > 0) {
                *sh = sh.map(|v| v * sh_signs[k % 16 - 1]);
            }
            let turned = axes.turned(turned);
            let side = DVec3::new(0.6, 0.0, -0.8);
            for i in 0..cloud.len() {
                let wide = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
                assert!((to_scene * wide(cloud.means[i]) - wide(turned.means[i])).length() < 1e-6, "{name}");
                let axis = |cloud: &Gaussians| rotation_from_quat(cloud.quats[i].map(f64::from)).z_axis;
                let along = (to_scene * axis(&cloud)).dot(axis(&turned)).abs();
                assert!((along - 1.0).abs() < 1e-6, "{name}: {along}");
                let want = eval_sh(3, cloud.sh_of(i), to_scene.transpose() * side);
                assert!((eval_sh(3, turned.sh_of(i), side) - want).length() < 1e-5, "{name}");
            }
        }
    }

    #[test]
    fn only_unknown_extensions_are_noted() {
        let axes = |number: u32| record(COORDINATE_SYSTEM, &number.to_le_bytes());
        let read = Extensions::parse(&[record(0xADBE_0002, &[0; 12]), axes(6)].concat());
        assert_eq!(read, Extensions { axes: Axes { signs: [1.0; 3], quarter_turn: false }, notes: Vec::new() });
        assert_eq!(Extensions::parse(&[]), Extensions::default());
        let noted = |block: &[u8], word: &str| {
            let Extensions { axes, notes } = Extensions::parse(block);
            assert!(axes == Axes::USUAL && notes.len() == 1 && notes[0].contains(word), "{notes:?}");
        };
        noted(&axes(17), "number 17");
        noted(&record(COORDINATE_SYSTEM, &[6]), "no number");
        noted(&record(0x1234_0001, &[0; 7]), "vendor extensions");
        noted(&[1, 2, 3], "vendor extensions");
        noted(&axes(6)[..11], "vendor extensions");
    }
}
