//! Effects of a script on slaves, `script=`: loss of power, a jam, a sticking input, forced inputs.

use ecmsk::cia402::DriveState;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::sk::{
    DriveResponse, HspResponse, IoResponse, MasterState, Motion, SdoCommand, SdoResponse, SlaveCommand, StateByte,
};
use support::script_client::{Client, MS, SIZE};

fn drive(client: &Client, slave: usize) -> DriveResponse {
    DriveResponse::decode(&client.slot(slave))
}

fn command(client: &Client, slave: usize, command: SlaveCommand) {
    client.write(|f| f.put_slave(SIZE, slave, &command.into()));
}

fn servo_on(client: &mut Client, slave: usize) {
    command(client, slave, SlaveCommand::ServoOn);
    client.until("on", |c| drive(c, slave).statusword.is_enabled());
}

fn write(client: &mut Client, slave: u8, index: u16, value: u32) {
    let object = ObjectAddress::new(index, 0);
    client.write(|f| f.put_sdo(SIZE, &SdoCommand::Write { slave, object, size: SdoSize::One, value }));
    client.until(
        "the answer",
        |c| matches!(SdoResponse::decode(&c.slot(41)), SdoResponse::Done { object: done, .. } if done == object),
    );
}

fn inputs(client: &Client, slave: usize) -> u16 {
    IoResponse::decode(&client.slot(slave)).bits
}

/// Changes of the inputs until that time: time and new value.
fn changes(client: &mut Client, slave: usize, until_ms: u64) -> Vec<(u64, u16)> {
    let mut changes = vec![];
    loop {
        let at = client.read();
        if at > until_ms * MS {
            return changes;
        }
        let now = inputs(client, slave);
        if changes.last().is_none_or(|(_, before)| *before != now) {
            changes.push((at / MS, now));
        }
    }
}

/// `io`: the inputs are forced at their time, and wired to the outputs again at the end. A frame shows what was
/// measured in the cycle before.
#[test]
fn inputs_are_forced_and_wired_again() {
    let text = "at 2s io 2 inputs 0x00FF for 100ms\nat 2.3s io 2 inputs 0x8000\nat 2.4s end io 2";
    let mut client = Client::with("drive,io", "io-inputs", "clock=virtual", text);
    client.op();
    command(&client, 2, SlaveCommand::IoWrite(0x1234));
    command(&client, 2, SlaveCommand::IoRead);
    client.until("the loop", |c| inputs(c, 2) == 0x1234);
    let seen: Vec<_> = changes(&mut client, 2, 2600).into_iter().skip(1).collect();
    assert_eq!(seen, [(2001, 0x00FF), (2101, 0x1234), (2301, 0x8000), (2401, 0x1234)]);
    command(&client, 2, SlaveCommand::IoWrite(7));
    command(&client, 2, SlaveCommand::IoRead);
    client.until("the outputs are as they were written", |c| inputs(c, 2) == 7);
}

/// `io .. walk`: one input after the other, from the first, cyclically; the end undoes it.
#[test]
fn io_walk_sets_one_input_after_the_other() {
    let mut client = Client::with("io", "io-walk", "clock=virtual", "at 2s io 1 walk 20ms for 400ms");
    client.op();
    let seen: Vec<_> = changes(&mut client, 1, 2600).into_iter().skip(1).collect();
    let walk = (0..20).map(|n| (2001 + 20 * n, 1 << (n % 16)));
    assert_eq!(seen, walk.chain([(2401, 0)]).collect::<Vec<_>>());
}

/// The second channel of a module has inputs of its own.
#[test]
fn inputs_of_a_channel_are_forced() {
    let text = "at 2s io 1.2 inputs 0x0F0F for 50ms\nat 2.1s io 1 inputs 3";
    let mut client = Client::with("hsp2", "io-hsp", "clock=virtual&slot=16", text);
    let size = ecmsk::sk::SlotSize::Bytes16;
    let kinds = std::array::from_fn(|k| if k == 0 { ecmsk::sk::SlaveKind::Hsp } else { ecmsk::sk::SlaveKind::None });
    client.write(|f| f.put_master(size, &ecmsk::sk::MasterCommand::SetAxis { group: 0, kinds }));
    client.write(|f| f.put_master(size, &ecmsk::sk::MasterCommand::SetState(MasterState::Op)));
    let mut seen = vec![];
    while client.read() < 2200 * MS {
        let answer = HspResponse::decode(&client.report.slot(size, 1), size);
        let inputs = [answer.first.inputs, answer.second.inputs];
        if seen.last() != Some(&inputs) {
            seen.push(inputs);
        }
    }
    assert_eq!(seen, [[0, 0], [0, 0x0F0F], [0, 0], [3, 0]]);
}

/// SK-4.61 SK-4.62 `lose`: the slave is lost, the slaves behind it stay; after the end SET_STATE brings it back.
#[test]
fn power_is_lost_and_comes_back() {
    let mut client =
        Client::with("drive*3", "lose", "clock=virtual", "at 3s lose 2 for 500ms\nat 5s lose 3\nat 6s find 3");
    client.op();
    servo_on(&mut client, 3);
    let failed = |c: &Client| c.answer().state.is_failed();
    let at = client.until("the loss", failed);
    assert!((3000 * MS..3100 * MS).contains(&at), "{at}");
    assert!(drive(&client, 3).statusword.is_enabled(), "those behind it stay");
    while client.read() < 3600 * MS {}
    assert!(failed(&client), "it does not come back by itself");
    client.request(MasterState::Op);
    client.until("OP", |c| c.answer().state == StateByte::reached(MasterState::Op));
    servo_on(&mut client, 2);
    let at = client.until("the other loss", failed);
    assert!((5000 * MS..5100 * MS).contains(&at), "{at}");
    assert!(drive(&client, 2).statusword.is_enabled());
    while client.read() < 6001 * MS {}
    client.request(MasterState::Op);
    client.until("OP", |c| c.answer().state == StateByte::reached(MasterState::Op));
}

