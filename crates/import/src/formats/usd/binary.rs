//! Limits of a binary layer (usdc): sizes, counts, nesting depth and offsets are checked before the library reads it,
//! since the library trusts them.
//!
//! An excessive count would abort the program for lack of memory, and values that contain themselves would overflow the
//! stack; neither can be caught. All other damage is detected by the library.

use super::text;

/// First bytes of a binary layer.
pub const MAGIC: &[u8] = b"PXR-USDC";
/// Maximum number of tokens, of fields, of field sets, of paths, and of specs (prims and properties).
const MAX_ENTRIES: u64 = 1 << 20;
/// Maximum size of the values of one field, of a section after decompression, and of all paths as text, bytes.
const MAX_BYTES: u64 = 256 << 20;
/// Maximum nesting depth of paths, and of dictionaries and time samples.
const MAX_DEPTH: usize = 256;
const MAX_VALUE_DEPTH: usize = 32;
/// Maximum number of nested values in one field.
const MAX_VALUES: usize = 1 << 20;

/// Flags of a value representation (64 bits): array, inlined (the payload is the value), and compressed.
const ARRAY: u64 = 1 << 63;
const INLINED: u64 = 1 << 62;
const COMPRESSED: u64 = 1 << 61;

/// Checks the limits of a layer that starts with [`MAGIC`].
///
/// # Errors
/// If the version is older than 0.4.0, an offset lies outside the layer, or a limit is exceeded; the message names the
/// section.
pub fn check(bytes: &[u8]) -> Result<(), String> {
    let mut at = At { bytes, place: 16 };
    let minor = bytes.get(9).copied().unwrap_or_default();
    if bytes.get(8) != Some(&0) || minor < 4 {
        return Err("of a version of the binary format that is not supported; expected 0.4.0 or newer".into());
    }
    at.place = at.count("the place of the table of contents")?;
    let count = at.count("the table of contents")?;
    let mut sections = Vec::new();
    for _ in 0..count.min(64) {
        let name = at.take(16, "the table of contents")?;
        let name: Vec<u8> = name.iter().copied().take_while(|&byte| byte != 0).collect();
        sections.push((name, at.count("the table of contents")?));
        at.count("the table of contents")?;
    }
    let section = |name: &str| {
        let found = sections.iter().find(|(known, _)| known == name.as_bytes());
        found.map(|&(_, place)| At { bytes, place })
    };
    let mut tokens = Vec::new();
    if let Some(mut at) = section("TOKENS") {
        at.entries("tokens")?;
        let size = at.count("tokens")?;
        tokens = at.unpacked(size, "tokens")?;
        for token in tokens.split(|&byte| byte == 0) {
            text::check_expression(token)?;
        }
    }
    if let Some(mut at) = section("STRINGS") {
        let count = at.count("strings")?;
        at.several(count, 4, "strings")?;
    }
    if let Some(mut at) = section("FIELDSETS") {
        let count = at.entries("sets of fields")?;
        at.integers(count, "sets of fields")?;
    }
    if let Some(mut at) = section("SPECS") {
        let count = at.entries("prims and properties")?;
        for _ in 0..3 {
            at.integers(count, "prims and properties")?;
        }
    }
    if let Some(mut at) = section("PATHS") {
        at.entries("paths")?;
        let count = at.entries("paths")?;
        at.integers(count, "paths")?;
        let names = at.integers(count, "paths")?;
        let jumps = at.integers(count, "paths")?;
        let lengths: Vec<u64> = tokens.split(|&byte| byte == 0).map(|token| token.len() as u64 + 1).collect();
        check_paths(&names, &jumps, &lengths)?;
    }
    if let Some(mut at) = section("FIELDS") {
        let count = at.entries("fields")?;
        at.integers(count, "fields")?;
        let held = at.unpacked(8 * count, "fields")?;
        for (index, value) in held.chunks_exact(8).enumerate() {
            let value = u64::from_le_bytes(value.try_into().map_err(|_| "fields: damaged")?);
            let mut values = Values { bytes, minor, left: MAX_VALUES, size: 0 };
            values.check(value, 0).map_err(|message| format!("field {index}: {message}"))?;
        }
    }
    Ok(())
}

