//! The binary interface keeps what it had: exports, and the declarations of `include/ecmsk.h`, with sizes and offsets as a
//! C compiler sees them. The header is what cbindgen makes of the sources (`capi/tests/ecmsk_header.rs`).
//!
//! `surface/VERSION.txt` has the facts of each version. That of the present version grows; those of others are as they were
//! released, and are never written again. `cargo xtask semver` compares them with the tags of the releases.
#![cfg(target_os = "linux")]

mod needs_cxx {
    use std::collections::{BTreeMap, BTreeSet};
    use std::fmt::Write as _;
    use std::{env, fs};

    use object::read::elf::ElfFile64;
    use object::{Endianness, Object as _, ObjectSymbol as _, elf};
    use support::Language::C;
    use support::root;

    /// The declarations of `ecmsk.h`.
    #[derive(Default)]
    struct Header {
        values: Vec<String>,
        /// Names of types, each with its members: type, name. A type without members is opaque or another name of one.
        types: Vec<(String, Vec<(String, String)>)>,
        opaque: Vec<String>,
        functions: Vec<String>,
    }

    impl Header {
        fn read() -> Self {
            let text = fs::read_to_string(support::include_dir().join("ecmsk.h")).expect("the header");
            let mut header = Self::default();
            let mut code = String::new();
            let mut for_cpp = false;
            for line in without_comments(&text).lines() {
                match line.split_whitespace().collect::<Vec<_>>()[..] {
                    ["#define", name, _] => header.values.push(name.to_owned()),
                    ["#ifdef", "__cplusplus"] => for_cpp = true,
                    ["#endif", ..] => for_cpp = false,
                    [first, ..] if !first.starts_with('#') && !for_cpp => {
                        code.push_str(line);
                        code.push(' ');
                    }
                    _ => {}
                }
            }
            statements(&code).iter().for_each(|statement| header.take(statement));
            header
        }

        fn take(&mut self, statement: &str) {
            let Some(declared) = statement.strip_prefix("typedef ") else {
                return self.functions.push(statement.to_owned());
            };
            if let Some((members, name)) =
                declared.strip_prefix("struct {").and_then(|structure| structure.rsplit_once("} "))
            {
                let members = members.split(';').map(str::trim).filter(|member| !member.is_empty());
                let members = members.map(|member| member.rsplit_once(' ').expect("a type and a name"));
                let members = members.map(|(kind, name)| (kind.to_owned(), name.to_owned())).collect();
                return self.types.push((name.to_owned(), members));
            }
            let (kind, name) = declared.rsplit_once(' ').expect("a type and a name");
            if kind.starts_with("struct ") {
                self.opaque.push(name.to_owned());
            } else {
                self.types.push((name.to_owned(), Vec::new()));
            }
        }

        /// A program that prints values, sizes and offsets.
        fn probe(&self) -> String {
            let mut text = "#include \"ecmsk.h\"\n#include <stdio.h>\nint main(void)\n{\n".to_owned();
            for name in &self.values {
                writeln!(text, "    printf(\"value {name} %ld\\n\", (long)({name}));").expect("text");
            }
            for (name, members) in &self.types {
                writeln!(text, "    {{ struct aligned {{ char byte; {name} it; }}; {name} it;").expect("text");
                let align = "(unsigned long)offsetof(struct aligned, it)";
                writeln!(
                    text,
                    "    printf(\"type {name} aligned to %lu, %lu bytes\\n\", {align}, (unsigned long)sizeof it);"
                )
                .expect("text");
                for (kind, member) in members {
                    let name_alone = member.split('[').next().expect("a name");
                    writeln!(
                        text,
                        "    printf(\"  {name}.{name_alone}: {kind}, at %lu, %lu bytes\\n\", \
                         (unsigned long)offsetof({name}, {name_alone}), (unsigned long)sizeof it.{name_alone});"
                    )
                    .expect("text");
                }
                text.push_str("    }\n");
            }
            text.push_str("    return 0;\n}\n");
            text
        }
    }

    fn without_comments(text: &str) -> String {
        let mut rest = text;
        let mut code = String::new();
        while let Some((before, comment)) = rest.split_once("/*") {
            code.push_str(before);
            rest = comment.split_once("*/").expect("a comment ends").1;
        }
        code.push_str(rest);
        code
    }

    /// The statements of a header, each on one line with one blank between words.
    fn statements(code: &str) -> Vec<String> {
        let (mut found, mut begun, mut depth) = (Vec::new(), String::new(), 0);
        for letter in code.chars() {
            match letter {
                '{' => depth += 1,
                '}' => depth -= 1,
                ';' if depth == 0 => {
                    found.push(begun.split_whitespace().collect::<Vec<_>>().join(" "));
                    begun.clear();
                    continue;
                }
                _ => {}
            }
            begun.push(letter);
        }
        assert_eq!(begun.trim(), "", "the header ends with a statement");
        found
    }

    /// The facts of this build, one a line.
    fn facts() -> String {
        let bytes = fs::read(&support::library().shared).expect("the library");
        let file = ElfFile64::<Endianness>::parse(&*bytes).expect("an ELF file");
        let table = file.elf_dynamic_table().expect("a dynamic section");
        let soname = table.iter().find(|entry| entry.tag == elf::DT_SONAME).expect("a SONAME");
        let soname = String::from_utf8_lossy(table.string(soname).expect("a string")).into_owned();
        let exported: BTreeSet<&str> = file
            .dynamic_symbols()
            .filter(|symbol| symbol.is_definition())
            .map(|symbol| symbol.name().expect("a name"))
            .collect();

        let mut text = format!("soname {soname}\n");
        let list = fs::read_to_string(root().join("capi/exports.txt")).expect("capi/exports.txt");
        let list = list.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
        for (at, name) in list.filter(|name| exported.contains(name)).enumerate() {
            writeln!(text, "export {} {name}", at + 1).expect("text");
        }
        let header = Header::read();
        header.opaque.iter().for_each(|name| writeln!(text, "type {name} opaque").expect("text"));
        let source = support::out_dir().join("surface.c");
        fs::write(&source, header.probe()).expect("a file in the target folder");
        text.push_str(&support::compile(&source, C("c99")).run("sim:", [""; 0]).success());
        header.functions.iter().for_each(|function| writeln!(text, "function {function}").expect("text"));
        text
    }

