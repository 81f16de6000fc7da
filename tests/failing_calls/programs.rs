//! A C program on the library, by itself and below `ecmsk exec`.

mod needs_cxx {
    use std::fs;
    use std::process::Command;

    use support::failing_calls::{self, Blow, Run, Struck, Whose};
    use support::{Language, Program, tool_without_link};

    use crate::served::Served;
    use crate::verbs::whole;
    use crate::{EACH_ONCE, FEW, LIMIT, strike};

    const END: i32 = 2500;

    fn program() -> Program {
        support::compile(&support::root().join("tests/c/counted.c"), Language::C("c99"))
    }

    fn struck(command: &mut Command, whose: Whose, blow: Option<Blow>) -> Struck {
        failing_calls::run(command, whose, blow, LIMIT, None)
    }

    /// The accepted frames according to the program.
    fn accepted(struck: &Struck) -> Result<u64, String> {
        let said = struck.ended.stdout.strip_prefix("ok ").and_then(|number| number.trim_end().parse().ok());
        said.ok_or_else(|| format!("it says `{}`", struck.ended.stdout))
    }

    fn simulated(test: &str, usual: usize, clock: &str) {
        let program = program();
        let link = format!("sim:?slaves=drive&clock={clock}");
        strike(test, usual, |blow| {
            let struck = struck(&mut program.command(&link), Whose::Program, blow);
            Run::judge(struck, |struck| accepted(struck).map(drop))
        });
    }

    #[test]
    fn a_program() {
        simulated("a_program", EACH_ONCE, "virtual");
    }

    #[test]
    fn a_program_on_the_real_clock() {
        simulated("a_program_on_the_real_clock", FEW, "real");
    }

    #[test]
    fn a_program_on_a_served_board() {
        let program = program();
        strike("a_program_on_a_served_board", FEW, |blow| {
            let served = Served::start();
            let mut command = program.command(&served.uri());
            let run = Run::judge(struck(command.arg("tcp"), Whose::Program, blow), |struck| {
                let (accepted, arrived) = (accepted(struck)?, served.written());
                if accepted == arrived { Ok(()) } else { Err(format!("{accepted} accepted, {arrived} arrived")) }
            });
            run.and(|struck| served.stands_within(END, struck.ended.status.success()))
        });
    }

    /// A call of `ecmsk exec --record` itself fails, or one of the program below it.
    fn recorded(test: &str, whose: Whose) {
        let program = program();
        let file = support::out_dir().join(format!("{test}.pcapng"));
        let name = file.to_str().expect("UTF-8").to_owned();
        let library = support::library().shared.to_str().expect("UTF-8").to_owned();
        let exe = program.exe.to_str().expect("UTF-8").to_owned();
        strike(test, EACH_ONCE, |blow| {
            let _ = fs::remove_file(&file);
            let link = "sim:?slaves=drive&clock=virtual";
            let words = ["exec", "--library", &library, "--link", link, "--record", &name, "--", &exe];
            Run::judge(struck(&mut tool_without_link(&words), whose, blow), |struck| {
                let (accepted, frames) = (accepted(struck)?, whole(&file)? as u64);
                if frames > accepted { Ok(()) } else { Err(format!("{frames} frames of {accepted} are recorded")) }
            })
        });
    }

    #[test]
    fn exec_with_a_recording() {
        recorded("exec_with_a_recording", Whose::Program);
    }

    #[test]
    fn a_program_that_exec_records() {
        recorded("a_program_that_exec_records", Whose::ItsPrograms);
    }
}
