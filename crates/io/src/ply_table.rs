//! PLY as a container: the header, and reading the rows of an element in any of the three encodings.

use std::path::Path;

use crate::error::{BY_ENDING, IoError, Place};

/// Upper limit on the length of a header, which normally has a few kilobytes.
const MAX_HEADER_BYTES: usize = 1 << 20;

/// Upper limits on the elements of a file and on the properties of one: names are compared with all before them. Clouds have
/// a few elements, and under a hundred properties.
const MAX_ELEMENTS: usize = 64;
const MAX_PROPERTIES: usize = 4096;

/// A scalar type of a PLY property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Decodes `raw`, which has `self.bytes()` bytes. Every type fits f64 exactly.
    fn decode(self, raw: &[u8], big_endian: bool) -> f64 {
        let mut le = [0u8; 8];
        let n = raw.len().min(8);
        le[..n].copy_from_slice(&raw[..n]);
        if big_endian {
            le[..n].reverse();
        }
        let [a, b, c, d, ..] = le;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(le),
        }
    }
}

/// A property: a single value, or a list with its length.
#[derive(Clone, Debug)]
pub(crate) struct Property {
    pub(crate) name: String,
    kind: Scalar,
    list_count: Option<Scalar>,
}

impl Property {
    /// True for a single value of a floating-point type.
    pub(crate) fn is_float(&self) -> bool {
        matches!(self.kind, Scalar::F32 | Scalar::F64)
    }
}

/// An element: `count` rows with the same properties.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) count: u64,
    pub(crate) properties: Vec<Property>,
}

impl Element {
    /// Column of the property `name`.
    pub(crate) fn column(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }

    fn has_lists(&self) -> bool {
        self.properties.iter().any(|p| p.list_count.is_some())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

/// The encoding that a header names.
fn encoding_of(name: &str) -> Result<Encoding, String> {
    match name {
        "ascii" => Ok(Encoding::Ascii),
        "binary_little_endian" => Ok(Encoding::Little),
        "binary_big_endian" => Ok(Encoding::Big),
        other => Err(format!("unknown PLY encoding {other}")),
    }
}

/// A PLY file whose header is parsed; rows are read with [`PlyTable::walk`].
pub(crate) struct PlyTable<'a> {
    pub(crate) elements: Vec<Element>,
    /// The words of every comment, in the order of the lines.
    pub(crate) comments: Vec<Vec<String>>,
    path: &'a Path,
    bytes: &'a [u8],
    encoding: Encoding,
    body: usize,
}

/// Callback for the rows of one element: row index, and its values in property order.
pub(crate) type RowSink<'s> = dyn FnMut(usize, &[f64]) + 's;

impl<'a> PlyTable<'a> {
    pub(crate) fn parse(bytes: &'a [u8], path: &'a Path) -> Result<Self, IoError> {
        let head = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
        let mut table =
            Self { elements: Vec::new(), comments: Vec::new(), path, bytes, encoding: Encoding::Ascii, body: 0 };
        let (mut position, mut line_number, mut encoding) = (0, 0u64, None);
        loop {
            line_number += 1;
            let fail = |what: &str| IoError::damaged(path, what).at(Place::Line(line_number));
            let Some(length) = head[position..].iter().position(|&b| b == b'\n') else {
                return Err(match line_number {
                    1 => fail("is not a PLY file").advise(BY_ENDING),
                    _ => fail("the PLY header has no end_header"),
                });
            };
            let raw = &head[position..position + length];
            position += length + 1;
            let text = String::from_utf8_lossy(raw);
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            let understood = match words.as_slice() {
                ["ply"] if line_number == 1 => Ok(()),
                _ if line_number == 1 => {
                    return Err(fail("is not a PLY file: the first line is not \"ply\"").advise(BY_ENDING));
                }
                ["format", name, _version] => encoding_of(name).map(|of_name| encoding = Some(of_name)),
                ["comment", words @ ..] => {
                    table.comments.push(words.iter().map(|&word| word.into()).collect());
                    Ok(())
                }
                ["obj_info", ..] | [] => Ok(()),
                ["element", name, count] => table.push_element(name, count),
                ["property", rest @ ..] => table.push_property(rest),
                ["end_header"] => break,
                _ => Err(format!("cannot parse the header line \"{}\"", text.trim())),
            };
            understood.map_err(|what| fail(&what))?;
        }
        let Some(encoding) = encoding else {
            return Err(IoError::damaged(path, "the PLY header has no format line"));
        };
        (table.encoding, table.body) = (encoding, position);
        Ok(table)
    }

