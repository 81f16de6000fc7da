//! The pages of recordings and boards, tested in a browser (Chromium).

mod needs_chromium {
    use crate::common::page::{Browser, Serving, insist};
    use crate::common::run;
    use crate::plot_html::{dumped, recorded};

    /// The page of a recording in a browser: states in words, events, the values of the frames, cursors, the XY diagram, keys,
    /// and the width of a phone. Its policy allows its own scripts only, and it fetches nothing. With ECMSK_BLESS=1 the test
    /// writes the picture of docs/WEB.md.
    #[test]
    fn a_recording_is_shown_from_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = recorded(folder.path());
        let html = folder.path().join("run.html");
        let title = "Two axes, an alarm on the way";
        run(["plot", file.to_str().expect("UTF-8"), "--title", title, "-o", html.to_str().expect("UTF-8")])
            .expect_code(0);
        let mut browser = Browser::start();
        browser.open(&format!("file://{}", html.display()));

        let text = browser.value("document.body.innerText");
        let text = text.as_str().expect("a text");
        for words in ["Operation enabled", "Fault", "alarm 0x7305", "network: OP", "Following error (counts)"] {
            assert!(text.contains(words), "{words} is missing in {text}");
        }
        assert_eq!(browser.value("performance.getEntriesByType('resource').length"), 0, "it fetches nothing");

        for (at_ns, position) in dumped(&file).into_iter().skip(20).step_by(50) {
            let shown = browser.value(&format!("page.store.value(1, 'position', {at_ns} / 1e9)"));
            let shown = shown.as_f64().expect("a number");
            assert!((shown - position as f64).abs() < 0.01, "{shown} and not {position} at {at_ns} ns");
        }

        // Curves are drawn: the picture has pixels with a colour, which background and grid have not.
        let coloured = "(() => { const { plot } = page.scope.panels[0]; const { canvas } = plot.ctx; \
                        const { data } = plot.ctx.getImageData(0, 0, canvas.width, canvas.height); let n = 0; \
                        for (let i = 0; i < data.length; i += 4) \
                          n += data[i + 3] > 0 && Math.abs(data[i] - data[i + 2]) > 60; return n; })()";
        assert!(browser.value(coloured).as_u64().expect("a count") > 500);

        let whole = browser.value("page.scope.range.to - page.scope.range.from").as_f64().expect("seconds");
        browser.press("+");
        let closer = browser.value("page.scope.range.to - page.scope.range.from").as_f64().expect("seconds");
        assert!(closer < whole, "{closer} of {whole}");
        browser.press("a");
        browser.press("f");
        browser.press("b");
        browser.value("page.scope.setCursor('b', 0.65)");
        assert!(
            browser.value("document.querySelector('#readings').innerText").as_str().expect("a text").contains("B - A")
        );
        browser.press("x");
        assert_eq!(browser.value("document.querySelector('#xy').hidden"), false);
        browser.value("document.querySelector('#events button.alarm').click()");
        let marked = browser.value("page.scope.marked").as_f64().expect("seconds");
        let (from, to) = (browser.value("page.scope.range.from"), browser.value("page.scope.range.to"));
        assert!(from.as_f64() < Some(marked) && Some(marked) < to.as_f64(), "{marked}");
        let picture = browser.picture();
        let theme = browser.value("document.documentElement.dataset.theme");
        browser.press("t");
        assert_ne!(browser.value("document.documentElement.dataset.theme"), theme);
        // `saved(act)` returns the content (a Blob) that `act` would save as a file.
        browser.value(
            "globalThis.saved = (act) => new Promise((done) => { const old = URL.createObjectURL; \
             URL.createObjectURL = (blob) => { URL.createObjectURL = old; done(blob); return old(blob); }; act(); })",
        );
        let table = browser.value("saved(() => page.saveCsv()).then((blob) => blob.text())");
        let table = table.as_str().expect("a text");
        assert!(table.starts_with("time (s),slave 1 position (counts),") && table.lines().count() > 10, "{table}");
        let log = browser.value(
            "saved(() => page.saveMcap()).then((blob) => blob.arrayBuffer()) \
             .then((bytes) => Array.from(new Uint8Array(bytes), (byte) => byte.toString(16).padStart(2, '0')).join(''))",
        );
        assert_log_has_positions(log.as_str().expect("a text"), &dumped(&file));
        let size = browser.value("saved(() => page.savePng()).then((blob) => blob.type + ' ' + (blob.size > 10000))");
        assert_eq!(size, "image/png true");

