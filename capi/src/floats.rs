//! Floating point as Rust code needs it, whatever the caller uses: programs switch exceptions on (Delphi and C++Builder do)
//! or round otherwise, and their state is theirs again when a call ends.

/// The caller's state; it is put back when this is dropped.
pub use state::FloatingPoint;

#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
mod state {
    use std::arch::asm;

    pub struct FloatingPoint {
        sse: Option<u32>,
        x87: Option<u16>,
    }

    /// SSE: every exception masked, to nearest, denormals as they are. Bits 0 to 5 say what has happened so far.
    const SSE: u32 = 0x1F80;
    const SSE_HAPPENED: u32 = 0x3F;
    /// x87: every exception masked, to nearest, 64 bits. What is not so is put right; 53 bits, which Microsoft's C library sets,
    /// will do.
    const X87: u16 = 0x037F;
    const X87_SEEN: u16 = 0x0E3F;
    const X87_RIGHT: u16 = 0x023F;

    impl FloatingPoint {
        /// Makes the state ours.
        #[inline]
        pub fn begin() -> Self {
            let (sse, x87) = (sse(), x87());
            let sse = (sse & !SSE_HAPPENED != SSE).then_some(sse);
            let x87 = (x87 & X87_SEEN != X87_RIGHT).then_some(x87);
            if sse.is_some() {
                set_sse(SSE);
            }
            if x87.is_some() {
                set_x87(X87);
            }
            Self { sse, x87 }
        }
    }

    impl Drop for FloatingPoint {
        fn drop(&mut self) {
            if let Some(theirs) = self.sse {
                set_sse(theirs);
            }
            if let Some(theirs) = self.x87 {
                set_x87(theirs);
            }
        }
    }

    fn sse() -> u32 {
        let mut state = 0_u32;
        // SAFETY: it writes four bytes, for which there is room.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut state, options(nostack, preserves_flags)) };
        state
    }

    fn set_sse(state: u32) {
        // SAFETY: it reads four bytes; no bit is reserved, for the state is ours or came from `sse`.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const state, options(nostack, preserves_flags)) };
    }

    fn x87() -> u16 {
        let mut state = 0_u16;
        // SAFETY: it writes two bytes, for which there is room.
        unsafe { asm!("fnstcw word ptr [{}]", in(reg) &raw mut state, options(nostack, preserves_flags)) };
        state
    }

    fn set_x87(state: u16) {
        // What has happened while exceptions were masked must not be raised now that they are not.
        // SAFETY: it reads two bytes, a state of ours or one that came from `x87`.
        unsafe { asm!("fnclex", "fldcw word ptr [{}]", in(reg) &raw const state, options(nostack)) };
    }
}

/// Elsewhere programs leave the state as it is.
#[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
mod state {
    /// Nothing is to be done.
    pub struct FloatingPoint;

    impl FloatingPoint {
        /// Nothing is to be done.
        pub const fn begin() -> Self {
            Self
        }
    }
}
