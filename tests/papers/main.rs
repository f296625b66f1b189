//! `foxhound reproduce` comes to the numbers that we claim of each paper.

mod all;
mod localize;
mod mmwave;
mod reproduce;
mod stretch;
