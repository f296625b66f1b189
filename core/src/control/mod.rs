//! A trajectory becomes a velocity that the vehicle can fly and that keeps it clear of everything: response, wind, tracker,
//! guard. It may import `base`, `mapping` and, for the trajectory, `planning`.

pub mod evade;
pub mod guard;
pub mod gust;
pub mod response;
pub mod track;
#[cfg(test)]
pub(crate) mod vehicle;