/// `jam`: the shaft is blocked, and a following error occurs when targets move on; when the shaft is free again, the
/// drive moves.
#[test]
fn a_jam_brings_a_following_error() {
    let mut client = Client::stepped("jam", "at 3s jam 1 for 1s");
    client.op();
    servo_on(&mut client, 1);
    while client.read() < 3010 * MS {}
    let stands = drive(&client, 1).position;
    let mut target = stands;
    while drive(&client, 1).error_code == 0 {
        target += 5000;
        command(&client, 1, SlaveCommand::Csp(Motion::to(target)));
        let at = client.read();
        assert!(at < 3900 * MS, "no following error");
        assert!((drive(&client, 1).position - stands).abs() <= 1);
    }
    assert_eq!(drive(&client, 1).error_code, 0x8611);
    while client.read() < 4100 * MS {}
    command(&client, 1, SlaveCommand::AlarmClear);
    client.until("no fault", |c| drive(c, 1).statusword.state() == Some(DriveState::SwitchOnDisabled));
    servo_on(&mut client, 1);
    command(&client, 1, SlaveCommand::Csp(Motion::to(stands + 500)));
    client.until("it moves", |c| (drive(c, 1).position - stands - 500).abs() <= 5);
}

/// Homes slave 1; whether homing was attained.
fn home(client: &mut Client, method: u32) -> bool {
    write(client, 1, 0x6060, 6);
    write(client, 1, 0x6098, method);
    command(client, 1, SlaveCommand::GoHome);
    client.until("an end", |c| {
        let word = drive(c, 1).statusword.0;
        word & 0x2000 != 0 || word & 0x1400 == 0x1400
    });
    let attained = drive(client, 1).statusword.0 & 0x2000 == 0;
    (0..100).for_each(|_| {
        client.read();
    });
    attained
}

/// `stick`: homing fails while the input sticks, and succeeds when the input works again.
#[test]
fn an_input_that_sticks_ends_homing_in_an_error() {
    let text = "at 1s stick 1 negative-limit on\nat 1s stick 1 positive-limit on for 3s\nat 4s end stick 1\n\
                at 20s stick 1 index off";
    let mut client = Client::stepped("stick", text);
    client.op();
    servo_on(&mut client, 1);
    let before = client.read();
    assert!(before < 4000 * MS, "{before}");
    while client.read() < 1100 * MS {}
    assert!(!home(&mut client, 34), "both limit switches at once");
    while client.read() < 4010 * MS {}
    assert!(home(&mut client, 34), "all inputs work");
    while client.read() < 20_010 * MS {}
    assert!(!home(&mut client, 34), "no index pulse comes");
}

/// Opening again undoes all effects, whatever the new script is.
#[test]
fn opening_again_undoes_everything_a_script_did() {
    let options = "clock=virtual&name=script-slaves";
    let text = "jam 1\nlose 2\nio 3 inputs 0xFFFF\nstick 1 positive-limit on\nstick 1 negative-limit on";
    let mut first = Client::with("drive*2,io", "slaves-again", options, text);
    (0..100).for_each(|_| {
        first.read();
    });
    first.link.close();
    let mut second = Client::with("drive*2,io", "slaves-again", options, "");
    // Slave 2 is in Init: all slaves go to Init first.
    for state in [MasterState::Init, MasterState::PreOp] {
        second.request(state);
        second.until("the state", |c| c.answer().state == StateByte::reached(state));
    }
    second.op();
    command(&second, 3, SlaveCommand::IoRead);
    (0..10).for_each(|_| {
        second.read();
    });
    assert_eq!(inputs(&second, 3), 0);
    servo_on(&mut second, 2);
    servo_on(&mut second, 1);
    command(&second, 1, SlaveCommand::Csp(Motion::to(700)));
    second.until("it moves", |c| (drive(c, 1).position - 700).abs() <= 5);
    assert!(home(&mut second, 34));
}

mod needs_cxx {
    use support::script_client::file;
    use support::{Language, compile, root};

    /// An unmodified C program handles all of them: it sees inputs change, a following error, a homing error and a lost
    /// slave, and recovers from each as the guides describe.
    #[test]
    fn an_unmodified_program_recovers_from_every_scripted_fault_of_a_slave() {
        let text = "at 3s io 3 inputs 0x5A5A for 500ms\nat 4s jam 1 for 2s\nat 9s stick 2 negative-limit on\n\
                    at 9s stick 2 positive-limit on\nat 14s end stick 2\nat 20s lose 2 for 1s";
        let script = file("troubles", text);
        let program = compile(&root().join("tests/c/troubles.c"), Language::C("c99"));
        let link = format!("sim:?slaves=drive*2,io&clock=virtual&script={}", script.display());
        let ended = program.run(&link, [""; 0]);
        assert_eq!(
            (ended.stderr.as_str(), ended.stdout.as_str()),
            ("", "inputs 5A5A\ninputs 0000\nfollowing error\non again\nhoming error\nlost\nback\n")
        );
    }
}
