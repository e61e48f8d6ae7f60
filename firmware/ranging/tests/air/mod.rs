//! A perfect radio for the state machines: events in order of time, frames that a test
//! can lose, repeat or invent. Times are ticks of a perfect clock.

use nova_ranging::exchange::Identity;
use nova_ranging::time::DELAYED_GRID;
use nova_ranging::{
    Address, Command, DeviceTime, Event, Initiator, Outcome, PanId, PhyProfile, Responder, Step,
    Then, Ticks, Timing, When,
};
use std::collections::BTreeMap;

pub(crate) const PAN: PanId = PanId(0xDECA);
pub(crate) const ANTENNA_DELAY: u64 = 16_436;

pub(crate) fn identity(address: Address) -> Identity {
    Identity { pan: PAN, address }
}

pub(crate) fn timing() -> Timing {
    Timing {
        reply_us: 600,
        slot_us: 400,
        profile: PhyProfile::DEFAULT,
        tx_antenna_delay: Ticks::new(ANTENNA_DELAY),
    }
}

/// A clock that runs at `1 + ppm` and showed `start` at true time 0 (ticks).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    pub(crate) start: u64,
    pub(crate) ppm: f64,
}

impl Clock {
    pub(crate) fn read(&self, t: f64) -> DeviceTime {
        DeviceTime::from_ticks(self.start + (t + t * self.ppm * 1e-6).round() as u64)
    }

    /// True time after `now` at which the clock shows `reading`.
    fn when(&self, reading: DeviceTime, now: f64) -> f64 {
        now + reading.since(self.read(now)).get() as f64 / (1.0 + self.ppm * 1e-6)
    }
}

#[derive(Clone)]
pub(crate) enum Machine {
    Initiator(Initiator),
    Responder(Responder),
}

impl Machine {
    pub(crate) fn on_event(&mut self, event: Event<'_>) -> Step {
        match self {
            Self::Initiator(machine) => machine.on_event(event),
            Self::Responder(machine) => machine.on_event(event),
        }
    }

    pub(crate) fn is_idle(&self) -> bool {
        match self {
            Self::Initiator(machine) => machine.is_idle(),
            Self::Responder(machine) => machine.is_idle(),
        }
    }
}

/// A node, and when its receiver is on.
struct Node {
    machine: Machine,
    clock: Clock,
    position: f64,
    listening: Option<(f64, f64)>,
    /// Counts what ends listening, so that time-outs know whether they still count.
    epoch: u64,
    outcomes: Vec<Outcome>,
}

enum Happening {
    Sent {
        node: usize,
        at: DeviceTime,
        then: Then,
        bytes: Vec<u8>,
    },
    Arrives {
        node: usize,
        bytes: Vec<u8>,
    },
    Timeout {
        node: usize,
        epoch: u64,
    },
}

/// What becomes of a frame on its way to one node: when it arrives, beside its time of
/// flight; no entry loses it.
pub(crate) type Fate = Vec<f64>;

/// Nodes on a line; positions in ticks of flight.
pub(crate) struct Air {
    nodes: Vec<Node>,
    queue: BTreeMap<(u64, u64), Happening>,
    count: u64,
    /// Frames sent so far, by all.
    pub(crate) frames: usize,
    /// Frame number, sender, receiver.
    pub(crate) fate: Box<dyn FnMut(usize, usize, usize) -> Fate>,
}

/// Fractions of a tick that times in the queue are kept to.
const FINE: f64 = 1024.0;

impl Air {
    pub(crate) fn new() -> Self {
        Self {
            nodes: Vec::new(),
            queue: BTreeMap::new(),
            count: 0,
            frames: 0,
            fate: Box::new(|_, _, _| vec![0.0]),
        }
    }

    /// Node 0 is the initiator.
    pub(crate) fn initiator(&mut self, address: Address, clock: Clock, position: f64) {
        self.initiator_with(timing(), address, clock, position);
    }

    /// Node 0 with another speed than the responders'.
    pub(crate) fn initiator_with(
        &mut self,
        timing: Timing,
        address: Address,
        clock: Clock,
        position: f64,
    ) {
        let machine = Machine::Initiator(Initiator::new(identity(address), timing));
        self.add(machine, clock, position);
    }

    pub(crate) fn responder(&mut self, address: Address, clock: Clock, position: f64) {
        let mut responder = Responder::new(identity(address), timing());
        assert_eq!(responder.start(), Command::Listen { until: None });
        self.add(Machine::Responder(responder), clock, position);
        self.nodes.last_mut().unwrap().listening = Some((0.0, f64::INFINITY));
    }

    fn add(&mut self, machine: Machine, clock: Clock, position: f64) {
        self.nodes.push(Node {
            machine,
            clock,
            position,
            listening: None,
            epoch: 0,
            outcomes: Vec::new(),
        });
    }

