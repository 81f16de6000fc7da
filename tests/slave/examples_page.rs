//! docs/SLAVES.md claims no more about the examples of other masters than is known.

/// The last column of each row has its evidence; a row with a test as evidence has its maps in `maps.rs`.
#[test]
fn each_row_says_how_it_is_known() {
    let page = std::fs::read_to_string(support::root().join("docs/SLAVES.md")).expect("the page");
    let section = page.split("### Their examples").nth(1).expect("the section").split("\n#").next().expect("its end");
    let cells = |row: &str| row.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let rows: Vec<_> = section.lines().filter(|line| line.starts_with("| ")).skip(2).map(cells).collect();
    assert!(rows.len() > 10, "{rows:?}");
    let maps = include_str!("maps.rs");
    for row in &rows {
        let [example, known] = [&row[1], &row[row.len() - 2]];
        match known.as_str() {
            "by hand" => {
                assert!(example.contains(|c: char| c.is_ascii_digit()) || example.contains("KickCAT"), "{example}")
            }
            "test" => {
                let is_there =
                    ["ec400", "IgH", "ROS 2"].iter().any(|name| example.contains(name) && maps.contains(name));
                assert!(is_there, "{example}");
            }
            other => assert_eq!(other, "source", "{example}"),
        }
    }
}
