use genmanip_core::{AssetRef, AssetUid, Document, Seed};

use crate::{AssetError, Catalogue, GraspFile, GraspLibrary, panda, variant};

#[test]
fn the_grasps_that_come_with_the_program_are_fresh_and_plausible() {
    let (catalogue, file) = (Catalogue::builtin(), GraspFile::builtin());
    assert!(!file.objects.is_empty());
    for uid in file.objects.keys() {
        let model = catalogue.build(uid).unwrap();
        let (card, grasps) = (&model.card, file.of(&model).unwrap().unwrap());
        assert!(card.can_grasp && !card.is_articulated && !grasps.is_empty(), "{}", card.name);
        assert!(grasps.windows(2).all(|pair| pair[0].share() >= pair[1].share()), "{}: not sorted", card.name);
        for tried in grasps {
            let grasp = &tried.grasp;
            assert!(tried.trials > 0 && tried.held <= tried.trials, "{}: {tried:?}", card.name);
            assert!(grasp.width > 0.0 && grasp.width < 0.08, "{}: {grasp:?}", card.name);
            assert!(grasp.pose.position.length() < card.size_m.length() + 0.02, "{}: {grasp:?}", card.name);
        }
    }
}

/// Reading and writing again gives the same text, as an interrupted bake relies on.
#[test]
fn grasp_files_round_trip() {
    let text = GraspFile::builtin().to_text();
    let again = GraspFile::from_json(&text).unwrap();
    assert!(again.to_text() == text && again.objects.keys().eq(GraspFile::builtin().objects.keys()));
    let grasps = |file: &GraspFile| file.objects.values().flat_map(|object| object.grasps.clone()).collect::<Vec<_>>();
    for (read, written) in grasps(&again).iter().zip(grasps(GraspFile::builtin())) {
        assert!(read.grasp.pose.position.distance(written.grasp.pose.position) < 1e-5, "{read:?}");
        assert!(read.grasp.pose.angle_to(&written.grasp.pose) < 1e-4, "{read:?}");
        assert_eq!((read.held, read.trials), (written.held, written.trials));
    }
}

#[test]
fn stale_grasps_are_refused_and_unknown_objects_have_none() {
    let mug = Catalogue::builtin().build("001").unwrap();
    let changed = variant(&mug, Seed::new(1));
    let error = GraspFile::builtin().of(&changed).unwrap_err();
    assert!(matches!(&error, AssetError::StaleGrasps { uid, .. } if uid == "001"), "{error}");
    assert!(error.to_string().contains("genmanip grasps bake"), "{error}");
    let mut nameless = (*mug).clone();
    nameless.card.uid = "no such thing".into();
    assert_eq!(GraspFile::builtin().of(&nameless).unwrap(), None);
}

/// A robot gets its own grasps of unchanged objects, an error for changed ones, and nothing of another robot.
#[test]
fn the_library_returns_grasps_of_this_robot_and_object() {
    let (robot, mug) = (panda(), Catalogue::builtin().build("001").unwrap());
    let library = GraspLibrary::builtin();
    let known = &GraspFile::builtin().objects["001"].grasps;
    assert!(!known.is_empty() && library.of(&robot, &mug).unwrap() == known);

    let mut changed = (*mug).clone();
    changed.friction += 0.1;
    let error = library.of(&robot, &changed).unwrap_err();
    assert!(matches!(&error, AssetError::StaleGrasps { uid, .. } if uid == "001"), "{error}");
    assert!(error.to_string().contains("genmanip grasps bake"), "{error}");

    let mut other = (*robot).clone();
    other.name = "another arm".into();
    assert_eq!(library.of(&other, &mug), Ok(&[][..]), "grasps of another robot");
    assert_eq!(library.of(&other, &changed), Ok(&[][..]));
    assert_eq!(library.of(&robot, &variant(&mug, Seed::new(1))), Ok(&[][..]), "a variant is a different object");
    let shelf = Catalogue::builtin().build("057").unwrap();
    assert_eq!(library.of(&robot, &shelf), Ok(&[][..]), "never tried");

    let mut file = GraspFile::builtin().clone();
    file.made_by.robot_hash = Some("0".into());
    let error = GraspLibrary::new([file.clone()]).of(&robot, &mug).unwrap_err().to_string();
    assert!(error.contains("001 with panda") && error.contains("genmanip grasps bake"), "{error}");
    file.made_by.robot_hash = Some(robot.physics_hash());
    assert!(GraspLibrary::new([file]).of(&robot, &mug).unwrap() == known);

    // An untried object uses the grasps of an object with the same physics.
    let mut twin = (*mug).clone();
    twin.asset = AssetRef::Builtin { uid: "twin".into(), version: 1 };
    assert!(library.of(&robot, &twin).unwrap() == known);

    // Files of several robots are kept apart.
    let mut theirs = GraspFile::builtin().clone();
    theirs.made_by.robot.clone_from(&other.name);
    theirs.objects.retain(|uid, _| uid == "046");
    let both = GraspLibrary::new([GraspFile::builtin().clone(), theirs]);
    let cube = Catalogue::builtin().build("046").unwrap();
    assert!(both.of(&other, &mug) == Ok(&[][..]) && !both.of(&other, &cube).unwrap().is_empty());
    assert!(both.of(&robot, &mug).unwrap() == known);
}

/// A sample of the list: building all objects takes a minute.
#[test]
fn the_list_has_grasps_that_were_tried() {
    let (robot, full) = (panda(), Catalogue::full());
    let can_grasp = full.cards().iter().filter(|card| card.can_grasp && !card.is_articulated);
    let without: Vec<&AssetUid> = can_grasp
        .step_by(29)
        .map(|card| &card.uid)
        .filter(|uid| GraspLibrary::builtin().of(&robot, &full.build(*uid).unwrap()).unwrap().is_empty())
        .collect();
    assert_eq!(without, Vec::<&AssetUid>::new(), "regenerate data/instance_grasps.json");
}

#[test]
fn invalid_rows_are_rejected_with_their_index() {
    let file = |row: &str| {
        let made_by = r#"{"seed":0,"genmanip_version":"","engine":"","robot":"","settings":{}}"#;
        let objects = format!(r#"{{"001":{{"physics_hash":"","grasps":[{row}]}}}}"#);
        GraspFile::from_json(&format!(r#"{{"schema":"genmanip.grasps/1","made_by":{made_by},"objects":{objects}}}"#))
    };
    assert_eq!(file("[0,0,0.1, 0,3,0, 0.05,0.8, 4,5]").unwrap().objects["001"].grasps[0].held, 4);
    for (row, expected) in [
        ("[0,0,0.1, 0,3,0, -0.05,0.8, 4,5]", "width"),
        ("[0,0,0.1, 0,3,0, 0.05,1.8, 4,5]", "score"),
        ("[0,0,0.1, 0,3,0, 0.05,0.8, 6,5]", "held ≤ trials"),
        ("[0,0,0.1, 0,3,0, 0.05,0.8, 4.5,5]", "whole numbers"),
        ("[0,0,0.1, 0,3,0]", "length 6"),
        ("[0,0,1e999, 0,3,0, 0.05,0.8, 4,5]", "out of range"),
    ] {
        let message = file(row).unwrap_err().to_string();
        assert!(message.contains(expected), "{row}: {message}");
    }
}
