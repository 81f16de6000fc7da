//! The buttons of the page, in a browser.

use std::time::{Duration, Instant};

use serde_json::json;

use super::Machine;
use crate::common::page::Browser;

impl Browser {
    /// Presses or releases the mouse at the middle of the element.
    fn mouse(&mut self, kind: &str, element: &str) {
        let place = self.value(&format!(
            "(() => {{ const found = document.querySelector({element:?}); found.scrollIntoView({{ block: 'center' }}); \
             const box = found.getBoundingClientRect(); return [box.x + box.width / 2, box.y + box.height / 2]; }})()"
        ));
        self.call(
            "Input.dispatchMouseEvent",
            json!({
                "type": kind, "x": place[0], "y": place[1], "button": "left", "clickCount": 1,
                "buttons": u8::from(kind == "mousePressed"),
            }),
        );
    }

    fn click(&mut self, element: &str) {
        self.value(&format!("document.querySelector({element:?}).click()"));
    }

    fn in_control(machine: &Machine) -> Self {
        let mut browser = Self::start();
        browser.open(machine.web.address());
        browser.wait_for("document.querySelector('#control .hold') !== null");
        browser.value("[...document.querySelectorAll('#control p button')][1].click()");
        browser.wait_for("document.querySelector('#control .state').innerText.includes('This page has control')");
        browser.value("[...document.querySelectorAll('#control p button')][2].click()");
        browser.wait_for(
            "page.control.state.busy === null && document.querySelector('#control .texts').innerText.includes('configured')",
        );
        browser.click("[aria-label='On: slave 1']");
        browser.wait_for("document.querySelector('#control .texts').innerText.includes('axis 1: on')");
        browser
    }
}

const PLUS: &str = "[aria-label='Hold: slave 1 plus']";
const MINUS: &str = "[aria-label='Hold: slave 1 minus']";

/// An expression that becomes true when the page has control; it takes control if no page has it.
const HAS_CONTROL: &str = "page.control.holder === 'you' || \
                           (page.control.holder === 'none' && (page.control.takeButton.click(), false))";

/// Presses a button until axis 1 moves; `how` is for the message if it does not. A late machine ends the motion, or the
/// control; then the button is pressed again.
fn until_it_moves(machine: &Machine, browser: &mut Browser, how: &str, press: fn(&mut Browser, bool)) {
    support::tcp::until(how, || {
        browser.wait_for(HAS_CONTROL);
        let from = machine.position();
        press(browser, true);
        let began = Instant::now();
        while began.elapsed() < Duration::from_secs(3) {
            if machine.position().abs_diff(from) > 100 {
                return Some(());
            }
            browser.value("1");
        }
        press(browser, false);
        None
    });
}

fn plus(browser: &mut Browser, down: bool) {
    browser.mouse(if down { "mousePressed" } else { "mouseReleased" }, PLUS);
}

fn minus(browser: &mut Browser, down: bool) {
    browser.mouse(if down { "mousePressed" } else { "mouseReleased" }, MINUS);
}

fn space(browser: &mut Browser, down: bool) {
    browser.value(&format!("document.querySelector({PLUS:?}).focus()"));
    let key = json!({
        "type": if down { "keyDown" } else { "keyUp" }, "key": " ", "code": "Space", "windowsVirtualKeyCode": 32,
    });
    browser.call("Input.dispatchKeyEvent", key);
}

