//! Numbers for people: console, page, settings. Tables of results are not rounded here.

/// Fixed decimals, a real minus sign, an en dash where there is no number; what rounds to zero has no sign.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    plain(value, decimals).replace('-', "−")
}

/// [`fixed`] in ASCII, for the terminal and for files that are read by programs.
pub fn plain(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "-".into();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if !rest.bytes().any(|b| (b'1'..=b'9').contains(&b)) => rest.into(),
        _ => text,
    }
}

/// About `digits` significant digits, a real minus sign.
pub fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return fixed(value, 0);
    }
    let exponent = value.abs().log10().floor();
    if !(-3.0..6.0).contains(&exponent) {
        return format!("{value:.*e}", digits.saturating_sub(1)).replace('-', "−");
    }
    fixed(value, (digits as f64 - 1.0 - exponent).max(0.0) as usize)
}

/// A setting as a person would write it: six significant digits at most, no trailing zeros, ASCII.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return plain(value, 0);
    }
    // Rounded first: 999999.7 has seven digits before the point afterwards.
    let rounded: f64 = format!("{value:.5e}").parse().expect("a printed number");
    match (1e-4..1e6).contains(&rounded.abs()) {
        true => format!("{rounded}"),
        false => format!("{rounded:e}"),
    }
}

/// A number and how far it may be off, with the digits that mean something: the error with one, or two where it begins with a 1, the number as
/// far as these. Without an error six digits.
pub fn with_error(value: f64, error: Option<f64>) -> String {
    let Some(error) = error.filter(|e| e.is_finite() && *e > 0.0) else { return significant(value, 6) };
    let rounded = |digits: usize| -> (f64, f64) {
        let text = format!("{error:.digits$e}");
        let (mantissa, exponent) = text.split_once('e').expect("printed with an exponent");
        (mantissa.parse().expect("printed"), exponent.parse().expect("printed"))
    };
    let (mantissa, exponent) = rounded(1);
    let last = if mantissa < 1.95 { exponent - 1.0 } else { rounded(0).1 };
    let step = 10f64.powf(last.max(0.0));
    let shown = |v: f64| fixed((v / step).round() * step, (-last).clamp(0.0, 12.0) as usize);
    let shown = if last < 0.0 {
        [fixed(value, -last as usize), fixed(error, -last as usize)]
    } else {
        [value, error].map(shown)
    };
    format!("{} ± {}", shown[0], shown[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(fixed(-0.04, 1), "0.0");
        assert_eq!(fixed(-12.345, 1), "−12.3");
        assert_eq!(fixed(f64::NAN, 1), "–");
        assert_eq!(
            (plain(-0.04, 1), plain(-0.06, 1), plain(-0.0, 0)),
            ("0.0".into(), "-0.1".into(), "0".into())
        );
        assert_eq!(significant(1234.5, 3), "1234"); // ties go to even
        assert_eq!(significant(0.012345, 3), "0.0123");
        assert_eq!(significant(3.2e-11, 2), "3.2e−11");
    }

    #[test]
    fn errors_say_which_digits_mean_something() {
        for (value, error, words) in [
            (621.34, 4.2, "621 ± 4"),
            (621.34, 0.034, "621.34 ± 0.03"),
            (621.34, 12.3, "621 ± 12"),
            (621.34, 140.0, "620 ± 140"),
            (-0.5, 37.0, "0 ± 40"),
            (3.0, 0.96, "3 ± 1"),
        ] {
            assert_eq!(with_error(value, Some(error)), words);
        }
        assert_eq!(with_error(12.0, None), "12.0000");
    }

    #[test]
    fn settings_read_as_they_were_written() {
        for (value, words) in [
            (0.018 * 1e3, "18"), // 18.000000000000004 without
            (0.1 + 0.2, "0.3"),
            (-0.0, "0"),
            (12.5, "12.5"),
            (1e-3, "0.001"),
            (2e-5, "2e-5"),
            (999_999.7, "1e6"),
            (100.0, "100"),
            (-2.0 / 3.0, "-0.666667"),
            (f64::NAN, "-"),
        ] {
            assert_eq!(short(value), words);
        }
    }
}
