//! One search for home.
//!
//! A run sees the travel as its method's plan does: mirrored methods see it in a mirror, so that every run sets out to
//! the right where its switch is inactive.
//!
//! **Speeds** \[OURS]. A leg is fast until the edge is sought in it and the switch has been seen; from there on, and in
//! the search for the index pulse, it is slow. A run whose first leg leads from outside the switch over the edge is
//! fast up to the edge.

use super::method::{Direction, Edge, Method, Plan};
use super::{HomingError, HomingSettings, Shaft};
use crate::slave::switches::{Inputs, Switches};

/// What a run looks for at present.
#[derive(Clone, Copy, Debug)]
enum Sought {
    Edge(Edge),
    Index,
}

/// A search under way.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    method: Method,
    sought: Sought,
    /// The positive limit switch turns the run back, if it has not yet.
    limit_turns: bool,
    heading: Direction,
    /// The first leg, if it began where the switch is inactive.
    set_out: bool,
    /// The switch has been active.
    seen: bool,
    /// The switches as they were last.
    inputs: Inputs,
    /// Counts gone so far.
    way: f64,
}

impl Run {
    /// Sets out. `None`: home is where the shaft is.
    ///
    /// # Errors
    /// Why there is no way to set out; the shaft does not move then.
    pub fn start(settings: &HomingSettings, shaft: Shaft, switches: &Switches) -> Result<Option<Self>, HomingError> {
        let code = settings.method;
        let method = Method::from_code(code).ok_or(HomingError::UnsupportedMethod(code))?;
        if shaft.moves {
            return Err(HomingError::Moving);
        }
        if let Some(input) = method.missing(|input| switches.is_wired(input)) {
            return Err(HomingError::NotWired { method: code, input });
        }
        let inputs = seen_by(method, switches.read(shaft.position));
        let mut run = match method.plan {
            Plan::Here => return Ok(None),
            Plan::Index => Self::new(method, Sought::Index, inputs),
            Plan::Edge { edge, limit_turns } => {
                let mut run = Self::new(method, Sought::Edge(edge), inputs);
                run.seen = inputs.has(edge.switch);
                run.set_out = !run.seen;
                run.limit_turns = limit_turns;
                if run.seen {
                    run.heading = edge.from_within();
                }
                run
            }
        };
        if settings.switch_speed == 0 || settings.zero_speed == 0 || settings.acceleration == 0 {
            return Err(HomingError::NoSpeed);
        }
        if inputs.has_both_limits() {
            return Err(HomingError::BothLimits);
        }
        // [OURS] A run that a limit would turn back, and that begins on it, begins turned.
        if run.heading == Direction::Positive && inputs.has(Direction::Positive.limit()) && run.limit_turns {
            run.turn_at_limit();
        }
        run.look_ahead()?;
        Ok(Some(run))
    }

    const fn new(method: Method, sought: Sought, inputs: Inputs) -> Self {
        let heading = Direction::Positive;
        Self { method, sought, limit_turns: false, heading, set_out: false, seen: false, inputs, way: 0.0 }
    }

    /// The velocity that is wanted, counts/s.
    pub fn velocity(&self, settings: &HomingSettings) -> f64 {
        let slow = match self.sought {
            Sought::Index => true,
            Sought::Edge(edge) => self.seen && !self.set_out && self.heading == edge.moving,
        };
        let speed = if slow { settings.zero_speed } else { settings.switch_speed };
        self.heading.mirrored_if(self.method.mirrored).sign() * f64::from(speed)
    }

    /// The shaft went from one count to another, with `way` counts asked for. `Some`: home was there.
    ///
    /// # Errors
    /// Why the search is over.
    pub fn pass(&mut self, from: i64, to: i64, way: f64, switches: &Switches) -> Result<Option<i64>, HomingError> {
        let is_new = seen_by(self.method, switches.read(from)) != self.inputs;
        let is_met = is_new || matches!(self.sought, Sought::Index) || switches.change_between(from, to);
        if is_met && let Some(home) = self.look_along(from, to, switches)? {
            return Ok(Some(home));
        }
        self.way += way.abs();
        if self.way > switches.search_limit() {
            return Err(HomingError::TooFar(switches.search_limit() as u64));
        }
        Ok(None)
    }

