//! What lidar and camera see from the swaying body.

use messages::DepthHeader;
use mujoco_rs::prelude::*;
use nalgebra::{UnitQuaternion, Vector3};
use world::LidarConfig;

use crate::legs::attitude;
use crate::rays::Rays;

/// Where the body is, on which sensors are mounted.
#[derive(Debug, Clone, Copy)]
pub struct Sight {
    /// Of the body's origin (world frame), metres.
    at: Vector3<f64>,
    turned: UnitQuaternion<f64>,
    /// Heights of sensors are told for a body that is so high, metres.
    standing_m: f64,
}

impl Sight {
    /// From where the body is now.
    #[must_use]
    pub fn of(data: &MjData<Box<MjModel>>, standing_m: f64) -> Self {
        Self { at: Vector3::from_column_slice(&data.qpos()[..3]), turned: attitude(data), standing_m }
    }

    /// Where something mounted at a place of the level robot frame is (world frame), metres.
    fn place(&self, x_m: f64, y_m: f64, z_m: f64) -> Vector3<f64> {
        self.at + self.turned * Vector3::new(x_m, y_m, z_m - self.standing_m)
    }

    /// The range of each beam, metres; `None` where it meets nothing.
    pub fn scan(&self, lidar: &LidarConfig, rays: &mut Rays, ranges_m: &mut Vec<Option<f64>>) {
        let mount = lidar.robot_from_lidar;
        let from = self.place(mount.x_m, mount.y_m, lidar.height_m).into();
        ranges_m.clear();
        ranges_m.extend((0..lidar.beams).map(|beam| {
            let angle_rad = mount.yaw_rad + lidar.angle_min_rad + beam as f64 * lidar.angle_increment_rad;
            let way = self.turned * Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0);
            rays.cast(&from, &way.into(), lidar.range_max_m)
        }));
    }

    /// The inverse depth of each pixel along the optical axis, 1/metres, row by row; 0 where nothing is met within
    /// `reach_m`, or where what a pixel (row, column) meets at a place (world frame) is dark.
    pub fn photograph(
        &self,
        camera: &DepthHeader,
        reach_m: f64,
        rays: &mut Rays,
        is_dark: impl Fn([usize; 2], &Vector3<f64>) -> bool,
        inverse_depths: &mut [f32],
    ) {
        let mount = camera.robot_from_camera;
        let from: [f64; 3] = self.place(mount.x_m, mount.y_m, mount.z_m).into();
        let turned = self.turned * UnitQuaternion::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad);
        for (i, inverse_depth) in inverse_depths.iter_mut().enumerate() {
            let (row, column) = (i / camera.width as usize, i % camera.width as usize);
            let left = -(column as f64 - camera.cx_px) / camera.fx_px;
            let up = -(row as f64 - camera.cy_px) / camera.fy_px;
            let way = Vector3::new(1.0, left, up);
            let length = way.norm();
            let way = turned * (way / length);
            let met = rays.cast(&from, &way.into(), reach_m * length);
            let met = met.filter(|range_m| !is_dark([row, column], &(Vector3::from(from) + way * *range_m)));
            *inverse_depth = met.map_or(0.0, |range_m| (length / range_m) as f32);
        }
    }
}
