//! Tests of the steps that lead from each network state to each other one, and of those that bring lost slaves back.

use super::*;

fn at(state: MasterState) -> Network {
    Network { reached: Some(state), found: 1, scanned: true, talks: true, ..Network::default() }
}

/// SK-4: the steps of every change from one state to another.
#[test]
fn every_way_is_walked_step_by_step() {
    use MasterState::*;
    let ways: [(MasterState, MasterState, &[Step]); 9] = [
        (PreOp, Op, &[Step::Configure, Step::Move(SafeOp), Step::Move(Op)]),
        (PreOp, SafeOp, &[Step::Configure, Step::Move(SafeOp)]),
        (SafeOp, Op, &[Step::Move(Op)]),
        (Init, PreOp, &[Step::Move(PreOp)]),
        (Op, SafeOp, &[Step::Move(SafeOp)]),
        (Op, PreOp, &[Step::Move(PreOp)]),
        (Op, Init, &[Step::Move(Init)]),
        (SafeOp, Init, &[Step::Move(Init)]),
        (PreOp, PreOp, &[]),
    ];
    for (from, to, steps) in ways {
        let mut network = at(from);
        assert!(network.request(to, 0, false));
        for step in steps {
            assert_eq!(network.next_step(), Some(*step), "{from} to {to}");
            network.done(*step);
        }
        assert_eq!((network.next_step(), network.state()), (None, Some(to)), "{from} to {to}");
    }
}

/// The steps that the network takes from its present state, if each of them succeeds at once.
fn walk(network: &mut Network) -> Vec<Step> {
    let mut steps = Vec::new();
    while let Some(step) = network.next_step() {
        assert!(steps.len() < 20, "it never ends: {steps:?}");
        network.begin(step);
        network.done(step);
        steps.push(step);
    }
    steps
}

/// SK-4.64 The present state is requested during a change to another one: the steps already done are undone.
#[test]
fn the_state_of_before_is_asked_for_again() {
    let mut network = at(MasterState::PreOp);
    assert!(network.request(MasterState::Op, 0, false));
    network.begin(Step::Configure);
    assert!(network.request(MasterState::PreOp, 0, false));
    assert_eq!(walk(&mut network), [Step::Move(MasterState::PreOp)]);
}

/// SK-4.75 Settings that were declared during the configuration are configured, however often the target is replaced:
/// the way up begins at PreOP again.
#[test]
fn new_settings_are_remembered_with_another_target() {
    use MasterState::*;
    let again = [Step::Move(PreOp), Step::Configure, Step::Move(SafeOp), Step::Move(Op)];
    for requests in [[(SafeOp, false), (Op, false), (Op, true)], [(SafeOp, false), (SafeOp, true), (Op, false)]] {
        let mut network = at(PreOp);
        for (n, (target, otherwise)) in requests.into_iter().enumerate() {
            assert!(network.request(target, 0, otherwise));
            if n == 0 {
                network.begin(Step::Configure);
            }
        }
        assert_eq!(walk(&mut network), again, "{requests:?}");
    }
}

/// SK-4.62 The recovery of lost slaves in each state: below SafeOP there is nothing to configure.
#[test]
fn lost_slaves_come_back() {
    use MasterState::*;
    let ways: [(MasterState, &[Step]); 4] = [
        (Init, &[Step::RecoverTo(Init)]),
        (PreOp, &[Step::RecoverTo(PreOp)]),
        (SafeOp, &[Step::RecoverToPreOp, Step::RecoverConfigure, Step::RecoverTo(SafeOp)]),
        (Op, &[Step::RecoverToPreOp, Step::RecoverConfigure, Step::RecoverTo(Op)]),
    ];
    for (state, steps) in ways {
        let mut network = at(state);
        network.mark_lost(SlaveSet::first(2));
        assert!(network.request(state, 0, false));
        assert_eq!(walk(&mut network), steps, "{state}");
        assert!(network.lost().is_empty(), "{state}");
    }
}

