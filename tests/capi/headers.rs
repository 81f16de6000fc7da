//! The headers in `include/`: valid C and C++, with the numbers, sizes and prototypes that programs rely on.
#![cfg(unix)]

mod needs_cxx {

    use ecmsk::cia402::Mode;
    use ecmsk::sk::{DriveSync, MasterState, SlaveKind, SlotSize, StateByte};
    use std::collections::BTreeMap;
    use std::fmt::Write as _;
    use std::fs;
    use std::path::PathBuf;
    use support::Language::{self, C, Cpp};

    const VENDOR_HEADERS: [(&str, SlotSize); 3] = [
        ("NEXTWUSBLib.h", SlotSize::Bytes12),
        ("NEXTWUSBLib_12B.h", SlotSize::Bytes12),
        ("NEXTWUSBLib_16B.h", SlotSize::Bytes16),
    ];
    /// The commands in the headers, which are frozen: a later command of the board is not in them.
    const COMMANDS: [&str; 22] = [
        "GET_STATUS",
        "SET_STATE",
        "SET_AXIS",
        "SET_DC",
        "SET_EX",
        "SET_FIFO",
        "DRIVE_MODE",
        "SDO_RD",
        "SDO_WR",
        "ALM_CLR",
        "SV_ON",
        "SV_OFF",
        "IO_RD",
        "IO_WR",
        "CSP",
        "CSV",
        "CST",
        "GO_HOME",
        "ABORT_HOME",
        "LIO_RD",
        "LIO_WR",
        "SW_RESET",
    ];
    const LANGUAGES: [Language; 7] =
        [C("c99"), C("c11"), C("c17"), Cpp("c++98"), Cpp("c++11"), Cpp("c++17"), Cpp("c++20")];

    /// Writes a source into the test's folder.
    fn source(name: &str, language: Language, text: &str) -> PathBuf {
        let extension = if matches!(language, C(_)) { "c" } else { "cpp" };
        let path = support::out_dir().join(format!("{name}.{extension}"));
        fs::write(&path, text).expect("a file in the target folder");
        path
    }

    fn name_of(header: &str, language: Language) -> String {
        let (C(standard) | Cpp(standard)) = language;
        format!("{}-{}", header.replace('.', "_"), standard.replace('+', "p"))
    }

    /// Every macro of a vendor header with its number: the commands of the guide, and this project's own constants.
    fn macros(size: SlotSize) -> BTreeMap<String, u32> {
        let mut macros = BTreeMap::new();
        let mut put = |name: &str, value: u32| assert_eq!(macros.insert(name.to_owned(), value), None, "{name} twice");
        put("DEF_MA_MAX", size.slots() as u32);
        put("NIC_INIT", StateByte::NETWORK_INIT.0.into());
        for (name, state) in [
            ("STATE_INIT", MasterState::Init),
            ("STATE_PRE_OP", MasterState::PreOp),
            ("STATE_SAFE_OP", MasterState::SafeOp),
            ("STATE_OPERATIONAL", MasterState::Op),
        ] {
            put(name, state.code().into());
        }
        for (code, name, ..) in support::guide::TABLE.iter().filter(|(_, name, ..)| COMMANDS.contains(name)) {
            put(name, (*code).into());
        }
        for (name, mode) in
            [("HOMING_MODE", Mode::Homing), ("CSP_MODE", Mode::Csp), ("CSV_MODE", Mode::Csv), ("CST_MODE", Mode::Cst)]
        {
            put(name, mode.code().into());
        }
        for (name, sync) in [("FREERUN", DriveSync::FreeRun), ("DCSYNC", DriveSync::DcSync)] {
            put(name, sync as u32);
        }
        for kind in [SlaveKind::Drive, SlaveKind::Io, SlaveKind::Hsp, SlaveKind::Step, SlaveKind::None] {
            put(kind.name(), kind.nibble().into());
        }
        macros
    }

    /// The members of `transData`: name, size, offset.
    fn members(size: SlotSize) -> Vec<(&'static str, usize, usize)> {
        let mut members = vec![("CMD", 2, 0), ("Parm", 2, 2), ("Data1", 4, 4), ("Data2", 4, 8)];
        if size == SlotSize::Bytes16 {
            members.push(("Data3", 4, 12));
        }
        members
    }

