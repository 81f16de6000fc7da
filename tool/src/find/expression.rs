//! Parses the expressions of `ecmsk find`. A number is compared with a number, and conditions are joined by `and`, `or`
//! and `not`.

use ecmsk::machine_file::{MachineFile, Unit};
use ecmsk::sk::MasterState;

use super::condition::{Comparison, Condition, Flag, Leaf, Number, OfAxis, What};
use super::measure::{self, Measure};
use super::words::{COMPARISONS, FLAGS, OF_AXIS, unknown};
use crate::board::AxisWord;

/// \[OURS] The largest depth of nested parentheses and `not`, so that the recursive parser cannot overflow the stack.
const DEPTH_MAX: usize = 50;

/// An error in an expression, with its position.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("column {column} of the expression: {why}")]
pub struct ExpressionError {
    /// The position in the expression, in characters from 1.
    pub column: usize,
    /// What is wrong, and what to write.
    pub why: String,
}

/// Parses an expression. `machine` is needed for axes that are given by name.
///
/// # Errors
/// [`ExpressionError`] at the first position where the text is no expression, names an unknown axis, or compares
/// quantities of different kinds.
pub fn parse(text: &str, machine: Option<&MachineFile>) -> Result<Condition, ExpressionError> {
    let mut parser = Parser { text, at: 0, depth: 0, machine };
    let whole = parser.or()?;
    parser.skip_blanks();
    if parser.at < text.len() {
        return Err(parser.error(parser.at, "`and` or `or` is missing here, or this is too much".to_owned()));
    }
    parser.condition(whole)
}

/// A part of an expression, with its position in bytes.
struct Part {
    at: usize,
    is: Is,
}

enum Is {
    Condition(Condition),
    Number(Number),
}

struct Parser<'t> {
    text: &'t str,
    /// The position of the next character, in bytes.
    at: usize,
    depth: usize,
    machine: Option<&'t MachineFile>,
}

impl<'t> Parser<'t> {
    fn error(&self, at: usize, why: String) -> ExpressionError {
        ExpressionError { column: self.text[..at].chars().count() + 1, why }
    }

