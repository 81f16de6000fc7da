//! The packages that Windows' installer puts in place (`.msi`), one for each width: the files of the zip package, with the
//! tool in a folder of its own, which is added to PATH. wixl (of msitools) makes the database from a description in WiX's
//! language. What it cannot say is written afterwards: the change of PATH, versions of files, which packages this one replaces,
//! and what depends on the time of the build.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use uuid::Uuid;

use super::release::Release;
use super::tree::{DATA, PROGRAM, Tree};
use super::windows_zip::PROGRAMS;
use super::{archive, first_axis};
use crate::command;
use crate::error::Error;
use crate::needs::{MSIBUILD, WIXL};
use crate::project::Project;
use crate::windows::{self, Width};

/// By this id Windows knows that a package is a newer version of an installed one, so it never changes. Ids of the parts of a
/// package are derived from it. The packages of the two widths may be installed side by side.
const fn upgrade_id(width: Width) -> Uuid {
    Uuid::from_u128(match width {
        Width::X86 => 0x6f2c_5a0e_0f5b_4c6f_9d53_8a3c_51e1_7a86,
        Width::X64 => 0x0b1d_77c4_0d0b_4b2c_8f0f_3f5e_6cb2_9a64,
    })
}

/// The tool in the installed folder.
const TOOL: &str = "bin/ecmsk.exe";
/// The folder under Program Files.
const FOLDER: &str = "ecmsk";
/// Where msiextract, which knows the 32-bit one of Windows' folders for programs, puts that folder.
pub const EXTRACTED: [&str; 2] = ["Program Files/ecmsk", "ecmsk"];

/// Makes the package of a width from the tree of the zip package in the folder `out`; returns its path. `work` is a folder for
/// its files.
pub fn make(release: &Release, zip: &Tree, width: Width, work: &Path, out: &Path) -> Result<PathBuf, Error> {
    let tree = Tree::new(work.join(width.name()))?;
    for file in zip.files()? {
        let path = file.to_string_lossy();
        if !PROGRAMS.contains(&&*path) {
            tree.copy(&zip.root().join(&file), &path, DATA)?;
        }
    }
    tree.copy(&zip.at(&format!("{}/ecmsk.exe", width.name())), TOOL, PROGRAM)?;
    tree.set_time(release.epoch)?;
    let mut files: Vec<String> = tree.files()?.iter().map(|file| file.to_string_lossy().into_owned()).collect();
    files.sort();
    let contents: Result<String, Error> =
        files.iter().map(|file| Ok(format!("{file} {}\n", archive::sha256(&tree.at(file))?))).collect();
    let product = id_of(width, &format!("{} {}", release.version, contents?));
    let description = work.join(format!("{}.wxs", width.name()));
    fs::write(&description, in_wix(release, width, product, &files)).map_err(Error::file("write", &description))?;
    let package = out.join(format!("ecmsk-{}-{}.msi", release.version, width.name()));
    let mut wixl = release.command(WIXL.program);
    wixl.current_dir(tree.root()).args(["--arch", width.name(), "--output"]).arg(&package).arg(&description);
    command::output(&mut wixl)?;
    add(release, width, &files, &package)?;
    set_id_and_times(release, product, &package).map_err(Error::file("finish", &package))?;
    Ok(package)
}

/// Installs the package under Wine and moves an axis with the tool, which PATH then finds.
pub fn first_axis(project: &Project, width: Width, package: &Path) -> Result<(), Error> {
    let words: Vec<&str> = ["ecmsk.exe"].into_iter().chain(first_axis::MOVE).collect();
    first_axis::timed(&format!("the msi file under Wine ({})", width.name()), first_axis::MOVED, || {
        windows::run_installed(project, width, package, FOLDER, &words)
    })
}

/// The id of a part of the package.
fn id_of(width: Width, part: &str) -> Uuid {
    Uuid::new_v5(&upgrade_id(width), part.as_bytes())
}

/// The name of the component that consists of this file.
fn component(files: &[String], file: &str) -> String {
    format!("File{}", files.iter().position(|other| other == file).unwrap_or_default())
}

/// The name of the folder that ends with this path, below the installed one.
fn folder_id(path: &str) -> String {
    if path.is_empty() { "INSTALLDIR".to_owned() } else { format!("In_{}", path.replace('/', "_")) }
}