    /// A program that prints every number of a header and does not compile if a prototype differs.
    fn probe(header: &str, size: SlotSize) -> String {
        let mut text = format!("#include \"{header}\"\n#include <stddef.h>\n#include <stdio.h>\n");
        text.push_str(
            "bool (*open_it)(void) = OpenECMUSB;\n\
         void (*close_it)(void) = CloseECMUSB;\n\
         bool (*write_it)(unsigned char *, unsigned long) = ECMUSBWrite;\n\
         bool (*read_it)(unsigned char *, unsigned long) = ECMUSBRead;\n\
         static transData slots[DEF_MA_MAX];\n\
         static struct transData one;\n\
         int main(void)\n{\n",
        );
        for name in macros(size).keys() {
            writeln!(text, "    printf(\"{name} %lu\\n\", (unsigned long)({name}));").expect("text");
        }
        for (name, ..) in members(size) {
            writeln!(
                text,
                "    printf(\"{name} %lu %lu %d\\n\", (unsigned long)sizeof one.{name}, \
             (unsigned long)offsetof(struct transData, {name}), (one.{name} = 0, --one.{name} > 0));"
            )
            .expect("text");
        }
        text.push_str(
        "    printf(\"sizeof %lu %lu %lu\\n\", (unsigned long)sizeof one, (unsigned long)sizeof slots, (unsigned long)sizeof(bool));\n\
         \x20   return 0;\n}\n",
    );
        text
    }

    /// The expected output of the program.
    fn expected(size: SlotSize) -> String {
        let mut text = String::new();
        for (name, value) in macros(size) {
            writeln!(text, "{name} {value}").expect("text");
        }
        for (name, bytes, offset) in members(size) {
            // 1: the member is unsigned.
            writeln!(text, "{name} {bytes} {offset} 1").expect("text");
        }
        writeln!(text, "sizeof {} {} 1", size.bytes(), size.frame_len()).expect("text");
        text
    }

    /// LIB-1, LIB-4, LIB-8, LIB-9, LIB-13, LIB-14, LIB-15, LIB-16, LIB-17, LIB-18, LIB-19 The three vendor headers compile without a
    /// warning in every standard of C and C++ and mean what the wire format means; SK-1.6 the members have the library's names.
    #[test]
    fn vendor_headers_have_the_numbers_and_prototypes_of_the_wire_format() {
        for (header, size) in VENDOR_HEADERS {
            for language in LANGUAGES {
                let name = name_of(header, language);
                let program = support::compile(&source(&name, language, &probe(header, size)), language);
                assert_eq!(program.run("sim:", [""; 0]).success(), expected(size), "{name}");
            }
        }
    }

    /// LIB-13, LIB-14, LIB-15, LIB-16, LIB-17 A vendor header defines the macros that programs know, and no others that
    /// could conflict.
    #[test]
    fn vendor_headers_define_nothing_else() {
        for (header, size) in VENDOR_HEADERS {
            let text = fs::read_to_string(support::include_dir().join(header)).expect("the header");
            let defined =
                text.lines().filter_map(|line| line.strip_prefix("#define ")).filter_map(|line| line.split(' ').next());
            let mut own: Vec<&str> = defined.filter(|name| !macros(size).contains_key(*name)).collect();
            own.dedup();
            assert_eq!(own, [format!("NEXTWUSBLIB_{}B_H", size.bytes()).as_str(), "NEXTWUSB_CALL"], "{header}");
        }
    }

    /// LIB-9 `NEXTWUSBLib.h` is the 12-byte header under another name; a program may include both.
    #[test]
    fn the_header_of_the_guides_samples_is_the_12_byte_one() {
        let read = |header| fs::read_to_string(support::include_dir().join(header)).expect("the header");
        assert_eq!(read("NEXTWUSBLib.h"), read("NEXTWUSBLib_12B.h"));
        let both = "#include \"NEXTWUSBLib.h\"\n#include \"NEXTWUSBLib_12B.h\"\nint main() { return 0; }\n";
        support::compile(&source("both", Cpp("c++98"), both), Cpp("c++98"));
    }

    /// LIB-18 The two slot sizes cannot be mixed in one source: it does not compile, and the error states the reason.
    #[test]
    fn both_slot_sizes_in_one_source_are_refused() {
        let mixed = "#include \"NEXTWUSBLib_12B.h\"\n#include \"NEXTWUSBLib_16B.h\"\n";
        let path = source("mixed", C("c99"), mixed);
        let output = C("c99").compiler().arg("-fsyntax-only").arg(path).output().expect("the compiler runs");
        assert!(!output.status.success());
        assert!(String::from_utf8_lossy(&output.stderr).contains("not both"), "{output:?}");
    }

    /// LIB-19 Off Windows no calling convention is left; on Windows the functions are __stdcall and declared without dllimport.
    #[test]
    fn calling_conventions_are_windows_own() {
        for (header, _) in VENDOR_HEADERS {
            let path = support::include_dir().join(header);
            let preprocess = |defines: &[&str]| {
                let mut compiler = Cpp("c++17").compiler();
                support::succeed(compiler.args(defines).args(["-E", "-P", "-x", "c++"]).arg(&path))
            };
            let here = preprocess(&["-U_WIN32"]);
            assert!(here.contains("bool OpenECMUSB(void);"), "{here}");
            assert!(!here.contains("__stdcall"), "{here}");
            let windows = preprocess(&["-D_WIN32"]);
            for prototype in [
                "bool __stdcall OpenECMUSB(void);",
                "void __stdcall CloseECMUSB(void);",
                "bool __stdcall ECMUSBWrite(unsigned char *data, unsigned long dwlength);",
                "bool __stdcall ECMUSBRead(unsigned char *data, unsigned long dwlength);",
            ] {
                assert!(windows.contains(prototype), "{prototype}\n{windows}");
            }
            assert!(windows.contains("extern \"C\""), "{windows}");
            assert!(!windows.contains("dllimport"), "{windows}");
        }
    }

