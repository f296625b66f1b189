//! What a linked image can call, and what its functions take of the stack: read from the machine code.
//!
//! A Thumb-2 function is decoded in address order, as far as it concerns the flow between functions and the stack pointer:
//! `bl`, `b.w`, `b<c>.w`, `b`, `cbz` for the former (a branch that stays inside its function is none), `push`, `vpush`, `sub sp`
//! and their kin for the latter. Encodings are those of the ARMv7-M Architecture Reference Manual, A5 and A7. Mapping symbols
//! (`$t`, `$d`: ELF for the Arm Architecture, 5.5.5) tell instructions from tables and constants.
//!
//! What a function takes of the stack is the sum of everything it ever takes: never too little, and too much only where two
//! paths through it take different amounts.

use std::collections::{BTreeMap, BTreeSet};

use object::{Object as _, ObjectSection as _, ObjectSymbol as _};

use crate::Failure;
use crate::build::Image;

/// Every function of an image.
pub(crate) struct Program {
    functions: BTreeMap<u32, Function>,
}

/// A function's name, code size, stack and calls.
#[derive(Default)]
pub(crate) struct Function {
    /// Its name, without hash.
    pub(crate) name: String,
    /// Bytes of code.
    pub(crate) bytes: u32,
    /// Bytes of stack.
    pub(crate) frame: u32,
    /// Where it calls or jumps to, by address.
    pub(crate) calls: BTreeSet<u32>,
    /// Where it calls what a register holds.
    pub(crate) indirect: Vec<u32>,
    /// Where it takes an amount of stack that is not known here.
    pub(crate) unknown: Vec<u32>,
}

/// What one instruction does, as far as it matters here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Effect {
    None,
    /// Goes on at an address, and may come back.
    To(u32),
    /// Goes on at an address that a register holds.
    ToRegister,
    /// Takes bytes of the stack.
    Takes(u32),
    /// Takes as many bytes as a register says.
    TakesRegister(u8),
    /// A register gets a constant.
    Low(u8, u16),
    High(u8, u16),
    /// A register is rounded down: the bits that go.
    Aligned(u32),
}

impl Program {
    /// Reads the functions of an image.
    pub(crate) fn read(image: &Image) -> Result<Self, Failure> {
        let unreadable = |why: String| Failure(format!("{}: {why}", image.elf.display()));
        let bytes = std::fs::read(&image.elf).map_err(|error| unreadable(error.to_string()))?;
        let file = object::File::parse(bytes.as_slice()).map_err(|error| unreadable(error.to_string()))?;
        let text = file.section_by_name(".text").ok_or_else(|| unreadable("no .text".to_owned()))?;
        let code = text.data().map_err(|error| unreadable(error.to_string()))?;
        let (from, to) = (text.address() as u32, (text.address() + text.size()) as u32);

        let mut starts: BTreeMap<u32, (u32, String)> = BTreeMap::new();
        let mut data = BTreeMap::new();
        for symbol in file.symbols() {
            let (name, address) = (symbol.name().unwrap_or_default(), symbol.address() as u32);
            if address < from || address >= to {
                continue;
            }
            if name == "$t" || name.starts_with("$t.") {
                data.insert(address, false);
            } else if name == "$d" || name.starts_with("$d.") {
                data.insert(address, true);
            } else if symbol.kind() == object::SymbolKind::Text {
                let entry = starts.entry(address & !1).or_insert((0, readable(name)));
                entry.0 = entry.0.max(symbol.size() as u32);
            }
        }
        if starts.len() < 20 {
            return Err(unreadable("it has no symbols, so nothing can be said of it".to_owned()));
        }
        let ends: Vec<u32> = starts.keys().copied().skip(1).chain([to]).collect();
        let mut functions = BTreeMap::new();
        for ((start, (size, name)), next) in starts.into_iter().zip(ends) {
            let end = if size == 0 { next } else { (start + size).min(next) };
            let halfwords = |address: u32| {
                let at = (address - from) as usize;
                code.get(at..at + 2).map_or(0, |pair| u16::from_le_bytes([pair[0], pair[1]]))
            };
            let is_data = |address: u32| data.range(..=address).next_back().is_some_and(|(_, data)| *data);
            let mut function = Function::decode(start, end, halfwords, is_data);
            function.name = name;
            functions.insert(start, function);
        }
        Ok(Self { functions })
    }

    /// The function at an address, or around it.
    pub(crate) fn at(&self, address: u32) -> Option<(u32, &Function)> {
        let (start, function) = self.functions.range(..=address).next_back()?;
        (address < start + function.bytes.max(2)).then_some((*start, function))
    }