/// docs/SAFETY.md: an axis runs while its button is held by the mouse or a key, and stands when it is released, when
/// the page is hidden, and when the browser freezes or ends.
#[test]
fn a_button_of_the_page_moves_an_axis_while_it_is_held() {
    let machine = Machine::start();
    let mut browser = Browser::in_control(&machine);
    until_it_moves(&machine, &mut browser, "motion by the mouse", plus);
    browser.mouse("mouseReleased", PLUS);
    let there = machine.stands();
    assert!(there > 100);
    // The other way, while the first button still has the focus.
    browser.wait_for(HAS_CONTROL);
    browser.mouse("mousePressed", MINUS);
    assert_eq!(browser.value("page.control.hold?.is_positive"), false);
    browser.mouse("mouseReleased", MINUS);
    assert_eq!(browser.value("page.control.hold"), serde_json::Value::Null);
    until_it_moves(&machine, &mut browser, "motion the other way", minus);
    browser.mouse("mouseReleased", MINUS);
    assert!(machine.stands() < there);
    let there = machine.stands();

    until_it_moves(&machine, &mut browser, "motion by a key", space);
    browser.value("document.querySelector('#scope').focus()");
    assert!(machine.stands() > there);
    // The buttons are made anew while one is held: nobody would notice its release.
    until_it_moves(&machine, &mut browser, "motion before the buttons are made anew", plus);
    browser.value(
        "page.control.built = '', page.control.list(page.known.slaves, page.store.curves.map((c) => c.channel))",
    );
    machine.stands();
    browser.mouse("mouseReleased", PLUS);

    until_it_moves(&machine, &mut browser, "motion before the page is hidden", plus);
    browser.value(
        "Object.defineProperty(document, 'hidden', { value: true, configurable: true }), \
         document.dispatchEvent(new Event('visibilitychange'))",
    );
    machine.stands();
    browser.value("delete document.hidden, document.dispatchEvent(new Event('visibilitychange'))");
    browser.mouse("mouseReleased", PLUS);

    until_it_moves(&machine, &mut browser, "motion before the page freezes", plus);
    // A page that computes for ever answers no question.
    browser.value("setTimeout(() => { const end = Date.now() + 5000; while (Date.now() < end); }, 0), 1");
    machine.stands();
    browser.wait_for("document.querySelector('#control .texts').innerText.includes('has lost control')");
    browser.mouse("mouseReleased", PLUS);
    until_it_moves(&machine, &mut browser, "motion after control was taken again", plus);
    drop(browser);
    machine.stands();
    machine.end();
}

/// The page with its buttons keeps nobody out, and Escape stops. With ECMSK_BLESS=1 the test writes a picture of
/// docs/WEB.md.
mod needs_axe {
    use super::{Browser, HAS_CONTROL, Machine, plus, until_it_moves};

    #[test]
    fn the_buttons_are_open_to_all_and_escape_stops() {
        let machine = Machine::start();
        let mut browser = Browser::in_control(&machine);
        browser.wait_for("document.querySelector('[data-reading=\"1\"]').innerText.endsWith(' counts')");
        for theme in ["light", "dark"] {
            browser.value(&format!("page.setTheme('{theme}')"));
            browser.value("document.querySelectorAll('#control details').forEach((each) => { each.open = true; })");
            assert_eq!(browser.barriers(), [""; 0], "{theme}");
        }
        // Looking for barriers takes the page longer than it may be silent.
        browser.wait_for(HAS_CONTROL);
        // The question before an object is written names what is written. Who changes that is asked anew.
        browser.value(
            "globalThis.fields = document.querySelectorAll('#control input[type=text]'), \
             fields[0].value = '0x6081', fields[1].value = '1', \
             document.querySelector('[aria-label^=\"Write:\"]').click()",
        );
        browser.wait_for(
            "[...document.querySelectorAll('#control button')]\
             .some((button) => button.innerText === 'Write 0x6081 = 1 to slave 1 now?')",
        );
        browser.value("fields[1].value = '777', fields[1].dispatchEvent(new Event('input'))");
        assert_eq!(browser.value("document.querySelector('[aria-label^=\"Write now\"]')"), serde_json::Value::Null);
        if std::env::var_os("ECMSK_BLESS").is_some() {
            browser.value("page.setTheme('light')");
            browser.value("document.querySelectorAll('#control details').forEach((each) => { each.open = false; })");
            let picture = browser.picture();
            std::fs::write(support::root().join("docs/web_control.png"), picture).expect("it is written");
        }
        browser.click("[aria-label='Home: slave 1']");
        browser.wait_for("document.querySelector('[aria-label=\"Home now, a second click: slave 1\"]') !== null");
        assert!(
            !browser
                .value("document.querySelector('#control .texts').innerText")
                .as_str()
                .expect("text")
                .contains("home found")
        );
        // A double click is no second one.
        browser.click("[aria-label='Home now, a second click: slave 1']");
        std::thread::sleep(std::time::Duration::from_millis(600));
        assert_eq!(browser.value("page.control.state.busy"), serde_json::Value::Null);
        browser.click("[aria-label='Home now, a second click: slave 1']");
        browser.wait_for("document.querySelector('#control .texts').innerText.includes('home found')");
        until_it_moves(&machine, &mut browser, "motion before Escape", plus);
        // Also while a field has the focus.
        browser.value("page.control.speed.focus(), page.control.hold !== null || 'let go'");
        browser.press("Escape");
        machine.stands();
        browser.wait_for("document.querySelector('#control .texts').innerText.includes('axes stand still')");
        browser.wait_for("document.querySelector('#control .state').innerText.includes('No page has control')");
        machine.end();
    }
}
