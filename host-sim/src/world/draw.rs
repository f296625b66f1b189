//! Builds worlds from files and at random: people on recorded tracks; pillars at random places where there is space.

use std::path::Path;

use super::random::Random;
use crate::scenario::input::{InputError, read_text};
use crate::scenario::{Obstacle, Scenario};

/// Attempts to place a pillar before the map counts as full.
const THROWS: usize = 1000;

impl Scenario {
    /// Reads a scenario and the files that it names: [`Self::parse`], and [`Self::drawn`]. Relative paths start at
    /// its folder.
    ///
    /// # Errors
    /// Names the file and the error in it.
    pub fn read(path: &Path, seed: u64) -> Result<Self, InputError> {
        let parsed = Self::parse(&read_text(path)?).and_then(|mut scenario| {
            if let (Some(tracks), Some(folder)) = (&mut scenario.people_csv, path.parent()) {
                *tracks = folder.join(&tracks);
            }
            scenario.drawn(seed)
        });
        parsed.map_err(|error| error.in_file(path))
    }

    /// The same with its random pillars, and the people of its file added.
    ///
    /// # Errors
    /// The pillars do not fit, or the file cannot be read.
    pub fn drawn(mut self, seed: u64) -> Result<Self, InputError> {
        self = self.with_tracks()?;
        let Some(wanted) = self.random.take() else { return Ok(self) };
        let mut random = Random::new(seed, 5);
        let [west, south, east, north] = self.bounds;
        for number in 0..wanted.count {
            let mut throw = || {
                let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
                let r = between(wanted.radius[0], wanted.radius[1]);
                Obstacle { x: between(west, east), y: between(south, north), r, ..Obstacle::default() }
            };
            let fits = |one: &Obstacle| {
                let free = |[x, y]: [f64; 2], r: f64| libm::hypot(one.x - x, one.y - y) - r - one.r;
                self.obstacles.iter().all(|other| free([other.x, other.y], other.r) >= wanted.gap)
                    && [self.start, self.goal].into_iter().all(|place| free(place, 0.0) >= wanted.clear)
            };
            let Some(pillar) = (0..THROWS).map(|_| throw()).find(fits) else {
                let text = format!("random.count = {}: there is space for only {number}", wanted.count);
                return Err(InputError::new(text));
            };
            self.obstacles.push(pillar);
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Scenario {
        Scenario::parse(text).unwrap()
    }

    #[test]
    fn a_seed_is_a_world_in_which_everything_has_its_room() {
        let scenario = parsed(r#"{"random":{"count":25},"obstacles":[{"x":5,"y":5,"r":0.5}]}"#);
        let drawn = scenario.clone().drawn(7).unwrap();
        assert_eq!((drawn.obstacles.len(), drawn.random), (26, None));
        for (index, one) in drawn.obstacles.iter().enumerate() {
            let free = |x: f64, y: f64, r: f64| (one.x - x).hypot(one.y - y) - r - one.r;
            assert!(drawn.obstacles[..index].iter().all(|other| free(other.x, other.y, other.r) >= 0.6));
            assert!(index == 0 || (0.15..=0.35).contains(&one.r));
            assert!(free(1.0, 1.0, 0.0) >= 0.8 && free(9.0, 9.0, 0.0) >= 0.8);
        }
        assert_eq!(scenario.clone().drawn(7).unwrap(), drawn);
        assert_ne!(scenario.drawn(8).unwrap().obstacles, drawn.obstacles);
    }

    #[test]
    fn a_map_that_is_full_says_how_many_it_holds() {
        let error = parsed(r#"{"random":{"count":500}}"#).drawn(1).unwrap_err().to_string();
        assert!(error.starts_with("random.count = 500: there is space for only "), "{error}");
    }
}
