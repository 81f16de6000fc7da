//! Reads the operands of a verb: slaves, axes, inputs, states, codes.

use super::words::{LineError, Word, Words, number, time, whole};
use crate::address::slaves::{SlaveModel, SlaveSpec};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::AlState;
use crate::slave::{AlStatus, Input, InputPattern};

const AL_STATES: [(&str, AlState); 4] =
    [("init", AlState::Init), ("preop", AlState::PreOp), ("safeop", AlState::SafeOp), ("op", AlState::Op)];
const INPUTS: [(&str, Input); 4] = [
    ("negative-limit", Input::NegativeLimit),
    ("positive-limit", Input::PositiveLimit),
    ("home", Input::Home),
    ("index", Input::Index),
];

/// Reads the operands of a verb, one after the other, and checks them against the network.
pub(super) struct Reader<'a, 'b> {
    pub(super) words: &'b mut Words<'a>,
    pub(super) slaves: &'b [SlaveSpec],
    /// The syntax of the verb, for error messages.
    pub(super) form: String,
    /// Whether the verb follows `end`. Its only operand is then the slave.
    pub(super) ends: bool,
}

impl Reader<'_, '_> {
    pub(super) fn slave(&mut self) -> Result<u8, LineError> {
        let word = self.words.need("SLAVE", &self.form)?;
        self.slave_of(word, word.text)
    }

    fn slave_of(&self, word: Word, text: &str) -> Result<u8, LineError> {
        let count = self.slaves.len();
        let slave = whole(text).and_then(|slave| u8::try_from(slave).ok());
        slave.filter(|slave| (1..=count).contains(&usize::from(*slave))).ok_or_else(|| {
            if count == 0 {
                return word.wrong("no slave of this network", "none, the network has no slaves");
            }
            word.wrong("no slave of this network", &format!("a number from 1 to {count}"))
        })
    }

    /// Reads a slave, from 1, and returns it with the index of one of its axes, from 0. `2.1` names an axis; `2` alone names
    /// the first one.
    pub(super) fn axis(&mut self) -> Result<(u8, usize), LineError> {
        self.part(SlaveModel::axes, "axis", "a drive")
    }

    /// Like [`Self::axis`], but only for an axis with a motor that can be jammed: a pulse module has axes and no motors.
    pub(super) fn motor(&mut self) -> Result<(u8, usize), LineError> {
        self.part(SlaveModel::motors, "axis", "a motor")
    }

    /// Reads a slave, from 1, and returns it with the index of one of its channels of digital inputs, from 0.
    pub(super) fn channel(&mut self) -> Result<(u8, usize), LineError> {
        self.part(SlaveModel::channels, "channel", "digital inputs")
    }

    /// Reads the number of a slave and of one of its axes or channels, such as `2.1`. Returns the slave, from 1, and
    /// the index of the axis or channel, from 0. `parts` returns how many axes or channels a model has; For error
    /// messages, `name` is "axis" or "channel", and `has` is what a slave needs to have one.
    fn part(&mut self, parts: fn(SlaveModel) -> usize, name: &str, has: &str) -> Result<(u8, usize), LineError> {
        let word = self.words.need("SLAVE", &self.form)?;
        let (slave, part) = word.text.split_once('.').unwrap_or((word.text, "1"));
        let slave = self.slave_of(word, slave)?;
        let model = self.slaves[usize::from(slave) - 1].model;
        let count = parts(model);
        let part = whole(part).and_then(|part| usize::try_from(part).ok()).filter(|part| (1..=count).contains(part));
        let allowed = match count {
            0 => format!("a slave with {has}; slave {slave} is {}", model.with_article()),
            1 => format!("{slave}, slave {slave} has one {name}"),
            n => format!("{slave}.1 to {slave}.{n}"),
        };
        part.map(|part| (slave, part - 1)).ok_or_else(|| word.wrong(&format!("no {name}"), &allowed))
    }

    pub(super) fn input(&mut self) -> Result<Input, LineError> {
        self.one_of("INPUT", "input", INPUTS)
    }

    pub(super) fn on_or_off(&mut self) -> Result<bool, LineError> {
        self.one_of("on|off", "value", [("on", true), ("off", false)])
    }

    /// Takes the next word, which must be one of `words`. For error messages, `form` is the placeholder of this operand in the
    /// syntax of the verb, and `name` describes the value.
    fn one_of<T: Copy, const N: usize>(
        &mut self,
        form: &str,
        name: &str,
        words: [(&'static str, T); N],
    ) -> Result<T, LineError> {
        let word = self.words.need(form, &self.form)?;
        let found = words.iter().find(|(text, _)| *text == word.text).map(|(_, meaning)| *meaning);
        found.ok_or_else(|| word.unknown(name, &words.map(|(text, _)| text)))
    }

    /// Reads the bit pattern to which digital inputs are forced: `inputs BITS`, or `walk TIME`.
    pub(super) fn pattern(&mut self) -> Result<InputPattern, LineError> {
        let word = self.words.need("inputs|walk", &self.form)?;
        match word.text {
            "inputs" => number(self.words, "BITS", &self.form, 0, 0xFFFF).map(|bits| InputPattern::Bits(bits as u16)),
            "walk" => {
                let word = self.words.peek();
                match (time(self.words, &self.form)?, word) {
                    (0, Some(word)) => Err(word.wrong("no TIME", "a time that is longer than 0")),
                    (step_ns, _) => Ok(InputPattern::Walk { step_ns }),
                }
            }
            _ => Err(word.unknown("pattern", &["inputs", "walk"])),
        }
    }

    pub(super) fn state(&mut self) -> Result<AlState, LineError> {
        self.one_of("STATE", "state", AL_STATES)
    }

    /// Reads the AL status code with which a slave refuses a state; [`AlStatus::INVALID_CHANGE`] \[OURS] if none is given.
    pub(super) fn al_status(&mut self) -> Result<AlStatus, LineError> {
        match self.words.peek() {
            None => Ok(AlStatus::INVALID_CHANGE),
            Some(word) if word.text == "for" => Ok(AlStatus::INVALID_CHANGE),
            Some(_) => number(self.words, "AL_STATUS", &self.form, 1, 0xFFFF).map(|code| AlStatus(code as u16)),
        }
    }

    pub(super) fn abort_code(&mut self) -> Result<AbortCode, LineError> {
        number(self.words, "CODE", &self.form, 1, u32::MAX.into()).map(|code| AbortCode(code as u32))
    }

    /// Takes the next word if it names an object (`INDEX:SUB`).
    pub(super) fn object(&mut self) -> Result<Option<ObjectAddress>, LineError> {
        let Some(word) = self.words.peek().filter(|word| word.text.contains(':')) else { return Ok(None) };
        self.words.next();
        let parts = word.text.split_once(':');
        let index = parts.and_then(|(index, _)| u16::try_from(whole(index)?).ok());
        let sub = parts.and_then(|(_, sub)| u8::try_from(whole(sub)?).ok());
        let object = index.zip(sub).map(|(index, sub)| ObjectAddress::new(index, sub));
        object.map(Some).ok_or_else(|| word.wrong("no object", "index and subindex, such as 0x6098:0"))
    }
}
