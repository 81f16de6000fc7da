//! One search for home.
//!
//! A run sees the travel in the orientation of its method's plan: for a mirrored method, directions and limit switches are
//! exchanged, so that every run starts to the right if its switch is inactive.
//!
//! **Speeds** \[OURS]. A run uses the switch speed (0x6099:1) until the switch has been active and the shaft moves in the
//! direction in which it has to cross the edge for home. From then on, and while searching for the index pulse, it uses the
//! zero speed (0x6099:2). A run that starts where the switch is inactive and reaches the edge without reversing uses the switch
//! speed up to the edge.

use super::method::{Direction, Edge, Method, SearchPlan};
use super::{HomingError, HomingSettings, Shaft};
use crate::slave::switches::{Inputs, Switches};

/// What the search looks for at present: an edge of a switch, or the index pulse.
#[derive(Clone, Copy, Debug)]
enum Sought {
    Edge(Edge),
    Index,
}

/// A search for home that is in progress.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    method: Method,
    sought: Sought,
    /// Whether the positive limit switch still reverses the run; it does so only once.
    limit_reverses: bool,
    heading: Direction,
    /// Whether the run began where the switch is inactive and has not reversed yet. The first leg uses the switch speed up to
    /// the edge.
    on_first_leg: bool,
    /// Whether the switch has been active during the run.
    switch_seen: bool,
    /// The states of the switches at the count that was evaluated last, in the orientation of the plan.
    inputs: Inputs,
    /// The distance that the position demand has covered since the start of the run, counts, for the limit of the search.
    distance: f64,
}

