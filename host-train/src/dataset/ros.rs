//! ROS 2 messages that hold clouds, from a network or a bag.

pub mod cdr;
pub mod point_cloud2;