/// Traverses the path tree as the library does and checks that it ends. A jump greater than 0 is the offset to the
/// sibling of an entry that also has a child; 0 is a sibling alone, -1 a child alone, -2 neither. `lengths` are those
/// of the tokens, bytes.
fn check_paths(names: &[i32], jumps: &[i32], lengths: &[u64]) -> Result<(), String> {
    let (mut open, mut visited, mut total) = (vec![(0_usize, 0_usize, 0_u64)], 0, 0_u64);
    while let Some((mut index, mut depth, mut length)) = open.pop() {
        loop {
            let (Some(&jump), Some(name)) = (jumps.get(index), names.get(index)) else {
                return Err("paths: they continue beyond their end".into());
            };
            let own = lengths.get(name.unsigned_abs() as usize).copied().unwrap_or(1) + length;
            (visited, total) = (visited + 1, total + own);
            if visited > jumps.len() {
                return Err("paths: they lead to each other".into());
            }
            if depth > MAX_DEPTH || total > MAX_BYTES {
                return Err(format!("paths: nested deeper than {MAX_DEPTH}, or longer than {} MiB", MAX_BYTES >> 20));
            }
            if jump > 0 {
                open.push((index + jump as usize, depth, length));
            }
            // The next entry is the child or, with a jump of 0, the sibling; otherwise the branch ends.
            if jump > 0 || jump == -1 {
                (depth, length) = (depth + 1, own);
            } else if jump != 0 {
                break;
            }
            index += 1;
        }
    }
    Ok(())
}

/// Cursor into the bytes of a layer.
#[derive(Clone, Copy)]
struct At<'a> {
    bytes: &'a [u8],
    place: u64,
}

impl<'a> At<'a> {
    fn take(&mut self, size: u64, what: &str) -> Result<&'a [u8], String> {
        let end = self.place.checked_add(size);
        let range = end.and_then(|end| Some(usize::try_from(self.place).ok()?..usize::try_from(end).ok()?));
        let taken = range.and_then(|range| self.bytes.get(range));
        let taken = taken.ok_or_else(|| format!("{what}: {size} bytes at {} exceed the file", self.place))?;
        self.place += size;
        Ok(taken)
    }

    fn several(&mut self, count: u64, size: u64, what: &str) -> Result<(), String> {
        let size = count.checked_mul(size).ok_or_else(|| format!("{what}: {count} exceed the file"))?;
        self.take(size, what).map(drop)
    }

    fn small(&mut self, what: &str) -> Result<u32, String> {
        let bytes = self.take(4, what)?;
        Ok(bytes.iter().rev().fold(0, |sum, &byte| sum << 8 | u32::from(byte)))
    }

    fn count(&mut self, what: &str) -> Result<u64, String> {
        let bytes = self.take(8, what)?;
        Ok(bytes.iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte)))
    }

    fn entries(&mut self, what: &str) -> Result<u64, String> {
        let count = self.count(what)?;
        if count > MAX_ENTRIES {
            return Err(format!("{count} {what}; at most {MAX_ENTRIES} are supported"));
        }
        Ok(count)
    }

    /// Decompresses an LZ4 block to at most `size` bytes.
    fn unpacked(&mut self, size: u64, what: &str) -> Result<Vec<u8>, String> {
        if size > MAX_BYTES {
            return Err(format!("{what}: {size} bytes; at most {} MiB are supported", MAX_BYTES >> 20));
        }
        let packed = self.count(what)?;
        let packed = self.take(packed, what)?;
        let mut unpacked = vec![0; size as usize];
        match packed {
            [0, packed @ ..] => {
                let size =
                    lz4_flex::block::decompress_into(packed, &mut unpacked).map_err(|e| format!("{what}: {e}"))?;
                unpacked.truncate(size);
                Ok(unpacked)
            }
            [_, ..] => Err(format!("{what}: a block of more than 127 MiB is not supported")),
            [] => Err(format!("{what}: an empty block")),
        }
    }

    /// Decompresses `count` integers. They are stored as differences, each of 1, 2 or 4 bytes, or of none for the most
    /// common difference; a code of two bits states which.
    fn integers(&mut self, count: u64, what: &str) -> Result<Vec<i32>, String> {
        let codes = count.div_ceil(4);
        let unpacked = self.unpacked(if count == 0 { 0 } else { 4 + codes + 4 * count }, what)?;
        let mut read = At { bytes: &unpacked, place: 0 };
        if count == 0 {
            return Ok(Vec::new());
        }
        let common = read.small(what)?.cast_signed();
        let codes = read.take(codes, what)?;
        let (mut last, mut integers) = (0_i32, Vec::new());
        for index in 0..count as usize {
            let difference = match codes[index / 4] >> (2 * (index % 4)) & 3 {
                0 => common,
                1 => i32::from(read.take(1, what)?[0].cast_signed()),
                2 => {
                    let bytes = read.take(2, what)?;
                    i32::from(i16::from_le_bytes([bytes[0], bytes[1]]))
                }
                _ => read.small(what)?.cast_signed(),
            };
            last = last.wrapping_add(difference);
            integers.push(last);
        }
        Ok(integers)
    }
}

