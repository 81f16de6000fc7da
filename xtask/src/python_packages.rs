//! What the tests and the packages of the Python package take from PyPI: maturin, which makes its wheel, pytest, NumPy, the
//! checkers of its types and of its wheel, each with the packages that it depends on. The versions are for CPython 3.11 on
//! Linux on x86-64 (Debian 12). A test finds them by their names in `target/xtask`.

use std::env;
use std::ffi::OsString;

use crate::fetched::{Fetched, Index};
use crate::needs::{NODE, NPM, Need, PIP, PYTHON, joined};
use crate::project::Project;

/// A wheel. `file` is one of its files, which is there if the wheel was unpacked.
const fn wheel(
    name: &'static str,
    version: &'static str,
    file: &'static str,
    cost: &'static str,
    sha256: &'static str,
) -> Fetched {
    Fetched { index: Index::Pip, name, version, sha256, program: file, cost }
}

/// A wheel of less than half a megabyte.
const fn small(name: &'static str, version: &'static str, file: &'static str, sha256: &'static str) -> Fetched {
    wheel(name, version, file, "some kB", sha256)
}

/// The program that builds wheels of Rust crates.
pub static MATURIN: Fetched = wheel(
    "maturin",
    "1.16.0",
    "maturin-1.16.0.data/scripts/maturin",
    "11 MB to fetch, 30 MB in the target folder",
    "837db2f4d93d4899c3ac393fb3cc9eebf35b6002336e5d574f4a4fb6c49fe283",
);

/// What the tests need besides: NumPy for recordings as arrays, mypy with its packages, pytest with its packages.
pub static OF_THE_TESTS: [Fetched; 12] = [
    wheel(
        "numpy",
        "2.4.6",
        "numpy/__init__.py",
        "17 MB to fetch, 60 MB in the target folder",
        "89cd468399cfd2504718f0ba50e410dca55a170b61a02ad92bb18c8a65186e93",
    ),
    wheel(
        "mypy",
        "2.4.1",
        "mypy/__init__.py",
        "15 MB to fetch, 60 MB in the target folder",
        "b69a15fc2e75858d6b15e91ed3a0dcff1a533265183b64734138791fe0f49aa5",
    ),
    wheel(
        "ast_serialize",
        "0.13.1",
        "ast_serialize/__init__.py",
        "1 MB to fetch, 3 MB in the target folder",
        "9f99786e0d62082a5b121b3437f3167562133711df22128de1e9886f57f0b226",
    ),
    wheel(
        "librt",
        "0.17.0",
        "librt-0.17.0.dist-info/METADATA",
        "600 kB to fetch, 2 MB in the target folder",
        "598c5455f07fc182a926b88e63776c49dc4cf47465c998cbc6ba1f010b875b51",
    ),
    small(
        "mypy_extensions",
        "1.2.0",
        "mypy_extensions.py",
        "993e7a20aa5671eb41a7132cf555af30062da99729601601b9a8382b11cae768",
    ),
    small(
        "pathspec",
        "1.1.1",
        "pathspec/__init__.py",
        "a00ce642f577bf7f473932318056212bc4f8bfdf53128c78bbd5af0b9b20b189",
    ),
    small(
        "typing_extensions",
        "4.16.0",
        "typing_extensions.py",
        "481caa481374e813c1b176ada14e97f1f67a4539ce9cfeb3f350d78d6370c2e8",
    ),
    wheel(
        "pytest",
        "9.2.0",
        "pytest/__init__.py",
        "400 kB to fetch, 2 MB in the target folder",
        "07acdcf88ec174f907dc01af70bf52d49b014bbab03faeeade31c96b18c2e588",
    ),
    small(
        "iniconfig",
        "2.3.1",
        "iniconfig/__init__.py",
        "9121e2c1fdb355232495be3194c8dfe87ccc2d5dee45947b78e68f499790d7a7",
    ),
    small(
        "packaging",
        "26.4",
        "packaging/__init__.py",
        "81383611a09c1bc0b08b76e0fd5829d7c6824c65b27a6aee339da133f4233ea2",
    ),
    small("pluggy", "1.7.0", "pluggy/__init__.py", "7dd7b0d8832ba3cb632c306926ded123429211b83641b35dc5c41ad2d34f9bec"),
    wheel(
        "pygments",
        "2.21.0",
        "pygments/__init__.py",
        "1 MB to fetch, 5 MB in the target folder",
        "2363c69b61c4a97c838da3b130dcd6468f4848992b21a82f2a63ec34377137d9",
    ),
];

