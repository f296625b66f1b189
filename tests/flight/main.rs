//! Flights in the simulator arrive, collide with nothing and land, in every setting that is flown.

mod belief;
mod closed_loop;
mod corners;
mod gusts;
mod landing;
mod matrix;
mod multipath;
mod navigation;
mod pad;
mod people;
mod radios;
mod recorded;
mod scenarios;
mod step_response;
mod turning;