        let size = serde_json::json!({"width": 390, "height": 800, "deviceScaleFactor": 1, "mobile": true});
        browser.call("Emulation.setDeviceMetricsOverride", size);
        browser.wait_for("document.documentElement.clientWidth <= 390");
        assert_eq!(
            browser.value("document.documentElement.scrollWidth <= 390"),
            true,
            "a phone shows all of its width"
        );
        assert!(picture.len() > 10_000);
        if std::env::var_os("ECMSK_BLESS").is_some() {
            std::fs::write(support::root().join("docs/web.png"), picture).expect("it is written");
        }
    }

    /// Asserts that an MCAP file, as hexadecimal digits, is whole and has these positions of slave 1, each at its time.
    #[track_caller]
    fn assert_log_has_positions(digits: &str, positions: &[(i64, i64)]) {
        let bytes = data_encoding::HEXLOWER.decode(digits.as_bytes()).expect("digits");
        let summary = mcap::Summary::read(&bytes).expect("a summary").expect("it is there");
        let statistics = summary.stats.expect("statistics");
        let topics: Vec<&str> = summary.channels.values().map(|channel| &*channel.topic).collect();
        for topic in ["/page/board", "/page/axis/1", "/page/axis/2"] {
            assert!(topics.contains(&topic), "{topic} is missing in {topics:?}");
        }
        let mut messages = 0;
        let mut found = std::collections::BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).expect("a log") {
            let message = message.expect("a message");
            messages += 1;
            let values: serde_json::Value = serde_json::from_slice(&message.data).expect("JSON");
            if let Some(position) = values["position"].as_f64().filter(|_| message.channel.topic == "/page/axis/1") {
                found.insert(message.log_time as i64, position);
            }
        }
        assert_eq!(messages, statistics.message_count);
        let (first, last) = (found.keys().next().expect("some"), found.keys().next_back().expect("some"));
        let mut compared = 0;
        for (at_ns, position) in positions.iter().filter(|(at_ns, _)| (first..=last).contains(&at_ns)) {
            // A point inside a run of equal values is left out, and the messages before and after it have that value.
            let Some((_, before)) = found.range(..=at_ns).next_back() else { continue };
            let exact = found.get(at_ns).unwrap_or(before);
            assert!((exact - *position as f64).abs() < 1e-6, "{exact}, not {position}, at {at_ns} ns");
            compared += 1;
        }
        assert!(compared > 100, "{compared}");
    }

    /// The page of a board in a browser shows what another program does, and stops at its trigger.
    #[test]
    fn a_board_is_shown_live() {
        let board = Serving::start("tcp", &["--link", "sim:?slaves=drive*2,io"]);
        let link = board.link();
        let web = Serving::start("web", &["--link", &link, "--find", "position(1) > 900"]);
        let mut browser = Browser::start();
        browser.open(web.address());
        browser.wait_for("document.querySelector('#board').innerText.includes('PreOP')");
        insist(&["home", "1", "--up", "--link", &link]);
        browser.wait_for("document.querySelector('#slaves').innerText.includes('Operation enabled')");
        browser.wait_for("page.events.some((event) => event.text === 'Operation enabled')");
        for outputs in ["0x1", "0x0"] {
            insist(&["io", "3", "--set", outputs, "--link", &link]);
            browser
                .wait_for(&format!("page.store.value(3, 'output', page.store.to) === {}", u8::from(outputs == "0x1")));
        }
        browser.value(
            "document.querySelector('#span').value = '1', \
             document.querySelector('#span').dispatchEvent(new Event('change')), \
             document.querySelector('#trigger-channel').value = 'slave 3 out 0', \
             document.querySelector('#trigger-level').value = '0.5', document.querySelector('#arm').click()",
        );
        insist(&["io", "3", "--set", "0x1", "--link", &link]);
        browser.wait_for("document.querySelector('#trigger-state').innerText.startsWith('fired at')");
        assert_eq!(browser.value("page.store.value(3, 'output', page.scope.marked)"), 1);
        assert_eq!(browser.value("page.store.value(3, 'output', page.scope.marked - 1e-6)"), 0);
        assert_eq!(browser.value("page.paused"), true);
        // Half of the second that is shown is before the trigger.
        let shown = "['from', 'to'].map((end) => Math.round((page.scope.range[end] - page.scope.marked) * 1000))";
        assert_eq!(browser.value(shown), serde_json::json!([-500, 500]));
        browser
            .value("document.querySelector('#trigger-kind').value = 'found', document.querySelector('#arm').click()");
        insist(&["move", "1=1000", "--link", &link]);
        browser.wait_for("document.querySelector('#trigger-state').innerText.startsWith('fired at')");
        let position = browser.value("page.store.value(1, 'position', page.scope.marked)").as_f64().expect("a number");
        assert!(position > 900.0 && position <= 1000.0, "{position}");
        let counters = browser.value("document.querySelector('#counters').innerText");
        assert!(counters.as_str().expect("a text").contains("reports lost\t"), "{counters}");
        // Of the events of a day only the newest stay.
        let many = "page.message({ type: 'events', events: Array.from({ length: 6000 }, (_, i) => \
                    ({ at_ns: 0, slave: 0, kind: 'drive', text: `event ${i}` })) })";
        browser.value(many);
        assert_eq!(browser.value("page.events.length"), 5000);
        assert_eq!(browser.value("page.events.at(-1).text"), "event 5999");
        web.end();
        browser.wait_for("document.querySelector('#notes').innerText.includes('not connected')");
        board.end();
    }

    /// docs/WEB.md: a panel with many curves has few points, and for all curves the same times.
    #[test]
    fn many_axes_are_drawn_with_few_points() {
        let web = Serving::start("web", &["--link", "sim:?slaves=drive*40"]);
        let mut browser = Browser::start();
        browser.open(web.address());
        browser.wait_for("document.querySelector('#board').innerText.includes('PreOP')");
        // The server is gone: what comes now comes from the test.
        web.end();
        browser.wait_for("document.querySelector('#notes').innerText.includes('not connected')");
        browser.value(
            "page.store.setChannels([...page.store.curves.map((curve) => curve.channel), ...Array.from({ length: 40 }, (_, i) => \
                ({ slave: i + 1, quantity: 'position', bit: 0, factor: 1, unit: '', held: false }))]), \
             page.store.curves.filter((curve) => curve.channel.quantity === 'position').forEach((curve, axis) => { \
                curve.length = 20000; \
                curve.times = Float64Array.from({ length: 20000 }, (_, i) => i / 1000); \
                curve.values = curve.times.map((at) => Math.sin(at * (axis + 1)) * 1000); \
            }), page.store.from = 0, page.store.to = 20, page.scope.show({ from: 0, to: 20 })",
        );
        let seen = browser.value(
            "(() => { const { plot, curves } = page.scope.panels[0]; \
              return [curves.length, plot.data[0].length, Math.max(...plot.data[40]), page.scope.root.clientWidth]; })()",
        );
        let [curves, times, greatest, width] = [0, 1, 2, 3].map(|place| seen[place].as_f64().expect("a number"));
        assert_eq!(curves, 40.0, "{seen}");
        assert!(times > width / 2.0 && times <= width + 4.0, "{seen}");
        assert!(greatest > 999.0, "{seen}");
    }

    /// The memory that the page uses, bytes: its objects, and the points outside of them; and the nodes of its document.
    fn used(browser: &mut Browser) -> (f64, f64) {
        browser.call("HeapProfiler.collectGarbage", serde_json::json!({}));
        let heap = browser.call("Runtime.getHeapUsage", serde_json::json!({}));
        let nodes = browser.call("Memory.getDOMCounters", serde_json::json!({}))["nodes"].as_f64().expect("a count");
        let bytes = ["usedSize", "backingStorageSize"].map(|name| heap[name].as_f64().expect("bytes"));
        (bytes.iter().sum(), nodes)
    }

    /// docs/WEB.md: a live page keeps 10 minutes of points and the newest 5000 events. So its memory is the same after 24
    /// virtual hours as after 8, when there have been more than 5000 events.
    #[test]
    fn a_day_does_not_grow_a_live_page() {
        let web = Serving::start("web", &["--link", "sim:?slaves=drive"]);
        let mut browser = Browser::start();
        browser.open(web.address());
        // The server is gone: what comes now comes from the test.
        web.end();
        browser.wait_for("document.querySelector('#notes').innerText.includes('not connected')");
        browser.value(include_str!("../../web/tests/day_in_browser.js"));
        let mut at = |from: u32, to: u32| {
            let seen = browser.value(&format!("hours({from}, {to})"));
            let [first, last, events] = [0, 1, 2].map(|place| seen[place].as_f64().expect("a number"));
            assert!((last - f64::from(to * 3600)).abs() < 1.0 && events == 5000.0, "{seen}");
            assert!(last - first <= 661.0, "{seen}: 10 minutes and a tenth");
            used(&mut browser)
        };
        let ((eight, eight_nodes), (day, day_nodes)) = (at(0, 8), at(8, 24));
        assert!(day <= eight * 1.05, "{day} bytes after a day, {eight} after 8 hours");
        assert!(day_nodes <= eight_nodes * 1.05, "{day_nodes} nodes after a day, {eight_nodes} after 8 hours");
        assert_ne!(browser.value("document.querySelector('#slaves').innerText"), "");
    }
}

