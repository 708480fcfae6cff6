//! Figures of the publication that a comparison stands beside: "Modeling of the Thigh: a 3D deformable approach considering
//! muscle interactions" (2016), summary of |FE − rigid| in N over the muscles that carry force in its rigid model.

use coupling::configuration::Configuration::{self, WithContact, WithoutContact};
use coupling::scene::StepName;

/// Mean and largest difference \[N\] of the publication at a step that it has, without or with contact.
pub fn published(step: StepName, configuration: Configuration) -> Option<[f64; 2]> {
    Some(match (step, configuration) {
        (StepName::HeelStrike, WithoutContact) => [4.3, 20.0],
        (StepName::HeelStrike, WithContact) => [2.7, 10.3],
        (StepName::LoadingResponse, WithoutContact) => [13.0, 26.9],
        (StepName::LoadingResponse, WithContact) => [17.5, 112.0],
        (StepName::Twentieth(_), _) => return None,
    })
}
