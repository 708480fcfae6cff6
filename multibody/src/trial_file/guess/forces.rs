//! Which plates the foot steps on, and which part of the recording that makes.

use std::path::{Path, PathBuf};

use super::columns::{self, Columns};
use super::sets::Found;
use super::{Recording, Wishes, list, quoted};
use crate::error::{InputError, Mistakes};
use crate::keys::Filled;
use crate::natural::SegmentId;
use crate::read::{self, TimeSeries};
use crate::trial::Side;
use crate::trial_file::force::{self, Contact};
use crate::trial_file::{Axes, TrialFile};

/// A table of forces.
pub(super) struct Table {
    pub path: PathBuf,
    columns: Vec<Columns>,
}

/// The table that was asked for, or the one beside a TRC file whose name begins most like that of the recording and whose times overlap.
pub(super) fn table(wishes: &Wishes, recording: &Recording) -> Result<Option<Table>, InputError> {
    if let Some(path) = &wishes.force {
        let columns = columns::plates(&read::read_series(path)?);
        return Ok(Some(Table { path: path.clone(), columns }));
    }
    if recording.c3d.as_ref().is_some_and(|c| !c.plates.is_empty()) {
        return Ok(None);
    }
    let folder = recording.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut beside: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    beside.retain(|p| matches!(read::ending(p).as_str(), "sto" | "mot"));
    beside.sort();
    let alike = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        name.bytes().zip(recording.stem().bytes()).take_while(|(a, b)| a == b).count()
    };
    // Another trial's table has a name that begins less like this one.
    beside.sort_by_key(|p| std::cmp::Reverse(alike(p)));
    let time = &recording.markers.time;
    let overlaps =
        |series: &TimeSeries| match (series.time.first(), series.time.last(), time.first(), time.last()) {
            (Some(a), Some(b), Some(c), Some(d)) => a < d && c < b,
            _ => false,
        };
    for path in beside.into_iter().filter(|p| alike(p) >= 3) {
        if let Ok(series) = read::read_series(&path)
            && overlaps(&series)
        {
            let columns = columns::plates(&series);
            if !columns.is_empty() {
                return Ok(Some(Table { path, columns }));
            }
        }
    }
    Ok(None)
}

/// What the plates say of one leg.
pub(super) struct Steps {
    contacts: Vec<Contact>,
    on_plate: bool,
    columns: Vec<String>,
    plates: Vec<usize>,
    /// Vertical force of all plates over the cycle, as a mass \[kg\].
    mass: Option<f64>,
    /// In words, for the top of the file.
    pub summary: Vec<String>,
}

impl Steps {
    /// Heel strikes that are seen.
    pub fn strikes(&self) -> usize {
        self.contacts.iter().filter(|c| c.whole).count()
    }

    /// `[force]` and `[range]`.
    pub fn fill(&self, table: Option<String>, filled: &mut Filled, open: &mut Vec<String>) {
        if self.on_plate {
            filled.set("force.on_plate", "true");
        }
        if let Some(file) = &table {
            filled.set("force.file", quoted(file));
        }
        let whole: Vec<&Contact> = self.contacts.iter().filter(|c| c.whole).collect();
        match (&whole[..], self.contacts.first()) {
            ([first, second, ..], _) => {
                filled.set("range.cycle", "1");
                filled.set("force.plates", format!("[{}]", first.plate));
                if second.plate != first.plate {
                    filled.set("force.next_plate", second.plate.to_string());
                }
                filled.note(
                    "range",
                    format!("Heel strikes at {:.3} s and {:.3} s.", first.start, second.start),
                );
            }
            (_, Some(one)) => {
                filled.set("force.plates", format!("[{}]", one.plate));
                filled.set("range.start_s", format!("{:.3}", one.start + 5e-4));
                filled.set("range.end_s", format!("{:.3}", one.end - 5e-4));
                filled.note(
                    "range",
                    "One contact of this foot is on a plate: the reported part is its stance.",
                );
            }
            _ => {
                let plates: Vec<String> = self.plates.iter().map(usize::to_string).collect();
                filled.note("force", match plates.is_empty() {
                    true => "FILL IN: no forces were found; name a table with `file` (or give it with --force-table).".to_string(),
                    false => format!("FILL IN: no contact of this foot was found on the plates {}.", plates.join(", ")),
                });
                filled.note("range", "FILL IN: `cycle`, or `start_s` and `end_s`.");
                open.extend(["range".to_string()]);
            }
        }
        if let Some(mass) = self.mass.filter(|_| !filled.values.contains_key("subject.mass_kg")) {
            filled.note("subject.mass_kg", format!("The plates carry {mass:.1} kg on average over the cycle: the body mass, if every step was on a plate."));
        }
        for (k, names) in self.columns.iter().enumerate() {
            for (key, value) in names.lines().filter_map(|l| l.split_once('=')) {
                filled.set(&format!("force.columns.{k}.{key}"), value);
            }
        }
    }
}

