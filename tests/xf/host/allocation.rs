//! No exchange allocates.

use allocation_counter::measure;
use ecmsk::xf::host::{Host, HostConfig, Next, ProcessRequest};

use super::chip::Fault;
use super::process::{pdo, with_fifo_on};

/// XF-12.13 Submitting, sending, receiving and taking results allocate nothing, whatever comes back.
#[test]
fn the_driver_allocates_nothing() {
    let mut rig = with_fifo_on(HostConfig { pipelined_writes: true, ..HostConfig::DEFAULT });
    let mut count = 0;
    for n in 0..500 {
        let fault = [Fault::None, Fault::ToHost(77), Fault::NotReady, Fault::ToChip(99)][n as usize / 3 % 4];
        let (host, now) = (&mut rig.host, &mut rig.now);
        let mut packet = [0; 144];
        let mut exchange = false;
        let sent = measure(|| {
            let _ = host.process(ProcessRequest::Exchange { count: 1, outputs: &pdo(n) });
            if let Ok(ticket) = host.submit(*now, &super::commands::dac(n % 4096)) {
                let _ = host.take(ticket, &super::commands::dac(n % 4096));
            }
            match host.next(*now) {
                Ok(Next::Exchange(bytes)) => {
                    packet.copy_from_slice(bytes);
                    exchange = true;
                }
                Ok(Next::WaitUntil(time) | Next::WaitForReady { until: time }) => *now = time,
                Err(error) => panic!("{error}"),
            }
        });
        assert_eq!(sent.count_total, 0);
        if exchange {
            let back = rig.chip.exchange(&packet, fault);
            rig.now += super::TRANSFER_NS;
            let (host, now) = (&mut rig.host, rig.now);
            let received = measure(|| {
                host.received(now, &back);
                let _ = (host.take_report(), host.inputs(), host.counters());
            });
            assert_eq!(received.count_total, 0);
            count += 1;
        }
    }
    assert!(count > 200, "{count}");
    assert!(size_of::<Host>() < 13 * 1024, "{}", size_of::<Host>());
}
