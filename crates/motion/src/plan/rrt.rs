//! RRT-Connect (Kuffner and LaValle, 2000): two trees that grow towards each other.

use rand::{Rng, RngExt};

use super::PlanSettings;
use crate::collision::Checker;
use crate::path::{distance, lerp};

/// A tree of configurations; nodes without parent are roots.
struct Tree {
    configs: Vec<Vec<f64>>,
    parents: Vec<Option<usize>>,
}

enum Growth {
    Blocked,
    Stepped(usize),
    Arrived(usize),
}

/// Waypoints from `start` to one of `goals` (nearest first), or `None` after the settings' iterations.
///
/// `iterations` counts the nodes added.
pub(super) fn connect(
    checker: &Checker,
    settings: &PlanSettings,
    spacing: f64,
    start: &[f64],
    goals: &[Vec<f64>],
    rng: &mut impl Rng,
    iterations: &mut usize,
) -> Option<Vec<Vec<f64>>> {
    if let Some(goal) = goals.iter().find(|goal| checker.edge_is_free(start, goal, spacing)) {
        return Some(vec![start.to_vec(), goal.clone()]);
    }
    let limits: Vec<(f64, f64)> = checker.chain().lower().zip(checker.chain().upper()).collect();
    let mut trees = [Tree::rooted(&[start.to_vec()]), Tree::rooted(goals)];
    let mut growing = 0;
    let budget = *iterations + settings.max_iterations;
    while *iterations < budget {
        let sample: Vec<f64> = limits.iter().map(|(lower, upper)| rng.random_range(*lower..=*upper)).collect();
        *iterations += 1;
        let [first, second] = &mut trees;
        let (active, other) = if growing == 0 { (first, second) } else { (second, first) };
        if let Growth::Stepped(node) | Growth::Arrived(node) = active.extend(checker, settings, spacing, &sample) {
            let target = active.configs[node].clone();
            let mut met = None;
            while *iterations < budget {
                *iterations += 1;
                match other.extend(checker, settings, spacing, &target) {
                    Growth::Blocked => break,
                    Growth::Stepped(_) => {}
                    Growth::Arrived(end) => {
                        met = Some(end);
                        break;
                    }
                }
            }
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
        growing = usize::from(trees[1].configs.len() < trees[0].configs.len());
    }
    None
}

impl Tree {
    fn rooted(roots: &[Vec<f64>]) -> Self {
        Self { configs: roots.to_vec(), parents: vec![None; roots.len()] }
    }

    fn nearest(&self, target: &[f64]) -> usize {
        let squared = |config: &Vec<f64>| config.iter().zip(target).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let mut best = (f64::INFINITY, 0);
        for (index, config) in self.configs.iter().enumerate() {
            let distance = squared(config);
            if distance < best.0 {
                best = (distance, index);
            }
        }
        best.1
    }

    fn extend(&mut self, checker: &Checker, settings: &PlanSettings, spacing: f64, target: &[f64]) -> Growth {
        let near = self.nearest(target);
        let length = distance(&self.configs[near], target);
        let arrives = length <= settings.rrt_range;
        let next =
            if arrives { target.to_vec() } else { lerp(&self.configs[near], target, settings.rrt_range / length) };
        if !checker.edge_is_free(&self.configs[near], &next, spacing) {
            return Growth::Blocked;
        }
        self.configs.push(next);
        self.parents.push(Some(near));
        let node = self.configs.len() - 1;
        if arrives { Growth::Arrived(node) } else { Growth::Stepped(node) }
    }

    fn to_root(&self, node: usize) -> Vec<Vec<f64>> {
        let parents = std::iter::successors(Some(node), |node| self.parents[*node]);
        parents.map(|node| self.configs[node].clone()).collect()
    }
}
