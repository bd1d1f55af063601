use super::*;

fn with_settings(settings: &[&str]) -> ConfigSourceArgs {
    ConfigSourceArgs { set: settings.iter().map(|&setting| setting.to_owned()).collect(), ..Default::default() }
}

fn refusal(settings: &[&str]) -> String {
    let error = resolve(&with_settings(settings), None).expect_err("refused");
    assert_eq!(crate::failure::exit_code(&error), crate::failure::USAGE, "{error}");
    error.to_string()
}

#[test]
fn every_preset_can_be_trained() {
    for preset in PRESETS {
        let args = ConfigSourceArgs { preset: Some(preset.name.to_owned()), ..Default::default() };
        resolve(&args, None).unwrap_or_else(|error| panic!("{}: {error}", preset.name));
    }
}

#[test]
fn the_preset_neu3d_is_the_defaults() {
    let args = ConfigSourceArgs { preset: Some("neu3d".to_owned()), ..Default::default() };
    assert_eq!(resolve(&args, None).expect("resolved").config, Config::default());
}

#[test]
fn a_folder_of_photos_has_a_preset_of_its_own() {
    let folder = tempfile::tempdir().expect("folder");
    let resolved = || resolve(&ConfigSourceArgs::default(), Some(folder.path())).expect("resolved");
    assert_eq!(resolved().preset.name, FOR_VIDEO);
    for name in ["images", "sparse"] {
        std::fs::create_dir(folder.path().join(name)).expect("made");
    }
    let resolved = resolved();
    assert_eq!(resolved.preset.name, FOR_PHOTOS);
    let note = resolved.note.expect("said");
    assert!(note.contains(FOR_PHOTOS) && note.contains("chosen by the scene format;"), "{note}");
    let preset = |capture: &str| {
        let args = with_settings(&[&format!("scene.capture={capture}")]);
        resolve(&args, Some(folder.path())).expect("resolved").preset.name
    };
    assert_eq!([preset("video"), preset("photos")], [FOR_ONE_CAMERA, FOR_PHOTOS]);
}

#[test]
fn a_built_in_scene_has_one_name_in_configurations_and_on_the_command_line() {
    for kind in mvfusion_data::BuiltinKind::ALL {
        let args = with_settings(&[&format!("scene.kind={}", kind.key())]);
        assert_eq!(resolve(&args, None).expect("resolved").config.scene.kind, kind);
    }
}

#[test]
fn a_later_source_wins() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("a.toml");
    std::fs::write(&file, "seed = 3\n[train]\nscale = 0.5\nbatch_size = 3\n[train.stages]\ngeometry = 11\n")
        .expect("written");
    let args = ConfigSourceArgs {
        config: Some(file),
        seed: Some(9),
        ..with_settings(&["train.scale=0.25", "train.scale=1", "seed=5", "scene.kind=casual"])
    };
    let config = resolve(&args, None).expect("resolved").config;
    assert_eq!((config.seed, config.train.scale, config.train.batch_size), (9, 1.0, 3));
    assert_eq!(config.train.stages.geometry.0, 11);
    assert_eq!(config.scene.kind, mvfusion_data::BuiltinKind::Casual);
    // A table adds to the table that it overrides.
    let preset = resolve(&ConfigSourceArgs::default(), None).expect("resolved").config;
    assert_eq!(config.train.stages.refinement, preset.train.stages.refinement);
}

#[test]
fn a_calling_program_overrides_the_file_and_is_named_in_its_errors() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("a.toml");
    std::fs::write(&file, "seed = 3\ntrain.scale = 0.5\n").expect("written");
    let of = |text: &str| ConfigSourceArgs {
        config: Some(file.clone()),
        table: Some(text.parse().expect("TOML")),
        ..ConfigSourceArgs::default()
    };
    let config = resolve(&of("train.scale = 0.25"), None).expect("resolved").config;
    assert_eq!((config.seed, config.train.scale), (3, 0.25));
    let error = resolve(&of("train.scal = 1"), None).expect_err("refused").to_string();
    assert!(error.contains("the calling program") && error.contains("`train.scale`"), "{error}");
}

#[test]
fn a_folder_asks_for_its_own_preset_and_is_written_down_absolute() {
    let resolved = resolve(&ConfigSourceArgs::default(), Some(Path::new("scenes/steak"))).expect("resolved");
    assert_eq!(resolved.preset.name, FOR_VIDEO);
    let note = resolved.note.expect("said");
    assert!(note.contains(FOR_VIDEO) && note.contains("no known format was found in scenes/steak"), "{note}");
    let data = resolved.config.scene.data.expect("set");
    assert!(data.is_absolute() && data.ends_with("scenes/steak"), "{}", data.display());
    assert_eq!(resolve(&with_settings(&["scene.data=scenes/steak"]), None).expect("resolved").preset.name, FOR_VIDEO);
}

#[test]
fn what_is_written_down_is_read_again() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("config.toml");
    let args = with_settings(&["eval.dynamic_masks=m", "optim.epsilon=1e-17"]);
    let config = resolve(&args, Some(Path::new("x"))).expect("resolved").config;
    std::fs::write(&file, to_toml(&config).expect("written as TOML")).expect("written");
    assert_eq!(read(&file).expect("read"), config);
}

