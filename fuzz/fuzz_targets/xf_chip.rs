//! The model of the ECM-XF, over slave models and over controllers, against a host that sends whatever it likes: requests with
//! right check words, and any bytes in between. Nothing panics, there is a byte for each byte, and the chip goes on.

#![no_main]

use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{Drive, DriveConfig, Io, Slave};
use ecmsk::xf::chip::{Chip, ChipPort, Controllers, Profile, SimulatedNetwork, SlaveModels};
use ecmsk::xf::request::{Arguments, UnknownCommand};
use ecmsk::xf::{CheckRule, CommandCode, CommandHeader, Control, MAX_PACKET, Request, Reserve, write_request};
use libfuzzer_sys::fuzz_target;

/// Bytes of a step, the data of a request not counted.
const STEP: usize = 16;
/// Longer than the chip takes to start.
const END_NS: u64 = 1_000_000_000;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, mut bytes)) = bytes.split_first() else { return };
    let profile = [Profile::OLD, Profile::NEW, Profile::XFU][usize::from(kind % 3)];
    let slaves: Vec<Box<dyn Slave>> = vec![Box::new(Drive::new(DriveConfig::default())), Box::new(Io::default())];
    let network = if kind / 3 % 2 == 0 {
        SimulatedNetwork::Models(SlaveModels::new(slaves))
    } else {
        let controllers = Controllers::new(slaves, SimHandle::default());
        SimulatedNetwork::Controllers(controllers.expect("they can be described"))
    };
    let mut rig = Rig::new(Chip::new(profile, network));
    while let Some((step, rest)) = bytes.split_first_chunk::<STEP>() {
        let (data, rest) = rest.split_at(usize::from(step[15]).min(rest.len()));
        bytes = rest;
        rig.step(step, data);
    }
    rig.end();
});

struct Rig {
    port: ChipPort<SimulatedNetwork>,
    now: u64,
    rule: CheckRule,
}

impl Rig {
    fn new(chip: Chip<SimulatedNetwork>) -> Self {
        Self { port: ChipPort::new(chip), now: 1_000_000_000, rule: CheckRule::FIXED }
    }

    fn step(&mut self, step: &[u8; STEP], data: &[u8]) {
        self.now += u64::from(step[1]) * 100_000;
        match step[0] % 16 {
            0 => self.bytes(&step.repeat(1 + usize::from(step[2] % 90))),
            1 => self.bytes(data),
            2 => self.rule = if step[2] & 1 == 0 { CheckRule::FIXED } else { CheckRule::CRC32 },
            3 => {
                self.port.chip_mut().wire_gpio(self.now, step[2], [None, Some(false), Some(true)][step[3] as usize % 3])
            }
            4 => self.port.chip_mut().turn_encoder(i32::from_le_bytes([step[2], step[3], step[4], 0])),
            5 => self.network(step[2], step[3]),
            _ => self.request(step, data),
        }
    }

    /// What goes wrong with the slaves.
    fn network(&mut self, what: u8, slave: u8) {
        let network = self.port.chip().network().handle();
        let number = 1 + slave % 2;
        match what % 6 {
            0 => network.cut_after(slave % 3),
            1 => network.heal(),
            2 => network.silence(number, true),
            3 => network.silence(number, false),
            4 => network.lose(number),
            _ => network.find(number),
        }
    }

    /// A request with a right check word.
    fn request(&mut self, step: &[u8; STEP], data: &[u8]) {
        let size = self.port.chip().size();
        let code = CommandCode::from_code(step[2] % 146);
        let arguments = Arguments {
            parameter: step[4],
            info: [step[5], step[6], step[7], step[8]],
            reserve: Reserve(u16::from_le_bytes([step[9], step[10]])),
            len: if step[3] & 0x80 == 0 { data.len() as u16 } else { u16::from_le_bytes([step[11], step[12]]) },
        };
        let data = &data[..data.len().min(size.bytes())];
        let header = CommandHeader { control: Control(step[13]), ..CommandHeader::with_index(step[14]) };
        let mut buffer = [0; MAX_PACKET];
        let request = Request::Unknown(UnknownCommand { code, arguments, data });
        if let Ok(packet) = write_request(&mut buffer, size, self.rule, header, &request) {
            let packet = packet.to_vec();
            self.bytes(&packet);
        }
    }

    fn bytes(&mut self, bytes: &[u8]) {
        let mut from = vec![0xA5; bytes.len()];
        assert_eq!(self.port.transfer(self.now, bytes, &mut from), bytes.len());
    }

    /// Time passes, and the chip takes packets again.
    fn end(&mut self) {
        let chip = self.port.chip_mut();
        let now = self.now + END_NS;
        chip.run_until(now);
        assert!(chip.is_ready(), "the chip goes on");
        assert_eq!(chip.now(), now);
        let len = chip.size().packet_len();
        let mut answer = [0xA5; MAX_PACKET];
        chip.exchange(now, &[0; MAX_PACKET][..len], &mut answer[..len]);
        assert_eq!(
            (&answer[..4], &answer[len - 4..len]),
            (&[0xA4, 0xA3, 0xA2, 0xA1][..], &[0x59, 0x58, 0x57, 0x56][..])
        );
    }
}
