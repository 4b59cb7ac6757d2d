//! Sampled decisions of a layout attempt before placement: headings and the feasible intervals that follow.

use std::f64::consts::{FRAC_PI_2, TAU};

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Aabb, Atom, HorizontalAxis, Pose, Relation, Workspace};
use genmanip_relations::placement_window;
use rand::{Rng, RngExt};

use crate::constraint_network::{Network, ORIGIN};
use crate::context::Context;

/// Maximum number of headings tried until an object fits into its container. Chosen: a box that fits at a quarter of
/// all headings is missed once in a thousand samples.
const MAX_HEADINGS: usize = 24;

/// Maximum yaw of an articulated object from facing the robot (rad). Chosen so that its doors stay in reach.
const FACING_RAD: f64 = 0.25;

/// Maximum yaw of an aligned object from the table's edges (rad). Chosen to look placed by a person.
const ALIGNED_RAD: f64 = 0.1;

/// Free space around an object in a cavity, both sides together, and above it in a covered one (m). Chosen larger than
/// the needs of settling.
const CAVITY_CLEARANCE_M: [f64; 2] = [0.002, 0.004];

/// Distance from the edge of a support region (m), and the usable share of the rest. Chosen because regions are boxes
/// and many carriers are round.
const EDGE_M: f64 = 0.012;
const USABLE_SHARE: f64 = 0.75;

/// Headings of all objects and the difference constraints of their centres.
#[derive(Clone, Debug)]
pub(crate) struct SampledLayout {
    pub objects: Vec<OrientedObject>,
    pub x: Network,
    pub y: Network,
    /// Index of the goal alternative for whose objects space is kept; `None` for none.
    pub alternative: Option<usize>,
}

/// An object with its sampled heading; all boxes have the object's origin at the world's origin.
#[derive(Clone, Debug)]
pub(crate) struct OrientedObject {
    pub yaw: f64,
    /// Bounds of the object.
    pub bounds: Aabb,
    /// Bounds of the cavities.
    cavities: Vec<Aabb>,
    /// Bounds of the root link, which can support other objects; moving links cannot.
    body: Aabb,
    /// True for an articulated object, whose cavities may be covered from above.
    is_articulated: bool,
    /// Region of the carrier over which this object is placed; `None` on the table or another surface.
    pub support_region: Option<SupportRegion>,
}

/// Region on or in a carrier for the bounds of an object, with the carrier's origin at the world's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SupportRegion {
    pub area: Aabb,
    /// True if covered from above, so that objects cannot be lowered into it.
    pub covered: bool,
}

/// Contradiction between relations: the indices of their edges.
pub(crate) struct Contradiction(pub Vec<usize>);

impl SampledLayout {
    /// Samples all headings and derives all implied bounds (`Network::close`). With `aligned`, yaw is a quarter turn up
    /// to `ALIGNED_RAD` off, and objects may use the larger area ([`crate::LayoutSettings::area`]).
    ///
    /// # Errors
    /// Indices into the context's edges that contradict each other.
    pub fn new(context: &Context, aligned: bool, rng: &mut impl Rng) -> Result<Self, Contradiction> {
        let mut objects: Vec<Option<OrientedObject>> = vec![None; context.models.len()];
        for step in &context.steps {
            let carrier = step.support.and_then(|(support, relation)| Some((objects[support].clone()?, relation)));
            let oriented = OrientedObject::sample(context, step.object, carrier.as_ref(), aligned, rng);
            objects[step.object] =
                Some(oriented.ok_or_else(|| Contradiction(step.support_edge.into_iter().collect()))?);
        }
        let objects: Vec<OrientedObject> = objects.into_iter().flatten().collect();
        let alternatives = context.goal_regions.len();
        let alternative = (alternatives > 0).then(|| rng.random_range(0..alternatives));
        let regions = alternative.map_or(0, |index| context.goal_regions[index].len());
        let network = Network::new(objects.len() + regions);
        let mut layout = Self { x: network.clone(), y: network, alternative, objects };
        layout.bound(context, aligned);
        let conflict = layout.x.close().and(layout.y.close());
        conflict.map_err(Contradiction)?;
        Ok(layout)
    }

