//! The black-box tests in one executable: each of these files once linked the whole project by itself.

mod access;
mod bad_input;
mod camera;
mod devices;
mod enrol;
mod evaluate;
mod fault_matrix;
mod faults;
mod gstreamer;
mod hearing;
mod injection;
mod links;
mod odometry;
mod planned;
mod record;
mod recordings;
mod replays;
mod shared_memory;
mod sound;
mod sources;
mod speak;
mod supervision;
mod swaps;
mod systemd;
mod voice;
mod walks;
