//! Top view of a layout: table, robot, footprints of objects, and relations.

use genmanip_core::{GraphEdge, ReferenceId, Workspace};

use super::colors::{CONFLICT, GOAL, HAIRLINE, INITIAL, INK, MUTED, hex};
use super::graph::bounds;
use super::route::{LABEL_SIZE, RoutedEdge, Shape, UnroutedEdge, label_size, route};
use super::svg::{Anchor, Area, BOLD, Canvas, Point, Svg, text_width, wrap};

/// Contents of the top view.
#[derive(Clone, Debug, PartialEq)]
pub struct TopView {
    /// Area of the table in which objects may be placed.
    pub workspace: Workspace,
    /// Objects, and support surfaces other than the table, in any order.
    pub footprints: Vec<Footprint>,
    /// Relations, drawn as arrows from subject to reference.
    pub edges: Vec<DrawnEdge>,
    /// Radii of the reach around the robot's base, m, drawn as arcs.
    pub reach_m: Vec<f64>,
    /// Regions in which each relation allows the centre of an object that could not be placed.
    pub windows: Vec<PlaceWindow>,
}

/// Labelled rectangle in the world's xy plane.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaceWindow {
    /// Smallest and largest x, world frame, m.
    pub x: [f64; 2],
    /// Smallest and largest y, world frame, m.
    pub y: [f64; 2],
    /// Label that names the relation which allows the region.
    pub label: String,
}

/// Outline of an object seen from above.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    /// Id of the instance or surface, to which the edges refer.
    pub id: ReferenceId,
    /// Name that is written at the object.
    pub name: String,
    /// sRGB colour of the filled outline.
    pub color: [u8; 3],
    /// Outlines in the world's xy plane, m, e.g. one convex polygon per collision piece.
    pub polygons: Vec<Vec<[f64; 2]>>,
}

/// Relation drawn as an arrow.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DrawnEdge {
    /// Relation between objects, by their ids.
    pub edge: GraphEdge,
    /// Role of the relation, which determines colour and line style.
    pub role: EdgeRole,
}

/// Role of a drawn relation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeRole {
    /// The relation holds initially.
    Initial,
    /// The relation is a goal.
    Goal,
    /// The relation could not be satisfied.
    Conflict,
}

/// Scale of the drawing, pixels per metre.
const SCALE: f64 = 490.0;
const NAME_SIZE: f64 = 12.5;
const BASE_RADIUS_M: f64 = 0.09;
const FOOT: f64 = 34.0;

/// Draws a layout from above with the robot at the bottom: up is front (+x), left is the robot's left (+y).
///
/// Points that are not finite, and relations of objects without a footprint, are omitted.
pub fn layout_svg(picture: &TopView) -> Svg {
    let (canvas, [width, height]) = plan_drawing(picture);
    canvas.finish(width, height, "Layout seen from above")
}

