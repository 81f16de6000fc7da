//! Programs that stall while their end stops the axes.

use std::ops::AddAssign;
use std::sync::{Arc, Mutex};

use ecmsk::coe::ObjectAddress;
use ecmsk::ethercat::Ns;
use support::dice::Dice;
use support::schedules;

use super::ends::{LAST_TARGET, S, SPEED, moving, moving_in_csv, stands_and_is_off};
use super::{Exchange, Kept, POSITION, Wires, Xf};

/// Schedules of the test; more by `ECMSK_SOAK_SCHEDULES`.
const SCHEDULES: u64 = 16;
const MS: Ns = S / 1000;
/// The speed of an axis in CSP: 10 counts in a cycle of 1 ms.
const CSP_SPEED: i32 = 10_000;
/// How far an axis may be from its path, counts.
const LAG: i32 = 30;
/// A slave measures its position once in a cycle of 1 ms, which a look may come just before or after.
const CYCLES_PER_S: i32 = 1000;
/// Quick-stop deceleration, counts/s\u{b2}.
const QUICK_STOP_DECELERATION: ObjectAddress = ObjectAddress::new(0x6085, 0);

/// Totals of the schedules.
#[derive(Debug, Default)]
struct Done {
    stalls: u64,
    errors: u64,
}

impl AddAssign for Done {
    fn add_assign(&mut self, other: Self) {
        self.stalls += other.stalls;
        self.errors += other.errors;
    }
}

/// Times, and the positions of both axes.
type Track = Arc<Mutex<Vec<(Ns, [i32; 2])>>>;

fn look(chip: &Kept, track: &Track) {
    let positions = [0, 1].map(|slave| chip.object(slave, POSITION) as i32);
    track.lock().unwrap().push((Wires::now(chip), positions));
}

/// Ends the program, which stalls before some exchanges.
fn end(seed: u64, xf: Xf<Kept>, chip: &Kept) -> (Track, Done) {
    let (track, stalls) = (Track::default(), Arc::<Mutex<u64>>::default());
    let (seen, stood, own) = (Arc::clone(&track), Arc::clone(&stalls), chip.clone());
    let mut dice = Dice(seed ^ 0x7866_7374_616C_6C73);
    let (mut left, rarely) = (1 + dice.below(3), dice.pick(&[3, 10, 40]));
    look(chip, &track);
    chip.behaves(move |_, _| {
        if left > 0 && dice.one_in(rarely) {
            left -= 1;
            *stood.lock().unwrap() += 1;
            let most = dice.pick(&[20, 200, 1200, 5000]);
            for _ in 0..dice.below(most) {
                own.alone(MS);
                look(&own, &seen);
            }
        }
        look(&own, &seen);
        Exchange::Passes
    });
    // With an error as well, all steps of the stop were tried.
    let ended = xf.close();
    chip.behaves(|_, _| Exchange::Passes);
    let stalls = *stalls.lock().unwrap();
    (track, Done { stalls, errors: ended.is_err().into() })
}

fn schedule(seed: u64) -> Done {
    let is_csv = seed % 2 == 1;
    let (xf, chip) = if is_csv {
        moving_in_csv()
    } else {
        let (xf, chip, _) = moving();
        (xf, chip)
    };
    let speed = if is_csv { SPEED } else { CSP_SPEED };
    let deceleration = f64::from(chip.object(0, QUICK_STOP_DECELERATION));
    let (track, done) = end(seed, xf, &chip);
    stands_and_is_off(&chip);
    look(&chip, &track);

    let track = track.lock().unwrap();
    for pair in track.windows(2) {
        let [(began, before), (ended, after)] = [pair[0], pair[1]];
        for axis in 0..2 {
            let way = after[axis] - before[axis];
            let most = (f64::from(speed) * (ended - began) as f64 / 1e9) as i32 + speed / CYCLES_PER_S + LAG;
            assert!((-2..=most).contains(&way), "axis {axis}: {way} counts in {} ns", ended - began);
        }
    }
    let ramp = (f64::from(speed).powi(2) / (2.0 * deceleration)) as i32;
    for at in track.last().expect("positions").1.into_iter().filter(|_| !is_csv) {
        assert!(at <= LAST_TARGET + ramp + LAG, "at {at}, with a ramp of {ramp} counts");
    }
    done
}

/// XF-17.10 A program that stalls for up to 5 s before any exchange of its end: no axis turns round or gets faster, none
/// goes further beyond its last target than its quick stop takes, and in the end all are at rest and off.
#[test]
fn an_end_that_stalls() {
    let (schedules, Done { stalls, .. }) = schedules::run_all("xf_api", "an_end_that_stalls", SCHEDULES, schedule);
    assert!(stalls >= schedules / 2, "only {stalls} of {schedules}");
}
