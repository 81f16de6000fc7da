//! Files over EtherCAT.

use std::collections::BTreeMap;

/// The files of a slave, and the oddities of its FoE.
#[derive(Default)]
pub struct Foe {
    /// Contents by name.
    pub files: BTreeMap<String, Vec<u8>>,
    /// The packet that is numbered one too high.
    pub wrong_packet: Option<u32>,
    /// The file that is being read, and the packet that was sent last.
    reading: Option<(Vec<u8>, u32)>,
    /// The file that is being written.
    writing: Option<(String, Vec<u8>)>,
    /// The code of the error by which the master has ended a transfer.
    pub ended_with: Option<u32>,
}

impl Foe {
    pub(super) fn answer(&mut self, body: &[u8], room: usize) -> Vec<Vec<u8>> {
        let Some((head, rest)) = body.split_first_chunk::<6>() else { return Vec::new() };
        let number = u32::from_le_bytes([head[2], head[3], head[4], head[5]]);
        let name = || String::from_utf8_lossy(rest).trim_end_matches('\0').to_owned();
        let room = room - 12;
        match head[0] {
            1 => match self.files.get(&name()).cloned() {
                Some(content) => {
                    self.reading = Some((content, 0));
                    self.packet(room)
                }
                None => vec![message(5, 0x8001, b"not found")],
            },
            2 => {
                self.writing = Some((name(), Vec::new()));
                vec![message(4, self.numbered(0), &[])]
            }
            3 => {
                let Some((name, content)) = &mut self.writing else { return vec![message(5, 0x8004, &[])] };
                content.extend(rest);
                if rest.len() < room {
                    self.files.insert(std::mem::take(name), std::mem::take(content));
                    self.writing = None;
                }
                vec![message(4, self.numbered(number), &[])]
            }
            4 => self.packet(room),
            5 => {
                self.ended_with = Some(number);
                (self.reading, self.writing) = (None, None);
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    const fn numbered(&self, packet: u32) -> u32 {
        match self.wrong_packet {
            Some(wrong) if wrong == packet => packet + 1,
            _ => packet,
        }
    }

    /// The next packet, or nothing after the last one.
    fn packet(&mut self, room: usize) -> Vec<Vec<u8>> {
        let Some((content, packet)) = &mut self.reading else { return Vec::new() };
        let begin = *packet as usize * room;
        *packet += 1;
        let packet = *packet;
        let Some(rest) = content.get(begin..) else {
            self.reading = None;
            return Vec::new();
        };
        let data = rest[..rest.len().min(room)].to_vec();
        vec![message(3, self.numbered(packet), &data)]
    }
}

fn message(opcode: u8, number: u32, data: &[u8]) -> Vec<u8> {
    let mut message = vec![opcode, 0];
    message.extend(number.to_le_bytes());
    message.extend(data);
    message
}
