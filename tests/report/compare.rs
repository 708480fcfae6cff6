//! Does the page of `compare` show what was computed: table, fields of the viewer, and does it turn and step in a browser?

use std::path::Path;
use std::sync::OnceLock;

use base64::Engine;
use command::report::compare::{CompareReport, compare_page};
use coupling::comparison::{Comparison, Prepared};
use coupling::configuration::PerConfiguration;
use coupling::scene::Scene;
use coupling::scene::StepName;
use fem::geometry::Surface;
use fem::parts::fields;
use nalgebra::Vector3;
use serde_json::Value;

use super::html::check_page;
use super::in_browser;

/// Two glutei at a coarse resolution, stress-free at heel strike, in both configurations.
struct Small {
    prepared: Prepared,
    comparison: Comparison,
}

fn small() -> &'static Small {
    static SMALL: OnceLock<Small> = OnceLock::new();
    SMALL.get_or_init(|| {
        let text = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\nstress_free = \"heel_strike\"\n";
        let scene = Scene::parse(Path::new("glutei.toml"), text, None).unwrap();
        let prepared = Prepared::new(scene, None, &mut |_| ()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let comparison = prepared.solve(PerConfiguration::of(|_| true), folder.path(), false, &mut |_| ()).unwrap();
        Small { prepared, comparison }
    })
}

fn report(small: &Small) -> CompareReport<'_> {
    CompareReport {
        subject: "S01, male, 70 kg, 1.72 m, right leg",
        name: "two <glutei>",
        comparison: &small.comparison,
        bones: &small.prepared.made.as_ref().unwrap().bones,
        mid_thigh: small.prepared.mid_thigh(), // far from the glutei
        settings: &[],
        simulated: &[],
        left_out: &[],
        notes: &[],
        passes: &[],
        unsettled: &[],
        seconds: &[],
    }
}

/// Content of a script element of the page.
fn data<'a>(page: &'a str, id: &str) -> &'a str {
    page.split(&format!("id=\"thigh-{id}\">")).nth(1).unwrap().split("</script>").next().unwrap()
}

fn numbers(page: &str, id: &str) -> Vec<f64> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(data(page, id)).unwrap();
    bytes.as_chunks::<2>().0.iter().map(|b| f64::from(u16::from_le_bytes(*b))).collect()
}

#[test]
fn the_page_of_a_comparison_shows_every_force_and_fetches_nothing() {
    let small = small();
    let report = report(small);
    let page = compare_page(&report);
    check_page(&page);
    assert!(page.contains("two &lt;glutei&gt;") && !page.contains("two <glutei>"));
    let table = page.split("id=\"muscle-forces\"").nth(1).unwrap().split("</section>").next().unwrap();
    for k in 0..2 {
        for row in report.rows(k) {
            for force in [row.rigid, row.fe.without.unwrap().total, row.fe.with.unwrap().total] {
                let cell = format!(
                    "<td class=\"n\">{}</td>",
                    format!("{force:.1}").replace('-', "−").replace("−0.0", "0.0")
                );
                assert!(table.contains(&cell), "{}: {cell}", row.muscle);
            }
        }
    }
    let differences = report.differences();
    assert_eq!(differences.len(), 4);
    for d in &differences {
        let of =
            |row: &command::report::compare::Row| (row.fe[d.configuration].unwrap().total - row.rigid).abs();
        let rows = report.rows(StepName::ALL.iter().position(|s| *s == d.step).unwrap());
        let largest = rows.iter().map(of).fold(0.0, f64::max);
        let carrying: Vec<f64> = rows.iter().filter(|r| r.rigid > 0.5).map(of).collect();
        assert!(
            (d.largest - largest).abs() < 1e-9
                && (d.mean.unwrap() - carrying.iter().sum::<f64>() / carrying.len() as f64).abs() < 1e-9
        );
    }
    for published in ["4.3", "20.0", "2.7", "10.3", "13.0", "26.9", "17.5", "112.0"] {
        assert!(table.contains(&format!("<td class=\"n\">{published}</td>")), "{published}");
    }
    assert!(page.len() < 15_000_000);
}

