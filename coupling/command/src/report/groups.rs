//! Which muscles are shown together.

/// Heading and muscles (names as in the model) of each group, proximal to distal.
const GROUPS: [(&str, &[&str]); 8] = [
    ("Hip extensors", &["gmax1", "gmax2", "gmax3"]),
    ("Hip abductors", &["gmed1", "gmed2", "gmed3", "gmin1", "gmin2", "gmin3", "tfl"]),
    ("Hip adductors", &["addlong", "addbrev", "addmag1", "addmag2", "addmag3", "pect", "grac"]),
    ("Hip flexors and rotators", &["iliacus", "psoas", "sart", "quadfem", "gem", "piri"]),
    ("Knee extensors", &["recfem", "vasmed", "vasint", "vaslat"]),
    ("Hamstrings", &["semimem", "semiten", "bflh", "bfsh"]),
    ("Plantar flexors and inverters", &["gasmed", "gaslat", "soleus", "tibpost", "flexdig", "flexhal"]),
    ("Dorsiflexors and everters", &["tibant", "extdig", "exthal", "pertert", "perbrev", "perlong"]),
];

/// Headings with the positions of their muscles in `names`; muscles of no known group come last.
pub fn grouped(names: &[String]) -> Vec<(&'static str, Vec<usize>)> {
    let position = |name: &&str| names.iter().position(|n| n == name);
    let mut groups: Vec<(&str, Vec<usize>)> = GROUPS
        .iter()
        .map(|(title, members)| (*title, members.iter().filter_map(position).collect()))
        .collect();
    let known = |i: &usize| groups.iter().any(|(_, members)| members.contains(i));
    let others: Vec<usize> = (0..names.len()).filter(|i| !known(i)).collect();
    groups.push(("Other muscles", others));
    groups.retain(|(_, members)| !members.is_empty());
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_muscle_is_shown_once() {
        let mut names: Vec<String> =
            GROUPS.iter().flat_map(|(_, m)| m.iter().map(|n| n.to_string())).collect();
        assert_eq!(names.len(), 43);
        names.push("unheard_of".into());
        let groups = grouped(&names);
        let mut seen: Vec<usize> = groups.iter().flat_map(|(_, members)| members.clone()).collect();
        seen.sort();
        assert_eq!(seen, (0..44).collect::<Vec<_>>());
        assert_eq!(groups.last().unwrap(), &("Other muscles", vec![43]));
    }
}