/// Check of the values of one field.
struct Values<'a> {
    bytes: &'a [u8],
    /// Minor version of the format: 0.`minor`.
    minor: u8,
    /// Number of further values that are allowed.
    left: usize,
    /// Estimated memory of the values checked so far, bytes.
    size: u64,
}

impl<'a> Values<'a> {
    /// Checks the value that a 64-bit value representation refers to, with all values in it.
    fn check(&mut self, value: u64, depth: usize) -> Result<(), String> {
        if depth > MAX_VALUE_DEPTH || self.left == 0 {
            return Err(format!("nested deeper than {MAX_VALUE_DEPTH}, or more than {MAX_VALUES} values"));
        }
        self.left -= 1;
        let (kind, place) = (value >> 48 & 0xff, value & ((1 << 48) - 1));
        // The library reads arrays and payload lists (55) from the file even if they are flagged as inlined.
        if value & INLINED != 0 && value & ARRAY == 0 && kind != 55 {
            return Ok(());
        }
        let mut at = At { bytes: self.bytes, place };
        match kind {
            31 => self.dictionary(&mut at, depth),
            32..=39 | 54 | 55 => self.edits(&mut at, kind, depth),
            40 | 41 | 50 => self.list(&mut at, 4),
            45 | 58 => self.list(&mut at, 8),
            49 => self.list(&mut at, 16),
            46 => self.samples(&mut at, depth),
            // Arrays of strings (10), asset paths (12) and path expressions (57) are lists of 32-bit indices.
            10 | 12 | 57 if value & ARRAY != 0 => self.list(&mut at, 4),
            _ if (value & ARRAY != 0 || kind == 48) && place != 0 => self.array(&mut at, kind, value & COMPRESSED != 0),
            _ => Ok(()),
        }
    }

    fn grow(&mut self, count: u64, size: u64) -> Result<(), String> {
        self.size = self.size.saturating_add(count.saturating_mul(size));
        if self.size > MAX_BYTES {
            return Err(format!("{count} values of {size} bytes; at most {} MiB are supported", MAX_BYTES >> 20));
        }
        Ok(())
    }

    fn list(&mut self, at: &mut At<'a>, size: u64) -> Result<(), String> {
        let count = at.count("a list")?;
        // An item takes at least 48 bytes in memory, as a string or path.
        self.grow(count, size.max(48))?;
        at.several(count, size, "a list")
    }