#[test]
fn a_value_that_training_refuses_is_refused_in_the_file_of_a_run_as_well() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("config.toml");
    std::fs::write(&file, "[motion]\nsamples = 0\n").expect("written");
    let error = read(&file).expect_err("refused");
    assert_eq!(crate::failure::exit_code(&error), crate::failure::USAGE);
    let said = format!("{error:#}");
    assert!(said.contains("config.toml: `motion.samples` is 0: "), "{said}");
}

#[test]
fn an_unknown_key_is_refused_with_the_nearest_one_and_its_place() {
    let message = refusal(&["model.widht=3"]);
    assert!(message.contains("`model.widht`") && message.contains("`model.width`"), "{message}");
    assert!(message.contains("--set model.widht=3"), "{message}");
    assert!(refusal(&["stages.geometry=3"]).contains("`train.stages`"));
    assert!(refusal(&["motion.weights.postion=3"]).contains("`motion.weights.position`"));
    assert!(!refusal(&["qqqqqqqqqqqqqq=3"]).contains("Did you mean"));
}

#[test]
fn an_unknown_key_in_a_file_is_refused_with_its_line() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("a.toml");
    std::fs::write(&file, "seed = 3\n\n[train]\nscale = 0.5\nbatchsize = 3\n").expect("written");
    let error =
        resolve(&ConfigSourceArgs { config: Some(file), ..Default::default() }, None).expect_err("refused").to_string();
    assert!(error.contains("a.toml, line 5") && error.contains("`train.batch_size`"), "{error}");
}

#[test]
fn a_list_for_a_table_and_a_value_out_of_range_are_refused_with_their_line() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("a.toml");
    for (text, expected) in [
        ("seed = 3\nloss = [2.0]\n", "`loss` must be a table with the keys "),
        ("[train]\nscale = 0\n", "`train.scale` is 0: give a number above 0"),
    ] {
        std::fs::write(&file, text).expect("written");
        let args = ConfigSourceArgs { config: Some(file.clone()), ..Default::default() };
        let error = resolve(&args, None).expect_err("refused");
        assert_eq!(crate::failure::exit_code(&error), crate::failure::USAGE, "{error}");
        let said = error.to_string();
        assert!(said.contains("a.toml, line 2") && said.contains(expected), "{said}");
    }
}

#[test]
fn a_dotted_key_in_quotes_is_refused_with_its_line() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("a.toml");
    for (text, name) in
        [("seed = 3\n'train.scale' = 0.5\n", "train.scale"), ("[train]\n\"stages.geometry\" = 1\n", "stages.geometry")]
    {
        std::fs::write(&file, text).expect("written");
        let args = ConfigSourceArgs { config: Some(file.clone()), ..Default::default() };
        let error = resolve(&args, None).expect_err("refused").to_string();
        assert!(error.contains("a.toml, line 2") && error.contains(&format!("`{name}` without quotes")), "{error}");
    }
}

#[test]
fn a_value_of_the_wrong_kind_is_refused_with_what_would_be_right() {
    for (setting, expected) in [
        ("model.width=wide", "must be a whole number, 0 or more, not \"wide\""),
        ("model.width=-3", "must be a whole number, 0 or more, not -3"),
        ("train.scale=small", "must be a number, not \"small\""),
        ("model.deformation=1", "must be true or false, not 1"),
        ("scene.kind=movie", "must be one of `video`, `motion`, `casual`, not \"movie\""),
        ("scene.kind=3", "must be one of `video`, `motion`, `casual`, not 3"),
        ("scene.data=3", "must be a string, not 3"),
        ("model.grid.resolution=[1, 2]", "must be a list such as [64, 64, 64, 150], not [1, 2]"),
        ("train=3", "must be a table"),
        ("train=[0.003]", "`train` must be a table with the keys scale, "),
        ("loss=[2.0]", "must be a table"),
        ("scene=[\"casual\"]", "must be a table"),
        ("train.stages=[]", "must be a table"),
        ("motion.weights=[1, 2]", "`motion.weights` must be a table with the keys position, scale, rotation"),
        ("optim.means={start=\"x\"}", "`optim.means.start` must be a number, not \"x\""),
    ] {
        let message = refusal(&[setting]);
        assert!(message.contains(expected), "{setting}: {message}");
    }
}

#[test]
fn a_setting_that_is_no_setting_is_refused() {
    for setting in ["train.scale", "=3", "train..scale=3", ".=1"] {
        assert!(refusal(&[setting]).contains("--set"), "{setting}");
    }
    assert!(refusal(&["train.scale=0"]).contains("train.scale"));
    assert!(refusal(&["scene.data="]).contains("`scene.data` is an empty path"));
}

#[test]
fn an_unknown_preset_is_refused_with_the_list() {
    let args = ConfigSourceArgs { preset: Some("neu3".to_owned()), ..Default::default() };
    let message = resolve(&args, None).expect_err("refused").to_string();
    assert!(message.contains("`neu3d`") && message.contains("quickstart"), "{message}");
}
