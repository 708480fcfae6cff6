//! Figures of the publication that a comparison stands beside: "Modeling of the Thigh: a 3D deformable approach considering
//! muscle interactions" (2016), summary of |FE − rigid| in N over the muscles that carry force in its rigid model.

use coupling::steps::StepName;

/// Mean and largest difference \[N\] of the publication at a step, without (0) or with contact (1).
pub(super) fn published(step: StepName, configuration: usize) -> [f64; 2] {
    match (step, configuration) {
        (StepName::HeelStrike, 0) => [4.3, 20.0],
        (StepName::HeelStrike, _) => [2.7, 10.3],
        (StepName::LoadingResponse, 0) => [13.0, 26.9],
        (StepName::LoadingResponse, _) => [17.5, 112.0],
    }
}
