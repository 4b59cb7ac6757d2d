//! Evaluations compared, and all of them in a table.

use std::fs;

use crate::{REPOSITORY, copy_of_finished_run, genmanip};

/// Policies on the finished run, each with several episodes per scenario.
#[test]
fn policies_are_compared_by_scenario_and_listed() {
    let folder = copy_of_finished_run();
    let evaluate = ["evaluate", "run", "--episodes-per-scenario", "2", "--json"];
    let policies = ["--policy", "do_nothing:seconds=0.1", "--policy", "expert"];
    let reports = genmanip(folder.path(), &[&evaluate[..], &policies].concat()).json(0);
    let episodes = |index: usize| reports[index]["results"].as_array().unwrap().len();
    assert_eq!((episodes(0), episodes(1)), (4, 4));
    let names = ["021_spatial-000", "021_spatial-000+1"];
    let ids: Vec<_> = reports[0]["results"].as_array().unwrap().iter().map(|result| &result["id"]).collect();
    assert!(names.iter().all(|name| ids.iter().any(|id| *id == name)), "{ids:?}");

    let files = ["run/evaluation/expert.json", "run/evaluation/do_nothing_seconds=0.1.json"];
    let comparison = genmanip(folder.path(), &["compare", files[0], files[1], "--json"]).json(0);
    let overall = &comparison["overall"];
    assert_eq!((&overall["scenarios"], &overall["pairs"]), (&2.into(), &4.into()));
    // Two scenarios, however often they are run, cannot show that one policy is better.
    assert_eq!(overall["p_value"], 0.5, "{overall}");
    let words = genmanip(folder.path(), &["compare", files[0], files[1]]).stdout;
    for said in ["A  expert (oracle)", "exact permutation test by scenario", "too few to find any"] {
        assert!(words.contains(said), "{said}: {words}");
    }

    // Another horizon is in the label, and a comparison warns of it.
    let short = ["evaluate", "run", "--policy", "expert", "--horizon", "0.5", "--stop-on-success", "--json"];
    let report = &genmanip(folder.path(), &short).json(0)[0];
    assert_eq!(report["label"], "expert+horizon=0.5+stop_on_success", "{report}");
    assert_eq!((&report["horizon_s"], &report["stop_on_success"]), (&0.5.into(), &true.into()));
    assert!(reports[0].get("horizon_s").is_none() && reports[0].get("stop_on_success").is_none());
    let shorter = "run/evaluation/expert+horizon=0.5+stop_on_success.json";
    let words = genmanip(folder.path(), &["compare", files[0], shorter]).stdout;
    for said in ["warning: the horizons of 2 episodes differ", "B 0.5 s", "episodes of B ended once the goal held"] {
        assert!(words.contains(said), "{said}: {words}");
    }
    assert!(comparison.get("warnings").is_none(), "{comparison}");
    fs::remove_file(folder.path().join(shorter)).unwrap();
    for impossible in ["0", "-3", "inf", "4000"] {
        genmanip(folder.path(), &["evaluate", "run", "--policy", "expert", "--horizon", impossible])
            .assert_refused(&["s is not possible", "at most 3600"]);
    }

    let board = genmanip(folder.path(), &["leaderboard", ".", "--html", "board.html"]);
    assert_eq!(board.code, Some(0), "{board:?}");
    let (policies, oracle) = board.stdout.split_once("### With simulator truth (oracle)").unwrap();
    assert!(
        policies.contains("| do_nothing_seconds=0.1 | 4 | 0.0 % (") && oracle.contains("| expert | 4 |"),
        "{board:?}"
    );
    let page = fs::read_to_string(folder.path().join("board.html")).unwrap();
    assert!(page.contains("With simulator truth (oracle)") && !page.contains("<script"), "{page}");
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = copy_of_finished_run();
    let only = ["evaluate", "run/scenarios/021_spatial-000.json", "--policy", "do_nothing:seconds=0.1", "--out", "one"];
    let all = ["evaluate", "run", "--policy", "do_nothing:seconds=0.1"];
    for call in [&only[..], &all] {
        assert_eq!(genmanip(folder.path(), call).code, Some(0));
    }
    let file = "evaluation/do_nothing_seconds=0.1.json";
    let [ours, theirs] = ["run", "one"].map(|run| format!("{run}/{file}"));
    fs::create_dir(folder.path().join("empty")).unwrap();
    let cases: [(&[&str], &[&str]); 4] = [
        (&["compare", &ours, &theirs], &["is of suite run (", "one/evaluation", "on the same scenarios"]),
        (&["compare", &ours, "run"], &["run is a folder", "RUN/evaluation/expert.json"]),
        (&["compare", &ours, "run/run.json"], &["run/run.json", "genmanip.evaluation/2"]),
        (&["leaderboard", "empty"], &["no evaluation below empty", "RUN/evaluation/*.json"]),
    ];
    for (call, said) in cases {
        genmanip(folder.path(), call).assert_refused(said);
    }
}

#[test]
fn simulation_is_compared_with_reality() {
    let folder = tempfile::tempdir().unwrap();
    let table = format!("{REPOSITORY}/examples/sim2real/rates.csv");
    let report = genmanip(folder.path(), &["sim2real", &table, "--json", "--svg", "agreement.svg"]).json(0);
    assert_eq!(report["overall"]["policies"].as_array().unwrap().len(), 6, "{report}");
    assert!(report["overall"]["mmrv"]["value"].as_f64().unwrap() > 0.0);
    assert_eq!(report["tasks"][0]["task"], "coke");
    assert!(fs::read_to_string(folder.path().join("agreement.svg")).unwrap().starts_with("<svg"));

    fs::write(folder.path().join("percent.csv"), "policy,sim,real\na,80,0.5\n").unwrap();
    fs::write(folder.path().join("other.csv"), "model,sim,real\na,0.8,0.5\n").unwrap();
    let cases: [(&[&str], &[&str]); 3] = [
        (&["sim2real", "percent.csv"], &["line 2: sim 80; expected a rate from 0 to 1, not per cent", "percent.csv"]),
        (&["sim2real", "other.csv"], &["unknown column \"model\"", "accepted, in any order", "other.csv"]),
        (&["sim2real", "."], &["expected a file"]),
    ];
    for (call, said) in cases {
        genmanip(folder.path(), call).assert_refused(said);
    }
}
