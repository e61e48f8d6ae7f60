//! How a [`NovaNavigator`](super::NovaNavigator) is to work.

use super::parameters::Parameters;
use super::planner::{LambdaWeighs, Planner};
use super::variants::{Switches, Variant};

/// How to navigate. The default is the paper's method with the paper's parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NovaOptions {
    /// Table II.
    pub parameters: Parameters,
    /// Which parts of the method are used.
    pub switches: Switches,
    /// Reading of Eq. 8.
    pub lambda_weighs: LambdaWeighs,
    /// Shifts the points that the Bayesian optimisation tries. Nothing else is random.
    pub seed: u64,
}

impl Default for NovaOptions {
    fn default() -> Self {
        Self::variant(Variant::V7)
    }
}

impl NovaOptions {
    /// A row of the ablation study, with the paper's parameters.
    pub fn variant(variant: Variant) -> Self {
        Self {
            parameters: Parameters::default(),
            switches: variant.switches(),
            lambda_weighs: LambdaWeighs::default(),
            seed: 0,
        }
    }

    pub(super) fn planner(&self) -> Planner {
        Planner {
            candidates: self.parameters.candidates,
            lambda: self.parameters.lambda,
            lambda_weighs: self.lambda_weighs,
        }
    }
}