    /// All functions, by address.
    pub(crate) fn functions(&self) -> impl Iterator<Item = (u32, &Function)> {
        self.functions.iter().map(|(address, function)| (*address, function))
    }

    /// The functions of a name.
    pub(crate) fn named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = u32> + 'a {
        self.functions().filter(move |(_, function)| function.name == name).map(|(address, _)| address)
    }

    /// Whether a function, or what it calls, is the one of a name.
    pub(crate) fn reaches(&self, start: u32, name: &str) -> bool {
        let (mut seen, mut next) = (BTreeSet::from([start]), vec![start]);
        while let Some((_, function)) = next.pop().and_then(|address| self.at(address)) {
            if function.name == name {
                return true;
            }
            next.extend(self.callees(function).into_iter().filter(|callee| seen.insert(*callee)));
        }
        false
    }

    /// The name of the function at an address.
    pub(crate) fn name(&self, address: u32) -> &str {
        self.at(address).map_or("", |(_, function)| function.name.as_str())
    }

    /// A program for tests: names, addresses, calls, indirect calls.
    #[cfg(test)]
    pub(crate) fn of(functions: &[(&str, u32, &[u32], &[u32])]) -> Self {
        let functions = functions.iter().map(|(name, address, calls, indirect)| {
            let (calls, indirect) = (calls.iter().copied().collect(), indirect.to_vec());
            let name = (*name).to_owned();
            (*address, Function { name, bytes: 16, frame: 8, calls, indirect, ..Function::default() })
        });
        Self { functions: functions.collect() }
    }

    /// Where the calls of a function lead, at their starts.
    pub(crate) fn callees(&self, function: &Function) -> BTreeSet<u32> {
        function.calls.iter().filter_map(|address| self.at(*address)).map(|(start, _)| start).collect()
    }
}

impl Function {
    fn decode(start: u32, end: u32, halfword: impl Fn(u32) -> u16, is_data: impl Fn(u32) -> bool) -> Self {
        let mut function = Self { bytes: end - start, ..Self::default() };
        let mut constants = [None::<u32>; 16];
        let mut address = start;
        while address < end {
            if is_data(address) {
                address += 2;
                continue;
            }
            let first = halfword(address);
            let wide = first >> 11 >= 0b11101;
            let effect =
                if wide { wide_effect(address, first, halfword(address + 2)) } else { narrow_effect(address, first) };
            match effect {
                Effect::None => {}
                Effect::To(to) if (start..end).contains(&to) => {
                    // A branch to its own beginning is a call of itself; anywhere else inside is a loop or a branch.
                    if to == start && wide && halfword(address + 2) & 0xD000 == 0xD000 {
                        function.calls.insert(to);
                    }
                }
                Effect::To(to) => {
                    function.calls.insert(to);
                }
                Effect::ToRegister => function.indirect.push(address),
                Effect::Takes(bytes) => function.frame += bytes,
                Effect::TakesRegister(register) => match constants[usize::from(register & 15)] {
                    Some(bytes) => function.frame += bytes,
                    None => function.unknown.push(address),
                },
                Effect::Low(register, value) => constants[usize::from(register & 15)] = Some(u32::from(value)),
                Effect::High(register, value) => {
                    let constant = &mut constants[usize::from(register & 15)];
                    *constant = constant.map(|low| low & 0xFFFF | u32::from(value) << 16);
                }
                // What is rounded down takes up to so much more.
                Effect::Aligned(mask) => function.frame += mask,
            }
            address += if wide { 4 } else { 2 };
        }
        function
    }
}

fn narrow_effect(address: u32, code: u16) -> Effect {
    let ahead = |offset: i32| Effect::To(address.wrapping_add(4).wrapping_add_signed(offset));
    match code >> 8 {
        // b<c>, but not `udf` and `svc`.
        0xD0..=0xDD => ahead(i32::from(code as i8) * 2),
        0xE0..=0xE7 => ahead(i32::from((code << 5) as i16 >> 5) * 2),
        0xB1 | 0xB3 | 0xB9 | 0xBB => ahead(i32::from(code >> 3 & 0x1F | code >> 4 & 0x20) * 2),
        // bx, blx; `bx lr` returns.
        0x47 if code >> 3 & 15 == 14 && code & 0x80 == 0 => Effect::None,
        0x47 => Effect::ToRegister,
        // mov pc, Rm
        0x46 if code & 0x87 == 0x87 => Effect::ToRegister,
        0xB4 | 0xB5 => Effect::Takes(4 * (code & 0x1FF).count_ones()),
        0xB0 if code & 0x80 != 0 => Effect::Takes(u32::from(code & 0x7F) * 4),
        // movs Rd, #imm8
        0x20..=0x27 => Effect::Low((code >> 8 & 7) as u8, code & 0xFF),
        _ => Effect::None,
    }
}

