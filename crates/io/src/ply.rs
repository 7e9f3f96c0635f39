//! Gaussian clouds as `.ply`: INRIA's layout, and for reading also SuperSplat's packed one.
//!
//! Properties are read by name, in any order and of any scalar type; other properties and elements are skipped.
//! `f_rest_*` are stored by channel (all of red, then green, then blue) and become `[coefficient][rgb]`; of SH degree 4
//! the first three degrees are kept. A Gaussian without `scale_2` (2D Gaussians) is flat. Mip-Splatting's `filter_3D`
//! is applied to scales and opacities. Comments say that opacities are compensated for small Gaussians:
//! `SplatRenderMode: mip` (Brush, splat-transform), which is also written here, or `antialiased 1` (Postshot). A cloud with
//! `filter_3D` and without such a comment is Mip-Splatting's own, which always compensates.

use std::path::Path;

use rayon::prelude::*;

use crate::error::IoError;
use crate::ply_table::{Element, PlyTable};
use crate::{LEAST_LOG_SCALE, atomic_write, cut_note, logit_of_byte, ply_packed, read_bytes};
use instgs_vk::scene::PixelFilter;
use instgs_vk::scene::gaussians::{Gaussians, MAX_SH_DEGREE, sh_coefficients};

/// First word of the comment that holds a dilation other than that of 3DGS, px^2; ours alone.
const DILATION_COMMENT: &str = "dilation_px2";

/// Property of Mip-Splatting's 3D filter, and the pixel filter that its programs train and draw with.
const FILTER_3D: &str = "filter_3D";
const MIP_SPLATTING: PixelFilter = PixelFilter { dilation_px2: 0.1, antialias: true };

/// The contents of a `.ply` file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyCloud {
    /// All Gaussians of the file.
    pub gaussians: Gaussians,
    /// The pixel filter that the cloud was trained with.
    pub pixel_filter: PixelFilter,
    /// Notes for the user, one line each.
    pub notes: Vec<String>,
}

/// Bytes of a Gaussian in a plain `.ply`: position, normal, SH, opacity, scale, rotation as floats. 248 for SH degree 3.
pub fn row_bytes(sh_degree: u32) -> u64 {
    4 * (14 + 3 * sh_coefficients(sh_degree) as u64)
}

/// Reads the Gaussians of a `.ply` file. An infinite logit (opacity 0 or 1) becomes a large finite one, and a scale of
/// 0 the smallest normal f32; other non-finite values are kept.
pub fn read_ply(path: &Path) -> Result<Gaussians, IoError> {
    Ok(parse_ply(&read_bytes(path)?, path)?.gaussians)
}

/// Parses the bytes of a `.ply`; `path` is only used in messages.
pub fn parse_ply(bytes: &[u8], path: &Path) -> Result<PlyCloud, IoError> {
    let table = PlyTable::parse(bytes, path)?;
    let vertex = table
        .element("vertex")
        .ok_or_else(|| IoError::new(path, "has no element vertex").advise("a scene has one vertex per Gaussian"))?;
    let said = filter_of(&table.comments);
    let is_mip = said.is_none() && vertex.column(FILTER_3D).is_some();
    let (mut gaussians, file_degree) = if vertex.column("packed_position").is_some() {
        ply_packed::read(&table, path)?
    } else {
        read_plain(&table, vertex, path)?
    };
    gaussians.log_scales.par_iter_mut().flatten().for_each(|s| {
        *s = if *s == f32::NEG_INFINITY { LEAST_LOG_SCALE } else { *s };
    });
    let [transparent, opaque] = [0, u8::MAX].map(logit_of_byte);
    gaussians.opacity_logits.par_iter_mut().filter(|l| l.is_infinite()).for_each(|l| *l = l.clamp(transparent, opaque));
    let mip_note = || {
        let dilation = MIP_SPLATTING.dilation_px2;
        format!(
            "has Mip-Splatting's {FILTER_3D}: drawn as there, with opacity compensation and a dilation of {dilation} px^2"
        )
    };
    let notes = cut_note(file_degree).into_iter().chain(is_mip.then(mip_note)).collect();
    let pixel_filter = said.unwrap_or(if is_mip { MIP_SPLATTING } else { PixelFilter::default() });
    Ok(PlyCloud { gaussians, pixel_filter, notes })
}

