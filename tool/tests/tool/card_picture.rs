//! The picture of docs/NIC.md: the program of README's picture on a simulated board, in virtual time, and beside it on a
//! network card with slaves at its end. The real-time run differs a little each time, so a new run is compared with the kept
//! picture by its meaning. The rest of the picture must be exactly what the tool draws.
#![cfg(target_os = "linux")]

mod needs_cxx {
    mod needs_network_namespace {
        use std::collections::BTreeSet;
        use std::env;
        use std::fs;
        use std::os::unix::fs::symlink;
        use std::path::Path;
        use std::process::Command;

        use support::examples::VIRTUAL;
        use support::{Language, root};

        use crate::common::ecmsk;
        use crate::common::svg::{Plot, STATES};

        /// The shell script of the demo that makes a pair of network cards and runs a program on simulated slaves: $1 is the
        /// tool, $2 the program.
        const ON_A_CARD: &str = "
ip link add veth0 type veth peer name veth1
ip link set veth0 up
ip link set veth1 up
$1 serve ethercat --on veth1 --slaves 'drive*2' --priority 10 \
    --script examples/scripts/alarm_on_the_way_on_a_wire.ecmscript > slaves.log 2>&1 &
slaves=$!
trap 'kill $slaves' EXIT
tries=0
until grep -q answering slaves.log || [ $tries = 100 ]; do sleep 0.05; tries=$((tries + 1)); done
$2
";
        /// The colour of the run on the network card.
        const BESIDE: &str = "#202020";
        const ALARM: &str = "alarm 0x7500: communication, nic:veth0";
        /// The picture ends before either run does, so that its scale does not depend on real time.
        const END: &str = "4.3s";
        /// The tolerance of a coordinate, in the picture's units of a quarter of a pixel. If the scale differs by some counts,
        /// coordinates are rounded to other numbers.
        const ROUNDED: f64 = 2.0;
        /// How near a curve has to come to a value, in counts, to count as having reached it.
        const NEAR: f64 = 12_000.0;

        fn draw(folder: &Path) -> String {
            symlink(root().join("examples"), folder.join("examples")).expect("a symbolic link");
            let program = support::compile(&root().join("examples/cpp/alarm_recovery.cpp"), Language::Cpp("c++17"));
            let script = "script=examples/scripts/alarm_on_the_way.ecmscript";
            let board = format!("{VIRTUAL}&{script}&record=two_axes.pcapng");
            support::succeed(program.command(&board).current_dir(folder));
            let card = program.command("nic:veth0?priority=20&record=on_a_card.pcapng");
            let mut run = Command::new("unshare");
            run.args(["--net", "sh", "-euc", ON_A_CARD, "sh", env!("CARGO_BIN_EXE_ecmsk")]).arg(card.get_program());
            run.envs(card.get_envs().filter_map(|(name, value)| Some((name, value?))));
            support::succeed(run.current_dir(folder));
            let arguments = ["plot", "two_axes.pcapng", "--beside", "on_a_card.pcapng", "--to", END, "-o", "-"];
            support::succeed(ecmsk(arguments).current_dir(folder))
        }

        /// The time, later than `after`, at which the curve of an axis in the card's run first comes near a value; both times
        /// are in seconds.
        fn comes(plot: &Plot, axis: u8, value: f64, after: f64) -> f64 {
            let samples = plot.panel(&format!("Axis {axis}")).samples(BESIDE, false);
            let first = samples.iter().find(|(at, is)| *at > after && (is - value).abs() < NEAR);
            first.unwrap_or_else(|| panic!("axis {axis} never comes to {value}")).0
        }

        /// Checks that on the card both axes home and move along the square, and that drive 2 has its alarm on the
        /// second side.
        fn assert_way(svg: &str) {
            let plot = Plot::parse(svg);
            for axis in [1, 2] {
                let samples = plot.panel(&format!("Axis {axis}")).samples(BESIDE, false);
                let lowest = samples.iter().map(|(_, value)| *value).fold(0.0, f64::min);
                // The vertical axis of the picture fits the motion after homing. The lowest point that it shows is on the way
                // to the negative limit switch, most of which is outside of the picture.
                assert!((-200_000.0..-50_000.0).contains(&lowest), "its negative limit switch: {lowest}");
            }
            let home = [1, 2].map(|axis| comes(&plot, axis, 0.0, 1.5));
            let second = comes(&plot, 1, 1_000_000.0, home[0].max(home[1]));
            let third = comes(&plot, 2, 1_000_000.0, second);
            comes(&plot, 1, 0.0, third);
            let panel = plot.panel("Axis 2");
            let alarm = panel.notes().into_iter().find(|(_, text)| *text == ALARM).expect("it is told").0;
            assert!(second < alarm && alarm < third, "at {second}, {alarm} and {third} s");
        }

