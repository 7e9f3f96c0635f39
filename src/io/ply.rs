//! Gaussian clouds as `.ply`: the INRIA layout, and SuperSplat's packed one for reading.
//!
//! Read by property name, in any order and of any scalar type; further properties and elements are skipped.
//! `f_rest_*` are stored by channel (all of red, then green, then blue) and become `[coefficient][rgb]`.

use std::path::Path;

use rayon::prelude::*;

use crate::io::error::IoError;
use crate::io::ply_table::{Element, PlyTable};
use crate::io::{atomic_write, ply_packed, read_bytes};
use crate::scene::gaussians::{Gaussians, sh_coefficients};

/// Reads a `.ply` cloud. Values are kept as they are, non-finite ones included.
pub fn read_ply(path: &Path) -> Result<Gaussians, IoError> {
    parse_ply(&read_bytes(path)?, path)
}

/// Parses the bytes of a `.ply`; `path` is for messages only.
pub fn parse_ply(bytes: &[u8], path: &Path) -> Result<Gaussians, IoError> {
    let table = PlyTable::parse(bytes, path)?;
    let vertex = table.element("vertex").ok_or_else(|| IoError::new(path, "has no element vertex"))?;
    if vertex.column("packed_position").is_some() {
        return ply_packed::read(&table, path);
    }
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
    let scales = [column("scale_0")?, column("scale_1")?, column("scale_2")?];
    let quats = [column("rot_0")?, column("rot_1")?, column("rot_2")?, column("rot_3")?];
    let (sh_degree, rest) = rest_columns(vertex, path)?;
    let per_channel = sh_coefficients(sh_degree) - 1;
    if let Some((bytes, columns)) = table.float_rows("vertex") {
        let sh: Vec<[usize; 3]> =
            (0..per_channel).map(|k| [rest[k], rest[per_channel + k], rest[2 * per_channel + k]]).collect();
        let rows = FloatRows { bytes, columns };
        return Ok(Gaussians {
            sh_degree,
            means: rows.values(means),
            quats: rows.values(quats),
            log_scales: rows.values(scales),
            opacity_logits: rows.values([opacity]).into_iter().map(|[logit]| logit).collect(),
            sh: rows.runs(&[&[dc], sh.as_slice()].concat()),
        });
    }

    // Grows with what is really there: the walk checks the count against the file's length first.
    let mut out = Gaussians { sh_degree, ..Gaussians::default() };
    table.walk(&mut [("vertex", &mut |_, row: &[f64]| {
        let get = |c: usize| row[c] as f32;
        out.means.push(means.map(get));
        out.quats.push(quats.map(get));
        out.log_scales.push(scales.map(get));
        out.opacity_logits.push(get(opacity));
        out.sh.push(dc.map(get));
        for k in 0..per_channel {
            out.sh.push([rest[k], rest[per_channel + k], rest[2 * per_channel + k]].map(get));
        }
    })])?;
    Ok(out)
}

/// Rows of little-endian floats, read by all cores: a file of 100 MB takes a tenth of the second that walking takes.
struct FloatRows<'a> {
    bytes: &'a [u8],
    columns: usize,
}

impl FloatRows<'_> {
    fn rows(&self) -> rayon::slice::ChunksExact<'_, u8> {
        self.bytes.par_chunks_exact(4 * self.columns)
    }

    /// These columns of every row.
    fn values<const N: usize>(&self, columns: [usize; N]) -> Vec<[f32; N]> {
        self.rows().map(|row| columns.map(|c| float_at(row, c))).collect()
    }

    /// A run of triples for every row.
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

/// The SH degree that the `f_rest_*` properties of `element` call for, and their columns by number.
pub(crate) fn rest_columns(element: &Element, path: &Path) -> Result<(u32, Vec<usize>), IoError> {
    let count = element.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
    let Some(degree) = (0..=3).find(|&d| 3 * (sh_coefficients(d) - 1) == count) else {
        let what = format!("has {count} f_rest properties; SH degrees 0 to 3 have 0, 9, 24 or 45");
        return Err(IoError::new(path, what));
    };
    let find = |k: usize| {
        let name = format!("f_rest_{k}");
        element
            .column(&name)
            .ok_or_else(|| IoError::new(path, format!("element {} has no property {name}", element.name)))
    };
    Ok((degree, (0..count).map(find).collect::<Result<_, _>>()?))
}

/// Writes the INRIA layout (binary little endian, with the zero normals that its readers expect).
pub fn write_ply(path: &Path, cloud: &Gaussians) -> Result<(), IoError> {
    atomic_write(path, |out| out.write_all(&ply_bytes(cloud)))
}

/// The bytes that [`write_ply`] writes.
pub fn ply_bytes(cloud: &Gaussians) -> Vec<u8> {
    let per_channel = cloud.sh_coefficients() - 1;
    let mut names: Vec<String> =
        ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(String::from).into();
    names.extend((0..3 * per_channel).map(|k| format!("f_rest_{k}")));
    names.push("opacity".into());
    names.extend((0..3).map(|k| format!("scale_{k}")));
    names.extend((0..4).map(|k| format!("rot_{k}")));
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", cloud.len()).into_bytes();
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
    use super::*;

    /// A cloud whose every value is different.
    pub(crate) fn sample(degree: u32, n: usize) -> Gaussians {
        let mut counter = 0;
        let mut next = || {
            counter += 1;
            (counter % 997) as f32 * 0.001 - 0.4
        };
        let mut out = Gaussians { sh_degree: degree, ..Gaussians::default() };
        for _ in 0..n {
            out.means.push([next() * 8.0, next() * 8.0, next() * 8.0]);
            out.quats.push([next() + 1.0, next(), next(), next()]);
            out.log_scales.push([next() - 4.0, next() - 4.0, next() - 4.0]);
            out.opacity_logits.push(next() * 3.0);
            (0..sh_coefficients(degree)).for_each(|_| out.sh.push([next(), next(), next()]));
        }
        out
    }

    fn parse(bytes: &[u8]) -> Result<Gaussians, IoError> {
        parse_ply(bytes, Path::new("test.ply"))
    }

    #[test]
    fn what_is_written_is_read() {
        for degree in 0..=3 {
            let cloud = sample(degree, 5);
            assert_eq!(parse(&ply_bytes(&cloud)), Ok(cloud));
        }
        assert_eq!(parse(&ply_bytes(&Gaussians::default())), Ok(Gaussians::default()));
    }

    /// Rows of floats are read by all cores; the same in the other byte order is walked.
    #[test]
    fn both_ways_of_reading_agree() {
        let cloud = sample(3, 300);
        let mut bytes = ply_bytes(&cloud);
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
        let bytes = ply_bytes(&sample(1, 2));
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
