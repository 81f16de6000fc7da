//! The verbs of a script. The table `VERBS` defines them for the parser and for the text of `ecmsk link help`. A new
//! verb is a new element of this table, and its action is in `run.rs`. A verb for a fault inside a slave makes a
//! [`Fault`].

use std::num::NonZeroU16;

use super::reader::Reader;
use super::run::{ScriptAction, ScriptOrigin, Step};
use super::words::{LineError, Word, Words, number, time};
use crate::address::slaves::SlaveSpec;
use crate::slave::cable::Noise;
use crate::slave::{DeviceFault, Fault};

/// A verb of scripts, an element of the table [`VERBS`].
struct Verb {
    name: &'static str,
    /// The syntax of the verb's operands.
    form: &'static str,
    meaning: &'static str,
    lasts: Lasts,
    /// Reads the operands. After `end` the verb has only a slave as its operand ([`Reader::ends`]).
    read: fn(&mut Reader) -> Result<ScriptAction, LineError>,
}

/// How long the effect of a line of a script lasts, for example a jam or an alarm.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Lasts {
    /// `end` does not accept the verb: its effect is immediate, or the same verb changes it again.
    Never,
    /// The effect lasts until `end` with the verb.
    UntilEnd,
    /// The effect lasts until `end`, or for the time that the line gives with `for`.
    ForTime,
}

/// The origins of times, by the word after `from`.
const ORIGINS: [(&str, ScriptOrigin); 3] =
    [("start", ScriptOrigin::Start), ("frame", ScriptOrigin::Frame), ("op", ScriptOrigin::Op)];

