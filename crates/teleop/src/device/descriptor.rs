//! HID report descriptors: where the axes and buttons of a device lie in its input reports.
//!
//! Follows "Device Class Definition for HID" 1.11, section 6.2.2. Layouts are read from the device's own descriptor and
//! never looked up by product: guessed layouts are wrong for other models of the same maker.

use super::DeviceError;

/// Longest report descriptor that is read, bytes; those of multi-axis controllers have about 200.
const MAX_DESCRIPTOR_BYTES: usize = 4096;
/// Maximum number of fields of a layout, and of values of one input item.
const MAX_FIELDS: usize = 512;
/// Maximum nesting of Push items.
const MAX_PUSHED: usize = 8;

/// Usage page of axes.
const GENERIC_DESKTOP: u32 = 0x01;
/// Usage page of buttons.
const BUTTON: u32 = 0x09;
/// Usage of the axis X; those of Y, Z, Rx, Ry and Rz follow it.
const USAGE_X: u32 = 0x30;

/// Fields of a device's input reports that are axes or buttons.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportLayout {
    /// True if reports start with their id.
    has_ids: bool,
    fields: Vec<Field>,
    /// Report ids with the lengths of their reports, bytes, the id included.
    lengths: Vec<(u8, usize)>,
}

/// Field of an input report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Field {
    report: u8,
    /// First bit after the report id, and number of bits.
    bits: (usize, u32),
    /// Logical minimum and maximum.
    range: (i32, i32),
    meaning: Meaning,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    /// X, Y, Z, Rx, Ry, Rz by index.
    Axis(usize),
    /// Number of a button, from 0.
    Button(usize),
}

/// Global items of the descriptor's state table.
#[derive(Clone, Copy, Default)]
struct Globals {
    usage_page: u32,
    logical: (i32, i32),
    /// Logical maximum read as unsigned, which applies if the logical minimum is not negative.
    unsigned_maximum: u32,
    report_size: u32,
    report_count: u32,
    report_id: u8,
}

/// Local items, which apply up to the next main item.
#[derive(Default)]
struct Locals {
    usages: Vec<u32>,
    minimum: Option<u32>,
}

impl ReportLayout {
    /// Layout from a report descriptor.
    ///
    /// # Errors
    /// If the descriptor is too long, cut off or contradictory, or has none of the six axes.
    pub fn parse(descriptor: &[u8]) -> Result<Self, DeviceError> {
        if descriptor.len() > MAX_DESCRIPTOR_BYTES {
            return Err(bad(0, "a report descriptor of at most 4096 bytes"));
        }
        let (mut globals, mut locals) = (Globals::default(), Locals::default());
        let mut pushed = Vec::new();
        let mut layout = Self { has_ids: false, fields: Vec::new(), lengths: Vec::new() };
        // Bits used so far, by report id.
        let mut used = [0_usize; 256];
        let mut at = 0;
        while let Some(&prefix) = descriptor.get(at) {
            let place = at;
            if prefix == 0xfe {
                let size = *descriptor.get(at + 1).ok_or_else(|| bad(place, "a complete long item"))?;
                at += 3 + usize::from(size);
                continue;
            }
            let size = [0, 1, 2, 4][usize::from(prefix & 3)];
            let data = descriptor.get(at + 1..at + 1 + size).ok_or_else(|| bad(place, "a complete item"))?;
            at += 1 + size;
            let (unsigned, signed) = (unsigned(data), signed(data));
            match prefix & 0xfc {
                0x80 => {
                    let offset = &mut used[usize::from(globals.report_id)];
                    layout.input(place, unsigned, &globals, &locals, offset)?;
                    locals = Locals::default();
                }
                0x90 | 0xa0 | 0xb0 | 0xc0 => locals = Locals::default(),
                0x04 => globals.usage_page = unsigned,
                0x14 => globals.logical.0 = signed,
                0x24 => (globals.logical.1, globals.unsigned_maximum) = (signed, unsigned),
                0x74 if unsigned <= 32 => globals.report_size = unsigned,
                0x74 => return Err(bad(place, "fields of at most 32 bits")),
                0x84 => {
                    globals.report_id = u8::try_from(unsigned)
                        .ok()
                        .filter(|id| *id > 0)
                        .ok_or_else(|| bad(place, "a report id from 1 to 255"))?;
                    layout.has_ids = true;
                }
                0x94 if unsigned as usize <= MAX_FIELDS => globals.report_count = unsigned,
                0x94 => return Err(bad(place, "at most 512 values in an item")),
                0xa4 if pushed.len() < MAX_PUSHED => pushed.push(globals),
                0xb4 => globals = pushed.pop().ok_or_else(|| bad(place, "a push before every pop"))?,
                0xa4 => return Err(bad(place, "at most 8 nested pushes")),
                0x08 if locals.usages.len() < MAX_FIELDS => locals.usages.push(usage(unsigned, size, &globals)),
                0x18 => locals.minimum = Some(usage(unsigned, size, &globals)),
                0x28 => {
                    let last = usage(unsigned, size, &globals);
                    let first =
                        locals.minimum.take().ok_or_else(|| bad(place, "a usage minimum before its maximum"))?;
                    let room = MAX_FIELDS.saturating_sub(locals.usages.len());
                    locals.usages.extend((first..=last).take(room));
                }
                _ => {}
            }
        }
        let used = (0_u8..=255).zip(used).filter(|(_, bits)| *bits > 0);
        layout.lengths = used.map(|(id, bits)| (id, bits.div_ceil(8) + usize::from(layout.has_ids))).collect();
        match layout.fields.iter().any(|field| matches!(field.meaning, Meaning::Axis(_))) {
            true => Ok(layout),
            false => Err(bad(0, "one of the axes X, Y, Z, Rx, Ry, Rz in its input reports")),
        }
    }