    fn rest(&self) -> &'t str {
        &self.text[self.at..]
    }

    fn skip_blanks(&mut self) {
        self.at = self.text.len() - self.rest().trim_start().len();
    }

    fn takes(&mut self, sign: &str) -> bool {
        self.skip_blanks();
        let takes = self.rest().starts_with(sign);
        self.at += if takes { sign.len() } else { 0 };
        takes
    }

    /// The word at the present position, which is not consumed; empty if there is no word.
    fn word(&mut self) -> &'t str {
        self.skip_blanks();
        let rest = self.rest();
        let is_first = rest.starts_with(|letter: char| letter.is_alphabetic() || letter == '_');
        let end = rest.find(|letter: char| !(letter.is_alphanumeric() || letter == '_')).unwrap_or(rest.len());
        if is_first { &rest[..end] } else { "" }
    }

    fn takes_word(&mut self, word: &str) -> bool {
        let takes = self.word().eq_ignore_ascii_case(word);
        self.at += if takes { word.len() } else { 0 };
        takes
    }

    fn condition(&self, part: Part) -> Result<Condition, ExpressionError> {
        match part.is {
            Is::Condition(condition) => Ok(condition),
            // `alarm(1)` alone is a state of the axis. In a comparison it is the error code.
            Is::Number(Number::Leaf(Leaf { what: What::OfAxis { quantity: OfAxis::Alarm, slave, .. }, .. })) => {
                Ok(Condition::Flag { flag: Flag::Fault, slave: Some(slave) })
            }
            Is::Number(_) => {
                Err(self.error(part.at, "this is a number; compare it, as in position(1) > 500".to_owned()))
            }
        }
    }

    fn number(&self, part: Part) -> Result<Number, ExpressionError> {
        match part.is {
            Is::Number(number) => Ok(number),
            Is::Condition(_) => {
                Err(self
                    .error(part.at, "this is true or false and no number; take it out of the comparison".to_owned()))
            }
        }
    }

    /// Parses conditions that are joined by `word`. `next` parses each of them, and `join` makes one condition of them.
    fn joined(
        &mut self,
        word: &str,
        next: fn(&mut Self) -> Result<Part, ExpressionError>,
        join: fn(Vec<Condition>) -> Condition,
    ) -> Result<Part, ExpressionError> {
        let first = next(self)?;
        if !self.takes_word(word) {
            return Ok(first);
        }
        let at = first.at;
        let mut all = vec![self.condition(first)?];
        loop {
            let part = next(self)?;
            all.push(self.condition(part)?);
            if !self.takes_word(word) {
                return Ok(Part { at, is: Is::Condition(join(all)) });
            }
        }
    }

    fn or(&mut self) -> Result<Part, ExpressionError> {
        self.joined("or", Self::and, Condition::Any)
    }

    fn and(&mut self) -> Result<Part, ExpressionError> {
        self.joined("and", Self::not, Condition::All)
    }

    fn not(&mut self) -> Result<Part, ExpressionError> {
        self.skip_blanks();
        let at = self.at;
        if !self.takes_word("not") {
            return self.comparison();
        }
        let part = self.deeper(Self::not)?;
        Ok(Part { at, is: Is::Condition(Condition::Not(Box::new(self.condition(part)?))) })
    }

    fn deeper(&mut self, read: fn(&mut Self) -> Result<Part, ExpressionError>) -> Result<Part, ExpressionError> {
        if self.depth == DEPTH_MAX {
            return Err(self.error(self.at, format!("nested deeper than {DEPTH_MAX}; write it with fewer parentheses")));
        }
        self.depth += 1;
        let part = read(self);
        self.depth -= 1;
        part
    }

    fn comparison(&mut self) -> Result<Part, ExpressionError> {
        let part = self.sum()?;
        let at = part.at;
        let Some(comparison) = self.comparison_sign() else { return Ok(part) };
        let mut left = self.number(part)?;
        let part = self.sum()?;
        let mut right = self.number(part)?;
        self.skip_blanks();
        let end = self.at;
        if self.comparison_sign().is_some() {
            return Err(self.error(end, "one comparison at a time; join two with `and`".to_owned()));
        }
        measure::settle(at, [&mut left, &mut right], self.machine).map_err(|(at, why)| self.error(at, why))?;
        Ok(Part { at, is: Is::Condition(Condition::Compare { left, comparison, right }) })
    }

    fn comparison_sign(&mut self) -> Option<Comparison> {
        COMPARISONS.into_iter().find(|(sign, _)| self.takes(sign)).map(|(_, comparison)| comparison)
    }

    fn sum(&mut self) -> Result<Part, ExpressionError> {
        let first = self.signed()?;
        let at = first.at;
        let mut sign = self.plus_or_minus();
        if sign.is_none() {
            return Ok(first);
        }
        let mut all = vec![(1.0, self.number(first)?)];
        while let Some(factor) = sign {
            let part = self.signed()?;
            all.push((factor, self.number(part)?));
            sign = self.plus_or_minus();
        }
        Ok(Part { at, is: Is::Number(Number::Sum(all)) })
    }

    fn plus_or_minus(&mut self) -> Option<f64> {
        let signs = [("+", 1.0), ("-", -1.0)];
        signs.into_iter().find(|(sign, _)| self.takes(sign)).map(|(_, factor)| factor)
    }

    fn signed(&mut self) -> Result<Part, ExpressionError> {
        self.skip_blanks();
        let at = self.at;
        if !self.takes("-") {
            return self.atom();
        }
        let part = self.deeper(Self::signed)?;
        Ok(Part { at, is: Is::Number(Number::Sum(vec![(-1.0, self.number(part)?)])) })
    }

    fn atom(&mut self) -> Result<Part, ExpressionError> {
        self.skip_blanks();
        let at = self.at;
        if self.takes("(") {
            let Part { is, .. } = self.inside()?;
            return Ok(Part { at, is });
        }
        if self.rest().starts_with(|letter: char| letter.is_ascii_digit() || letter == '.') {
            return self.literal();
        }
        let word = self.word();
        if word.is_empty() {
            let why = match self.rest().chars().next() {
                Some(letter) => format!("`{letter}` cannot stand here; write a quantity, as in position(1) > 500"),
                None => "it ends here; write a quantity, as in position(1) > 500".to_owned(),
            };
            return Err(self.error(at, why));
        }
        self.at += word.len();
        self.named(at, word)
    }

    /// Parses the expression between parentheses. The opening parenthesis was already consumed.
    fn inside(&mut self) -> Result<Part, ExpressionError> {
        let part = self.deeper(Self::or)?;
        if self.takes(")") { Ok(part) } else { Err(self.error(self.at, "`)` is missing; close each `(`".to_owned())) }
    }

    fn literal(&mut self) -> Result<Part, ExpressionError> {
        let (at, rest) = (self.at, self.rest());
        let end = rest.find(|letter: char| !(letter.is_ascii_alphanumeric() || letter == '.')).unwrap_or(rest.len());
        let hex = rest[..end].strip_prefix("0x").or_else(|| rest[..end].strip_prefix("0X"));
        let (len, value) = match hex {
            Some(digits) => (end, u32::from_str_radix(digits, 16).ok().map(f64::from)),
            None => {
                let end = rest.find(|letter: char| !(letter.is_ascii_digit() || letter == '.')).unwrap_or(rest.len());
                (end, rest[..end].parse().ok())
            }
        };
        let value = value.ok_or_else(|| self.error(at, format!("`{}` is no number", &rest[..end])))?;
        self.at += len;
        let measure = self.unit()?;
        let leaf = Leaf { at, what: What::Literal { value, measure }, divisor: 1.0 };
        Ok(Part { at, is: Is::Number(Number::Leaf(leaf)) })
    }

    /// The unit after a number, if there is one.
    fn unit(&mut self) -> Result<Option<Measure>, ExpressionError> {
        if self.takes("%") {
            return Ok(Some(Measure::Percent));
        }
        let word = self.word();
        if let Some(unit) = Unit::ALL.into_iter().find(|unit| unit.word() == word) {
            self.at += word.len();
            return Ok(Some(if self.takes("/s") { Measure::Speed(unit) } else { Measure::Distance(unit) }));
        }
        if word.is_empty() || ["and", "or"].iter().any(|other| word.eq_ignore_ascii_case(other)) {
            return Ok(None);
        }
        let units = Unit::ALL.map(Unit::word).join(", ");
        Err(self.error(self.at, format!("`{word}` is no unit; there are {units}, each with /s for speeds, and %")))
    }

    /// Interprets the word at the position `at`, which was already consumed.
    fn named(&mut self, at: usize, word: &str) -> Result<Part, ExpressionError> {
        let leaf = |what| Ok(Part { at, is: Is::Number(Number::Leaf(Leaf { at, what, divisor: 1.0 })) });
        let lower = word.to_lowercase();
        let states = [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op];
        if let Some(state) = states.into_iter().find(|state| state.name().eq_ignore_ascii_case(word)) {
            return leaf(What::StateWord(state.code()));
        }
        match &*lower {
            "state" => return leaf(What::State),
            "fifo" => return leaf(What::Fifo),
            "gap" => return Ok(Part { at, is: Is::Condition(Condition::Gap) }),
            "abs" => {
                if !self.takes("(") {
                    return Err(self.error(self.at, "`(` is missing; write abs(velocity(1))".to_owned()));
                }
                let part = self.inside()?;
                return Ok(Part { at, is: Is::Number(Number::Magnitude(Box::new(self.number(part)?))) });
            }
            _ => {}
        }
        let quantity = OF_AXIS.into_iter().find(|(name, _)| *name == lower).map(|(_, quantity)| quantity);
        let flag = FLAGS.into_iter().find(|(name, _)| *name == lower).map(|(_, flag)| flag);
        let axis = if quantity.is_some() || flag.is_some() { self.axis()? } else { None };
        match (quantity, flag, axis) {
            (Some(quantity), _, Some((slave, is_named))) => leaf(What::OfAxis { quantity, slave, is_named }),
            (Some(OfAxis::Alarm), _, None) => {
                Ok(Part { at, is: Is::Condition(Condition::Flag { flag: Flag::Fault, slave: None }) })
            }
            (Some(_), _, None) => {
                Err(self.error(at, format!("of which axis? write {lower}(1), or the name of an axis")))
            }
            (None, Some(flag), axis) => {
                let slave = axis.map(|(slave, _)| slave);
                Ok(Part { at, is: Is::Condition(Condition::Flag { flag, slave }) })
            }
            (None, None, _) => Err(self.error(at, unknown(word))),
        }
    }

    /// Parses the axis between parentheses. Returns its slave number, and whether it is given by its name. `None` if
    /// there are no parentheses.
    fn axis(&mut self) -> Result<Option<(u8, bool)>, ExpressionError> {
        if !self.takes("(") {
            return Ok(None);
        }
        self.skip_blanks();
        let (at, rest) = (self.at, self.rest());
        let Some(end) = rest.find(')') else {
            return Err(self.error(self.text.len(), "`)` is missing; close each `(`".to_owned()));
        };
        let word = AxisWord::parse(&rest[..end]).ok_or_else(|| {
            let name = rest[..end].trim();
            self.error(
                at,
                format!("`{name}` is no axis; write the number of a slave, 1 to 40, or a name of the machine file"),
            )
        })?;
        let slave = word.slave("find", self.machine).map_err(|error| {
            // The text of the error begins with the verb. It is removed, because here the column comes first.
            let text = error.to_string();
            self.error(at, text.strip_prefix("find: ").unwrap_or(&text).to_owned())
        })?;
        self.at += end + 1;
        Ok(Some((slave, word.is_name())))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::condition::Values;
    use super::*;
    use crate::motion::Quantity;

    /// Values in which axis 1 is at position 1000 with the target 1200, and nothing is known about other axes.
    struct Standing;

    impl Values for Standing {
        fn of_axis(&self, quantity: OfAxis, slave: u8) -> Option<i64> {
            let value = match quantity {
                OfAxis::Position => 1000,
                OfAxis::Target => 1200,
                OfAxis::Moving(Quantity::FollowingError) => -200,
                OfAxis::Moving(Quantity::Torque) => 355,
                OfAxis::Moving(Quantity::Velocity) => -40,
                OfAxis::Moving(Quantity::TargetStep) => 0,
                OfAxis::Alarm => 0x7500,
            };
            (slave == 1).then_some(value)
        }

        fn flag(&self, flag: Flag, slave: Option<u8>) -> Option<bool> {
            (slave != Some(2)).then_some(matches!(flag, Flag::Enabled | Flag::Fault))
        }

        fn state(&self) -> u8 {
            8
        }

        fn fifo(&self) -> Option<u16> {
            Some(152)
        }
    }

    fn holds(text: &str) -> Option<bool> {
        parse(text, None).unwrap_or_else(|error| panic!("{text}: {error}")).holds(&Standing, false)
    }

    /// `not` has a higher precedence than `and`, and `and` a higher one than `or`. Plus and minus have a higher
    /// precedence than comparisons.
    #[test]
    fn conditions_hold_as_they_are_written() {
        for text in [
            "position(1) > 500",
            "position( 1 )==1000",
            "target(1) - position(1) = 200",
            "1000 - 500 - 500 = 0 - 0 + position(1) - 1000",
            "-position(1) < -999",
            "following_error(1) > 199 and following_error(1) <= 200",
            "abs(velocity(1)) > 39 and velocity(1) < 0",
            "torque(1) > 35.4 and torque(1) < 35.6 %",
            "alarm(1) and alarm(1) == 0x7500 and alarm",
            "state == OP and state != safeop and state > PreOP",
            "fifo < 160",
            "homing or enabled and not homing",
            "not homing and enabled(1)",
            "not (homing or gap)",
            "NOT HOMING AND ENABLED",
            "((position(1)) > (500))",
        ] {
            assert_eq!(holds(text), Some(true), "{text}");
        }
        for text in ["enabled and homing or gap", "position(1) < 1000", "not not homing", "target_step(1) > 0"] {
            assert_eq!(holds(text), Some(false), "{text}");
        }
    }

    /// An unknown value makes a condition unknown, unless the known values alone decide the result.
    #[test]
    fn what_is_not_known_neither_holds_nor_fails() {
        for text in ["position(2) > 5", "not (position(2) > 5)", "enabled(2) and enabled(1)", "enabled(2) or homing"] {
            assert_eq!(holds(text), None, "{text}");
        }
        assert_eq!(holds("enabled(2) and homing(1)"), Some(false));
        assert_eq!(holds("enabled(2) or enabled(1)"), Some(true));
    }

    proptest! {
        /// Any text, however long, is either parsed or refused with a column inside the text.
        #[test]
        fn any_text_is_read_or_refused(text in "([a-z_]{1,8}|[0-9.x%]{1,4}|[()<>=!+-]|and|or|not|abs|position\\(1\\)|mm|/s| |\\PC){0,40}") {
            if let Err(error) = parse(&text, None) {
                prop_assert!((1..=text.chars().count() + 1).contains(&error.column), "{error}");
            }
        }
    }

    /// Long chains and deep nesting need no more stack than other expressions.
    #[test]
    fn long_expressions_are_no_deep_ones() {
        let long = ["fault"; 20_000].join(" or ");
        assert_eq!(holds(&long), Some(true));
        for deep in ["not ".repeat(20_000), "(".repeat(20_000), "-".repeat(20_000), "abs(".repeat(20_000)] {
            assert!(parse(&deep, None).unwrap_err().why.starts_with("nested deeper than"));
        }
    }
}
