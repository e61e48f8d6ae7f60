//! Table II of the paper.

/// Key implementation parameters of NOVA. [`Parameters::default`] is the paper's Table II; the names
/// there are given with each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// `v_UAV`: target speed, m/s.
    pub speed_m_s: f64,
    /// Time between the INS readings that the filter works on, seconds ("INS interval").
    pub ins_interval_s: f64,
    /// Time between ranges, seconds ("UWB interval").
    pub uwb_interval_s: f64,
    /// `D_init`: exploratory flight across the estimated direction, metres.
    pub init_distance_m: f64,
    /// `z_init`: descent before that, metres.
    pub init_descent_m: f64,
    /// `N`: candidates for the next waypoint.
    pub candidates: usize,
    /// `lambda` of Eq. 8, 0 to 1.
    pub lambda: f64,
    /// `Max_opt`: most alternations of a joint optimisation.
    pub max_alternations: u32,
    /// `epsilon`: a joint optimisation stops once the tag moves by less than this, metres.
    pub epsilon_m: f64,
    /// `D_2D^thr`: horizontal distance to the tag at which the descent begins, metres.
    pub descend_within_m: f64,
    /// `beta_min`: smallest weight of an INS velocity in the moving average, 0 to 1.
    pub beta_min: f64,
    /// `Max_ADAM`: most iterations of Adam.
    pub adam_iterations: u32,
    /// `eta`: learning rate of Adam.
    pub adam_learning_rate: f64,
    /// `v_min^adam` and `v_max^adam`: bounds of Adam's second moment.
    pub adam_velocity: [f64; 2],
    /// `d_lat`, in the text `D_final`: lateral move between the descents, metres.
    pub lateral_m: f64,
    /// Evaluations of the Bayesian optimisation for one segment. The paper does not say how many.
    pub tuning_evaluations: usize,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            speed_m_s: 1.0,
            ins_interval_s: 0.5,
            uwb_interval_s: 0.1,
            init_distance_m: 5.0,
            init_descent_m: 1.0,
            candidates: 24,
            lambda: 0.7,
            max_alternations: 20,
            epsilon_m: 0.1,
            descend_within_m: 1.0,
            beta_min: 0.15,
            adam_iterations: 500,
            adam_learning_rate: 0.1,
            adam_velocity: [0.1, 30.0],
            lateral_m: 1.0,
            tuning_evaluations: 25,
        }
    }
}
