//! Selection of the episodes that the report shows with images: one of every task for a small run; for a larger one,
//! examples of every cause of failure and every kind of task.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{FailureCause, TaskKind};
use serde::Serialize;

use super::{EpisodeRow, TaskRow};

/// A selected task with one of its episodes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Case {
    /// Index of the task among the task rows.
    pub task: usize,
    /// Index of the episode among the episode rows; `None` if no episode of the task was recorded.
    pub episode: Option<usize>,
    /// Reason of the selection; `None` if all tasks are shown.
    pub why: Option<ExampleRole>,
}

/// Property that a case is an example of, with its rank.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ExampleRole {
    /// Property that the case shows.
    pub shows: ExampleOf,
    /// Rank among the episodes with the same property; 1 is the most instructive.
    pub place: usize,
    /// Number of episodes with the same property.
    pub of: usize,
}

/// Property shown by a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExampleOf {
    /// A failure of this cause.
    Failure(FailureCause),
    /// A success at a task of this kind.
    Success(TaskKind),
}

/// Maximum number of cases of a page: 48 cases render in about 12 s on one core and take 6 MB.
pub const MAX_CASES: usize = 48;

/// Rule of [`choose`] for larger runs, as shown on the page.
pub const RULE: &str = "every cause of failure, then successes of every kind of task. Among the episodes of a cause \
                        those with a film strip come first, then those closest to their goal; causes, and kinds, \
                        take turns, each time with another task";

/// Selects the cases of a run.
///
/// For up to `most` tasks, all are selected in order, each with one recorded episode: a collected attempt, successes
/// first; otherwise an evaluated episode, failures first. Ties go to the first one.
///
/// For more tasks, [`RULE`] selects, with two thirds of the cases for failures. Episodes of the `baseline` policy are
/// not selected. Every cause and every kind gets at least one case, even beyond `most`.
pub fn choose(tasks: &[TaskRow], rows: &[EpisodeRow], baseline: Option<&str>, most: usize) -> Vec<Case> {
    if tasks.len() <= most {
        let best = best_of_each_task(tasks.len(), rows);
        return (0..tasks.len()).map(|task| Case { task, episode: best[task], why: None }).collect();
    }
    let mut groups: BTreeMap<ExampleOf, Vec<usize>> = BTreeMap::new();
    let is_control = |row: &EpisodeRow| row.evaluation.is_some() && row.evaluation.as_deref() == baseline;
    for (index, row) in rows.iter().enumerate().filter(|(_, row)| !is_control(row)) {
        match (row.outcome.success, row.outcome.cause, tasks.get(row.task)) {
            (true, _, Some(task)) => groups.entry(ExampleOf::Success(task.kind)).or_default().push(index),
            (false, Some(cause), Some(_)) => groups.entry(ExampleOf::Failure(cause)).or_default().push(index),
            _ => {}
        }
    }
    let mut groups: Vec<Group> = groups.into_iter().map(|(shows, members)| Group::new(shows, members, rows)).collect();
    groups.sort_by_key(|group| (group.is_success(), std::cmp::Reverse(group.members.len()), group.shows));
    let failures = groups.iter().take_while(|group| !group.is_success()).count();
    let (failed, succeeded) = groups.split_at_mut(failures);
    let left = |groups: &[Group]| groups.iter().map(|group| group.members.len()).sum::<usize>();
    let share = (2 * most / 3).max(most.saturating_sub(left(succeeded)));
    let mut known = BTreeSet::new();
    let taken = take_turns(failed, share, rows, &mut known);
    take_turns(succeeded, most.saturating_sub(taken), rows, &mut known);
    groups.into_iter().flat_map(|group| group.cases(rows)).collect()
}

/// Index of the row shown for each task, see [`choose`].
fn best_of_each_task(tasks: usize, rows: &[EpisodeRow]) -> Vec<Option<usize>> {
    let rank = |row: &EpisodeRow| (!row.is_attempt(), row.outcome.success != row.is_attempt());
    let mut best: Vec<Option<usize>> = vec![None; tasks];
    for (index, row) in rows.iter().enumerate().filter(|(_, row)| row.recorded && row.task < tasks) {
        if best[row.task].is_none_or(|known| rank(row) < rank(&rows[known])) {
            best[row.task] = Some(index);
        }
    }
    best
}

/// Episodes with the same property.
struct Group {
    shows: ExampleOf,
    /// Indices of rows, most instructive first.
    members: Vec<usize>,
    /// Selected members, as positions in `members`.
    chosen: Vec<usize>,
}

impl Group {
    fn new(shows: ExampleOf, mut members: Vec<usize>, rows: &[EpisodeRow]) -> Self {
        members.sort_by(|&a, &b| {
            let (a, b) = (&rows[a], &rows[b]);
            (b.recorded.cmp(&a.recorded))
                .then(b.outcome.score.total_cmp(&a.outcome.score))
                .then(b.outcome.missed_by.total_cmp(&a.outcome.missed_by))
                .then(a.is_attempt().cmp(&b.is_attempt()).reverse())
                .then_with(|| (&a.evaluation, &a.id).cmp(&(&b.evaluation, &b.id)))
        });
        Self { shows, members, chosen: Vec::new() }
    }

    fn is_success(&self) -> bool {
        matches!(self.shows, ExampleOf::Success(_))
    }