/// Drawing of [`layout_svg`], and its width and height (px).
pub fn plan_drawing(picture: &TopView) -> (Canvas, [f64; 2]) {
    let view = View::of(picture);
    let mut canvas = Canvas::default();
    draw_table(&mut canvas, &view, picture);
    let scene = PlanScene::new(picture, &view);
    scene.draw(&mut canvas);
    draw_windows(&mut canvas, &view, picture);
    let mut note = String::from("Up is front = away from the robot, left is the robot's left. Grid 10 cm.");
    let radii: Vec<String> = picture.radii().map(|radius| format!("{radius} m")).collect();
    if !radii.is_empty() {
        note += &format!(" Dashed: reach {}.", radii.join(", "));
    }
    let foot = [14.0, view.height - 12.0];
    canvas.text(foot, 11.0, Anchor::Start, &format!(r#"fill="{MUTED}""#), &note);
    (canvas, [view.width, view.height])
}

fn draw_windows(canvas: &mut Canvas, view: &View, picture: &TopView) {
    let Workspace { x, y } = picture.workspace;
    let clip = |[low, high]: [f64; 2], [least, most]: [f64; 2]| [low.clamp(least, most), high.clamp(least, most)];
    let style = format!(
        r#"fill="{CONFLICT}" fill-opacity="0.10" stroke="{CONFLICT}" stroke-width="1.4" stroke-dasharray="6 4""#
    );
    let mut foot = 0.0_f64;
    for window in &picture.windows {
        if window.x.iter().chain(&window.y).any(|value| !value.is_finite()) {
            continue;
        }
        // Regions beyond the table are clamped to its edge, so that they stay visible.
        let (wx, wy) = (clip(window.x, [x[0] - 0.05, x[1] + 0.04]), clip(window.y, [y[0] - 0.05, y[1] + 0.05]));
        let ([left, top], [right, bottom]) = (view.page([wx[1], wy[1]]), view.page([wx[0], wy[0]]));
        let area = Area { x: left, y: top, width: (right - left).max(2.0), height: (bottom - top).max(2.0) };
        canvas.rect(&area, 3.0, &style);
        let width = text_width(&window.label, LABEL_SIZE) * BOLD + 8.0;
        let mut middle = [area.center()[0], area.y + 10.0];
        // Labels of regions that begin at about the same height are stacked.
        if (middle[1] - foot).abs() < 18.0 {
            middle[1] = foot + 18.0;
        }
        foot = middle[1];
        canvas.plate(&Area::around(middle, width, 16.0), LABEL_SIZE, [CONFLICT, "#ffffff"], &window.label);
    }
}

impl TopView {
    fn radii(&self) -> impl Iterator<Item = f64> {
        self.reach_m.iter().copied().filter(|radius| radius.is_finite() && *radius > 0.0)
    }
}

/// Mapping from the world's xy plane (m) to the page (px).
struct View {
    front_m: f64,
    left_m: f64,
    width: f64,
    height: f64,
}

impl View {
    fn of(picture: &TopView) -> Self {
        let Workspace { x, y } = picture.workspace;
        let points: Vec<[f64; 2]> = picture.footprints.iter().flat_map(finite_points).collect();
        // A distant object must not shrink the table to a dot, so the view grows by at most half a metre.
        let reach = |low: f64, high: f64, axis: usize| {
            points.iter().fold([low, high], |[a, b], point| {
                [a.min(point[axis].max(low - 0.5)), b.max(point[axis].min(high + 0.5))]
            })
        };
        let [back, front] = reach(x[0].min(-BASE_RADIUS_M - 0.02), x[1], 0);
        let [right, left] = reach(y[0], y[1], 1);
        let (front_m, left_m) = (front + 0.05, left + 0.06);
        Self { front_m, left_m, width: (left_m - right + 0.06) * SCALE, height: (front_m - back) * SCALE + FOOT }
    }

    fn page(&self, world: [f64; 2]) -> Point {
        [(self.left_m - world[1]) * SCALE, (self.front_m - world[0]) * SCALE]
    }

    /// Arcs of the robot's reach over the table, in page coordinates.
    fn arcs(&self, picture: &TopView) -> Vec<Vec<Point>> {
        let [right, left] = picture.workspace.y;
        let arc = |radius: f64| {
            (-180..=180)
                .map(|half_degree| (f64::from(half_degree) / 2.0).to_radians())
                .map(|angle| [radius * angle.cos(), radius * angle.sin()])
                .filter(|world| (right..=left).contains(&world[1]) && (0.0..=self.front_m).contains(&world[0]))
                .map(|world| self.page(world))
                .collect()
        };
        picture.radii().map(arc).collect()
    }
}

fn finite_points(footprint: &Footprint) -> Vec<[f64; 2]> {
    footprint.polygons.iter().flatten().filter(|point| point.iter().all(|value| value.is_finite())).copied().collect()
}

fn draw_table(canvas: &mut Canvas, view: &View, picture: &TopView) {
    let Workspace { x, y } = picture.workspace;
    let [left, top] = view.page([x[1], y[1]]);
    let [right, bottom] = view.page([x[0], y[0]]);
    let table = Area { x: left, y: top, width: right - left, height: bottom - top };
    canvas.rect(&table, 6.0, &format!(r##"fill="#faf8f5" stroke="{HAIRLINE}" stroke-width="1.5""##));
    let lines = |low: f64, high: f64| {
        let first = (low.clamp(-100.0, 100.0) * 10.0 + 1e-6).floor() as i64 + 1;
        (first..).map(|step| step as f64 / 10.0).take_while(move |value| *value < high - 1e-6).take(100)
    };
    let grid = r##"fill="none" stroke="#ece7df""##;
    for value in lines(x[0], x[1]) {
        canvas.polyline(&[view.page([value, y[1]]), view.page([value, y[0]])], false, grid);
        let at = view.page([value, y[1]]);
        canvas.text(
            [at[0] - 26.0, at[1] + 3.5],
            10.5,
            Anchor::Start,
            &format!(r#"fill="{MUTED}""#),
            &format!("{value:.1}"),
        );
    }
    for value in lines(y[0], y[1]) {
        canvas.polyline(&[view.page([x[1], value]), view.page([x[0], value])], false, grid);
        let at = view.page([x[1], value]);
        canvas.text([at[0], at[1] - 7.0], 10.5, Anchor::Middle, &format!(r#"fill="{MUTED}""#), &format!("{value:.1}"));
    }
    for arc in view.arcs(picture) {
        canvas.polyline(&arc, false, r##"fill="none" stroke="#7c9cc4" stroke-dasharray="7 5" stroke-width="1.3""##);
    }
    let base = view.page([0.0, 0.0]);
    canvas.circle(base, BASE_RADIUS_M * SCALE, &format!(r##"fill="#e2e8f0" stroke="{MUTED}""##));
    canvas.text([base[0], base[1] + 4.0], 12.0, Anchor::Middle, &format!(r#"fill="{INK}" font-weight="600""#), "robot");
    let [bx, by] = [base[0], base[1] - BASE_RADIUS_M * SCALE];
    canvas.arrow(&[[bx, by - 4.0], [bx, by - 34.0]], MUTED, 1.4, false);
    canvas.text([bx + 9.0, by - 18.0], 11.0, Anchor::Start, &format!(r#"fill="{MUTED}""#), "front +x");
    canvas.arrow(
        &[[bx - BASE_RADIUS_M * SCALE - 4.0, base[1]], [bx - BASE_RADIUS_M * SCALE - 34.0, base[1]]],
        MUTED,
        1.4,
        false,
    );
    let at = [bx - BASE_RADIUS_M * SCALE - 88.0, base[1] + 4.0];
    canvas.text(at, 11.0, Anchor::Start, &format!(r#"fill="{MUTED}""#), "left +y");
}

/// Objects, names and arrows of a top view, in page coordinates (px).
pub struct PlanScene {
    objects: Vec<(Vec<Vec<Point>>, [u8; 3])>,
    /// Lines of each name, with the area they cover.
    pub names: Vec<(Vec<String>, Area)>,
    /// Arrows between footprints, each with its label and role.
    pub arrows: Vec<(RoutedEdge, String, EdgeRole)>,
}

impl PlanScene {
    fn new(picture: &TopView, view: &View) -> Self {
        let mut order: Vec<(&Footprint, Area)> = picture
            .footprints
            .iter()
            .map(|footprint| {
                let points = finite_points(footprint);
                (footprint, bounds(points.iter().map(|point| Area::around(view.page(*point), 0.0, 0.0))))
            })
            .filter(|(footprint, _)| !finite_points(footprint).is_empty())
            .collect();
        // Small objects are drawn over large ones.
        order.sort_by(|a, b| (b.1.width * b.1.height).total_cmp(&(a.1.width * a.1.height)));
        let objects = order.iter().map(|(footprint, _)| (outlines(footprint, view), footprint.color)).collect();

        let index = |id: &ReferenceId| order.iter().position(|(footprint, _)| footprint.id == *id);
        let (mut wires, mut roles) = (Vec::new(), Vec::new());
        let mut carried: Vec<Option<String>> = vec![None; order.len()];
        for DrawnEdge { edge, role } in &picture.edges {
            let Some(from) = index(&edge.subject) else { continue };
            let references = [Some(&edge.reference), edge.second_reference.as_ref()];
            for to in references.into_iter().flatten().filter_map(index).filter(|to| *to != from) {
                if edge.relation.is_support() && order[from].1.overlaps(&order[to].1) {
                    carried[from] = Some(format!("{} {}", edge.relation.name(), order[to].0.name));
                } else {
                    wires.push(UnroutedEdge { from, to, label: edge.relation.name().into() });
                    roles.push(*role);
                }
            }
        }
        let boxes: Vec<Area> = order.iter().map(|(_, area)| *area).collect();
        let page = Area { x: 36.0, y: 24.0, width: view.width - 40.0, height: view.height - FOOT - 24.0 };
        let lanes: Vec<(Point, Point)> =
            wires.iter().map(|wire| (boxes[wire.from].center(), boxes[wire.to].center())).collect();
        let mut names: Vec<(Vec<String>, Area)> = Vec::new();
        for ((footprint, area), carried) in order.iter().zip(&carried) {
            let mut lines = wrap(&footprint.name, NAME_SIZE, 110.0, 2);
            lines.extend(carried.clone());
            let place = place_name(&lines, area, &boxes, &names, &lanes, &page);
            names.push((lines, place));
        }
        let mut shapes: Vec<Shape> = order
            .iter()
            .map(|(footprint, area)| Shape {
                area: *area,
                outlines: outlines(footprint, view),
                solid: false,
                owner: None,
            })
            .collect();
        shapes.extend(names.iter().enumerate().map(|(at, (_, area))| Shape { owner: Some(at), ..Shape::solid(*area) }));
        let (routed, _) = route(&shapes, &wires, [0.45, 0.92]);
        let arrows = routed.into_iter().zip(wires).zip(roles).map(|((line, wire), role)| (line, wire.label, role));
        Self { objects, arrows: arrows.collect(), names }
    }

    fn draw(&self, canvas: &mut Canvas) {
        for (outlines, color) in &self.objects {
            let style = format!(
                r##"fill="{}" fill-opacity="0.72" stroke="#334155" stroke-opacity="0.55" stroke-linejoin="round""##,
                hex(*color)
            );
            for outline in outlines {
                canvas.polyline(outline, true, &style);
            }
        }
        let color = |role: EdgeRole| match role {
            EdgeRole::Initial => INITIAL,
            EdgeRole::Goal => GOAL,
            EdgeRole::Conflict => CONFLICT,
        };
        for (routed, _, role) in &self.arrows {
            canvas.arrow(&routed.points, color(*role), 1.7, *role != EdgeRole::Initial);
        }
        for (lines, area) in &self.names {
            canvas.rect(area, 4.0, r##"fill="#ffffff" fill-opacity="0.82""##);
            for (row, line) in lines.iter().enumerate() {
                let at = [area.x + area.width / 2.0, area.y + 13.0 + row as f64 * 15.0];
                canvas.text(at, NAME_SIZE, Anchor::Middle, r#"font-weight="600""#, line);
            }
        }
        for (routed, label, role) in &self.arrows {
            canvas.plate(&routed.label, LABEL_SIZE, [color(*role), "#ffffff"], label);
        }
    }

    /// Texts and shapes of a diagram, for tests.
    #[cfg(test)]
    pub fn of(picture: &TopView) -> Self {
        Self::new(picture, &View::of(picture))
    }
}

fn outlines(footprint: &Footprint, view: &View) -> Vec<Vec<Point>> {
    let finite = |outline: &&Vec<[f64; 2]>| outline.iter().flatten().all(|value| value.is_finite());
    footprint.polygons.iter().filter(finite).map(|outline| outline.iter().map(|at| view.page(*at)).collect()).collect()
}

/// Position of a name: inside its object if the name fits, else beside it, without overlapping other names, objects and
/// arrows if possible.
fn place_name(
    lines: &[String],
    own: &Area,
    boxes: &[Area],
    names: &[(Vec<String>, Area)],
    lanes: &[(Point, Point)],
    page: &Area,
) -> Area {
    let width = lines.iter().map(|line| text_width(line, NAME_SIZE) * BOLD).fold(0.0, f64::max) + 6.0;
    let height = lines.len() as f64 * 15.0 + 4.0;
    let [x, y] = own.center();
    let mut candidates = vec![Area::around([x, y], width, height)];
    for distance in [3.0, 16.0, 34.0, 60.0, 90.0] {
        let (dx, dy) = (own.width / 2.0 + width / 2.0 + distance, own.height / 2.0 + height / 2.0 + distance);
        for [sx, sy] in [
            [0.0, 1.0],
            [0.0, -1.0],
            [1.0, 0.0],
            [-1.0, 0.0],
            [0.6, 1.0],
            [-0.6, 1.0],
            [0.6, -1.0],
            [-0.6, -1.0],
            [1.0, 0.7],
            [-1.0, 0.7],
            [1.0, -0.7],
            [-1.0, -0.7],
        ] {
            candidates.push(Area::around([x + sx * dx, y + sy * dy], width, height));
        }
    }
    let cost = |rank: usize, area: &Area| {
        let over_names = names.iter().filter(|(_, other)| area.overlaps(&other.grown(2.0))).count();
        let over_boxes = boxes.iter().filter(|other| *other != own && area.overlaps(other)).count();
        let (label_width, label_height) = label_size("right");
        let over_lanes = lanes
            .iter()
            .filter(|(a, b)| {
                let room =
                    Area::around(area.center(), area.width + label_width * 0.4, area.height + label_height * 0.4);
                (0..=20).map(|step| f64::from(step) / 20.0).any(|t| {
                    let at = [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
                    room.contains(at) && !own.contains(at)
                })
            })
            .count();
        let spills = rank == 0 && (width > own.width + 8.0 || height > own.height);
        let outside = !area.within(page);
        1000.0 * over_names as f64
            + 500.0 * f64::from(u8::from(outside))
            + 60.0 * over_boxes as f64
            + 45.0 * over_lanes as f64
            + if spills { 40.0 } else { 0.0 }
            + rank as f64
    };
    let best = candidates.iter().enumerate().min_by(|a, b| cost(a.0, a.1).total_cmp(&cost(b.0, b.1)));
    best.map_or(candidates[0], |(_, area)| *area)
}
