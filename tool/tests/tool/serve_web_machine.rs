//! The machine in motion on the page: what the page is told of the machine file, and in a browser (Chromium) where it draws
//! the axes.

use serde_json::json;

use crate::common::page::{Serving, hello};
use crate::common::run;

/// Two axes of a table, one with a negative scale on a rail, one that turns, and a gantry.
const MACHINE: &str = r#"
format = 1

[axes]
X = { slave = 1, unit = "mm", per = 0.001, min = 0, max = 20 }
Y = { slave = 2, unit = "mm", per = 0.001, min = 0, max = 10 }
Z = { slave = 3, unit = "mm", per = -0.001, min = -5, max = 20 }
C = { slave = 4, unit = "deg", per = 0.01, min = -90 }
G1 = { slave = 5, unit = "mm", per = 0.001, min = 0, max = 8 }
G2 = { slave = 6, unit = "mm", per = 0.001, min = 0, max = 8 }
B = { slave = 7, unit = "mm", per = 0.001, min = 0, max = 4 }

[picture]
xy = [["X", "Y"]]
gantries = [{ sides = ["G1", "G2"], bridge = "B" }]
"#;
const SLAVES: &str = "sim:?slaves=drive*7";

fn machine_file(folder: &std::path::Path, text: &str) -> String {
    let file = folder.join("m.toml");
    std::fs::write(&file, text).expect("a file");
    file.to_str().expect("UTF-8").to_owned()
}

/// The page of a recording has the limits, the turns and the groups of the machine file that the recording carries. Without a
/// machine file it has none.
#[test]
fn a_recording_has_what_its_machine_file_says_of_the_axes() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), MACHINE);
    let file = folder.path().join("run.pcapng");
    let html = folder.path().join("run.html");
    let [file, html] = [&file, &html].map(|path| path.to_str().expect("UTF-8"));
    let link = format!("{SLAVES}&clock=virtual");
    run(["move", "Z=1", "C=5", "--up", "--link", &link, "--machine", &machine, "--record", file]).expect_code(0);
    let page = |options: &[&str]| {
        run([&["plot", file, "-o", html], options].concat()).expect_code(0);
        hello(&std::fs::read_to_string(html).expect("a page"))
    };
    let told = page(&[]);
    let ends = |slave: usize| {
        let slave = &told["slaves"][slave - 1];
        (slave["min"].as_f64(), slave["max"].as_f64(), slave["turn"].as_f64())
    };
    assert_eq!([1, 2].map(ends), [(Some(0.0), Some(20.0), None), (Some(0.0), Some(10.0), None)]);
    assert_eq!(ends(3), (Some(-5.0), Some(20.0), None), "the lower limit is the first one");
    assert_eq!(ends(4), (Some(-90.0), None, Some(360.0)));
    assert_eq!(told["picture"], json!({"xy": [[1, 2]], "gantries": [{"sides": [5, 6], "bridge": 7}]}));
    // In other units limits and turns are in those.
    let told = page(&["--counts-per-unit", "3=-500,4=1"]);
    assert_eq!((&told["slaves"][2]["min"], &told["slaves"][2]["max"]), (&json!(-10.0), &json!(40.0)));
    assert_eq!(told["slaves"][3]["turn"], 36000.0);
    let told = page(&["--machine", "none"]);
    assert!(told["slaves"][0]["min"].is_null() && told["picture"].is_null(), "{told}");
}

/// The server of a board tells its machine file to the server of the page, which says so.
#[test]
fn a_served_board_tells_its_machine_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), MACHINE);
    let board = Serving::start("tcp", &["--link", SLAVES, "--machine", &machine]);
    let web = Serving::start("web", &["--link", &format!("tcp://{}", board.address())]);
    let mut socket = web.socket().expect("there is room");
    let told = crate::common::page::next_text(&mut socket, &mut Vec::new());
    assert_eq!((&told["slaves"][3]["name"], &told["slaves"][3]["turn"]), (&json!("C"), &json!(360.0)));
    assert_eq!(told["picture"]["xy"], json!([[1, 2]]));
    assert!(web.end().contains("note: machine file m.toml of the server"));
    board.end();
}

