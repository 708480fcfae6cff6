//! Muscles: lines of action, full paths and lengths, Hill curves, and the way from tendon force to activation.

pub mod curves;
pub mod hill;
pub mod musculotendon;
pub mod path;
pub mod wrap;
pub mod wrapped;

use musculotendon::TableError;

/// Number of muscle lines of action of the right leg.
pub const N_MUSCLES: usize = 43;

/// Parameters of one muscle with its tendon. Forces, fibre and tendon numbers belong together: take them from one set.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleTendon {
    /// Name as in the muscle table of the model they come from, e.g. `vas_lat_r`.
    pub name: String,
    /// Short name as in the force sharing, e.g. `vaslat`.
    pub short_name: String,
    /// Peak isometric force \[N\].
    pub f_max: f64,
    /// Optimal fibre length \[m\].
    pub l_opt: f64,
    /// Tendon slack length \[m\].
    pub l_ts: f64,
    /// Pennation angle at optimal fibre length \[rad\].
    pub pennation: f64,
    /// Fastest shortening of the fibre \[optimal fibre lengths/s\].
    pub v_max: f64,
    /// Time constant of activation \[s\].
    pub tau_activation: f64,
    /// Time constant of deactivation \[s\].
    pub tau_deactivation: f64,
}

/// Reads a table in the form of `muscles_gait2392.csv`.
fn read_units(text: &str) -> Result<Vec<MuscleTendon>, TableError> {
    let mut units: Vec<MuscleTendon> = Vec::new();
    for row in musculotendon::rows("muscles", text)? {
        let positive = |column: &str| match row.number(column)? {
            value if value > 0.0 => Ok(value),
            value => Err(row.error(format!("`{column}` is {value}, expected a positive number"))),
        };
        let pennation = row.number("pennation_at_opt_rad")?;
        if !(0.0..1.4).contains(&pennation) {
            return Err(row.error(format!("pennation is {pennation} rad, expected 0 to 1.4")));
        }
        let name = row.text("name")?.to_string();
        if units.iter().any(|u| u.name == name) {
            return Err(row.error(format!("muscle `{name}` appears twice")));
        }
        units.push(MuscleTendon {
            name,
            short_name: row.text("model_name")?.to_string(),
            f_max: positive("max_isometric_force_N")?,
            l_opt: positive("opt_fibre_length_m")?,
            l_ts: positive("tendon_slack_length_m")?,
            pennation,
            v_max: positive("vmax_fibre_lengths_per_s")?,
            tau_activation: positive("tau_act_s")?,
            tau_deactivation: positive("tau_deact_s")?,
        });
    }
    if units.len() != N_MUSCLES {
        let reason = format!("{} muscles, expected {N_MUSCLES}", units.len());
        return Err(TableError::Incomplete { table: "muscles", reason });
    }
    Ok(units)
}
