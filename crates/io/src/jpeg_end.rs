//! Detects truncated JPEG files, whose missing part the decoder silently fills with grey.

/// True if `bytes` begin as a JPEG and have no end-of-image marker after the first scan's header. In a scan the byte FF
/// is followed by 00 or a restart number, so FF D9 cannot be data; the headers before it, which may hold a thumbnail
/// with its own end marker, are skipped. False for anything that is not a JPEG: the decoder reports that.
pub(crate) fn is_cut_jpeg(bytes: &[u8]) -> bool {
    if !bytes.starts_with(&[0xFF, 0xD8, 0xFF]) {
        return false;
    }
    let mut at = 2;
    loop {
        match bytes.get(at..at + 4) {
            // Skips fill bytes before a marker.
            Some(&[0xFF, 0xFF, ..]) => at += 1,
            Some(&[0xFF, 0xDA, ..]) => return !bytes[at..].windows(2).any(|w| w == [0xFF, 0xD9]),
            Some(&[0xFF, _, high, low]) => at += 2 + usize::from(u16::from_be_bytes([high, low])),
            Some(_) => return false,
            None => return true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::is_cut_jpeg;

    #[test]
    fn cut_and_whole() {
        let header = [0xFF, 0xD8, 0xFF, 0xE1, 0, 6, 0xFF, 0xD9, 1, 2, 0xFF, 0xFF, 0xDA, 0, 3, 7];
        let whole = [&header[..], &[1, 2, 0xFF, 0, 3, 0xFF, 0xD9, 9]].concat();
        assert!(!is_cut_jpeg(&whole) && !is_cut_jpeg(&whole[..whole.len() - 1]));
        (3..whole.len() - 1).for_each(|n| assert!(is_cut_jpeg(&whole[..n]), "{n}"));
        assert!(!is_cut_jpeg(b"\x89PNG") && !is_cut_jpeg(b""));
    }
}