    fn bound(&mut self, context: &Context, wide: bool) {
        let settings = context.settings;
        let workspace = context.world.workspace;
        let table = settings.area(&workspace, context.robot.reach_scale(), wide);
        let mut both = |a: usize, b: usize, x: [f64; 2], y: [f64; 2], edge: Option<usize>| {
            self.x.bound(a, b, x, edge);
            self.y.bound(a, b, y, edge);
        };
        for step in &context.steps {
            let oriented = &self.objects[step.object];
            let half = oriented.bounds.size() * 0.5;
            match step.support.zip(oriented.support_region) {
                Some(((support, _), support_region)) => {
                    let carrier = self.objects[support].bounds.center().truncate();
                    let (middle, max_offset) =
                        (support_region.area.center().truncate() - carrier, support_region.max_offset(half.truncate()));
                    let (low, high) = (middle - max_offset, middle + max_offset);
                    both(support + 1, step.object + 1, [low.x, high.x], [low.y, high.y], step.support_edge);
                }
                None => {
                    let area = context.area(context.grounds[step.object], table);
                    let inside = |[low, high]: [f64; 2], half: f64| [low + half, high - half];
                    both(ORIGIN, step.object + 1, inside(area.x, half.x), inside(area.y, half.y), step.support_edge);
                }
            }
            if context.moved[step.object] {
                let most = context.reach_m[1];
                both(ORIGIN, step.object + 1, [0.0, most], [-most, most], None);
            }
        }
        // Goal regions must have space on the table and within the robot's reach.
        let regions = self.alternative.map_or(&[][..], |index| &context.goal_regions[index]);
        for (number, region) in regions.iter().enumerate() {
            let at = context.models.len() + number + 1;
            let (size, far) = (self.objects[region.object].bounds.size(), context.reach_m[1]);
            let Workspace { x, y } = context.area(region.ground(), workspace);
            let half = size * 0.5;
            both(ORIGIN, at, [x[0] + half.x, far.min(x[1] - half.x)], [y[0] + half.y, y[1] - half.y], None);
            for &(relation, surface) in region.surfaces.iter().filter(|(relation, _)| !relation.is_support()) {
                if let Some(window) = context.surface_window(relation, surface, size) {
                    both(ORIGIN, at, window.x, window.y, None);
                }
            }
            for &(relation, anchor) in &region.anchors {
                let extent = self.objects[anchor].bounds.size();
                let centered = Aabb { min: extent * -0.5, max: extent * 0.5 };
                if let Some(window) = placement_window(relation, &centered, size, context.relations) {
                    both(anchor + 1, at, window.x, window.y, None);
                }
            }
        }
        for (edge, (atom, indices)) in context.edges.iter().enumerate() {
            let Atom::Relation { relation, reference, .. } = atom else { continue };
            if relation.is_support() {
                continue;
            }
            if let (&[subject], Some(surface)) = (indices.as_slice(), context.world.further_surface(reference)) {
                let size = self.objects[subject].bounds.size();
                if let Some(window) = context.surface_window(*relation, surface, size) {
                    both(ORIGIN, subject + 1, window.x, window.y, Some(edge));
                }
                continue;
            }
            let &[subject, reference] = indices.as_slice() else { continue };
            let (anchor, size) = (self.objects[reference].bounds.size(), self.objects[subject].bounds.size());
            let centered = Aabb { min: anchor * -0.5, max: anchor * 0.5 };
            let Some(window) = placement_window(*relation, &centered, size, context.relations) else { continue };
            let apart = (anchor + size) * 0.5 + DVec3::splat(context.gap(subject, reference));
            let (mut x, mut y) = (window.x, window.y);
            if let Some(side) = relation.side() {
                let (range, apart) = match side.axis {
                    HorizontalAxis::Depth => (&mut x, apart.x),
                    HorizontalAxis::Width => (&mut y, apart.y),
                };
                match side.is_positive {
                    true => range[0] = range[0].max(apart).min(range[1]),
                    false => range[1] = range[1].min(-apart).max(range[0]),
                }
            }
            both(reference + 1, subject + 1, x, y, Some(edge));
        }
    }
}

