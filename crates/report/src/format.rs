//! Formats numbers and names for people.

/// Escapes a text for HTML content and quoted attributes.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // Control characters are not allowed in HTML.
            c if c.is_control() && c != '\n' && c != '\t' => out.push('\u{FFFD}'),
            c => out.push(c),
        }
    }
    out
}

/// A whole number with thin spaces between thousands.
pub(super) fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202F}');
        }
        out.push(digit);
    }
    out
}

/// A number with this number of decimals; a dash if it is NaN.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    match value {
        v if v.is_nan() => "–".into(),
        v if v.is_infinite() => if v > 0.0 { "∞" } else { "−∞" }.into(),
        v => format!("{v:.decimals$}").replace('-', "−"),
    }
}

/// Like [`fixed`], with a plus in front of numbers that are not negative.
pub(super) fn signed(value: f64, decimals: usize) -> String {
    let plus = if value.is_finite() && value >= 0.0 { "+" } else { "" };
    format!("{plus}{}", fixed(value, decimals))
}

/// A number of bytes in the unit that leaves one to four digits before the point.
pub(super) fn bytes(value: u64) -> String {
    let units = ["KiB", "MiB", "GiB", "TiB"];
    if value < 1024 {
        return format!("{value} B");
    }
    let (mut scaled, mut unit) = (value as f64 / 1024.0, 0);
    // 1023.95 would be shown as 1024.0.
    while scaled >= 1023.95 && unit + 1 < units.len() {
        scaled /= 1024.0;
        unit += 1;
    }
    format!("{scaled:.1} {}", units[unit])
}

/// A wall time of `seconds`: seconds, minutes and seconds, or hours and minutes; a dash if it is not a time.
pub(super) fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return "–".into();
    }
    if seconds < 99.95 {
        return format!("{seconds:.1} s");
    }
    let minutes = (seconds / 60.0).round() as u64;
    if seconds < 5970.0 {
        let whole = seconds.round() as u64;
        return format!("{} min {:02} s", whole / 60, whole % 60);
    }
    format!("{} h {:02} min", minutes / 60, minutes % 60)
}

/// A number at an axis: `2.5k`, `30k`, `1.2M`.
pub(super) fn axis(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        v if v >= 1e6 => (value / 1e6, "M"),
        v if v >= 1e3 => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let text = format!("{scaled:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    format!("{}{unit}", text.replace('-', "−"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        assert_eq!(escape("<a href=\"x\">&'\u{1}</a>"), "&lt;a href=&quot;x&quot;&gt;&amp;&#39;\u{FFFD}&lt;/a&gt;");
        assert_eq!([0, 999, 1_234_567].map(count), ["0", "999", "1\u{202F}234\u{202F}567"]);
        let numbers = [(23.456, 2), (f64::NAN, 2), (f64::INFINITY, 2), (-0.5, 1)].map(|(v, d)| fixed(v, d));
        assert_eq!(numbers, ["23.46", "–", "∞", "−0.5"]);
        assert_eq!([0.126, -0.5, f64::NAN].map(|v| signed(v, 2)), ["+0.13", "−0.50", "–"]);
        assert_eq!(
            [0, 1023, 1024, (1 << 20) - 1, 5 << 30].map(bytes),
            ["0 B", "1023 B", "1.0 KiB", "1.0 MiB", "5.0 GiB"]
        );
        let times = [0.0, 59.96, 100.0, 3599.6, 7260.0, f64::NAN].map(duration);
        assert_eq!(times, ["0.0 s", "60.0 s", "1 min 40 s", "60 min 00 s", "2 h 01 min", "–"]);
        assert_eq!([0.0, 0.05, 2500.0, 30_000.0, -1.2e6].map(axis), ["0", "0.05", "2.5k", "30k", "−1.2M"]);
    }
}
