//! Where the streams of a run come from.

use messages::TopicId;

use super::{Settings, Source};
use crate::recorded::CueOrigin;

impl Settings {
    /// Whether the run has a simulated world: one of its sensors looks at it, or emulated devices do.
    #[must_use]
    pub fn has_world(&self) -> bool {
        self.simulation.emulated.on || self.sources().iter().any(|(_, source)| *source == Source::Simulated)
    }

    /// The sensors' sources, each with its key.
    #[must_use]
    pub fn sources(&self) -> Vec<(&'static str, Source)> {
        let second = self.lidar.second.as_ref().map(|second| ("lidar.second.source", second.source));
        let others = [
            ("lidar.source", self.lidar.source),
            ("depth.source", self.depth.source),
            ("odometry.source", self.odometry.source),
        ];
        others.into_iter().chain(second).collect()
    }

    /// Whether recorded frames stand in place of a sensor, or recorded cues in the handler's.
    #[must_use]
    pub fn replays(&self) -> bool {
        let mut sensors = self.sources().into_iter();
        sensors.any(|(_, source)| source == Source::Replayed) || self.cue.source == CueOrigin::Replayed
    }

    /// The streams that are taken from a recording.
    #[must_use]
    pub fn replayed_topics(&self) -> Vec<TopicId> {
        let second = self.lidar.second.as_ref().map(|second| (second.source, TopicId::SecondScan));
        let sources = [
            (self.lidar.source, TopicId::LidarScan),
            (self.depth.source, TopicId::DepthFrame),
            (self.odometry.source, TopicId::Odometry),
        ];
        let replayed =
            sources.into_iter().chain(second).filter(|(source, _)| *source == Source::Replayed).map(|(_, topic)| topic);
        replayed.chain((self.cue.source == CueOrigin::Replayed).then_some(TopicId::Cue)).collect()
    }
}
