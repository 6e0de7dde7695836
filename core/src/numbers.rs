//! The two number formats, of a policy and of everything that goes with it.

/// Something in one of the two number formats: a network, its working memory, the feature of a target.
#[derive(Clone, Copy, Debug)]
pub enum Numbers<F, I> {
    /// In 8-bit integers. The first variant, so that zeroed memory of a microcontroller takes no flash.
    Int8(I),
    /// In 32-bit floating point.
    F32(F),
}

impl<F, I> Numbers<F, I> {
    /// The content in floating point; integer content is first replaced by `zero`.
    pub(crate) fn floats(&mut self, zero: fn() -> F) -> &mut F {
        loop {
            match self {
                Numbers::F32(floats) => return floats,
                Numbers::Int8(_) => self.become_f32(zero),
            }
        }
    }

    /// The content in integers; floating-point content is first replaced by `zero`.
    pub(crate) fn integers(&mut self, zero: fn() -> I) -> &mut I {
        loop {
            match self {
                Numbers::Int8(integers) => return integers,
                Numbers::F32(_) => self.become_int8(zero),
            }
        }
    }

    // Out of line, so that only callers that change the format have a copy on their stack.
    #[cold]
    #[inline(never)]
    fn become_f32(&mut self, zero: fn() -> F) {
        *self = Numbers::F32(zero());
    }

    #[cold]
    #[inline(never)]
    fn become_int8(&mut self, zero: fn() -> I) {
        *self = Numbers::Int8(zero());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_stays_until_the_other_format_is_asked_for() {
        let mut numbers: Numbers<f32, i8> = Numbers::Int8(3);
        *numbers.integers(|| 0) += 1;
        assert!(matches!(numbers, Numbers::Int8(4)));
        *numbers.floats(|| 0.5) += 1.0;
        assert!(matches!(numbers, Numbers::F32(1.5)));
        assert_eq!(*numbers.integers(|| 7), 7);
    }
}
