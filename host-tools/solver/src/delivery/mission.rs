//! The mission (Algorithm 1), with an answer to each failure.
//!
//! ```text
//!             on the ground at the goal        released              on the ground at the start
//!   Delivering ───────────────► Releasing ───────────► Returning ───────────────► Finished
//!     │  ▲   │                                          ▲    │
//!     │  │   └── battery low before half way, fence, ───┘    │ battery empty, or lost for too long
//!     │  │       third failed landing: back with the package ▼
//!     ▼  │                                              HandedOver  (the autopilot's own failsafe)
//!   Holding    nothing tells the place: wait
//!   Searching  near the ground and nothing there has been seen or heard: a spiral, until it is
//!   Climbing   near the ground and unsure: up again, then another try
//! ```
//!
//! | trouble | answer |
//! |---|---|
//! | GPS lost on the way | hold; back in time: go on; else hand over |
//! | marker hidden, or UWB lost or stalled | the other is enough: go on |
//! | neither seen nor heard near the ground | search in a spiral; found: go on; else climb and try again |
//! | both lost near or on the ground, or the place unsure | climb to the arc and try again; the third time back to the start |
//! | battery low | before half way back to the start; later deliver and stay |
//! | battery empty | hand over: the autopilot lands at once |
//! | outside the fence | back to the start; twice as far outside: hand over |

/// What the mission is told, every tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Situation {
    /// Time, seconds; never goes back.
    pub t_s: f64,
    /// Estimated length of path behind the vehicle, metres.
    pub along_m: f64,
    /// Estimated height above the goal, metres.
    pub height_m: f64,
    /// Horizontal sigma of the estimate, metres.
    pub sigma_m: f64,
    /// Estimated distance to the path, metres.
    pub off_path_m: f64,
    /// Time since the autopilot's own place was last heard, seconds.
    pub gps_age_s: f64,
    /// Time since the marker or a UWB place was last used, seconds.
    pub local_age_s: f64,
    /// What is left of the battery, 0 to 1.
    pub battery: f64,
    /// The autopilot feels the ground.
    pub on_ground: bool,
    /// The package has left.
    pub released: bool,
}

/// Limits of the mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionOptions {
    /// Length of the whole path, metres.
    pub length_m: f64,
    /// Height above which a landing is tried again, metres: h - r.
    pub retry_height_m: f64,
    /// Below this height the marker or UWB must be heard, metres, a part lower with each further try; minus infinity lands by GPS alone.
    pub decision_height_m: f64,
    /// Below that height the horizontal sigma must be at most this, metres.
    pub most_sigma_m: f64,
    /// Landings that are tried.
    pub tries: u32,
    /// A sensor is lost when silent for so long, seconds.
    pub lost_s: f64,
    /// Near the ground the marker and UWB are lost when silent for so long, seconds: the large marker leaves the view
    /// before the ground is reached.
    pub local_lost_s: f64,
    /// A search lasts so long at most, seconds.
    pub longest_search_s: f64,
    /// A hold lasts so long at most, seconds.
    pub longest_hold_s: f64,
    /// Below this the battery does not suffice for the way there and back.
    pub low_battery: f64,
    /// Below this it is empty.
    pub empty_battery: f64,
    /// The fence: distance to the path, metres.
    pub fence_m: f64,
}

/// Where the mission is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum State {
    /// With the package to the goal.
    Delivering,
    /// On the ground at the goal.
    Releasing,
    /// To the start, with the package (aborted) or without.
    Returning,
    /// Waits for a place to be told, since then, seconds; goes on to the goal or to the start afterwards.
    Holding {
        /// Since when.
        since_s: f64,
        /// To the goal.
        forwards: bool,
    },
    /// Looks about near the ground for what marks the goal, since then, seconds.
    Searching {
        /// Since when.
        since_s: f64,
    },
    /// Up again after a landing that was not sure.
    Climbing,
    /// On the ground: at the start, or at the goal when the battery keeps it there.
    Finished,
    /// The autopilot's failsafe has it.
    HandedOver,
}

/// What the vehicle shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Follow the field: s = 1.
    FollowToGoal,
    /// Follow the field: s = -1.
    FollowToStart,
    /// Stay where it is.
    Hold,
    /// Fly a spiral about where this was first ordered ([`super::Spiral`]).
    Search,
    /// Straight up.
    Climb,
    /// Open the holder.
    Release,
    /// Motors off, on the ground.
    Stop,
    /// Leave it to the autopilot's own failsafe.
    HandOver,
}

/// What has gone wrong, for the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trouble {
    /// Nothing tells the place.
    NoPlace,
    /// Nothing that marks the goal is seen or heard.
    NotFound,
    /// The place is not sure enough to land.
    Unsure,
    /// Too many landings were not sure.
    TooManyTries,
    /// The battery does not suffice for both ways.
    LowBattery,
    /// The battery is empty.
    EmptyBattery,
    /// Outside the fence.
    Fence,
}

/// The mission.
#[derive(Debug, Clone)]
pub struct Mission {
    options: MissionOptions,
    state: State,
    failed_tries: u32,
    troubles: Vec<(f64, Trouble)>,
}