/// `wheel`, which packs a wheel, its judges auditwheel and abi3audit, and the packages that these depend on.
pub static OF_THE_WHEELS: [Fetched; 20] = [
    small(
        "abi3audit",
        "0.0.26",
        "abi3audit/__init__.py",
        "b94b774984e50ec03481c1dda88c48079f6baec870b263bf7f5e7415feb8802d",
    ),
    small(
        "abi3info",
        "2026.9.25",
        "abi3info/__init__.py",
        "d5cbf46f358a4e0cafa171572adb67e5dce14a1b316e3c9f577234dbafcd5214",
    ),
    small("attrs", "26.1.0", "attrs/__init__.py", "c647aa4a12dfbad9333ca4e71fe62ddc36f4e63b2d260a37a8b83d2f043ac309"),
    small(
        "auditwheel",
        "6.8.2",
        "auditwheel/__init__.py",
        "05fd2dd4b743217cd5f66066adc95b03a079424b1f0a878ad1e40fe2cdea4704",
    ),
    small("cattrs", "26.2.1", "cattrs/__init__.py", "a12aaa3453dc8f633a815293179f08b7421ed18d2575c459c3c736f840beac24"),
    small(
        "certifi",
        "2026.10.19.post1",
        "certifi/__init__.py",
        "1324c476b4811eff41a8bc2122cd0bbd4d9c7234c725446d99ab1612b3a7fdd2",
    ),
    small(
        "charset_normalizer",
        "3.5.3",
        "charset_normalizer/__init__.py",
        "2a6f937e0b70133d1f826d0a253331b6fe1a4c874808cc12e16f2fb8177042f4",
    ),
    small("idna", "3.20", "idna/__init__.py", "ab7ae7122974553370f0bdb919e1a960b2cd1bc1ef0276416d896db81c14582c"),
    small(
        "kaitaistruct",
        "0.11",
        "kaitaistruct.py",
        "5c6ce79177b4e193a577ecd359e26516d1d6d000a0bffd6e1010f2a46a62a561",
    ),
    small(
        "markdown_it_py",
        "4.3.0",
        "markdown_it/__init__.py",
        "7aa1511a46c39138de78d9eba92ce47e63124d8003fc98b3a351909e04239efa",
    ),
    small("mdurl", "0.1.2", "mdurl/__init__.py", "84008a41e51615a49fc9966191ff91509e3c40b939176e643fd50a5c2196b8f8"),
    small("pefile", "2024.8.26", "pefile.py", "76f8b485dcd3b1bb8166f1128d395fa3d87af26360c2358fb75b80019b957c6f"),
    small(
        "platformdirs",
        "4.14.9",
        "platformdirs/__init__.py",
        "d0d3a23e7ff282cfa94b77f5a22b81030dcb68ba0430f90c74f4bd8d090782ea",
    ),
    small(
        "pyelftools",
        "0.33",
        "elftools/__init__.py",
        "f215ad5f47d3f1373a21496a6c9e0707c622840d0622f23ff7ce08678b020036",
    ),
    small(
        "requests",
        "2.34.2",
        "requests/__init__.py",
        "2a0d60c172f83ac6ab31e4554906c0f3b3588d37b5cb939b1c061f4907e278e0",
    ),
    small(
        "requests_cache",
        "1.3.3",
        "requests_cache/__init__.py",
        "c8df20ff874ebfc026959e3874e6c12bd6724934cdb10925915908453d4b17e4",
    ),
    small("rich", "15.0.0", "rich/__init__.py", "33bd4ef74232fb73fe9279a257718407f169c09b78a87ad3d296f548e27de0bb"),
    small(
        "url_normalize",
        "3.1.0",
        "url_normalize/__init__.py",
        "34c386c6b2dbde760eaaaa8542dc29995c75f2baf94acceee18e5b6b29579469",
    ),
    small(
        "urllib3",
        "2.8.0",
        "urllib3/__init__.py",
        "0cf3cae568d36aa9576b28dfb35f11328f1cb974ca7647d9475ebb86c75ac6e3",
    ),
    small("wheel", "0.48.0", "wheel/__init__.py", "3217dcc807155e45db462d7ef2431f5ddda0d7273b700d05a67b271ceb1287ab"),
];

/// What makes a wheel.
const MAKES: &[Need] = &[PYTHON, PIP, Need::fetched(&MATURIN)];
/// What the tests need: a wheel, and [`OF_THE_TESTS`].
pub const TESTS: &[Need] = &joined::<{ MAKES.len() + OF_THE_TESTS.len() }>(&[MAKES, &needs(&OF_THE_TESTS)]);
/// What the tests of its types with Pyright need.
pub const PYRIGHT: &[Need] =
    &joined::<{ TESTS.len() + 3 }>(&[TESTS, &[NODE, NPM, Need::fetched(&crate::npm::PYRIGHT)]]);
/// What packs and judges a wheel: [`OF_THE_WHEELS`], some of which depend on packages of the tests.
pub const WHEELS: &[Need] = &joined::<{ TESTS.len() + OF_THE_WHEELS.len() }>(&[TESTS, &needs(&OF_THE_WHEELS)]);

const fn needs<const N: usize>(packages: &'static [Fetched; N]) -> [Need; N] {
    let mut needs = [PYTHON; N];
    let mut at = 0;
    while at < N {
        needs[at] = Need::fetched(&packages[at]);
        at += 1;
    }
    needs
}

/// The folders of all packages, for `PYTHONPATH`.
pub fn path(project: &Project) -> OsString {
    let packages = OF_THE_TESTS.iter().chain(&OF_THE_WHEELS);
    env::join_paths(packages.map(|package| package.folder(project))).unwrap_or_default()
}
