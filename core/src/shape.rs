//! Widths of a network: what a policy file states, and what follows from it.
//!
//! One build runs every [runnable](Shape::is_runnable) shape: working memory is sized for the largest, [`Shape::FULL`].

use crate::dims::{CODES, EMBED, HEAD, LAYERS, LOGITS, STEPS_ONE_WAY, padded};

/// Widths of a network: embedding `3 -> embed[0] -> embed[1] -> embed[2]`, two heads
/// `2 embed[2] -> head[0] -> head[1] -> 33`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Outputs of the pointwise embedding's layers; the last is the length of one cloud's feature.
    pub embed: [usize; 3],
    /// Outputs of a head's hidden layers.
    pub head: [usize; 2],
}

impl Shape {
    /// The paper's: 64-128-1024, heads 512-256 (implementation details).
    pub const FULL: Shape = Shape {
        embed: EMBED,
        head: HEAD,
    };
    /// For small microcontrollers, at most 256 KiB in 8-bit integers: 64-64-384, heads 128-64.
    pub const COMPACT: Shape = Shape {
        embed: [64, 64, 384],
        head: [128, 64],
    };

    /// Length of one cloud's global feature vector.
    pub const fn features(&self) -> usize {
        self.embed[2]
    }

    /// Length of the state: feature of the source, then feature of the target.
    pub const fn state(&self) -> usize {
        2 * self.features()
    }

    /// `(inputs, outputs)` of each layer in file order: embedding, translation head, rotation head.
    pub const fn layers(&self) -> [(usize, usize); LAYERS] {
        let ([e1, e2, features], [h1, h2]) = (self.embed, self.head);
        [
            (3, e1),
            (e1, e2),
            (e2, features),
            (2 * features, h1),
            (h1, h2),
            (h2, LOGITS),
            (2 * features, h1),
            (h1, h2),
            (h2, LOGITS),
        ]
    }

    /// Whether this build can run the shape: no width exceeds the paper's, and the inputs of every layer but the first are a
    /// multiple of 64, as rows of 8-bit codes are.
    pub fn is_runnable(&self) -> bool {
        let widths = |s: &Shape| {
            let ([e1, e2, features], [h1, h2]) = (s.embed, s.head);
            [e1, e2, 2 * features, h1, h2]
        };
        let fits = |(width, most): (usize, usize)| {
            (CODES..=most).contains(&width) && width.is_multiple_of(CODES)
        };
        widths(self).into_iter().zip(widths(&Shape::FULL)).all(fits)
    }

    /// The shape as stored in the header of a policy file.
    pub const fn header(&self) -> [u16; 8] {
        let ([e1, e2, features], [h1, h2]) = (self.embed, self.head);
        [
            e1 as u16,
            e2 as u16,
            features as u16,
            h1 as u16,
            h2 as u16,
            LOGITS as u16,
            0,
            0,
        ]
    }

    /// The shape that a header states, if this build can run it.
    pub fn from_header(header: [u16; 8]) -> Option<Shape> {
        let [e1, e2, features, h1, h2, ..] = header.map(usize::from);
        let shape = Shape {
            embed: [e1, e2, features],
            head: [h1, h2],
        };
        (shape.header() == header && shape.is_runnable()).then_some(shape)
    }

    /// Multiply-adds to embed one point.
    pub const fn macs_per_point(&self) -> usize {
        let [e1, e2, features] = self.embed;
        3 * e1 + e1 * e2 + e2 * features
    }

    /// Multiply-adds in the half of the heads' first layers that reads one cloud's feature.
    pub const fn macs_half(&self) -> usize {
        2 * self.features() * self.head[0]
    }

    /// Multiply-adds of both heads looking one way, without the target's half of their first layers, which hosts cache.
    pub const fn macs_step(&self) -> usize {
        let [h1, h2] = self.head;
        self.macs_half() + 2 * (h1 * h2 + h2 * LOGITS)
    }

    /// Multiply-adds of a registration on a microcontroller: two clouds of `points` points, `steps` steps, and only the
    /// target's feature cached. The policy looks both ways, and at all points in every step ([`crate::Policy::rescan`]).
    pub const fn macs_registration(&self, points: usize, steps: usize) -> u64 {
        let embedding = (points * self.macs_per_point()) as u64;
        let way = (self.macs_half() + self.macs_step()) as u64;
        let ways = steps as u64 + steps.saturating_sub(STEPS_ONE_WAY) as u64;
        (steps as u64 + 1) * embedding + ways * way
    }
}

const _: () = assert!(padded(Shape::FULL.features()) == Shape::FULL.features());
const _: () = assert!(Shape::FULL.macs_per_point() * 1024 == 142_802_944);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_say_the_shape_and_others_are_refused() {
        for shape in [Shape::FULL, Shape::COMPACT] {
            assert_eq!(Shape::from_header(shape.header()), Some(shape));
        }
        let full = Shape::FULL.header();
        for (i, width) in [
            (0, 0),
            (0, 128),
            (1, 96),
            (2, 1056),
            (2, 48),
            (4, 32),
            (5, 32),
            (7, 1),
        ] {
            let mut header = full;
            header[i] = width;
            assert_eq!(Shape::from_header(header), None, "{i} {width}");
        }
    }
}
