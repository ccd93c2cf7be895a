//! Many episodes side by side, on all cores.

use std::sync::Arc;

use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, IntoParallelRefMutIterator, ParallelIterator};

use crate::config::Config;
use crate::episode::Episode;
use crate::part_seed;
use crate::score::Report;

/// An episode that has ended: another one has begun in its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Finished {
    /// Its place in the batch.
    pub place: usize,
    /// What became of it.
    pub report: Report,
    /// The last thing that it saw.
    pub observation: Vec<f32>,
    /// What the shield said of that.
    pub unsafe_mask: u32,
}

/// One place of a batch.
#[derive(Debug)]
struct Place {
    episode: Episode,
    begun: u64,
    /// Decisions of the running episode that are left.
    left: usize,
    reward: f64,
    finished: Option<(Report, Vec<f32>, u32)>,
}

/// See the module. Episode *k* of place *i* has a seed of its own, whoever runs it and on how many cores.
#[derive(Debug)]
pub struct Batch {
    places: Vec<Place>,
    seed: u64,
}

impl Batch {
    /// `count` episodes of a kind; [`Batch::begin`] first.
    ///
    /// # Errors
    /// Where a sensor's configuration is out of its bounds.
    pub fn new(config: &Arc<Config>, count: usize) -> Result<Self, world::ConfigError> {
        let place = |_| {
            let episode = Episode::new(config.clone())?;
            Ok(Place { episode, begun: 0, left: 0, reward: 0.0, finished: None })
        };
        Ok(Self { places: (0..count).map(place).collect::<Result<_, _>>()?, seed: 0 })
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Begins every place's first episode, or all of them anew with another seed. The first ones are cut short, each at
    /// another decision: what is learnt from at one time is of all parts of an episode.
    pub fn begin(&mut self, seed: u64) {
        self.seed = seed;
        let count = self.places.len();
        self.places.par_iter_mut().enumerate().for_each(|(i, place)| {
            place.begun = 0;
            place.next(seed, i);
            place.left -= place.left * i / count;
        });
    }

    /// One decision in every place; where an episode ends, the next one begins.
    ///
    /// # Panics
    /// Where there are not as many actions as places.
    pub fn step(&mut self, actions: &[usize]) {
        assert_eq!(actions.len(), self.places.len(), "one action for each place");
        let seed = self.seed;
        self.places.par_iter_mut().with_min_len(8).zip(actions).enumerate().for_each(|(i, (place, action))| {
            let step = place.episode.step(*action);
            (place.reward, place.finished) = (step.reward, None);
            place.left -= 1;
            if step.ended || place.left == 0 {
                let episode = &place.episode;
                place.finished = Some((episode.report(), episode.observation().to_vec(), episode.unsafe_mask()));
                place.next(seed, i);
            }
        });
    }

    /// What every place is at now.
    pub fn episodes(&self) -> impl ExactSizeIterator<Item = &Episode> {
        self.places.iter().map(|place| &place.episode)
    }

    /// What the teacher says that each action is worth in each; see [`crate::Teacher::worths_m`].
    #[must_use]
    pub fn taught(&self) -> Vec<Vec<f64>> {
        self.places.par_iter().with_min_len(4).map(|place| place.episode.teacher().worths_m()).collect()
    }

    /// The rewards of the last step.
    pub fn rewards(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        self.places.iter().map(|place| place.reward)
    }

    /// The episodes that ended with the last step.
    pub fn finished(&self) -> impl Iterator<Item = Finished> + '_ {
        self.places.iter().enumerate().filter_map(|(i, place)| {
            let (report, observation, unsafe_mask) = place.finished.clone()?;
            Some(Finished { place: i, report, observation, unsafe_mask })
        })
    }
}

impl Place {
    fn next(&mut self, seed: u64, number: usize) {
        self.episode.begin(part_seed(part_seed(seed, number as u64), self.begun));
        self.begun += 1;
        self.left = self.episode.decisions();
    }
}
