//! Results of the faults, and violated requirements.

use std::collections::BTreeMap;
use std::fmt::{self, Display};

use serde::{Deserialize, Serialize};

use super::kind::Kind;
use crate::drive::qemu::Worst;

/// Results of the faults of one kind.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Row {
    /// Number of faults.
    pub faults: u32,
    /// After this many the vehicle flew on.
    pub recovered: u32,
    /// After this many it held, by the outcome that was published.
    pub safe: BTreeMap<String, u32>,
    /// After this many it did neither.
    pub lost: u32,
    /// Collisions under our control.
    pub collisions: u32,
    /// Collisions while the computer was absent.
    pub collisions_away: u32,
    /// Restarts of the computer.
    pub restarts: u32,
    /// Those for which the pilot got the right text.
    pub restarts_told: u32,
    /// Steps that were late.
    pub late_steps: u32,
    /// Setpoints that were too fast or not finite.
    pub outside_limits: u32,
    /// Setpoints with motion while the autopilot would not obey us.
    pub uninvited: u32,
}

impl Row {
    fn add(&mut self, other: &Self) {
        self.faults += other.faults;
        self.recovered += other.recovered;
        for (name, count) in &other.safe {
            *self.safe.entry(name.clone()).or_default() += count;
        }
        self.lost += other.lost;
        self.collisions += other.collisions;
        self.collisions_away += other.collisions_away;
        self.restarts += other.restarts;
        self.restarts_told += other.restarts_told;
        self.late_steps += other.late_steps;
        self.outside_limits += other.outside_limits;
        self.uninvited += other.uninvited;
    }

    /// Requirements for one fault of this kind that are violated.
    #[must_use]
    pub fn complaints(&self, kind: Kind) -> Vec<String> {
        let mut complaints = Vec::new();
        let mut ask = |is_so: bool, complaint: &dyn Display| {
            if !is_so {
                complaints.push(complaint.to_string());
            }
        };
        ask(self.lost == 0, &"it neither flew on nor stood and said why");
        ask(self.collisions == 0, &"a pillar was touched");
        ask(self.collisions_away == 0, &"a pillar was touched with the computer away");
        ask(self.outside_limits == 0, &format_args!("{} setpoints outside the limits", self.outside_limits));
        ask(self.uninvited == 0, &format_args!("{} setpoints that nobody had invited", self.uninvited));
        // A mission that ended with a collision has no further requirements.
        if self.collisions + self.collisions_away == 0 {
            let expected = kind.restarts().map_or(self.restarts, u32::from);
            ask(self.restarts == expected, &format_args!("{} restarts instead of {expected}", self.restarts));
            let untold = self.restarts.saturating_sub(self.restarts_told);
            ask(untold == 0, &format_args!("{untold} restarts were not told, or in other words"));
        }
        ask(kind != Kind::StolenProcessor || self.late_steps > 0, &"no step was late");
        complaints
    }
}

/// A violated requirement.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Complaint {
    /// Number of the fault in the mission, from 1 on.
    pub fault: u32,
    /// Its kind.
    pub kind: Kind,
    /// The violated requirement.
    pub what: String,
}

impl Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "fault {}, {}: {}", self.fault, self.kind.name(), self.what)
    }
}

/// Results of some missions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// Number of missions.
    pub missions: u32,
    /// Simulated seconds.
    pub seconds: u64,
    /// By kind.
    pub rows: BTreeMap<Kind, Row>,
    /// The worst values.
    pub worst: Worst,
    /// Missions in which the firmware stopped answering.
    pub broken: u32,
    /// All violated requirements.
    pub complaints: Vec<Complaint>,
}

impl Report {
    /// Adds one fault.
    pub(super) fn note(&mut self, fault: u32, kind: Kind, row: &Row) {
        self.rows.entry(kind).or_default().add(row);
        self.complaints.extend(row.complaints(kind).into_iter().map(|what| Complaint { fault, kind, what }));
    }

    /// Adds another report.
    pub fn add(&mut self, other: &Self) {
        self.missions += other.missions;
        self.seconds += other.seconds;
        for (kind, row) in &other.rows {
            self.rows.entry(*kind).or_default().add(row);
        }
        self.worst.add(other.worst);
        self.broken += other.broken;
        self.complaints.extend_from_slice(&other.complaints);
    }

    /// All kinds together.
    #[must_use]
    pub fn all(&self) -> Row {
        self.rows.values().fold(Row::default(), |mut all, row| {
            all.add(row);
            all
        })
    }
}

impl Display for Report {
    /// The table of `docs/results/faults.md`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = self.all();
        writeln!(f, "{} missions, {} faults, {} simulated seconds.\n", self.missions, all.faults, self.seconds)?;
        writeln!(
            f,
            "| fault | times | flew on | stood still, saying | neither | pillars touched | with the computer away | restarts \
             | told | late steps | setpoints outside limits | uninvited |"
        )?;
        writeln!(f, "|---|---|---|---|---|---|---|---|---|---|---|---|")?;
        for (kind, row) in &self.rows {
            line(f, &kind.name(), row)?;
        }
        line(f, "all", &all)?;
        let Worst { fast_instructions, plan_instructions, stack_bytes, .. } = self.worst;
        writeln!(
            f,
            "\nThe worst of all steps: {fast_instructions} instructions of guidance, {plan_instructions} of a replan with \
             what pre-empted it, {stack_bytes} bytes of stack."
        )?;
        let Self { broken, complaints, .. } = self;
        write!(f, "\n{broken} missions in which the firmware did not answer any more; {} complaints.", complaints.len())
    }
}

fn line(f: &mut fmt::Formatter<'_>, name: &str, row: &Row) -> fmt::Result {
    let safe: Vec<String> = row.safe.iter().map(|(outcome, count)| format!("{count} `{outcome}`")).collect();
    let Row { faults, recovered, lost, collisions, collisions_away, .. } = row;
    let Row { restarts, restarts_told, late_steps, outside_limits, uninvited, .. } = row;
    writeln!(
        f,
        "| {name} | {faults} | {recovered} | {} | {lost} | {collisions} | {collisions_away} | {restarts} | {restarts_told} \
         | {late_steps} | {outside_limits} | {uninvited} |",
        safe.join(", "),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restart_without_a_word_a_restart_too_few_and_a_touched_pillar_are_complaints() {
        let good = Row { faults: 1, recovered: 1, restarts: 1, restarts_told: 1, ..Row::default() };
        assert_eq!(good.complaints(Kind::Panic), [""; 0]);
        assert_eq!(good.complaints(Kind::LineNoise).len(), 1, "an unwanted restart");
        let bad = [
            Row { restarts_told: 0, ..good.clone() },
            Row { restarts: 0, restarts_told: 0, ..good.clone() },
            Row { collisions: 1, ..good.clone() },
            Row { collisions_away: 1, ..good.clone() },
            Row { recovered: 0, lost: 1, ..good.clone() },
            Row { outside_limits: 1, ..good.clone() },
            Row { uninvited: 1, ..good },
        ];
        for row in bad {
            assert_eq!(row.complaints(Kind::Panic).len(), 1, "{row:?}");
        }
        let stolen = Row { faults: 1, recovered: 1, ..Row::default() };
        assert_eq!(stolen.complaints(Kind::StolenProcessor), ["no step was late"]);
    }
}
