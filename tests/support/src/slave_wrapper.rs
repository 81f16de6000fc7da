//! A macro for a test's slave that wraps another slave.

/// Calls of a [`Slave`](ecmsk::slave::Slave) that are passed unchanged to the slave inside: `hand_on_slave!(inner:
/// name, state);` in the `impl`, where `inner` is the field with that slave.
#[macro_export]
macro_rules! hand_on_slave {
    ($slave:tt: $($call:ident),+ $(,)?) => {
        $($crate::hand_on_slave!(@$call $slave);)+
    };
    (@name $slave:tt) => {
        fn name(&self) -> &str {
            self.$slave.name()
        }
    };
    (@state $slave:tt) => {
        fn state(&self) -> ecmsk::fieldbus::AlState {
            self.$slave.state()
        }
    };
    (@enter $slave:tt) => {
        fn enter(&mut self, target: ecmsk::fieldbus::AlState) -> Result<(), ecmsk::slave::AlStatus> {
            self.$slave.enter(target)
        }
    };
    (@read $slave:tt) => {
        fn read(
            &mut self,
            object: ecmsk::coe::ObjectAddress,
            scope: ecmsk::coe::SdoScope,
            value: &mut [u8],
        ) -> Result<usize, ecmsk::coe::AbortCode> {
            self.$slave.read(object, scope, value)
        }
    };
    // Without complete access to the mapping: a bus then maps by writing each entry, which a wrapper that tracks the
    // mapping has to see.
    (@read_entries $slave:tt) => {
        fn read(
            &mut self,
            object: ecmsk::coe::ObjectAddress,
            scope: ecmsk::coe::SdoScope,
            value: &mut [u8],
        ) -> Result<usize, ecmsk::coe::AbortCode> {
            if scope == ecmsk::coe::SdoScope::Complete && (0x1600..0x1C14).contains(&object.index) {
                return Err(ecmsk::coe::AbortCode::COMPLETE_ACCESS);
            }
            self.$slave.read(object, scope, value)
        }
    };
    (@set_sync_managers $slave:tt) => {
        fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
            self.$slave.set_sync_managers(outputs, inputs);
        }
    };
    (@step $slave:tt) => {
        fn step(&mut self, dt_ns: ecmsk::fieldbus::Ns) {
            self.$slave.step(dt_ns);
        }
    };
    (@begin_step $slave:tt) => {
        fn begin_step(&mut self, dt_ns: ecmsk::fieldbus::Ns) -> Option<&mut ecmsk::slave::plant::Servo> {
            self.$slave.begin_step(dt_ns)
        }
    };
    (@end_step $slave:tt) => {
        fn end_step(&mut self, dt_ns: ecmsk::fieldbus::Ns) {
            self.$slave.end_step(dt_ns);
        }
    };
    (@apply_fault $slave:tt) => {
        fn apply_fault(&mut self, fault: ecmsk::slave::Fault) -> bool {
            self.$slave.apply_fault(fault)
        }
    };
    (@has_dc $slave:tt) => {
        fn has_dc(&self) -> bool {
            self.$slave.has_dc()
        }
    };
    (@shaft $slave:tt) => {
        fn shaft(&self, axis: usize) -> Option<i64> {
            self.$slave.shaft(axis)
        }
    };
}
