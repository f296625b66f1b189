//! Bearings, calibration and the link's state are as accurate as we claim, on signals that these tests make themselves.

mod bearing_accuracy;
mod bearing_command;
mod calibration;
mod direction_finding;
mod link_state;
mod modulations;
mod music;
mod other_radios;
mod radio_files;
mod reflections;
mod switched_arrays;
mod two_emitters;
mod waves;