/// The pixel filter, by the last comments about it; `None` if no comment is.
fn filter_of(comments: &[Vec<String>]) -> Option<PixelFilter> {
    let dilation = |words: &Vec<String>| match words.as_slice() {
        [name, value] if name == DILATION_COMMENT => dilation_of(value),
        _ => None,
    };
    let (dilation_px2, antialias) = (comments.iter().rev().find_map(dilation), is_compensated(comments));
    let usual = PixelFilter::default();
    (dilation_px2.is_some() || antialias.is_some()).then(|| PixelFilter {
        dilation_px2: dilation_px2.unwrap_or(usual.dilation_px2),
        antialias: antialias.unwrap_or(usual.antialias),
    })
}

/// A dilation that scenes can have, px^2.
pub(crate) fn dilation_of(text: &str) -> Option<f32> {
    text.parse().ok().filter(|dilation| (1e-6..=1e6).contains(dilation))
}

/// Whether opacities are compensated, by the last comment about it; `None` if there is none.
fn is_compensated(comments: &[Vec<String>]) -> Option<bool> {
    let says = |words: &Vec<String>| {
        let words: Vec<String> = words.iter().map(|word| word.to_ascii_lowercase()).collect();
        match words.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
            ["splatrendermode:", mode] => Some(*mode == "mip"),
            ["antialiased", flag] => Some(matches!(*flag, "1" | "true")),
            _ => None,
        }
    };
    comments.iter().rev().find_map(says)
}

/// Reads a cloud in INRIA's layout; also returns the SH degree stored in the file.
fn read_plain(table: &PlyTable<'_>, vertex: &Element, path: &Path) -> Result<(Gaussians, u32), IoError> {
    let column = |name: &str| {
        vertex.column(name).ok_or_else(|| {
            let error = IoError::new(path, format!("element vertex has no property {name}"));
            if vertex.column("opacity").is_none() {
                error.advise("this is a mesh or point cloud, not a cloud of Gaussians")
            } else {
                error
            }
        })
    };
    let means = [column("x")?, column("y")?, column("z")?];
    let dc = [column("f_dc_0")?, column("f_dc_1")?, column("f_dc_2")?];
    let opacity = column("opacity")?;
    let scales = [column("scale_0")?, column("scale_1")?];
    // 2D Gaussians have no third scale.
    let thickness = vertex.column("scale_2");
    let quats = [column("rot_0")?, column("rot_1")?, column("rot_2")?, column("rot_3")?];
    let filter = vertex.column(FILTER_3D);
    let RestColumns { kept: sh_degree, stored, triples } = rest_columns(vertex, path)?;
    let sh = [&[dc], triples.as_slice()].concat();
    let shape = |value: &dyn Fn(usize) -> f32| {
        let [x, y] = scales.map(value);
        let (log_scales, logit) = ([x, y, thickness.map_or(f32::NEG_INFINITY, value)], value(opacity));
        filter.map_or((log_scales, logit), |filter| filtered(log_scales, logit, value(filter)))
    };
    if let Some((bytes, columns)) = table.float_rows("vertex") {
        let rows = FloatRows { bytes, columns };
        let (log_scales, opacity_logits) = rows.rows().map(|row| shape(&|c| float_at(row, c))).unzip();
        let (means, quats) = (rows.values(means), rows.values(quats));
        let sh = rows.runs(&sh);
        return Ok((Gaussians { sh_degree, means, quats, log_scales, opacity_logits, sh }, stored));
    }

    // Grows with the rows read: the walk checks the count against the file's length first.
    let mut out = Gaussians { sh_degree, ..Gaussians::default() };
    table.walk(&mut [("vertex", &mut |_, row: &[f64]| {
        let get = |c: usize| row[c] as f32;
        let (log_scales, logit) = shape(&get);
        out.means.push(means.map(get));
        out.quats.push(quats.map(get));
        out.log_scales.push(log_scales);
        out.opacity_logits.push(logit);
        out.sh.extend(sh.iter().map(|triple| triple.map(get)));
    })])?;
    Ok((out, stored))
}