    /// Takes an element of the header; the text of an error says what is wrong with its line.
    fn push_element(&mut self, name: &str, count: &str) -> Result<(), String> {
        let Ok(count) = count.parse::<u64>() else {
            return Err(format!("element {name} has the count {count}, which is not a number"));
        };
        if self.elements.iter().any(|e| e.name == name) {
            return Err(format!("element {name} appears twice"));
        }
        if self.elements.len() == MAX_ELEMENTS {
            return Err(format!("has more than {MAX_ELEMENTS} elements, and a cloud has one or two"));
        }
        self.elements.push(Element { name: name.into(), count, properties: Vec::new() });
        Ok(())
    }

    /// Takes a property of the header, of the last element, by the words after the first.
    fn push_property(&mut self, words: &[&str]) -> Result<(), String> {
        let element = self.elements.last_mut().ok_or("a property comes before any element")?;
        let property = match words {
            ["list", count, kind, name] => Scalar::parse(count)
                .zip(Scalar::parse(kind))
                .map(|(count, kind)| Property { name: (*name).into(), kind, list_count: Some(count) }),
            [kind, name] => Scalar::parse(kind).map(|kind| Property { name: (*name).into(), kind, list_count: None }),
            _ => None,
        };
        let Some(property) = property else {
            return Err(format!("cannot parse the property line \"property {}\"", words.join(" ")));
        };
        if property.list_count.is_some_and(|c| matches!(c, Scalar::F32 | Scalar::F64)) {
            return Err(format!("the list {} is counted by a floating-point type", property.name));
        }
        if element.column(&property.name).is_some() {
            return Err(format!("property {} appears twice in element {}", property.name, element.name));
        }
        if element.properties.len() == MAX_PROPERTIES {
            let what = "properties, and a Gaussian has under a hundred";
            return Err(format!("element {} has more than {MAX_PROPERTIES} {what}", element.name));
        }
        element.properties.push(property);
        Ok(())
    }

