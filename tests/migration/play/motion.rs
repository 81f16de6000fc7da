//! Motions: pacing of their frames, events in the middle, and recovery from these.

use super::*;
use crate::judge::Rule;

impl Player<'_> {
    /// Moves axes that stopped at the end of a motion to the position that the program has of them.
    pub(super) fn back(&mut self, slaves: &[usize]) {
        const FRAMES: i64 = 150;
        let starts: Vec<_> = slaves.iter().map(|slave| self.position(*slave)).collect();
        for n in 1..=FRAMES {
            let mut frame = Frame::new();
            for (slave, from) in slaves.iter().zip(&starts) {
                let goal = self.goals[slave - 1];
                let at = std::array::from_fn(|axis| {
                    let (from, goal) = (i64::from(from[axis]), i64::from(goal[axis]));
                    (from + (goal - from) * n / FRAMES) as i32
                });
                let unit = &self.plan.units[slave - 1];
                let at = if unit.is_csp() { at } else { [0; MAX_AXES] };
                frame.put_slave(self.plan.size, *slave, &command(unit, at).into());
            }
            self.paced(Pace::Ahead(60), n as u32);
            self.machine.send(|out, _| out.clone_from(&frame));
        }
        self.apart = None;
        let mut rules = vec![Rule::Same; self.plan.units.len()];
        slaves.iter().for_each(|slave| rules[slave - 1] = Rule::EndsAlike);
        self.end(&format!("back: {slaves:?}"), &rules);
    }

    /// Waits until the next frame may be sent.
    fn paced(&mut self, pace: Pace, frame: u32) {
        let waiting = |machine: &Machine| FIFO_ENTRIES - machine.answer().fifo_free.min(FIFO_ENTRIES);
        let room = |machine: &mut Machine, most: u16| {
            // Frames sent since the report do not show in it.
            if frame.is_multiple_of(8) {
                machine.fresh();
                machine.until("room", |machine| waiting(machine) + 8 <= most);
            }
        };
        match pace {
            Pace::Ahead(most) => room(&mut self.machine, most.max(16)),
            Pace::EachReport => {
                self.machine.read();
            }
            Pace::WithStalls(ms) => {
                room(&mut self.machine, 140);
                if frame % 100 == 99 {
                    self.machine.sleep(Duration::from_millis(ms));
                }
            }
            Pace::Threshold(_) => room(&mut self.machine, 100),
        }
    }

    pub(super) fn motion(&mut self, motion: &Motion, what: &str) {
        let Motion { slaves, frames, speed, pace, meanwhile } = motion;
        let units = &self.plan.units;
        if let Pace::Threshold(free) = *pace {
            self.machine.master(MasterCommand::SetFifo(FifoAction::Threshold(free)));
        }
        let starts: Vec<_> = slaves.iter().map(|slave| self.goals[slave - 1]).collect();
        let (mut way, half) = (0, frames / 2);
        for n in 1..=*frames {
            let step = speed_at(n, *frames, *speed);
            way += step;
            let targets = |unit: &Unit, start: [i32; MAX_AXES]| {
                if unit.is_csp() { start.map(|start| start + way) } else { [100 * step, 90 * step] }
            };
            let mut frame = Frame::new();
            for (slave, start) in slaves.iter().zip(&starts) {
                let unit = &units[slave - 1];
                let targets = targets(unit, *start);
                if (n, *meanwhile) == (half, Meanwhile::Alarm(*slave)) {
                    self.machine.log.trap(*slave, 0, targets[0], Fault::Alarm { axis: 0, fault: ALARM });
                }
                frame.put_slave(self.plan.size, *slave, &command(unit, targets).into());
            }
            if n == half {
                self.half_way(*meanwhile, &mut frame);
            } else if n % 40 == 3
                && let Meanwhile::Sdos(slave) = *meanwhile
            {
                let object = ObjectAddress::new(0x1018, 1 + (n / 40 % 3) as u8);
                frame.put_sdo(self.plan.size, &SdoCommand::Read { slave: slave as u8, object });
            }
            self.paced(*pace, n);
            self.machine.send(|out, _| out.clone_from(&frame));
            if (n, *meanwhile) == (half, Meanwhile::Clear) {
                self.machine.master(MasterCommand::SetFifo(FifoAction::Clear));
                break;
            }
        }
        for (slave, start) in slaves.iter().zip(starts) {
            self.goals[slave - 1] = start.map(|start| start + way);
        }
        self.after(motion, what);
    }

    /// The event in the middle of a motion.
    fn half_way(&mut self, meanwhile: Meanwhile, frame: &mut Frame) {
        let size = self.plan.size;
        match meanwhile {
            Meanwhile::On(slave) => frame.put_slave(size, slave, &SlaveCommand::ServoOn.into()),
            Meanwhile::Off(slave) => frame.put_slave(size, slave, &SlaveCommand::ServoOff.into()),
            Meanwhile::Lost(slave) => self.machine.network.lose(slave as u8),
            Meanwhile::LostAndBack(slave) => {
                let network = self.machine.network.clone();
                network.lose(slave as u8);
                self.machine.until("the loss", |machine| machine.answer().state.is_failed());
                network.find(slave as u8);
                self.machine.master(MasterCommand::SetState(MasterState::Op));
            }
            _ => {}
        }
    }

    /// Recovers from the event in the middle of a motion.
    fn after(&mut self, motion: &Motion, what: &str) {
        let slaves = &motion.slaves;
        let mut rules = vec![Rule::Same; self.plan.units.len()];
        let axes = |slave: &usize| (0..self.plan.units[slave - 1].axes).map(|axis| (*slave, axis)).collect::<Vec<_>>();
        let mut together: Vec<(usize, usize)> = slaves.iter().flat_map(axes).collect();
        let is_filled = matches!(motion.pace, Pace::Threshold(_) | Pace::Ahead(120));
        let is_steady = is_filled && matches!(motion.meanwhile, Meanwhile::Nothing | Meanwhile::Sdos(_));
        match motion.meanwhile {
            Meanwhile::On(slave) => {
                self.machine.until("servo on", |machine| machine.word(slave).is_enabled());
                self.machine.settle();
                self.goals[slave - 1] = self.position(slave);
            }
            Meanwhile::Off(slave) => {
                self.machine.until("servo off", |machine| !machine.word(slave).is_enabled());
            }
            Meanwhile::Clear => {
                slaves.iter().for_each(|slave| rules[slave - 1] = Rule::CutBy(CUT_BY));
                together.clear();
            }
            Meanwhile::Lost(slave) => {
                self.machine.until("the loss", |machine| machine.answer().state.is_failed());
                self.machine.network.find(slave as u8);
                self.machine.go(MasterState::Op);
            }
            Meanwhile::LostAndBack(_) => {
                self.machine.until("it is back", |machine| !machine.answer().state.is_failed());
            }
            _ => {}
        }
        if let Meanwhile::Alarm(slave) = motion.meanwhile
            && !is_filled
        {
            self.apart = Some((slave, STOP * motion.speed.unsigned_abs()));
        }
        self.end(what, &rules);
        if let Some(part) = self.parts.last_mut() {
            (part.together, part.is_steady) = (together, is_steady);
            if let Meanwhile::Alarm(_) = motion.meanwhile {
                part.counts_apart =
                    u64::from(self.plan.ahead) + LATENCY + TRANSPORT_US.div_ceil(self.plan.cycle_us.into());
            }
        }
        match motion.meanwhile {
            Meanwhile::Alarm(slave) => {
                assert!(!self.machine.log.is_armed(), "there was no alarm");
                self.machine.slave(slave, SlaveCommand::AlarmClear);
                self.machine.until("the alarm is cleared", |machine| machine.drive(slave).error_code == 0);
                let mut rules = vec![Rule::Same; self.plan.units.len()];
                // It is held at the position where the alarm has stopped it.
                rules[slave - 1] = if is_filled { Rule::Same } else { Rule::CutBy(1) };
                self.end("alarm cleared", &rules);
                self.machine.servo_on(&[slave]);
                self.end("on again", &rules);
                self.back(&[slave]);
            }
            Meanwhile::Clear => self.back(slaves),
            _ => {}
        }
    }
}

/// A ramp up, and down again.
fn speed_at(n: u32, frames: u32, speed: i32) -> i32 {
    let ramp = n.min(frames - n) as i32;
    (1 + ramp).min(speed)
}

/// The motion command of a slave's mode.
fn command(unit: &Unit, targets: [i32; MAX_AXES]) -> SlaveCommand {
    use ecmsk::cia402::Mode;
    let target = |target| AxisTarget { target, outputs: 0 };
    let second = if unit.axes == 2 { target(targets[1]) } else { AxisTarget::default() };
    let targets = Targets { first: target(targets[0]), second };
    match unit.mode {
        Some(Mode::Csv) => SlaveCommand::Csv(targets),
        // Less than friction holds.
        Some(Mode::Cst) => SlaveCommand::Cst((targets.first.target % 25) as i16),
        _ => SlaveCommand::Csp(targets),
    }
}