impl OrientedObject {
    /// Samples a heading; `None` if the object does not fit into its container at any heading tried.
    fn sample(
        context: &Context,
        object: usize,
        carrier: Option<&(Self, Relation)>,
        aligned: bool,
        rng: &mut impl Rng,
    ) -> Option<Self> {
        let model = &context.models[object];
        for _ in 0..MAX_HEADINGS {
            // Articulated objects face the robot; others have any yaw.
            let yaw = match (model.card.is_articulated, aligned) {
                (true, _) => rng.random_range(-FACING_RAD..FACING_RAD),
                (false, true) => {
                    f64::from(rng.random_range(0..4)) * FRAC_PI_2 + rng.random_range(-ALIGNED_RAD..ALIGNED_RAD)
                }
                (false, false) => rng.random_range(0.0..TAU),
            };
            let pose = Pose::from_position_yaw(DVec3::ZERO, yaw);
            let bounds = model.world_bounds(&pose, &context.joints[object]);
            let support_region = match carrier {
                Some((carrier, relation)) => match carrier.support_region_for(*relation, &bounds, rng) {
                    None => continue,
                    support_region => support_region,
                },
                None => None,
            };
            let cavities = model.cavities(&context.joints[object]);
            let cavities = cavities.iter().map(|piece| Aabb::from_pieces(&pose, [piece])).collect();
            let root = model.links.first().map_or(bounds, |link| Aabb::from_pieces(&pose, &link.pieces));
            return Some(Self {
                yaw,
                bounds,
                cavities,
                body: root,
                is_articulated: model.card.is_articulated,
                support_region,
            });
        }
        None
    }

    /// World pose with the bounds' centre at `center` and their underside at height `bottom` (m).
    pub fn pose(&self, center: DVec2, bottom: f64) -> Pose {
        let offset = self.bounds.center().truncate();
        Pose::from_position_yaw((center - offset).extend(bottom - self.bounds.min.z), self.yaw)
    }

    /// Samples a support region on or in this carrier for an object with these bounds; `None` if no cavity is large
    /// enough.
    fn support_region_for(&self, relation: Relation, bounds: &Aabb, rng: &mut impl Rng) -> Option<SupportRegion> {
        let size = bounds.size();
        let fits = |cavity: &&Aabb| (cavity.size() - size).truncate().min_element() > CAVITY_CLEARANCE_M[0];
        let fitting: Vec<&Aabb> = self.cavities.iter().filter(fits).collect();
        let from_above = |area: &Aabb| SupportRegion { area: *area, covered: false };
        match (relation.is_inside(), self.is_articulated) {
            (true, true) => {
                let high: Vec<&Aabb> =
                    fitting.into_iter().filter(|cavity| cavity.size().z > size.z + CAVITY_CLEARANCE_M[1]).collect();
                let at = rng.random_range(0..high.len().max(1));
                high.get(at).map(|cavity| SupportRegion { area: **cavity, covered: true })
            }
            (true, false) => fitting.first().map(|cavity| from_above(cavity)),
            (false, true) => Some(from_above(&self.body)),
            (false, false) => {
                Some(from_above(fitting.first().copied().or(self.cavities.first()).unwrap_or(&self.body)))
            }
        }
    }
}

impl SupportRegion {
    /// Maximum offset of an object's centre from the region's centre (m); `half` is half the size of the object's
    /// bounds.
    fn max_offset(&self, half: DVec2) -> DVec2 {
        (self.area.size().truncate() * 0.5 - half - DVec2::splat(EDGE_M)).max(DVec2::ZERO) * USABLE_SHARE
    }
}
