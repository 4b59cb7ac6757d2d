//! Tables of success rates in simulation and in reality, as comma-separated values.

use genmanip_core::names::near_misses;
use genmanip_workspace::WorkspaceError;

/// Maximum number of trials of a cell, since every resample of the bootstrap draws each of them.
const MAX_TRIALS: usize = 100_000;

/// Accepted columns, for error messages.
const ACCEPTED: &str = "accepted, in any order: task (optional), policy, world (sim or real), trials, successes; or \
                        task, policy, sim, real (rates from 0 to 1), with trials, or sim_trials and real_trials \
                        (optional); or task, first, second, world, first_wins, second_wins, ties (optional)";

/// All column names, to suggest the one that a misspelt name resembles.
const COLUMNS: [&str; 14] = [
    "task",
    "policy",
    "world",
    "trials",
    "successes",
    "sim",
    "real",
    "sim_trials",
    "real_trials",
    "first",
    "second",
    "first_wins",
    "second_wins",
    "ties",
];

/// One of the two compared worlds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum World {
    /// Trials in simulation.
    Sim,
    /// Trials on the real robot.
    Real,
}

impl World {
    /// Both worlds, simulation first.
    pub const ALL: [Self; 2] = [Self::Sim, Self::Real];

    /// Name of the world in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Real => "real",
        }
    }
}

/// Observed success rate of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// Success rate, 0 to 1.
    pub rate: f64,
    /// Number of trials; `None` if the table gives only rates.
    pub trials: Option<usize>,
}

/// Success of one policy on one task in one world.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Name of the task; empty if the table has no such column.
    pub task: String,
    /// Name of the policy.
    pub policy: String,
    /// World of the trials.
    pub world: World,
    /// Observed success rate.
    pub observed: Observed,
}

/// Results of pairwise comparisons of two policies in one world.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparisons {
    /// Names of the two policies.
    pub policies: [String; 2],
    /// World of the comparisons.
    pub world: World,
    /// Number of comparisons that each of the two won.
    pub wins: [usize; 2],
    /// Number of comparisons without a winner.
    pub ties: usize,
}

/// Content of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Table {
    /// Success rates by task, policy and world; every cell occurs once.
    Rates(Vec<Cell>),
    /// Pairwise comparisons of policies.
    Pairs(Vec<Comparisons>),
}

/// Reads a table from CSV text; columns may be in any order.
///
/// # Errors
/// [`WorkspaceError::Input`] with the line, the expected content and the accepted columns.
pub fn parse(text: &str) -> Result<Table, WorkspaceError> {
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line))
        .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let (number, head) = lines.next().ok_or_else(|| refused("the table is empty".into()).with_hint(ACCEPTED))?;
    let columns: Vec<String> = fields(head, number)?.into_iter().map(|name| name.to_lowercase()).collect();
    for (index, name) in columns.iter().enumerate() {
        if !COLUMNS.contains(&name.as_str()) {
            let near = near_misses(name, &COLUMNS);
            let near = near.first().map_or(String::new(), |near| format!(", did you mean {near}?"));
            return Err(refused(format!("line {number}: unknown column {name:?}{near}")).with_hint(ACCEPTED));
        }
        if columns[..index].contains(name) {
            return Err(refused(format!("line {number}: column {name} stands there twice")).with_hint(ACCEPTED));
        }
    }
    let mut rows = Vec::new();
    for (line, text) in lines {
        let values = fields(text, line)?;
        if values.len() != columns.len() {
            let (wanted, got) = (columns.len(), values.len());
            return Err(refused(format!("line {line} has {got} fields, the head has {wanted}"))
                .with_hint("a text with a comma stands in double quotes; numbers have a point, no comma"));
        }
        rows.push(Row { line, columns: &columns, values });
    }
    if rows.is_empty() {
        return Err(refused("the table has a head and no row".into()).with_hint(ACCEPTED));
    }
    let has = |names: &[&str]| names.iter().all(|name| columns.iter().any(|column| column == name));
    if has(&["first", "second", "first_wins", "second_wins", "world"]) {
        return rows.iter().map(Row::comparisons).collect::<Result<_, _>>().map(Table::Pairs);
    }
    let cells = if has(&["policy", "world", "trials", "successes"]) {
        counted(&rows)?
    } else if has(&["policy", "sim", "real"]) {
        rates(&rows)?
    } else {
        let found = columns.join(", ");
        return Err(refused(format!("line {number}: the columns {found} do not make a table")).with_hint(ACCEPTED));
    };
    Ok(Table::Rates(cells))
}