        /// An element of a picture: its name with its text, its attributes of style, and its attributes with coordinates.
        #[derive(Clone, Debug, PartialEq)]
        struct Element {
            name: String,
            look: Vec<(String, String)>,
            places: Vec<(String, String)>,
        }

        impl Element {
            /// All elements of a picture: first those of the card's run, then all others.
            fn all(svg: &str) -> (Vec<Self>, Vec<Self>) {
                let document = roxmltree::Document::parse(svg).expect("well-formed XML");
                let elements = document.descendants().filter(|node| node.is_element()).map(|node| {
                    let text = node.text().unwrap_or_default().trim();
                    let attributes = node.attributes().map(|one| (one.name().to_owned(), one.value().to_owned()));
                    let (places, look) = attributes.partition(|(name, _)| is_place(name));
                    Self { name: format!("{} {text}", node.tag_name().name()), look, places }
                });
                let elements: Vec<Self> = elements.collect();
                let has = |element: &Self, name: &str, colour: &str| {
                    element.look.iter().any(|(other, value)| other == name && value == colour)
                };
                // Both runs have a shaded area where drive 2 has its fault. That of the card's run is drawn later, so it is the
                // last one.
                let fault = elements.iter().rposition(|element| has(element, "fill", STATES[0]));
                let is_of_card = |(n, element): &(usize, Self)| {
                    element.name.ends_with(ALARM) || has(element, "stroke", BESIDE) || Some(*n) == fault
                };
                let (card, others): (Vec<_>, Vec<_>) = elements.into_iter().enumerate().partition(is_of_card);
                [card, others].map(|part| part.into_iter().map(|(_, element)| element).collect()).into()
            }

            fn is_near(&self, now: &Self) -> bool {
                let are_near = |((name, kept), (other, now)): (&(String, String), &(String, String))| {
                    name == other && are_near(kept, now)
                };
                self.places.len() == now.places.len() && self.places.iter().zip(&now.places).all(are_near)
            }
        }

        /// Why two pictures differ by more than the card's run; `None`: they do not.
        fn difference(kept: &str, now: &str) -> Option<String> {
            if kept.is_empty() {
                return Some("there is none".to_owned());
            }
            let ((kept_card, kept), (now_card, now)) = (Element::all(kept), Element::all(now));
            // The curves of the card's run have gaps where the program was late, so their number differs in each run. Only
            // which styles occur is compared.
            let looks = |card: &[Element]| {
                let looks = card.iter().map(|one| format!("{} {:?}", one.name, one.look));
                looks.collect::<BTreeSet<String>>()
            };
            if looks(&kept_card) != looks(&now_card) || kept.len() != now.len() {
                return Some(format!("{:?}, and now {:?}", looks(&kept_card), looks(&now_card)));
            }
            let mut both = kept.iter().zip(&now);
            let other = both.find(|(kept, now)| kept.name != now.name || kept.look != now.look || !kept.is_near(now));
            other.map(|(kept, now)| format!("{kept:?}, and now {now:?}"))
        }

        fn is_place(attribute: &str) -> bool {
            ["x", "y", "x1", "y1", "x2", "y2", "width", "height", "points"].contains(&attribute)
        }

        /// Whether two texts have equally many coordinates, which differ by at most [`ROUNDED`].
        fn are_near(kept: &str, now: &str) -> bool {
            let places = |text: &str| text.split([' ', ',']).flat_map(str::parse).collect::<Vec<f64>>();
            let (kept, now) = (places(kept), places(now));
            kept.len() == now.len() && kept.iter().zip(&now).all(|(kept, now)| (kept - now).abs() <= ROUNDED)
        }

        /// The picture of docs/NIC.md is what the tool draws for that program, except the real-time run. That one
        /// homes, moves along the square and has its alarm on the second side.
        #[test]
        fn the_picture_of_nic_is_what_the_demo_draws() {
            let folder = tempfile::tempdir().expect("a folder");
            let now = draw(folder.path());
            let file = root().join("docs/on_a_card.svg");
            let why = difference(&fs::read_to_string(&file).unwrap_or_default(), &now);
            if why.is_some() && env::var_os("ECMSK_BLESS").is_some() {
                assert_way(&now);
                fs::write(&file, &now).expect("the file can be written");
            } else if let Some(why) = why {
                panic!("{} differs; if that is right run the test with ECMSK_BLESS=1: {why}", file.display());
            }
            assert!(Plot::parse(&now).texts().contains(&ALARM), "the alarm came");
            assert_way(&fs::read_to_string(&file).expect("the picture"));
        }
    }
}
