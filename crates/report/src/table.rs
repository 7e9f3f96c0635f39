//! Tables for the report, as HTML.

/// Marks a cell that [`table`] draws as a bar.
const BAR: &str = "<i ";

/// A cell with a bar whose length is `value` as a fraction of `largest`.
pub(super) fn bar(value: f64, largest: f64) -> String {
    let part = if largest > 0.0 { (100.0 * value / largest).clamp(0.0, 100.0) } else { 0.0 };
    format!("{BAR}style=\"width:{part:.1}%\"></i>")
}

/// A table; cells are HTML, the first of each row is a name. Empty without rows.
pub(super) fn table(names: &[&str], rows: &[Vec<String>], sum: Option<Vec<String>>) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let cell = |text: &String| {
        let class = if text.starts_with(BAR) { " class=\"bar\"" } else { "" };
        format!("<td{class}>{text}</td>")
    };
    let row =
        |class: &str, cells: &[String]| format!("<tr{class}>{}</tr>\n", cells.iter().map(cell).collect::<String>());
    let names: String = names.iter().map(|name| format!("<th>{name}</th>")).collect();
    let body: String = rows.iter().map(|cells| row("", cells)).collect();
    let sum = sum.map(|cells| row(" class=\"sum\"", &cells)).unwrap_or_default();
    format!(
        "<div class=\"wide\"><table>\n<thead><tr>{names}</tr></thead>\n<tbody>\n{body}{sum}</tbody></table></div>\n"
    )
}
