//! How much stack the image can take at most: `cargo xtask stack`.
//!
//! Every function's own part is read from the machine code ([`crate::thumb`]), then the longest path of calls from each root is added up.
//! Levels that interrupt each other lie on top of each other, each with what the processor stacks by itself; handlers of one
//! priority do not interrupt each other, so the longest counts. What a register calls is looked up in a table; what is not
//! there fails, and so does a function that calls itself. A panic ends in a reset and a fault has a stack of its own: neither
//! counts.

use std::collections::BTreeMap;

use crate::Failure;
use crate::board;
use crate::build::{Image, Parts};
use crate::panics::{FIELDS, is_meant, is_panic};
use crate::thumb::Program;

/// Registers with those of the floating point unit, and the word that keeps them aligned (`PushStack`, Armv7-M B1.5.6).
const EXCEPTION_BYTES: u32 = 26 * 4 + 4;
/// The most that variables and stack may take.
const RAM_MAX_BYTES: u64 = 112 * 1024;
/// How many of the largest frames on a path are printed.
const PRINTED: usize = 6;

/// The levels of the NUCLEO-G474RE, from the thread up; of several roots the one that takes most counts.
const LEVELS: [(&str, &[&str]); 4] = [
    ("thread: planner", &["Reset"]),
    ("link", &["FMAC"]),
    ("guidance", &["CORDIC"]),
    (
        "DMA, time, serial lines",
        &[
            "DMA1_CHANNEL1",
            "DMA1_CHANNEL2",
            "DMA1_CHANNEL3",
            "DMA1_CHANNEL4",
            "DMA1_CHANNEL5",
            "DMA2_CHANNEL4",
            "TIM1_BRK_TIM15",
            "USART1",
            "USART3",
            "LPUART1",
        ],
    ),
];

/// What the thread does before guidance and the planner run.
const START_UP: &str = "foxhound_firmware::program::start";
/// The levels that pre-empt it.
const AROUND_START_UP: [&str; 2] = ["link", "DMA, time, serial lines"];

/// A task's polling, whoever's; which task it is says what it reaches.
const POLL: &str = "embassy_executor::raw::TaskStorage<F>::poll";
/// What only the guidance task reaches.
const GUIDANCE: &str = "foxhound_firmware::app::fly";

/// How texts are written.
const WRITTEN: [&str; 2] = ["*Write>::write_str", "core::fmt::Write::write_char"];
/// What is written: strings and numbers, none of which contains another.
const SHOWN: [&str; 4] = ["*Write>::write_str", "core::fmt::Write::write_char", "<&str as *", "<u32 as *"];

/// What a function calls by what a register holds: by its name, names of which any may be meant.
const INDIRECT: &[(&str, &[&str])] = &[
    // Tasks; an executor has only its own.
    ("FMAC", &[POLL]),
    ("CORDIC", &[POLL]),
    // Wakers are all embassy's.
    ("foxhound_firmware::*", &["embassy_executor::raw::waker::*"]),
    ("embassy_*", &["embassy_executor::raw::waker::*"]),
    ("<embassy_*", &["embassy_executor::raw::waker::*"]),
    ("DMA2_CHANNEL4", &["embassy_executor::raw::waker::*"]),
    ("TIM1_BRK_TIM15", &["embassy_executor::raw::waker::*"]),
    ("USART1", &["embassy_executor::raw::waker::*"]),
    ("USART3", &["embassy_executor::raw::waker::*"]),
    ("LPUART1", &["embassy_executor::raw::waker::*"]),
    ("DMA1_CHANNEL*", &["embassy_executor::raw::waker::*"]),
    ("_embassy_time_schedule_wake", &["embassy_executor::raw::waker::*"]),
    FIELDS,
    // What the store keeps is its own.
    ("sequential_storage::*", &["<foxhound_computer::store::record::Record as *"]),
    // The log writes into a buffer in both modes.
    ("_defmt_acquire", &["defmt_rtt::channel::Channel::*"]),
    ("_defmt_write", &["defmt_rtt::channel::Channel::*"]),
    ("_defmt_release", &["defmt_rtt::channel::Channel::*"]),
    // Texts are written where they are kept, or into the log; what is shown is text or a number.
    ("core::fmt::write", &SHOWN),
    ("core::fmt::Write::write_fmt", &SHOWN),
    ("<core::fmt::Formatter>::pad", &WRITTEN),
    ("<core::fmt::Formatter>::pad_integral", &WRITTEN),
    ("<core::fmt::Formatter>::pad_integral::write_prefix", &WRITTEN),
    ("<&T as core::fmt::Display>::fmt", &SHOWN),
];