    /// LIB-19 `ecmsk.h` compiles without a warning in every standard, also beside a vendor header, and its structures
    /// begin with their size.
    #[test]
    fn the_header_of_our_own_functions_compiles_everywhere() {
        let text = "#include \"NEXTWUSBLib_12B.h\"\n#include \"ecmsk.h\"\n#include <stdio.h>\n\
        int main(void)\n{\n    ecmsk_stats stats;\n    ecmsk_counters counters;\n    ecmsk_axis axis;\n\
        \x20   printf(\"%d %d %d\\n\", (char *)&stats.size == (char *)&stats, (char *)&counters.size == (char *)&counters,\n\
        \x20       (char *)&axis.size == (char *)&axis);\n\
        \x20   return ecmsk_version() == NULL || sizeof stats.size != 4 || sizeof counters.size != 4 || sizeof axis.size != 4;\n}\n";
        for language in LANGUAGES {
            let program = support::compile(&source(&name_of("ecmsk.h", language), language, text), language);
            assert_eq!(program.run("sim:", [""; 0]).success(), "1 1 1\n");
        }
    }

    /// Options by which a header with Windows' keywords compiles on Linux: README names them.
    const FOR_A_HEADER_OF_WINDOWS: &str = "'-D__declspec(x)=' -D__stdcall=";

    /// The text of headers for Windows: the keywords of an import and of the calling convention.
    const HEADER_OF_WINDOWS: &str = "
#ifdef NEXTWUSBLIB_EXPORTS
#define NEXTWUSBLIB_API __declspec(dllexport)
#else
#define NEXTWUSBLIB_API __declspec(dllimport)
#endif
#define DEF_MA_MAX 42
struct transData { unsigned short CMD; unsigned short Parm; unsigned int Data1; unsigned int Data2; };
extern \"C\" {
NEXTWUSBLIB_API bool __stdcall OpenECMUSB(void);
NEXTWUSBLIB_API void __stdcall CloseECMUSB(void);
NEXTWUSBLIB_API bool __stdcall ECMUSBWrite(unsigned char *data, unsigned long dwlength);
NEXTWUSBLIB_API bool __stdcall ECMUSBRead(unsigned char *data, unsigned long dwlength);
}
";

    /// LIB-68 A program that keeps a header for Windows beside its source compiles with the options that README names, and
    /// runs; they do no harm with this project's header.
    #[test]
    fn a_header_for_windows_beside_the_source() {
        let readme = fs::read_to_string(support::root().join("README.md")).expect("README.md");
        assert!(readme.contains(FOR_A_HEADER_OF_WINDOWS), "README names the options");
        // As a shell takes them.
        let options: Vec<String> =
            FOR_A_HEADER_OF_WINDOWS.split(' ').map(|option| option.trim_matches('\'').to_owned()).collect();
        for (name, own_header) in [("windows", true), ("ours", false)] {
            let folder = support::out_dir().join(format!("header-of-{name}"));
            let _ = fs::remove_dir_all(&folder);
            fs::create_dir_all(&folder).expect("a folder in the target folder");
            if own_header {
                fs::write(folder.join("NEXTWUSBLib_12B.h"), HEADER_OF_WINDOWS).expect("a header");
            }
            let source = folder.join("program.cpp");
            let program = "#include \"NEXTWUSBLib_12B.h\"\n#include <cstdio>\n\
                 static transData slots[DEF_MA_MAX];\n\
                 int main() {\n\
                 \x20   if (!OpenECMUSB() || !ECMUSBWrite((unsigned char *)slots, sizeof slots)) return 1;\n\
                 \x20   if (!ECMUSBRead((unsigned char *)slots, sizeof slots)) return 2;\n\
                 \x20   std::printf(\"%u\\n\", slots[0].Parm & 0xFFu);\n\
                 \x20   CloseECMUSB();\n\
                 }\n";
            fs::write(&source, program).expect("a source");
            let exe = folder.join("program");
            let mut compiler = Cpp("c++17").compiler();
            compiler.args(&options).arg(&source).arg("-o").arg(&exe).arg("-L").arg(&support::library().dir);
            support::succeed(compiler.arg("-lNEXTWUSBLib"));
            let ended = support::Program { exe }.run("sim:?slaves=drive&clock=virtual", [""; 0]);
            assert_eq!(ended.success(), "2\n", "PreOP, {name}");
            if own_header {
                let without = Cpp("c++17").compiler().arg("-fsyntax-only").arg(&source).output().expect("g++ runs");
                assert!(!without.status.success(), "the options are what it needs");
            }
        }
    }
}
