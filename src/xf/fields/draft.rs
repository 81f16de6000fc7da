//! Builds a request from fields.

use super::FunctionFields;
use super::field::{Field, FieldKind, FieldPosition, Value};
use crate::xf::layout::FieldWriter;
use crate::xf::request::{Arguments, Encode, Request};
use crate::xf::{DataSize, Malformed, segment};

/// A request whose fields are set one by one.
#[derive(Debug)]
pub struct Draft<'b> {
    function: &'static FunctionFields,
    written: FieldWriter<'b>,
}

impl<'b> Draft<'b> {
    /// A request whose fields have their defaults. `data` becomes its data segment; the old content is overwritten.
    ///
    /// If the segment is too short for the layout of the function, [`Self::put`] fails for fields beyond the segment,
    /// and [`Self::request`] fails.
    pub fn new(function: &'static FunctionFields, data: &'b mut [u8]) -> Self {
        data.fill(0);
        let arguments = Arguments { parameter: function.function.unwrap_or(0), ..Arguments::NONE };
        let mut draft = Self { function, written: FieldWriter { arguments, data } };
        for field in function.request {
            if let (true, Some(default @ 1..)) = (field.is_number(), field.default) {
                // A default always fits into its field. So the only possible error is a segment that is too short,
                // which `request` reports later.
                let _ = field.put(default, &mut draft.written);
            }
        }
        draft
    }

    /// Sets a field.
    ///
    /// # Errors
    /// The value does not fit into the field, or the field does not fit into the data segment.
    pub fn put(&mut self, field: &Field, value: Value<'_>) -> Result<(), Malformed> {
        match value {
            Value::Number(number) => field.put(field.checked(number)?, &mut self.written),
            Value::Bytes(bytes) => self.put_bytes(field, bytes),
        }
    }

    fn put_bytes(&mut self, field: &Field, bytes: &[u8]) -> Result<(), Malformed> {
        let FieldPosition::Data(at) = field.position else { return Ok(()) };
        if field.bytes > 0 {
            Malformed::at_most(field.name, bytes.len(), field.bytes.into())?;
        }
        self.written.put_at(at.into(), bytes)?;
        if let FieldKind::Objects { count_at } = field.kind {
            let count = (bytes.len() / 4) as u16;
            segment::put_at(self.written.data, count_at.into(), &count.to_le_bytes())?;
        }
        let counting = self.function.request.iter().find(|count| count.counts == Some(field.name));
        let length = i64::try_from(bytes.len()).unwrap_or(i64::MAX);
        counting.map_or(Ok(()), |count| count.put(count.checked(length)?, &mut self.written))
    }

    /// Whether the value that was set in this field is part of the request. Some fields belong only to certain
    /// operations, such as the data of a write; with another operation the request's type ignores them.
    pub fn keeps(&self, field: &Field) -> bool {
        let mut data = [0; DataSize::MAX.bytes()];
        let Ok((_, arguments)) = self.request().and_then(|request| request.command(&mut data)) else { return false };
        let (width, written) = (usize::from(field.bytes), &self.written);
        match field.position {
            FieldPosition::Parameter => arguments.parameter == written.arguments.parameter,
            FieldPosition::Info(byte) => {
                let place = byte.into()..usize::from(byte) + width;
                arguments.info[place.clone()] == written.arguments.info[place]
            }
            FieldPosition::Data(at) => {
                let is_tail = width == 0;
                let end = if is_tail { written.arguments.len.into() } else { usize::from(at) + width };
                let place = usize::from(at)..end;
                let is_there = !is_tail || usize::from(arguments.len) >= end;
                is_there && data.get(place.clone()) == written.data.get(place)
            }
            FieldPosition::Reserve | FieldPosition::Length | FieldPosition::Return => true,
        }
    }

    /// Decodes the request from its fields.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    pub fn request(&self) -> Result<Request<'_>, Malformed> {
        Request::decode(self.function.code, &self.written.arguments, self.written.data)
    }
}
