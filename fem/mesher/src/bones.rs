//! Rigid bones as closed surfaces, and the reader of their table (`gait-data/thigh/bone_sections.csv`).

use std::path::Path;

use super::table::{Table, bad};
use fem::geometry::Surface;
use fem::mesh::MeshError;

/// A rigid bone.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// Name, e.g. `femur`.
    pub name: String,
    /// Closed, outward \[m\].
    pub surface: Surface,
}

impl Bone {
    /// Reads the table of bones: a header `bone,item,index,a,b,c`, then per bone rows `v` (index, x, y, z in mm) and `f` (index,
    /// three vertices). `file` is the name for messages. Refuses what is not one closed, outward body that does not cross itself.
    pub fn read_csv(text: &str, file: &Path) -> Result<Vec<Bone>, MeshError> {
        let mut table = Table::read(text, file)?;
        if !table.header().iter().eq(["bone", "item", "index", "a", "b", "c"]) {
            return Err(bad(file, 1, "the columns must be bone, item, index, a, b, c".into()));
        }
        let mut bones: Vec<(Bone, usize)> = Vec::new();
        for row in table.rows() {
            let row = row?;
            let number = |column: usize| {
                let text = &row.cells[column];
                let value = text.parse().ok().filter(|v: &f64| v.is_finite());
                value.ok_or_else(|| row.bad(format!("`{text}` is not a finite number")))
            };
            let count = |column: usize| {
                let text = &row.cells[column];
                text.parse::<u32>()
                    .map_err(|_| row.bad(format!("`{text}` is not the number of a vertex or face")))
            };
            let name = &row.cells[0];
            if bones.last().is_none_or(|(bone, _)| bone.name != name) {
                if name.is_empty() || bones.iter().any(|(bone, _)| bone.name == name) {
                    return Err(row.bad(format!("bone `{name}`: give every bone a name and list it once")));
                }
                bones.push((Bone { name: name.into(), surface: Surface::default() }, row.line));
            }
            let surface = &mut bones.last_mut().expect("a bone was begun").0.surface;
            let expected = match &row.cells[1] {
                "v" => {
                    surface.points.push([number(3)? / 1000.0, number(4)? / 1000.0, number(5)? / 1000.0]);
                    surface.points.len() - 1
                }
                "f" => {
                    surface.triangles.push([count(3)?, count(4)?, count(5)?]);
                    surface.triangles.len() - 1
                }
                other => return Err(row.bad(format!("item `{other}`; there are v (vertex) and f (face)"))),
            };
            if count(2)? as usize != expected {
                return Err(row.bad(format!("index {} where {expected} was expected", &row.cells[2])));
            }
        }
        if bones.is_empty() {
            return Err(bad(file, 1, "the table has no bones".into()));
        }
        for (bone, line) in &bones {
            bone.surface
                .check()
                .map_err(|e| bad(file, *line, format!("bone `{}` (from this line): {e}", bone.name)))?;
        }
        Ok(bones.into_iter().map(|(bone, _)| bone).collect())
    }
}