    /// Adds the fields of an input item.
    fn input(
        &mut self,
        place: usize,
        flags: u32,
        globals: &Globals,
        locals: &Locals,
        offset: &mut usize,
    ) -> Result<(), DeviceError> {
        let (is_constant, is_variable) = (flags & 1 != 0, flags & 2 != 0);
        let (least, most) = globals.logical;
        let most = if least >= 0 { i32::try_from(globals.unsigned_maximum).unwrap_or(i32::MAX) } else { most };
        for index in 0..globals.report_count as usize {
            let start = *offset + index * globals.report_size as usize;
            // The last usage applies to all further values.
            let usage = locals.usages.get(index).or(locals.usages.last()).copied();
            let meaning = usage.filter(|_| !is_constant && is_variable).and_then(meaning);
            let Some(meaning) = meaning else { continue };
            if globals.report_size == 0 || least >= most {
                return Err(bad(place, "axes and buttons with a size and a range of values"));
            }
            if self.fields.len() >= MAX_FIELDS {
                return Err(bad(place, "at most 512 axes and buttons"));
            }
            let bits = (start, globals.report_size);
            self.fields.push(Field { report: globals.report_id, bits, range: (least, most), meaning });
        }
        *offset += globals.report_size as usize * globals.report_count as usize;
        Ok(())
    }

    /// First input report in a stream of bytes, and the bytes after it; `None` if it is not complete. Bytes with an
    /// unknown report id are one report.
    pub fn first_report<'a>(&self, bytes: &'a [u8]) -> Option<(&'a [u8], &'a [u8])> {
        let id = if self.has_ids { *bytes.first()? } else { 0 };
        let length = self.lengths.iter().find(|(known, _)| *known == id).map_or(bytes.len(), |(_, length)| *length);
        bytes.split_at_checked(length).filter(|(report, _)| !report.is_empty())
    }

    /// Applies an input report to the axes (-1 to 1) and to the bit mask of the pressed buttons. Axes and buttons that
    /// it does not contain keep their values.
    ///
    /// # Errors
    /// If the report has no field of the layout.
    pub fn apply(&self, report: &[u8], axes: &mut [f64; 6], buttons: &mut u32) -> Result<(), DeviceError> {
        let (id, body) = match (self.has_ids, report.split_first()) {
            (true, Some((&id, body))) => (id, body),
            (false, Some(_)) => (0, report),
            (_, None) => return Err(DeviceError::EmptyReport),
        };
        let mut is_known = false;
        for field in self.fields.iter().filter(|field| field.report == id) {
            is_known = true;
            let Some(value) = field.value(body) else { continue };
            match field.meaning {
                Meaning::Axis(axis) => axes[axis] = field.deflection(value),
                Meaning::Button(button) if value != 0 => *buttons |= 1 << button,
                Meaning::Button(button) => *buttons &= !(1 << button),
            }
        }
        if is_known { Ok(()) } else { Err(DeviceError::UnknownReport { id }) }
    }
}

impl Field {
    /// Logical value in a report's bytes after its id; `None` if the report is too short.
    fn value(&self, body: &[u8]) -> Option<i64> {
        let (start, size) = self.bits;
        let mut value = 0_u64;
        for bit in 0..size as usize {
            let byte = body.get((start + bit) / 8)?;
            value |= u64::from((byte >> ((start + bit) % 8)) & 1) << bit;
        }
        let is_negative = self.range.0 < 0 && (value >> (size - 1)) & 1 == 1;
        Some(value as i64 - if is_negative { 1 << size } else { 0 })
    }

    /// Deflection of a logical value from the middle of the logical range, -1 to 1.
    fn deflection(&self, value: i64) -> f64 {
        let (least, most) = (f64::from(self.range.0), f64::from(self.range.1));
        ((value as f64 - (least + most) / 2.0) / ((most - least) / 2.0)).clamp(-1.0, 1.0)
    }
}

/// Usage with its page in the upper 16 bits; an item of four bytes states the page itself.
fn usage(value: u32, size: usize, globals: &Globals) -> u32 {
    if size == 4 { value } else { (globals.usage_page << 16) | value }
}

fn meaning(usage: u32) -> Option<Meaning> {
    let (page, id) = (usage >> 16, usage & 0xffff);
    match page {
        GENERIC_DESKTOP => id.checked_sub(USAGE_X).filter(|axis| *axis < 6).map(|axis| Meaning::Axis(axis as usize)),
        BUTTON => id.checked_sub(1).filter(|button| *button < 32).map(|button| Meaning::Button(button as usize)),
        _ => None,
    }
}

fn unsigned(data: &[u8]) -> u32 {
    data.iter().rev().fold(0, |value, byte| (value << 8) | u32::from(*byte))
}

fn signed(data: &[u8]) -> i32 {
    match *data {
        [byte] => i32::from(byte as i8),
        [low, high] => i32::from(i16::from_le_bytes([low, high])),
        _ => unsigned(data) as i32,
    }
}

fn bad(at: usize, expected: &'static str) -> DeviceError {
    DeviceError::Descriptor { at, expected }
}
