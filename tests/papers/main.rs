//! `foxhound reproduce` gives the numbers that we claim for each paper.

mod all;
mod localize;
mod mmwave;
mod reproduce;
mod stretch;