/// The colours of the viewer, recomputed here from the cells, tractions and surfaces of the frames.
#[test]
fn the_viewer_holds_places_and_nodal_values_to_half_a_step_of_its_scale() {
    let small = small();
    let report = report(small);
    let page = compare_page(&report);
    let head: Value = serde_json::from_str(data(&page, "head")).unwrap();
    let n = head["vertices"].as_u64().unwrap() as usize;
    let pair = |v: &Value| [v[0].as_f64().unwrap(), v[1].as_f64().unwrap()];
    let thigh = &small.comparison.thigh;
    let mesh = &thigh.mesh;
    let mut index = 0;
    let mut seen = [0; 5];
    for (_, result) in small.comparison.solutions.present() {
        let plan = &result.plan;
        index += 1; // the mesh at rest has no values
        for frame in &result.run.frames {
            let packed = numbers(&page, &index.to_string());
            let entry = &head["frames"][index];
            index += 1;
            let mut at = 3 * n;
            let mut columns: Vec<Option<&[f64]>> = Vec::new();
            for has in entry["has"].as_array().unwrap() {
                let column = has.as_bool().unwrap().then(|| &packed[at..at + n]);
                at += if column.is_some() { n } else { 0 };
                columns.push(column);
            }
            assert_eq!(at, packed.len());
            let (_, cells) = fields(plan, frame);
            let mean = |name: &str, block: &str, node: u32| {
                let values = &cells.iter().find(|f| f.name == name).unwrap().values;
                let (mut first, mut found) = (0, Vec::new());
                for b in &plan.mesh.blocks {
                    let own = b.cells().enumerate().filter(|(_, c)| b.name == block && c.contains(&node));
                    found.extend(own.map(|(i, _)| values[first + i]));
                    first += b.n_cells();
                }
                found.iter().sum::<f64>() / found.len() as f64
            };
            let skins: Vec<Surface> = thigh
                .muscles
                .iter()
                .map(|m| {
                    Surface::from_faces(
                        frame.x.as_chunks::<3>().0,
                        &mesh.surfaces[&format!("{}/surface", m.name)],
                    )
                    .0
                })
                .collect();
            for (m, muscle) in thigh.muscles.iter().enumerate() {
                let surface = format!("{}/surface", muscle.name);
                let nodes = fem::mesh::unique_nodes(mesh.surfaces[&surface].iter().flatten().copied());
                let tractions = fem::measure::contact_tractions(plan, frame.snapshot(), &surface);
                let first = head["parts"][m]["vertices"][0].as_u64().unwrap() as usize;
                for (k, &node) in nodes.iter().enumerate().step_by(7) {
                    let v = first + k;
                    let place = Vector3::from_column_slice(&frame.x[3 * node as usize..][..3]);
                    for c in 0..3 {
                        let (low, high) =
                            (head["box"][0][c].as_f64().unwrap(), head["box"][1][c].as_f64().unwrap());
                        let shown = low + packed[3 * v + c] / 65534.0 * (high - low);
                        assert!((shown - place[c]).abs() <= 0.5001 * (high - low) / 65534.0);
                    }
                    let other = &skins[1 - m];
                    let depth = if inside(other, &place) { distance(other, &place) } else { 0.0 };
                    let pushed =
                        tractions.iter().find(|t| t.0 == node).map_or(0.0, |t| Vector3::from(t.1).norm());
                    let wanted = [
                        1e-3 * mean("von_mises_Pa", &muscle.name, node),
                        1e-3 * mean("pressure_Pa", &muscle.name, node),
                        mean("stretch", &format!("{}/fibres", muscle.name), node),
                        1e-3 * pushed,
                        1e3 * depth,
                    ];
                    for (f, wanted) in wanted.into_iter().enumerate() {
                        let Some(column) = columns[f] else { continue };
                        let [low, high] = pair(&head["fields"][f]["range"]);
                        let shown = low + column[v] / 65534.0 * (high - low);
                        let step = (high - low) / 65534.0;
                        assert!(
                            column[v] < 65535.0 && (shown - wanted).abs() <= 0.5001 * step + 1e-12,
                            "field {f} of {}: {shown}, not {wanted}",
                            muscle.name
                        );
                        seen[f] += usize::from(wanted.abs() > 10.0 * step);
                    }
                }
            }
        }
    }
    assert!(seen.iter().all(|n| *n > 10), "some field was nowhere more than zero: {seen:?}");
}

/// Winding number of a closed surface about a point: its solid angle over 4π (van Oosterom and Strackee 1983).
fn inside(surface: &Surface, p: &Vector3<f64>) -> bool {
    let angle: f64 = (0..surface.triangles.len())
        .map(|t| {
            let [a, b, c] = surface.corners(t).map(|x| x - p);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            2.0 * a.dot(&b.cross(&c)).atan2(below)
        })
        .sum();
    angle > 2.0 * std::f64::consts::PI
}

/// Distance to a surface, every triangle tried.
fn distance(surface: &Surface, p: &Vector3<f64>) -> f64 {
    let of = |t| fem::geometry::distance::point_triangle(p, &surface.corners(t)).0.distance;
    (0..surface.triangles.len()).map(of).fold(f64::INFINITY, f64::min)
}

/// The glutei end above the middle of the thigh: the section is where they are, and all of them are in it.
#[test]
fn sections_are_placed_where_the_muscles_are() {
    let page = compare_page(&report(small()));
    let section =
        page.split("id=\"sections-through-the-muscles\"").nth(1).unwrap().split("</section>").next().unwrap();
    let figures: Vec<&str> = section.split("<svg class=\"slice\"").skip(1).collect();
    assert_eq!(figures.len() % 4, 0, "two steps in two configurations at every height");
    for name in ["gluteus minimus", "gluteus medius"] {
        assert!(figures.iter().any(|f| f.contains(&format!("<title>{name}</title>"))), "{name}");
    }
    assert!(figures.iter().all(|f| f.contains("class=\"scale\"") && f.contains("50 mm</text>")));
}

