//! A table that can be written as text, Markdown and CSV.

use serde::Serialize;

use instgs_vk::math::digits::grouped;

/// A cell of a [`Sheet`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cell {
    /// Text, shown as it is.
    Text(String),
    /// A number, shown with the given number of decimals.
    Number(f64, #[serde(skip)] usize),
    /// An integer, shown in groups of three digits.
    Count(u64),
    /// Empty: nothing was measured.
    Empty,
}

impl Cell {
    /// A number that may be missing.
    pub fn maybe(value: Option<f64>, decimals: usize) -> Self {
        value.filter(|v| v.is_finite()).map_or(Self::Empty, |v| Self::Number(v, decimals))
    }

    /// Text of the cell for people.
    fn shown(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(value, decimals) => format!("{value:.decimals$}"),
            Self::Count(value) => grouped(*value),
            Self::Empty => String::new(),
        }
    }

    /// Text of the cell for scripts.
    fn plain(&self) -> String {
        match self {
            Self::Count(value) => value.to_string(),
            other => other.shown(),
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// A table with its explanation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sheet {
    /// File name without extension.
    pub key: &'static str,
    /// Heading of the table.
    pub title: String,
    /// A paragraph below the heading.
    pub note: String,
    /// Names of the columns.
    pub head: Vec<&'static str>,
    /// Rows, each as long as `head`.
    pub rows: Vec<Vec<Cell>>,
}

impl Sheet {
    /// Heading, note and table as Markdown.
    pub fn markdown(&self) -> String {
        // A bar would end the cell.
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let escaped = |text: String| text.replace('|', "\\|");
        let mut out = format!("### {}\n\n", self.title);
        if !self.note.is_empty() {
            out += &format!("{}\n\n", self.note);
        }
        out += &line(self.head.iter().map(|h| escaped((*h).into())).collect());
        out += &format!("|---|{}\n", "---:|".repeat(self.head.len().saturating_sub(1)));
        for row in &self.rows {
            out += &line(row.iter().map(|cell| escaped(cell.shown())).collect());
        }
        out
    }

    /// The table as CSV, numbers without grouping.
    ///
    /// # Errors
    /// None in practice, since it writes to memory.
    pub fn csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut out = csv::Writer::from_writer(Vec::new());
        out.write_record(&self.head)?;
        for row in &self.rows {
            out.write_record(row.iter().map(Cell::plain))?;
        }
        out.into_inner().map_err(|e| e.into_error().into())
    }

    /// Header and rows as text, for alignment.
    pub fn lines(&self) -> Vec<Vec<String>> {
        let head = self.head.iter().map(|h| (*h).to_owned()).collect();
        let rows = self.rows.iter().map(|row| row.iter().map(Cell::shown).collect());
        std::iter::once(head).chain(rows).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_table_for_people_pages_and_scripts() -> Result<(), Box<dyn std::error::Error>> {
        let sheet = Sheet {
            key: "a",
            title: "A".into(),
            note: "Note.".into(),
            head: vec!["", "dB", "bytes"],
            rows: vec![
                vec!["3DGS, same | time".into(), Cell::Number(1.005, 1), Cell::Count(1_234_567)],
                vec!["b".into(), Cell::maybe(Some(f64::NAN), 1), Cell::maybe(None, 2)],
            ],
        };
        let markdown = "### A\n\nNote.\n\n|  | dB | bytes |\n|---|---:|---:|\n\
                        | 3DGS, same \\| time | 1.0 | 1,234,567 |\n| b |  |  |\n";
        assert_eq!(sheet.markdown(), markdown);
        let csv = String::from_utf8(sheet.csv()?)?;
        assert_eq!(csv, "\"\",dB,bytes\n\"3DGS, same | time\",1.0,1234567\nb,,\n".replacen("\"\"", "", 1));
        assert_eq!(sheet.lines()[1], ["3DGS, same | time", "1.0", "1,234,567"]);
        assert_eq!([0, 999, 1000].map(grouped), ["0", "999", "1,000"]);
        Ok(())
    }
}