/// Describes the package in WiX's language.
fn in_wix(release: &Release, width: Width, product: Uuid, files: &[String]) -> String {
    let program_files = match width {
        Width::X86 => "ProgramFilesFolder",
        Width::X64 => "ProgramFiles64Folder",
    };
    let upgrade = upgrade_id(width);
    let mut folders: Vec<&str> =
        files.iter().flat_map(|file| Path::new(file).ancestors().skip(1)).filter_map(Path::to_str).collect();
    folders.sort_unstable();
    folders.dedup();
    let mut text = format!(
        r#"<?xml version="1.0" encoding="utf-8"?>
<Wix xmlns="http://schemas.microsoft.com/wix/2006/wi">
  <Product Id="{product:X}" UpgradeCode="{upgrade:X}" Name="ecmsk ({width})" Version="{version}" Language="1033"
           Manufacturer="The ecmsk authors">
    <Package InstallerVersion="200" Compressed="yes" InstallScope="perMachine" Manufacturer="The ecmsk authors"
             Description="ecmsk {version} ({width})" Comments="Programs for the ECM-SK, without the vendor's library"/>
    <MajorUpgrade DowngradeErrorMessage="A newer version of ecmsk is installed; remove it first."/>
    <Property Id="REINSTALLMODE" Value="amus"/>
    <Media Id="1" Cabinet="ecmsk.cab" EmbedCab="yes"/>
    <Directory Id="TARGETDIR" Name="SourceDir">
      <Directory Id="{program_files}">
        <Directory Id="INSTALLDIR" Name="{FOLDER}"/>
      </Directory>
    </Directory>
"#,
        version = release.version,
        width = width.name(),
    );
    let win64 = if width == Width::X64 { "yes" } else { "no" };
    for folder in folders.into_iter().filter(|folder| !folder.is_empty()) {
        let (parent, name) = folder.rsplit_once('/').unwrap_or(("", folder));
        let (parent, own) = (folder_id(parent), folder_id(folder));
        let _ =
            writeln!(text, r#"    <DirectoryRef Id="{parent}"><Directory Id="{own}" Name="{name}"/></DirectoryRef>"#);
    }
    for file in files {
        let (folder, name) = file.rsplit_once('/').unwrap_or(("", file));
        let (folder, id, guid) = (folder_id(folder), component(files, file), id_of(width, file));
        let _ = writeln!(
            text,
            r#"    <DirectoryRef Id="{folder}"><Component Id="{id}" Guid="{guid:X}" Win64="{win64}"><File Id="{id}" Name="{name}" Source="{file}" KeyPath="yes"/></Component></DirectoryRef>"#
        );
    }
    text.push_str("    <Feature Id=\"All\" Title=\"ecmsk\" Level=\"1\">\n");
    for file in files {
        let _ = writeln!(text, r#"      <ComponentRef Id="{}"/>"#, component(files, file));
    }
    text + "    </Feature>\n  </Product>\n</Wix>\n"
}

/// The version that a file names in its resources, if it is not that of the release: assemblies have the vendor's.
fn version_of(release: &Release, file: &str) -> Option<String> {
    match Path::new(file).file_name()?.to_str()? {
        name if name.starts_with("NEXTWUSB_dotNET") && name.ends_with(".dll") => Some("2.0.0.0".to_owned()),
        name if name.ends_with(".dll") || name.ends_with(".exe") => Some(format!("{}.0", release.version)),
        _ => None,
    }
}

/// Adds what wixl has no words for: the folder of the tool in PATH, the versions of files, and that a package of the same version
/// replaces this one, too.
fn add(release: &Release, width: Width, files: &[String], package: &Path) -> Result<(), Error> {
    // `=`: set when installed; `-`: removed with the package; `*`: of the machine. `[~]` stands for what PATH has already.
    let row = format!("'Path', '=-*PATH', '[~];[{}]', '{}'", folder_id("bin"), component(files, TOOL));
    let action = |name: &str, number: u16| {
        format!("INSERT INTO `InstallExecuteSequence` (`Action`, `Sequence`) VALUES ('{name}', {number})")
    };
    // Without its version a file counts as older than an installed one that has one. It would not be copied, and removed with
    // the old package.
    let versions = files.iter().filter_map(|file| {
        let (version, id) = (version_of(release, file)?, component(files, file));
        Some(format!("UPDATE `File` SET `Version` = '{version}', `Language` = '1033' WHERE `File` = '{id}'"))
    });
    let queries = [
        "CREATE TABLE `Environment` (`Environment` CHAR(72) NOT NULL, `Name` CHAR(255) NOT NULL LOCALIZABLE, \
         `Value` CHAR(255) LOCALIZABLE, `Component_` CHAR(72) NOT NULL PRIMARY KEY `Environment`)"
            .to_owned(),
        format!("INSERT INTO `Environment` (`Environment`, `Name`, `Value`, `Component_`) VALUES ({row})"),
        action("RemoveEnvironmentStrings", 3300),
        action("WriteEnvironmentStrings", 5200),
        "DELETE FROM `Upgrade` WHERE `ActionProperty` = 'WIX_UPGRADE_DETECTED'".to_owned(),
        // 1: takes the features over; 512: up to this version, including it.
        format!(
            "INSERT INTO `Upgrade` (`UpgradeCode`, `VersionMax`, `Attributes`, `ActionProperty`) \
             VALUES ('{{{:X}}}', '{}', 513, 'WIX_UPGRADE_DETECTED')",
            upgrade_id(width),
            release.version
        ),
    ];
    let mut msibuild = release.command(MSIBUILD.program);
    msibuild.arg(package);
    for query in queries.into_iter().chain(versions) {
        msibuild.arg("-q").arg(query);
    }
    command::output(&mut msibuild).map(drop)
}

/// Gives the package an id and times that do not depend on the build. msitools has no option for them.
fn set_id_and_times(release: &Release, product: Uuid, package: &Path) -> std::io::Result<()> {
    let mut database = ::msi::open_rw(package)?;
    let time = UNIX_EPOCH + Duration::from_secs(release.epoch);
    let summary = database.summary_info_mut();
    // Like the product's it comes from the contents: Windows takes two packages with one id for the same file.
    summary.set_uuid(Uuid::new_v5(&product, &release.epoch.to_le_bytes()));
    summary.set_creation_time(time);
    summary.set_last_save_time(time);
    database.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ids by which Windows tells packages and parts of them apart: a part keeps its id in another package, whose id is another
    /// one; the widths share none. Windows wants them in upper case.
    #[test]
    fn windows_tells_packages_apart() {
        let files = ["README.txt".to_owned(), TOOL.to_owned()];
        let ids = |product: &str, width| {
            let release = Release { version: "0.1.0", epoch: 1_795_305_600 };
            let text = in_wix(&release, width, id_of(width, product), &files);
            let of = |name: &str| {
                let begin = format!("{name}=\"");
                text.split(&begin).skip(1).map(|rest| rest.split('"').next().unwrap().to_owned()).collect::<Vec<_>>()
            };
            [of("UpgradeCode"), of("Guid"), of("<Product Id")]
        };
        let [upgrade, parts, product] = ids("one", Width::X64);
        assert_eq!([upgrade.len(), parts.len(), product.len()], [1, 2, 1]);
        let all = [&upgrade[..], &parts[..], &product[..]].concat();
        assert!(all.iter().all(|id| id.len() == 36 && *id == id.to_uppercase()), "{all:?}");
        let newer = ids("another", Width::X64);
        assert_eq!([&newer[0], &newer[1]], [&upgrade, &parts]);
        assert_ne!(newer[2], product);
        let other = ids("one", Width::X86);
        assert!(other[0] != upgrade && other[2] != product && parts.iter().all(|part| !other[1].contains(part)));
    }

    /// What has a version in its resources has the same one in the package, or an upgrade would remove it.
    #[test]
    fn files_with_a_version_name_it() {
        let release = Release { version: "0.3.0", epoch: 1_795_305_600 };
        let of = |file| version_of(&release, file);
        assert_eq!(of("x64/NEXTWUSB_dotNET_12B.dll").as_deref(), Some("2.0.0.0"));
        assert_eq!([of(TOOL), of("x86/NEXTWUSBLib.dll")].map(Option::unwrap), ["0.3.0.0", "0.3.0.0"]);
        assert_eq!([of("dotnet/NEXTWUSB_dotNET.xml"), of("lib/x64/libNEXTWUSBLib.dll.a")], [None, None]);
    }
}
