//! Diagram of a scene graph: the initial graph, and each alternative of the goal beside it.

use genmanip_core::{Atom, GraphEdge, HorizontalAxis, ReferenceId, Relation, RelationKind, Task};

use super::colors::{CONFLICT, GOAL, GOAL_WASH, HAIRLINE, INITIAL, INK, MUTED, WASH, color_of_word, hex};
use super::graph_layout::{CellConstraint, PreferredCell, cells};
use super::route::{LABEL_SIZE, RoutedEdge, Shape, UnroutedEdge, route};
use super::svg::{Anchor, Area, BOLD, Canvas, Svg, text_width, wrap};

const NAME_SIZE: f64 = 13.0;
const LINE: f64 = 17.0;
const MARGIN: f64 = 16.0;
const HEADING: f64 = 30.0;
const ROBOT: f64 = 40.0;
/// Vertical gap between an object and its support, px: room for an arrow with its label.
const STACK_GAP: f64 = 44.0;
/// Maximum width, px, with the goals beside the initial graph; if wider, they are placed below it.
const MAX_WIDTH: f64 = 715.0;

/// Draws the initial scene graph and, in a second colour, every alternative of the goal.
///
/// An arrow leads from the subject to the reference: *A —left→ B* says that A is to the robot's left of B. The page's
/// upward direction is away from the robot; an object on a support stands above it in a common frame.
pub fn graph_svg(task: &Task) -> Svg {
    let (canvas, [width, height]) = graph_drawing(task, &[]);
    canvas.finish(width, height, &format!("Scene graph and goal of: {}", task.instruction))
}

/// Drawing of [`graph_svg`], with conflicting edges in red, and its width and height (px).
pub fn graph_drawing(task: &Task, conflicts: &[Atom]) -> (Canvas, [f64; 2]) {
    let start = Panel::start(task, conflicts);
    let goals: Vec<Panel> = (0..task.goal.alternatives.len()).map(|index| Panel::goal(task, index)).collect();
    let widest_goal = goals.iter().map(Panel::width).fold(0.0, f64::max);
    let goals_height: f64 = goals.iter().map(|goal| goal.height() + MARGIN).sum();
    let beside = start.width() + widest_goal + 3.0 * MARGIN <= MAX_WIDTH && goals_height <= start.height() * 1.7;

    let mut canvas = Canvas::default();
    let (mut width, mut height) = (start.width() + 2.0 * MARGIN, start.height() + 2.0 * MARGIN);
    start.draw(&mut canvas, [MARGIN, MARGIN], start.width());
    let first = if beside { [start.width() + 2.0 * MARGIN, MARGIN] } else { [MARGIN, start.height() + 2.0 * MARGIN] };
    let (mut at, mut row_height) = (first, 0.0_f64);
    let row_end = MARGIN + start.width().max(MAX_WIDTH - 2.0 * MARGIN);
    for goal in &goals {
        if !beside && at[0] > first[0] && at[0] + goal.width() > row_end {
            at = [first[0], at[1] + row_height + MARGIN];
            row_height = 0.0;
        }
        let drawn_width = if beside { widest_goal } else { goal.width() };
        goal.draw(&mut canvas, at, drawn_width);
        width = width.max(at[0] + drawn_width + MARGIN);
        height = height.max(at[1] + goal.height() + MARGIN);
        row_height = row_height.max(goal.height());
        at = if beside { [at[0], at[1] + goal.height() + MARGIN] } else { [at[0] + goal.width() + MARGIN, at[1]] };
    }
    (canvas, [width, height])
}

/// Drawing of one graph with its heading.
pub struct Panel {
    heading: String,
    is_goal: bool,
    nodes: Vec<Node>,
    wires: Vec<UnroutedEdge>,
    /// True for edges drawn in red, by index into `wires`; false beyond the end.
    conflicts: Vec<bool>,
    /// Bounding boxes of the nodes, px, in the panel's coordinates.
    pub boxes: Vec<Area>,
    /// Frames around stacks of objects, px.
    frames: Vec<Area>,
    /// Routed edges, in the order of `wires`.
    pub routed: Vec<RoutedEdge>,
    bounds: Area,
}

struct Node {
    lines: Vec<String>,
    id: ReferenceId,
    dot: [u8; 3],
    state: Option<String>,
    moved: bool,
}

