//! The verbs of a script: the one table that lines are read by and the help is made from.

use super::run::{Deed, Step};
use super::words::{Word, Words, Wrong, number, time, whole};
use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::AlState;
use crate::link::slaves::SlaveSpec;
use crate::slave::{AlStatus, DeviceFault};

/// One verb.
struct Verb {
    name: &'static str,
    /// What stands behind it.
    form: &'static str,
    meaning: &'static str,
    /// It holds until it ends, so that `for` and `end` make sense.
    lasts: bool,
    /// Reads what stands behind it, or what stands behind `end` and it.
    read: fn(&mut Reader) -> Result<Deed, Wrong>,
}

/// Reads the words behind a verb.
struct Reader<'a, 'b> {
    words: &'b mut Words<'a>,
    slaves: &'b [SlaveSpec],
    form: String,
    /// `end` stood before the verb: what says how is left out.
    ends: bool,
}

const VERBS: &[Verb] = &[
    Verb {
        name: "alarm",
        form: "SLAVE[.AXIS] CODE [stays]",
        meaning: "a fault with that error code (0x603F); stays: no fault reset clears it",
        lasts: false,
        read: |line| {
            let (slave, axis) = line.axis()?;
            let code = number(line.words, "CODE", &line.form, 1, 0xFFFF)? as u16;
            let resettable = !line.words.take("stays");
            Ok(Deed::Alarm { slave, axis, fault: DeviceFault { code, resettable } })
        },
    },
    Verb {
        name: "cut",
        form: "SLAVE",
        meaning: "the cable is cut before that slave; before the first one no cycle passes any more",
        lasts: true,
        read: |line| if line.ends { Ok(Deed::Cut(None)) } else { Ok(Deed::Cut(Some(line.slave()? - 1))) },
    },
    Verb {
        name: "heal",
        form: "",
        meaning: "the cable is whole again, as with `end cut`",
        lasts: false,
        read: |_| Ok(Deed::Cut(None)),
    },
    Verb {
        name: "mute",
        form: "SLAVE",
        meaning: "a slave answers nothing, while frames still pass it",
        lasts: true,
        read: |line| Ok(Deed::Mute { slave: line.slave()?, mute: true }),
    },
    Verb {
        name: "refuse",
        form: "SLAVE STATE [AL_STATUS]",
        meaning: "a slave does not enter init, preop, safeop or op, with that AL status code (0x0011 if none is given)",
        lasts: true,
        read: |line| {
            let slave = line.slave()?;
            let state = if line.ends { None } else { Some((line.state()?, line.al_status()?)) };
            Ok(Deed::Refuse { slave, state })
        },
    },
    Verb {
        name: "sdo-delay",
        form: "SLAVE TIME",
        meaning: "SDO transfers with a slave take that much longer",
        lasts: true,
        read: |line| {
            let slave = line.slave()?;
            Ok(Deed::SdoDelay { slave, ns: if line.ends { 0 } else { time(line.words, &line.form)? } })
        },
    },
    Verb {
        name: "sdo-abort",
        form: "SLAVE [INDEX:SUB] CODE",
        meaning: "a slave aborts every SDO transfer with that code, or those of one object (one of a slave at a time), \
                  e.g. 0x6098:0 0x06020000",
        lasts: true,
        read: |line| {
            let slave = line.slave()?;
            let abort = if line.ends { None } else { Some((line.object()?, line.abort_code()?)) };
            Ok(Deed::SdoAbort { slave, abort })
        },
    },
    Verb {
        name: "silent",
        form: "",
        meaning: "the board makes no reports, while everything else goes on",
        lasts: true,
        read: |_| Ok(Deed::Silent(true)),
    },
    Verb {
        name: "full",
        form: "",
        meaning: "the board takes nothing out of its FIFO, so that it fills and full counts rise",
        lasts: true,
        read: |_| Ok(Deed::Full(true)),
    },
    Verb {
        name: "inputs",
        form: "BITS",
        meaning: "the six inputs of the chip, bit k is input k",
        lasts: false,
        read: |line| Ok(Deed::Inputs(number(line.words, "BITS", &line.form, 0, 0x3F)? as u8)),
    },
];

const AL_STATES: [(&str, AlState); 4] =
    [("init", AlState::Init), ("preop", AlState::PreOp), ("safeop", AlState::SafeOp), ("op", AlState::Op)];

/// The verbs, for `ecmsk link help`.
pub(crate) fn help() -> String {
    let mut text = String::from(
        "A script (script=FILE) is one event a line, at board time since the link was opened; # begins a comment:\n\n    \
         [at TIME] VERB .. [for TIME]      for example  at 3s cut 2 for 500ms\n    \
         [at TIME] end VERB [SLAVE]        takes back what lasts\n\n\
         Times are numbers with us, ms, s, min or h. Verbs:\n",
    );
    for verb in VERBS {
        let lasts = if verb.lasts { " [for TIME]" } else { "" };
        text.push_str(&format!("  {}{lasts}\n      {}\n", form(verb), verb.meaning));
    }
    text
}

fn form(verb: &Verb) -> String {
    format!("{} {}", verb.name, verb.form).trim_end().to_owned()
}

