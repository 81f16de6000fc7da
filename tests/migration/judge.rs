//! Whether the slaves of two machines were sent the same outputs, except for the differences that the table allows.
//!
//! Compared, slave by slave, are the outputs it was sent, without repeats, so that latency and idle cycles make no
//! difference. A target counts if its axis acts on it: an axis that is off or homes gets its actual position, whose age
//! depends on the bus (the rows `latency` and `hold`).

use ecmsk::fieldbus::MAX_AXES;

use crate::tap::{Row, Took};

/// Which of a slave's outputs have to be equal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// All of them.
    Same,
    /// All but that many in a row: a motion was ended by the program or by an event that the program saw, and until
    /// then that many more cycles passed than on the other machine (the rows `clear`, `loss` and `latency`).
    CutBy(usize),
    /// The last ones: the axis starts at the position where such an end has left it.
    EndsAlike,
}

/// Controlword, outputs and, if it counts, target of each axis.
type Said = [(u16, u16, Option<i32>); MAX_AXES];

fn said(took: &Took) -> Said {
    std::array::from_fn(|axis| {
        let out = &took.axes[axis];
        (out.controlword.0, out.outputs, took.follows[axis].then_some(out.target))
    })
}

/// Outputs the slave at that place was sent, without repeats.
fn spoken(rows: &[Row], place: usize) -> Vec<Said> {
    let mut spoken: Vec<Said> = rows.iter().filter_map(|row| row[place].as_ref()).map(said).collect();
    spoken.dedup();
    spoken
}

/// Compares the outputs that a slave was sent on two machines.
///
/// # Errors
/// How they differ.
pub fn same(a: &[Row], b: &[Row], slave: usize, rule: Rule) -> Result<(), String> {
    let [a, b] = [a, b].map(|rows| spoken(rows, slave - 1));
    let alike = a.iter().zip(&b).take_while(|(a, b)| a == b).count();
    if alike == a.len() && alike == b.len() {
        return Ok(());
    }
    let [rest_a, rest_b] = [&a[alike..], &b[alike..]];
    let behind = rest_a.iter().rev().zip(rest_b.iter().rev()).take_while(|(a, b)| a == b).count();
    let differ = rest_a.len().max(rest_b.len()) - behind;
    let holds = match rule {
        Rule::Same => false,
        Rule::CutBy(most) => differ <= most,
        Rule::EndsAlike => a.last() == b.last(),
    };
    if holds {
        return Ok(());
    }
    let part = |all: &[Said]| format!("{:?}", &all[alike.saturating_sub(2)..all.len().min(alike + 6)]);
    Err(format!(
        "slave {slave} was sent something else ({rule:?}) after {alike} of {} and {}, {differ} differ:\n  {}\n  {}",
        a.len(),
        b.len(),
        part(&a),
        part(&b)
    ))
}

/// Whether targets that were sent together on one machine were sent together on the other: those of these axes, slave and
/// axis, in the cycles in which all of them act.
///
/// # Errors
/// How they differ.
pub fn together(a: &[Row], b: &[Row], axes: &[(usize, usize)]) -> Result<(), String> {
    let [a, b] = [a, b].map(|rows| {
        let targets = |row: &Row| {
            let target = |(slave, axis): &(usize, usize)| {
                let took = row[slave - 1].as_ref()?;
                took.follows[*axis].then_some(took.axes[*axis].target)
            };
            axes.iter().map(target).collect::<Option<Vec<i32>>>()
        };
        let mut targets: Vec<Vec<i32>> = rows.iter().filter_map(targets).collect();
        targets.dedup();
        targets
    });
    let alike = a.iter().zip(&b).take_while(|(a, b)| a == b).count();
    if alike == a.len() && alike == b.len() {
        return Ok(());
    }
    let part = |all: &[Vec<i32>]| format!("{:?}", &all[alike.saturating_sub(2)..all.len().min(alike + 4)]);
    Err(format!(
        "axes {axes:?} did not move together after {alike} of {} and {}:\n  {}\n  {}",
        a.len(),
        b.len(),
        part(&a),
        part(&b)
    ))
}

/// Cycles of a motion, from 0, in which an axis got the previous cycle's target again.
pub fn repeats(rows: &[Row], slave: usize, axis: usize) -> Vec<usize> {
    let targets: Vec<i32> = rows
        .iter()
        .filter_map(|row| row[slave - 1].as_ref())
        .filter(|took| took.follows[axis])
        .map(|took| took.axes[axis].target)
        .collect();
    let changes = |pair: &[i32]| pair[0] != pair[1];
    let first = targets.windows(2).position(changes);
    let last = targets.windows(2).rposition(changes);
    match (first, last) {
        (Some(first), Some(last)) => {
            let motion = targets[first..=last + 1].windows(2).enumerate();
            motion.filter(|(_, pair)| !changes(pair)).map(|(cycle, _)| cycle).collect()
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use ecmsk::cia402::Controlword;
    use ecmsk::fieldbus::AxisOut;

    use super::*;

    fn rows(targets: &[i32]) -> Vec<Row> {
        let row = |target: &i32| {
            let mut axes = [AxisOut::default(); MAX_AXES];
            axes[0] = AxisOut { controlword: Controlword::ENABLE_OPERATION, target: *target, outputs: 0 };
            vec![Some(Took { axes, follows: [true, false] })]
        };
        targets.iter().map(row).collect()
    }

    /// Without this test a comparison that accepts every difference would pass unnoticed.
    #[test]
    fn the_judge_sees_what_differs() {
        let way = rows(&[1, 2, 3, 4, 5, 6]);
        let repeated = rows(&[1, 1, 2, 3, 3, 3, 4, 5, 6]);
        assert_eq!(same(&way, &repeated, 1, Rule::Same), Ok(()));
        assert_eq!((repeats(&way, 1, 0), repeats(&repeated, 1, 0)), (vec![], vec![2, 3]));
        for other in [&[1, 2, 4, 5, 6][..], &[1, 2, 3, 5, 4, 6], &[1, 2, 3, 4, 5], &[1, 2, 3, 4, 3, 4, 5, 6]] {
            let other = rows(other);
            assert!(same(&way, &other, 1, Rule::Same).is_err());
            assert!(same(&way, &other, 1, Rule::CutBy(2)).is_ok());
            assert!(together(&way, &other, &[(1, 0)]).is_err());
        }
        assert!(same(&way, &rows(&[1, 2]), 1, Rule::CutBy(3)).is_err());
        assert!(same(&way, &rows(&[9, 8, 6]), 1, Rule::EndsAlike).is_ok());
        assert!(same(&way, &rows(&[1, 2, 3, 4, 5, 7]), 1, Rule::EndsAlike).is_err());
    }
}