mod needs_chromium {
    use super::{MACHINE, SLAVES, machine_file};
    use crate::common::page::{Browser, Serving, insist};
    use crate::common::run;
    use crate::plot_html::{dumped, recorded};

    /// JavaScript: the middle of an element, and where that is inside another one, from 0 to 1 across and up.
    const PLACES: &str = "globalThis.middle = (of) => { const { left, right, top, bottom } = of.getBoundingClientRect(); \
         return [(left + right) / 2, (top + bottom) / 2]; }; \
         globalThis.within = (of, frame) => { const [x, y] = middle(of); const { left, bottom, width, height } = \
         frame.getBoundingClientRect(); return [(x - left) / width, (bottom - y) / height]; }; \
         globalThis.part = (figure, name) => document.querySelector(`#axes figure.${figure} ${name}`); \
         globalThis.isAt = (of, end) => Math.abs(middle(of)[0] - middle(end)[0]) < 1; \
         globalThis.told = (figure) => part(figure, 'svg').getAttribute('aria-label'); 1";

    /// A board: the carriage goes with its axis and stands at the mark of its soft limit, the tool of a table is where both of
    /// its axes are, and a pointer turns.
    #[test]
    fn the_machine_moves_with_the_board() {
        let folder = tempfile::tempdir().expect("a folder");
        let machine = machine_file(folder.path(), MACHINE);
        let board = Serving::start("tcp", &["--link", SLAVES, "--machine", &machine]);
        let link = format!("tcp://{}", board.address());
        let web = Serving::start("web", &["--link", &link]);
        let mut browser = Browser::start();
        browser.open(web.address());
        browser.value(PLACES);
        let go = |target: &str| insist(&["move", target, "--up", "--link", &link]);

        go("Z=-5");
        browser.wait_for("isAt(part('linear', '.carriage'), document.querySelectorAll('#axes .linear .limit')[0])");
        go("Z=20");
        browser.wait_for("isAt(part('linear', '.carriage'), document.querySelectorAll('#axes .linear .limit')[1])");
        browser.wait_for("told('linear').startsWith('Z: 20.000 mm; limits of Z from -5 to 20 mm')");

        go("X=5");
        go("Y=10");
        let tool = "within(part('xy', '.carriage.tool'), part('xy', '.face'))";
        browser.wait_for(&format!("Math.abs({tool}[0] - 0.25) < 0.01 && Math.abs({tool}[1] - 1) < 0.02"));
        browser.wait_for("told('xy').startsWith('X: 5.000 mm; Y: 10.000 mm;')");

        go("C=90");
        browser.wait_for("part('rotary', '.carriage').style.transform === 'rotate(90deg)'");
        browser.wait_for("told('rotary').startsWith('C: 90.00 deg; limits of C from -90 deg')");

        // The bridge is askew while one side has gone on alone.
        let bridge = "within(part('gantry', '.carriage.tool'), part('gantry', '.face'))";
        go("B=2");
        go("G1=6");
        browser.wait_for(&format!("Math.abs({bridge}[0] - 0.375) < 0.01 && Math.abs({bridge}[1] - 0.5) < 0.02"));
        browser.wait_for("told('gantry').startsWith('G1: 6.000 mm; G2: 0.000 mm; B: 2.000 mm;')");
        browser.wait_for("told('gantry').includes('; G1 - G2: 6.000 mm; ')");
        go("G2=6");
        browser.wait_for(&format!("Math.abs({bridge}[0] - 0.75) < 0.01"));
        assert_eq!(browser.value("document.querySelectorAll('#axes figure').length"), 4);
        web.end();
        board.end();
    }