impl Mission {
    /// On the ground at the start, with the package.
    pub fn new(options: MissionOptions) -> Self {
        Self {
            options,
            state: State::Delivering,
            failed_tries: 0,
            troubles: Vec::new(),
        }
    }

    /// Where it is.
    pub fn state(&self) -> State {
        self.state
    }

    /// What has gone wrong, and when.
    pub fn troubles(&self) -> &[(f64, Trouble)] {
        &self.troubles
    }

    /// Takes the situation in; what to do now.
    pub fn step(&mut self, now: &Situation) -> Order {
        self.state = self.next(now);
        match self.state {
            State::Delivering => Order::FollowToGoal,
            State::Releasing => Order::Release,
            State::Returning => Order::FollowToStart,
            State::Holding { .. } => Order::Hold,
            State::Searching { .. } => Order::Search,
            State::Climbing => Order::Climb,
            State::Finished => Order::Stop,
            State::HandedOver => Order::HandOver,
        }
    }

    fn next(&mut self, now: &Situation) -> State {
        let o = self.options;
        let flying = !matches!(
            self.state,
            State::Releasing | State::Finished | State::HandedOver
        );
        if flying {
            if now.battery < o.empty_battery {
                return self.trouble(now, Trouble::EmptyBattery, State::HandedOver);
            }
            if now.off_path_m > 2.0 * o.fence_m {
                return self.trouble(now, Trouble::Fence, State::HandedOver);
            }
        }
        match self.state {
            State::Delivering => self.delivering(now),
            State::Searching { since_s } => {
                if self.no_place(now) {
                    self.hold(now, true)
                } else if now.off_path_m > self.options.fence_m {
                    self.trouble(now, Trouble::Fence, State::Returning)
                } else if self.is_sure(now) {
                    State::Delivering
                } else if now.on_ground || now.t_s - since_s > self.options.longest_search_s {
                    self.unsure(now)
                } else {
                    self.state
                }
            }
            State::Climbing => {
                if self.no_place(now) {
                    return self.hold(now, true);
                }
                if now.height_m >= o.retry_height_m {
                    return State::Delivering;
                }
                State::Climbing
            }
            State::Releasing => match now.released {
                true if now.battery < o.low_battery => State::Finished,
                true => State::Returning,
                false => State::Releasing,
            },
            State::Returning => {
                // It has to leave the ground at the goal before it can have come down at the start.
                let half_m = 0.5 * o.length_m;
                if now.on_ground && now.along_m < half_m {
                    State::Finished
                } else if self.no_place(now) {
                    self.hold(now, false)
                } else {
                    State::Returning
                }
            }
            State::Holding { since_s, forwards } => {
                if !self.no_place(now) {
                    if forwards {
                        State::Delivering
                    } else {
                        State::Returning
                    }
                } else if now.t_s - since_s > o.longest_hold_s {
                    State::HandedOver
                } else {
                    self.state
                }
            }
            State::Finished | State::HandedOver => self.state,
        }
    }

    fn delivering(&mut self, now: &Situation) -> State {
        let o = self.options;
        let beyond_half = now.along_m > 0.5 * o.length_m;
        let sure = self.is_sure(now);
        let lands_unseen = o.decision_height_m == f64::NEG_INFINITY;
        if now.on_ground && beyond_half && (sure || lands_unseen) {
            return State::Releasing;
        }
        if now.off_path_m > o.fence_m {
            return self.trouble(now, Trouble::Fence, State::Returning);
        }
        if now.battery < o.low_battery && !beyond_half {
            return self.trouble(now, Trouble::LowBattery, State::Returning);
        }
        // The height may be off by metres: each further try looks from lower, and the ground may come first.
        let tried = f64::from(self.failed_tries) / f64::from(o.tries.max(1));
        let is_low = now.on_ground || now.height_m < o.decision_height_m * (1.0 - tried);
        if beyond_half && is_low && !sure {
            let not_found = !(now.on_ground || now.local_age_s <= o.local_lost_s);
            if not_found {
                let search = State::Searching { since_s: now.t_s };
                return self.trouble(now, Trouble::NotFound, search);
            }
            return self.unsure(now);
        }
        if self.no_place(now) {
            return self.hold(now, true);
        }
        State::Delivering
    }

    fn is_sure(&self, now: &Situation) -> bool {
        // NaN fails the comparison.
        now.sigma_m <= self.options.most_sigma_m && now.local_age_s <= self.options.local_lost_s
    }

    /// Another try, or none.
    fn unsure(&mut self, now: &Situation) -> State {
        self.failed_tries += 1;
        if self.failed_tries >= self.options.tries {
            return self.trouble(now, Trouble::TooManyTries, State::Returning);
        }
        self.trouble(now, Trouble::Unsure, State::Climbing)
    }

    fn no_place(&self, now: &Situation) -> bool {
        now.gps_age_s > self.options.lost_s && now.local_age_s > self.options.lost_s
    }

    fn hold(&mut self, now: &Situation, forwards: bool) -> State {
        let state = State::Holding {
            since_s: now.t_s,
            forwards,
        };
        self.trouble(now, Trouble::NoPlace, state)
    }

    fn trouble(&mut self, now: &Situation, what: Trouble, next: State) -> State {
        self.troubles.push((now.t_s, what));
        next
    }
}
