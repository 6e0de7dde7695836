//! cloud_file