/// Builds the image, prints what each level takes and what takes it, and fails where it is too much or not known.
pub(crate) fn run(parts: Parts) -> Result<(), Failure> {
    let image = Image::with(parts, board::NUCLEO)?;
    let program = Program::read(&image)?;
    let variables = image.size()?.ram_bytes;
    let (mut stack, mut around) = (0, 0);
    for (index, (level, roots)) in LEVELS.into_iter().enumerate() {
        let mut longest = (0, String::new(), Vec::new());
        for root in roots {
            let start = program.named(root).next().ok_or_else(|| Failure(format!("the image has no {root}")))?;
            let mut depths = Depths::new(&program, *root == "CORDIC", Some(START_UP));
            let bytes = depths.of(start)?;
            if bytes > longest.0 {
                longest = (bytes, (*root).to_owned(), depths.way(start));
            }
        }
        let (bytes, root, way) = longest;
        let stacked = if index > 0 { EXCEPTION_BYTES } else { 0 };
        stack += bytes + stacked;
        around += if AROUND_START_UP.contains(&level) { bytes + stacked } else { 0 };
        println!("{:>6}  {level} ({root}), {stacked} of them stacked by the processor", bytes + stacked);
        print_largest(way);
    }
    let start = program.named(START_UP).next().ok_or_else(|| Failure(format!("the image has no {START_UP}")))?;
    let mut depths = Depths::new(&program, false, None);
    let start_up = depths.of(start)? + around;
    println!("{start_up:>6}  before them: start-up, with what pre-empts it");
    print_largest(depths.way(start));
    let stack = stack.max(start_up);
    let sum = u64::from(stack) + variables;
    println!("{stack:>6}  of stack, and {variables} of variables: {sum} of {RAM_MAX_BYTES}");
    if sum > RAM_MAX_BYTES {
        return Err(Failure(format!("stack and variables take {sum} bytes, {} too many", sum - RAM_MAX_BYTES)));
    }
    Ok(())
}

/// Prints the largest frames of a path.
fn print_largest(mut way: Vec<(String, u32)>) {
    way.sort_by_key(|(_, frame)| std::cmp::Reverse(*frame));
    for (name, frame) in way.iter().take(PRINTED) {
        println!("          {frame:>6}  {name}");
    }
}

/// The longest paths of calls from functions.
struct Depths<'a> {
    program: &'a Program,
    /// Whose tasks: of guidance, or of the link.
    is_guidance: bool,
    /// What is left out.
    without: Option<&'static str>,
    /// What is known: the bytes, and the next function on the longest path. `None` while it is being found out.
    known: BTreeMap<u32, Option<(u32, Option<u32>)>>,
}

impl<'a> Depths<'a> {
    fn new(program: &'a Program, is_guidance: bool, without: Option<&'static str>) -> Self {
        Self { program, is_guidance, without, known: BTreeMap::new() }
    }

