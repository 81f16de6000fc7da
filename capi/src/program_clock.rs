//! The clock of a program whose waits take virtual time (`ecmsk exec --clock virtual`). The library that the tool
//! preloads keeps this clock, and this module connects it with the boards on virtual time. A wait of the program lets
//! the boards' time pass, and a call that lets a board's time pass advances the program's clock. Without the preloaded
//! library nothing happens here.

#[cfg(target_os = "linux")]
pub use system::find;
pub use system::{BoardClock, InLibrary, turn};

#[cfg(target_os = "linux")]
#[path = "../../sleep/src/table.rs"]
mod table;

#[cfg(target_os = "linux")]
mod system {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::OnceLock;
    use std::time::Duration;

    use ecmsk::link::{Link, PASS_MAX, use_program_clock};

    use super::table::{GetTable, NAME, Table, VERSION};
    use crate::floating_point::FloatingPoint;
    use crate::{forked, open_boards};

    /// The preloaded library; `None`: there is none.
    fn preloaded() -> Option<&'static Table> {
        static FOUND: OnceLock<Option<&'static Table>> = OnceLock::new();
        *FOUND.get_or_init(|| {
            // SAFETY: the name ends with 0.
            let function = unsafe { libc::dlsym(libc::RTLD_DEFAULT, NAME.as_ptr()) };
            if function.is_null() {
                return None;
            }
            // SAFETY: only the preloaded library has a function of that name, and it is of this type.
            let get_table = unsafe { std::mem::transmute::<*mut libc::c_void, GetTable>(function) };
            // SAFETY: the table is never freed, and its first member is the same in all versions.
            let table = unsafe { get_table().as_ref() }.filter(|table| table.version == VERSION)?;
            (table.use_boards)(pass_to);
            use_program_clock(|| preloaded().map_or(0, |table| (table.now)()));
            Some(table)
        })
    }

    /// Looks for the preloaded library, before main. If it were looked for later, a fork could happen during the search
    /// of another thread, and the child would wait forever for the end of that search.
    pub fn find() {
        preloaded();
    }

    /// Lets the time of all open boards pass up to a time of the program's clock.
    extern "C" fn pass_to(time: u64) {
        // A child of fork must not use its parent's boards, nor their locks.
        if !forked::is_forked() {
            let _floating_point = FloatingPoint::begin();
            let _ = catch_unwind(AssertUnwindSafe(|| open_boards::each(|board| board.pass_to(time))));
        }
    }

    /// To be called before a call that lets a board's time pass. Waits until all other threads of the program wait, so
    /// that threads whose wait ends at the present time run first.
    pub fn turn() {
        if let Some(table) = preloaded() {
            (table.turn)();
        }
    }

    /// Marks this thread as being in this library until this is dropped: its clocks and waits are real ones.
    pub struct InLibrary(Option<&'static Table>);

    impl InLibrary {
        pub fn begin() -> Self {
            let table = preloaded();
            if let Some(table) = table {
                (table.enter)();
            }
            Self(table)
        }
    }

    impl Drop for InLibrary {
        fn drop(&mut self) {
            if let Some(table) = self.0 {
                (table.leave)();
            }
        }
    }

    /// Relates the time of a board on virtual time to the program's clock: the readings of both at one moment, in
    /// nanoseconds.
    pub struct BoardClock {
        table: &'static Table,
        program: u64,
        board: u64,
    }

    impl BoardClock {
        /// For a board that was just opened; `None` if the program has no virtual clock, or if the board's time is
        /// real.
        pub fn begin(link: &dyn Link) -> Option<Self> {
            let (table, info) = (preloaded()?, link.info());
            (table.opened)(info.virtual_time);
            info.virtual_time.then(|| Self { table, program: (table.now)(), board: info.opened_at.0 })
        }

        /// The board's time on the program's clock; `None`: the board is lost or closed.
        fn of_board(&self, link: &dyn Link) -> Option<u64> {
            let now = link.pass(Duration::ZERO).ok().flatten()?;
            Some(self.program.saturating_add(now.0.saturating_sub(self.board)))
        }

        /// Lets the board's time pass up to a time of the program's clock. A board that is lost or closed keeps its time.
        pub fn pass_to(&self, link: &dyn Link, time: u64) {
            let Some(of_board) = self.of_board(link) else { return };
            let mut left = Duration::from_nanos(time.saturating_sub(of_board));
            while !left.is_zero() {
                let step = left.min(PASS_MAX);
                if link.pass(step).is_err() {
                    return;
                }
                left -= step;
            }
        }

        /// To be called before a call that lets the board's time pass: advances the board to the program's time.
        pub fn before(&self, link: &dyn Link) {
            self.pass_to(link, (self.table.now)());
        }

        /// To be called after a call that lets the board's time pass: advances the program's clock to the board's time.
        pub fn after(&self, link: &dyn Link) {
            if let Some(of_board) = self.of_board(link) {
                (self.table.reached)(of_board);
            }
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    use ecmsk::link::Link;

    pub const fn turn() {}

    pub struct InLibrary;

    impl InLibrary {
        pub const fn begin() -> Self {
            Self
        }
    }

    pub struct BoardClock;

    impl BoardClock {
        pub fn begin(_link: &dyn Link) -> Option<Self> {
            None
        }

        pub fn before(&self, _link: &dyn Link) {}

        pub fn after(&self, _link: &dyn Link) {}
    }
}