    /// Lets a frame appear at a node's antenna.
    pub(crate) fn invent(&mut self, t: f64, node: usize, bytes: &[u8]) {
        let bytes = bytes.to_vec();
        self.put(t, Happening::Arrives { node, bytes });
    }

    /// Node 0 starts a round at `t`; then everything that follows from it. What each
    /// node said.
    pub(crate) fn round(&mut self, t: f64, named: &[Address], open: usize) -> Vec<Vec<Outcome>> {
        let Machine::Initiator(initiator) = &mut self.nodes[0].machine else {
            panic!("node 0 is the initiator");
        };
        let command = initiator.start(named, open);
        self.carry_out(t, 0, command);
        self.run();
        self.nodes
            .iter_mut()
            .map(|node| std::mem::take(&mut node.outcomes))
            .collect()
    }

    pub(crate) fn all_idle(&self) -> bool {
        self.nodes.iter().all(|node| node.machine.is_idle())
    }

    fn put(&mut self, t: f64, what: Happening) {
        self.count += 1;
        self.queue.insert(((t * FINE) as u64, self.count), what);
    }

    fn run(&mut self) {
        while let Some(((t, _), happening)) = self.queue.pop_first() {
            let t = t as f64 / FINE;
            match happening {
                Happening::Sent {
                    node,
                    at,
                    then,
                    bytes,
                } => {
                    self.depart(t, node, &bytes);
                    if let Then::Listen {
                        after_us,
                        timeout_us,
                    } = then
                    {
                        let end = t + PhyProfile::DEFAULT.marker_to_end(bytes.len()).get() as f64;
                        let on = end + Ticks::from_us(after_us).get() as f64;
                        let off = timeout_us
                            .map_or(f64::INFINITY, |us| on + Ticks::from_us(us).get() as f64);
                        self.listen(node, on, off);
                    }
                    self.event(t, node, Event::Sent { at });
                }
                Happening::Arrives { node, bytes } => {
                    let hears = self.nodes[node]
                        .listening
                        .is_some_and(|(on, off)| (on..=off).contains(&t));
                    if hears {
                        self.nodes[node].epoch += 1;
                        let at = self.nodes[node].clock.read(t);
                        self.event(t, node, Event::Received { bytes: &bytes, at });
                    }
                }
                Happening::Timeout { node, epoch } if epoch == self.nodes[node].epoch => {
                    self.nodes[node].listening = None;
                    self.event(t, node, Event::ListenTimeout);
                }
                Happening::Timeout { .. } => {}
            }
        }
    }

    fn depart(&mut self, t: f64, from: usize, bytes: &[u8]) {
        self.frames += 1;
        for to in (0..self.nodes.len()).filter(|&to| to != from) {
            let flight = (self.nodes[from].position - self.nodes[to].position).abs();
            for late in (self.fate)(self.frames, from, to) {
                self.invent(t + flight + late, to, bytes);
            }
        }
    }

    fn listen(&mut self, node: usize, on: f64, off: f64) {
        self.nodes[node].epoch += 1;
        self.nodes[node].listening = Some((on, off));
        let epoch = self.nodes[node].epoch;
        if off.is_finite() {
            self.put(off, Happening::Timeout { node, epoch });
        }
    }

    fn event(&mut self, t: f64, node: usize, event: Event<'_>) {
        let step = self.nodes[node].machine.on_event(event);
        self.nodes[node].outcomes.extend(step.outcome);
        self.carry_out(t, node, step.command);
    }

    fn carry_out(&mut self, t: f64, node: usize, command: Command) {
        let clock = self.nodes[node].clock;
        match command {
            Command::Wait => {}
            Command::Idle => {
                self.nodes[node].listening = None;
                self.nodes[node].epoch += 1;
            }
            Command::KeepListening => {
                let (_, off) = self.nodes[node].listening.expect("nothing to go on with");
                self.listen(node, t, off);
            }
            Command::Listen { until } => {
                let off = until.map_or(f64::INFINITY, |until| clock.when(until, t));
                self.listen(node, t, off);
            }
            Command::Send {
                frame,
                when,
                ahead_us,
                then,
            } => {
                self.nodes[node].listening = None;
                self.nodes[node].epoch += 1;
                let asked = t;
                let (t, at) = match when {
                    When::Now => {
                        let t = t + Ticks::from_us(150).get() as f64;
                        (t, clock.read(t))
                    }
                    When::At(start) => {
                        assert_eq!(start.ticks() % DELAYED_GRID, 0, "off the radio's grid");
                        let at = start.after(Ticks::new(ANTENNA_DELAY));
                        let t = clock.when(at, asked);
                        // 100 ppm for the node's clock.
                        let ahead = Ticks::from_us(ahead_us).get() as f64 * 1.0001;
                        assert!(t <= asked + ahead, "{ahead_us} us are too few");
                        (t, at)
                    }
                };
                let bytes = frame.to_vec();
                self.put(
                    t,
                    Happening::Sent {
                        node,
                        at,
                        then,
                        bytes,
                    },
                );
            }
        }
    }
}
