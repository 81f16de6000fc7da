//! SDO information: the list of objects.

use super::Coe;

impl Coe {
    pub(super) fn information(&self, body: &[u8], room: usize) -> Vec<Vec<u8>> {
        let (opcode, data) = (body[0] & 0x7F, body.get(4..).unwrap_or_default());
        let word = |at: usize| {
            u16::from_le_bytes([data.get(at).copied().unwrap_or(0), data.get(at + 1).copied().unwrap_or(0)])
        };
        let subs = |index: u16| self.objects.range((index, 0)..=(index, u8::MAX));
        let error = |code: u32| vec![(7, code.to_le_bytes().to_vec())];
        let missing = || error(0x0602_0000);
        let answers: Vec<(u8, Vec<u8>)> = match (self.refuses_information, opcode) {
            (Some(code), _) => error(code),
            (_, 1) => {
                let mut indices: Vec<u16> = self.objects.keys().map(|(index, _)| *index).collect();
                indices.dedup();
                let lengths = [indices.len() as u16, 0, 0, 0, 0];
                let listed: Vec<u16> = if word(0) == 0 { lengths.to_vec() } else { indices };
                let bytes: Vec<u8> = [word(0)].into_iter().chain(listed).flat_map(u16::to_le_bytes).collect();
                bytes.chunks((room - 12) & !1).map(|part| (2, part.to_vec())).collect()
            }
            (_, 3) => match subs(word(0)).next_back() {
                Some(((index, last), _)) => {
                    let mut bytes = index.to_le_bytes().to_vec();
                    bytes.extend([7, 0, *last, if *last > 0 { 9 } else { 7 }]);
                    bytes.extend(format!("object {index:04X}").bytes());
                    vec![(4, bytes)]
                }
                None => missing(),
            },
            (_, 5) => match self.value(word(0), word(2) as u8) {
                Some(value) => {
                    let mut bytes = data[..4].to_vec();
                    let kind: u16 = [0, 5, 6, 0, 7].get(value.len()).copied().unwrap_or(9);
                    bytes.extend(kind.to_le_bytes());
                    bytes.extend((8 * value.len() as u16).to_le_bytes());
                    bytes.extend(if self.read_only.contains(&word(0)) { 0x0007_u16 } else { 0x003F }.to_le_bytes());
                    vec![(6, bytes)]
                }
                None => missing(),
            },
            _ => missing(),
        };
        let count = answers.len();
        let fragment = |(n, (opcode, data)): (usize, (u8, Vec<u8>))| {
            let left = count - 1 - n;
            let mut message = 0x8000_u16.to_le_bytes().to_vec();
            message.extend([opcode | if left > 0 && !self.marks_no_fragments { 0x80 } else { 0 }, 0]);
            message.extend((left as u16).to_le_bytes());
            message.extend(data);
            message
        };
        answers.into_iter().enumerate().map(fragment).collect()
    }
}