mod needs_axe {
    use serde_json::json;

    use crate::common::page::{Browser, Serving, insist};
    use crate::common::run;
    use crate::plot_html::recorded;

    /// An axis on a rail with limits, two of a table, and one that turns.
    const MACHINE: &str = r#"
format = 1

[slaves.5]
kind = "io"

[axes]
X = { slave = 1, unit = "mm", per = 0.001, min = 0, max = 20 }
Y = { slave = 2, unit = "mm", per = 0.001, min = 0, max = 10 }
Z = { slave = 3, unit = "mm", per = 0.001, min = -5, max = 20 }
C = { slave = 4, unit = "deg", per = 0.01, min = -90, max = 90 }

[picture]
xy = [["X", "Y"]]
"#;

    /// Asserts that nothing keeps people out of the page, light and dark, and at the width of a phone.
    #[track_caller]
    fn assert_open_to_all(browser: &mut Browser, what: &str) {
        for theme in ["light", "dark"] {
            browser.value(&format!("page.setTheme('{theme}')"));
            assert_eq!(browser.barriers(), [""; 0], "{what}, {theme}");
        }
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            json!({"width": 390, "height": 800, "deviceScaleFactor": 1, "mobile": true}),
        );
        browser.wait_for("document.documentElement.clientWidth <= 390");
        assert_eq!(browser.barriers(), [""; 0], "{what}, on a phone");
        browser.call("Emulation.clearDeviceMetricsOverride", json!({}));
    }

    /// The page of a recording with all that it can show: cursors, the XY diagram, a curve that is hidden, an event that is
    /// chosen, an axis in alarm, and the dialog with the keys.
    #[test]
    fn the_page_of_a_recording_is_open_to_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = recorded(folder.path());
        let html = folder.path().join("run.html");
        run(["plot", file.to_str().expect("UTF-8"), "-o", html.to_str().expect("UTF-8")]).expect_code(0);
        let mut browser = Browser::start();
        browser.open(&format!("file://{}", html.display()));
        assert_open_to_all(&mut browser, "as it is opened");
        browser.value(
            "page.nextPlane(), document.querySelector('#events button.alarm').click(), \
             page.scope.setCursor('a', 0.62), page.scope.setCursor('b', 0.65)",
        );
        browser.value("page.scope.hidden.add(page.store.find(1, 'target')), page.scope.build(), page.scope.refresh()");
        assert_eq!(browser.value("document.querySelectorAll('.legend [aria-pressed=false]').length"), 1);
        assert_eq!(browser.value("document.querySelector('#axes .alarm') !== null"), true);
        assert_open_to_all(&mut browser, "with all that it can show");
        browser.value("document.querySelector('#help').showModal()");
        assert_open_to_all(&mut browser, "with its keys");
    }

    /// The page of a board, with its trigger, counters, limits and a dial.
    #[test]
    fn a_live_page_is_open_to_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let machine = folder.path().join("m.toml");
        std::fs::write(&machine, MACHINE).expect("a file");
        let machine = machine.to_str().expect("UTF-8");
        let board = Serving::start("tcp", &["--link", "sim:?slaves=drive*4,io", "--machine", machine]);
        let link = board.link();
        let web = Serving::start("web", &["--link", &link]);
        let mut browser = Browser::start();
        browser.open(web.address());
        insist(&["move", "Z=1", "--up", "--link", &link]);
        insist(&["io", "5", "--set", "0x1", "--link", &link]);
        browser.wait_for("page.store.value(5, 'output', page.store.to) === 1");
        browser.wait_for("document.querySelector('#counters').innerText.includes('reports lost')");
        browser.wait_for("['linear', 'xy', 'rotary'].every((kind) => document.querySelector(`#axes .${kind}`))");
        assert_open_to_all(&mut browser, "as it is opened");
        browser.value(
            "page.nextPlane(), document.querySelector('#arm').click(), \
             document.querySelector('#events button').click()",
        );
        assert_eq!(browser.value("page.paused"), true);
        assert_open_to_all(&mut browser, "with all that it can show");
        web.end();
        board.end();
    }
}