    fn array(&mut self, at: &mut At<'a>, kind: u64, is_compressed: bool) -> Result<(), String> {
        const WHAT: &str = "an array";
        if self.minor < 5 {
            at.small(WHAT)?;
        }
        let count = if self.minor < 7 { u64::from(at.small(WHAT)?) } else { at.count(WHAT)? };
        let size = match kind {
            1 | 2 => 1,
            7 => 2,
            3 | 4 | 8 | 11 | 21 => 4,
            25 => 6,
            5 | 6 | 9 | 18 | 20 | 22 | 29 | 48 | 56 => 8,
            24 | 26 => 12,
            17 | 19 | 28 | 30 => 16,
            23 => 24,
            16 | 27 | 13 => 32,
            14 => 72,
            _ => 128,
        };
        self.grow(count, if kind == 11 { 16 } else { size })?;
        let [is_integers, is_floats] = [(3..=6).contains(&kind), matches!(kind, 7..=9 | 48 | 56)];
        if count < 4 || !is_compressed || !(is_integers && self.minor >= 5 || is_floats && self.minor >= 6) {
            // Types without a fixed size are refused by the library.
            return if size == 128 && kind != 15 { Ok(()) } else { at.several(count, size, WHAT) };
        }
        if is_floats && at.take(1, WHAT)? == b"t" {
            let count = at.small(WHAT)?;
            at.several(count.into(), size, WHAT)?;
        }
        let packed = at.count(WHAT)?;
        at.take(packed, WHAT).map(drop)
    }

    /// Checks a list operation: lists of explicit, added, prepended, appended, deleted and ordered items, each present
    /// if its bit in the header is set.
    fn edits(&mut self, at: &mut At<'a>, kind: u64, depth: usize) -> Result<(), String> {
        let present = at.take(1, "an edited list")?[0] >> 1;
        for _ in 0..(present & 0x3f).count_ones() {
            match kind {
                37 | 39 => self.list(at, 8)?,
                35 => {
                    let count = at.count("references")?;
                    self.grow(count, 256)?;
                    for _ in 0..count {
                        at.several(24, 1, "references")?;
                        self.dictionary(at, depth)?;
                    }
                }
                55 => {
                    let count = at.count("payloads")?;
                    self.grow(count, 256)?;
                    at.several(count, if self.minor < 8 { 8 } else { 24 }, "payloads")?;
                }
                _ => self.list(at, 4)?,
            }
        }
        Ok(())
    }

    /// Moves the cursor by the signed offset stored at it, relative to the offset's own position.
    fn jump(at: &mut At<'a>) -> Result<(), String> {
        let start = at.place;
        let offset = at.count("a value")?.cast_signed();
        at.place = start.checked_add_signed(offset).ok_or("a value: before the start of the file")?;
        Ok(())
    }

    fn dictionary(&mut self, at: &mut At<'a>, depth: usize) -> Result<(), String> {
        for _ in 0..at.count("a dictionary")? {
            at.small("a dictionary")?;
            Self::jump(at)?;
            let value = at.count("a dictionary")?;
            self.check(value, depth + 1)?;
        }
        Ok(())
    }

