//! The floating-point state of the processor. Rust code needs the default one, but programs enable exceptions (Delphi and
//! C++Builder do) or change the rounding. Every call sets the default state and restores the caller's when it ends.

/// The default state is in force until this is dropped, which restores the caller's.
pub use state::FloatingPoint;

#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
mod state {
    use std::arch::asm;

    pub struct FloatingPoint {
        /// The caller's MXCSR, if it differs from the default.
        sse: Option<u32>,
        /// The caller's x87 control word, if it differs from the default.
        x87: Option<u16>,
    }

    /// The default MXCSR: all exceptions masked, rounding to nearest, denormals not flushed.
    const SSE: u32 = 0x1F80;
    /// The bits of MXCSR that record which exceptions have occurred.
    const SSE_FLAGS: u32 = 0x3F;
    /// The default x87 control word: all exceptions masked, rounding to nearest, 64 bits of precision. The 53 bits that
    /// Microsoft's C library sets are left as they are, so the check below leaves out one bit of the precision.
    const X87: u16 = 0x037F;
    const X87_CHECKED_BITS: u16 = 0x0E3F;
    const X87_CHECKED_VALUE: u16 = 0x023F;

    impl FloatingPoint {
        /// Sets the default state.
        #[inline]
        pub fn begin() -> Self {
            let (sse, x87) = (sse(), x87());
            let sse = (sse & !SSE_FLAGS != SSE).then_some(sse);
            let x87 = (x87 & X87_CHECKED_BITS != X87_CHECKED_VALUE).then_some(x87);
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
            if let Some(of_caller) = self.sse {
                set_sse(of_caller);
            }
            if let Some(of_caller) = self.x87 {
                set_x87(of_caller);
            }
        }
    }

    fn sse() -> u32 {
        let mut state = 0_u32;
        // SAFETY: the instruction writes the four bytes of `state`.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut state, options(nostack, preserves_flags)) };
        state
    }

    fn set_sse(state: u32) {
        // SAFETY: the instruction reads the four bytes of `state`, which has no reserved bit set: it is the default or came
        // from `sse`.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const state, options(nostack, preserves_flags)) };
    }

    fn x87() -> u16 {
        let mut state = 0_u16;
        // SAFETY: the instruction writes the two bytes of `state`.
        unsafe { asm!("fnstcw word ptr [{}]", in(reg) &raw mut state, options(nostack, preserves_flags)) };
        state
    }

    fn set_x87(state: u16) {
        // `fnclex` clears exceptions that occurred while they were masked, which would be raised when they are unmasked.
        // SAFETY: the instruction reads the two bytes of `state`, which is the default or came from `x87`.
        unsafe { asm!("fnclex", "fldcw word ptr [{}]", in(reg) &raw const state, options(nostack)) };
    }
}

/// On processors other than x86 programs do not change the floating-point state, so it is neither set nor restored.
#[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
mod state {
    pub struct FloatingPoint;

    impl FloatingPoint {
        pub const fn begin() -> Self {
            Self
        }
    }
}
