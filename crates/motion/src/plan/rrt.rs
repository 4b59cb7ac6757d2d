//! RRT-Connect (Kuffner and LaValle, 2000): two trees that grow towards each other.

use std::f64::consts::{PI, TAU};

use rand::{Rng, RngExt};

use super::settings::PlanSettings;
use crate::chain::ChainJoint;
use crate::collision::Checker;
use crate::path::{distance, lerp};

/// A tree of configurations; roots have no parent.
struct Tree {
    dof: usize,
    /// Joint positions of all nodes, concatenated.
    numbers: Vec<f64>,
    parents: Vec<Option<usize>>,
}

enum Growth {
    Blocked,
    Stepped(usize),
    Arrived(usize),
}

/// Waypoints from `start` to one of `goals`; `None` after the maximum iterations.
///
/// `iterations` counts the nodes added. After [`PlanSettings::link_padding_after`] of them, the clearance between links
/// of the robot is reduced; the trees remain valid.
pub(super) fn connect(
    checker: &mut Checker,
    settings: &PlanSettings,
    spacing: f64,
    start: &[f64],
    goals: &[Vec<f64>],
    rng: &mut impl Rng,
    iterations: &mut usize,
) -> Option<Vec<Vec<f64>>> {
    let ends = |joint: usize| {
        let ends = || goals.iter().map(|goal| goal[joint]).chain([start[joint]]);
        (ends().fold(f64::INFINITY, f64::min), ends().fold(f64::NEG_INFINITY, f64::max))
    };
    // A joint half a turn beyond start and goals has taken every orientation; rotating it further would only wind it
    // up.
    let unwound = |(index, joint): (usize, &ChainJoint)| {
        let (lower, upper) = (joint.lower, joint.upper);
        if joint.is_prismatic || upper - lower <= TAU {
            return (lower, upper);
        }
        let (low, high) = ends(index);
        (lower.max(low - PI), upper.min(high + PI))
    };
    let limits: Vec<(f64, f64)> = checker.chain().joints().iter().enumerate().map(unwound).collect();
    let near: Vec<(f64, f64)> = limits
        .iter()
        .enumerate()
        .map(|(joint, (lower, upper))| {
            let (low, high) = ends(joint);
            let clamped = |q: f64| q.max(*lower).min(*upper);
            (clamped(low - settings.sample_around), clamped(high + settings.sample_around))
        })
        .collect();
    let mut samples = 0;
    let mut trees = [Tree::rooted(start.len(), &[start.to_vec()]), Tree::rooted(start.len(), goals)];
    let (mut growing, mut is_link_clearance_limited) = (0, false);
    let budget = *iterations + settings.max_iterations;
    while *iterations < budget {
        if *iterations >= settings.link_padding_after && !is_link_clearance_limited {
            checker.limit_link_clearance(settings.link_padding);
            is_link_clearance_limited = true;
        }
        samples += 1;
        let ranges = if samples % 2 == 1 { &near } else { &limits };
        let sample: Vec<f64> = ranges.iter().map(|(lower, upper)| rng.random_range(*lower..=*upper)).collect();
        *iterations += 1;
        let [first, second] = &mut trees;
        let (active, other) = if growing == 0 { (first, second) } else { (second, first) };
        let near = active.nearest(&sample);
        if let Growth::Stepped(node) | Growth::Arrived(node) = active.extend(checker, settings, spacing, near, &sample)
        {
            let target = active.config(node).to_vec();
            let mut tip = other.nearest(&target);
            let met = loop {
                *iterations += 1;
                match other.extend(checker, settings, spacing, tip, &target) {
                    Growth::Arrived(end) => break Some(end),
                    Growth::Stepped(node) if *iterations < budget => tip = node,
                    Growth::Stepped(_) | Growth::Blocked => break None,
                }
            };
            if let Some(end) = met {
                let (mut from_start, mut from_goal) = (active.to_root(node), other.to_root(end));
                if growing == 1 {
                    std::mem::swap(&mut from_start, &mut from_goal);
                }
                from_start.reverse();
                from_start.extend(from_goal.into_iter().skip(1));
                return Some(from_start);
            }
        }
        growing = usize::from(trees[1].parents.len() < trees[0].parents.len());
    }
    None
}

impl Tree {
    fn rooted(dof: usize, roots: &[Vec<f64>]) -> Self {
        Self { dof, numbers: roots.concat(), parents: vec![None; roots.len()] }
    }

    fn config(&self, node: usize) -> &[f64] {
        &self.numbers[node * self.dof..(node + 1) * self.dof]
    }

    fn nearest(&self, target: &[f64]) -> usize {
        let mut best = (f64::INFINITY, 0);
        for (index, config) in self.numbers.chunks_exact(self.dof).enumerate() {
            let squared = config.iter().zip(target).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            if squared < best.0 {
                best = (squared, index);
            }
        }
        best.1
    }

    /// Extends a node towards a target by at most [`PlanSettings::rrt_range`].
    fn extend(
        &mut self,
        checker: &Checker,
        settings: &PlanSettings,
        spacing: f64,
        near: usize,
        target: &[f64],
    ) -> Growth {
        let from = self.config(near);
        let length = distance(from, target);
        let arrives = length <= settings.rrt_range;
        let next = if arrives { target.to_vec() } else { lerp(from, target, settings.rrt_range / length) };
        if !checker.edge_is_free(from, &next, spacing) {
            return Growth::Blocked;
        }
        self.numbers.extend(next);
        self.parents.push(Some(near));
        let node = self.parents.len() - 1;
        if arrives { Growth::Arrived(node) } else { Growth::Stepped(node) }
    }

    fn to_root(&self, node: usize) -> Vec<Vec<f64>> {
        let parents = std::iter::successors(Some(node), |node| self.parents[*node]);
        parents.map(|node| self.config(node).to_vec()).collect()
    }
}