    /// What a function and everything that it calls take at most.
    fn of(&mut self, start: u32) -> Result<u32, Failure> {
        match self.known.get(&start) {
            Some(Some((bytes, _))) => return Ok(*bytes),
            Some(None) => return Err(Failure(format!("{} calls itself", self.program.name(start)))),
            None => {}
        }
        let Some((_, function)) = self.program.at(start) else { return Ok(0) };
        if let Some(at) = function.unknown.first() {
            return Err(Failure(format!("{} takes an unknown amount at {at:#x}", function.name)));
        }
        self.known.insert(start, None);
        let mut callees = self.program.callees(function);
        if !function.indirect.is_empty() {
            callees.extend(self.indirect(&function.name)?);
        }
        let (mut most, mut by) = (0, None);
        for callee in callees {
            // A panic does not return; formatting calls itself through what is formatted, to no great depth.
            if is_panic(self.program.name(callee))
                || self.without == Some(self.program.name(callee))
                || matches!(self.known.get(&callee), Some(None)) && is_text(self.program.name(callee))
            {
                continue;
            }
            let bytes = self.of(callee)?;
            if bytes > most {
                (most, by) = (bytes, Some(callee));
            }
        }
        self.known.insert(start, Some((function.frame + most, by)));
        Ok(function.frame + most)
    }

    /// The possible targets of an indirect call.
    fn indirect(&self, caller: &str) -> Result<Vec<u32>, Failure> {
        let Some((_, names)) = INDIRECT.iter().find(|(name, _)| is_meant(name, caller)) else {
            return Err(Failure(format!("{caller} calls what a register holds, and nobody says what that may be")));
        };
        let may_be = |name: &str| names.iter().any(|pattern| is_meant(pattern, name));
        let meant = self.program.functions().filter(|(_, function)| may_be(&function.name));
        let meant: Vec<u32> = meant.map(|(address, _)| address).collect();
        let is_mine = |address: &u32| {
            self.program.name(*address) != POLL || self.program.reaches(*address, GUIDANCE) == self.is_guidance
        };
        let mine: Vec<u32> = meant.into_iter().filter(is_mine).collect();
        if mine.is_empty() { Err(Failure(format!("nothing is left that {caller} may call"))) } else { Ok(mine) }
    }

    /// The frames on the longest path.
    fn way(&self, start: u32) -> Vec<(String, u32)> {
        let mut way = Vec::new();
        let mut next = Some(start);
        while let Some(at) = next {
            let Some((_, function)) = self.program.at(at) else { break };
            way.push((function.name.clone(), function.frame));
            next = self.known.get(&at).copied().flatten().and_then(|(_, by)| by);
        }
        way
    }
}

/// Whether a function is one of those that write text.
fn is_text(name: &str) -> bool {
    name.contains("core::fmt::")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_way_is_found_and_a_panic_is_none() {
        // Eight bytes each.
        let program = Program::of(&[
            ("root", 0, &[16, 32], &[]),
            ("short", 16, &[], &[]),
            ("long", 32, &[48, 64], &[]),
            ("leaf", 48, &[], &[]),
            ("core::panicking::panic", 64, &[16, 80], &[]),
            ("after", 80, &[96], &[]),
            ("more", 96, &[], &[]),
        ]);
        let mut depths = Depths::new(&program, false, None);
        assert_eq!(depths.of(0).ok(), Some(24));
        assert_eq!(depths.way(0).iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["root", "long", "leaf"]);
    }

    #[test]
    fn who_calls_itself_and_unknown_calls_are_refused() {
        let program = Program::of(&[("root", 0, &[16], &[]), ("again", 16, &[0], &[])]);
        assert!(Depths::new(&program, false, None).of(0).is_err_and(|why| why.0.contains("calls itself")));
        let program = Program::of(&[("root", 0, &[], &[2])]);
        assert!(Depths::new(&program, false, None).of(0).is_err_and(|why| why.0.contains("nobody says")));
        let waker = "embassy_executor::raw::waker::wake";
        let program = Program::of(&[("USART1", 0, &[], &[2]), (waker, 16, &[], &[])]);
        assert_eq!(Depths::new(&program, false, None).of(0).ok(), Some(16));
    }
}