    pub(crate) fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|e| e.name == name)
    }

    /// True if the rows that the header claims can fit in the rest of the file; checked before allocating.
    fn fits(&self, element: &Element, position: usize) -> bool {
        let remaining = (self.bytes.len() - position) as u64;
        let least: u64 = match self.encoding {
            // A value takes at least one character and a separator; the last value needs no separator.
            Encoding::Ascii => 2 * element.properties.len() as u64,
            _ => element.properties.iter().map(|p| p.list_count.unwrap_or(p.kind).bytes() as u64).sum(),
        };
        let slack = u64::from(self.encoding == Encoding::Ascii);
        element.count.checked_mul(least).is_some_and(|need| need <= remaining + slack)
    }

    /// The bytes of an element that comes first and has only little-endian floats, as trainers write it, and the number
    /// of floats per row. `None` for all other files, and if the file is truncated; [`PlyTable::walk`] reads or rejects
    /// those.
    pub(crate) fn float_rows(&self, name: &str) -> Option<(&'a [u8], usize)> {
        let element = self.elements.first().filter(|e| e.name == name && self.encoding == Encoding::Little)?;
        let floats = element.properties.iter().all(|p| p.kind == Scalar::F32 && p.list_count.is_none());
        if !floats || element.properties.is_empty() || !self.fits(element, self.body) {
            return None;
        }
        let columns = element.properties.len();
        Some((&self.bytes[self.body..self.body + 4 * columns * element.count as usize], columns))
    }

    /// Reads the body once, in file order. `sinks` are (element name, callback). Elements with a callback must have no
    /// lists; elements without one are skipped.
    ///
    /// # Errors
    /// The file is truncated, a value cannot be parsed, or an element has a list.
    pub(crate) fn walk(&self, sinks: &mut [(&str, &mut RowSink<'_>)]) -> Result<(), IoError> {
        let mut position = self.body;
        let mut wanted = sinks.len();
        for element in &self.elements {
            if wanted == 0 {
                break;
            }
            if !self.fits(element, position) {
                let what = format!(
                    "ends early: element {} has {} rows, and {} bytes are left for them from byte {position}",
                    element.name,
                    element.count,
                    self.bytes.len() - position
                );
                return Err(IoError::new(self.path, what).at(Place::Byte(self.bytes.len() as u64)));
            }
            let sink = sinks.iter_mut().find(|(name, _)| *name == element.name).map(|(_, sink)| sink);
            wanted -= usize::from(sink.is_some());
            if sink.is_some() && element.has_lists() {
                let what = format!(
                    "element {} has a list property, which clouds of points or Gaussians do not have",
                    element.name
                );
                return Err(IoError::new(self.path, what).advise("give a cloud, not a mesh"));
            }
            position = match sink {
                Some(sink) => self.rows(element, position, &mut **sink)?,
                None => self.rows(element, position, &mut |_, _| {})?,
            };
        }
        Ok(())
    }

    /// Reads the rows of one element from `position` on; returns the position of their end.
    fn rows(&self, element: &Element, mut position: usize, sink: &mut RowSink<'_>) -> Result<usize, IoError> {
        if element.properties.is_empty() {
            return Ok(position);
        }
        let mut row = Vec::with_capacity(element.properties.len());
        for i in 0..element.count {
            row.clear();
            for property in &element.properties {
                match property.list_count {
                    None => row.push(self.value(property.kind, &mut position, element)?),
                    Some(count_type) => {
                        let at = position;
                        let count = self.value(count_type, &mut position, element)?;
                        if !(count >= 0.0 && count <= (self.bytes.len() - position) as f64) {
                            let what = format!("the list {} has the length {count}", property.name);
                            return Err(IoError::new(self.path, what).at(Place::Byte(at as u64)));
                        }
                        for _ in 0..count as u64 {
                            self.value(property.kind, &mut position, element)?;
                        }
                        row.push(count);
                    }
                }
            }
            sink(i as usize, &row);
        }
        Ok(position)
    }

    fn value(&self, kind: Scalar, position: &mut usize, element: &Element) -> Result<f64, IoError> {
        let early = || {
            let what = format!("ends early, within element {}", element.name);
            IoError::new(self.path, what).at(Place::Byte(self.bytes.len() as u64))
        };
        if self.encoding == Encoding::Ascii {
            let rest = &self.bytes[*position..];
            let start = rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or_else(early)?;
            let token = &rest[start..];
            let token = &token[..token.iter().position(u8::is_ascii_whitespace).unwrap_or(token.len())];
            let at = *position + start;
            *position = at + token.len();
            let number = std::str::from_utf8(token).ok().and_then(|t| t.parse::<f64>().ok());
            return number.ok_or_else(|| {
                let shown = String::from_utf8_lossy(&token[..token.len().min(20)]).into_owned();
                let what = format!("\"{}\" in element {} is not a number", shown.escape_debug(), element.name);
                IoError::new(self.path, what).at(Place::Byte(at as u64))
            });
        }
        let raw = self.bytes.get(*position..*position + kind.bytes()).ok_or_else(early)?;
        *position += kind.bytes();
        Ok(kind.decode(raw, self.encoding == Encoding::Big))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(header: &str) -> String {
        let bytes = format!("ply\nformat ascii 1.0\n{header}end_header\n");
        PlyTable::parse(bytes.as_bytes(), Path::new("x.ply")).err().map(|e| e.to_string()).unwrap_or_default()
    }

    /// Names are compared with each other, which would take minutes for a header of a megabyte.
    #[test]
    fn headers_of_too_many_names_are_refused() {
        let elements = |count: usize| (0..count).map(|i| format!("element e{i} 0\n")).collect::<String>();
        assert_eq!(error(&elements(MAX_ELEMENTS)), "");
        let text = error(&elements(MAX_ELEMENTS + 1));
        assert!(text.starts_with("x.ply: line 67: has more than 64 elements") && text.contains("; copy"), "{text}");
        let properties = |count: usize| {
            let lines = (0..count).map(|i| format!("property char p{i}\n"));
            format!("element vertex 0\n{}", lines.collect::<String>())
        };
        assert_eq!(error(&properties(MAX_PROPERTIES)), "");
        let text = error(&properties(MAX_PROPERTIES + 1));
        assert!(text.starts_with("x.ply: line 4100: element vertex has more than 4096 properties"), "{text}");
    }

    #[test]
    fn faults_of_headers_have_a_line_and_a_next_step() {
        for (header, want) in [
            ("property char x\n", "line 3: a property comes before any element; copy"),
            ("element vertex many\n", "line 3: element vertex has the count many, which is not a number; copy"),
            ("element vertex 1\nproperty word x\n", "line 4: cannot parse the property line \"property word x\"; copy"),
            ("format utf8 1.0\n", "line 3: unknown PLY encoding utf8; copy"),
        ] {
            assert!(error(header).contains(want), "{}", error(header));
        }
    }
}
