//! Results of many flights or many frames: the papers' experiments, and campaigns that answer one question each.
//!
//! | module | the question |
//! |---|---|
//! | [`reproduce`] | what of the papers' results comes out here? |
//! | [`matrix`] | does every setting of sensor, bearings, vehicle and hull fly? |
//! | [`gusts`] | how many flights touch something in gusts? |
//! | [`landings`] | how many come down on the pad? |
//! | [`link_state`] | how often is the link state's classifier right, and how is it trained? |
//! | [`pad`] | what does the landing pad's detector find, and how are its weights trained? |
//! | [`flight`] | how does one flight end? |
//! | [`seeds`] | the ranges of seeds: those to tune on, those to publish |

pub mod flight;
pub mod gusts;
pub mod landings;
pub mod link_state;
pub mod matrix;
pub mod pad;
pub mod reproduce;
pub mod seeds;

mod network;

/// How much of a campaign is flown.
#[derive(Clone, Copy, Debug)]
pub struct Campaign {
    /// Flights of each scene.
    pub flights: u64,
    /// Whether on development seeds.
    pub is_development: bool,
    /// Called with what is flown next, or has been.
    pub tell: fn(&str),
}