const VERBS: &[Verb] = &[
    Verb {
        name: "alarm",
        form: "SLAVE[.AXIS] CODE [stays]",
        meaning: "a fault with that error code (0x603F); stays: no fault reset clears it before `end alarm`",
        lasts: Lasts::UntilEnd,
        read: |line| {
            let (slave, axis) = line.axis()?;
            if line.ends {
                return Ok(ScriptAction::Fault { slave, fault: Fault::AlarmCauseEnds { axis } });
            }
            let code = number(line.words, "CODE", &line.form, 1, 0xFFFF)? as u16;
            let resettable = !line.words.take("stays");
            Ok(ScriptAction::Fault { slave, fault: Fault::Alarm { axis, fault: DeviceFault { code, resettable } } })
        },
    },
    Verb {
        name: "cut",
        form: "SLAVE",
        meaning: "the cable is cut before that slave; before the first one no cycle passes any more",
        lasts: Lasts::ForTime,
        read: |line| {
            if line.ends { Ok(ScriptAction::Cut(None)) } else { Ok(ScriptAction::Cut(Some(line.slave()? - 1))) }
        },
    },
    Verb {
        name: "heal",
        form: "",
        meaning: "the cable is whole again, as with `end cut`",
        lasts: Lasts::Never,
        read: |_| Ok(ScriptAction::Cut(None)),
    },
    Verb {
        name: "noise",
        form: "SLAVE N",
        meaning: "the cable before that slave damages one of N frames, by turns out and back (one cable at a time); for \
                  `ecmsk bus` and `ecmsk serve ethercat`, whose slaves have frames",
        lasts: Lasts::ForTime,
        read: |line| {
            let slave = line.slave()?;
            let one_of = if line.ends { 0 } else { number(line.words, "N", &line.form, 1, 0xFFFF)? as u16 };
            Ok(ScriptAction::Noise(NonZeroU16::new(one_of).map(|one_of| Noise { slave, one_of })))
        },
    },
    Verb {
        name: "mute",
        form: "SLAVE",
        meaning: "a slave answers nothing, while frames still pass it",
        lasts: Lasts::ForTime,
        read: |line| Ok(ScriptAction::Mute { slave: line.slave()?, mute: true }),
    },
    Verb {
        name: "refuse",
        form: "SLAVE STATE [AL_STATUS]",
        meaning: "a slave does not enter init, preop, safeop or op, with that AL status code (0x0011 if none is given)",
        lasts: Lasts::ForTime,
        read: |line| {
            let slave = line.slave()?;
            let state = if line.ends { None } else { Some((line.state()?, line.al_status()?)) };
            Ok(ScriptAction::Refuse { slave, state })
        },
    },
    Verb {
        name: "sdo-delay",
        form: "SLAVE TIME",
        meaning: "SDO transfers with a slave take that much longer",
        lasts: Lasts::ForTime,
        read: |line| {
            let slave = line.slave()?;
            Ok(ScriptAction::SdoDelay { slave, ns: if line.ends { 0 } else { time(line.words, &line.form)? } })
        },
    },
    Verb {
        name: "sdo-abort",
        form: "SLAVE [INDEX:SUB] CODE",
        meaning: "a slave aborts every SDO transfer with that code, or those of one object (one of a slave at a time), \
                  e.g. 0x6098:0 0x06020000",
        lasts: Lasts::ForTime,
        read: |line| {
            let slave = line.slave()?;
            let abort = if line.ends { None } else { Some((line.object()?, line.abort_code()?)) };
            Ok(ScriptAction::SdoAbort { slave, abort })
        },
    },
    Verb {
        name: "lose",
        form: "SLAVE",
        meaning: "a slave loses its power: it falls to Init and answers nothing, while frames still pass it",
        lasts: Lasts::ForTime,
        read: |line| Ok(ScriptAction::Lose { slave: line.slave()?, lost: true }),
    },
    Verb {
        name: "find",
        form: "SLAVE",
        meaning: "a slave has power again: it answers, in Init, as with `end lose`",
        lasts: Lasts::Never,
        read: |line| Ok(ScriptAction::Lose { slave: line.slave()?, lost: false }),
    },
    Verb {
        name: "stick",
        form: "SLAVE[.AXIS] INPUT on|off",
        meaning: "an input of an axis sticks: negative-limit, positive-limit, home or index (no pulse comes any more); \
                  `end stick` frees all of the axis",
        lasts: Lasts::ForTime,
        read: |line| {
            let (slave, axis) = line.axis()?;
            let stuck = if line.ends { None } else { Some((line.input()?, line.on_or_off()?)) };
            let (input, value) = (stuck.map(|(input, _)| input), stuck.map(|(_, on)| on));
            Ok(ScriptAction::Fault { slave, fault: Fault::Stick { axis, input, value } })
        },
    },
    Verb {
        name: "jam",
        form: "SLAVE",
        meaning: "the shaft of a drive or a step is jammed: it stands whatever the torque, and a following error comes",
        lasts: Lasts::ForTime,
        read: |line| {
            let (slave, axis) = line.motor()?;
            Ok(ScriptAction::Fault { slave, fault: Fault::Jam { axis, jammed: true } })
        },
    },
    Verb {
        name: "io",
        form: "SLAVE[.CHANNEL] inputs BITS|walk TIME",
        meaning: "digital inputs of an io or hsp are forced, instead of being wired to the outputs, and SI1 to SI4 of a \
                  dp3cl: to BITS, bit k is input k, or one after the other for TIME each",
        lasts: Lasts::ForTime,
        read: |line| {
            let (slave, channel) = line.channel()?;
            let pattern = if line.ends { None } else { Some(line.pattern()?) };
            Ok(ScriptAction::Fault { slave, fault: Fault::ForceInputs { channel, pattern } })
        },
    },
    Verb {
        name: "silent",
        form: "",
        meaning: "the board makes no reports, while everything else goes on",
        lasts: Lasts::ForTime,
        read: |_| Ok(ScriptAction::Silent(true)),
    },
    Verb {
        name: "full",
        form: "",
        meaning: "the board takes nothing out of its FIFO, so that it fills and full counts rise",
        lasts: Lasts::ForTime,
        read: |_| Ok(ScriptAction::Full(true)),
    },
    Verb {
        name: "inputs",
        form: "BITS",
        meaning: "the six inputs of the chip, bit k is input k",
        lasts: Lasts::Never,
        read: |line| Ok(ScriptAction::Inputs(number(line.words, "BITS", &line.form, 0, 0x3F)? as u8)),
    },
];

