//! Parses the objects of `sdo`, given by index or by name, their types and their values.

use std::fmt;

use ecmsk::coe::ObjectAddress;

use crate::board::whole;

/// The data type of an object, of at most 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
}

use Type::{I8, I16, I32, U8, U16, U32};

impl Type {
    const ALL: [(&str, Self); 6] = [("u8", U8), ("i8", I8), ("u16", U16), ("i16", I16), ("u32", U32), ("i32", I32)];

    /// Parses the name of a type: `u8`, `i8`, `u16`, `i16`, `u32` or `i32`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|(name, _)| name.eq_ignore_ascii_case(text));
        known.map(|(_, of)| of).ok_or_else(|| "allowed: u8, i8, u16, i16, u32, i32".into())
    }

    /// The name of the type.
    pub fn name(self) -> &'static str {
        Self::ALL.into_iter().find(|(_, of)| *of == self).map_or("u32", |(name, _)| name)
    }

    /// The size in bits: 8, 16 or 32.
    pub const fn bits(self) -> u32 {
        match self {
            U8 | I8 => 8,
            U16 | I16 => 16,
            U32 | I32 => 32,
        }
    }

    /// Whether the value fits the type. A decimal value must be in the range of the type. A hexadecimal value (0x) may
    /// instead be its bits: 0xFFFF fits `i16` and is -1.
    pub fn takes(self, value: Value) -> bool {
        let (low, high) = match self {
            U8 | U16 | U32 => (0, (1_i64 << self.bits()) - 1),
            I8 | I16 | I32 => (-(1_i64 << (self.bits() - 1)), (1_i64 << (self.bits() - 1)) - 1),
        };
        (low..=high).contains(&value.number) || value.is_bits && (0..1_i64 << self.bits()).contains(&value.number)
    }

    /// Converts the bits of a value of this type to a number.
    pub const fn number(self, raw: u32) -> i64 {
        match self {
            U8 | U16 | U32 => raw as i64,
            I8 => raw as u8 as i8 as i64,
            I16 => raw as u16 as i16 as i64,
            I32 => raw as i32 as i64,
        }
    }
}

/// A value for an object, as the user has written it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Value {
    pub number: i64,
    /// Whether the value was written with 0x. Then it may also be the bits of a negative number.
    is_bits: bool,
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_bits { write!(f, "0x{:X}", self.number) } else { self.number.fmt(f) }
    }
}

impl Value {
    /// Parses a decimal number or a hexadecimal one with 0x.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let number = whole(text).ok_or("allowed: a whole number, decimal or with 0x")?;
        Ok(Self { number, is_bits: text.starts_with("0x") || text.starts_with("0X") })
    }
}

/// An object, with its name and type if they are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Object {
    pub address: ObjectAddress,
    /// The name and type of the object, if it is in [`KNOWN`].
    pub known: Option<(&'static str, Type)>,
}

/// The objects of ETG.1000.6 and CiA 402 that can be given by name.
pub const KNOWN: [(&str, u16, u8, Type); 41] = [
    ("device_type", 0x1000, 0, U32),
    ("error_register", 0x1001, 0, U8),
    ("vendor_id", 0x1018, 1, U32),
    ("product_code", 0x1018, 2, U32),
    ("revision", 0x1018, 3, U32),
    ("serial_number", 0x1018, 4, U32),
    ("error_code", 0x603F, 0, U16),
    ("controlword", 0x6040, 0, U16),
    ("statusword", 0x6041, 0, U16),
    ("quick_stop_option", 0x605A, 0, I16),
    ("fault_reaction_option", 0x605E, 0, I16),
    ("mode", 0x6060, 0, I8),
    ("mode_display", 0x6061, 0, I8),
    ("position_actual", 0x6064, 0, I32),
    ("following_error_window", 0x6065, 0, U32),
    ("following_error_time", 0x6066, 0, U16),
    ("position_window", 0x6067, 0, U32),
    ("position_window_time", 0x6068, 0, U16),
    ("velocity_actual", 0x606C, 0, I32),
    ("target_torque", 0x6071, 0, I16),
    ("max_torque", 0x6072, 0, U16),
    ("torque_actual", 0x6077, 0, I16),
    ("target_position", 0x607A, 0, I32),
    ("home_offset", 0x607C, 0, I32),
    ("software_limit_min", 0x607D, 1, I32),
    ("software_limit_max", 0x607D, 2, I32),
    ("max_profile_velocity", 0x607F, 0, U32),
    ("max_motor_speed", 0x6080, 0, U32),
    ("profile_velocity", 0x6081, 0, U32),
    ("profile_acceleration", 0x6083, 0, U32),
    ("profile_deceleration", 0x6084, 0, U32),
    ("quick_stop_deceleration", 0x6085, 0, U32),
    ("homing_method", 0x6098, 0, I8),
    ("homing_speed_switch", 0x6099, 1, U32),
    ("homing_speed_zero", 0x6099, 2, U32),
    ("homing_acceleration", 0x609A, 0, U32),
    ("following_error", 0x60F4, 0, I32),
    ("digital_inputs", 0x60FD, 0, U32),
    ("digital_outputs", 0x60FE, 1, U32),
    ("target_velocity", 0x60FF, 0, I32),
    ("supported_modes", 0x6502, 0, U32),
];