/// Cells of a table with one world per row; successes and trials of rows for the same cell are added.
fn counted(rows: &[Row]) -> Result<Vec<Cell>, WorkspaceError> {
    let mut cells: Vec<(Cell, usize, usize)> = Vec::new();
    for row in rows {
        let (trials, successes) = (row.trials("trials")?, row.count("successes")?);
        if successes > trials {
            return Err(row.refused(format!("{successes} successes in {trials} trials")));
        }
        let (task, policy, world) = (row.text("task")?, row.text("policy")?, row.world()?);
        let is_same = |(cell, ..): &&mut (Cell, usize, usize)| {
            (cell.task.as_str(), cell.policy.as_str(), cell.world) == (task, policy, world)
        };
        if let Some((_, all, won)) = cells.iter_mut().find(is_same) {
            *all += trials;
            *won += successes;
            if *all > MAX_TRIALS {
                return Err(row.refused(format!("more than {MAX_TRIALS} trials of {policy} in all")));
            }
            continue;
        }
        let observed = Observed { rate: 0.0, trials: None };
        cells.push((Cell { task: task.into(), policy: policy.into(), world, observed }, trials, successes));
    }
    let cell = |(cell, trials, successes): (Cell, usize, usize)| Cell {
        observed: Observed { rate: successes as f64 / trials as f64, trials: Some(trials) },
        ..cell
    };
    Ok(cells.into_iter().map(cell).collect())
}

/// Cells of a table with the rates of both worlds in each row.
fn rates(rows: &[Row]) -> Result<Vec<Cell>, WorkspaceError> {
    let mut cells: Vec<Cell> = Vec::new();
    for row in rows {
        let (task, policy) = (row.text("task")?, row.text("policy")?);
        if cells.iter().any(|cell| (cell.task.as_str(), cell.policy.as_str()) == (task, policy)) {
            return Err(row.refused(format!("a second row of policy {policy:?} and task {task:?}")));
        }
        for (world, own) in [(World::Sim, "sim_trials"), (World::Real, "real_trials")] {
            let Some(rate) = row.rate(world.name())? else { continue };
            let column = [own, "trials"].into_iter().find(|name| row.value(name).is_some_and(|text| !text.is_empty()));
            let trials = column.map(|column| row.trials(column)).transpose()?;
            cells.push(Cell { task: task.into(), policy: policy.into(), world, observed: Observed { rate, trials } });
        }
    }
    Ok(cells)
}

/// A data row of the table.
struct Row<'a> {
    /// Line number in the file, from 1.
    line: usize,
    columns: &'a [String],
    values: Vec<String>,
}

