//! What the tests of the Python package take from PyPI: the program that makes its wheel, the checker of its types, pytest and
//! NumPy, each with the packages that it needs. The versions are for CPython 3.11 on Linux on x86-64 (Debian 12). A test finds
//! them by their names in `target/xtask`.

use crate::fetched::{Fetched, Index};

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

/// The program that builds wheels of Rust crates.
pub const MATURIN: Fetched = wheel(
    "maturin",
    "1.16.0",
    "maturin-1.16.0.data/scripts/maturin",
    "11 MB to fetch, 30 MB in the target folder",
    "837db2f4d93d4899c3ac393fb3cc9eebf35b6002336e5d574f4a4fb6c49fe283",
);
/// NumPy, for the tests that read recordings as arrays.
pub const NUMPY: Fetched = wheel(
    "numpy",
    "2.4.6",
    "numpy/__init__.py",
    "17 MB to fetch, 60 MB in the target folder",
    "89cd468399cfd2504718f0ba50e410dca55a170b61a02ad92bb18c8a65186e93",
);
/// mypy, the checker of types.
pub const MYPY: Fetched = wheel(
    "mypy",
    "2.4.1",
    "mypy/__init__.py",
    "15 MB to fetch, 60 MB in the target folder",
    "b69a15fc2e75858d6b15e91ed3a0dcff1a533265183b64734138791fe0f49aa5",
);
/// A package that mypy depends on.
pub const AST_SERIALIZE: Fetched = wheel(
    "ast_serialize",
    "0.13.1",
    "ast_serialize/__init__.py",
    "1 MB to fetch, 3 MB in the target folder",
    "9f99786e0d62082a5b121b3437f3167562133711df22128de1e9886f57f0b226",
);
/// A package that mypy depends on.
pub const LIBRT: Fetched = wheel(
    "librt",
    "0.17.0",
    "librt-0.17.0.dist-info/METADATA",
    "600 kB to fetch, 2 MB in the target folder",
    "598c5455f07fc182a926b88e63776c49dc4cf47465c998cbc6ba1f010b875b51",
);
/// A package that mypy depends on: types for its own plugins.
pub const MYPY_EXTENSIONS: Fetched = wheel(
    "mypy_extensions",
    "1.2.0",
    "mypy_extensions.py",
    "some kB",
    "993e7a20aa5671eb41a7132cf555af30062da99729601601b9a8382b11cae768",
);
/// A package that mypy depends on: patterns of file names.
pub const PATHSPEC: Fetched = wheel(
    "pathspec",
    "1.1.1",
    "pathspec/__init__.py",
    "some kB",
    "a00ce642f577bf7f473932318056212bc4f8bfdf53128c78bbd5af0b9b20b189",
);
/// A package that mypy depends on: features of newer versions of `typing`.
pub const TYPING_EXTENSIONS: Fetched = wheel(
    "typing_extensions",
    "4.16.0",
    "typing_extensions.py",
    "some kB",
    "481caa481374e813c1b176ada14e97f1f67a4539ce9cfeb3f350d78d6370c2e8",
);
/// pytest, which runs the Python tests.
pub const PYTEST: Fetched = wheel(
    "pytest",
    "9.2.0",
    "pytest/__init__.py",
    "400 kB to fetch, 2 MB in the target folder",
    "07acdcf88ec174f907dc01af70bf52d49b014bbab03faeeade31c96b18c2e588",
);
/// A package that pytest depends on: a parser of INI files.
pub const INICONFIG: Fetched = wheel(
    "iniconfig",
    "2.3.1",
    "iniconfig/__init__.py",
    "some kB",
    "9121e2c1fdb355232495be3194c8dfe87ccc2d5dee45947b78e68f499790d7a7",
);
/// A package that pytest depends on: versions of packages.
pub const PACKAGING: Fetched = wheel(
    "packaging",
    "26.4",
    "packaging/__init__.py",
    "some kB",
    "81383611a09c1bc0b08b76e0fd5829d7c6824c65b27a6aee339da133f4233ea2",
);
/// A package that pytest depends on: its system of plugins.
pub const PLUGGY: Fetched = wheel(
    "pluggy",
    "1.7.0",
    "pluggy/__init__.py",
    "some kB",
    "7dd7b0d8832ba3cb632c306926ded123429211b83641b35dc5c41ad2d34f9bec",
);
/// A package that pytest depends on: syntax highlighting.
pub const PYGMENTS: Fetched = wheel(
    "pygments",
    "2.21.0",
    "pygments/__init__.py",
    "1 MB to fetch, 5 MB in the target folder",
    "2363c69b61c4a97c838da3b130dcd6468f4848992b21a82f2a63ec34377137d9",
);