/// Log scales and logit of a Gaussian after Mip-Splatting's 3D filter of standard deviation `filter`, scene units (Yu
/// et al. 2024, Eq. 9): each variance grows by its square, and the opacity shrinks as the volume grows.
fn filtered(log_scales: [f32; 3], logit: f32, filter: f32) -> ([f32; 3], f32) {
    let grown = log_scales.map(|s| {
        let variance = (2.0 * f64::from(s)).exp();
        0.5 * (variance + f64::from(filter).powi(2)).ln()
    });
    let log_shrink: f64 = log_scales.iter().zip(grown).map(|(&s, grown)| f64::from(s) - grown).sum();
    let opacity = log_shrink.exp() / (1.0 + f64::from(-logit).exp());
    (grown.map(|s| s as f32), (opacity / (1.0 - opacity)).ln() as f32)
}

/// Rows of little-endian floats, read in parallel: about ten times as fast as walking the rows.
struct FloatRows<'a> {
    bytes: &'a [u8],
    columns: usize,
}

impl FloatRows<'_> {
    fn rows(&self) -> rayon::slice::ChunksExact<'_, u8> {
        self.bytes.par_chunks_exact(4 * self.columns)
    }

    /// The given columns of every row.
    fn values<const N: usize>(&self, columns: [usize; N]) -> Vec<[f32; N]> {
        self.rows().map(|row| columns.map(|c| float_at(row, c))).collect()
    }

    /// A list of column triples for every row, concatenated.
    fn runs(&self, columns: &[[usize; 3]]) -> Vec<[f32; 3]> {
        let mut out = vec![[0.0; 3]; self.rows().len() * columns.len()];
        out.par_chunks_exact_mut(columns.len()).zip(self.rows()).for_each(|(run, row)| {
            run.iter_mut().zip(columns).for_each(|(value, triple)| *value = triple.map(|c| float_at(row, c)));
        });
        out
    }
}

fn float_at(row: &[u8], column: usize) -> f32 {
    row[4 * column..].first_chunk().map_or(0.0, |&bytes| f32::from_le_bytes(bytes))
}

/// The columns of an element that hold the SH coefficients above 0.
pub(crate) struct RestColumns {
    /// The SH degree that is read.
    pub(crate) kept: u32,
    /// The SH degree that the file stores.
    pub(crate) stored: u32,
    /// The columns of red, green and blue of the kept coefficients.
    pub(crate) triples: Vec<[usize; 3]>,
}

/// The SH degree of the `f_rest_*` properties of `element`, and their columns.
pub(crate) fn rest_columns(element: &Element, path: &Path) -> Result<RestColumns, IoError> {
    let count = element.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
    let Some(stored) = (0..=4).find(|&d| 3 * (sh_coefficients(d) - 1) == count) else {
        let what = format!("has {count} f_rest properties; SH degrees 0 to 4 have 0, 9, 24, 45 or 72");
        return Err(IoError::damaged(path, what));
    };
    let find = |k: usize| {
        let name = format!("f_rest_{k}");
        element
            .column(&name)
            .ok_or_else(|| IoError::damaged(path, format!("element {} has no property {name}", element.name)))
    };
    let (kept, per_channel) = (stored.min(MAX_SH_DEGREE), count / 3);
    let triple = |k: usize| Ok([find(k)?, find(per_channel + k)?, find(2 * per_channel + k)?]);
    let triples = (0..sh_coefficients(kept) - 1).map(triple).collect::<Result<_, IoError>>()?;
    Ok(RestColumns { kept, stored, triples })
}

/// Writes INRIA's layout (binary little endian, with the zero normals that its readers expect); `antialias` says
/// whether opacities are compensated.
///
/// # Errors
/// The file cannot be written.
pub fn write_ply(path: &Path, cloud: &Gaussians, filter: PixelFilter) -> Result<(), IoError> {
    atomic_write(path, |out| out.write_all(&ply_bytes(cloud, filter)))
}