impl Object {
    /// Parses `0x6064`, `0x6099:1` or a name.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        if let Some((name, index, sub, of)) = KNOWN.into_iter().find(|(name, ..)| name.eq_ignore_ascii_case(text)) {
            return Ok(Self { address: ObjectAddress::new(index, sub), known: Some((name, of)) });
        }
        let (index, sub) = text.split_once(':').unwrap_or((text, "0"));
        // Object indexes are hexadecimal everywhere, so an index without 0x is ambiguous and refused: 6041, read as
        // decimal, would be object 0x1799. A number too large for a hexadecimal index, such as 24641, is read as
        // decimal.
        let is_bare = index.contains(|digit: char| digit.is_ascii_digit()) && !index.starts_with('+');
        if is_bare && u16::from_str_radix(index, 16).is_ok_and(|index| index > 0) {
            let sub = text.strip_prefix(index).unwrap_or_default();
            return Err(format!(
                "did you mean `0x{index}{sub}`? allowed: an index with 0x, such as 0x6064 or 0x6099:1"
            ));
        }
        let index = whole(index).and_then(|index| u16::try_from(index).ok()).filter(|index| *index > 0);
        let sub = whole(sub).and_then(|sub| u8::try_from(sub).ok());
        let Some((index, sub)) = index.zip(sub) else {
            let names = KNOWN.map(|(name, ..)| name);
            let near = names.into_iter().filter(|name| strsim::jaro_winkler(name, text) > 0.8).take(3);
            let near: Vec<_> = near.map(|name| format!("`{name}`")).collect();
            let near = if near.is_empty() { String::new() } else { format!("did you mean {}? ", near.join(", ")) };
            return Err(format!("{near}allowed: an index such as 0x6064 or 0x6099:1, or a name such as statusword"));
        };
        let known = KNOWN.into_iter().find(|(_, i, s, _)| (*i, *s) == (index, sub)).map(|(name, .., of)| (name, of));
        Ok(Self { address: ObjectAddress::new(index, sub), known })
    }
}

impl fmt::Display for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.known {
            Some((name, _)) => write!(f, "{name} ({})", self.address),
            None => self.address.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An object is given by index, decimal or with 0x, or by name. For a wrong name the error lists similar ones.
    #[test]
    fn an_object_is_named_by_number_or_by_name() {
        let statusword = Object::parse("statusword").unwrap();
        assert_eq!(statusword, Object::parse("0x6041").unwrap());
        assert_eq!(statusword, Object::parse("24641:0").unwrap());
        assert_eq!(Object::parse("0x6099:1").unwrap().to_string(), "homing_speed_switch (0x6099:1)");
        assert_eq!(Object::parse("0x2000:0x10").unwrap().address, ObjectAddress::new(0x2000, 16));
        for wrong in ["", "0", "0x10000", "0x6041:256", "0x6041:", ":1", "-1", "0x", "0x+1"] {
            assert!(Object::parse(wrong).is_err(), "{wrong}");
        }
        assert!(Object::parse("statuswrod").unwrap_err().contains("did you mean `statusword`?"));
    }

    /// A value is checked against its type. A value with 0x may be the bits of a negative number.
    #[test]
    fn a_value_is_checked_against_its_type() {
        let takes = |of: Type, text| of.takes(Value::parse(text).unwrap());
        assert!(takes(I8, "-128") && takes(I8, "127") && takes(I8, "0xFF") && !takes(I8, "128") && !takes(I8, "0x100"));
        assert!(takes(U16, "65535") && !takes(U16, "65536") && !takes(U16, "-1") && !takes(U16, "-0x1"));
        assert!(takes(U32, "0xFFFFFFFF") && takes(I32, "-2147483648") && !takes(I32, "2147483648"));
        assert_eq!((I8.number(0xFF), I16.number(0x8000), I32.number(u32::MAX), U8.number(0xFF)), (-1, -32768, -1, 255));
    }
}
