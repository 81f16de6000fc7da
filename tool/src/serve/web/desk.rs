//! The desk of the page that has control: what the page wants, for the hand (`hand.rs`), the thread that commands the
//! board.
//!
//! An answer of the page counts for [`FRESH_MAX`] from the time at which its question was sent. So a page that goes away,
//! sleeps or is slow stops what it moves, whatever its own clock does.

use std::collections::BTreeSet;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::Deserialize;

use crate::lock::lock;

/// The longest time from a question until its answer no longer holds a button. \[OURS]
const FRESH_MAX: Duration = Duration::from_millis(300);
/// A page that answers no question for this long loses control, and what it has begun is ended. \[OURS]
pub const SILENT_MAX: Duration = Duration::from_secs(1);
/// The longest wait of the hand for something to do. \[OURS]
const IDLE_WAIT: Duration = Duration::from_millis(100);

/// A button that is held: an axis that runs meanwhile.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Press {
    /// The number of the press, from 1, larger at each press. What has ended one press does not end the next one.
    pub press: u32,
    /// The slave of the axis.
    pub slave: u8,
    /// Whether the axis moves in the positive direction of its unit.
    pub is_positive: bool,
    /// The part of the axis' default speed, 0 to 1.
    pub part: f64,
}

/// A command of the page that is carried out once, unlike a button that is held.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Order {
    /// Take the network to OP.
    Op,
    /// Switch an axis on.
    On { slave: u8 },
    /// Switch an axis off.
    Off { slave: u8 },
    /// Reset the alarm of an axis.
    Clear { slave: u8 },
    /// Home an axis.
    Home { slave: u8 },
    /// Set all outputs of an IO slave, or those of the board (`slave` is 0).
    Outputs { slave: u8, bits: u16 },
    /// Read an object of a slave (SDO).
    Read { slave: u8, object: String, r#type: Option<String> },
    /// Write an object of a slave (SDO).
    Write { slave: u8, object: String, r#type: Option<String>, value: String },
}

impl Order {
    /// Whether all texts of the order are single words of a script: an object, a type, or a number.
    pub fn is_words(&self) -> bool {
        let is_word = |text: &str| {
            let is_letter = |byte: u8| byte.is_ascii_alphanumeric() || b"_:-".contains(&byte);
            !text.is_empty() && !text.starts_with("--") && text.bytes().all(is_letter)
        };
        let (object, of, value) = match self {
            Self::Read { object, r#type, .. } => (object, r#type, None),
            Self::Write { object, r#type, value, .. } => (object, r#type, Some(value)),
            Self::Op
            | Self::On { .. }
            | Self::Off { .. }
            | Self::Clear { .. }
            | Self::Home { .. }
            | Self::Outputs { .. } => return true,
        };
        is_word(object) && of.as_deref().is_none_or(is_word) && value.is_none_or(|value| is_word(value))
    }
}

/// Why control has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The page has given it up.
    Given,
    /// The page is gone.
    Gone,
    /// The page has answered nothing for [`SILENT_MAX`].
    Silent,
    /// A page has stopped all axes.
    Stopped,
    /// The server ends.
    Server,
}

/// The next task of the hand.
#[derive(Debug, PartialEq)]
pub enum Next {
    /// An order.
    Order(Order),
    /// Jog as long as this button is held.
    Jog(Press),
    /// Nothing at present.
    Nothing,
    /// Control has ended.
    Over,
}

/// What the page that has control wants. Its connection writes here, and the hand reads.
pub struct Desk {
    wishes: Mutex<Wishes>,
    changed: Condvar,
}

#[derive(Debug)]
struct Wishes {
    /// When the newest question that the page has answered was sent; at first, when control began.
    fresh: Instant,
    held: Option<Press>,
    /// The number of the newest press that no longer counts, because it was released or came too late.
    used: u32,
    /// Whether a press has come too late since the last look.
    is_late: bool,
    /// The slaves whose axes are switched off next. Nothing but the end of control drops that.
    offs: BTreeSet<u8>,
    /// The order that is done after that.
    order: Option<Order>,
    /// The kind of the task that the hand carries out at present.
    running: Option<Running>,
    /// Whether what runs at present is to end.
    is_halted: bool,
    /// Whether no button counts before an answer with none: at first, and after a halt.
    is_deaf: bool,
    end: Option<End>,
}

/// The kinds of tasks of the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Running {
    Jog,
    Off,
    Order,
}

impl Wishes {
    fn release(&mut self) {
        self.used = self.held.take().map_or(self.used, |press| press.press.max(self.used));
    }

    fn halt(&mut self) {
        self.release();
        (self.order, self.is_deaf) = (None, true);
        self.is_halted |= self.running != Some(Running::Off);
    }

    /// The button that is held at the time `now`.
    fn held(&mut self, now: Instant) -> Option<Press> {
        let held = self.held.filter(|press| press.press > self.used)?;
        if now.saturating_duration_since(self.fresh) > FRESH_MAX {
            // A page that was frozen may have missed the release. Only a new press moves the axis again.
            (self.used, self.is_late) = (held.press, true);
            return None;
        }
        Some(held)
    }

    /// Why control has ended by the time `now`. A page that was silent for too long does not get it back by an answer.
    fn end(&mut self, now: Instant) -> Option<End> {
        if self.end.is_none() && now.saturating_duration_since(self.fresh) > SILENT_MAX {
            self.halt();
            self.end = Some(End::Silent);
        }
        self.end
    }
}

impl Desk {
    /// The desk of a page that gets control at the time `now`.
    pub fn new(now: Instant) -> Self {
        let wishes = Wishes {
            fresh: now,
            held: None,
            used: 0,
            is_late: false,
            offs: BTreeSet::new(),
            order: None,
            running: None,
            is_halted: false,
            is_deaf: true,
            end: None,
        };
        Self { wishes: Mutex::new(wishes), changed: Condvar::new() }
    }

    /// Records an answer of the page to a question that was sent at the time `asked`. Returns false if a button does not
    /// count, because an order runs or waits: nothing may begin to move when that ends.
    pub fn alive(&self, asked: Instant, hold: Option<Press>) -> bool {
        let mut wishes = lock(&self.wishes);
        // A silence that is over now must not go unnoticed.
        wishes.end(Instant::now().max(asked));
        wishes.fresh = wishes.fresh.max(asked);
        wishes.is_deaf &= hold.is_some();
        let orders = !wishes.offs.is_empty() || wishes.order.is_some();
        let is_busy = orders || matches!(wishes.running, Some(Running::Order | Running::Off));
        let is_new = hold.is_some_and(|press| press.press > wishes.used);
        match hold {
            Some(press) if wishes.is_deaf || is_busy => wishes.used = wishes.used.max(press.press),
            _ => wishes.held = hold,
        }
        self.changed.notify_all();
        !(is_new && is_busy)
    }

    /// Records that nothing is held any more.
    pub fn release(&self) {
        lock(&self.wishes).release();
    }

    /// Gives an order; returns false if something else is done already. Switching an axis off ends that first.
    pub fn order(&self, order: Order) -> bool {
        let mut wishes = lock(&self.wishes);
        if let Order::Off { slave } = order {
            wishes.halt();
            wishes.offs.insert(slave);
        } else if wishes.running.is_some() || wishes.order.is_some() || !wishes.offs.is_empty() {
            return false;
        } else {
            wishes.order = Some(order);
        }
        self.changed.notify_all();
        true
    }

    /// Ends what runs, and drops the order that waits.
    pub fn halt(&self) {
        lock(&self.wishes).halt();
    }

    /// Ends control.
    pub fn end(&self, why: End) {
        let mut wishes = lock(&self.wishes);
        wishes.halt();
        wishes.end.get_or_insert(why);
        self.changed.notify_all();
    }

    /// Whether what the hand does has to end. Asked for in every cycle of a motion.
    pub fn is_stopped(&self, now: Instant) -> bool {
        let mut wishes = lock(&self.wishes);
        wishes.end(now).is_some() || wishes.is_halted
    }

    /// Why control has ended; `None` if it has not.
    pub fn why_ended(&self, now: Instant) -> Option<End> {
        lock(&self.wishes).end(now)
    }

    /// Whether this button is still held; if not, this press never counts again.
    pub fn is_held(&self, press: Press, now: Instant) -> bool {
        let mut wishes = lock(&self.wishes);
        let is_held = wishes.held(now) == Some(press);
        if !is_held {
            wishes.used = wishes.used.max(press.press);
        }
        is_held
    }

    /// Whether a press has come too late since the last call.
    pub fn take_late(&self) -> bool {
        std::mem::take(&mut lock(&self.wishes).is_late)
    }

    /// This press does not count any more.
    pub fn drop_press(&self, press: Press) {
        let mut wishes = lock(&self.wishes);
        wishes.used = wishes.used.max(press.press);
    }

    /// What ran is done.
    pub fn done(&self) {
        lock(&self.wishes).running = None;
    }

    /// Waits shortly for something to do.
    pub fn next(&self) -> Next {
        let until = Instant::now() + IDLE_WAIT;
        let mut wishes = lock(&self.wishes);
        loop {
            let now = Instant::now();
            if wishes.end(now).is_some() {
                return Next::Over;
            }
            let off = wishes.offs.pop_first().map(|slave| (Next::Order(Order::Off { slave }), Running::Off));
            let order = off.or_else(|| wishes.order.take().map(|order| (Next::Order(order), Running::Order)));
            let next = order.or_else(|| wishes.held(now).map(|press| (Next::Jog(press), Running::Jog)));
            if let Some((next, running)) = next {
                (wishes.running, wishes.is_halted) = (Some(running), false);
                return next;
            }
            if now >= until {
                return Next::Nothing;
            }
            let waited = self.changed.wait_timeout(wishes, until - now);
            wishes = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLUS: Press = Press { press: 1, slave: 1, is_positive: true, part: 1.0 };

    fn ms(time: u64) -> Duration {
        Duration::from_millis(time)
    }

    /// A time that a machine which stands still does not reach in a test.
    fn later() -> Instant {
        Instant::now() + Duration::from_secs(1000)
    }

    /// A desk whose page has answered once that nothing is held.
    fn ready(now: Instant) -> Desk {
        let desk = Desk::new(now);
        desk.alive(now, None);
        desk
    }

    /// docs/SAFETY.md: a button counts for 300 ms from the question whose answer has it, however late the answer is. After
    /// that only a new press counts.
    #[test]
    fn a_button_counts_for_300_ms_from_its_question() {
        let began = Instant::now();
        let desk = ready(began);
        desk.alive(began + ms(50), Some(PLUS));
        assert!(desk.is_held(PLUS, began + ms(350)));
        // An answer to an older question prolongs nothing.
        desk.alive(began + ms(20), Some(PLUS));
        assert!(desk.is_held(PLUS, began + ms(350)) && !desk.take_late());
        assert!(!desk.is_held(PLUS, began + ms(351)));
        assert!(desk.take_late() && !desk.take_late());
        // The page has missed the release, and goes on with the same press.
        desk.alive(began + ms(400), Some(PLUS));
        assert!(!desk.is_held(PLUS, began + ms(401)));
        let again = Press { press: 2, ..PLUS };
        desk.alive(began + ms(450), Some(again));
        assert!(desk.is_held(again, began + ms(451)));
        assert!(!desk.take_late());
    }

    /// A release counts at once, and an axis that is held does not become another one, or its other direction, by the same
    /// press.
    #[test]
    fn a_press_ends_with_its_release_and_moves_one_axis_one_way() {
        let began = Instant::now();
        for other in [Press { slave: 2, ..PLUS }, Press { is_positive: false, ..PLUS }] {
            let desk = ready(began);
            desk.alive(began, Some(PLUS));
            assert!(desk.is_held(PLUS, began));
            desk.alive(began, Some(other));
            assert!(!desk.is_held(PLUS, began));
            desk.alive(began, Some(PLUS));
            assert!(!desk.is_held(PLUS, began));
        }
        let desk = ready(began);
        desk.alive(began, Some(PLUS));
        desk.release();
        assert!(!desk.is_held(PLUS, began) && !desk.take_late());
        desk.alive(began + ms(1), Some(PLUS));
        assert!(!desk.is_held(PLUS, began + ms(1)));
    }

    /// docs/SAFETY.md: a page that answers nothing for a second loses control, and what it has begun ends.
    #[test]
    fn a_silent_page_loses_control_after_a_second() {
        let began = Instant::now();
        let desk = ready(began);
        desk.alive(began + ms(500), None);
        assert!(desk.order(Order::Home { slave: 1 }));
        assert!(!desk.is_stopped(began + ms(1500)) && desk.why_ended(began + ms(1500)).is_none());
        assert!(desk.is_stopped(began + ms(1501)));
        // An answer after that changes nothing, and what has waited is not done.
        desk.alive(began + ms(1510), Some(PLUS));
        assert_eq!(desk.why_ended(began + ms(1520)), Some(End::Silent));
        assert_eq!(desk.next(), Next::Over);
    }

    /// A halt drops the order that waits and the button that is held, and ends what runs. A button counts again after an
    /// answer with none, also one whose press the server had not seen yet. The next order runs again.
    #[test]
    fn a_halt_ends_what_was_begun() {
        let now = later();
        let desk = ready(now);
        let unanswered = Desk::new(now);
        unanswered.alive(now, Some(PLUS));
        assert!(!unanswered.is_held(PLUS, now), "it was held before the server has asked");
        desk.alive(now, Some(PLUS));
        assert!(desk.is_held(PLUS, now) && desk.order(Order::Home { slave: 1 }));
        desk.halt();
        assert!(desk.is_stopped(now) && desk.why_ended(now).is_none());
        let unseen = Press { press: 2, ..PLUS };
        desk.alive(now, Some(unseen));
        assert_eq!(desk.next(), Next::Nothing);
        desk.alive(now, None);
        let again = Press { press: 3, ..PLUS };
        desk.alive(now, Some(again));
        assert!(desk.is_held(again, now));
        desk.release();
        assert!(desk.order(Order::Op));
        assert_eq!(desk.next(), Next::Order(Order::Op));
        assert!(!desk.is_stopped(now));
        desk.end(End::Given);
        desk.end(End::Stopped);
        assert_eq!((desk.next(), desk.why_ended(now)), (Next::Over, Some(End::Given)));
    }

    /// While something runs, an order is refused, so that nothing begins long after its click. Switching off ends what
    /// runs, and is done next.
    #[test]
    fn an_order_waits_for_nothing_but_switching_off() {
        let desk = ready(later());
        assert!(desk.order(Order::Home { slave: 1 }));
        assert!(!desk.order(Order::Home { slave: 2 }), "one waits");
        assert_eq!(desk.next(), Next::Order(Order::Home { slave: 1 }));
        assert!(!desk.order(Order::Home { slave: 2 }) && !desk.is_stopped(Instant::now()));
        assert!(desk.order(Order::Off { slave: 1 }));
        assert!(desk.is_stopped(Instant::now()) && desk.order(Order::Off { slave: 2 }));
        desk.done();
        assert_eq!(desk.next(), Next::Order(Order::Off { slave: 1 }));
        // Neither another one nor a halt ends switching off, or drops it.
        assert!(desk.order(Order::Off { slave: 1 }));
        desk.halt();
        assert!(!desk.is_stopped(Instant::now()));
        for slave in [1, 2] {
            desk.done();
            assert_eq!(desk.next(), Next::Order(Order::Off { slave }));
        }
        desk.done();
        assert_eq!(desk.next(), Next::Nothing);
        assert!(desk.order(Order::Home { slave: 2 }));
    }

    /// A button that is pressed while an order runs moves nothing when that ends.
    #[test]
    fn a_button_does_not_wait_for_the_end_of_an_order() {
        let now = later();
        let desk = ready(now);
        assert!(desk.order(Order::Home { slave: 1 }));
        assert_eq!(desk.next(), Next::Order(Order::Home { slave: 1 }));
        assert!(desk.alive(now, None));
        assert!(!desk.alive(now, Some(PLUS)), "it is said");
        assert!(desk.alive(now, Some(PLUS)), "once");
        desk.done();
        assert!(desk.alive(now, Some(PLUS)));
        assert_eq!(desk.next(), Next::Nothing);
        let again = Press { press: 2, ..PLUS };
        assert!(desk.alive(now, Some(again)));
        assert_eq!(desk.next(), Next::Jog(again));
        assert!(desk.alive(now, Some(again)) && desk.is_held(again, now));
    }
}
