//! Marker names with and without the prefix that motion capture programs put before them: `JW:RASI` and `RASI`.

/// Several markers could be meant.
pub(super) struct Ambiguous(pub Vec<String>);

/// Index of the marker that `name` means among the recorded `names`: the one of exactly that name, else the one whose name is the same without
/// prefixes.
pub(super) fn find(names: &[String], name: &str) -> Result<Option<usize>, Ambiguous> {
    let which = |same: &dyn Fn(&str) -> bool| -> Vec<usize> {
        names.iter().enumerate().filter(|(_, n)| same(n)).map(|(k, _)| k).collect()
    };
    let exactly = which(&|n| n == name);
    let found = if exactly.is_empty() {
        // A prefix in the trial file that the recording writes otherwise would name another subject.
        let prefixed = name.contains(':');
        which(&|n| bare(n) == bare(name) && !(prefixed && n.contains(':')))
    } else {
        exactly
    };
    match found[..] {
        [] => Ok(None),
        [one] => Ok(Some(one)),
        _ => Err(Ambiguous(found.iter().map(|k| format!("`{}`", names[*k])).collect())),
    }
}

/// Name without its prefix.
pub(super) fn bare(name: &str) -> &str {
    match name.rsplit_once(':') {
        Some((_, bare)) if !bare.is_empty() => bare,
        _ => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prefix_may_be_there_or_not() {
        let names: Vec<String> =
            ["JW:RASI", "JW:LASI", "heel", "A:toe", "B:toe"].iter().map(|n| n.to_string()).collect();
        let at = |name: &str| find(&names, name).ok().flatten();
        assert_eq!(at("RASI"), Some(0));
        assert_eq!(at("JW:LASI"), Some(1));
        assert_eq!(at("JW:heel"), Some(2));
        assert_eq!(at("DM:RASI"), None, "the prefix of another subject");
        assert!(find(&names, "toe").is_err_and(|a| a.0 == ["`A:toe`", "`B:toe`"]));
        assert_eq!(at("B:toe"), Some(4));
    }
}