/// The bytes that [`write_ply`] writes.
pub fn ply_bytes(cloud: &Gaussians, filter: PixelFilter) -> Vec<u8> {
    let per_channel = cloud.sh_coefficients() - 1;
    let mut names: Vec<String> =
        ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(String::from).into();
    names.extend((0..3 * per_channel).map(|k| format!("f_rest_{k}")));
    names.push("opacity".into());
    names.extend((0..3).map(|k| format!("scale_{k}")));
    names.extend((0..4).map(|k| format!("rot_{k}")));
    let mode = if filter.antialias { "comment SplatRenderMode: mip\n" } else { "" };
    let dilation = match filter.has_usual_dilation() {
        true => String::new(),
        false => format!("comment {DILATION_COMMENT} {}\n", filter.dilation_px2),
    };
    let head = format!("ply\nformat binary_little_endian 1.0\n{mode}{dilation}element vertex {}\n", cloud.len());
    let mut out = head.into_bytes();
    for name in &names {
        out.extend_from_slice(format!("property float {name}\n").as_bytes());
    }
    out.extend_from_slice(b"end_header\n");
    out.reserve(4 * names.len() * cloud.len());
    for i in 0..cloud.len() {
        let sh = cloud.sh_of(i);
        let mut put = |values: &[f32]| values.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        put(&cloud.means[i]);
        put(&[0.0; 3]);
        put(&sh[0]);
        for channel in 0..3 {
            sh[1..].iter().for_each(|c| put(&[c[channel]]));
        }
        put(&[cloud.opacity_logits[i]]);
        put(&cloud.log_scales[i]);
        put(&cloud.quats[i]);
    }
    out
}

#[cfg(test)]
pub(crate) mod tests {
    use instgs_samples::sample;

    use super::*;

    fn parse(bytes: &[u8]) -> Result<Gaussians, IoError> {
        parse_ply(bytes, Path::new("test.ply")).map(|cloud| cloud.gaussians)
    }