    /// The version that is being made.
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    /// The facts of all versions, by the name of the version.
    fn all_kept() -> BTreeMap<String, String> {
        let folder = root().join("tests/capi/surface");
        let files = fs::read_dir(&folder).expect("tests/capi/surface").map(|entry| entry.expect("an entry").path());
        let kept: BTreeMap<String, String> = files
            .map(|file| {
                let version = file.file_stem().expect("a name").to_string_lossy().into_owned();
                (version, fs::read_to_string(&file).expect("facts"))
            })
            .collect();
        assert!(!kept.is_empty(), "no version has facts: take the files of {} back from git", folder.display());
        kept
    }

    /// The first version of which the facts `now` lack something, or have something else.
    fn broken<'a>(kept: &'a BTreeMap<String, String>, now: &str) -> Option<&'a str> {
        kept.iter().find(|(_, facts)| !has_only_additions(facts, now)).map(|(version, _)| &**version)
    }

    /// Whether `now` has all lines of `kept`, in their order. A structure may have grown.
    fn has_only_additions(kept: &str, now: &str) -> bool {
        let mut now = now.lines();
        kept.lines().all(|line| now.any(|new| new == line || has_grown(line, new)))
    }

    fn has_grown(kept: &str, now: &str) -> bool {
        matches!((size(kept), size(now)), (Some((one, kept)), Some((other, now))) if one == other && now > kept)
    }

    /// A structure with its alignment, and its size.
    fn size(line: &str) -> Option<(&str, u64)> {
        let (structure, size) = line.strip_prefix("type ")?.strip_suffix(" bytes")?.split_once(", ")?;
        Some((structure, size.parse().ok()?))
    }

    /// The surface of the C library has all that each version had, and nothing that the facts of the present one lack.
    /// `ECMSK_BLESS` writes additions to these alone, and refuses every other change: a program that was compiled before
    /// would break.
    #[test]
    fn the_surface_stays() {
        let (kept, now) = (all_kept(), facts());
        if let Some(version) = broken(&kept, &now) {
            panic!(
                "programs that were compiled against {version} break; take the change back, or give the library a new \
                 SONAME\n--- {version}\n{}\n--- now\n{now}",
                kept[version]
            );
        }
        if env::var_os("ECMSK_BLESS").is_some() {
            let path = root().join("tests/capi/surface").join(VERSION).with_added_extension("txt");
            fs::write(&path, &now).expect("the facts can be written");
            return;
        }
        assert!(
            kept.get(VERSION) == Some(&now),
            "there is something new since {VERSION}; if it is right run `ECMSK_BLESS=1 cargo test --test capi surface`\n\
             --- now\n{now}"
        );
    }

    /// What a released version had stays, whatever the facts of later versions say.
    #[test]
    fn a_release_binds_later_versions() {
        let facts = |lines: &str| lines.replace(' ', "\n") + "\n";
        let kept = |versions: &[(&str, &str)]| -> BTreeMap<String, String> {
            versions.iter().map(|(version, lines)| ((*version).to_owned(), facts(lines))).collect()
        };
        let released = kept(&[("0.1.0", "open close read")]);
        assert_eq!(broken(&released, &facts("open close read write")), None);
        assert_eq!(broken(&released, &facts("open read write")), Some("0.1.0"));
        let next = kept(&[("0.1.0", "open close read"), ("0.2.0", "open read write")]);
        assert_eq!(broken(&next, &facts("open read write")), Some("0.1.0"));
        assert_eq!(broken(&next, &facts("open close read")), Some("0.2.0"));
        assert_eq!(broken(&next, &facts("open close read write")), None);
    }

    /// No line of the facts may change or disappear, and none may come between members; additions at an end are
    /// allowed.
    #[test]
    fn what_breaks_programs_is_no_addition() {
        let kept = all_kept().remove(VERSION).expect("the facts of the present version");
        let lines: Vec<&str> = kept.lines().collect();
        assert!(lines.len() > 80, "{}", lines.len());
        for at in 0..lines.len() {
            let mut gone = lines.clone();
            gone.remove(at);
            assert!(!has_only_additions(&kept, &gone.join("\n")), "{}", lines[at]);
            let other = format!("{} or another", lines[at]);
            let mut changed = lines.clone();
            changed[at] = &other;
            assert!(!has_only_additions(&kept, &changed.join("\n")), "{}", lines[at]);
        }
        let stats = "type ecmsk_faults aligned to 8, 32 bytes";
        assert!(lines.contains(&stats), "{kept}");
        assert!(!has_only_additions(&kept, &kept.replace(stats, "type ecmsk_faults aligned to 8, 24 bytes")));
        assert!(!has_only_additions(&kept, &kept.replace(stats, "type ecmsk_faults aligned to 4, 32 bytes")));
        let grown = kept.replace(stats, "type ecmsk_faults aligned to 8, 40 bytes");
        assert!(has_only_additions(&kept, &format!("{grown}function void ecmsk_new(void)\n")));
    }
}
