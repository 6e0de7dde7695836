//! Pairs drawn from models, as the protocols of the paper say.
