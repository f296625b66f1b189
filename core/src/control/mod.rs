//! Turns a trajectory into a velocity that the vehicle can fly and that keeps it clear of all obstacles: a model of
//! how the vehicle follows commands, wind estimate, tracker, evader, guard. It may import `base`, `mapping` and, for
//! the trajectory, `planning`.

pub mod evade;
pub mod guard;
pub mod track;
#[cfg(test)]
pub(crate) mod vehicle;
pub mod vehicle_model;
pub mod wind;