fn wide_effect(address: u32, first: u16, second: u16) -> Effect {
    let ahead = |offset: i32| Effect::To(address.wrapping_add(4).wrapping_add_signed(offset));
    let bit = |word: u16, at: u32| i32::from(word >> at & 1);
    let sign = -bit(first, 10);
    if first >> 11 == 0b11110 && second & 0x8000 != 0 {
        let (j1, j2, low) = (bit(second, 13), bit(second, 11), i32::from(second & 0x7FF) << 1);
        // bl, b.w
        if second & 0x1000 != 0 {
            let (i1, i2) = (1 ^ j1 ^ (sign & 1), 1 ^ j2 ^ (sign & 1));
            return ahead(sign << 24 | i1 << 23 | i2 << 22 | i32::from(first & 0x3FF) << 12 | low);
        }
        // b<c>.w; the codes above are barriers, `msr` and their kin.
        if second & 0x5000 == 0 && first >> 7 & 7 != 7 {
            return ahead(sign << 20 | j2 << 19 | j1 << 18 | i32::from(first & 0x3F) << 12 | low);
        }
        return Effect::None;
    }
    let (to, immediate) = ((second >> 8 & 15) as u8, immediate(first, second));
    match first {
        // stmdb sp!; str Rt, [sp, #-imm]!; strd Rt, Rt2, [sp, #-imm]!; vpush of doubles and of singles
        0xE92D => Effect::Takes(4 * second.count_ones()),
        0xF84D if second & 0xF00 == 0xD00 => Effect::Takes(u32::from(second & 0xFF)),
        0xE96D => Effect::Takes(u32::from(second & 0xFF) * 4),
        0xED2D | 0xED6D if second & 0xE00 == 0xA00 => Effect::Takes(u32::from(second & 0xFF) * 4),
        // sub sp, sp, #imm; subw; sub sp, sp, Rm. Into another register it takes nothing yet, until that is moved into sp.
        0xF1AD | 0xF5AD => Effect::Takes(expanded(immediate)),
        0xF2AD | 0xF6AD => Effect::Takes(immediate),
        0xEBAD if second & 0xF0F0 == 0 => Effect::TakesRegister((second & 15) as u8),
        0xEBAD => Effect::TakesRegister(15),
        // movw, movt, mov.w #imm
        _ if first & 0xFBF0 == 0xF240 => Effect::Low(to, wide_constant(first, second)),
        _ if first & 0xFBF0 == 0xF2C0 => Effect::High(to, wide_constant(first, second)),
        0xF04F | 0xF44F => {
            let value = expanded(immediate);
            if value <= 0xFFFF { Effect::Low(to, value as u16) } else { Effect::None }
        }
        // bfc Rd, #0, #width: how a stack is rounded down
        0xF36F if second >> 8 & 0x70 == 0 && second & 0xC0 == 0 => Effect::Aligned((1 << ((second & 31) + 1)) - 1),
        // ldr pc, [...]; a pop into it is `ldm` or post-indexed from sp, and returns.
        _ if first & 0xFF70 == 0xF850 && second >> 12 == 15 && first != 0xF85D => Effect::ToRegister,
        _ => Effect::None,
    }
}

/// i:imm3:imm8.
fn immediate(first: u16, second: u16) -> u32 {
    u32::from(first >> 10 & 1) << 11 | u32::from(second >> 12 & 7) << 8 | u32::from(second & 0xFF)
}

/// imm4:i:imm3:imm8.
fn wide_constant(first: u16, second: u16) -> u16 {
    (first & 15) << 12 | immediate(first, second) as u16
}

/// `ThumbExpandImm`.
fn expanded(immediate: u32) -> u32 {
    let low = immediate & 0xFF;
    match immediate >> 8 {
        0 => low,
        1 => low << 16 | low,
        2 => low << 24 | low << 8,
        3 => low * 0x0101_0101,
        _ => (low & 0x7F | 0x80).rotate_right(immediate >> 7),
    }
}

