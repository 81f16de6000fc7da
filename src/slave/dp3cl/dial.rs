//! The dial switch SW1 to SW8: motor current, holding current, command filter, direction, and station number.

use super::rating::Rating;

/// The positions of the dial switch: bit 0 is SW1, bit 7 is SW8; 1 is ON.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dial(pub u8);

/// Peak currents of the ratings A3, A7 and A8, mA: for the codes 1 to 7 of SW1 to SW3 (SW1 is bit 0). With code 0 the
/// current comes from parameter P4-00.
const PEAK_305_MA: [u16; 7] = [560, 840, 1400, 1820, 2100, 2660, 3000];
const PEAK_705_MA: [u16; 7] = [2500, 3400, 4200, 5000, 5600, 6400, 7000];
const PEAK_808_MA: [u16; 7] = [2700, 3600, 4600, 5500, 6400, 7300, 8400];

impl Dial {
    /// The peak current that SW1 to SW3 select, mA; `None`: the current comes from parameter P4-00. In station mode
    /// (SW8 on) it is always `None`, because SW1 to SW7 are the station number.
    pub const fn peak_ma(self, rating: Rating) -> Option<u16> {
        let code = (self.0 & 0b111) as usize;
        if code == 0 || self.sets_station() {
            return None;
        }
        Some(match rating {
            Rating::A3 => PEAK_305_MA[code - 1],
            Rating::A7 => PEAK_705_MA[code - 1],
            Rating::A8 => PEAK_808_MA[code - 1],
        })
    }

    /// SW4: whether the motor keeps its full current at standstill.
    pub const fn holds_full_current(self) -> bool {
        !self.sets_station() && self.0 & 1 << 3 != 0
    }

    /// The filter time that SW5 and SW6 select, microseconds; 0: the command filter is off; `None`: the time comes from
    /// parameter P0-02, because both are off or SW8 is on.
    pub const fn filter_us(self) -> Option<u32> {
        if self.sets_station() {
            return None;
        }
        match self.0 >> 4 & 0b11 {
            0b00 => None,
            0b10 => Some(3000),
            0b01 => Some(12_000),
            _ => Some(0),
        }
    }

    /// SW7: whether the motor turns clockwise for increasing positions, the reverse of the usual direction.
    pub const fn is_reversed(self) -> bool {
        !self.sets_station() && self.0 & 1 << 6 != 0
    }

    /// SW8, station mode: whether SW1 to SW7 give the station number.
    pub const fn sets_station(self) -> bool {
        self.0 & 1 << 7 != 0
    }

    /// The station number, 1 to 127; `None` if the switch does not give one. \[OURS] Number 0 counts as none too.
    pub const fn station(self) -> Option<u16> {
        match self.0 & 0x7F {
            number if number != 0 && self.sets_station() => Some(number as u16),
            _ => None,
        }
    }
}