    /// A file of one Gaussian with the given properties in addition to the required ones.
    fn file_of(comment: &str, properties: &[(String, f32)]) -> Vec<u8> {
        let common = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "rot_0", "rot_1", "rot_2", "rot_3"];
        let all = common.iter().map(|name| (name.to_string(), 0.5)).chain(properties.iter().cloned());
        let (mut head, mut body) =
            (format!("ply\nformat binary_little_endian 1.0\n{comment}element vertex 1\n"), Vec::new());
        for (name, value) in all {
            head += &format!("property float {name}\n");
            body.extend(value.to_le_bytes());
        }
        [head.as_bytes(), b"end_header\n", &body].concat()
    }

    fn named(properties: &[(&str, f32)]) -> Vec<(String, f32)> {
        properties.iter().map(|&(name, value)| (name.into(), value)).collect()
    }

    #[test]
    fn certain_opacities_and_missing_thickness_are_kept() -> Result<(), IoError> {
        let (inf, nan) = (f32::INFINITY, f32::NAN);
        for (logit, want) in [(inf, logit_of_byte(255)), (-inf, logit_of_byte(0)), (20.0, 20.0), (-90.0, -90.0)] {
            let cloud = parse(&file_of("", &named(&[("opacity", logit), ("scale_0", -inf), ("scale_1", -1.0)])))?;
            assert_eq!(cloud.opacity_logits, [want]);
            assert_eq!(cloud.log_scales, [[LEAST_LOG_SCALE, -1.0, LEAST_LOG_SCALE]]);
            assert!(cloud.is_finite(0));
        }
        for bad in [("opacity", nan, "scale_0", 0.0), ("opacity", 0.0, "scale_0", inf)] {
            let cloud = parse(&file_of("", &named(&[(bad.0, bad.1), (bad.2, bad.3), ("scale_1", -1.0)])))?;
            assert!(!cloud.is_finite(0), "{bad:?}");
        }
        assert!((LEAST_LOG_SCALE - f32::MIN_POSITIVE.ln()).abs() < 1e-5);
        Ok(())
    }

    /// Scales of 3 and a filter of 4 give 5; the opacity of 1/2 shrinks by 27 / 125.
    #[test]
    fn the_filter_of_mip_splatting_is_part_of_the_shape() -> Result<(), IoError> {
        let scales = ["scale_0", "scale_1", "scale_2"].map(|name| (name, 3f32.ln()));
        let properties = [&scales[..], &[("opacity", 0.0), ("filter_3D", 4.0)]].concat();
        let cloud = parse(&file_of("", &named(&properties)))?;
        let opacity = 0.5 * 27.0 / 125.0f32;
        assert!(cloud.log_scales[0].iter().all(|s| (s - 5f32.ln()).abs() < 1e-6), "{cloud:?}");
        assert!((cloud.opacity_logits[0] - (opacity / (1.0 - opacity)).ln()).abs() < 1e-6, "{cloud:?}");
        let unfiltered = [&scales[..], &[("opacity", 0.7), ("filter_3D", 0.0)]].concat();
        assert!((parse(&file_of("", &named(&unfiltered)))?.opacity_logits[0] - 0.7).abs() < 1e-6);
        // Its programs compensate opacities without saying so.
        let read = |comment: &str| parse_ply(&file_of(comment, &named(&properties)), Path::new("x"));
        let silent = read("comment made by x\n")?;
        assert_eq!((silent.pixel_filter, silent.notes.len()), (MIP_SPLATTING, 1));
        let said = read("comment SplatRenderMode: default\n")?;
        assert_eq!((said.pixel_filter, said.notes.len()), (PixelFilter::default(), 0));
        Ok(())
    }

    #[test]
    fn comments_tell_of_opacity_compensation() -> Result<(), IoError> {
        let shape = named(&[("opacity", 0.0), ("scale_0", 0.0), ("scale_1", 0.0), ("scale_2", 0.0)]);
        let mip = "comment splatrendermode: MIP\n";
        for (comments, want) in [
            (String::new(), false),
            (mip.to_owned(), true),
            ("comment antialiased 1\n".into(), true),
            ("comment antialiased 0\ncomment made by x\n".into(), false),
            (format!("{mip}comment SplatRenderMode: default\n"), false),
        ] {
            assert_eq!(
                parse_ply(&file_of(&comments, &shape), Path::new("x"))?.pixel_filter.antialias,
                want,
                "{comments}"
            );
        }
        for (antialias, dilation_px2) in [(false, 0.3), (true, 0.3), (true, 0.1)] {
            let filter = PixelFilter { dilation_px2, antialias };
            assert_eq!(parse_ply(&ply_bytes(&sample(1, 2), filter), Path::new("x"))?.pixel_filter, filter);
        }
        let odd = file_of("comment dilation_px2 nothing\n", &shape);
        assert_eq!(parse_ply(&odd, Path::new("x"))?.pixel_filter, PixelFilter::default());
        Ok(())
    }

    #[test]
    fn of_sh_degree_4_the_first_three_are_kept() -> Result<(), IoError> {
        let shape = named(&[("opacity", 0.0), ("scale_0", 0.0), ("scale_1", 0.0), ("scale_2", 0.0)]);
        let rest = (0..72u8).map(|k| (format!("f_rest_{k}"), f32::from(k)));
        let cloud = parse_ply(&file_of("", &shape.into_iter().chain(rest).collect::<Vec<_>>()), Path::new("x"))?;
        assert_eq!((cloud.gaussians.sh_degree, cloud.notes.len()), (3, 1));
        let want = (0..15u8).map(|k| [k, 24 + k, 48 + k].map(f32::from));
        assert_eq!(cloud.gaussians.sh[1..], want.collect::<Vec<_>>());
        Ok(())
    }

    #[test]
    fn what_is_written_is_read() {
        for degree in 0..=3 {
            let cloud = sample(degree, 5);
            assert_eq!(parse(&ply_bytes(&cloud, PixelFilter::default())), Ok(cloud));
        }
        assert_eq!(parse(&ply_bytes(&Gaussians::default(), PixelFilter::default())), Ok(Gaussians::default()));
    }

    /// Rows of little-endian floats are read in parallel; the same file in big endian is walked.
    #[test]
    fn both_ways_of_reading_agree() {
        let cloud = sample(3, 300);
        let mut bytes = ply_bytes(&cloud, PixelFilter::default());
        assert_eq!(parse(&bytes[..bytes.len() - 1]).map_err(|e| e.to_string().contains("ends early")), Err(true));
        let end = b"end_header\n";
        let body = bytes.windows(end.len()).position(|w| w == end).unwrap_or(0) + end.len();
        bytes[body..].chunks_exact_mut(4).for_each(<[u8]>::reverse);
        let header = String::from_utf8_lossy(&bytes[..body]).replace("little", "big");
        let big = [header.as_bytes(), &bytes[body..]].concat();
        assert_eq!(parse(&big), Ok(cloud));
    }

    const HEADER_TAIL: &str = "element pre 1\nproperty list uchar int ids\nproperty short q\nelement vertex 2\nproperty double rot_3\n\
        property float rot_2\nproperty float rot_1\nproperty float rot_0\nproperty uchar extra\nproperty float z\nproperty float y\n\
        property float x\nproperty float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n\
        property float scale_0\nproperty float scale_1\nproperty float scale_2\nelement post 9\nproperty int a\nend_header\n";

    fn expected() -> Gaussians {
        Gaussians {
            sh_degree: 0,
            means: vec![[8.0, 7.0, 6.0]; 2],
            quats: vec![[4.0, 3.0, 2.0, 1.0]; 2],
            log_scales: vec![[13.0, 14.0, 15.0]; 2],
            opacity_logits: vec![12.0; 2],
            sh: vec![[9.0, 10.0, 11.0]; 2],
        }
    }

    #[test]
    fn every_encoding_with_any_order_types_extras_and_lists() {
        let ascii = format!(
            "ply\r\nformat ascii 1.0\ncomment x\n{HEADER_TAIL}3 1 2 3 7\n1 2 3 4 5 6 7 8 9 10 11 12 13 14 15\n1 2 3 4 5 6 7 8 9 10 11 12 13 14 1.5e1"
        );
        assert_eq!(parse(ascii.as_bytes()), Ok(expected()));
        for big in [false, true] {
            let name = if big { "big" } else { "little" };
            let mut bytes = format!("ply\nformat binary_{name}_endian 1.0\n{HEADER_TAIL}").into_bytes();
            let mut put = |le: &[u8]| {
                let mut v = le.to_vec();
                if big {
                    v.reverse();
                }
                bytes.extend(v);
            };
            put(&[2]);
            put(&7i32.to_le_bytes());
            put(&8i32.to_le_bytes());
            put(&9i16.to_le_bytes());
            for _ in 0..2 {
                put(&1f64.to_le_bytes());
                (2..=15u8).for_each(|v| if v == 5 { put(&[v]) } else { put(&f32::from(v).to_le_bytes()) });
            }
            assert_eq!(parse(&bytes), Ok(expected()));
        }
    }

    #[test]
    fn errors_name_what_is_wrong() {
        let text = |bytes: &[u8]| parse(bytes).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text(b"hello\n").contains("not a PLY"));
        let bytes = ply_bytes(&sample(1, 2), PixelFilter::default());
        let cut = text(&bytes[..bytes.len() - 3]);
        assert!(cut.contains(&format!("byte {}", bytes.len() - 3)) && cut.contains("ends early"), "{cut}");
        let edit = |from: &str, to: &str| {
            let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap_or(0);
            [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
        };
        assert!(text(&edit("scale_1", "scale_x")).contains("scale_1"));
        assert!(text(&edit("f_rest_8", "g_rest_8")).contains("8 f_rest"));
        assert!(text(&edit("f_rest_8", "f_rest_9")).contains("f_rest_8"));
        assert!(text(&edit("vertex 2\n", "vertex 4611686018427387904\n")).contains("ends early"));
    }
}