impl Panel {
    /// Graph of the initial scene; objects that the goal moves or changes are outlined in the goal's colour.
    pub fn start(task: &Task, conflicts: &[Atom]) -> Self {
        let atoms: Vec<&Atom> = task.goal.alternatives.iter().flatten().collect();
        let nodes = task.scene_graph.nodes.iter().map(|node| {
            Node::new(task, &node.id, node.state.clone(), atoms.iter().any(|atom| *atom.subject() == node.id))
        });
        let edges = &task.scene_graph.edges;
        let surfaces = task.surfaces.iter().map(|surface| ReferenceId::from(surface.id.clone()));
        let used = surfaces.filter(|id| edges.iter().any(|edge| edge.reference == *id));
        let nodes = nodes.chain(used.map(|id| Node::new(task, &id, None, false)));
        let mut panel = Self::build("START".into(), false, nodes.collect(), edges);
        let ids: Vec<ReferenceId> = panel.nodes.iter().map(|node| node.id.clone()).collect();
        let index = |id: &ReferenceId| ids.iter().position(|other| other == id);
        let in_conflict = |from: usize, to: usize, label: &str| {
            conflicts.iter().any(|atom| match atom {
                Atom::Relation { subject, relation, .. } => {
                    index(subject) == Some(from)
                        && relation.name() == label
                        && atom.references().any(|id| index(id) == Some(to))
                }
                Atom::State { .. } => false,
            })
        };
        panel.conflicts = panel.wires.iter().map(|wire| in_conflict(wire.from, wire.to, &wire.label)).collect();
        panel
    }

    /// Graph of one alternative of the goal, by index.
    pub fn goal(task: &Task, alternative: usize) -> Self {
        let atoms = task.goal.alternatives.get(alternative).map_or(&[][..], Vec::as_slice);
        let heading = match (task.goal.alternatives.len(), alternative) {
            (1, _) => "GOAL".into(),
            (_, 0) => "GOAL · ALTERNATIVE A".into(),
            (_, index) => format!("OR · ALTERNATIVE {}", letter(index)),
        };
        let mut ids: Vec<&ReferenceId> = Vec::new();
        let mut edges = Vec::new();
        for atom in atoms {
            if let Atom::Relation { subject, relation, reference, second_reference } = atom {
                edges.push(GraphEdge {
                    subject: subject.clone(),
                    relation: *relation,
                    reference: reference.clone(),
                    second_reference: second_reference.clone(),
                });
            }
            for id in atom.ids() {
                if !ids.contains(&id) {
                    ids.push(id);
                }
            }
        }
        let nodes = ids.into_iter().map(|id| {
            let state = atoms.iter().find_map(|atom| match atom {
                Atom::State { object, state } if *object == *id => Some(state.clone()),
                _ => None,
            });
            Node::new(task, id, state, atoms.iter().any(|atom| *atom.subject() == *id))
        });
        Self::build(heading, true, nodes.collect(), &edges)
    }

    fn build(heading: String, is_goal: bool, nodes: Vec<Node>, edges: &[GraphEdge]) -> Self {
        let index = |id: &ReferenceId| nodes.iter().position(|node| node.id == *id);
        let mut links: Vec<Link> = Vec::new();
        for edge in edges {
            let (Some(from), Some(to)) = (index(&edge.subject), index(&edge.reference)) else { continue };
            let second = edge.second_reference.as_ref().and_then(index);
            if from != to {
                links.push(Link { from, to, second, relation: edge.relation });
            }
        }
        let stacks = Stacks::new(&nodes, &links);
        let ties: Vec<CellConstraint> = links.iter().filter_map(|link| stacks.tie(link)).collect();
        let cells = cells(stacks.roots.len(), &ties);
        let mut wires = Vec::new();
        for link in &links {
            for to in [Some(link.to), link.second].into_iter().flatten().filter(|to| *to != link.from) {
                wires.push(UnroutedEdge { from: link.from, to, label: link.relation.name().into() });
            }
        }
        // Gaps are widened until every label has a free position.
        let mut best = (usize::MAX, Vec::new(), Vec::new(), Vec::new());
        for attempt in 0..6 {
            let (boxes, frames) = stacks.arrange(&cells, 1.0 + 0.22 * f64::from(attempt));
            let shapes: Vec<Shape> = boxes.iter().copied().map(Shape::solid).collect();
            let (routed, clashes) = route(&shapes, &wires, [1.0, 1.0]);
            if clashes < best.0 {
                best = (clashes, boxes, frames, routed);
            }
            if clashes == 0 {
                break;
            }
        }
        let (_, boxes, frames, routed) = best;
        let bounds =
            bounds(boxes.iter().chain(&frames).copied().chain(
                routed.iter().flat_map(|wire| {
                    wire.points.iter().map(|point| Area::around(*point, 8.0, 8.0)).chain([wire.label])
                }),
            ));
        Self { heading, is_goal, nodes, wires, conflicts: Vec::new(), boxes, frames, routed, bounds }
    }

