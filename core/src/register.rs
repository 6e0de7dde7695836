//! One registration: observe, embed, arg-max, accumulate, verdict.
