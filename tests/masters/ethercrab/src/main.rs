//! Masters with ethercrab on simulated slaves, one program each. A wrong step ends the program with a panic.
//!
//! ethercrab 0.7.1 has defects of its own, whatever the slave: values of more than 4 bytes are not written, an emergency that comes
//! as the answer to an SDO is a panic, no single slave that lost its power can be configured again, and a change of state that is
//! refused shows as a timeout. `defects.rs` shows those that can be shown.

mod defects;
mod dp3cl;
mod emergency;
mod many;
mod paced;
mod refused;
mod rig;
mod start;
mod vanish;
mod watchdog;

use async_io::block_on;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let (Some(interface), Some(program)) = (arguments.next(), arguments.next()) else {
        panic!("usage: ethercrab_master INTERFACE PROGRAM");
    };
    let master = rig::master(&interface);
    block_on(async {
        match &*program {
            "defects" => defects::run(&master).await,
            "dp3cl" => dp3cl::run(&master).await,
            "emergency" => emergency::run(&master).await,
            "many" => many::run(&master).await,
            "paced" => paced::run(&master).await,
            "refused" => refused::run(&master).await,
            "start" => start::run(&master).await,
            "vanish" => vanish::run(&master).await,
            "watchdog" => watchdog::run(&master).await,
            other => panic!("there is no program `{other}`"),
        }
    });
    println!("all as it has to be");
}