/// Contacts of the foot of this side with each plate.
pub(super) fn steps(
    recording: &Recording,
    side: Side,
    found: &Found,
    axes: Option<Axes>,
    table: Option<&Table>,
) -> Steps {
    let mut steps = Steps {
        contacts: Vec::new(),
        on_plate: false,
        columns: table.iter().flat_map(|t| &t.columns).map(written).collect(),
        plates: match (table, &recording.c3d) {
            (Some(table), _) => table.columns.iter().map(|c| c.plate).collect(),
            (None, Some(c3d)) => c3d.plates.iter().map(|p| p.number).collect(),
            (None, None) => Vec::new(),
        },
        mass: None,
        summary: Vec::new(),
    };
    let Some(axes) = axes else { return steps };
    let Some(mut draft) = draft(recording, side, found, axes, table) else { return steps };
    let folder = recording.path.parent();
    let data = table.and_then(|t| t.path.parent());
    let Ok(recorded) = draft.record(Path::new(recording.path.file_name().unwrap_or_default()), folder) else {
        return steps;
    };
    let wanted: Vec<_> = found.tracked(SegmentId::Foot).into_iter().map(|n| (n, SegmentId::Foot)).collect();
    let feet = draft.tracks(&recorded, &wanted, &mut Mistakes::default());
    for on_plate in [false, true] {
        draft.force.on_plate = on_plate;
        steps.on_plate = on_plate;
        let mut signals = Vec::new();
        for number in steps.plates.clone() {
            draft.force.plates = vec![number];
            signals.extend(force::plates(&draft, &recorded, data, &mut Mistakes::default()));
        }
        steps.contacts = force::contacts_of_the_foot(&draft, &signals, &recorded.markers, &feet);
        let whole: Vec<&Contact> = steps.contacts.iter().filter(|c| c.whole).collect();
        if let [first, second, ..] = whole[..] {
            steps.mass = force::mean_vertical(&signals, first.start, second.start).map(|f| f / 9.81);
        }
        if !steps.contacts.is_empty() {
            break;
        }
    }
    if steps.contacts.is_empty() {
        steps.on_plate = false;
    }
    let name = side.name();
    for plate in &steps.plates {
        let on: Vec<String> = steps
            .contacts
            .iter()
            .filter(|c| c.plate == *plate)
            .map(|c| format!("{:.3} to {:.3} s", c.start, c.end))
            .collect();
        steps.summary.push(match on.is_empty() {
            true => format!("Force plate {plate}: not stepped on by the {name} foot."),
            false => format!("Force plate {plate}: {name} foot on it from {}.", on.join(", ")),
        });
    }
    steps
}

fn written(columns: &Columns) -> String {
    let mut text =
        format!("plate={}\nforce={}\npoint={}", columns.plate, list(&columns.force), list(&columns.point));
    if let Some(moment) = &columns.moment {
        text += &format!("\nmoment={}", list(moment));
    }
    text
}

/// A trial file that is good enough to look at the plates.
fn draft(
    recording: &Recording,
    side: Side,
    found: &Found,
    axes: Axes,
    table: Option<&Table>,
) -> Option<TrialFile> {
    let tracked = |segment| list(&found.tracked(segment));
    let units = recording.unit.map_or(String::new(), |u| format!("units = \"{}\"\n", u.name()));
    let file = table.map_or(String::new(), |t| {
        format!("file = {}\n", quoted(&t.path.file_name().unwrap_or_default().to_string_lossy()))
    });
    let columns: String = table
        .iter()
        .flat_map(|t| &t.columns)
        .map(|c| format!("[[force.columns]]\n{}\n", written(c)))
        .collect();
    let text = format!(
        "motion = \"draft\"\nzeros_missing = {}\n{units}[axes]\nx = \"{}\"\ny = \"{}\"\nz = \"{}\"\n[subject]\nname = \"draft\"\nmass_kg = 70\n\
         height_m = 1.7\nsex = \"male\"\nside = \"{}\"\n[range]\ncycle = 1\n[force]\n{file}plates = []\n{columns}[markers]\npelvis = {}\nthigh = {}\n\
         shank = {}\nfoot = {}\n[landmarks]\nsource = \"functional\"\n",
        recording.zeros,
        axes.x,
        axes.y,
        axes.z,
        side.name(),
        tracked(SegmentId::Pelvis),
        tracked(SegmentId::Thigh),
        tracked(SegmentId::Shank),
        tracked(SegmentId::Foot),
    );
    let mut file: TrialFile = toml::from_str(&text).ok()?;
    file.path = PathBuf::from("draft.toml");
    Some(file)
}