    fn width(&self) -> f64 {
        (self.bounds.width + 2.0 * MARGIN).max(text_width(&self.heading, 11.0) * 1.12 + 2.0 * MARGIN).max(150.0)
    }

    fn height(&self) -> f64 {
        self.bounds.height + HEADING + MARGIN + if self.is_goal { 0.0 } else { ROBOT + 10.0 }
    }

    fn draw(&self, canvas: &mut Canvas, at: [f64; 2], width: f64) {
        let (color, wash) = if self.is_goal { (GOAL, GOAL_WASH) } else { (INITIAL, WASH) };
        let frame = Area { x: at[0], y: at[1], width, height: self.height() };
        canvas.rect(
            &frame,
            10.0,
            &format!(r#"fill="{wash}" stroke="{}""#, if self.is_goal { "#fcd9a0" } else { HAIRLINE }),
        );
        let style = format!(r#"fill="{color}" font-weight="700" letter-spacing="0.8""#);
        canvas.text([at[0] + 12.0, at[1] + 20.0], 11.0, Anchor::Start, &style, &self.heading);
        let by = [at[0] + (width - self.bounds.width) / 2.0 - self.bounds.x, at[1] + HEADING - self.bounds.y];
        for area in &self.frames {
            canvas.rect(
                &area.shifted(by),
                12.0,
                &format!(r##"fill="#ffffff" fill-opacity="0.6" stroke="{HAIRLINE}" stroke-dasharray="3 3""##),
            );
        }
        let ink = |wire: usize| if self.conflicts.get(wire) == Some(&true) { CONFLICT } else { color };
        for (number, wire) in self.routed.iter().enumerate() {
            let points: Vec<[f64; 2]> = wire.points.iter().map(|point| [point[0] + by[0], point[1] + by[1]]).collect();
            canvas.arrow(&points, ink(number), 1.6, false);
        }
        for (node, area) in self.nodes.iter().zip(&self.boxes) {
            node.draw(canvas, &area.shifted(by), self.is_goal);
        }
        for (number, (wire, routed)) in self.wires.iter().zip(&self.routed).enumerate() {
            canvas.plate(&routed.label.shifted(by), LABEL_SIZE, [ink(number), wash], &wire.label);
        }
        if !self.is_goal {
            let foot = [at[0] + width / 2.0, frame.y + frame.height - 12.0];
            draw_robot(canvas, foot);
        }
    }
}

impl Node {
    fn new(task: &Task, id: &ReferenceId, state: Option<String>, moved: bool) -> Self {
        let card = task.card(id);
        let word = card.and_then(|card| card.colors.first()).map_or("", String::as_str);
        Self {
            lines: wrap(&task.name_of(id), NAME_SIZE, 92.0, 3),
            id: id.clone(),
            dot: color_of_word(word),
            state,
            moved,
        }
    }

    fn size(&self) -> [f64; 2] {
        let name = self.lines.iter().map(|line| text_width(line, NAME_SIZE) * BOLD).fold(0.0, f64::max);
        let tag = self.state.as_ref().map_or(0.0, |state| text_width(state, 11.0) + 16.0);
        let tag_height = if self.state.is_some() { 21.0 } else { 0.0 };
        [(name + 38.0).max(tag + 16.0).max(72.0), self.lines.len() as f64 * LINE + 14.0 + tag_height]
    }

    fn draw(&self, canvas: &mut Canvas, area: &Area, is_goal: bool) {
        let stroke =
            if self.moved { format!(r#"stroke="{GOAL}" stroke-width="2""#) } else { format!(r#"stroke="{MUTED}""#) };
        canvas.rect(area, 8.0, &format!(r##"fill="#ffffff" {stroke}"##));
        let middle = area.x + area.width / 2.0;
        let name = self.lines.iter().map(|line| text_width(line, NAME_SIZE) * BOLD).fold(0.0, f64::max);
        let left = middle - (name + 18.0) / 2.0;
        let names_middle = area.y + 7.0 + self.lines.len() as f64 * LINE / 2.0;
        canvas.circle([left + 5.5, names_middle], 5.5, &format!(r#"fill="{}" stroke="{MUTED}""#, hex(self.dot)));
        for (row, line) in self.lines.iter().enumerate() {
            let baseline = area.y + 7.0 + row as f64 * LINE + 12.8;
            canvas.text([left + 18.0, baseline], NAME_SIZE, Anchor::Start, r#"font-weight="600""#, line);
        }
        if let Some(state) = &self.state {
            let tag = Area::around([middle, area.y + area.height - 14.0], text_width(state, 11.0) + 14.0, 17.0);
            let (fill, ink) = if is_goal { (GOAL, "#ffffff") } else { ("#e2e8f0", INK) };
            canvas.rect(&tag, 8.5, &format!(r#"fill="{fill}""#));
            canvas.text([middle, tag.y + 12.6], 11.0, Anchor::Middle, &format!(r#"fill="{ink}""#), state);
        }
    }
}

struct Link {
    from: usize,
    to: usize,
    second: Option<usize>,
    relation: Relation,
}

/// Nodes grouped into stacks: a support or container is drawn below its contents.
struct Stacks {
    sizes: Vec<[f64; 2]>,
    children: Vec<Vec<usize>>,
    /// Bottom node of each stack: one without support among the nodes.
    roots: Vec<usize>,
    /// Index into `roots` of each node's stack.
    pile: Vec<usize>,
}

impl Stacks {
    fn new(nodes: &[Node], links: &[Link]) -> Self {
        let mut carrier: Vec<Option<usize>> = vec![None; nodes.len()];
        for link in links.iter().filter(|link| link.relation.is_support()) {
            let mut below = Some(link.to);
            while let Some(node) = below.filter(|node| *node != link.from) {
                below = carrier[node];
            }
            if below.is_none() && carrier[link.from].is_none() {
                carrier[link.from] = Some(link.to);
            }
        }
        let mut children = vec![Vec::new(); nodes.len()];
        for (node, carrier) in carrier.iter().enumerate() {
            if let Some(carrier) = carrier {
                children[*carrier].push(node);
            }
        }
        let roots: Vec<usize> = (0..nodes.len()).filter(|node| carrier[*node].is_none()).collect();
        let pile = (0..nodes.len()).map(|node| {
            let mut root = node;
            while let Some(below) = carrier[root] {
                root = below;
            }
            roots.iter().position(|other| *other == root).unwrap_or(0)
        });
        let pile = pile.collect();
        Self { sizes: nodes.iter().map(Node::size).collect(), children, roots, pile }
    }

    fn tie(&self, link: &Link) -> Option<CellConstraint> {
        let (from, to) = (self.pile[link.from], self.pile[link.to]);
        let wish = match (link.relation.kind(), link.second) {
            (RelationKind::Side(side), _) => {
                let step = if side.is_positive { 1 } else { -1 };
                PreferredCell::Step(match side.axis {
                    HorizontalAxis::Depth => [0, step],
                    HorizontalAxis::Width => [-step, 0],
                })
            }
            (RelationKind::Between, Some(second)) => PreferredCell::Middle(self.pile[second]),
            (RelationKind::Between, None) | (RelationKind::Around | RelationKind::Support(_), _) => {
                PreferredCell::Close
            }
        };
        (from != to).then_some(CellConstraint { from, to, wish })
    }

    /// Width and height, px, of a node with everything above it.
    fn pile_size(&self, node: usize) -> [f64; 2] {
        let above = self.children[node].iter().map(|child| self.pile_size(*child));
        let [width, height] = above.fold([-12.0, 0.0], |[width, height], [w, h]| [width + w + 12.0, h.max(height)]);
        let lift = if self.children[node].is_empty() { 0.0 } else { STACK_GAP };
        [self.sizes[node][0].max(width), self.sizes[node][1] + lift + height]
    }

    /// Places a node and everything above it, with the bottom centre at a point.
    fn put(&self, node: usize, bottom: [f64; 2], boxes: &mut [Area]) {
        let [width, height] = self.sizes[node];
        boxes[node] = Area { x: bottom[0] - width / 2.0, y: bottom[1] - height, width, height };
        let widths: Vec<f64> = self.children[node].iter().map(|child| self.pile_size(*child)[0]).collect();
        let total = widths.iter().sum::<f64>() + 12.0 * widths.len().saturating_sub(1) as f64;
        let mut left = bottom[0] - total / 2.0;
        for (child, width) in self.children[node].iter().zip(widths) {
            self.put(*child, [left + width / 2.0, bottom[1] - height - STACK_GAP], boxes);
            left += width + 12.0;
        }
    }

    /// Boxes of all nodes and frames around the stacks; `spread` scales the gaps between stacks.
    fn arrange(&self, cells: &[[i32; 2]], spread: f64) -> (Vec<Area>, Vec<Area>) {
        let count = |axis: usize| cells.iter().map(|cell| cell[axis] + 1).max().unwrap_or(0) as usize;
        // Bottom nodes in one row share a horizontal centre line; the rest of their stacks rises above it.
        let mut columns = vec![0.0_f64; count(0)];
        let mut rows = vec![[0.0_f64; 2]; count(1)];
        let framed = |root: usize| if self.children[root].is_empty() { 0.0 } else { 10.0 };
        for (root, cell) in self.roots.iter().zip(cells) {
            let ([width, height], half) = (self.pile_size(*root), self.sizes[*root][1] / 2.0);
            let (column, row) = (&mut columns[cell[0] as usize], &mut rows[cell[1] as usize]);
            *column = column.max(width + 2.0 * framed(*root));
            *row = [row[0].max(half + framed(*root)), row[1].max(height - half + framed(*root))];
        }
        let (gap_x, gap_y) = (70.0 * spread, 50.0 * spread);
        let mut boxes = vec![Area { x: 0.0, y: 0.0, width: 0.0, height: 0.0 }; self.sizes.len()];
        let mut frames = Vec::new();
        for (pile, (root, cell)) in self.roots.iter().zip(cells).enumerate() {
            let (column, row) = (cell[0] as usize, cell[1] as usize);
            let x = columns[..column].iter().map(|width| width + gap_x).sum::<f64>() + columns[column] / 2.0;
            let line = rows[..row].iter().map(|[below, above]| below + above + gap_y).sum::<f64>() + rows[row][0];
            self.put(*root, [x, -line + self.sizes[*root][1] / 2.0], &mut boxes);
            if framed(*root) > 0.0 {
                let members = boxes.iter().zip(&self.pile).filter(|(_, other)| **other == pile).map(|(area, _)| *area);
                frames.push(bounds(members).grown(10.0));
            }
        }
        (boxes, frames)
    }
}

/// Bounding box of areas.
pub fn bounds(areas: impl IntoIterator<Item = Area>) -> Area {
    let around = |a: Area, b: Area| {
        let (x, y) = (a.x.min(b.x), a.y.min(b.y));
        Area { x, y, width: (a.x + a.width).max(b.x + b.width) - x, height: (a.y + a.height).max(b.y + b.height) - y }
    };
    areas.into_iter().reduce(around).unwrap_or(Area { x: 0.0, y: 0.0, width: 0.0, height: 0.0 })
}

/// Letter of an alternative by index: A to Z, then AA, AB, ….
pub fn letter(index: usize) -> String {
    let last = char::from(b'A' + (index % 26) as u8);
    if index < 26 { last.into() } else { letter(index / 26 - 1) + &last.to_string() }
}

/// Draws the robot at the lower edge, since the page's upward direction is away from the robot.
fn draw_robot(canvas: &mut Canvas, foot: [f64; 2]) {
    let style = format!(r#"fill="{MUTED}""#);
    let plate = Area::around([foot[0], foot[1] - 8.0], 62.0, 18.0);
    canvas.rect(&plate, 9.0, &format!(r##"fill="#e2e8f0" stroke="{HAIRLINE}""##));
    canvas.text([foot[0], foot[1] - 4.0], 11.0, Anchor::Middle, &style, "robot");
    canvas.arrow(&[[foot[0], plate.y - 2.0], [foot[0], plate.y - 18.0]], MUTED, 1.2, false);
    canvas.text([foot[0] + 8.0, plate.y - 8.0], 11.0, Anchor::Start, &style, "front");
}
