//! From where in the image a panic can begin: `cargo xtask panics`.
//!
//! The image is the one that is flashed. From the roots below every call is followed through the machine code, and each function
//! in which a panic can begin is printed with the path of calls to it. One that is not in `EXCUSED` fails, and so does an
//! indirect call through a register, but for that of a parameter's row, which is followed to all that it may mean.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

use crate::Failure;
use crate::board;
use crate::build::{Image, Parts};
use crate::thumb::Program;

/// What runs in flight: guidance and the link's part of a step, parameters, the replan, what comes in, what goes out, frames of the
/// camera. Around them is embassy, which polls a finished task never and an executor's queue always.
const ROOTS: [&str; 5] = [
    "foxhound_firmware::app::fly",
    "foxhound_computer::flight::Flight<S>::serve",
    "foxhound_firmware::app::planner::replan",
    "foxhound_link::companion::Companion::receive",
    "foxhound_link::companion::Companion::transmit",
];
/// And what comes in from the camera, or as IQ reports. What is around the first wakes guidance, which is embassy's.
const CAMERA: &str = "foxhound_computer::camera::Camera::push";
const REPORTS: &str = "foxhound_computer::iq::Finder<_>::bearing";

/// Functions in which a panic could begin, by a name that may end in `*`, each with the proof that it never does in flight.
const EXCUSED: [(&str, &str); 3] = [
    ("sequential_storage::*", STORE),
    ("foxhound_computer::store::Store<F>::*", STORE),
    ("embassy_stm32::flash::*", STORE),
];
/// `Companion::take_storage` gives nobody anything to do while we are in control (`link/tests/link/params.rs`,
/// `computer/tests/store/start.rs`).
const STORE: &str = "not in control: the store is asked outside it only, where a restart ends in standby";

/// A parameter's field is found by a function of its row: who calls it, and what it may be.
pub(crate) const FIELDS: (&str, &[&str]) = (
    "foxhound_core::guidance::param::Values::*",
    &["foxhound_core::guidance::param::parts::*", "core::ops::function::FnOnce::call_once"],
);

/// Whether a name is the pattern, in which one `*` may stand for anything.
pub(crate) fn is_meant(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        Some((front, back)) => name.starts_with(front) && name.ends_with(back),
        None => name == pattern,
    }
}

/// Builds the image, prints where a panic can begin, and fails where no proof says that it does not.
pub(crate) fn run(parts: Parts) -> Result<(), Failure> {
    let program = Program::read(&Image::with(parts, board::NUCLEO)?)?;
    let mut unproven = BTreeSet::new();
    for root in ROOTS.into_iter().chain([if parts == Parts::IQ { REPORTS } else { CAMERA }]) {
        let start = program.named(root).next();
        let start = start.ok_or_else(|| Failure(format!("the image has no function {root}")))?;
        let reach = Reach::from(&program, start);
        println!("{:>4} functions, {} may panic: {root}", reach.came_from.len(), reach.panics.len());
        for (address, how) in &reach.panics {
            let name = program.name(*address);
            let proof = EXCUSED.iter().find(|(excused, _)| is_meant(excused, name)).map(|(_, proof)| *proof);
            if proof.is_none() {
                unproven.insert(name.to_owned());
            }
            let way = reach.way(&program, *address);
            let how: Vec<&str> = how.iter().map(String::as_str).collect();
            println!("    {}: {} ({})", way.join(" > "), how.join(", "), proof.unwrap_or("not proven"));
        }
    }
    if unproven.is_empty() {
        Ok(())
    } else {
        Err(Failure(format!("may panic: {}", unproven.into_iter().collect::<Vec<_>>().join(", "))))
    }
}

/// Whether a function is one of the library's with which every panic begins.
pub(crate) fn is_panic(name: &str) -> bool {
    let last = name.rsplit("::").next().unwrap_or(name);
    name.starts_with("core::panicking::")
        || name.starts_with("core::")
            && (last.ends_with("_fail") || last.ends_with("_failed") || last.starts_with("panic_"))
        || last == "rust_begin_unwind"
}

/// What can be reached from a function.
struct Reach {
    /// From where a function was reached first, by address.
    came_from: BTreeMap<u32, u32>,
    /// Where panics can begin, and with what.
    panics: BTreeMap<u32, BTreeSet<String>>,
}

impl Reach {
    fn from(program: &Program, root: u32) -> Self {
        let mut reach = Self { came_from: BTreeMap::from([(root, root)]), panics: BTreeMap::new() };
        let mut next = VecDeque::from([root]);
        while let Some((address, function)) = next.pop_front().and_then(|address| program.at(address)) {
            let mut begins = BTreeSet::new();
            let mut callees = program.callees(function);
            if !function.indirect.is_empty() {
                let (caller, fields) = FIELDS;
                if is_meant(caller, &function.name) {
                    let is_field = |name: &str| fields.iter().any(|field| is_meant(field, name));
                    callees.extend(program.functions().filter(|(_, one)| is_field(&one.name)).map(|(at, _)| at));
                } else {
                    begins.insert("a call of what a register holds".to_owned());
                }
            }
            for callee in callees {
                if is_panic(program.name(callee)) {
                    begins.insert(program.name(callee).to_owned());
                } else if let Entry::Vacant(place) = reach.came_from.entry(callee) {
                    place.insert(address);
                    next.push_back(callee);
                }
            }
            if !begins.is_empty() {
                reach.panics.insert(address, begins);
            }
        }
        reach
    }

    /// The names on the shortest path of calls from the root to a function.
    fn way<'a>(&self, program: &'a Program, to: u32) -> Vec<&'a str> {
        let mut way = vec![program.name(to)];
        let mut at = to;
        while let Some(from) = self.came_from.get(&at).copied().filter(|from| *from != at) {
            way.push(program.name(from));
            at = from;
        }
        way.reverse();
        way
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beginnings_of_panics_are_known_by_their_names() {
        for name in [
            "core::panicking::panic_bounds_check",
            "core::panicking::panic_const::panic_const_div_by_zero",
            "core::slice::index::slice_index_fail",
            "core::option::unwrap_failed",
            "core::cell::panic_already_borrowed",
            "rust_begin_unwind",
            "__rustc::rust_begin_unwind",
        ] {
            assert!(is_panic(name), "{name}");
        }
        for name in ["foxhound_link::companion::Companion::fail", "core::slice::sort::select", "memcpy"] {
            assert!(!is_panic(name), "{name}");
        }
    }

    #[test]
    fn a_way_to_a_panic_is_found_and_told_from_the_root_on() {
        // 0 calls 16, which calls 32; 48 panics too, and nobody calls it.
        let program = Program::of(&[
            ("root", 0, &[16], &[]),
            ("middle", 16, &[32, 0], &[]),
            ("leaf", 32, &[64], &[]),
            ("other", 48, &[64], &[]),
            ("core::panicking::panic", 64, &[], &[]),
        ]);
        let reach = Reach::from(&program, 0);
        assert_eq!(reach.panics.keys().copied().collect::<Vec<_>>(), [32]);
        assert_eq!(reach.way(&program, 32), ["root", "middle", "leaf"]);
        let program = Program::of(&[("root", 0, &[16], &[]), ("middle", 16, &[], &[20])]);
        assert_eq!(Reach::from(&program, 0).panics.len(), 1, "an unknown call");
    }
}
