//! How a registrar looks at clouds: which points it embeds, in which order, and where the feature goes.

use super::{Registrar, Registration};
use crate::cloud::Cloud;
use crate::cut::Reach;
use crate::dims::QUANT_TILE;
use crate::float;
use crate::focus::Focus;
use crate::numbers::Numbers;
use crate::order::Order;
use crate::quant;
use crate::view::View;
use core::ops::Range;

/// Which points of a cloud are embedded.
#[derive(Clone, Copy)]
enum Kept<'f> {
    /// Points of the source within reach.
    Within(Reach),
    /// Points of the target near the source.
    Near(&'f Focus),
}

impl Kept<'_> {
    fn keeps(self, view: &View, point: [f32; 3]) -> bool {
        match self {
            Kept::Within(reach) => reach.keeps(view, point),
            Kept::Near(focus) => focus.keeps(view, point),
        }
    }
}

impl Registrar<'_, '_> {
    /// Finds the order in which the kernels embed a cloud fastest, if that is not the cloud's own.
    pub(super) fn put_in_order(&self, cloud: Cloud<'_>, order: &mut Order) {
        let prunes = match &self.policy.network {
            Numbers::F32(network) => network.embedding.prunes(self.isa),
            Numbers::Int8(_) => self.isa.prunes_codes(),
        };
        // With ties, the critical point depends on the order.
        if prunes && self.policy.sees_all(1) {
            order.find(cloud);
        } else {
            order.clear();
        }
    }

    /// Stores the embedded target's feature, and turns to the source.
    pub(super) fn finish_target(&mut self, registration: &mut Registration<'_>) {
        self.finish();
        let (isa, target) = (self.isa, &mut registration.target);
        match &self.policy.network {
            Numbers::F32(network) => {
                let target = target.floats();
                target.feature = self.scratch.floats().feature;
                let heads = [&network.translation, &network.rotation];
                for (head, half) in heads.into_iter().zip(&mut target.halves) {
                    float::target_half(isa, head, &target.feature, half);
                }
            }
            Numbers::Int8(network) => {
                let target = target.integers();
                target.feature.clone_from(&self.scratch.integers().feature);
                for (head, sums) in network.heads.iter().zip(&mut target.sums) {
                    quant::target_sums(isa, head, &target.feature, sums);
                }
            }
        }
        self.put_in_order(registration.source, &mut registration.order);
    }

    /// Embeds at most `points` more points of the target, from index `seen` on; returns the new `seen`.
    pub(super) fn look_at_target(
        &mut self,
        registration: &mut Registration<'_>,
        seen: usize,
        points: usize,
    ) -> usize {
        let (target, view) = (registration.whole_target, registration.target_view());
        if seen == 0 {
            self.put_in_order(target, &mut registration.order);
        }
        let focus = self.focus(registration, &view);
        let end = seen.saturating_add(points).min(target.len());
        let kept = Kept::Near(&focus);
        self.embed_cloud(target, &registration.order, seen..end, kept, false, &view);
        end
    }

    /// The points of the target to look at.
    fn focus(&self, registration: &Registration<'_>, target_view: &View) -> Focus {
        if self.policy.sight.focus == 0 {
            return Focus::ALL;
        }
        let (source, view) = (registration.source, registration.source_view());
        let reach = self.policy.sight.cut.of(source, &view);
        Focus::on(
            (source, &view, reach),
            (registration.whole_target, target_view),
        )
    }

    /// Embeds at most `points` more points of the source under the current pose, from index `seen` on; returns the new `seen`.
    pub(super) fn look(
        &mut self,
        registration: &Registration<'_>,
        seen: usize,
        points: usize,
    ) -> usize {
        let (source, view) = (registration.source, registration.source_view());
        if self.policy.sees_all(registration.steps) {
            let end = seen.saturating_add(points).min(source.len());
            let counted = self.finds_critical(registration.steps);
            let reach = self.policy.sight.cut.of(source, &view);
            let order = &registration.order;
            let kept = Kept::Within(reach);
            self.embed_cloud(source, order, seen..end, kept, counted, &view);
            return end;
        }
        let mut seen = seen;
        let mut tile = [[0.0; 3]; QUANT_TILE];
        let mut left = points;
        while left > 0 && seen < source.len() {
            let mut filled = 0;
            for place in tile.iter_mut().take(left) {
                let next = registration.critical.next(seen);
                let Some((next, point)) = next.and_then(|i| Some((i, source.point(i)?))) else {
                    seen = source.len();
                    break;
                };
                *place = point;
                seen = next + 1;
                filled += 1;
            }
            if let Some(points) = tile.get(..filled) {
                self.embed(points, None, &view);
            }
            left -= filled.min(left);
        }
        seen
    }

    /// Whether the step after `steps` steps looks at all points, and the next one only at the critical ones.
    fn finds_critical(&self, steps: usize) -> bool {
        self.policy.sees_all(steps) && !self.policy.sees_all(steps + 1)
    }

    /// Turns the embedded source into its feature, and keeps its critical points if the next step needs them.
    pub(super) fn finish_source(&mut self, registration: &mut Registration<'_>) {
        if self.finds_critical(registration.steps) {
            let (critical, order) = (&mut registration.critical, &registration.order);
            let channels = self.policy.shape.features();
            critical.clear();
            match &self.policy.network {
                Numbers::F32(_) => {
                    let winners = self.scratch.floats().winners().iter().take(channels);
                    winners.for_each(|&place| critical.insert(order.point(place.into())));
                }
                Numbers::Int8(_) => {
                    let winners = self.scratch.integers().winners().take(channels);
                    winners.for_each(|place| critical.insert(order.point(place)));
                }
            }
        }
        self.finish();
    }

    /// Turns what was embedded into a feature; in f32 it is one already.
    fn finish(&mut self) {
        match &self.policy.network {
            Numbers::F32(_) => {}
            Numbers::Int8(network) => quant::finish(network, self.scratch.integers()),
        }
    }

    /// Embeds the kept points at some places of an order; with `counted`, records the places of the critical ones among them.
    fn embed_cloud(
        &mut self,
        cloud: Cloud<'_>,
        order: &Order,
        places: Range<usize>,
        kept: Kept<'_>,
        counted: bool,
        view: &View,
    ) {
        let mut tile = [[0.0; 3]; QUANT_TILE];
        let mut place = places.start;
        while place < places.end {
            let together = (places.end - place).min(order.together(place));
            let end = place + together;
            let mut filled = 0;
            while let Some(space) = tile.get_mut(filled)
                && place < end
            {
                let point = cloud.point(order.point(place)).unwrap_or_default();
                if kept.keeps(view, point) {
                    *space = point;
                    filled += 1;
                } else if counted && filled > 0 {
                    // Counted points must lie at consecutive places.
                    break;
                }
                place += 1;
            }
            let points = tile.get(..filled).unwrap_or(&[]);
            self.embed(points, counted.then_some(place - filled), view);
        }
    }

    /// Embeds points of the current cloud; with `first`, the place of the first one, records the critical ones among them.
    fn embed(&mut self, points: &[[f32; 3]], first: Option<usize>, view: &View) {
        match &self.policy.network {
            Numbers::F32(network) => {
                let scratch = self.scratch.floats();
                float::embed(self.isa, &network.embedding, points, first, view, scratch);
            }
            Numbers::Int8(network) => {
                let scratch = self.scratch.integers();
                quant::embed(self.isa, network, points, first, view, scratch);
            }
        }
    }
}