impl Row<'_> {
    fn comparisons(&self) -> Result<Comparisons, WorkspaceError> {
        let [first, second] = [self.text("first")?, self.text("second")?];
        if first == second {
            return Err(self.refused(format!("{first:?} is compared with itself")));
        }
        let wins = [self.count("first_wins")?, self.count("second_wins")?];
        let ties = if self.value("ties").is_some() { self.count("ties")? } else { 0 };
        let all = wins[0] + wins[1] + ties;
        if all == 0 || all > MAX_TRIALS {
            return Err(self.refused(format!("{all} comparisons; expected 1 to {MAX_TRIALS}")));
        }
        Ok(Comparisons { policies: [first, second].map(Into::into), world: self.world()?, wins, ties })
    }

    fn value(&self, name: &str) -> Option<&str> {
        let index = self.columns.iter().position(|column| column == name)?;
        Some(self.values[index].as_str())
    }

    /// Text of a field; an empty field is an error, a missing optional column gives an empty text.
    fn text(&self, name: &str) -> Result<&str, WorkspaceError> {
        match self.value(name) {
            Some("") => Err(self.refused(format!("no {name}"))),
            value => Ok(value.unwrap_or_default()),
        }
    }

    fn world(&self) -> Result<World, WorkspaceError> {
        let text = self.text("world")?;
        let is_meant = |world: &World| world.name() == text.to_lowercase();
        let unknown = || self.refused(format!("world {text:?}; expected sim or real"));
        World::ALL.into_iter().find(is_meant).ok_or_else(unknown)
    }

    fn count(&self, name: &str) -> Result<usize, WorkspaceError> {
        let text = self.text(name)?;
        let count = text.parse().ok().filter(|&count: &usize| count <= MAX_TRIALS);
        count.ok_or_else(|| self.refused(format!("{name} {text:?}; expected a whole number up to {MAX_TRIALS}")))
    }

    fn trials(&self, name: &str) -> Result<usize, WorkspaceError> {
        match self.count(name)? {
            0 => Err(self.refused(format!("no trial in column {name}; leave such a row out"))),
            trials => Ok(trials),
        }
    }

    /// Rate from 0 to 1; `None` for a missing column or an empty field.
    fn rate(&self, name: &str) -> Result<Option<f64>, WorkspaceError> {
        let Some(text) = self.value(name).filter(|text| !text.is_empty()) else { return Ok(None) };
        match text.parse::<f64>() {
            Ok(rate) if (0.0..=1.0).contains(&rate) => Ok(Some(rate)),
            Ok(rate) if rate > 1.0 && rate <= 100.0 => {
                Err(self.refused(format!("{name} {text}; expected a rate from 0 to 1, not per cent")))
            }
            _ => Err(self.refused(format!("{name} {text:?}; expected a rate from 0 to 1"))),
        }
    }

    fn refused(&self, what: String) -> WorkspaceError {
        refused(format!("line {}: {what}", self.line))
    }
}

/// Fields of a line, separated by commas. A field that contains a comma is in double quotes, within which `""` is a
/// quote.
fn fields(line: &str, number: usize) -> Result<Vec<String>, WorkspaceError> {
    let mut fields = Vec::new();
    let mut rest = line;
    loop {
        let trimmed = rest.trim_start();
        let (field, after) = match trimmed.strip_prefix('"') {
            Some(quoted) => {
                let (mut field, mut rest) = (String::new(), quoted);
                loop {
                    let open = || refused(format!("line {number}: a double quote is not closed"));
                    let (text, after) = rest.split_once('"').ok_or_else(open)?;
                    field += text;
                    rest = after;
                    let Some(more) = rest.strip_prefix('"') else { break };
                    field.push('"');
                    rest = more;
                }
                (field, rest.trim_start())
            }
            None => {
                let end = trimmed.find(',').unwrap_or(trimmed.len());
                (trimmed[..end].trim_end().to_owned(), &trimmed[end..])
            }
        };
        fields.push(field);
        match after.strip_prefix(',') {
            Some(more) => rest = more,
            None if after.is_empty() => return Ok(fields),
            None => return Err(refused(format!("line {number}: text after a closing double quote"))),
        }
    }
}