    /// Selects the next member whose task is not selected yet, or, as the first member, any; false if there is none.
    fn take(&mut self, rows: &[EpisodeRow], known: &mut BTreeSet<usize>) -> bool {
        let next = self.chosen.last().map_or(0, |place| place + 1);
        let is_fresh = |place: &usize| !known.contains(&rows[self.members[*place]].task);
        let fresh = (next..self.members.len()).find(is_fresh);
        let any = self.chosen.is_empty().then_some(0).filter(|place| *place < self.members.len());
        let Some(place) = fresh.or(any) else { return false };
        known.insert(rows[self.members[place]].task);
        self.chosen.push(place);
        true
    }

    fn cases(self, rows: &[EpisodeRow]) -> impl Iterator<Item = Case> {
        let Self { shows, members, mut chosen } = self;
        chosen.sort_unstable();
        chosen.into_iter().map(move |place| Case {
            task: rows[members[place]].task,
            episode: Some(members[place]),
            why: Some(ExampleRole { shows, place: place + 1, of: members.len() }),
        })
    }
}

/// Lets the groups select in turn until `most` cases are selected, each group at least once; returns the number
/// selected.
fn take_turns(groups: &mut [Group], most: usize, rows: &[EpisodeRow], known: &mut BTreeSet<usize>) -> usize {
    let (mut taken, mut round) = (0, 0);
    loop {
        let before = taken;
        for group in groups.iter_mut() {
            if (taken < most || round == 0) && group.take(rows, known) {
                taken += 1;
            }
        }
        round += 1;
        if taken == before || taken >= most {
            return taken;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::Outcome;

    fn row(id: usize, task: usize, cause: Option<FailureCause>, recorded: bool, score: f64) -> EpisodeRow {
        EpisodeRow {
            id: format!("e{id}"),
            task,
            evaluation: None,
            outcome: Outcome {
                agent_failure: None,
                success: cause.is_none(),
                cause,
                evidence: String::new(),
                score,
                missed_by: 0.0,
                duration_s: 1.0,
            },
            recorded,
            wall_s: None,
        }
    }

    fn tasks(count: usize) -> Vec<TaskRow> {
        let kind = |index: usize| TaskKind::ALL[index % 3];
        let task = |index| TaskRow { id: format!("t{index}"), kind: kind(index), goal: vec![], objects: vec![] };
        (0..count).map(task).collect()
    }

    #[test]
    fn a_small_run_shows_every_task_with_its_first_success() {
        let slipped = Some(FailureCause::Slipped);
        let mut rows = vec![row(0, 1, slipped, true, 0.5), row(1, 1, None, true, 1.0), row(2, 1, None, true, 1.0)];
        rows.push(row(3, 2, slipped, false, 0.0));
        // Of evaluated episodes, failures come first.
        for (id, cause) in [(4, None), (5, slipped)] {
            rows.push(EpisodeRow { evaluation: Some("mine".into()), ..row(id, 0, cause, true, 1.0) });
        }
        let chosen: Vec<_> =
            choose(&tasks(3), &rows, None, 3).into_iter().map(|case| (case.task, case.episode)).collect();
        assert_eq!(chosen, [(0, Some(5)), (1, Some(1)), (2, None)]);
    }

    #[test]
    fn a_large_run_shows_every_cause_and_every_kind_and_counts_the_rest() {
        let mut rows: Vec<EpisodeRow> = (0..1000).map(|id| row(id, id, None, true, 1.0)).collect();
        for id in (0..1000).step_by(7) {
            rows[id] = row(id, id, Some(FailureCause::Slipped), id % 2 == 0, id as f64 / 2000.0);
        }
        rows[8] = row(8, 8, Some(FailureCause::Planning), false, 0.0);
        let cases = choose(&tasks(1000), &rows, None, 12);
        assert_eq!(cases.len(), 12);
        let of = |shows: ExampleOf| {
            cases.iter().filter(|case| case.why.as_ref().unwrap().shows == shows).collect::<Vec<_>>()
        };
        let slipped = of(ExampleOf::Failure(FailureCause::Slipped));
        assert_eq!((slipped.len(), of(ExampleOf::Failure(FailureCause::Planning)).len()), (7, 1));
        // The one with a film strip that came closest, of all that slipped.
        assert_eq!((slipped[0].episode, slipped[0].why.as_ref().unwrap().of), (Some(994), 143));
        for kind in &TaskKind::ALL[..3] {
            assert!(!of(ExampleOf::Success(*kind)).is_empty(), "{kind:?}");
        }
        let tasks_shown: BTreeSet<usize> = cases.iter().map(|case| case.task).collect();
        assert_eq!(tasks_shown.len(), 12, "each of another task");
        // Too few cases for every property: each is still shown once.
        assert_eq!(choose(&tasks(1000), &rows, None, 1).len(), 5);
    }

    #[test]
    fn the_control_policy_gives_no_cases() {
        let failed =
            EpisodeRow { evaluation: Some("do_nothing".into()), ..row(0, 0, Some(FailureCause::Timeout), true, 0.0) };
        assert_eq!(choose(&tasks(2), std::slice::from_ref(&failed), Some("do_nothing"), 1), []);
        assert_eq!(choose(&tasks(2), &[failed], None, 1).len(), 1);
    }
}
