//! What is seen through transparent things: two sides per pixel, the nearest and the farthest.

use glam::{Vec2, Vec3A};

use crate::arrival::Arrival;
use crate::layers::TILE;
use crate::scene::Scene;
use crate::shade::Spot;
use crate::view::{View, surface_of};

/// A transparent surface in front of a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pane {
    pub pixel: u32,
    /// Index of the pixel among those that show several opaque surfaces.
    pub mixed: Option<u32>,
    pub spot: Spot,
    /// Share of the pixel that it is in front of.
    pub coverage: f32,
    /// What leaves it towards the viewer, and the share of what is behind that passes.
    pub color: Vec3A,
    pub passes: Vec3A,
    /// Whether its mesh encloses a solid.
    pub is_solid: bool,
    /// Of a solid, the unit normal in the world, towards the viewer, and the unit direction in the world in which the sight
    /// goes on behind it.
    pub normal: Vec3A,
    pub inside: Vec3A,
}

impl Pane {
    /// Pixels.
    pub fn place(&self) -> Vec2 {
        Vec2::new(self.spot.x, self.spot.y)
    }
}

/// How far a bent sight may look aside, pixels: no farther than the tiles whose change is known.
const MOST_BENT: f32 = (TILE - 1) as f32;

/// What is seen through panes, the farther one first, of what is behind.
pub(crate) fn seen_through(panes: &[Pane], behind: Vec3A) -> Vec3A {
    let is_thing = matches!(panes, [far, near] if surface_of(far.spot.id) == surface_of(near.spot.id));
    panes.iter().fold(behind, |behind, pane| {
        let once = pane.color + behind * pane.passes;
        // Before the far side of a hollow thing and behind its near side lie those of its cavity.
        let color = if is_thing && !pane.is_solid { pane.color + once * pane.passes } else { once };
        behind + (color - behind) * pane.coverage
    })
}

/// What a bent sight meets.
pub(crate) struct Bent {
    /// A pixel that shows it.
    pixel: usize,
    /// The surroundings in its direction, and their share where it leads too far aside.
    around: Vec3A,
    share: f32,
}

impl Bent {
    pub fn seen(&self, colors: &[Vec3A]) -> Vec3A {
        colors[self.pixel].lerp(self.around, self.share)
    }
}

/// What is seen behind a solid transparent thing: the sight leaves its far side where it went on inside for as long as
/// the thing is deep. `None` when nothing is bent, what is seen there is nearer, or part of the thing itself is behind.
pub(crate) fn bent(panes: &[Pane], view: &View, arrival: &Arrival, scene: &Scene<'_>) -> Option<Bent> {
    let [far, near] = panes else { return None };
    if !near.is_solid || surface_of(far.spot.id) != surface_of(near.spot.id) {
        return None;
    }
    // What sticks to its far side, a label, is seen there wherever the sight is bent to.
    let body_of = |surface: usize| surface.checked_sub(1).and_then(|part| scene.assets.parts[part].body);
    let behind = body_of(usize::from(arrival.surface[near.pixel as usize]));
    if behind.is_some() && behind == body_of(surface_of(near.spot.id) as usize) {
        return None;
    }
    let lens = &view.lens;
    let [first, last] = [near, far].map(|pane| lens.point_at(pane.place(), pane.spot.depth));
    let place = near.place();
    let aside = lens.pixel_of(first + near.inside * first.distance(last)) - place;
    let pixel = (place + aside.clamp(Vec2::splat(-MOST_BENT), Vec2::splat(MOST_BENT))).round();
    let [column, row] = [pixel.x.clamp(0.0, lens.width as f32 - 1.0), pixel.y.clamp(0.0, lens.height as f32 - 1.0)];
    let index = row as usize * lens.width + column as usize;
    let depth = arrival.depth[index];
    let material = &scene.surfaces[surface_of(near.spot.id) as usize - 1];
    let leaving = refracted(near.inside, far.normal, material.index_of_refraction());
    let share = ((near.inside.dot(leaving) - 0.97) / (0.85 - 0.97)).clamp(0.0, 1.0);
    let around = if share > 0.0 { scene.lighting.surroundings(leaving) } else { Vec3A::ZERO };
    (depth <= 0.0 || depth > near.spot.depth).then_some(Bent { pixel: index, around, share })
}

/// The direction behind a border that is met along a unit direction against its unit normal; mirrored where nothing
/// passes. `ratio` is the index of refraction before it over the one behind.
pub(crate) fn refracted(along: Vec3A, normal: Vec3A, ratio: f32) -> Vec3A {
    let facing = -along.dot(normal);
    let behind = 1.0 - ratio * ratio * (1.0 - facing * facing);
    let bent = if behind > 0.0 {
        along * ratio + normal * (ratio * facing - behind.sqrt())
    } else {
        along + normal * (2.0 * facing)
    };
    bent.normalize_or(along)
}