/// Slider, rotation, colours and configurations change what is on the canvas; a change undone brings the picture back.
#[test]
fn the_viewer_turns_and_steps_in_a_browser() {
    let page = compare_page(&report(small()));
    let script = r#"
        const canvas = document.getElementById("thigh");
        const pictures = {};
        const take = (name) => (pictures[name] = canvas.toDataURL());
        const drag = (dx) => {
            const send = (target, kind, x) => target.dispatchEvent(
                new PointerEvent(kind, { pointerId: 1, clientX: x, clientY: 200, bubbles: true, cancelable: true }));
            send(canvas, "pointerdown", 300);
            send(window, "pointermove", 300 + dx);
            send(window, "pointerup", 300 + dx);
        };
        const slider = document.getElementById("pick-step");
        const step = (value) => { slider.value = value; slider.dispatchEvent(new Event("input")); };
        const press = (group, value) => document.querySelector(`#${group} [data-value="${value}"]`).click();
        take("start"); take("again");
        const labels = [document.getElementById("step-name").textContent];
        step(1); take("step"); labels.push(document.getElementById("step-name").textContent);
        step(2); take("back");
        drag(120); take("turned"); drag(-120); take("turned back");
        canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300, cancelable: true })); take("zoomed");
        canvas.dispatchEvent(new Event("dblclick")); take("home");
        for (const field of ["von_mises", "pressure", "stretch", "contact", "overlap"]) { press("pick-field", field); take(field); }
        press("pick-field", "stretch"); press("pick-configuration", "0"); take("without");
        const drag_to = (name, value) => {
            const input = document.getElementById(name);
            input.value = value;
            input.dispatchEvent(new Event("input"));
        };
        press("pick-field", "contact"); press("pick-configuration", "1"); take("covered");
        drag_to("see-through", 80); take("glass"); drag_to("see-through", 0); take("covered again");
        press("pick-cut", "1"); take("cut"); drag_to("cut-at", 70); take("cut deeper");
        const cut = document.getElementById("cut-name").textContent;
        press("pick-cut", ""); take("whole again");
        const scale = document.getElementById("scalebar").textContent;
        const triad = document.getElementById("triad").textContent;
        press("pick-field", "stretch"); press("pick-configuration", "0");
        press("pick-field", ""); take("plain");
        document.querySelector(".list button").click(); take("hidden");
        const gl = canvas.getContext("webgl2");
        const pixel = new Uint8Array(4 * canvas.width * canvas.height);
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        let painted = 0;
        for (let i = 3; i < pixel.length; i += 4) painted += pixel[i] > 0;
        const same = (a, b) => pictures[a] === pictures[b];
        document.title = JSON.stringify({
            labels, painted, cut, scale, triad, error: gl.getError(), overflow: document.documentElement.scrollWidth - innerWidth,
            same: [same("start", "again"), same("start", "back"), same("start", "turned back"), same("start", "home"),
                same("covered", "covered again"), same("covered", "whole again")],
            differ: ["step", "turned", "zoomed", "von_mises", "pressure", "stretch", "contact", "overlap"].map((n) => !same("start", n))
                .concat([!same("covered", "glass"), !same("covered", "cut"), !same("cut", "cut deeper")])
                .concat([!same("von_mises", "pressure"), !same("stretch", "without"), !same("plain", "hidden")]),
        });"#;
    for width in ["--window-size=1300,900", "--window-size=480,900"] {
        let Some(dom) = in_browser(&page, script, &[width, "--enable-unsafe-swiftshader"]) else { return };
        let title =
            dom.split("<title>").nth(1).unwrap().split("</title>").next().unwrap().replace("&quot;", "\"");
        let seen: Value =
            serde_json::from_str(&title).unwrap_or_else(|_| panic!("the script did not end: {title}"));
        assert_eq!(seen["labels"], serde_json::json!(["loading response", "heel strike"]), "{seen}");
        for (key, wanted) in [("cut", "y = "), ("scale", " mm"), ("triad", "front"), ("triad", "right")] {
            assert!(seen[key].as_str().unwrap().contains(wanted), "{key}: {seen}");
        }
        assert!(seen["painted"].as_u64().unwrap() > 5000, "{seen}");
        assert_eq!(seen["error"], 0, "{seen}");
        assert!(seen["overflow"].as_f64().unwrap() <= 0.0, "{width}: {seen}");
        assert!(seen["same"].as_array().unwrap().iter().all(|v| v == true), "{seen}");
        assert!(seen["differ"].as_array().unwrap().iter().all(|v| v == true), "{seen}");
    }
}
