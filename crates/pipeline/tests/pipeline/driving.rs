//! An environment that the calling program drives.

use std::sync::Arc;

use genmanip_core::{ActionSpace, CameraRequest, GripperEncoding};
use genmanip_core::{ActionSpec, EpisodeResult, ImageChannels, Observation};
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::sessions::{SceneSource, Session, SessionSettings};

/// A session gives the results of `do_nothing` for half a second; restoring a saved state and invalid actions change
/// nothing.
pub fn a_session_ends_as_the_loop_does(suite: &Suite, results: &[EpisodeResult]) {
    let scenes = Arc::new(SceneSource::of_suite(suite).unwrap());
    assert_eq!(scenes.len(), results.len());
    let mut session = Session::new(Arc::clone(&scenes), SessionSettings::new(ActionSpec::native(), 60.0)).unwrap();
    assert!(session.step(&[0.0; 8]).unwrap_err().to_string().contains("there is no episode"));
    for (index, expected) in results.iter().enumerate() {
        session.reset(index, None).unwrap();
        let still: Vec<f32> =
            session.observe().unwrap().state[Observation::STATE].iter().map(|&value| value as f32).collect();
        let mut saved = None;
        for step in 0..30 {
            if step == 10 {
                saved = Some(session.save().unwrap());
            }
            session.step(&still).unwrap();
        }
        session.restore(&saved.unwrap()).unwrap();
        for wrong in [&still[..7], &[f32::NAN; 8]] {
            session.step(wrong).unwrap_err();
        }
        (10..30).for_each(|_| assert!(!session.step(&still).unwrap().truncated));
        assert_eq!(session.finish("do_nothing").unwrap(), *expected);
    }
    out_of_reach(&scenes);
    let unserved = |settings: SessionSettings| {
        let error =
            Session::new(Arc::clone(&scenes), settings).and_then(|mut session| session.reset(0, None)).unwrap_err();
        format!("{error}\nhint: {}", error.hint().unwrap())
    };
    let native = SessionSettings::new(ActionSpec::native(), 60.0);
    let ids = ImageChannels { ids: true, ..ImageChannels::RGB };
    assert!(unserved(SessionSettings { rate_hz: 7.0, ..native.clone() }).contains("such as 10, 15"));
    for horizon_s in [0.0, -1.0, f64::INFINITY] {
        let settings = SessionSettings { horizon_s: Some(horizon_s), ..native.clone() };
        assert!(unserved(settings).contains("`horizon_s`"));
    }
    for discount in [0.0, 1.5, -1.0, f64::NAN] {
        let settings = SessionSettings { shaping_discount: Some(discount), ..native.clone() };
        assert!(unserved(settings).contains("`shaping_discount`"));
    }
    assert!(
        unserved(SessionSettings { cameras: vec![CameraRequest::new("none", ids)], ..native.clone() }).contains("none")
    );
    assert!(unserved(SessionSettings { cameras: vec![CameraRequest::new("static", ids)], ..native }).contains("truth"));
    assert!(session.reset(scenes.len(), None).unwrap_err().to_string().contains("there is no scene"));
}

/// A pose that the arm cannot reach: the last command is held, and time passes until it is over.
fn out_of_reach(scenes: &Arc<SceneSource>) {
    let action = ActionSpec::new(ActionSpace::EePose, GripperEncoding::WidthM);
    let settings = SessionSettings { horizon_s: Some(0.2), ..SessionSettings::new(action, 15.0) };
    let mut session = Session::new(Arc::clone(scenes), settings).unwrap();
    session.reset(0, Some(780_100)).unwrap();
    let far = [3.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.08];
    let outcomes: Vec<_> = (0..3).map(|_| session.step(&far).unwrap()).collect();
    assert!(outcomes.iter().all(|outcome| outcome.refused.as_deref().is_some_and(|why| why.contains("x 3.000"))));
    assert_eq!(outcomes.iter().map(|outcome| outcome.truncated).collect::<Vec<_>>(), [false, false, true]);
    assert!(session.step(&far).unwrap_err().to_string().contains("the episode is over"));
    // Three actions of four control steps, then a second of settling.
    assert_eq!(session.finish("far").unwrap().frames, 12 + 60);
}