    /// A recording: the carriage is at the position of cursor A, else at that of the end of what is shown, and faintly at the
    /// target. An axis in alarm looks like one. Without a machine file a rail ends at round numbers around what was seen. The
    /// pictures fit a phone.
    #[test]
    fn the_machine_of_a_recording_is_at_the_cursor() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = recorded(folder.path());
        let html = folder.path().join("run.html");
        let machine = "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.001, min = 0, max = 10 }\n";
        let machine = machine_file(folder.path(), machine);
        let plot = |machine: &str| {
            let [file, html] = [&file, &html].map(|path| path.to_str().expect("UTF-8"));
            run(["plot", file, "--machine", machine, "-o", html]).expect_code(0);
        };
        plot(&machine);
        let mut browser = Browser::start();
        // Without transitions a carriage is at its place at once.
        let calm = serde_json::json!({"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]});
        browser.call("Emulation.setEmulatedMedia", calm);
        browser.open(&format!("file://{}", html.display()));
        browser.value(PLACES);
        browser.value(
            "globalThis.ends = [...document.querySelectorAll('#axes [data-slave=\"1\"]')][0].ownerSVGElement\
             .querySelectorAll('.limit'); \
             globalThis.along = (of) => (middle(of)[0] - middle(ends[0])[0]) / (middle(ends[1])[0] - middle(ends[0])[0]); \
             globalThis.one = (slave, name) => document.querySelector(`#axes ${name}[data-slave='${slave}']`); 1",
        );
        for (at_ns, counts) in dumped(&file).into_iter().skip(20).step_by(50) {
            browser.value(&format!("page.scope.setCursor('a', {at_ns} / 1e9)"));
            let along = browser.value("along(one(1, '.carriage'))").as_f64().expect("a number");
            let expected = counts as f64 / 10_000.0;
            assert!((along - expected).abs() < 0.005, "{along} and not {expected} at {at_ns} ns");
            let target = browser.value("page.store.value(1, 'target', page.moment) / 10").as_f64();
            let drawn =
                browser.value("one(1, '.target').classList.contains('unknown') ? null : along(one(1, '.target'))");
            match target {
                Some(target) => assert!((drawn.as_f64().expect("it is drawn") - target).abs() < 0.005, "{target}"),
                None => assert!(drawn.is_null(), "{drawn}"),
            }
        }
        let looks = "[...one(2, '.carriage').classList].includes('alarm') + ' ' + \
                     one(2, '.carriage').ownerSVGElement.getAttribute('aria-label')";
        browser
            .value("page.scope.setCursor('a', page.events.find((event) => event.kind === 'alarm').at_ns / 1e9 + 0.01)");
        let alarm = browser.value(looks);
        assert!(
            alarm.as_str().is_some_and(|text| text.starts_with("true slave 2: ") && text.contains("alarm 0x7305: ")),
            "{alarm}"
        );
        browser.value("page.scope.clearCursors(), page.scope.show({ from: 0.2, to: 0.5 })");
        let early = browser.value(looks);
        assert!(early.as_str().is_some_and(|text| text.starts_with("false slave 2: ")), "{early}");
        let shown = "Math.abs(along(one(1, '.carriage')) - page.store.value(1, 'position', 0.5) / 10) < 0.005";
        assert_eq!(browser.value(shown), true, "it is where the axis is at the end of what is shown");

        browser.press("m");
        assert_eq!(browser.value("document.querySelector('#machine').hidden"), true);
        browser.press("m");
        assert_eq!(browser.value("document.querySelector('#machine').hidden"), false);
        browser.press(" ");
        browser.wait_for("page.playing === undefined && Math.abs(page.scope.cursors.a - 0.5) < 1e-6");
        assert_eq!(browser.value(shown), true, "a recording that is played moves it to the end");
        let size = serde_json::json!({"width": 390, "height": 800, "deviceScaleFactor": 1, "mobile": true});
        browser.call("Emulation.setDeviceMetricsOverride", size);
        browser.wait_for("document.documentElement.clientWidth <= 390");
        assert_eq!(browser.value("document.documentElement.scrollWidth <= 390"), true);

        plot("none");
        browser.open(&format!("file://{}?again", html.display()));
        browser.value(PLACES);
        let ends = browser.value("page.machine.axis(1, 'light').reach");
        let (from, to) = (ends["from"].as_f64().expect("a number"), ends["to"].as_f64().expect("a number"));
        let seen: Vec<f64> = dumped(&file).into_iter().map(|(_, counts)| counts as f64).collect();
        assert!(from <= 0.0 && to >= seen.iter().copied().fold(0.0, f64::max) && to <= 20_000.0, "{from} {to}");
        assert_eq!(browser.value("document.querySelectorAll('#axes figure.linear').length"), 2);
        assert_eq!(browser.value("document.querySelectorAll('#axes .limit').length"), 0);
    }
}
