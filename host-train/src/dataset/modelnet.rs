//! modelnet
