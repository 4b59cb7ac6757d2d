use super::*;

#[test]
fn policies_are_found_by_name_with_arguments() {
    let labels = [
        ("expert", "expert"),
        ("replay", "replay"),
        ("do_nothing", "do_nothing"),
        ("do_nothing:seconds=5", "do_nothing"),
        ("do_nothing:seconds=0.5", "do_nothing_seconds=0.5"),
        ("python:mine.press:Press", "python_class=mine.press_Press"),
        ("agent:path=grid,preset=paper", "agent_path=grid_preset=paper"),
        ("agent:transcripts=out/asked,vlm=random", "agent_vlm=random"),
        ("agent:vlm=random,answers=out/answers", "agent_vlm=random_answers=answers"),
        ("openpi:url=ws://gpu:8000,preset=libero", "openpi_url=gpu_8000_preset=libero"),
    ];
    for (text, label) in labels {
        let factory = PolicyFactory::resolve(text).unwrap();
        assert_eq!((factory.label(), factory.name()), (label, text.split(':').next().unwrap()));
    }
    let known: Vec<&str> = POLICIES.iter().filter(|entry| entry.is_usual).map(|entry| entry.name).collect();
    let all = PolicyFactory::all(true).unwrap();
    assert_eq!(all.iter().map(PolicyFactory::name).collect::<Vec<_>>(), known);
}

#[test]
fn what_is_wrong_is_said() {
    let cases = [
        ("expret", "unknown policy `expret`", "did you mean `expert`?"),
        (
            "",
            "unknown policy ``",
            "policies are expert, replay, do_nothing, random, blind, clumsy, playback, skill, learned, agent",
        ),
        ("playback", "policy playback needs a dataset", "playback:dataset=FOLDER"),
        ("playback:dataset=none", "cannot play none back", ""),
        ("learned", "policy learned needs the folder of a policy", "learned:FOLDER"),
        ("learned:policy,execute=2.5", "policy learned: execute=2.5 is not possible", "a whole number"),
        ("learned:policy,ensemble=-1", "policy learned: ensemble=-1 is not possible", "from 0 to 100"),
        ("python", "`` names no class", "python:MODULE:CLASS"),
        ("python:my_policy", "`my_policy` names no class", "MyPolicy in my_policy.py"),
        ("python:my_policy:My Policy", "names no class", ""),
        ("expert:speed=2", "policy expert takes no arguments", "expected expert alone"),
        ("do_nothing:second=2", "unknown policy argument `second`", "did you mean `seconds`?"),
        ("do_nothing:seconds", "`seconds` is no argument of policy do_nothing", "do_nothing:key=value"),
        ("do_nothing:seconds=-1", "seconds=-1 is not possible", "from 0 to 600"),
        ("agent:masks=none", "unknown source of masks `none`", "sources of masks are oracle, rgbd, http:URL"),
        ("agent:vlm=none.toml", "cannot read none.toml", ""),
        ("agent:vlm=recorded", "recorded answers lie in a folder", "vlm=recorded,answers=FOLDER"),
        ("agent:loop=half", "unknown loop `half`", "loops are closed, open"),
        ("agent:ctof=1", "ctof=1 is not possible", "yes or no"),
        ("agent:err_check=2", "err_check=2 is not possible", "from 0 to 1"),
        ("do_nothing:seconds=-0.0", "seconds=-0.0 is not possible", "from 0 to 600"),
        ("do_nothing:seconds=NaN", "seconds=NaN is not possible", "from 0 to 600"),
    ];
    for (text, what, hint) in cases {
        let error = PolicyFactory::resolve(text).unwrap_err();
        let (got, help) = (error.to_string(), error.hint().unwrap_or_default());
        assert!(got.contains(what) && help.contains(hint), "{text}: {got}; {help}");
    }
}