/// The section of `ecmsk link help` on scripts.
pub(crate) fn help() -> String {
    let mut text = String::from(
        "A script (script=FILE) is one event a line, at board time since the link was opened; # begins a comment:\n\n    \
         [at TIME] VERB .. [for TIME]      for example  at 3s cut 2 for 500ms\n    \
         [at TIME] end VERB [SLAVE]        takes back what lasts\n\n\
         For slaves on a network interface (`ecmsk serve ethercat`) times count from its start, and below a line\n\n    \
         from frame                        from the first frame of a master\n    \
         from op                           from when the first slave is in OP\n\n\
         Times are numbers with us, ms, s, min or h. Those of warnings count from when the board was opened, as `at` does. \
         Verbs:\n",
    );
    for verb in VERBS {
        let lasts = if verb.lasts == Lasts::ForTime { " [for TIME]" } else { "" };
        text.push_str(&format!("  {}{lasts}\n      {}\n", form(verb), verb.meaning));
    }
    text
}

/// The syntax of the verb with its operands.
fn form(verb: &Verb) -> String {
    format!("{} {}", verb.name, verb.form).trim_end().to_owned()
}

/// Adds the steps of one line to `steps`: none for an empty line, two for a line with `for`, otherwise one. A line `from` adds
/// none and sets the origin for the following lines.
pub(super) fn parse_line(
    line: u32,
    text: &str,
    slaves: &[SlaveSpec],
    from: &mut ScriptOrigin,
    steps: &mut Vec<Step>,
) -> Result<(), LineError> {
    let mut words = Words::of(text);
    if words.peek().is_none() {
        return Ok(());
    }
    if words.take("from") {
        *from = origin(&mut words)?;
        return Ok(());
    }
    let at = if words.take("at") { time(&mut words, "at TIME VERB ..")? } else { 0 };
    let ends = words.take("end");
    let word = words.need("VERB", &names(ends).join(", "))?;
    let verb = VERBS.iter().find(|verb| verb.name == word.text && (verb.lasts != Lasts::Never || !ends));
    let verb = verb.ok_or_else(|| unknown_verb(word, ends))?;
    let form = match (ends, verb.lasts) {
        (false, Lasts::ForTime) => format!("{} [for TIME]", form(verb)),
        (false, _) => form(verb),
        (true, _) => match verb.form.split(' ').next() {
            Some(slave) if slave.starts_with("SLAVE") && verb.name != "cut" => format!("end {} {slave}", verb.name),
            _ => format!("end {}", verb.name),
        },
    };
    let mut reader = Reader { words: &mut words, slaves, form: form.clone(), ends };
    let action = (verb.read)(&mut reader)?;
    let action = if ends { action.undo() } else { action };
    let lasts = verb.lasts == Lasts::ForTime && !ends && words.take("for");
    let end = if lasts { Some(at + time(&mut words, &form)?) } else { None };
    if let Some(word) = words.next() {
        return Err(word.wrong("too much", &form));
    }
    let step = Step { from: *from, at, line, verb: verb.name, action, ended: ends };
    steps.push(step);
    steps.extend(end.map(|at| Step { at, action: action.undo(), ended: true, ..step }));
    Ok(())
}

/// Reads the origin after the word `from`.
fn origin(words: &mut Words) -> Result<ScriptOrigin, LineError> {
    let form = format!("from {}", ORIGINS.map(|(name, _)| name).join("|"));
    let word = words.need("start|frame|op", &form)?;
    let found = ORIGINS.iter().find(|(name, _)| *name == word.text).map(|(_, origin)| *origin);
    let origin = found.ok_or_else(|| word.unknown("moment", &ORIGINS.map(|(name, _)| name)))?;
    words.next().map_or(Ok(origin), |word| Err(word.wrong("too much", &form)))
}

/// The names of all verbs, or only of the verbs that `end` accepts.
pub(super) fn names(ends: bool) -> Vec<&'static str> {
    VERBS.iter().filter(|verb| verb.lasts != Lasts::Never || !ends).map(|verb| verb.name).collect()
}

fn unknown_verb(word: Word, ends: bool) -> LineError {
    if ends {
        word.unknown("verb that `end` ends", &names(true))
    } else {
        let mut known = vec!["at", "end", "from"];
        known.extend(names(false));
        word.unknown("verb", &known)
    }
}
