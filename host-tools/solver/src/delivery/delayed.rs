//! Measurements that come late.
//!
//! A camera's pose is some 100 ms old when it has been computed; at 2 m/s that is 20 cm. The paper names it as future work.
//! Here the filter goes back to when the measurement was taken, corrects itself there, and repeats what has happened
//! since: the same as if it had come at once.

use super::filter::{Input, LandingFilter, Measurement, Verdict};
use std::collections::VecDeque;

/// A filter with a memory.
#[derive(Debug, Clone)]
pub struct Delayed<F> {
    memory_s: f64,
    begin: Moment<F>,
    moments: VecDeque<(Event, Moment<F>)>,
}

#[derive(Debug, Clone)]
struct Moment<F> {
    t_s: f64,
    input: Input,
    filter: F,
}

#[derive(Debug, Clone, Copy)]
struct Event {
    t_s: f64,
    what: What,
}

#[derive(Debug, Clone, Copy)]
enum What {
    Input(Input),
    Measurement(Measurement),
}

impl<F: LandingFilter + Clone> Moment<F> {
    fn after(&self, event: &Event) -> (Self, Verdict) {
        let mut next = self.clone();
        let dt_s = event.t_s - self.t_s;
        if dt_s > 0.0 {
            next.filter.predict(&self.input, dt_s);
            next.t_s = event.t_s;
        }
        let verdict = match &event.what {
            What::Input(input) => {
                next.input = *input;
                Verdict::Used
            }
            What::Measurement(measurement) => next.filter.update(measurement),
        };
        (next, verdict)
    }
}

impl<F: LandingFilter + Clone> Delayed<F> {
    /// A filter at `t_s` that remembers `memory_s` seconds.
    pub fn new(filter: F, t_s: f64, memory_s: f64) -> Self {
        let still = Input {
            velocity_m_s: Default::default(),
            rate_rad_s: Default::default(),
        };
        Self {
            memory_s,
            begin: Moment {
                t_s,
                input: still,
                filter,
            },
            moments: VecDeque::new(),
        }
    }

    /// The filter as of the last event.
    pub fn filter(&self) -> &F {
        &self
            .moments
            .back()
            .map_or(&self.begin, |(_, moment)| moment)
            .filter
    }

    /// An input that holds from `t_s` on.
    pub fn input(&mut self, t_s: f64, input: Input) -> Verdict {
        self.take(Event {
            t_s,
            what: What::Input(input),
        })
    }

    /// A measurement taken at `t_s`; [`Verdict::Unusable`] where that is longer ago than the memory reaches.
    pub fn measurement(&mut self, t_s: f64, measurement: Measurement) -> Verdict {
        self.take(Event {
            t_s,
            what: What::Measurement(measurement),
        })
    }

    fn take(&mut self, event: Event) -> Verdict {
        // NaN fails the comparison.
        if !(event.t_s.is_finite() && event.t_s >= self.begin.t_s) {
            return Verdict::Unusable;
        }
        let place = self
            .moments
            .partition_point(|(earlier, _)| earlier.t_s <= event.t_s);
        let later: Vec<Event> = self
            .moments
            .drain(place..)
            .map(|(event, _)| event)
            .collect();
        let last = self
            .moments
            .back()
            .map_or(&self.begin, |(_, moment)| moment);
        let (mut moment, verdict) = last.after(&event);
        self.moments.push_back((event, moment.clone()));
        for event in later {
            moment = moment.after(&event).0;
            self.moments.push_back((event, moment.clone()));
        }
        let newest_s = moment.t_s;
        while let Some((event, _)) = self.moments.front()
            && newest_s - event.t_s > self.memory_s
            && let Some((_, moment)) = self.moments.pop_front()
        {
            self.begin = moment;
        }
        verdict
    }
}
