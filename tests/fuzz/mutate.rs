//! Damage.

use support::Random;

/// `bytes` with one to three things wrong.
pub fn damaged(bytes: &[u8], is_text: bool, random: &mut Random) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..random.integer(1, 3) {
        out = match is_text && random.chance(0.8) {
            true => in_text(&out, random),
            false => in_bytes(out, random),
        };
    }
    out
}

fn in_bytes(mut bytes: Vec<u8>, random: &mut Random) -> Vec<u8> {
    if bytes.is_empty() {
        return vec![random.bits() as u8; random.below(600)];
    }
    let n = bytes.len();
    // Headers are short and matter most.
    let at = if random.chance(0.5) { random.below(n.min(2048)) } else { random.below(n) };
    let length = random.below((n - at).min(64)) + 1;
    match random.below(8) {
        0 => (0..random.integer(1, 8)).for_each(|_| {
            let at = random.below(n);
            bytes[at] ^= 1 << random.below(8);
        }),
        1 => bytes.truncate(at),
        2 => drop(bytes.drain(at..at + length)),
        3 => {
            let part = bytes[at..at + length].to_vec();
            bytes.splice(at..at, part);
        }
        4 => {
            let noise: Vec<u8> = (0..length).map(|_| random.bits() as u8).collect();
            bytes.splice(at..at, noise);
        }
        5 => {
            // Counts that lie.
            let lies: [&[u8]; 9] = [
                &[0],
                &[255],
                &[0, 0],
                &[255, 255],
                &[255, 127],
                &[0, 0, 0, 0],
                &[255, 255, 255, 255],
                &[255, 255, 255, 127],
                &[0, 0, 192, 127], // NaN
            ];
            let lie = lies[random.below(lies.len())];
            let end = (at + lie.len()).min(n);
            bytes[at..end].copy_from_slice(&lie[..end - at]);
        }
        6 => bytes[at] = random.bits() as u8,
        _ => {
            let from = random.below(n);
            let length = length.min(n - from);
            bytes.copy_within(from..from + length.min(n - at), at);
        }
    }
    bytes
}

/// What stands where a number stood.
const NUMBERS: [&str; 20] = [
    "NaN",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e999",
    "-1",
    "0",
    "-0",
    "",
    "1e-320",
    "99999999999999999999",
    "1,5",
    "0x10",
    "abc",
    "--1",
    "1e",
    "4294967296",
    "2.5",
];

fn in_text(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let mut lines: Vec<String> = text.split('\n').map(str::to_string).collect();
    let n = lines.len();
    let at = if random.chance(0.4) { random.below(n.min(12)) } else { random.below(n) };
    match random.below(20) {
        0 | 1 => drop(lines.remove(at)),
        2 => lines.insert(at, lines[at].clone()),
        3 => lines.swap(at, random.below(n)),
        4 if at + 1 < n => {
            let next = lines.remove(at + 1);
            lines[at] += &next;
        }
        5..=8 => lines[at] = with_number(&lines[at], random),
        // The same column in all lines from here on.
        9 => {
            let column = random.below(8);
            lines[at..].iter_mut().for_each(|line| *line = without_cell(line, column));
        }
        10 | 11 => lines[at] = with_word(&lines[at], random),
        12 => lines[at] = without_cell(&lines[at], random.below(8)),
        13 => lines[at] += ["\t", ",", ",,", " 7", "\t\t1", ";", " #", "\"", "]"][random.below(9)],
        14 => return text.replace('\n', ["\r\n", "\r", "\n\n", "\n\r"][random.below(4)]).into_bytes(),
        15 => return encoded(&text, random),
        16 => {
            let [from, to] =
                [['\t', ','], [',', ';'], ['.', ','], ['"', '\''], ['=', ':'], [' ', '\t']][random.below(6)];
            return text.replace(from, &to.to_string()).into_bytes();
        }
        17 => lines.truncate(at),
        18 => lines[at] = lines[at].repeat(random.integer(2, 300)),
        _ => lines[at].clear(),
    }
    lines.join("\n").into_bytes()
}

/// Other encodings: byte order marks, UTF-16, a letter of Latin-1, a null byte.
fn encoded(text: &str, random: &mut Random) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    match random.below(5) {
        0 => bytes.splice(0..0, [0xEF, 0xBB, 0xBF]).for_each(drop),
        1 => bytes = [0xFF, 0xFE].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect(),
        2 => bytes = [0xFE, 0xFF].into_iter().chain(text.encode_utf16().flat_map(u16::to_be_bytes)).collect(),
        3 => bytes.insert(random.below(bytes.len() + 1), 0xE4),
        _ => bytes.insert(random.below(bytes.len() + 1), 0),
    }
    bytes
}

/// Places of the tokens of a line that `is` is true of.
fn tokens(line: &str, is: impl Fn(&str) -> bool) -> Vec<(usize, usize)> {
    let inside = |c: char| c.is_ascii_alphanumeric() || "+-._".contains(c);
    let mut found = Vec::new();
    let mut start = None;
    for (i, c) in line.char_indices().chain([(line.len(), ' ')]) {
        match (inside(c), start) {
            (true, None) => start = Some(i),
            (false, Some(from)) => {
                if is(&line[from..i]) {
                    found.push((from, i));
                }
                start = None;
            }
            _ => {}
        }
    }
    found
}

fn with_number(line: &str, random: &mut Random) -> String {
    let numbers = tokens(line, |t| t.parse::<f64>().is_ok());
    if numbers.is_empty() {
        return line.to_string();
    }
    let (from, to) = numbers[random.below(numbers.len())];
    format!("{}{}{}", &line[..from], NUMBERS[random.below(NUMBERS.len())], &line[to..])
}

fn with_word(line: &str, random: &mut Random) -> String {
    let words = tokens(line, |t| t.parse::<f64>().is_err());
    if words.is_empty() {
        return line.to_string();
    }
    let (from, to) = words[random.below(words.len())];
    let word = &line[from..to];
    let other = match random.below(7) {
        0 => word.to_uppercase(),
        1 => format!("{word}x"),
        2 => word[1..].to_string(),
        3 => word.chars().rev().collect(),
        4 => "true".to_string(),
        5 => "../../x".to_string(),
        _ => "7".to_string(),
    };
    format!("{}{other}{}", &line[..from], &line[to..])
}

fn without_cell(line: &str, column: usize) -> String {
    let separator = if line.contains('\t') { '\t' } else { ',' };
    let cells: Vec<&str> = line.split(separator).collect();
    let left: Vec<&str> =
        cells.iter().enumerate().filter(|(i, _)| *i != column % cells.len()).map(|(_, c)| *c).collect();
    left.join(&separator.to_string())
}
