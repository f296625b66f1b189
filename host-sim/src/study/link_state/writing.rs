//! The files that the training makes.

use std::fmt::Write as _;

use foxhound_core::localize::link_state::{NAMES, Weights};

use super::examination::{CLASS_NAMES, Confusion};
use super::{Report, TRAINING_SCENES};

/// Where the weights are, in the repository.
pub const WEIGHTS_FILE: &str = "core/src/localize/link_state/weights.rs";
/// Where the document is.
pub const DOCUMENT_FILE: &str = "docs/results/link-state.md";

/// The weights as a source file.
#[must_use]
pub fn source(weights: &Weights, seed: u64) -> String {
    let list = |values: &[f32]| values.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(", ");
    let rows = |rows: &mut dyn Iterator<Item = &[f32]>| {
        rows.fold(String::new(), |mut text, row| {
            let _ = writeln!(text, "        [{}],", list(row));
            text
        })
    };
    format!(
        "//! Weights of the link state's network, made by `foxhound link-state --train --seed {seed}`; do not edit.\n\
         //!\n\
         //! A change to the chain up to the bearing, to the features or to the training asks for new ones: `--check` says so.\n\n\
         use super::Weights;\n\n\
         /// The weights.\n\
         #[rustfmt::skip]\n\
         pub const WEIGHTS: Weights = Weights {{\n    hidden: [\n{}    ],\n    hidden_bias: [{}],\n    output: [\n{}    ],\n    \
         output_bias: [{}],\n}};\n",
        rows(&mut weights.hidden.iter().map(|row| &row[..])),
        list(&weights.hidden_bias),
        rows(&mut weights.output.iter().map(|row| &row[..])),
        list(&weights.output_bias),
    )
}

/// The document.
#[must_use]
pub fn document(report: &Report) -> String {
    format!("{INTRODUCTION}\n{}\nFeatures, in order: `{}`.\n\n{LIMITS}", measured(report), NAMES.join("`, `"))
}

/// The part of the document that the examination makes.
#[must_use]
pub fn measured(report: &Report) -> String {
    let mut text = format!(
        "## Confusion\n\n{} moments of {} scenes that are not among the {TRAINING_SCENES} of the training (seed {}): {}.\n",
        report.samples,
        report.scenes,
        report.seed,
        (0..CLASS_NAMES.len())
            .map(|class| format!("{} {}", report.class_counts[class], CLASS_NAMES[class]))
            .collect::<Vec<_>>()
            .join(", ")
    );
    for (name, outcome) in [("Without a map", &report.without_map), ("With most walls known", &report.with_map)] {
        let _ = writeln!(text, "\n{name}: balanced accuracy {}.\n", outcome.summary());
        confusion(&mut text, &outcome.confusion, &outcome.recall);
        let precision = outcome.precision.map(|x| format!("{:.0}", 100.0 * x)).join(", ");
        let _ = writeln!(
            text,
            "\nOf its answers {precision} % are right. Line of sight against all others: balanced accuracy {:.1} %. Where the \
             strongest path leads by 6 dB and nothing has changed within the window: {:.1} %.",
            100.0 * outcome.line_of_sight_balanced,
            100.0 * outcome.clear_balanced
        );
    }
    let [low, high] = report.baseline.balanced_accuracy_95.map(|x| 100.0 * x);
    let [a, b, c] = report.baseline.thresholds_db;
    let _ = writeln!(
        text,
        "\nThe level alone, with the thresholds that are best for these very scenes ({a}, {b}, {c} dB): balanced accuracy \
         {:.1} % [{low:.1}, {high:.1}].\n",
        100.0 * report.baseline.balanced_accuracy
    );
    confusion(&mut text, &report.baseline.confusion, &report.baseline.recall);
    text
}

fn confusion(text: &mut String, counts: &Confusion, recall: &[f64]) {
    let _ = writeln!(text, "| truth | {} | recall, % |\n|---|---|---|---|---|---|", CLASS_NAMES.join(" | "));
    for ((name, row), recall) in CLASS_NAMES.iter().zip(counts).zip(recall) {
        let row = row.map(|count| count.to_string()).join(" | ");
        let _ = writeln!(text, "| {name} | {row} | {:.1} |", 100.0 * recall);
    }
}

const INTRODUCTION: &str = "# Link state: how the beacon's wave gets here

A network of 12 hidden neurons (`core/src/localize/link_state`) tells from the last 24 looks whether the strongest wave comes straight
from the beacon, by one reflection, by several, or not at all. This file and the weights are made by

    cargo run --release -- link-state --train     # writes core/src/localize/link_state/weights.rs and this file
    cargo run --release -- link-state --check     # trains anew and compares the weights byte for byte
    cargo run --release -- link-state --seed 7    # examines the weights with fresh scenes

## Scenes

Drawn from the seed. Half are yards of 15 to 35 m with one to six walls of 3 to 16 m, half floors of 8 to 20 by 8 to 25 m with
one to three partitions and a door in each. A reflection takes 3 to 10 dB, the way through a wall 6 to 50. Paths of up to three
reflections by the image method; each sounds in whole ADC frames at 868 MHz (N = 256), which go through the product's own
chain, with gains of 3 % and phases of 0.02 rad that calibration has left, tilt of 0.04 rad, yaw off by 0.015 rad and odometry
by 1 %. The free wave at one metre has 38 dB (sigma 7, 20 to 55): nobody tells how strong a beacon is. Four legs a scene of up
to 6.6 m, straight or curved at 0.3 to 1.5 m/s, some hovering; six in ten begin where the beacon's own wave is not the
strongest, if there is such a place. The truth is the class of the strongest path; none where that has less than -13 dB per
sample. A wave through a wall is line of sight: its bearing is right. With a map, 60 to 100 % of the walls are known, their
ends to 0.1 m.

Classes count alike in the training. Intervals hold 95 % of 1000 draws of as many scenes.
";

const LIMITS: &str = "## What cannot be told

- A wall that mirrors one strong wave makes the wave of a beacon behind it: the same phases, the same bearings from wherever
  it is heard, the same slope of the level. Without a map only company gives it away, other waves of like strength, and where
  there is none, or where the direct wave has such company, the answer is a guess.
- With the wall known it is before the source or behind it; but a window of 1.9 m ranges no farther than some metres, and a
  wave that came through a wall has one before its source as well.
- One reflection and several differ in nothing but what they have lost, and how strong the beacon is nobody says.
- Scenes are flat, walls smooth: no diffraction, no scattering, no furniture. Where the truth differs, so will these numbers.
";