fn refused(what: String) -> WorkspaceError {
    WorkspaceError::input(what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_in_any_order() {
        let cell = |task: &str, policy: &str, world, rate, trials| {
            let (task, policy) = (task.to_owned(), policy.to_owned());
            Cell { task, policy, world, observed: Observed { rate, trials } }
        };
        let both = |trials| {
            Table::Rates(vec![
                cell("a, b", "octo", World::Sim, 0.5, trials),
                cell("a, b", "octo", World::Real, 0.25, trials),
            ])
        };
        let pair = |ties| {
            let policies = ["x", "y"].map(String::from);
            Table::Pairs(vec![Comparisons { policies, world: World::Real, wins: [3, 1], ties }])
        };
        let cases = [
            (
                "\u{feff}successes,World,trials,policy,task\r\n2,sim,4,octo,\"a, b\"\r\n\r\n1,REAL,4,octo,\"a, b\"\n",
                both(Some(4)),
            ),
            ("policy , sim,real,task\n# a remark\nocto,0.5,.25,\"a, b\"\n", both(None)),
            ("policy,trials,sim,real,task\nocto,4,0.5,.25,\"a, b\"", both(Some(4))),
            // Rows of the same cell are added.
            (
                "policy,world,trials,successes\no,sim,1,1\no,sim,3,1\n",
                Table::Rates(vec![cell("", "o", World::Sim, 0.5, Some(4))]),
            ),
            ("policy,sim,real,real_trials\nocto,0.5,,7\n", Table::Rates(vec![cell("", "octo", World::Sim, 0.5, None)])),
            ("first,second,world,first_wins,second_wins\nx,y,real,3,1\n", pair(0)),
            ("ties,first,second,world,first_wins,second_wins\n2,x,y,real,3,1\n", pair(2)),
        ];
        for (text, wanted) in cases {
            assert_eq!(parse(text).unwrap(), wanted, "{text}");
        }
        assert_eq!(fields("\"say \"\"hi\"\"\" , b", 1).unwrap(), ["say \"hi\"", "b"]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let cases = [
            ("", "the table is empty"),
            ("policy,sim,real\n", "a head and no row"),
            ("policy,simm,real\na,0,0\n", "line 1: unknown column \"simm\", did you mean sim?"),
            ("policy,sim,sim\na,0,0\n", "line 1: column sim stands there twice"),
            ("policy,sim\na,0\n", "line 1: the columns policy, sim do not make a table"),
            ("policy,sim,real\na,0\n", "line 2 has 2 fields, the head has 3"),
            ("policy,sim,real\na,78.7,0\n", "line 2: sim 78.7; expected a rate from 0 to 1, not per cent"),
            ("policy,sim,real\na,nan,0\n", "line 2: sim \"nan\"; expected a rate from 0 to 1"),
            ("policy,sim,real\na,0,0\n\na,0,0\n", "line 4: a second row of policy \"a\""),
            ("policy,sim,real\n,0,0\n", "line 2: no policy"),
            ("policy,world,trials,successes\na,moon,3,1\n", "line 2: world \"moon\"; expected sim or real"),
            ("policy,world,trials,successes\na,sim,3,4\n", "line 2: 4 successes in 3 trials"),
            ("policy,world,trials,successes\na,sim,0,0\n", "line 2: no trial in column trials"),
            ("policy,world,trials,successes\na,sim,-1,0\n", "line 2: trials \"-1\"; expected a whole number"),
            ("policy,world,trials,successes\na,sim,200000,0\n", "expected a whole number up to 100000"),
            ("policy,sim,real\n\"a,0,0\n", "line 2: a double quote is not closed"),
            ("policy,sim,real\n\"a\"b,0,0\n", "line 2: text after a closing double quote"),
            ("first,second,world,first_wins,second_wins\nx,x,real,3,1\n", "line 2: \"x\" is compared with itself"),
            ("first,second,world,first_wins,second_wins\nx,y,real,0,0\n", "line 2: 0 comparisons; expected 1"),
        ];
        for (text, wanted) in cases {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.starts_with(wanted) || error.contains(wanted), "{text:?}: {error}");
        }
    }
}