impl Run {
    /// Starts a run; `None` if home is the present position.
    ///
    /// # Errors
    /// An unsupported method, a moving shaft, an input that is not wired, a speed or acceleration of 0, or an active
    /// limit switch that the search cannot leave. In these cases the shaft does not move.
    pub fn start(settings: &HomingSettings, shaft: Shaft, switches: &Switches) -> Result<Option<Self>, HomingError> {
        let code = settings.method;
        let method = Method::from_code(code).ok_or(HomingError::UnsupportedMethod(code))?;
        if shaft.moves {
            return Err(HomingError::Moving);
        }
        if let Some(input) = method.missing(|input| switches.is_wired(input)) {
            return Err(HomingError::NotWired { method: code, input });
        }
        let inputs = as_planned(method, switches.read(shaft.position));
        let mut run = match method.plan {
            SearchPlan::Here => return Ok(None),
            SearchPlan::Index => Self::new(method, Sought::Index, inputs),
            SearchPlan::Edge { edge, limit_reverses } => {
                let mut run = Self::new(method, Sought::Edge(edge), inputs);
                run.switch_seen = inputs.has(edge.switch);
                run.on_first_leg = !run.switch_seen;
                run.limit_reverses = limit_reverses;
                if run.switch_seen {
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
        // [OURS] If the positive limit switch is active at the start, and the plan of the method reverses the search at
        // this switch, the run starts in the negative direction, because the travel ends in the positive one.
        if run.heading == Direction::Positive && inputs.has(Direction::Positive.limit()) && run.limit_reverses {
            run.reverse_at_limit();
        }
        run.check_limit_ahead()?;
        Ok(Some(run))
    }

    const fn new(method: Method, sought: Sought, inputs: Inputs) -> Self {
        let heading = Direction::Positive;
        Self {
            method,
            sought,
            limit_reverses: false,
            heading,
            on_first_leg: false,
            switch_seen: false,
            inputs,
            distance: 0.0,
        }
    }

    /// The velocity that the run requests, counts/s.
    pub fn velocity(&self, settings: &HomingSettings) -> f64 {
        let slow = match self.sought {
            Sought::Index => true,
            Sought::Edge(edge) => self.switch_seen && !self.on_first_leg && self.heading == edge.moving,
        };
        let speed = if slow { settings.zero_speed } else { settings.switch_speed };
        self.heading.mirrored_if(self.method.mirrored).sign() * f64::from(speed)
    }

    /// Evaluates the counts `from` to `to` that the shaft has moved through, while the demand has moved by `way` counts.
    /// Returns the count of home if home was found.
    ///
    /// # Errors
    /// The run ends without home, because a limit switch is active that the method does not use, because both limit
    /// switches are active, or because the search distance is exceeded.
    pub fn pass(&mut self, from: i64, to: i64, way: f64, switches: &Switches) -> Result<Option<i64>, HomingError> {
        let is_new = as_planned(self.method, switches.read(from)) != self.inputs;
        let is_met = is_new || matches!(self.sought, Sought::Index) || switches.change_between(from, to);
        if is_met && let Some(home) = self.scan_path(from, to, switches)? {
            return Ok(Some(home));
        }
        self.distance += way.abs();
        if self.distance > switches.search_limit() {
            return Err(HomingError::TooFar(switches.search_limit() as u64));
        }
        Ok(None)
    }

    /// Evaluates the switches and the index pulse at `from`, and then at each count up to `to` at which a switch
    /// changes or the index pulse comes. Returns the count of home if home was found.
    fn scan_path(&mut self, from: i64, to: i64, switches: &Switches) -> Result<Option<i64>, HomingError> {
        let mirrored = self.method.mirrored;
        // An input may change while the shaft is at standstill, for example by a fault. An edge needs a direction: the
        // direction of the run.
        let moving = match to.cmp(&from) {
            std::cmp::Ordering::Less => Direction::Negative.mirrored_if(mirrored),
            std::cmp::Ordering::Equal => self.heading,
            std::cmp::Ordering::Greater => Direction::Positive.mirrored_if(mirrored),
        };
        let mut at = from;
        let mut index = false;
        loop {
            if self.evaluate(moving, as_planned(self.method, switches.read(at)), index)? {
                return Ok(Some(at));
            }
            let seeks_index = matches!(self.sought, Sought::Index);
            let Some(next) = switches.next(at, to, seeks_index) else { return Ok(None) };
            at = next;
            index = seeks_index && switches.has_index(at);
        }
    }

    /// Evaluates the switches and the index pulse at one count. Returns true if home is at this count.
    ///
    /// \[OURS] Home is checked first, then the limit switches.
    fn evaluate(&mut self, moving: Direction, now: Inputs, index: bool) -> Result<bool, HomingError> {
        let was = std::mem::replace(&mut self.inputs, now);
        if now.has_both_limits() {
            return Err(HomingError::BothLimits);
        }
        match self.sought {
            Sought::Index if index => return Ok(true),
            Sought::Edge(edge) if was.has(edge.switch) != now.has(edge.switch) => {
                let rises = now.has(edge.switch);
                self.switch_seen |= rises;
                match (moving == edge.moving, rises == edge.rises) {
                    // The run has reversed already, and the shaft still brakes in the old direction. An edge that it crosses
                    // meanwhile is not home, because the run now seeks home in the new direction.
                    (true, true) if self.heading != moving => {}
                    (true, true) if self.method.index => self.sought = Sought::Index,
                    (true, true) => return Ok(true),
                    // The shaft has crossed the edge in the wrong direction: reverse, to cross it in the direction of
                    // the plan.
                    (false, false) => self.reverse(edge.moving),
                    _ => {}
                }
            }
            _ => {}
        }
        for end in [Direction::Positive, Direction::Negative] {
            if now.has(end.limit()) && !was.has(end.limit()) {
                self.limit_reached(end)?;
            }
        }
        self.check_limit_ahead()?;
        Ok(false)
    }

    /// Handles the limit switch at one end of the travel when it becomes active. The run goes on if it searches for this
    /// switch, reverses if the plan of its method says so, and otherwise ends with an error.
    fn limit_reached(&mut self, end: Direction) -> Result<(), HomingError> {
        let Sought::Edge(edge) = self.sought else { return Err(self.wrong_limit(end)) };
        let turns =
            matches!(self.method.plan, SearchPlan::Edge { limit_reverses: true, .. }) && end == Direction::Positive;
        match (turns, self.heading) {
            _ if edge.switch == end.limit() => {}
            // The run has reversed already and the shaft is still braking, so nothing has to be done.
            (true, Direction::Negative) => {}
            (true, Direction::Positive) if self.limit_reverses => self.reverse_at_limit(),
            _ => return Err(self.wrong_limit(end)),
        }
        Ok(())
    }

    /// Returns an error if the run would continue towards an active limit switch, unless it searches for that switch.
    fn check_limit_ahead(&self) -> Result<(), HomingError> {
        let sought = matches!(self.sought, Sought::Edge(edge) if edge.switch == self.heading.limit());
        if self.inputs.has(self.heading.limit()) && !sought {
            return Err(self.wrong_limit(self.heading));
        }
        Ok(())
    }

    const fn reverse(&mut self, heading: Direction) {
        self.heading = heading;
        self.on_first_leg = false;
    }

    const fn reverse_at_limit(&mut self) {
        self.limit_reverses = false;
        self.reverse(Direction::Negative);
    }

    fn wrong_limit(&self, end: Direction) -> HomingError {
        HomingError::WrongLimit(end.mirrored_if(self.method.mirrored).limit())
    }
}

/// The states of the switches in the orientation of the method's plan: for a mirrored method the limit switches are
/// exchanged.
const fn as_planned(method: Method, inputs: Inputs) -> Inputs {
    if method.mirrored { inputs.mirrored() } else { inputs }
}