/// A name without its hash, `a::b::c`.
pub(crate) fn readable(name: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What an instruction at address 0x1000 does.
    fn effect(code: &[u16]) -> Effect {
        match *code {
            [first, second] => wide_effect(0x1000, first, second),
            [code] => narrow_effect(0x1000, code),
            _ => Effect::None,
        }
    }

    #[test]
    fn what_takes_of_the_stack_is_counted() {
        for (code, bytes) in [
            (&[0xB5F0][..], 20),       // push {r4-r7, lr}
            (&[0xE92D, 0x0B00], 12),   // push.w {r8, r9, r11}
            (&[0xF84D, 0xBD08], 8),    // str r11, [sp, #-8]!
            (&[0xB084], 16),           // sub sp, #16
            (&[0xF5AD, 0x5D80], 4096), // sub.w sp, sp, #4096
            (&[0xF2AD, 0x7DFC], 2044), // subw sp, sp, #2044
            (&[0xED2D, 0x8B06], 24),   // vpush {d8-d10}
            (&[0xED6D, 0x8A01], 4),    // vpush {s17}
        ] {
            assert_eq!(effect(code), Effect::Takes(bytes), "{code:04x?}");
        }
        assert_eq!(effect(&[0xEBAD, 0x0D0C]), Effect::TakesRegister(12));
        assert_eq!(effect(&[0xF24B, 0x5CDF]), Effect::Low(12, 46559));
        assert_eq!(effect(&[0xF2C0, 0x0C01]), Effect::High(12, 1));
        assert_eq!(effect(&[0xF36F, 0x0402]), Effect::Aligned(7));
    }

    #[test]
    fn calls_and_branches_lead_where_the_assembler_meant_them_to() {
        for (code, to) in [
            (&[0xF002, 0xFBDB][..], 10166 + 4), // bl
            (&[0xF7FE, 0xFD29], -5550 + 4),     // bl
            (&[0xF000, 0xB895], 298 + 4),       // b.w
            (&[0xF7FF, 0xBADD], -2630 + 4),     // b.w
            (&[0xF041, 0x8153], 4774 + 4),      // bne.w
            (&[0xF43F, 0xAF18], -464 + 4),      // beq.w
            (&[0xF6FF, 0xAEFF], -514 + 4),      // blt.w
            (&[0xE7FB], -10 + 4),               // b
            (&[0xE005], 10 + 4),                // b
            (&[0xD815], 42 + 4),                // bhi
            (&[0xD8DE], -68 + 4),               // bhi
            (&[0xBB5C], 86 + 4),                // cbnz
            (&[0xB1D0], 52 + 4),                // cbz
        ] {
            assert_eq!(effect(code), Effect::To(0x1000_u32.wrapping_add_signed(to)), "{code:04x?}");
        }
        // blx r9; bx r3; ldr pc, [r0, #4]
        for code in [&[0x47C8][..], &[0x4718], &[0xF8D0, 0xF004]] {
            assert_eq!(effect(code), Effect::ToRegister, "{code:04x?}");
        }
        // bx lr; pop {r4, pc}; ldr pc, [sp], #4; udf; svc; dmb; mrs
        for code in
            [&[0x4770][..], &[0xBD10], &[0xF85D, 0xFB04], &[0xDE00], &[0xDF01], &[0xF3BF, 0x8F5F], &[0xF3EF, 0x8010]]
        {
            assert_eq!(effect(code), Effect::None, "{code:04x?}");
        }
    }

    #[test]
    fn a_large_frame_is_read_from_the_register_that_holds_it() {
        // push {r4, lr}; movw r12, #46559; sub.w sp, sp, r12; bl to 0x40 ahead; a word of data; bx lr
        let code = [0xB510, 0xF24B, 0x5CDF, 0xEBAD, 0x0D0C, 0xF000, 0xF81E, 0xB5FF, 0xB5FF, 0x4770];
        let function = Function::decode(0, 20, |at| code[at as usize / 2], |at| (14..18).contains(&at));
        assert_eq!((function.frame, function.indirect.len(), function.unknown.len()), (46567, 0, 0));
        assert_eq!(function.calls, BTreeSet::from([0x4A]));
        let unknown = Function::decode(0, 4, |at| [0xEBAD, 0x0D0C][at as usize / 2], |_| false);
        assert_eq!(unknown.unknown, [0]);
    }

    #[test]
    fn names_lose_their_hash_and_keep_the_rest() {
        let mangled = "_ZN13foxhound_link9companion9Companion7receive17h0123456789abcdefE";
        assert_eq!(readable(mangled), "foxhound_link::companion::Companion::receive");
        assert_eq!(
            readable("_RNvNtCs7ldSeZOOJos_4core9panicking18panic_bounds_check"),
            "core::panicking::panic_bounds_check"
        );
        assert_eq!(readable("memcpy"), "memcpy");
    }
}