    fn samples(&mut self, at: &mut At<'a>, depth: usize) -> Result<(), String> {
        Self::jump(at)?;
        let times = at.count("time samples")?;
        self.check(times, depth + 1)?;
        Self::jump(at)?;
        let count = at.count("time samples")?;
        self.grow(count, 8)?;
        for _ in 0..count {
            let value = at.count("time samples")?;
            self.check(value, depth + 1)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An LZ4 block of literals only, i.e. not compressed.
    fn block(bytes: &[u8]) -> Vec<u8> {
        let mut packed = vec![0, (bytes.len().min(15) as u8) << 4];
        if let Some(more) = bytes.len().checked_sub(15) {
            packed.extend(vec![255; more / 255]);
            packed.push((more % 255) as u8);
        }
        packed.extend(bytes);
        [&(packed.len() as u64).to_le_bytes()[..], &packed].concat()
    }

    /// Encodes integers with differences of four bytes each.
    fn integers(values: &[i32]) -> Vec<u8> {
        let before = [0].iter().chain(values);
        let differences: Vec<u8> =
            values.iter().zip(before).flat_map(|(own, last)| (own - last).to_le_bytes()).collect();
        block(&[&[0; 4][..], &vec![0xff; values.len().div_ceil(4)], &differences].concat())
    }

    /// A binary layer with one section, which starts at byte 64.
    fn layer(name: &str, section: &[u8]) -> Vec<u8> {
        let mut bytes = [MAGIC, &[0, 8, 0, 0, 0, 0, 0, 0], &24_u64.to_le_bytes(), &1_u64.to_le_bytes()].concat();
        bytes.extend(name.bytes().chain(std::iter::repeat(0)).take(16));
        bytes.extend(64_u64.to_le_bytes());
        bytes.extend((section.len() as u64).to_le_bytes());
        assert_eq!(bytes.len(), 64);
        bytes.extend(section);
        bytes
    }

    /// A layer with one field of this value representation, and the bytes `held` from [`PLACE`] on.
    fn field(value: u64, held: &[u8]) -> Vec<u8> {
        let section = [&1_u64.to_le_bytes()[..], &integers(&[0]), &block(&value.to_le_bytes())].concat();
        let mut bytes = layer("FIELDS", &section);
        bytes.resize(PLACE as usize, 0);
        bytes.extend(held);
        bytes
    }

    const PLACE: u64 = 512;

    #[track_caller]
    fn refused(bytes: &[u8], why: &str) {
        let said = check(bytes).unwrap_err();
        assert!(said.contains(why), "{said}");
    }

    #[test]
    fn paths_that_lead_to_each_other_are_refused() {
        let paths = |jumps: &[i32]| {
            let (count, zeros) = ((jumps.len() as u64).to_le_bytes(), integers(&vec![0; jumps.len()]));
            layer("PATHS", &[&count[..], &count, &zeros, &zeros, &integers(jumps)].concat())
        };
        // Each entry has the next one as both child and sibling, which makes 2^63 paths.
        refused(&paths(&[&[1; 63][..], &[-2]].concat()), "lead to each other");
        refused(&paths(&[-1; 64]), "beyond their end");
        refused(&paths(&[-1; 600]), "nested deeper");
        assert_eq!(check(&paths(&[-1, 2, -2, 0, -2])), Ok(()));
    }

    #[test]
    fn counts_beyond_the_file_are_refused() {
        refused(MAGIC, "version");
        refused(&layer("TOKENS", &[0xff; 24]), "tokens");
        refused(
            &layer("TOKENS", &[&1_u64.to_le_bytes()[..], &(1_u64 << 40).to_le_bytes()].concat()),
            "at most 256 MiB",
        );
        refused(&layer("SPECS", &(1_u64 << 30).to_le_bytes()), "at most");
        refused(&layer("STRINGS", &(1_u64 << 62).to_le_bytes()), "exceed");
        let array = |kind: u64| ARRAY | kind << 48 | PLACE;
        let count = |count: u64| [&count.to_le_bytes()[..], &[0; 64]].concat();
        assert_eq!(check(&field(array(24), &count(4))), Ok(()));
        refused(&field(array(24), &count(6)), "exceed the file");
        refused(&field(array(24), &count(1 << 40)), "at most 256 MiB");
        refused(&field(array(24) | INLINED, &count(1 << 40)), "at most 256 MiB");
        refused(&field(array(8) | COMPRESSED, &count(1 << 40)), "at most 256 MiB");
        refused(&field(41 << 48 | PLACE, &count(1 << 20)), "exceed the file");
        refused(&field(32 << 48 | PLACE, &[2, 0, 0, 0, 0, 0, 0, 0, 1]), "at most 256 MiB");
    }

    #[test]
    fn values_that_contain_themselves_are_refused() {
        let itself = 31 << 48 | PLACE;
        let dictionary =
            |count: u64| [&count.to_le_bytes()[..], &[0; 4], &8_i64.to_le_bytes(), &u64::to_le_bytes(itself)].concat();
        refused(&field(itself, &dictionary(1)), "nested deeper");
        let samples = 46 << 48 | PLACE;
        let times = 48 << 48 | (PLACE + 40);
        let held = [8, times, 8, 1, samples, 1, 0].map(u64::to_le_bytes).concat();
        refused(&field(samples, &held), "nested deeper");
    }
}
