//! What scans are laid onto: the surfaces that the last keyframes saw.

use std::collections::VecDeque;

use guidance::se2::Se2;
use nalgebra::Vector2;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::contour::ContourPoint;

/// Surfaces look the same way where their normals are within 45 degrees.
const SAME_WAY: f64 = 0.7;

/// Points of the last keyframes, odometry frame.
#[derive(Debug, Clone, Default)]
pub struct Reference {
    keyframes: VecDeque<Vec<Surface>>,
    tree: RTree<Surface>,
    newest: Option<Se2>,
}

type Surface = GeomWithData<[f64; 2], [f64; 2]>;

impl Reference {
    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Where the robot was at the newest keyframe.
    #[must_use]
    pub fn odom_from_newest(&self) -> Option<&Se2> {
        self.newest.as_ref()
    }

    /// Takes in what a robot there sees, and forgets what goes beyond `kept` keyframes.
    pub fn add(&mut self, odom_from_robot: &Se2, points: &[ContourPoint], kept: usize) {
        let surfaces = points.iter().map(|point| {
            let point = point.seen_from(odom_from_robot);
            GeomWithData::new([point.at.x, point.at.y], [point.normal.x, point.normal.y])
        });
        self.keyframes.push_back(surfaces.collect());
        while self.keyframes.len() > kept {
            self.keyframes.pop_front();
        }
        self.tree = RTree::bulk_load(self.keyframes.iter().flatten().copied().collect());
        self.newest = Some(*odom_from_robot);
    }

    /// The nearest point within `reach_m` that looks the same way, all in the odometry frame.
    #[must_use]
    pub fn nearest(&self, point: &ContourPoint, reach_m: f64) -> Option<ContourPoint> {
        let nearest = self.tree.nearest_neighbor(&[point.at.x, point.at.y])?;
        let (at, normal) = (Vector2::from(*nearest.geom()), Vector2::from(nearest.data));
        let is_near = (at - point.at.coords).norm_squared() <= reach_m * reach_m;
        (is_near && normal.dot(&point.normal) > SAME_WAY).then(|| ContourPoint { at: at.into(), normal })
    }
}