/// SK-4.62 SK-4.76 A slave is lost after the others came back, while a failure is still being acknowledged. It comes
/// back with the next SET_STATE.
#[test]
fn one_more_is_lost_after_the_others_came_back() {
    use MasterState::Op;
    let mut network = Network { failed: true, ..at(Op) };
    network.mark_lost(SlaveSet::first(1));
    assert!(network.request(Op, 0, false));
    for step in [Step::RecoverToPreOp, Step::RecoverConfigure, Step::RecoverTo(Op)] {
        assert_eq!(network.next_step(), Some(step));
        network.begin(step);
        network.done(step);
    }
    assert_eq!(network.next_step(), Some(Step::Move(Op)), "the failure is acknowledged");
    network.begin(Step::Move(Op));
    let second = SlaveSet::first(2).difference(SlaveSet::first(1));
    network.mark_lost(second);
    assert!(network.request(Op, 0, false));
    network.done(Step::Move(Op));
    assert_eq!(network.next_step(), Some(Step::RecoverToPreOp));
    network.begin(Step::RecoverToPreOp);
    assert_eq!(network.recovering(), second);
    network.done(Step::RecoverToPreOp);
    assert_eq!(walk(&mut network), [Step::RecoverConfigure, Step::RecoverTo(Op)]);
    assert_eq!((network.lost(), network.state_byte()), (SlaveSet::EMPTY, StateByte::reached(Op)));
}

/// SK-4.62 SK-4.74 One of two lost slaves is silent, and another state is requested while the other one comes back.
/// That request brings both back, and does not go on without them.
#[test]
fn another_request_forgets_no_lost_slave() {
    use MasterState::*;
    for silent in [true, false] {
        let mut network = at(SafeOp);
        network.mark_lost(SlaveSet::first(2));
        assert!(network.request(SafeOp, 0, false));
        network.begin(Step::RecoverToPreOp);
        network.recovery_failed(1, silent);
        network.done(Step::RecoverToPreOp);
        network.begin(Step::RecoverConfigure);
        network.done(Step::RecoverConfigure);
        network.begin(Step::RecoverTo(SafeOp));
        assert!(network.request(Op, 0, false));
        network.done(Step::RecoverTo(SafeOp));
        assert_eq!(network.lost(), SlaveSet::first(1));
        let again = [Step::RecoverToPreOp, Step::RecoverConfigure, Step::RecoverTo(SafeOp), Step::Move(Op)];
        assert_eq!(walk(&mut network), again, "silent: {silent}");
        assert_eq!(network.state_byte(), StateByte::reached(Op));
    }
}

/// SK-4.74 One of two lost slaves is silent. The other one refuses after another state was requested. The silent one is
/// tried again.
#[test]
fn who_refuses_after_another_request_keeps_nobody_back() {
    use MasterState::*;
    let mut network = at(SafeOp);
    network.mark_lost(SlaveSet::first(2));
    assert!(network.request(SafeOp, 0, false));
    network.begin(Step::RecoverToPreOp);
    network.recovery_failed(1, true);
    assert!(network.request(Op, 0, false));
    network.recovery_failed(2, false);
    assert_eq!(network.next_step(), Some(Step::RecoverToPreOp));
    network.begin(Step::RecoverToPreOp);
    assert_eq!(network.recovering(), SlaveSet::first(1));
}

/// SK-4.55 SK-4.76 A program that sends SET_STATE in every frame sees that a lost slave has refused: the repeated
/// requests do not reset that.
#[test]
fn asking_again_forgets_no_refusal() {
    use MasterState::SafeOp;
    let mut network = at(SafeOp);
    network.mark_lost(SlaveSet::first(2));
    assert!(network.request(SafeOp, 0, false));
    network.begin(Step::RecoverToPreOp);
    network.recovery_failed(1, false);
    for step in [Step::RecoverToPreOp, Step::RecoverConfigure, Step::RecoverTo(SafeOp)] {
        assert!(network.request(SafeOp, 0, false));
        network.done(step);
    }
    assert_eq!((network.lost(), network.failed), (SlaveSet::first(1), true));
    assert_eq!(network.next_step(), None, "it is not asked again");
}

/// SK-4.74 When several slaves return to OP, silent ones get half of the time that is left. A single slave gets all of
/// it.
#[test]
fn who_comes_back_with_others_has_half_of_the_time() {
    use MasterState::Op;
    for (slaves, patience) in [(1, None), (2, Some(500))] {
        let mut network = at(Op);
        network.mark_lost(SlaveSet::first(slaves));
        assert!(network.request(Op, 1000, false));
        network.begin(Step::RecoverToPreOp);
        assert_eq!(network.step_timeout(Step::RecoverTo(Op), 1000), patience, "{slaves}");
        assert_eq!(network.step_timeout(Step::RecoverConfigure, 1000), None, "{slaves}");
    }
}
