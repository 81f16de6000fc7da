"""An IO slave and the board's own inputs and outputs: a light runs along the 16 outputs of the slave."""

import os

import ecmsk
from ecmsk import Config, MasterState, Slave

with ecmsk.open(os.environ.get("ECMSK_LINK", "sim:?slaves=io&clock=virtual")) as ecm:
    ecm.configure(Config([Slave.io()]))
    ecm.set_state(MasterState.OP)
    for output in range(16):
        ecm.set_outputs(1, 1 << output)
        print(f"output {output:2} on: inputs 0x{ecm.inputs(1):04X}")
    ecm.set_outputs(1, 0)
    ecm.set_local_outputs(0x15)
    print(f"the board's outputs 0, 2 and 4 on; its inputs: 0x{ecm.local_inputs():02X}")
    ecm.set_local_outputs(0)
    ecm.set_state(MasterState.PREOP)
