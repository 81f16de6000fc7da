//! Packets of a chip in Wireshark with the plugin: the numbers of `ecmsk dump`, and each field of each function.

mod needs_tshark {
    use std::fs;
    use std::path::{Path, PathBuf};

    use ecmsk::coe::ObjectAddress;
    use ecmsk::link::chip;
    use ecmsk::xf::fields::{AnswerFields, Draft, FUNCTIONS, Field, FieldKind, FunctionFields, Value};
    use ecmsk::xf::host::Wires;
    use ecmsk::xf::request::Slaves;
    use ecmsk::xf::response::Returned;
    use ecmsk::xf::{
        AnswerHeader, CheckRule, CommandCode, CommandHeader, DataSize, END_WORD, Errors, EtherCatState, FIXED_CHECK,
        MAX_PACKET, NOT_READY, write_request,
    };
    use ecmsk::xf_api::{NetworkConfig, Xf};
    use serde_json::Value as Json;
    use support::dice::Dice;
    use tempfile::TempDir;

    use crate::common::tshark::{dumped, field, is_same, remarks, shown, values};

    /// The first byte of a packet in a recording, for bytes to the chip and (next constant) from the chip.
    const TO_CHIP: u8 = 0;
    const FROM_CHIP: u8 = 1;

    /// The length in bytes of the data segment in answers that a test makes: more than the longest answer needs.
    const DATA_OF_ANSWERS: usize = 256;

