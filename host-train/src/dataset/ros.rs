//! Messages of ROS 2 that hold clouds, from a network or a bag.

pub mod cdr;
pub mod point_cloud2;
