use super::*;

const TEXT: &str = r#"
every = { spills = 0 }
kernels.tile_blend = { code_bytes = 32_768 }

[families.gfx1100]
every.waves = 12
kernels.adam.waves = 16
kernels.tile_blend = { waves = 8, code_bytes = 50_000 }

[known.adam]
why = "a test"
families.gfx1100 = { spills = 4 }
"#;

/// One device, family gfx1100, with one pipeline of a kernel.
fn device(kernel: &str, figures: &[(Figure, u64)]) -> BTreeMap<String, DeviceFigures> {
    let row = KernelFigures {
        kernel: kernel.into(),
        specialisation: "TRAINING=1".into(),
        subgroup_sizes: vec![32],
        figures: figures.iter().copied().collect(),
        unknown: BTreeMap::new(),
    };
    let (device, driver) = ("a device".into(), "a driver".into());
    let figures = DeviceFigures { device, driver, subgroup_size: 32, seconds: 1.0, kernels: vec![row] };
    BTreeMap::from([("gfx1100".to_owned(), figures)])
}

fn lines(violations: &[Violation]) -> Vec<String> {
    violations.iter().map(Violation::to_string).collect()
}

#[test]
fn a_kernel_without_an_entry_falls_under_the_default() {
    let budgets = Budgets::parse(TEXT).unwrap();
    let good = budgets.judge(&device("scan_reduce", &[(Figure::Spills, 0), (Figure::Waves, 12)]));
    assert_eq!(lines(&good.violations), [""; 0]);
    let bad = budgets.judge(&device("scan_reduce", &[(Figure::Spills, 1), (Figure::Waves, 11)]));
    let expected = [
        "scan_reduce (TRAINING=1) on gfx1100: spills 1, budget at most 0",
        "scan_reduce (TRAINING=1) on gfx1100: waves 11, budget at least 12",
    ];
    assert_eq!(lines(&bad.violations), expected);
}

#[test]
fn the_most_special_entry_counts() {
    let budgets = Budgets::parse(TEXT).unwrap();
    let limits = |kernel, family| budgets.of(kernel, family).into_iter().collect::<Vec<_>>();
    let expected = [(Figure::Spills, 0), (Figure::Waves, 8), (Figure::CodeBytes, 50_000)];
    assert_eq!(limits("tile_blend", "gfx1100"), expected);
    assert_eq!(limits("tile_blend", "vega10"), [(Figure::Spills, 0), (Figure::CodeBytes, 32_768)]);
    assert_eq!(limits("adam", "gfx1100"), [(Figure::Spills, 0), (Figure::Waves, 16)]);
}

#[test]
fn a_figure_that_the_driver_does_not_give_breaks_its_budget() {
    let verdict = Budgets::parse(TEXT).unwrap().judge(&device("scan_reduce", &[(Figure::Waves, 16)]));
    let expected = ["scan_reduce (TRAINING=1) on gfx1100: the driver gives no spills, budget at most 0"];
    assert_eq!(lines(&verdict.violations), expected);
}

#[test]
fn what_is_known_may_get_no_worse_and_is_struck_out_when_mended() {
    let budgets = Budgets::parse(TEXT).unwrap();
    let judge = |spills| budgets.judge(&device("adam", &[(Figure::Spills, spills), (Figure::Waves, 16)]));
    let within = judge(4);
    assert_eq!((within.violations.len(), within.known.len(), within.mended.len()), (0, 1, 0));
    let worse = judge(5);
    assert_eq!(lines(&worse.violations), ["adam (TRAINING=1) on gfx1100: spills 5, budget at most 0"]);
    let mended = judge(0);
    assert_eq!((mended.violations.len(), mended.known.len()), (0, 0));
    let text = "adam on gfx1100: spills keeps its budget now, so take it out of known.adam";
    assert_eq!(mended.mended.iter().map(Mended::to_string).collect::<Vec<_>>(), [text]);
    assert_eq!(budgets.judge(&BTreeMap::new()).mended, [], "nothing was looked at");
}

#[test]
fn names_that_do_not_exist_are_errors() {
    let error = |text: &str| Budgets::parse(text).unwrap_err();
    assert_eq!(error("kernels.tile_bland.waves = 8"), "there is no kernel tile_bland: name one of glsl/*.comp");
    assert!(error("[families.vega10]\nkernels.adan.waves = 8").contains("no kernel adan"));
    assert!(error("\nevery.wavs = 8").starts_with("line 2: unknown variant `wavs`"), "{}", error("\nevery.wavs = 8"));
    assert!(error("evry.waves = 8").contains("unknown field `evry`"));
    let known = TEXT.replace("families.gfx1100 = ", "families.gfx1 = ");
    assert_eq!(error(&known), "known: there is no family gfx1: add families.gfx1");
}