    /// The numbers of each packet in a recording are those of `dump`; damaged packets and other bytes are shown as such.
    #[test]
    fn packets_are_shown_as_by_dump() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("run.pcapng");
        let link = format!("xf-sim:?slaves=drive&clock=virtual&record={}", file.display());
        let mut xf = Xf::open(&link).expect("it starts");
        xf.start_network(&NetworkConfig::default()).expect("a network");
        xf.set_state(Slaves::All, EtherCatState::PreOp).expect("PreOP");
        xf.sdo_write(0, ObjectAddress::new(0x6060, 0), 8_i8).expect("CSP");
        drop(xf);
        let (mut wires, _) = chip::open(&link).expect("a chip");
        wires.exchange(&[0xEE; 144], &mut [0; 144]).expect("it passes");
        wires.exchange(&[0xEE; 10], &mut [0; 10]).expect("it passes");
        drop(wires);
        let (shown, dumped) = (shown(&file, "ecmsk_xf", &[]), dumped(&file, &[]));
        assert!(shown.len() > 100);
        let mut compared = [0; 4];
        for packet in &dumped {
            let number = packet["number"].as_u64().expect("a number");
            // `dump` joins pieces of packets and the plugin does not, so they are not compared.
            if packet.get("pieces").is_none() {
                let (_, layer) = shown.iter().find(|(shown, _)| *shown == number).expect("a packet");
                compared[compare_packet(layer, packet)] += 1;
            }
        }
        assert!(compared.iter().all(|count| *count > 0), "{compared:?}");
    }

    /// Compares what the plugin shows of a packet with the JSON of `dump`. Returns the kind of packet: 0 damaged, 1 not ready,
    /// 2 a piece, 3 any other.
    fn compare_packet(layer: &Json, packet: &Json) -> usize {
        let text = packet["text"][0].as_str().expect("words");
        let special = ["damaged", "not_ready", "piece"];
        let is_piece = text.ends_with("as no packet has");
        let kind = special.iter().position(|name| packet.get(name).is_some() || is_piece && *name == "piece");
        for (n, name) in special.iter().enumerate() {
            assert_eq!(layer.get(format!("ecmsk_xf.{name}")).is_some(), kind == Some(n), "{name}: {packet}");
        }
        assert_eq!(layer["ecmsk_xf.direction"], packet["direction"], "{packet}");
        for name in ["index", "code", "nop", "ret", "state", "errors", "rx_fifo", "tx_fifo"] {
            match (layer.get(format!("ecmsk_xf.{name}")), packet.get(name)) {
                (None, None) => {}
                (Some(shown), Some(expected)) => assert!(is_same(shown, expected), "{name} is {shown}: {packet}"),
                (shown, _) => panic!("{name} is {shown:?}: {packet}"),
            }
        }
        if kind.is_none() {
            let check = field(layer, "ecmsk_xf.check.type").and_then(Json::as_str).expect("a check");
            assert!(
                packet["direction"] == "answer" || packet["text"][1].as_str().is_some_and(|text| text.ends_with(check))
            );
        }
        kind.unwrap_or(special.len())
    }

    /// The plugin shows each field of a request that this project's code has written, and of an answer that this code can read,
    /// with its value.
    #[test]
    fn each_field_of_each_function_is_shown() {
        let (mut capture, mut dice, mut expected) = (Capture::default(), Dice(44), Vec::new());
        for row in &FUNCTIONS {
            for _ in 0..4 {
                if let Some(fields) = request(&mut capture, &mut dice, row) {
                    expected.push(fields);
                    expected.extend(row.answers.iter().map(|form| answer(&mut capture, &mut dice, row, form)));
                }
            }
        }
        let folder = tempfile::tempdir().expect("a folder");
        let shown = shown(&capture.keep(&folder), "ecmsk_xf", &[]);
        assert_eq!(shown.len(), expected.len());
        let mut names = std::collections::BTreeSet::new();
        for ((number, layer), packet) in shown.iter().zip(&expected) {
            assert_eq!(layer["ecmsk_xf.command"], packet.name, "packet {number}");
            let parts = values(layer, "ecmsk_xf.repeated");
            for (part, name, value) in &packet.fields {
                let shown = if packet.repeats { values(&parts[*part], name) } else { values(layer, name) };
                assert_eq!(shown.iter().map(number_of).collect::<Vec<_>>(), *value, "packet {number}: {name}: {layer}");
                names.insert(name.clone());
            }
        }
        let all = FUNCTIONS.iter().map(|row| row.request.len()).sum::<usize>();
        assert!(names.len() > all, "{} names of {all} fields of requests, and those of answers", names.len());
    }

    /// What the plugin should show of a packet.
    struct Expected {
        name: &'static str,
        repeats: bool,
        /// The fields: each with its part of a repeated answer (from 0), its name and its values.
        fields: Vec<(usize, String, Vec<Json>)>,
    }

    /// A value that tshark shows as a text: as a number if it is one, otherwise as the text.
    fn number_of(shown: &Json) -> Json {
        let text = shown.as_str().expect("a text");
        let number = match text.strip_prefix("0x") {
            Some(digits) => i64::from_str_radix(digits, 16).ok(),
            None => text.parse().ok(),
        };
        number.map_or_else(|| text.into(), Json::from)
    }

    /// Writes a command with values for all of its fields; `None` if the values do not go together.
    fn request(capture: &mut Capture, dice: &mut Dice, row: &'static FunctionFields) -> Option<Expected> {
        let mut data = [0; DataSize::MANUAL.bytes()];
        let mut draft = Draft::new(row, &mut data);
        let mut put = Vec::new();
        for field in row.request {
            let bytes = any_bytes(dice, field);
            let value = if field.is_number() { Value::Number(any_number(dice, field)) } else { Value::Bytes(&bytes) };
            draft.put(field, value).ok()?;
            put.push((field, json_of(field, value)));
        }
        let request = draft.request().ok()?;
        // Fields of different operations may have the same position in a request. Then the value of the last one is in the
        // packet.
        let is_at = |one: &Field, other: &Field| one.position == other.position && one.shift == other.shift;
        let is_last =
            |field: &Field| put.iter().rfind(|(other, _)| is_at(other, field)).is_some_and(|(last, _)| *last == field);
        let is_kept = |field: &Field| draft.keeps(field) && field.counts.is_none() && is_last(field);
        let kept = put.iter().filter(|(field, value)| is_kept(field) && !value.is_empty());
        let fields = kept.map(|(field, value)| (0, name_of(row, "", field), value.clone())).collect();
        let mut buffer = [0; MAX_PACKET];
        let header = CommandHeader::with_index(capture.next_index());
        let packet = write_request(&mut buffer, DataSize::MANUAL, CheckRule::CRC32, header, &request).ok()?;
        capture.push(TO_CHIP, packet);
        Some(Expected { name: row.name(), repeats: false, fields })
    }

    /// Writes an answer to the last command, with random data.
    fn answer(capture: &mut Capture, dice: &mut Dice, row: &'static FunctionFields, form: &AnswerFields) -> Expected {
        let parts = if form.every.is_some() { 3 } else { 1 };
        let len = form.len.or(form.every.map(|every| parts * every)).unwrap_or_else(|| dice.pick(&[32, 64, 112]));
        let mut data: Vec<u8> = (0..len).map(|_| b'a' + dice.below(26) as u8).collect();
        for field in form.fields {
            if let (FieldKind::Objects { count_at }, true) = (field.kind, data.len() >= 2) {
                data[usize::from(count_at)..][..2].copy_from_slice(&3_u16.to_le_bytes());
            }
        }
        let returned = Returned { ret: dice.roll() as u8, len };
        let index = capture.index;
        let header = AnswerHeader { index, code: row.code, ret: returned.ret, len, ..AnswerHeader::default() };
        capture.push(FROM_CHIP, &packet_of(&header, &data, FIXED_CHECK));
        // An answer may have several forms. The plugin uses the first one with the length of the data, so the expected fields
        // are those of that form.
        let form = row.answer(returned).unwrap_or(form);
        let mut fields = Vec::new();
        for part in 0..usize::from(if form.every.is_some() { parts } else { 1 }) {
            let base = part * usize::from(form.every.unwrap_or(0));
            for field in form.fields {
                let value = field.get(returned, &data, base).map(|value| json_of(field, value)).unwrap_or_default();
                if !value.is_empty() {
                    fields.push((part, name_of(row, "answer.", field), value));
                }
            }
        }
        Expected { name: row.name(), repeats: form.every.is_some(), fields }
    }

    fn packet_of(header: &AnswerHeader, data: &[u8], check: u32) -> Vec<u8> {
        let mut packet = header.encode().to_vec();
        packet.extend(data);
        packet.resize(header.encode().len() + DATA_OF_ANSWERS, 0);
        packet.extend(check.to_le_bytes());
        packet.extend(END_WORD.to_le_bytes());
        packet
    }

    /// A value that the field takes: one of its names, or any.
    fn any_number(dice: &mut Dice, field: &Field) -> i64 {
        let any = (dice.roll() & ((1 << field.width) - 1)).min(u64::from(u32::MAX));
        match field.kind {
            FieldKind::Choice(names) => i64::from(names[dice.below(names.len() as u64) as usize].1),
            FieldKind::Bits(names) => i64::from(names.iter().fold(0, |all, (_, bit)| all | bit) & any as u32),
            FieldKind::Signed => i64::from(any as i32),
            // In half of the cases a small number, because numbers of slaves, axes and pins have to be small.
            _ if dice.one_in(2) => (any & 7).cast_signed(),
            _ => any.cast_signed(),
        }
    }

    fn any_bytes(dice: &mut Dice, field: &Field) -> Vec<u8> {
        let len = if field.bytes > 0 { field.bytes.into() } else { 4 * (1 + dice.below(2)) };
        (0..len).map(|_| b'a' + dice.below(26) as u8).collect()
    }

    /// A value as the plugin shows it; an empty list for a field without bytes, which the plugin does not show.
    fn json_of(field: &Field, value: Value<'_>) -> Vec<Json> {
        match value {
            Value::Number(number) => vec![number.into()],
            Value::Bytes([]) => Vec::new(),
            Value::Bytes(bytes) => match field.kind {
                FieldKind::Objects { .. } => {
                    let objects = bytes
                        .chunks_exact(4)
                        .map(|four| four.iter().rev().fold(0, |number, byte| number << 8 | i64::from(*byte)));
                    objects.map(Json::from).collect()
                }
                FieldKind::Text | FieldKind::NumberOrText => vec![String::from_utf8_lossy(bytes).into()],
                _ => vec![bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(":").into()],
            },
        }
    }

    /// The name of a field in Wireshark: the field `state` of the function `StateSet` is `ecmsk_xf.state_set.state`. `part` is
    /// `answer.` for a field of an answer.
    fn name_of(row: &FunctionFields, part: &str, field: &Field) -> String {
        let snake = row.type_name.chars().enumerate().flat_map(|(n, letter)| {
            let line = (letter.is_uppercase() && n > 0).then_some('_');
            line.into_iter().chain(letter.to_lowercase())
        });
        format!("ecmsk_xf.{}.{part}{}", snake.collect::<String>(), field.name)
    }

    /// New errors, a wrong working counter, a packet that is damaged or lost have a remark each.
    #[test]
    fn remarks_say_what_goes_wrong() {
        let good = AnswerHeader::default();
        let full = AnswerHeader { errors: Errors::FIFO, ..good };
        let lost = AnswerHeader { wkc_errors: 1, ..full };
        let failed = AnswerHeader { errors: Errors::FIFO | Errors::NON_IMMEDIATE, ..lost };
        let emergency = AnswerHeader { code: CommandCode::CoeEmergency, len: 12, ..failed };
        let cases = [
            (good, FIXED_CHECK, ""),
            (full, FIXED_CHECK, "ecmsk_xf.fifo_full"),
            (full, FIXED_CHECK, ""),
            (lost, FIXED_CHECK, "ecmsk_xf.slave_lost"),
            (failed, FIXED_CHECK, "ecmsk_xf.error"),
            (emergency, FIXED_CHECK, "ecmsk_xf.emergency"),
            (lost, NOT_READY, "ecmsk_xf.lost_command"),
            (lost, 1, "ecmsk_xf.damaged_packet"),
        ];
        let mut capture = Capture::default();
        for (header, check, _) in &cases {
            capture.push(FROM_CHIP, &packet_of(header, &[], *check));
        }
        let folder = tempfile::tempdir().expect("a folder");
        for ((_, layer), (_, _, expected)) in shown(&capture.keep(&folder), "ecmsk_xf", &[]).iter().zip(cases) {
            let names: Vec<String> = remarks(layer).into_iter().map(|(name, _)| name).collect();
            assert_eq!(names.join(" "), expected);
        }
    }

    /// A pcap file of packets of link type USER15.
    #[derive(Default)]
    struct Capture {
        packets: Vec<Vec<u8>>,
        index: u8,
    }

    impl Capture {
        fn next_index(&mut self) -> u8 {
            self.index = self.index.wrapping_add(1);
            self.index
        }

        fn push(&mut self, mark: u8, packet: &[u8]) {
            self.packets.push([&[mark], packet].concat());
        }

        fn keep(&self, folder: &TempDir) -> PathBuf {
            const USER15: u32 = 162;
            let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
            let mut file = words(&[0xA1B2_C3D4, 2 | 4 << 16, 0, 0, 65_535, USER15]);
            for (n, packet) in (0..).zip(&self.packets) {
                file.extend(words(&[n, 0, packet.len() as u32, packet.len() as u32]));
                file.extend(packet);
            }
            let path: &Path = folder.path();
            fs::write(path.join("chip.pcap"), file).expect("a file");
            path.join("chip.pcap")
        }
    }
}
