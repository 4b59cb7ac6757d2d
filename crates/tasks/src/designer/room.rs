//! Room that an object has in or on another one if a sentence asks for it, whether or not it belongs there.

use genmanip_core::{ObjectCard, Relation, RelationKind, Support};

use super::things::things;
use crate::references::sentence::{Part, Where};

/// Longest object on a flat or shallow support, in lengths of the support: its middle lies on the support.
const MAX_OVERHANG: f64 = 1.6;

/// Depth below which a support is shallow, so that a long object lies across its rim, metres.
const SHALLOW_M: f64 = 0.03;

/// An object with a lid or drawers that can be filled from above while it is open. Layouts of single objects of
/// several sizes decided the limits: a die, a pen, an egg and a stapler found room in drawers, but no roll of tape.
struct Openable {
    category: &'static str,
    /// States in which it is open, the plainest first.
    open: &'static [&'static str],
    /// Largest length and width of a content, as shares of the longer and the shorter side.
    content: [f64; 2],
    /// Largest height of a content, metres.
    max_height_m: f64,
}

const OPENABLE: [Openable; 4] = [
    Openable {
        category: "drawer cabinet",
        open: &["top_open", "bottom_open", "both_open"],
        content: [0.8, 0.4],
        max_height_m: 0.056,
    },
    Openable { category: "hinged-lid box", open: &["open"], content: [0.7, 0.75], max_height_m: 0.08 },
    Openable { category: "jewellery box", open: &["open"], content: [0.7, 0.7], max_height_m: 0.08 },
    Openable { category: "flap bin", open: &["open"], content: [0.8, 0.6], max_height_m: 0.13 },
];

fn openable(card: &ObjectCard) -> Option<&'static Openable> {
    OPENABLE.iter().find(|openable| openable.category == card.category)
}

/// State in which a part of an object is open to be filled; `None` if it cannot be filled from above.
pub(super) fn open_state(card: &ObjectCard, part: Option<Part>) -> Option<&'static str> {
    let wanted = match part {
        Some(Part::Upper) => Some("top_open"),
        Some(Part::Lower) => Some("bottom_open"),
        Some(Part::Both) => Some("both_open"),
        Some(Part::Any | Part::Other) | None => None,
    };
    openable(card)?.open.iter().copied().find(|state| wanted.is_none_or(|wanted| *state == wanted))
}

/// Support relation in which `item` can be brought to a place at `host`; `None` if there is none.
pub(super) fn support(place: &Where, host: &ObjectCard, item: &ObjectCard) -> Option<Relation> {
    let fits = |relation: Relation| match relation.kind() {
        RelationKind::Support(_) if host.uid == item.uid => false,
        RelationKind::Support(Support::In) if host.is_articulated => fits_into(host, item),
        RelationKind::Support(_) if !has_room(host, item) => false,
        RelationKind::Support(Support::In) => host.is_container && things().lies_inside(host, item),
        RelationKind::Support(Support::On) => {
            host.annotations.room.is_none() && (!host.is_articulated || is_furniture(host))
        }
        RelationKind::Support(Support::OnOrIn) => host.annotations.room.is_some() && !host.is_articulated,
        RelationKind::Side(_) | RelationKind::Around | RelationKind::Between => false,
    };
    place.relations.iter().copied().find(|relation| fits(*relation))
}

/// True if an articulated object has a flat top of its own.
fn is_furniture(host: &ObjectCard) -> bool {
    ["drawer cabinet", "hinged cabinet", "microwave", "mini oven"].contains(&host.category.as_str())
}

/// True if an open box or drawer can be filled with an object from above.
fn fits_into(host: &ObjectCard, item: &ObjectCard) -> bool {
    openable(host).is_some_and(|openable| {
        let [length, width] = sides(host);
        let [item_length, item_width] = sides(item);
        let [long, wide] = openable.content;
        item_length <= long * length && item_width <= wide * width && item.size_m.z <= openable.max_height_m
    })
}

/// True if there is room for `item` in or on `host`; long objects may stick out over both ends of a shallow one.
fn has_room(host: &ObjectCard, item: &ObjectCard) -> bool {
    let ([length, _], [item_length, item_width]) = (sides(host), sides(item));
    let is_shallow = host.annotations.room.is_none_or(|room| room.depth_m <= SHALLOW_M);
    let width = host.annotations.room.map_or(sides(host)[1], |room| room.inside_m[0].min(room.inside_m[1]));
    let lies_across = is_shallow && item_length <= MAX_OVERHANG * length && 2.0 * item_width <= width;
    let is_low = host.size_m.z <= sides(host)[1];
    things().has_room(host, item) || lies_across && is_low
}

/// Longer and shorter side of an object seen from above, metres.
fn sides(card: &ObjectCard) -> [f64; 2] {
    [card.size_m.x.max(card.size_m.y), card.size_m.x.min(card.size_m.y)]
}

/// Reason why none of some hosts takes an object at this place.
pub(super) fn why_no_room(place: &Where, hosts: &[&ObjectCard]) -> &'static str {
    let is_inside = place.relations.contains(&Relation::In);
    if is_inside && hosts.iter().all(|host| host.is_articulated && openable(host).is_none()) {
        return "cannot be filled from above, where the gripper comes from";
    }
    if is_inside && hosts.iter().all(|host| !host.is_container) {
        return "is no container";
    }
    "has no room for the object, which the gripper lays down as it lies"
}
