//! A macro for a test's bus that wraps another bus.

/// Calls of a [`Fieldbus`](ecmsk::fieldbus::Fieldbus) that are passed unchanged to the bus inside: `hand_on!(inner:
/// room, push);` in the `impl`, where `inner` is the field with that bus.
#[macro_export]
macro_rules! hand_on {
    ($bus:tt: $($call:ident),+ $(,)?) => {
        $($crate::hand_on!(@$call $bus);)+
    };
    (@pacing $bus:tt) => {
        fn pacing(&self) -> ecmsk::fieldbus::Pacing {
            self.$bus.pacing()
        }
    };
    (@start $bus:tt) => {
        fn start(&mut self, job: ecmsk::fieldbus::Job, now: ecmsk::fieldbus::Ns) -> Result<(), ecmsk::fieldbus::Busy> {
            self.$bus.start(job, now)
        }
    };
    (@prepare $bus:tt) => {
        fn prepare(&mut self, config: &ecmsk::fieldbus::BusConfig, now: ecmsk::fieldbus::Ns) {
            self.$bus.prepare(config, now);
        }
    };
    (@start_sdo $bus:tt) => {
        fn start_sdo(
            &mut self,
            request: ecmsk::fieldbus::SdoRequest,
            now: ecmsk::fieldbus::Ns,
        ) -> Result<(), ecmsk::fieldbus::Busy> {
            self.$bus.start_sdo(request, now)
        }
    };
    (@poll_job $bus:tt) => {
        fn poll_job(&mut self, now: ecmsk::fieldbus::Ns) -> Option<ecmsk::fieldbus::JobDone> {
            self.$bus.poll_job(now)
        }
    };
    (@poll_sdo $bus:tt) => {
        fn poll_sdo(&mut self, now: ecmsk::fieldbus::Ns) -> Option<ecmsk::fieldbus::SdoDone> {
            self.$bus.poll_sdo(now)
        }
    };
    (@cancel_job $bus:tt) => {
        fn cancel_job(&mut self) {
            self.$bus.cancel_job();
        }
    };
    (@cancel_sdo $bus:tt) => {
        fn cancel_sdo(&mut self) {
            self.$bus.cancel_sdo();
        }
    };
    (@room $bus:tt) => {
        fn room(&self) -> u16 {
            self.$bus.room()
        }
    };
    (@clear_ahead $bus:tt) => {
        fn clear_ahead(&mut self, now: ecmsk::fieldbus::Ns) {
            self.$bus.clear_ahead(now);
        }
    };
    (@poll_clear $bus:tt) => {
        fn poll_clear(&mut self, now: ecmsk::fieldbus::Ns) -> Option<ecmsk::fieldbus::Cleared> {
            self.$bus.poll_clear(now)
        }
    };
    (@push $bus:tt) => {
        fn push(&mut self, outputs: &ecmsk::fieldbus::Outputs) -> Result<(), ecmsk::fieldbus::BusError> {
            self.$bus.push(outputs)
        }
    };
    (@poll $bus:tt) => {
        fn poll(
            &mut self,
            now: ecmsk::fieldbus::Ns,
            inputs: &mut ecmsk::fieldbus::Inputs,
        ) -> Option<ecmsk::fieldbus::CycleDone> {
            self.$bus.poll(now, inputs)
        }
    };
}