/// Reads a line into its steps: none, one, or one and its end.
pub(super) fn line(line: u32, text: &str, slaves: &[SlaveSpec], steps: &mut Vec<Step>) -> Result<(), Wrong> {
    let mut words = Words::of(text);
    if words.peek().is_none() {
        return Ok(());
    }
    let at = if words.take("at") { time(&mut words, "at TIME VERB ..")? } else { 0 };
    let ends = words.take("end");
    let word = words.need("VERB", &names(ends).join(", "))?;
    let verb = VERBS.iter().find(|verb| verb.name == word.text && (verb.lasts || !ends));
    let verb = verb.ok_or_else(|| unknown_verb(word, ends))?;
    let form = match (ends, verb.lasts) {
        (false, true) => format!("{} [for TIME]", form(verb)),
        (false, false) => form(verb),
        (true, _) if verb.form.starts_with("SLAVE") && verb.name != "cut" => format!("end {} SLAVE", verb.name),
        (true, _) => format!("end {}", verb.name),
    };
    let mut reader = Reader { words: &mut words, slaves, form: form.clone(), ends };
    let deed = (verb.read)(&mut reader)?;
    let deed = if ends { deed.end() } else { deed };
    let lasts = verb.lasts && !ends && words.take("for");
    let end = if lasts { Some(at + time(&mut words, &form)?) } else { None };
    if let Some(word) = words.next() {
        return Err(word.wrong("too much", &form));
    }
    steps.push(Step { at, line, verb: verb.name, deed, ended: ends });
    steps.extend(end.map(|at| Step { at, line, verb: verb.name, deed: deed.end(), ended: true }));
    Ok(())
}

fn names(ends: bool) -> Vec<&'static str> {
    VERBS.iter().filter(|verb| verb.lasts || !ends).map(|verb| verb.name).collect()
}

fn unknown_verb(word: Word, ends: bool) -> Wrong {
    if ends {
        word.unknown("verb that `end` ends", &names(true))
    } else {
        let mut known = vec!["at", "end"];
        known.extend(names(false));
        word.unknown("verb", &known)
    }
}

impl Reader<'_, '_> {
    fn slave(&mut self) -> Result<u8, Wrong> {
        let word = self.words.need("SLAVE", &self.form)?;
        self.slave_of(word, word.text)
    }

    fn slave_of(&self, word: Word, text: &str) -> Result<u8, Wrong> {
        let count = self.slaves.len();
        let slave = whole(text).and_then(|slave| u8::try_from(slave).ok());
        slave.filter(|slave| (1..=count).contains(&usize::from(*slave))).ok_or_else(|| {
            if count == 0 {
                return word.wrong("no slave of this network", "none, the network has no slaves");
            }
            word.wrong("no slave of this network", &format!("a number from 1 to {count}"))
        })
    }

    /// A slave and one of its axes, from 0.
    fn axis(&mut self) -> Result<(u8, usize), Wrong> {
        let word = self.words.need("SLAVE", &self.form)?;
        let (slave, axis) = word.text.split_once('.').unwrap_or((word.text, "1"));
        let slave = self.slave_of(word, slave)?;
        let model = self.slaves[usize::from(slave) - 1].model;
        let axes = model.axes();
        let axis = whole(axis).and_then(|axis| usize::try_from(axis).ok()).filter(|axis| (1..=axes).contains(axis));
        let allowed = match axes {
            0 => format!("a slave with a drive; slave {slave} is an {}", model.name()),
            1 => format!("{slave}, slave {slave} has one axis"),
            n => format!("{slave}.1 to {slave}.{n}"),
        };
        axis.map(|axis| (slave, axis - 1)).ok_or_else(|| word.wrong("no axis", &allowed))
    }

    fn state(&mut self) -> Result<AlState, Wrong> {
        let word = self.words.need("STATE", &self.form)?;
        let state = AL_STATES.iter().find(|(name, _)| *name == word.text).map(|(_, state)| *state);
        state.ok_or_else(|| word.unknown("state", &AL_STATES.map(|(name, _)| name)))
    }

    /// The code that a refusal comes with, [`AlStatus::INVALID_CHANGE`] \[OURS] if none is given.
    fn al_status(&mut self) -> Result<AlStatus, Wrong> {
        match self.words.peek() {
            None => Ok(AlStatus::INVALID_CHANGE),
            Some(word) if word.text == "for" => Ok(AlStatus::INVALID_CHANGE),
            Some(_) => number(self.words, "AL_STATUS", &self.form, 1, 0xFFFF).map(|code| AlStatus(code as u16)),
        }
    }

    fn abort_code(&mut self) -> Result<AbortCode, Wrong> {
        number(self.words, "CODE", &self.form, 1, u32::MAX.into()).map(|code| AbortCode(code as u32))
    }

    /// An object if one is named.
    fn object(&mut self) -> Result<Option<ObjectAddress>, Wrong> {
        let Some(word) = self.words.peek().filter(|word| word.text.contains(':')) else { return Ok(None) };
        self.words.next();
        let parts = word.text.split_once(':');
        let index = parts.and_then(|(index, _)| u16::try_from(whole(index)?).ok());
        let sub = parts.and_then(|(_, sub)| u8::try_from(whole(sub)?).ok());
        let object = index.zip(sub).map(|(index, sub)| ObjectAddress::new(index, sub));
        object.map(Some).ok_or_else(|| word.wrong("no object", "index and subindex, such as 0x6098:0"))
    }
}