    /// What was on the way is seen, one thing after the other. `Some`: home was there.
    fn look_along(&mut self, from: i64, to: i64, switches: &Switches) -> Result<Option<i64>, HomingError> {
        let mirrored = self.method.mirrored;
        // Inputs may change while the shaft stands: as if it were on its way already.
        let moving = match to.cmp(&from) {
            std::cmp::Ordering::Less => Direction::Negative.mirrored_if(mirrored),
            std::cmp::Ordering::Equal => self.heading,
            std::cmp::Ordering::Greater => Direction::Positive.mirrored_if(mirrored),
        };
        let mut at = from;
        let mut index = false;
        loop {
            if self.see(moving, seen_by(self.method, switches.read(at)), index)? {
                return Ok(Some(at));
            }
            let seeks_index = matches!(self.sought, Sought::Index);
            let Some(next) = switches.next(at, to, seeks_index) else { return Ok(None) };
            at = next;
            index = seeks_index && switches.has_index(at);
        }
    }

    /// The shaft is where a switch changes or the index pulse comes. True: home is here.
    ///
    /// \[OURS] What ends the search is looked at first, then the limit switches.
    fn see(&mut self, moving: Direction, now: Inputs, index: bool) -> Result<bool, HomingError> {
        let was = std::mem::replace(&mut self.inputs, now);
        if now.has_both_limits() {
            return Err(HomingError::BothLimits);
        }
        match self.sought {
            Sought::Index if index => return Ok(true),
            Sought::Edge(edge) if was.has(edge.switch) != now.has(edge.switch) => {
                let rises = now.has(edge.switch);
                self.seen |= rises;
                match (moving == edge.moving, rises == edge.rises) {
                    // On the ramp of a turn it is crossed before it is sought.
                    (true, true) if self.heading != moving => {}
                    (true, true) if self.method.index => self.sought = Sought::Index,
                    (true, true) => return Ok(true),
                    // From its other side.
                    (false, false) => self.turn(edge.moving),
                    _ => {}
                }
            }
            _ => {}
        }
        for end in [Direction::Positive, Direction::Negative] {
            if now.has(end.limit()) && !was.has(end.limit()) {
                self.run_into_limit(end)?;
            }
        }
        self.look_ahead()?;
        Ok(false)
    }

    /// The limit switch at that end has become active.
    fn run_into_limit(&mut self, end: Direction) -> Result<(), HomingError> {
        let Sought::Edge(edge) = self.sought else { return Err(self.wrong_limit(end)) };
        let turns = matches!(self.method.plan, Plan::Edge { limit_turns: true, .. }) && end == Direction::Positive;
        match (turns, self.heading) {
            _ if edge.switch == end.limit() => {}
            // It slows down after having turned.
            (true, Direction::Negative) => {}
            (true, Direction::Positive) if self.limit_turns => self.turn_at_limit(),
            _ => return Err(self.wrong_limit(end)),
        }
        Ok(())
    }

    /// No run goes on towards an active limit switch, unless that is what it looks for.
    fn look_ahead(&self) -> Result<(), HomingError> {
        let sought = matches!(self.sought, Sought::Edge(edge) if edge.switch == self.heading.limit());
        if self.inputs.has(self.heading.limit()) && !sought {
            return Err(self.wrong_limit(self.heading));
        }
        Ok(())
    }

    const fn turn(&mut self, heading: Direction) {
        self.heading = heading;
        self.set_out = false;
    }

    const fn turn_at_limit(&mut self) {
        self.limit_turns = false;
        self.turn(Direction::Negative);
    }

    fn wrong_limit(&self, end: Direction) -> HomingError {
        HomingError::WrongLimit(end.mirrored_if(self.method.mirrored).limit())
    }
}

/// Switches as a method's plan sees them.
const fn seen_by(method: Method, inputs: Inputs) -> Inputs {
    if method.mirrored { inputs.mirrored() } else { inputs }
}
